"""A point-to-point motion of fourth order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from blocks.symbolic import choose, select
from engine.block import Block, option, parameter, signal_out
from engine.errors import ParameterError
from engine.quantity import coherent, compatible

if TYPE_CHECKING:
    from engine.net import Net

_ORDERS = ("position", "velocity", "acceleration", "jerk", "snap")


class Trajectory(Block):
    """Fourth-order motion: snap +-s or 0, piecewise, from a start to an end state under limits v, a, j and s.

    s = snap_limit bounds the fourth derivative of the position, j = jerk_limit the third, and so on. With ``profile:
    trapezoidal`` the jerk may stay at its limit, with ``triangular`` it may not. From rest to rest over D with all four
    limits met at once, D = v T / 2 = a T^2 / 8 = j T^3 / 64 = s T^4 / 512. The motion is the shortest of those whose
    acceleration and jerk are zero wherever the velocity peaks; see `trajectory_planner`.

    The motion begins at ``start``; the integration meets every change of snap exactly. Before it and after it the
    velocity stays as it is at that end. The motion is planned when the model is built, so its parameters cannot be
    tuned afterwards. All values have the unit of the positions, per s, s2, s3 and s4. [Gao J. n.d., secs. 3.2, 3.5]
    """

    profile = option(str, "trapezoidal", "shape of the pulses of jerk", choices=("trapezoidal", "triangular"))
    start_position = parameter("*", 0.0, "position at the start, with its unit", structural=True)
    end_position = parameter("*", ..., "position at the end, with its unit", structural=True)
    velocity_limit = parameter("*", ..., "largest velocity v", gt=0, structural=True)
    acceleration_limit = parameter("*", ..., "largest acceleration a", gt=0, structural=True)
    jerk_limit = parameter("*", ..., "largest jerk j", gt=0, structural=True)
    snap_limit = parameter("*", ..., "largest snap s", gt=0, structural=True)
    start_velocity = parameter("*", 0.0, "velocity at the start", structural=True)
    end_velocity = parameter("*", 0.0, "velocity at the end", structural=True)
    start_acceleration = parameter("*", 0.0, "acceleration at the start", structural=True)
    end_acceleration = parameter("*", 0.0, "acceleration at the end", structural=True)
    start_jerk = parameter("*", 0.0, "jerk at the start", structural=True)
    end_jerk = parameter("*", 0.0, "jerk at the end", structural=True)
    start = parameter("s", 0.0, "instant at which the motion begins")

    position = signal_out("*", "position")
    velocity = signal_out("*", "velocity")
    acceleration = signal_out("*", "acceleration")
    jerk = signal_out("*", "jerk")
    snap = signal_out("*", "snap")

    def check(self) -> None:
        """All values must measure derivatives of one position, and the motion must be possible."""
        from blocks.sources.motion_profile import Limits, State
        from blocks.sources.trajectory_planner import plan

        self._unit = self._position_unit()
        ends = [State(*(self.values[f"{end}_{order}"] for order in _ORDERS[:4])) for end in ("start", "end")]
        limits = Limits(*(self.values[f"{order}_limit"] for order in _ORDERS[1:]))
        try:
            with np.errstate(all="ignore"):
                self.motion = plan(ends[0], ends[1], limits, triangular=self.values["profile"] == "triangular")
            computed = bool(np.isfinite(self.motion.instants).all() and np.isfinite(self.motion.states).all())
        except (ArithmeticError, RuntimeError):  # beyond the range of numbers, or a root not found within it
            computed = False
        if not computed:
            raise ParameterError(
                "the motion cannot be computed: a limit is out of all proportion to the others or to the distance",
                remedy="check the units of the limits",
            )

    def _position_unit(self) -> str:
        """Unit of the position, from whatever value has one; ``*`` if none has."""
        found, first = "*", ""
        for name in type(self).parameters:
            unit, order = self.unit_of(name), name.split("_")[-2 if name.endswith("_limit") else -1]
            if unit == "*" or order not in _ORDERS:
                continue
            power = _ORDERS.index(order)
            made = coherent(f"{unit}.s{power}")[1] if power else unit
            if found == "*":
                found, first = made, name
            elif not compatible(made, found):
                wanted = f"{found}/s{power if power > 1 else ''}" if power else found
                raise ParameterError(f"{name} is in {unit}, which does not fit {first}", remedy=f"give it in {wanted}")
        return found

    def stamp(self, net: Net) -> None:
        motion, last = self.motion, len(self.motion.snap) + 1
        instants = [float(t) for t in motion.instants]
        # Phase 0 comes before the motion, phase k is segment k, and the last comes after it.
        begin = [0.0, *instants]
        rows = [[*map(float, row), float(snap)] for row, snap in zip(motion.states[:-1], motion.snap, strict=True)]
        outside = [[*map(float, motion.states[k, :2]), 0.0, 0.0, 0.0] for k in (0, -1)]
        rows = [outside[0], *rows, outside[1]]

        phase = net.time_event(
            "phase", lambda k: choose(k < last, self.start + select(k, [*instants, float("inf")]), float("inf"))
        )
        t = net.time - self.start - select(phase, begin)
        p, v, a, j, s = (select(phase, [row[order] for row in rows]) for order in range(5))
        values = (
            p + t * (v + t * (a / 2 + t * (j / 6 + t * s / 24))),
            v + t * (a + t * (j / 2 + t * s / 6)),
            a + t * (j + t * s / 2),
            j + t * s,
            s,
        )
        for order, (name, value) in enumerate(zip(_ORDERS, values, strict=True)):
            unit = self._unit if order == 0 or self._unit == "*" else coherent(f"{self._unit}/s{order}")[1]
            net.output(name, value, unit, type(self).ports[name].doc)
