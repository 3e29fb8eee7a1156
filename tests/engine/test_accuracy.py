"""The default step follows lightly damped modes to the end of a run, whatever its rows; against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blocks.actuators.spring_damper import TranslationalSpringDamper
from blocks.links.fixed import TranslationalFixed
from blocks.links.inertia import Mass
from engine.assemble import build
from engine.energy import conserved, may_be_conservative
from engine.simulate import simulate
from engine.start import start_values
from engine.step import DRIFT, LIGHT, STEP_PER_RATE, fastest, internal_step
from engine.system import Connection, System

RATE = 2 * np.pi


def _oscillator(damping_ratio: Any = 0.0, hanging: Any = False) -> Any:
    blocks = {
        "m": Mass(mass=2.0),
        "k": TranslationalSpringDamper(stiffness=2.0 * RATE**2, damping=4.0 * damping_ratio * RATE),
        "g": TranslationalFixed(),
    }
    return System(blocks, [Connection(("m.flange", "k.a")), Connection(("k.b", "g.flange"))], name="oscillator")


def _model(damping_ratio: Any = 0.0) -> Any:
    return build(_oscillator(damping_ratio), outputs=["m.flange.position", "m.flange.speed"])


def _phasor(run: Any, damping_ratio: Any = 0.0) -> Any:
    """What is left of the exact answer's rotation: 1 throughout for an exact run, but for the envelope."""
    turning = RATE * np.sqrt(1 - damping_ratio**2)
    position, speed = run["m.flange.position"], run["m.flange.speed"]
    z = position - 1j * (speed + damping_ratio * RATE * position) / turning
    return z * np.exp(-1j * turning * run.time)


@pytest.mark.parametrize(("stop", "step"), [(10.0, 0.1), (100.0, 0.1), (100.0, 10.0), (1000.0, 10.0), (1000.0, 0.01)])
@pytest.mark.parametrize("damping_ratio", [0.0, 1e-4, 0.004])
def test_phase_and_amplitude_stay_within_the_bound(stop: Any, step: Any, damping_ratio: Any) -> None:
    model = _model(damping_ratio)
    run = simulate(model, stop, step, initial={"m.flange.position": 1.0})
    left = np.exp(-damping_ratio * RATE * run.time)
    start = _phasor(run, damping_ratio)[0]
    error = np.abs(_phasor(run, damping_ratio) / start - left)
    assert error.max() <= 1.05 * DRIFT


def test_what_is_damped_keeps_the_step_it_had() -> None:
    for damping_ratio in (LIGHT * 1.01, 0.05, 0.7):
        model = _model(damping_ratio)
        p = model.parameter_values
        rate = fastest(model, p, start_values(model, p)).rate
        assert internal_step(model, p, start_values(model, p), 1.0, 1000.0) == pytest.approx(STEP_PER_RATE / rate)


def test_a_step_that_is_given_is_taken() -> None:
    run = simulate(_model(), 100.0, 0.1, internal_step=0.05, initial={"m.flange.position": 1.0})
    assert run.internal_step == 0.05
    assert run.steps == 2000


def test_energy_of_a_conservative_model() -> None:
    """E = k x0^2 / 2, and RK4 loses z^6/72 of it per step z = w h."""
    model = _model()
    assert may_be_conservative(model)
    step = 0.05
    run = simulate(model, 100.0, 0.1, internal_step=step, initial={"m.flange.position": 1.0}, record_states=True)
    found = conserved(run, lambda: build(_oscillator(), outputs=[], energy=True))
    assert found is not None
    assert found.start == pytest.approx(RATE**2, rel=1e-12)
    z = RATE * step
    assert found.end == pytest.approx(found.start * (1 - z**6 / 72 + z**8 / 576) ** run.steps, rel=1e-9)
    assert found.drift == pytest.approx(found.start - found.end, rel=1e-9)


def test_what_loses_energy_is_not_called_conservative() -> None:
    assert not may_be_conservative(_model(0.01))
