"""Threads whose runs in C end when the thread that waits for them is interrupted."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any, TypeVar

from engine import native
from engine.work import Work, count_by, counting

Answer = TypeVar("Answer")


class Threads(ThreadPoolExecutor):
    """A pool of threads; a context manager. Ctrl-C inside it ends the runs that are under way.

    That holds for the runs of pools that these threads make, too. They are counted with those of the maker's thread
    (`engine.work`). A pool that outlives its maker is no matter for this class.

    Args:
        workers: how many.
        name: with which the threads' names begin.
    """

    def __init__(self, workers: int, name: str = "flexarm") -> None:
        inherited = native.cancelling()
        self._flag = ctypes.c_int32(0) if inherited is None else inherited
        self.workers = workers
        super().__init__(workers, name, initializer=_begin, initargs=(self._flag, counting()))

    def map(
        self, fn: Callable[..., Answer], *iterables: Iterable[Any], timeout: float | None = None, chunksize: int = 1
    ) -> Iterator[Answer]:
        """As that of the base class, but a single worker's work is done by the thread that asks for it.

        A switch of threads costs as much as a short run.
        """
        if self.workers == 1:
            return map(fn, *iterables)
        return super().map(fn, *iterables, timeout=timeout, chunksize=chunksize)

    def cancel(self) -> None:
        """End the runs that are under way, and let none begin."""
        self._flag.value = 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        interrupted = kind is not None and not issubclass(kind, Exception)
        if interrupted:
            self.cancel()
        self.shutdown(wait=True, cancel_futures=interrupted)
        return None


def _begin(flag: ctypes.c_int32, work: Work | None) -> None:
    native.cancelled_by(flag)
    count_by(work)
