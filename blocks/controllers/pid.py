"""A proportional-integral-derivative controller with limits, continuous or sampled."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from blocks.symbolic import by_mode, choose, exp, greatest, least
from engine.block import option, parameter, signal_in, signal_out
from engine.errors import ParameterError
from engine.ports import Expression
from engine.quantity import compatible
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net

NEVER = 1e9
"""A limit that no command reaches: the default, since parameters are finite."""


class PID(SignalBlock):
    """PID controller: v = kp e + ki x + kd N (e - f), x' = e + w, f' = N (e - f), out = v within the limits.

    e = reference - measurement, kp, ki, kd the gains, N = derivative_corner, w the anti-windup, x(0) = start, f(0) = 0.
    With ``derivative_on: measurement`` the derivative acts on -measurement in place of e: a step of the reference then
    gives no kick. Transfer function without limits kp + ki / s + kd N s / (s + N).

    ``anti_windup: back_calculation`` leads the surplus back, w = (out - v) / (ki Tt), Tt = tracking_time. ``clamping``
    stops the integral, x' = 0, while v lies beyond a limit and the error drives it further. ``none`` lets it wind up.

    Sampled (``period`` T > 0): at each instant f+ = f + (1 - exp(-N T)) (e - f), the derivative is (f+ - f) / T, out is
    v within the limits, then x+ = x + T (e + w); out holds until the next instant. A large N gives (e - e before) / T.
    With ki = 0 there is no x, with kd = 0 no f, and that gain cannot be tuned afterwards. [Astrom 2006]
    """

    proportional_gain = parameter("*", ..., "gain kp on the error, with its unit", tolerance=0.2)
    integral_gain = parameter("*", 0.0, "gain ki on the integral of the error, with its unit", ge=0, tolerance=0.2)
    derivative_gain = parameter("*", 0.0, "gain kd on the derivative of the error, with its unit", tolerance=0.2)
    derivative_corner = parameter("rad/s", 100.0, "corner N of the derivative's filter", gt=0, tolerance=0.2)
    lower = parameter("*", -NEVER, "lower limit of the output; -1e9 means none")
    upper = parameter("*", NEVER, "upper limit of the output; 1e9 means none")
    tracking_time = parameter("s", 1.0, "time Tt in which back calculation discharges the integral", gt=0)
    start = parameter("*", 0.0, "integral of the error at the beginning")
    period = period()
    sample_offset = sample_offset()
    derivative_on = option(str, "error", "what is differentiated", choices=("error", "measurement"))
    anti_windup = option(
        str, "back_calculation", "what the integral does at a limit", choices=("back_calculation", "clamping", "none")
    )
    unit = option(str, "V", "coherent SI unit of the output")

    reference = signal_in("*", "what the measurement should be")
    measurement = signal_in("*", "what is measured, in the unit of the reference", like="reference")
    out = signal_out("*", "the command")
    unlimited = signal_out("*", "the command before the limits v")

    def relations(self) -> Iterable[Relation]:
        """The limits must leave room."""
        return [Relation("lower", "is not below", "upper")]

    def check(self) -> None:
        """The gains must lead to one unit."""
        super().check()
        kp = self.unit_of("proportional_gain")
        for name, power in (("integral_gain", "{}.s"), ("derivative_gain", "{}/s")):
            unit = self.unit_of(name)
            if "*" not in (kp, unit) and not compatible(kp, power.format(unit)):
                raise ParameterError(
                    f"proportional_gain is in {kp} but {name} in {unit}",
                    remedy="integral_gain is proportional_gain per second, derivative_gain proportional_gain times one",
                )
        if self.values["integral_gain"] == 0:
            self.values["anti_windup"] = "none"

    def stamp(self, net: Net) -> None:
        error = self.reference - self.measurement
        if self.period == 0:
            self._continuous(net, error)
        else:
            self._sampled(net, error)

    def _windup(self, surplus: Expression) -> Expression:
        """What is added to the error in the integral, of out - v."""
        return surplus / (self.integral_gain * self.tracking_time) if self.anti_windup == "back_calculation" else 0.0

    def _continuous(self, net: Net, error: Expression) -> None:
        integrates = self.differs("integral_gain")
        v = self.proportional_gain * error
        if integrates:
            x = net.state("integral", "*", start=self.start, doc="integral of the error")
            v += self.integral_gain * x
        if self.differs("derivative_gain"):
            source = error if self.derivative_on == "error" else -self.measurement
            f = net.state("filtered", "*", doc="filtered signal of the derivative")
            net.derivative(f, self.derivative_corner * (source - f))
            v += self.derivative_gain * self.derivative_corner * (source - f)
        out, rate = v, error
        if self.values["lower"] > -NEVER or self.values["upper"] < NEVER:
            lower, upper = self.lower, self.upper

            def limits(mode: Expression) -> tuple[Expression, Expression]:
                return by_mode(mode, v - lower, v - upper, upper - v), by_mode(mode, -1, lower - v, -1)

            def winding(mode: Expression) -> tuple[Expression, Expression]:
                stops = least(v - upper, error), least(lower - v, -error)
                goes = greatest(v - lower, error), greatest(upper - v, -error)
                return by_mode(mode, goes[0], stops[0], goes[1]), by_mode(mode, -1, stops[1], -1)

            out = by_mode(net.switch("limit", ("below", "inside", "above"), limits), lower, v, upper)
            if self.anti_windup == "clamping":
                held = net.switch("integral_held", ("below", "free", "above"), winding)
                rate = by_mode(held, 0, error, 0)
            rate += self._windup(out - v)
        if integrates:
            net.derivative(x, rate)
        self._give(net, out, v)

    def _sampled(self, net: Net, error: Expression) -> None:
        ticks = clock(net, self)
        integrates = self.differs("integral_gain")
        v = self.proportional_gain * error
        if integrates:
            x = net.memory("integral", "*", ticks, start=self.start)
            v += self.integral_gain * x
        if self.differs("derivative_gain"):
            source = error if self.derivative_on == "error" else -self.measurement
            f = net.memory("filtered", "*", ticks)
            change = (1 - exp(-self.derivative_corner * self.period)) * (source - f)
            net.update(f, f + change)
            v += self.derivative_gain * change / self.period
        out = least(greatest(v, self.lower), self.upper)
        rate = error + self._windup(out - v)
        if self.anti_windup == "clamping":
            further = ((v > self.upper) * (error > 0)) + ((v < self.lower) * (error < 0))
            rate = choose(further > 0, 0.0, error)
        if integrates:
            net.update(x, x + self.period * rate)
        command = net.memory("command", self.unit, ticks, held=True)
        wanted = net.memory("wanted", self.unit, ticks, held=True)
        net.update(command, out)
        net.update(wanted, v)
        self._give(net, command, wanted)

    def _give(self, net: Net, out: Expression, wanted: Expression) -> None:
        self.publish(net, out, self.unit)
        net.output("unlimited", wanted, self.unit, self.ports["unlimited"].doc)
