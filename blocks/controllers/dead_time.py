"""What the dead time of a switching amplifier takes from the voltage of a motor."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.symbolic import by_mode
from engine.block import option, parameter, signal_in, signal_out
from engine.ports import Expression, Port

if TYPE_CHECKING:
    from engine.net import Net


class DeadTime(SignalBlock):
    """Dead time of a bridge: out = u - Vd s(i), s(i) = i / I0 within +-I0, 1 above and -1 below.

    u is the command, Vd = lost_voltage = supply voltage times dead time / switching period, and I0 = ripple_current is
    half the ripple of the current, as in `Bridge` [Jeong 1991]. The loss acts against the current, not against the
    speed: it takes torque from a motor that drives and from one that brakes. The two kinks are located.

    It stands before a `DCMotor`, with the motor's R and km (back_emf_constant), and its input ``speed`` reads the
    speed w of its shaft. Without inductance the current is i = (out - km w) / R, and the law is solved for it: with
    e = u - km w, out = u - e Vd / (Vd + R I0) within |e| <= Vd + R I0, u - Vd above, u + Vd below. With ``inductance``
    an input ``current`` in place of ``speed`` reads that of the motor; R and km then have no meaning.
    """

    lost_voltage = parameter("V", ..., "voltage Vd that the dead time takes against the current", gt=0, tolerance=0.5)
    ripple_current = parameter("A", 0.05, "current I0 above which all of it is lost", gt=0, tolerance=0.5)
    resistance = parameter("ohm", ..., "winding resistance R of the motor", gt=0, tolerance=0.15)
    back_emf_constant = parameter("V.s/rad", ..., "voltage per speed km of the motor", ge=0, tolerance=0.15)
    inductance = option(bool, False, "whether the motor has an inductance: then its current is read")

    input = signal_in("V", "voltage u that is commanded", name="in")
    out = signal_out("V", "voltage at the motor")

    def further_ports(self) -> Iterable[Port]:
        """What the current is told by."""
        if self.inductance:
            yield Port("current", "input", "current of the motor i", unit="A")
        else:
            yield Port("speed", "input", "speed of the motor's shaft w", unit="rad/s")

    def stamp(self, net: Net) -> None:
        u, lost, knee = self.input, self.lost_voltage, self.ripple_current
        if self.inductance:
            x = self.port("current")
            end, within = knee, x * lost / knee
        else:
            x, room = u - self.back_emf_constant * self.port("speed"), self.resistance * knee
            end, within = lost + room, x * lost / (lost + room)

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, x + end, x - end, end - x), by_mode(mode, -1, -end - x, -1)

        mode = net.switch("dead_time", ("negative", "within the ripple", "positive"), guards)
        self.publish(net, u - by_mode(mode, -lost, within, lost), "V")
