"""How many independent values a coloured residual counts for, by the ways to whiten it.

    python -m benchmarks.whitening

Two models of one recording leave the sensor's white noise and each a slow residual below 2 Hz, 32 independent values,
the second's a tenth larger. The difference of their log-likelihoods is computed with the spectrum known (which is
right), in bands of a third of an octave with strengths of their own (as `diagnosis.search.evidence` does), with an
autoregressive model of order 8 of what the better one leaves, and with white noise. Prints median and standard
deviation over drawn pairs; ADR 18 has the table.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
import scipy.linalg
from numpy.random import Generator
from numpy.typing import NDArray

Array = NDArray[np.float64]

SECONDS, VALUES, ORDER, LARGER, PAIRS = 8, 32, 8, 1.1, 60
CASES = ((1000, 1.0), (1000, 3.0), (1000, 30.0), (5000, 30.0))
"""Samples a second, and root mean square of the slow residual in that of the noise."""


def left(random: Generator, noise: Array, size: float) -> Array:
    """Noise and a slow residual of a root mean square, as amplitudes of cosines, shape (n,)."""
    found = noise.copy()
    found[1 : VALUES + 1] += size * np.sqrt(len(noise) / VALUES) * random.normal(size=VALUES)
    return found


def known(best: Array, rival: Array, size: float) -> float:
    """With the spectrum of each known."""
    total = 0.0
    for c, own, sign in ((rival, LARGER * size, 1), (best, size, -1)):
        power = np.ones(len(c))
        power[1 : VALUES + 1] += own**2 * len(c) / VALUES
        total -= sign * 0.5 * float(np.sum(np.log(power) + c**2 / power))
    return total


def in_bands(c: Array, rate: float) -> float:
    """Log-likelihood with a strength for each third of an octave, never below the sensor's."""
    n = len(c)
    number = np.zeros(n)
    number[1:] = np.floor(3 * np.log2(np.arange(1, n) * rate / (2 * n)))
    number[:5] = number[4]
    total = 0.0
    for band in np.unique(number):
        squares = c[number == band] ** 2
        strength = max(float(squares.mean()), 1.0)
        total -= 0.5 * float(len(squares) * np.log(strength) + squares.sum() / strength)
    return total


def autoregressive(best: Array, rival: Array) -> float:
    """By the innovations of an autoregressive model of the better one (Yule-Walker), with their variance."""
    n = len(best)
    lags = np.array([best[: n - k] @ best[k:] for k in range(ORDER + 1)]) / n
    taps = scipy.linalg.solve_toeplitz(lags[:ORDER], lags[1:])

    def power(x: Array) -> float:
        rest = x[ORDER:] - sum(taps[k] * x[ORDER - 1 - k : n - 1 - k] for k in range(ORDER))
        return float(rest @ rest)

    return -0.5 * (power(rival) / power(best) - 1) * (n - ORDER)


def main() -> None:
    """Print the table."""
    print(f"{'rate':>6s} {'residual':>8s} {'known':>14s} {'bands':>14s} {'AR(8)':>14s} {'white':>16s}")
    for rate, size in CASES:
        random, n, rows = np.random.default_rng(0), SECONDS * rate, []
        for _ in range(PAIRS):
            noise = random.normal(size=n)
            c, other = left(random, noise, size), left(random, noise, LARGER * size)
            best, rival = (scipy.fft.idct(x, norm="ortho") for x in (c, other))
            white = -0.5 * (float(rival @ rival) / float(best @ best) - 1) * n
            bands = in_bands(other, rate) - in_bands(c, rate)
            rows.append((known(c, other, size), bands, autoregressive(best, rival), white))
        told = [f"{np.median(x):.0f} +- {np.std(x):.0f}" for x in np.array(rows).T]
        print(f"{rate:6d} {size:8g} {told[0]:>14s} {told[1]:>14s} {told[2]:>14s} {told[3]:>16s}")


if __name__ == "__main__":
    main()
