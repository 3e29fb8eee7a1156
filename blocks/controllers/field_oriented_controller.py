"""Current control of a synchronous motor in rotor coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import by_mode, greatest, least, magnitude, sqrt
from engine.block import Block, option, parameter, signal_in, signal_out
from engine.ports import Expression
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class FieldOrientedController(Block):
    """Field-oriented control: v = kp e + ki x + decoupling on each axis, x' = e, e = i* - i; |i*| <= I, |v| <= V.

    iq* = q_reference within the current limit I = current_limit, id* = 0. kp = wb L and ki = wb R by the bandwidth wb
    and the motor's L, R of that axis, so that each current follows its reference as wb / (s + wb); the decoupling
    -we Lq iq and we (Ld id + psi) takes the axes apart. V = modulation * bus voltage: 1 / sqrt 3 of the bus voltage is
    what a three-phase bridge gives undistorted. Beyond V both voltages shrink in proportion and the integrals are led
    back.

    Field weakening (``field_weakening: true``): id* is the one nearest 0 with which iq* fits the voltage,
    we^2 ((psi + Ld id*)^2 + (Lq iq*)^2) <= (s V - R I)^2, s = voltage_share leaving some to the control. Where the
    current does not suffice for that, both lie on its limit as well: the envelope of torque over speed that a data
    sheet draws. id* stays above -psi / Ld. Give it the parameters of the `PMSM`. [Vas 1990; Morimoto 1990]
    """

    pole_pairs = option(int, ..., "pole pairs p of the motor", ge=1, le=200)
    field_weakening = option(bool, False, "whether id* goes below 0 at high speed")
    bandwidth = parameter("rad/s", ..., "bandwidth wb of the current loops", gt=0, tolerance=0.3)
    current_limit = parameter("A", ..., "greatest amplitude of the currents I", gt=0, tolerance=0.2)
    modulation = parameter("1", 0.5773502691896258, "greatest amplitude of a phase per bus voltage", gt=0, le=1)
    voltage_share = parameter("1", 0.95, "share s of the voltage that the references may need", gt=0, lt=1)
    resistance = parameter("ohm", ..., "winding resistance R of a phase", gt=0)
    d_inductance = parameter("H", ..., "inductance Ld along the magnets", gt=0)
    q_inductance = parameter("H", SameAs("d_inductance"), "inductance Lq across them", gt=0)
    flux_linkage = parameter("Wb", ..., "flux of the magnets through a phase psi", ge=0)

    q_reference = signal_in("A", "what iq should be")
    d_current = signal_in("A", "current along the magnets id")
    q_current = signal_in("A", "current across them iq")
    speed = signal_in("rad/s", "speed of the shaft w")
    bus_voltage = signal_in("V", "direct voltage of the bridge")
    d_voltage = signal_out("V", "voltage along the magnets vd")
    q_voltage = signal_out("V", "voltage across them vq")
    d_target = signal_out("A", "reference id* within the limits")
    q_target = signal_out("A", "reference iq* within the limits")
    bus_current = signal_out("A", "current that the bridge draws from the bus, 3/2 (vd id + vq iq) / bus voltage")

    def _targets(self, we: Expression, most: Expression) -> tuple[Expression, Expression]:
        """References of both axes within current and voltage."""
        limit, ld, lq, psi = self.current_limit, self.d_inductance, self.q_inductance, self.flux_linkage
        if not self.field_weakening:
            return 0.0, greatest(least(self.q_reference, limit), -limit)
        spare = greatest(self.voltage_share * most - self.resistance * limit, 1e-3 * most)
        room = spare / greatest(magnitude(we), 1e-9)  # flux that the voltage allows
        asked = least(magnitude(self.q_reference), limit)
        for_asked = (_root(room**2 - (lq * asked) ** 2) - psi) / ld
        # Where the voltage's ellipse cuts the circle of the current: beyond it less torque is left.
        missing = psi**2 + (lq * limit) ** 2 - room**2
        on_circle = -missing / (psi * ld + _root((psi * ld) ** 2 + (lq**2 - ld**2) * missing) + 1e-30)
        d = greatest(greatest(least(greatest(for_asked, on_circle), 0.0), -limit), -psi / ld)
        left = least(_root(limit**2 - d**2), _root(room**2 - (psi + ld * d) ** 2) / lq)
        return d, greatest(least(self.q_reference, left), -left)

    def stamp(self, net: Net) -> None:
        ld, lq, rate = self.d_inductance, self.q_inductance, self.bandwidth
        we, most = self.pole_pairs * self.speed, self.modulation * self.bus_voltage
        d_target, q_target = self._targets(we, most)
        asked = []
        for name, error, inductance, across in (
            ("d", d_target - self.d_current, ld, -we * lq * self.q_current),
            ("q", q_target - self.q_current, lq, we * (ld * self.d_current + self.flux_linkage)),
        ):
            x = net.state(f"{name}_integral", "V", doc=f"integral part of the voltage of the {name} axis")
            asked.append((x, error, rate * inductance * error + x + across, inductance))
        size = _root(asked[0][2] ** 2 + asked[1][2] ** 2)
        limited = net.switch(
            "voltage_limit",
            ("none", "inside", "reached"),
            lambda mode: (by_mode(mode, -1, size - most, most - size), -1),
        )
        share = by_mode(limited, 1.0, 1.0, most / greatest(size, most))
        power = 1.5 * share * (asked[0][2] * self.d_current + asked[1][2] * self.q_current)
        net.output(self.bus_current, power / greatest(self.bus_voltage, 1e-9))
        for (x, error, voltage, inductance), port in zip(asked, (self.d_voltage, self.q_voltage), strict=True):
            # Led back by what the limit cuts off, at the rate of the loop: R / L of the surplus.
            surplus = (share - 1) * voltage
            net.derivative(x, rate * self.resistance * (error + surplus / (rate * inductance)))
            net.output(port, share * voltage)
        net.output(self.d_target, d_target)
        net.output(self.q_target, q_target)


def _root(square: Expression) -> Expression:
    """Square root of what may be 0 or less, with a finite slope there."""
    return sqrt(greatest(square, 1e-18))
