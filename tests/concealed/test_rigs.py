"""Random rigs: drawn within what is promised, the same for a seed, and right by oracles of their own."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid

from benchmarks.concealed.case import draw
from benchmarks.concealed.drawing import Options, Unseen, choose_sensors, hide, make_bench, true_parameters
from benchmarks.concealed.effects import CATALOGUE, DRIVES
from benchmarks.concealed.mechanism import Mechanism, Readout
from benchmarks.concealed.named import plant
from benchmarks.concealed.native import FRICTION
from benchmarks.concealed.plants.base import LinkOptions
from benchmarks.concealed.refit import GaussNewton, Small, least_squares, refit
from benchmarks.concealed.rigs import hidden
from benchmarks.concealed.rigs.drawn import made
from benchmarks.concealed.rigs.equip import KINDS, RATES, ROWS
from benchmarks.concealed.rigs.hard import HARD, hard
from benchmarks.concealed.rigs.rig import SLIDING
from benchmarks.concealed.rigs.topology import PARTS
from benchmarks.concealed.scenario import text, write
from benchmarks.concealed.simulator import InputChain, Simulator
from benchmarks.concealed.sites import DECLARED, drive_sites, find, sites
from benchmarks.concealed.truth import Nuisance, Truth
from tests.concealed.flexarm_side import NOT_IN_THE_LIBRARY, clean, difference
from tests.concealed.rig_side import simulated

MANY = range(150)
QUIET: dict[str, Any] = {"nuisance": 0.0, "seconds": 2.0, "loop": "open"}


@pytest.fixture(scope="module")
def drawn() -> Any:
    """Many rigs and how they are recorded."""
    return [made(seed) for seed in MANY]


def steady(rig: Any) -> Any:
    """A rig with time stamps that do not err, in a copy of its own."""
    other = object.__new__(type(rig))
    other.__dict__ = dict(rig.__dict__, habits=replace(rig.habits, jitter=0.0))
    return other


# -- what is drawn ----------------------------------------------------------------------------------------------------


def test_everything_lies_within_what_is_promised(drawn: Any) -> None:
    for rig, options in drawn:
        t = rig.topology
        assert 1 <= len(t.bodies) + t.link <= 4
        assert 2.0 <= options.seconds <= 30.0
        assert options.rate in RATES
        assert ROWS[0] <= options.seconds * options.rate <= ROWS[1]
        train, hold = options.kinds[: rig.habits.training], options.kinds[rig.habits.training :]
        assert 2 <= len(train) <= 5
        assert 1 <= len(hold) <= 4
        assert not set(train) & set(hold)
        assert set(options.kinds) <= set(KINDS)
        assert 0 <= rig.habits.jitter <= 0.2
        assert 1 <= len(rig.sensors) <= 3
        for part in t.between:
            assert 1.0 <= part.ratio <= 200.0
        for sensor in rig.sensors:
            assert sensor.counts == 0 or 200 <= sensor.counts <= 2**20
            assert sensor.sigma > 0


@pytest.mark.parametrize(
    ("what", "low", "high"),
    [
        (lambda r, o: r.topology.slides, 0.15, 0.35),
        (lambda r, o: r.topology.link, 0.4, 0.6),
        (lambda r, o: o.loop == "closed", 0.25, 0.42),
        (lambda r, o: r.habits.preload > 0, 0.1, 0.3),
        (lambda r, o: r.habits.jitter > 0, 0.15, 0.35),
        (lambda r, o: any(q.at != q.read for q in r.topology.probes), 0.2, 0.5),
        (lambda r, o: any(p.kind == "gear" and p.lossy for p in r.topology.between), 0.1, 0.5),
    ],
    ids=["slides", "link", "closed", "preload", "jitter", "other side", "lossy"],
)
def test_shares_are_those_that_are_told(drawn: Any, what: Any, low: Any, high: Any) -> None:
    assert low <= np.mean([what(rig, options) for rig, options in drawn]) <= high


@pytest.mark.parametrize("part", PARTS)
def test_a_rig_has_what_it_is_asked_to_have(part: Any) -> None:
    for seed in range(60):
        rig, options = made(seed, part)
        t = rig.topology
        assert rig.name == f"rig-{seed}-{part}"
        assert plant(rig.name) is rig
        kinds = [p.kind for p in t.between]
        if part == "belt":
            assert kinds[:2] == ["pulley", "belt"]
            assert 0.008 <= 1 / t.between[0].ratio <= 0.04
            assert "pretension" not in rig.blocks
            assert t.turns(t.nodes[0][0])
            assert not any(t.turns(flange) for node in t.nodes[1:] for flange in node)
        elif part == "motor":
            assert rig.drive_unit == "V"
            assert not {"motor.efficiency", "motor.back_emf_constant"} & rig.nominal().keys()
            assert not rig.fixed.get("motor.inductance")
        else:
            assert kinds[0] == "mesh"
            assert 3 <= t.between[0].ratio <= 160
        able = {s.effect.name for s in drive_sites(rig)}
        assert {"belt": "belt_slack", "motor": "warm_up", "gear": "transmission_error"}[part] in able
        assert ROWS[0] <= options.seconds * options.rate <= ROWS[1]


def test_what_is_asked_for_changes_nothing_else() -> None:
    """A rig without a part is the same whether rigs with one were drawn before or not."""
    made.cache_clear()
    first = [made(seed) for seed in range(5)]
    made.cache_clear()
    for seed in range(5):
        for part in PARTS:
            made(seed, part)
    for seed, (rig, options) in enumerate(first):
        again, recorded = made(seed)
        assert (again.blocks, again.parameters, again.sensors, recorded) == (
            rig.blocks,
            rig.parameters,
            rig.sensors,
            options,
        )


def test_stops_are_where_a_position_is_measured_and_warm_friction_in_bearings(drawn: Any) -> None:
    for rig, _ in drawn:
        able = drive_sites(rig)
        angles = [q.at for q in rig.topology.probes if q.kind == "angle"]
        stops = [{s.place, *s.same} for s in able if s.effect.name == "end_stop"]
        assert all(any(at in names for names in stops) for at in angles)
        assert all(names & set(angles) for names in stops)
        assert {s.place for s in able if s.effect.name == "friction_warm_up"} == rig.topology.bearings.keys()


def test_every_kind_of_drive_sensor_and_effect_is_drawn(drawn: Any) -> None:
    assert {r.drive_unit for r, _ in drawn} == {"V", "A", "N.m", "N"}
    kinds = {q.kind for r, _ in drawn for q in r.topology.probes}
    assert kinds == {"angle", "speed", "tacho", "acceleration", "strain", "tip", "tip_acceleration"}
    assert any(s.step for r, _ in drawn for s in r.sensors)
    everywhere = {s.effect.name for r, _ in drawn for s in sites(r)}
    assert len(everywhere) == 28
    counts = [len(node) for r, _ in drawn for node, cut in zip(r.topology.nodes, r.topology.cuts, strict=True) if cut]
    assert max(counts) >= 4


def test_the_same_seed_gives_the_same_bytes(tmp_path: Any) -> None:
    written = []
    for name in ("a", "b"):
        made.cache_clear()
        hidden.drawn.cache_clear()
        asked, case = hidden.drawn(5)
        sealed = write(case, tmp_path / name, tmp_path / f"answers-{name}", asked.withheld)
        files = {p.name: p.read_bytes() for p in (tmp_path / name).iterdir()}
        written.append((asked, files, json.loads(sealed.read_text())))
    assert written[0] == written[1]
    assert hidden.drawn(4)[0] != written[0][0]


def test_the_scenario_says_nothing_about_what_is_concealed() -> None:
    rig, options = made(4)
    plain = text(draw(rig, [], [], 4, replace(options, nuisance=0.0)))
    for site in ("delay", "coulomb_friction@gear1.output"):
        with_it = text(draw(rig, [site], [3.0], 4, replace(options, nuisance=0.0)))
        assert with_it.split("recordings:")[0] == plain.split("recordings:")[0]
    assert "motor-side" not in text(draw("hard-backlash-link-side", [], [], 1, replace(HARD["hard-ridge"].options)))


def test_a_name_that_is_no_plant() -> None:
    assert plant("rig-17").name == "rig-17"
    assert plant("hard-ridge") is hard("hard-ridge")
    with pytest.raises(ValueError, match="rig-SEED for a random rig"):
        plant("rig-love")


# -- sizes and background ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 4, 14])
def test_what_is_concealed_is_as_large_as_it_is_said(seed: Any) -> None:
    asked, case = hidden.drawn(seed)
    assert len(asked.effects) == 2 + (seed == 1)
    for size, threshold, wanted in zip(case.sizes, case.thresholds, asked.sizes, strict=True):
        assert size == pytest.approx(wanted * threshold, rel=1e-9)
    assert min(case.visible) > 0.9


@pytest.mark.parametrize("seed", [4, 14])
def test_the_background_leaves_little_beside_the_effect(seed: Any) -> None:
    """All of it together, gain and winding apart, which are errors of parameters."""
    _, case = hidden.drawn(seed)
    base, found = case.truth.bare(), case.truth.nuisance
    small = Small(case.bench, base)
    parts = Nuisance(ripple=found.ripple, warm_up=found.warm_up, drift=found.drift)
    assert 0 < small.size(case.bench.outputs(replace(base, nuisance=parts))) < 0.03 * min(case.visible) * 1.2


def test_an_effect_that_cannot_be_seen_is_refused() -> None:
    rig, options = made(28)
    with pytest.raises(Unseen, match="cannot be made"):
        draw(rig, ["sensor_scale@hub.shaft.angle"], [5.0], 28, replace(options, **QUIET))


def test_a_backlash_that_shows_by_its_faces_alone_is_refused() -> None:
    """An accelerometer on a stiff rigid node sees the faces give long before it sees a gap."""
    rig, options = made(0)
    with pytest.raises(Unseen, match="its faces"):
        draw(rig, ["backlash@accelerometer.shaft -> gear1.input"], [5.0], 0, replace(options, **QUIET, rate=500.0))


@pytest.mark.parametrize(("seed", "effect"), [(543296, "delay"), (731157, "lag"), (948163, "delay")])
def test_what_comes_later_and_shows_however_little_that_is_is_refused(seed: int, effect: str) -> None:
    """Where the command jumps, an accelerometer is read before the jump, be it late by a nanosecond or by a sample.

    The delay of rig 948163 was 85 ps: as its instants are rounded, the more samples are read before their jump.
    """
    rig, options = made(seed)
    with pytest.raises(Unseen, match="side of a jump"):
        draw(rig, [effect], [10.0], seed, options)


def test_a_belt_that_hangs_all_the_time_is_refused() -> None:
    """It is a belt of one strand, half as stiff: a wrong stiffness, which is all that recordings could show."""
    rig, options = made(1001, "belt")
    with pytest.raises(Unseen, match="half its stiffness"):
        draw(rig, ["belt_slack"], [3.0], 1001, options)


def test_a_stop_that_no_recording_to_train_on_meets_is_refused() -> None:
    rig, options = made(1001)
    with pytest.raises(Unseen, match="met by no recording to train on"):
        draw(rig, ["end_stop"], [2.0], 1001, options)


def test_the_quick_refit_finds_the_minimum_of_the_slow_one() -> None:
    rig, options = made(4)
    rng = np.random.default_rng(1)
    base = Truth(rig, true_parameters(rig, rng, options))
    bench, _ = make_bench(base, rig.nominal(), choose_sensors(rig, options, ()), rng, options)
    site = find(rig, "stribeck_friction@gear1.output")
    _, concealed, _ = hide(bench, base, [site], [5.0], rng)
    target = bench.outputs(replace(base, concealed=concealed))

    def cost(fitted: Any) -> Any:
        parts = zip(bench.outputs(fitted), target, bench.held_out, strict=True)
        left = sum(float(np.sum((a - b) ** 2)) for a, b, hold in parts if not hold)
        moved = [math.log(fitted.parameters[k] / bench.centre[k]) / tol for k, tol in bench.tolerance.items()]
        return left + float(np.square(moved).sum())

    slow, quick = refit(bench, base, target), GaussNewton(bench, base).refit(target)
    assert cost(quick) <= 1.02 * cost(slow)


def test_damped_steps_that_creep_along_a_ridge_are_followed_by_undamped_ones() -> None:
    """A sum that is told a million times as well as its parts: the least squares of the parts is numpy's."""
    H, y = np.array([[1e6, 1e6], [1.0, 0.0], [0.0, 0.1]]), np.array([0.0, -0.5, 0.0])
    x, _ = least_squares(lambda x: H @ x - y, np.array([1.0, -1.0]), iterations=15)
    assert x == pytest.approx(np.linalg.lstsq(H, y, rcond=None)[0], abs=1e-6)


