"""What the child process of `fmu.host` does: it loads FMUs, and does to them what it reads line by line.

A request is a line of JSON, a list of calls ``[name, argument, ...]``; the answer is a line with their results, or with
the error of the first that failed, and with what the FMU logged meanwhile.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from engine.errors import FlexarmError, SimulationError
from fmu.loaded import Loaded, instance

_LOOK = 1.0
"""Seconds between looks at whether the parent is still there."""

_MOST_MESSAGES = 1000
"""Messages that are kept of one request; an FMU may log at every step."""


class Child:
    """The FMU that is loaded, if any."""

    def __init__(self) -> None:
        self._loaded: Loaded | None = None

    def answer(self, calls: list[list[Any]]) -> dict[str, Any]:
        """The answer to a request."""
        before = self._loaded.messages if self._loaded is not None else []
        before.clear()
        made: dict[str, Any] = {}
        try:
            made["results"] = [self._called(*call) for call in calls]
        except FlexarmError as error:
            made["error"] = [type(error) is SimulationError, error.message, error.remedy]
        except Exception as error:  # whatever FMPy makes of a foreign FMU
            made["error"] = [True, f"{type(error).__name__}: {error}", ""]
        messages = self._loaded.messages if self._loaded is not None else before
        made["messages"] = messages[-_MOST_MESSAGES:]
        return made

    def _called(self, name: str, *arguments: Any) -> Any:
        if name == "open":
            from fmpy import read_model_description

            folder, instance_name = arguments
            description = read_model_description(folder, validate=False)
            self._loaded = instance(description, folder, instance_name)
            return None
        assert self._loaded is not None
        if name == "close":
            self._loaded.raw.freeInstance()
            self._loaded = None
            return None
        allowed: dict[str, Callable[..., Any]] = {
            "set": self._loaded.set,
            "get": self._loaded.get,
            "rate": self._loaded.rate,
            "enter": self._loaded.enter,
            "leave": self._loaded.leave,
            "step": self._loaded.step,
            "end": self._loaded.end,
        }
        return allowed[name](*arguments)


def _watch(parent: int) -> None:
    """End with the parent, even in the midst of a call that does not return."""
    while os.getppid() == parent:
        time.sleep(_LOOK)
    os._exit(1)


def _private() -> tuple[BinaryIO, BinaryIO]:
    """The pipes to the parent, where the FMU's own reading and printing does not reach them."""
    requests, answers = os.dup(0), os.dup(1)
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    return os.fdopen(requests, "rb"), os.fdopen(answers, "wb")


def main() -> None:
    """Answer requests until there are no more."""
    requests, answers = _private()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    if sys.platform != "win32":
        threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()
    child = Child()
    with contextlib.suppress(BrokenPipeError):
        for line in requests:
            answers.write(json.dumps(child.answer(json.loads(line))).encode() + b"\n")
            answers.flush()
    os._exit(0)  # an FMU that is still loaded may hang or crash when it is unloaded
