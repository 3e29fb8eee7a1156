"""Parameters that contradict one another are an error of the FMU with the reason in its log, and can be mended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Model, FMU3Slave

import fmu
from blocks.actuators.friction import BearingFriction
from engine.errors import ParameterError
from engine.model import Model
from fmu.plan import plan
from fmu.python_core import Core
from scenarios.load import load

RUBBING = """\
schema: 1
name: rubbing
blocks:
  drive: {type: Torque}
  source: {type: Step, height: 1 N.m, start: 0.1 s, stop: 0.2 s}
  limit: {type: Saturation, lower: -1 N.m, upper: 1 N.m}
  rotor: {type: Inertia, inertia: 0.1}
  rub: {type: BearingFriction, coulomb_friction: 0.2 N.m, static_friction: 0.3 N.m}
connect:
  - [source.out, limit.in]
  - [limit.out, drive.torque]
  - [drive.shaft, rotor.shaft, rub.shaft]
"""
CONFLICTS = [
    ({"rub.static_friction": 0.1}, "rub.static_friction = 0.1 is less than rub.coulomb_friction = 0.2"),
    ({"rub.coulomb_friction": 0.7}, "rub.static_friction = 0.3 is less than rub.coulomb_friction = 0.7"),
    ({"limit.lower": 1.0}, "limit.lower = 1 is not below limit.upper = 1"),
    ({"source.stop": 0.1}, "source.stop = 0.1 is not after source.start = 0.1"),
]


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> Model:
    file = tmp_path_factory.mktemp("rubbing") / "rubbing.yaml"
    file.write_text(RUBBING)
    return load(file).build(outputs=["rotor.shaft.speed"])


class Instance:
    """Calls whose spelling depends on the version of FMI, and what is logged."""

    def __init__(self, path: Path, folder: Path, version: int, exchange: bool) -> None:
        extract(str(path), str(folder))
        self.description: Any = read_model_description(str(path))
        self.three, self.exchange, self.messages = version == 3, exchange, list[str]()
        made = (FMU3Model if exchange else FMU3Slave) if self.three else (FMU2Model if exchange else FMU2Slave)
        part = self.description.modelExchange if exchange else self.description.coSimulation
        self.fmu: Any = made(
            guid=self.description.instantiationToken if self.three else self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=part.modelIdentifier,
            instanceName="instance",
        )

        def log(*arguments: Any) -> None:
            self.messages.append(arguments[-1].decode())

        if self.three:
            self.fmu.instantiate(loggingOn=True, logMessage=log)
        else:
            calls = fmi2CallbackFunctions()
            calls.logger = fmi2CallbackLoggerTYPE(log)
            self.fmu.instantiate(loggingOn=True, callbacks=calls)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}

    def set(self, values: dict[str, float]) -> None:
        write = self.fmu.setFloat64 if self.three else self.fmu.setReal
        for name, value in values.items():
            write([self.references[name]], [value])

    def speed(self) -> float:
        read = self.fmu.getFloat64 if self.three else self.fmu.getReal
        return float(read([self.references["rotor_shaft_speed"]])[0])

    def enter(self) -> None:
        if self.three:
            self.fmu.enterInitializationMode(startTime=0.0)
        else:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()

    def leave(self) -> None:
        self.fmu.exitInitializationMode()

    def goes_on(self, k: int) -> None:
        """A step, or the event iteration of Model Exchange."""
        if not self.exchange:
            self.fmu.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
        elif self.three:
            self.fmu.updateDiscreteStates()
        else:
            self.fmu.newDiscreteStates()

    def refuses(self, words: str, action: Any, *arguments: Any) -> None:
        self.messages.clear()
        with pytest.raises(FMICallException) as caught:
            action(*arguments)
        assert caught.value.status == 3
        assert [words in message for message in self.messages] == [True], self.messages


@pytest.mark.parametrize("exchange", [False, True], ids=["Co-Simulation", "Model Exchange"])
@pytest.mark.parametrize("version", [2, 3])
def test_an_importer_is_refused_and_may_mend_it(version: int, exchange: bool, rubbing: Model, tmp_path: Path) -> None:
    """At the start and while running; one by one, in any order, the values may pass through a contradiction."""
    path = fmu.export(rubbing, tmp_path / "rubbing.fmu", platforms=["linux64"], version=version)
    own = {p.name: p.value for p in rubbing.parameters}
    made = Instance(path, tmp_path / "unpacked", version, exchange)
    made.enter()
    for wrong, words in CONFLICTS:
        made.set(wrong)
        made.refuses(words, made.leave)
        made.refuses(words, made.speed)
        made.set({name: own[name] for name in wrong})
    made.set({"rub.coulomb_friction": 0.7})
    made.set({"rub.static_friction": 0.9})
    made.leave()
    made.goes_on(0)
    for k, (wrong, words) in enumerate(
        [({"rub.static_friction": 0.6}, "0.6 is less than rub.coulomb"), *CONFLICTS[2:]]
    ):
        made.set(wrong)
        made.refuses(words, made.speed)
        made.refuses(words, made.goes_on, 1 + k)
        made.set({name: 0.9 if name.startswith("rub") else own[name] for name in wrong})
        assert np.isfinite(made.speed())
        made.goes_on(1 + k)


def test_the_python_backend_refuses_it_too(rubbing: Model) -> None:
    core = Core(plan(rubbing, settable=False))
    reference = {v.name: v.reference for v in core.plan.variables}
    core.set([reference["rub.static_friction"]], [0.1])
    with pytest.raises(ParameterError, match="is less than"):
        core.step(0.0, 1e-3)
    core.set([reference["rub.coulomb_friction"]], [0.05])
    core.step(0.0, 1e-3)


def test_a_fit_may_pass_through_it(rubbing: Model) -> None:
    """The law then takes the sliding level for both, so that a search is not cut off; the scenario refuses it."""
    assert rubbing.parameter_vector({"rub.static_friction": 0.1})[rubbing.parameter_index("rub.static_friction")] == 0.1
    assert "is less than" in rubbing.parameter_conflict(rubbing.parameter_vector({"rub.static_friction": 0.1}))
    assert rubbing.parameter_conflict(rubbing.parameter_values) == ""
    with pytest.raises(ParameterError, match=r"static_friction = 0.1 N.m is less than coulomb_friction = 0.2 N.m"):
        BearingFriction(coulomb_friction=0.2, static_friction=0.1)
