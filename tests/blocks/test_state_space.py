"""State-space blocks, state feedback, observers and their design, from matrices, files and python-control systems."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
import scipy.linalg
from scipy.io import savemat

from blocks.actuators.effort import Torque
from blocks.actuators.spring_damper import SpringDamper
from blocks.controllers import from_control, kalman, lqr
from blocks.controllers.control_systems import plant
from blocks.controllers.design import observer
from blocks.controllers.design_file import save
from blocks.controllers.low_pass import LowPass
from blocks.controllers.observer import Observer
from blocks.controllers.state_feedback import StateFeedback
from blocks.controllers.state_space import DiscreteStateSpace, StateSpace, spectral_radius
from blocks.links.inertia import Inertia
from blocks.sensors.encoder import Encoder
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import ConnectionProblem, ParameterError
from engine.linearise import LinearModel, linearise
from engine.simulate import Drive
from scenarios.load import load
from tests.blocks.assembly import linear, model, run

RNG = np.random.default_rng(11)
A = np.array([[-1.0, 2.0, 0.0], [-3.0, -0.5, 1.0], [0.0, 0.0, -4.0]])
B, C, D = RNG.normal(size=(3, 2)), RNG.normal(size=(2, 3)), RNG.normal(size=(2, 2))
MATRICES = {"A": A, "B": B, "C": C, "D": D}


def test_continuous_system_is_its_transfer_matrix() -> None:
    inputs, outputs = ["g.in1", "g.in2"], ["g.out1", "g.out2"]
    found = linear({"g": StateSpace(**MATRICES)}, inputs=inputs, outputs=outputs)
    for w in (0.2, 1.7, 30.0):
        expected = C @ np.linalg.solve(1j * w * np.eye(3) - A, B) + D
        np.testing.assert_allclose(found.gain(w), expected, rtol=1e-12)


def test_sampled_system_is_its_recursion() -> None:
    values, period = RNG.normal(size=(50, 2)), 0.02
    a = scipy.linalg.expm(A * period)
    block = DiscreteStateSpace(A=a, B=B, C=C, D=D, start=[1, -1, 2], period=period)
    assert spectral_radius(block) == pytest.approx(max(abs(np.linalg.eigvals(a))))
    drive = Drive(period * np.arange(50), values, "zero_order")
    result = run({"g": block}, inputs=["g.in1", "g.in2"], drive=drive, stop=49 * period, step=period / 2, energy=False)
    x = np.array([1.0, -1.0, 2.0])
    for k, u in enumerate(values):
        y = C @ x + D @ u
        for row in (2 * k, 2 * k + 1):
            if row < len(result.time):
                assert [result["g.out1"][row], result["g.out2"][row]] == pytest.approx(y, abs=1e-12)
        x = a @ x + B @ u


def test_shapes_that_are_meant() -> None:
    single = StateSpace(A=-2, B=3, C=1)
    assert set(single.ports) == {"in", "out"}
    row = StateSpace(A=[[0, 1], [-1, -1]], B=[0, 1], C=[1, 0], start=[0.5, 0])
    assert row._b.shape == (2, 1)
    result = run({"g": row, "zero": Constant(value=0)}, "zero.out g.in", stop=0.5, step=0.01, energy=False)
    expected = [(scipy.linalg.expm(row._a * t) @ [0.5, 0])[0] for t in result.time]
    np.testing.assert_allclose(result["g.out"], expected, atol=1e-8)
    assert set(StateSpace(D=[[1, 2, 3]]).ports) == {"in1", "in2", "in3", "out"}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"A": [[1, 2], [3, 4]], "C": [1, 0]}, "'B' is missing"),
        ({}, "no matrix is given"),
        ({"A": [[1, 2], [3, 4]], "B": [1, 2, 3], "C": [1, 0]}, r"B is 1 by 3, not 2 by 1\n.*2 states"),
        ({"A": [[1, 2, 3], [4, 5, 6]], "B": [1, 2], "C": [1, 0]}, "A is 2 by 3, not 2 by 2"),
        ({"A": [[1, 2], [3]], "B": 1, "C": 1}, "A is not a matrix: its rows have lengths 2, 1"),
        ({"A": "high", "B": 1, "C": 1}, "'high' is not a number"),
        ({"A": -1, "B": 1, "C": 1, "start": [1, 2]}, "start is 1 by 2, not 1 by 1"),
        ({"A": float("nan"), "B": 1, "C": 1}, "not a finite number"),
    ],
)
def test_refusals(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        StateSpace(**values)


# -- files ------------------------------------------------------------------------------------------------------------


def test_files_give_the_same_block(tmp_path: Path) -> None:
    (tmp_path / "g.json").write_text(
        json.dumps({"name": "g", "dt": 0.02, **{k: v.tolist() for k, v in MATRICES.items()}})
    )
    savemat(tmp_path / "g.mat", {**MATRICES, "dt": 0.02, "note": "text"})
    for name in ("g.json", "g.mat"):
        block = DiscreteStateSpace(file=str(tmp_path / name))
        assert block.period == 0.02
        for key, value in (("_a", A), ("_b", B), ("_c", C), ("_d", D)):
            np.testing.assert_array_equal(getattr(block, key), value)
    with pytest.raises(ParameterError, match=r"period = 0.01 s, but the file says dt = 0.02 s"):
        DiscreteStateSpace(file=str(tmp_path / "g.mat"), period=0.01)
    with pytest.raises(ParameterError, match=r"'A' is given, and in '.*g.mat' too"):
        StateSpace(A=A, file=str(tmp_path / "g.mat"))
    with pytest.raises(ParameterError, match=r"'.*g.mat' holds none of K, N\n  allowed: A, B, C, D, dt"):
        StateFeedback(file=str(tmp_path / "g.mat"))


def test_what_linearise_writes_can_be_read(tmp_path: Path) -> None:
    from flexarm.api import linearise as linearise_scenario
    from flexarm.output import write_linear

    found = linearise_scenario("srv02-2mass-b3")
    for suffix in (".json", ".mat"):
        write_linear(tmp_path / f"plant{suffix}", found, "plant")
        block = StateSpace(file=str(tmp_path / f"plant{suffix}"))
        again = linear({"g": block}, inputs=["g.in"], outputs=["g.out1", "g.out2"])
        np.testing.assert_allclose(again.gain(11.0), found.gain(11.0), rtol=1e-12)


class _Trap:
    def __reduce__(self) -> tuple[Any, ...]:
        return (Path("/nowhere/run-by-unpickling").touch, ())


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("k.pkl", pickle.dumps(_Trap()), "is not a .json or .mat file\n  save the matrices as one of these"),
        ("k.npz", b"PK", "is not a .json or .mat file"),
        ("k.json", b"[1, 2", "is not JSON"),
        ("k.json", b"[1, 2]", "holds no JSON object"),
        ("k.json", b'{"A": [[1, 2], [3]], "B": 1}', "'A' in '.*k.json' is no matrix of numbers"),
        ("k.json", b'{"A": 1, "B": 1, "C": NaN}', "'C' holds a number that is not finite"),
        ("k.mat", b"not a mat file at all", "is not a MATLAB file"),
        ("k.mat", pickle.dumps(_Trap()), "is not a MATLAB file"),
        ("k.mat", b"MATLAB 7.3 MAT-file" + b" " * 105 + b"\x00\x02IM" + b"\x00" * 400, "version 7.3.*\n.*-v7"),
    ],
)
def test_files_that_are_refused(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ParameterError, match=message):
        StateSpace(file=str(tmp_path / name))


def test_a_missing_file_is_named() -> None:
    with pytest.raises(ParameterError, match=r"'/nowhere/k.mat': cannot read the file: No such file"):
        StateSpace(file="/nowhere/k.mat")


def test_matrices_and_files_in_a_scenario(tmp_path: Path) -> None:
    (tmp_path / "gain.json").write_text('{"K": [[3, 4]]}')
    (tmp_path / "s.yaml").write_text(
        """
