"""A periodic answer, the run it was read from, and the linear algebra of Newton's method on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.model import Vector

Array = Any


@dataclass
class Orbit:
    """A periodic answer.

    Attributes:
        amplitudes: half the peak to peak of each output over a period.
        rms: root mean square of each output about its mean.
        x: state at the beginning of the period; None where the closed form holds.
        inverse: of I - dP/dx, for the combinations of states that matter, in units of ``span``.
        span: what each combination of states that matters spans over the period.
        settled: whether the answer repeats.
        run: what it was read from; None where the closed form holds, or where it had to settle by itself.
    """

    amplitudes: Vector
    rms: Vector
    x: Vector | None = None
    inverse: Array = None
    span: Array = None
    settled: bool = True
    run: Pass | None = None


@dataclass
class Pass:
    """The run over a period that an answer was read from.

    Attributes:
        p, step, rows: parameters, integration step (s) and steps of the run.
        lead: rows after which the start is forgotten; 0 where the answer repeats.
        x1: state after it.
        windows: for each output, where its highest and its lowest value lie: the row, and the state ``lead`` before.
    """

    p: Vector
    step: float
    rows: int
    lead: int
    x1: Vector
    windows: tuple[tuple[tuple[int, Vector], tuple[int, Vector]], ...] = ()


def reduced(rows: Array) -> Array:
    """The reduced row echelon form of independent rows."""
    rows, pivot = np.array(rows), 0
    for column in range(rows.shape[1]):
        if pivot == len(rows):
            break
        best = pivot + int(np.argmax(np.abs(rows[pivot:, column])))
        if abs(rows[best, column]) < 1e-9:
            continue
        rows[[pivot, best]] = rows[[best, pivot]]
        rows[pivot] /= rows[pivot, column]
        others = np.arange(len(rows)) != pivot
        rows[others] -= np.outer(rows[others, column], rows[pivot])
        pivot += 1
    rows[np.abs(rows) < 1e-9] = 0.0
    return rows


def renewed(inverse: Array, moved: Vector, change: Vector) -> Array:
    """Broyden's update of the inverse: a move by ``moved`` made the gap shrink by ``change``."""
    along = moved @ inverse
    below = float(along @ change)
    if abs(below) < 1e-12 * float(np.linalg.norm(along) * np.linalg.norm(change) + 1e-300):
        return inverse
    return inverse + np.outer(moved - inverse @ change, along) / below
