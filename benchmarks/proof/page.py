"""The page: what was asked, what came out, and every failure."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.proof import figures
from benchmarks.proof.data import Proof
from benchmarks.proof.score import Score
from benchmarks.proof.summary import (
    FLOOR_BOUND,
    SLACK,
    Goal,
    amended,
    by_size,
    confusion,
    goals,
    median,
    rate,
    suites,
)
from benchmarks.proof.words import CONFUSION, GOALS, HEAD, HELD_OUT, INTERVALS, LEGEND, POWER, SINDY, TIME
from engine.files import writing


def write(proof: Proof, page: Path, causes: Mapping[str, str]) -> None:
    """Write the page, and its figures beside it.

    Raises:
        FlexarmError: a file cannot be written.
    """
    power, matrix = page.with_name(f"{page.stem}-power.svg"), page.with_name(f"{page.stem}-confusion.png")
    figures.power(proof.rows, power)
    figures.matrix(proof.rows, matrix)
    parts = [
        _head(proof.rows),
        _frozen(proof.about, proof.rows),
        _goals(proof.rows, causes),
        _suites(proof.rows),
        f"![Power against effect size, and held-out errors]({power.name})\n\n" + _power(proof.rows),
        _confusion(proof.rows) + f"\n![Confusion matrix]({matrix.name})\n",
        _held_out(proof.rows),
        _intervals(proof.rows),
        _peers(proof),
        _time(proof.rows),
        _failures(proof.rows, causes),
        _seeds(proof.rows),
    ]
    with writing(page, (".md",)) as temporary:
        temporary.write_text("\n".join(parts), encoding="utf-8")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    cells = [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in cells)]) + "\n"


def _head(rows: Sequence[Score]) -> str:
    ran = [r for r in rows if r.seconds > 0]
    named = [r for r in ran if r.outcome == "named" and r.truth] or ran
    if not named:
        return HEAD.format(example="--plant pendulum --effect offset --seed 1", say="It says what it finds")
    best = min(named, key=lambda r: r.seconds)
    say = f"It took {best.seconds:.0f} s here, and ends with what was reported and what had\nbeen concealed"
    return HEAD.format(example=best.name, say=say)


def _frozen(about: Mapping[str, Any], rows: Sequence[Score]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    lines = ["## What was frozen, and what ran\n", f"{versions}; {about['machine']}.\n"]
    made = about.get("frozen")
    if made:
        lines.append(f"Commit `{made['commit']}` froze the rules. Seeds of a suite are the first four bytes of")
        lines.append("SHA-256(commit, suite, k), k = 0, 1, ..., modulo 1e6, so that nobody could choose them.\n")
        now = about.get("trees", {})
        listed = [
            [
                f"`{path}/`",
                f"`{then[:12]}`",
                f"`{now.get(path, 'absent')[:12]}`",
                "yes" if now.get(path) == then else "no",
            ]
            for path, then in made["trees"].items()
        ]
        lines.append(table(["folder", "tree when frozen", f"tree at {about['commit'][:12]}", "the same"], listed))
        for what, key in (
            ("`diagnosis/` and `blocks/`", "changed_since"),
            ("what draws and scores", "judges_changed_since"),
        ):
            listing = ", ".join(f"`{name}`" for name in made.get(key, ())) or "none"
            lines.append(f"Files of {what} that differ from the frozen commit: {listing}.\n")
    else:
        lines.append(
            "No commit has frozen the rules yet: these seeds were chosen, and the figures are of development.\n"
        )
    drawn = Counter(r.frozen for r in rows if r.outcome != "not run")
    if made:
        lines.append(f"{drawn[made['commit']]} of {len(rows)} cases have seeds of that commit.\n")
    states = Counter(r.code for r in rows if r.code)
    if states:
        told = ", ".join(f"`{state}` ({count} cases)" for state, count in states.most_common())
        lines.append(f"States of the program that diagnosed (hash over all its sources): {told}.\n")
    return "\n".join(lines)


def _goals(rows: Sequence[Score], causes: Mapping[str, str]) -> str:
    met, found = {True: "met", False: "**not met**", None: "-"}, goals(rows)
    listed = [[g.suite, g.goal, g.measured, met[g.met]] for g in found]
    return GOALS + table(["suite", "goal", "measured", ""], listed) + shortfalls(found, causes)


def shortfalls(found: Sequence[Goal], causes: Mapping[str, str]) -> str:
    """Why goals were not met, those whose cause is known."""
    reasons = [(g, _fitting(f"goal {g.suite}: {g.goal}", causes)) for g in found if g.met is False]
    told = [f"* *{g.suite}, {g.goal}*: {why}" for g, why in reasons if why]
    return "\n**Where it falls short, and why**\n\n" + "\n".join(told) + "\n" if told else ""


def _suites(rows: Sequence[Score]) -> str:
    found, right = suites(rows), Counter(r.suite for r in rows if r.right)
    outcomes = list(dict.fromkeys(o for o in ORDER if any(c[o] for _, c in found)))
    listed = [
        [name, str(counts.total()), rate(right[name], counts.total())] + [str(counts[o] or "") for o in outcomes]
        for name, counts in found
    ]
    return "## Suites\n\n" + table(["suite", "cases", "right", *outcomes], listed) + LEGEND


ORDER = (
    "named",
    "tie",
    "equal",
    "none",
    "half",
    "loose tie",
    "unknown",
    "missed",
    "wrong tie",
    "wrong",
    "false alarm",
    "failed",
    "not run",
)


def _power(rows: Sequence[Score]) -> str:
    found = by_size(rows)
    sizes = sorted({size for of_size in found.values() for size in of_size})
    listed = []
    for effect in sorted(found):
        cells = []
        for size in sizes:
            cases = found[effect].get(size, [])
            cells.append(f"{sum(r.right for r in cases)} of {len(cases)}" if cases else "-")
        listed.append([effect, *cells])
    every = [[r for of_size in found.values() for r in of_size.get(size, [])] for size in sizes]
    listed.append(["all", *(rate(sum(r.right for r in cases), len(cases)) for cases in every)])
    head = ["effect", *(f"{size:g} x threshold" for size in sizes)]
    return POWER + table(head, listed)


def _confusion(rows: Sequence[Score]) -> str:
    listed = []
    for truth, counts in sorted(confusion(rows).items()):
        others = ", ".join(f"{name} {n}" for name, n in counts.most_common() if name != truth)
        listed.append([truth, str(counts.total()), str(counts[truth]), others or "-"])
    return CONFUSION + table(["concealed", "cases", "so reported", "reported as something else"], listed)


def _held_out(rows: Sequence[Score]) -> str:
    listed = []
    for name, _ in suites(rows):
        errors = amended([r for r in rows if r.suite == name])
        if errors:
            below = sum(e[2] <= FLOOR_BOUND for e in errors)
            worse = sum(e[2] > e[1] * SLACK for e in errors)
            medians = [f"{median([e[k] for e in errors]):.3g}" for k in range(3)]
            listed.append([name, *medians, rate(below, len(errors)), str(worse)])
    head = ["suite", "nominal", "refit alone", "amended", f"amended <= {FLOOR_BOUND} x floor", "worse than the refit"]
    return HELD_OUT + table(head, listed)


def _intervals(rows: Sequence[Score]) -> str:
    counts: dict[str, list[bool]] = {}
    for row in rows:
        for name, hit in row.covered:
            counts.setdefault(name, []).append(hit)
    every = [hit for hits in counts.values() for hit in hits]
    listed = [[name, rate(sum(hits), len(hits))] for name, hits in sorted(counts.items())]
    listed.append(["all", rate(sum(every), len(every))])
    return INTERVALS + table(["parameter", "inside"], listed)


def _peers(proof: Proof) -> str:
    text = "## A peer on the same cases: PySINDy\n\n"
    if not proof.sindy:
        return text + "Not run (`pip install 'flexarm[peers]'`, then `python -m benchmarks.peers.sindy -o DIR`).\n"
    ours = {r.name: r for r in proof.rows}
    groups: dict[str, list[tuple[dict[str, Any], Score]]] = {}
    for name, found in proof.sindy.items():
        if name in ours and ours[name].outcome != "not run":
            groups.setdefault("+".join(t.partition("@")[0] for t in ours[name].truth) or "none", []).append(
                (found, ours[name])
            )
    listed = []
    for effect, pairs in sorted(groups.items()):
        able = [(f, r) for f, r in pairs if f["applies"]]
        right = sum(r.right for _, r in pairs)
        cells = ["no: " + pairs[0][0]["reason"], "-", "-"]
        if able:
            cells = ["yes", *(f"{sum(f[key] for f, _ in able)} of {len(able)}" for key in ("selected", "alone"))]
        listed.append([effect, *cells, f"{right} of {len(pairs)}"])
    head = ["concealed", "a term of the library can be it", "term selected", "and no other nonlinear", "flexarm right"]
    return text + SINDY + table(head, listed)


def _time(rows: Sequence[Score]) -> str:
    listed = []
    for name, _ in suites(rows):
        ran = [r for r in rows if r.suite == name and r.seconds > 0]
        if not ran:
            continue
        cpu = [r.cpu for r in ran if r.cpu is not None]
        middle = f"{median(cpu):.0f} s" if cpu else "not measured"
        seconds = [r.seconds for r in ran]
        listed.append([name, f"{median(seconds):.0f} s", middle, f"{max(seconds):.0f} s"])
    return TIME + table(["suite", "median", "median CPU", "slowest"], listed)


def _failures(rows: Sequence[Score], causes: Mapping[str, str]) -> str:
    failed = [r for r in rows if not r.right]
    listed = []
    for row in sorted(failed, key=lambda r: (r.suite, r.truth, r.plant)):
        said = row.failure.strip().splitlines()[-1] if row.failure.strip() else row.verdict
        size = ", ".join(f"{s:g} x" for s in row.spec["sizes"]) if row.truth and row.spec["effects"] else ""
        truth = " + ".join(row.truth) or "nothing"
        cells = [f"`{row.name}`", row.plant, f"{truth} {size}".strip(), row.outcome, said, cause(row, causes)]
        listed.append(cells)
    head = ["case", "plant", "concealed", "outcome", "verdict", "cause, where known"]
    told = f"{len(failed)} of {len(rows)} cases.\n\n" + (table(head, listed) if listed else "")
    return "## The failures one by one\n\n" + told


def cause(row: Score, causes: Mapping[str, str]) -> str:
    """Why a case failed, by its name or by the first pattern that fits ``suite plant effect@place+...``."""
    if row.name in causes:
        return causes[row.name]
    return _fitting(f"{row.suite} {row.plant} {'+'.join(row.truth) or 'none'}", causes)


def _fitting(text: str, causes: Mapping[str, str]) -> str:
    return next((why for pattern, why in causes.items() if fnmatch.fnmatchcase(text, pattern)), "")


def _seeds(rows: Sequence[Score]) -> str:
    listed = []
    for name, _ in suites(rows):
        found = sorted({r.spec["seed"] for r in rows if r.suite == name})
        shown = ", ".join(map(str, found[:20])) + (f", ... ({len(found)} in all)" if len(found) > 20 else "")
        listed.append([name, shown])
    return "## Seeds\n\nOf each case, as `benchmarks.concealed` takes them; the rest is in the data file.\n\n" + table(
        ["suite", "seeds"], listed
    )
