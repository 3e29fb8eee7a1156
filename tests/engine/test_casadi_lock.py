"""Symbols are worked with by one thread at a time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi as ca
import pytest

from engine.assemble import build
from engine.casadi_lock import one_at_a_time, symbolic_property
from engine.linearise import linearise
from engine.system import System
from engine.tangent import tangents
from tests.engine.parts import Body, Dry, Jump, Push, system

WORKERS = 4


@pytest.fixture
def crowd(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many threads are in a function of CasADi, at each call of one; each call takes a while."""
    inside: set[int] = set()
    met: list[int] = []

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            here = threading.get_ident()
            outermost = here not in inside
            inside.add(here)
            met.append(len(inside))
            time.sleep(1e-3)  # other threads go on meanwhile, as they do in CasADi itself
            try:
                return function(*args, **options)
            finally:
                if outermost:
                    inside.discard(here)

        return call

    for name in ("Function", "jacobian", "substitute", "vertcat", "densify", "depends_on", "which_depends"):
        monkeypatch.setattr(ca, name, watched(getattr(ca, name)))
    return met


def rotor(k: int) -> System:
    return system(
        {"j": Jump(height=1.0, start=0.0), "t": Push(), "m": Body(inertia=2.0 + k), "f": Dry(level=0.1 + k / 10)},
        ("j.out", "t.in"),
        ("t.shaft", "m.shaft", "f.shaft"),
    )


def test_models_are_built_run_and_linearised_by_threads_that_wait_for_one_another(crowd: list[int]) -> None:
    def work(k: int) -> float:
        model = build(rotor(k), outputs=["m.shaft.speed"], variant=k % 2 == 0)
        slope = tangents(model, 0.01, wrt=["m.inertia"]).of("m.shaft.speed", "m.inertia")
        assert linearise(model, at={"m.shaft.speed": 1.0}, modes={"f": "sliding forward"}).A.shape == (2, 2)
        return float(slope[-1])

    with ThreadPoolExecutor(WORKERS) as pool:
        found = list(pool.map(work, range(2 * WORKERS)))
    assert len(crowd) > 100 * WORKERS
    assert max(crowd) == 1
    # Speed from rest: w = (1 - Mc) t / J with J = 2 + k and Mc = (1 + k) / 10.
    for k, slope in enumerate(found):
        assert slope == pytest.approx(-(0.9 - k / 10) * 0.01 / (2.0 + k) ** 2, rel=1e-6)


class Shape:
    """Something with a property that takes the lock again, and may be long about it."""

    def __init__(self, wait: Callable[[], object]) -> None:
        self.wait = wait
        self.times = 0

    @symbolic_property
    def area(self) -> int:
        """What is made of symbols."""
        self.wait()
        one_at_a_time(lambda: None)()
        self.times += 1
        return 7


def test_a_property_is_worked_out_once_and_described() -> None:
    shape = Shape(lambda: None)
    assert (shape.area, shape.area, shape.times) == (7, 7, 1)
    assert Shape.area.__doc__ == "What is made of symbols."


def test_a_property_and_a_function_do_not_wait_for_each_other_for_ever() -> None:
    """As they do with `functools.cached_property` of Python 3.11, whose lock is taken before this one."""
    begun, inside = threading.Event(), threading.Event()

    def wait() -> None:
        begun.set()
        inside.wait(0.2)

    one, other = Shape(wait), Shape(lambda: None)

    @one_at_a_time
    def function() -> None:
        inside.set()
        assert other.area == 7

    def later() -> None:
        begun.wait()
        function()

    threads = [threading.Thread(target=work, daemon=True) for work in (lambda: one.area, later)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert not any(thread.is_alive() for thread in threads)
    assert (one.times, other.times) == (1, 1)
