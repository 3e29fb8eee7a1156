"""Bounds on held-out responses, each calibrated on other data than it is scored on, and the weights from all."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexarm.design.uncertainty.calibration import LEVEL, Calibration, calibrated
from flexarm.design.uncertainty.results import Band, Weight
from flexarm.design.uncertainty.spectra import Piece, pieces_of

if TYPE_CHECKING:
    from diagnosis.estimation.least_squares import Fit


def bounds(
    fit: Fit, draws: Sequence[NDArray[np.float64]], progress: Callable[[float], None] | None
) -> tuple[tuple[Band, ...], dict[str, Weight]]:
    """Bounds on every part of every held-out recording, each calibrated on all others, and weights from all."""
    from diagnosis.estimation.time_experiment import TimeExperiment

    held = [e for e in fit.problem.held_out if isinstance(e, TimeExperiment)]
    pieces: list[Piece] = []
    for number, e in enumerate(held):
        pieces += pieces_of(fit, draws, e, halves=len(held) < 2)
        if progress is not None:
            progress((number + 1) / len(held))
    bands: list[Band] = []
    weights: dict[str, Weight] = {}
    for signal in dict.fromkeys(piece.signal for piece in pieces):
        mine = [piece for piece in pieces if piece.signal == signal]
        whole = calibrated(mine)
        weights[signal] = replace(whole.weight, gain=whole.weight.gain * whole.factor)
        for piece in mine:
            others = [other for other in mine if other is not piece]
            if not others:
                continue
            bands.append(_band(piece, calibrated(others)))
    return tuple(bands), weights


def _band(piece: Piece, calibration: Calibration) -> Band:
    # The amplitude of a complex normal bin keeps within sqrt(-ln 0.05) of its deviation in 95 of 100.
    bound, alone = calibration.bound(piece), math.sqrt(-math.log(1 - LEVEL)) * np.sqrt(piece.variance)
    return Band(
        piece.recording,
        piece.signal,
        piece.unit,
        piece.part,
        piece.frequency,
        piece.measured,
        piece.predicted,
        piece.left,
        bound,
        alone,
    )