def test_a_refit_goes_on_from_the_end_of_the_one_before() -> None:
    """A payload moves a resonance by many of its widths: from the start the refit ended at 19 floors, by steps at 3."""
    rig, options = made(255656)
    case = draw(rig, ["payload@link"], [2.82], 255656, options)
    assert case.visible[0] < 2 * case.asked[0]


def test_no_inductance_shows_more_than_any_other_background() -> None:
    """On rig 765873, which conceals nothing, it left more than all the rest, and was what was found."""
    _, case = hidden.drawn(765873)
    assert not case.truth.concealed
    assert case.truth.nuisance.inductance == 0.0


# -- physics ----------------------------------------------------------------------------------------------------------


def test_an_elastic_rig_rings_at_the_frequency_of_two_inertias(drawn: Any) -> None:
    """w^2 = k (1/J1 + 1/J2), seen from the spring, for rigs of two rigid bodies without losses."""
    tried = 0
    for rig, _ in drawn:
        t = rig.topology
        springs = [part for part in t.between if part.kind == "spring"]
        if len(springs) != 1 or t.link or any(part.lossy for part in t.between) or rig.drive_unit == "V":
            continue
        p = {k: (0.0 if k.endswith(("damping", "friction")) else v) for k, v in rig.nominal().items()}
        at = next(i for i, part in enumerate(t.between) if part.kind == "spring")
        sides = [0.0, 0.0]
        for flange, body in t.bodies.items():
            node = t.node_of(flange)
            speed = np.prod([t.between[i].ratio for i in range(node, at) if node <= at])
            slow = np.prod([t.between[i].ratio for i in range(at + 1, node)])
            key = f"{body}.{'mass' if t.slides else 'inertia'}"
            sides[node > at] += p[key] * speed**2 / slow**2
        for i, part in enumerate(t.between):
            if part.massive:
                speed = np.prod([t.between[j].ratio for j in range(i + 1, at)])
                slow = np.prod([t.between[j].ratio for j in range(at + 1, i + 1)])
                sides[i >= at] += p[f"{part.name}.inertia"] * speed**2 / slow**2
        A, _ = rig.assemble(p, {}, LinkOptions(), 0.0).mechanism.state_space()
        expected = math.sqrt(p[f"{springs[0].name}.stiffness"] * (1 / sides[0] + 1 / sides[1]))
        assert np.abs(np.linalg.eigvals(A).imag).max() == pytest.approx(expected, rel=1e-6)
        tried += 1
    assert tried >= 5


