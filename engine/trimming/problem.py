"""What a trim problem asks: its unknowns, where they begin, their bounds, and the values that are fixed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from engine.casadi_lock import one_at_a_time
from engine.errors import ParameterError, nearest
from engine.linearise import operating_point
from engine.model import FRICTION, Equations, Model, Vector
from engine.ports import MOTION
from engine.trimming.indifferent import indifferent

_ORDERS = {name: order for kind in MOTION.values() for order, (name, _) in enumerate(kind[:2])}


class Problem:
    """A trim problem; unknowns z: states, memories, stages of delay lines, free inputs, slides.

    Attributes:
        model: the model.
        asked: modes that are held whatever the guards say.
        fix: values that states, motions or outputs must have, by name.
        targets: the same as equations: what is fixed, its place, the value.
        point: where the search begins, with the inputs that are given.
        p: parameters.
        n, n_d: numbers of states and of memories.
        free: places of the free inputs among the inputs.
        lines: the delay line of each stage.
        slides: directions of the states on which nothing depends, shape (n, k).
        start, low, high: of the unknowns.
        function: rates, outputs, memories and entries of delay lines, then the slopes of each.
    """

    def __init__(
        self,
        model: Model,
        at: dict[str, float],
        inputs: dict[str, float],
        fix: dict[str, float],
        free: Sequence[str],
        bounds: dict[str, tuple[float, float]],
        modes: Mapping[str, str] | None,
        parameters: dict[str, float] | None,
    ) -> None:
        if model.externals:
            raise ParameterError(
                f"'{model.externals[0].name}' is a Python function, whose memory has no equation",
                remedy="trim the plant without it: name its outputs as inputs",
            )
        self.model, names = model, [v.name for v in model.inputs]
        for name in free:
            if name not in names:
                raise ParameterError(f"'{name}' is not an input that can be free", remedy=nearest(name, names))
            if name in fix:
                raise ParameterError(f"'{name}' is both fixed and free", remedy="give one of the two")
        inputs |= {name: fix[name] for name in fix if name in names}
        self.asked = dict(modes or {})
        self.fix = {name: value for name, value in fix.items() if name not in names}
        states = [v.name for v in (*model.states, *model.memories)]
        begin = at | {k: v for k, v in self.fix.items() if k in states or k.rpartition(".")[0] in model.motions}
        begin = {k: v for k, v in begin.items() if k not in [o.name for o in model.outputs] or k in states or k in at}
        try:
            self.point = operating_point(model, at=begin, inputs=inputs, modes=self.asked, parameters=parameters)
        except ParameterError:
            if begin == at:
                raise
            self.point = operating_point(model, at=at, inputs=inputs, modes=self.asked, parameters=parameters)
        self.p, self.n, self.n_d = self.point.p, len(model.states), len(model.memories)
        self.free = [names.index(name) for name in free]
        self.lines = [line for line in model.lines for _ in line.stages]
        self.slides = indifferent(model, self.p)
        self.targets = [self._target(name, value) for name, value in self.fix.items()]
        reads = [float(self.point.d[line.memories[k]]) for line in model.lines for k in range(len(line.stages))]
        self.start = np.concatenate(
            [self.point.x, self.point.d, reads, self.point.u[self.free], np.zeros(self.slides.shape[1])]
        )
        self.low, self.high = np.full(len(self.start), -np.inf), np.full(len(self.start), np.inf)
        self._bound(bounds, names)
        self.function = model.derived("trim", _with_slopes, fire=True)

    def _bound(self, bounds: dict[str, tuple[float, float]], names: list[str]) -> None:
        places = {v.name: i for i, v in enumerate((*self.model.states, *self.model.memories))}
        first = self.n + self.n_d + len(self.lines)
        places |= {names[j]: first + k for k, j in enumerate(self.free)}
        for name, (low, high) in bounds.items():
            if name not in places:
                hint = "it is given, not searched: name it as free" if name in names else nearest(name, places)
                raise ParameterError(f"'{name}' cannot be bounded", remedy=hint)
            if not low < high:
                raise ParameterError(f"the bounds of '{name}' hold nothing: {low:g} is not below {high:g}")
            i = places[name]
            self.low[i], self.high[i] = low, high
            if not low <= self.start[i] <= high:
                self.start[i] = (low + high) / 2 if math.isfinite(low + high) else min(max(self.start[i], low), high)

    def _target(self, name: str, value: float) -> tuple[str, Any, float]:
        """A fixed value as an equation: of an output, a motion, or a state."""
        model = self.model
        states = [v.name for v in (*model.states, *model.memories)]
        flange, _, quantity = name.rpartition(".")
        outputs = [v.name for v in model.outputs]
        if name in states:
            return "state", states.index(name), value
        if name in outputs:
            return "output", outputs.index(name), value
        if flange in model.motions and quantity in _ORDERS:
            return "motion", (model.motions[flange], _ORDERS[quantity]), value
        known = [*states, *outputs, *(v.name for v in model.inputs)]
        raise ParameterError(f"'{name}' is no state, motion, input or output of the model", remedy=nearest(name, known))

    @property
    @one_at_a_time
    def nonlinear(self) -> bool:
        """Whether the rates are other than linear, or modes may change."""
        e = self.model.equations
        both = ca.vertcat(e.x, e.u, e.d)
        return bool(self.model.modes) or bool(ca.depends_on(ca.jacobian(e.derivative, both), both))

    def unpack(self, z: Vector) -> tuple[Vector, Vector, Vector, Vector, Vector]:
        """States, memories, what delay lines give, inputs, slides."""
        a, b = self.n, self.n + self.n_d
        c = b + len(self.lines)
        d = c + len(self.free)
        u = self.point.u.copy()
        u[self.free] = z[c:d]
        return z[:a], z[a:b], z[b:c], u, z[d:]

    def stuck(self, m: Vector) -> list[int]:
        """Coordinates of the joints that are stuck."""
        return [
            mode.coordinate for mode, v in zip(self.model.modes, m, strict=True) if mode.kind == FRICTION and v == 0
        ]


def _with_slopes(e: Equations) -> list[Any]:
    parts = [e.derivative, e.outputs, e.update, e.entering]
    slopes = [ca.densify(ca.jacobian(f, s)) for f in parts for s in (e.x, e.d, e.fire, e.u)]
    return [*(ca.densify(f) for f in parts), *slopes]
