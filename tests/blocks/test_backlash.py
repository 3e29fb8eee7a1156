"""Backlash: contact laws, events without chatter, energy."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import integrate, optimize

from blocks.actuators.backlash import Backlash, TranslationalBacklash
from blocks.actuators.effort import Torque
from blocks.actuators.friction import BearingFriction
from blocks.actuators.spring_damper import SpringDamper
from blocks.links.fixed import Fixed, TranslationalFixed
from blocks.links.inertia import Inertia, Mass
from blocks.sources.sine import Sine
from engine.block import Block
from engine.simulate import Result
from tests.blocks.assembly import instants, linear, run, switches
from tests.blocks.test_drive_train import balance

J, K, GAP = 2e-3, 50.0, 0.03


def bounce(damping: float, law: str, speed: float = 1.0, stop: float = 1.0, step: float = 1e-4) -> Result:
    """A body between two faces that do not move, starting in the middle of the gap."""
    parts: dict[str, Block] = {
        "body": Inertia(inertia=J),
        "gap": Backlash(stiffness=K, damping=damping, half_gap=GAP, law=law),
        "wall": Fixed(),
    }
    wires = ["body.shaft gap.a", "gap.b wall.shaft"]
    return run(parts, *wires, stop=stop, initial={"body.shaft.speed": speed}, internal_step=step)


@pytest.mark.parametrize("law", ["push_only", "two_sided"])
def test_elastic_bounces_at_the_right_instants(law: str) -> None:
    result = bounce(0.0, law)
    touch, flight = np.pi * np.sqrt(J / K), 2 * GAP
    expected, t = [], GAP
    while t < 1.0:
        expected += [t, t + touch]
        t += touch + flight
    expected = [t for t in expected if t < 1.0]
    assert instants(result, "gap.contact") == pytest.approx(expected, rel=1e-9)
    assert switches(result, "gap.contact") == ([1, 0, -1, 0] * 20)[: len(expected)]
    assert np.ptp(result["energy.stored"]) < 1e-9 * result["energy.stored"][0]
    assert balance(result) < 1e-9


def restitution(damping: float, law: str) -> float:
    """Speed after a contact over the speed before, from the closed form of the penetration."""
    decay = damping / (2 * J)
    wd = np.sqrt(K / J - decay**2)

    def penetration(t: float) -> float:
        return float(np.exp(-decay * t) * np.sin(wd * t) / wd)

    def rate(t: float) -> float:
        return float(np.exp(-decay * t) * (np.cos(wd * t) - decay / wd * np.sin(wd * t)))

    leaves: Any = penetration if law == "two_sided" else lambda t: K * penetration(t) + damping * rate(t)
    return -rate(optimize.brentq(leaves, 0.3 * np.pi / wd, 1.01 * np.pi / wd, xtol=1e-15))


@pytest.mark.parametrize("law", ["push_only", "two_sided"])
@pytest.mark.parametrize("damping", [0.02, 0.1, 0.3])
def test_damped_bounces_lose_the_right_speed(damping: float, law: str) -> None:
    result = bounce(damping, law, stop=0.5)
    e = restitution(damping, law)
    speeds = np.abs(result["body.shaft.speed"][result["gap.contact"] == 0])
    bounces = np.round(np.log(speeds) / np.log(e))
    np.testing.assert_allclose(speeds, e**bounces, rtol=1e-7)
    assert bounces.max() >= 2
    assert balance(result) < 1e-4
    assert switches(result, "gap.contact") == ([1, 0, -1, 0] * 20)[: len(switches(result, "gap.contact"))]


@pytest.mark.parametrize(("law", "damping"), [("two_sided", 0.3), ("push_only", 0.3), ("push_only", 0.02)])
def test_energy_of_contacts_is_accounted_for(law: str, damping: float) -> None:
    """What a pushing contact gives up as its faces withdraw has a kink: the books close with the square of the step."""
    coarse, fine = (balance(bounce(damping, law, stop=0.3, step=step)) for step in (1e-4, 5e-6))
    assert fine < 1e-7
    assert coarse < 3e-5


def test_a_pushing_contact_never_pulls_and_a_two_sided_one_does() -> None:
    pushing, both = bounce(0.3, "push_only"), bounce(0.3, "two_sided")
    assert (pushing["gap.torque"] * pushing["gap.contact"] >= 0).all()
    assert (both["gap.torque"] * both["gap.contact"]).min() < -1e-3
    assert (pushing["gap.torque"][np.abs(pushing["gap.offset"]) < GAP] == 0).all()


def test_open_gap_lets_the_bodies_alone() -> None:
    result = bounce(0.1, "push_only", speed=0.2, stop=0.14)
    assert result.event_count == 0
    np.testing.assert_allclose(result["gap.offset"], 0.2 * result.time, rtol=1e-12)
    assert (result["gap.torque"] == 0).all()


def shaken(law: str, gap: float, spring: bool = False, step: float | None = None) -> Result:
    """Two-mass drive of [Gao J. n.d., Table B.3], shaken at its motor."""
    middle = (
        SpringDamper(stiffness=0.013, damping=2e-4)
        if spring
        else Backlash(stiffness=0.013, damping=2e-4, half_gap=gap, law=law)
    )
    parts: dict[str, Block] = {
        "source": Sine(amplitude="2 mN.m", frequency=3),
        "torque": Torque(),
        "motor": Inertia(inertia=4.606e-7),
        "gap": middle,
        "load": Inertia(inertia=5e-5),
        "drag": BearingFriction(viscous_friction=1e-5),
    }
    wires = ["source.out torque.torque", "torque.shaft motor.shaft drag.shaft gap.a", "gap.b load.shaft"]
    return run(parts, *wires, stop=3.0, internal_step=step)


def test_two_sided_without_gap_is_the_spring_damper() -> None:
    closed, plain = shaken("two_sided", 0.0), shaken("", 0.0, spring=True)
    for name in ("motor.shaft.angle", "motor.shaft.speed", "load.shaft.speed", "gap.torque"):
        np.testing.assert_allclose(closed[name], plain[name], rtol=0, atol=1e-12 * np.abs(plain[name]).max())
    assert (closed["gap.contact"] == 1).all()
    assert switches(closed, "gap.contact") == [1]
    assert closed["energy.stored"][-1] == pytest.approx(plain["energy.stored"][-1], rel=1e-10)


def test_two_sided_without_gap_is_linear_at_once() -> None:
    parts: dict[str, Block] = {
        "body": Inertia(inertia=J),
        "gap": Backlash(stiffness=K, damping=0.1, half_gap=0, law="two_sided"),
        "wall": Fixed(),
    }
    found = linear(parts, "body.shaft gap.a", "gap.b wall.shaft")
    np.testing.assert_allclose(np.sort_complex(found.poles()), np.sort_complex(np.roots([J, 0.1, K])), rtol=1e-9)


def test_pushing_without_gap_is_another_law() -> None:
    one, both = shaken("push_only", 0.0), shaken("two_sided", 0.0)
    difference = np.abs(one["motor.shaft.speed"] - both["motor.shaft.speed"]).max()
    assert difference > 0.01 * np.abs(both["motor.shaft.speed"]).max()
    assert (one["gap.torque"] * one["gap.contact"] >= -1e-18).all()
    assert balance(shaken("push_only", 0.0, step=2e-5)) < 1e-6


@pytest.mark.parametrize("law", ["push_only", "two_sided"])
def test_shaken_gap_does_not_chatter_and_balances(law: str) -> None:
    result = shaken(law, 0.03, step=2e-5)
    times = np.array(instants(result, "gap.contact"))
    assert 20 < len(times) < 400
    assert np.diff(times).min() > 1e-5
    values = switches(result, "gap.contact")
    assert all((a == 0) != (b == 0) for a, b in pairwise(values))
    assert balance(result) < 1e-6


def test_shaken_gap_against_an_independent_integration() -> None:
    """scipy with the four rules of the design's table, no mode logic of ours."""
    d, k, g, j1, j2, b = 2e-4, 0.013, 0.03, 4.606e-7, 5e-5, 1e-5
    result = shaken("push_only", g)

    def flow(c: int) -> Any:
        def rhs(t: float, y: Any) -> list[float]:
            tau = 0.0 if c == 0 else k * (y[0] - y[2] - c * g) + d * (y[1] - y[3])
            return [y[1], (2e-3 * np.sin(6 * np.pi * t) - b * y[1] - tau) / j1, y[3], tau / j2]

        return rhs

    def face(side: int) -> Any:
        def force(_: float, y: Any) -> float:
            return float(side * (k * (y[0] - y[2] - side * g) + d * (y[1] - y[3])))

        def penetration(_: float, y: Any) -> float:
            return float(side * (y[0] - y[2]) - g)

        return force, penetration

    def closing(side: int) -> Any:
        force, penetration = face(side)
        event: Any = lambda t, y: min(force(t, y), penetration(t, y))  # noqa: E731
        event.terminal, event.direction = True, 1
        return event

    def opening(side: int) -> Any:
        event: Any = lambda t, y: face(side)[0](t, y)  # noqa: E731
        event.terminal, event.direction = True, -1
        return event

    t, y, c, count, stop = 0.0, np.zeros(4), 0, 0, 1.0
    while t < stop:
        events = [closing(1), closing(-1)] if c == 0 else [opening(c)]
        part = integrate.solve_ivp(flow(c), (t, stop), y, events=events, rtol=1e-11, atol=1e-13, max_step=1e-3)
        t, y = float(part.t[-1]), part.y[:, -1]
        if part.status == 1:
            c = 0 if c else (1 if len(part.t_events[0]) else -1)
            count += 1
    assert count == sum(time < stop for time in instants(result, "gap.contact"))
    here = np.array([result[f"{n}.shaft.{q}"][1000] for n in ("motor", "load") for q in ("angle", "speed")])
    np.testing.assert_allclose(here, y, rtol=2e-4, atol=1e-5)


def test_translational_twin_in_preload() -> None:
    """A mass hung between faces, pressed in at the start: contact is found at once, then it leaves for good."""
    k, m, gap, pressed = 200.0, 0.5, 0.01, 0.004
    parts: dict[str, Block] = {
        "body": Mass(mass=m),
        "gap": TranslationalBacklash(stiffness=k, half_gap=gap),
        "wall": TranslationalFixed(),
    }
    wires = ["body.flange gap.a", "gap.b wall.flange"]
    result = run(parts, *wires, stop=0.4, initial={"body.flange.position": gap + pressed}, internal_step=1e-4)
    quarter = np.pi / 2 * np.sqrt(m / k)
    assert result["gap.force"][0] == pytest.approx(k * pressed)
    assert switches(result, "gap.contact")[:3] == [1, 0, -1]
    assert instants(result, "gap.contact")[:2] == pytest.approx([0, quarter], rel=1e-8)
    speed = pressed * np.sqrt(k / m)
    assert instants(result, "gap.contact")[2] == pytest.approx(quarter + 2 * gap / speed, rel=1e-8)
