"""Controllers written in Python: loaded only where named, called at the instants, made afresh for every run."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blocks.controllers.pi import PI
from blocks.controllers.python_controller import PythonController
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from engine.block import Block
from engine.codegen import model_code
from engine.errors import FlexarmError, ParameterError, SimulationError
from engine.simulate import simulate
from engine.tangent import tangents
from scenarios.load import load
from tests.blocks.assembly import model, run

SOURCE = '''
import pathlib
pathlib.Path(__file__).with_suffix(".ran").touch()

class PI:
    """kp e + ki times the sum of what came before."""

    def __init__(self):
        self.total = 0.0

    def __call__(self, t, u):
        out = 0.5 * (u[0] - u[1]) + 3.0 * self.total
        self.total += 0.01 * (u[0] - u[1])
        return out

def double(t, u):
    return 2 * u[0]

number = 3
'''

SCENARIO = """
schema: 1
name: speed-loop
blocks:
  reference: {type: Step, height: 20 rad/s, start: 0.03 s}
  CONTROLLER
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4e-5 kg.m2}
  friction: {type: BearingFriction, coulomb_friction: 2e-4 N.m}
connect:
  - [reference.out, law.REFERENCE]
  - [motor.shaft.speed, law.MEASUREMENT]
  - [law.out, motor.voltage]
  - [motor.shaft, friction.shaft]
