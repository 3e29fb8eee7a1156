"""Random rigs and hard cases: what they must show, and their page."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from benchmarks.proof import frozen
from benchmarks.proof.data import Proof
from benchmarks.proof.figures import binned, reliability
from benchmarks.proof.page import cause, shortfalls, table
from benchmarks.proof.score import Score, wilson
from benchmarks.proof.summary import Goal, of, rate
from engine.files import writing

DATA = frozen.ROOT / "benchmarks" / "results" / "random-rigs.json"
FIGURE = "random-rigs-reliability.svg"
PAGE = frozen.ROOT / "docs" / "random-rigs.md"

LARGE = 3.0
"""Detection thresholds from which an effect must be named."""

COVER = (0.85, 0.99)
"""Share of its 95 % intervals that must hold the true value, for every parameter."""

MEDIAN, SLOW = 5.0, 30.0
"""Processor time (s) of a diagnosis: median, and what 95 % keep to."""

HEAD = """# Random rigs

The four plants of [the proof](proof.md) are known to whoever writes the rules. Here the rig itself is drawn
(`benchmarks/concealed/rigs`): one to four bodies that turn or slide, gears, belts, springs, a flexible link, motor,
sensors and where the scenario reads them, rates, lengths, controller, preloaded starts, jitter; then what is concealed:
nothing, one to three effects of 1 to 30 detection thresholds, a wrong parameter, or an effect that the tool may not
try.
Truth comes from the same simulator, which shares nothing with flexarm. Each rig and all about it follows from its seed:

    .venv/bin/python -m benchmarks.proof run rigs --seeds 0 1 2 --longest 300 -o DIR
    .venv/bin/python -m benchmarks.proof rigs -o DIR

Cases stand in `benchmarks/results/random-rigs.json`, one line each. A diagnosis is told to say what it
has found after 200 s (`flexarm diagnose --longest`, which counts operations); one that was stopped after 300 s of
processor time is a failure. The tool's answers are those of the state named below; whether a tie is one is computed by
the truth generator of the state that this page was written at.

"""

HARD = """## Hard cases

Cases at which the rules failed on other rigs, each drawn by `benchmarks/concealed/rigs/hard.py`:

