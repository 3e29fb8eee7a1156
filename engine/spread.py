"""Map a function over many tasks: in this process, on threads, on processes, or on a dask cluster.

Results come in the order of the tasks, on every backend. Only a bounded number of tasks runs at a time, so neither all
tasks nor all results need to fit into memory. Tasks, results
and the function travel to other processes, so that each must be picklable; the function is one of a module.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, TypeVar

from engine.errors import FlexarmError
from engine.files import folder_made, writing
from engine.threads import Threads

Task = TypeVar("Task")
Answer = TypeVar("Answer")

AHEAD = 8
"""Tasks under way for each worker, so that none waits while the oldest is not finished: it may take ten times as long
as the others."""

MOST_WORKERS = 256
"""Workers of one machine: each process takes some 100 MB."""

CONNECT = "15s"
"""How long a cluster may take to answer."""


def cores() -> int:
    """Cores that this process may use."""
    with contextlib.suppress(AttributeError):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Spread:
    """Workers for `map` and `kept`; a context manager. Leaving it by an exception stops what is under way.

    Args:
        workers: how many; as many as cores if None. One works in this process. A cluster has its own number.
        scheduler: address of a dask scheduler such as ``tcp://10.0.0.1:8786``; its workers must have flexarm installed.
        threads: threads of this process in place of processes, for functions that hold no interpreter lock.

    Raises:
        FlexarmError: the cluster does not answer, or dask is not installed.
    """

    def __init__(self, workers: int | None = None, scheduler: str | None = None, *, threads: bool = False) -> None:
        if workers is not None and workers < 1:
            raise FlexarmError(f"{workers} workers cannot do anything", remedy="give 1 or more")
        if workers is not None and workers > MOST_WORKERS:
            raise FlexarmError(
                f"{workers} workers are too many for this machine's {cores()} cores",
                remedy=f"give at most {MOST_WORKERS}, best one for each core, or a --scheduler",
            )
        self.workers = workers or cores()
        self._client: Any = None
        self._pool: Executor | None = None
        self._alive: Connection | None = None
        if scheduler:
            self._client = _cluster(scheduler)
            self.workers = max(1, sum(self._client.nthreads().values()))
        elif threads and self.workers > 1:
            self._pool = Threads(self.workers, "flexarm-spread")
        elif self.workers > 1:
            # Spawned, because a fork of a process with threads may hang. Workers end when this end of the pipe closes,
            # be it that we close it or that this process is killed.
            context = multiprocessing.get_context("spawn")
            reader, self._alive = context.Pipe(duplex=False)
            self._pool = ProcessPoolExecutor(self.workers, context, initializer=_begin, initargs=(reader,))

    def map(self, function: Callable[[Task], Answer], tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Yield ``function(task)`` for every task, in order; tasks are taken as they are needed.

        Raises:
            FlexarmError: a worker died. What the function raises is raised here, in the task's turn.
        """
        if self._pool is None and self._client is None:
            yield from map(function, tasks)
            return
        waiting: deque[Future[Answer]] = deque()
        try:
            for task in tasks:
                waiting.append(self._submit(function, task))
                if len(waiting) >= AHEAD * self.workers:
                    yield self._result(waiting.popleft())
            while waiting:
                yield self._result(waiting.popleft())
        finally:
            # A pool of processes whose workers end breaks over a future that was cancelled here, and then keeps the
            # interpreter from ending (CPython 3.11); its own shutdown cancels what waits.
            for future in waiting if not isinstance(self._pool, ProcessPoolExecutor) else ():
                future.cancel()

    def _submit(self, function: Callable[[Task], Answer], task: Task) -> Future[Answer]:
        try:
            if self._client is not None:
                made: Future[Answer] = self._client.submit(function, task, pure=False)
                return made
            assert self._pool is not None
            return self._pool.submit(function, task)
        except BrokenProcessPool as error:
            raise _died() from error

    def _result(self, future: Future[Answer]) -> Answer:
        try:
            return future.result()
        except BrokenProcessPool as error:
            raise _died() from error
        except Exception as error:
            if type(error).__module__.partition(".")[0] in ("distributed", "dask"):
                raise FlexarmError(
                    f"the cluster lost a task: {str(error)[:300]}", remedy="see the logs of its workers, and try again"
                ) from error
            raise

    def call(self, function: Callable[[Task], Answer], task: Task) -> Answer:
        """``function(task)``, done by a worker; threads of this process may call it at the same time.

        Raises:
            FlexarmError: a worker died. What the function raises is raised here.
        """
        if self._pool is None and self._client is None:
            return function(task)
        return self._result(self._submit(function, task))

    def shared(self, value: Task) -> Task:
        """Data that many tasks share: sent to each worker of a cluster once. Put the returned object into the tasks."""
        if self._client is None:
            return value
        shipped: Task = self._client.scatter(value, broadcast=True, hash=False)
        return shipped

    def kept(
        self, function: Callable[[Task], Any], tasks: Iterable[tuple[str, Task]], store: Store
    ) -> Generator[tuple[str, Any], None, None]:
        """Like `map` for tasks with keys, except that what the store holds is not computed again.

        Args:
            function: called for tasks whose key the store does not hold; the store keeps what it returns.
            tasks: key and task; the key tells everything that the result depends on.
            store: such as a `JsonStore`.

        Yields:
            Key and result, as the store gives it back, in the order of the tasks.
        """
        listed = list(tasks)
        missing = [pair for pair in dict(listed).items() if pair[0] not in store]
        fresh = zip((key for key, _ in missing), self.map(function, [task for _, task in missing]), strict=True)
        for key, _ in listed:
            while key not in store:
                done, answer = next(fresh)
                store[done] = answer
            yield key, store[key]

    def __enter__(self) -> Spread:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(self._pool, Threads) and kind is not None and not issubclass(kind, Exception):
            self._pool.cancel()
        self.close(at_once=kind is not None)

    def close(self, at_once: bool = False) -> None:
        """End the workers; ``at_once`` without waiting for what they do."""
        if self._client is not None:
            self._client.close()
        if at_once and self._alive is not None:
            self._alive.close()
        if self._pool is not None:
            self._pool.shutdown(wait=not at_once, cancel_futures=True)
        if self._alive is not None and not at_once:
            self._alive.close()


