"""Families of linear models: against single ones, a nonlinear run, and the layouts that other programs read."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest

from engine import family_files
from engine.errors import ParameterError
from engine.family import LinearFamily, combinations, grid, scheduling_axis
from engine.linearise import linearise
from engine.model import Model
from engine.simulate import Drive, simulate
from scenarios.load import load

SHOWN = ["arm.joint1.angle", "arm.joint2.angle", "arm.link1.deflection"]


def two_link(*overrides: str) -> Model:
    return load("two-link-flexible", overrides).build(["drive1.torque", "drive2.torque"], SHOWN)


@pytest.fixture(scope="module")
def damped() -> Model:
    """With joint friction beside which a slew of 5 s is slow."""
    return two_link("arm.viscous_friction=0.02")


@pytest.fixture(scope="module")
def over_angles(damped: Model) -> LinearFamily:
    angles = np.linspace(-math.pi / 2, math.pi / 2, 11)
    return grid(damped, [scheduling_axis(damped, f"arm.joint{k}.angle", angles) for k in (1, 2)])


def test_members_are_the_linear_models_of_their_points(damped: Model, over_angles: LinearFamily) -> None:
    assert over_angles.shape == (11, 11)
    assert over_angles.A.shape == (11, 11, 16, 16)
    for index in ((0, 0), (3, 8), (10, 5)):
        at = {f"arm.joint{k + 1}.angle": float(over_angles.axes[k].values[index[k]]) for k in range(2)}
        alone = linearise(damped, at=at)
        member = over_angles[index]
        for key in "ABCD":
            np.testing.assert_array_equal(getattr(member, key), getattr(alone, key))
        assert member.point == alone.point


def test_the_interpolated_model_follows_a_slow_slew(damped: Model, over_angles: LinearFamily) -> None:
    """A turn of both joints by more than a radian in 5 s: 1 % of the range of each output."""
    stop = 5.0
    time = np.linspace(0, stop, 1001)
    torque = 0.02 * np.pi / stop * np.sin(2 * np.pi * time / stop)[:, None] * [1.2, 1.5]
    start = {"arm.joint1.angle": math.radians(-40), "arm.joint2.angle": math.radians(-40)}
    run = simulate(damped, stop, stop / 1000, drive=Drive(time, torque, "linear"), record_states=True, initial=start)
    assert run.states is not None
    found = over_angles.simulate(time, torque, run.states[0])
    error = np.abs(found - run.values).max(axis=0) / np.ptp(run.values, axis=0)
    assert np.ptp(run.values, axis=0)[:2].min() > 1.0
    assert error.max() < 0.01, error


def test_scheduled_on_speeds_too_it_follows_a_slew_that_is_not_slow() -> None:
    """The scenario's own friction, whose time constant is 40 s: angles alone are off by 30 %, with speeds by 1 %."""
    model, stop = two_link(), 5.0
    time = np.linspace(0, stop, 1001)
    torque = 0.01 * np.pi / stop * np.sin(2 * np.pi * time / stop)[:, None] * [1.2, 0.15]
    start = {"arm.joint1.angle": math.radians(-40), "arm.joint2.angle": math.radians(-40)}
    run = simulate(model, stop, stop / 1000, drive=Drive(time, torque, "linear"), record_states=True, initial=start)
    assert run.states is not None
    assert np.ptp(run.values, axis=0)[:2].min() > 1.9
    angle = scheduling_axis(model, "arm.joint2.angle", np.linspace(-1.3, 1.3, 11))
    speeds = [scheduling_axis(model, f"arm.joint{k}.speed", np.linspace(-s, s, 7)) for k, s in ((1, 0.9), (2, 1.6))]
    errors = []
    for axes in ([angle], [angle, *speeds]):
        found = grid(model, axes).simulate(time, torque, run.states[0])
        errors.append(float((np.abs(found - run.values).max(axis=0) / np.ptp(run.values, axis=0)).max()))
    assert errors[0] > 0.3
    assert errors[1] < 0.01, errors


def test_between_the_points_entries_are_linear(over_angles: LinearFamily) -> None:
    a, b = over_angles.axes[1].values[4:6]
    middle = over_angles.at(arm_joint1_angle=0.0, arm_joint2_angle=(a + b) / 2)
    np.testing.assert_allclose(middle.A, (over_angles.A[5, 4] + over_angles.A[5, 5]) / 2, rtol=1e-12)
    with pytest.raises(ParameterError, match=r"outside of the axis 'arm.joint2.angle'"):
        over_angles.at(arm_joint1_angle=0.0, arm_joint2_angle=2.0)
    with pytest.raises(ParameterError, match="'arm_joint3_angle' is no axis"):
        over_angles.at(arm_joint3_angle=0.0)
    with pytest.raises(ParameterError, match="no value is given for 'arm_joint2_angle'"):
        over_angles.at(arm_joint1_angle=0.0)


