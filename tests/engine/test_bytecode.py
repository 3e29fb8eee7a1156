"""Byte code: the numbers of compiled code to the bit, for every operation and for whole runs; and when it gives way."""

from __future__ import annotations

import ctypes
import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from blocks.controllers.delay import Delay
from blocks.controllers.gain import Gain
from blocks.sources.sine import Sine
from engine import bytecode, native
from engine.assemble import build
from engine.codegen import INCLUDES, Emitter, runtime
from engine.compile import library
from engine.model import Model
from engine.operations import BINARY, UNARY
from engine.simulate import Drive, simulate
from engine.system import Connection, System
from engine.tangent import tangents
from scenarios.load import load

QUICK = ["reference-a", "reference-b", "srv02-tracking", "bouc-wen", "ball-screw-axis", "robot-servo"]
SLOW = [
    "belt-axis",
    "clamped-flexible-link",
    "coupled-drives",
    "emps",
    "flexible-arm-braked",
    "flexible-arm-sweep",
    "flexible-joint-stage",
    "flexible-pendulum",
    "friction-damper",
    "harmonic-drive-arm",
    "lumped-arm-pulse",
    "pmsm-joint",
    "quanser-single-link",
    "reference-c",
    "rigid-pendulum",
    "silverbox",
    "srv02-3mass-b4",
    "srv02-backlash",
    "two-link-flexible",
    "xl330-loaded",
]
SCENARIOS = [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]


