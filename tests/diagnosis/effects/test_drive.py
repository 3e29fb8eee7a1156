"""What models of drives leave out: where it is proposed, and that it is found in recordings of independent code."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.integrate import solve_ivp

from benchmarks.concealed.case import draw
from benchmarks.concealed.drawing import Options
from benchmarks.concealed.effects import Concealed
from benchmarks.concealed.plants import PLANTS
from benchmarks.concealed.recording import record
from benchmarks.concealed.scenario import write
from diagnosis.api import diagnose, gather, possible_effects
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.orders import explained_energy, standing_out
from diagnosis.effects.scales import operating_scales
from diagnosis.effects.step_heights import NEAR, heights
from diagnosis.estimation.covariance import covariance
from diagnosis.estimation.problem import Problem
from diagnosis.problems import problem, variant
from diagnosis.search.board import Board
from diagnosis.search.equivalent_effects import NESTED
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.search import _Search, _seen_beside
from diagnosis.verdict.verdict import Diagnosis
from diagnosis.verdict.write import amended_text
from scenarios.amend import AtFlange, InSignal, Set, Wire, amended
from scenarios.load import load
from tests.diagnosis.effects.test_effects import mount, rig, spring

MOTOR = "{type: DCMotor, resistance: 2 ohm, torque_constant: 0.05 N.m/A, rotor_inertia: 1e-3 kg.m2}"
ARM = "  arm: {type: Inertia, inertia: 0.1 kg.m2}\n"


def proposed(path: Path, effect: str) -> list[Candidate]:
    return [c for c in possible_effects(path) if c.effect == effect]


def geared(folder: Path, more: str = "", joined: str = "", wires: str = "") -> Path:
    """A motor, a gear and an arm, with further blocks on the arm's shaft."""
    blocks = f"  motor: {MOTOR}\n  gear: {{type: Gear, ratio: 20}}\n{ARM}{more}"
    connect = f"  - [motor.shaft, gear.input]\n  - [gear.output, arm.shaft{joined}]\n{wires}"
    made: Path = rig(folder, blocks, connect, ("motor.voltage", "V"), ("arm.shaft.angle", "rad"))
    return made


# -- friction that grows with the load ---------------------------------------------------------------------------------


def test_friction_grows_with_what_a_block_tells_of_the_load(tmp_path: Path) -> None:
    """At the motor's shaft with the motor's torque, at the weight's with the weight's; a level beside it."""
    weight = "  weight: {type: GravityTorque, mass: 1 kg, radius: 0.2 m}\n"
    found = proposed(geared(tmp_path, weight, ", weight.shaft"), "load_dependent_friction")
    assert [c.place for c in found] == ["motor.shaft", "weight.shaft"]
    assert len({c.name for c in found}) == 2, "both may be missing at once"
    assert [p.name for p in found[0].parameters] == ["coefficient", "coulomb_friction"]
    attached, wire = found[0].edits(found[0].starts[0])
    assert isinstance(attached, AtFlange)
    assert (attached.type, attached.target) == ("LoadDependentFriction", "motor.shaft")
    assert isinstance(wire, Wire)
    assert wire.ends == ("motor.torque", f"{found[0].name}.load")


def test_a_share_that_grows_with_the_load_stands_beside_it(tmp_path: Path) -> None:
    """The richer law is tried where the simpler one is, contains it, and is in its unit along a slide too."""
    simple, rich = (proposed(geared(tmp_path), f"{kind}_friction") for kind in ("load_dependent", "quadratic_load"))
    assert [c.place for c in rich] == [c.place for c in simple]
    assert [p.name for p in rich[0].parameters] == ["coefficient", "quadratic_coefficient", "coulomb_friction"]
    assert rich[0].effect in NESTED[simple[0].effect]
    folder = tmp_path / "slide"
    folder.mkdir()
    path = mount(folder, "{type: TranslationalSpringDamper, stiffness: 20 N/m}")
    found = proposed(path, "quadratic_load_friction")[-1]
    block = written(path, found).system.blocks[found.name]
    assert block.unit_of("quadratic_coefficient") == "1/N"


def test_a_level_that_the_model_has_is_not_put_in_twice(tmp_path: Path) -> None:
    bearing = "  bearing: {type: BearingFriction, coulomb_friction: 10 mN.m}\n"
    (found,) = proposed(geared(tmp_path, bearing, ", bearing.shaft"), "load_dependent_friction")
    assert [p.name for p in found.parameters] == ["coefficient"]


