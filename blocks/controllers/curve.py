"""A measured characteristic of a signal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.symbolic import polyline
from engine.block import option, parameter, signal_in, signal_out
from engine.errors import ParameterError
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net


class Curve(SignalBlock):
    """Characteristic: out = in + f(in), f straight lines through ``heights`` at equal distances from lower to upper.

    Beyond the ends f is constant. It is for a law that was measured and has no formula, as of an amplifier or a valve.
    """

    points = option(int, 9, "how many values", ge=2, le=200)
    lower = parameter("*", ..., "abscissa of the first value, with its unit")
    upper = parameter("*", ..., "abscissa of the last value, with its unit")
    heights = parameter("*", 0.0, "what is added to the signal at each abscissa, in its unit", size="points")

    input = signal_in("*", "signal", name="in")
    out = signal_out("*", "the signal and what the characteristic adds")

    def relations(self) -> Iterable[Relation]:
        """The abscissas must rise."""
        return [Relation("lower", "is not below", "upper")]

    def check(self) -> None:
        """All must be in the unit of the signal."""
        super().check()
        given = {name: self.unit_of(name) for name in ("lower", "upper", "heights")}
        if len({unit for unit in given.values() if unit != "*"}) > 1:
            stated = ", ".join(f"{name} in {unit}" for name, unit in given.items() if unit != "*")
            raise ParameterError(f"{stated}: all are values of one signal", remedy="give them in its unit")

    def stamp(self, net: Net) -> None:
        added = polyline(self.input, self.lower, self.upper, [self.heights[k] for k in range(self.points)])
        self.publish(net, self.input + added)
