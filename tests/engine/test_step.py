"""The internal step: chosen from the fastest mode, contacts closed, and checked by halving."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from blocks.actuators.hardening_spring import HardeningSpring
from engine.assemble import build
from engine.simulate import simulate
from engine.start import start_values
from engine.step import STEP_PER_RATE, StepRule, fastest, internal_step, stiffest
from tests.engine.parts import Anchor, Body, Rest, Spring, system


def test_the_step_follows_the_stiffest_contact_though_it_is_open_at_the_start() -> None:
    plant = system({"m": Body(inertia=0.01), "r": Rest(stiffness=4e4, gap=0.1)}, ("m.shaft", "r.shaft"))
    model = build(plant)
    p = model.parameter_values
    rate = fastest(model, p, start_values(model, p)).rate
    assert rate == pytest.approx(np.sqrt(4e4 / 0.01), rel=1e-9)
    run = simulate(model, 0.1, 1e-2, initial={"m.shaft.speed": 1.0})
    assert run.internal_step == pytest.approx(STEP_PER_RATE / rate, rel=1e-9)


def test_of_the_states_of_a_run_the_stiffest_tells_the_step() -> None:
    """A weight on a spring that hardens: k + 3 k3 x^2 is largest farthest out, and what is no number tells nothing."""
    parts = {"m": Body(inertia=0.01), "s": HardeningSpring(stiffness=4.0, cubic_stiffness=300.0), "end": Anchor()}
    model = build(system(parts, ("m.shaft", "s.a"), ("s.b", "end.shaft")))
    states = np.array([[0.0, 2.0], [-0.3, 0.0], [0.2, 1.0], [math.nan, 0.0]])
    there = stiffest(model, model.parameter_values, states)
    assert there.tolist() == [-0.3, 0.0]
    rate = math.sqrt((4.0 + 3 * 300.0 * 0.3**2) / 0.01)
    assert internal_step(model, model.parameter_values, there, 1.0) == pytest.approx(STEP_PER_RATE / rate, rel=1e-6)
    assert model.stiffens
    plain = {"m": Body(inertia=0.01), "s": Spring(stiffness=4.0), "end": Anchor()}
    assert not build(system(plain, ("m.shaft", "s.a"), ("s.b", "end.shaft"))).stiffens


def test_a_step_too_long_is_noticed_and_the_mode_named() -> None:
    blocks = {
        "slow": Body(inertia=1.0),
        "soft": Spring(stiffness=1.0),
        "fast": Body(inertia=1e-3),
        "stiff": Spring(stiffness=100.0),
        "ground": Anchor(),
    }
    wires = (("ground.shaft", "soft.a"), ("soft.b", "slow.shaft", "stiff.a"), ("stiff.b", "fast.shaft"))
    model = build(system(blocks, *wires))
    start = {"fast.shaft.angle": 0.1}
    with pytest.warns(RuntimeWarning, match=r"stiff\.b|fast\.shaft"):
        simulate(model, 1.0, 1e-2, initial=start, internal_step=5e-3, step_tolerance=1e-4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(model, 1.0, 1e-2, initial=start, internal_step=2e-4, step_tolerance=1e-4)


@pytest.mark.parametrize(
    ("values", "longest"),
    [
        ([-1 + 100j, -1 - 100j], 0.5 / abs(-1 + 100j)),
        ([-1000.0, -1.0], 2.0 / 1000),
        ([-30 + 20j, -30 - 20j], 2.0 / abs(30 + 20j)),
        ([400.0, -400.0], 0.5 / 400),
        ([-1000.0, -1 + 400j, -1 - 400j], 0.5 / abs(-1 + 400j)),
    ],
)
def test_a_mode_that_dies_is_given_longer_steps_than_one_that_swings_or_grows(
    values: list[complex], longest: float
) -> None:
    assert StepRule(0.5, 2.0).longest(np.array(values, dtype=complex)) == pytest.approx(longest, rel=1e-9)
    assert StepRule(0.5, 2.0).longest(np.zeros(1, dtype=complex)) > 1e200


def test_behind_a_mode_that_has_died_a_model_is_where_it_should_be_whatever_its_steps() -> None:
    """A light body on a stiff damper, pulled by a soft spring: x' = -k x / d after the first instants."""
    inertia, damping, stiffness = 1e-6, 1e-2, 1e-2
    blocks = {"m": Body(inertia=inertia), "s": Spring(stiffness=stiffness, damping=damping), "g": Anchor()}
    model = build(system(blocks, ("g.shaft", "s.a"), ("s.b", "m.shaft")))
    p = model.parameter_values
    short, long = (
        internal_step(model, p, start_values(model, p), 1.0, rule=rule) for rule in (StepRule(), StepRule(0.5, 2.0))
    )
    assert long == pytest.approx(4 * short)
    run = simulate(model, 2.0, 0.1, initial={"m.shaft.angle": 1.0}, internal_step=long)
    slow = min(abs(root) for root in np.roots([inertia, damping, stiffness]))
    np.testing.assert_allclose(run["m.shaft.angle"][1:], np.exp(-slow * run.time[1:]), rtol=2e-4)
