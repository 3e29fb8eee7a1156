"""Laws that are alike, sizes that are bounded or only chosen, and a mismatch that one recording alone shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis import api
from diagnosis.api import diagnose, gather
from diagnosis.effects.catalogue import EFFECTS, candidates
from diagnosis.effects.effect import Candidate, EffectParameter
from diagnosis.effects.scales import operating_scales
from diagnosis.problems import problem
from diagnosis.recordings.types import Recorded
from diagnosis.search.equivalent_effects import lookalikes, one_law
from diagnosis.search.exchange import exchanged
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.posterior import prices
from diagnosis.search.study import Study
from diagnosis.thresholds import FITTING, INTERVALS, SEARCH
from diagnosis.verdict import verdict, wording
from engine.errors import FlexarmError
from scenarios.load import load
from tests.diagnosis import plants
from tests.diagnosis.plants import case


@pytest.fixture(scope="module")
def fitter(tmp_path_factory: pytest.TempPathFactory) -> CandidateFitter:
    scenario = load(case(tmp_path_factory.mktemp("bench"), seed=2))
    return CandidateFitter(scenario, gather(scenario, [], []), 1)


@pytest.fixture(scope="module")
def listed(fitter: CandidateFitter) -> Any:
    return candidates(operating_scales(fitter.base))


def found(listed: Any, effect: Any, place: str = "motor.shaft") -> Any:
    return next(c for c in listed if (c.effect, c.place) == (effect, place))


def made(*effects: tuple[str, str]) -> Any:
    """A model of some effects, each with its place, as far as `lookalikes` sees it."""
    return SimpleNamespace(
        effects=tuple(Candidate(e, place, place, f"found_{e}", lambda v: []) for e, place in effects)
    )


def test_a_single_effect_is_tried_as_the_pair_that_it_may_be_taken_for() -> None:
    """Each of the pair where it does best, beside the effects that stay."""
    singles = [made(("coulomb_friction", "arm")), made(("offset", "u")), made(("coulomb_friction", "motor"))]
    chosen = made(("lag", "u"), ("direction_dependent_friction", "arm"))
    (found,) = lookalikes(chosen, [m.effects[0] for m in singles])
    assert [c.key for c in found] == ["lag at u", "coulomb_friction at arm", "offset at u"]
    assert lookalikes(chosen, [m.effects[0] for m in singles[1:2]]) == []  # one of the pair was never fitted
    assert lookalikes(made(("lag", "u")), [m.effects[0] for m in singles]) == []


def test_a_pair_is_tried_as_the_single_effects_that_it_may_be() -> None:
    """Each where either of the two is, or everywhere if it has no place there."""
    names = [("direction_dependent_friction", "arm"), ("direction_dependent_friction", "motor"), ("dead_zone", "w")]
    singles = [made(one).effects[0] for one in names]
    chosen = made(("coulomb_friction", "arm"), ("lag", "u"), ("offset", "u"))
    rows = [[c.key for c in row] for row in lookalikes(chosen, singles)]
    assert rows == [["lag at u", "direction_dependent_friction at arm"], ["lag at u", "dead_zone at w"]]
    assert lookalikes(made(("coulomb_friction", "arm"), ("lag", "u")), singles) == []


def test_of_a_pair_what_has_no_place_there_is_put_everywhere() -> None:
    """An offset does best alone in a reference; beside the friction, it is the one at the motor that does its work."""
    singles = [
        made((name, place))
        for name, place in (
            ("offset", "reference"),
            ("coulomb_friction", "rotor"),
            ("coulomb_friction", "arm"),
            ("offset", "motor"),
        )
    ]
    found = lookalikes(made(("direction_dependent_friction", "arm")), [m.effects[0] for m in singles])
    assert [[c.key for c in pair] for pair in found] == [
        ["coulomb_friction at arm", "offset at reference"],
        ["coulomb_friction at arm", "offset at motor"],
    ]


def test_a_known_pair_counts_as_one_law() -> None:
    pair = made(("coulomb_friction", "arm"), ("offset", "u"))
    assert one_law(pair.effects) == 1
    assert prices(pair.effects) == 1
    assert prices(made(("coulomb_friction", "arm"), ("lag", "u")).effects) == 2


def test_a_further_body_is_not_heavier_than_twice_what_it_hangs_on(listed: Any) -> None:
    """Beyond that it stands still, and is a spring and a damper to the ground."""
    mode = found(listed, "extra_mode")
    free = next(f for f in mode.free(mode.starts[0]) if f.name.endswith(".inertia"))
    felt = mode.parameters[0].reference
    assert free.value(1e3) == pytest.approx(2 * felt)
    assert free.value(0.0) == mode.starts[0]["inertia"] < felt


def test_static_friction_that_a_fit_left_below_the_sliding_friction_still_makes_a_block(listed: Any) -> None:
    crossed = {"coulomb_friction": 3e-4, "static_friction": 2.9e-4, "stribeck_velocity": 1.0}
    (edit,) = found(listed, "stribeck_friction").edits(crossed)
    assert edit.parameters["static_friction"] == edit.parameters["coulomb_friction"] == "0.0003 N.m"


def test_the_inductance_is_fitted_like_any_other_size(listed: Any) -> None:
    coil = next(c for c in listed if c.effect == "inductance")
    assert [f.name for f in coil.free(coil.starts[0])] == ["motor.inductance"]


def test_a_delay_is_known_as_well_as_the_timing_and_an_order_exactly() -> None:
    study: Any = SimpleNamespace(scales=SimpleNamespace(sample=2e-3))
    row = verdict._chosen_size(study, EffectParameter("delay", 1e-3, fixed=True, unit="s"), 5e-3)
    assert row["low"] == pytest.approx(5e-3 - 1.96 * INTERVALS.input_timing * 2e-3)
    assert row["high"] == pytest.approx(5e-3 + 1.96 * INTERVALS.input_timing * 2e-3)
    order = verdict._chosen_size(study, EffectParameter("order", 1.0, fixed=True), 6.0)
    assert order == {"value": 6.0, "low": 6.0, "high": 6.0, "unit": "1"}


@pytest.mark.parametrize(
    ("gain", "told"), [(58.4, "degrees and radians"), (0.105, "rpm and rad/s"), (1e-3, "thousands"), (1.7, "")]
)
def test_a_sensor_scale_near_that_between_two_units_is_pointed_out(gain: float, told: str) -> None:
    """A scale as large as the factor, or as small as its inverse, within what other parameters take up."""
    trial = SimpleNamespace(
        added=lambda: {"sensor_scale.gain": gain},
        effects=(Candidate("sensor_scale", "arm.shaft.angle", "arm", "found", lambda values: []),),
    )
    study: Any = SimpleNamespace(chosen=trial, trials=(trial,))
    rows = wording._units(study)
    assert rows == (
        [f"a scale of {gain:.4g} at arm.shaft.angle is near that between {told}: is its unit right?"] * bool(told)
    )


def test_the_halves_of_a_recording_are_all_of_it_and_begin_alike(fitter: CandidateFitter) -> None:
    whole: Any = fitter.recordings[0]
    fitted, judged = whole.split(SEARCH.part)
    assert (fitted.role, judged.role) == ("train", "hold_out")
    a, b, y = (r.measurements[0].values for r in (fitted, judged, whole))
    beyond = slice(FITTING.first_samples, None)
    assert np.all(np.isfinite(a[beyond]) != np.isfinite(b[beyond]))
    np.testing.assert_array_equal(b[: FITTING.first_samples], y[: FITTING.first_samples])
    np.testing.assert_array_equal(np.where(np.isfinite(a), a, b), y)
    assert np.isfinite(a[np.asarray(whole.time) < SEARCH.part]).all()
    assert fitted.drive == judged.drive == whole.drive


SLIDE = """\
schema: 1
name: slide
blocks:
  drive: {type: Force}
  table: {type: Mass, mass: 0.2 kg}
