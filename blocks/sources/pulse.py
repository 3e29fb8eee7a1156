"""One pulse, or a train of pulses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.sources.base import Source
from blocks.symbolic import choose, floor, least
from engine.block import option, parameter
from engine.ports import Expression
from engine.quantity import SameAs
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net


class Pulse(Source):
    """Pulses: out = offset + height while start + k period <= t < start + k period + width, else offset; k = 0, 1, ...

    ``count`` is the number of pulses, one by default; 0 means no end. The integration meets every edge exactly. Edges
    at or before t = 0 have happened when the simulation begins. The output has the unit of ``height``.
    """

    amount = "height"

    height = parameter("*", 1.0, "what a pulse adds, with its unit")
    start = parameter("s", 0.0, "instant at which the first pulse comes")
    width = parameter("s", ..., "duration of a pulse", gt=0)
    period = parameter("s", SameAs("width"), "time from one pulse to the next, needed when there are several", gt=0)
    count = option(int, 1, "number of pulses; 0 means without end", ge=0)

    def relations(self) -> Iterable[Relation]:
        """Pulses must not overlap."""
        remedy = "give a period longer than the width, or count: 1"
        return [Relation("period", "does not exceed", "width", remedy)] if self.values["count"] != 1 else []

    def stamp(self, net: Net) -> None:
        edges = 2 * self.count if self.count else float("inf")
        period = self.period if self.count != 1 else 2 * self.width
        elapsed = -self.start
        whole = floor(elapsed / period)
        passed = 2 * whole + 1 + (elapsed - whole * period >= self.width)
        past = choose(elapsed >= 0, least(passed, edges), 0)

        def following(count: Expression) -> Expression:
            edge = count + past
            pulse = floor(edge / 2)
            instant = self.start + pulse * period + (edge - 2 * pulse) * self.width
            return choose(edge < edges, instant, float("inf"))

        edge = net.time_event("edge", following) + past
        self.publish(net, (edge - 2 * floor(edge / 2)) * self.height)
