"""Plans against closed forms: what a step shows of friction, which laws are one law, and what tells them apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.fft
import scipy.optimize
from numpy.typing import NDArray

import flexarm
from diagnosis.planning.plan import Plan, Row
from engine.errors import FlexarmError

RESISTANCE, CONSTANT, INERTIA, VISCOUS = 2.6, 7.68e-3, 4.6e-7, 1.3e-6
SIGMA, SAMPLE, DURATION = 0.3, 2e-3, 2.0

MOTOR = f"""\
schema: 1
name: bench-motor
blocks:
  source: {{type: Step, height: 1 V}}
  motor:
    type: DCMotor
    resistance: {RESISTANCE} ohm
    torque_constant: {CONSTANT} N.m/A
    back_emf_constant: {CONSTANT} V.s/rad
    rotor_inertia: {INERTIA} kg.m2
    viscous_friction: {VISCOUS} N.m.s/rad
connect:
  - [source.out, motor.voltage]
simulate: {{stop: {DURATION} s, step: {SAMPLE} s, record: [source.out, motor.shaft.speed]}}
"""
KNOWN = """\
tolerances:
  motor.resistance: 0
  motor.torque_constant: 0
  motor.back_emf_constant: 0
  motor.rotor_inertia: 0
  motor.viscous_friction: 0
  motor.efficiency: 0
"""
RECORDED = f"""\
recordings:
  run:
    file: run.csv
    time: {{column: t, unit: s}}
    drive: {{motor.voltage: {{column: u, unit: V}}}}
    measurements: {{motor.shaft.speed: {{column: y, unit: rad/s, noise: {SIGMA}}}}}
"""


def motor(folder: Path, voltage: Any, *, exact: bool = True) -> Path:
    """The motor, and an experiment with an input; what stands in its file as measured does not matter."""
    t = np.arange(0.0, DURATION + 1e-9, SAMPLE)
    table = np.column_stack([t, voltage(t), np.sin(99 * t)])
    np.savetxt(folder / "run.csv", table, delimiter=",", header="t,u,y", comments="")
    path = folder / "motor.yaml"
    path.write_text(MOTOR + (KNOWN if exact else "") + RECORDED, encoding="utf-8")
    return path


def row(found: Plan, effect: str, place: str = "") -> Row:
    made = [r for r in found.rows if r.effect == effect and place in r.place]
    assert len(made) == 1, [r.label for r in found.rows]
    return made[0]


def tied(found: Plan, one: Row, other: Row, multiple: float = 3.0) -> bool:
    return (min(one.number, other.number), max(one.number, other.number)) in found.tied[multiple]


def one_way(t: NDArray[np.float64]) -> NDArray[np.float64]:
    return 1.0 + 0.5 * np.sin(2 * np.pi * t)


def both_ways(t: NDArray[np.float64]) -> NDArray[np.float64]:
    return 1.5 * np.sin(2 * np.pi * t)


def bands(course: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energy and number of values in bands of a third of an octave from 1 Hz on, the lowest of five or more."""
    n = len(course)
    number = np.zeros(n, dtype=int)
    number[1:] = np.floor(3 * np.log2(np.arange(1, n) / (2 * DURATION)))
    number[:5] = number[4]
    energy, count = [], []
    power = scipy.fft.dct(course, norm="ortho") ** 2
    for k in np.unique(number):
        energy.append(power[number == k].sum())
        count.append((number == k).sum())
    return np.array(energy), np.array(count, dtype=float)


def test_the_smallest_coulomb_friction_is_that_of_the_closed_form(tmp_path: Path) -> None:
    """All is known but the friction F: the speed lags by F / d (1 - exp(-t d / J)), d the whole damping."""
    found = flexarm.plan(
        motor(tmp_path, np.ones_like),
        only=(
            "coulomb_friction",
            "viscous_friction",
        ),
    )
    t = np.arange(0.0, DURATION + 1e-9, SAMPLE)
    damping = VISCOUS + CONSTANT**2 / RESISTANCE
    shape = (1 - np.exp(-t * damping / INERTIA)) / damping / SIGMA
    energy, count = bands(shape)
    # The size that matters is the torque that acts: inertia times the root mean square of the acceleration.
    acceleration = CONSTANT / RESISTANCE / INERTIA * np.exp(-t * damping / INERTIA)
    usual, spread = 0.1 * INERTIA * math.sqrt(np.mean(acceleration**2)), math.log(10)
    price = math.log(2 * 2)  # of two effects, and that a parameter is wrong is as likely as both together

    def named(friction: float) -> float:
        """Evidence of the right law over none, less its price and what 95 % ask for."""
        gained = 0.5 * np.sum(count * np.log1p(friction**2 * energy / count))
        prior = 0.5 * (math.log(friction / usual) / spread) ** 2
        volume = 0.5 * math.log(1 + friction**2 * energy.sum() * spread**2)
        return float(gained - prior - volume - price - math.log(0.95 / 0.05))

    def searched(friction: float) -> float:
        """What chance does not show, over the price and an effort of 3."""
        ratio = 1 + friction**2 * energy / count
        chance = (1 - 2 / (9 * count) + 3 * np.sqrt(2 / (9 * count))) ** 3
        return float(0.5 * np.sum(np.where(ratio > chance, count * np.log(ratio), 0.0)) - price - 3)

    sizes = np.geomspace(1e-9, 1e-4, 4000)
    wanted = next(s for s in sizes if named(s) >= 0 and searched(s) >= 0)
    made = row(found, "coulomb_friction")
    assert made.unit == "N.m"
    assert made.size == pytest.approx(wanted, rel=0.1)  # what `CLOSE` promises, and the random sums