@pytest.fixture
def ways(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Calls a function twice: with byte code alone, and with the model's own code alone."""

    def both(run: Any) -> tuple[Any, Any]:
        made = []
        for enough in (math.inf, -math.inf):
            native.forget()
            monkeypatch.setattr(native, "ENOUGH", enough)
            monkeypatch.setattr(native, "LOOK", math.inf)
            made.append(run())
            assert all((way.own is None) == (enough > 0) for way in native._ways.values())
        native.forget()
        return made[0], made[1]

    return both


def _same(one: Any, other: Any) -> None:
    assert one.events == other.events
    assert one.steps == other.steps
    for name in ("values", "states", "modes", "final_state", "final_memory", "final_modes"):
        a, b = getattr(one, name), getattr(other, name)
        assert a is b is None or np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes(), name


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_run_of_a_scenario_is_the_same_to_the_bit(name: str, ways: Any) -> None:
    model = load(name).build()
    _same(*ways(lambda: simulate(model, 1.5, 1e-3, record_states=True)))


@pytest.mark.parametrize("name", SCENARIOS)
def test_its_tangents_are_too(name: str, ways: Any) -> None:
    model = load(name).build()
    names = [p.name for p in model.parameters][::2][:6]
    states = [state.name for state in model.states][:2] if not model.initial else []
    for wrt in (names[:2], [*names, *states]):
        one, other = ways(lambda wrt=wrt: tangents(model, 0.5, 1e-3, wrt=wrt))
        _same(one.result, other.result)
        assert np.array_equal(one.values, other.values)
        assert one.grazing == other.grazing


def _delayed() -> Model:
    blocks = {
        "s": Sine(amplitude=2.0, frequency="3 Hz"),
        "g": Gain(gain=1.5),
        "b": Delay(delay="70 ms", period="10 ms"),
    }
    return build(System(blocks, [Connection(("s.out", "g.in")), Connection(("g.out", "b.in"))], name="line"), ["g.in"])


def test_delays_and_drives_are_too(ways: Any) -> None:
    model = _delayed()
    time = np.arange(0.0, 1.0, 0.013)
    for hold in ("linear", "previous"):
        drive = Drive(time, np.sin(20 * time)[:, None], hold)
        _same(*ways(lambda drive=drive: simulate(model, 1.0, 1e-3, drive=drive, record_states=True)))
        one, other = ways(lambda drive=drive: tangents(model, 1.0, 1e-3, wrt=["g.gain", "b.start"], drive=drive))
        assert np.array_equal(one.values, other.values)
        assert np.abs(one.values).max() >= 1


_WRAPPED = """
__attribute__((visibility("default"))) void both(const double *x, const double *m, const double *p, double *r) {
  double cp[FA_NCP + 1], cm[FA_NCM + 1];
  fa_prepare_parameters(p, cp);
  fa_prepare_modes(m, p, cp, cm);
  fa_derivative(p[1] * x[1], x, 0, 0, m, p, cp, cm, 0, r);
}
"""
_INTERPRETED = """
__attribute__((visibility("default"))) void both(const double *x, const double *m, const double *p, double *r,
                                                 const fa_code *code) {
  const struct { const fa_code *code; double *file; } made = {code, (double[4096]){0}}, *s = &made;
  fa_filled(code, made.file);
  fa_prepare_parameters(p, 0);
  fa_prepare_modes(m, 0, 0, 0);
  fa_derivative(p[1] * x[1], x, 0, 0, m, p, 0, 0, 0, r);
}
"""


def test_every_operation_is_the_same_to_the_bit() -> None:
    t, u, d = ca.SX.sym("t"), ca.SX(0, 1), ca.SX(0, 1)
    x, m, p, fire = ca.SX.sym("x", 2), ca.SX.sym("m", 2), ca.SX.sym("p", 2), ca.SX(0, 1)
    emitter = Emitter()
    pairs = [(x[0], x[1]), (x[0], p[0]), (p[1], p[0]), (x[1], m[0]), (m[1], p[0]), (x[0], ca.SX(0.7)), (t, x[1])]
    nodes = []
    for operation in (*UNARY, *BINARY):
        for a, b in pairs:
            made = ca.SX.unary(operation, a) if operation in UNARY else ca.SX.binary(operation, a, b)
            nodes += [made, ca.if_else(m[0] != 0, made * x[0], 0), ca.if_else(m[1] * p[0] > 0, made + a, a)]
    emitter.add("derivative", [t, x, u, d, m, p, fire], ca.vertcat(*nodes))
    code = bytecode.Code()
    code.struct.nx, code.struct.np, code.struct.nf = 2, 2, 2
    assert bytecode._programs(code, emitter)
    head = "static double fa_min(double a, double b) { return a < b ? a : b; }\n"
    head += "static double fa_max(double a, double b) { return a > b ? a : b; }\n"
    head += "static double fa_sign(double a) { return (double)((a > 0) - (a < 0)); }\n"
    own = library(INCLUDES + head + emitter.text() + _WRAPPED)
    source = bytecode.source()
    general = library(source[: source.index(runtime("core.c"))] + _INTERPRETED)
    random = np.random.default_rng(0)
    for _ in range(50):
        given = [random.normal(0, 2, 2), random.integers(-1, 2, 2).astype(float), random.normal(0, 2, 2)]
        found = np.zeros((2, len(nodes)))
        arrays = [array.ctypes.data_as(ctypes.c_void_p) for array in given]
        own.both(*arrays, ctypes.c_void_p(found[0].ctypes.data))
        general.both(*arrays, ctypes.c_void_p(found[1].ctypes.data), ctypes.c_void_p(code.address))
        wrong = np.flatnonzero(~((found[0] == found[1]) | np.isnan(found).all(axis=0)))
        assert not len(wrong), [(str(nodes[k]), *found[:, k]) for k in wrong]
        assert np.isfinite(found[0]).mean() > 0.5


def test_a_model_gets_its_own_code_once_that_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    native.forget()
    monkeypatch.setattr(native, "known", lambda _: False)
    model = load("reference-a").build()
    first = simulate(model, 0.2)
    (way,) = native._ways.values()
    assert way.own is None
    assert way.code is not None
    work = way._spent
    assert work == pytest.approx(first.steps * way.code.step, rel=0.1)
    monkeypatch.setattr(native, "ENOUGH", 2.5 * work - native.ENOUGH_FOR_EACH * way.code.step)
    simulate(model, 0.2)
    assert way.own is None
    again = simulate(model, 0.2)
    assert way.own is not None
    assert np.array_equal(first.values, again.values)
    native.forget()


def test_a_large_model_or_one_with_many_directions_gets_it_at_once() -> None:
    model = load("reference-a", ["link.modes=64"]).build()
    assert len(model.states) > bytecode.MOST
    assert bytecode.simulation_code(model) is None
    small = load("reference-a").build()
    assert bytecode.tangent_code(small, (0,), bytecode.ROOMS[-1] + 1) is None
    assert bytecode.room_for(4) == 7
