"""Twists shown as states in place of angles: values, rates, derivatives, starts and refusals at the FMU's border."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model
from fmpy.fmi3 import FMU3Model

import fmu
from engine.linearise import linearise
from engine.model import Model
from fmu.structure import structure
from fmu.twists import twists
from scenarios.load import load

CHAIN = """\
schema: 1
name: chain
blocks:
  motor: {type: DCMotor, resistance: 2, torque_constant: 0.05 N.m/A, rotor_inertia: 1e-4 kg.m2}
  rub: {type: BearingFriction, coulomb_friction: 0.01, viscous_friction: 1e-4}
  drive: {type: HarmonicDrive, ratio: -50, stiffness: 900, damping: 0.4}
  arm: {type: Inertia, inertia: 0.2}
  tip: {type: Inertia, inertia: 0.1}
  bend: {type: SpringDamper, stiffness: 300, damping: 0.1}
  clamp: {type: BearingFriction, coulomb_friction: 0.1}
connect:
  - [motor.shaft, rub.shaft, drive.input]
  - [drive.output, arm.shaft, bend.a]
  - [bend.b, tip.shaft, clamp.shaft]
"""
SHOWN = ["motor.shaft.angle", "drive.output.twist", "tip.shaft.twist"]
RATES = ["motor.shaft.speed", "drive.output.twist_rate", "tip.shaft.speed"]
S: Any = np.zeros((6, 6))
"""States shown = S states. The output turns by -1/50 of the motor; the tip, which friction holds, keeps its speed."""
S[:3, :3] = [[1, 0, 0], [1 / 50, 1, 0], [0, -1, 1]]
S[3:, 3:] = [[1, 0, 0], [1 / 50, 1, 0], [0, 0, 1]]


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Model:
    file = tmp_path_factory.mktemp("chain") / "chain.yaml"
    file.write_text(CHAIN)
    return load(file).build(inputs=["motor.voltage"], outputs=["drive.torque", "bend.torque", "tip.shaft.angle"])


class Exchange:
    """An instance in Model Exchange whose calls do not know the version of FMI."""

    def __init__(self, path: Path, folder: Path, version: int) -> None:
        extract(str(path), str(folder))
        self.description: Any = read_model_description(str(path))
        self.three = version == 3
        made = FMU3Model if self.three else FMU2Model
        self.fmu: Any = made(
            guid=self.description.instantiationToken if self.three else self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.description.modelExchange.modelIdentifier,
            instanceName="instance",
        )
        self.fmu.instantiate()
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}

    def get(self, names: list[str]) -> np.ndarray:
        read = self.fmu.getFloat64 if self.three else self.fmu.getReal
        return np.array(read([self.references[name] for name in names]))

    def set(self, name: str, value: float) -> None:
        write = self.fmu.setFloat64 if self.three else self.fmu.setReal
        write([self.references[name]], [value])

    def start(self) -> None:
        if self.three:
            self.fmu.enterInitializationMode(startTime=0.0)
        else:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        if self.three:
            self.fmu.updateDiscreteStates()
        else:
            self.fmu.newDiscreteStates()
        self.fmu.enterContinuousTimeMode()

    def _array(self, call: Any, values: np.ndarray) -> np.ndarray:
        import ctypes

        buffer = (ctypes.c_double * len(values))(*values)
        call(buffer, len(values))
        return np.array(buffer)

    @property
    def states(self) -> np.ndarray:
        return self._array(self.fmu.getContinuousStates, np.zeros(6))

    @states.setter
    def states(self, values: np.ndarray) -> None:
        self._array(self.fmu.setContinuousStates, values)

    @property
    def rates(self) -> np.ndarray:
        call = self.fmu.getContinuousStateDerivatives if self.three else self.fmu.getDerivatives
        return self._array(call, np.zeros(6))

    @property
    def nominals(self) -> np.ndarray:
        return self._array(self.fmu.getNominalsOfContinuousStates, np.zeros(6))


@pytest.fixture(params=[2, 3])
def shown(request: pytest.FixtureRequest, chain: Model, tmp_path: Path) -> Exchange:
    path = fmu.export(chain, tmp_path / "chain.fmu", platforms=["linux64"], version=request.param)
    assert fmu.validate(path) == []
    return Exchange(path, tmp_path / "unpacked", request.param)


def test_states_and_their_rates_are_those_of_the_names(shown: Exchange, chain: Model) -> None:
    """Vector and names agree, the coordinates follow, and the rates are S times the model's own."""
    shown.start()
    z = np.array([40.0, 3e-3, -2e-3, 30.0, 0.2, -0.7])
    shown.states = z
    x = np.linalg.solve(S, z)
    assert np.abs(shown.states - z).max() < 1e-15
    names = [state.name for state in chain.states]
    assert np.abs(shown.get(SHOWN + RATES) - z).max() < 1e-15
    assert np.abs(shown.get(names) - x).max() < 1e-14
    m = shown.fmu.getInt32 if shown.three else shown.fmu.getInteger
    modes = m([v.valueReference for v in shown.description.modelVariables if v.name.endswith(".mode")])
    own = chain.functions["derivative"](0.0, x, [0.0], [], modes, chain.parameter_values).full().ravel()
    expected = S @ own
    assert np.abs(shown.rates - expected).max() <= 1e-12 * np.abs(expected).max()
    assert np.abs(shown.get([f"der({name})" for name in SHOWN + RATES]) - shown.rates).max() == 0
    listed = {v.name: v.derivative.name for v in shown.description.modelVariables if v.derivative is not None}
    assert list(listed.values()) == SHOWN + RATES