schema: 1
name: s
parameters: {rate: -2}
blocks:
  one: {type: Step, height: 1 rad}
  plant: {type: StateSpace, A: [[0, 1], [$rate, -3]], B: [0, 1], C: [[1, 0], [0, 1]]}
  law: {type: StateFeedback, file: gain.json, unit: rad}
connect:
  - [one.out, law.reference]
  - [plant.out1, law.x1]
  - [plant.out2, law.x2]
  - [law.out, plant.in]
simulate: {stop: 1 s}
analyses:
  loop: {kind: linearise, inputs: [law.reference], outputs: [plant.out1]}
"""
    )
    scenario = load(tmp_path / "s.yaml", ["law.reference_gain=5"])
    found = linearise(scenario.build(["law.reference"], ["plant.out1"]))
    np.testing.assert_allclose(sorted(found.poles().real), sorted(np.roots([1, 3 + 4, 2 + 3]).real), rtol=1e-12)
    assert found.gain(1e-9)[0, 0] == pytest.approx(5 / 5)
    changed = load(tmp_path / "s.yaml", ["plant.A=[[0, 1], [-6, -5]]"])
    poles = linearise(changed.build(["law.reference"], ["plant.out1"])).poles()
    np.testing.assert_allclose(sorted(poles.real), sorted(np.roots([1, 5 + 4, 6 + 3])), rtol=1e-12)


# -- python-control ---------------------------------------------------------------------------------------------------


def test_blocks_from_python_control() -> None:
    system = control.tf([1, 2], [1, 3, 5])
    block = from_control(system, unit="V")
    assert isinstance(block, StateSpace)
    found = linear({"g": block}, inputs=["g.in"], outputs=["g.out"])
    assert found.gain(2.2)[0, 0] == pytest.approx(complex(system(2.2j)), rel=1e-12)
    np.testing.assert_allclose(from_control(control.ss(A, B, C, D))._a, A)
    assert from_control(control.tf([3], [1]))._d[0, 0] == 3


@pytest.mark.parametrize("period", [0.05, 0.3])
def test_sampling_a_system_is_exact_for_a_held_input(period: float) -> None:
    block = from_control(control.tf([1, 2], [1, 3, 5]), period=period)
    expected = control.c2d(control.ss(control.tf([1, 2], [1, 3, 5])), period, "zoh")
    assert isinstance(block, DiscreteStateSpace)
    values = RNG.normal(size=40)
    drive = Drive(period * np.arange(40), values, "zero_order")
    result = run({"g": block}, inputs=["g.in"], drive=drive, stop=39 * period, step=period, energy=False)
    simulated = control.forced_response(expected, T=period * np.arange(40), inputs=values).outputs
    np.testing.assert_allclose(result["g.out"], np.ravel(simulated), atol=1e-12)


def test_sampled_systems_keep_their_period() -> None:
    assert from_control(control.tf([1], [1, -0.5], 0.02)).period == 0.02
    with pytest.raises(ParameterError, match="does not say how often"):
        from_control(control.tf([1], [1, -0.5], True))
    assert from_control(control.tf([1], [1, -0.5], True), period=0.1).period == 0.1
    with pytest.raises(ParameterError, match=r"sampled with 0.02 s, not 0.05 s"):
        from_control(control.tf([1], [1, -0.5], 0.02), period=0.05)
    with pytest.raises(ParameterError, match="cannot bring the system into state space"):
        from_control(control.tf([1, 0, 0], [1, 1]))


# -- design -----------------------------------------------------------------------------------------------------------


def arm() -> dict[str, Block]:
    """Motor and load with a spring between: states two coordinates and two speeds."""
    return {
        "torque": Torque(),
        "motor": Inertia(inertia=0.02),
        "spring": SpringDamper(stiffness=3.0, damping=0.01),
        "load": Inertia(inertia=0.05),
    }


WIRES = ("torque.shaft motor.shaft spring.a", "spring.b load.shaft")


def arm_model() -> LinearModel:
    return linear(arm(), *WIRES, inputs=["torque.torque"], outputs=["motor.shaft.angle", "load.shaft.angle"])


def test_lqr_agrees_with_python_control() -> None:
    found, weights = arm_model(), [1.0, 10.0, 0.1, 0.2]
    made = lqr(found, weights, [0.5])
    expected = control.lqr(control.ss(found.A, found.B, found.C, found.D), np.diag(weights), [[0.5]])
    np.testing.assert_allclose(made.gain, expected[0], rtol=1e-8)
    np.testing.assert_allclose(sorted(made.poles.real), sorted(np.asarray(expected[2]).real), rtol=1e-7)
    assert made.states == found.states
    sampled = lqr(found, weights, 0.5, period=0.01)
    discrete = control.c2d(control.ss(found.A, found.B, found.C, found.D), 0.01)
    np.testing.assert_allclose(sampled.gain, control.dlqr(discrete, np.diag(weights), [[0.5]])[0], rtol=1e-6)


def test_the_cost_of_lqr_is_what_a_simulation_sums_up() -> None:
    """From x0 the integral of x' Q x + u' R u is x0' S x0."""
    found = arm_model()
    made = lqr(found, [1.0, 1.0, 0.1, 0.1], 0.2)
    start = {"load.shaft.angle": 0.3, "motor.shaft.angle": -0.1}
    parts = arm() | {"law": made.block(unit="N.m")}
    names = list(found.states)
    wires = [f"{name} law.x{k + 1}" for k, name in enumerate(names)]
    result = run(parts, *WIRES, *wires, "law.out torque.torque", stop=12.0, step=0.002, initial=start, energy=False)
    x = np.array([result[name] for name in names])
    running = np.array([1.0, 1.0, 0.1, 0.1]) @ x**2 + 0.2 * result["law.out"] ** 2
    cost = np.trapezoid(running, result.time)
    assert cost == pytest.approx(float(x[:, 0] @ made.cost @ x[:, 0]), rel=1e-4)
    assert np.abs(x[:, -1]).max() < 1e-3