connect: [[drive.flange, table.flange]]
simulate: {stop: 2 s, step: 10 ms}
recordings:
  push:
    file: push.csv
    time: {column: t}
    drive: {drive.force: {column: u, unit: N}}
    measurements: {table.flange.position: {column: x, unit: m, noise: 1e-5}}
    initial: {free: [table.flange.position]}
"""


@pytest.mark.parametrize("from_row", [0, 50])
def test_the_held_out_part_begins_where_the_recording_does(tmp_path: Path, from_row: int) -> None:
    """x = u t^2 / (2 m): half a metre on, the held-out part's first sample, or the recording's, tells no start."""
    t = 0.01 * np.arange(200)
    x = np.where(np.arange(200) >= from_row, 2.5 * t**2, np.nan)
    rows = np.column_stack([t, np.full(200, 1.0), x])
    np.savetxt(tmp_path / "push.csv", rows, delimiter=",", header="t,u,x", comments="", fmt="%.8g")
    (tmp_path / "slide.yaml").write_text(SLIDE, encoding="utf-8")
    scenario = load(tmp_path / "slide.yaml")
    whole: Any = gather(scenario, (), ())[0]
    for part in whole.split(SEARCH.part):
        (begun,) = problem(scenario, [part]).experiments
        assert begun.initial["table.flange.position"] == pytest.approx(0.0, abs=1e-4)


def limited(t: Any) -> dict[str, Any]:
    """Small inputs to fit, and one large one to hold out."""
    return {
        "steps": ("train", np.where(t % 1.0 < 0.5, 0.6, -0.5)),
        "chirp": ("train", 0.6 * np.sin(2 * np.pi * (0.5 + t) * t)),
        "small": ("hold_out", 0.7 * np.sin(2 * np.pi * 0.9 * t)),
        "large": ("hold_out", 1.6 * np.sin(2 * np.pi * 0.7 * t)),
    }


def hum(monkeypatch: pytest.MonkeyPatch, size: float) -> None:
    """Add a hum of 7 Hz (rad/s), which nobody looks for, to all recordings; noise has 0.3 rad/s."""
    own = plants.speed
    monkeypatch.setattr(plants, "speed", lambda t, u, **more: own(t, u, **more) + size * np.sin(2 * np.pi * 7 * t))


def limited_beside_a_hum(folder: Path, monkeypatch: pytest.MonkeyPatch, size: float) -> CandidateFitter:
    """An amplifier that gives at most 1 V, which only the large input meets."""
    plants.limit_amplifier(monkeypatch, limited)
    hum(monkeypatch, size)
    scenario = load(case(folder, seed=5))
    return CandidateFitter(scenario, gather(scenario, [], []), 1)


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_what_one_held_out_recording_alone_shows_is_fitted_and_judged_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: float
) -> None:
    """The limit is found beside a hum that is less than the noise, too."""
    fitter = limited_beside_a_hum(tmp_path, monkeypatch, size)
    exchange = exchanged(fitter, fitter.refit, math.log(40))
    assert exchange is not None
    moved, told = exchange
    roles = {r.name: r.role for r in moved}
    assert roles == {
        "steps": "train",
        "chirp": "train",
        "small": "hold_out",
        "large (fitted part)": "train",
        "large (held-out part)": "hold_out",
    }
    assert "every other 0.5 s" in told


def test_the_only_held_out_recording_is_fitted_in_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = limited
    monkeypatch.setitem(globals(), "limited", lambda t: {k: v for k, v in own(t).items() if k != "small"})
    fitter = limited_beside_a_hum(tmp_path, monkeypatch, 0.0)
    exchange = exchanged(fitter, fitter.refit, math.log(40))
    assert exchange is not None
    assert [r.name for r in exchange[0] if r.role == "hold_out"] == ["large (held-out part)"]


def test_where_fitted_recordings_leave_more_than_noise_no_other_is_fitted_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hum of twice the noise's power is to be explained first, if any effect does; once none does, no longer."""
    fitter = limited_beside_a_hum(tmp_path, monkeypatch, 0.6)
    assert exchanged(fitter, fitter.refit, math.log(40)) is None
    exchange = exchanged(fitter, fitter.refit, math.log(40), searched=True)
    assert exchange is not None
    assert "'large' shows a mismatch that the training recordings do not show" in exchange[1]


