"""Base of the parts that turn rotation into translation: their ratio, elasticity and losses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.actuators.directed_loss import directed_loss
from engine.block import Block, flange, parameter, signal_out
from engine.errors import ParameterError
from engine.ports import TRANSLATIONAL, Expression
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class _RotationToTranslation(Block):
    """The law; subclasses declare what gives the ratio h, travel per angle (m/rad).

    Rigid (``stiffness: 0``): position = h angle, eliminated exactly. Of the power that enters at the shaft the share
    ``efficiency`` arrives at the slide, whichever way it flows, as with `Gear`.

    Elastic: F = k e + d e', e = h angle - position, F on the slide. ``efficiency`` eta counts while the shaft drives,
    and takes F h / eta from it; ``backdriving_efficiency`` eta_b while the slide does, and gives it eta_b F h. The
    difference from F h is a dry friction at the shaft whose level follows |F|: below it the shaft sticks, exactly.
    With eta_b <= 0 no force at the slide, however great, turns the shaft: the part is self-locking.
    """

    cut_after = ("slide",)

    stiffness = parameter("N/m", 0.0, "force per stretch k between shaft and slide; 0 is rigid", ge=0, tolerance=0.3)
    damping = parameter("N.s/m", 0.0, "force per rate of stretch d; for an elastic part", ge=0, tolerance=0.5)
    efficiency = parameter("1", 1.0, "share eta of the shaft's power that arrives", gt=0, le=1, tolerance=0.1)
    backdriving_efficiency = parameter(
        "1",
        SameAs("efficiency"),
        "share eta_b of the slide's power that arrives at the shaft; 0 or less is self-locking",
        le=1,
        tolerance=0.2,
    )
    inertia = parameter("kg.m2", 0.0, "moment of inertia of the part on its shaft", ge=0, tolerance=0.1)

    shaft = flange("what turns")
    slide = flange("what moves along", kind=TRANSLATIONAL)
    force = signal_out("N", "force F on the slide; of a rigid part it is not told, and 0")

    _elastic_only = ("damping", "backdriving_efficiency")

    def check(self) -> None:
        """What needs elasticity must have it."""
        if not self.differs("stiffness"):
            given = next((name for name in self._elastic_only if name in self.given), "")
            if given:
                raise ParameterError(
                    f"{given} is for an elastic {type(self).__name__}, and stiffness is 0",
                    remedy="give the stiffness, in N/m at the slide; a data sheet calls it rigidity",
                )

    def _travel(self) -> Expression:
        """Travel per angle h (m/rad)."""
        raise NotImplementedError

    def stamp(self, net: Net) -> None:
        a, b, h = self.shaft, self.slide, self._travel()
        net.inertia(a, self.inertia)
        eta, eta_b = self.efficiency, self.backdriving_efficiency
        lossy = self.differs("efficiency", 1) or self.differs("backdriving_efficiency", 1)
        if not self.differs("stiffness"):
            net.tie({b: 1, a: -h}, (a, b, eta) if lossy else None)
            net.output(self.force, 0.0)
            return
        stretch, rate = h * a.angle - b.angle, h * a.speed - b.speed
        force = self.stiffness * stretch + self.damping * rate
        net.force(b, force)
        net.force(a, -h * force)
        net.store(self.stiffness * stretch**2 / 2)
        net.dissipate(self.damping * rate**2)
        net.output(self.force, force)
        if not lossy:
            return
        # The slide holds the shaft back in its forward sense where h F > 0.
        directed_loss(net, a, h * force, eta, eta_b)
