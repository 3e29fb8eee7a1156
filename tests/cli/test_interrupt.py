"""Ctrl-C that Python drops is heard all the same."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable

import pytest

from engine.errors import FlexarmError
from engine.model import Model
from engine.simulate import simulate
from engine.tangent import tangents
from engine.threads import Threads
from flexarm.console.interrupt import heard
from scenarios.load import load

LONG = """\
schema: 1
name: long
blocks:
  source: {type: Sine, amplitude: 1 V, frequency: 3 Hz}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7}
connect:
  - [source.out, motor.voltage]
simulate: {stop: 1500 s, step: 500 s, internal_step: 2e-6 s, record: [motor.shaft.speed]}
"""


class Dropped:
    """Its destructor is interrupted; what is raised there is only printed."""

    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):
            pass


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_in_a_destructor_is_not_lost() -> None:
    before = signal.getsignal(signal.SIGINT)
    with heard() as check:
        check()
        one = Dropped()
        del one  # raises nothing here
        with pytest.raises(KeyboardInterrupt):
            check()
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_elsewhere_is_raised_at_once() -> None:
    with heard(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_command_that_ignores_interrupts_goes_on_ignoring_them() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with heard() as check:
            os.kill(os.getpid(), signal.SIGINT)
            check()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_thread_is_left_alone() -> None:
    seen = []

    def work() -> None:
        with heard() as check:
            check()
            seen.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [True]


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """A model compiled for runs of 750 million steps, minutes long, between whose three rows nothing is recorded."""
    path = tmp_path_factory.mktemp("long") / "long.yaml"
    path.write_text(LONG)
    model = load(path).build()
    simulate(model, 1e-3, 1e-3)
    tangents(model, 1e-3, 1e-3, wrt=["motor.resistance"])
    return model


def _run(model: Model) -> None:
    simulate(model, 1500.0, 500.0, internal_step=2e-6)


def _tangents(model: Model) -> None:
    tangents(model, 1500.0, 500.0, internal_step=2e-6, wrt=["motor.resistance"])


def _pool(model: Model) -> None:
    with Threads(2) as pool:
        list(pool.map(_run, [model] * 4))


def _nested(model: Model) -> None:
    with Threads(1) as pool:
        pool.submit(_pool, model).result()


@pytest.mark.parametrize("work", [_run, _tangents, _pool, _nested])
def test_an_interrupt_is_heard_while_c_runs(long: Model, work: Callable[[Model], None]) -> None:
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        work(long)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("flexarm")]


def test_an_error_in_one_thread_leaves_the_others_alone(long: Model) -> None:
    def fail(k: int) -> float:
        if k == 0:
            raise FlexarmError("no")
        return float(simulate(long, 0.05, 1e-3, internal_step=1e-6).values[-1, 0])

    with Threads(2) as outer:
        done = outer.submit(fail, 1)
        with pytest.raises(FlexarmError), Threads(1) as pool:
            pool.submit(fail, 0).result()
        assert done.result() == fail(2)
