"""The energy of a conservative model: what integration alone may change, and by how much it did."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from engine.casadi_lock import one_at_a_time
from engine.model import FRICTION, Model, Vector
from engine.simulate import Result
from engine.start import start_values

_ZERO = 1e-12


@dataclass(frozen=True)
class Conserved:
    """Kinetic and potential energy at the rows of a run to which nothing is supplied and in which nothing is lost.

    Attributes:
        start, end: energy at the first and last row (J).
        drift: farthest from the start (J).
    """

    start: float
    end: float
    drift: float


@one_at_a_time
def may_be_conservative(model: Model) -> bool:
    """Whether a model may keep its energy: no friction, sampled block or table, and a flow without divergence.

    It is quick to say; `conserved` decides.
    """
    if not model.coordinates or model.memories or model.tables or model.inputs or model.count(FRICTION):
        return False
    e = model.equations
    flow = ca.Function("divergence", e.arguments, [ca.trace(ca.jacobian(e.derivative, e.x))])
    x = start_values(model, model.parameter_values)
    arguments = (0, x, np.zeros(e.u.numel()), np.zeros(e.d.numel()), np.zeros(e.m.numel()), model.parameter_values)
    value = float(flow(*arguments))
    return abs(value) <= _ZERO


@one_at_a_time
def conserved(result: Result, books: Callable[[], Model]) -> Conserved | None:
    """The energy over a run with recorded states; None if the model is not conservative, or nothing is in motion.

    Args:
        result: of a model for which `may_be_conservative` is true, with ``record_states``.
        books: gives the same model with its energy balance; see `engine.assemble.build`.
    """
    if result.states is None or result.modes is None:
        return None
    model = books()
    e, n = model.equations, len(result.model.states)
    names = [output.name for output in model.outputs]
    p = model.parameter_vector({k: v for k, v in result.parameters.items() if k in {q.name for q in model.parameters}})
    if len(model.states) != n + 2 or "energy.stored" not in names:
        return None
    flows = ca.substitute(e.derivative[n:], e.p, ca.DM(p))
    if not flows.is_zero():
        return None
    stored = ca.Function("stored", e.arguments, [e.outputs[names.index("energy.stored")]])
    rows = len(result.time)
    x = np.vstack([result.states.T, np.zeros((2, rows))])
    u, d = np.zeros((e.u.numel(), rows)), np.zeros((e.d.numel(), rows))
    energy: Vector = np.array(
        stored(result.time[None, :], x, u, d, result.modes.T, np.tile(p[:, None], (1, rows))).full()
    ).ravel()
    if not np.ptp(result.states, axis=0).any():
        return None
    return Conserved(float(energy[0]), float(energy[-1]), float(np.abs(energy - energy[0]).max()))
