"""Where held-out recordings begin: a shaft that slips from wave to wave of a cogging, integrated by a few lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.api import gather
from diagnosis.estimation import held_out_starts
from diagnosis.estimation.growing import grown
from diagnosis.estimation.held_out_starts import with_held_out_starts
from diagnosis.estimation.parameters import Array
from diagnosis.problems import problem
from scenarios.load import load

INERTIA, LOSS, COGGING, ORDER, NOISE = 1e-3, 4e-3, 0.02, 36, 0.02

ROTOR = f"""\
schema: 1
name: rotor
blocks:
  motor: {{type: Torque}}
  rotor: {{type: Inertia, inertia: {INERTIA} kg.m2}}
  bearing: {{type: BearingFriction, viscous_friction: {LOSS} N.m.s/rad}}
  magnets: {{type: TorqueRipple, amplitude: {COGGING} N.m, order: {ORDER}}}
connect:
  - [motor.shaft, rotor.shaft, bearing.shaft, magnets.shaft]
simulate: {{stop: 4 s, step: 2 ms}}
recordings:
"""
RECORDING = """\
  {name}:
    file: {name}.csv
    time: {{column: t, unit: s}}
    role: {role}
    drive: {{motor.torque: {{column: u, unit: N.m, hold: zero_order}}}}
    measurements:
      rotor.shaft.angle: {{column: a, unit: rad, noise: {noise}}}
    initial: {{free: [rotor.shaft.angle]}}
"""


def turned(torque: Array, start: float) -> Array:
    """The angle at each step of 2 ms, by Runge and Kutta."""

    def rates(y: Array, u: float) -> Array:
        return np.array([y[1], (u - LOSS * y[1] + COGGING * np.sin(ORDER * y[0])) / INERTIA])

    y, rows, h = np.array([start, 0.0]), [], 2e-3
    for u in torque:
        rows.append(y[0])
        a = rates(y, u)
        b = rates(y + h / 2 * a, u)
        c = rates(y + h / 2 * b, u)
        y = y + h / 6 * (a + 2 * b + 2 * c + rates(y + h * c, u))
    return np.array(rows)


@pytest.mark.parametrize("seed", range(4))
def test_a_shaft_that_slips_from_wave_to_wave_is_followed_from_its_beginning(tmp_path: Path, seed: int) -> None:
    """Its start is known to a fraction of a wave, and over the whole recording each wave has a hollow of its own."""
    rng, t, text = np.random.default_rng(seed), 2e-3 * np.arange(2000), ROTOR
    for name, role in (("fitted", "train"), ("held", "hold_out")):
        torque = 0.025 * np.sin(2 * np.pi * rng.uniform(0.4, 0.8) * t) + 0.01 * np.sin(
            2 * np.pi * rng.uniform(1, 2) * t
        )
        angle = turned(torque, 1.0) + rng.normal(0, NOISE, len(t))
        angle[0] = 1.0 + 2 * NOISE
        rows = np.column_stack([t, torque, angle])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,u,a", comments="")
        text += RECORDING.format(name=name, role=role, noise=NOISE)
    path = tmp_path / "rotor.yaml"
    path.write_text(text, encoding="utf-8")
    scenario = load(str(path))
    made = problem(scenario, gather(scenario, [], []))
    x = with_held_out_starts(made, np.zeros(len(made.free)), noise="coloured")
    # Whole recordings of one seed end a little beside the noise: it slips once within the last digits.
    assert made.chi2(x, made.held_out) < 3 < 0.01 * made.chi2(np.zeros(len(made.free)), made.held_out)


@pytest.mark.parametrize(("amplitude", "begun"), [(COGGING, 1), (0.0, 0)])
def test_a_start_that_a_recording_answers_evenly_is_not_sought_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, amplitude: float, begun: int
) -> None:
    """Without cogging the angle is the start's and what the torque adds: one fit finds it, whatever is left over."""
    rng, t = np.random.default_rng(0), 2e-3 * np.arange(2000)
    torque = 0.025 * np.sin(2 * np.pi * 0.6 * t)
    for name in ("fitted", "held"):
        rows = np.column_stack([t, torque, turned(torque, 1.0) + rng.normal(0, NOISE, len(t))])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,u,a", comments="")
    blocks = ROTOR.replace(f"amplitude: {COGGING}", f"amplitude: {amplitude}")
    text = blocks + "".join(
        RECORDING.format(name=n, role=r, noise=NOISE / 10) for n, r in (("fitted", "train"), ("held", "hold_out"))
    )
    (tmp_path / "rotor.yaml").write_text(text, encoding="utf-8")
    scenario = load(str(tmp_path / "rotor.yaml"))
    made = problem(scenario, gather(scenario, [], []))
    anew: list[int] = []

    def counted(*given: Any) -> Array | None:
        anew.append(1)
        return grown(*given)

    monkeypatch.setattr(held_out_starts, "grown", counted)
    x = with_held_out_starts(made, np.zeros(len(made.free)), noise="coloured")
    assert made.chi2(x, made.held_out) > 50
    assert len(anew) == begun
