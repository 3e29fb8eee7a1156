"""One thread at a time works with symbols.

CasADi 3.7 and 3.8 let go of Python's lock while they work, and keep equal constants as one. A thread that drops the
last expression with a constant may free it after another thread was given it, which then reads what is freed and ends
the process: one of twelve diagnoses with two threads did. Expressions are mostly made in Python, so waiting is cheap.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import ParamSpec, TypeVar

Given = ParamSpec("Given")
Made = TypeVar("Made")

_lock = threading.RLock()


def one_at_a_time(function: Callable[Given, Made]) -> Callable[Given, Made]:
    """The function, which no thread enters while another is in one of these; what it drops is gone when it ends."""

    @functools.wraps(function)
    def alone(*args: Given.args, **kwargs: Given.kwargs) -> Made:
        with _lock:
            return function(*args, **kwargs)

    return alone
