"""Sensors against the motion they read."""

from __future__ import annotations

import numpy as np
import pytest

from blocks.actuators.effort import Force, Torque
from blocks.links.assumed_modes import AssumedModesLink
from blocks.links.inertia import Inertia, Mass
from blocks.sensors.accelerometer import Accelerometer, TranslationalAccelerometer
from blocks.sensors.encoder import Encoder
from blocks.sensors.strain_gauge import StrainGauge
from blocks.sensors.tachometer import Tachometer
from blocks.sources.sine import Sine
from engine.block import Block
from engine.simulate import Result
from tests.blocks.assembly import run

STEP = 2 * np.pi / 4096


def sweep(**sensors: Block) -> Result:
    """A body that swings by +-0.3 rad, read by the sensors."""
    parts: dict[str, Block] = {
        "source": Sine(amplitude=0.3, frequency=1),
        "torque": Torque(),
        "body": Inertia(inertia=0.01),
    }
    shaft = " ".join(["torque.shaft", "body.shaft", *(f"{name}.shaft" for name in sensors)])
    return run({**parts, **sensors}, "source.out torque.torque", shaft, stop=1.0)


@pytest.mark.parametrize(
    ("rounding", "low", "high"), [("floor", 0.0, 1.0), ("round", -0.5, 0.5), ("none", -1e-12, 1e-12)]
)
def test_encoder_quantises(rounding: str, low: float, high: float) -> None:
    result = sweep(encoder=Encoder(counts_per_revolution=4096, rounding=rounding))
    angle, seen = result["body.shaft.angle"], result["encoder.out"]
    missing = (angle - seen) / STEP
    assert missing.min() >= low - 1e-9
    assert missing.max() <= high + 1e-9
    if rounding != "none":
        assert missing.max() - missing.min() > 0.99
        np.testing.assert_array_equal(result["encoder.count"], np.round(result["encoder.count"]))
    np.testing.assert_allclose(seen, result["encoder.count"] * STEP, rtol=1e-15)


def test_encoder_below_zero_counts_down() -> None:
    parts: dict[str, Block] = {"body": Inertia(inertia=1), "encoder": Encoder(counts_per_revolution=4)}
    result = run(parts, "body.shaft encoder.shaft", stop=1.0, initial={"body.shaft.angle": -0.1})
    assert result["encoder.count"][-1] == -1


def test_sampled_encoder_holds() -> None:
    result = sweep(encoder=Encoder(counts_per_revolution=4096, rounding="none", period=0.05))
    angle = result["body.shaft.angle"]
    np.testing.assert_allclose(result["encoder.out"], angle[(np.arange(1001) // 50) * 50], rtol=0, atol=1e-14)


def test_tachometer_and_accelerometer() -> None:
    result = sweep(tacho=Tachometer(sensitivity="1.5 mV/rpm", bias=0.02), acc=Accelerometer(radius=0.25, bias=-0.1))
    assert result.units["tacho.out"] == "V"
    rpm = result["body.shaft.speed"] * 60 / (2 * np.pi)
    np.testing.assert_allclose(result["tacho.out"], 1.5e-3 * rpm + 0.02, rtol=1e-12)
    torque = 0.3 * np.sin(2 * np.pi * result.time)
    np.testing.assert_allclose(result["acc.out"], 0.25 * torque / 0.01 - 0.1, rtol=0, atol=1e-11)


def test_accelerometer_on_a_slide() -> None:
    parts: dict[str, Block] = {
        "source": Sine(amplitude=3, frequency=1),
        "force": Force(),
        "cart": Mass(mass=2),
        "acc": TranslationalAccelerometer(bias=0.5),
    }
    result = run(parts, "source.out force.force", "force.flange cart.flange acc.flange", stop=1.0)
    np.testing.assert_allclose(result["acc.out"], 1.5 * np.sin(2 * np.pi * result.time) + 0.5, rtol=0, atol=1e-12)


def test_strain_gauge_reads_the_root() -> None:
    """One mode: curvature at the root 2 beta^2 alpha / L^2; a bridge of 10 V per strain on a strip of 1 mm."""
    link = AssumedModesLink(length=0.4, mass=0.065, flexural_rigidity=0.137, hub_inertia=1e-3)
    parts: dict[str, Block] = {"link": link, "gauge": StrainGauge(sensitivity=10 * 1e-3 / 2, bias=0.1)}
    start = {"link.mode1.position": 0.01}
    result = run(parts, "link.root.curvature gauge.curvature", stop=0.5, initial=start)
    strain = 2 * 1.8751040687**2 * result["link.mode1.amplitude"] / 0.4**2 * 1e-3 / 2
    np.testing.assert_allclose(result["gauge.out"], 10 * strain + 0.1, rtol=0, atol=1e-9)
