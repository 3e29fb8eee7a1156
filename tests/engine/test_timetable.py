"""What runs share is worked out once, and is what each alone would have."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from engine.errors import ParameterError
from engine.lanes import WIDTH, groups
from engine.model import Model
from engine.native import Outcome
from engine.simulate import Drive, carried_out_together, prepare, simulate
from engine.tangent import tangents
from scenarios.load import load


def test_runs_with_one_drive_share_its_timetable_and_their_numbers_are_those_of_runs_alone() -> None:
    model = load("reference-a").build(inputs=["motor.voltage"])
    time = np.arange(0.0, 0.5, 0.01)
    drive = Drive(time, np.sin(20 * time)[:, None], "linear")
    first, second = (prepare(model, stop, 1e-3, drive=drive) for stop in (0.5, 0.5))
    shorter, coarser = prepare(model, 0.4, 1e-3, drive=drive), prepare(model, 0.5, 2e-3, drive=drive)
    assert first.timetable is second.timetable
    assert (first.outputs, shorter.outputs, coarser.outputs) == (500, 400, 250)
    for stop, step in ((0.5, 1e-3), (0.4, 1e-3), (0.5, 2e-3)):
        alone = simulate(model, stop, step, drive=Drive(drive.time, drive.values, drive.hold))
        again = simulate(model, stop, step, drive=drive)
        np.testing.assert_array_equal(again.values, alone.values)
        np.testing.assert_array_equal(simulate(model, stop, step, drive=drive, backend="interpreter").time, again.time)


def test_a_drive_travels_without_it() -> None:
    model = load("reference-a").build(inputs=["motor.voltage"])
    drive = Drive([0.0, 0.1], [[1.0], [2.0]])
    before = simulate(model, 0.3, drive=drive)
    after = simulate(model, 0.3, drive=pickle.loads(pickle.dumps(drive)))
    np.testing.assert_array_equal(after.values, before.values)


@pytest.mark.parametrize(("time", "values"), [([0.0, 0.1], [1.0, 2.0]), ([0.0], [1.5]), (0.0, 1.5)])
def test_values_of_one_input_or_of_one_instant_may_be_a_plain_list(time: Any, values: Any) -> None:
    model = load("reference-a").build(inputs=["motor.voltage"])
    column = np.atleast_1d(values)[:, None]
    plain = simulate(model, 0.3, drive=Drive(time, values))
    np.testing.assert_array_equal(plain.values, simulate(model, 0.3, drive=Drive(np.atleast_1d(time), column)).values)


def test_parameters_that_were_set_before_are_checked_all_the_same() -> None:
    model = load("reference-a").build()
    name = model.parameters[0].name
    found = model.parameter_vector({name: 1.5})
    found[:] = 0.0
    assert model.parameter_vector({name: 1.5})[0] == 1.5
    assert model.parameter_vector()[0] == model.parameters[0].value


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_a_clock_that_no_run_reaches_ticks_once(tmp_path: Path, backend: str) -> None:
    path = tmp_path / "held.yaml"
    path.write_text(
        "schema: 1\nname: held\nblocks:\n  source: {type: Sine, amplitude: 1, frequency: 1 Hz, phase: 90 deg}\n"
        "  hold: {type: SampleHold, period: 1e30 s}\nconnect: [[source.out, hold.in]]\n"
        "simulate: {stop: 1 s, step: 10 ms, record: [hold.out]}\n"
    )
    values = simulate(load(path).build(), 1.0, 0.01, backend=backend)["hold.out"]
    np.testing.assert_allclose(values, 1.0, rtol=1e-12)


def test_a_run_that_ends_before_its_first_row_takes_any_internal_step() -> None:
    found = simulate(load("reference-a").build(), 1e-300, 1e10, internal_step=1e-300)
    assert len(found.time) == 1


def test_a_step_beyond_the_end_may_be_too_long_for_the_ticks_of_a_drive() -> None:
    """They are of a nanosecond, and 64 bits hold 292 years of them."""
    model = load("reference-a").build(inputs=["motor.voltage"])
    found = simulate(model, 0.1, 1e10, drive=Drive([0.0, 0.0123], [[0.0], [1.0]]))
    assert found.time.tolist() == [0.0]


@pytest.mark.parametrize("kind", [float, int])
@pytest.mark.parametrize("changed", ["time", "values"])
def test_a_drive_whose_numbers_were_changed_in_place_drives_by_the_new_ones(kind: type, changed: str) -> None:
    model = load("reference-a").build(inputs=["motor.voltage"])
    time = np.array([0.0, 0.1, 0.2])
    values: NDArray[Any] = np.array([[1], [3], [2]], dtype=kind)
    drive = Drive(time, values)
    before = simulate(model, 0.4, drive=drive).values.copy()
    if changed == "time":
        time[1] = 0.15
    else:
        values[1] = 5
    after = simulate(model, 0.4, drive=drive).values
    alone = simulate(model, 0.4, drive=Drive(time.copy(), values.copy())).values
    np.testing.assert_array_equal(after, alone)
    assert not np.array_equal(after, before)


def _pushed(folder: Path) -> Model:
    """A mass of 2 kg that a force moves: its acceleration jumps with the force."""
    path = folder / "pushed.yaml"
    path.write_text(
        "schema: 1\nname: pushed\nblocks:\n  push: {type: Force}\n  table: {type: Mass, mass: 2 kg}\n"
        "  source: {type: Step, height: 1 N}\nconnect: [[source.out, push.force], [push.flange, table.flange]]\n"
        "simulate: {stop: 1 s, step: 10 ms}\n"
    )
    outputs = ["table.flange.acceleration", "table.flange.speed", "table.flange.position"]
    return load(path).build(inputs=["push.force"], outputs=outputs)


FORCE, JUMP = np.array([3.0, -1.0]), 0.4321
ROWS = np.array([0.0, 0.017, 0.0311, JUMP, JUMP + 1e-6, 0.78, 0.9999])


def _expected(mass: float) -> NDArray[np.float64]:
    """Acceleration, speed and position under the first force until the jump and the second from then on."""
    before, after = np.minimum(ROWS, JUMP), np.maximum(ROWS - JUMP, 0.0)
    force = np.where(ROWS < JUMP, *FORCE)
    speed = (FORCE[0] * before + FORCE[1] * after) / mass
    place = (FORCE[0] * before**2 / 2 + FORCE[0] * JUMP * after + FORCE[1] * after**2 / 2) / mass
    return np.column_stack([force / mass, speed, place])


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_rows_stand_at_the_instants_asked_for_on_the_right_side_of_a_jump(tmp_path: Path, backend: str) -> None:
    model, drive = _pushed(tmp_path), Drive([0.0, JUMP], FORCE[:, None])
    for _ in range(2):
        found = simulate(model, 1.0, 0.01, drive=drive, rows=ROWS, backend=backend)
        np.testing.assert_array_equal(found.time, ROWS)
        np.testing.assert_allclose(found.values, _expected(2.0), rtol=1e-12, atol=1e-15)
        even = simulate(model, 1.0, 0.01, drive=drive, backend=backend)
        assert len(even.time) == 101, "the same drive with even rows is another run"


def test_tangents_stand_at_the_instants_asked_for(tmp_path: Path) -> None:
    model, drive = _pushed(tmp_path), Drive([0.0, JUMP], FORCE[:, None])
    found = tangents(model, 1.0, 0.01, wrt=["table.mass"], drive=drive, rows=ROWS)
    np.testing.assert_array_equal(found.result.time, ROWS)
    np.testing.assert_allclose(found.values[:, :, 0], -_expected(2.0) / 2.0, rtol=1e-12, atol=1e-15)


def test_rows_of_runs_side_by_side_stand_at_the_instants_asked_for(tmp_path: Path) -> None:
    """As many as lanes of vectors have room for, each with a mass of its own."""
    model, drive = _pushed(tmp_path), Drive([0.0, JUMP], FORCE[:, None])
    masses = np.linspace(1.0, 3.0, WIDTH).tolist()
    jobs = [prepare(model, 1.0, 0.01, parameters={"table.mass": m}, drive=drive, rows=ROWS) for m in masses]
    assert groups(model, jobs) == [list(range(WIDTH))], "they go side by side"
    for mass, found in zip(masses, carried_out_together(model, jobs), strict=True):
        assert isinstance(found, Outcome)
        np.testing.assert_allclose(found.y, _expected(mass), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([0.1, 0.2], "begins with zero"),
        ([], "begins with zero"),
        ([0.0, np.nan], "finite"),
        ([0.0, 0.2, 0.2], "row 2 is at 0.2 s and the one before it at 0.2 s"),
        ([0.0, 0.3, 0.2], "row 2 is at 0.2 s"),
        ([0.0, 2.0], "after the stop at 1 s"),
    ],
)
def test_rows_that_cannot_be_had_are_refused(tmp_path: Path, rows: list[float], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        simulate(_pushed(tmp_path), 1.0, 0.01, rows=rows)
