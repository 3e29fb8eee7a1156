"""A flexible arm by assumed modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.links import mode_shapes
from blocks.symbolic import sqrt
from engine.block import Block, flange, option, parameter, signal_out
from engine.errors import ParameterError
from engine.ports import TRANSLATIONAL, Expression

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion


class AssumedModesLink(Block):
    """Flexible uniform arm: z(s,t) = s theta + w, w = sum Q_i(s) alpha_i, Q_i the clamped-free modes.

    T = Jh theta'^2 / 2 + 1/2 int rho (s theta' + w')^2 ds + mp (L theta' + w'(L))^2 / 2,    U = EI/2 int w_ss^2 ds

    L = length, rho = mass / L, EI = flexural_rigidity, mp = payload, Jh = hub_inertia, theta = angle of the hub; in the
    horizontal plane, small w. A positive torque at the hub turns it in the positive sense; alpha_1 > 0 bends the tip
    that way. A payload of 0 leaves its terms out, and cannot be tuned later. Each mode is damped by zeta_j = 2 xi_j
    sqrt(K_j M_j), xi = damping_ratio of the clamped arm,
    K_j = EI beta_j^4 / L^3, M_j = m + mp Q_j(L)^2.

    ``nonlinear`` adds 1/2 theta'^2 (int rho w^2 ds + mp w(L)^2): the terms alpha^2 theta'' and alpha theta'^2 of [Gao
    X. n.d., eq. 11]. Alone they are spin softening, and the arm diverges when theta' reaches the first clamped
    frequency. ``foreshortening`` adds the shortening of the arm by bending, -1/2 theta'^2 alpha' G alpha with G_ij =
    rho/2 int (L^2 - s^2) Q_i' Q_j' ds + mp L int Q_i' Q_j' ds; together they stiffen. [Gao X. n.d., eq. 11], corrected
    (docs/errata.md); mode shapes [Blevins 1979, Table 8-1].
    """

    modes_option = "modes"
    spin_options = ("nonlinear", "foreshortening")
    payload_parameters = ("payload", "mass")

    modes = option(int, 1, "number of assumed modes", ge=1, le=64)
    nonlinear = option(bool, False, "include the terms in theta'^2 of the deflected arm")
    foreshortening = option(bool, False, "include that a bent arm is shorter; needs nonlinear")
    length = parameter("m", ..., "length L from the axis to the tip", gt=0)
    mass = parameter("kg", ..., "mass m, evenly spread over the length", gt=0, tolerance=0.1)
    flexural_rigidity = parameter("N.m2", ..., "bending stiffness EI", gt=0, tolerance=0.2)
    payload = parameter("kg", 0.0, "point mass mp at the tip", ge=0, tolerance=0.1)
    hub_inertia = parameter("kg.m2", 0.0, "moment of inertia Jh of the hub", ge=0, tolerance=0.1)
    damping_ratio = parameter(
        "1", 0.0, "damping ratio xi of each clamped mode", ge=0, lt=1, tolerance=0.5, size="modes"
    )

    hub = flange("the axis of the arm")
    deflection = signal_out("m", "deflection of the tip from the hub's direction, w(L)", name="tip.deflection")
    slope = signal_out("rad", "direction of the arm at the tip, theta + w_s(L)", name="tip.angle")
    position = signal_out("m", "path of the tip, L theta + w(L)", name="tip.position")
    acceleration = signal_out(
        "m/s2", "acceleration of the tip across the arm, L theta'' + w''(L)", name="tip.acceleration"
    )
    curvature = signal_out("1/m", "curvature at the root, w_ss(0)", name="root.curvature")

    def check(self) -> None:
        """Foreshortening alone has no meaning."""
        if self.foreshortening and not self.nonlinear:
            raise ParameterError("foreshortening needs nonlinear: true", remedy="set both, or neither")

    def stamp(self, net: Net) -> None:
        hub, length, mass, payload = self.hub, self.length, self.mass, self._tip_mass()
        orders = range(1, self.modes + 1)
        alpha = [net.coordinate(f"mode{i}", kind=TRANSLATIONAL) for i in orders]
        tip = [mode_shapes.tip(i) for i in orders]

        arm = self.hub_inertia + mass * length**2 / 3 + payload * length**2
        matrix: list[list[Expression]] = [[arm] + [0.0] * self.modes] + [[0.0] * (self.modes + 1) for _ in orders]
        for i in orders:
            coupling = mass * length * mode_shapes.first_moment(i) + payload * length * tip[i - 1]
            matrix[0][i] = matrix[i][0] = coupling
            for j in orders:
                matrix[i][j] = payload * (tip[i - 1] * tip[j - 1]) + (mass if i == j else 0.0)
        net.mass([hub, *alpha], matrix)

        rigidity = self.flexural_rigidity / length**3
        for i, motion in zip(orders, alpha, strict=True):
            stiffness = rigidity * mode_shapes.root(i) ** 4
            damping = 2 * self.damping_ratio[i - 1] * sqrt(stiffness * matrix[i][i])
            net.potential([motion], stiffness * motion.position**2 / 2)
            net.force(motion, -damping * motion.speed)
            net.dissipate(damping * motion.speed**2)
        if self.nonlinear:
            net.kinetic([hub, *alpha], hub.speed**2 / 2 * self._added_inertia(alpha))
        self._observe(net, alpha)

    def _tip_mass(self) -> Expression:
        """The payload; a plain zero where there is none, which keeps the modes' mass matrix diagonal."""
        return self.payload if self.differs("payload") else 0.0

    def _added_inertia(self, alpha: list[Motion]) -> Expression:
        """What the deflection adds to the moment of inertia about the hub."""
        bent = self.mass * sum(a.position**2 for a in alpha)
        bent += self._tip_mass() * sum(mode_shapes.tip(i) * a.position for i, a in enumerate(alpha, 1)) ** 2
        if self.foreshortening:
            beam, end = mode_shapes.stiffening(self.modes)
            for i, a in enumerate(alpha):
                for j, b in enumerate(alpha):
                    g = self.mass * float(beam[i, j]) + self._tip_mass() * float(end[i, j])
                    bent -= g * a.position * b.position
        return bent

    def _observe(self, net: Net, alpha: list[Motion]) -> None:
        """Publish the outputs that a sensor on the arm can measure."""
        hub, length = self.hub, self.length
        numbered = list(enumerate(alpha, 1))
        deflection = sum(mode_shapes.tip(i) * a.position for i, a in numbered)
        net.output(self.deflection, deflection)
        net.output(self.slope, hub.angle + sum(mode_shapes.tip_slope(i) * a.position for i, a in numbered) / length)
        net.output(self.position, length * hub.angle + deflection)
        bending = sum(mode_shapes.tip(i) * a.acceleration for i, a in numbered)
        net.output(self.acceleration, length * hub.acceleration + bending)
        curvature = sum(2 * mode_shapes.root(i) ** 2 * a.position for i, a in numbered)
        net.output(self.curvature, curvature / length**2)
        for i, a in numbered:
            net.output(f"mode{i}.amplitude", a.position, "m", f"amplitude of mode {i}, alpha_{i}")
