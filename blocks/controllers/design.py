"""Designing state feedback and observers from linear models.

A linear model is what `engine.linearise.linearise` returns, a python-control state-space system, or a `Plant`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from blocks.controllers.control_systems import Matrix, Plant, check_observer, in_words, plant
from blocks.controllers.observer import Observer
from blocks.controllers.state_feedback import StateFeedback
from engine.errors import ParameterError
from engine.quantity import convert


@dataclass(frozen=True)
class Feedback:
    """A state feedback u = -K x.

    Attributes:
        gain: K, shape (inputs, states).
        cost: S, so that the cost from x is x' S x, shape (states, states).
        poles: of the closed loop (1/s, or in the z-plane).
        states: names of the states, in the order of the gain's columns.
        period: sample period (s); 0 for a continuous one.
    """

    gain: Matrix
    cost: Matrix
    poles: NDArray[np.complex128]
    states: tuple[str, ...] = ()
    period: float = 0.0

    def block(self, **settings: Any) -> StateFeedback:
        """A `StateFeedback` with this gain; ``settings`` are its further parameters.

        Raises:
            ParameterError: another period.
        """
        _same_period("the feedback", self.period, settings)
        return StateFeedback(gain=self.gain, period=self.period, **settings)


def lqr(model: Any, Q: ArrayLike, R: ArrayLike, *, period: float = 0.0) -> Feedback:
    """The feedback u = -K x that minimises the integral, or with a period the sum, of x' Q x + u' R u.

    Args:
        model: a linear model.
        Q: weight of the states, shape (n, n), or its diagonal; symmetric, not negative.
        R: weight of the inputs, shape (m, m), or its diagonal; symmetric, positive.
        period: sample period (s) of the controller; 0 for a continuous one.

    Raises:
        ParameterError: weights of the wrong shape or sign, or a plant that no such feedback stabilises.
    """
    made = plant(model, period)
    n, m = made.B.shape
    q, r = _weight("Q", Q, n, made.states), _weight("R", R, m, ())
    if np.linalg.eigvalsh(r).min() <= 0:
        raise ParameterError("R is not positive", remedy="give every input a weight above zero")
    if np.linalg.eigvalsh(q).min() < -1e-12 * np.abs(q).max():
        raise ParameterError("Q has a negative direction", remedy="give weights of zero or more")
    solve = scipy.linalg.solve_discrete_are if made.period else scipy.linalg.solve_continuous_are
    try:
        S = solve(made.A, made.B, q, r)
    except np.linalg.LinAlgError as error:
        raise _unstabilisable(made.states) from error
    if made.period:
        K = np.linalg.solve(r + made.B.T @ S @ made.B, made.B.T @ S @ made.A)
    else:
        K = np.linalg.solve(r, made.B.T @ S)
    poles = np.linalg.eigvals(made.A - made.B @ K).astype(complex)
    if (np.abs(poles) >= 1).any() if made.period else (poles.real >= 0).any():
        raise _unstabilisable(made.states)
    return Feedback(K, S, poles, made.states, made.period)


def kalman(model: Any, process: ArrayLike, noise: ArrayLike, *, period: float = 0.0) -> Matrix:
    """The gain L of the observer with the least variance, shape (states, outputs).

    Args:
        model: a linear model.
        process: intensity of the noise on the states (continuous) or its covariance per sample, (n, n) or its diagonal.
        noise: the same of the noise on the outputs, (p, p) or its diagonal.
        period: sample period (s) of the observer; 0 for a continuous one.

    Raises:
        ParameterError: as `lqr`.
    """
    made = plant(model, period)
    dual = Plant(made.A.T, made.C.T, made.B.T, made.D.T, made.period, made.states)
    return lqr(dual, process, noise).gain.T


def observer(model: Any, gain: ArrayLike, *, period: float = 0.0, **settings: Any) -> Observer:
    """An `Observer` of a linear model with a gain L, shape (states, outputs); ``settings`` are further parameters.

    Raises:
        ParameterError: an observer that is not stable, as with the gain of another period.
    """
    made = plant(model, period)
    check_observer(made, gain)
    direct = {"D": made.D} if made.D.any() else {}
    return Observer(A=made.A, B=made.B, C=made.C, **direct, L=np.asarray(gain), period=made.period, **settings)


def _same_period(what: str, own: float, settings: dict[str, Any]) -> None:
    """Take a period out of the settings that is the design's own.

    Raises:
        ParameterError: it is another.
    """
    given = settings.pop("period", own)
    if convert(given, "s") != own:
        raise ParameterError(f"{what} is {in_words(own)}, not {in_words(convert(given, 's'))}", remedy="design it anew")


def _weight(name: str, given: ArrayLike, n: int, states: Sequence[str]) -> Matrix:
    weight = np.asarray(given, dtype=float)
    weight = weight * np.eye(n) if weight.ndim == 0 else np.diag(weight) if weight.ndim == 1 else weight
    if weight.shape != (n, n) or not np.isfinite(weight).all() or not np.allclose(weight, weight.T):
        names = f": {', '.join(states)}" if states else ""
        raise ParameterError(f"{name} must be a symmetric {n} by {n} matrix, or {n} weights{names}")
    return weight


def _unstabilisable(states: Sequence[str]) -> ParameterError:
    named = f" ({', '.join(states)})" if states else ""
    return ParameterError(
        f"no feedback of these states{named} with these weights makes the plant stable",
        remedy="weight every unstable or free motion in Q, and leave out states that the inputs cannot move",
    )
