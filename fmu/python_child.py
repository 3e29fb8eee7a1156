"""What the Python process of an FMU does: it answers the requests of the FMU's binary; see ``heads/process.c``.

One process has one instance. It ends when the pipe of the requests is closed, by the importer or by its end.
"""

from __future__ import annotations

import contextlib
import enum
import gc
import os
import select
import signal
import struct
import sys
import threading
from collections.abc import Callable
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from pythonfmu.enums import Fmi2Status

from engine.errors import FlexarmError
from fmu.python_slave import Refused, Slave
from fmu.python_state import Standing


class Request(enum.IntEnum):
    """What is asked, as in ``heads/process.c``."""

    OPEN = 1
    SETUP = 2
    ENTER = 3
    LEAVE = 4
    TERMINATE = 5
    RESET = 6
    GET_REAL = 7
    GET_INTEGER = 8
    SET_REAL = 9
    NO_TYPE = 10
    STEP = 11
    TIME = 12
    SAVE = 13
    RESTORE = 14
    FORGET = 15
    WRITE = 16
    READ = 17
    CLOSE = 18


_REQUEST, _ANSWER, _MESSAGE = struct.Struct("=II"), struct.Struct("=III"), struct.Struct("=II")
_SETUP, _STEP, _TIME, _NUMBER = (struct.Struct(form) for form in ("=ddddd", "=dd", "=d", "=Q"))


class Child:
    """An instance and its saved states, and what requests do with them.

    Args:
        folder: resources of the FMU.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._name = ""
        self._slave: Slave | None = None
        self._saved: dict[int, Standing] = {}
        self._number = 0
        self._calls: dict[int, Callable[[bytes], object]] = {
            Request.OPEN: self._open,
            Request.SETUP: self._setup,
            Request.ENTER: lambda _: self._present.enter_initialization_mode(),
            Request.LEAVE: lambda _: self._present.exit_initialization_mode(),
            Request.TERMINATE: lambda _: self._present.terminate(),
            Request.RESET: lambda _: self._made(),
            Request.GET_REAL: lambda given: np.array(self._present.get_real(_references(given)), "=d").tobytes(),
            Request.GET_INTEGER: lambda given: np.array(self._present.get_integer(_references(given)), "=i4").tobytes(),
            Request.SET_REAL: self._set_real,
            Request.NO_TYPE: lambda given: self._present.refuse_type(_references(given)),
            Request.STEP: lambda given: self._present.do_step(*_STEP.unpack(given)),
            Request.TIME: lambda _: _TIME.pack(self._present.time),
            Request.SAVE: lambda _: self._kept(self._present._get_fmu_state()),
            Request.RESTORE: lambda given: self._present._set_fmu_state(self._saved[_number(given)]),
            Request.FORGET: lambda given: self._saved.pop(_number(given), None),
            Request.WRITE: lambda given: self._present._fmu_state_to_bytes(self._saved[_number(given)]),
            Request.READ: lambda given: self._kept(self._present._fmu_state_from_bytes(given)),
            Request.CLOSE: lambda _: self._close(),
        }

    def answer(self, asked: int, given: bytes) -> bytes:
        """The answer to a request. Whatever goes wrong is told by its status and a message."""
        status, result, text = Fmi2Status.ok, b"", ""
        try:
            made = self._calls[asked](given)
            result = made if isinstance(made, bytes) else b""
        except Refused as error:
            status, text = error.status, error.text
        except FlexarmError as error:
            status, text = Fmi2Status.error, "; ".join(filter(None, (error.message, error.remedy)))
        except BaseException as error:  # of the user's code too, which may even want to leave
            status, text = Fmi2Status.error, f"{type(error).__name__}: {error}"
        messages = b"".join(_message(log.status, log.msg) for log in self._logged())
        if text:
            messages += _message(status, text)
        return _ANSWER.pack(status.value, len(messages), len(result)) + messages + result

    @property
    def _present(self) -> Slave:
        if self._slave is None:
            raise Refused(Fmi2Status.error, "there is no instance: its model could not be loaded")
        return self._slave

    def _logged(self) -> list[Any]:
        queue = [] if self._slave is None else self._slave.log_queue
        found = list(queue)
        queue.clear()
        return found

    def _open(self, given: bytes) -> None:
        self._name = given.decode("utf-8", "replace")
        self._made()

    def _made(self) -> None:
        """Make the instance afresh, its Python functions included."""
        self._slave = None
        self._slave = Slave(instance_name=self._name, resources=str(self._folder))

    def _setup(self, given: bytes) -> None:
        with_tolerance, tolerance, start, with_stop, stop = _SETUP.unpack(given)
        self._present.setup_experiment(start, stop if with_stop else None, tolerance if with_tolerance else None)

    def _set_real(self, given: bytes) -> None:
        n = len(given) // 12
        values = np.frombuffer(given, "=d", offset=4 * n).tolist()
        self._present.set_real(_references(given[: 4 * n]), values)

    def _kept(self, state: Standing) -> bytes:
        self._number += 1
        self._saved[self._number] = state
        return _NUMBER.pack(self._number)

    def _close(self) -> None:
        self._slave = None
        self._saved.clear()
        gc.collect()  # so that files which Python functions hold are written


def _references(given: bytes) -> list[int]:
    return [int(reference) for reference in np.frombuffer(given, "=u4")]


def _number(given: bytes) -> int:
    return int(_NUMBER.unpack(given)[0])


def _message(status: Fmi2Status, text: str) -> bytes:
    raw = text.encode("utf-8", "replace")
    return _MESSAGE.pack(status.value, len(raw)) + raw


def _watch(channel: int) -> None:
    """End with the importer, even in the midst of a Python function that does not return."""
    looked = select.poll()
    looked.register(channel, 0)
    looked.poll()
    os._exit(1)


def serve(requests: int, answers: int, folder: str) -> None:
    """Answer requests until there are no more.

    Args:
        requests: descriptor to read from.
        answers: descriptor to write to, the same for a socket.
        folder: resources of the FMU.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the importer decides
    for printed in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, ValueError):
            printed.reconfigure(line_buffering=True, errors="backslashreplace")  # type: ignore[union-attr]
    if hasattr(select, "poll"):
        threading.Thread(target=_watch, args=(requests,), daemon=True).start()
    child = Child(Path(folder))
    reader: BufferedReader = os.fdopen(requests, "rb", closefd=False)
    with contextlib.suppress(OSError):
        while len(head := reader.read(_REQUEST.size)) == _REQUEST.size:
            asked, length = _REQUEST.unpack(head)
            answer = child.answer(asked, reader.read(length))
            while answer:
                answer = answer[os.write(answers, answer) :]
    with contextlib.suppress(Exception):
        sys.stdout.flush()
    os._exit(0)  # threads of the user's code would hold the process
