"""A switch between two signals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.symbolic import choose
from engine.block import parameter, signal_in, signal_out
from engine.errors import ParameterError
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class Switch(SignalBlock):
    """Switch: out = on while control > threshold, else off; once on, it goes back below threshold - hysteresis.

    The instants of switching are located, and the integration restarts there. It begins as ``control`` says at the
    start; within the hysteresis it begins off. ``on``, ``off`` and ``out`` have one unit.
    """

    threshold = parameter("*", 0.0, "value of control above which the switch is on, with its unit")
    hysteresis = parameter("*", 0.0, "how far control must fall below the threshold to go off", ge=0)

    control = signal_in("*", "signal that decides")
    on = signal_in("*", "signal that passes while control is above")
    off = signal_in("*", "signal that passes else", like="on")
    out = signal_out("*", "what passes", like="on")

    def check(self) -> None:
        """Threshold and hysteresis are values of one signal."""
        super().check()
        units = {self.unit_of("threshold"), self.unit_of("hysteresis")} - {"*"}
        if len(units) > 1:
            raise ParameterError(
                f"threshold and hysteresis are in {' and '.join(sorted(units))}", remedy="use one unit"
            )

    def stamp(self, net: Net) -> None:
        over = self.control - self.threshold

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return choose(mode > 0, -over - self.hysteresis, over), -1

        mode = net.switch("position", ("none", "off", "on"), guards)
        self.publish(net, choose(mode > 0, self.on, self.off))
