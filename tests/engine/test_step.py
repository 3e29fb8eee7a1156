"""The internal step: chosen from the fastest mode, contacts closed, and checked by halving."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from engine.assemble import build
from engine.simulate import simulate
from engine.start import start_values
from engine.step import STEP_PER_RATE, fastest
from tests.engine.parts import Anchor, Body, Rest, Spring, system


def test_the_step_follows_the_stiffest_contact_though_it_is_open_at_the_start() -> None:
    plant = system({"m": Body(inertia=0.01), "r": Rest(stiffness=4e4, gap=0.1)}, ("m.shaft", "r.shaft"))
    model = build(plant)
    p = model.parameter_values
    rate = fastest(model, p, start_values(model, p)).rate
    assert rate == pytest.approx(np.sqrt(4e4 / 0.01), rel=1e-9)
    run = simulate(model, 0.1, 1e-2, initial={"m.shaft.speed": 1.0})
    assert run.internal_step == pytest.approx(STEP_PER_RATE / rate, rel=1e-9)


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
