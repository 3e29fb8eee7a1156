"""Springs that were wound before the start: in its linear limit each law swings about its rest."""

from __future__ import annotations

import numpy as np
import pytest

from blocks.actuators.backlash import Backlash, TranslationalBacklash
from blocks.actuators.bouc_wen import BoucWenSpring
from blocks.actuators.hardening_spring import HardeningSpring
from blocks.actuators.spring_damper import SpringDamper, TranslationalSpringDamper
from blocks.actuators.structural_spring import StructuralSpring
from blocks.links.fixed import Fixed, TranslationalFixed
from blocks.links.inertia import Inertia, Mass
from engine.block import Block
from engine.simulate import Result
from tests.blocks.assembly import run
from tests.blocks.test_drive_train import balance

BODY, K, REST = 2e-3, 50.0, 0.04
BAND = {"lowest_frequency": 1.0, "highest_frequency": 1e4}


def released(spring: Block, stop: float = 0.2) -> Result:
    """A body at zero, held by the spring to a wall at zero, and let go."""
    sliding = "slide" if isinstance(spring, TranslationalBacklash | TranslationalSpringDamper) else ""
    body, wall = (Mass(mass=BODY), TranslationalFixed()) if sliding else (Inertia(inertia=BODY), Fixed())
    port, fixed = (next(iter(block.ports)) for block in (body, wall))
    parts = {"body": body, "spring": spring, "wall": wall}
    return run(parts, f"body.{port} spring.a", f"spring.b wall.{fixed}", stop=stop, internal_step=5e-5)


@pytest.mark.parametrize(
    "spring",
    [
        SpringDamper(stiffness=K, rest_angle=REST),
        HardeningSpring(stiffness=K, cubic_stiffness=0, rest_angle=REST),
        Backlash(stiffness=K, half_gap=0, law="two_sided", rest_angle=REST),
        BoucWenSpring(stiffness=K, residual_share=1, yield_twist=1e-3, rest_angle=REST),
        BoucWenSpring(stiffness=K, residual_share=0, yield_twist=1e9, rest_angle=REST),
        StructuralSpring(stiffness=K, loss_factor=0, rest_angle=REST, **BAND),
        TranslationalSpringDamper(stiffness=K, rest_distance=REST),
        TranslationalBacklash(stiffness=K, half_gap=0, law="two_sided", rest_distance=REST),
    ],
    ids=lambda spring: type(spring).__name__,
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wound_spring_swings_about_its_rest(spring: Block, sign: float) -> None:
    """J q'' = -k (q - rest) from q = 0: q = rest (1 - cos(w t)), w = sqrt(k / J); the energy is that of the winding."""
    key = "rest_angle" if "rest_angle" in spring.values else "rest_distance"
    given = {name: value for name, value in spring.values.items() if spring.same_as(name) is None}
    result = released(type(spring)(**(given | {key: sign * REST})))
    motion = next(result[name] for name in ("body.shaft.angle", "body.flange.position") if name in result.names)
    exact = sign * REST * (1 - np.cos(np.sqrt(K / BODY) * result.time))
    np.testing.assert_allclose(motion, exact, rtol=0, atol=1e-6 * REST)
    assert result["energy.stored"][0] == pytest.approx(K * REST**2 / 2, rel=1e-9)
    assert balance(result) < 1e-7


def test_the_play_of_a_wound_contact_lies_about_its_rest() -> None:
    """A face touches at rest - g: from 0 the body is thrown to rest - g with k (rest - g)^2 / 2, and then flies."""
    gap = 0.01
    result = released(Backlash(stiffness=K, half_gap=gap, rest_angle=REST), stop=0.05)
    parted = np.pi / 2 * np.sqrt(BODY / K)
    flight = result.time > parted
    speed = (REST - gap) * np.sqrt(K / BODY)
    flying = flight & (result.time < parted + 2 * gap / speed)
    exact = REST - gap + speed * (result.time[flying] - parted)
    assert flying.sum() >= 3
    np.testing.assert_allclose(result["body.shaft.angle"][flying], exact, rtol=0, atol=1e-7)


def test_a_hysteretic_spring_is_wound_no_further_than_it_yields() -> None:
    result = released(BoucWenSpring(stiffness=K, residual_share=0.1, yield_twist=REST / 4, rest_angle=-REST), stop=0.01)
    assert result["spring.torque"][0] == pytest.approx(K * (0.1 * REST + 0.9 * REST / 4), rel=1e-9)


def test_a_structural_spring_stays_wound_at_rest() -> None:
    """Relaxed, tau = k0 e with k0 = k - g n / 2: nothing creeps."""
    spring = StructuralSpring(stiffness=K, loss_factor=0.1, rest_angle=REST, **BAND)
    parts = {"wall": Fixed(), "spring": spring, "other": Fixed()}
    torque = run(parts, "wall.shaft spring.a", "spring.b other.shaft", stop=1.0)["spring.torque"]
    part = 2 * 0.1 * K * np.log(1e4) / 7 / np.pi
    np.testing.assert_allclose(torque, -(K - 4 * part) * REST, rtol=1e-9)
