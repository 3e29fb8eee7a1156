"""What a script or notebook gets: conversions, short texts, files, sampled loops, cases and design helpers."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import control
import numpy as np
import pytest

import flexarm
from flexarm import design

LOOP = """
schema: 1
name: sampled
blocks:
  pid: {type: PID, proportional_gain: 8 V/rad, integral_gain: 20 V/(rad.s), derivative_gain: 0.2 V.s/rad, period: 2 ms}
  motor: {type: DCMotor, resistance: 2 ohm, torque_constant: 0.05 N.m/A, rotor_inertia: 2e-5 kg.m2}
  encoder: {type: Encoder, counts_per_revolution: 4096}
connect:
  - [pid.out, motor.voltage]
  - [motor.shaft, encoder.shaft]
  - [encoder.out, pid.measurement]
simulate: {stop: 0.5 s, step: 1 ms, record: [motor.shaft.angle, pid.out]}
analyses:
  loop: {kind: linearise, inputs: [pid.reference], outputs: [motor.shaft.angle]}
"""


@pytest.fixture
def loop(tmp_path: Path) -> Path:
    path = tmp_path / "loop.yaml"
    path.write_text(LOOP)
    return path


def driven(loop: Path) -> flexarm.Result:
    model = flexarm.load(loop).build(["pid.reference"])
    return flexarm.simulate(model, 0.5, drive=flexarm.Drive([0.0], [[1.0]]))


def test_poles_of_a_sampled_loop_are_those_of_the_loop(loop: Path) -> None:
    found = flexarm.linearise(loop)
    assert isinstance(found, flexarm.DiscreteModel)
    assert found.dt == 2e-3
    assert found.stable()
    np.testing.assert_array_equal(found.A, flexarm.discretise(loop).A)
    # The loop settles with its slowest pole: held against a run of the model itself, beyond the encoder's step.
    result = driven(loop)
    slowest = max(abs(pole) for pole in found.poles())
    angle = result["motor.shaft.angle"]
    assert abs(angle[-1] - 1) < 10 * slowest ** (0.5 / 2e-3) + 2 * np.pi / 4096
    open_loop = flexarm.linearise(loop, discrete=False)
    assert "pid.integral" not in open_loop.states
    assert not open_loop.stable()  # the shaft's angle integrates


def test_rows_farther_apart_than_the_run_is_long_are_refused(tmp_path: Path) -> None:
    """As in the file: a single row of zeros looks like a machine at rest."""
    for stop, step in ((None, 500.0), (5e-4, None), (1.0, 2.0)):
        with pytest.raises(flexarm.FlexarmError, match="is longer than the simulation"):
            flexarm.simulate("quanser-single-link", stop, step)
    assert len(flexarm.simulate("quanser-single-link", 1e-3, 1e-3).time) == 2
    with pytest.raises(flexarm.FlexarmError, match="is longer than the simulation"):
        flexarm.sweep("quanser-single-link", ["gear.ratio=60:70:2"], tmp_path / "out", step=500.0)


def test_results_become_frames_sets_and_files(loop: Path, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    result = driven(loop)
    frame, data = result.to_pandas(), result.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert frame.attrs["units"] == {"time": "s", "motor.shaft.angle": "rad", "pid.out": "V"}
    assert data["pid.out"].attrs["units"] == "V"
    for name in result.names:
        np.testing.assert_array_equal(frame[name].to_numpy(), result[name])
        np.testing.assert_array_equal(data[name].to_numpy(), result[name])
    np.testing.assert_array_equal(frame.index.to_numpy(), result.time)
    np.testing.assert_array_equal(data["time"].to_numpy(), result.time)
    for ending in (".csv", ".parquet", ".mat"):
        kept = flexarm.read(result.save(tmp_path / f"run{ending}"))
        column = next(name for name in kept.names if "angle" in name)
        np.testing.assert_allclose(np.ravel(kept[column]), result["motor.shaft.angle"], rtol=1e-15)
    with pytest.raises(flexarm.FlexarmError, match="of no kind that can be written"):
        result.save(tmp_path / "run.xlsx")


def test_linear_models_too(loop: Path, tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    linear = flexarm.linearise(loop)
    frames, data = linear.to_pandas(), linear.to_xarray()
    for key in "ABCD":
        np.testing.assert_array_equal(frames[key].to_numpy(), getattr(linear, key))
        np.testing.assert_array_equal(data[key].to_numpy(), getattr(linear, key))
    assert (
        frames["B"].loc["motor.shaft.speed", "pid.reference"] == linear.B[linear.states.index("motor.shaft.speed"), 0]
    )
    held = np.load(linear.save(tmp_path / "loop.npz"))
    np.testing.assert_array_equal(held["A"], linear.A)
    assert isinstance(linear, flexarm.DiscreteModel)
    assert held["dt"] == linear.dt


def test_texts_are_short_and_html_is_well_formed(loop: Path) -> None:
    result, linear = driven(loop), flexarm.linearise(loop)
    model, scenario = result.model, flexarm.load(loop)
    assert repr(result) == "<result of 'sampled': 501 rows to 0.5 s, 2 signals, 0 switches>"
    assert repr(linear).startswith("<linear model in discrete time, every 0.002 s: 6 states, 1 input, 1 output")
    assert repr(scenario).startswith("<scenario 'sampled': 3 blocks")
    for made in (result, linear, model, scenario):
        assert len(repr(made)) < 300
    for shown in (result, linear):
        table = ElementTree.fromstring(shown._repr_html_())
        assert table.tag == "table"
    assert "motor.shaft.angle" in result._repr_html_()
    assert "<svg" in result._repr_html_()


def test_cases_are_mappings_or_cases(loop: Path) -> None:
    model = flexarm.load(loop, ["pid.proportional_gain=5 V/rad"]).build(["pid.reference"])
    drive = flexarm.Drive([0.0], [[1.0]])
    rows = [{"motor.resistance": r} for r in (1.0, 3.0)]
    cases = [flexarm.Case(parameters=row, drive=drive) for row in rows]
    alone = [flexarm.simulate(model, 0.1, parameters=row, drive=drive)["motor.shaft.angle"] for row in rows]
    for found, expected in zip(flexarm.batch(model, cases, 0.1), alone, strict=True):
        assert isinstance(found, flexarm.Result)
        np.testing.assert_array_equal(found["motor.shaft.angle"], expected)
    for found in flexarm.batch(model, rows, 0.1):
        assert isinstance(found, flexarm.Result)
        np.testing.assert_array_equal(found["motor.shaft.angle"], 0.0)


def test_one_input_or_output_may_be_a_plain_text(loop: Path) -> None:
    plain = flexarm.linearise(loop, inputs="motor.voltage", outputs="motor.shaft.angle", discrete=False)
    listed = flexarm.linearise(loop, inputs=["motor.voltage"], outputs=["motor.shaft.angle"], discrete=False)
    assert np.array_equal(plain.A, listed.A)
    assert (plain.inputs, plain.outputs) == (listed.inputs, listed.outputs)
    model = flexarm.load(loop).build("motor.voltage", "motor.shaft.angle")
    assert [v.name for v in (*model.inputs, *model.outputs)] == ["motor.voltage", "motor.shaft.angle"]


def test_design_helpers_are_at_hand(loop: Path) -> None:
    plant = flexarm.linearise(loop, inputs=["motor.voltage"], outputs=["motor.shaft.angle"], discrete=False)
    weights = np.array([100.0, 0.01] + [0.0] * (len(plant.states) - 2))
    feedback = design.lqr(plant, weights.tolist(), [1.0], period=2e-3)
    held = control.sample_system(control.ss(plant.A, plant.B, plant.C, plant.D), 2e-3, "zoh")
    gain, _, poles = control.dlqr(held, np.diag(weights), np.eye(1))
    np.testing.assert_allclose(feedback.gain, gain, rtol=1e-6)
    np.testing.assert_allclose(sorted(np.abs(feedback.poles)), sorted(np.abs(poles)), rtol=1e-6)
