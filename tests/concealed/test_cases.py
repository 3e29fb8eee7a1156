"""Cases: deterministic, blind, at the size asked for, and made without flexarm."""

from __future__ import annotations

import ast
import csv
import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import benchmarks.concealed
from benchmarks.concealed import ties
from benchmarks.concealed.__main__ import main
from benchmarks.concealed.case import draw
from benchmarks.concealed.drawing import Options
from benchmarks.concealed.effects import CATALOGUE, NAMES
from benchmarks.concealed.nuisance import SHARES, sensor_noise, smaller
from benchmarks.concealed.plants import PLANTS
from benchmarks.concealed.refit import Small, excess, refit
from benchmarks.concealed.rigs.drawn import made
from benchmarks.concealed.rigs.ways import ways
from benchmarks.concealed.scenario import text, write
from benchmarks.concealed.sites import find, sites
from benchmarks.concealed.suites import CORE, PAIRS, TIES
from benchmarks.concealed.ties import FLOOR, from_answers, tie_class
from benchmarks.concealed.truth import Nuisance
from diagnosis.verdict.experiment_design import menu

FOLDER = Path(benchmarks.concealed.__file__).parent
OURS = {"engine", "blocks", "scenarios", "fmu", "diagnosis", "flexarm"}
QUIET = Options(nuisance=0.0)
SHORT = Options(seconds=1.0)


def files(folder: Any) -> dict[Any, Any]:
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


