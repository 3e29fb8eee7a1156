"""The scorer on verdicts whose merit is plain."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.concealed.ties import Rival
from benchmarks.proof import score
from benchmarks.proof.score import scores, wilson
from benchmarks.proof.summary import confusion, goals, label
from tests.proof.made import INPUT, finding, put

LAG = f"lag at {INPUT}"
LAG_KEY = f"lag@{INPUT}"
ZONE = finding("dead_zone", INPUT)
FRICTION = finding("coulomb_friction", "motor.shaft")


def only(folder: Any) -> Any:
    (row,) = scores(folder)
    return row


# [Newcombe 1998, Table I, method 3]
@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_bounds_are_those_of_the_published_table(hits: int, total: int, low: float, high: float) -> None:
    assert wilson(hits, total) == pytest.approx((low, high), abs=5e-5)
    assert wilson(total - hits, total) == pytest.approx((1 - high, 1 - low), abs=5e-5)


@pytest.mark.parametrize(
    ("effects", "findings", "outcome", "placed", "claimed", "found"),
    [
        (["dead_zone"], [ZONE], "named", True, False, 1),
        (["dead_zone"], [finding("lag", INPUT)], "wrong", True, True, 0),
        (["dead_zone"], [finding("dead_zone", "load.shaft")], "wrong", False, True, 0),
        (["dead_zone"], [ZONE, FRICTION], "half", True, True, 1),
        (["dead_zone"], [], "missed", False, False, 0),
        (["dead_zone"], [finding("unknown", INPUT, "unknown")], "unknown", True, False, 0),
        (["coulomb_friction"], [finding("coulomb_friction", "gear.output")], "named", True, False, 1),
        (["dead_zone", "coulomb_friction"], [ZONE, FRICTION], "named", True, False, 2),
        (["dead_zone", "coulomb_friction"], [ZONE], "half", False, False, 1),
        ([], [], "none", None, False, 0),
        ([], [ZONE], "false alarm", None, True, 0),
        ([], [finding("unknown", INPUT, "unknown")], "false alarm", None, False, 0),
    ],
)
def test_outcomes(
    tmp_path: Path,
    effects: list[Any] | list[str],
    findings: list[Any],
    outcome: str,
    placed: bool | None,
    claimed: bool,
    found: int,
) -> None:
    put(tmp_path, effects, findings, ties={f"dead_zone@{INPUT}": 2.5})
    row = only(tmp_path)
    assert (row.outcome, row.placed, row.claimed, row.found) == (outcome, placed, claimed, found)
    assert row.right == (outcome in ("named", "none"))


@pytest.mark.parametrize(
    ("findings", "distance", "outcome"),
    [
        ([finding("dead_zone", INPUT, "tie", [LAG])], 0.4, "tie"),
        ([finding("dead_zone", INPUT, "tie", [LAG])], 2.5, "loose tie"),
        ([finding("dead_zone", INPUT, "tie", ["nothing"])], 0.4, "loose tie"),
        ([finding("lag", INPUT, "tie", [f"dead_zone at {INPUT}"])], 0.4, "tie"),
        ([finding("lag", INPUT, "tie", [f"offset at {INPUT}"])], 0.4, "wrong tie"),
    ],
)
def test_a_tie_is_right_only_if_the_truth_generator_has_it_too(
    tmp_path: Path, findings: list[Any], distance: float, outcome: str
) -> None:
    put(tmp_path, findings=findings, ties={LAG_KEY: distance, f"offset@{INPUT}": distance})
    row = only(tmp_path)
    assert row.outcome == outcome
    assert row.right == (outcome == "tie")
    assert not row.claimed


@pytest.mark.parametrize(("place", "outcome"), [("motor.shaft", "loose tie"), ("gear.output", "tie")])
def test_friction_that_grows_with_another_load_is_not_computed_with_that_of_the_drive(
    tmp_path: Path, place: str, outcome: str
) -> None:
    """A gear's output moves with the motor, and bears another torque: the generator has no such friction there."""
    loaded = f"load_dependent_friction at {place}"
    tie = finding("coulomb_friction", "motor.shaft", "tie", [loaded])
    put(tmp_path, ["coulomb_friction"], [tie], ties={"load_dependent_friction@motor.shaft": 2.5})
    assert only(tmp_path).outcome == outcome


