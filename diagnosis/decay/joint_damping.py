"""Joint damping coefficients: from a ratio, and from the values that Mohan, Singh and Saha print.

A joint with viscous damping d (N.m.s/rad) on an inertia I (kg.m2 about the joint) that swings at w (rad/s):

    I q'' + d q' + I w^2 q = 0            d = xi 2 I w          (2 I w is the critical damping)

Mohan, Singh and Saha multiply the measured ratio by kappa_bar = 4 pi rho a f, eq (7c). That is 2 m w with the mass
m = rho a: the critical damping of a translated mass, in kg/s, not of a link that turns. In the equation of motion (8),
as N.m.s/rad, their kappa damps 2 m w / (2 I w) = m / I times too much, about 25 times for the link of table 1. A
uniform link has I = m a^2 / 3, so a published kappa times a^2 / 3 is the coefficient that was measured.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

from diagnosis.decay.record import DampingWarning
from engine.errors import ParameterError


def critical_joint_damping(inertia: float, frequency: float) -> float:
    """Critical damping 2 I w of a joint (N.m.s/rad).

    Args:
        inertia: about the joint (kg.m2).
        frequency: natural frequency (Hz).
    """
    _positive(inertia=inertia, frequency=frequency)
    return 4 * math.pi * inertia * frequency


def joint_damping(ratio: float, inertia: float, frequency: float) -> float:
    """Joint damping coefficient (N.m.s/rad) of a measured damping ratio.

    Args:
        ratio: xi.
        inertia: about the joint (kg.m2).
        frequency: natural frequency (Hz).
    """
    return ratio * critical_joint_damping(inertia, frequency)


def published_critical_factor(mass: float, frequency: float) -> float:
    """kappa_bar of Mohan, Singh and Saha, eq (7c): 4 pi rho a f = 2 m w (kg/s), reproduced as printed.

    Args:
        mass: rho a (kg).
        frequency: Hz.
    """
    _positive(mass=mass, frequency=frequency)
    return 4 * math.pi * mass * frequency


@dataclass(frozen=True)
class PublishedDamping:
    """The meaning of a published kappa.

    Attributes:
        kappa: as printed (kg/s).
        damping: the coefficient that was measured, kappa a^2 / 3 (N.m.s/rad).
        ratio: damping ratio of ``damping`` in the equation of motion.
        literal_ratio: damping ratio if ``kappa`` itself is used as N.m.s/rad.
        excess: literal_ratio / ratio.
        warnings: sentences on the literal use.
    """

    kappa: float
    damping: float
    ratio: float
    literal_ratio: float
    excess: float
    warnings: tuple[str, ...]


def published_joint_damping(kappa: float, length: float, inertia: float, frequency: float) -> PublishedDamping:
    """Convert a published kappa into a joint damping, and state the effect of its literal use.

    Args:
        kappa: as printed (kg/s).
        length: of the link (m).
        inertia: of link and hub about the joint (kg.m2).
        frequency: natural frequency of the joint's oscillation (Hz).

    Warns:
        DampingWarning: always, with the ratio that the printed number means in the equation of motion.
    """
    _positive(kappa=kappa, length=length)
    critical = critical_joint_damping(inertia, frequency)
    damping = kappa * length**2 / 3
    literal, ratio = kappa / critical, damping / critical
    swing = (
        f"of each amplitude {100 * math.exp(-2 * math.pi * literal / math.sqrt(1 - literal**2)):.2g} % "
        "is left after one period"
        if literal < 1
        else "the joint creeps back without swinging"
    )
    sentence = (
        f"kappa = {kappa:g} kg/s used as a joint damping in N.m.s/rad means a damping ratio of {literal:.3f} "
        f"({swing}); the coefficient that was measured is kappa a^2 / 3 = {damping:.4g} N.m.s/rad, ratio {ratio:.4f}"
    )
    warnings.warn(sentence, DampingWarning, stacklevel=2)
    return PublishedDamping(kappa, damping, ratio, literal, literal / ratio, (sentence,))


def modal_damping(ratio: float, mass: float, stiffness: float) -> float:
    """Modal damping coefficient 2 xi sqrt(K M) in whatever normalisation M and K have.

    Args:
        ratio: xi.
        mass: modal mass M.
        stiffness: modal stiffness K.
    """
    _positive(mass=mass, stiffness=stiffness)
    return 2 * ratio * math.sqrt(stiffness * mass)


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(f"{name} = {value:g} is not a positive number")
