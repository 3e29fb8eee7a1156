"""Saved states, reset and tuning."""

from __future__ import annotations

import math
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from engine import native
from engine.model import TIME, Model
from engine.native import Job, Timetable
from fmu.verify import reference, references, slave

each_model = pytest.mark.parametrize("name", ["smooth_model", "switching_model", "timed_model", "delayed_model"])


def _start(instance: Any) -> None:
    instance.setupExperiment(startTime=0.0)
    instance.enterInitializationMode()
    instance.exitInitializationMode()


def _run(instance: Any, description: Any, first: int, last: int, step: float = 1e-3) -> np.ndarray:
    """Outputs of the steps, the input being a wave."""
    u, y = references(description, "input"), references(description, "output")
    rows = []
    for k in range(first, last):
        instance.setReal(u, [3 * np.sin(0.07 * (k - k % 5))] * len(u))
        instance.doStep(currentCommunicationPoint=k * step, communicationStepSize=step)
        rows.append(instance.getReal(y))
    return np.array(rows)


@each_model
def test_reset_equals_a_fresh_instance(name: str, exported: Any, request: pytest.FixtureRequest) -> None:
    model = request.getfixturevalue(name)
    with slave(exported(model)) as (instance, description, _):
        _start(instance)
        fresh = _run(instance, description, 0, 300)
        tuned = reference(description, "motor.resistance")
        instance.setReal([tuned], [4.0])
        _run(instance, description, 300, 400)
        instance.reset()
        assert instance.getReal([tuned]) == [2.6]
        _start(instance)
        assert np.array_equal(_run(instance, description, 0, 300), fresh)


@each_model
def test_a_saved_state_rolls_back_bit_for_bit(name: str, exported: Any, request: pytest.FixtureRequest) -> None:
    model = request.getfixturevalue(name)
    with slave(exported(model)) as (instance, description, _):
        whole = [v.valueReference for v in description.modelVariables if v.type == "Integer"]
        modes = set()
        _start(instance)
        _run(instance, description, 0, 217)
        state = instance.getFMUstate()
        first = _run(instance, description, 217, 500)
        modes.add(tuple(instance.getInteger(whole)))
        instance.setReal([reference(description, "motor.resistance")], [5.0])
        _run(instance, description, 500, 600)
        instance.setFMUstate(state)
        assert np.array_equal(_run(instance, description, 217, 500), first)
        assert tuple(instance.getInteger(whole)) in modes
        again = instance.getFMUstate()
        instance.setFMUstate(state)
        instance.getFMUstate()
        instance.freeFMUstate(state)
        instance.freeFMUstate(again)


def test_a_state_saved_after_reading_outputs_is_the_same_instant(switching_model: Model, exported: Any) -> None:
    with slave(exported(switching_model)) as (instance, description, _):
        y, u = references(description, "output"), references(description, "input")
        _start(instance)
        _run(instance, description, 0, 100)
        instance.getReal(y)
        state = instance.getFMUstate()
        instance.setReal(u, [2.5])
        expected = instance.getReal(y)
        instance.setReal(u, [-9.0])
        instance.getReal(y)
        instance.setFMUstate(state)
        instance.setReal(u, [2.5])
        assert instance.getReal(y) == expected


_CONTINUE = """
import sys
import numpy as np
from pathlib import Path
sys.path.insert(0, sys.argv[4])
from fmu.verify import slave
from importlib.util import module_from_spec, spec_from_file_location
spec = spec_from_file_location("tests_state", sys.argv[3])
tests = module_from_spec(spec)
spec.loader.exec_module(tests)
with slave(sys.argv[1]) as (instance, description, _):
    tests._start(instance)
    instance.setFMUstate(instance.deSerializeFMUstate(Path(sys.argv[2]).read_bytes()))
    np.save(sys.argv[2] + ".npy", tests._run(instance, description, 217, 400))
"""


