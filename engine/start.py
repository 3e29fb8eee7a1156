"""Where a simulation starts."""

from __future__ import annotations

import numpy as np

from engine.errors import ParameterError, nearest
from engine.model import Model, Vector
from engine.ports import MOTION

_ORDERS = {name: order for kind in MOTION.values() for order, (name, _) in enumerate(kind[:2])}


def starting_names(model: Model) -> list[str]:
    """Every name that may be given a starting value: states, and the motions of flanges."""
    motions = [f"{flange}.{quantity}" for flange in model.motions for quantity in _ORDERS]
    return list(dict.fromkeys([*(state.name for state in model.states), *motions]))


def start_values(model: Model, p: Vector, initial: dict[str, float] | None = None) -> Vector:
    """States at the start.

    Args:
        model: the model.
        p: parameter vector.
        initial: values by name, over the model's own: a motion such as ``link.hub.angle``, or a state. Where all states
            are given, the model's own do not count.

    Returns:
        x, shape (states,). Coordinates that no name fixes start at rest at zero, in the least-squares sense.

    Raises:
        ParameterError: unknown name, or values that contradict each other.
    """
    whole = bool(initial) and all(state.name in (initial or {}) for state in model.states)
    given = {**({} if whole else model.initial), **(initial or {})}
    x = model.at("start")(p).ravel()
    if not given:
        return x
    names = [state.name for state in model.states]
    n = model.coordinates
    transform = model.at("transform")(p)
    offset = _imposed(model, p, x)
    rows: dict[int, list[tuple[Vector, float, str]]] = {0: [], 1: []}
    for name, value in given.items():
        flange, _, quantity = name.rpartition(".")
        if name in names and names.index(name) >= 2 * n:
            x[names.index(name)] = value
        elif flange in model.motions and quantity in _ORDERS:
            order, row = _ORDERS[quantity], model.motions[flange]
            rows[order].append((transform[row], value - offset[order][row], name))
        elif name in names:
            index = names.index(name)
            rows[index // n].append((np.eye(n)[index % n], value, name))
        else:
            raise ParameterError(f"initial value for unknown '{name}'", remedy=nearest(name, starting_names(model)))
    for order, entries in rows.items():
        if entries:
            matrix = np.array([row for row, _, _ in entries])
            wanted = np.array([value for _, value, _ in entries])
            q = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
            wrong = np.abs(matrix @ q - wanted) > 1e-9 * (1 + np.abs(wanted))
            if wrong.any():
                worst = int(np.argmax(wrong))
                culprit = entries[worst][2]
                tied = [name for row, _, name in entries if name != culprit and np.any(row * entries[worst][0])]
                raise ParameterError(
                    f"initial value of '{culprit}' contradicts {' and '.join(repr(name) for name in tied)}",
                    remedy="motions that are tied need values that match: give one of them",
                    signal=culprit,
                )
            x[order * n : (order + 1) * n] = q
    return x


def _imposed(model: Model, p: Vector, x: Vector) -> Vector:
    """Angles and speeds that impositions add at time 0, shape (2, motions)."""
    e = model.equations
    u, d, m = np.zeros(e.u.numel()), model.at("memory_start")(p), np.zeros(e.m.numel())
    return model.at("imposed")(0.0, x, u, d, m, p).reshape(2, -1)
