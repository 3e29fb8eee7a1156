"""A mass that swings on a shaft, a torque that swings in time, laws given as curves: closed forms, numpy, energy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from blocks.actuators.effort import Torque
from blocks.actuators.prescribed_motion import PrescribedMotion
from blocks.actuators.torque_curve import TorqueCurve
from blocks.actuators.vibration import Vibration
from blocks.controllers.curve import Curve
from blocks.links.fixed import Fixed
from blocks.links.inertia import Inertia
from blocks.links.resonator import Resonator
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from engine.block import Block
from engine.errors import FlexarmError, ParameterError
from engine.simulate import Drive, simulate
from scenarios.load import load
from tests.blocks.assembly import linear, model, run
from tests.blocks.test_drive_train import balance

SHAFT, SWINGING, RATE, RATIO = 0.03, 0.012, 40.0, 0.07


def on_a_shaft(ratio: float = RATIO) -> dict[str, Block]:
    return {
        "torque": Torque(),
        "shaft": Inertia(inertia=SHAFT),
        "panel": Resonator(inertia=SWINGING, frequency=RATE, damping_ratio=ratio),
    }


WIRE = "torque.shaft shaft.shaft panel.shaft"


@pytest.mark.parametrize("ratio", [0.0, RATIO, 0.6])
def test_a_resonator_makes_a_second_mass(ratio: float) -> None:
    """The poles of two masses on a spring and a damper, from the 4 x 4 matrix of the textbook."""
    k, d = SWINGING * RATE**2, 2 * ratio * SWINGING * RATE
    pair = np.array([[1.0, -1.0], [-1.0, 1.0]])
    lower = -np.linalg.solve(np.diag([SHAFT, SWINGING]), np.hstack([k * pair, d * pair]))
    exact = np.linalg.eigvals(np.vstack([np.eye(2, 4, 2), lower]))
    found = linear(on_a_shaft(ratio), WIRE, inputs=["torque.torque"], outputs=["shaft.shaft.angle"]).poles()
    assert len(found) == 4
    swings = [sorted(p[np.abs(p) > 1.0], key=lambda s: s.imag) for p in (found, exact)]
    np.testing.assert_allclose(swings[0], swings[1], rtol=1e-9)
    # By hand: the spring sees the two masses in series.
    stretched = np.sqrt(1 + SWINGING / SHAFT)
    np.testing.assert_allclose(np.abs(swings[0]), RATE * stretched, rtol=1e-9)
    np.testing.assert_allclose(-swings[0][0].real / np.abs(swings[0][0]), ratio * stretched, rtol=1e-9, atol=1e-12)


def test_a_resonator_on_a_held_shaft_swings_as_declared() -> None:
    parts: dict[str, Block] = {
        "wall": Fixed(),
        "panel": Resonator(inertia=SWINGING, frequency=RATE, damping_ratio=RATIO),
    }
    poles = linear(parts, "wall.shaft panel.shaft").poles()
    exact = RATE * (-RATIO + 1j * np.sqrt(1 - RATIO**2))
    assert poles[np.argmax(poles.imag)] == pytest.approx(exact, rel=1e-12)


def test_a_resonator_adds_its_inertia_to_what_moves_slowly() -> None:
    found = linear(on_a_shaft(), WIRE, inputs=["torque.torque"], outputs=["shaft.shaft.angle"])
    for slow in (0.01, 0.1):
        seen = -1 / (slow**2 * found.gain(slow)[0, 0])
        assert abs(seen / (SHAFT + SWINGING) - 1) < (slow / RATE) ** 2
    # Den Hartog's absorber: apparent inertia J1 + J (1 + 2 z r) / (1 + 2 z r + r^2), r = i w / W.
    for w in (0.5 * RATE, RATE, 3.0 * RATE):
        r = 1j * w / RATE
        exact = SHAFT + SWINGING * (1 + 2 * RATIO * r) / (1 + 2 * RATIO * r + r**2)
        assert -1 / (w**2 * found.gain(w)[0, 0]) == pytest.approx(exact, rel=1e-9)


def test_a_resonator_answers_a_step_and_balances() -> None:
    """Constant torque: the twist settles as a second-order step, and the angular momentum is torque * time."""
    torque = 0.5
    parts = {**on_a_shaft(), "drive": Constant(value=torque)}
    result = run(parts, "drive.out torque.torque", WIRE, stop=2.0, internal_step=2e-4)
    stretched = np.sqrt(1 + SWINGING / SHAFT)
    w, z, t = RATE * stretched, RATIO * stretched, result.time
    held = torque / (SHAFT + SWINGING) / RATE**2
    wd = w * np.sqrt(1 - z**2)
    twist = held * (1 - np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t)))
    np.testing.assert_allclose(result["panel.twist"], twist, rtol=0, atol=1e-8 * held)
    # e = shaft - body, so the momentum of both follows from the shaft's angle and the twist.
    centre = (SHAFT + SWINGING) * result["shaft.shaft.angle"] - SWINGING * result["panel.twist"]
    np.testing.assert_allclose(centre, torque * t**2 / 2, rtol=0, atol=1e-9)
    assert balance(result) < 1e-8
    assert (np.diff(result["energy.dissipated"]) >= -1e-15).all()
    # Of the spring's energy and the swing about it, what the step put in beyond both bodies' common motion is lost.
    lost = SWINGING * RATE**2 * held**2 / 2
    assert result["energy.dissipated"][-1] == pytest.approx(lost, rel=1e-3)


@pytest.mark.parametrize("phase", [0.0, 0.9, -2.0])
def test_a_vibration_shakes_an_inertia(phase: float) -> None:
    """J x'' = A sin(W t + p) from rest: x' = A / (J W) (cos p - cos(W t + p)), and x by one more integration."""
    inertia, size, rate = 0.02, 0.3, 2 * np.pi * 7.0
    parts: dict[str, Block] = {
        "shaft": Inertia(inertia=inertia),
        "fan": Vibration(amplitude=size, frequency="7 Hz", phase=phase),
    }
    result = run(parts, "fan.shaft shaft.shaft", stop=1.3, internal_step=2e-4)
    t, top = result.time, size / (inertia * rate)
    speed = top * (np.cos(phase) - np.cos(rate * t + phase))
    angle = top * np.cos(phase) * t - top / rate * (np.sin(rate * t + phase) - np.sin(phase))
    np.testing.assert_allclose(result["shaft.shaft.speed"], speed, rtol=0, atol=1e-8)
    np.testing.assert_allclose(result["shaft.shaft.angle"], angle, rtol=0, atol=1e-8)
    np.testing.assert_allclose(result["fan.torque"], size * np.sin(rate * t + phase), rtol=0, atol=1e-12)
    np.testing.assert_allclose(result["energy.supplied"], inertia * speed**2 / 2, rtol=0, atol=1e-8)
    assert balance(result) < 1e-8


