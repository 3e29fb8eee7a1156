"""What acts on slides: closed forms and the energy balance."""

from __future__ import annotations

import numpy as np
import pytest

from blocks.actuators.ground_spring import TranslationalGroundSpring
from blocks.actuators.quadratic_drag import TranslationalQuadraticDrag
from blocks.links.inertia import Mass
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
