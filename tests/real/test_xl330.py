"""The XL330 servo: friction that grows with the load, on a gain that no parameter was fitted to; columns kept aside."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from diagnosis.api import diagnose, fit
from diagnosis.binding import find_recording
from diagnosis.effects.catalogue import EFFECTS
from diagnosis.problems import problem
from diagnosis.recordings.types import Recording
from scenarios.load import Scenario, load

STEPS = 885
"""Steps of the register `load` in a duty of one."""

SUPPLIED = {
    "  arm: {type: Inertia": "  bus: {type: Supply, source_voltage: 7.4 V, resistance: 0.5 ohm, time_constant: 1 ms}\n"
    "  share: {type: Gain, gain: 0.135135 1/V, unit: '1'}\n  drawn: {type: Product}\n  arm: {type: Inertia",
    "  - [servo.duty, acting.a]\n": "  - [servo.duty, acting.a, drawn.b]\n  - [motor.current, drawn.a]\n"
    "  - [drawn.out, bus.current]\n  - [bus.voltage, share.in]\n  - [share.out, servo.supply_share]\n",
    "enable.gain: 0,": "enable.gain: 0, share.gain: 0, bus.source_voltage: 0, bus.resistance: 1, bus.time_constant: 0,",
    "    loop: reference": "      bus.voltage: {column: entries.input_volts, unit: V, noise: 0.1, use: evidence}\n"
    "    loop: reference",
}
"""What gives the servo a supply with a resistance, whose voltage is the column `input_volts`."""


@pytest.fixture
def logs(recordings: Path) -> Path:
    if not (recordings / "bam_xl330").is_dir():
        pytest.skip("no bam_xl330")
    return recordings / "bam_xl330"


def held_out(name: str, *overrides: str) -> float:
    """Mean absolute error of the position (rad) at gain 200, fitted at 100 and 400; each recording counts as much."""
    found, _ = fit(name, overrides=overrides)
    errors = []
    for e in found.problem.experiments:
        if e.name.startswith("kp200"):
            left = (found.problem.residual(found.x, e) * e.sigma)[np.isfinite(e.measured)]
            errors.append(float(np.abs(left).mean()))
    assert len(errors) == 4
    return float(np.mean(errors))


def read(scenario: Scenario) -> list[Recording]:
    found = [find_recording(scenario, name) for name in scenario.recordings]
    assert all(isinstance(r, Recording) for r in found)
    return [r for r in found if isinstance(r, Recording)]


def beside(source: str | Path, *overrides: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """What the fitted model says of all columns, spare ones too, and what was logged, for each recording."""
    scenario = load(str(source), overrides)
    found, _ = fit(scenario)
    wide = problem(scenario, [r.with_spare() for r in read(scenario)])
    told = {}
    for e in wide.experiments:
        left = wide.residual(found.x, e) * e.sigma
        known = np.isfinite(e.measured).all(axis=1)
        told[e.name] = (e.measured[known] - left[known], e.measured[known])
    return told


def test_the_duty_wraps_and_is_said_to(logs: Path) -> None:
    """Every log in which the motor pulls both ways jumps between 0 and 65535, and a mapping without `wrap:` is told."""
    bare = Path(load("xl330").document.file).read_text(encoding="utf-8").replace(", wrap: int16", "")
    for recording in read(load("xl330", text=bare)):
        told = [note for note in recording.notes if "entries.load" in note]
        turns = "up_and_down" not in recording.name
        assert len(told) == turns
        assert all("'wrap: int16'" in note and re.search(r"rows \d+, \d+", note) for note in told)


def test_the_duty_is_what_the_firmwares_law_makes_of_goal_and_position(logs: Path) -> None:
    """The scenario's law, row by row of the same file: to 4 steps of 885 over all logs, so that nothing lags in it."""
    left = []
    for recording in read(load("xl330")):
        goal, on = (channel.values for channel in recording.drive)
        gain = float(str(recording.settings["servo.proportional_gain"]).split()[0])
        duty = np.clip(gain * (goal - recording.measurements[0].values), -1.0, 1.0) * on
        (logged,) = recording.spare
        left.append(STEPS * (logged.values - duty))
        assert np.corrcoef(logged.values, duty)[0, 1] > 0.999
    assert np.concatenate(left).std() < 5.0


@pytest.mark.slow
def test_the_duty_on_the_gain_that_nobody_fitted_to_is_told_twice_as_well(logs: Path) -> None:
    """Nothing was fitted to it: steps of 885 by which it is missed, each recording counting as much."""

    def missed(name: str, *overrides: str) -> float:
        told = {key: made for key, made in beside(name, *overrides).items() if key.startswith("kp200")}
        return STEPS * float(np.mean([np.abs(measured[:, 1] - made[:, 1]).mean() for made, measured in told.values()]))

    assert missed("xl330") == pytest.approx(25.0, abs=2.0)
    assert missed("xl330-loaded", "limit.current_limit=100 A") == pytest.approx(13.1, abs=2.0)


@pytest.mark.slow
def test_the_supply_does_not_sag_as_the_position_would_have_it(logs: Path, tmp_path: Path) -> None:
    """A resistance of the supply lets the position fit better; the voltage that was logged does not know of it."""
    text = Path(load("xl330-loaded").document.file).read_text(encoding="utf-8")
    for old, new in SUPPLIED.items():
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "supplied.yaml"
    path.write_text(text, encoding="utf-8")
    told = beside(path, "limit.current_limit=100 A")
    held = [np.abs(made[:, 0] - measured[:, 0]).mean() for key, (made, measured) in told.items() if "kp200" in key]
    assert 1e3 * float(np.mean(held)) == pytest.approx(25.5, abs=1.5)
    sags = np.concatenate([made[:, 2] - made[:, 2].mean() for made, _ in told.values()])
    volts = np.concatenate([measured[:, 2] - measured[:, 2].mean() for _, measured in told.values()])
    assert sags.std() > 0.2
    assert abs(float(sags @ volts / (sags @ sags))) < 0.2, "it would be one"


@pytest.mark.slow
def test_the_diagnosis_asks_the_duty_which_of_two_loads_is_right(logs: Path) -> None:
    """Friction with the torque of the motor, and with that of the weight beside it; the column is held against both."""
    found = diagnose("xl330", workers=2, without=sorted(set(EFFECTS) - {"load_dependent_friction"}))
    assert found.study.spare
    assert all(one.correlations["acting.out"] > 0.99 for one in found.study.spare)
    assert any("the spare signal acting.out" in text for text in found.warnings)


@pytest.mark.slow
def test_friction_that_grows_with_the_load_halves_the_error(logs: Path) -> None:
    refit, loaded = held_out("xl330"), held_out("xl330-loaded")
    assert refit == pytest.approx(0.0534, abs=0.003)
    assert loaded < 0.032
    # A share that grows with the load itself does what the published law M6 does, which squares it too.
    squared = ("limit.current_limit=100 A", "loaded.quadratic_coefficient=0.15 1/(N.m)")
    assert held_out("xl330-loaded", *squared) == pytest.approx(0.0243, abs=0.001)
    # Without a limit that acts, the same: these recordings do not ask for one once the friction is right.
    assert held_out("xl330-loaded", "limit.current_limit=100 A") == pytest.approx(loaded, abs=0.002)
