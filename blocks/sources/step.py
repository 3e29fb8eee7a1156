"""A step, on from one instant to another."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.sources.base import NEVER, Source
from blocks.symbolic import choose
from engine.block import parameter
from engine.ports import Expression
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net


class Step(Source):
    """Step: out = offset + height while start <= t < stop, else offset.

    The integration meets both instants exactly. With ``start`` at or before 0 the step is on from the beginning. The
    output has the unit of ``height``.
    """

    amount = "height"

    height = parameter("*", 1.0, "what the step adds, with its unit")
    start = parameter("s", 0.0, "instant at which it comes")
    stop = parameter("s", NEVER, "instant at which it goes; 1e9 s means never")

    def relations(self) -> Iterable[Relation]:
        """The end of the step must come after its start."""
        return [Relation("stop", "is not after", "start")]

    def stamp(self, net: Net) -> None:
        past = (self.start <= 0) + (self.stop <= 0)

        def following(count: Expression) -> Expression:
            return choose(count + past < 1, self.start, choose(count + past < 2, self.stop, float("inf")))

        phase = net.time_event("phase", following) + past
        self.publish(net, choose(phase == 1, self.height, 0.0))
