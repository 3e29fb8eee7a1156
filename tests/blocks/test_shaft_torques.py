"""Torque ripple, drag, gravity and payload: closed forms and the energy balance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from blocks.actuators.gravity_torque import GravityTorque
from blocks.actuators.quadratic_drag import QuadraticDrag
from blocks.actuators.torque_ripple import TorqueRipple
from blocks.links.inertia import Inertia
from blocks.links.payload import Payload
from engine.block import Block
from tests.blocks.assembly import linear, run
from tests.blocks.test_drive_train import balance

J = 2e-3


@pytest.mark.parametrize(("order", "phase"), [(2.0, 0.0), (7.0, 0.4), (24.0, -1.0)])
def test_a_body_coasts_over_the_ripple(order: float, phase: float) -> None:
    """J w^2 / 2 changes by the work of A sin(n phi + phase); nothing is lost."""
    amplitude, speed = 0.02, 9.0
    parts: dict[str, Block] = {
        "body": Inertia(inertia=J),
        "ripple": TorqueRipple(amplitude=amplitude, order=order, phase=phase),
    }
    result = run(parts, "body.shaft ripple.shaft", stop=2.0, internal_step=1e-4, initial={"body.shaft.speed": speed})
    phi = result["body.shaft.angle"]
    work = amplitude / order * (np.cos(phase) - np.cos(order * phi + phase))
    np.testing.assert_allclose(result["body.shaft.speed"], np.sqrt(speed**2 + 2 * work / J), rtol=1e-8)
    np.testing.assert_allclose(result["ripple.torque"], amplitude * np.sin(order * phi + phase), rtol=0, atol=1e-15)
    assert result["energy.dissipated"][-1] == 0
    assert balance(result) < 1e-9


def test_ripple_has_stable_angles() -> None:
    """About n phi + phase = pi the ripple is a spring of n A."""
    parts: dict[str, Block] = {
        "body": Inertia(inertia=J),
        "ripple": TorqueRipple(amplitude=0.02, order=12, phase=np.pi),
    }
    poles = linear(parts, "body.shaft ripple.shaft").poles()
    np.testing.assert_allclose(np.sort(poles.imag), np.array([-1, 1]) * np.sqrt(12 * 0.02 / J), rtol=1e-12)


@pytest.mark.parametrize("speed", [30.0, -30.0])
def test_drag_slows_as_one_over_time(speed: float) -> None:
    c = 4e-5
    parts: dict[str, Block] = {"body": Inertia(inertia=J), "drag": QuadraticDrag(drag=c)}
    result = run(parts, "body.shaft drag.shaft", stop=5.0, initial={"body.shaft.speed": speed})
    exact = speed / (1 + c * abs(speed) / J * result.time)
    np.testing.assert_allclose(result["body.shaft.speed"], exact, rtol=1e-9)
    assert balance(result) < 1e-9


ROD = {"mass": 0.18002, "radius": 0.33 / 2}
"""[Mohan 2010, Table 1]: a rod of 0.33 m, rho a = 0.18002 kg; I = 6.5640e-3 kg.m2 with its hub."""


def test_pendulum_of_paper_003() -> None:
    """Computed independently: wn = 6.6623 rad/s = 1.0603 Hz, and 1.0594 Hz at 7 deg."""
    payload = Payload(**ROD, inertia=0.18002 * 0.33**2 / 12 + 2.95e-5)
    parts: dict[str, Block] = {"rod": payload, "weight": GravityTorque(**ROD)}
    wire = "rod.shaft weight.shaft"
    pole = linear(parts, wire).poles()[-1]
    assert abs(pole) == pytest.approx(6.6623, abs=5e-4)
    start = np.radians(7)
    result = run(parts, wire, stop=10.0, initial={"rod.shaft.angle": start})
    angle = result["rod.shaft.angle"]
    rising = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    crossings = result.time[rising] - angle[rising] * 1e-3 / (angle[rising + 1] - angle[rising])
    frequency = (len(crossings) - 1) / (crossings[-1] - crossings[0])
    assert frequency == pytest.approx(1.0594, abs=1e-4)
    exact = abs(pole) / (4 * special.ellipk(np.sin(start / 2) ** 2))
    assert frequency == pytest.approx(exact, rel=1e-6)
    assert balance(result) < 1e-8


def test_weight_pulls_where_it_should() -> None:
    """A body held level, a quarter turn from hanging, feels -m g r; upside down it is unstable."""
    weight = GravityTorque(mass=2.0, radius=0.5, gravity=10.0, hanging_angle=0.3)
    parts: dict[str, Block] = {"body": Inertia(inertia=0.4), "weight": weight}
    wire = "body.shaft weight.shaft"
    for offset, torque in ((0.0, 0.0), (np.pi / 2, -10.0), (-np.pi / 2, 10.0), (np.pi / 6, -5.0)):
        result = run(parts, wire, stop=0.01, initial={"body.shaft.angle": 0.3 + offset})
        assert result["weight.torque"][0] == pytest.approx(torque, abs=1e-12)
        assert result["body.shaft.acceleration"][0] == pytest.approx(torque / 0.4, abs=1e-12)
        assert result["energy.stored"][0] == pytest.approx(10.0 * (1 - np.cos(offset)), abs=1e-12)
    upright = linear(parts, wire, at={"body.shaft.angle": 0.3 + np.pi}).poles()
    np.testing.assert_allclose(np.sort(upright.real), [-5.0, 5.0], rtol=1e-12)


def test_payload_adds_its_inertia() -> None:
    parts: dict[str, Block] = {"body": Inertia(inertia=J), "load": Payload(mass=0.2, radius=0.1, inertia=1e-4)}
    result = run(parts, "body.shaft load.shaft", stop=0.01, initial={"body.shaft.speed": 3.0})
    assert result["energy.stored"][0] == pytest.approx((J + 0.2 * 0.01 + 1e-4) * 4.5, rel=1e-14)