def test_where_nothing_tells_a_load_there_is_none_to_grow_with(tmp_path: Path) -> None:
    """A rigid gear tells no torque, a drag and a ripple carry none."""
    more = (
        "  drag: {type: QuadraticDrag, drag: 1 mN.m.s2/rad2}\n"
        "  ripple: {type: TorqueRipple, amplitude: 1 mN.m, order: 3}\n"
    )
    found = proposed(geared(tmp_path, more, ", drag.shaft, ripple.shaft"), "load_dependent_friction")
    assert [c.place for c in found] == ["motor.shaft"]


@pytest.mark.parametrize(
    ("make", "kind"), [(spring, "LoadDependentFriction"), (mount, "TranslationalLoadDependentFriction")]
)
def test_a_torque_that_is_given_and_the_torque_of_a_spring_load_too(tmp_path: Path, make: Any, kind: str) -> None:
    """What drives is an input, which cannot be read: what stands before it can. The amended file is a scenario."""
    joint = "{type: SpringDamper, stiffness: 20 N.m/rad}"
    path = make(
        tmp_path, joint if make is spring else joint.replace("Spring", "TranslationalSpring", 1).replace(".m/rad", "/m")
    )
    found = proposed(path, "load_dependent_friction")
    assert [c.block for c in found] == ["torque", "joint", "joint"]
    edits = found[0].edits(found[0].starts[0])
    assert [type(e) for e in edits] == [InSignal, AtFlange, Wire]
    assert edits[1].type == kind  # type: ignore[union-attr]
    for c in found:
        written = tmp_path / f"{c.place}.yaml"
        written.write_text(amended(path.read_text(), c.edits(c.starts[0])), encoding="utf-8")
        load(str(written))


# -- the limit of a current --------------------------------------------------------------------------------------------


def test_a_limit_of_the_current_needs_a_winding(tmp_path: Path) -> None:
    (found,) = proposed(geared(tmp_path), "current_limit")
    limiter, wire = found.edits(found.starts[0])
    assert isinstance(limiter, InSignal)
    assert limiter.parameters["resistance"] == "2 ohm"
    assert limiter.parameters["back_emf_constant"] == "0.05 V.s/rad"
    assert isinstance(wire, Wire)
    assert wire.ends == ("motor.shaft.speed", f"{found.name}.speed")
    assert not found.held, "resistance and back-emf are known as well as the motor's"
    folder = tmp_path / "torque"
    folder.mkdir()
    assert not proposed(spring(folder, "{type: SpringDamper, stiffness: 20 N.m/rad}"), "current_limit")


def test_a_limiter_that_is_there_gets_another_limit(tmp_path: Path) -> None:
    """A limiter before the motor, under control, whose limit is never reached."""
    more = (
        "  source: {type: Step, height: 1 rad}\n  pid: {type: PID, proportional_gain: 5 V/rad}\n"
        "  limit: {type: CurrentLimiter, current_limit: 100 A, resistance: 2 ohm, back_emf_constant: 0.05 V.s/rad}\n"
    )
    wires = (
        "  - [source.out, pid.reference]\n  - [arm.shaft.angle, pid.measurement]\n  - [pid.out, limit.in]\n"
        "  - [motor.shaft.speed, limit.speed]\n  - [limit.out, motor.voltage]\n"
    )
    path = geared(tmp_path, more, "", wires)
    text = path.read_text().replace(
        "drive: {motor.voltage: {column: u, unit: V}}",
        "drive: {pid.reference: {column: u, unit: rad}}\n    loop: reference",
    )
    path.write_text(text)
    (found,) = proposed(path, "current_limit")
    (edit,) = found.edits({"current_limit": 1.5})
    assert edit == Set("limit", "current_limit", "1.5 A")


def test_a_law_that_reads_the_shaft_makes_no_reference_of_a_voltage(tmp_path: Path) -> None:
    """A limit that is never reached changes nothing: no parameter is known better with it.

    They were: the voltage was taken for a controller's reference, which is known exactly. The interval of a dead time's
    voltage was 0.07 % to either side, of an amplifier whose gain was 5 % off.
    """
    path = geared(tmp_path)
    scenario = load(str(path))
    base = problem(scenario, gather(scenario, [], []))
    (found,) = proposed(path, "current_limit")
    law = [f"{found.name}.{key}" for key in ("current_limit", "resistance", "back_emf_constant")]
    never = variant(base, found.edits({"current_limit": 1e6}), held=law)
    names = [f.name for f in base.free]
    assert [f.name for f in never.free] == names
    x = np.zeros(len(names))
    without, within = (np.diag(covariance(posed, x)[0]) for posed in (base, never))
    np.testing.assert_allclose(within, without, rtol=1e-6)


