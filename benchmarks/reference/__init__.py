"""Hand-written C loops of the reference models, compiled with the engine's compiler and flags."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine.compile import library

OUTPUTS = {"a": 5, "b": 7, "c": 6}
"""Outputs of each loop: those that the scenario ``reference-...`` records, in its order."""

Loop = Callable[[int, int, NDArray[np.float64]], int]


def loop(model: str) -> Loop:
    """The loop of model ``a``, ``b`` or ``c``: (rows after the first, RK4 steps per row, outputs) -> switches."""
    function = library((Path(__file__).parent / f"model_{model}.c").read_text(encoding="utf-8")).reference
    function.argtypes = [ctypes.c_int64, ctypes.c_int64, ctypes.POINTER(ctypes.c_double)]
    function.restype = ctypes.c_int

    def run(rows: int, parts: int, y: NDArray[np.float64]) -> int:
        assert y.shape == (rows + 1, OUTPUTS[model])
        assert y.flags.c_contiguous
        assert y.dtype == np.float64
        return int(function(rows, parts, y.ctypes.data_as(ctypes.POINTER(ctypes.c_double))))

    return run


def disagreement(ours: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Largest difference of any output, relative to that output's largest magnitude."""
    return float((np.abs(ours - other).max(axis=0) / np.abs(other).max(axis=0)).max())