def test_energy_is_kept_but_for_what_is_damped(drawn: Any) -> None:
    """Left to itself, a rig without lossy gears loses exactly what its dampers take."""
    tried = 0
    for rig, _ in drawn:
        t = rig.topology
        if any(part.lossy for part in t.between) or rig.drive_unit == "V" or not any(t.cuts):
            continue
        body = rig.assemble(rig.nominal(), {}, LinkOptions(), 0.0)
        A, _ = body.mechanism.state_space()
        M, n = body.mechanism.mass_matrix(), len(body.mechanism.names)
        assert pytest.approx(M.T) == M
        K, D = -M @ A[n : 2 * n, :n], -M @ A[n : 2 * n, n : 2 * n]
        for matrix in (K, D):
            scale = np.abs(matrix).max() or 1.0
            assert np.abs(matrix - matrix.T).max() < 1e-9 * scale
            assert np.linalg.eigvalsh((matrix + matrix.T) / 2).min() > -1e-9 * scale
        fastest = np.abs(np.linalg.eigvals(A)).max()
        h = min(1e-3, 0.02 / fastest)
        start = np.zeros(len(A))
        start[n] = 1.0
        made_ = Simulator(body.mechanism, [Readout({0: 1.0})], h, 1)
        x = made_.run(np.zeros(2000), states=True, initial=start).states
        assert x is not None
        q, v = x[:, :n], x[:, n : 2 * n]
        energy = 0.5 * np.einsum("ki,ij,kj->k", v, M, v) + 0.5 * np.einsum("ki,ij,kj->k", q, K, q)
        lost = trapezoid(np.einsum("ki,ij,kj->k", v, D, v), dx=h)
        assert energy[0] - energy[-1] == pytest.approx(lost, abs=2e-3 * energy[0])
        tried += 1
    assert tried >= 10


