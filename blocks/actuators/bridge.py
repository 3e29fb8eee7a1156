"""The bridge between a direct voltage and a motor, averaged over a switching period."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import by_mode
from engine.block import Block, parameter, signal_in, signal_out
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class Bridge(Block):
    """Averaged bridge: out = d V - Vd s(i) - Ron i, d = duty in -1 ... 1, V = supply voltage, i = the motor's current.

    Vd = V dead_time / switching_period is what the dead time between two switches of a leg takes from the mean voltage,
    against the current: s(i) = i / I0 within +-I0, 1 above and -1 below. I0 = ripple_current is half the ripple of the
    current: within it the current passes zero in every period and the losses of both directions cancel in part. Ron =
    on_resistance of the switches that the current flows through. The current that the bridge draws from the supply is
    d i. The kinks of d at +-1 and of s are located. [Jeong 1991]

    Because the voltage depends on the current at once, the motor needs an inductance while dead_time or on_resistance
    is above 0; with both 0 they are not in the equations. Connect the motor's current to ``current``. The power V d i
    enters at the bridge and out i goes on to the motor; the rest is lost.
    """

    dead_time = parameter("s", 0.0, "time for which both switches of a leg are open", ge=0, tolerance=0.5)
    switching_period = parameter("s", 50e-6, "time of a period of the pulse width modulation", gt=0)
    ripple_current = parameter("A", 0.05, "current I0 above which the whole dead time counts", gt=0, tolerance=0.5)
    on_resistance = parameter("ohm", 0.0, "resistance Ron of the switches that conduct", ge=0, tolerance=0.5)

    duty = signal_in("1", "share d of the supply voltage, -1 to 1; beyond it is held there")
    supply = signal_in("V", "supply voltage V")
    current = signal_in("A", "current of the motor i")
    out = signal_out("V", "voltage at the motor")
    supply_current = signal_out("A", "current that is drawn from the supply")

    def stamp(self, net: Net) -> None:
        i, v = self.current, self.supply

        def held(name: str, x: Expression, labels: tuple[str, str, str]) -> Expression:
            def guards(mode: Expression) -> tuple[Expression, Expression]:
                return by_mode(mode, x + 1, x - 1, 1 - x), by_mode(mode, -1, -1 - x, -1)

            return by_mode(net.switch(name, labels, guards), -1, x, 1)

        duty = held("modulation", self.duty, ("full reverse", "inside", "full forward"))
        out = duty * v
        if self.differs("dead_time"):
            lost = v * self.dead_time / self.switching_period
            out = out - lost * held("dead_time", i / self.ripple_current, ("negative", "within the ripple", "positive"))
        if self.differs("on_resistance"):
            out = out - self.on_resistance * i
        net.supply(duty * v * i - out * i)
        net.dissipate(duty * v * i - out * i)
        net.output(self.out, out)
        net.output(self.supply_current, duty * i)
