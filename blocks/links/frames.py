"""Roots of the links along a planar chain: positions and velocities.

From the root of a link, where (u, v) and w are the velocity and the turning, to its tip, with the position (X, y) and
the slope y_s of the tip in the link's axes, and on over a joint of angle q to the root of the next link:

    w_t = w + y_s'                        w' = w_t + q'
    u_t = u - y w + X'                    u' =  cos(a) u_t + sin(a) v_t            a = y_s + q
    v_t = v + X w + y'                    v' = -sin(a) u_t + cos(a) v_t

These are the propagation matrices A of the DeNOC form [Mohan 2010, eqs. 2 to 4], one link at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from blocks.links.bending import Link
from blocks.symbolic import cos, sin
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion, Velocity

    Mover = Motion | Velocity

Pair = tuple[Expression, Expression]


@dataclass(frozen=True)
class Root:
    """The root of a link.

    Attributes:
        turn: angular velocity w.
        along, across: velocity u and v along the link's axes; None where the root does not move.
        angle: direction of the link's x axis in the base, and ``direction`` its cosine and sine.
        position: in the base.
    """

    turn: Mover
    along: Mover | None
    across: Mover | None
    angle: Expression
    direction: Pair
    position: Pair

    def outward(self, x: Expression, y: Expression) -> Pair:
        """A vector given along the link's axes, in the base."""
        c, s = self.direction
        return c * x - s * y, s * x + c * y

    def inward(self, x: Expression, y: Expression) -> Pair:
        """A vector given in the base, along the link's axes."""
        c, s = self.direction
        return c * x + s * y, c * y - s * x

    def tip(self, link: Link, d: list[Expression]) -> tuple[Pair, Expression]:
        """Position and direction of the link's tip, in the base."""
        x, y = self.outward(link.reach(d), link.tip(d))
        return (self.position[0] + x, self.position[1] + y), self.angle + link.slope(d)


def first_root(joint: Motion) -> Root:
    """The root of the first link, which turns about the origin of the base."""
    q = joint.angle
    return Root(joint, None, None, q, (cos(q), sin(q)), (0.0, 0.0))


def next_root(net: Net, name: str, root: Root, link: Link, modes: list[Motion], joint: Motion) -> Root:
    """The root that ``joint`` carries at the tip of a link; ``name`` is that of the link it belongs to."""
    d = [mode.position for mode in modes]
    slopes, drawn, lifts = (_by_mover(modes, row) for row in link.tip_rates(d))
    turn = _built(net, f"{name}.base.turn", {root.turn: 1.0, **slopes})
    along = _built(net, f"{name}.base.along", {root.along: 1.0, root.turn: -link.tip(d), **drawn})
    across = _built(net, f"{name}.base.across", {root.across: 1.0, root.turn: link.reach(d), **lifts})

    turned = link.slope(d) + joint.angle
    c, s = cos(turned), sin(turned)
    position, angle = root.tip(link, d)
    return Root(
        net.velocity(f"{name}.turn", {turn: 1.0, joint: 1.0}),
        _built(net, f"{name}.along", {along: c, across: s}),
        _built(net, f"{name}.across", {along: -s, across: c}),
        angle + joint.angle,
        root.outward(c, s),
        position,
    )


def _by_mover(modes: list[Motion], row: list[Expression]) -> dict[Mover | None, Expression]:
    return dict(zip(modes, row, strict=False))


def _built(net: Net, name: str, terms: Mapping[Mover | None, Expression]) -> Mover:
    """A velocity from its nonzero terms; a single term with coefficient 1 is returned as it is."""
    kept = {m: c for m, c in terms.items() if m is not None and not (isinstance(c, float) and c == 0)}
    if len(kept) == 1 and isinstance(next(iter(kept.values())), float):
        return next(iter(kept))
    return net.velocity(name, kept)