@pytest.mark.parametrize(("times", "fitted"), [(10.0, True), (100.0, False)])
def test_what_may_be_a_nuisance_beside_what_the_model_explains_is_not_fitted_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, times: float, fitted: bool
) -> None:
    """The user's model leaves so many times as much of the held-out recordings as the model that was found."""
    fitter = limited_beside_a_hum(tmp_path, monkeypatch, 0.6)
    model = fitter.refit

    def louder(x: Any, e: Any) -> Any:
        left = model.fit.problem.leftover(x, e)
        return replace(left, energy=times * left.energy, energies=times * left.energies)

    user: Any = SimpleNamespace(held_out=model.fit.problem.held_out, leftover=louder)
    fitter.__dict__["refit"] = replace(model, fit=replace(model.fit, problem=user))
    assert (exchanged(fitter, model, math.log(40), searched=True) is not None) == fitted


def test_what_held_out_recordings_show_no_more_of_than_fitted_ones_is_not_fitted_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hum of 80 rad/s is in all of them, and the large input's limit leaves less than that."""
    fitter = limited_beside_a_hum(tmp_path, monkeypatch, 80.0)
    assert exchanged(fitter, fitter.refit, math.log(40), searched=True) is None


def test_beside_a_hum_none_is_fitted_that_only_the_model_misses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It counts where the user's model misses it too, however much of it the model explains; else it refutes that."""
    fitter = limited_beside_a_hum(tmp_path, monkeypatch, 0.3)
    model, price = fitter.refit, math.log(40)
    far = model.fit.x.copy()
    number = [f.name for f in model.fit.problem.free].index("motor.torque_constant")
    far[number] = model.fit.problem.free[number].position(0.02 * model.fit.problem.free[number].start)
    fitter.__dict__["refit"] = replace(model, fit=replace(model.fit, x=far))
    assert exchanged(fitter, model, price) is not None
    (small,) = [e for e in model.fit.problem.held_out if e.name == "small"]
    right: Any = SimpleNamespace(
        held_out=model.fit.problem.held_out, leftover=lambda x, e: model.fit.problem.leftover(x, [small])
    )
    fitter.__dict__["refit"] = replace(model, fit=replace(model.fit, problem=right))
    assert exchanged(fitter, model, price) is None


