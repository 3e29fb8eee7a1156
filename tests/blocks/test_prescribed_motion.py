"""Imposed motion: the path, the effort it takes, and the energy that comes in."""

from __future__ import annotations

import numpy as np
import pytest

from blocks.actuators.prescribed_motion import PrescribedMotion, TranslationalPrescribedMotion
from blocks.actuators.spring_damper import SpringDamper, TranslationalSpringDamper
from blocks.controllers.low_pass import LowPass
from blocks.links.inertia import Inertia, Mass
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import StructureError
from tests.blocks.assembly import model, run
from tests.blocks.test_drive_train import balance


def test_an_exact_course_is_followed_exactly() -> None:
    """A body on a damped spring whose end is moved: the torque is J a + tau, and its work is all that enters."""
    amplitude, frequency, k, d, j1, j2 = 0.2, 2.0, 30.0, 0.3, 0.01, 0.05
    parts: dict[str, Block] = {
        "course": Sine(amplitude=f"{amplitude} rad", frequency=frequency),
        "motion": PrescribedMotion(),
        "shaft": Inertia(inertia=j1),
        "spring": SpringDamper(stiffness=k, damping=d),
        "body": Inertia(inertia=j2),
    }
    wires = ["course.out motion.angle", "motion.shaft shaft.shaft spring.a", "spring.b body.shaft"]
    result = run(parts, *wires, stop=8.0, internal_step=5e-4)
    w, t = 2 * np.pi * frequency, result.time
    np.testing.assert_allclose(result["shaft.shaft.angle"], amplitude * np.sin(w * t), rtol=0, atol=1e-15)
    np.testing.assert_allclose(result["shaft.shaft.speed"], amplitude * w * np.cos(w * t), rtol=0, atol=1e-14)
    torque = -j1 * amplitude * w**2 * np.sin(w * t) + result["spring.torque"]
    np.testing.assert_allclose(result["motion.torque"], torque, rtol=0, atol=1e-12)
    late = t > 4.0
    response = (k + 1j * w * d) / (k + 1j * w * d - j2 * w**2)
    settled = np.imag(amplitude * response * np.exp(1j * w * t))[late]
    np.testing.assert_allclose(result["body.shaft.angle"][late], settled, rtol=0, atol=2e-6)
    assert balance(result) < 1e-8


def test_a_filtered_course_is_critically_damped() -> None:
    """A step of the input: x = u (1 - (1 + w t) exp(-w t)), torque J x'' = J u w^2 (1 - w t) exp(-w t)."""
    height, w, inertia = 0.4, 60.0, 0.02
    parts: dict[str, Block] = {
        "course": Step(height=f"{height} rad"),
        "motion": PrescribedMotion(course="filtered", corner_frequency=w),
        "shaft": Inertia(inertia=inertia),
        "spring": SpringDamper(stiffness=0.5),
        "body": Inertia(inertia=0.1),
    }
    wires = ["course.out motion.angle", "motion.shaft shaft.shaft spring.a", "spring.b body.shaft"]
    result = run(parts, *wires, stop=0.3, internal_step=2e-4)
    fade = np.exp(-w * result.time)
    path = height * (1 - (1 + w * result.time) * fade)
    np.testing.assert_allclose(result["shaft.shaft.angle"], path, rtol=0, atol=1e-9)
    torque = inertia * height * w**2 * (1 - w * result.time) * fade + result["spring.torque"]
    np.testing.assert_allclose(result["motion.torque"], torque, rtol=0, atol=1e-6)
    assert balance(result) < 1e-6


def test_a_filtered_course_begins_where_it_is_told() -> None:
    parts: dict[str, Block] = {
        "course": Step(height="0.7 rad"),
        "motion": PrescribedMotion(course="filtered", start_angle=0.7),
        "shaft": Inertia(inertia=0.02),
        "spring": SpringDamper(stiffness=0.5),
        "body": Inertia(inertia=0.1),
    }
    wires = ["course.out motion.angle", "motion.shaft shaft.shaft spring.a", "spring.b body.shaft"]
    result = run(parts, *wires, stop=1.0, initial={"body.shaft.angle": 0.7})
    np.testing.assert_allclose(result["shaft.shaft.angle"], 0.7, rtol=0, atol=1e-14)
    np.testing.assert_allclose(result["motion.torque"], 0.0, atol=1e-12)


@pytest.mark.parametrize("course", ["exact", "filtered"])
def test_translational_twin(course: str) -> None:
    mass, k, amplitude, frequency, w = 2.0, 400.0, 0.01, 3.0, 250.0
    parts: dict[str, Block] = {
        "course": Sine(amplitude=f"{amplitude} m", frequency=frequency, phase=0.5 * np.pi, offset=f"{-amplitude} m"),
        "motion": TranslationalPrescribedMotion(course=course, corner_frequency=w),
        "cart": Mass(mass=mass),
        "spring": TranslationalSpringDamper(stiffness=k, damping=20.0),
        "rider": Mass(mass=0.3),
    }
    wires = ["course.out motion.position", "motion.flange cart.flange spring.a", "spring.b rider.flange"]
    result = run(parts, *wires, stop=2.0, internal_step=2e-4)
    omega, t = 2 * np.pi * frequency, result.time
    gain = 1.0 if course == "exact" else 1 / (1 + 1j * omega / w) ** 2
    late = t > 1.0
    path = np.real(amplitude * gain * np.exp(1j * omega * t)) - amplitude
    np.testing.assert_allclose(result["cart.flange.position"][late], path[late], rtol=0, atol=1e-9)
    force = mass * result["cart.flange.acceleration"] + result["spring.force"]
    np.testing.assert_allclose(result["motion.force"], force, rtol=0, atol=1e-11)
    assert balance(result) < 1e-6


def test_what_cannot_be_differentiated_is_refused() -> None:
    parts: dict[str, Block] = {
        "course": Step(height="1 rad"),
        "filter": LowPass(corner_frequency=10),
        "motion": PrescribedMotion(),
        "shaft": Inertia(inertia=0.02),
    }
    wires = ["course.out filter.in", "filter.out motion.angle", "motion.shaft shaft.shaft"]
    with pytest.raises(StructureError, match="the motion that 'motion' imposes cannot be differentiated"):
        model(parts, *wires)