@pytest.mark.parametrize(("distance", "found"), [(0.4, 1), (2.5, 0)])
def test_what_is_in_a_true_tie_is_found_though_another_effect_is_missing(
    tmp_path: Path, distance: float, found: int
) -> None:
    tie = finding("dead_zone", INPUT, "tie", [LAG])
    put(tmp_path, ["dead_zone", "coulomb_friction"], [tie], ties={LAG_KEY: distance})
    row = only(tmp_path)
    assert (row.outcome, row.right, row.found) == ("wrong tie", False, found)


RIGS: dict[str, dict[str, Any]] = {
    "rig-644334": {
        "backlash": ("table.flange -> stage.flange", ["mount1.b", "table.flange", "stage.flange"], {}),
        "delay": ("source.out -> drive.force", ["source.out", "drive.force"], {}),
    },
    "rig-52864": {
        "joint_flexibility": ("hub.shaft -> gear2.input", ["gear1.output", "hub.shaft", "gear2.input"], {}),
        "hardening_spring": ("motor.shaft -> gear1.input", ["motor.shaft", "gear1.input"], {}),
    },
}
STAGE, SOFT = "backlash at mount1.b -> stage.flange", "joint_flexibility at gear1.output -> gear2.input"


@pytest.mark.parametrize(
    ("plant", "told", "rival"),
    [
        ("rig-644334", STAGE, []),
        (
            "rig-644334",
            f"{STAGE} + lag at source.out -> drive.force",
            ["backlash@table.flange -> stage.flange", "lag@source.out -> drive.force"],
        ),
        (
            "rig-52864",
            f"{SOFT} + hardening_spring at gear1.output -> hub.shaft",
            ["hardening_spring@gear1.output -> hub.shaft", "joint_flexibility@hub.shaft -> gear2.input"],
        ),
        (
            "rig-52864",
            f"joint_flexibility at gear1.output -> hub.shaft + {SOFT}",
            ["joint_flexibility@gear1.output -> hub.shaft", "joint_flexibility@hub.shaft -> gear2.input"],
        ),
    ],
    ids=["the truth alone", "the truth at another flange", "two cuts of one node", "one law twice"],
)
def test_what_meets_the_truth_is_at_its_place_and_other_joints_are_what_they_are_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plant: str, told: str, rival: list[str]
) -> None:
    """The truth itself is asked of the truth generator at its true place, and not at all if nothing else is told."""
    (first, (place, _, _)), (other, (there, _, _)) = RIGS[plant].items()
    asked: list[tuple[str, ...]] = []

    def computed(case: Any, rivals: Any) -> Any:
        asked.extend(rivals)
        return [Rival(tuple((e, p) for e, _, p in (part.partition("@") for part in r)), 0.4, ()) for r in rivals]

    monkeypatch.setattr(score, "from_answers", lambda answer: None)
    monkeypatch.setattr(score, "tie_class", computed)
    findings = [finding(first, place), finding(other, there, "tie", [told])]
    put(tmp_path, list(RIGS[plant]), findings, plant=plant, truth=RIGS[plant])
    assert only(tmp_path).outcome == "tie"
    assert asked == ([tuple(rival)] if rival else [])


@pytest.mark.parametrize(
    ("findings", "distance", "outcome", "found"),
    [
        ([ZONE], 0.004, "equal", 2),
        ([ZONE], 0.4, "half", 1),
        ([ZONE, finding("lag", INPUT)], 0.004, "half", 1),
    ],
)
def test_a_part_that_does_the_same_as_the_whole_is_right(
    tmp_path: Path, findings: list[Any], distance: float, outcome: str, found: int
) -> None:
    put(tmp_path, ["dead_zone", "coulomb_friction"], findings, ties={f"dead_zone@{INPUT}": distance})
    row = only(tmp_path)
    assert (row.outcome, row.found, row.right) == (outcome, found, outcome == "equal")


def test_a_wrong_parameter_is_named_by_its_name(tmp_path: Path) -> None:
    wrong = (("load.inertia", 1.8),)
    put(
        tmp_path, [], [finding("wrong_parameter", "load.inertia", "wrong_parameter", inertia=(0.01, 0.03))], wrong=wrong
    )
    row = only(tmp_path)
    assert (row.outcome, row.truth) == ("named", ("wrong_parameter@load.inertia",))
    assert row.covered == (("wrong_parameter.inertia", True),)
    put(tmp_path, [], [finding("wrong_parameter", "gear.inertia", "wrong_parameter")], seed=2, wrong=wrong)
    assert sorted(r.outcome for r in scores(tmp_path)) == ["named", "wrong"]


