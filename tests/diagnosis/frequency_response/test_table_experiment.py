"""Frequency-response tables: independent oracles, and [Gao J. n.d., Tables 2.2, A.1, A.2] diagnosed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from diagnosis.api import diagnose, fit, gather
from diagnosis.frequency_response.table_experiment import TableExperiment, quantum, scatter
from diagnosis.problems import problem
from diagnosis.thresholds import TABLES
from diagnosis.verdict.write import write
from engine.errors import FlexarmError
from scenarios.load import load

MOTOR = {"R": 2.6, "k": 7.68e-3, "eta": 0.69, "J": 4.606e-7, "B": 1.26e-6}
LOAD = {"k": 0.013, "d": 2e-4, "J": 4.91e-5, "B": 1.98e-6}
DRY = 2.25e-4

HEAD = """\
schema: 1
name: bench
blocks:
  source: {type: Step, height: 2 V}
  motor:
    type: DCMotor
    resistance: 2.6 ohm
    torque_constant: 7.68 mN.m/A
    back_emf_constant: 7.68 mV.s/rad
    efficiency: 0.69
    rotor_inertia: 4.606e-7 kg.m2
    viscous_friction: 1.26e-6 N.m.s/rad
"""
TWO_MASSES = """\
  spring: {type: SpringDamper, stiffness: 0.013 N.m/rad, damping: 2e-4 N.m.s/rad}
  load: {type: Inertia, inertia: 4.91e-5 kg.m2}
  bearing: {type: BearingFriction, viscous_friction: 1.98e-6 N.m.s/rad}
connect:
  - [source.out, motor.voltage]
  - [motor.shaft, spring.a]
  - [spring.b, load.shaft, bearing.shaft]
"""
STUCK = """\
  friction: {type: BearingFriction, coulomb_friction: 2.25e-4 N.m}
connect:
  - [source.out, motor.voltage]
  - [motor.shaft, friction.shaft]
"""
TABLE = """\
recordings:
  table:
    kind: frequency_response
    file: table.csv
    drive: motor.voltage
    frequency: {column: w, unit: rad/s}
    amplitude: {column: u, unit: V}
    response:
      motor.shaft.speed: {column: y, unit: rad/s, noise: 0.01 rad/s}
"""


def scenario(folder: Any, body: Any, frequency: Any, amplitude: Any, reading: Any, extra: str = "") -> Any:
    rows = np.column_stack([frequency, np.broadcast_to(amplitude, np.shape(frequency)), reading])
    np.savetxt(folder / "table.csv", rows, delimiter=",", header="w,u,y", comments="", fmt="%.12g")
    path = folder / "bench.yaml"
    path.write_text(HEAD + body + TABLE + extra)
    return load(path)


def two_mass_gain(w: Any) -> Any:
    """|speed of the motor / voltage| of two masses, from the equations of motion in the frequency domain."""
    m, c, s = MOTOR, LOAD, 1j * np.asarray(w)
    link = c["d"] + c["k"] / s
    a = m["J"] * s + m["B"] + m["eta"] * m["k"] ** 2 / m["R"] + link
    b = c["J"] * s + c["B"] + link
    return np.abs(m["eta"] * m["k"] / m["R"] * b / (a * b - link**2))


def sticking_motor(w: Any, amplitude: Any, cycles: float = 6) -> Any:
    """Half the range of the motor's speed under Coulomb friction, by scipy with the stuck phases located."""
    m = MOTOR

    def drive(t: Any) -> Any:
        return m["eta"] * m["k"] / m["R"] * amplitude * math.sin(w * t)

    slope = m["B"] + m["eta"] * m["k"] ** 2 / m["R"]
    t, v, sign, end, top = 0.0, 0.0, 0.0, cycles * 2 * math.pi / w, []
    while t < end - 1e-12:
        if sign == 0.0:
            # Stuck: wait until the drive exceeds the friction.
            grid = np.linspace(t, end, 20_000)
            over = np.flatnonzero(np.abs([drive(x) for x in grid]) > DRY)
            if not len(over):
                break
            t, sign = float(grid[over[0]]), math.copysign(1.0, drive(float(grid[over[0]])))
        stop: Any = lambda _, y: y[0]  # noqa: E731
        stop.terminal, stop.direction = True, -sign
        start = sign * 1e-12 if v == 0 else v
        found = solve_ivp(
            lambda x, y, sign=sign: [(drive(x) - slope * y[0] - sign * DRY) / m["J"]],
            (t, end),
            [start],
            events=stop,
            rtol=1e-9,
            atol=1e-9,
            max_step=0.002 / w * 2 * math.pi,
        )
        top.append((found.t, found.y[0]))
        t, v = float(found.t[-1]), 0.0
        if not len(found.t_events[0]):
            break
        sign = math.copysign(1.0, drive(t)) if abs(drive(t)) > DRY else 0.0
    times, speeds = (np.concatenate(parts) for parts in zip(*top, strict=True))
    late = speeds[times > end - 2 * math.pi / w]
    return (late.max() - late.min()) / 2