# -- independence -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("file", sorted(FOLDER.rglob("*.py")), ids=lambda p: str(p.relative_to(FOLDER)))
def test_no_module_imports_anything_of_ours(file: Any) -> None:
    for node in ast.walk(ast.parse(file.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            names = [node.module or ""]
        elif isinstance(node, ast.Call):
            assert getattr(node.func, "id", getattr(node.func, "attr", "")) not in ("__import__", "import_module")
        assert not {name.split(".")[0] for name in names} & OURS


def test_nothing_of_ours_is_loaded_while_a_case_is_made() -> None:
    code = (
        "import sys; from benchmarks.concealed.case import draw; draw('pendulum', ['backlash'], [3], 1);"
        f"print({sorted(OURS)!r}, [m for m in sys.modules if m.split('.')[0] in {sorted(OURS)!r}])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=FOLDER.parents[1]
    )
    assert done.stdout.strip().endswith("[]")


# -- what a case is ---------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write(draw("geared-two-mass", ["backlash"], [3.0], 7, SHORT), tmp_path / name, tmp_path / f"answers-{name}")
    assert files(tmp_path / "a") == files(tmp_path / "b")
    sealed = [json.loads((tmp_path / f"answers-{n}" / f"{n}.json").read_text()) for n in ("a", "b")]
    assert sealed[0] == sealed[1]
    write(draw("geared-two-mass", ["backlash"], [3.0], 8, SHORT), tmp_path / "c", tmp_path / "answers-c")
    assert files(tmp_path / "a")["rec1.csv"] != files(tmp_path / "c")["rec1.csv"]


def test_a_case_can_be_drawn_again_from_its_answers() -> None:
    case = draw("pendulum", ["torque_ripple"], [10.0], 3, Options(seconds=2.0))
    again = from_answers(json.loads(json.dumps(case.answers())))
    assert again.truth == case.truth
    for a, b in zip(case.recordings, again.recordings, strict=True):
        assert np.array_equal(a.measured, b.measured)


@pytest.mark.parametrize("plant", list(PLANTS))
def test_the_folder_says_nothing_about_what_is_concealed(plant: Any, tmp_path: Path) -> None:
    """Whatever is concealed, the scenario is the same text; only the recordings' values differ."""
    options = Options(seconds=1.0, kinds=("multi_step", "chirp", "ramp", "prbs", "reversal", "coast"))
    plain = text(draw(plant, [], [], 4, options))
    for effect in ("coulomb_friction", "delay", "joint_flexibility"):
        case = draw(plant, [effect], [3.0], 4, options)
        assert text(case) == plain
    sealed = write(case, tmp_path / "case", tmp_path / "answers")
    names = {p.name for p in (tmp_path / "case").iterdir()}
    assert names == {"scenario.yaml", *(f"rec{k}.csv" for k in range(1, 7))}
    assert json.loads(sealed.read_text())["effects"] == ["joint_flexibility"]
    words = " ".join(p.read_text() for p in (tmp_path / "case").iterdir())
    assert not any(name in words for name in NAMES if name not in ("none", "inductance", "viscous_friction"))


def test_answers_may_not_lie_in_the_case(tmp_path: Path) -> None:
    case = draw("pendulum", [], [], 1, Options(seconds=0.5, nuisance=0))
    with pytest.raises(ValueError, match="must not lie"):
        write(case, tmp_path / "case", tmp_path / "case" / "answers")


def test_columns_and_counts(tmp_path: Path) -> None:
    case = draw("srv02-flexible", [], [], 2, Options(seconds=2.0))
    write(case, tmp_path / "case", tmp_path / "answers")
    with (tmp_path / "case" / "rec3.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["t", "u", "enc", "strain"]
    assert len(rows) == 2000
    assert float(rows[1]["t"]) == 1e-3
    counts = [int(row["enc"]) for row in rows]
    assert max(abs(c) for c in counts) > 20
    angle = case.recordings[2].measured[:, 0]
    assert angle == pytest.approx(np.array(counts) * 2 * np.pi / 4096)


def test_roles_and_kinds() -> None:
    case = draw("harmonic-arm", [], [], 5)
    assert [r.role for r in case.recordings] == ["train"] * 3 + ["hold_out"] * 3
    assert len({r.kind for r in case.recordings}) == 6


@pytest.mark.parametrize("plant", list(PLANTS))
def test_true_parameters_lie_within_their_tolerances(plant: Any) -> None:
    for seed in range(30):
        case = draw(plant, [], [], seed, Options(seconds=0.2, nuisance=0))
        for q in PLANTS[plant].parameters:
            assert abs(case.truth.parameters[q.name] / q.value - 1) <= min(q.spread, q.tolerance) + 1e-12
            assert case.truth.parameters[q.name] <= q.ceiling


def test_a_parameter_may_be_wrong_on_purpose() -> None:
    case = draw("geared-two-mass", [], [], 1, Options(seconds=0.5, nuisance=0, wrong=(("load.inertia", 2.6),)))
    assert 2.3 < case.truth.parameters["load.inertia"] / case.nominal["load.inertia"] < 2.9


def test_every_effect_of_the_catalogue_lives_somewhere() -> None:
    everywhere = {s.effect.name for plant in PLANTS.values() for s in sites(plant)}
    assert everywhere == set(CATALOGUE)
    assert len(everywhere) == 28
    for effect in CORE:
        assert sum(any(s.effect.name == effect for s in sites(p)) for p in PLANTS.values()) >= 2


def test_what_cannot_be_hidden_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot hide 'inductance'"):
        draw("pendulum", ["inductance"], [3.0], 1)
    with pytest.raises(ValueError, match=r"it has dead_zone@source\.out"):
        draw("pendulum", ["dead_zone@arm.shaft"], [3.0], 1)
    with pytest.raises(ValueError, match="change the joint"):
        draw("pendulum", ["backlash", "joint_flexibility"], [3.0], 1, QUIET)
    with pytest.raises(ValueError, match="add 'gyro'"):
        draw("pendulum", ["sensor_bias@arm.shaft.speed"], [3.0], 1)
    with pytest.raises(ValueError, match="no kind of recording"):
        draw("pendulum", [], [], 1, Options(kinds=("sing",)))


def test_places_have_synonyms() -> None:
    assert find(PLANTS["srv02-flexible"], "coulomb_friction@link.hub").place == "motor.shaft"
    assert "motor.voltage" in find(PLANTS["srv02-flexible"], "dead_zone").same


# -- sizes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plant", "effect"),
    [
        ("srv02-flexible", "coulomb_friction"),
        ("geared-two-mass", "delay"),
        ("harmonic-arm", "joint_flexibility"),
        ("pendulum", "quadratic_drag"),
        ("srv02-flexible", "extra_mode"),
    ],
)
def test_at_size_one_the_effect_is_as_large_as_the_floor(plant: str, effect: str) -> None:
    case = draw(plant, [effect], [1.0], 6, QUIET)
    bare = replace(case.truth, nuisance=Nuisance())
    assert excess(case.bench, bare) == pytest.approx(1.0, abs=0.06)
    assert case.visible[0] == pytest.approx(1.0, abs=0.06)


def test_sizes_are_multiples_of_the_threshold() -> None:
    sizes = [
        draw("pendulum", ["stray_spring"], [m], 6, Options(seconds=1.0, nuisance=0.0)).sizes[0]
        for m in (1.0, 3.0, 10.0)
    ]
    assert sizes[1] / sizes[0] == pytest.approx(3)
    assert sizes[2] / sizes[0] == pytest.approx(10)


@pytest.mark.parametrize("plant", list(PLANTS))
@pytest.mark.parametrize("loop", ["open", pytest.param("closed", marks=pytest.mark.slow)])
def test_without_effect_a_refit_reaches_the_floor(plant: Any, loop: Any) -> None:
    """Gain error, ripple, warm-up, drift and coloured noise stay in the background: on average below 1.1 floors."""
    left = []
    for seed in range(2):
        case = draw(plant, [], [], seed, Options(loop=loop))
        recorded = [r.measured / case.bench.sigma for r in case.recordings]
        fitted = refit(case.bench, case.truth.bare(), recorded)
        left.append(case.bench.distance(case.bench.outputs(fitted), recorded))
    assert 0.97 < np.mean(left) < 1.1
    assert max(left) < 1.2


def test_closed_loop_logs_what_the_plant_got() -> None:
    """The plant driven open loop with the logged input gives the recorded output."""
    case = draw("srv02-flexible", ["coulomb_friction"], [10.0], 2, Options(loop="closed", nuisance=0))
    outputs = case.bench.outputs(case.truth, 2e-5)
    for recorded, clean in zip(case.recordings, outputs, strict=True):
        assert np.std(recorded.measured / case.bench.sigma - clean) < 1.1
        assert np.abs(recorded.command).max() > 0.5


def test_released_pendulum_starts_away_from_rest() -> None:
    case = draw("pendulum", [], [], 2, Options(kinds=("decay", "chirp", "prbs", "decay", "ramp", "coast"), nuisance=0))
    assert abs(case.recordings[0].measured[0, 0]) > 0.3
    assert np.all(case.recordings[0].command == 0)
    assert "free: [arm.shaft.angle]" in text(case)


def test_noise_has_its_declared_size_and_colour() -> None:
    noise = sensor_noise(np.random.default_rng(1), 200_000, 1e-3, 0.7, (0.2, 0.02))
    assert np.std(noise) == pytest.approx(0.7, rel=0.02)
    lag = 10
    correlation = np.mean(noise[lag:] * noise[:-lag]) / np.var(noise)
    assert correlation == pytest.approx(0.2 * np.exp(-lag * 1e-3 / 0.02), abs=0.015)


def test_stated_noise_can_be_wrong() -> None:
    case = draw("srv02-flexible", [], [], 1, Options(seconds=0.5, nuisance=0, sigma_error=1.3))
    assert "noise: 0.0065}" in text(case)
    assert f"noise: {1.3 / np.sqrt(12):.5g}}}" in text(case)


# -- ties -------------------------------------------------------------------------------------------------------------


def test_friction_and_offset_tie_when_driven_one_way_and_not_otherwise() -> None:
    tie = TIES[0]
    case = draw(tie.plant, tie.effects, tie.sizes, 1, tie.options)
    assert tie_class(case, [tie.rival])[0].tied
    both_ways = draw(tie.plant, tie.effects, tie.sizes, 1)
    assert not tie_class(both_ways, [tie.rival])[0].tied


def test_two_laws_of_one_joint_are_no_tie_that_can_be_confirmed() -> None:
    """The tool may cut a node twice and claim a hysteresis and a spring in it; here a joint has one law."""
    place = "gear.output -> link.hub"
    case = draw("srv02-flexible", ["joint_flexibility"], [10.0], 1, Options(seconds=0.5))
    assert not tie_class(case, [(f"hysteresis@{place}", f"joint_flexibility@{place}")])[0].tied


@pytest.mark.parametrize(
    ("plant", "truth", "place", "rivals"),
    [
        ("srv02-flexible", "joint_flexibility", "gear.output -> link.hub", ("hardening_spring", "backlash")),
        ("harmonic-arm", "coulomb_friction", "rotor.shaft", ("direction_dependent_friction", "stribeck_friction")),
        ("srv02-flexible", "gravity", "motor.shaft", ("torque_ripple",)),
        ("harmonic-arm", "torque_ripple", "rotor.shaft", ("cogging",)),
    ],
)
def test_a_law_that_contains_the_truth_ties(
    plant: str, truth: str, place: str, rivals: tuple[str, str] | tuple[str]
) -> None:
    case = draw(plant, [f"{truth}@{place}"], [10.0], 3, Options(seconds=1.0))
    for rival in tie_class(case, [(f"{name}@{place}",) for name in rivals]):
        assert rival.distance < 0.02 * FLOOR, rival.name


def test_a_parameter_that_may_leave_its_tolerance_is_an_explanation() -> None:
    case = draw("pendulum", [], [], 1, Options(wrong=(("weight.mass", 0.4),)))
    ends = tie_class(case, [("none",), ("wrong_parameter@rotor.inertia",), ("wrong_parameter@weight.mass",)])
    distances = {rival.name: rival.distance for rival in ends}
    assert distances["wrong_parameter@weight.mass"] < 0.02 * FLOOR
    assert min(distances["none"], distances["wrong_parameter@rotor.inertia"]) > FLOOR
    with pytest.raises(ValueError, match=r"no parameter 'weight\.inertia'; it has .*weight\.mass"):
        tie_class(case, [("wrong_parameter@weight.inertia",)])


def test_what_fits_with_all_parameters_held_fits_with_one_of_them_free() -> None:
    place = "gear.output -> link.hub"
    case = draw("srv02-flexible", [f"joint_flexibility@{place}"], [10.0], 3, Options(seconds=1.0))
    (rival,) = tie_class(case, [(f"joint_flexibility@{place}", "wrong_parameter@link.flexural_rigidity")])
    assert rival.distance < 0.02 * FLOOR
    assert rival.more == 1


def test_a_spring_on_either_side_of_a_gear_ties() -> None:
    """Behind a ratio of 116 the same spring is 13 400 times as stiff: the fit of the rival has to begin near it."""
    case = draw("rig-213257", ["hardening_spring@motor.shaft -> gear1.input"], [25.89], 213257)
    assert tie_class(case, [("hardening_spring@gear1.output -> hub.shaft",)])[0].distance < 0.02 * FLOOR


def test_a_spring_on_either_side_of_a_gear_ties_beside_another_in_its_node(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind a gear without losses and inertia the spring is the same; another one parts the node where it then is.

    That other one is the truth's, and stays where it is.
    """
    given = []

    def told(plant: Any, places: Any, others: Any) -> Any:
        given.append((places, others))
        return ways(plant, places, others)

    monkeypatch.setattr(ties, "ways", told)
    soft = "joint_flexibility@hub.shaft -> gear2.input"
    options = replace(made(52864)[1], nuisance=0.0, seconds=3.0)
    case = draw("rig-52864", [soft, "hardening_spring@motor.shaft -> gear1.input"], [10.0, 25.0], 52864, options)
    (rival,) = tie_class(case, [(soft, "hardening_spring@gear1.output -> hub.shaft")])
    assert rival.distance < 0.02 * FLOOR
    assert given == [(["gear1.output -> hub.shaft"], ["hub.shaft -> gear2.input"])]
    ratio = case.plant.ratio("motor.shaft") / case.plant.ratio("hub.shaft")
    spring, law = case.truth.concealed[1].parameters, rival.parameters[1]
    assert law["stiffness"] == pytest.approx(spring["stiffness"] * ratio**2, rel=0.05)
    assert law["cubic_stiffness"] == pytest.approx(spring["cubic_stiffness"] * ratio**4, rel=0.05)


def test_a_joint_is_cut_in_every_way_that_its_name_allows() -> None:
    """The tool names a cut by the drive's flange. That the guide stays on that side is not the first way tried."""
    plant, options = made(557229)
    plant = plant.also_cut({"carriage.flange -> table.flange": (0, frozenset({"table.flange", "stage.flange"}))})
    options = replace(options, nuisance=0.0, seconds=2.0)
    case = draw(plant, ["joint_flexibility@carriage.flange -> table.flange"], [20.0], 557229, options)
    ends = [f"joint_flexibility@drive.flange -> {name}" for name in ("table.flange", "stage.flange", "guide1.slide")]
    same, another, nothing = (tie_class(case, [(one,)])[0] for one in ends)
    assert same.distance < 0.02 * FLOOR
    assert 5 * FLOOR < another.distance < math.inf
    assert nothing.distance == math.inf  # there is no inertia at the guide


def test_the_background_is_small_on_recordings_of_its_own() -> None:
    """Of each disturbance a refit leaves 0.06 to 0.16 floors on usual recordings, no more on those driven one way."""
    tie = TIES[0]
    case = draw(tie.plant, tie.effects, tie.sizes, 1, tie.options)
    found, base = case.truth.nuisance, case.truth.bare()
    small = Small(case.bench, base)
    for part in (Nuisance(ripple=found.ripple), Nuisance(warm_up=found.warm_up), Nuisance(drift=found.drift)):
        assert 0 < small.size(case.bench.outputs(replace(base, nuisance=part))) < 1.1 * max(SHARES)


def test_the_smaller_of_two_backgrounds() -> None:
    one = Nuisance(ripple=((1e-3, 11.0, 0.5), (5e-4, 13.0, 0.1)), warm_up=(2e-4, 20.0), drift=3e-4, gain=0.02)
    other = Nuisance(ripple=((8e-4, 17.0, 0.2), (4e-4, 19.0, 0.3)), warm_up=(3e-4, 20.0), drift=1e-4, gain=-0.03)
    made = smaller(one, other)
    assert made == replace(one, ripple=other.ripple, drift=1e-4)
    assert smaller(other, one) == replace(other, warm_up=(2e-4, 20.0))


each_tie = pytest.mark.parametrize("tie", TIES, ids=lambda t: f"{t.plant}: {'+'.join(t.effects)} ~ {'+'.join(t.rival)}")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
@each_tie
def test_designed_ties_are_ties(tie: Any, seed: int) -> None:
    case = draw(tie.plant, tie.effects, tie.sizes, seed, tie.options)
    rival, none = sorted(tie_class(case, [tie.rival, ("none",)]), key=lambda r: not r.effects)
    assert rival.tied
    assert not none.tied


@pytest.mark.slow
@each_tie
def test_designed_ties_can_be_settled(tie: Any) -> None:
    """Recorded beside the others, some input that is no larger makes the rival differ by more than the floor."""
    case = draw(tie.plant, tie.effects, tie.sizes, 1, tie.options)
    known = menu(max(float(np.abs(r.command).max()) for r in case.recordings), case.bench.interval)
    assert any(after(case, tie.rival, *known[kind][1:]) > FLOOR for kind in ("reversal", "prbs_20ms", "ramp", "push"))


def after(case: Any, rival: Any, time: Any, drive: Any) -> Any:
    """Distance of a rival on an input that is held out, once it was fitted to the same input and the training ones."""
    train, interval = case.bench.training(), case.bench.interval
    command = np.interp(interval * np.arange(round(time[-1] / interval)), time, drive)
    quiet = np.zeros(len(command) + 1)
    bench = replace(
        train,
        commands=(*train.commands, command, command),
        held_out=(*train.held_out, False, True),
        slow=(*train.slow, quiet, quiet),
        start=(*train.start, 0.0, 0.0),
        released=(*train.released, 0.0, 0.0),
    )
    return tie_class(replace(case, bench=bench), [rival])[0].distance


def test_pairs_can_be_drawn() -> None:
    for plant, pairs in PAIRS.items():
        assert len(pairs) == 5
        for pair in pairs:
            for effect in pair:
                find(PLANTS[plant], effect)
    case = draw("geared-two-mass", PAIRS["geared-two-mass"][0], [3.0], 1, Options(seconds=1.0, nuisance=0.0))
    assert [c.effect for c in case.truth.concealed] == ["backlash", "coulomb_friction"]
    assert case.truth.concealed[1].place == "load.shaft"


# -- command line -----------------------------------------------------------------------------------------------------


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["make", "--plant", "pendulum", "--effect", "offset", "--size", "3", "--seed", "7", "--seconds", "1"]
    assert main([*given, "-o", str(tmp_path / "c1"), "--answers", str(tmp_path / "answers")]) == 0
    assert json.loads((tmp_path / "answers" / "c1.json").read_text())["seed"] == 7
    assert main(["list"]) == 0
    assert "gear.output -> link.hub" in capsys.readouterr().out
    given[4] = "love"
    assert main([*given, "-o", str(tmp_path / "c2"), "--answers", str(tmp_path / "answers")]) == 1
    assert "cannot hide 'love'" in capsys.readouterr().err