def test_lqr_refusals() -> None:
    found = arm_model()
    with pytest.raises(ParameterError, match=r"Q must be a symmetric 4 by 4 matrix, or 4 weights: torque"):
        lqr(found, [1, 2, 3], 1)
    with pytest.raises(ParameterError, match="R is not positive"):
        lqr(found, 1, 0)
    with pytest.raises(ParameterError, match="Q has a negative direction"):
        lqr(found, [1, 1, -1, 1], 1)
    with pytest.raises(ParameterError, match=r"no feedback of these states.*makes the plant stable"):
        lqr(control.ss(np.diag([1.0, -1.0]), [[0.0], [1.0]], [[1.0, 1.0]], 0), 1, 1)


@pytest.mark.parametrize("period", [0.0, 0.01])
def test_separation(period: float) -> None:
    """Feedback of an observer's estimate: the loop has the poles of the feedback and of the observer."""
    found = arm_model()
    single = LinearModel(
        found.A, found.B, found.C[1:], found.D[1:], found.states, found.inputs, found.outputs[1:], found.units,
        found.modes, found.point, found.rate,
    )  # fmt: skip
    feedback = lqr(single, [1.0, 1.0, 0.1, 0.1], 0.2, period=period)
    gain = kalman(single, [1e-3, 1e-3, 1.0, 1.0], 1e-4, period=period)
    parts = arm() | {
        "law": feedback.block(unit="N.m"),
        "observer": observer(single, gain, period=period),
    }
    wires = [f"observer.x{k + 1} law.x{k + 1}" for k in range(4)]
    wires += ["law.out torque.torque observer.u", "load.shaft.angle observer.y"]
    start = {"load.shaft.angle": 0.3, "motor.shaft.angle": 0.3}
    names = list(found.states)
    result = run(
        parts, *WIRES, *wires, stop=3.0, step=0.01, internal_step=0.001, initial=start, outputs=[*names, "observer.x1"],
        energy=False,
    )  # fmt: skip
    made = plant(single, period)
    n = 4
    loop = np.block(
        [[made.A, -made.B @ feedback.gain], [gain @ made.C, made.A - made.B @ feedback.gain - gain @ made.C]]
    )
    expected_poles = np.concatenate([feedback.poles, np.linalg.eigvals(made.A - gain @ made.C)])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(loop)), np.sort_complex(expected_poles), atol=1e-6)
    x = np.concatenate([[result[name][0] for name in names], np.zeros(n)])
    step = loop if period else scipy.linalg.expm(loop * 0.01)
    for k in range(301):
        assert [result[name][k] for name in names] == pytest.approx(x[:n], abs=2e-6)
        assert result["observer.x1"][k] == pytest.approx(x[n], abs=2e-6)
        x = step @ x


