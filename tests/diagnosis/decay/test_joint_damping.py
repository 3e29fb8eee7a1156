"""What [Mohan 2010, sec. 3.1.1, Table 1] prints for its pendulum, and what they mean."""

from __future__ import annotations

import math

import numpy as np
import pytest

from diagnosis.decay.joint_damping import (
    critical_joint_damping,
    joint_damping,
    modal_damping,
    published_critical_factor,
    published_joint_damping,
)
from diagnosis.decay.record import DampingWarning
from engine.errors import ParameterError

DENSITY, LENGTH, HUB, GRAVITY = 0.5455, 0.33, 2.95e-5, 9.81
MASS = DENSITY * LENGTH
INERTIA = MASS * LENGTH**2 / 3 + HUB
FREQUENCY = math.sqrt(MASS * GRAVITY * LENGTH / 2 / INERTIA) / (2 * math.pi)


def test_the_pendulum() -> None:
    assert pytest.approx(0.18002, rel=1e-4) == MASS
    assert pytest.approx(6.5640e-3, rel=1e-4) == INERTIA
    assert pytest.approx(1.0603, rel=1e-4) == FREQUENCY
    assert 2 * math.pi * FREQUENCY == pytest.approx(6.6623, rel=1e-4)


def test_the_published_numbers_are_reproduced_as_printed() -> None:
    factor = published_critical_factor(MASS, 0.96)
    assert factor == pytest.approx(2.17165, rel=1e-4)
    assert round(factor, 4) in (2.1716, 2.1717)
    assert published_critical_factor(0.180, 0.96) == pytest.approx(2.17147, rel=1e-4)
    assert 0.0142 * factor == pytest.approx(0.030837, rel=1e-4)
    assert round(0.0142 * factor, 4) == 0.0308


def test_the_critical_damping_of_a_joint() -> None:
    assert critical_joint_damping(INERTIA, FREQUENCY) == pytest.approx(0.08746, rel=1e-4)
    assert critical_joint_damping(INERTIA, 0.96) == pytest.approx(0.07919, rel=1e-4)
    assert joint_damping(0.0142, INERTIA, FREQUENCY) == pytest.approx(1.242e-3, rel=2e-4)
    assert joint_damping(0.0142, INERTIA, 0.96) == pytest.approx(1.124e-3, rel=5e-4)


def test_kappa_used_as_a_joint_damping_is_flagged() -> None:
    with pytest.warns(DampingWarning, match=r"kappa = 0\.0308 .*damping ratio of 0\.352"):
        found = published_joint_damping(0.0308, LENGTH, INERTIA, FREQUENCY)
    assert found.literal_ratio == pytest.approx(0.3521, rel=2e-4)
    assert found.damping == pytest.approx(1.118e-3, rel=2e-4)
    assert found.ratio == pytest.approx(0.01278, rel=5e-4)
    assert found.literal_ratio / 0.0142 == pytest.approx(24.8, rel=1e-3)
    assert found.excess == pytest.approx(3 / LENGTH**2, rel=1e-12)
    assert "1.118e-03" in found.warnings[0] or "0.001118" in found.warnings[0]


def test_the_literal_ratio_is_what_the_equation_of_motion_shows() -> None:
    # Roots of I s^2 + kappa s + I w^2, no formula of the module involved.
    roots = np.roots([INERTIA, 0.0308, MASS * GRAVITY * LENGTH / 2])
    ratio = -roots[0].real / abs(roots[0])
    assert ratio == pytest.approx(0.3521, rel=2e-4)
    assert np.exp(2 * np.pi * roots[0].real / abs(roots[0].imag)) == pytest.approx(0.094, rel=5e-3)
    assert abs(roots[0].imag) / (2 * np.pi) == pytest.approx(0.9924, rel=2e-4)


def test_an_overdamped_reading_is_said_to_creep() -> None:
    with pytest.warns(DampingWarning, match="without swinging"):
        found = published_joint_damping(0.2, LENGTH, INERTIA, FREQUENCY)
    assert found.literal_ratio > 1


def test_modal_damping_of_the_clamped_link() -> None:
    # [Mohan 2010, Table 2]: M = 0.06 kg, K = 137.600 and 5404.11 N/m.
    assert modal_damping(1.0, 0.06, 137.600) == pytest.approx(5.7464, rel=1e-4)
    assert modal_damping(0.198, 0.06, 137.600) == pytest.approx(1.1378, rel=1e-4)
    assert modal_damping(0.0428, 0.06, 5404.11) == pytest.approx(1.5413, rel=1e-4)


def test_impossible_values_are_refused() -> None:
    with pytest.raises(ParameterError, match="inertia"):
        critical_joint_damping(0.0, 1.0)
    with pytest.raises(ParameterError, match="frequency"):
        published_critical_factor(0.18, math.nan)
    with pytest.raises(ParameterError, match="kappa"):
        published_joint_damping(-1.0, LENGTH, INERTIA, FREQUENCY)