def test_what_was_fitted_of_a_held_out_recording_is_reported_of_the_same_recordings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A size that is only chosen, such as a delay, has a slope in each recording that was fitted: all or none fit."""
    plants.limit_amplifier(monkeypatch, limited)
    told: list[tuple[Sequence[Recorded], Sequence[Recorded]]] = []

    def as_reported(fitter: CandidateFitter, found: Study) -> Study:
        told.append((fitter.recordings, found.recordings))
        return found

    monkeypatch.setattr(api, "as_reported", as_reported)
    diagnose(case(tmp_path, seed=5), without=sorted({*EFFECTS} - {"saturation"}))
    ((fitted, found),) = told
    assert len(found) == 5, "one of four was split"
    assert fitted == found


def test_counts_without_a_revolution_are_refused(tmp_path: Path) -> None:
    path = case(tmp_path, seed=1)
    text = path.read_text().replace("{column: speed, unit: rad/s}", "{column: speed, unit: count}")
    path.write_text(text)
    scenario = load(path)
    with pytest.raises(FlexarmError, match="the counts per revolution are not given") as caught:
        gather(scenario, [], [])
    assert "counts_per_rev: 4096" in caught.value.remedy
    where = caught.value.where
    assert where is not None
    assert where.line > 0


@pytest.mark.parametrize(
    ("cell", "row", "told", "remedy"),
    [
        ("ERR", 4, "a text", "leave the cell empty, or write 'nan'"),
        ("0.3V", 4, "a number with a text behind it", "leave units out of the cells"),
        ("2024-03-01 10:00:00", 4, "a date or a time of day", "give the time as a number of seconds"),
    ],
)
def test_what_is_no_number_is_told_with_a_remedy_that_fits(
    tmp_path: Path, cell: str, row: int, told: str, remedy: str
) -> None:
    path = case(tmp_path, seed=1)
    file = tmp_path / "steps.csv"
    lines = file.read_text().splitlines()
    values = lines[1 + row].split(",")
    lines[1 + row] = ",".join([values[0], cell, values[2]])
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(FlexarmError, match=f"column 'u' holds {told} in line {row + 2}") as caught:
        gather(load(path), ["steps"], [])
    assert caught.value.remedy.startswith(remedy)
    assert caught.value.where is not None
    assert math.isfinite(caught.value.where.line)
