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
        model = build(rotor(k), outputs=["m.shaft.speed"])
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
