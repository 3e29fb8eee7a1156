"""Byte code and its machine code: the numbers of compiled code to the bit, for every operation and for whole runs."""

from __future__ import annotations

import ctypes
import math
import platform
import subprocess
import sys
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
    """Calls a function with byte code alone, with its machine code alone, and with the model's own code alone."""

    def each(run: Any) -> list[Any]:
        made = []
        for enough, machine in ((math.inf, False), (math.inf, True), (-math.inf, True)):
            native.forget()
            monkeypatch.setattr(native, "ENOUGH", enough)
            monkeypatch.setattr(native, "LOOK", math.inf)
            monkeypatch.setattr(native, "MACHINE_CODE", machine)
            made.append(run())
            assert all((way.own is None) == (enough > 0) for way in native._ways.values())
        native.forget()
        return made

    return each


TRANSLATED = platform.machine() in ("x86_64", "AMD64") and sys.platform != "win32"


def _same(one: Any, other: Any) -> None:
    assert one.events == other.events
    assert one.steps == other.steps
    for name in ("values", "states", "modes", "final_state", "final_memory", "final_modes"):
        a, b = getattr(one, name), getattr(other, name)
        assert a is b is None or np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes(), name


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_run_of_a_scenario_is_the_same_to_the_bit(name: str, ways: Any) -> None:
    model = load(name).build()
    first, *others = ways(lambda: simulate(model, 1.5, 1e-3, record_states=True))
    for other in others:
        _same(first, other)


@pytest.mark.parametrize("name", SCENARIOS)
def test_its_tangents_are_too(name: str, ways: Any) -> None:
    model = load(name).build()
    names = [p.name for p in model.parameters][::2][:6]
    states = [state.name for state in model.states][:2] if not model.initial else []
    for wrt in (names[:2], [*names, *states]):
        one, *others = ways(lambda wrt=wrt: tangents(model, 0.5, 1e-3, wrt=wrt))
        for other in others:
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
    for hold in ("linear", "zero_order"):
        drive = Drive(time, np.sin(20 * time)[:, None], hold)
        first, *others = ways(lambda drive=drive: simulate(model, 1.0, 1e-3, drive=drive, record_states=True))
        for other in others:
            _same(first, other)
        one, *others = ways(lambda drive=drive: tangents(model, 1.0, 1e-3, wrt=["g.gain", "b.start"], drive=drive))
        assert all(np.array_equal(one.values, other.values) for other in others)
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

#if FA_WIDTH == 4
__attribute__((visibility("default"))) void four(const double *x, const double *m, const double *p, double *r,
                                                 const fa_code *code) {
  const fa_program *program = &code->program[FA_DERIVATIVE];
  fa_lane wide[4096], found[program->count];
  FA_EACH_LANE(l) {
    const struct { const fa_code *code; double *file; } made = {code, (double[4096]){0}}, *s = &made;
    fa_filled(code, made.file);
    fa_prepare_parameters(p + 2 * l, 0);
    fa_prepare_modes(m + 2 * l, 0, 0, 0);
    for (int64_t k = 0; k < code->registers; k++) wide[k][l] = made.file[k];
    wide[0][l] = p[2 * l + 1] * x[2 * l + 1];
    for (int i = 0; i < 2; i++) wide[FA_X + i][l] = x[2 * l + i];
  }
  program->lanes(wide, 0, 0, found, fa_bits);
  for (int64_t k = 0; k < program->count; k++) FA_EACH_LANE(l) r[l * program->count + k] = found[k][l];
}
#endif
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
        within = ca.if_else(m[1] > 0, ca.sin(made * x[1]) + x[0], 0)
        nodes += [ca.if_else(m[0] > 0, ca.cos(within) + made, 0), ca.if_else(m[0] > 0, ca.sin(within) * made, 0)]
    emitter.add("derivative", [t, x, u, d, m, p, fire], ca.vertcat(*nodes))
    code = bytecode.Code()
    code.struct.nx, code.struct.np, code.struct.nf = 2, 2, 2
    assert bytecode._programs(code, emitter)
    own = library(INCLUDES + runtime("functions.c") + emitter.text() + _WRAPPED)
    source = bytecode.source()
    general = library(source[: source.index(runtime("core.c"))] + _INTERPRETED)
    random = np.random.default_rng(0)
    special = np.array([0.0, -0.0, 1.0, math.nan, math.inf, -math.inf])
    cases = [
        *([random.normal(0, 2, 2), random.integers(-1, 2, 2).astype(float), random.normal(0, 2, 2)] for _ in range(52)),
        *([random.choice(special, 2) for _ in range(3)] for _ in range(200)),
    ]
    found = np.zeros((4, len(cases), len(nodes)))
    for way in (0, 1, 2):
        if way == 2:
            code.translate(library(source))
            assert (code.struct.program[2].machine is not None) == TRANSLATED
            assert (code.struct.program[2].lanes is not None) == hasattr(general, "four")
        for case, given in enumerate(cases):
            arrays = [array.ctypes.data_as(ctypes.c_void_p) for array in given]
            result = ctypes.c_void_p(found[way, case].ctypes.data)
            if way:
                general.both(*arrays, result, ctypes.c_void_p(code.address))
            else:
                own.both(*arrays, result)
    found[3] = found[2]
    if code.struct.program[2].lanes is not None:
        found[3] = 0
        for case in range(0, len(cases), 4):
            together = [*(np.array([given[k] for given in cases[case : case + 4]]) for k in range(3)), found[3, case:]]
            pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in together]
            general.four(*pointers, ctypes.c_void_p(code.address))
    bits = np.where(np.isnan(found), math.nan, found).view(np.uint64)
    wrong = np.argwhere((bits != bits[0]).any(axis=0))
    assert not len(wrong), [(str(nodes[k]), cases[c], *found[:, c, k]) for c, k in wrong[:9]]
    assert np.isfinite(found[0, :52]).mean() > 0.5