def test_observer_converges_at_its_own_poles() -> None:
    """Without input the estimate's error obeys e' = (A - L C) e, whatever the plant does."""
    found = arm_model()
    L = RNG.normal(size=(4, 2))
    block = Observer(A=found.A, B=found.B, C=found.C, L=L, start=[0.1, 0, 0, 0])
    parts = arm() | {"observer": block, "push": Sine(amplitude="0.3 N.m", frequency=2.0)}
    wires = ["push.out torque.torque observer.u", "motor.shaft.angle observer.y1", "load.shaft.angle observer.y2"]
    result = run(parts, *WIRES, *wires, stop=1.0, step=0.01, internal_step=5e-4, energy=False)
    error = np.array([result[f"observer.x{k + 1}"] - result[name] for k, name in enumerate(found.states)])
    for k in (0, 37, 100):
        expected = scipy.linalg.expm((found.A - L @ found.C) * result.time[k]) @ error[:, 0]
        np.testing.assert_allclose(error[:, k], expected, atol=1e-7)


def test_several_outputs_and_a_reference() -> None:
    block = StateFeedback(gain=[[1, 0, 2], [0, 0, 0]], reference_gain=[3, 4], period=0.1, sample_offset=0.05)
    parts: dict[str, Block] = {"k": block, "r": Step(height=1, start=0.31)}
    parts |= {name: Constant(value=value) for name, value in (("a", 5), ("b", 6), ("c", 7))}
    wires = ["r.out k.reference", "a.out k.x1", "b.out k.x2", "c.out k.x3"]
    result = run(parts, *wires, stop=0.5, step=0.01, energy=False)
    sampled = result.time >= 0.05 - 1e-12
    stepped = result.time >= 0.35 - 1e-12
    np.testing.assert_allclose(result["k.out1"], sampled * (-19.0) + 3.0 * stepped, atol=1e-12)
    np.testing.assert_allclose(result["k.out2"], 4.0 * stepped, atol=1e-12)
    with pytest.raises(ParameterError, match="no gain is given"):
        StateFeedback()
    with pytest.raises(ParameterError, match=r"reference_gain is 1 by 3, not 2 by 1"):
        StateFeedback(gain=[[1], [2]], reference_gain=[1, 2, 3])


