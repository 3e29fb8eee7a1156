"""A Co-Simulation FMU in a child process, which may die: the same few calls for FMI 2 and FMI 3.

A foreign FMU is a program of its maker's. Loaded here, a truncated or faulty binary would take this process with it.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import math
import struct
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from engine.child_process import ending, environment, python_command
from engine.errors import FlexarmError, SimulationError
from fmu.archive import unpack
from fmu.loaded import Described, described

_REMEDY = "its binary may be truncated, made for another machine, or faulty; ask where it comes from for a sound one"
LOADING = 60.0
"""Seconds within which an FMU must have been loaded."""
_IDLE = 4
"""Children that are kept for the next instance of the same file; a start takes some tenths of a second."""


class Child:
    """A process that loads FMUs; see `fmu.child`.

    Raises:
        FlexarmError: no Python can be started.
    """

    def __init__(self) -> None:
        command = python_command("from fmu.child import main; main()")
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment(),
            )
        except OSError as error:
            raise FlexarmError(f"no process can be started for the FMU: {error.strerror}") from error

    def ask(self, calls: list[list[Any]], name: str) -> dict[str, Any]:
        """The answer to some calls to the FMU of that file name.

        Raises:
            SimulationError: the process died.
        """
        process, late = self._process, False
        assert process.stdin is not None
        assert process.stdout is not None

        def end() -> None:
            nonlocal late
            late = True
            process.kill()

        limit = threading.Timer(LOADING, end)
        if calls[0][0] == "open":
            limit.start()
        try:
            process.stdin.write(json.dumps(calls).encode() + b"\n")
            process.stdin.flush()
            line = process.stdout.readline()
            if line.endswith(b"\n"):
                answer: dict[str, Any] = json.loads(line)
                return answer
        except (BrokenPipeError, ConnectionError, OSError, ValueError):
            pass
        finally:
            limit.cancel()
        self.kill()
        if late:
            raise SimulationError(f"'{name}' did not load within {LOADING:g} s", remedy=_REMEDY)
        raise SimulationError(f"'{name}' ended its process {ending(process.returncode)}", remedy=_REMEDY)

    def kill(self) -> None:
        """End it at once."""
        process = self._process
        with suppress(OSError):
            process.kill()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        process.wait()


_idle: list[tuple[str, Child]] = []
_lock = threading.Lock()


def _taken(key: str) -> Child:
    """A child that has loaded nothing, or nothing but the same file."""
    with _lock:
        for k, (known, child) in enumerate(_idle):
            if known == key:
                del _idle[k]
                return child
    return Child()


def _returned(key: str, child: Child) -> None:
    with _lock:
        _idle.append((key, child))
        old = [_idle.pop(0)[1] for _ in range(len(_idle) - _IDLE)]
    for one in old:
        one.kill()


@atexit.register
def _end() -> None:
    while _idle:
        _idle.pop()[1].kill()


def _check_whole(folder: Path, file: str) -> None:
    """Refuse a library that has lost its end: the system's loader maps what is not there, and crashes or never returns.

    Raises:
        FlexarmError: an ELF library is shorter than its own tables say.
    """
    for path in folder.glob("binaries/*/*.so"):
        content = path.read_bytes()
        if content[:6] != b"\x7fELF\x02\x01" or len(content) < 64:
            continue  # of another kind, which its loader checks, or none at all
        segments, sections, _, _, size, count, width, rows = struct.unpack_from("<QQIHHHHH", content, 32)
        ends = [sections + width * rows if sections else 0, segments + size * count]
        if ends[1] <= len(content) and size >= 56:
            for k in range(count):
                offset, _, _, length = struct.unpack_from("<QQQQ", content, segments + k * size + 8)
                ends.append(offset + length)
        if max(ends) > len(content):
            raise FlexarmError(
                f"'{file}' is damaged: its '{path.name}' has {len(content)} of {max(ends)} bytes",
                remedy="get the file again, or ask where it comes from for a sound one",
            )


class Host(Described):
    """An instance of an FMU, from its start to its end; made by `host`.

    Values that are set wait for the next call that must have an answer, so what is wrong with them is told there.

    Attributes:
        description: of the FMU, as FMPy reads it.
        messages: what the FMU logged.
    """

    def __init__(self, child: Child, description: Any, file: str) -> None:
        super().__init__(description)
        self._file = file
        self.messages: list[str] = []
        self._child = child
        self._waiting: list[list[Any]] = []
        self._time = 0.0

    def _ask(self, *call: Any) -> Any:
        calls = [*self._waiting, list(call)]
        self._waiting = []
        answer = self._child.ask(calls, self._file)
        self.messages += answer["messages"]
        if "error" in answer:
            failed, message, remedy = answer["error"]
            said = message if call[0] == "open" else f"'{self._file}': {message}"
            raise (SimulationError if failed else FlexarmError)(said, remedy=remedy)
        return answer["results"][-1]

    def open(self, folder: str, name: str) -> None:
        """Load the unpacked FMU and make an instance."""
        self._ask("open", folder, name)

    def close(self) -> None:
        """Free the instance."""
        self._waiting = []
        self._ask("close")

    def set(self, names: Sequence[str], values: Sequence[float], slopes: Sequence[float] = ()) -> None:
        """Set variables; with slopes (FMI 2 alone), inputs that go on rising until the next step's end."""
        for name in names:
            self.variable(name)
        if names:
            self._waiting.append(["set", list(names), [float(v) for v in values], [float(v) for v in slopes]])

    def get(self, names: Sequence[str]) -> list[float]:
        """Values of variables.

        Raises:
            SimulationError: one is not finite.
        """
        for name in names:
            self.variable(name)
        count = len(self.messages)
        values: list[float] = self._ask("get", list(names))
        for name, value in zip(names, values, strict=True):
            if not math.isfinite(value):
                said = self.messages[count:]
                hint = f"; it said: {said[-1]}" if said else ""
                raise SimulationError(
                    f"'{name}' of the FMU is {value} at t = {self._time:.9g} s{hint}",
                    remedy="see whether its inputs and parameters fit, and its communication step is short enough",
                )
        return values

    def rate(self, name: str) -> float:
        """Rate of change of an output, per second."""
        self.variable(name)
        return float(self._ask("rate", name))

    @contextmanager
    def starting(self, start: float = 0.0, stop: float | None = None) -> Iterator[None]:
        """Initialization mode, in which inputs may be set; parameters are set before."""
        self._time = start
        self._ask("enter", start, stop)
        yield
        self._ask("leave")

    def step(self, begin: float, length: float) -> None:
        """Go on from ``begin`` by ``length`` (s).

        Raises:
            SimulationError: the FMU refuses, ends the run, stops early or dies.
        """
        self._ask("step", begin, length)
        self._time = begin + length

    def end(self) -> None:
        """Terminate the run."""
        self._ask("end")


@contextmanager
def host(path: str | Path, name: str = "instance") -> Iterator[Host]:
    """An instance of a Co-Simulation FMU in a child process, not yet started.

    Raises:
        FlexarmError: the file is no FMU, has no Co-Simulation, or has no binary that can be loaded on this machine.
    """
    description = described(path)
    key = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        unpack(Path(path), Path(folder))
        _check_whole(Path(folder), str(path))
        child = _taken(key)
        sound = False
        try:
            made = Host(child, description, Path(path).name)
            try:
                made.open(folder, name)
            except FlexarmError as error:
                raise FlexarmError(f"'{path}': {error.message}", remedy=error.remedy) from error
            yield made
            with suppress(FlexarmError):  # the run is over; an FMU that dies now is not used again
                made.close()
                sound = not description.coSimulation.canBeInstantiatedOnlyOncePerProcess
        finally:
            if sound:
                _returned(key, child)
            else:
                child.kill()