def test_friction_driven_one_way_is_an_offset_and_driven_both_ways_is_not(tmp_path: Path) -> None:
    effects = ("coulomb_friction", "offset", "direction_dependent_friction")
    forward = flexarm.plan(motor(tmp_path, one_way), only=effects)
    assert tied(forward, row(forward, "coulomb_friction"), row(forward, "offset"))
    assert tied(forward, row(forward, "direction_dependent_friction"), row(forward, "offset"))
    assert tied(forward, row(forward, "coulomb_friction"), row(forward, "offset"), 10.0)
    through = flexarm.plan(motor(tmp_path, both_ways), only=effects)
    assert not tied(through, row(through, "coulomb_friction"), row(through, "offset"))
    assert not tied(through, row(through, "direction_dependent_friction"), row(through, "offset"))
    # Moving all the time, levels of F + a and F - a are F beside an offset: only the two together stay.
    both = {row(through, "coulomb_friction").number, row(through, "offset").number}
    doubles = row(through, "direction_dependent_friction").pairs[3.0]
    assert [set(pair) for pair in doubles] == [both]


def test_one_input_of_the_menu_undoes_a_tie_of_one_direction(tmp_path: Path) -> None:
    found = flexarm.plan(
        motor(tmp_path, one_way),
        only=(
            "coulomb_friction",
            "offset",
        ),
    )
    assert found.apart(3.0) == 0
    assert found.best_input is not None
    settled = {one.kind for one in found.inputs if one.settles}
    assert {"slow_sine", "ramp", "reversal", "both_ways_decay"} <= settled
    assert len(found.best_input.settles) == max(len(one.settles) for one in found.inputs)


def test_a_winding_is_a_lag_of_its_time_constant(tmp_path: Path) -> None:
    """L J s2 + R J s + k2 = (T s + 1)(R J' s + k2) with T = L / R, but for what the inertia takes up."""
    path = motor(tmp_path, both_ways, exact=False)
    found = flexarm.plan(
        path,
        only=(
            "lag",
            "inductance",
            "sensor_lag",
        ),
    )
    lag, winding = row(found, "lag"), row(found, "inductance")
    assert not lag.finest
    assert lag.size is not None
    assert winding.size is not None
    assert winding.size / RESISTANCE == pytest.approx(lag.size, rel=0.2)
    assert tied(found, lag, winding)
    # Before a linear machine a lag is what it is behind it.
    assert tied(found, lag, row(found, "sensor_lag"), 10.0)


def test_one_wave_per_revolution_is_gravity_and_six_are_a_ripple(tmp_path: Path) -> None:
    found = flexarm.plan(
        motor(tmp_path, one_way),
        only=(
            "gravity",
            "torque_ripple",
        ),
    )
    gravity, other = row(found, "gravity"), next(r for r in found.rows if r.shape == "order 6")
    assert gravity.shows
    assert not any(r.shape == "order 1" for r in found.rows)
    assert not tied(found, gravity, other)


def test_what_tolerances_take_up_does_not_show(tmp_path: Path) -> None:
    """A body fixed to the rotor is more inertia: within its tolerance nothing shows, without one it does."""
    free = flexarm.plan(motor(tmp_path, both_ways, exact=False), only=("payload",))
    held = flexarm.plan(motor(tmp_path, both_ways), only=("payload",))
    assert row(held, "payload").shows
    size = row(held, "payload").size
    assert size is not None
    assert size < 0.01 * INERTIA
    loose = row(free, "payload")
    assert not loose.shows or (loose.size or 0) > 0.1 * INERTIA


TRAIN = """\
schema: 1
name: drive-train
blocks:
  source: {type: Sine, amplitude: 0.2 N.m, frequency: 1.5 Hz}
  drive: {type: Torque}
  rotor: {type: Inertia, inertia: 1e-3 kg.m2}
  gear: {type: Gear, ratio: 10}
  hub: {type: Inertia, inertia: 0.05 kg.m2}
  drag: {type: BearingFriction, viscous_friction: 0.05 N.m.s/rad}
connect:
  - [source.out, drive.torque]
  - [drive.shaft, rotor.shaft, gear.input]
  - [gear.output, hub.shaft, drag.shaft]
simulate: {stop: 2 s, step: 2 ms}
tolerances: {rotor.inertia: 10 %, hub.inertia: 10 %, drag.viscous_friction: 20 %}
"""


