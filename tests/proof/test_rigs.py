"""Random rigs and hard cases: drawn blind, stopped by processor time, and scored."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.concealed.named import plant as named_plant
from benchmarks.concealed.rigs.hidden import drawn
from benchmarks.concealed.sites import find
from benchmarks.proof import data, frozen, rigs
from benchmarks.proof import run as runner
from benchmarks.proof.__main__ import main
from benchmarks.proof.drives import DATA as DRIVES
from benchmarks.proof.score import Score, scores
from benchmarks.proof.suites import DRAWN, FURTHER, ON_RIGS, SUITES, Spec, drives, from_json
from tests.proof.test_blind import SPY

WITHHOLDING, PLAIN = 0, 5
"""Seeds of rigs: one conceals an effect that is withheld, one an effect that is not."""


def score(
    truth: Any = (), outcome: str = "named", sizes: Any = (), withheld: Any = (), wrong: Any = (), **more: Any
) -> Score:
    spec = Spec("rigs", "rig-1", tuple(truth), tuple(sizes), 1, withheld=tuple(withheld))
    told = asdict(spec)
    told["options"]["wrong"] = list(wrong)
    return Score("rigs-x", "rigs", "rig-1", told, tuple(truth), outcome=outcome, sizes=tuple(sizes), **more)


def goal(rows: Any, what: Any, goal: Any) -> Any:
    (found,) = [g for g in rigs.rig_goals(rows) if g.suite.startswith(what) and g.goal.startswith(goal)]
    return found


def test_why_a_goal_was_not_met_stands_below_the_goals() -> None:
    causes = {"goal withheld: confident wrong name*": "a twin was told", "goal nothing*": "of a goal that is met"}
    rows = [score(["lag@u"], "wrong", [9.0], ["lag"], claimed=True), score(outcome="none")]
    told = rigs._table(rows, causes)
    assert told.count("* *") == 1
    assert "* *withheld, confident wrong name <= 5 %*: a twin was told\n" in told
    assert "falls short" not in rigs._table(rows[1:], causes)


# -- running ----------------------------------------------------------------------------------------------------------


def test_a_drawn_case_says_what_it_conceals_to_the_scorer_alone(tmp_path: Any, monkeypatch: Any) -> None:
    script, note = tmp_path / "spy.py", tmp_path / "note.json"
    script.write_text(SPY)
    monkeypatch.setattr(runner, "TOOL", (sys.executable, str(script)))
    monkeypatch.setenv("SPY", str(note))
    for seed in (PLAIN, WITHHOLDING):
        (spec,) = SUITES["rigs"]([seed])
        assert spec.effects == (DRAWN,)
        asked, case = drawn(seed)
        runner.run([spec], tmp_path / str(seed), 1, lambda line: None, longest=100)
        seen = json.loads(note.read_text())
        told = seen["argv"][seen["argv"].index("--without") + 1 :] if "--without" in seen["argv"] else []
        assert told == list(asked.withheld)
        assert seen["files"] == [*sorted(f"{r.name}.csv" for r in case.recordings), "scenario.yaml"]
        assert f"rig-{seed}" in seen["text"]  # a name that says nothing
        (row,) = scores(tmp_path / str(seed))
        assert row.truth == asked.effects
        assert from_json(row.spec) == Spec("rigs", f"rig-{seed}", *astuple(asked))
        assert row.outcome == "missed"


def astuple(asked: Any) -> Any:
    return asked.effects, asked.sizes, asked.seed, asked.options, asked.withheld


def test_what_spends_too_much_is_stopped_however_long_it_waits(tmp_path: Any, monkeypatch: Any) -> None:
    busy = tmp_path / "busy.py"
    busy.write_text("while True: pass\n")
    monkeypatch.setattr(runner, "TOOL", (sys.executable, str(busy)))
    monkeypatch.setattr(runner, "LONGEST", 0.001)  # of no account where processor time counts
    (tmp_path / "case").mkdir()
    numbers = runner.diagnose(Spec("rigs", "rig-1", (), (), 1), tmp_path / "case", tmp_path, longest=1)
    assert numbers["failure"] == "stopped after 1 s of processor time"
    assert 0.5 < numbers["cpu"] < 8  # the limit is kept by the kernel's ticks, which are not those of the usage


def test_suites_in_the_order_of_their_seeds() -> None:
    assert [s.plant for s in SUITES["rigs"]([3, 1])] == ["rig-3", "rig-1"]
    names = [s.plant for s in SUITES["hard"]([1])]
    assert len(names) == len(set(names)) == 10


# -- scoring ----------------------------------------------------------------------------------------------------------


def test_effects_of_drives_on_random_rigs_that_have_a_place_for_them() -> None:
    drawn_for: dict[str, list[str]] = {}
    for spec in drives([1]):
        if spec.plant.startswith("rig-"):
            drawn_for.setdefault(spec.effects[0], []).append(spec.plant)
    assert {effect: len(set(plants)) for effect, plants in drawn_for.items()} == dict.fromkeys(ON_RIGS, 4) | FURTHER
    for effect, plants in drawn_for.items():
        for name in plants:
            assert find(named_plant(name), effect).effect.name == effect
    # A case is called by all that it is drawn from: those that are on record are still drawn as they were.
    assert {row.name for row in data.load(DRIVES).rows} <= {spec.name for spec in drives([1])}


def test_only_effects_of_three_thresholds_must_be_named() -> None:
    rows = [
        score(["offset@a"], sizes=[3.2], placed=True, claims=(True,)),
        score(["offset@a"], "wrong", sizes=[2.9], placed=False, claims=(False,)),
        score(["offset@a"], "unknown", sizes=[10.0], placed=True, recognised=True),
        score(["offset@a"], "failed", sizes=[10.0], placed=False),
    ]
    assert goal(rows, "one effect", "right name").measured.startswith("1 of 3")
    assert goal(rows, "one effect", "right place").measured.startswith("2 of 3")
    assert goal(rows, "findings", "right").measured.startswith("1 of 2")
    found = goal(rows, "one to three", "`unknown`")
    assert found.measured.startswith("2 of 4")  # what failed counts against it
    assert found.met is False


def test_pairs_triples_nothing_withheld_and_wrong_parameters() -> None:
    rows = [
        score(["offset@a", "lag@a"], "half", sizes=[3, 3], found=1),
        score(["offset@a", "lag@a"], sizes=[3, 3], found=2),
        score(["offset@a", "lag@a", "delay@a"], "half", sizes=[3, 3, 3], found=2),
        score((), "none"),
        score((), "false alarm", claimed=True),
        score(["offset@a"], "unknown", sizes=[9], withheld=["offset"]),
        score(["wrong_parameter@a.b"], sizes=[], wrong=[("a.b", 2.0)]),
    ]
    assert goal(rows, "two effects", "both").measured.startswith("1 of 2")
    assert goal(rows, "two effects", "at least one").met is True
    assert goal(rows, "three effects", "at least two").met is True
    assert goal(rows, "nothing", "false").measured.startswith("1 of 2")
    assert goal(rows, "withheld", "confident").measured.startswith("0 of 1")
    assert goal(rows, "one parameter", "found").measured.startswith("1 of 1")
    assert goal(rows, "one effect", "right name").measured == "not run"


def test_a_rig_that_cannot_be_drawn_is_told_and_counts_for_nothing(tmp_path: Path) -> None:
    """Its seed asked for effects of which none can be seen: the tool was never run, and nothing was concealed."""
    failure = f"{runner.UNDRAWN}: of 12 drawings of 3 effects none can be seen"
    rows = [
        score((), "none", code="a"),
        score([DRAWN], "failed", failure=failure),
        score((), "failed", failure="crash"),
    ]
    rigs.write(data.Proof({"machine": "two cores"}, rows, {}), tmp_path / "page.md", {}, {})
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "2 of the 3 rigs that were asked for have run" in page
    assert "1 cannot be drawn, since no effect of those that were drawn can be seen: `rig-1`." in page
    assert "| nothing concealed | false alarms <= 3 % | 1 of 2," in page
    assert "1 of 2 rigs." in page


def test_each_parameter_has_its_own_intervals() -> None:
    right = (*[("lag.x", True)] * 9, ("lag.x", False), ("delay.y", False))
    found = goal([score(["lag@a"], sizes=[5], covered=right)], "95 %", "each parameter")
    assert found.measured.startswith("1 of 2 parameters, and 1 outside by their bounds; all intervals: 9 of 11")
    assert found.met is False
    wrong = goal([score(["lag@a"], sizes=[5], covered=[("delay.y", False)] * 5)], "95 %", "each parameter")
    assert wrong.measured.startswith("0 of 1 parameters, and 1 outside by their bounds")


@pytest.mark.parametrize("since", [[], ["diagnosis/search/posterior.py"]])
def test_a_page_of_rules_that_have_changed_says_so(tmp_path: Path, since: list[str]) -> None:
    about = {"machine": "two cores", "frozen": {"changed_since": since}}
    rigs.write(data.Proof(about, [score((), "none", code="a")], {}), tmp_path / "page.md", {}, {})
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    told = "The rules have changed since; what they would tell now was not measured: `diagnosis/"
    assert (told in page) == bool(since)


def test_seeds_of_a_frozen_commit_are_named_by_it() -> None:
    drawn = frozen.seeds("0a1b2c3d4e5f6071", "rigs", 3)
    rows = [replace(score(), spec=score().spec | {"seed": seed}, frozen="0a1b2c3d4e5f6071") for seed in drawn]
    told = "seeds: the 3 that follow from the frozen commit `0a1b2c3d4e5f`, `run rigs --frozen --count 3`"
    assert rigs._which(rows, sorted(drawn), sorted(drawn)) == told
    chosen = [replace(row, spec=row.spec | {"seed": seed}) for row, seed in zip(rows, (2001, 2002, 2005), strict=True)]
    assert rigs._which(chosen, [2001, 2002, 2005], [2001, 2002]) == "seeds: 2001 to 2005; run: 2001 to 2002"


def test_a_page_of_a_generator_that_has_changed_says_that_seeds_may_draw_other_rigs(tmp_path: Path) -> None:
    """What scores has changed too: the page is written anew by it, and draws nothing."""
    judges = ["benchmarks/concealed/refit.py", "benchmarks/proof/score.py"]
    about = {"machine": "two cores", "frozen": {"judges_changed_since": judges}}
    rigs.write(data.Proof(about, [score((), "none", code="a")], {}), tmp_path / "page.md", {}, {})
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "truth generator has changed since, and a seed may draw another rig now: `benchmarks/concealed/ref" in page
    assert "score.py" not in page


def test_processor_time_is_judged_by_its_middle_and_its_end() -> None:
    rows = [replace(score((), "none"), cpu=float(s)) for s in [4] * 19 + [80]]
    assert goal(rows, "processor time", "median").met is True
    assert goal(rows, "processor time", "95 %").measured.startswith("4 s")
    assert goal([*rows, rows[-1]], "processor time", "95 %").met is False


@pytest.mark.parametrize(
    ("trials", "recognised"),
    [
        ([(["offset at source.out -> motor.voltage"], 2.0), (["lag at a"], 9.0)], True),
        ([(["offset at source.out -> motor.voltage"], 9.0), (["lag at a"], 2.0)], False),
        ([(["offset at somewhere"], 2.0)], False),
        ([], False),
    ],
)
def test_unknown_although_the_right_was_found(trials: Any, recognised: Any) -> None:
    from benchmarks.proof.score import _recognised

    found = {"trials": [{"effects": names, "hold_out_chi2": chi} for names, chi in trials]}
    assert _recognised(found, [("offset", {"source.out -> motor.voltage", "motor.voltage"})]) is recognised


def test_the_page_tells_what_has_run_and_what_has_not(tmp_path: Any, monkeypatch: Any) -> None:
    script = tmp_path / "spy.py"
    script.write_text(SPY)
    monkeypatch.setattr(runner, "TOOL", (sys.executable, str(script)))
    monkeypatch.setenv("SPY", str(tmp_path / "note.json"))
    specs = [*SUITES["rigs"]([PLAIN, 6]), next(SUITES["hard"]([1]))]
    runner.run(specs[:1], tmp_path / "proof", 1, lambda line: None)
    known = runner.plan(tmp_path / "proof") | {s.name: asdict(s) for s in specs}
    (tmp_path / "proof" / runner.PLAN).write_text(json.dumps(known))
    given = [
        "rigs",
        "-o",
        str(tmp_path / "proof"),
        "--page",
        str(tmp_path / "p.md"),
        "--data",
        str(tmp_path / "d.json"),
    ]
    assert main(given) == 0
    page = (tmp_path / "p.md").read_text()
    assert "1 of the 2 rigs that were asked for have run" in page
    assert "1 of 1 rigs." in page
    assert "Coulomb friction begun on a ridge" in page
    assert "not run yet" in page
    assert len(data.load(tmp_path / "d.json").rows) == 3
