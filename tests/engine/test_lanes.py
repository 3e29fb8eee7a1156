"""Runs in lanes, compiled and of byte code, are single runs to the bit, with all that may happen; and no lanes."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np
import pytest

from blocks.controllers.delay import Delay
from blocks.controllers.gain import Gain
from blocks.sources.sine import Sine
from engine import lanes, native
from engine.assemble import build
from engine.batch import Case, Failure, batch
from engine.codegen import INCLUDES, Emitter, lanes_source, runtime
from engine.compile import library
from engine.errors import ParameterError, SimulationError
from engine.lanes import alike, lanes_of
from engine.model import Model
from engine.native import Job, Outcome
from engine.operations import BINARY, UNARY
from engine.simulate import Drive, Result, carried_out_together, prepare, simulate
from engine.system import Connection, System
from scenarios.load import load
from tests.engine.parts import Body, Dry, Push, system

QUICK = ["reference-b", "srv02-tracking", "bouc-wen", "ball-screw-axis"]
SLOW = ["reference-a", "reference-c", "belt-axis", "robot-servo", "emps", "friction-damper", "two-link-flexible"]
SCENARIOS = [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]


@pytest.fixture
def in_lanes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Makes the code of a model's lanes, so many wide, or for the processor at hand; that code is gone afterwards."""

    def make(model: Model, width: int | None = None) -> int:
        head = "" if width is None else f"#define FA_WIDTH {width}\n"
        monkeypatch.setattr(lanes, "lanes_source", lambda model: head + lanes_source(model))
        lanes.forget()
        lanes_of(model).make(model)
        return lanes_of(model).width

    yield make
    lanes.forget()


