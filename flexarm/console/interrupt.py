"""Ctrl-C that is not lost: Python drops an exception that is raised in a destructor or in a callback from C."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

INTERRUPTED = 130
"""Exit code after Ctrl-C, as of a shell."""


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
    # Only the main thread gets signals, and a command in the background is not to be stopped by Ctrl-C.
    if threading.current_thread() is not threading.main_thread() or before is signal.SIG_IGN:
        yield check
        return
    signal.signal(signal.SIGINT, press)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