"""


def rig_goals(rows: Sequence[Score]) -> list[Goal]:
    """What random rigs must show, and what they show. A case that failed counts against it."""
    plain = [r for r in rows if r.truth and not r.spec["withheld"] and not r.spec["options"].get("wrong")]
    one = [r for r in plain if len(r.truth) == 1 and min(r.sizes, default=0.0) >= LARGE]
    two, three = ([r for r in plain if len(r.truth) == n] for n in (2, 3))
    nothing = [r for r in rows if not r.truth]
    withheld = [r for r in rows if r.spec["withheld"]]
    wrong = [r for r in rows if r.spec["options"].get("wrong")]
    claims = [right for r in rows if not r.spec["withheld"] for right in r.claims]
    return [
        _least(f"one effect, {LARGE:g} thresholds or more", "right name, or a confirmed tie", one, _right, 0.90),
        _least(f"one effect, {LARGE:g} thresholds or more", "right place", one, lambda r: bool(r.placed), 0.95),
        _claims(claims),
        _most("nothing concealed", "false alarms", nothing, lambda r: not r.right, 0.03),
        _least("two effects", "both right", two, _right, 0.75),
        _least("two effects", "at least one right", two, lambda r: r.found > 0, 0.95),
        _least("three effects", "at least two right", three, lambda r: r.found > 1, 0.60),
        _most("withheld", "confident wrong name", withheld, lambda r: r.claimed, 0.05),
        _most("one to three effects", "`unknown` although the right was found", plain, lambda r: r.recognised, 0.03),
        _least("one parameter wrong", "found as such", wrong, _right, None),
        _intervals(rows),
        _converged(rows),
        *_times(rows),
    ]


def _right(row: Score) -> bool:
    return row.right


def _least(what: str, goal: str, rows: Sequence[Score], hit: Callable[[Score], bool], least: float | None) -> Goal:
    hits = sum(row.outcome != "failed" and hit(row) for row in rows)
    told = goal if least is None else f"{goal} >= {100 * least:.0f} %"
    met = None if least is None or not rows else hits >= least * len(rows)
    return Goal(what, told, rate(hits, len(rows)), met)


def _most(what: str, goal: str, rows: Sequence[Score], hit: Callable[[Score], bool], most: float) -> Goal:
    hits = sum(row.outcome == "failed" or hit(row) for row in rows)
    return Goal(
        what, f"{goal} <= {100 * most:.0f} %", rate(hits, len(rows)), hits <= most * len(rows) if rows else None
    )


def _claims(claims: Sequence[bool]) -> Goal:
    """A finding that claims a name; no probability stands in it, so that each counts as one that is sure."""
    right = sum(claims)
    met = right >= 0.95 * len(claims) if claims else None
    return Goal("findings that claim a name", "right >= 95 %", rate(right, len(claims)), met)


def _converged(rows: Sequence[Score]) -> Goal:
    pairs = [r.converged for r in rows if r.converged]
    hits, total = sum(n for n, _ in pairs), sum(n for _, n in pairs)
    met = hits >= 0.99 * total if total else None
    return Goal("fits of models that take part in the choice", "converged >= 99 %", rate(hits, total), met)


def _intervals(rows: Sequence[Score]) -> Goal:
    counts = covered(rows)
    off = [name for name, hits in counts.items() if not COVER[0] <= sum(hits) / len(hits) <= COVER[1]]
    every = [hit for hits in counts.values() for hit in hits]
    bounds = {name: wilson(sum(counts[name]), len(counts[name])) for name in off}
    beyond = [name for name, (low, high) in bounds.items() if high < COVER[0] or low > COVER[1]]
    told = f"{len(counts) - len(off)} of {len(counts)} parameters, and {len(beyond)} outside by their bounds; "
    told += f"all intervals: {rate(sum(every), len(every))}"
    goal = f"each parameter's cover {100 * COVER[0]:.0f} to {100 * COVER[1]:.0f} %"
    return Goal("95 % intervals", goal, told if counts else "not run", not off if counts else None)


def covered(rows: Sequence[Score]) -> dict[str, list[bool]]:
    """Parameter -> for each of its intervals whether it holds the true value."""
    counts: dict[str, list[bool]] = {}
    for row in rows:
        for name, hit in row.covered:
            counts.setdefault(name, []).append(hit)
    return dict(sorted(counts.items()))


def _times(rows: Sequence[Score]) -> list[Goal]:
    spent = sorted(r.cpu for r in rows if r.cpu)
    if not spent:
        return [Goal("processor time", f"median <= {MEDIAN:g} s, 95 % <= {SLOW:g} s", "not run", None)]
    middle, slow = statistics.median(spent), spent[min(len(spent) - 1, math.ceil(0.95 * len(spent)) - 1)]
    told = f"{len(spent)} diagnoses, of which {sum(r.early for r in rows)} ended early"
    return [
        Goal("processor time", f"median <= {MEDIAN:g} s", f"{middle:.0f} s, {told}", middle <= MEDIAN),
        Goal("processor time", f"95 % <= {SLOW:g} s", f"{slow:.0f} s, {told}", slow <= SLOW),
    ]


def write(proof: Proof, page: Path, causes: Mapping[str, str], hard: Mapping[str, str]) -> None:
    """Write the page.

    Args:
        proof: random rigs and hard cases.
        page: file.
        causes: known causes of failures, by a case's name or a pattern.
        hard: name of each hard case and what it is.

    Raises:
        FlexarmError: the file cannot be written.
    """
    every = of(proof.rows, "rigs")
    rows = [r for r in every if r.outcome != "not run" and r.drawn]
    parts = [HEAD + _ran(proof, every, rows), _table(rows, causes), _outcomes(rows), _coverage(rows)]
    reliability(rows, page.with_name(FIGURE))
    parts += [_reliability(rows), _failures(rows, causes)]
    parts.append(_hard(of(proof.rows, "hard"), hard, causes))
    with writing(page, (".md",)) as temporary:
        temporary.write_text("\n".join(parts), encoding="utf-8")


def _ran(proof: Proof, every: Sequence[Score], rows: Sequence[Score]) -> str:
    seeds = sorted(r.spec["seed"] for r in rows)
    asked = sorted(r.spec["seed"] for r in every)
    none = [f"`{r.plant}`" for r in every if not r.drawn]
    states = ", ".join(f"`{s}` ({n} cases)" for s, n in Counter(r.code for r in rows if r.code).most_common())
    told = f"{len(rows)} of the {len(every)} rigs that were asked for have run ({_which(every, asked, seeds)}). "
    if none:
        told += (
            f"{len(none)} cannot be drawn, since no effect of those that were drawn can be seen: {', '.join(none)}. "
        )
    told += (
        f"{proof.about['machine']}, shared with other work. State of the program (hash over its sources): {states}.\n"
    )
    if since := proof.about.get("frozen", {}).get("changed_since"):
        listing = ", ".join(f"`{name}`" for name in since)
        told += f"\nThe rules have changed since; what they would tell now was not measured: {listing}.\n"
    judges = proof.about.get("frozen", {}).get("judges_changed_since", [])
    if generator := [name for name in judges if name.startswith("benchmarks/concealed/")]:
        listing = ", ".join(f"`{name}`" for name in generator)
        told += f"\nThe truth generator has changed since, and a seed may draw another rig now: {listing}.\n"
    return told


def _which(every: Sequence[Score], asked: Sequence[int], ran: Sequence[int]) -> str:
    """The seeds: those that follow from the frozen commit are named by it, since nobody chose them."""
    if not asked:
        return "none"
    commits = {r.frozen for r in every}
    if len(commits) == 1 and (commit := commits.pop()) and sorted(frozen.seeds(commit, "rigs", len(asked))) == asked:
        drawn = f"run rigs --frozen --count {len(asked)}"
        return f"seeds: the {len(asked)} that follow from the frozen commit `{commit[:12]}`, `{drawn}`"
    chosen = "development seeds, chosen" if asked[-1] < 1000 else "seeds"
    return f"{chosen}: {asked[0]} to {asked[-1]}; run: {_spans(ran)}"


def _spans(numbers: Sequence[int]) -> str:
    parts: list[list[int]] = []
    for k in numbers:
        if parts and k == parts[-1][1] + 1:
            parts[-1][1] = k
        else:
            parts.append([k, k])
    return ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in parts)


def _table(rows: Sequence[Score], causes: Mapping[str, str]) -> str:
    met, found = {True: "met", False: "**not met**", None: "-"}, rig_goals(rows)
    listed = [[g.suite, g.goal, g.measured, met[g.met]] for g in found]
    text = "## What must be shown\n\nRates with 95 % bounds (Wilson).\n\n" + table(["", "goal", "measured", ""], listed)
    return text + shortfalls(found, causes)


def _outcomes(rows: Sequence[Score]) -> str:
    groups: dict[str, list[Score]] = {}
    for row in rows:
        groups.setdefault(_group(row), []).append(row)
    listed = [
        [name, str(len(found)), rate(sum(r.right for r in found), len(found)), _counts(found)]
        for name, found in sorted(groups.items())
    ]
    return "## Outcomes\n\n" + table(["concealed", "rigs", "right", "outcomes"], listed)


def _group(row: Score) -> str:
    if row.spec["withheld"]:
        return "one effect, withheld"
    if row.spec["options"].get("wrong"):
        return "a wrong parameter"
    if len(row.truth) == 1:
        small = min(row.sizes, default=0.0) < LARGE
        return f"one effect, {'below' if small else 'from'} {LARGE:g} thresholds"
    return ("nothing", "", "two effects", "three effects")[len(row.truth)]


def _counts(rows: Sequence[Score]) -> str:
    return ", ".join(f"{name} {n}" for name, n in Counter(r.outcome for r in rows).most_common())


def _coverage(rows: Sequence[Score]) -> str:
    listed = [[name, rate(sum(hits), len(hits))] for name, hits in covered(rows).items()]
    return "## Intervals\n\n" + (table(["parameter", "inside"], listed) if listed else "None to compare.\n")


def _reliability(rows: Sequence[Score]) -> str:
    said = (
        "Of all findings with a name, those of a tie too: the probability that is claimed, and the share that is the "
        "truth at its place."
    )
    listed = [
        [f"{low:.2f} to {high:.2f}", f"{claimed:.3f}", rate(right, total)]
        for low, high, claimed, right, total in binned(rows)
    ]
    drawn = f"\n![Claimed probability against the share that is right]({FIGURE})\n"
    return f"## Reliability\n\n{said}\n\n" + table(["claimed", "mean", "right"], listed) + drawn


def _failures(rows: Sequence[Score], causes: Mapping[str, str]) -> str:
    failed = sorted((r for r in rows if not r.right), key=lambda r: (_group(r), r.spec["seed"]))
    listed = [
        [
            f"`{r.plant}`",
            _told(r),
            r.outcome + (", found all the same" if r.recognised else ""),
            _said(r),
            _errors(r),
            cause(r, causes),
        ]
        for r in failed
    ]
    head = ["rig", "concealed", "outcome", "verdict", "refit -> amended, held out", "cause, where known"]
    return f"## The failures one by one\n\n{len(failed)} of {len(rows)} rigs.\n\n" + table(head, listed)


def _told(row: Score) -> str:
    sizes = row.sizes or (math.nan,) * len(row.truth)
    parts = [t + ("" if math.isnan(n) else f" {n:.3g} x") for t, n in zip(row.truth, sizes, strict=False)]
    return " + ".join(parts or row.truth) or "nothing"


def _said(row: Score) -> str:
    return row.failure.strip().splitlines()[-1] if row.failure.strip() else row.verdict


def _errors(row: Score) -> str:
    return f"{row.errors[1]:.3g} -> {row.errors[2]:.3g}" if row.errors else "-"


def _hard(rows: Sequence[Score], hard: Mapping[str, str], causes: Mapping[str, str]) -> str:
    ran = [r for r in rows if r.outcome != "not run"]
    right = sum(r.right for r in ran)
    listed = [
        [
            f"`{r.plant}`",
            hard.get(r.plant, ""),
            _told(r),
            r.outcome,
            _said(r),
            _errors(r),
            "" if r.right else cause(r, causes),
        ]
        for r in sorted(ran, key=lambda r: r.plant)
    ]
    known = {r.plant for r in ran}
    listed += [[f"`{name}`", what, "", "not run yet", "", "", ""] for name, what in hard.items() if name not in known]
    head = ["case", "what it is", "concealed", "outcome", "verdict", "refit -> amended, held out", "cause, where known"]
    return HARD + f"{right} right of {len(ran)} that ran.\n\n" + table(head, listed)
