"""A motion imposed on a flange from outside."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, option, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net

_COURSE = "whether the flange follows the input itself, or a second-order filter of it"
_CORNER = "angular corner frequency w of the filter, for course: filtered"


class PrescribedMotion(Block):
    """Imposed angle: angle of the shaft = the input angle, whatever torque that takes.

    ``course: exact`` follows the input itself. Its speed and acceleration are derived, so the input must be a formula
    of time, such as a `Sine`; where it jumps, the shaft jumps, without work. ``course: filtered`` follows any input u
    through x'' = w^2 (u - x) - 2 w x', critically damped, w = corner_frequency, at rest at ``start_angle`` to begin
    with. ``torque`` is what imposes the motion, positive in the positive sense; its power enters from outside.
    """

    cut_after = ("shaft",)
    imposes_motion = ("shaft",)

    course = option(str, "exact", _COURSE, choices=("exact", "filtered"))
    corner_frequency = parameter("rad/s", 100.0, _CORNER, gt=0)
    start_angle = parameter("rad", 0.0, "angle at which the filter begins, for course: filtered")

    angle = signal_in("rad", "angle wanted")
    shaft = flange("what is moved")
    torque = signal_out("N.m", "torque that imposes the motion")

    def stamp(self, net: Net) -> None:
        motion, wanted = self.shaft, self.angle
        if self.course == "exact":
            effort = net.prescribe(motion, wanted)
        else:
            path = net.state("path", self.here("rad"), start=self.start_angle, doc="filtered input")
            rate = net.state("rate", self.here("rad/s"), doc="rate of the filtered input")
            w = self.corner_frequency
            pull = w**2 * (wanted - path) - 2 * w * rate
            net.derivative(path, rate)
            net.derivative(rate, pull)
            effort = net.prescribe(motion, path, rate, pull)
        net.supply(effort * motion.speed)
        net.output(self.torque, effort)


class TranslationalPrescribedMotion(PrescribedMotion, slide={"shaft": "flange"}, keeps=("corner_frequency",)):
    """Imposed position: position of the flange = the input position, whatever force that takes.

    The two courses are those of `PrescribedMotion`.
    """
