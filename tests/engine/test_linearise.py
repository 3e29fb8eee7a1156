"""Zeros and gains of linear models against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from engine.assemble import build
from engine.linearise import _by_magnitude, linearise, transmission_zeros
from tests.engine.parts import Anchor, Body, Dry, Push, Spring, system


def test_zeros_of_two_masses_are_those_of_the_clamped_one() -> None:
    plant = system(
        {"t": Push(), "a": Body(inertia=0.2), "s": Spring(stiffness=30.0, damping=0.04), "b": Body(inertia=0.5)},
        ("t.shaft", "a.shaft", "s.a"),
        ("s.b", "b.shaft"),
    )
    linear = linearise(build(plant, inputs=["t.in"], outputs=["a.shaft.angle", "b.shaft.angle"]))
    clamped = np.roots([0.5, 0.04, 30.0])
    assert sorted(linear.zeros(), key=np.imag) == pytest.approx(sorted(clamped, key=np.imag), rel=1e-9)
    assert linear.zeros("b.shaft.angle").real == pytest.approx([-30.0 / 0.04], rel=1e-6)
    w = 3.0
    through = 0.04j * w + 30.0
    expected = through / ((-0.2 * w**2 + through) * (-0.5 * w**2 + through) - through**2)
    assert linear.gain(w)[1, 0] == pytest.approx(expected, rel=1e-9)


def test_a_stuck_joint_passes_nothing_and_has_no_zeros() -> None:
    plant = system(
        {"t": Push(), "a": Body(inertia=0.2), "f": Dry(level=1.0), "s": Spring(stiffness=30.0), "g": Anchor()},
        ("t.shaft", "a.shaft", "f.shaft", "s.a"),
        ("s.b", "g.shaft"),
    )
    linear = linearise(build(plant, inputs=["t.in"], outputs=["a.shaft.angle"]))
    assert linear.modes == {"f": "stuck"}
    assert linear.states == ()
    assert len(linear.zeros()) == 0


def test_a_zero_transfer_has_no_zeros() -> None:
    A = np.array([[0.0, 1.0], [-250.0, 0.0]])
    assert len(transmission_zeros(A, np.zeros((2, 1)), np.zeros((1, 2)), np.zeros((1, 1)))) == 0


def test_equal_magnitudes_are_ordered_whatever_the_rounding() -> None:
    """Of a conjugate pair the lower comes first, though rounding makes it the larger one; a factor of 1e-8 counts."""
    up, down = 3e7j, -3e7j * (1 + 4e-16)
    assert abs(down) > abs(up)
    for given in ([up, down], [down, up]):
        assert _by_magnitude([*given, 1.0, -3e7 * (1 + 1e-8)]).tolist() == [1.0, down, up, -3e7 * (1 + 1e-8)]
    assert _by_magnitude([]).tolist() == []