def test_zeros_in_a_matrix_are_no_dependencies() -> None:
    """A system without direct part closes a loop that is not algebraic."""
    parts: dict[str, Block] = {"g": StateSpace(A=-1, B=1, C=1, D=0, start=1), "h": StateSpace(D=-1)}
    made = model(parts, "g.out h.in", "h.out g.in", energy=False)
    np.testing.assert_allclose(linearise(made).poles(), [-2.0], rtol=1e-12)


def test_the_json_schema_knows_matrices() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    from scenarios.jsonschema import json_schema

    validator = jsonschema.Draft202012Validator(json_schema())
    document: dict[str, Any] = {"schema": 1, "name": "s", "blocks": {"g": {"type": "StateSpace", "B": [0, 1], "C": 1}}}
    for matrix, fits in (([[0, 1], ["$rate", -3]], True), (-2, True), ("high", False), ([[1], "x"], False)):
        document["blocks"]["g"]["A"] = matrix
        assert validator.is_valid(document) == fits


def _designed(folder: Path, period: float) -> str:
    found = arm_model()
    feedback = lqr(found, [1.0, 1.0, 0.1, 0.1], 0.2, period=period)
    gain = kalman(found, [1e-3, 1e-3, 1.0, 1.0], [1e-4, 1e-4], period=period)
    return str(save(folder / f"{period}.json", found, feedback=feedback, observer_gain=gain, reference_gain=2.0))


def test_a_design_file_holds_what_was_designed(tmp_path: Path) -> None:
    found, file = arm_model(), _designed(tmp_path, 0.01)
    block, law = Observer(file=file), StateFeedback(file=file)
    sampled = plant(found, 0.01)
    np.testing.assert_array_equal(block._a, sampled.A)
    np.testing.assert_array_equal(law._k, lqr(found, [1.0, 1.0, 0.1, 0.1], 0.2, period=0.01).gain)
    assert (block.values["period"], law.values["period"]) == (0.01, 0.01)
    assert [law.ports[f"x{k + 1}"].carries for k in range(4)] == list(found.states)
    assert [law.ports[f"x{k + 1}"].unit for k in range(4)] == [found.units[name] for name in found.states]
    assert [block.ports[name].carries for name in ("u", "y1", "y2")] == [*found.inputs, *found.outputs]
    assert Observer(file=_designed(tmp_path, 0.0)).values["period"] == 0.0


@pytest.mark.parametrize("kind", [Observer, StateFeedback])
def test_matrices_of_another_period_are_refused(kind: type[Block], tmp_path: Path) -> None:
    sampled, continuous = _designed(tmp_path, 0.01), _designed(tmp_path, 0.0)
    kind(file=sampled, period="10 ms")
    with pytest.raises(ParameterError, match=r"period = 0.02 s, but .* sampled every 0.01 s"):
        kind(file=sampled, period=0.02)
    with pytest.raises(ParameterError, match=r"period = 0 s, but .* sampled every 0.01 s"):
        kind(file=sampled, period=0)
    with pytest.raises(ParameterError, match=r"period = 0.02 s, but .* continuous"):
        kind(file=continuous, period=0.02)


