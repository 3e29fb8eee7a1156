"""Fit the lumped arm with three joints to the poles and zeros of [One-link n.d., Table 2].

Eight numbers are free: three joint stiffnesses, three joint dampings, the hub's inertia and its viscous friction. The
table has thirteen: one real pole, and real and imaginary parts of three pole pairs and three zero pairs. Poles and
zeros leave mass * length^2 open, so everything is in units of it. Run it to print the numbers and the comparison::

    python -m tools.fit_lumped_arm [mass * length^2 in kg.m2]

``scenarios/lumped-arm.yaml`` holds the result for 0.15 kg.m2.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blocks.links.fictitious_joints import mass_matrix
from blocks.links.joint_tuning import tune_joint_stiffness

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

TABLE = Path(__file__).resolve().parent.parent / "scenarios" / "data" / "harmonic_drive_poles_zeros.csv"
JOINTS = 3
IMAGINARY, REAL = 2e-4, 1e-2
"""Relative precision that the imaginary and the real parts are given: about that of the table's digits."""


@dataclass(frozen=True)
class LumpedArm:
    """An arm of mass * length^2 = 1 kg.m2: stiffness and damping of each joint, hub inertia, hub damping."""

    stiffness: Vector
    damping: Vector
    hub_inertia: float
    hub_damping: float

    def matrices(self) -> tuple[Matrix, Matrix, Matrix]:
        """Mass, damping and stiffness matrices over the absolute angles of hub and elements."""
        n = len(self.stiffness)
        bend = np.eye(n, n + 1, 1) - np.eye(n, n + 1)
        M, C = mass_matrix(n).copy(), bend.T @ np.diag(self.damping) @ bend
        M[0, 0] += self.hub_inertia
        C[0, 0] += self.hub_damping
        return M, C, bend.T @ np.diag(self.stiffness) @ bend

    def numbers(self) -> Vector:
        """What the table holds, in its order: real pole, then real and imaginary part of each pole and zero pair."""
        M, C, K = self.matrices()
        free, clamped = _eigenvalues(M, C, K), _eigenvalues(M[1:, 1:], C[1:, 1:], K[1:, 1:])
        pairs = [*_upper(free), *_upper(clamped)]
        return np.array(
            [free.real[np.abs(free.imag) < 1e-6].min(), *(part for e in pairs for part in (e.real, e.imag))]
        )


def _eigenvalues(M: Matrix, C: Matrix, K: Matrix) -> NDArray[np.complex128]:
    n = len(M)
    lower = -np.linalg.solve(M, np.hstack([K, C]))
    return np.asarray(np.linalg.eigvals(np.vstack([np.eye(n, 2 * n, n), lower])), dtype=complex)


def _upper(values: NDArray[np.complex128]) -> list[complex]:
    return sorted((complex(e) for e in values if e.imag > 1e-6), key=lambda e: e.imag)


def published() -> Vector:
    """The numbers of Table 2, in the order of `LumpedArm.numbers`; the pole at zero is left out."""
    with TABLE.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    entries = [(row["kind"], float(row["real_per_s"]), float(row["imag_rad_per_s"])) for row in rows]
    real = [a for _, a, b in entries if b == 0 and a != 0]
    pairs = sorted((kind, b, a) for kind, a, b in entries if b > 0)
    return np.array([*real, *(part for _, b, a in pairs for part in (a, b))])


def fit() -> LumpedArm:
    """The arm that comes nearest to Table 2, each part weighted by its precision; see `IMAGINARY` and `REAL`.

    The start is the arm whose undamped joints give the zeros, with a hub of a tenth of its inertia.
    """
    from scipy.optimize import least_squares

    table = published()
    scale = np.array([REAL, *([REAL, IMAGINARY] * (2 * JOINTS))])
    zeros = table[1:].reshape(-1, 2)[JOINTS:]
    stiffness = np.array(list(tune_joint_stiffness(zeros[:, 1].tolist(), length=1.0, mass=1.0)))
    start = np.concatenate([stiffness, 1e-4 * stiffness, [0.1, 0.5]])

    def arm(x: Vector) -> LumpedArm:
        values = np.exp(x)
        return LumpedArm(values[:JOINTS], values[JOINTS : 2 * JOINTS], float(values[-2]), float(values[-1]))

    def misfit(x: Vector) -> Vector:
        return np.asarray((arm(x).numbers() / table - 1) / scale)

    return arm(least_squares(misfit, np.log(start), xtol=1e-15, ftol=1e-15, gtol=1e-15).x)


def main() -> None:
    """Print the numbers for a scenario, and the comparison."""
    moment = float(sys.argv[1]) if len(sys.argv) > 1 else 0.15
    arm = fit()
    print(f"mass * length^2 = {moment:g} kg.m2")
    print("joint_stiffness, N.m/rad:  ", [float(f"{moment * k:.6g}") for k in arm.stiffness])
    print("joint_damping, N.m.s/rad:  ", [float(f"{moment * c:.6g}") for c in arm.damping])
    print(f"hub_inertia, kg.m2:         {moment * arm.hub_inertia:.6g}")
    print(f"hub_damping, N.m.s/rad:     {moment * arm.hub_damping:.6g}")
    names = [
        "real pole",
        *(f"{kind} {i + 1}, {part}" for kind in ("pole", "zero") for i in range(JOINTS) for part in "ab"),
    ]
    for name, ours, theirs in zip(names, arm.numbers(), published(), strict=True):
        print(f"{name:12s} {theirs:12.6g} {ours:12.6g} {100 * (ours / theirs - 1):9.4f} %")


if __name__ == "__main__":
    main()
