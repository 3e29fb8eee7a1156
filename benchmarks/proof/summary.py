"""Rates, goals and tables of a list of scores; nothing here reads a file."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from benchmarks.concealed.suites import CORE
from benchmarks.proof.score import Score, wilson

FLOOR_BOUND = 1.2
"""Times the noise floor that a held-out error may reach."""

SINGLES = ("core", "catalogue")
SLACK = 1 + 1e-9


@dataclass(frozen=True)
class Goal:
    """A line of the table of what the benchmark must show.

    Attributes:
        suite: in words.
        goal: in words.
        measured: in words, with bounds.
        met: None if nothing was run.
    """

    suite: str
    goal: str
    measured: str
    met: bool | None


def rate(hits: int, total: int) -> str:
    """``45 of 50, 90 % (79 to 96 %)``; the bounds are Wilson's, 95 %."""
    if not total:
        return "not run"
    low, high = wilson(hits, total)
    return f"{hits} of {total}, {100 * hits / total:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)"


def of(rows: Iterable[Score], *suites: str) -> list[Score]:
    """The rows of some suites."""
    return [r for r in rows if r.suite in suites]


def label(row: Score) -> str:
    """What a case was reported as, in one word."""
    if row.outcome in ("failed", "not run"):
        return row.outcome
    if not row.reported:
        return "none"
    if row.outcome == "named" and len(row.truth) == 1:
        return row.reported[0][1]
    if len(row.reported) > 1:
        return "several"
    status, effect, _ = row.reported[0]
    return effect if status == "named" else status


def confusion(rows: Sequence[Score]) -> dict[str, Counter[str]]:
    """Truth -> how often it was reported as what, for cases that conceal one thing or nothing; none withheld."""
    table: dict[str, Counter[str]] = {}
    for row in rows:
        if len(row.truth) <= 1 and not row.spec["withheld"]:
            truth = row.truth[0].partition("@")[0] if row.truth else "none"
            table.setdefault(truth, Counter())[label(row)] += 1
    return table


def by_size(rows: Iterable[Score]) -> dict[str, dict[float, list[Score]]]:
    """Core effects, alone with the usual sensors: effect -> size in thresholds -> cases."""
    table: dict[str, dict[float, list[Score]]] = {}
    for row in of(rows, "core", "power"):
        effect = row.spec["effects"][0].partition("@")[0]
        if effect in CORE:
            table.setdefault(effect, {}).setdefault(row.spec["sizes"][0], []).append(row)
    return table


def amended(rows: Iterable[Score]) -> list[tuple[float, float, float]]:
    """Held-out errors (nominal, refit, amended) where something is concealed that the tool may name."""
    return [r.errors for r in rows if r.errors and r.truth and not r.spec["withheld"]]


def median(values: Sequence[float]) -> float:
    """Median, not a number if there are none."""
    return statistics.median(values) if values else float("nan")


def goals(rows: Sequence[Score]) -> list[Goal]:
    """What the benchmark must show, and what it shows. Cases that failed or were not run count against it."""
    singles, nothing, two = of(rows, *SINGLES), of(rows, "none"), of(rows, "pairs")
    fewer, withheld, ties = of(rows, "encoder", "closed"), of(rows, "withheld"), of(rows, "ties")
    hard = [r for r in rows if r.truth and not r.spec["withheld"] and r.suite != "ties"]
    errors, worse = amended(hard), sum(e[2] > e[1] * SLACK for e in amended(rows))
    below = sum(e[2] <= FLOOR_BOUND for e in errors)
    inside = [hit for r in rows for _, hit in r.covered]
    named = sum(r.outcome == "named" for r in singles)
    single = "every catalogue effect, alone"
    return [
        _share(single, "right name, or a tie that the truth generator confirms, >= 90 %", singles, _right, low=0.90),
        Goal(single, "of these, named outright", rate(named, len(singles)), None),
        _share(single, "right place >= 95 %", singles, lambda r: bool(r.placed), low=0.95),
        _share("nothing concealed", "false alarms <= 5 %", nothing, lambda r: not r.right, high=0.05),
        _share("pairs", "both right >= 75 %", two, _right, low=0.75),
        _share("pairs", "at least one right >= 95 %", two, lambda r: r.found > 0, low=0.95),
        _share("encoder alone; closed loop", "right, or a correct tie, >= 75 %", fewer, _right, low=0.75),
        _share("encoder alone; closed loop", "wrong name <= 5 %", fewer, lambda r: r.claimed, high=0.05),
        _share("true effect withheld", "confident wrong name <= 5 %", withheld, lambda r: r.claimed, high=0.05),
        _share("one parameter wrong, no effect", "found as such", of(rows, "wrong"), _right),
        _share("designed ties", "tie reported, 9 of 10", ties, lambda r: r.outcome == "tie", low=0.9),
        _settled(ties),
        _held(f"held-out error <= {FLOOR_BOUND} x floor in 90 %", below, len(hard), errors),
        Goal(
            "held-out error",
            "never worse than the refit",
            f"worse in {worse} of {len(amended(rows))}",
            worse == 0 if amended(rows) else None,
        ),
        _intervals(inside),
        _time("one effect or none", [*singles, *nothing], 30.0),
        _time("pairs", two, 180.0),
    ]


