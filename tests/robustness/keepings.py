"""Files that are kept from one process to the next, changed: states of FMUs in Python, compiled code, sweeps."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
import os
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from hypothesis import strategies as st

from engine import cache
from engine import compile as compiling
from engine.errors import FlexarmError
from flexarm.cut import cut
from flexarm.sweeps.store import SweepStore
from flexarm.sweeps.sweep import make_plan, sweep
from flexarm.sweeps.work import compute
from flexarm.table import read
from fmu.plan import Plan, plan
from fmu.python_core import Core
from fmu.python_state import from_bytes, to_bytes
from scenarios.load import load
from tests.robustness.guard import REFUSED, RESULT, bounded, explained
from tests.robustness.strategies import mangled, mutated

SCENARIO = """\
schema: 1
name: kept
blocks:
  s: {type: Step, height: 1 V}
  b: {type: Delay, delay: 30 ms, period: 10 ms}
  p: {type: PythonController, function: Sum, file: sum.py, inputs: 1, period: 10 ms}
  m: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7}
  f: {type: BearingFriction, coulomb_friction: 1e-4 N.m}
connect:
  - [s.out, p.in]
  - [p.out, b.in]
  - [b.out, m.voltage]
  - [m.shaft, f.shaft]
simulate: {stop: 50 ms, step: 10 ms, record: [m.shaft.speed]}
analyses:
  fmu: {kind: export, inputs: [p.in], outputs: [m.shaft.speed]}
"""
CONTROLLER = """\
class Part:
    def __init__(self):
        self.last = 0.0

class Sum:
    def __init__(self):
        self.sum, self.part, self.seen = 0.0, Part(), [1, (2, 3)]

    def __call__(self, t, u):
        self.sum += u[0]
        self.part.last = u[0]
        return self.sum
"""


@functools.cache
def _plan() -> Plan:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        Path(folder, "sum.py").write_text(CONTROLLER, encoding="utf-8")
        Path(folder, "kept.yaml").write_text(SCENARIO, encoding="utf-8")
        return plan(cut(Path(folder, "kept.yaml"), "export").model)


@functools.cache
def _state() -> bytes:
    core = Core(_plan())
    core.begin(0.0)
    for k in range(35):
        core.step(k * 1e-3, 1e-3)
    return to_bytes(core.snapshot(), "i")


def states() -> st.SearchStrategy[Any]:
    """The body of a saved state, as values changed or as bytes changed."""
    body = _state()[32:]
    return mutated(json.loads(body)).map(_text) | mangled(body)


def _text(value: Any) -> bytes:
    return json.dumps(value, default=str).encode("utf-8", "surrogatepass")


def check_state(body: bytes) -> str:
    """Restore it and go on; a refusal leaves the instance as it was."""
    core = Core(_plan())
    core.begin(0.0)
    core.step(0.0, 1e-3)
    before = to_bytes(core.snapshot(), "i")
    with bounded():
        try:
            core.restore(from_bytes(hashlib.sha256(b"i" + body).digest() + body, "i"))
        except FlexarmError as error:
            if to_bytes(core.snapshot(), "i") != before:
                raise AssertionError("a refused state has changed the instance") from error
            return _said(error)
        try:
            core.step(core.time, 1e-3)
            assert np.isfinite(core.get([v.reference for v in core.plan.variables if v.kind == "output"])).all()
        except FlexarmError as error:
            return _said(error)
        return RESULT


def _said(error: FlexarmError) -> str:
    if not error.message:
        raise ValueError("an empty message") from error
    return REFUSED


SOURCE = '__attribute__((visibility("default"))) double answer(void) { return 42; }\n'


@contextmanager
def _cached() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, FLEXARM_CACHE=folder):
        yield Path(folder)


@functools.cache
def _entry() -> tuple[str, bytes]:
    with _cached() as folder:
        compiling.library(SOURCE)
        made = next(folder.iterdir())
        return made.name, made.read_bytes()


def entries() -> st.SearchStrategy[Any]:
    """The changed bytes of a compiled library."""
    whole = _entry()[1]
    cuts = st.integers(0, len(whole)).map(lambda n: whole[:n])
    return mangled(whole) | cuts | cuts.map(cache.sealed).filter(lambda made: len(made) < 100)


def check_entry(content: bytes) -> str:
    """The library must answer whatever lies in the cache."""
    with _cached() as folder, bounded():
        (folder / _entry()[0]).write_bytes(content)
        library = compiling.library(SOURCE)
        library.answer.restype = ctypes.c_double
        assert library.answer() == 42
        return RESULT


SPIN = """\
schema: 1
name: spin
blocks:
  w: {type: Inertia, inertia: 0.5 kg.m2}
initial: {w.shaft.speed: 1}
simulate: {stop: 0.1 s, step: 10 ms, record: [w.shaft.angle]}
"""
VARY = ["w.inertia=1:4:4"]


@functools.cache
def _interrupted() -> dict[str, bytes]:
    """Files of a sweep whose runs are all done but not joined."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "spin.yaml").write_text(SPIN, encoding="utf-8")
        made = make_plan(load(Path(folder, "spin.yaml")), VARY)
        store = SweepStore(Path(folder, "out.parquet"), made, {})
        for span in store.begin():
            store.write(span, compute(made, span))
        store.close()
        return {path.name: path.read_bytes() for path in store.parts.iterdir()}


def _first(data: bytes, count: int) -> bytes:
    return data[:count]


@st.composite
def kept(draw: Any) -> dict[str, bytes | None]:
    """Changes of some of the files: other bytes, or a folder in the place of it (None)."""
    files = _interrupted()
    names = draw(st.lists(st.sampled_from(sorted(files)), min_size=1, max_size=3, unique=True))
    return {
        name: draw(
            st.none()
            | st.just(b"")
            | mangled(files[name])
            | st.integers(0, 4000).map(functools.partial(_first, files[name]))
        )
        for name in names
    }


def check_kept(changes: dict[str, bytes | None]) -> str:
    """The same command goes on from there, or refuses; begun again it is done."""
    with tempfile.TemporaryDirectory() as name, bounded():
        folder = Path(name)
        (folder / "spin.yaml").write_text(SPIN, encoding="utf-8")
        parts = folder / "out.parquet.parts"
        parts.mkdir()
        for file, content in (_interrupted() | changes).items():
            if content is None:
                (parts / file).mkdir()
            else:
                (parts / file).write_bytes(content)
        outcome = RESULT
        try:
            sweep(folder / "spin.yaml", VARY, folder / "out.parquet", workers=1)
        except FlexarmError as error:
            outcome = explained(error)
            if changes.get(".lock", b"") is not None:
                sweep(folder / "spin.yaml", VARY, folder / "out.parquet", workers=1, restart=True)
            else:
                return outcome
        table = read(folder / "out.parquet")
        assert table["w.inertia"].tolist() == [1.0, 2.0, 3.0, 4.0]
        assert np.abs(table["w.shaft.angle.final"] - 0.1).max() < 1e-12
        return outcome