# -- the dead time of an amplifier -------------------------------------------------------------------------------------


@pytest.mark.parametrize("henry", [0.0, 4e-3])
def test_a_dead_time_goes_by_the_current_that_there_is(tmp_path: Path, henry: float) -> None:
    """Of a motor with inductance the current itself, else what follows from voltage and speed."""
    path = geared(tmp_path)
    path.write_text(path.read_text().replace("resistance: 2 ohm", f"resistance: 2 ohm, inductance: {henry} H", 1))
    (found,) = proposed(path, "dead_time")
    law, wire = found.edits(found.starts[0])
    assert isinstance(law, InSignal)
    assert law.parameters["resistance"] == "2 ohm"
    assert isinstance(wire, Wire)
    read = ("motor.current", "current") if henry else ("motor.shaft.speed", "speed")
    assert wire.ends == (read[0], f"{found.name}.{read[1]}")
    written = tmp_path / "amended.yaml"
    written.write_text(amended(path.read_text(), found.edits(found.starts[0])), encoding="utf-8")
    assert load(str(written)).system.blocks[found.name].values["inductance"] is bool(henry)
    folder = tmp_path / "torque"
    folder.mkdir()
    assert not proposed(spring(folder, "{type: SpringDamper, stiffness: 20 N.m/rad}"), "dead_time")


# -- cogging -----------------------------------------------------------------------------------------------------------


def cogging(folder: Path, order: int, amplitude: float) -> tuple[Problem, Path]:
    """The geared two-mass plant with true parameters, and recordings of one that cogs as well."""
    plant = PLANTS["geared-two-mass"]
    case = draw(plant, [], [], 5, Options(nuisance=0.0, exact=True))
    there = Concealed("cogging", "motor.shaft", {"amplitude": amplitude, "order": float(order), "phase": 0.7})
    truth = replace(case.truth, concealed=(there,))
    kinds = [r.kind for r in case.recordings]
    made = replace(case, recordings=record(case.bench, truth, case.sensors, kinds, default_rng(1)))
    write(made, folder / "case", folder / "answers")
    path = folder / "case" / "scenario.yaml"
    scenario = load(str(path))
    return problem(scenario, gather(scenario, [], [])), path


@pytest.mark.parametrize("order", [13, 24, 60, 84, 100])
def test_the_order_of_a_cogging_stands_out(tmp_path: Path, order: int) -> None:
    """To a hundred waves per revolution of the motor, whose speed changes all the time and reverses."""
    made, _ = cogging(tmp_path, order, 3e-4)
    found = standing_out(made, np.zeros(len(made.free)), "motor.shaft", range(13, 101), 5)
    assert order in found[:3]


@pytest.mark.parametrize("order", [36, 90])
def test_an_encoder_behind_a_spring_tells_the_angle_of_a_model_that_turns_too_fast(tmp_path: Path, order: int) -> None:
    """The motor's angle runs ahead by many waves; the load's encoder says by how much, but for the twist."""
    made, _ = cogging(tmp_path, order, 3e-4)
    x = np.array([1.0 if f.name == "motor.resistance" else 0.0 for f in made.free])
    apart = [made.simulate(x, e)[-1] - e.measured[-1] for e in made.training]
    assert max(abs(rows[1]) for rows in apart) * 14 * order > 2 * math.pi
    assert standing_out(made, x, "motor.shaft", range(13, 101), 5)[0] == order


def test_cogging_is_proposed_where_something_drives(tmp_path: Path) -> None:
    """Not at the gear or the load behind the spring; and of orders that a torque ripple does not have."""
    _, path = cogging(tmp_path, 36, 3e-4)
    found = proposed(path, "cogging")
    assert [c.place for c in found] == ["motor.shaft"]
    orders = {start["order"] for start in found[0].starts}
    assert 36.0 in orders
    assert len(orders) <= 5
    assert not orders & {float(k) for k in range(13)}
    lower = {s["order"] for c in possible_effects(path) if c.effect == "torque_ripple" for s in c.starts}
    assert max(lower) == 12.0


