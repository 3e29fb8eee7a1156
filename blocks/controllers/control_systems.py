"""Linear models of the engine and of python-control as plants, and as blocks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from blocks.controllers.state_space import DiscreteStateSpace, StateSpace
from engine.errors import ParameterError

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Plant:
    """A linear model, sampled where ``period`` > 0 with its input held between the instants.

    Attributes:
        A, B, C, D: its matrices.
        period: sample period (s); 0 for a continuous one.
        states, inputs, outputs: names, where they are known.
        units: of the names.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    period: float = 0.0
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)


def plant(model: Any, period: float = 0.0) -> Plant:
    """A linear model as a `Plant`, sampled exactly for an input held over each period if one is given.

    Raises:
        ParameterError: the model is sampled with another period.
    """
    A, B, C, D = (np.atleast_2d(np.asarray(getattr(model, name), dtype=float)) for name in "ABCD")
    named: dict[str, Any] = {
        "states": tuple(model.state_labels if hasattr(model, "state_labels") else model.states),
        "inputs": tuple(model.input_labels if hasattr(model, "input_labels") else model.inputs),
        "outputs": tuple(model.output_labels if hasattr(model, "output_labels") else model.outputs),
        "units": dict(getattr(model, "units", {})),
    }
    own = float(getattr(model, "period", None) or getattr(model, "dt", None) or 0.0)
    if own:
        if period and not math.isclose(own, period, rel_tol=1e-9):
            raise ParameterError(f"the model is sampled with {own:g} s, not {period:g} s")
        return Plant(A, B, C, D, own, **named)
    if period:
        n, m = B.shape
        both = scipy.linalg.expm(np.block([[A, B], [np.zeros((m, n + m))]]) * period)
        A, B = both[:n, :n], both[:n, n:]
    return Plant(A, B, C, D, period, **named)


def from_control(system: Any, *, period: float = 0.0, **settings: Any) -> StateSpace | DiscreteStateSpace:
    """A block from a python-control system: state space, transfer function or zeros, poles and gain.

    Args:
        system: continuous, or sampled with ``dt`` in seconds.
        period: sample period (s) with which a continuous system is sampled exactly for a held input, or the one of a
            sampled system whose ``dt`` is True.
        settings: further parameters of the block, such as ``unit``.

    Raises:
        ParameterError: an improper system, or periods that contradict each other.
    """
    import control

    try:
        made = control.ss(system)
    except Exception as error:
        raise ParameterError(f"python-control cannot bring the system into state space: {error}") from error
    if made.dt is True:
        if not period:
            raise ParameterError("the system is sampled but does not say how often", remedy="give period")
        made = control.ss(made.A, made.B, made.C, made.D, period)
    found = plant(made, period)
    matrices = {"D": found.D, **({"A": found.A, "B": found.B, "C": found.C} if found.A.size else {})}
    if found.period:
        return DiscreteStateSpace(**matrices, period=found.period, **settings)
    return StateSpace(**matrices, **settings)


def in_words(period: float) -> str:
    """A sample period in words."""
    return f"sampled every {period:g} s" if period else "continuous"


def check_observer(made: Plant, gain: ArrayLike) -> None:
    """Refuse an observer that is not stable.

    Raises:
        ParameterError: that, or a gain of another shape.
    """
    L = np.asarray(gain, dtype=float)
    wanted = (made.A.shape[0], made.C.shape[0])
    if L.shape != wanted:
        raise ParameterError(f"the observer's gain is {L.shape}, not {wanted}", remedy="states by outputs")
    poles = np.linalg.eigvals(made.A - L @ made.C)
    if (np.abs(poles) > 1 + 1e-9).any() if made.period else (poles.real > 1e-9 * np.abs(poles).max(initial=0)).any():
        raise ParameterError(
            f"the observer, {in_words(made.period)}, is not stable with this gain",
            remedy="give the same period to kalman as here, 0 for a continuous observer",
        )
