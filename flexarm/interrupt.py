"""Ctrl-C that is not lost: Python drops an exception that is raised in a destructor or in a callback from C."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from typing import Any


@contextlib.contextmanager
def heard() -> Iterator[Callable[[], None]]:
    """While this is open, Ctrl-C raises KeyboardInterrupt as usual, and is remembered.

    Yields:
        A function that raises KeyboardInterrupt if Ctrl-C was pressed; to be called now and then.
    """
    pressed = False

    def press(number: int, frame: Any) -> None:
        nonlocal pressed
        pressed = True
        raise KeyboardInterrupt

    def check() -> None:
        if pressed:
            raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT) or signal.default_int_handler
    try:
        if before is not signal.SIG_IGN:  # a command in the background is not to be stopped by Ctrl-C
            signal.signal(signal.SIGINT, press)
    except ValueError:  # another thread than the main one, which gets no signals
        yield check
        return
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
