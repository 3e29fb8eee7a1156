"""Batches: order, determinism, bounded work in flight, failures in place, interruption and resumption."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from engine.assemble import build
from engine.batch import Case, Failure, batch
from engine.simulate import Drive, Result, simulate
from tests.engine.parts import Body, Dry, Push, system


@pytest.fixture(scope="module")
def model() -> Any:
    plant = system({"t": Push(), "m": Body(inertia=2.0), "f": Dry(level=3.0)}, ("t.shaft", "m.shaft", "f.shaft"))
    return build(plant, inputs=["t.in"], outputs=["m.shaft.angle"])


def cases(n: int = 40) -> Iterator[Case]:
    for i in range(n):
        yield Case({"f.level": 1.0 + 0.1 * i}, Drive([0.0, 0.1], [[5.0 + i], [0.0]]), {"m.shaft.speed": 0.1 * i})


def values(found: Result | Failure) -> bytes:
    assert isinstance(found, Result)
    return found.values.tobytes()


def test_results_come_in_order_and_do_not_depend_on_the_number_of_threads(model: Any) -> None:
    runs = {n: [values(r) for r in batch(model, cases(), 1.0, 1e-2, workers=n)] for n in (1, 2, 7)}
    assert runs[1] == runs[2] == runs[7]
    alone = [simulate(model, 1.0, 1e-2, parameters=c.parameters, drive=c.drive, initial=c.initial) for c in cases()]
    assert runs[1] == [r.values.tobytes() for r in alone]


def test_cases_are_read_as_needed(model: Any) -> None:
    read: list[int] = []

    def many() -> Iterator[Case]:
        for i in range(10_000):
            read.append(i)
            yield Case()

    stream = batch(model, many(), 0.1, 1e-2, workers=2)
    for _ in range(5):
        next(stream)
    stream.close()
    assert len(read) < 20


def test_a_failing_run_keeps_its_place(model: Any) -> None:
    bad = Case(initial={"m.shaft.speed": 1e308})
    good = Case()
    results = list(batch(model, [good, bad, good], 1000.0, 100.0, workers=2))
    assert [isinstance(r, Failure) for r in results] == [False, True, False]
    reason = results[1].reason if isinstance(results[1], Failure) else ""
    assert "diverged" in reason
    assert "m.shaft" in reason or "t.shaft" in reason


def test_progress_counts_every_result(model: Any) -> None:
    seen: list[int] = []
    list(batch(model, cases(9), 0.1, 1e-2, workers=2, progress=seen.append))
    assert seen == list(range(1, 10))
