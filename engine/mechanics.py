"""The mechanism: mass matrix, forces, stuck joints, accelerations.

    M q'' = f,   M = T' E M0 T,   f = T' E f0

T carries coordinates to motions, E holds the efficiency weights. A stuck coordinate has its row and column of M masked
and its force zeroed, so its acceleration is exactly zero; what would move it is the residual of its own row, and that
is compared with the static friction.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from engine.block import Expression
from engine.coordinates import choose
from engine.errors import StructureError
from engine.net import Motion, Net
from engine.system import System
from engine.wiring import Wiring


class Mechanics:
    """Accelerations of a stamped net.

    Args:
        system: blocks and connections, for names in errors.
        net: what the blocks stamped.
        wiring: resolves the signals inside the forces.
        flanges: (block, port) -> motion.
        p: parameter vector (symbols) and ``values``, its nominal values.
    """

    def __init__(
        self,
        system: System,
        net: Net,
        wiring: Wiring,
        flanges: dict[tuple[str, str], Motion],
        p: Expression,
        values: NDArray[np.float64],
    ) -> None:
        self.system, self.net, self.wiring, self.flanges = system, net, wiring, flanges
        self.p, self.values = p, values
        self.coordinates = choose(net, p, values)
        self.count = len(self.coordinates.names)
        self.q = ca.SX.sym("q", self.count)
        self.v = ca.SX.sym("v", self.count)
        self.T = self.coordinates.transform()
        self.friction_modes = {c: ca.SX.sym(f"stick{c}") for c in sorted(self.coordinates.frictions)}
        self.guards: dict[int, Expression] = {}
        self.lost = ca.SX(0)
        self.kinetic_energy = ca.SX(0)
        self.acceleration = ca.SX(0, 1)
        wiring.solve_accelerations(self._solve)

    def solved(self) -> Expression:
        """Accelerations of the coordinates, shape (n, 1)."""
        self.wiring.accelerations()
        return self.acceleration

    def in_coordinates(self, expression: Expression) -> Expression:
        """Replace the motions' angles and speeds by combinations of the coordinates."""
        motions = self.net.motions
        if not motions:
            return expression
        old = ca.vertcat(*[m.angle for m in motions], *[m.speed for m in motions])
        return ca.substitute(expression, old, ca.densify(ca.vertcat(self.T @ self.q, self.T @ self.v)))

    def _forces(self) -> Expression:
        f = ca.SX.zeros(len(self.net.motions), 1)
        for index, value in self.net.forces.items():
            f[index] += value
        return self.wiring.resolve(f)

    def _mass(self) -> Expression:
        n = len(self.net.motions)
        mass = ca.SX(n, n)
        for (i, j), value in self.net.masses.items():
            mass[i, j] = value
        return mass

    def _dry(self, coordinate: int) -> tuple[Expression, Expression, Expression, Expression]:
        """Friction (real units, along the coordinate), static levels forward and backward, and the power it takes."""
        mode = self.friction_modes[coordinate]
        force = forward_level = backward_level = power = ca.SX(0)
        for entry, scale in self.coordinates.frictions[coordinate]:
            size = ca.fabs(scale)
            positive = float(ca.Function("s", [self.p], [scale])(self.values)) > 0
            moving = mode if positive else -mode
            ahead, behind = (moving > 0) * entry.forward, (moving < 0) * entry.backward
            force += scale * (ahead - behind)
            levels = (entry.static_forward, entry.static_backward)
            forward_level += size * levels[0 if positive else 1]
            backward_level += size * levels[1 if positive else 0]
            power += entry.velocity * (ahead - behind)
        return force, forward_level, backward_level, power

    def _solve(self) -> list[Expression]:
        """Accelerations of the motions; also fills the residuals of the friction coordinates and the losses."""
        if self.count == 0:
            self.acceleration = ca.SX(0, 1)
            return [ca.SX(0) for _ in self.net.motions]
        weights = ca.diag(ca.vertcat(*self.coordinates.weights))
        mass0, force0 = self.in_coordinates(self._mass()), self.in_coordinates(self._forces())
        mass = self.T.T @ weights @ mass0 @ self.T
        self._check_mass(mass)
        force = self.T.T @ weights @ force0
        dry_power = ca.SX(0)
        levels: dict[int, tuple[Expression, Expression]] = {}
        slip = ca.SX.ones(self.count, 1)
        for c, mode in self.friction_modes.items():
            dry, ahead, behind, power = (self.in_coordinates(self.wiring.resolve(e)) for e in self._dry(c))
            weight = self._weight(c)
            force[c] -= weight * dry
            levels[c] = (weight * ahead, weight * behind)
            dry_power += power
            slip[c] = mode * mode
        masked = mass
        if self.friction_modes:
            masked = ca.diag(slip) @ mass @ ca.diag(slip) + ca.diag(1 - slip)
        factor = ca.ldl(ca.sparsify(masked))
        acceleration = ca.ldl_solve(slip * force, *factor)
        for c, (ahead, behind) in levels.items():
            residual = force[c] - mass[c, :] @ acceleration
            mode = self.friction_modes[c]
            above = ca.if_else(mode == 0, residual - ahead, -mode * self.v[c])
            below = ca.if_else(mode == 0, -residual - behind, -1)
            self.guards[c] = ca.vertcat(above, below)
        motions = self.T @ acceleration
        self.acceleration = acceleration
        speed = self.T @ self.v
        self.kinetic_energy = ca.dot(speed, mass0 @ speed) / 2
        self.lost = dry_power
        if any(tie.efficiency is not None for tie in self.net.ties):
            self.lost = ca.dot(speed, force0 - mass0 @ motions)
        return [motions[i] for i in range(len(self.net.motions))]

    def _weight(self, coordinate: int) -> Expression:
        entry, _ = self.coordinates.frictions[coordinate][0]
        return self.coordinates.weights[next(iter(entry.terms))]

    def _check_mass(self, mass: Expression) -> None:
        """Refuse a massless coordinate by the names of the flanges that move with it."""
        function = ca.Function("mass", [self.q, self.p], [mass])
        numbers = np.array(function(np.zeros(self.q.numel()), self.values).full())
        diagonal = np.diag(numbers)
        for i, value in enumerate(diagonal):
            if value <= 0:
                raise self._massless(i, "has no inertia")
        scale = 1 / np.sqrt(diagonal)
        eigenvalues, vectors = np.linalg.eigh(scale[:, None] * numbers * scale[None, :])
        if eigenvalues[0] < 1e-12:
            raise self._massless(int(np.argmax(np.abs(vectors[:, 0]))), "has no inertia of its own")

    def _massless(self, coordinate: int, what: str) -> StructureError:
        movers = [m.name for m, row in zip(self.net.motions, self.coordinates.rows, strict=True) if coordinate in row]
        flanges = [
            f"{block}.{port}" for (block, port), motion in self.flanges.items() if motion.name in movers
        ] or movers
        return StructureError(
            f"the motion of {' = '.join(flanges)} {what}",
            self.system.place(flanges[0].split(".")[0]),
            "give it an inertia (an Inertia or Mass block, or the block's own inertia), or merge it with its neighbour",
        )