def same(one: Result, other: Result | Failure) -> None:
    assert isinstance(other, Result), other
    assert one.events == other.events
    for name in ("steps", "event_count", "internal_step", "backend", "parameters"):
        assert getattr(one, name) == getattr(other, name), name
    for name in ("time", "values", "final_state", "final_memory", "final_modes"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def compare(model: Model, cases: list[Case], stop: float, step: float, **settings: Any) -> list[Result]:
    found = list(batch(model, cases, stop, step, workers=2, log_capacity=100_000, **settings))
    expected = [
        simulate(model, stop, step, parameters=c.parameters, drive=c.drive, initial=c.initial, **settings)
        for c in cases
    ]
    assert len(found) == len(expected)
    for one, other in zip(expected, found, strict=True):
        same(one, other)
    return expected


def varied(model: Model, count: int) -> list[Case]:
    """Cases in each of which three parameters are less than the model's by up to five per cent."""
    random = np.random.default_rng(1)
    usable = [p for p in model.parameters if p.value and p.declared.le != p.value != p.declared.ge][:40]
    cases = []
    for _ in range(count):
        chosen = random.choice(len(usable), 3, replace=False)
        cases.append(Case({usable[k].name: usable[k].value * random.uniform(0.95, 1.0) for k in chosen}))
    return cases


@pytest.mark.parametrize("width", [4, 8])
def test_runs_that_stick_and_slip_under_drives(width: int, in_lanes: Any) -> None:
    plant = system({"t": Push(), "m": Body(inertia=2.0), "f": Dry(level=3.0)}, ("t.shaft", "m.shaft", "f.shaft"))
    model = build(plant, inputs=["t.in"], outputs=["m.shaft.angle", "m.shaft.speed"])
    assert in_lanes(model, width) == width
    time = np.arange(0.0, 2.0, 0.013)
    for hold in ("zero_order", "linear"):
        cases = [
            Case(
                {"f.level": 3.0 + 0.05 * k, "m.inertia": 1.0 + 0.01 * k},
                Drive(time, (4.0 + 0.3 * k) * np.sin(9 * time + k)[:, None], hold),
                {"m.shaft.speed": 0.1 * k},
            )
            for k in range(21)
        ]
        results = compare(model, cases, 2.0, 1e-2)
        assert min(result.event_count for result in results) > 8
        assert len({result.event_count for result in results}) > 1


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios(name: str, in_lanes: Any) -> None:
    model = load(name).build()
    in_lanes(model)
    compare(model, varied(model, 16), 0.6, 1e-3)


def test_a_long_run_with_many_switches(in_lanes: Any) -> None:
    model = load("reference-b").build()
    in_lanes(model)
    cases = [Case({"motor.resistance": float(value)}) for value in np.linspace(2.2, 3.0, 8)]
    assert min(result.event_count for result in compare(model, cases, 10.0, 1e-3)) > 50


def test_a_large_model_whose_code_has_loops(in_lanes: Any) -> None:
    model = load("reference-a", ["link.modes=64"]).build()
    in_lanes(model)
    compare(model, varied(model, 8), 0.05, 1e-3)


def test_delay_lines(in_lanes: Any) -> None:
    blocks = {
        "s": Sine(amplitude=2.0, frequency="3 Hz"),
        "g": Gain(gain=1.5),
        "b": Delay(delay="70 ms", period="10 ms"),
    }
    wires = [Connection(("s.out", "g.in")), Connection(("g.out", "b.in"))]
    model = build(System(blocks, wires, name="line"), ["g.in"])
    in_lanes(model)
    time = np.arange(0.0, 1.0, 0.013)
    compare(model, [Case({"g.gain": 1.0 + k}, Drive(time, np.sin(time + k)[:, None])) for k in range(8)], 1.0, 1e-3)


def test_other_steps_knots_and_stops_are_not_done_together(in_lanes: Any) -> None:
    plant = system({"t": Push(), "m": Body(inertia=2.0), "f": Dry(level=3.0)}, ("t.shaft", "m.shaft", "f.shaft"))
    model = build(plant, inputs=["t.in"], outputs=["m.shaft.angle"])
    width = in_lanes(model, 8)
    drives = [Drive([0.0, 0.1 + 0.1 * (k % 2)], [[5.0 + k], [0.0]]) for k in range(16)]
    jobs = [prepare(model, 1.0, 1e-2, drive=drive) for drive in drives[:width]]
    assert alike(jobs[0]) == alike(jobs[2]) != alike(jobs[1])
    assert lanes_of(model).groups(jobs) == [[0, 2, 4, 6], [1, 3, 5, 7]]
    assert lanes_of(model).groups(jobs[:6]) == [[place] for place in (0, 2, 4, 1, 3, 5)]
    compare(model, [Case(drive=drive) for drive in drives], 1.0, 1e-2)


def test_a_run_that_fails_leaves_the_others_as_they_are(in_lanes: Any) -> None:
    plant = system({"t": Push(), "m": Body(inertia=2.0), "f": Dry(level=3.0)}, ("t.shaft", "m.shaft", "f.shaft"))
    model = build(plant, inputs=["t.in"], outputs=["m.shaft.angle", "m.shaft.speed"])
    in_lanes(model)
    speeds = [1.0, 1e308, 2.0, 3.0, 1e307, 4.0, 5.0, 6.0]
    cases = [Case(initial={"m.shaft.speed": speed}) for speed in speeds]
    found = list(batch(model, cases, 1000.0, 100.0, workers=1))
    lanes.forget()
    alone = list(batch(model, cases, 1000.0, 100.0, workers=1))
    assert [isinstance(result, Failure) for result in found] == [speed > 1e300 for speed in speeds]
    for one, other in zip(alone, found, strict=True):
        if isinstance(one, Failure):
            assert one == other
        else:
            same(one, other)


def test_runs_are_cancelled(in_lanes: Any) -> None:
    model = load("reference-b").build()
    in_lanes(model)
    flag = ctypes.c_int32(1)
    jobs = [prepare(model, 1.0, 1e-3, parameters={"motor.resistance": 2.0 + 0.1 * k}) for k in range(4)]
    for job in jobs:
        job.cancel = flag
    assert [outcome.status for outcome in lanes_of(model).run(model, jobs)] == [native.CANCELLED] * 4


def test_a_processor_without_such_vectors_does_runs_one_by_one(in_lanes: Any) -> None:
    model = load("reference-b").build()
    assert in_lanes(model, 1) == 1
    cases = varied(model, 9)
    assert lanes_of(model).groups([prepare(model, 0.1, 1e-3) for _ in cases]) == [[k] for k in range(9)]
    compare(model, cases, 0.1, 1e-3)


def test_values_that_do_not_fit_end_a_batch_after_the_results_before(in_lanes: Any) -> None:
    model = load("reference-b").build()
    in_lanes(model)
    cases = [*varied(model, 3), Case({"motor.resistence": 1.0}), *varied(model, 12)]
    found = batch(model, cases, 0.1, 1e-3, workers=2)
    assert [isinstance(next(found), Result) for _ in range(3)] == [True] * 3
    with pytest.raises(ParameterError, match="resistence"):
        next(found)


def test_lanes_come_once_they_pay(monkeypatch: pytest.MonkeyPatch) -> None:
    lanes.forget()
    monkeypatch.setattr(lanes, "known", lambda _: False)
    model = load("reference-a").build()
    expected = [values.values.tobytes() for values in batch(model, [Case()], 0.2) if isinstance(values, Result)]
    assert lanes_of(model).width == 1
    lost = lanes_of(model)._lost
    assert lost > 0
    monkeypatch.setattr(native, "ENOUGH_FOR_EACH", 0.0)
    monkeypatch.setattr(native, "ENOUGH", 2.5 * lost / lanes.DEARER)
    found = [values.values.tobytes() for values in batch(model, [Case()] * 40, 0.2) if isinstance(values, Result)]
    assert found == expected * 40
    assert not lanes_of(model)._possible
    lanes.forget()


@pytest.fixture
def byte_code(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Models stay byte code."""
    native.forget()
    monkeypatch.setattr(native, "ENOUGH", math.inf)
    monkeypatch.setattr(native, "LOOK", math.inf)
    yield
    native.forget()


def outcomes(model: Model, jobs: list[Job]) -> list[Outcome]:
    """Of runs together, of every number of lanes; held against those of single runs."""
    expected = [native.run(model, job) for job in jobs]
    (group,) = lanes.groups(model, jobs)
    assert group == list(range(len(jobs)))
    for count in range(2, len(jobs) + 1):
        found = lanes.run_together(model, jobs[:count])
        assert len(found) == count
        for one, other in zip(expected, found, strict=False):
            for name in ("steps", "events", "row", "status", "culprit", "t1"):
                assert getattr(one, name) == getattr(other, name), name
            for name in ("x1", "d1", "m1", "log"):
                assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
            assert one.y[: one.row].tobytes() == other.y[: one.row].tobytes()
    return expected


def together() -> Model:
    model = load("reference-b").build()
    code = native.way_of(model).code
    if code is None or not code.in_lanes:
        pytest.skip("this processor has no vectors for that")
    return model


def sliding() -> Model:
    together()
    plant = system({"t": Push(), "m": Body(inertia=2.0), "f": Dry(level=3.0)}, ("t.shaft", "m.shaft", "f.shaft"))
    return build(plant, inputs=["t.in"], outputs=["m.shaft.angle", "m.shaft.speed"])


@pytest.mark.usefixtures("byte_code")
@pytest.mark.parametrize("hold", ["zero_order", "linear"])
def test_byte_code_sticks_and_slips_under_drives(hold: str) -> None:
    model, time = sliding(), np.arange(0.0, 2.0, 0.013)
    jobs = [
        prepare(
            model,
            2.0,
            1e-2,
            parameters={"f.level": 3.0 + 0.05 * k, "m.inertia": 1.0 + 0.01 * k},
            drive=Drive(time, (4.0 * (k != 1) + 0.3 * k) * np.sin(9 * time + k)[:, None], hold),
            initial={"m.shaft.speed": 0.1 * k},
        )
        for k in range(4)
    ]
    assert len({outcome.events for outcome in outcomes(model, jobs)}) > 2


@pytest.mark.usefixtures("byte_code")
@pytest.mark.parametrize("name", SCENARIOS)
def test_byte_code_of_scenarios(name: str) -> None:
    together()
    model = load(name).build()
    jobs = [prepare(model, 0.6, 1e-3, parameters=c.parameters, internal_step=7e-4) for c in varied(model, 4)]
    outcomes(model, jobs)


@pytest.mark.usefixtures("byte_code")
def test_byte_code_with_delay_lines() -> None:
    together()
    blocks = {
        "s": Sine(amplitude=2.0, frequency="3 Hz"),
        "g": Gain(gain=1.5),
        "b": Delay(delay="70 ms", period="10 ms"),
    }
    wires = [Connection(("s.out", "g.in")), Connection(("g.out", "b.in"))]
    model = build(System(blocks, wires, name="line"), ["g.in"])
    time = np.arange(0.0, 1.0, 0.013)
    drives = [Drive(time, np.sin(time + k)[:, None]) for k in range(4)]
    outcomes(model, [prepare(model, 1.0, 1e-3, parameters={"g.gain": 1.0 + k}, drive=d) for k, d in enumerate(drives)])


@pytest.mark.usefixtures("byte_code")
def test_byte_code_that_fails_in_a_lane_leaves_the_others_as_they_are() -> None:
    model = sliding()
    jobs = [prepare(model, 1000.0, 100.0, initial={"m.shaft.speed": speed}) for speed in (1.0, 1e308, 2.0, 1e307)]
    failed = [outcome.status != native.OK for outcome in outcomes(model, jobs)]
    assert failed == [False, True, False, True]
    found = carried_out_together(model, jobs)
    assert [isinstance(one, SimulationError) for one in found] == failed


@pytest.mark.usefixtures("byte_code")
def test_byte_code_in_lanes_is_cancelled() -> None:
    model, flag = together(), ctypes.c_int32(1)
    jobs = [prepare(model, 1.0, 1e-3, parameters={"motor.resistance": 2.0 + 0.1 * k}) for k in range(4)]
    native.cancelled_by(flag)
    try:
        with pytest.raises(KeyboardInterrupt):
            lanes.run_together(model, jobs)
    finally:
        native.cancelled_by(None)
    for job in jobs:
        job.cancel = flag
    assert [outcome.status for outcome in lanes.run_together(model, jobs)] == [native.CANCELLED] * 4


@pytest.mark.usefixtures("byte_code")
def test_byte_code_is_grouped_by_what_runs_share() -> None:
    model = sliding()
    drives = [Drive([0.0, 0.1 + 0.1 * (k % 2)], [[5.0 + k], [0.0]]) for k in range(12)]
    jobs = [prepare(model, 1.0, 1e-2, drive=drive) for drive in drives]
    assert lanes.groups(model, jobs) == [[0, 2, 4, 6], [8, 10], [1, 3, 5, 7], [9, 11]]
    jobs[0].record_states = jobs[2].record_states = True
    assert lanes.groups(model, jobs[:6]) == [[0], [2], [1, 3, 5], [4]]


@pytest.mark.usefixtures("byte_code")
def test_byte_code_without_machine_code_has_no_lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "MACHINE_CODE", False)
    model = load("reference-b").build()
    jobs = [prepare(model, 0.1, 1e-3) for _ in range(4)]
    assert lanes.groups(model, jobs) == [[k] for k in range(4)]
    alone = native.run(model, jobs[0])
    assert all(one.y.tobytes() == alone.y.tobytes() for k in range(4) for one in lanes.run_together(model, [jobs[k]]))


@pytest.mark.usefixtures("byte_code")
def test_where_most_is_done_alone_a_model_s_own_code_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    model, time = sliding(), np.arange(0.0, 2.0, 0.013)
    quiet = [prepare(model, 2.0, 1e-2, drive=Drive(time, 0 * time[:, None])) for _ in range(4)]
    busy = [prepare(model, 2.0, 1e-2, drive=Drive(time, 9 * np.sin(90 * time + k)[:, None])) for k in range(4)]
    way = native.way_of(model)
    lanes.run_together(model, quiet)
    assert way._lost == 0
    first = lanes.run_together(model, busy)
    assert way.alone > 0.3
    lanes.run_together(model, busy)
    assert way._lost > 0
    assert way.own is None
    monkeypatch.setattr(native, "ENOUGH", -math.inf)
    own = lanes.run_together(model, busy)
    assert way.own is not None
    assert [one.y.tobytes() for one in own] == [one.y.tobytes() for one in first]
    lanes.run_together(model, quiet)
    assert way.alone == 0


_WRAPPED = """
__attribute__((visibility("default"))) void both(const double *x, const double *m, const double *p, double *r) {
  double cp[FA_NCP + 1], cm[FA_NCM + 1];
  fa_lane ms[2], ps[2], cps[FA_NCP + 1], cms[FA_NCM + 1];
  for (int l = 0; l < FA_WIDTH; l++) {
    fa_prepare_parameters(p + 2 * l, cp);
    fa_prepare_modes(m + 2 * l, p + 2 * l, cp, cm);
    fa_derivative(p[2 * l + 1] * x[2 * l + 1], x + 2 * l, 0, 0, m + 2 * l, p + 2 * l, cp, cm, 0, r + SIZE * l);
    for (int i = 0; i < 2; i++) ms[i][l] = m[2 * l + i], ps[i][l] = p[2 * l + i];
    for (int i = 0; i < FA_NCP; i++) cps[i][l] = cp[i];
    for (int i = 0; i < FA_NCM; i++) cms[i][l] = cm[i];
  }
  static fa_lane xs[2], rs[SIZE];
  for (int l = 0; l < FA_WIDTH; l++) for (int i = 0; i < 2; i++) xs[i][l] = x[2 * l + i];
  fa_derivative_lanes(ps[1] * xs[1], xs, 0, 0, ms, ps, cps, cms, 0, rs);
  for (int l = 0; l < FA_WIDTH; l++) for (int i = 0; i < SIZE; i++) r[SIZE * (FA_WIDTH + l) + i] = rs[i][l];
}
"""


@pytest.mark.parametrize("width", [4, 8])
def test_every_operation_is_the_same_to_the_bit(width: int) -> None:
    t, u, d = ca.SX.sym("t"), ca.SX(0, 1), ca.SX(0, 1)
    x, m, p, fire = ca.SX.sym("x", 2), ca.SX.sym("m", 2), ca.SX.sym("p", 2), ca.SX(0, 1)
    emitter = Emitter()
    numbers = [(x[0], ca.SX(value)) for value in (0.7, 2.0, -0.0, 0.5)]
    pairs = [(x[0], x[1]), (x[0], p[0]), (p[1], p[0]), (x[1], m[0]), (m[1], p[0]), (t, x[1]), *numbers]
    pairs.append((ca.SX(2.0), x[1]))
    nodes = []
    for operation in (*UNARY, *BINARY):
        for a, b in pairs:
            made = ca.SX.unary(operation, a) if operation in UNARY else ca.SX.binary(operation, a, b)
            nodes += [made, ca.if_else(m[0] != 0, made * x[0], 0), ca.if_else(m[1] * p[0] > 0, made + a, a)]
    emitter.add("derivative", [t, x, u, d, m, p, fire], ca.vertcat(*nodes))
    head = f"#define FA_WIDTH {width}\n#define SIZE {len(nodes)}\n{INCLUDES}"
    head += runtime("functions.c") + runtime("vectors.c")
    own = library(head + emitter.text(["derivative"]) + _WRAPPED)
    random = np.random.default_rng(0)
    special = np.array([0.0, -0.0, 1.0, math.nan, math.inf, -math.inf])
    ordinary = [[random.normal(0, 2, 2), random.integers(-1, 2, 2), random.normal(0, 2, 2)] for _ in range(50 * width)]
    cases = np.array([*ordinary, *([random.choice(special, 2) for _ in range(3)] for _ in range(100 * width))])
    assert len(cases) % width == 0
    share = []
    for first in range(0, len(cases), width):
        given = [np.ascontiguousarray(cases[first : first + width, k], dtype=float) for k in range(3)]
        found = np.zeros((2, width, len(nodes)))
        own.both(*(array.ctypes.data_as(ctypes.c_void_p) for array in (*given, found)))
        bits = np.where(np.isnan(found), math.nan, found).view(np.uint64)
        wrong = np.argwhere(bits[0] != bits[1])
        assert not len(wrong), [(str(nodes[k]), cases[first + lane], *found[:, lane, k]) for lane, k in wrong[:9]]
        share.append(np.isfinite(found).mean())
    assert np.mean(share[:50]) > 0.5
