"""[Gao J. n.d., ch. 4]: PI and inverse-dynamics feed-forward on the fourth-order trajectory."""

from __future__ import annotations

import functools
import json
from dataclasses import astuple, dataclass

import numpy as np
import pytest

from blocks.controllers.rigid_feedforward import RigidFeedForward
from engine.simulate import simulate
from scenarios.load import load

N = 14
B1 = {"J": 4.81e-5, "k": 0.012, "d": 3e-5, "B": 1.68e-6}
B3 = {"J": 4.91e-5, "k": 0.013, "d": 2e-4, "B": 1.98e-6}
REFIT = {"J": 6.04e-5, "k": 2.31e-2, "d": 3.6e-4, "B": 6.1e-7}
PLANT = {"J": "load.inertia", "k": "contact.stiffness", "d": "contact.damping", "B": "bearing.viscous_friction"}
MODEL = {"J": "load_inertia", "k": "stiffness", "d": "damping", "B": "load_viscous_friction"}


@dataclass(frozen=True)
class Errors:
    """Largest deviations: motor speed, what the filter shows of it, link speed, link position; and the peak voltage."""

    motor: float
    filtered: float
    speed: float
    position: float
    voltage: float


@functools.cache
def errors(*changes: str, stop: float = 3.0) -> Errors:
    """The scenario with changes; the motor's error is that from its own reference."""
    run = simulate(load("srv02-tracking", changes).build(), stop, 1e-3)
    reference = run["feedforward.motor.speed"]
    return Errors(
        *(
            float(np.abs(x).max())
            for x in (
                reference - run["motor.shaft.speed"],
                reference - run["filter.out"],
                run["trajectory.velocity"] - run["load.shaft.speed"],
                run["trajectory.position"] - run["load.shaft.angle"],
                run["motor.voltage"],
            )
        )
    )


def plant(values: dict[str, float], ratio: float = N) -> list[str]:
    """Motor-referred values as those of the link's side."""
    return [f"{PLANT[name]}={value * ratio**2!r}" for name, value in values.items()]


def model(values: dict[str, float]) -> list[str]:
    return [f"feedforward.{MODEL[name]}={value * N**2!r}" for name, value in values.items()]


def rigid(values: dict[str, float] | None = None) -> str:
    """Replace the feed-forward by that of a rigid load, with the shipped motor."""
    given = dict(load("srv02-tracking").system.blocks["feedforward"].values)
    given = {name: value for name, value in given.items() if name in RigidFeedForward.parameters}
    if values:
        given |= {MODEL[name]: values[name] * N**2 for name in ("J", "B")}
    return f"feedforward={json.dumps({'type': 'RigidFeedForward', **given})}"


PI_ONLY, RAW = "feedforward.active=false", "compensation.active=false"


def test_the_shipped_values_are_those_of_table_b1() -> None:
    assert astuple(errors(*plant(B1), *model(B1))) == pytest.approx(astuple(errors()), rel=1e-9)


def test_the_trajectory() -> None:
    """D = 2.4 in 2.000 s, and the last mass arrives."""
    run = simulate(load("srv02-tracking").build(), 2.0, 1e-3)
    assert run["trajectory.position"][-1] == pytest.approx(2.4, abs=1e-9)
    assert run["trajectory.velocity"].max() == pytest.approx(2.4, abs=1e-9)
    assert run["trajectory.velocity"][-1] == pytest.approx(0, abs=1e-9)
    assert run["load.shaft.angle"][-1] == pytest.approx(2.4, abs=1e-4)


