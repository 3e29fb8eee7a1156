"""Columns that nothing is fitted to: a motor's current tells what its speed does not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from diagnosis.api import diagnose
from diagnosis.binding import find_recording
from diagnosis.recordings.types import Recording
from diagnosis.search.posterior import probabilities, told_as
from diagnosis.search.spare_channels import _sentence
from diagnosis.search.study import LEAST_ODDS, SpareEvidence
from diagnosis.thresholds import EVIDENCE
from engine.errors import FlexarmError
from scenarios.load import load
from tests.diagnosis.plants import (
    EFFICIENCY,
    INERTIA,
    RECORDING,
    RESISTANCE,
    SCENARIO,
    TORQUE_CONSTANT,
    VISCOUS,
    inputs,
)

CURRENT = "      motor.current: {{column: i, unit: A, noise: 0.002 A, use: evidence}}\n"


LAG = 0.02
"""Time constant (s) of what is concealed."""

PARTS = 20
"""Steps of the integration in a sample."""


def case(folder: Path, late: Literal["input", "sensor"], *, spare: bool = True) -> Path:
    """A motor whose voltage or whose speed's sensor is late; a current through a sensor that nobody calibrated."""
    folder.mkdir(exist_ok=True)
    random = np.random.default_rng(3)
    t = np.arange(0.0, 2.0 + 1e-9, 2e-3)
    text = SCENARIO.format(resistance=RESISTANCE, inertia=INERTIA)
    gain = EFFICIENCY * TORQUE_CONSTANT / RESISTANCE
    damping = VISCOUS + gain * TORQUE_CONSTANT
    h = (t[1] - t[0]) / PARTS
    decay, filtered = math.exp(-damping / INERTIA * h), math.exp(-h / LAG)
    for name, (role, u) in inputs(t).items():
        rows, volt, speed, shown = [], 0.0, 0.0, 0.0
        for wanted in u:
            acting = wanted if late == "sensor" else volt
            rows.append((shown if late == "sensor" else speed, (acting - TORQUE_CONSTANT * speed) / RESISTANCE))
            for _ in range(PARTS):
                before = speed
                volt = wanted + (volt - wanted) * filtered
                end = gain * (wanted if late == "sensor" else volt) / damping
                speed = end + (speed - end) * decay
                middle = 0.5 * (before + speed)
                shown = middle + (shown - middle) * filtered
        speeds, current = np.array(rows).T
        noisy = speeds + random.normal(0, 0.3, len(t)), 0.8 * current + 0.05 + random.normal(0, 0.002, len(t))
        columns = np.column_stack([t, u, *noisy])
        np.savetxt(folder / f"{name}.csv", columns, delimiter=",", header="t,u,speed,i", comments="")
        lines = RECORDING.format(name=name, role=role).splitlines(keepends=True)
        text += "".join([*lines[:-1], CURRENT.format() if spare else "", lines[-1]])
    path = folder / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return diagnose(case(tmp_path_factory.mktemp("blind"), "sensor", spare=False), workers=2)


