"""A serial arm of rigid and flexible links in a plane."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.links.bending import Link
from blocks.links.frames import Root, first_root, next_root
from blocks.links.shape_sets import SETS, shape_set
from blocks.symbolic import cos, sin, sqrt
from engine.block import Block, flange, option, parameter, signal_out
from engine.errors import ParameterError
from engine.ports import TRANSLATIONAL, Port

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion


class SerialArm(Block):
    """Serial arm: M(q) q'' + h(q, q') + B q' + K q = tau + gravity, q = joint angles and amplitudes of modes.

    Uniform links in a plane, each hinged to the tip of the one before; the first turns about a fixed point. A link with
    0 modes is rigid; another bends by y = sum Q_j(s) d_j, and its energy is that of `blocks.links.bending`. The shapes
    Q_j are the clamped-free modes, or those of ``craig_bampton`` (`blocks.links.shape_sets`), which a link needs that
    carries a moment at its tip: one before a locked or driven joint. The tip carries the next joint along, displaced by
    y(L) and turned by y_s(L). Motors, gears, brakes and frictions of joint i are connected to the flange ``joint<i>``,
    whose angle is that of link i against the tip before; a rotor there counts with its turning against that tip alone.

    B holds viscous_friction at the joints and zeta_j = 2 xi_j sqrt(K_j M_j) for each mode, xi = damping_ratio,
    K_j = EI int (d2 Q_j / ds2)^2 ds, M_j = m + mp Q_j(L)^2; damping_ratio has one value per mode, link after link.
    With ``gravity`` the plane is vertical: g pulls in the direction ``gravity_direction`` from the x axis, the
    direction in which the arm points at zero angles, so that by default it hangs there.

    Accelerations come from the recursion over the links that the DeNOC matrices make possible [Mohan 2010, eqs. 2 to
    4], at a cost in proportion to their number. Limits: small slopes, since the tip is taken to turn by y_s itself;
    uniform links; bending in the plane only. Equations of motion [Mohan 2010, eqs. 8, 11], corrected (docs/errata.md).
    """

    links = option(int, ..., "number of links", ge=1, le=256)
    modes = option(int, 2, "number of modes of each link, 0 for a rigid one", ge=0, le=32, size="links")
    shapes = option(str, "cantilever", "set of shapes in which links bend", choices=SETS)
    nonlinear = option(bool, True, "keep the terms of a link's own deflection in its inertia")
    foreshortening = option(bool, False, "include that a bent link is shorter; needs nonlinear")
    gravity = option(bool, False, "the arm moves in a vertical plane")
    length = parameter("m", ..., "length L from joint to joint or tip", gt=0, size="links")
    mass = parameter("kg", ..., "mass m, evenly spread over the length", gt=0, tolerance=0.1, size="links")
    flexural_rigidity = parameter(
        "N.m2", 0.0, "bending stiffness EI; only a link with modes needs it", ge=0, tolerance=0.2, size="links"
    )
    payload = parameter("kg", 0.0, "point mass mp at the end of the link", ge=0, tolerance=0.1, size="links")
    hub_inertia = parameter(
        "kg.m2", 0.0, "moment of inertia Jh that turns with the root of the link", ge=0, tolerance=0.1, size="links"
    )
    viscous_friction = parameter("N.m.s/rad", 0.0, "torque per speed of the joint", ge=0, tolerance=0.3, size="links")
    damping_ratio = parameter(
        "1", 0.0, "damping ratio xi of each mode of the clamped link", ge=0, lt=1, tolerance=0.5, size="modes"
    )
    gravitational_acceleration = parameter("m/s2", 9.81, "pull g on each kilogram", ge=0)
    gravity_direction = parameter("rad", 0.0, "direction of the pull from the x axis of the base")

    joint1 = flange("the first joint; the next are joint2, joint3 and so on")
    tip_x = signal_out("m", "position of the arm's end along the x axis", name="tip.x")
    tip_y = signal_out("m", "position of the arm's end along the y axis", name="tip.y")
    tip_angle = signal_out("rad", "direction of the arm's end from the x axis", name="tip.angle")

    def check(self) -> None:
        """A link that bends needs stiffness."""
        for i, (modes, rigidity) in enumerate(zip(self.modes, self.flexural_rigidity, strict=True), 1):
            if self.shapes == "craig_bampton" and modes == 1:
                raise ParameterError(f"link {i} has 1 mode, but craig_bampton begins with 2", remedy="give 2, or 0")
            if modes and rigidity == 0:
                raise ParameterError(
                    f"link {i} has {modes} modes but no flexural_rigidity",
                    remedy="give its flexural_rigidity in N.m2, or 0 modes for a rigid link",
                )
        if self.foreshortening and not self.nonlinear:
            raise ParameterError("foreshortening needs nonlinear: true", remedy="set both, or neither")

    def further_ports(self) -> Iterable[Port]:
        """Flanges of the joints after the first."""
        return (Port(f"joint{i}", "flange", f"joint {i}", kind="rotational") for i in range(2, self.links + 1))

    def stamp(self, net: Net) -> None:
        root = first_root(self.joint1)
        for i, modes in enumerate(self.modes):
            name, joint = f"link{i + 1}", self.port(f"joint{i + 1}")
            values = self.length[i], self.mass[i], self.payload[i], self.hub_inertia[i]
            link = Link(*values, shape_set(self.shapes, modes), self.nonlinear, self.foreshortening)
            bending = [net.coordinate(f"{name}.mode{j + 1}", kind=TRANSLATIONAL) for j in range(modes)]
            friction = self.viscous_friction[i] * joint.speed
            net.force(joint, -friction)
            net.dissipate(friction * joint.speed)
            self._move(net, root, link, bending)
            self._bend(net, i, link, bending)
            if self.gravity:
                self._pull(net, root, link, bending)
            if i + 1 < self.links:
                root = next_root(net, f"link{i + 2}", root, link, bending, self.port(f"joint{i + 2}"))
        position, angle = root.tip(link, [mode.position for mode in bending])
        net.output(self.tip_x, position[0])
        net.output(self.tip_y, position[1])
        net.output(self.tip_angle, angle)

    def _move(self, net: Net, root: Root, link: Link, bending: list[Motion]) -> None:
        """Kinetic energy of a link, by Lagrange's equation in its turning axes."""
        d, rates = [mode.position for mode in bending], [mode.speed for mode in bending]
        if root.along is None or root.across is None:
            net.kinetic([root.turn, *bending], link.kinetic(0.0, 0.0, root.turn.speed, d, rates))
            return
        u, v, w = root.along.speed, root.across.speed, root.turn.speed
        momentum = net.kinetic([root.along, root.across, root.turn, *bending], link.kinetic(u, v, w, d, rates))
        net.force(root.along, momentum[1] * w)
        net.force(root.across, -momentum[0] * w)
        net.force(root.turn, momentum[0] * v - momentum[1] * u)

    def _bend(self, net: Net, i: int, link: Link, bending: list[Motion]) -> None:
        """Stiffness and damping of a link's modes, and what can be measured on it."""
        name, before = f"link{i + 1}", sum(self.modes[:i])
        pairs = zip(link.stiffness(self.flexural_rigidity[i]), link.modal_mass(), strict=True)
        for j, (mode, (stiffness, mass)) in enumerate(zip(bending, pairs, strict=True)):
            net.potential([mode], stiffness * mode.position**2 / 2)
            damping = 2 * self.damping_ratio[before + j] * sqrt(stiffness * mass)
            net.force(mode, -damping * mode.speed)
            net.dissipate(damping * mode.speed**2)
            net.output(f"{name}.mode{j + 1}.amplitude", mode.position, "m", f"amplitude of mode {j + 1}")
        if bending:
            d = [mode.position for mode in bending]
            net.output(f"{name}.deflection", link.tip(d), "m", "deflection of the link's tip from its root's direction")
            net.output(f"{name}.curvature", link.root_curvature(d), "1/m", "curvature at the link's root")

    def _pull(self, net: Net, root: Root, link: Link, bending: list[Motion]) -> None:
        """Weight of a link and of its payload."""
        d = [mode.position for mode in bending]
        g, towards = self.gravitational_acceleration, self.gravity_direction
        base = g * cos(towards), g * sin(towards)
        gx, gy = root.inward(*base)
        whole, (along, across) = link.mass + link.payload, link.moments(d)
        if root.along is not None and root.across is not None:
            net.force(root.along, whole * gx)
            net.force(root.across, whole * gy)
        net.force(root.turn, along * gy - across * gx)
        for mode, (x, y) in zip(bending, link.moment_slopes(d), strict=True):
            net.force(mode, x * gx + y * gy)
        held = base[0] * root.position[0] + base[1] * root.position[1]
        net.store(-whole * held - along * gx - across * gy)
