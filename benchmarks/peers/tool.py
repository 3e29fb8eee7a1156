"""What a tool is to the comparison."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SMOOTH = 1e-4
"""Speed (rad/s) over which friction is smoothed for tools that are given no events."""


@dataclass(frozen=True)
class Tool:
    """A way to solve a problem.

    Attributes:
        name, how: of the tool, and what it was told.
        run: solves it, and returns the output at every row; all that can be prepared beforehand has been.
        slow: takes seconds, so that it is repeated less often.
        setup: processor time (s) of preparing it; None if it was not measured.
    """

    name: str
    how: str
    run: Callable[[], NDArray[np.float64]]
    slow: bool = False
    setup: float | None = None


def installed(package: str) -> bool:
    """Whether a package can be imported."""
    return importlib.util.find_spec(package) is not None
