"""Harmonic drive: [One-link n.d., eq. 1] written out, its rigid limit (eq. 2), losses and the energy balance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blocks.actuators.effort import Torque
from blocks.actuators.friction import BearingFriction
from blocks.actuators.gear import Gear
from blocks.actuators.harmonic_drive import HarmonicDrive
from blocks.actuators.spring_damper import SpringDamper
from blocks.links.fixed import Fixed
from blocks.links.inertia import Inertia
from blocks.sources.pulse import Pulse
from blocks.sources.sine import Sine
from engine.block import Block
from engine.linearise import LinearModel
from engine.simulate import Drive, Result
from tests.blocks.assembly import linear, run
from tests.blocks.test_drive_train import balance

N, ROTOR, LOAD = 100.0, 1.5e-6, 0.012
WIRES = ["torque.shaft rotor.shaft drive.input", "drive.output load.shaft"]


def parts(ratio: float = N, **drive: Any) -> dict[str, Block]:
    return {
        "torque": Torque(),
        "rotor": Inertia(inertia=ROTOR),
        "drive": HarmonicDrive(ratio=ratio, **drive),
        "load": Inertia(inertia=LOAD),
    }


def plant(**drive: Any) -> LinearModel:
    outputs = ["rotor.shaft.angle", "load.shaft.angle"]
    return linear(parts(**drive), *WIRES, inputs=["torque.torque"], outputs=outputs)


@pytest.mark.parametrize("w", [1.0, 300.0, 480.0, 5e3])
def test_equation_1_written_out(w: float) -> None:
    """(Ir s^2 + S / n^2) qr - S / n qs = tm, (Is s^2 + S) qs - S / n qr = 0, S = K + D s."""
    k, d = 1000.0, 0.4
    s = 1j * w
    spring = k + d * s
    matrix = [[ROTOR * s**2 + spring / N**2, -spring / N], [-spring / N, LOAD * s**2 + spring]]
    expected = np.linalg.solve(matrix, [1, 0])
    np.testing.assert_allclose(plant(stiffness=k, damping=d).gain(w)[:, 0], expected, rtol=1e-9)


def test_tends_to_the_rigid_limit_as_one_over_k() -> None:
    """(n^2 Ir + Is) q'' = n tm: at 50 rad/s the load's answer is off by w^2 Is Ir n^2 / (K (Is + n^2 Ir)) and less."""
    w = 50.0
    rigid = -N / (N**2 * ROTOR + LOAD) / w**2
    stiffness = np.array([1e2, 1e3, 1e4, 1e5, 1e6])
    off = np.array([abs(plant(stiffness=k).gain(w)[1, 0] / rigid - 1) for k in stiffness])
    reduced = LOAD * N**2 * ROTOR / (LOAD + N**2 * ROTOR)
    np.testing.assert_allclose(off, w**2 * reduced / stiffness / (1 - w**2 * reduced / stiffness), rtol=1e-5)
    slopes = np.diff(np.log(off)) / np.diff(np.log(stiffness))
    np.testing.assert_allclose(slopes[1:], -1, atol=0.02)


def test_rigid_limit_over_time() -> None:
    """The mean of rotor and load turns as (2) says; the twist rings at sqrt(K (1 / Is + 1 / (n^2 Ir)))."""
    push = 5e-3
    for k in (1e3, 1e5):
        result = run(parts(stiffness=k), *WIRES, inputs=["torque.torque"], drive=Drive([0.0], [[push]]), stop=0.1)
        total = N**2 * ROTOR + LOAD
        rigid = N * push / total * result.time**2 / 2
        mean = (N * ROTOR * result["rotor.shaft.angle"] + LOAD * result["load.shaft.angle"]) / total
        np.testing.assert_allclose(mean, rigid, rtol=0, atol=1e-8)
        bend = 2 * N * push * LOAD / total / k
        assert np.abs(result["load.shaft.angle"] - rigid).max() < bend
        assert np.abs(result["drive.twist"]).max() == pytest.approx(bend, rel=0.02)
        poles = plant(stiffness=k).poles()
        assert poles[-1].imag == pytest.approx(np.sqrt(k * (1 / LOAD + 1 / (N**2 * ROTOR))), rel=1e-9)