def test_nothing_stands_out_of_noise(tmp_path: Path) -> None:
    """A wave that explains no more than chance is not proposed, or has nothing to explain."""
    made, _ = cogging(tmp_path, 36, 0.0)
    answer = explained_energy(made, np.zeros(len(made.free)), "motor.shaft", range(13, 101))
    loud, _ = cogging(tmp_path / "loud", 36, 3e-4)
    assert answer.max() < 0.01 * explained_energy(loud, np.zeros(len(loud.free)), "motor.shaft", range(13, 101)).max()


# -- transmission error ------------------------------------------------------------------------------------------------

ROTOR, LOAD, RATIO, STIFF, LOSS = 2e-5, 0.05, 30.0, 90.0, 0.6
ERROR, ERROR_ORDER, ERROR_PHASE = 6e-5, 2.0, 0.6

JOINT = f"""\
schema: 1
name: joint
blocks:
  torque: {{type: Torque}}
  rotor: {{type: Inertia, inertia: {ROTOR} kg.m2}}
  drive: {{type: HarmonicDrive, ratio: {RATIO}, stiffness: {STIFF} N.m/rad, damping: {LOSS} N.m.s/rad}}
  arm: {{type: Inertia, inertia: {LOAD} kg.m2}}
connect:
  - [torque.shaft, rotor.shaft, drive.input]
  - [drive.output, arm.shaft]
simulate: {{stop: 2 s, step: 2 ms}}
recordings:
"""


def joint(folder: Path, error: float) -> Path:
    """A joint whose gear has a wave, integrated by scipy: rotor and arm, torque in, both angles out."""

    def rates(t: float, y: Any, torque: Any) -> list[float]:
        a, v, b, w = y
        wave, slope = ERROR_ORDER * a + ERROR_PHASE, 1 / RATIO
        twist = a / RATIO + error * (np.sin(wave) - np.sin(ERROR_PHASE)) - b
        slope += error * ERROR_ORDER * np.cos(wave)
        spring = STIFF * twist + LOSS * (slope * v - w)
        return [v, (torque(t) - spring * slope) / ROTOR, w, spring / LOAD]

    rng, text, t = default_rng(4), JOINT, np.arange(0.0, 2.0, 2e-3)
    for k, role in enumerate(("train", "train", "hold_out")):
        rate, other = 7.0 + 3.0 * k, 11.0 + 2.0 * k

        def torque(at: float, rate: float = rate, other: float = other) -> float:
            at = 2e-3 * math.floor(at / 2e-3 + 1e-6)
            return 0.015 * (math.sin(rate * at) + math.sin(other * at))

        made = solve_ivp(rates, (0, 2), [0.0] * 4, t_eval=t, args=(torque,), rtol=1e-9, atol=1e-10, max_step=2e-3)
        angles = made.y[[0, 2]].T + rng.normal(0, 1, (len(t), 2)) * [1e-3, 2e-5]
        rows = np.column_stack([t, [torque(at) for at in t], angles])
        np.savetxt(folder / f"r{k}.csv", rows, delimiter=",", header="t,u,a,b", comments="")
        text += (
            f"  r{k}:\n    file: r{k}.csv\n    time: {{column: t, unit: s}}\n    role: {role}\n"
            "    drive: {torque.torque: {column: u, unit: N.m, hold: zero_order}}\n    measurements:\n"
            "      rotor.shaft.angle: {column: a, unit: rad, noise: 1e-3}\n"
            "      arm.shaft.angle: {column: b, unit: rad, noise: 2e-5}\n"
        )
    (folder / "joint.yaml").write_text(text, encoding="utf-8")
    return folder / "joint.yaml"


def test_a_transmission_error_needs_a_gear_that_gives(tmp_path: Path) -> None:
    (found,) = proposed(joint(tmp_path, 0.0), "transmission_error")
    assert {start["error_order[1]"] for start in found.starts} == {1.0, 2.0, 4.0, 1 / RATIO, 2 / RATIO}
    folder = tmp_path / "rigid"
    folder.mkdir()
    assert not proposed(geared(folder), "transmission_error")


