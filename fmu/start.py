"""The initial state as expressions of the parameters, so that an importer may change them before initialization."""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.linalg

from engine.model import Model
from engine.ports import MOTION, Expression

_ORDERS = {name: order for kind in MOTION.values() for order, (name, _) in enumerate(kind[:2])}


def start_expression(model: Model) -> Expression:
    """States at the start as an expression of the parameters; see `engine.start.start_values` for the rule.

    Initial values of motions fix the coordinates in the least-squares sense; of values that repeat one another, as on
    tied flanges, an independent set at the default parameters is used.
    """
    e, n = model.equations, model.coordinates
    x = [e.start[i] for i in range(e.start.numel())]
    names = [state.name for state in model.states]
    transform, motions = e.transform, e.transform.size1()
    imposed = ca.Function("imposed", e.arguments, [e.imposed])(
        0, ca.vertcat(*x), ca.SX.zeros(e.u.numel()), e.memory_start, ca.SX.zeros(e.m.numel()), e.p
    )
    rows: dict[int, list[tuple[Expression, Expression]]] = {0: [], 1: []}
    for name, value in model.initial.items():
        flange, _, quantity = name.rpartition(".")
        if name in names and names.index(name) >= 2 * n:
            x[names.index(name)] = ca.SX(value)
        elif flange in model.motions and quantity in _ORDERS:
            order, row = _ORDERS[quantity], model.motions[flange]
            rows[order].append((transform[row, :], value - imposed[order * motions + row]))
        else:
            index = names.index(name)
            rows[index // n].append((ca.SX(ca.DM.eye(n)[index % n, :]), ca.SX(value)))
    for order, entries in rows.items():
        if entries:
            q = _least(model, ca.vertcat(*[row for row, _ in entries]), [value for _, value in entries])
            x[order * n : (order + 1) * n] = [q[i] for i in range(n)]
    return ca.densify(ca.vertcat(*x)) if x else ca.SX(0, 1)


def _least(model: Model, matrix: Expression, wanted: list[Expression]) -> Expression:
    """The smallest q with matrix q = wanted."""
    numbers = np.array(ca.Function("rows", [model.equations.p], [matrix])(model.parameter_values).full())
    _, r, order = scipy.linalg.qr(numbers.T, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(r))
    rank = int((sizes > 1e-12 * sizes.max(initial=1e-300)).sum())
    keep = sorted(int(k) for k in order[:rank])
    a, b = matrix[keep, :], ca.vertcat(*[wanted[k] for k in keep])
    return ca.densify(ca.mtimes(a.T, ca.solve(ca.mtimes(a, a.T), b)))
