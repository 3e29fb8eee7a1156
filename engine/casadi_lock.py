"""One thread at a time works with symbols.

CasADi 3.7 and 3.8 let go of Python's lock while they work, and keep equal constants as one. A thread that drops the
last expression with a constant may free it after another thread was given it, which then reads what is freed and ends
the process: one of 13 diagnoses with two threads did. Expressions are mostly made in Python, so waiting is cheap.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any, Generic, ParamSpec, Self, TypeVar, overload

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


class symbolic_property(Generic[Made]):  # noqa: N801  # it is written as a decorator
    """`functools.cached_property` of what is made of symbols.

    That of Python 3.11 has a lock of its own, for all instances together: two threads, each with one of the two locks,
    would wait for one another for ever.
    """

    def __init__(self, function: Callable[[Any], Made]) -> None:
        self._function = function
        self.__doc__ = function.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type) -> Made: ...

    def __get__(self, instance: object | None, owner: type) -> Made | Self:
        if instance is None:
            return self
        kept = instance.__dict__
        with _lock:
            if self._name not in kept:
                kept[self._name] = self._function(instance)
        found: Made = kept[self._name]
        return found