@pytest.mark.slow
def test_a_transmission_error_is_named(tmp_path: Path) -> None:
    """Beside a ripple of the motor, which a wave of the same order resembles."""
    others = ("extra_mode", "outside_vibration", "sensor_scale", "sensor_lag", "hysteresis", "delay", "wrong_parameter")
    found = diagnose(joint(tmp_path, ERROR), workers=1, without=others)
    (finding,) = found.findings
    assert (finding["status"], finding["effect"], finding["place"]) == ("named", "transmission_error", "drive")
    assert finding["parameters"]["error_amplitude[1]"]["value"] == pytest.approx(ERROR, rel=0.02)
    assert finding["parameters"]["error_order[1]"]["value"] == ERROR_ORDER
    assert_reproduced(found, tmp_path / "amended.yaml")


# -- what happens to a command -----------------------------------------------------------------------------------------


def axis(folder: Path, *, belt: str = "", motor: str = "") -> Path:
    """A motor, a pulley, a belt and a carriage whose position is measured."""
    folder.mkdir(exist_ok=True)
    blocks = (
        f"  motor: {MOTOR.replace('}', motor + '}')}\n  pulley: {{type: Pulley, radius: 20 mm}}\n"
        f"  belt: {{type: Belt, stiffness: 20 kN/m, damping: 5 N.s/m{belt}}}\n"
        "  carriage: {type: Mass, mass: 2 kg}\n"
    )
    wires = "  - [motor.shaft, pulley.shaft]\n  - [pulley.slide, belt.a]\n  - [belt.b, carriage.flange]\n"
    made: Path = rig(folder, blocks, wires, ("motor.voltage", "V"), ("carriage.flange.position", "m"))
    return made


def written(path: Path, c: Candidate) -> Any:
    """The amended file of a candidate at its first sizes, loaded."""
    there = path.with_name("amended.yaml")
    there.write_text(amended(path.read_text(), c.edits(c.starts[0])), encoding="utf-8")
    return load(str(there))


@pytest.mark.parametrize("held", [True, False])
def test_a_limit_of_the_rate_stands_before_every_driven_input(tmp_path: Path, held: bool) -> None:
    """Six rates, of one model. A command that jumps has no lag; else it is one that is too short to count, and held."""
    path = geared(tmp_path)
    if not held:
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace("{column: u, unit: V}", "{column: u, unit: V, hold: linear}"), encoding="utf-8")
        assert path.read_text(encoding="utf-8") != text
    (found,) = proposed(path, "rate_limit")
    assert found.place == "signal -> motor.voltage"
    assert len(found.structures()) == 1
    rates = [start["rising"] for start in found.starts]
    assert rates == sorted(rates, reverse=True), "the least effect first"
    assert found.held == (() if held else ("time_constant",))
    block = written(path, found).system.blocks[found.name]
    assert block.held_input == held
    assert block.unit_of("rising") == "V/s"


def test_the_rate_of_a_signal_of_unknown_unit_has_none_either(tmp_path: Path) -> None:
    """A controller of plain gains leaves open in what unit its reference is."""
    blocks = (
        "  reference: {type: Sine, amplitude: 0.1, frequency: 1 Hz}\n"
        "  controller: {type: StateSpace, D: [[20, -20, -2]], unit: V}\n"
        f"  motor: {MOTOR}\n"
    )
    wires = (
        "  - [reference.out, controller.in1]\n  - [motor.shaft.angle, controller.in2]\n"
        "  - [motor.shaft.speed, controller.in3]\n  - [controller.out, motor.voltage]\n"
    )
    path = rig(tmp_path, blocks, wires, ("controller.in1", "rad"), ("motor.shaft.angle", "rad"))
    text = path.read_text().replace("measurements", "loop: reference\n    measurements")
    path.write_text(text)
    found = {c.place: c for c in proposed(path, "rate_limit")}
    block = written(path, found["reference.out -> controller.in1"]).system.blocks["found_rate_limit"]
    assert block.rising > 0


def recorded(folder: Path, effect: str, place: str, **parameters: float) -> Path:
    """The geared two-mass plant with true parameters, and recordings of one with an effect."""
    case = draw(PLANTS["geared-two-mass"], [], [], 5, Options(nuisance=0.0, exact=True, seconds=2.0))
    truth = replace(case.truth, concealed=(Concealed(effect, place, parameters),))
    kinds = [r.kind for r in case.recordings]
    made = replace(case, recordings=record(case.bench, truth, case.sensors, kinds, default_rng(1)))
    write(made, folder / "case", folder / "answers")
    return folder / "case" / "scenario.yaml"


