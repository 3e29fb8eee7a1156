"""Work that runs take, counted over all threads that share in it: a measure of effort that no clock disturbs."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

EACH = 420_000
"""Operations that take as long as to begin a run; measured."""

EACH_NUMBER = 20
"""Operations that take as long as what is done with each number that a run or its tangents give; measured."""

FACTORED = 0.7
"""Operations that take as long as to factor a matrix, for each of its numbers times each of its columns; measured."""

DIRECTION = 0.15
"""Time of a run's tangent in one direction, as a share of that of the run itself; measured."""


class Work:
    """A sum that threads add to.

    Attributes:
        done: operations: steps of runs, each times those of its model's right-hand side, `DIRECTION` of them for each
            tangent, `EACH` for each run and `EACH_NUMBER` for each number that it gives, and those of what is made of
            these.
    """

    def __init__(self) -> None:
        self.done = 0
        self._lock = threading.Lock()

    def add(self, done: int) -> None:
        """Count more; whole numbers, so that their sum does not hang on their order."""
        with self._lock:
            self.done += done


_own = threading.local()


def counting() -> Work | None:
    """What the runs of this thread are counted by, or None."""
    return getattr(_own, "work", None)


def count_by(work: Work | None) -> None:
    """Let the runs of this thread be counted."""
    _own.work = work


@contextmanager
def counted() -> Iterator[Work]:
    """Count the runs within by themselves, and by nobody else; those of pools of threads that are made there too."""
    before, work = counting(), Work()
    count_by(work)
    try:
        yield work
    finally:
        count_by(before)