def test_a_body_that_sticks_does_not_accelerate_when_the_command_jumps() -> None:
    """An accelerometer on a body held by friction reads nothing, also at the instant at which the torque changes."""
    m = Mechanism()
    body = m.coordinate("body")
    m.inertia(body, 2.0)
    m.torque(body)
    m.add(FRICTION, body, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0)
    command = np.repeat([0.0, 0.9, -0.9, 0.5, 3.0], 10)
    run = Simulator(m, [Readout(body.sense, 2)], 1e-3, 50).run(command)
    assert np.abs(run.clean[:40]).max() < 1e-15  # but for the last digit
    assert run.clean[40:, 0] == pytest.approx(1.0)  # (3 - 1) / 2


@pytest.mark.parametrize("substeps", [1, 7])
def test_an_accelerometer_feels_what_has_come_of_a_late_command(substeps: int) -> None:
    """One body of 2 kg.m2: a sample later the whole of it, a sixteenth of a sample later or at a rate nothing yet."""
    m = Mechanism()
    body = m.coordinate("body")
    m.inertia(body, 2.0)
    m.torque(body)
    command = np.repeat([0.0, 1.0], 4)
    for chain, first in [(InputChain(), 4), (InputChain(delay=1e-3 / 16), 5), (InputChain(delay=1e-3), 5)]:
        run = Simulator(m, [Readout(body.sense, 2)], 1e-3, substeps, chain).run(command)
        assert run.clean[:, 0] == pytest.approx(np.where(np.arange(8) < first, 0.0, 0.5))
    run = Simulator(m, [Readout(body.sense, 2)], 1e-3, substeps, InputChain(slew=400.0)).run(command)
    assert run.clean[:, 0] == pytest.approx([0, 0, 0, 0, 0, 0.2, 0.4, 0.5])