@pytest.mark.parametrize("step", [0.03, 0.08, 0.3, 0.9])
def test_the_height_of_steps_stands_out(tmp_path: Path, step: float) -> None:
    """Of a command of 3 V: one of the two that are proposed is the one of thousands that is nearest the truth."""
    scenario = load(str(recorded(tmp_path, "command_quantisation", "source.out -> motor.voltage", step=step)))
    made = problem(scenario, gather(scenario, [], []))
    found = heights(made, np.zeros(len(made.free)), "motor.voltage", 3.0, 2)
    assert min(abs(height / step - 1) for height in found) < 0.55 * NEAR * step / 3.0


def test_fine_steps_stand_out_of_what_bent_parameters_leave(tmp_path: Path) -> None:
    """Of 1500 steps to the largest command: a fit has moved masses and constants to make up for what it can."""
    step = 0.00595
    case = draw("belt-axis", ["command_quantisation"], [30.0], 1, Options(seconds=4.0, rate=1000.0))
    (there,) = case.truth.concealed
    truth = replace(case.truth, concealed=(replace(there, parameters={"step": step}),))
    kinds = [r.kind for r in case.recordings]
    made = replace(case, recordings=record(case.bench, truth, case.sensors, kinds, default_rng(1)))
    write(made, tmp_path / "case", tmp_path / "answers")
    scenario = load(str(tmp_path / "case" / "scenario.yaml"))
    refit = CandidateFitter(scenario, gather(scenario, [], []), 1).refit.fit
    first, *_ = heights(refit.problem, refit.x, "motor.voltage", 9.0, 2)
    assert abs(first / step - 1) < 0.55 * NEAR * step / 9.0


def test_no_height_stands_out_of_noise(tmp_path: Path) -> None:
    path = recorded(tmp_path, "command_quantisation", "source.out -> motor.voltage", step=0.0)
    assert not proposed(path, "command_quantisation")


# -- the supply and the winding ----------------------------------------------------------------------------------------


def test_a_supply_needs_a_motor_with_a_winding(tmp_path: Path) -> None:
    """Command over the supply's voltage is the duty of a bridge; the motor's current loads the supply."""
    path = geared(tmp_path)
    (found,) = proposed(path, "supply_sag")
    assert len(found.structures()) == 1, "the bus is as quick at every size"
    told = next(p for p in found.parameters if p.name == "source_voltage")
    assert told.fixed
    assert told.unit == "V", "a resistance means nothing without the voltage that it is told for"
    system = written(path, found).system
    assert {block for block in system.blocks if block.startswith("found")} == {
        f"found_supply_sag{part}" for part in ("", "_duty", "_full", "_bridge")
    }
    folder = tmp_path / "torque"
    folder.mkdir()
    assert not proposed(spring(folder, "{type: SpringDamper, stiffness: 20 N.m/rad}"), "supply_sag")


def test_a_small_supply_resistance_changes_nothing(tmp_path: Path) -> None:
    """Source, bridge and duty let the command through, to a thousandth with a supply of a thousandth of an ohm."""
    path = recorded(tmp_path, "command_quantisation", "source.out -> motor.voltage", step=0.0)
    (found,) = proposed(path, "supply_sag")
    scenario = load(str(path))
    bare = problem(scenario, gather(scenario, [], []))
    made = variant(bare, found.edits({**found.starts[0], "resistance": 1e-3}), [], found.held)
    e = bare.training[0]
    one, other = (p.simulate(np.zeros(len(p.free)), e) for p in (bare, made))
    assert np.abs(one - other).max() < 1e-3 * np.abs(one).max()


def test_a_motor_warms_up_where_it_is_the_same_motor_while_cold(tmp_path: Path) -> None:
    """Not where its losses or its second constant have no place in the motor with heat."""
    path = geared(tmp_path)
    (found,) = proposed(path, "warm_up")
    assert found.place == "motor"
    made = written(path, found).system.blocks["motor"]
    assert type(made).__name__ == "ThermalDCMotor"
    assert made.values["resistance"] == 2.0
    for k, more in enumerate((", efficiency: 0.8", ", back_emf_constant: 0.06 V.s/rad")):
        assert not proposed(axis(tmp_path / str(k), motor=more), "warm_up")


