"""Imposed motion: the follower's motion and the reaction against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.assemble import build
from engine.errors import StructureError
from engine.simulate import simulate
from tests.engine.parts import Anchor, Body, Clutch, Dry, Gearing, Imposed, Lag, Spring, Swing, system


def test_the_reaction_of_an_imposed_swing_is_inertia_times_acceleration() -> None:
    plant = system(
        {"a": Swing(amplitude=0.3, frequency=4.0), "i": Imposed(), "m": Body(inertia=0.2)},
        ("a.out", "i.in"),
        ("i.shaft", "m.shaft"),
    )
    run = simulate(build(plant), 2.0, 1e-2)
    angle = 0.3 * np.sin(4.0 * run.time)
    assert np.abs(run["m.shaft.angle"] - angle).max() < 1e-15
    assert np.abs(run["i.reaction"] + 0.2 * 16.0 * angle).max() < 1e-13


def test_a_body_on_a_spring_follows_its_imposed_end_and_the_books_close() -> None:
    k, J, w, A = 30.0, 0.5, 5.0, 0.1
    blocks = {
        "a": Swing(amplitude=A, frequency=w),
        "i": Imposed(),
        "g": Gearing(ratio=3.0, efficiency=0.8),
        "m": Body(inertia=0.01),
        "s": Spring(stiffness=k),
        "l": Body(inertia=J),
    }
    wires = (("a.out", "i.in"), ("i.shaft", "g.input", "m.shaft"), ("g.output", "s.a"), ("s.b", "l.shaft"))
    run = simulate(build(system(blocks, *wires), energy=True), 3.0, 1e-2, internal_step=1e-3)
    w0 = np.sqrt(k / J)
    t, end = run.time, A / 3.0
    exact = end / (1 - (w / w0) ** 2) * (np.sin(w * t) - w / w0 * np.sin(w0 * t))
    assert np.abs(run["l.shaft.angle"] - exact).max() < 1e-9
    twist = end * np.sin(w * t) - exact
    reaction = -0.01 * A * w**2 * np.sin(w * t) + k * twist / (3.0 * 0.8)
    assert np.abs(run["i.reaction"] - reaction).max() < 1e-8
    assert np.abs(run["energy.residual"] - run["energy.residual"][0]).max() < 1e-9


def test_friction_against_an_imposed_motion_drags_until_it_sticks() -> None:
    """A free body is dragged by a clutch from a surface that swings: it sticks while the swing is gentle."""
    plant = system(
        {"a": Swing(amplitude=0.01, frequency=2.0), "i": Imposed(), "m": Body(inertia=0.5), "c": Clutch(level=1.0)},
        ("a.out", "i.in"),
        ("i.shaft", "c.a"),
        ("c.b", "m.shaft"),
    )
    run = simulate(build(plant), 3.0, 1e-2, initial={"m.shaft.speed": 0.02})
    assert np.abs(run["m.shaft.angle"] - 0.01 * np.sin(2.0 * run.time)).max() < 1e-12
    fast = simulate(build(plant), 3.0, 1e-2, parameters={"a.frequency": 40.0}, internal_step=1e-3)
    slopes = np.diff(fast["m.shaft.speed"]) / 1e-2
    assert np.abs(slopes).max() <= 1.0 / 0.5 + 1e-6


def test_impossible_impositions_are_refused_by_name() -> None:
    def text(blocks: Any, *wires: Any) -> str:
        with pytest.raises(StructureError) as caught:
            build(system(blocks, *wires))
        return str(caught.value)

    swing, body = Swing(), Body(inertia=1.0)
    assert "the ground" in text({"a": swing, "i": Imposed(), "g": Anchor()}, ("a.out", "i.in"), ("i.shaft", "g.shaft"))
    twice = {"a": swing, "i": Imposed(), "j": Imposed(), "m": body}
    assert "fixes already" in text(twice, ("a.out", "i.in", "j.in"), ("i.shaft", "j.shaft", "m.shaft"))
    lagged = {"a": swing, "lag": Lag(), "i": Imposed(), "m": body}
    assert "differentiated" in text(lagged, ("a.out", "lag.in"), ("lag.out", "i.in"), ("i.shaft", "m.shaft"))
    held = {"a": swing, "i": Imposed(), "f": Dry(level=1.0), "m": body}
    assert "imposed motions" in text(held, ("a.out", "i.in"), ("i.shaft", "m.shaft", "f.shaft"))