def test_nominals_are_shares_of_what_the_twists_reach(shown: Exchange, chain: Model) -> None:
    shown.start()
    variables = {v.name: v for v in shown.description.modelVariables}
    assert [float(variables[name].nominal) for name in SHOWN + RATES] == shown.nominals.tolist()
    assert shown.nominals[1] < 1e-3 * shown.nominals[0]


def test_directional_derivatives_are_those_of_the_states_shown(shown: Exchange, chain: Model) -> None:
    """A' = S A S^-1, B' = S B, C' = C S^-1 of the linear model in the modes of the point, every joint sliding."""
    shown.set("motor.shaft.speed", 30.0)
    shown.set("drive.output.speed", 0.2)
    shown.set("tip.shaft.speed", 0.3)
    shown.start()
    point = dict(zip((s.name for s in chain.states), np.linalg.solve(S, shown.states), strict=True))
    linear = linearise(chain, at=point, modes={"rub": "sliding forward", "clamp": "sliding forward"})
    back = np.linalg.inv(S)
    expected = np.block([[S @ linear.A @ back, S @ linear.B], [linear.C @ back, linear.D]])
    rates = [shown.references[f"der({name})"] for name in SHOWN + RATES]
    y = [v.valueReference for v in shown.description.modelVariables if v.causality == "output"]
    knowns = [shown.references[name] for name in [*SHOWN, *RATES, "motor_voltage"]]
    columns = [shown.fmu.getDirectionalDerivative(rates + y, [known], [1.0]) for known in knowns]
    given = np.array(columns).T
    assert np.abs(given - expected).max() <= 1e-12 * np.abs(expected).max()
    listed = structure(chain, twists(chain)).rates
    for row, line in zip(listed, expected, strict=False):
        places = {k if what == "state" else 6 + k for what, k, _ in row}
        assert set(np.flatnonzero(np.abs(line) > 1e-9 * np.abs(expected).max())) <= places


def test_starts_are_set_on_angles_and_twists_follow(shown: Exchange) -> None:
    shown.set("drive.output.angle", 0.25)
    assert shown.get(["drive.output.angle"]) == [0.25]
    with pytest.raises(FMICallException):
        shown.set("drive.output.twist", 0.1)
    shown.start()
    assert shown.get(["drive.output.twist", "tip.shaft.twist"]) == pytest.approx([0.25, -0.25])
    with pytest.raises(FMICallException):
        shown.set("drive.output.angle", 0.1)
    starts = {v.name: (v.start, v.initial) for v in shown.description.modelVariables}
    assert starts["drive.output.twist"] == (None, "calculated")
    assert starts["drive.output.angle"] == ("0.0", "exact")


def test_the_relation_stays_that_of_the_export(shown: Exchange) -> None:
    """A tuned ratio changes the model and not what is shown, so states set come back."""
    shown.set("drive.ratio", -80.0)
    shown.start()
    z = np.array([40.0, 3e-3, -2e-3, 30.0, 0.2, -0.7])
    shown.states = z
    assert np.abs(shown.states - z).max() < 1e-15
    assert shown.get(["drive.output.angle"])[0] == pytest.approx(3e-3 - 40 / 50, abs=1e-14)


def test_saved_states_bring_the_twists_back(shown: Exchange) -> None:
    shown.start()
    z = np.array([40.0, 3e-3, -2e-3, 30.0, 0.2, -0.7])
    shown.states = z
    rates = shown.rates
    kept = (shown.fmu.getFMUState if shown.three else shown.fmu.getFMUstate)()
    shown.states = 2 * z
    (shown.fmu.setFMUState if shown.three else shown.fmu.setFMUstate)(kept)
    assert np.abs(shown.states - z).max() < 1e-15
    assert np.array_equal(shown.rates, rates)


LOOP = """\
schema: 1
name: loop
blocks:
  a: {type: Inertia, inertia: 1}
  b: {type: Inertia, inertia: 2}
  c: {type: Inertia, inertia: 3}
  ab: {type: SpringDamper, stiffness: 10}
  bc: {type: SpringDamper, stiffness: 20}
  ca: {type: SpringDamper, stiffness: 30}
  again: {type: SpringDamper, stiffness: 40}
connect:
  - [a.shaft, ab.a, ca.b, again.a]
  - [b.shaft, ab.b, bc.a, again.b]
  - [c.shaft, bc.b, ca.a]
"""


def test_springs_in_a_loop_or_side_by_side_give_no_more_twists_than_there_are(tmp_path: Path) -> None:
    file = tmp_path / "loop.yaml"
    file.write_text(LOOP)
    model = load(file).build()
    found = [twist for twist in twists(model) if twist.coordinate < model.coordinates]
    assert len(found) == 2
    matrix = np.eye(3)
    for twist in found:
        for k, coefficient in twist.terms.items():
            matrix[twist.coordinate, k] = coefficient
    assert abs(np.linalg.det(matrix)) == pytest.approx(1.0)
    assert np.count_nonzero(matrix @ np.ones(3)) == 1, "turning all shafts together changes one state"
