"""What any input may lead to: a result without NaN, or an error that says where; within bounded time."""

from __future__ import annotations

import contextlib
import re
import signal
import warnings
from collections.abc import Iterator
from types import FrameType

from engine import simulate
from engine.errors import FlexarmError

LONGEST = 30
"""Seconds of this process's work that one example may take before it counts as a hang."""

WAITING = 20
"""Times as long by the clock before it counts as one, whatever else the machine does: for what waits idly."""

STEPS = 20_000
"""Bound on internal steps while properties run, so that the bound itself is met and every example is short."""

REFUSED, RESULT = "refused", "result"

_NAMED = re.compile(r"'[^']+'|t = |\b(step|stop|internal_step|drive|rows|line|times?)\b")


class Hang(BaseException):
    """An example took too long; not an `Exception`, so that no handler of the library swallows it."""


@contextlib.contextmanager
def bounded(seconds: int = LONGEST, steps: int = STEPS) -> Iterator[None]:
    """Within it Python code that works for longer than ``seconds`` is stopped, and a run has at most ``steps``."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise Hang(f"longer than {seconds} s")

    before, most = [(s, signal.signal(s, ring)) for s in (signal.SIGALRM, signal.SIGPROF)], simulate.MOST_STEPS
    signal.alarm(WAITING * seconds)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    simulate.MOST_STEPS = steps
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        for number, handler in before:
            signal.signal(number, handler)
        simulate.MOST_STEPS = most


def refused(error: FlexarmError) -> str:
    """Assert that an error says what is wrong; who holds the value adds where."""
    assert error.message.strip(), "an empty message"
    assert len(str(error)) < 5000, "a message out of all proportion"
    return REFUSED


def explained(error: FlexarmError, file: bool = False) -> str:
    """Assert that an error says what is wrong and where; ``file``: the place must be one in a file."""
    text = str(error)
    assert error.message.strip(), "an empty message"
    assert len(text) < 5000, f"a message of {len(text)} characters"
    text.encode("utf-8")
    if file:
        assert error.where is not None, f"no place: {text}"
        assert error.where.file, f"no file: {text}"
    else:
        assert (error.where is not None and str(error.where)) or _NAMED.search(text), f"names nothing: {text}"
    return REFUSED