@pytest.mark.parametrize(
    ("sliding", "level"), [(False, "coulomb_friction: 5 mN.m"), (True, "viscous_friction: 3 N.s/m")]
)
def test_a_friction_warms_up_where_there_is_one_that_can_fall(tmp_path: Path, sliding: bool, level: str) -> None:
    """Of a shaft or of a slide, in place of the one that is there; one of zero makes no heat."""

    def rubbed(folder: Path, given: str) -> Path:
        if sliding:
            path = axis(folder)
            text = path.read_text().replace(
                "  carriage: ", f"  guide: {{type: TranslationalBearingFriction{given}}}\n  carriage: "
            )
            path.write_text(text.replace("carriage.flange]", "carriage.flange, guide.slide]"))
            return path
        folder.mkdir()
        return geared(folder, f"  guide: {{type: BearingFriction{given}}}\n", ", guide.shaft")

    assert not proposed(rubbed(tmp_path / "none", ""), "friction_warm_up")
    path = rubbed(tmp_path / "some", f", {level}")
    (found,) = proposed(path, "friction_warm_up")
    assert found.place == "guide"
    capacities = [start["heat_capacity"] for start in found.starts]
    assert capacities == sorted(capacities, reverse=True), "the least effect first"
    made = written(path, found).system.blocks["guide"]
    assert type(made).__name__ == ("TranslationalWarmingFriction" if sliding else "WarmingFriction")
    key, value = level.split(": ")
    assert made.values[key] == pytest.approx(float(value.split()[0]) * (1 if sliding else 1e-3))


# -- belts and stops ---------------------------------------------------------------------------------------------------


def test_a_belt_goes_slack_where_no_pretension_is_given(tmp_path: Path) -> None:
    path = axis(tmp_path / "belt")
    (found,) = proposed(path, "belt_slack")
    assert found.place == "belt"
    assert found.edits({"pretension": 12.5}) == [Set("belt", "pretension", "12.5 N")]
    assert not proposed(axis(tmp_path / "tense", belt=", pretension: 30 N"), "belt_slack")
    folder = tmp_path / "mount"
    folder.mkdir()
    assert not proposed(mount(folder, "{type: TranslationalSpringDamper, stiffness: 2 kN/m}"), "belt_slack")


def stopped(folder: Path, *, upper: float, lower: float) -> Path:
    """The axis, with recordings of a carriage that swings between ends at which it turns back at once."""
    path = axis(folder)
    for name in ("one", "other"):
        t, u, y = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1).T
        np.savetxt(
            folder / f"{name}.csv",
            np.column_stack([t, u, folded(y, lower, upper)]),
            delimiter=",",
            header="t,u,y",
            comments="",
        )
    return path


def folded(y: Any, lower: float, upper: float) -> Any:
    """A course reflected at both ends."""
    y = np.where(y > upper, 2 * upper - y, y)
    return np.where(y < lower, 2 * lower - y, y)


def test_a_stop_is_proposed_at_the_ends_at_which_what_is_measured_turns_back(tmp_path: Path) -> None:
    """Where it swings evenly, nothing is proposed; else a stop at that end, and both where both are."""
    assert not proposed(axis(tmp_path / "free"), "end_stop")
    found = proposed(stopped(tmp_path / "one", upper=0.12, lower=-1.0), "end_stop")
    assert [c.option for c in found] == ["upper one"]
    assert {p.name for p in found[0].parameters} == {"upper", "stiffness", "damping"}
    assert all(0.1 < start["upper"] < 0.121 for start in found[0].starts)
    path = stopped(tmp_path / "both", upper=0.12, lower=-0.1)
    found = proposed(path, "end_stop")
    assert [c.option for c in found] == ["upper one", "lower one", "both"]
    made = written(path, found[-1]).system.blocks["found_end_stop"]
    assert type(made).__name__ == "TranslationalEndStop"


def test_a_shaft_whose_angle_nobody_measures_has_no_stops(tmp_path: Path) -> None:
    path = stopped(tmp_path / "one", upper=0.12, lower=-1.0)
    text = path.read_text().replace(
        "carriage.flange.position: {column: y, unit: m", "carriage.flange.speed: {column: y, unit: m/s"
    )
    path.write_text(text)
    assert not proposed(path, "end_stop")


# -- found -------------------------------------------------------------------------------------------------------------


def assert_reproduced(found: Diagnosis, path: Path) -> None:
    """The amended file makes the error that was reported, whatever else of an inserted block was fitted beside it.

    On the rows that the study judged by: of one recording a part may have been taken to learn from.
    """
    path.write_text(amended_text(found), encoding="utf-8")
    scenario = load(str(path))
    made = problem(scenario, gather(scenario, [], []))
    chi2 = made.chi2(np.zeros(len(made.free)), found.study.chosen.fit.problem.held_out)
    assert chi2 == pytest.approx(found.study.chosen.hold_out, rel=1e-3)


