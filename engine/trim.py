"""Equilibria: states, memories and inputs at which nothing changes, in modes that hold there.

Newton's method (scipy's trust region, within bounds) solves the equations of one set of modes at a time, so that stuck
and sliding are solved apart. Modes whose guards are violated at the solution change, and it is solved again. A machine
that turns steadily is an equilibrium too, a relative one: its rates lie along states on whose common change nothing
depends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from engine.errors import TrimError
from engine.linearise import Point
from engine.model import Model, Vector
from engine.trimming.kept import kept_states, same
from engine.trimming.modes import labels, solve
from engine.trimming.problem import Problem
from engine.trimming.starts import distance, further_solutions

__all__ = ["Equilibrium", "TrimError", "trim"]

TRIES = 12
"""Starts about the first one from which further equilibria are sought."""


@dataclass(frozen=True)
class Equilibrium:
    """Where nothing changes.

    Attributes:
        states: state and memory name -> value, SI units.
        inputs: input name -> value.
        outputs: output name -> value.
        modes: mode name -> label that holds there.
        turning: state name -> its steady rate, of states on which nothing depends.
        kept: state name -> why it stays where the search began: ``stuck``, or ``indifferent``: nothing depends on it.
        others: values of the states at further equilibria that the same search found, by name.
        units: name -> unit.
        point: the same as the engine's functions take it.
    """

    states: dict[str, float]
    inputs: dict[str, float]
    outputs: dict[str, float]
    modes: dict[str, str]
    turning: dict[str, float]
    kept: dict[str, str]
    others: tuple[dict[str, float], ...]
    units: dict[str, str]
    point: Point = field(repr=False)

    def arguments(self) -> dict[str, Any]:
        """As `engine.linearise.linearise` and `discretise` take it: ``at``, ``inputs``, ``modes``."""
        return {"at": dict(self.states), "inputs": dict(self.inputs), "modes": dict(self.modes)}


def trim(
    model: Model,
    *,
    at: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    fix: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    modes: Mapping[str, str] | None = None,
    parameters: dict[str, float] | None = None,
    tries: int = TRIES,
    seed: int = 0,
) -> Equilibrium:
    """Find an equilibrium; of several the one that Newton's method reaches from the start.

    Args:
        model: built with its inputs and outputs.
        at: where to begin: motions, states and memories by name, SI units; the rest as at the model's start.
        inputs: values of inputs, zero by default; those of ``free`` begin there.
        fix: values that motions, states, inputs or outputs must have.
        free: inputs that are searched for.
        bounds: state or free input -> least and greatest value.
        modes: mode name -> label, held whatever the guards say.
        parameters: values that replace the model's.
        tries: further starts, for other equilibria.
        seed: of these.

    Raises:
        ParameterError: a name or label that does not exist, bounds that hold nothing.
        TrimError: no equilibrium, one that no combination of modes has, or a continuum of them.
    """
    problem = Problem(
        model, dict(at or {}), dict(inputs or {}), dict(fix or {}), free, dict(bounds or {}), modes, parameters
    )
    random = np.random.default_rng(seed)
    further = list(further_solutions(problem, random, tries)) if problem.nonlinear else []
    try:
        found, there, jacobian = solve(problem, problem.start)
    except TrimError:
        if not further:
            raise
        # A start may be where Newton's method has no direction, as half way between hanging and standing.
        found, there, jacobian = min(further, key=lambda row: distance(problem, row[0]))
    kept = kept_states(problem, found, there, jacobian)
    others: list[Vector] = []
    for other, _, _ in further:
        if not any(same(problem, other, known, there) for known in (found, *others)):
            others.append(other)
    return _result(problem, found, there, kept, others)


def _result(problem: Problem, z: Vector, m: Vector, kept: dict[str, str], others: list[Vector]) -> Equilibrium:
    """What was found, with names."""
    model = problem.model
    x, d, _, u, slide = problem.unpack(z)
    names = [v.name for v in (*model.states, *model.memories)]
    y = np.array(model.functions["outputs"](problem.point.t, x, u, d, m, problem.p).full()).ravel()
    turning = problem.slides @ slide
    variables = (*model.states, *model.memories, *model.inputs, *model.outputs)
    point = Point(problem.point.t, x, u, d, m, problem.p)
    return Equilibrium(
        dict(zip(names, [*x.tolist(), *d.tolist()], strict=True)),
        dict(zip((v.name for v in model.inputs), u.tolist(), strict=False)),
        dict(zip((v.name for v in model.outputs), y.tolist(), strict=True)),
        {mode.name: label for mode, label in labels(model, m).items()},
        {n: float(r) for n, r in zip(names, turning, strict=False) if abs(r) > 1e-9},
        kept,
        tuple(dict(zip(names, other.tolist(), strict=False)) for other in others),
        {v.name: v.unit for v in variables},
        point,
    )