def test_a_preloaded_rig_begins_twisted_and_at_rest() -> None:
    seed = next(s for s in MANY if made(s)[0].habits.preload)
    rig, options = made(seed)
    case = draw(rig, [], [], seed, replace(options, nuisance=0.0))
    twisted = [k for k, angle in enumerate(case.bench.released) if angle]
    assert twisted
    words = text(case)
    assert words.count(f"free: [{rig.habits.free[0]}]") == len(twisted)
    body = rig.assemble(case.truth.parameters, {}, LinkOptions(), 0.0)
    made_ = Simulator(body.mechanism, [Readout(body.ports[rig.main].sense)], 1e-3, 1)
    start = made_.at(0.3)
    n = len(body.mechanism.names)
    assert made_.run(np.zeros(1), initial=start).clean[0, 0] == pytest.approx(0.3)
    assert not start[n:].any()
    last = [part for part in rig.topology.between if part.kind == "spring"][-1]
    before, behind = (body.ports[end] for end in last.ends)
    read = Simulator(body.mechanism, [Readout(before.sense), Readout(behind.sense)], 1e-3, 1)
    angles = read.run(np.zeros(1), initial=start).clean[0]
    assert angles[0] == 0
    assert angles[1] == pytest.approx(0.3 * rig.topology.ratio(last.ends[1]))