def test_the_mat_file_has_the_layout_of_the_lpv_block(over_angles: LinearFamily) -> None:
    """Matrices n x n x grid, offsets n x 1 x grid, and a sampling grid of the size of the array."""
    from scipy.io import loadmat

    found = loadmat(io.BytesIO(family_files.as_mat(over_angles)))
    assert found["A"].shape == (16, 16, 11, 11)
    assert found["B"].shape == (16, 2, 11, 11)
    assert (found["x0"].shape, found["u0"].shape, found["y0"].shape) == (
        (16, 1, 11, 11),
        (2, 1, 11, 11),
        (3, 1, 11, 11),
    )
    np.testing.assert_array_equal(found["A"][:, :, 3, 8], over_angles[3, 8].A)
    sampled = found["sampling_grid"][0, 0]
    assert sampled.dtype.names == ("arm_joint1_angle", "arm_joint2_angle")
    assert sampled["arm_joint2_angle"][3, 8] == over_angles.axes[1].values[8]
    assert [str(row[0][0]) for row in found["states"]] == list(over_angles.states)
    text = family_files.script(over_angles, "two-link", "two.mat")
    assert "load('two.mat')" in text
    assert "SamplingGrid" in text


def test_xarray_and_control_hold_the_same(over_angles: LinearFamily) -> None:
    data = over_angles.to_xarray()
    one = data.sel({"arm.joint1.angle": 0.0, "arm.joint2.angle": math.pi / 2}, method="nearest")
    np.testing.assert_array_equal(one.A.values, over_angles[5, 10].A)
    assert data.A.dims == ("arm.joint1.angle", "arm.joint2.angle", "to_state", "state")
    systems = over_angles.to_control()
    assert systems.shape == (11, 11)
    np.testing.assert_array_equal(systems[5, 10].A, over_angles[5, 10].A)


def test_members_by_any_whole_number(over_angles: LinearFamily) -> None:
    """As of a sequence and of an array: a number of numpy's, such as argmax gives, and one from the end."""
    last = over_angles[10, 10]
    for index in (-1, np.int64(120), (-1, -1), (np.int64(10), 10)):
        np.testing.assert_array_equal(over_angles[index].A, last.A)
        np.testing.assert_array_equal(over_angles.kept(index).A, over_angles.kept((10, 10)).A)
    for wrong in (121, -122, (0, 11), (0,)):
        with pytest.raises(IndexError):
            over_angles[wrong]


def test_every_combination_of_modes_keeps_one_order_of_states() -> None:
    """Friction and a gap: nine combinations; a stuck joint's states stay, and do not move."""
    model = load("srv02-backlash").build(["motor.voltage"], ["motor.shaft.speed", "load.shaft.speed"])
    made = combinations(model)
    assert len(made) == 9
    assert len({tuple(sorted(modes.items())) for modes in made.modes}) == 9
    for k, modes in enumerate(made.modes):
        alone = linearise(model, modes=modes)
        kept = made.kept(k)
        np.testing.assert_array_equal(kept.A, alone.A)
        assert kept.states == alone.states
        if modes["friction"] == "stuck":
            assert not made[k].A[[0, 2]].any()
            assert not made[k].B[[0, 2]].any()


def test_what_is_no_scheduling_variable() -> None:
    model = load("srv02-backlash").build(["motor.voltage"], ["motor.shaft.speed"])
    with pytest.raises(ParameterError, match=r"'load.inertai' is no scheduling variable"):
        scheduling_axis(model, "load.inertai", [1e-5, 2e-5])
    with pytest.raises(ParameterError, match="out of range"):
        scheduling_axis(model, "load.inertia", [-1e-5, 2e-5])
    with pytest.raises(ParameterError, match="do not rise"):
        scheduling_axis(model, "load.inertia", [2e-5, 1e-5])
    axis = scheduling_axis(model, "load.inertia", [1e-5, 2e-5])
    with pytest.raises(ParameterError, match="an axis twice"):
        grid(model, [axis, axis])
    made = grid(model, [axis], modes={"friction": "sliding forward", "contact.contact": "positive face"})
    with pytest.raises(ParameterError, match="neither states nor inputs say what it is"):
        made.simulate(np.linspace(0, 1, 3), np.zeros((3, 1)), np.zeros(4))