def test_motor_referred_model_is_the_same() -> None:
    """(Ja, da, ka) / n^2 and n = 1."""
    geared = plant(stiffness=800.0, damping=0.3)
    alone: dict[str, Block] = {
        "torque": Torque(),
        "rotor": Inertia(inertia=ROTOR),
        "drive": HarmonicDrive(ratio=1, stiffness=800.0 / N**2, damping=0.3 / N**2),
        "load": Inertia(inertia=LOAD / N**2),
    }
    outputs = ["rotor.shaft.angle", "load.shaft.angle"]
    referred = linear(alone, *WIRES, inputs=["torque.torque"], outputs=outputs)
    for w in (3.0, 200.0, 2e3):
        ratio = geared.gain(w)[:, 0] / referred.gain(w)[:, 0]
        np.testing.assert_allclose(ratio, [1, 1 / N], rtol=1e-9)


@pytest.mark.parametrize("eta", [1.0, 0.7])
def test_constant_efficiency_is_a_lossy_gear_and_a_spring(eta: float) -> None:
    source: dict[str, Block] = {"push": Pulse(height="5 mN.m", width=0.03, period=0.1, count=3)}
    one = run(
        source | parts(stiffness=500.0, damping=0.2, efficiency=eta),
        "push.out torque.torque",
        *WIRES,
        stop=0.3,
        internal_step=1e-4,
    )
    two = run(
        source
        | {
            "torque": Torque(),
            "rotor": Inertia(inertia=ROTOR),
            "gear": Gear(ratio=N, efficiency=eta),
            "spring": SpringDamper(stiffness=500.0, damping=0.2),
            "load": Inertia(inertia=LOAD),
        },
        "push.out torque.torque",
        "torque.shaft rotor.shaft gear.input",
        "gear.output spring.a",
        "spring.b load.shaft",
        stop=0.3,
        internal_step=1e-4,
    )
    for signal in ("rotor.shaft.angle", "load.shaft.speed", "energy.dissipated"):
        np.testing.assert_allclose(one[signal], two[signal], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(one["drive.torque"], two["spring.torque"], rtol=0, atol=1e-8)
    assert balance(one) < 1e-6


def driven(loss: str, torque: float, load: float, ratio: float = N) -> Result:
    """Constant torques on both sides, from rest."""
    blocks = parts(ratio, stiffness=2e3, damping=5.0, efficiency=0.6, loss=loss) | {"pull": Torque()}
    wires = [WIRES[0], "drive.output load.shaft pull.shaft"]
    drive = Drive([0.0], [[torque, load]])
    return run(blocks, *wires, inputs=["torque.torque", "pull.torque"], drive=drive, stop=0.5)


def test_directed_loss_when_the_motor_drives_and_when_the_load_does() -> None:
    """Once the twist has settled: eta n^2 Jr while the motor drives, n^2 Jr / eta while the load does."""
    eta = 0.6
    motor = driven("directed", 4e-3, 0.0)
    rate = eta * N * 4e-3 / (eta * N**2 * ROTOR + LOAD)
    assert motor["load.shaft.acceleration"][-1] == pytest.approx(rate, rel=1e-6)
    load = driven("directed", 0.0, 0.5)
    rate = 0.5 / (LOAD + N**2 * ROTOR / eta)
    assert load["load.shaft.acceleration"][-1] == pytest.approx(rate, rel=1e-6)
    for result in (motor, load):
        assert (np.diff(result["energy.dissipated"]) >= -1e-15).all()
        assert balance(result) < 1e-6
    assert driven("constant", 4e-3, 0.0)["load.shaft.acceleration"][-1] == pytest.approx(
        motor["load.shaft.acceleration"][-1], rel=1e-6
    )
    assert driven("constant", 0.0, 0.5)["energy.dissipated"][-1] < 0, "a constant efficiency gains when the load drives"


def test_a_drive_that_reverses_loses_what_its_twin_loses() -> None:
    """n < 0, as with the circular spline held: eta n^2 Jr while the motor drives, n^2 Jr / eta while the load does."""
    eta = 0.6
    motor = driven("directed", 4e-3, 0.0, -N)
    rate = -eta * N * 4e-3 / (eta * N**2 * ROTOR + LOAD)
    assert motor["load.shaft.acceleration"][-1] == pytest.approx(rate, rel=1e-6)
    assert motor["rotor.shaft.acceleration"][-1] == pytest.approx(-N * rate, rel=1e-6)
    load = driven("directed", 0.0, 0.5, -N)
    assert load["load.shaft.acceleration"][-1] == pytest.approx(0.5 / (LOAD + N**2 * ROTOR / eta), rel=1e-6)
    for result, twin in ((motor, driven("directed", 4e-3, 0.0)), (load, driven("directed", 0.0, 0.5))):
        assert (np.diff(result["energy.dissipated"]) >= -1e-15).all()
        assert balance(result) < 1e-6
        assert result["energy.dissipated"][-1] == pytest.approx(twin["energy.dissipated"][-1], rel=1e-9)


def test_a_swinging_drive_that_reverses_balances() -> None:
    source: dict[str, Block] = {"push": Sine(amplitude="6 mN.m", frequency=7)}
    runs = []
    for ratio in (N, -N):
        blocks = source | parts(ratio, stiffness=700.0, damping=0.1, efficiency=0.75, loss="directed")
        runs.append(run(blocks, "push.out torque.torque", *WIRES, stop=0.5, internal_step=5e-5))
    forward, reversed_ = runs
    assert balance(reversed_) < 1e-6
    np.testing.assert_allclose(reversed_["rotor.shaft.angle"], forward["rotor.shaft.angle"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(reversed_["load.shaft.angle"], -forward["load.shaft.angle"], rtol=0, atol=1e-11)


def test_directed_loss_holds_the_input_within_its_band() -> None:
    """A wound drive against a wall: the input stays while eta tau / n < T < tau / (eta n), exactly."""
    blocks: dict[str, Block] = {
        "torque": Torque(),
        "rotor": Inertia(inertia=ROTOR),
        "bearing": BearingFriction(viscous_friction=1e-3),
        "drive": HarmonicDrive(ratio=N, stiffness=200.0, efficiency=0.6, loss="directed"),
        "wall": Fixed(),
    }
    wires = ["torque.shaft rotor.shaft bearing.shaft drive.input", "drive.output wall.shaft"]
    top = 4e-3
    knots = [0.0, 5.0, 8.0]
    result = run(
        blocks,
        *wires,
        inputs=["torque.torque"],
        drive=Drive(knots, [[0.0], [top], [0.0]], "linear"),
        stop=8.0,
        internal_step=2e-4,
    )
    twist, time = result["drive.twist"], result.time
    highest = twist.max()
    assert highest == pytest.approx(0.6 * N * top / 200.0, rel=2e-2)
    leave = 5.0 + 3.0 * (1 - 0.6**2)
    held = (time > 5.2) & (time < leave - 0.1)
    assert np.ptp(twist[held]) == 0.0
    times = [t for t, name, value in result.events if name == "drive" and value == -1]
    assert times[0] == pytest.approx(5.0 + 3.0 * (1 - 0.6 * 200.0 * highest / N / top), abs=1e-6)
    assert balance(result) < 1e-6


def test_swinging_drive_with_directed_loss_balances() -> None:
    source: dict[str, Block] = {"push": Sine(amplitude="6 mN.m", frequency=7)}
    blocks = source | parts(stiffness=700.0, damping=0.1, efficiency=0.75, loss="directed")
    result = run(blocks, "push.out torque.torque", *WIRES, stop=1.0, internal_step=5e-5)
    assert balance(result) < 1e-6
    assert (np.diff(result["energy.dissipated"]) >= -1e-14).all()