# -- flexarm on the other side ----------------------------------------------------------------------------------------

QUICK = (0, 2, 7, 8, 12)


@pytest.mark.parametrize("seed", [s if s in QUICK else pytest.param(s, marks=pytest.mark.slow) for s in range(40)])
def test_the_nominal_model_is_that_of_the_written_scenario(seed: Any, tmp_path: Any) -> None:
    """Without noise and with true parameters the codes agree to a hundredth of a floor: solver accuracy."""
    rig, options = made(seed)
    case = draw(steady(rig), [], [], seed, replace(options, nuisance=0.0))
    assert difference(simulated(case, tmp_path), clean(case)) < 1e-2


JOINTS = {"backlash", "hardening_spring", "hysteresis"}


def _kinds() -> Any:
    """Each effect, where things turn and where they slide; joints that were rigid, and springs."""
    for slides, names in ((False, sorted(CATALOGUE)), (True, sorted(SLIDING))):
        for name in names:
            if name not in NOT_IN_THE_LIBRARY:
                for rigid in (True, False) if name in JOINTS else (None,):
                    yield pytest.param(name, slides, rigid, id=f"{name}{'-slides' * slides}{'-rigid' * bool(rigid)}")


def _where(name: Any, slides: Any, rigid: Any) -> Any:
    """A place of that kind for each rig that has one."""
    found = []
    for seed in range(150):
        rig, _ = made(seed)
        able = [s for s in sites(rig) if s.effect.name == name and rigid in (None, " -> " in s.place)]
        if rig.topology.slides == slides and able:
            found.append((seed, str(able[seed % len(able)])))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("name", "slides", "rigid"), list(_kinds()))
def test_every_effect_means_the_same_on_both_sides(name: Any, slides: Any, rigid: Any, tmp_path: Any) -> None:
    """At its true place, the sensors where they sit, with the true numbers: a twentieth of a floor, or 1e-3 of it.

    A payload is kept out: the truth bends in the mode of the loaded arm, the scenario in that of the bare one. Joints
    are simulated in small steps on both sides: in those that either side chooses they differ by a tenth of a floor.
    """
    for seed, site in _where(name, slides, rigid):
        rig, options = made(seed)
        options = replace(options, **QUIET, rate=max(options.rate, 500.0))
        try:
            case = draw(steady(rig), [site], [5.0], seed, options)
            break
        except Unseen:
            continue
    else:
        raise AssertionError("no rig shows it")
    (concealed,) = case.truth.concealed
    if concealed.effect == "delay":
        whole = max(1, round(concealed.parameters["delay"] * 1e4)) * 1e-4
        concealed = replace(concealed, parameters={"delay": whole})
        case = replace(case, truth=replace(case.truth, concealed=(concealed,)))
    joint = concealed.effect in JOINTS
    truth = case.bench.outputs(case.truth, 2.5e-7) if joint else clean(case)
    without = difference(simulated(case, tmp_path / "without"), truth)
    step = 1e-5 if joint else None
    within = difference(simulated(case, tmp_path / "with", [concealed], step), truth)
    assert within < max(0.05, (3e-2 if concealed.effect == "payload" else 1e-3) * without)


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in range(1, 8))])
def test_a_rig_that_is_asked_for_is_that_of_the_written_scenario(part: Any, seed: Any, tmp_path: Any) -> None:
    rig, options = made(seed, part)
    case = draw(steady(rig), [], [], seed, replace(options, nuisance=0.0))
    assert difference(simulated(case, tmp_path), clean(case)) < 1e-2