def only(made: Any) -> Any:
    (e,) = made.experiments
    assert isinstance(e, TableExperiment)
    return e


def test_a_linear_table_leaves_nothing_over(tmp_path: Path) -> None:
    w = np.geomspace(0.05, 300, 7)
    made = problem(s := scenario(tmp_path, TWO_MASSES, w, 2.0, 2.0 * two_mass_gain(w)), gather(s, (), ()))
    e = only(made)
    left = made.residual(np.zeros(len(made.free)), e) * e.sigma * e.relative
    assert np.abs(left).max() < 1e-6


def test_the_simulated_answer_is_the_closed_form(tmp_path: Path) -> None:
    w = np.array([0.1, 0.9, 7.0, 16.0, 120.0])
    made = problem(s := scenario(tmp_path, TWO_MASSES, w, 2.0, 2.0 * two_mass_gain(w)), gather(s, (), ()))
    answers = only(made).answers
    answers.closed_form.__dict__["_state_space"] = None
    found = answers.solve({}, w, np.full(5, 2.0), {})
    assert all(o.settled and o.x is not None for o in found)
    decibel = 20 * np.log10([o.amplitudes[0] for o in found] / (2.0 * two_mass_gain(w)))
    assert np.abs(decibel).max() < 2e-3


def test_coulomb_friction_acts_as_an_independent_integration_says(tmp_path: Path) -> None:
    w, u = np.array([2.0, 12.0, 30.0, 60.0]), np.array([2.0, 0.3, 0.8, 2.0])
    reading = np.array([sticking_motor(a, b) for a, b in zip(w, u, strict=True)])
    made = problem(s := scenario(tmp_path, STUCK, w, u, reading), gather(s, (), ()))
    e = only(made)
    left = made.residual(np.zeros(len(made.free)), e) * e.sigma * e.relative
    assert np.abs(left).max() < 0.01
    # At the same frequency a linear model answers in proportion; this one does not.
    assert reading[1] / u[1] < 0.8 * reading[0] / u[0]


def test_a_start_nearby_gives_the_same_answer(tmp_path: Path) -> None:
    w = np.array([0.2, 1.0, 9.0, 20.0, 90.0])
    s = load("srv02-backlash")
    made = problem(s, gather(s, (), ()))
    first = made.experiments[0]
    assert isinstance(first, TableExperiment)
    answers = first.answers
    near = dict(enumerate(answers.solve({"contact.stiffness": 0.0125}, w, np.full(5, 2.0), {})))
    warm = answers.solve({}, w, np.full(5, 2.0), near)
    cold = answers.solve({}, w, np.full(5, 2.0), {})
    ratio = np.array([a.amplitudes[0] / b.amplitudes[0] for a, b in zip(warm, cold, strict=True)])
    assert np.abs(20 * np.log10(ratio)).max() < 3e-3


