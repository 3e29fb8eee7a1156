"""A flexible arm as rigid elements joined by fictitious springs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.links.fictitious_joints import element_lengths, mass_matrix
from engine.block import Block, flange, option, parameter, signal_out
from engine.ports import Expression, Port

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion


class LumpedMassLink(Block):
    """Flexible arm of n + 1 rigid elements: M q'' + C q' + K q = (torque at the hub) e_0, q_0 = angle of the hub.

    M = sum m_i phi_i phi_i^T + mp phi_tip phi_tip^T + Jh e_0 e_0^T,    g_i = e_i - e_(i-1)
    K = sum k_i g_i g_i^T,    C = sum c_i g_i g_i^T + c_h e_0 e_0^T

    n = joints, q_i the angle of element i against the ground, k_i = joint_stiffness, c_i = joint_damping,
    c_h = hub_damping, Jh = hub_inertia, mp = payload. Element i of length l_i has its mass m l_i / L as a point at its
    middle: phi_i = (l_0 .. l_(i-1), l_i / 2, 0 ..), and phi_tip = (l_0 .. l_n). The joints sit where
    `blocks.links.fictitious_joints` says: at 1/8, 1/2 and 7/8 of the length L for n = 3.

    In the horizontal plane, small bends. A positive torque at the hub turns it in the positive sense. Outputs
    ``strain1`` .. ``strainN`` are the bends q_i - q_(i-1) that gauges at the joints measure, positive where the arm
    bends that way, and ``element1.direction`` .. the q_i. With `joint_tuning.tune_joint_stiffness` the clamped arm gets
    given frequencies; clamped poles are also the zeros of hub angle / torque. [One-link n.d., eq. 3]
    """

    joints = option(int, 3, "number of fictitious joints n", ge=1, le=16)
    length = parameter("m", ..., "length L from the axis to the tip", gt=0)
    mass = parameter("kg", ..., "mass m, evenly spread over the length", gt=0, tolerance=0.1)
    joint_stiffness = parameter(
        "N.m/rad", ..., "torque per bend k of each joint, from the hub", gt=0, tolerance=0.2, size="joints"
    )
    joint_damping = parameter(
        "N.m.s/rad", 0.0, "torque per rate of bend c of each joint", ge=0, tolerance=0.5, size="joints"
    )
    payload = parameter("kg", 0.0, "point mass mp at the tip", ge=0, tolerance=0.1)
    hub_inertia = parameter("kg.m2", 0.0, "moment of inertia Jh of the hub", ge=0, tolerance=0.1)
    hub_damping = parameter("N.m.s/rad", 0.0, "viscous friction c_h of the hub", ge=0, tolerance=0.3)

    hub = flange("the axis of the arm")
    deflection = signal_out("m", "deflection of the tip from the hub's direction", name="tip.deflection")
    slope = signal_out("rad", "direction of the last element, q_n", name="tip.angle")
    position = signal_out("m", "path of the tip, sum of l_i q_i", name="tip.position")
    acceleration = signal_out("m/s2", "acceleration of the tip across the arm", name="tip.acceleration")

    def further_ports(self) -> Iterable[Port]:
        """A strain gauge and a direction for each joint."""
        for i in range(1, self.joints + 1):
            yield Port(f"strain{i}", "output", f"bend of joint {i}, e_{i} = q_{i} - q_{i - 1}", unit="rad")
            yield Port(f"element{i}.direction", "output", f"angle of element {i} against the ground, q_{i}", unit="rad")

    def stamp(self, net: Net) -> None:
        lengths = element_lengths(self.joints)
        q = [self.hub, *(net.coordinate(f"element{i}") for i in range(1, self.joints + 1))]

        moment, tip = self.mass * self.length**2, self.payload * self.length**2
        shares = mass_matrix(self.joints)
        matrix: list[list[Expression]] = [
            [moment * float(shares[i, j]) + tip * (a * b) for j, b in enumerate(lengths)] for i, a in enumerate(lengths)
        ]
        matrix[0][0] += self.hub_inertia
        net.mass(q, matrix)

        hub_torque = self.hub_damping * self.hub.speed
        net.force(self.hub, -hub_torque)
        net.dissipate(hub_torque * self.hub.speed)
        for i in range(self.joints):
            self._joint(net, q[i], q[i + 1], self.joint_stiffness[i], self.joint_damping[i])
        self._observe(net, q)

    def _joint(self, net: Net, a: Motion, b: Motion, stiffness: Expression, damping: Expression) -> None:
        """A spring and damper that carry ``b`` after ``a``."""
        bend, rate = b.angle - a.angle, b.speed - a.speed
        net.pair(a, b, stiffness * bend + damping * rate)
        net.store(stiffness * bend**2 / 2)
        net.dissipate(damping * rate**2)

    def _observe(self, net: Net, q: list[Motion]) -> None:
        """Publish the outputs that a sensor on the arm can measure."""
        lengths = [self.length * share for share in element_lengths(self.joints)]
        along = list(zip(lengths, q, strict=True))
        net.output(self.position, sum(part * motion.angle for part, motion in along))
        net.output(self.deflection, sum(part * (motion.angle - self.hub.angle) for part, motion in along))
        net.output(self.slope, q[-1].angle)
        net.output(self.acceleration, sum(part * motion.acceleration for part, motion in along))
        for i in range(1, self.joints + 1):
            net.output(self.port(f"strain{i}"), q[i].angle - q[i - 1].angle)
            net.output(self.port(f"element{i}.direction"), q[i].angle)