NEEDED = {"belt_slack": "belt", "warm_up": "motor", "transmission_error": "gear"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "first"),
    [*itertools.product(sorted(DECLARED), (0, 20)), ("dead_time", 0), ("dead_time", 10)],
)
def test_effects_of_drives_mean_the_same_on_both_sides(name: Any, first: Any, tmp_path: Any) -> None:
    """On the first rig that shows it: a twentieth of a floor, or of a stop a ten-thousandth, as on the belt axis.

    The first rig from 10 with a winding has a known inductance: there the dead time goes by the current that flows.
    """
    assert DRIVES.keys() >= DECLARED
    for seed in range(first, first + 20):
        rig, options = made(seed, NEEDED.get(name, ""))
        options = replace(options, **QUIET, rate=max(options.rate, 500.0))
        able = [s for s in drive_sites(rig) if s.effect.name == name]
        if not able:
            continue
        try:
            case = draw(steady(rig), [str(able[0])], [2.0 if name == "end_stop" else 10.0], seed, options)
            break
        except Unseen:
            continue
    else:
        raise AssertionError("no rig shows it")
    truth = clean(case)
    without = difference(simulated(case, tmp_path / "without"), truth)
    within = difference(simulated(case, tmp_path / "with", case.truth.concealed), truth)
    assert without > 0.9
    assert within < max(0.05, (1e-4 if name == "end_stop" else 0.0) * without)


def test_hard_cases_are_named() -> None:
    assert len(HARD) == 10
    for name, given in HARD.items():
        for effect in given.effects:
            find(plant(name), effect)


@pytest.mark.parametrize("name", ["hard-belt-cogging", "hard-low-noise"])
def test_hard_cases_can_be_drawn(name: Any) -> None:
    given = HARD[name]
    case = draw(name, given.effects, given.sizes, 1, replace(given.options, seconds=2.0))
    assert case.sizes[0] == pytest.approx(given.sizes[0] * case.thresholds[0])


def test_the_arm_that_friction_holds_stands_still_a_fifth_of_the_time() -> None:
    given = HARD["hard-held-still"]
    case = draw("hard-held-still", given.effects, given.sizes, 1, given.options)
    still = [np.abs(np.diff(r.measured[:, 0])) < 1e-9 for r in case.recordings]
    assert np.mean(np.concatenate(still)) > 0.2
    moved = [np.abs(np.diff(r.command)) > 1e-2 for r in case.recordings]
    assert np.mean(np.concatenate(still) & np.concatenate(moved)) > 0.05  # its controller pushes meanwhile


@pytest.mark.slow
@pytest.mark.parametrize("name", list(HARD))
def test_hard_cases_mean_the_same_on_both_sides(name: Any, tmp_path: Any) -> None:
    given = HARD[name]
    options: Options = replace(given.options, seconds=2.0, nuisance=0.0)
    case = draw(name, given.effects, given.sizes, 1, options)
    truth = clean(case)
    without = difference(simulated(case, tmp_path / "without"), truth)
    within = difference(simulated(case, tmp_path / "with", case.truth.concealed), truth)
    assert within < max(0.05, 1e-3 * without)