def test_derivatives_are_those_of_the_closed_form(tmp_path: Path) -> None:
    w = np.geomspace(0.05, 300, 7)
    made = problem(s := scenario(tmp_path, TWO_MASSES, w, 2.0, 2.0 * two_mass_gain(w)), gather(s, (), ()))
    e = only(made)
    _, J = made.linearised(np.zeros(len(made.free)), e)
    names = [f.name for f in made.free]
    h, base = TABLES.difference, dict(LOAD)
    try:
        LOAD["J"] = base["J"] * math.exp(0.1 * h)
        up = two_mass_gain(w)
    finally:
        LOAD.update(base)
    slope = 20 * np.log10(up / two_mass_gain(w)) / h
    mine = -J[:, names.index("load.inertia")] * (e.sigma * e.relative)[:, 0]
    assert np.abs(mine - slope).max() < 1e-5 * np.abs(slope).max()


def test_the_step_of_readings_is_found_whatever_digits_they_have() -> None:
    random = np.random.default_rng(4)
    step = 0.340885
    readings = step * random.integers(10, 600, 30)
    assert quantum(np.round(readings, 4)) == pytest.approx(step, rel=1e-4)
    readings[7] += 0.4 * step  # a misprint
    assert quantum(np.round(readings, 4)) == pytest.approx(step, rel=1e-4)
    assert quantum(np.round(random.uniform(1, 200, 30), 3)) == pytest.approx(1e-3)


def test_scatter_sees_noise_and_not_the_curve() -> None:
    w = np.geomspace(0.05, 300, 60)
    level = 20 * np.log10(two_mass_gain(w))
    assert scatter(w, level) < 0.02
    noisy = level + np.random.default_rng(2).normal(0, 0.2, 60)
    assert scatter(w, noisy) == pytest.approx(0.2, rel=0.35)


def test_every_second_row_is_held_out_unless_a_table_is(tmp_path: Path) -> None:
    w = np.geomspace(0.05, 300, 13)
    s = scenario(tmp_path, TWO_MASSES, w, 2.0, 2.0 * two_mass_gain(w))
    made = problem(s, gather(s, (), ()))
    train, held = made.training, made.held_out
    assert [len(e.time) for e in (*train, *held)] == [7, 6]
    one, other = train[0], held[0]
    assert isinstance(one, TableExperiment)
    assert isinstance(other, TableExperiment)
    assert np.allclose(np.sort(np.concatenate([one.frequency, other.frequency])), w)
    assert "held out" in one.note


def test_tables_and_recordings_over_time_do_not_mix(tmp_path: Path) -> None:
    w = np.geomspace(0.05, 300, 7)
    s = scenario(tmp_path, TWO_MASSES, w, 2.0, 2.0 * two_mass_gain(w))
    (table,) = gather(s, (), ())
    t = np.arange(0, 1, 1e-2)
    np.savetxt(
        tmp_path / "run.csv",
        np.column_stack([t, np.sin(t), np.sin(t)]),
        delimiter=",",
        header="t,motor.voltage [V],motor.shaft.speed [rad/s]",
        comments="",
    )
    with pytest.raises(FlexarmError, match="frequency-response table"):
        problem(s, [table, *gather(s, [tmp_path / "run.csv"], ())])


def test_too_few_rows_are_refused(tmp_path: Path) -> None:
    w = np.array([1.0, 10.0])
    s = scenario(tmp_path, TWO_MASSES, w, 2.0, 2.0 * two_mass_gain(w))
    with pytest.raises(FlexarmError, match="2 rows"):
        problem(s, gather(s, (), ()))


