"""Dependencies of the equations by their sparsity, for ModelStructure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from engine.model import TIME, Model
from engine.ports import Expression
from fmu.start import start_expression
from fmu.twists import Twist

Pattern = NDArray[np.bool_]
Known = tuple[list[int], list[int], list[int]]
KINDS = ("constant", "tunable", "discrete", "dependent")
"""Kinds of dependence, the most constant first."""


@dataclass(frozen=True)
class Structure:
    """Dependencies, by position in the model, of states as they are shown: twists in the place of coordinates.

    Attributes:
        rates: for each state derivative, what it depends on: (kind of known, its position, kind of dependence). Knowns
            are ``state`` and ``input``; kinds are ``constant``, ``tunable``, ``discrete`` and ``dependent``.
        outputs: the same for each output.
        initial_states, initial_rates, initial_outputs: for each, positions of the (inputs, parameters, states) that
            its value at the start depends on; of states, those of the model with an exact start.
        exact: for each state whether its start is a number of its own, which no parameter changes.
    """

    rates: list[list[tuple[str, int, str]]]
    outputs: list[list[tuple[str, int, str]]]
    initial_states: list[Known]
    initial_rates: list[Known]
    initial_outputs: list[Known]
    exact: list[bool]


def _pattern(expression: Expression, symbols: Expression) -> Pattern:
    rows, columns = expression.numel(), symbols.numel()
    found = np.zeros((rows, columns), dtype=bool)
    if rows and columns:
        i, j = ca.jacobian_sparsity(expression, symbols).get_triplet()
        found[i, j] = True
    return found


def _along(a: Pattern, b: Pattern) -> Pattern:
    """The chain of two dependencies."""
    return np.asarray((a.astype(int) @ b.astype(int)) > 0)


def structure(model: Model, twists: Sequence[Twist] = ()) -> Structure:
    """The dependencies of a model with twists shown as states."""
    rates, outputs = _running(model)
    states, first_rates, first_outputs = _initial(model)
    exact = [not parameters for _, parameters, _ in states]
    made: dict[int, set[int]] = {k: {k} for k in range(len(model.states))}
    for twist in twists:  # the states that a coordinate is found from
        made[twist.coordinate] |= {j for k in twist.terms for j in made[k]}
    rates, outputs = ([_shown(row, made) for row in table] for table in (rates, outputs))
    for twist in reversed(twists):
        k, others = twist.coordinate, list(twist.terms)
        rates[k] = _merged([entry for j in (k, *others) for entry in rates[j]])
        for table in (states, first_rates):
            table[k] = _joined([table[j] for j in (k, *others)])
    return Structure(rates, outputs, states, first_rates, first_outputs, exact)


def _shown(row: list[tuple[str, int, str]], made: Mapping[int, set[int]]) -> list[tuple[str, int, str]]:
    """What a row depends on, with every coordinate replaced by the states that it is found from."""
    places = [(what, {j} if what == "input" else made[j], kind) for what, j, kind in row]
    return _merged([(what, k, kind) for what, found, kind in places for k in found])


def _merged(entries: Iterable[tuple[str, int, str]]) -> list[tuple[str, int, str]]:
    """One entry for each known, of the least constant kind."""
    found: dict[tuple[str, int], str] = {}
    for what, k, kind in entries:
        found[what, k] = max(found.get((what, k), kind), kind, key=KINDS.index)
    return [
        (what, k, kind)
        for (what, k), kind in sorted(found.items(), key=lambda entry: (entry[0][0] == "input", entry[0][1]))
    ]


def _joined(rows: Sequence[Known]) -> Known:
    inputs, parameters, states = (sorted({k for row in rows for k in row[part]}) for part in range(3))
    return inputs, parameters, states


def _running(model: Model) -> tuple[list[list[tuple[str, int, str]]], list[list[tuple[str, int, str]]]]:
    e = model.equations
    n, r = len(model.states), len(model.inputs)
    unknowns = ca.vertcat(e.derivative, e.outputs)
    rows: list[list[tuple[str, int, str]]] = [[] for _ in range(unknowns.numel())]
    knowns = ca.vertcat(e.x, e.u[:r])
    if not knowns.numel() or not unknowns.numel():
        return rows[:n], rows[n:]
    jacobian = ca.jacobian(unknowns, knowns)
    entries = ca.vertcat(*jacobian.nonzeros()) if jacobian.nnz() else ca.SX(0, 1)
    moving = _pattern(entries, ca.vertcat(e.t, e.x, e.u, e.d)).any(axis=1)
    switching, tuned = _pattern(entries, e.m).any(axis=1), _pattern(entries, e.p).any(axis=1)
    kinds = np.where(moving, "dependent", np.where(switching, "discrete", np.where(tuned, "tunable", "constant")))
    found = np.full((unknowns.numel(), n + r), "", dtype="<U9")
    i, j = jacobian.sparsity().get_triplet()
    found[i, j] = kinds
    # A clock that ticks at a communication point hands the inputs of that instant on through its memories.
    held = _along(_pattern(unknowns, e.d), _pattern(e.update, knowns))
    found[held & (found == "")] = "dependent"
    for row, line in zip(rows, found, strict=True):
        for k in map(int, np.flatnonzero(line != "")):
            row.append(("state", k, str(line[k])) if k < n else ("input", k - n, str(line[k])))
    return rows[:n], rows[n:]


def _initial(model: Model) -> tuple[list[Known], ...]:
    e = model.equations
    r, n_p, n = len(model.inputs), len(model.parameters), len(model.states)
    given = ca.vertcat(e.u[:r], e.p)
    start = ca.vertcat(start_expression(model))
    chosen = _pattern(start, e.p)
    exact = np.diag(~chosen.any(axis=1))
    x = np.hstack([np.zeros((n, r), dtype=bool), chosen, exact])
    d = np.hstack([np.zeros((e.d.numel(), r), dtype=bool), _pattern(e.memory_start, e.p), np.zeros((e.d.numel(), n))])
    d = d.astype(bool)
    switching = [k for k, mode in enumerate(model.modes) if mode.kind != TIME]

    def arrived(expression: Expression) -> Pattern:
        chain = _along(_pattern(expression, e.x), x) | _along(_pattern(expression, e.d), d)
        direct = np.hstack([_pattern(expression, given), np.zeros((expression.numel(), n), dtype=bool)])
        return np.asarray(direct | chain | _along(_pattern(expression, e.m), m))

    m = np.zeros((len(model.modes), r + n_p + n), dtype=bool)
    if switching:
        m[switching] = arrived(e.guards).any(axis=0)
    if any(clock.offset == 0 for clock in model.clocks):
        d = d | arrived(e.update)
    whole = (x, arrived(e.derivative), arrived(e.outputs))
    return tuple([_known(row, r, n_p) for row in table] for table in whole)


def _known(row: Pattern, inputs: int, parameters: int) -> Known:
    parts = np.split(row, [inputs, inputs + parameters])
    first, second, third = ([int(k) for k in np.flatnonzero(part)] for part in parts)
    return first, second, third