simulate: {stop: 0.5 s, step: 2 ms, record: [motor.shaft.speed, law.out]}
"""
FOREIGN = "law: {type: PythonController, file: law.py, function: PI, inputs: 2, period: 10 ms}"
OWN = "law: {type: PI, proportional_gain: 0.5 V.s/rad, integral_gain: 3 V/rad, period: 10 ms}"


def written(folder: Path, controller: str, ports: tuple[str, str]) -> Path:
    text = SCENARIO.replace("CONTROLLER", controller).replace("REFERENCE", ports[0]).replace("MEASUREMENT", ports[1])
    (folder / "loop.yaml").write_text(text)
    (folder / "law.py").write_text(SOURCE)
    return folder / "loop.yaml"


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_a_loop_through_python_equals_the_block(tmp_path: Path, backend: str) -> None:
    foreign = load(written(tmp_path, FOREIGN, ("in1", "in2")))
    with pytest.warns(RuntimeWarning, match=r"'.*law.py' is run: a PythonController of the scenario names it"):
        theirs = foreign.build()
    own = load(written(tmp_path, OWN, ("reference", "measurement"))).build()
    runs = [simulate(made, 0.5, 0.002, backend=backend) for made in (theirs, theirs, own)]
    assert np.array_equal(runs[0].values, runs[1].values)
    np.testing.assert_allclose(runs[0]["motor.shaft.speed"], runs[2]["motor.shaft.speed"], rtol=1e-12, atol=1e-12)
    assert runs[0]["motor.shaft.speed"][-1] == pytest.approx(20, abs=0.5)
    assert runs[2].event_count == runs[0].event_count > 0


def test_nothing_runs_unless_the_scenario_is_built(tmp_path: Path) -> None:
    path = written(tmp_path, FOREIGN, ("in1", "in2"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scenario = load(path)
    assert not (tmp_path / "law.ran").exists()
    with pytest.warns(RuntimeWarning):
        scenario.build()
    assert (tmp_path / "law.ran").exists()


def test_a_module_is_imported_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "flexarm_test_law.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "flexarm_test_law", raising=False)
    block = PythonController(function="flexarm_test_law:double", period=0.1)
    parts: dict[str, Block] = {"s": Sine(amplitude="1 rad", frequency=0.7), "f": block}
    with pytest.warns(RuntimeWarning, match="'flexarm_test_law' is run"):
        result = run(parts, "s.out f.in", stop=1.0, step=0.05, energy=False)
    last = np.floor(result.time * 10 + 1e-9) / 10
    np.testing.assert_allclose(result["f.out"], 2 * np.sin(2 * np.pi * 0.7 * last), atol=1e-12)
    assert result.units["f.out"] == "V"


def test_a_callable_may_be_given_without_a_warning() -> None:
    calls = []

    def law(t: float, u: np.ndarray) -> list[float]:
        calls.append(t)
        return [u.sum(), t]

    block = PythonController(function=law, inputs=3, outputs=2, period=0.25, sample_offset=0.1, unit="1")
    assert block.function.endswith("law")
    parts: dict[str, Block] = {"a": Constant(value=1), "b": Constant(value=2), "c": Constant(value=4), "f": block}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = run(parts, "a.out f.in1", "b.out f.in2", "c.out f.in3", stop=1.0, step=0.05, energy=False)
    np.testing.assert_allclose(calls, [0.1, 0.35, 0.6, 0.85], atol=1e-15)
    np.testing.assert_allclose(result["f.out1"], 7.0 * (result.time > 0.099), atol=1e-15)
    assert result["f.out2"][-1] == pytest.approx(0.85)


def test_a_class_is_made_for_every_run() -> None:
    class Counter:
        def __init__(self) -> None:
            self.count = 0

        def __call__(self, t: float, u: np.ndarray) -> int:
            self.count += 1
            return self.count

    made = model({"f": PythonController(function=Counter, inputs=0, period=0.1)}, energy=False)
    for _ in range(2):
        assert simulate(made, 1.0, 0.1)["f.out"].tolist() == list(range(1, 12))


def test_a_failure_names_the_block_and_the_instant() -> None:
    def law(t: float, u: np.ndarray) -> float:
        if t > 0.25:
            raise RuntimeError("the arm is out of reach")
        return 0.0

    made = model({"f": PythonController(function=law, inputs=0, period=0.1)}, energy=False)
    with pytest.raises(
        SimulationError, match=r"'f.function' failed: RuntimeError: the arm is out of reach, at t = 0.3 s"
    ):
        simulate(made, 1.0, 0.1)


def test_no_gradients_and_no_export() -> None:
    parts: dict[str, Block] = {"s": Sine(frequency=1), "f": PythonController(function=lambda t, u: u[0], period=0.1)}
    made = model(parts, "s.out f.in", energy=False)
    with pytest.raises(ParameterError, match="has no derivative"):
        tangents(made, 1.0, 0.1, wrt=["s.amplitude"])
    with pytest.raises(NotImplementedError, match="only a simulation can call"):
        model_code(made)
    from fmu import export

    with pytest.raises(FlexarmError, match=r"'f.function' is a Python function"):
        export(made, Path("never-written.fmu"))
    assert not Path("never-written.fmu").exists()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"function": "double"}, r"does not say where to look\n.*package.module:name"),
        ({"function": "mod:double", "file": "law.py"}, "does not say where to look"),
        ({"function": "doubel", "file": "law.py"}, r"'.*law.py' has no 'doubel'\n  did you mean 'double'"),
        ({"function": "number", "file": "law.py"}, "'number' in '.*law.py' cannot be called"),
        ({"function": "double", "file": "none.py"}, r"'.*none.py' cannot be run: FileNotFoundError"),
        ({"function": "double", "file": "broken.py"}, r"'.*broken.py' cannot be run: SyntaxError"),
        ({"function": "no_such_module_here:f"}, "'no_such_module_here' cannot be run: ModuleNotFoundError"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*is run:RuntimeWarning")
def test_what_cannot_be_loaded(tmp_path: Path, values: dict[str, Any], message: str) -> None:
    (tmp_path / "law.py").write_text(SOURCE)
    (tmp_path / "broken.py").write_text("def f(:\n")
    if "file" in values:
        values = {**values, "file": str(tmp_path / values["file"])}
    with pytest.raises(ParameterError, match=message):
        model({"f": PythonController(**values, period=0.1, inputs=0)})


def test_results_are_stored_by_content(tmp_path: Path) -> None:
    def signature(source: str) -> str:
        (tmp_path / "law.py").write_text(source)
        block = PythonController(function="double", file=str(tmp_path / "law.py"), period=0.1)
        parts: dict[str, Block] = {"s": Sine(frequency=1), "f": block}
        with pytest.warns(RuntimeWarning):
            return model(parts, "s.out f.in").signature

    assert signature(SOURCE) == signature(SOURCE)
    assert signature(SOURCE) != signature(SOURCE.replace("2 * u", "3 * u"))


def test_the_pi_block_is_the_oracle() -> None:
    """The recursion of the foreign PI is that of the block's documentation."""
    block = PI(proportional_gain=0.5, integral_gain=3.0, period=0.01)
    parts: dict[str, Block] = {"r": Constant(value=2), "m": Constant(value=0.5), "pi": block}
    result = run(parts, "r.out pi.reference", "m.out pi.measurement", stop=0.1, step=0.01, energy=False)
    np.testing.assert_allclose(result["pi.out"], 0.75 + 4.5 * result.time, atol=1e-12)