LOWER, UPPER = -2.0, 4.0
HEIGHTS = [1.5, -0.5, 0.25, 0.25, -2.0, -1.0, 3.0]


def heights(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """What numpy makes of the same points; it keeps the end values beyond."""
    return np.interp(x, np.linspace(LOWER, UPPER, len(HEIGHTS)), HEIGHTS)


def curve(of: str) -> TorqueCurve:
    return TorqueCurve(of=of, points=len(HEIGHTS), lower=LOWER, upper=UPPER, heights=HEIGHTS)


@pytest.mark.parametrize("of", ["angle", "speed"])
def test_a_torque_curve_goes_through_its_points(of: str) -> None:
    """The shaft is led past both ends."""
    parts: dict[str, Block] = {
        "course": Sine(amplitude="6 rad" if of == "angle" else "1 rad", frequency="1 rad/s" if of == "angle" else 6.0),
        "motion": PrescribedMotion(),
        "shaft": Inertia(inertia=0.1),
        "law": curve(of),
    }
    result = run(parts, "course.out motion.angle", "motion.shaft shaft.shaft law.shaft", stop=7.0, step=1e-2)
    x = result[f"shaft.shaft.{of}"]
    assert x.min() < LOWER - 1
    assert x.max() > UPPER + 1
    np.testing.assert_allclose(result["law.torque"], heights(x), rtol=0, atol=1e-12)


@pytest.mark.parametrize("torque", [0.6, -0.35, 2.0])
def test_a_torque_curve_settles_where_it_balances_the_drive(torque: float) -> None:
    """A falling curve, with uneven slopes; 2 N.m is more than it holds, so that the shaft then speeds up steadily."""
    drag = [1.0, 0.7, 0.5, 0.2, 0.0, -0.3, -0.4, -0.8, -1.5]
    inertia, speeds = 0.01, np.linspace(-20.0, 20.0, 9)
    parts: dict[str, Block] = {
        "drive": Constant(value=torque),
        "torque": Torque(),
        "shaft": Inertia(inertia=inertia),
        "law": TorqueCurve(points=9, lower=-20.0, upper=20.0, heights=drag),
    }
    result = run(
        parts, "drive.out torque.torque", "torque.shaft shaft.shaft law.shaft", stop=10.0, step=1e-2, internal_step=2e-4
    )
    speed = result["shaft.shaft.speed"]
    if torque < 1.5:
        assert speed[-1] == pytest.approx(np.interp(torque, -np.array(drag), speeds), abs=1e-6)
    else:
        rise = np.diff(speed[speed > 20.0]) / 1e-2
        np.testing.assert_allclose(rise, (torque - 1.5) / inertia, rtol=1e-9)
    assert balance(result) < 1e-8


def test_a_torque_curve_of_the_angle_stores_what_it_takes() -> None:
    """A torque of the angle alone is conservative: J speed^2 / 2 gains the integral of f; trapezia are exact here."""
    inertia, start, fast = 0.05, -2.7, 12.0
    parts: dict[str, Block] = {"shaft": Inertia(inertia=inertia), "law": curve("angle")}
    begin = {"shaft.shaft.angle": start, "shaft.shaft.speed": fast}
    result = run(parts, "shaft.shaft law.shaft", stop=0.9, internal_step=1e-4, initial=begin)
    angle, speed = result["shaft.shaft.angle"], result["shaft.shaft.speed"]
    knots = np.union1d(np.linspace(LOWER, UPPER, len(HEIGHTS)), [start, -50.0, 50.0])
    work = np.concatenate([[0.0], np.cumsum(np.diff(knots) * (heights(knots)[1:] + heights(knots)[:-1]) / 2)])

    def integral(x: NDArray[np.float64]) -> NDArray[np.float64]:
        k = np.clip(np.searchsorted(knots, x) - 1, 0, len(knots) - 2)
        found: NDArray[np.float64] = work[k] + (x - knots[k]) * (heights(x) + heights(knots[k])) / 2
        return found

    gained = integral(angle) - integral(np.array([start]))
    assert angle.max() > UPPER + 1
    np.testing.assert_allclose(inertia * (speed**2 - fast**2) / 2, gained, rtol=0, atol=1e-6)


def mapped(block: Curve, values: NDArray[np.float64]) -> NDArray[np.float64]:
    times = 0.1 * np.arange(len(values))
    made = model({"law": block}, inputs=["law.in"], outputs=["law.out"], energy=False)
    return simulate(made, float(times[-1]), 0.1, drive=Drive(times, values[:, None]))["law.out"]


def test_a_characteristic_is_added_to_the_signal() -> None:
    values = np.linspace(-5.0, 7.0, 241)
    block = Curve(points=len(HEIGHTS), lower=LOWER, upper=UPPER, heights=HEIGHTS)
    np.testing.assert_allclose(mapped(block, values), values + heights(values), rtol=0, atol=1e-12)


def test_a_characteristic_without_heights_changes_nothing() -> None:
    values = np.array([-3.0, 0.0, 0.3, 9.0])
    assert mapped(Curve(lower=-1.0, upper=1.0), values).tolist() == values.tolist()


@pytest.mark.parametrize("block", [Curve, TorqueCurve])
def test_abscissas_must_rise(block: type[Block]) -> None:
    with pytest.raises(ParameterError, match=r"lower = 2 is not below upper = 2"):
        block(lower=2.0, upper=2.0)
    with pytest.raises(ParameterError, match="heights"):
        block(lower=0.0, upper=1.0, points=3, heights=[1.0, 2.0])


AMPLIFIER = """\
schema: 1
name: amplifier
blocks:
  source: {type: Step, height: 1.5 V}
  law: {type: Curve, points: 3, lower: -2000 mV, upper: 2 V, heights: [0 V, 100 mV, 500 HEIGHT]}
  motor: {type: DCMotor, resistance: 2 ohm, torque_constant: 10 mN.m/A, rotor_inertia: 1e-6 kg.m2}
connect:
  - [source.out, law.in]
  - [law.out, motor.voltage]
simulate: {stop: 10 ms, step: 1 ms, record: [law.out]}
"""


def test_a_characteristic_has_the_units_of_its_signal(tmp_path: Path) -> None:
    path = tmp_path / "amplifier.yaml"
    path.write_text(AMPLIFIER.replace("HEIGHT", "mV"))
    scenario = load(path)
    made = model(
        dict(scenario.system.blocks), "source.out law.in", "law.out motor.voltage", outputs=["law.out"], energy=False
    )
    assert simulate(made, 0.01, 1e-3)["law.out"][-1] == pytest.approx(1.5 + 0.4, abs=1e-12)
    assert next(v.unit for v in made.outputs if v.name == "law.out") == "V"
    assert {p.unit for p in made.parameters if p.name.startswith("law.")} == {"V"}
    path.write_text(AMPLIFIER.replace("HEIGHT", "mA"))
    with pytest.raises(FlexarmError, match="values in V and in A stand in one list"):
        load(path)


def test_abscissas_and_heights_are_in_one_unit() -> None:
    with pytest.raises(ParameterError, match="lower in V, upper in V, heights in A: all are values of one signal"):
        Curve(lower="-1 V", upper="2000 mV", points=2, heights=["1 mA", "2 A"])
