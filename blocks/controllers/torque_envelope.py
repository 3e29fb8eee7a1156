"""What torque a drive gives at which speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.symbolic import by_mode, greatest, least, magnitude
from engine.block import parameter, signal_in, signal_out
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class TorqueEnvelope(SignalBlock):
    """Torque envelope: out' = (u - out) wb, u = the reference within +-T(w); T = least(Tp, P / |w|), 0 beyond wm.

    The servo motor and its current loop as a drive's data sheet gives them: peak torque Tp = peak_torque, the corner
    P / Tp beyond which the power P = peak_power is the limit (field weakening, or the voltage), and the greatest speed
    wm = speed_limit. Within 2 % of wm the torque that drives further falls to 0 in a straight line; the torque that
    brakes keeps Tp. wb = bandwidth of the current loop; the lag is 1 / wb. The limits' kinks are located.

    Connect out to a `Torque` on the rotor. A limit that is never reached does nothing. For the motor's own currents
    and voltages there are `PMSM` and `FieldOrientedController`.
    """

    peak_torque = parameter("N.m", ..., "greatest torque Tp", gt=0, tolerance=0.2)
    peak_power = parameter("W", 1e9, "greatest mechanical power P; 1e9 is none", gt=0, tolerance=0.3)
    speed_limit = parameter("rad/s", 1e9, "speed wm beyond which no torque drives; 1e9 is none", gt=0, tolerance=0.2)
    bandwidth = parameter("rad/s", ..., "bandwidth wb of the current loop", gt=0, tolerance=0.5)

    reference = signal_in("N.m", "torque that is asked for")
    speed = signal_in("rad/s", "speed of the motor's shaft w")
    out = signal_out("N.m", "torque that the drive gives")

    def _limit(self, along: Expression) -> Expression:
        """Greatest torque in a direction, for the speed in that direction."""
        fast = greatest(magnitude(along), self.peak_power / self.peak_torque)
        left = least(greatest((self.speed_limit - along) / (0.02 * self.speed_limit), 0.0), 1.0)
        # Power limits what drives alone; braking, the current does.
        return self.peak_torque * left * by_mode(along, 1.0, 1.0, self.peak_power / (self.peak_torque * fast))

    def stamp(self, net: Net) -> None:
        u, upper, lower = self.reference, self._limit(self.speed), -self._limit(-self.speed)

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, u - lower, u - upper, upper - u), by_mode(mode, -1, lower - u, -1)

        mode = net.switch("limit", ("below", "inside", "above"), guards)
        torque = net.state("torque", "N.m", doc="torque that the drive gives")
        net.derivative(torque, (by_mode(mode, lower, u, upper) - torque) * self.bandwidth)
        self.publish(net, torque, "N.m")