@pytest.mark.parametrize("name", ["switching_model", "timed_model", "delayed_model"])
def test_a_serialised_state_continues_in_a_new_process(
    name: str, exported: Any, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    path, file = exported(request.getfixturevalue(name)), tmp_path / "state"
    with slave(path) as (instance, description, _):
        _start(instance)
        _run(instance, description, 0, 217)
        file.write_bytes(instance.serializeFMUstate(instance.getFMUstate()))
        expected = _run(instance, description, 217, 400)
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, "-c", _CONTINUE, path, file, __file__, root], check=True)
    assert np.array_equal(np.load(f"{file}.npy"), expected)


def test_damaged_and_foreign_states_are_refused(switching_model: Model, smooth_model: Model, exported: Any) -> None:
    with slave(exported(smooth_model)) as (other, _, _):
        _start(other)
        foreign = other.serializeFMUstate(other.getFMUstate())
    with slave(exported(switching_model)) as (instance, description, messages):
        _start(instance)
        _run(instance, description, 0, 50)
        blob = instance.serializeFMUstate(instance.getFMUstate())
        before = instance.getReal(references(description, "output"))
        bad = [foreign, b"", blob[:-1], blob + b"\0", b"x" * len(blob)]
        bad += [blob[:at] + bytes([blob[at] ^ 0x10]) + blob[at + 1 :] for at in (0, 9, 17, 25, 40, len(blob) - 1)]
        for wrong in bad:
            messages.clear()
            with pytest.raises(FMICallException):
                instance.deSerializeFMUstate(wrong)
            assert len(messages) == 1
        assert instance.getReal(references(description, "output")) == before
        with pytest.raises(FMICallException):
            instance.setFMUstate(None)
        instance.setFMUstate(instance.deSerializeFMUstate(blob))


def _restart(model: Model, instance: Any, description: Any, p: np.ndarray, at: float, rows: int) -> np.ndarray:
    """The runner's outputs from the FMU's present state on, with parameters p and the inputs at zero."""
    kinds = {kind: [v for v in description.modelVariables if v.causality == "local"] for kind in ("Real", "Integer")}
    reals = {v.name: v.valueReference for v in kinds["Real"] if v.type == "Real"}
    whole = [v.valueReference for v in kinds["Integer"] if v.type == "Integer"]
    modes = iter(instance.getInteger(whole)) if whole else iter(())
    half = round(2000 * at) % 2
    job = Job(
        p=p,
        x0=np.array(instance.getReal([reals[state.name] for state in model.states])),
        d0=np.array(instance.getReal([reals[memory.name] for memory in model.memories])),
        m0=np.array([1.0 if mode.kind == TIME else float(next(modes)) for mode in model.modes]),
        hmax=1e-3,
        timetable=Timetable(
            resolution=5e-4,
            rows=2 * np.arange(rows + 1),
            time=np.arange(rows + 1) * np.float64(1e-3),
            period=np.full(len(model.clocks), 2, dtype=np.int64),
            offset=np.full(len(model.clocks), half, dtype=np.int64),
            knot=np.zeros(1, dtype=np.int64),
            value=np.zeros((1, len(model.inputs))),
            linear=np.zeros(len(model.inputs), dtype=np.int32),
        ),
        t0=at,
    )
    outcome = native.run(model, job)
    assert outcome.status == 0
    return outcome.y


@pytest.mark.parametrize(
    ("name", "at", "changed"),
    [
        ("smooth_model", 0.3, {"motor.resistance": 4.0, "link.mass": 0.05}),
        ("timed_model", 0.3, {"friction.coulomb_friction": 1e-3, "gear.ratio": 9.0}),
        ("switching_model", 0.3005, {"play.half_gap": 0.001, "friction.static_friction": 2.3e-4}),
    ],
)
def test_tuning_equals_a_restart_from_the_same_state(
    name: str, at: float, changed: dict[str, float], exported: Any, request: pytest.FixtureRequest
) -> None:
    model = request.getfixturevalue(name)
    with slave(exported(model)) as (instance, description, _):
        u, y = references(description, "input"), references(description, "output")
        _start(instance)
        _run(instance, description, 0, 300)
        if at > 0.3:
            instance.doStep(currentCommunicationPoint=0.3, communicationStepSize=at - 0.3)
        instance.setReal(u, [0.0] * len(u))
        expected = _restart(model, instance, description, model.parameter_vector(changed), at, 200)
        instance.setReal([reference(description, n) for n in changed], list(changed.values()))
        given = [instance.getReal(y)]
        for k in range(200):
            instance.doStep(currentCommunicationPoint=at + k * 1e-3, communicationStepSize=1e-3)
            given.append(instance.getReal(y))
    assert np.allclose(given, expected, rtol=1e-9, atol=1e-10)


