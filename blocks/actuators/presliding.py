"""Base of the friction laws with presliding: a bristle that bends before the surfaces slide."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from blocks.actuators.friction import static_not_below_sliding
from blocks.symbolic import exp, greatest
from engine.block import Block, parameter
from engine.ports import Expression
from engine.quantity import SameAs
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion


_STRIBECK = "velocity vs over which the friction falls from Fs to Fc"


def slow_slide() -> Any:
    """The Stribeck velocity of a slide, whose usual value is another number than a shaft's."""
    return parameter("m/s", 0.01, _STRIBECK, gt=0, tolerance=0.5)


def stribeck(block: Any, velocity: Expression) -> Expression:
    """Friction g(v) of steady sliding, without its viscous part."""
    coulomb, static, width = block.coulomb_friction, block.static_friction, block.stribeck_velocity
    if static is coulomb:
        return coulomb
    static = greatest(static, coulomb)
    return coulomb + (static - coulomb) * exp(-((velocity / width) ** 2))


class _Bristle(Block):
    """F = sigma0 z + sigma1 z' + B v with the bristle's bend z; subclasses give z' and the flanges."""

    coulomb_friction = parameter("N.m", ..., "sliding friction Fc", gt=0, tolerance=0.3)
    static_friction = parameter(
        "N.m", SameAs("coulomb_friction"), "friction Fs at the slowest sliding; Fc if not given", gt=0, tolerance=0.3
    )
    stribeck_velocity = parameter("rad/s", 0.1, _STRIBECK, gt=0, tolerance=0.5)
    viscous_friction = parameter("N.m.s/rad", 0.0, "friction per velocity B", ge=0, tolerance=0.3)
    bristle_stiffness = parameter("N.m/rad", ..., "presliding stiffness sigma0", gt=0, tolerance=0.5)
    bristle_damping = parameter("N.m.s/rad", 0.0, "presliding damping sigma1", ge=0, tolerance=0.5)

    def relations(self) -> Iterable[Relation]:
        """The static level must not be below the sliding level."""
        return [static_not_below_sliding()]

    def _bend_rate(self, bend: Expression, velocity: Expression) -> Expression:
        """Rate z' of the bend."""
        raise NotImplementedError

    def _between(self, net: Net, a: Motion, b: Motion | None) -> None:
        """Stamp the friction of ``a`` against ``b`` (None is the ground)."""
        velocity = a.speed if b is None else a.speed - b.speed
        bend = net.state("bristle", self.here("rad"), doc="bend z of the bristle")
        rate = self._bend_rate(bend, velocity)
        net.derivative(bend, rate)
        spring = self.bristle_stiffness * bend
        friction = spring + self.bristle_damping * rate + self.viscous_friction * velocity
        net.pair(a, b, -friction)
        net.store(spring * bend / 2)
        net.dissipate(friction * velocity - spring * rate)
        net.output("friction", friction, self.here("N.m"), "friction F")
