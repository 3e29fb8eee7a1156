"""The resistor that takes what braking drives return."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.symbolic import choose
from engine.block import Block, parameter, signal_in, signal_out
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net


class BrakeChopper(Block):
    """Brake chopper: i = v / R from the instant the bus voltage v exceeds switch_on until it falls below switch_off.

    R = resistance of the brake resistor. Its current is added to that of the drives at the `Supply`; the power v^2 / R
    is lost. Both instants are located. With a time constant R C far below the step between the two voltages' crossings
    the chopper switches often; events then cost time.
    """

    resistance = parameter("ohm", ..., "resistance R of the brake resistor", gt=0, tolerance=0.2)
    switch_on = parameter("V", ..., "bus voltage above which it takes current", gt=0, tolerance=0.1)
    switch_off = parameter("V", ..., "bus voltage below which it stops", gt=0, tolerance=0.1)

    voltage = signal_in("V", "bus voltage v")
    current = signal_out("A", "current i that the resistor takes")

    def relations(self) -> Iterable[Relation]:
        """It must stop below where it begins."""
        return [Relation("switch_off", "is not below", "switch_on")]

    def stamp(self, net: Net) -> None:
        v = self.voltage
        braking = net.switch(
            "chopper",
            ("none", "off", "on"),
            lambda mode: (choose(mode > 0, self.switch_off - v, v - self.switch_on), -1),
        )
        current = choose(braking > 0, v / self.resistance, 0.0)
        net.supply(v * current)
        net.dissipate(v * current)
        net.output(self.current, current)
