"""The controller inside hobby and robot servos."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from blocks.symbolic import by_mode, greatest, least
from engine.block import parameter, signal_in, signal_out
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class DutyServo(SignalBlock):
    """Duty-cycle servo: out = d V, d = kp (reference - measurement) - kd speed, held within +-D; V = supply voltage.

    kp = proportional_gain and kd = derivative_gain per radian of the output, D = duty_limit. A hobby servo, and robot
    servos in their position mode, put a share d of the battery's voltage on a DC motor: there is no current loop, and
    the motor's back-emf damps. A Dynamixel X with its firmware's gain Kp has kp = Kp * 4096 / (2 pi) / (256 * 885) per
    radian [Duclusaud 2025].

    Continuous, the kinks at +-D are located. Sampled (``period`` > 0) it reads at its instants and holds.
    """

    proportional_gain = parameter("1/rad", ..., "duty per error kp", gt=0, tolerance=0.2)
    derivative_gain = parameter("s/rad", 0.0, "duty per speed kd", ge=0, tolerance=0.5)
    duty_limit = parameter("1", 1.0, "greatest duty D", gt=0, le=1, tolerance=0.2)
    supply_voltage = parameter("V", ..., "supply voltage V; scaled by the input supply_share", gt=0, tolerance=0.1)
    period = period()
    sample_offset = sample_offset()

    reference = signal_in("rad", "angle that is asked for")
    measurement = signal_in("rad", "angle that is measured", like="reference")
    speed = signal_in("rad/s", "speed that is measured", default=0.0)
    supply_share = signal_in("1", "share of the supply voltage that is there", default=1.0)
    out = signal_out("V", "voltage at the motor d V")
    duty = signal_out("1", "duty d within its limits")

    def stamp(self, net: Net) -> None:
        error, most = self.reference - self.measurement, self.duty_limit
        asked = self.proportional_gain * error - self.derivative_gain * self.speed
        if self.period > 0:
            duty = net.memory("held", "1", clock(net, self), held=True)
            net.update(duty, least(greatest(asked, -most), most))
        else:

            def guards(mode: Expression) -> tuple[Expression, Expression]:
                return by_mode(mode, asked + most, asked - most, most - asked), by_mode(mode, -1, -most - asked, -1)

            mode = net.switch("limit", ("full reverse", "inside", "full forward"), guards)
            duty = by_mode(mode, -most, asked, most)
        net.output(self.duty, duty)
        self.publish(net, duty * self.supply_voltage * self.supply_share, "V")
