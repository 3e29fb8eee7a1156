"""Places of the fictitious joints of a lumped arm, and the masses of its elements.

The rule of [One-link n.d., sec. 3.2] made explicit: begin with the undivided arm; each further
joint puts one joint into the middle of every rigid element and discards the joints before. So n joints give n + 1
elements, of lengths 1/2, 1/2; then 1/4, 1/2, 1/4; then 1/8, 3/8, 3/8, 1/8 of the arm, and so on.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


@functools.cache
def element_lengths(joints: int) -> tuple[float, ...]:
    """Lengths of the ``joints`` + 1 rigid elements from the hub to the tip, as shares of the arm's length."""
    edges = np.array([0.0, 1.0])
    for _ in range(joints):
        edges = np.concatenate(([0.0], (edges[:-1] + edges[1:]) / 2, [1.0]))
    return tuple(float(length) for length in np.diff(edges))


@functools.cache
def mass_matrix(joints: int) -> Matrix:
    """Mass matrix over the absolute element angles, hub first, without hub inertia and payload.

    Each element's mass is a point at its middle, whose path is the lengths of the elements before it, times their
    angles, and half its own.

    Returns:
        Shares of mass * length^2, shape (joints + 1, joints + 1).
    """
    lengths = np.array(element_lengths(joints))
    paths = np.tril(np.tile(lengths, (joints + 1, 1)), -1) + np.diag(lengths / 2)
    return np.asarray((paths.T * lengths) @ paths)


def natural_stiffness(joints: int) -> Vector:
    """Stiffness of each joint that stands for its share of a uniform beam, in flexural rigidity / length.

    A joint takes the bending of half of either neighbour, and of all of the first and the last element.
    """
    lengths = np.array(element_lengths(joints))
    share = (lengths[:-1] + lengths[1:]) / 2
    share[0] += lengths[0] / 2
    share[-1] += lengths[-1] / 2
    return np.asarray(1 / share)