def test_table_of_independent_values() -> None:
    """Independent values to 2 % where they do not depend on what happens at rest, and the bands where they do."""
    raw, raw_forward = errors(PI_ONLY, RAW), errors(RAW)
    assert raw.motor == pytest.approx(5.24, rel=0.02)
    assert raw.filtered == pytest.approx(4.55, rel=0.02)
    assert raw.speed == pytest.approx(0.477, rel=0.02)
    assert raw.position == pytest.approx(0.166, rel=0.02)
    assert raw.voltage == pytest.approx(2.61, rel=0.02)
    assert raw_forward.motor == pytest.approx(6.92, rel=0.02)
    assert raw_forward.voltage == pytest.approx(2.32, rel=0.02)

    pi, one_mass, exact = errors(PI_ONLY), errors(rigid()), errors()
    assert pi.motor == pytest.approx(4.55, rel=0.02)
    assert pi.speed == pytest.approx(0.406, rel=0.02)
    assert pi.position == pytest.approx(0.134, rel=0.02)
    assert pi.voltage == pytest.approx(2.34, rel=0.02)
    assert errors(rigid(), stop=1.9).motor == pytest.approx(0.68, rel=0.02)
    assert 0.6 < one_mass.motor < 1.9
    assert one_mass.speed == pytest.approx(0.108, rel=0.02)
    assert one_mass.voltage == pytest.approx(2.08, rel=0.02)
    assert exact.motor < 0.02
    assert exact.speed < 0.002
    assert exact.position < 0.002
    assert exact.voltage == pytest.approx(1.87, rel=0.02)


def test_order_and_ratios() -> None:
    """What holds whatever happens at rest."""
    pi, one_mass, exact = errors(PI_ONLY), errors(rigid()), errors()
    assert 3.5 < pi.motor < 6
    assert exact.motor < 0.01 * pi.motor
    assert exact.motor <= one_mass.motor < pi.motor
    assert pi.motor < errors(PI_ONLY, RAW).motor
    for share, alone in ((1.2, 5.20), (0.8, 3.69)):
        change = f"load.inertia={share * B1['J'] * N**2!r}"
        wrong, forward = errors(PI_ONLY, change), errors(change)
        assert wrong.motor == pytest.approx(alone, rel=0.02)
        assert forward.motor < 0.5 * wrong.motor
        assert forward.speed < 0.3 * wrong.speed
    half = f"contact.stiffness={B1['k'] * N**2 / 2!r}"
    assert errors(PI_ONLY, half).motor == pytest.approx(4.49, rel=0.02)
    assert 0.65 < errors(half).motor < 2.5


def test_the_flexible_link() -> None:
    """Plant B.3, and the refit of Table A.2 with a gap of 0.03 rad of the motor."""
    both = [*plant(B3), *model(B3)]
    assert errors(PI_ONLY, *both).motor == pytest.approx(4.47, rel=0.02)
    assert errors(*plant(B3), rigid(B3)).motor < 0.3 * errors(PI_ONLY, *both).motor
    assert errors(*both).motor < 0.02
    gap = [*plant(REFIT), *model(REFIT), f"bearing.coulomb_friction={1.16e-4 * N!r}", "contact.law=push_only"]
    gap.append(f"contact.half_gap={0.03 / N!r}")
    assert errors(PI_ONLY, *gap).motor == pytest.approx(5.18, rel=0.02)
    assert errors(*gap, rigid(REFIT)).motor == pytest.approx(0.73, rel=0.05)


def test_errors_grow_with_the_speed_of_the_trajectory() -> None:
    """With a ratio of 70 and no compensation 2.63 : 5.73 : 25.5 from T = 6, 4 to 2 s; compensation lowers each."""

    def error(duration: float, *more: str) -> float:
        d, t = 2.4, duration
        limits = {"velocity": 2 * d / t, "acceleration": 8 * d / t**2, "jerk": 64 * d / t**3, "snap": 512 * d / t**4}
        changes = [f"trajectory.{name}_limit={value!r}" for name, value in limits.items()]
        changes += ["gear.ratio=70", "feedforward.ratio=70", *plant(B1, 70.0)]
        return errors(PI_ONLY, *changes, *more, stop=duration + 1.0).motor

    raw = [error(t, RAW) for t in (6.0, 4.0, 2.0)]
    assert raw == pytest.approx([2.63, 5.73, 25.5], rel=0.02)
    assert 2.0 < raw[1] / raw[0] < 2.6
    assert 8 < raw[2] / raw[0] < 10.5
    for t, without in zip((6.0, 4.0, 2.0), raw, strict=True):
        assert error(t) < without