def test_a_fit_recovers_a_known_parameter_from_a_table(tmp_path: Path) -> None:
    w = np.geomspace(0.05, 300, 15)
    true = dict(LOAD)
    try:
        LOAD["J"] = 1.15 * true["J"]
        reading = 2.0 * two_mass_gain(w)
    finally:
        LOAD.update(true)
    known = "".join(
        f"  {n}: 0\n"
        for n in (
            "motor.resistance",
            "motor.torque_constant",
            "motor.back_emf_constant",
            "motor.efficiency",
            "motor.rotor_inertia",
            "motor.viscous_friction",
            "bearing.viscous_friction",
        )
    )
    s = scenario(tmp_path, TWO_MASSES, w, 2.0, reading, "tolerances:\n" + known)
    made, scores = fit(s)
    assert made.parameters()["load.inertia"] == pytest.approx(1.15 * LOAD["J"], rel=0.01)
    assert scores["held out"] < 0.1


def test_a_tolerance_for_no_parameter_is_refused(tmp_path: Path) -> None:
    w = np.geomspace(0.05, 300, 7)
    s = scenario(tmp_path, TWO_MASSES, w, 2.0, 2.0 * two_mass_gain(w), "tolerances: {spring.stifness: 5 %}\n")
    with pytest.raises(FlexarmError, match=r"spring\.stifness") as caught:
        problem(s, gather(s, (), ()))
    assert "spring.stiffness" in str(caught.value)


KNOWN = [f"tolerances.motor.{p}=0" for p in ("resistance", "torque_constant", "back_emf_constant", "efficiency")]


def rms(made: Any, role: Any = ("train", "hold_out")) -> float:
    """Root mean square of what a problem's model leaves over (dB), as its parameters were given."""
    zero = np.zeros(len(made.free))
    left = [made.residual(zero, e) * e.sigma * e.relative for e in made.experiments if e.role in role]
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))


@pytest.mark.parametrize(
    ("name", "overrides", "published"),
    [
        ("srv02-2mass-b3", [], 5.94),
        ("srv02-backlash", ["contact.half_gap=0"], 2.81),
        ("srv02-2mass-b3", ["contact.law=push_only", "contact.half_gap=0.03"], 1.47),
        ("srv02-backlash", [], 1.30),
        ("srv02-2mass-b1", [], 9.10),
    ],
)
def test_the_published_mismatches_come_out(name: str, overrides: list[Any] | list[str], published: float) -> None:
    s = load(name, overrides)
    assert rms(problem(s, gather(s, (), ()))) == pytest.approx(published, abs=0.01)


def test_table_2_2_cannot_tell_coulomb_from_viscous_friction() -> None:
    """Either, with the inertia within its tolerance, brings the linear motor's table down to its scatter."""
    coulomb, dry = fit("srv02-bare", overrides=[*KNOWN, "tolerances.motor.viscous_friction=0"])
    viscous, wet = fit(
        "srv02-bare", overrides=[*KNOWN, "friction.coulomb_friction=0", "tolerances.motor.viscous_friction=1000 %"]
    )
    _, without = fit(
        "srv02-bare", overrides=[*KNOWN, "friction.coulomb_friction=0", "tolerances.motor.viscous_friction=0"]
    )
    assert coulomb.parameters()["friction.coulomb_friction"] == pytest.approx(2.25e-4, abs=0.4e-4)
    assert viscous.parameters()["motor.viscous_friction"] > 1.5 * 1.26e-6
    for scores in (dry, wet):
        assert scores["fitted"] < 1.0
        assert scores["held out"] < 2.5
    assert without["held out"] > 30


