"""A proportional-integral controller, continuous or sampled."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from engine.block import option, parameter, signal_in, signal_out
from engine.errors import ParameterError
from engine.quantity import compatible

if TYPE_CHECKING:
    from engine.net import Net


class PI(SignalBlock):
    """PI controller: out = kp e + ki x, x' = e, with the error e = reference - measurement.

    kp = proportional_gain, ki = integral_gain; x starts at ``start``. Transfer function (kp s + ki) / s.

    Sampled (``period`` T > 0): at each instant out = kp e + ki x, then x+ = x + T e (forward Euler); the output holds
    until the next instant. There is no anti-windup: the integral goes on while a limit behind the controller is
    reached. With kp in V.s/rad and ki in V/rad: [Gao J. n.d., sec. 3.6].
    """

    proportional_gain = parameter("*", ..., "gain kp on the error, with its unit", tolerance=0.2)
    integral_gain = parameter("*", 0.0, "gain ki on the integral of the error, with its unit", tolerance=0.2)
    start = parameter("*", 0.0, "integral of the error at the beginning")
    period = period()
    sample_offset = sample_offset()
    unit = option(str, "V", "coherent SI unit of the output")

    reference = signal_in("*", "what the measurement should be")
    measurement = signal_in("*", "what is measured, in the unit of the reference", like="reference")
    out = signal_out("*", "the command")

    def check(self) -> None:
        """Both gains must lead to one unit."""
        super().check()
        kp, ki = self.unit_of("proportional_gain"), self.unit_of("integral_gain")
        if "*" not in (kp, ki) and not compatible(kp, f"{ki}.s"):
            raise ParameterError(
                f"proportional_gain is in {kp} but integral_gain in {ki}",
                remedy="integral_gain is proportional_gain per second: for example 0.5 V.s/rad and 0.5 V/rad",
            )

    def stamp(self, net: Net) -> None:
        error = self.reference - self.measurement
        if self.period == 0:
            x = net.state("integral", "*", start=self.start, doc="integral of the error")
            net.derivative(x, error)
            out = self.proportional_gain * error + self.integral_gain * x
        else:
            x = net.memory("integral", "*", clock(net, self), start=self.start)
            net.update(x, x + self.period * error)
            out = net.memory("command", self.unit, clock(net, self), held=True)
            net.update(out, self.proportional_gain * error + self.integral_gain * x)
        self.publish(net, out, self.unit)
