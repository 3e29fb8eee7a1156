"""The mechanism: mass matrix, forces, stuck joints, accelerations.

    M q'' = f,   M = T' E M0 T,   f = T' E f0

Velocities built on one another (`engine.stamps.Velocity`) stand behind the coordinates in M and f, and their
accelerations follow from ``v' = C z + b``, z = (q'', v'); see `engine.recursion`. T carries coordinates to motions, E
holds the efficiency weights. A stuck coordinate has its row and column of M masked and its force zeroed, so its
acceleration is exactly zero. The residual of its own row is the effort that would move it; it is compared with the
static friction.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from engine import recursion
from engine.coordinates import choose
from engine.errors import StructureError
from engine.factor import solve
from engine.net import Net
from engine.ports import Expression
from engine.stamps import Motion, Prescription
from engine.system import System
from engine.wiring import Wiring, hash_symbol


class Masses:
    """The mass matrix of a mechanism.

    Args:
        function: the matrix and the rows of C, from coordinates, parameters and what else it depends on.
    """

    def __init__(self, function: Any) -> None:
        self._function = function

    def lacking(self, values: NDArray[np.float64]) -> tuple[int, str] | None:
        """A coordinate that has no inertia where all else is zero, and in which way; None if each has.

        Args:
            values: of the parameters.
        """
        first, _, other = (np.zeros(self._function.numel_in(k)) for k in range(3))
        found = self._function(first, values, other)
        numbers = recursion.condense(*(matrix.full() for matrix in found))
        diagonal = np.diag(numbers)
        for i, value in enumerate(diagonal):
            if value <= 0:
                return i, "has no inertia"
        scale = 1 / np.sqrt(diagonal)
        scaled = scale[:, None] * numbers * scale[None, :]
        if not (np.isfinite(diagonal).all() and np.isfinite(scaled).all()):
            return int(np.argmin(np.isfinite(scaled).all(axis=1))), "has no finite inertia"
        eigenvalues, vectors = np.linalg.eigh(scaled)
        if len(eigenvalues) and eigenvalues[0] < 1e-12:
            return int(np.argmax(np.abs(vectors[:, 0]))), "has no inertia of its own"
        return None


class Mechanics:
    """Accelerations of a stamped net.

    Args:
        system: blocks and connections, for names in errors.
        net: what the blocks stamped.
        wiring: resolves the signals inside the forces.
        flanges: (block, port) -> motion.
        p: parameter vector (symbols) and ``values``, its nominal values.
        note: told each expression of parameters whose value shapes the equations.

    Attributes:
        sound: tells whether each motion has inertia at other values; None without motions.
    """

    def __init__(
        self,
        system: System,
        net: Net,
        wiring: Wiring,
        flanges: dict[tuple[str, str], Motion],
        p: Expression,
        values: NDArray[np.float64],
        note: Callable[[Expression], object],
    ) -> None:
        self.system, self.net, self.wiring, self.flanges = system, net, wiring, flanges
        self.p, self.values, self._note = p, values, note
        self.sound: Masses | None = None
        self.coordinates = choose(net, p, values, note)
        self.free = [c for c in range(len(self.coordinates.names)) if c not in self.coordinates.prescribed]
        self.count = len(self.free)
        self.q = ca.SX.sym("q", self.count)
        self.v = ca.SX.sym("v", self.count)
        self._imposed: list[Expression] | None = None
        self.reactions: list[Expression] = []
        self.T = self.coordinates.transform()
        self.friction_modes = {c: ca.SX.sym(f"stick{c}") for c in sorted(self.coordinates.frictions)}
        self.guards: dict[int, Expression] = {}
        self.lost = ca.SX(0)
        self.kinetic_energy = ca.SX(0)
        self.acceleration = ca.SX(0, 1)
        wiring.solve_accelerations(self._solve, lambda: self.reactions)

    def solved(self) -> Expression:
        """Accelerations of the coordinates, shape (n, 1)."""
        self.wiring.accelerations()
        return self.acceleration

    def twists(self) -> Expression:
        """What the net says of twists as combinations of the free coordinates, shape (twists, n)."""
        entries = [(k, index, c) for k, entry in enumerate(self.net.twists) for index, c in entry.items()]
        rows, columns, values = ([entry[i] for entry in entries] for i in range(3))
        shape = len(self.net.twists), len(self.net.motions)
        return ca.mtimes(ca.SX.triplet(rows, columns, ca.vertcat(ca.SX(0, 1), *values), shape), self.T[:, self.free])

    def in_coordinates(self, expression: Expression) -> Expression:
        """Replace the motions' angles and speeds by combinations of the coordinates."""
        if not self.net.motions:
            return expression
        return ca.substitute(expression, *self._whole_substitution)

    @functools.cached_property
    def _whole_substitution(self) -> tuple[Expression, Expression]:
        """Angles and speeds of the motions, and speeds of the velocities, and what stands for them."""
        old, new = self._substitution
        old = ca.vertcat(old, *[velocity.speed for velocity in self.net.velocities])
        return old, ca.vertcat(new, *self._recursion[1])

    @functools.cached_property
    def _substitution(self) -> tuple[Expression, Expression]:
        """Angles and speeds of the motions, and what stands for them."""
        motions = self.net.motions
        old = ca.vertcat(*[m.angle for m in motions], *[m.speed for m in motions])
        return old, ca.densify(ca.vertcat(self.T @ self._all(self.q, 0), self.T @ self._all(self.v, 1)))

    @functools.cached_property
    def _recursion(self) -> tuple[Expression, list[Expression]]:
        """C over motions and velocities, in coordinates, and the speeds of the velocities."""
        first = len(self.net.motions)
        matrix = ca.SX(len(self.net.velocities), first + len(self.net.velocities))
        for k, velocity in enumerate(self.net.velocities):
            for index, coefficient in velocity.terms.items():
                matrix[k, self._place(index)] = coefficient
        if not self.net.velocities:
            return matrix, []
        matrix = ca.substitute(matrix, *self._substitution)
        speeds: list[Expression] = ca.vertsplit(self._substitution[1])[first:]
        for row in recursion.rows_of(matrix):
            speeds.append(sum((c * speeds[j] for j, c in row.items()), ca.SX(0)))
        return matrix, speeds[first:]

    def _bias(self) -> Expression:
        """What the turning of coefficients adds to the accelerations of the velocities."""
        motions, velocities = self.net.motions, self.net.velocities
        speed = {m.index: m.speed for m in motions} | {entry.index: entry.speed for entry in velocities}
        coefficients = ca.vertcat(ca.SX(0, 1), *[c for velocity in velocities for c in velocity.terms.values()])
        q, v = ca.vertcat(*[m.angle for m in motions]), ca.vertcat(*[m.speed for m in motions])
        change = iter(ca.vertsplit(ca.jtimes(coefficients, q, v)))
        rows = [sum((next(change) * speed[index] for index in entry.terms), ca.SX(0)) for entry in velocities]
        return self.in_coordinates(ca.vertcat(ca.SX(0, 1), *rows))

    def _all(self, free: Expression, order: int) -> Expression:
        """All coordinates (or their derivative of that order) from the free ones and what is imposed."""
        if not self.coordinates.prescribed:
            return free
        if self._imposed is None:
            pairs = self.coordinates.prescribed.values()
            self._imposed = [self._motion(entry) / scale for entry, scale in pairs]
        rows = {c: motion[order] for c, motion in zip(self.coordinates.prescribed, self._imposed, strict=True)}
        rows |= {c: free[i] for i, c in enumerate(self.free)}
        return ca.vertcat(*[rows[c] for c in range(len(rows))])

    def imposed_motion(self) -> Expression:
        """What impositions add to the motions' angles, then to their speeds; shape (2 * motions, 1)."""
        none = ca.SX.zeros(self.count, 1)
        return ca.densify(ca.vertcat(self.T @ self._all(none, 0), self.T @ self._all(none, 1)))

    def _motion(self, entry: Prescription) -> Expression:
        """Angle, speed and acceleration of an imposed motion, as one column."""
        angle = self.wiring.resolve(entry.angle)
        if entry.speed is not None and entry.acceleration is not None:
            rows: Expression = ca.vertcat(
                angle, self.wiring.resolve(entry.speed), self.wiring.resolve(entry.acceleration)
            )
        else:
            counters = [event.count for event in self.net.time_events]
            known = {hash_symbol(s) for s in [self.net.time, *counters, *ca.symvar(self.p)]}
            if any(hash_symbol(s) not in known for s in ca.symvar(angle)):
                raise StructureError(
                    f"the motion that '{entry.owner}' imposes cannot be differentiated",
                    self.system.place(entry.owner),
                    "impose a formula of time, or let the block filter its input",
                )
            speed = ca.jacobian(angle, self.net.time)
            rows = ca.vertcat(angle, speed, ca.jacobian(speed, self.net.time))
        own = {hash_symbol(m.angle) for m in self.net.motions} | {hash_symbol(m.speed) for m in self.net.motions}
        if any(hash_symbol(s) in own for s in ca.symvar(rows)):
            raise StructureError(
                f"the motion that '{entry.owner}' imposes depends on the mechanism's own motion",
                self.system.place(entry.owner),
                "impose it through a filter, or use a torque and a controller",
            )
        return rows

    def _forces(self) -> Expression:
        f = ca.SX.zeros(len(self.net.motions) + len(self.net.velocities), 1)
        for index, value in self.net.forces.items():
            f[self._place(index)] += value
        return f

    def _mass(self) -> Expression:
        n = len(self.net.motions)
        mass = ca.SX(n + len(self.net.velocities), n + len(self.net.velocities))
        for (i, j), value in self.net.masses.items():
            mass[self._place(i), self._place(j)] = value
        return mass

    def _place(self, index: int) -> int:
        """Where a motion or velocity stands among all: the motions, then the velocities."""
        return index if index >= 0 else len(self.net.motions) - 1 - index

    def _dry(self, coordinate: int) -> tuple[Expression, Expression, Expression, Expression]:
        """Friction (real units, along the coordinate), static levels forward and backward, and the power it takes."""
        mode = self.friction_modes[coordinate]
        force = forward_level = backward_level = power = ca.SX(0)
        for entry, scale in self.coordinates.frictions[coordinate]:
            size = ca.fabs(scale)
            self._note(scale)
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
        """Accelerations of the motions; also fills guards, reactions, energy and losses."""
        names, free = self.coordinates.names, self.free
        if not names:
            return [ca.SX(0) for _ in self.net.motions]
        velocities = len(self.net.velocities)
        free = [*free, *range(len(names), len(names) + velocities)]
        onto = ca.diagcat(self.T, ca.SX.eye(velocities))
        weights = ca.diag(ca.vertcat(*self.coordinates.weights))
        mass0, force0 = (self.in_coordinates(self.wiring.resolve(part)) for part in (self._mass(), self._forces()))
        whole = onto.T @ weights @ mass0 @ onto
        force = onto.T @ weights @ force0
        imposed = ca.vertcat(self._all(ca.SX.zeros(self.count, 1), 2), ca.SX.zeros(velocities, 1))
        mass, push = whole[free, free], (force - whole @ imposed)[free, 0]
        steps = self._recursion[0] @ onto
        bias = self._bias() + steps @ imposed
        self._check_mass(mass, steps[:, free])
        dry_power = ca.SX(0)
        levels: dict[int, tuple[Expression, Expression]] = {}
        slip = ca.SX.ones(self.count + velocities, 1)
        for c, mode in self.friction_modes.items():
            dry, ahead, behind, power = (self.in_coordinates(self.wiring.resolve(e)) for e in self._dry(c))
            weight, i = self._weight(c), free.index(c)
            push[i] -= weight * dry
            levels[c] = (weight * ahead, weight * behind)
            dry_power += power
            slip[i] = mode * mode
        masked, masked_steps = mass, steps[:, free]
        if self.friction_modes:
            masked = ca.diag(slip) @ mass @ ca.diag(slip) + ca.diag(1 - slip)
            masked_steps = masked_steps @ ca.diag(slip)
        found = ca.SX(0, 1)
        if velocities:
            found = recursion.solve(masked, slip * push, masked_steps, bias)
        elif free:
            found = solve(masked, slip * push, self.p, list(self.friction_modes.values()))
        self.acceleration, rest = ca.vertsplit(found, [0, self.count, len(free)])
        residuals = recursion.gather(push - mass @ found, steps[:, free])
        for c, (ahead, behind) in levels.items():
            i, mode = free.index(c), self.friction_modes[c]
            residual = residuals[i]
            above = ca.if_else(mode == 0, residual - ahead, -mode * self.v[i])
            below = ca.if_else(mode == 0, -residual - behind, -1)
            self.guards[c] = ca.vertcat(above, below)
        everything = ca.vertcat(self._all(self.acceleration, 2), rest)
        motions = onto @ everything
        balance = recursion.gather(whole @ everything - force, steps)
        self.reactions = [
            balance[c] / (scale * self.coordinates.weights[entry.motion])
            for c, (entry, scale) in self.coordinates.prescribed.items()
        ]
        speed = ca.vertcat(self.T @ self._all(self.v, 1), *self._recursion[1])
        self.kinetic_energy = ca.dot(speed, mass0 @ speed) / 2
        self.lost = dry_power
        if any(tie.efficiency is not None for tie in self.net.ties):
            work = sum(
                (
                    r * speed[e.motion]
                    for r, (e, _) in zip(self.reactions, self.coordinates.prescribed.values(), strict=True)
                ),
                ca.SX(0),
            )
            self.lost = ca.dot(speed, force0 - mass0 @ motions) + work
        return [motions[i] for i in range(len(self.net.motions))]

    def _weight(self, coordinate: int) -> Expression:
        entry, _ = self.coordinates.frictions[coordinate][0]
        return self.coordinates.weights[next(iter(entry.terms))]

    def _check_mass(self, mass: Expression, steps: Expression) -> None:
        """Refuse a massless coordinate by the names of the flanges that move with it."""
        known = {hash_symbol(s) for s in ca.symvar(ca.vertcat(self.q, self.p))}
        others = [s for s in ca.symvar(ca.veccat(mass, steps)) if hash_symbol(s) not in known]
        function = ca.Function("mass", [self.q, self.p, ca.vertcat(*others)], [ca.densify(mass), ca.densify(steps)])
        self.sound = Masses(function)
        wrong = self.sound.lacking(self.values)
        if wrong is not None:
            raise self._massless(*wrong)

    def _massless(self, coordinate: int, what: str) -> StructureError:
        rows = zip(self.net.motions, self.coordinates.rows, strict=True)
        movers = [motion.name for motion, row in rows if self.free[coordinate] in row]
        flanges = [
            f"{block}.{port}" for (block, port), motion in self.flanges.items() if motion.name in movers
        ] or movers
        loose = [end for end in self.system.loose() if end in flanges]
        unconnected = f", and nothing is connected to {' and '.join(loose)}" if loose else ""
        return StructureError(
            f"the motion of {' = '.join(flanges)} {what}{unconnected}",
            self.system.place(flanges[0].split(".")[0]),
            f"{'connect it, or ' if loose else ''}give it an inertia (an Inertia or Mass block, or the block's own "
            "inertia), or merge it with its neighbour",
        )