def test_a_continuous_system_refuses_sampled_matrices(tmp_path: Path) -> None:
    file = tmp_path / "k.json"
    file.write_text('{"A": [[0.5]], "B": [[1]], "C": [[1]], "D": [[0]], "dt": 0.01}')
    assert DiscreteStateSpace(file=str(file)).values["period"] == 0.01
    with pytest.raises(ParameterError, match=r"sampled every 0\.01 s") as raised:
        StateSpace(file=str(file))
    assert raised.value.remedy == "use DiscreteStateSpace"


def test_designs_of_two_periods_do_not_mix(tmp_path: Path) -> None:
    found = arm_model()
    feedback = lqr(found, [1.0, 1.0, 0.1, 0.1], 0.2, period=0.01)
    gain = kalman(found, [1e-3, 1e-3, 1.0, 1.0], [1e-4, 1e-4])
    with pytest.raises(ParameterError, match=r"sampled every 0.01 s, is not stable"):
        observer(found, gain, period=0.01)
    with pytest.raises(ParameterError, match=r"sampled every 0.01 s, is not stable"):
        save(tmp_path / "d.json", found, feedback=feedback, observer_gain=gain)
    with pytest.raises(ParameterError, match=r"sampled every 0.01 s, not sampled every 0.02 s"):
        feedback.block(period="20 ms")
    with pytest.raises(ParameterError, match=r"sampled every 0.01 s, not sampled every 0.02 s"):
        save(tmp_path / "d.json", found, feedback=feedback, period=0.02)
    assert not list(tmp_path.iterdir())
    assert feedback.block(period="10 ms", unit="N.m").values["period"] == 0.01


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('"states": ["a"]', "names 1 states, and its matrices have 2"),
        ('"states": ["a", "b"], "units": {"a": "deg"}', "'a' is in deg"),
        ('"states": ["a", "b"], "units": {"a": "wobble"}', "unit of 'a'"),
        ('"dt": -1', "'dt' of the file is -1"),
    ],
)
def test_labels_that_do_not_fit(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "k.json"
    file.write_text(f'{{"K": [[1, 2]], {text}}}')
    with pytest.raises(ParameterError, match=message):
        StateFeedback(file=str(file))


def test_labels_of_a_matlab_file(tmp_path: Path) -> None:
    cells = {"states": np.array(["a.b.angle", "a.b.speed"], dtype=object)}
    cells["state_units"] = np.array(["rad", "rad/s"], dtype=object)
    savemat(tmp_path / "k.mat", {"K": [[1.0, 2.0]], **cells})
    ports = StateFeedback(file=str(tmp_path / "k.mat")).ports
    assert [(ports[n].carries, ports[n].unit) for n in ("x1", "x2")] == [("a.b.angle", "rad"), ("a.b.speed", "rad/s")]


WIRED = ["law.out torque.torque observer.u", "end.shaft load.shaft", "begin.shaft motor.shaft"]


@pytest.mark.parametrize(
    ("wires", "message"),
    [
        ("x1 x1, x2 x2, x3 x3, x4 x4; begin.out observer.y1, smooth.out observer.y2", ""),
        ("x1 x1, x2 x2, x3 x3, x4 x4; smooth.out observer.y1, begin.out observer.y2",
         "'observer.y1' takes motor.shaft.angle, but it is fed by smooth.out, which is load.shaft.angle"),
        ("x1 x2, x2 x1, x3 x3, x4 x4; begin.out observer.y1, smooth.out observer.y2",
         r"'law.x1' takes torque\.shaft\.angle, but it is fed by observer\.x2, which is spring\.b\.angle"),
        ("x1 x3, x2 x2, x3 x1, x4 x4; begin.out observer.y1, smooth.out observer.y2",
         "is in rad/s but 'law.x1' takes rad"),
    ],
)  # fmt: skip
def test_swapped_wires_are_refused(wires: str, message: str, tmp_path: Path) -> None:
    """Through encoders and a filter, by the flanges that they sit on."""
    file = _designed(tmp_path, 0.01)
    parts = arm() | {"observer": Observer(file=file), "law": StateFeedback(file=file, unit="N.m")}
    parts |= {"begin": Encoder(counts_per_revolution=1000), "end": Encoder(counts_per_revolution=1000)}
    parts |= {"smooth": LowPass(corner_frequency=1e3)}
    states, measured = wires.split("; ")
    made = [f"observer.{a} law.{b}" for a, b in (pair.split() for pair in states.split(", "))]
    made += measured.split(", ")

    def go() -> None:
        run(parts, *WIRES, *WIRED, "end.out smooth.in", *made, stop=0.01, step=0.01, energy=False)

    if not message:
        go()
        return
    with pytest.raises(ConnectionProblem, match=message):
        go()