def test_a_parameter_that_only_acts_on_the_start_is_fixed(switching_model: Model, exported: Any) -> None:
    with slave(exported(switching_model)) as (instance, description, messages):
        start = next(v for v in description.modelVariables if v.name == "controller.start")
        assert start.variability == "fixed"
        instance.setReal([start.valueReference], [0.7])
        _start(instance)
        integral = reference(description, "controller.integral")
        assert instance.getReal([integral])[0] == pytest.approx(0.7, abs=1e-2)
        with pytest.raises(FMICallException):
            instance.setReal([start.valueReference], [0.1])
        assert "controller.start" in messages[-1]


def test_two_fmus_in_one_process_do_not_meet(smooth_model: Model, switching_model: Model, exported: Any) -> None:
    alone = []
    for model in (smooth_model, switching_model):
        with slave(exported(model)) as (instance, description, _):
            _start(instance)
            alone.append(_run(instance, description, 0, 200))
    with slave(exported(smooth_model)) as (a, of_a, _), slave(exported(switching_model)) as (b, of_b, _):
        _start(a)
        _start(b)
        for first in range(0, 200, 10):
            assert np.array_equal(_run(a, of_a, first, first + 10), alone[0][first : first + 10])
            assert np.array_equal(_run(b, of_b, first, first + 10), alone[1][first : first + 10])


def _forged(blob: bytes, at: int, value: bytes) -> bytes:
    """A serialised state with other bytes at a place of its state, and the checksum that belongs to them."""
    state = bytearray(blob[32:])
    state[at : at + len(value)] = value
    total = 1469598103934665603
    for byte in state:
        total = ((total ^ byte) * 1099511628211) % 2**64
    return blob[:24] + total.to_bytes(8, "little") + bytes(state)


_WORDS = [b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"\x63\0\0\0", b"\0\0\0\x80"]
_DOUBLES = [struct.pack("<d", value) for value in (math.nan, math.inf, -1.0, 7.0, 1e300)]


def test_forged_states_are_refused_or_harmless(switching_model: Model, exported: Any, tmp_path: Path) -> None:
    """Every word of a saved state replaced in turn, under a checksum that fits: no crash, no hang, no false step.

    In a child process, which may die: what matters is that it does not.
    """
    with slave(exported(switching_model)) as (instance, description, _):
        _start(instance)
        _run(instance, description, 0, 50)
        blob = instance.serializeFMUstate(instance.getFMUstate())
    files = tmp_path / "blob"
    files.write_bytes(bytes(blob))
    run = subprocess.run(
        [sys.executable, "-c", _FORGER, str(exported(switching_model)), str(files)],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-500:] + run.stderr[-2000:]
    refused, taken = map(int, run.stdout.split()[-2:])
    assert refused > 100
    assert taken > 100


_FORGER = """
import sys
from pathlib import Path
from fmpy.fmi1 import FMICallException
from fmu.verify import references, slave
from tests.fmu.test_state import _DOUBLES, _WORDS, _forged, _start

blob = Path(sys.argv[2]).read_bytes()
refused = taken = 0
with slave(sys.argv[1]) as (instance, description, messages):
    y = references(description, "output")
    _start(instance)
    for width, values in ((4, _WORDS), (8, _DOUBLES)):
        for at in range(0, len(blob) - 32 - width + 1, width):
            messages.clear()
            try:
                state = instance.deSerializeFMUstate(_forged(blob, at, values[at // width % len(values)]))
                instance.setFMUstate(state)
            except FMICallException:
                refused += 1
                continue
            taken += 1
            try:
                instance.getReal(y)
                instance.doStep(currentCommunicationPoint=0.05, communicationStepSize=1e-3)
            except FMICallException:
                instance.reset()
                _start(instance)
            instance.freeFMUstate(state)
print(refused, taken)
"""
