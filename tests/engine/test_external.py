"""Python functions at sample instants: equal to the same law written as memories, in both backends."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from engine.assemble import build
from engine.batch import Case, Failure, batch
from engine.block import Block, parameter, signal_in, signal_out
from engine.codegen import model_code
from engine.errors import ParameterError, SimulationError, StructureError
from engine.net import Net
from engine.simulate import Result, simulate
from engine.tangent import tangents
from tests.engine.parts import Body, Count, Dry, Held, Jump, Lag, Push, Wave, system


class Foreign(Block):
    """Two inputs, two outputs, by a Python function."""

    period = parameter("s", 0.01, "period", gt=0, structural=True)
    offset = parameter("s", 0.0, "offset", ge=0, structural=True)
    one = signal_in("*", "first", default=0.0)
    two = signal_in("*", "second", default=0.0)
    sum = signal_out("*", "first answer")
    more = signal_out("*", "second answer")

    def __init__(self, make: Any, identity: str = "", **values: Any) -> None:
        super().__init__(**values)
        self.make, self.identity = make, identity

    def stamp(self, net: Net) -> None:
        clock = net.clock(self.period, self.offset)
        wanted = [("sum_held", "1"), ("more_held", "1")]
        total, more = net.external("function", clock, [self.one, self.two], wanted, self.make, self.identity)
        net.output(self.sum, total)
        net.output(self.more, more)


class Amplifier(Block):
    """A signal of any unit as a torque."""

    value = signal_in("*", "value", name="in")
    out = signal_out("N.m", "torque")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.value)


class Total:
    """Counts like the sampled block `Count`, and remembers when it was called."""

    def __init__(self) -> None:
        self.total = 0.0
        self.instants: list[float] = []

    def __call__(self, t: Any, inputs: Any) -> tuple[Any, Any]:
        self.total += inputs[0]
        self.instants.append(t)
        return self.total, inputs[1]


BACKENDS = ("c", "interpreter")


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_loop_closed_in_python_equals_one_of_memories(backend: Any) -> None:
    """A stick-slip body held by a sampled integrator, in Python on one side and in memories on the other."""

    def plant(controller: Any, given: Any, taken: Any) -> Any:
        return system(
            {
                "c": controller,
                "k": Held(gain=-3.0, period=0.01),
                "a": Amplifier(),
                "t": Push(),
                "m": Body(inertia=0.3),
                "f": Dry(level=0.4),
                "lag": Lag(corner=30.0),
            },
            ("m.shaft.speed", "lag.in"),
            ("lag.out", given),
            (taken, "k.in"),
            ("k.out", "a.in"),
            ("a.out", "t.in"),
            ("t.shaft", "m.shaft", "f.shaft"),
            initial={"m.shaft.speed": 4.0},
        )

    own = simulate(build(plant(Count(period=0.01), "c.in", "c.out")), 2.0, 2e-3, backend="c")
    foreign = simulate(build(plant(Foreign(Total), "c.one", "c.sum")), 2.0, 2e-3, backend=backend)
    assert own.event_count == foreign.event_count > 0
    for name, most in (("m.shaft.speed", 1e-15 if backend == "c" else 1e-12), ("k.out", 1e-12)):
        assert np.abs(foreign[name] - own[name]).max() < most * np.abs(own[name]).max()


@pytest.mark.parametrize("backend", BACKENDS)
def test_order_within_an_instant_is_that_of_the_signals(backend: Any) -> None:
    """A chain memory -> function -> memory -> function has no delay, whatever the order of the blocks."""
    plant = system(
        {
            "last": Foreign(lambda: lambda t, u: (u[0] + 1, u[1]), period=0.02),
            "mid": Held(gain=10.0, period=0.01),
            "first": Foreign(lambda: lambda t, u: (t + u[0], 7.0), period=0.01),
            "ramp": Held(gain=2.0, period=0.01),
            "one": Jump(height=1.0, start=0.0255),
        },
        ("one.out", "ramp.in"),
        ("ramp.out", "first.one"),
        ("first.sum", "mid.in"),
        ("mid.out", "last.one"),
        ("first.more", "last.two"),
    )
    run = simulate(build(plant), 0.06, 5e-3, backend=backend)
    t = np.floor(run.time * 100 + 1e-9) / 100
    first = t + 2.0 * (t >= 0.03)
    np.testing.assert_allclose(run["first.sum"], first, atol=1e-14)
    np.testing.assert_allclose(run["mid.out"], 10 * first, atol=1e-13)
    slow = np.floor(run.time * 50 + 1e-9) / 50
    np.testing.assert_allclose(run["last.sum"], 10 * (slow + 2.0 * (slow >= 0.03)) + 1, atol=1e-13)
    np.testing.assert_allclose(run["last.more"], 7.0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_instants_rates_and_offsets(backend: Any) -> None:
    kept = []

    def make() -> Any:
        kept.append(Total())
        return kept[-1]

    plant = system({"a": Foreign(make, period=0.03, offset=0.005), "b": Foreign(make, period=0.02), "w": Wave()},
                   ("w.out", "a.one", "b.two"))  # fmt: skip
    model = build(plant)
    run = simulate(model, 0.1, 0.01, backend=backend)
    calls = {len(total.instants): total.instants for total in kept}
    np.testing.assert_allclose(calls[4], [0.005, 0.035, 0.065, 0.095], atol=1e-15)
    np.testing.assert_allclose(calls[6], [0, 0.02, 0.04, 0.06, 0.08, 0.1], atol=1e-15)
    assert run["a.sum"][0] == 0.0
    again = simulate(model, 0.1, 0.01, backend=backend)
    assert np.array_equal(again.values, run.values)
    assert len(kept) == 4


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda t, u: 1 / (0.05 - t) * u[3], r"'a.function' failed: IndexError: .*, at t = 0 s"),
        (lambda t, u: (0.0, 0.0, 0.0), r"it returned 3 values, not 2, at t = 0 s"),
        (lambda t, u: (0.0, float("nan") if t > 0.049 else 0.0), r"it returned nan, at t = 0.05 s"),
        (lambda t, u: ("x", 0.0), r"failed: ValueError: could not convert"),
    ],
)
def test_failures_say_which_function_and_when(backend: Any, function: Callable[..., Any], message: str) -> None:
    model = build(system({"a": Foreign(lambda: function)}))
    with pytest.raises(SimulationError, match=message) as caught:
        simulate(model, 0.1, 0.01, backend=backend)
    assert isinstance(caught.value.__cause__, Exception)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_function_that_cannot_be_made_and_an_interruption(backend: Any) -> None:
    with pytest.raises(SimulationError, match=r"'a.function' cannot be started: TypeError"):
        simulate(build(system({"a": Foreign(lambda: len(3))})), 0.1, 0.01, backend=backend)  # type: ignore[arg-type]

    def interrupted(t: Any, u: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(build(system({"a": Foreign(lambda: interrupted)})), 0.1, 0.01, backend=backend)


def test_no_tangents_and_no_export() -> None:
    model = build(system({"a": Foreign(Total), "w": Wave()}, ("w.out", "a.one")))
    assert [external.name for external in model.externals] == ["a.function"]
    with pytest.raises(
        ParameterError, match=r"'a.function' is a Python function or a foreign FMU, which has no derivative"
    ):
        tangents(model, 0.1, 0.01, wrt=["w.amplitude"])
    with pytest.raises(NotImplementedError, match=r"'a.function' is a Python function"):
        model_code(model)


def test_a_loop_of_functions_without_delay_is_refused() -> None:
    plant = system({"a": Foreign(Total), "b": Foreign(Total)}, ("a.sum", "b.one"), ("b.more", "a.two"))
    with pytest.raises(StructureError, match="algebraic loop"):
        build(plant)


def test_stored_results_know_the_function() -> None:
    def signature(identity: Any) -> Any:
        return build(system({"a": Foreign(Total, identity)})).signature

    assert signature("v1") == signature("v1")
    assert signature("v1") != signature("v2")


def test_batch_makes_a_function_for_each_run() -> None:
    threads = set()

    class Noted(Total):
        def __call__(self, t: Any, inputs: Any) -> Any:
            threads.add(threading.get_ident())
            if inputs[0] > 4.9 and t > 0.5:
                raise ValueError("too much")
            return super().__call__(t, inputs)

    model = build(system({"a": Foreign(Noted), "j": Jump(start=0.005)}, ("j.out", "a.one")))
    cases = [Case({"j.height": height}) for height in (1.0, 2.0, 3.0, 4.0, 5.0)]
    done = list(batch(model, cases, 1.0, 0.01, workers=2))
    assert [round(run["a.sum"][-1]) for run in done if isinstance(run, Result)] == [100, 200, 300, 400]
    assert isinstance(done[4], Failure)
    assert "too much" in done[4].reason
