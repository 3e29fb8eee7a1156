"""A permanent-magnet synchronous motor in rotor coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, option, parameter, signal_in, signal_out
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class PMSM(Block):
    """PMSM in dq: vd = R id + Ld id' - we Lq iq, vq = R iq + Lq iq' + we (Ld id + psi), we = p w.

    Torque on the shaft: 3/2 p (psi iq + (Ld - Lq) id iq); J w' = torque - B w + torque at the shaft. w = speed of the
    shaft, p = pole_pairs, R = resistance of a phase, psi = flux_linkage of a phase, its amplitude, J = rotor_inertia,
    B = viscous_friction. The d axis points along the magnets, the q axis a quarter of an electrical revolution ahead;
    transformation of equal amplitudes, so that i and v are amplitudes of a phase to the star point. A positive iq
    accelerates the shaft in the positive sense. With Ld = Lq there is no reluctance torque; buried magnets have
    Lq > Ld, and gain torque by id < 0.

    The power that enters is 3/2 (vd id + vq iq). Harmonics, iron losses and saturation are not in the law. From a data
    sheet: psi = Kt / (1.5 p) with Kt in N.m per ampere of amplitude, or Kt / (1.5 p sqrt 2) per ampere effective; R and
    L between two terminals are twice those of a phase. A brushless motor that is commutated in six steps is this one
    with the mean of its torque. [Vas 1990]
    """

    cut_after = ("shaft",)
    loads = ("shaft",)

    pole_pairs = option(int, ..., "pole pairs p, half the number of poles", ge=1, le=200)
    resistance = parameter("ohm", ..., "winding resistance R of a phase", gt=0, tolerance=0.15)
    d_inductance = parameter("H", ..., "inductance Ld along the magnets", gt=0, tolerance=0.2)
    q_inductance = parameter("H", SameAs("d_inductance"), "inductance Lq across them", gt=0, tolerance=0.2)
    flux_linkage = parameter("Wb", ..., "flux of the magnets through a phase psi, its amplitude", ge=0, tolerance=0.15)
    rotor_inertia = parameter("kg.m2", 0.0, "moment of inertia of the rotor J", ge=0, tolerance=0.1)
    viscous_friction = parameter("N.m.s/rad", 0.0, "bearing torque per speed B", ge=0, tolerance=0.3)

    d_voltage = signal_in("V", "voltage along the magnets vd", default=0.0)
    q_voltage = signal_in("V", "voltage across them vq")
    shaft = flange("the rotor")
    d_current = signal_out("A", "current along the magnets id")
    q_current = signal_out("A", "current across them iq")
    torque = signal_out("N.m", "torque of the currents on the rotor")

    def stamp(self, net: Net) -> None:
        p, resistance, w = self.pole_pairs, self.resistance, self.shaft.speed
        ld, lq, psi = self.d_inductance, self.q_inductance, self.flux_linkage
        d = net.state("d_winding.current", "A", doc="current along the magnets")
        q = net.state("q_winding.current", "A", doc="current across the magnets")
        net.derivative(d, (self.d_voltage - resistance * d + p * w * lq * q) / ld)
        net.derivative(q, (self.q_voltage - resistance * q - p * w * (ld * d + psi)) / lq)
        torque = 1.5 * p * (psi * q + (ld - lq) * d * q)
        net.inertia(self.shaft, self.rotor_inertia)
        net.force(self.shaft, torque - self.viscous_friction * w)

        net.supply(1.5 * (self.d_voltage * d + self.q_voltage * q))
        net.store(1.5 * (ld * d**2 + lq * q**2) / 2)
        net.dissipate(1.5 * resistance * (d**2 + q**2) + self.viscous_friction * w**2)
        net.output(self.d_current, d)
        net.output(self.q_current, q)
        net.output(self.torque, torque)
