"""Twists: the continuous states that Model Exchange shows in place of shaft angles and speeds.

An integrator holds each state to its relative tolerance times the state itself. The angle of a shaft that turns far
grows without bound, while the twist of the spring behind it stays small, so at a usual tolerance the twist drowns in
the error of two angles. So where shafts act on one another, the states that are shown are angle and speed of the first
one, and the twists of the others and their rates. The relation is linear and constant, and is undone at the FMU's
border: the model inside, its saved states and its results in Co-Simulation do not know of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from engine.model import FRICTION, Model, Vector

_WORD = {"angle": "twist", "position": "stretch"}
_ZERO = 1e-12


@dataclass(frozen=True)
class Twist:
    """One twist, or its rate: ``x[coordinate] + sum of coefficient * x[other]``, over the states x of the model.

    Attributes:
        name: path, such as ``contact.b.twist`` or ``contact.b.twist_rate``.
        coordinate: position of the state in whose place it is shown.
        terms: position of another state -> coefficient, at the default parameters.
        doc: the combination in words.
    """

    name: str
    coordinate: int
    terms: Mapping[int, float]
    doc: str

    def of(self, states: NDArray[np.float64]) -> Vector:
        """Its value in rows of states, shape (rows, states)."""
        found = states[:, self.coordinate].copy()
        for k, coefficient in self.terms.items():
            found += coefficient * states[:, k]
        return found


def twists(model: Model) -> tuple[Twist, ...]:
    """The twists of a model and their rates, each after those that its own terms are made of.

    Every combination by which bodies act on one another takes the place of one of its coordinates: of one that no
    friction holds if possible, and of the later one in the model's order. The speed of a coordinate that friction holds
    stays as it is: stuck, it must stand exactly still.
    """
    e = model.equations
    forms = ca.Function("twists", [e.p], [ca.densify(e.twists)])(model.parameter_values).full()
    stick = {mode.coordinate for mode in model.modes if mode.kind == FRICTION}
    chosen: dict[int, dict[int, float]] = {}
    for form in forms:
        support = [int(k) for k in np.flatnonzero(np.abs(form) > _ZERO)]
        if len(support) < 2:
            continue
        for pivot in sorted(support, key=lambda k: (k in stick, -k)):
            terms = {k: float(form[k] / form[pivot]) for k in support if k != pivot}
            if pivot not in chosen and not _reaches(chosen, terms, pivot):
                chosen[pivot] = terms
                break
    n = model.coordinates
    rates = {n + k: {n + j: c for j, c in terms.items()} for k, terms in chosen.items() if k not in stick}
    return tuple(_twist(model, k, (chosen | rates)[k]) for k in (*_ordered(chosen), *_ordered(rates)))


def _reaches(chosen: Mapping[int, Mapping[int, float]], start: Mapping[int, float], wanted: int) -> bool:
    """Whether what the coordinates of ``start`` are found from leads to ``wanted``."""
    waiting, seen = list(start), set[int]()
    while waiting:
        here = waiting.pop()
        if here == wanted:
            return True
        if here not in seen:
            seen.add(here)
            waiting += chosen.get(here, {})
    return False


def _ordered(chosen: Mapping[int, Mapping[int, float]]) -> list[int]:
    """The coordinates, each after those of its terms."""
    found: dict[int, None] = {}
    for first in chosen:
        waiting = [first]
        while waiting:
            here = waiting[-1]
            needed = [k for k in chosen[here] if k in chosen and k not in found]
            if needed:
                waiting += needed
                continue
            found[here] = None
            waiting.pop()
    return list(found)


def _twist(model: Model, k: int, terms: Mapping[int, float]) -> Twist:
    n, name = model.coordinates, model.states[k].name
    path, _, quantity = model.states[k % n].name.rpartition(".")
    words = [name]
    for j, coefficient in terms.items():
        size = "" if abs(coefficient) == 1 else f"{abs(coefficient):.9g} "
        words.append(f"{'-' if coefficient < 0 else '+'} {size}{model.states[j].name}")
    word = _WORD.get(quantity, "twist") + ("_rate" if k >= n else "")
    return Twist(f"{path}.{word}", k, terms, f"{' '.join(words)}; the state in place of {name}")