QUIET = Options(nuisance=0.0, seconds=2.0)


def law(effect: str, p: Any, amended_file: Path) -> tuple[str, float]:
    """The leading parameter of an effect, as the diagnosis calls it, and its true value."""
    if effect == "supply_sag":  # only resistance over voltage squared shows
        told = load(str(amended_file)).system.blocks["found_supply_sag"].values["source_voltage"]
        return "resistance", p["resistance"] * (told / p["voltage"]) ** 2
    own = {"rate_limit": ("rising", "rate"), "warm_up": ("winding_heat_capacity", "capacity")}
    own |= {"friction_warm_up": ("heat_capacity", "capacity")}
    own |= {"quadratic_load_friction": ("quadratic_coefficient", "quadratic_coefficient")}
    usual = {"load_dependent_friction": "coefficient", "current_limit": "current_limit", "cogging": "amplitude"}
    usual |= {
        "dead_time": "lost_voltage",
        "command_quantisation": "step",
        "belt_slack": "pretension",
        "end_stop": "upper",
    }
    name, true = own.get(effect, (usual.get(effect, ""),) * 2)
    return name, float(p[true])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "effect", "size"),
    [
        ("geared-two-mass", "load_dependent_friction", 100.0),
        ("geared-two-mass", "quadratic_load_friction", 100.0),
        ("geared-two-mass", "current_limit", 5.0),
        ("geared-two-mass", "cogging", 30.0),
        ("geared-two-mass", "rate_limit", 30.0),
        ("geared-two-mass", "command_quantisation", 100.0),
        ("geared-two-mass", "supply_sag", 100.0),
        ("geared-two-mass", "dead_time", 100.0),
        ("belt-axis", "belt_slack", 100.0),
        ("belt-axis", "warm_up", 100.0),
        ("belt-axis", "friction_warm_up", 100.0),
        ("belt-axis", "end_stop", 2.0),
    ],
)
def test_it_is_named_where_it_is_concealed(tmp_path: Path, plant: str, effect: str, size: float) -> None:
    """The truth is integrated by a code that shares nothing with ours; friction and saturation are tried too."""
    case = draw(plant, [effect], [size], 3, QUIET)
    write(case, tmp_path / "case", tmp_path / "answers")
    path = tmp_path / "case" / "scenario.yaml"
    resistance = f"{case.nominal['motor.resistance']!r} ohm"
    text = path.read_text().replace(f"resistance: {resistance}", "resistance: $winding")
    path.write_text(text.replace("\nblocks:", f"\nparameters: {{winding: {resistance}}}\nblocks:", 1), encoding="utf-8")
    found = diagnose(path, workers=1)
    assert found.verdict == "named"
    (finding,) = found.findings
    assert finding["effect"] == effect
    assert_reproduced(found, tmp_path / "case" / "amended.yaml")
    name, true = law(effect, case.truth.concealed[0].parameters, tmp_path / "case" / "amended.yaml")
    there = finding["parameters"][name]
    if effect == "command_quantisation":  # one that is only chosen has no interval
        assert there["value"] == pytest.approx(true, rel=5e-3)
    else:
        assert there["low"] <= true <= there["high"]


@pytest.mark.slow
def test_friction_and_cogging_that_lose_a_machine_are_found_over_the_beginnings(tmp_path: Path) -> None:
    """Of 300 thresholds each, on two masses: over whole recordings other effects promise more, and none fits."""
    case = draw("geared-two-mass", ["coulomb_friction", "cogging"], [300.0], 1)
    write(case, tmp_path / "case", tmp_path / "answers")
    scenario = load(str(tmp_path / "case" / "scenario.yaml"))
    fitter = CandidateFitter(scenario, gather(scenario, [], []), 1)
    few = {"coulomb_friction", "cogging", "dead_zone", "offset", "quadratic_drag"}
    scales = _seen_beside(operating_scales(fitter.base), fitter.refit)
    listed = [c for c in candidates(scales) if c.effect in few]
    search = _Search(Board(fitter, fitter.refit, listed, None))
    search.first.begin()
    before = search.known.best
    assert before.left.energy.sum() > 1e4 * before.left.count.sum()
    search.growing.pairs.of_beginnings(before)
    assert search.known.best.keys == {"coulomb_friction at motor.shaft", "cogging at motor.shaft"}
    assert search.known.best.fit.chi2 < 1.2
