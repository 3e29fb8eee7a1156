"""`engine.spread`: order, bounded work ahead, results kept by key, workers that die, on threads and processes."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from engine.errors import FlexarmError
from engine.spread import AHEAD, JsonStore, Spread


def square(number: int) -> int:
    return number * number


def sleepy(number: int) -> int:
    """Later tasks are finished first."""
    time.sleep(0.05 * (number % 3 == 0))
    return number


def fatal(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def wrong(number: int) -> int:
    if number == 5:
        raise FlexarmError("five is wrong", remedy="give six")
    return number


@pytest.mark.parametrize("settings", [{"workers": 1}, {"workers": 3, "threads": True}, {"workers": 2}])
def test_results_come_in_order(settings: dict[str, Any]) -> None:
    with Spread(**settings) as spread:
        assert list(spread.map(sleepy, range(20))) == list(range(20))
        assert list(spread.map(square, iter(range(5)))) == [0, 1, 4, 9, 16]


def test_tasks_are_taken_as_they_are_needed() -> None:
    """Of an endless generator, only the bounded number ahead of the reader is taken."""
    taken = 0

    def tasks() -> Iterator[Any]:
        nonlocal taken
        while True:
            taken += 1
            yield taken

    with Spread(2, threads=True) as spread:
        found = spread.map(square, tasks())
        assert [next(found) for _ in range(10)] == [k * k for k in range(1, 11)]
        assert taken <= 10 + 2 * AHEAD
        found.close()


@pytest.mark.parametrize("settings", [{"workers": 1}, {"workers": 2}])
def test_an_error_is_raised_in_its_turn(settings: dict[str, Any]) -> None:
    with Spread(**settings) as spread:
        found = spread.map(wrong, range(10))
        assert [next(found) for _ in range(5)] == [0, 1, 2, 3, 4]
        with pytest.raises(FlexarmError, match="five is wrong") as caught:
            next(found)
    assert caught.value.remedy == "give six"


def test_a_killed_worker_is_an_error_and_not_a_hang() -> None:
    with pytest.raises(FlexarmError, match="a worker process died"), Spread(2) as spread:
        list(spread.map(fatal, range(10)))


def test_kept_results_are_not_computed_again(tmp_path: Path) -> None:
    calls = []

    def counted(number: int) -> dict[str, float]:
        calls.append(number)
        if number == 7 and calls.count(7) == 1:
            raise KeyboardInterrupt
        return {"value": number / 3}

    tasks = [(f"case {k}", k) for k in range(10)]
    store = JsonStore(tmp_path / "kept")
    with pytest.raises(KeyboardInterrupt), Spread(1) as spread:
        list(spread.kept(counted, tasks, store))
    assert calls == list(range(8))
    with Spread(1) as spread:
        found = list(spread.kept(counted, [*tasks, tasks[2]], JsonStore(tmp_path / "kept")))
    # The eighth call was interrupted; seven are kept, and 7, 8 and 9 are made.
    assert calls[8:] == [7, 8, 9]
    assert found == [(f"case {k}", {"value": k / 3}) for k in (*range(10), 2)]
    assert not [path for path in (tmp_path / "kept").iterdir() if path.name.startswith(".")]


def test_threads_work_at_the_same_time() -> None:
    """Two tasks that wait for each other end only if both run."""
    barrier = threading.Barrier(2, timeout=600)

    def meet(number: int) -> int:
        barrier.wait()
        return number

    with Spread(2, threads=True) as spread:
        assert list(spread.map(meet, range(4))) == [0, 1, 2, 3]


def test_what_is_refused() -> None:
    with pytest.raises(FlexarmError, match="0 workers"):
        Spread(0)
    pytest.importorskip("distributed")
    with pytest.raises(FlexarmError, match="no dask scheduler answers at 'nonsense://x'"):
        Spread(scheduler="nonsense://x")


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", "7", '{"value": 3}', '{"sha256": "x", "value": 3}', "[" * 99_999]
)
def test_a_damaged_entry_of_a_store_does_not_count(tmp_path: Path, text: Any) -> None:
    store = JsonStore(tmp_path)
    store["a"] = {"x": [1.5, None], "y": "z"}
    assert store["a"] == {"x": [1.5, None], "y": "z"}
    next(tmp_path.iterdir()).write_text(text)
    assert "a" not in store
    with Spread(1) as spread:
        assert list(spread.kept(lambda task: task + 1, [("a", 1)], store)) == [("a", 2)]


def test_a_store_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FlexarmError, match="file"):
        JsonStore(tmp_path / "file")
