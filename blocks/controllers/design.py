"""Designing state feedback and observers from linear models.

A linear model is what `engine.linearise.linearise` returns, a python-control state-space system, or a `Plant`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from blocks.controllers.control_systems import Matrix, Plant, plant
from blocks.controllers.observer import Observer
from blocks.controllers.state_feedback import StateFeedback
from engine.errors import ParameterError
from engine.files import json_text, writing
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
    _check_observer(made, gain)
    direct = {"D": made.D} if made.D.any() else {}
    return Observer(A=made.A, B=made.B, C=made.C, **direct, L=np.asarray(gain), period=made.period, **settings)


def save(
    file: str | Path,
    model: Any,
    *,
    feedback: Feedback | None = None,
    observer_gain: ArrayLike | None = None,
    reference_gain: ArrayLike | None = None,
    period: float = 0.0,
) -> Path:
    """Write a design as a .json file, from which `Observer` and `StateFeedback` read it; returns its path.

    Beside A, B, C, D and K, L, N it holds the period, and the names and units of states, inputs and outputs, by which
    the blocks refuse another period and swapped wires.

    Args:
        file: ends in .json.
        model: the linear model that was designed for.
        feedback: of `lqr`.
        observer_gain: L, shape (states, outputs), of `kalman` or another design.
        reference_gain: N, a number for each input.
        period: sample period (s); that of the feedback if 0.

    Raises:
        ParameterError: feedback or observer belong to another period or other states.
        FlexarmError: the file cannot be written.
    """
    if feedback is not None:
        if period and not math.isclose(period, feedback.period, rel_tol=1e-9):
            raise ParameterError(f"the feedback is {_sampled(feedback.period)}, not {_sampled(period)}")
        period = feedback.period
    made = plant(model, period)
    if feedback is not None and made.period != feedback.period:
        raise ParameterError(f"the feedback is {_sampled(feedback.period)}, and the model {_sampled(made.period)}")
    if feedback is not None and feedback.states != made.states:
        raise ParameterError(f"the feedback is one of {', '.join(feedback.states)}, not of {', '.join(made.states)}")
    content: dict[str, Any] = {name: getattr(made, name).tolist() for name in "ABCD"}
    if feedback is not None:
        content["K"] = feedback.gain.tolist()
    if observer_gain is not None:
        _check_observer(made, observer_gain)
        content["L"] = np.asarray(observer_gain, dtype=float).tolist()
    if reference_gain is not None:
        content["N"] = np.asarray(reference_gain, dtype=float).reshape(-1, 1).tolist()
    content |= {"dt": made.period, "states": made.states, "inputs": made.inputs, "outputs": made.outputs}
    content["units"] = dict(made.units)
    path = Path(file)
    with writing(path, (".json",)) as temporary:
        temporary.write_text(json_text(content, indent=1) + "\n", encoding="utf-8")
    return path


def _sampled(period: float) -> str:
    return f"sampled every {period:g} s" if period else "continuous"


def _same_period(what: str, own: float, settings: dict[str, Any]) -> None:
    """Take a period out of the settings that is the design's own.

    Raises:
        ParameterError: it is another.
    """
    given = settings.pop("period", own)
    if convert(given, "s") != own:
        raise ParameterError(f"{what} is {_sampled(own)}, not {_sampled(convert(given, 's'))}", remedy="design it anew")


def _check_observer(made: Plant, gain: ArrayLike) -> None:
    L = np.asarray(gain, dtype=float)
    wanted = (made.A.shape[0], made.C.shape[0])
    if L.shape != wanted:
        raise ParameterError(f"the observer's gain is {L.shape}, not {wanted}", remedy="states by outputs")
    poles = np.linalg.eigvals(made.A - L @ made.C)
    if (np.abs(poles) > 1 + 1e-9).any() if made.period else (poles.real > 1e-9 * np.abs(poles).max(initial=0)).any():
        raise ParameterError(
            f"the observer, {_sampled(made.period)}, is not stable with this gain",
            remedy="give the same period to kalman as here, 0 for a continuous observer",
        )


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
