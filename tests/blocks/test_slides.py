"""What acts on slides: closed forms and the energy balance."""

from __future__ import annotations

import numpy as np
import pytest

from blocks.actuators.end_stop import TranslationalEndStop
from blocks.actuators.ground_spring import TranslationalGroundSpring
from blocks.actuators.quadratic_drag import TranslationalQuadraticDrag
from blocks.links.inertia import Mass
from blocks.sensors.encoder import LinearEncoder
from engine.block import Block
from tests.blocks.assembly import linear, run
from tests.blocks.test_drive_train import balance


@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_drag_slows_as_one_over_time(speed: float) -> None:
    c, m = 3.0, 1.5
    parts: dict[str, Block] = {"cart": Mass(mass=m), "drag": TranslationalQuadraticDrag(drag=c)}
    result = run(parts, "cart.flange drag.slide", stop=2.0, initial={"cart.flange.speed": speed})
    exact = speed / (1 + c * abs(speed) / m * result.time)
    np.testing.assert_allclose(result["cart.flange.speed"], exact, rtol=1e-9)
    assert balance(result) < 1e-9


def test_a_cart_swings_about_the_slack_position() -> None:
    k, d, m, rest = 40.0, 2.0, 0.5, 0.03
    parts: dict[str, Block] = {
        "cart": Mass(mass=m),
        "chain": TranslationalGroundSpring(stiffness=k, damping=d, rest_position=rest),
    }
    result = run(parts, "cart.flange chain.slide", stop=1.0, internal_step=2e-4)
    decay, t = d / (2 * m), result.time
    wd = np.sqrt(k / m - decay**2)
    exact = rest * (1 - np.exp(-decay * t) * (np.cos(wd * t) + decay / wd * np.sin(wd * t)))
    np.testing.assert_allclose(result["cart.flange.position"], exact, rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        result["chain.force"], k * (rest - exact) - d * result["cart.flange.speed"], rtol=0, atol=1e-9
    )
    poles = linear(parts, "cart.flange chain.slide").poles()
    np.testing.assert_allclose(np.sort(poles.imag), [-wd, wd], rtol=1e-12)
    assert balance(result) < 1e-8


def test_a_cart_between_stops_keeps_its_speed_and_its_period() -> None:
    """Without damping: half a natural period in each stop, d / v between them; p = v sqrt(m / k) beyond."""
    m, k, v, lower, upper = 0.5, 2e4, 1.0, -0.03, 0.05
    stops = TranslationalEndStop(lower=lower, upper=upper, stiffness=k)
    parts: dict[str, Block] = {"cart": Mass(mass=m), "stops": stops}
    period = 2 * (upper - lower) / v + 2 * np.pi * np.sqrt(m / k)
    start = {"cart.flange.speed": v}
    result = run(
        parts, "cart.flange stops.slide", stop=3 * period, step=period / 1000, initial=start, internal_step=2e-5
    )
    x = result["cart.flange.position"]
    between_rows = 1 - np.cos(np.sqrt(k / m) * period / 2000)  # the peak may fall between two rows
    assert x.max() - upper == pytest.approx(v * np.sqrt(m / k), rel=between_rows + 1e-6)
    assert lower - x.min() == pytest.approx(v * np.sqrt(m / k), rel=between_rows + 1e-6)
    np.testing.assert_allclose(x[1000:2001], x[2000:3001], rtol=0, atol=1e-7)
    assert balance(result) < 1e-7


@pytest.mark.parametrize("rounding", ["floor", "round"])
def test_a_scale_counts_its_lines(rounding: str) -> None:
    resolution, v = 5e-6, 0.0173123
    parts: dict[str, Block] = {"cart": Mass(mass=1.0), "scale": LinearEncoder(resolution=resolution, rounding=rounding)}
    result = run(parts, "cart.flange scale.slide", stop=0.1, initial={"cart.flange.speed": v})
    lines = v * result.time / resolution
    np.testing.assert_array_equal(result["scale.count"], np.floor(lines + (0.5 if rounding == "round" else 0.0)))
    np.testing.assert_allclose(result["scale.out"], result["scale.count"] * resolution, rtol=1e-12)