def test_a_second_encoder_tells_on_which_side_of_a_gear_play_is(tmp_path: Path) -> None:
    path = tmp_path / "train.yaml"
    path.write_text(TRAIN, encoding="utf-8")
    encoder = "1e-4 rad"

    def places(measure: dict[str, str]) -> tuple[Plan, Row, Row]:
        found = flexarm.plan(path, measure=measure, only=("backlash",))
        return found, row(found, "backlash", "-> gear.input"), row(found, "backlash", "gear.output ->")

    found, before, behind = places({"rotor.shaft.angle": encoder})
    assert before.shows
    assert behind.shows
    if not tied(found, before, behind):
        pytest.skip("one encoder is enough here")
    assert found.best_sensor is not None
    assert found.best_sensor.settles
    both, before, behind = places({"rotor.shaft.angle": encoder, found.best_sensor.sensor.signal: encoder})
    assert not tied(both, before, behind)


SPRUNG = f"""\
schema: 1
name: sprung
blocks:
  source: {{type: Step, height: 1 N.m}}
  drive: {{type: Torque}}
  rotor: {{type: Inertia, inertia: {INERTIA * 1e3}}}
  flex: {{type: SpringDamper, stiffness: 1 N.m/rad, damping: 1 mN.m.s/rad}}
  arm: {{type: Inertia, inertia: {INERTIA * 1e3}}}
connect:
  - [source.out, drive.torque]
  - [drive.shaft, rotor.shaft, flex.a]
  - [flex.b, arm.shaft]
simulate: {{stop: 1 s, step: 2 ms}}
"""


def test_an_effect_in_the_place_of_a_spring_is_tried_though_its_twist_could_be_read(tmp_path: Path) -> None:
    path = tmp_path / "sprung.yaml"
    path.write_text(SPRUNG, encoding="utf-8")
    found = flexarm.plan(path, measure={"arm.shaft.angle": "1e-4 rad"}, only=("backlash",))
    assert row(found, "backlash", "flex").shows
    assert not [why for _, why in found.failures if "flex.twist" in why]
    assert "no sensor of flex.twist is looked at: an effect takes its place" in found.planned.assumed
    other = flexarm.plan(path, measure={"arm.shaft.angle": "1e-4 rad"}, only=("offset",))
    assert not [text for text in other.planned.assumed if "flex.twist" in text]


def test_a_plan_does_not_depend_on_threads_or_samples(tmp_path: Path) -> None:
    effects = ("coulomb_friction", "offset", "torque_ripple")
    path = motor(tmp_path, both_ways)
    one = flexarm.plan(path, only=effects, workers=1).numbers()
    table = np.loadtxt(tmp_path / "run.csv", delimiter=",", skiprows=1)
    table[:, 2] = np.cos(40 * table[:, 0])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t,u,y", comments="")
    assert flexarm.plan(path, only=effects, workers=2).numbers() == one


def test_the_own_run_is_the_recording_of_it(tmp_path: Path) -> None:
    """The scenario's step as its own run, and as a recording of that run, give the same."""
    path = motor(tmp_path, np.ones_like)
    effects = ("coulomb_friction", "viscous_friction")
    own = flexarm.plan(path, measure={"motor.shaft.speed": f"{SIGMA} rad/s"}, only=effects)
    told = flexarm.plan(path, only=effects)
    for effect in ("coulomb_friction", "viscous_friction"):
        assert row(own, effect).size == pytest.approx(row(told, effect).size, rel=0.2)
    assert any("sampled every 2 ms" in text for text in own.planned.assumed)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"measure": {"motor.shaft.sped": "1 rad/s"}}, ["motor.shaft.sped", "motor.shaft.speed"]),
        ({"measure": {"motor.shaft.speed": "1 V"}}, ["rad/s", "--measure motor.shaft.speed"]),
        ({"measure": {"motor.shaft.speed": "0 rad/s"}}, ["above zero"]),
        ({"measure": {"motor.shaft.speed": ""}, "recordings": ["run"]}, ["both recordings and signals"]),
        ({"without": ["couloumb_friction"]}, ["coulomb_friction"]),
        ({"only": ["backlash"]}, ["backlash", "nowhere"]),
        ({"multiples": (0.5,)}, ["0.5 times", "1 or more"]),
        ({"workers": 0}, ["0 workers"]),
        ({"recordings": ["rum"]}, ["rum", "run"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, given: dict[str, Any], told: Sequence[str]) -> None:
    with pytest.raises(FlexarmError) as error:
        flexarm.plan(motor(tmp_path, one_way), **given)
    for text in told:
        assert text in str(error.value)


def test_a_table_is_no_plan() -> None:
    with pytest.raises(FlexarmError, match="frequency-response table"):
        flexarm.plan("srv02-bare")
