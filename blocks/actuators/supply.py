"""The direct voltage that feeds drives."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import choose
from engine.block import Block, option, parameter, signal_in, signal_out
from engine.errors import ParameterError

if TYPE_CHECKING:
    from engine.net import Net


class Supply(Block):
    """Supply: C v' = (E - v) / R - i, v = bus voltage, i = current that the drives draw; E and R those of the source.

    E = source_voltage, R = resistance of source and wires, C = capacitance of the bus. With C = 0 the voltage is
    v = E - R i at once; what draws i must then not need v at once. Where T = time_constant is given instead, C = T / R.
    ``returns: false`` is a rectifier: it feeds the bus
    and takes nothing back, so that braking drives charge C until a `BrakeChopper` takes the power. With R = 0 ohm and
    C = 0 the bus is stiff.

    The source gives E (E - v) / R, the capacitor holds C v^2 / 2, the resistance takes the rest; v i goes to the
    drives, which count it as theirs. v starts at E.
    """

    returns = option(bool, True, "whether the source takes current back")
    source_voltage = parameter("V", ..., "voltage E of the source without load", gt=0, tolerance=0.1)
    resistance = parameter("ohm", 0.0, "resistance R of source and wires", ge=0, tolerance=0.5)
    capacitance = parameter("F", 0.0, "capacitance C of the bus; 0 leaves it out", ge=0, tolerance=0.3)
    time_constant = parameter("s", 0.0, "time constant T = R C of the bus, instead of C; 0 leaves it out", ge=0)

    current = signal_in("A", "current i that the drives draw, positive out of the bus")
    voltage = signal_out("V", "bus voltage v")
    source_current = signal_out("A", "current that the source gives")

    def check(self) -> None:
        """What cannot hold must be refused."""
        capacitance, time_constant = self.values["capacitance"] > 0, self.values["time_constant"] > 0
        if capacitance and time_constant:
            raise ParameterError(
                "capacitance and time_constant say the same in two ways",
                remedy="give one of them, and leave the other out",
            )
        if (capacitance or time_constant) and self.values["resistance"] == 0:
            raise ParameterError(
                "a capacitance needs a resistance between it and the source", remedy="give resistance, in ohm"
            )
        if not self.returns and not capacitance and not time_constant:
            raise ParameterError(
                "a bus that takes no current back needs a capacitance",
                remedy="give capacitance, in F, or returns: true",
            )

    def stamp(self, net: Net) -> None:
        source, resistance, drawn = self.source_voltage, self.resistance, self.current
        if not self.differs("capacitance") and not self.differs("time_constant"):
            given = drawn
            v = source - resistance * given
        else:
            v = net.state("bus.voltage", "V", start=source, doc="bus voltage")
            given = (source - v) / resistance
            if not self.returns:
                feeding = net.switch(
                    "rectifier",
                    ("none", "blocked", "feeding"),
                    lambda mode: (choose(mode > 0, v - source, source - v), -1),
                )
                given = choose(feeding > 0, given, 0.0)
            capacitance = self.time_constant / resistance if self.differs("time_constant") else self.capacitance
            net.derivative(v, (given - drawn) / capacitance)
            net.store(capacitance * v**2 / 2)
        net.supply(source * given - v * drawn)
        net.dissipate(resistance * given**2)
        net.output(self.voltage, v)
        net.output(self.source_current, given)
