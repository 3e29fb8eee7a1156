"""The discrete-time linear model against scipy's zero-order hold and against simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete

from blocks.actuators.dc_motor import DCMotor
from blocks.actuators.friction import BearingFriction
from blocks.controllers.low_pass import LowPass
from blocks.controllers.pi import PI
from blocks.links.inertia import Inertia
from engine.assemble import build
from engine.block import Block
from engine.discretise import discretise
from engine.errors import ParameterError
from engine.linearise import linearise
from engine.model import Model
from engine.simulate import Drive, simulate
from engine.system import Connection, System

J, C, KT, R, KP, KI, T = 2e-3, 1e-3, 0.05, 2.0, 4.0, 30.0, 0.02


def _loop(filtered: bool = False, offset: float = 0.0) -> Model:
    blocks: dict[str, Block] = {
        "pi": PI(proportional_gain=f"{KP} V.s/rad", integral_gain=f"{KI} V/rad", period=T, sample_offset=offset),
        "motor": DCMotor(resistance=R, torque_constant=KT, back_emf_constant=KT, rotor_inertia=J),
        "drag": BearingFriction(viscous_friction=C),
        "disc": Inertia(inertia=J),
    }
    wires = [("pi.out", "motor.voltage"), ("motor.shaft", "drag.shaft", "disc.shaft")]
    if filtered:
        blocks["filter"] = LowPass(corner_frequency="3 Hz", period=2 * T)
        wires += [("motor.shaft.speed", "filter.in"), ("filter.out", "pi.measurement")]
    else:
        wires += [("motor.shaft.speed", "pi.measurement")]
    system = System(blocks, [Connection(ends) for ends in wires], name="loop")
    return build(system, inputs=["pi.reference"], outputs=["motor.shaft.speed", "pi.out"])


def test_poles_of_a_sampled_loop_by_hand() -> None:
    """Speed control of a first-order plant: z^2 - (1 + a - b kp) z + a - b kp + b ki T for forward Euler."""
    rate, gain = (C + KT**2 / R) / (2 * J), KT / R / (2 * J)
    a, b = (float(m[0, 0]) for m in cont2discrete(tuple(np.array([[v]]) for v in (-rate, gain, 1.0, 0.0)), T)[:2])
    found = discretise(_loop())
    assert found.dt == T
    poles = found.poles()
    poles = np.sort_complex(poles[np.abs(poles - 1) > 1e-9])  # the shaft's angle integrates
    moving = poles[np.abs(poles) > 1e-12]
    forward = np.roots([1, -(1 + a) + b * KP, a - b * KP + b * KI * T])
    np.testing.assert_allclose(np.sort_complex(moving), np.sort_complex(forward), rtol=1e-10)


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("offset", [0.0, 0.005])
def test_equals_the_simulation_of_a_linear_loop(filtered: bool, offset: float) -> None:
    model = _loop(filtered, offset)
    found = discretise(model)
    assert found.dt == pytest.approx(2 * T if filtered else T, rel=1e-15)
    rng = np.random.default_rng(1)
    u = rng.standard_normal(40)
    drive = Drive(np.arange(40) * found.dt, u[:, None])
    run = simulate(model, 39 * found.dt, found.dt, drive=drive, internal_step=1e-4)
    x, rows = np.zeros(len(found.A)), []
    for value in u:
        rows.append(found.C @ x + found.D @ [value])
        x = found.A @ x + found.B @ [value]
    np.testing.assert_allclose(rows, run.values, rtol=1e-9, atol=1e-9)


def test_gain_and_python_control_agree() -> None:
    found = discretise(_loop())
    system = found.to_control()
    assert system.dt == T
    w = 7.0
    np.testing.assert_allclose(found.gain(w), np.atleast_2d(system(np.exp(1j * w * T)).reshape(2, 1)), rtol=1e-9)


def test_names_units_and_drift() -> None:
    model = _loop()
    plain, found = linearise(model), discretise(model)
    assert found.states == (*plain.states, *(m.name for m in model.memories))
    assert found.continuous == plain.states
    assert found.drift == {}
    # With a reference held at the point the integrator winds up, so that is no equilibrium.
    assert discretise(model, inputs={"pi.reference": 1.0}).drift


def test_refuses_a_model_without_clocks() -> None:
    system = System({"disc": Inertia(inertia=J), "drag": BearingFriction(viscous_friction=C)}, [], name="disc")
    system.connections.append(Connection(("disc.shaft", "drag.shaft")))
    with pytest.raises(ParameterError, match="no sampled block"):
        discretise(build(system, outputs=["disc.shaft.speed"]))


def test_a_model_is_the_same_whatever_was_done_with_it() -> None:
    untouched, used = _loop(), _loop()
    linearise(used)
    discretise(used)
    simulate(used, 0.01, 1e-3, drive=Drive([0.0], [[1.0]]))
    assert used.signature == untouched.signature
    assert used.functions.keys() == untouched.functions.keys()
    with pytest.raises(TypeError):
        used.functions["jacobian"] = None  # type: ignore[index]
    with pytest.raises(TypeError):
        used.initial["disc.shaft.speed"] = 1.0  # type: ignore[index]
