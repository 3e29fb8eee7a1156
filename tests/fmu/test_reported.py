"""What users of importers report of other tools' FMUs, as tests of ours.

Simulink's importer: outputs that are zero at initialization, algebraic loops that are none, a hidden delay of one step.
OpenModelica: events that are missed between two steps.
"""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model

import fmu
from engine.model import Model
from engine.simulate import Drive, simulate
from fmu.verify import reference, references, slave
from scenarios.load import load


def test_outputs_have_their_values_at_initialization(smooth_model: Model, exported: Any) -> None:
    """A current of 2 V over the resistance, at once: in initialization mode, after it, and before any step."""
    with slave(exported(smooth_model)) as (instance, description, _):
        [current] = [reference(description, "motor_current")]
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.setReal(references(description, "input"), [2.0])
        resistance = instance.getReal([reference(description, "motor.resistance")])[0]
        assert instance.getReal([current]) == [pytest.approx(2.0 / resistance, rel=1e-12)]
        instance.exitInitializationMode()
        assert instance.getReal([current]) == [pytest.approx(2.0 / resistance, rel=1e-12)]


@pytest.mark.parametrize(
    "name", ["reference-a", "reference-b", "harmonic-drive-arm", "two-link-flexible", "srv02-tracking"]
)
def test_no_false_algebraic_loop(name: str, tmp_path: Path) -> None:
    """By the description an output depends on an input if, and only if, setting the input changes it at once."""
    path = fmu.export(_driven(name), tmp_path / "x.fmu", platforms=["linux64"])
    with slave(path) as (instance, description, _):
        u, y = references(description, "input"), references(description, "output")
        said = np.zeros((len(y), len(u)), dtype=bool)
        for unknown in description.outputs:
            for known in unknown.dependencies or []:
                if known.valueReference in u:
                    said[y.index(unknown.variable.valueReference), u.index(known.valueReference)] = True
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.setReal(u, [7.0] * len(u))
        instance.exitInitializationMode()
        instance.doStep(0.0, 0.02)
        found = np.zeros_like(said)
        for k in range(len(u)):
            before = np.array(instance.getReal(y))
            instance.setReal([u[k]], [8.0])
            found[:, k] = np.array(instance.getReal(y)) != before
            instance.setReal([u[k]], [7.0])
    assert not (found & ~said).any()
    assert np.array_equal(found, said)


def _driven(name: str) -> Model:
    """A shipped scenario without its controllers, so that inputs act at once or not at all."""
    from flexarm.cut import cut

    return cut(load(name), "export").model


def test_no_hidden_delay(smooth_model: Model, exported: Any) -> None:
    """An input set before a step acts over that step: the first row is that of a step of the input at zero."""
    times = np.arange(11) * 1e-3
    expected = simulate(smooth_model, 0.01, 1e-3, drive=Drive(times, np.full((11, 1), 3.0))).values
    with slave(exported(smooth_model)) as (instance, description, _):
        u, y = references(description, "input"), references(description, "output")
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        instance.setReal(u, [3.0])
        for k in range(10):
            instance.doStep(k * 1e-3, 1e-3)
            assert instance.getReal(y) == pytest.approx(expected[k + 1], rel=1e-12, abs=1e-15)
        assert abs(expected[1]).min() > 0


@pytest.mark.parametrize("name", ["srv02-backlash", "reference-b"])
def test_an_importer_that_looks_at_its_steps_alone_misses_no_event(name: str, tmp_path: Path) -> None:
    """Euler steps of 50 us, indicators compared at their ends, not located: the modes are those of the run."""
    stop, step, model = 1.0, 5e-5, load(name).build()
    path = fmu.export(model, tmp_path / "x.fmu", platforms=["linux64"])
    run = simulate(model, stop, 1e-3)
    expected = {mode.name: _modes(run.events, mode.name) for mode in model.modes if mode.kind != "time"}
    found = _euler(path, tmp_path, stop, step)
    assert sum(map(len, expected.values())) > 2
    for mode, rows in expected.items():
        assert [value for _, value in found[f"{mode}.mode"]] == [value for _, value in rows], mode
        assert [t for t, _ in found[f"{mode}.mode"]] == pytest.approx([t for t, _ in rows], abs=1e-3), mode


def _modes(events: Sequence[tuple[float, str, float]], name: str) -> list[tuple[float, int]]:
    """Changes of a mode; of several at one instant, such as a stop that is passed, the last."""
    rows = [(time, int(value)) for time, mode, value in events if mode == name and time > 0]
    return [row for row, after in itertools.zip_longest(rows, rows[1:]) if after is None or after[0] - row[0] > 1e-9]


def _euler(path: Path, folder: Path, stop: float, step: float) -> dict[str, list[tuple[float, int]]]:
    """Changes of each mode in a run of Model Exchange with explicit Euler."""
    extract(str(path), str(folder / "unpacked"))
    description: Any = read_model_description(str(path))
    model: Any = FMU2Model(
        guid=description.guid,
        unzipDirectory=str(folder / "unpacked"),
        modelIdentifier=description.modelExchange.modelIdentifier,
        instanceName="instance",
    )
    modes = {v.name: v.valueReference for v in description.modelVariables if v.type == "Integer"}
    model.instantiate()
    model.setupExperiment(startTime=0.0)
    model.enterInitializationMode()
    model.exitInitializationMode()
    x = (ctypes.c_double * description.numberOfContinuousStates)()
    rate, z = (ctypes.c_double * len(x))(), (ctypes.c_double * description.numberOfEventIndicators)()
    found: dict[str, list[tuple[float, int]]] = {name: [] for name in modes}

    def events() -> float:
        while True:
            again, _, _, _, timed, at = model.newDiscreteStates()
            if not again:
                break
        model.enterContinuousTimeMode()
        return float(at) if timed else np.inf

    due = events()
    old = dict(zip(modes, model.getInteger(list(modes.values())), strict=True))
    model.getEventIndicators(z, len(z))
    time, signs = 0.0, np.sign(z)
    for k in range(1, round(stop / step) + 1):
        model.getContinuousStates(x, len(x))
        model.getDerivatives(rate, len(x))
        length, time = k * step - time, k * step
        model.setTime(time)
        for i, slope in enumerate(rate):
            x[i] += length * slope
        model.setContinuousStates(x, len(x))
        model.completedIntegratorStep()
        model.getEventIndicators(z, len(z))
        if (np.sign(z) != signs).any() or time >= due:
            model.enterEventMode()
            due = events()
            new = dict(zip(modes, model.getInteger(list(modes.values())), strict=True))
            for name, value in new.items():
                if value != old[name]:
                    found[name].append((time, value))
            old = new
            model.getEventIndicators(z, len(z))
        signs = np.sign(z)
    model.freeInstance()
    return found
