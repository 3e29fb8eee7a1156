"""The force that is missing, recovered without a name, against the law that a plant made without flexarm has in it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.force_recovery import place_of, recover
from diagnosis.search.search import study
from diagnosis.thresholds import RECOVERY
from scenarios.load import load
from tests.diagnosis.plants import INERTIA, RESISTANCE, case

EFFECTS = {
    *("saturation", "uneven_gain", "offset", "delay", "lag", "inductance", "stribeck_friction", "wrong_parameter"),
    *("direction_dependent_friction", "viscous_friction", "quadratic_drag", "extra_mode", "gravity", "payload"),
    *("stray_spring", "torque_ripple", "outside_vibration", "sensor_bias", "sensor_scale", "sensor_lag"),
    *("rectified_sensor", "backlash", "joint_flexibility", "hardening_spring", "hysteresis"),
    *("load_dependent_friction", "current_limit", "cogging", "transmission_error"),
    *("rate_limit", "command_quantisation", "supply_sag", "belt_slack", "end_stop", "warm_up", "friction_warm_up"),
    *("quadratic_load_friction", "dead_time"),
}
FRICTION, DEAD = 4.0e-4, 0.15


def studied(folder: Any, **truth: Any) -> Any:
    """A study that tries Coulomb friction and a dead zone alone; the nominal parameters are the true ones.

    Torque is not measured: with an inertia that is off, every torque would be off in proportion.
    """
    path = case(folder, given_resistance=RESISTANCE, given_inertia=INERTIA, **truth)
    scenario = load(path)
    return study(CandidateFitter(scenario, gather(scenario, [], [])), without=sorted(EFFECTS))


@pytest.fixture(scope="module")
def sticky(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return studied(tmp_path_factory.mktemp("sticky"), coulomb=FRICTION, seed=3)


@pytest.fixture(scope="module")
def torque(sticky: Any) -> Any:
    return recover(sticky, "motor.shaft")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return studied(tmp_path_factory.mktemp("sound"), seed=8)


def against(found: Any, name: Any) -> Any:
    return next(c for c in found.curves if c.x_label == name)


def test_only_two_effects_are_tried(sticky: Any) -> None:
    listed = {c.effect for c in candidates(sticky.scales)} - EFFECTS
    assert listed == {"coulomb_friction", "dead_zone"}


def test_friction_shows_as_a_torque_against_the_motion(torque: Any) -> None:
    """Where the shaft turns fast enough that no knot straddles a reversal: -F sign(v), within the band."""
    found = torque
    assert (found.place, found.unit) == ("motor.shaft", "N.m")
    curve = against(found, "motor.shaft.speed")
    assert (curve.x_unit, curve.y_unit) == ("rad/s", "N.m")
    assert len(curve.x) == RECOVERY.bins
    fast = np.abs(curve.x) > 60
    assert np.sum(fast & (curve.x < 0)) >= 3
    assert np.sum(fast & (curve.x > 0)) >= 3
    truth = -FRICTION * np.sign(curve.x[fast])
    assert (curve.low[fast] <= truth).all()
    assert (truth <= curve.high[fast]).all()
    np.testing.assert_allclose(curve.y[fast], truth, rtol=0.05)
    assert (curve.high - curve.low)[fast].max() < 0.25 * FRICTION


def test_the_curve_against_what_the_force_depends_on_comes_first(torque: Any) -> None:
    assert torque.curves[0] is against(torque, "motor.shaft.speed")
    assert torque.curves[0].share > 0.85
    assert against(torque, "motor.shaft.angle").share < 0.2


def test_the_force_over_time_reverses_with_the_motion(sticky: Any, torque: Any) -> None:
    """Of one held-out recording: the plant's own friction torque, at the knots of which no neighbour reverses."""
    found = torque
    assert found.recording in ("ramp", "slow")
    np.testing.assert_allclose(np.diff(found.time), RECOVERY.knot)
    path = sticky.scenario.path.parent / f"{found.recording}.csv"
    t, _, speed = np.loadtxt(path, delimiter=",", skiprows=1).T
    v = np.interp(found.time, t, speed)
    inner = np.array(
        [
            abs(v[max(k - 2, 0) : k + 3]).min() > 10 and np.ptp(np.sign(v[k - 2 : k + 3])) == 0
            for k in range(2, len(v) - 2)
        ]
    )
    force, sign = found.force[2:-2][inner], np.sign(v[2:-2][inner])
    assert inner.sum() > 30
    np.testing.assert_allclose(force, -FRICTION * sign, rtol=0, atol=0.12 * FRICTION)
    assert found.log_odds > 1000


def test_a_dead_zone_shows_as_a_voltage_against_the_drive(tmp_path: Path) -> None:
    """Beyond the zone the motor lacks DEAD volts, in it all of them."""
    made = studied(tmp_path, dead=DEAD, seed=5)
    assert made.chosen.effects[0].effect == "dead_zone"
    assert place_of(made.chosen.effects[0], made) == ("motor.voltage", "V")
    curve = against(recover(made, "motor.voltage", "V"), "motor.voltage")
    truth = -np.clip(curve.x, -DEAD, DEAD)
    assert (np.abs(curve.x) < 0.8 * DEAD).any()
    beyond = np.abs(curve.x) > 2 * DEAD
    assert beyond.sum() >= 8
    np.testing.assert_allclose(curve.y[beyond], truth[beyond], rtol=0.12)
    inside = ~beyond
    np.testing.assert_allclose(curve.y[inside], truth[inside], rtol=0, atol=0.5 * DEAD)
    assert curve.share > 0.85


def test_where_nothing_is_concealed_the_force_is_nothing(sound: Any) -> None:
    """At every knot within three deviations of zero, a thousandth of the motor's torques, and with odds against it."""
    assert sound.chosen.effects == ()
    for place, unit, size in (("motor.shaft", "N.m", FRICTION), ("motor.voltage", "V", DEAD)):
        found = recover(sound, place, unit)
        assert found is not None
        assert (found.deviation > 0).all()
        assert np.abs(found.force / found.deviation).max() < 3
        assert np.abs(found.force).max() < 0.02 * size
        assert found.log_odds < 0
        for curve in found.curves:
            assert (curve.low <= 0.01 * size).all()
            assert (curve.high >= -0.01 * size).all()


def test_the_evidence_is_larger_where_something_is_missing(sticky: Any, sound: Any) -> None:
    """Also seen from the refit, whose parameters bent to make up for what is missing."""
    bent = replace(sticky, chosen=sticky.refit)
    missing, nothing = recover(bent, "motor.shaft"), recover(sound, "motor.shaft")
    assert missing is not None
    assert nothing is not None
    assert missing.log_odds > 1000 > 0 > nothing.log_odds


def test_the_numbers_are_plain(torque: Any) -> None:
    numbers = torque.numbers()
    assert json.loads(json.dumps(numbers)) == numbers
    assert numbers["curves"][0]["against"] == "motor.shaft.speed"
    assert {len(numbers["curves"][0][key]) for key in ("x", "force", "low", "high")} == {RECOVERY.bins}


def test_a_place_of_no_force_gives_no_evidence(sticky: Any) -> None:
    assert recover(sticky, "") is None
    assert recover(sticky, "motor.nothing") is None