@pytest.fixture(scope="module")
def seeing(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return diagnose(case(tmp_path_factory.mktemp("seeing"), "sensor"), workers=2)


@pytest.mark.parametrize(
    ("late", "wanted"), [("input", "lag at source.out -> motor.voltage"), ("sensor", "sensor_lag at motor.shaft.speed")]
)
def test_the_current_says_which_side_of_a_motor_is_late(
    tmp_path: Path, blind: Any, seeing: Any, late: Literal["input", "sensor"], wanted: str
) -> None:
    """From voltage and speed alone, a lag before a linear machine and one behind it are the same.

    A winding's inductance, with one pole more as well, is little less likely.
    """
    assert blind.verdict == "tie"
    assert {t.label for t in (blind.study.chosen, *blind.rivals)} == {
        "lag at source.out -> motor.voltage",
        "sensor_lag at motor.shaft.speed",
        "inductance at motor",
    }
    if late == "input":
        seeing = diagnose(case(tmp_path, late), workers=2)
    assert seeing.verdict == "named"
    assert seeing.study.chosen.label == wanted
    study = seeing.study
    before = probabilities(told_as([study.refit, *study.trials], study.refit), study.tried)
    heard = {one.model: one.log_likelihood for one in study.spare}
    best = max(heard, key=lambda keys: heard[keys])
    some = [keys for keys in heard if study.odds[keys] > 0]  # others are beyond what a number can hold
    assert len(some) == (2 if late == "input" else 1)
    for keys in some:
        by = math.log(study.odds[best] / study.odds[keys]) - math.log(before[best] / before[keys])
        assert by == pytest.approx((heard[best] - heard[keys]) / EVIDENCE.temperature)
    told = {row["effects"][0]: row for row in seeing.numbers()["spare_channels"]}
    assert told[wanted]["log_likelihood"] == 0.0
    assert told[wanted]["correlations"]["motor.current"] > 0.99
    assert any(f"motor.current speaks for {wanted}" in text for text in seeing.warnings)


@pytest.mark.parametrize(("by", "said"), [(11.0, "does not tell them apart"), (14.0, "rather than b, 33 to 1")])
def test_what_a_spare_column_says_is_told_from_twenty_to_one_on(by: float, said: str) -> None:
    """The logarithms of likelihoods are divided by four: exp(11 / 4) = 16, exp(14 / 4) = 33."""
    keys = {name: frozenset([name]) for name in "ab"}
    heard = [SpareEvidence(keys["a"], by, {}), SpareEvidence(keys["b"], 0.0, {})]
    assert said in _sentence(heard, {key: name for name, key in keys.items()}, ["motor.current"])


def test_nothing_is_fitted_to_a_spare_column(blind: Any, seeing: Any) -> None:
    """The fit and the evidence of each model are those without it."""
    found = {m.keys: m.log_evidence for m in seeing.study.trials}
    assert found == {m.keys: pytest.approx(m.log_evidence, abs=1e-6) for m in blind.study.trials}


def test_a_spare_signal_that_the_model_does_not_have_is_refused_at_once(tmp_path: Path) -> None:
    path = case(tmp_path, "sensor")
    path.write_text(path.read_text().replace("motor.current:", "motor.curent:"))
    with pytest.raises(FlexarmError, match=r"motor\.curent"):
        diagnose(path)


def test_a_spare_signal_that_one_recording_lacks_is_refused_at_once(tmp_path: Path) -> None:
    path = case(tmp_path, "sensor")
    lines = path.read_text().splitlines(keepends=True)
    last = max(k for k, line in enumerate(lines) if "use: evidence" in line)
    path.write_text("".join(line for k, line in enumerate(lines) if k != last))
    with pytest.raises(FlexarmError, match=r"'slow' has no spare column of 'motor\.current', which 'steps' has"):
        diagnose(path)


def test_models_that_were_not_heard_keep_their_probability(blind: Any, seeing: Any) -> None:
    """What the column says is shared out among those that it was held against."""
    heard = {one.model for one in seeing.study.spare}
    before, after = blind.study.odds, seeing.study.odds
    assert heard == {keys for keys, share in before.items() if share >= LEAST_ODDS} != set(before)
    assert sum(after[keys] for keys in heard) == pytest.approx(sum(before[keys] for keys in heard))
    for keys in set(before) - heard:
        assert after[keys] == pytest.approx(before[keys], rel=1e-6, abs=1e-300)


def test_a_recording_of_spare_columns_alone_is_refused(tmp_path: Path) -> None:
    path = case(tmp_path, "sensor")
    text = path.read_text().replace(
        "motor.shaft.speed: {column: speed, unit: rad/s}",
        "motor.shaft.speed: {column: speed, unit: rad/s, use: evidence}",
    )
    path.write_text(text)
    with pytest.raises(FlexarmError, match="nothing to fit to"):
        diagnose(path)


def test_parts_of_a_recording_share_its_spare_columns_out(tmp_path: Path) -> None:
    whole = find_recording(load(case(tmp_path, "sensor")), "chirp")
    assert isinstance(whole, Recording)
    parts = whole.split(0.5)
    assert parts is not None
    counts = [np.isfinite(p.spare[0].values) for p in parts]
    assert (counts[0] | counts[1]).all()
    assert (counts[0] & counts[1]).sum() < 0.05 * len(whole.time)
    assert replace(whole, spare=()).with_spare() == replace(whole, spare=())
