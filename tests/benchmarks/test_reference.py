"""The reference models against loops written by hand in C, and model B against scipy with events."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import oracle, reference
from engine.simulate import simulate
from scenarios.load import load


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("name", ["a", "b", "c"])
def test_hand_written_loop_gives_the_same(name: str, parts: int) -> None:
    model = load(f"reference-{name}").build()
    result = simulate(model, 10.0, internal_step=1e-3 / parts, backend="c")
    y = np.zeros((10_001, reference.OUTPUTS[name]))
    switches = reference.loop(name)(10_000, parts, y)
    assert reference.disagreement(result.values, y) < 1e-9
    # Beginnings and ends of the sources' phases are events of the engine too.
    assert switches == sum(not name.endswith((".phase", ".begun")) for _, name, _ in result.events)


@pytest.mark.slow
def test_model_b_agrees_with_an_event_driven_solver() -> None:
    exact = oracle.run(10.0, "DOP853", 1e-11)[0]
    model = load("reference-b").build()
    for step, bound in ((1e-3, 2e-4), (2.5e-4, 1e-5)):
        speed = simulate(model, 10.0, internal_step=step)["motor.shaft.speed"]
        assert np.sqrt(np.mean((speed - exact) ** 2) / np.mean(exact**2)) <= bound