def test_failures_and_cases_never_run_are_kept(tmp_path: Path) -> None:
    put(tmp_path, failure="stopped after 1800 s")
    put(tmp_path, failure="cannot be drawn: no such place", answered=False, seed=2)
    put(tmp_path, findings=[ZONE], seed=3)
    spec = json.loads((tmp_path / "results" / scores(tmp_path)[0].name / "run.json").read_text())["spec"]
    (tmp_path / "plan.json").write_text(json.dumps({"core-0000000000": {**spec, "seed": 99}}))
    rows = scores(tmp_path)
    assert sorted(r.outcome for r in rows) == ["failed", "failed", "named", "not run"]
    right = next(g for g in goals(rows) if g.goal.startswith("right name"))
    assert right.measured.startswith("1 of 4,")
    assert right.met is False
    assert sum(confusion(rows)["dead_zone"].values()) == 4


def test_a_failure_counts_as_a_false_alarm(tmp_path: Path) -> None:
    put(tmp_path, [], failure="exit code 1", suite="none")
    alarms = next(g for g in goals(scores(tmp_path)) if g.goal.startswith("false alarms"))
    assert alarms.measured.startswith("1 of 1,")


def test_intervals_compare_the_same_quantity(tmp_path: Path) -> None:
    # Seen at the gear's output, 14 times slower, the friction is 14 times as large.
    put(tmp_path, ["coulomb_friction"], [finding("coulomb_friction", "motor.shaft", coulomb_friction=(1e-4, 3e-4))])
    behind = finding("coulomb_friction", "gear.output", coulomb_friction=(2.7e-3, 2.9e-3))
    put(tmp_path, ["coulomb_friction"], [behind], seed=2)
    missed = finding("coulomb_friction", "gear.output", coulomb_friction=(1e-4, 3e-4))
    put(tmp_path, ["coulomb_friction"], [missed], seed=3)
    hits = {r.spec["seed"]: r.covered for r in scores(tmp_path)}
    assert hits == {k: (("coulomb_friction.coulomb_friction", hit),) for k, hit in ((1, True), (2, True), (3, False))}


def test_the_frequency_of_a_vibration_is_compared_in_radians(tmp_path: Path) -> None:
    for seed, ends in ((1, (15.6, 15.8)), (2, (2.4, 2.6))):
        found = finding("outside_vibration", "motor.shaft", frequency=ends)
        put(tmp_path, ["outside_vibration"], [found], seed=seed)
    hits = {r.spec["seed"]: r.covered for r in scores(tmp_path)}
    assert hits == {k: (("outside_vibration.frequency", hit),) for k, hit in ((1, True), (2, False))}


def test_errors_are_over_the_true_floor(tmp_path: Path) -> None:
    put(tmp_path, findings=[ZONE], errors=(50.0, 8.0, 4.0), sigma_error=0.5)
    assert only(tmp_path).errors == pytest.approx((12.5, 2.0, 1.0))


def test_labels(tmp_path: Path) -> None:
    put(tmp_path, findings=[ZONE])
    put(tmp_path, findings=[finding("dead_zone", INPUT, "tie", [LAG])], ties={LAG_KEY: 0.1}, seed=2)
    put(tmp_path, findings=[finding("lag", INPUT)], seed=3)
    put(tmp_path, findings=[ZONE, FRICTION], seed=4)
    put(tmp_path, seed=5)
    assert {r.spec["seed"]: label(r) for r in scores(tmp_path)} == {
        1: "dead_zone",
        2: "tie",
        3: "lag",
        4: "several",
        5: "none",
    }


def test_an_experiment_settles_a_tie_if_the_name_follows(tmp_path: Path) -> None:
    tie = finding("dead_zone", INPUT, "tie", [LAG])
    for seed, again in ((1, ZONE), (2, tie), (3, None)):
        name = put(tmp_path, findings=[tie], ties={LAG_KEY: 0.1}, seed=seed, suite="ties")
        if again:
            settled = tmp_path / "settled" / name
            settled.mkdir(parents=True)
            (settled / "run.json").write_text("{}")
            (settled / "diagnosis.json").write_text(json.dumps({"findings": [again]}))
    assert {r.spec["seed"]: r.settled for r in scores(tmp_path)} == {1: True, 2: False, 3: None}