@pytest.mark.parametrize(("tests", "translated"), [(5, True), (80, False)])
def test_more_tests_within_one_another_than_there_is_room_for_leave_byte_code(tests: int, translated: bool) -> None:
    x, p = ca.SX.sym("x", 1), ca.SX.sym("p", tests)
    value = ca.sin(x[0])
    for k in range(tests):
        value = ca.if_else(p[k] > 0, ca.sin(value) + k, 0)
    emitter, code = Emitter(), bytecode.Code()
    emitter.add("derivative", [ca.SX.sym("t"), x, ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1), p, ca.SX(0, 1)], value)
    nodes, results = emitter.plan().state["derivative"], emitter.functions["derivative"]
    assert max(len(conditions) for conditions, _ in emitter.groups(nodes, results)) == tests
    code.struct.nx, code.struct.np = 1, tests
    assert bytecode._programs(code, emitter)
    code.translate(library(bytecode.source()))
    assert (code.struct.program[2].machine is not None) == (TRANSLATED and translated)


_REFUSED = """
import ctypes, sys
DENY, NO_GAIN = 65, 1  # PR_SET_MDWE of Linux 6.3: what was writable is never executable
if ctypes.CDLL(None).prctl(DENY, NO_GAIN, 0, 0, 0):
    sys.exit(77)
from engine import native
from engine.simulate import simulate
from scenarios.load import load
result = simulate(load("reference-b").build(), 0.2)
(way,) = native._ways.values()
machine = [program.machine for program in way.code.struct.program]
print(way.own is None, machine == [None] * len(machine), result.values.tobytes().hex())
"""


def test_where_memory_may_not_be_made_executable_byte_code_stays() -> None:
    expected = simulate(load("reference-b").build(), 0.2).values.tobytes().hex()
    child = subprocess.run([sys.executable, "-c", _REFUSED], capture_output=True, text=True, check=False)
    if sys.platform != "linux" or child.returncode == 77:
        pytest.skip("this system cannot refuse it")
    assert child.returncode == 0, child.stderr
    assert child.stdout.split() == ["True", "True", expected]


def test_a_model_gets_its_own_code_once_that_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    native.forget()
    monkeypatch.setattr(native, "known", lambda _: False)
    model = load("reference-a").build()
    first = simulate(model, 0.2)
    (way,) = native._ways.values()
    assert way.own is None
    assert way.code is not None
    work = way._lost
    assert work == pytest.approx(first.steps * way.code.step * way.code.slower, rel=0.1)
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
    assert bytecode.room_for(5) == 8