class Store(Protocol):
    """Where `Spread.kept` keeps results by key."""

    def __contains__(self, key: str, /) -> bool: ...
    def __getitem__(self, key: str, /) -> Any: ...
    def __setitem__(self, key: str, value: Any, /) -> None: ...


class JsonStore:
    """A folder of JSON files, one for each key, each put in place whole and with its hash; damaged ones do not count.

    Args:
        folder: made if it does not exist.

    Raises:
        FlexarmError: it cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder_made(folder)

    def _path(self, key: str) -> Path:
        return self.folder / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"

    def __contains__(self, key: str) -> bool:
        return self._read(key) is not None

    def __getitem__(self, key: str) -> Any:
        found = self._read(key)
        if found is None:
            raise KeyError(key)
        return found[0]

    def _read(self, key: str) -> tuple[Any] | None:
        try:
            content = json.loads(self._path(key).read_text(encoding="utf-8"))
            value = content["value"]
            return (value,) if content["sha256"] == _digest(key, value) else None
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return None

    def __setitem__(self, key: str, value: Any) -> None:
        value = json.loads(json.dumps(value))  # as it is read again
        with writing(self._path(key), (".json",)) as temporary:
            temporary.write_text(json.dumps({"sha256": _digest(key, value), "value": value}), encoding="utf-8")


def _digest(key: str, value: Any) -> str:
    return hashlib.sha256(f"{key}\0{json.dumps(value)}".encode()).hexdigest()


def _begin(alive: Connection) -> None:
    """What a worker process does first."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    threading.Thread(target=_watch, args=(alive,), daemon=True).start()


def _watch(alive: Connection) -> None:
    wait([alive])
    os._exit(1)


def _died() -> FlexarmError:
    return FlexarmError(
        "a worker process died: it was killed, ran out of memory, or could not start",
        remedy="try again with fewer workers; a script that calls this needs the line: if __name__ == '__main__':",
    )


def _cluster(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise FlexarmError(
            "a scheduler needs dask.distributed, which is not installed", remedy="pip install 'flexarm[cluster]'"
        ) from error
    try:
        return Client(address, timeout=CONNECT, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        raise FlexarmError(
            f"no dask scheduler answers at '{address}': {error}",
            remedy="start one by 'dask scheduler', and give its address, such as tcp://10.0.0.1:8786",
        ) from error
