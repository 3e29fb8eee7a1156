"""What recordings say of a model, for control design: the family, its weights and the bounds on held-out responses."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from engine.family import LinearFamily

if TYPE_CHECKING:
    import control

    from diagnosis.estimation.least_squares import Fit


@dataclass(frozen=True)
class Weight:
    """A stable, minimum-phase weight, gain (1 + s/z1) ... / ((1 + s/p1) ...).

    Attributes:
        signal: it stands on.
        zeros, poles: rad/s, as positive numbers.
        gain: at rest.
    """

    signal: str
    zeros: tuple[float, ...]
    poles: tuple[float, ...]
    gain: float

    def __call__(self, frequency: Any) -> Any:
        """Gain at frequencies (rad/s)."""
        s = 1j * np.asarray(frequency, dtype=float)
        value = np.full(s.shape, complex(self.gain))
        for z in self.zeros:
            value = value * (1 + s / z)
        for p in self.poles:
            value = value / (1 + s / p)
        return np.abs(value)

    def to_control(self) -> control.StateSpace:
        """As a python-control system."""
        import control

        top = np.poly1d([self.gain])
        for z in self.zeros:
            top = top * np.poly1d([1 / z, 1])
        bottom = np.poly1d([1.0])
        for p in self.poles:
            bottom = bottom * np.poly1d([1 / p, 1])
        return control.tf2ss(control.tf(top.coeffs, bottom.coeffs))


@dataclass(frozen=True)
class Band:
    """A held-out response and the bound predicted for it.

    Attributes:
        recording, signal, unit: what it is of.
        part: the part of the recording, from 0 to 1.
        frequency: rad/s, shape (k,).
        measured, predicted: amplitudes of the response, shape (k,).
        left: amplitude of measured - predicted, shape (k,).
        bound: on it, shape (k,); calibrated on other data.
        parametric: what the draws alone predict, shape (k,).
    """

    recording: str
    signal: str
    unit: str
    part: tuple[float, float]
    frequency: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    left: NDArray[np.float64]
    bound: NDArray[np.float64]
    parametric: NDArray[np.float64]

    @property
    def coverage(self) -> float:
        """Share of the bins whose response lies within the bound."""
        return float(np.mean(self.left <= self.bound))

    @property
    def coverage_excited(self) -> float:
        """The same over the bins in which the predicted response is within 40 dB of its peak."""
        there = self.predicted >= 0.01 * self.predicted.max()
        return float(np.mean((self.left <= self.bound)[there]))


@dataclass(frozen=True)
class UncertainModel:
    """What recordings say of a model, for control design.

    Attributes:
        nominal: number of the fitted model in the family: 0.
        family: linear models over ``sample``; the first is the fitted one.
        samples: parameter values of each, SI units.
        names: of the fitted parameters.
        covariance: of these parameters at the fit, to first order, SI units, shape (p, p).
        weights: unstructured uncertainty of each measured signal.
        bands: held-out responses with their bounds; each calibrated on other data.
        fit: the fit.
    """

    family: LinearFamily
    samples: tuple[dict[str, float], ...]
    names: tuple[str, ...]
    covariance: NDArray[np.float64]
    weights: dict[str, Weight]
    bands: tuple[Band, ...]
    fit: Fit = field(repr=False)
    nominal: int = 0

    @property
    def coverage(self) -> float:
        """Share of all bins of all held-out responses within their bounds; nan without held-out data."""
        bins = sum(len(band.frequency) for band in self.bands)
        return sum(band.coverage * len(band.frequency) for band in self.bands) / bins if bins else math.nan

    def to_control(self) -> tuple[Any, list[Any], dict[str, Any]]:
        """Nominal model, samples and weights, as python-control systems."""
        every = self.family.to_control()
        return every[0], list(every[1:]), {name: weight.to_control() for name, weight in self.weights.items()}
