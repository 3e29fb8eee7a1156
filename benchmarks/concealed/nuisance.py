"""Small disturbances that no entry of the catalogue names, and the noise of the sensors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.concealed.bench import Bench
from benchmarks.concealed.effects import CATALOGUE
from benchmarks.concealed.refit import Small
from benchmarks.concealed.sites import Site, scales
from benchmarks.concealed.truth import Nuisance, Truth

Array = NDArray[np.float64]

GAIN = 0.05
SHARES = (0.06, 0.16)
"""What each disturbance leaves after a refit, in floors."""

SENSOR_DRIFT = (0.1, 0.3)
"""Drift of a sensor that does not count, in floors."""

FARTHEST = 0.003
"""The same at most, as a share of what the signal moves: a sensor that drifts by more is a fault of its own."""

MOST = math.hypot(*(3 * [SHARES[1]]), SENSOR_DRIFT[1])
"""What all of them together leave at most, in floors."""


def nuisance(bench: Bench, base: Truth, rng: Generator, level: float) -> Nuisance:
    """Draw the disturbances of a case.

    The amplifier's gain is off by up to 5 %. Half of the plants with a winding have an inductance. Two torque ripples
    of no whole order, friction that warms up and a slow torque are each scaled until a refit leaves 0.06 to 0.16 floors
    of them over all recordings; sensors that do not count drift by 0.1 to 0.3 floors; a fifth of the noise's power is
    coloured. An inductance that a sensor shows more of than all other disturbances together is left out, such as one
    beside an accelerometer on the rotor; on random rigs one that it shows more of than of any other torque, since the
    catalogue names it, and it would be the one thing to find.

    Args:
        bench: the recordings.
        base: the bare truth.
        rng: of the disturbances.
        level: factor on all but gain and inductance; 0 for no disturbance at all.
    """
    gain, winding = float(rng.uniform(-GAIN, GAIN)), bool(rng.random() < 0.5)
    waves = [(float(rng.uniform(9.5, 23.5)), float(rng.uniform(0, 2 * math.pi))) for _ in range(2)]
    shares = rng.uniform(*SHARES, 3)
    drifts = rng.uniform(*SENSOR_DRIFT, len(bench.signals))
    if level == 0:
        return Nuisance()
    here, small = scales(bench, base, Site(CATALOGUE["coulomb_friction"], base.plant.main)), Small(bench, base)
    parts = (
        Nuisance(ripple=tuple((part, *wave) for wave, part in zip(waves, (1.0, 0.5), strict=True))),
        Nuisance(warm_up=(1 / here.speed, 20.0)),
        Nuisance(drift=1.0),
    )
    scaled = Nuisance()
    for part, share in zip(parts, shares, strict=True):
        torque = 1e-3 * here.torque
        for _ in range(3):
            left = small.size(bench.outputs(replace(base, nuisance=_times(part, torque))))
            torque *= level * float(share) / max(left, 1e-9)
        one = _times(part, torque)
        scaled = replace(
            scaled,
            ripple=scaled.ripple or one.ripple,
            warm_up=one.warm_up if one.warm_up[0] else scaled.warm_up,
            drift=scaled.drift or one.drift,
        )
    inductance = base.plant.inductance * float(winding)
    shown = small.size(bench.outputs(replace(base, nuisance=Nuisance(inductance=inductance)))) if inductance else 0.0
    if shown > level * (SHARES[1] if base.plant.habits.hidden else MOST):
        inductance = 0.0
    spans = np.ptp(np.concatenate(bench.outputs(base)), axis=0)
    still = [base.plant.sensor(s).quantum > 0 for s in bench.signals]
    return replace(
        scaled,
        gain=gain,
        inductance=inductance,
        sensor_drift=tuple(
            0.0 if s else float(sigma) * min(level * float(d), FARTHEST * float(span))
            for s, d, sigma, span in zip(still, drifts, bench.sigma, spans, strict=True)
        ),
        coloured=(0.2, 0.02),
    )


def smaller(one: Nuisance, other: Nuisance) -> Nuisance:
    """The first, with each of its torques no larger than in the second."""
    ripple = min((one.ripple, other.ripple), key=lambda waves: max((abs(a) for a, *_ in waves), default=0.0))
    return replace(
        one,
        ripple=ripple,
        warm_up=min(one.warm_up, other.warm_up),
        drift=min(one.drift, other.drift),
    )


def _times(one: Nuisance, torque: float) -> Nuisance:
    """A disturbance of unit torque, scaled."""
    return replace(
        one,
        ripple=tuple((a * torque, order, phase) for a, order, phase in one.ripple),
        warm_up=(one.warm_up[0] * torque, one.warm_up[1]),
        drift=one.drift * torque,
    )


def slow_course(rng: Generator, samples: int, interval: float) -> Array:
    """A slow random course of root mean square 1: three cosines below 0.5 Hz."""
    t = interval * np.arange(samples)
    course = sum(np.cos(2 * np.pi * rng.uniform(0.05, 0.5) * t + rng.uniform(0, 2 * np.pi)) for _ in range(3))
    return np.asarray(course / np.sqrt(np.mean(np.square(course))))


def sensor_noise(rng: Generator, samples: int, interval: float, sigma: float, coloured: tuple[float, float]) -> Array:
    """White noise with a coloured share (first-order, of a correlation time); ``sigma`` is that of the sum."""
    share, correlation = coloured
    keep = math.exp(-interval / correlation)
    white, source = rng.standard_normal(samples), rng.standard_normal(samples)
    slow = lfilter([math.sqrt(1 - keep**2)], [1.0, -keep], source)
    return sigma * (math.sqrt(1 - share) * white + math.sqrt(share) * np.asarray(slow))
