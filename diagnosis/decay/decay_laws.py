"""The law by which an amplitude decays, told from the envelope.

| law | dissipation | amplitude over time |
|---|---|---|
| viscous | force proportional to speed | A exp(-r t) |
| coulomb | force of constant size (dry friction) | A - c t: a constant loss per cycle, until it stops |
| drag | force proportional to the square of the speed | A / (1 + b t) |
| viscous and coulomb | both | (A + c/r) exp(-r t) - c/r |

A stiffness k and a dry friction F lose 4 F / k of amplitude per cycle, so c = 4 F f / k at the frequency f.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from diagnosis.recordings.columns import Vector

LEAST_POINTS = 5
"""Smallest number of amplitudes for a fit."""

CLEAR = 6.0
"""Difference of the Bayesian information criterion above which one law is preferred (odds of 20 to 1)."""


@dataclass(frozen=True)
class Envelope:
    """A law fitted to amplitudes by least squares.

    Attributes:
        law: ``viscous``, ``coulomb``, ``drag`` or ``viscous and coulomb``.
        start: amplitude at time 0, in the signal's unit.
        rate: r (1/s) or b (1/s); 0 for ``coulomb``.
        loss: c, the constant loss of amplitude per second, in the signal's unit per second; 0 where there is none.
        rms: of the residuals, in the signal's unit.
    """

    law: str
    start: float
    rate: float
    loss: float
    rms: float

    def at(self, time: Vector) -> Vector:
        """Amplitude at times (s); never below zero."""
        if self.law == "drag":
            return np.asarray(self.start / (1 + self.rate * time))
        if self.rate == 0:
            return np.maximum(self.start - self.loss * time, 0.0)
        settled = self.loss / self.rate
        return np.maximum((self.start + settled) * np.exp(-self.rate * time) - settled, 0.0)


@dataclass(frozen=True)
class Envelopes:
    """All laws, fitted to the same amplitudes.

    Attributes:
        fits: best first.
        verdict: the preferred law, or ``undecided`` if the best is not clearly better than the next.
        loss_per_cycle: loss of amplitude in the first and the last cycle, in the signal's unit.
    """

    fits: tuple[Envelope, ...]
    verdict: str
    loss_per_cycle: tuple[float, float]

    def fit(self, law: str) -> Envelope:
        """The fit of a law."""
        return next(fit for fit in self.fits if fit.law == law)

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        first, last = self.loss_per_cycle
        if self.verdict == "coulomb":
            return (
                f"amplitude falls by a near-constant {first:.3g} to {last:.3g} per cycle: dry (Coulomb) friction, "
                "for which a damping ratio is no property of the joint"
            )
        if self.verdict == "viscous":
            return "amplitude falls exponentially: viscous damping"
        if self.verdict == "drag":
            return "amplitude falls hyperbolically: damping by the square of the speed, as of air"
        if self.verdict == "viscous and coulomb":
            return "amplitude falls exponentially and reaches zero: viscous damping with dry (Coulomb) friction"
        return "the amplitudes do not distinguish the laws of decay"


def envelopes(time: Vector, amplitude: Vector, frequency: float, independent: float | None = None) -> Envelopes | None:
    """Fit every law and choose the preferred one.

    Args:
        time: s, shape (n,).
        amplitude: positive, shape (n,).
        frequency: of the oscillation (Hz), for the loss per cycle.
        independent: number of independent amplitudes, if fewer than given (windows that overlap).

    Returns:
        None if there are fewer than five amplitudes.
    """
    if len(time) < LEAST_POINTS:
        return None
    fits = [_viscous(time, amplitude), _coulomb(time, amplitude), _drag(time, amplitude)]
    if len(time) > LEAST_POINTS:
        fits.append(_both(time, amplitude))
    n = min(len(time), independent or math.inf)
    floor = 1e-7 * float(amplitude.max())

    def information(fit: Envelope) -> float:
        free = 3 if fit.law == "viscous and coulomb" else 2
        return 2 * n * math.log(max(fit.rms, floor)) + free * math.log(n)

    fits.sort(key=information)
    clear = information(fits[1]) - information(fits[0]) > CLEAR
    best = fits[0]
    if not clear and "viscous and coulomb" in (best.law, fits[1].law):
        # The mixed law contains two of the others: it is preferred only if clearly better than each of them.
        fits.sort(key=lambda fit: (fit.law == "viscous and coulomb", information(fit)))
        best = fits[0]
        clear = information(fits[1]) - information(best) > CLEAR
    period = 1 / frequency
    ends = best.at(np.array([time[0], time[0] + period, time[-1] - period, time[-1]]))
    return Envelopes(
        tuple(fits),
        best.law if clear else "undecided",
        (float(ends[0] - ends[1]), float(ends[2] - ends[3])),
    )


def _rms(residual: Vector) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def _made(law: str, start: float, rate: float, loss: float, time: Vector, amplitude: Vector) -> Envelope:
    blank = Envelope(law, start, rate, loss, 0.0)
    return Envelope(law, start, rate, loss, _rms(blank.at(time) - amplitude))


def _coulomb(time: Vector, amplitude: Vector) -> Envelope:
    slope, start = np.polyfit(time, amplitude, 1)
    return _made("coulomb", float(start), 0.0, -float(slope), time, amplitude)


def _viscous(time: Vector, amplitude: Vector) -> Envelope:
    from scipy.optimize import least_squares

    slope, logarithm = np.polyfit(time, np.log(amplitude), 1)
    scale = float(amplitude.max())
    found = least_squares(
        lambda p: (scale * math.exp(p[0]) * np.exp(-p[1] * time) - amplitude) / scale,
        [float(logarithm) - math.log(scale), -float(slope)],
        x_scale=[1.0, max(abs(float(slope)), 1e-9)],
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    ).x
    return _made("viscous", scale * math.exp(found[0]), float(found[1]), 0.0, time, amplitude)


def _drag(time: Vector, amplitude: Vector) -> Envelope:
    from scipy.optimize import least_squares

    slope, inverse = np.polyfit(time, 1 / amplitude, 1)
    scale = float(amplitude.max())
    start = 1 / inverse if inverse > 0 else scale
    rate = max(float(slope) * start, 1e-9)
    found = least_squares(
        lambda p: (scale * p[0] / (1 + rate * p[1] * time) - amplitude) / scale,
        [start / scale, 1.0],
        bounds=([0.0, 0.0], [np.inf, np.inf]),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    ).x
    return _made("drag", scale * float(found[0]), rate * float(found[1]), 0.0, time, amplitude)


def _both(time: Vector, amplitude: Vector) -> Envelope:
    """A(t) = p exp(-r t) - q with q = c/r >= 0: linear in p and q, so that only r is searched."""
    from scipy.optimize import minimize_scalar, nnls

    span = float(time[-1] - time[0])

    def linear(logarithm: float) -> tuple[Vector, float]:
        matrix = np.column_stack([np.exp(-math.exp(logarithm) * time), -np.ones_like(time)])
        parts, residual = nnls(matrix, amplitude)
        return np.asarray(parts, dtype=np.float64), float(residual)

    grid = np.log(np.geomspace(1e-2 / span, 30 / span, 60))
    best = int(np.argmin([linear(x)[1] for x in grid]))
    bracket = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    logarithm = float(minimize_scalar(lambda x: linear(x)[1], bounds=bracket, method="bounded").x)
    (p, q), _ = linear(logarithm)
    rate = math.exp(logarithm)
    return _made("viscous and coulomb", float(p - q), rate, float(q * rate), time, amplitude)
