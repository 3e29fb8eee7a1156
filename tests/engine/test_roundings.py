"""Roundings in linear models: a gain of 1, so that a loop through an encoder is the loop without rounding."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from blocks.actuators.dc_motor import DCMotor
from blocks.controllers.pid import PID
from blocks.sensors.encoder import Encoder
from engine.assemble import build
from engine.block import Block
from engine.discretise import discretise
from engine.linearise import linearise
from engine.model import Model
from engine.roundings import has_rounding, jacobian
from engine.system import Connection, System


def servo(rounding: str, period: float, encoder_period: float) -> Model:
    blocks: dict[str, Block] = {
        "pid": PID(
            proportional_gain="8 V/rad", integral_gain="20 V/(rad.s)", derivative_gain="0.2 V.s/rad", period=period
        ),
        "motor": DCMotor(resistance=2.0, torque_constant=0.05, rotor_inertia=2e-5),
        "encoder": Encoder(counts_per_revolution=4096, rounding=rounding, period=encoder_period),
    }
    wires = [("pid.out", "motor.voltage"), ("motor.shaft", "encoder.shaft"), ("encoder.out", "pid.measurement")]
    return build(
        System(blocks, [Connection(ends) for ends in wires]), ["pid.reference"], ["motor.shaft.angle", "pid.out"]
    )


@pytest.mark.parametrize("rounding", ["floor", "round"])
@pytest.mark.parametrize("encoder_period", [0.0, 0.002])
def test_a_sampled_loop_is_that_of_an_ideal_sensor(rounding: str, encoder_period: float) -> None:
    ideal, found = (discretise(servo(kind, 0.002, encoder_period)) for kind in ("none", rounding))
    for name in "ABCD":
        np.testing.assert_allclose(getattr(found, name), getattr(ideal, name), rtol=0, atol=1e-12)
    assert found.rounded
    assert not ideal.rounded
    assert np.abs(found.poles()).max() < 1


def test_a_continuous_loop_too() -> None:
    ideal, found = (linearise(servo(kind, 0.0, 0.0)) for kind in ("none", "floor"))
    np.testing.assert_allclose(found.A, ideal.A, rtol=0, atol=1e-12)
    assert found.poles().real.max() < 0


def test_slopes_are_taken_at_the_rounded_values() -> None:
    """d/dx sin(floor(x) + ceil(y)^2) = cos(...): the slope of the outer law at what the roundings give."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    law = ca.vertcat(ca.sin(ca.floor(x) + ca.ceil(y) ** 2), ca.floor(3 * ca.floor(x) * y), x * y)
    at = ca.Function("at", [x, y], [jacobian(law, ca.vertcat(x, y))])
    found = np.array(at(2.3, 1.6).full())
    slope = np.cos(2 + 2**2)
    np.testing.assert_allclose(found, [[slope, slope * 2 * 2], [3 * 1.6, 3 * 2], [1.6, 2.3]], rtol=1e-14)
    assert has_rounding(law)
    assert not has_rounding(x * y)
