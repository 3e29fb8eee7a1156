"""Recursion without Python's stack: functions that call one another through long chains of blocks.

A step is a generator that yields the steps whose answers it needs, and returns its own answer. Errors pass through the
steps that wait, as they pass through callers.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, TypeVar

Answer = TypeVar("Answer")
Step = Generator[Any, Any, Answer]


def run(step: Step[Answer]) -> Answer:
    """Carry out a step and all that it needs, at any depth."""
    stack: list[Step[Any]] = [step]
    value: Any = None
    error: BaseException | None = None
    while stack:
        try:
            needed = stack[-1].send(value) if error is None else stack[-1].throw(error)
        except StopIteration as done:
            stack.pop()
            value, error = done.value, None
        except BaseException as raised:
            stack.pop()
            value, error = None, raised
        else:
            stack.append(needed)
            value, error = None, None
    if error is not None:
        raise error
    return value  # type: ignore[no-any-return]
