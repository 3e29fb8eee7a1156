"""Stiffnesses of the fictitious joints of a lumped arm for given frequencies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from blocks.links.fictitious_joints import Matrix, Vector, element_lengths, mass_matrix, natural_stiffness
from engine.errors import ParameterError

_STARTS = 400
"""Further starting points that are tried where the uniform arm's own solution cannot be followed."""


def tune_joint_stiffness(
    frequencies: Sequence[float], *, length: float, mass: float, payload: float = 0.0
) -> tuple[float, ...]:
    """Stiffness of each fictitious joint with which the undamped arm, clamped at its hub, has given frequencies.

    Several sets of stiffnesses may give the same frequencies: two do for the arm of [One-link n.d., Table 2] with two
    joints, four with three. The set returned is the one that a uniform arm's natural stiffnesses change into as its
    frequencies are shifted steadily to those given; where that path ends, the one of all sets found that is nearest to
    the natural one in the logarithm.

    Args:
        frequencies: angular frequencies (rad/s), rising; as many as there are joints.
        length: length of the arm (m).
        mass: mass of the arm (kg).
        payload: point mass at the tip (kg).

    Returns:
        Stiffnesses from the hub to the tip (N.m/rad).

    Raises:
        ParameterError: the frequencies do not rise from above zero, or no positive stiffnesses give them; a length or
            mass that is not positive.
    """
    wanted = np.asarray(frequencies, dtype=float)
    if wanted.ndim != 1 or not wanted.size or not np.isfinite(wanted).all() or (np.diff(wanted, prepend=0) <= 0).any():
        raise ParameterError(f"frequencies {list(frequencies)} do not rise from above zero", remedy="sort them")
    for name, value, lowest in (
        ("length", length, "above"),
        ("mass", mass, "above"),
        ("payload", payload, "not below"),
    ):
        if not np.isfinite(value) or value < 0 or (value == 0 and lowest == "above"):
            raise ParameterError(f"{name} = {value:g} must be {lowest} zero")
    tip = np.array(element_lengths(len(wanted)))
    arm = _Clamped(mass_matrix(len(wanted)) + payload / mass * np.outer(tip, tip), np.log(wanted**2))
    found = arm.followed()
    if found is None:
        found = arm.searched()
    if found is None:
        raise ParameterError(
            f"no joint stiffnesses above zero give a lumped arm the frequencies {wanted.tolist()} rad/s",
            remedy="joints at the places of the rule reach only some ratios of frequencies: give fewer frequencies",
        )
    return tuple(float(k) for k in np.exp(found) * mass * length**2)


class _Clamped:
    """Eigenvalues of the clamped arm as a function of its joints' stiffnesses, all in logarithms.

    Args:
        mass: mass matrix with the hub, shape (n + 1, n + 1).
        wanted: logarithms of the squared frequencies, rising, shape (n,).
    """

    def __init__(self, mass: Matrix, wanted: Vector) -> None:
        n = len(wanted)
        self.mass, self.wanted = mass[1:, 1:], wanted
        self.bend = np.eye(n) - np.eye(n, k=-1)
        natural = np.log(natural_stiffness(n))
        self.natural = natural + wanted[0] - self.spectrum(natural)[0][0]

    def spectrum(self, stiffness: Vector) -> tuple[Vector, Matrix]:
        """Logarithms of the eigenvalues, shape (n,), and their derivatives by those of the stiffnesses, (n, n)."""
        from scipy.linalg import eigh

        k = np.exp(stiffness)
        values, shapes = eigh(self.bend.T @ np.diag(k) @ self.bend, self.mass)
        return np.log(values), ((self.bend @ shapes) ** 2).T * k / values[:, None]

    def solved(self, start: Vector, wanted: Vector, longest: float) -> Vector | None:
        """Newton's iteration; None if it does not converge or would step further than ``longest``."""
        x = start.copy()
        for _ in range(50):
            try:
                values, slope = self.spectrum(x)
                change = np.linalg.solve(slope, wanted - values)
            except (np.linalg.LinAlgError, ValueError):
                return None
            size = float(np.abs(change).max())
            if not np.isfinite(size) or size > longest:
                return None
            x = x + change
            if size < 1e-13:
                return x
        return x if size < 1e-10 else None

    def followed(self) -> Vector | None:
        """The solution on the uniform arm's own path; None where the path ends."""
        x: Vector = self.natural
        here, step = 0.0, 0.05
        begin = self.spectrum(x)[0]
        while here < 1:
            there = min(1.0, here + step)
            found = self.solved(x, begin + there * (self.wanted - begin), 0.5)
            if found is not None:
                x, here, step = found, there, 1.5 * step
            elif step < 1e-4:
                return None
            else:
                step /= 2
        return x

    def searched(self) -> Vector | None:
        """The solution nearest to the natural stiffnesses, of those found from many starts; the same every time."""
        random = np.random.default_rng(len(self.wanted))
        found: list[Vector] = []
        for _ in range(_STARTS):
            start = self.natural + random.uniform(-4, 4, len(self.wanted))
            solution = self.solved(start, self.wanted, 3.0)
            if solution is not None:
                found.append(solution)
        found.sort(key=lambda x: float(np.sum((x - self.natural) ** 2)))
        return found[0] if found else None
