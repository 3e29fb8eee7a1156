"""Decays whose damping is known, from closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np

MODES = (7.622, 47.77)
AMPLITUDES = (1.0, 0.2)
LIGHT = (0.0315, 0.0068)
HEAVY = (0.198, 0.0428)


def viscous(time: Any, frequency: Any, ratio: Any, amplitude: float = 1.0, phase: float = 0.0) -> Any:
    """X exp(-xi w t) cos(w sqrt(1 - xi^2) t + phase), frequency in Hz."""
    w = 2 * np.pi * frequency
    return amplitude * np.exp(-ratio * w * time) * np.cos(w * np.sqrt(1 - ratio**2) * time + phase)


def coulomb(time: Any, frequency: Any, start: Any, shift: Any) -> Any:
    """Mass and spring with dry friction F from ``start`` at rest, shift = F / k: half periods about +-shift, then rest.

    Every half period takes 2 shift from the amplitude, whatever the amplitude is.
    """
    half = 0.5 / frequency
    count = np.floor(time / half)
    amplitude = np.maximum(start - 2 * shift * count, 0)
    stopped = np.ceil((start - shift) / (2 * shift))
    sign = (-1) ** count
    moving = sign * ((amplitude - shift) * np.cos(2 * np.pi * frequency * (time - count * half)) + shift)
    rest = (-1) ** stopped * (start - 2 * shift * stopped)
    return np.where(count < stopped, moving, rest)


def two_modes(rate: Any, ratios: Any, duration: float = 1.0, noise: float = 0.0, seed: int = 0) -> tuple[Any, Any]:
    """The decay of the clamped link of [Mohan 2010, Table 2]: two modes released together, with white noise."""
    time = np.arange(round(duration * rate)) / rate
    values = sum(viscous(time, *mode) for mode in zip(MODES, ratios, AMPLITUDES, strict=True))
    return time, values + noise * np.random.default_rng(seed).standard_normal(len(time))