def _right(row: Score) -> bool:
    return row.right


def _share(
    suite: str,
    goal: str,
    rows: Sequence[Score],
    hit: Callable[[Score], bool],
    low: float | None = None,
    high: float | None = None,
) -> Goal:
    """A rate against a bound. A case that failed is no hit of what is wanted, and one of what is not."""
    against = high is not None
    hits = sum(against if row.outcome in ("failed", "not run") else hit(row) for row in rows)
    if not rows or (low is None and high is None):
        return Goal(suite, goal, rate(hits, len(rows)), None)
    share = hits / len(rows)
    met = share <= high if high is not None else share >= (low or 0.0)
    return Goal(suite, goal, rate(hits, len(rows)), met)


def _settled(ties: Sequence[Score]) -> Goal:
    if all(r.settled is None for r in ties):
        return Goal("designed ties", "the proposed experiment settles 9 of 10", "not carried out", None)
    return _share("designed ties", "the proposed experiment settles 9 of 10", ties, lambda r: bool(r.settled), low=0.9)


def _held(goal: str, below: int, total: int, errors: Sequence[tuple[float, float, float]]) -> Goal:
    middle = f"; median {median([e[1] for e in errors]):.3g} -> {median([e[2] for e in errors]):.3g}" if errors else ""
    return Goal("held-out error", goal, rate(below, total) + middle, below >= 0.9 * total if total else None)


def _intervals(inside: Sequence[bool]) -> Goal:
    share = sum(inside) / len(inside) if inside else 0.0
    met = 0.88 <= share <= 0.98 if inside else None
    return Goal("95 % intervals", "cover 88 to 98 %", rate(sum(inside), len(inside)), met)


def _time(what: str, rows: Sequence[Score], most: float) -> Goal:
    """Judged by processor time where that was measured: one thread alone on its core would take as long."""
    ran = [r for r in rows if r.seconds > 0]
    if not ran:
        return Goal(f"time, {what}", f"median <= {most:g} s", "not run", None)
    seconds, cpu = median([r.seconds for r in ran]), [r.cpu for r in ran if r.cpu is not None]
    spent = f"{median(cpu):.0f} s of processor time, " if cpu else "processor time not measured, "
    slowest = max(r.seconds for r in ran)
    measured = f"median {spent}{seconds:.0f} s elapsed; slowest {slowest:.0f} s; {len(ran)} cases"
    return Goal(f"time, {what}", f"median <= {most:g} s", measured, (median(cpu) if cpu else seconds) <= most)


def suites(rows: Sequence[Score]) -> list[tuple[str, Counter[str]]]:
    """Suite -> outcomes, in the order of the suites."""
    order = dict.fromkeys(("core", "catalogue", "power", "none", "pairs", "encoder", "closed", "withheld", "wrong"))
    names = [*order, *sorted({r.suite for r in rows} - order.keys())]
    return [(name, Counter(r.outcome for r in of(rows, name))) for name in names if of(rows, name)]
