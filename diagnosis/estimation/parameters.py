"""The parameters that a fit may move, and what is known of them before: the prior.

A parameter moves in units of its declared tolerance, on a logarithmic scale where its bounds keep it positive. One that
may be absent, such as a loss, reaches zero: it moves linearly below its given value. The prior adds the square of that
distance to the cost: the tolerance is prior knowledge. A size of an effect has a wide prior of its own.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.thresholds import FITTING
from engine.model import Model

Array = NDArray[np.float64]
_NEARLY = 1 - 1e-12


@dataclass(frozen=True)
class FreeParameter:
    """A parameter that a fit may move.

    Attributes:
        name: of the model's parameter, or of a starting value.
        start: where it stands at first (SI).
        scale: change of the parameter per unit of the search variable: relative if ``logarithmic``, else in SI units.
        logarithmic: value = start * exp(scale * x) rather than start + scale * x.
        low, high: bounds (SI).
        may_vanish: a logarithmic one that is linear below ``start``, so that it can reach zero.
        prior: whether it is a parameter of the user's, with a tolerance.
        spread: standard deviation of the prior, in units of the search variable.
        centre: search variable at which the prior is centred.
        recording: for a starting value, the recording it belongs to.
        reach: how far from its start it can go at all (SI), for one that is measured; it gets there ever more slowly.
        like: parameter whose magnitude is expected to be equal, such as the other end of an amplifier's range. Of one
            that moves linearly: the two before it, the nearer first, on whose line it is expected, as in a curve.
        apart: standard deviation of the logarithm of the ratio to the one, or of the distance from the line (SI).
    """

    name: str
    start: float
    scale: float
    logarithmic: bool
    low: float = -math.inf
    high: float = math.inf
    may_vanish: bool = False
    prior: bool = True
    spread: float = 1.0
    centre: float = 0.0
    recording: str = ""
    like: tuple[str, ...] = ()
    apart: float = FITTING.alike
    reach: float = math.inf

    def value(self, x: float) -> float:
        """The parameter at search variable ``x``, kept within its bounds."""
        if not self.logarithmic:
            away = self.scale * x
            raw = self.start + (self.reach * math.tanh(away / self.reach) if math.isfinite(self.reach) else away)
        elif self.may_vanish and x < 0:
            raw = self.start * (1 + self.scale * x)
        else:
            raw = self.start * math.exp(min(max(self.scale * x, -50.0), 50.0))
        return min(max(raw, self.low), self.high)

    def slope(self, x: float) -> float:
        """Derivative of the parameter with respect to its search variable."""
        if not self.logarithmic:
            return self.scale / math.cosh(min(abs(self.scale * x / self.reach), 100.0)) ** 2
        return self.scale * (self.start if self.may_vanish and x < 0 else self.value(x))

    def position(self, value: float) -> float:
        """The search variable at which the parameter has ``value``."""
        if not self.logarithmic:
            away = value - self.start
            if math.isfinite(self.reach):
                away = self.reach * math.atanh(min(max(away / self.reach, -_NEARLY), _NEARLY))
            return away / self.scale
        share = value / self.start
        if self.may_vanish and share < 1:
            return (share - 1) / self.scale
        return math.log(max(share, 1e-300)) / self.scale

    @functools.cached_property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest search variable that stay within the bounds; infinite where there is none."""
        ends = [
            self.position(end) if math.isfinite(end) else math.copysign(math.inf, end) for end in (self.low, self.high)
        ]
        least, greatest = sorted(ends) if self.logarithmic and self.start < 0 else ends
        return (least, greatest) if least <= 0 <= greatest else (min(least, 0.0), max(greatest, 0.0))


def moved(free: Sequence[FreeParameter], x: Array, step: Array | Sequence[float], numbers: Sequence[int]) -> Array:
    """A search vector after a step of some of its variables, kept within their bounds."""
    there = x.copy()
    for i, change in zip(numbers, step, strict=True):
        low, high = free[i].ends
        there[i] = min(max(x[i] + change, low), high)
    return there


def sides(free: Sequence[FreeParameter], x: Array, distance: float, numbers: Sequence[int]) -> tuple[Array, Array]:
    """Search vectors at a distance to either side of ``x``, some variables moved, all of these by as much.

    Their signs are drawn, once and for all: the way leads along no one variable, and along no step of a fit, which may
    be one that changes nothing.
    """
    signs = np.random.default_rng(0).choice([-1.0, 1.0], len(numbers))
    step = distance * signs / max(len(numbers), 1) ** 0.5
    return moved(free, x, step, numbers), moved(free, x, -step, numbers)


def free_parameters(model: Model, tolerances: Mapping[str, float]) -> list[FreeParameter]:
    """Every parameter with a tolerance, that of ``tolerances`` or the declared one, moved in units of it."""
    rows = []
    for parameter in model.parameters:
        tolerance, (low, high) = parameter.declared.tolerance, parameter.declared.bounds
        tolerance = tolerances.get(parameter.name, tolerance)
        if not tolerance or parameter.value == 0.0:
            continue
        logarithmic = low >= 0 and parameter.value > 0
        scale = tolerance if logarithmic else tolerance * abs(parameter.value)
        may_vanish = logarithmic and parameter.declared.ge == 0
        rows.append(FreeParameter(parameter.name, parameter.value, scale, logarithmic, low, high, may_vanish))
    return rows


def prior(free: Sequence[FreeParameter], x: Array) -> tuple[Array, Array]:
    """Residual and Jacobian of the prior: a row for each parameter, and for each that is like others.

    Args:
        free: the parameters, n of them.
        x: search vector, shape (n,).

    Returns:
        Shapes (rows,) and (rows, n).
    """
    weights = np.array([1 / f.spread for f in free])
    r, J = weights * (x - np.array([f.centre for f in free])), np.diag(weights)
    place = {f.name: i for i, f in enumerate(free)}
    for i, f in enumerate(free):
        if f.like and all(name in place for name in f.like):
            others = [place[name] for name in f.like]
            shares = (1.0,) if f.logarithmic else (2.0, -1.0)
            row = np.zeros(len(x))
            row[[i, *others]] = f.scale, *(-share * free[j].scale for j, share in zip(others, shares, strict=True))
            if f.logarithmic:
                away = math.log(abs(f.start / free[others[0]].start))
            else:
                away = f.start - sum(share * free[j].start for j, share in zip(others, shares, strict=True))
            r, J = np.append(r, (away + row @ x) / f.apart), np.vstack([J, row / f.apart])
    return r, J