@pytest.mark.slow
def test_table_2_2_is_a_tie_that_holds_coulomb_friction(tmp_path: Path) -> None:
    overrides = [*KNOWN, "tolerances.motor.viscous_friction=0", "friction.coulomb_friction=0"]
    found = diagnose("srv02-bare", overrides=overrides)
    assert found.verdict == "tie"
    (finding,) = found.findings
    told = {t.effects[0].effect: t for t in found.rivals if t.effects[0].place == "motor.shaft"}
    assert {"coulomb_friction", "viscous_friction"} <= {*told, finding["effect"]}
    assert told["coulomb_friction"].added()["coulomb_friction.coulomb_friction"] == pytest.approx(2.25e-4, abs=0.4e-4)
    assert found.proposal is not None
    assert found.proposal.kind == "amplitude_sweep"
    assert any(label.startswith("coulomb_friction") for label in found.proposal.separates)
    assert any("one amplitude" in text for text in found.warnings)
    assert "rad/s" in finding["when"]
    assert "dB above" in finding["frequency"]
    names = {p.name for p in write(found, tmp_path / "out")}
    assert {"diagnosis.json", "amended.yaml", "held-out.png", "next-experiment.csv"} <= names
    assert (tmp_path / "out" / "next-experiment.csv").read_text().startswith("frequency [rad/s],motor.voltage [V]")
    assert load(tmp_path / "out" / "amended.yaml").recordings


@pytest.mark.slow
def test_table_2_2_shows_nothing_if_the_data_sheet_is_free_to_move() -> None:
    """Within the tolerances of the motor's constants the linear model fits; no friction is claimed from five rows."""
    assert diagnose("srv02-bare", overrides=["friction.coulomb_friction=0"]).verdict == "none"


def test_a_spring_at_rest_under_load_shifts_the_answer_only(tmp_path: Path) -> None:
    """Where a ground spring pulls at rest the amplitudes are those of the linear equations."""
    body = STUCK.replace("coulomb_friction: 2.25e-4 N.m", "viscous_friction: 0 N.m.s/rad").replace(
        "connect:", "  ground: {type: GroundSpring, stiffness: 1e-4 N.m/rad, rest_angle: 0.3 rad}\nconnect:"
    )
    body = body.replace("friction.shaft]", "friction.shaft, ground.shaft]")
    w, m = np.array([2.0, 10.0, 20.0, 60.0]), MOTOR
    slope = m["B"] + m["eta"] * m["k"] ** 2 / m["R"]
    reading = m["eta"] * m["k"] / m["R"] * 2.0 / np.abs(m["J"] * 1j * w + slope + 1e-4 / (1j * w))
    s = scenario(tmp_path, body, w, 2.0, reading)
    made = problem(s, gather(s, (), ()))
    assert rms(made) < 1e-3


@pytest.mark.slow
def test_table_a_2_is_led_by_backlash_and_other_contacts_rival_it() -> None:
    """From the linear two masses of Table B.3; Coulomb friction at the motor is not claimed."""
    found = diagnose("srv02-2mass-b3")
    chosen, rivals = found.study.chosen, {c.key for t in found.rivals for c in t.effects}
    assert found.verdict == "tie"
    assert [c.key for c in chosen.effects] == ["backlash at contact"]
    assert "one_sided_contact at contact" in rivals
    assert "coulomb_friction at motor.shaft" not in rivals
    assert _left(chosen.fit) < 0.6
    assert _left(found.study.refit.fit) > 2.0
    assert found.proposal is not None
    assert found.proposal.kind == "amplitude_sweep"


@pytest.mark.slow
def test_table_a_1_has_a_wrong_inertia_and_a_contact_that_is_not_a_spring() -> None:
    """Table B.1 does not describe Table A.1; what the contact lacks is told with the inertia let go of."""
    found = diagnose("srv02-2mass-b1")
    assert found.verdict == "wrong_parameter"
    wrong = next(f for f in found.findings if f["status"] == "wrong_parameter")
    assert wrong["place"] == "load.inertia"
    assert 1.8 < 1 / wrong["parameters"]["inertia"]["factor"] < 2.9
    assert {f["place"] for f in found.findings} == {"load.inertia", "contact"}
    assert _left(found.study.chosen.fit) < 0.5


def _left(made: Any) -> float:
    """Root mean square of what a fit leaves over, all rows (dB)."""
    parts = [made.problem.residual(made.x, e) * e.sigma * e.relative for e in made.problem.experiments]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
