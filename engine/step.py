"""Choose the internal step from the fastest mode, with contacts closed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.model import FRICTION, SWITCH, Model, Vector

LIGHT = 0.005
"""Damping ratio below which a mode is lightly damped: it lasts for more than thirty cycles."""

DRIFT = 1e-3
"""Phase (rad) and share of the amplitude that a lightly damped mode may be off by at the end of a run."""

STEP_PER_RATE = 0.5
"""Internal step times the fastest rate; RK4 is stable up to 2.78, and loses 1e-4 of a cycle's phase at 0.5."""


@dataclass(frozen=True)
class StepRule:
    """How long an internal step may be, times the rate of a mode.

    Attributes:
        swinging: for modes that swing, or grow.
        dying: for modes that lose more in a cycle than they swing, Re < -|Im|. The faster such a mode, the sooner it
            stands where the slower ones put it: RK4 puts it there as well as long as it is stable.
    """

    swinging: float = STEP_PER_RATE
    dying: float = STEP_PER_RATE

    def longest(self, values: NDArray[np.complex128]) -> float:
        """The longest step (s) for modes of some eigenvalues (1/s)."""
        dies = values.real < -np.abs(values.imag)
        rates = ((self.swinging, np.abs(values[~dies])), (self.dying, np.abs(values[dies])))
        return min(share / float(column.max(initial=1e-300)) for share, column in rates)


FOLLOWED = StepRule()
"""All modes are followed in their course, as runs do."""

SAME = 1e-6
"""Rates and shares that differ by no more than this fraction are equal."""


@dataclass(frozen=True)
class Fastest:
    """The fastest mode of a model.

    Attributes:
        rate: |eigenvalue| (1/s), zero for a model without dynamics.
        state: the state that takes the largest part in it; the first of several that take the same part.
    """

    rate: float
    state: str


def fastest(model: Model, p: Vector, x: Vector, u: Vector | None = None) -> Fastest:
    """The fastest mode at ``x`` and inputs ``u``, joints sliding, over switches open and closed to either side."""
    found = Fastest(0.0, "")
    for values, vectors, matrix in _spectra(model, p, x, u):
        sizes = np.abs(values)
        rate = float(sizes.max())
        if rate > found.rate:
            shares = np.abs(vectors) * np.linalg.norm(matrix, axis=0)[:, None]
            # Which of several equal eigenvalues comes first, and which of equal shares is larger, is rounding.
            share = shares[:, sizes >= (1 - SAME) * rate].max(axis=1)
            lead = model.states[int(np.argmax(share >= (1 - SAME) * share.max()))].name
            found = Fastest(rate, found.state if found.state and rate <= (1 + SAME) * found.rate else lead)
    return found


def eigenvalues(model: Model, p: Vector, x: Vector, u: Vector | None = None) -> list[NDArray[np.complex128]]:
    """Eigenvalues (1/s) at ``x`` and inputs ``u``, joints sliding, with switches open, then closed to either side."""
    return [values for values, _, _ in _spectra(model, p, x, u)]


def _spectra(
    model: Model, p: Vector, x: Vector, u: Vector | None
) -> Iterator[tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]]:
    """Eigenvalues, eigenvectors and the Jacobian with switches open, then closed to either side."""
    e = model.equations
    inputs = np.zeros(e.u.numel()) if u is None else u
    for m in _modes(model):
        matrix = model.at("jacobian")(0.0, x, inputs, np.zeros(e.d.numel()), m, p)
        if not matrix.size or not np.isfinite(matrix).all():
            continue
        try:
            values, vectors = np.linalg.eig(matrix)
        except np.linalg.LinAlgError:  # numbers too large or too small; the run itself reports what fails
            continue
        yield values, vectors, matrix


def _modes(model: Model) -> list[list[float]]:
    """Modes with joints sliding: switches open, then closed to either side."""
    levels = (0.0, 1.0, -1.0) if model.count(SWITCH) else (0.0,)
    return [[{FRICTION: 1.0, SWITCH: level}.get(mode.kind, 0.0) for mode in model.modes] for level in levels]


def stiffest(model: Model, p: Vector, states: NDArray[np.float64]) -> Vector:
    """Of states that a run visits, shape (rows, states), the one where its rates are largest.

    That is told by the size of the Jacobian, since a spring that hardens or a contact that gives way adds to it.
    """
    e = model.equations
    inputs, memories, jacobian = np.zeros(e.u.numel()), np.zeros(e.d.numel()), model.at("jacobian")
    rates = (jacobian.along(states, 1, 0.0, states[0], inputs, memories, m, p) for m in _modes(model))
    sizes = [np.sqrt(np.einsum("ij,ij->i", rows, rows)) for rows in rates]
    # Where a rate is not finite it tells no step.
    known = np.nan_to_num(np.array(sizes), nan=0.0, posinf=0.0)
    return np.asarray(states[int(np.argmax(known.max(axis=0)))])


def lasting_step(values: NDArray[np.complex128], stop: float) -> float:
    """The longest step (s) with which each lightly damped mode keeps its phase and amplitude within `DRIFT`.

    RK4 turns a mode of rate w by z - z^5/120 instead of z = w h in each step, and shrinks it by z^6/144: the modulus
    and argument of its stability function, 1 + iz - z^2/2 - iz^3/6 + z^4/24. Over w t radians the phase is late by
    w t z^4/120, which counts for as much as is left of the mode, exp(-zeta w t); the loss of amplitude is smaller, by a
    factor of 0.83 z.

    Args:
        values: eigenvalues (1/s).
        stop: length of the run (s).
    """
    rate = np.abs(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        damping = np.where(rate > 0, -values.real / rate, 1.0)
        turns = np.minimum(rate * stop, np.where(damping > 0, 1 / (math.e * np.maximum(damping, 1e-300)), np.inf))
        light = (values.imag > 0) & (damping < LIGHT)
        steps = (120 * DRIFT / turns[light]) ** 0.25 / rate[light]
    return float(steps.min(initial=np.inf))


def internal_step(
    model: Model,
    p: Vector,
    x: Vector,
    step: float,
    stop: float | None = None,
    u: Vector | None = None,
    rule: StepRule = FOLLOWED,
) -> float:
    """A step (s) no longer than ``step``, and than a rule allows for the modes of the model.

    Given the length of the run (s), it also follows every lightly damped mode to its end; see `lasting_step`. Modes
    that there are only while a contact is closed are resolved, and not followed: they last no longer than the contact.
    """
    return step_for(eigenvalues(model, p, x, u), step, stop, rule)


def step_for(
    spectra: Sequence[NDArray[np.complex128]], step: float, stop: float | None = None, rule: StepRule = FOLLOWED
) -> float:
    """The same for eigenvalues that are known, as of `eigenvalues`."""
    found = min((step, *(rule.longest(values) for values in spectra)))
    if stop is not None and spectra:
        found = min(found, lasting_step(spectra[0], stop))
    return found


def following_step(model: Model, p: Vector, x: Vector, stop: float, u: Vector | None = None) -> float:
    """The longest step (s) that follows every lightly damped mode to the end of a run; infinite if there is none."""
    return next((lasting_step(values, stop) for values, _, _ in _spectra(model, p, x, u)), np.inf)
