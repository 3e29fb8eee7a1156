"""A uniform arm by finite elements: Euler-Bernoulli beam, Hermite elements, clamped to a turning hub.

z(s,t) = s theta + w(s,t). What turns with the hub is clamped there; the clamped arm's lowest modes a_i, from the finite
elements with whatever the tip carries, describe w. Per mode: modal mass 1. The coupling with the hub, the tip and the
bending moment at the root come from the same matrices. Assembled with nothing but numpy and scipy.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

Array = NDArray[np.float64]

ELEMENTS = 40


@dataclass(frozen=True)
class Modes:
    """What an arm does at its hub, with modes of mass 1.

    Attributes:
        inertia: moment of inertia about the hub, tip mass included (kg.m2).
        frequency: of the clamped modes (rad/s).
        coupling: int rho s phi_i ds + mp L phi_i(L) (kg.m per unit amplitude).
        tip: phi_i(L).
        curvature: phi_i''(0), from the bending moment at the clamp.
        softening: int rho phi_i phi_j ds + mp phi_i phi_j at the tip: the unit matrix here.
        stiffening: what the shortening of the bent arm takes from T, G_ij = int N phi_i' phi_j' ds with the
            tension N(s) = rho (L^2 - s^2) / 2 + mp L at unit speed.
    """

    inertia: float
    frequency: Array
    coupling: Array
    tip: Array
    curvature: Array
    softening: Array
    stiffening: Array


def element_matrices(rho: float, rigidity: float, h: float) -> tuple[Array, Array]:
    """Consistent mass and stiffness of one element, for (w, w', w, w') at its ends."""
    M = np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h * h, 13 * h, -3 * h * h],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
        ]
    ) * (rho * h / 420)
    K = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h * h, -6 * h, 2 * h * h],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h * h, -6 * h, 4 * h * h],
        ]
    ) * (rigidity / h**3)
    return M, K


def _tension_matrix(tip_mass: float, start: float, h: float) -> Array:
    """int N(s) w'^2 of one element of a unit arm, by Gauss points (exact for this degree)."""
    points, weights = np.polynomial.legendre.leggauss(5)
    G = np.zeros((4, 4))
    for x, weight in zip((points + 1) / 2, weights / 2, strict=True):
        slope = np.array([(6 * x**2 - 6 * x) / h, 1 - 4 * x + 3 * x**2, (6 * x - 6 * x**2) / h, 3 * x**2 - 2 * x])
        s = start + x * h
        G += weight * h * ((1 - s**2) / 2 + tip_mass) * np.outer(slope, slope)
    return G


def modes(
    length: float, mass: float, rigidity: float, tip_mass: float = 0.0, count: int = 1, elements: int = ELEMENTS
) -> Modes:
    """The clamped arm's lowest modes.

    Args:
        length: of the arm (m).
        mass: of the arm, evenly spread (kg).
        rigidity: bending stiffness EI (N.m2).
        tip_mass: point mass at the tip (kg).
        count: number of modes kept.
        elements: number of finite elements.
    """
    unit = unit_modes(tip_mass / mass, count, elements)
    root = math.sqrt(mass)
    return Modes(
        inertia=mass * length**2 * unit.inertia,
        frequency=math.sqrt(rigidity / (mass * length**3)) * unit.frequency,
        coupling=root * length * unit.coupling,
        tip=unit.tip / root,
        curvature=unit.curvature / (root * length**2),
        softening=unit.softening,
        stiffening=unit.stiffening,
    )


@functools.lru_cache(maxsize=256)
def unit_modes(tip_mass: float, count: int, elements: int = ELEMENTS) -> Modes:
    """Modes of an arm of length, mass and bending stiffness 1."""
    h, size = 1 / elements, 2 * (elements + 1)
    M, K, G = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    m, k = element_matrices(1.0, 1.0, h)
    for e in range(elements):
        part = slice(2 * e, 2 * e + 4)
        M[part, part] += m
        K[part, part] += k
        G[part, part] += _tension_matrix(tip_mass, e * h, h)
    M[-2, -2] += tip_mass
    rigid = np.zeros(size)
    rigid[0::2] = np.linspace(0, 1, elements + 1)
    rigid[1::2] = 1.0

    squares, shapes = eigh(K[2:, 2:], M[2:, 2:], subset_by_index=[0, count - 1])
    full = np.zeros((size, count))
    full[2:] = shapes * np.sign(shapes[-2])
    moment = K[1] @ full - squares * (M[1] @ full)
    return Modes(
        inertia=float(rigid @ M @ rigid),
        frequency=np.sqrt(squares),
        coupling=np.asarray(rigid @ M @ full),
        tip=full[-2].copy(),
        curvature=-np.asarray(moment),
        softening=np.asarray(full.T @ M @ full),
        stiffening=np.asarray(full.T @ G @ full),
    )
