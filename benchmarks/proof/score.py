"""Scoring: the answers are opened here and nowhere else."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.concealed.plants import PLANTS
from benchmarks.concealed.plants.base import Plant
from benchmarks.concealed.sites import Site, sites
from benchmarks.concealed.ties import FLOOR, from_answers, tie_class


@dataclass(frozen=True)
class Score:
    """One case, judged.

    Attributes:
        name, suite, plant: of the case.
        truth: what was concealed, ``effect@place``.
        visible: how large it was, in noise floors after a refit.
        verdict: status, effect and place that were reported, and what it could not be told from.
        outcome: ``named``, ``tie`` (a true one, with the truth in it), ``none`` (rightly), ``missed``, ``unknown``,
            ``wrong`` (a wrong name claimed), ``false alarm``, ``failed``.
        placed: whether the place is right; None where none was to be found.
        hold_out: held-out error (mean square over the floor): (refit, amended).
        covered: (parameter, inside its interval) for each interval whose true value is known.
        seconds: of the diagnosis.
    """

    name: str
    suite: str
    plant: str
    truth: tuple[str, ...]
    visible: tuple[float, ...]
    verdict: str
    outcome: str
    placed: bool | None
    hold_out: tuple[float, float]
    covered: tuple[tuple[str, bool], ...]
    seconds: float


def wilson(hits: int, total: int) -> tuple[float, float]:
    """95 % bounds of a rate (Wilson 1927)."""
    if total == 0:
        return 0.0, 1.0
    z = 1.959963984540054
    rate, weight = hits / total, z**2 / total
    middle = (rate + weight / 2) / (1 + weight)
    half = z / (1 + weight) * math.sqrt(rate * (1 - rate) / total + weight / (4 * total))
    return max(0.0, middle - half), min(1.0, middle + half)


def scores(folder: Path) -> list[Score]:
    """Every finished case of a folder that `benchmarks.proof.run` filled."""
    rows = []
    for result in sorted((folder / "results").iterdir()):
        if (result / "run.json").exists():
            rows.append(_score(folder, result))
    return rows


def _score(folder: Path, result: Path) -> Score:
    run = json.loads((result / "run.json").read_text(encoding="utf-8"))
    answer = json.loads((folder / "answers" / f"{result.name}.json").read_text(encoding="utf-8"))
    spec, concealed = run["spec"], answer["concealed"]
    truth = tuple(f"{c['effect']}@{c['place']}" for c in concealed)
    truth = truth or tuple(f"wrong_parameter@{name}" for name, _ in spec["options"]["wrong"])
    visible = tuple(float(c["excess_in_floors"]) for c in concealed)
    if run["failure"]:
        return Score(
            result.name,
            spec["suite"],
            spec["plant"],
            truth,
            visible,
            "failed",
            "failed",
            False,
            (0, 0),
            (),
            run["seconds"],
        )
    found = json.loads((result / "diagnosis.json").read_text(encoding="utf-8"))
    targets = [(c["effect"], {c["place"], *c["same_place"]}) for c in concealed]
    targets += [("wrong_parameter", {name}) for name, _ in spec["options"]["wrong"]]
    outcome, placed = _outcome(found, targets, folder, result, answer)
    held = found["fit"]["hold_out"]
    return Score(
        result.name,
        spec["suite"],
        spec["plant"],
        truth,
        visible,
        _words(found),
        outcome,
        placed,
        (_pooled(held["refit"]), _pooled(held["amended"])),
        tuple(_covered(found, concealed)),
        run["seconds"],
    )


def _words(found: dict[str, Any]) -> str:
    parts = []
    for f in found["findings"]:
        others = "; ".join(f["indistinguishable_from"][:4])
        parts.append(f"{f['status']}: {f['effect']} at {f['place']}" + (f" or {others}" if others else ""))
    return " + ".join(parts) or found["verdict"]


def _pooled(signals: dict[str, dict[str, float]]) -> float:
    values = [row["chi2"] for row in signals.values()]
    return sum(values) / max(len(values), 1)


def _at(place: str, allowed: set[str]) -> bool:
    """Whether a reported place is one of the names of the true one."""
    parts = {place, *place.split(" -> ")}
    return bool(parts & allowed)


def _outcome(
    found: dict[str, Any], targets: list[tuple[str, set[str]]], folder: Path, result: Path, answer: dict[str, Any]
) -> tuple[str, bool | None]:
    reported = [
        (f["status"], f["effect"], f["place"], f["indistinguishable_from"])
        for f in found["findings"]
        if f["status"] != "none"
    ]
    if not targets:
        return ("none" if not reported else "false alarm"), None
    if not reported:
        return "missed", False
    placed = all(any(_at(place, allowed) for _, _, place, _ in reported) for _, allowed in targets)
    named = [
        any(
            status in ("named", "wrong_parameter") and effect == name and _at(place, allowed)
            for status, effect, place, _ in reported
        )
        for name, allowed in targets
    ]
    if all(named) and len(reported) == len(targets):
        return "named", placed
    if any(status == "tie" for status, *_ in reported):
        held = [_in_tie(reported, name, allowed) or hit for (name, allowed), hit in zip(targets, named, strict=True)]
        if all(held) and _true_tie(reported, targets, folder, result, answer):
            return "tie", True
        return ("loose tie" if all(held) else "wrong tie"), placed or all(held)
    if any(status == "unknown" for status, *_ in reported):
        return "unknown", placed
    return ("half" if any(named) else "wrong"), placed


def _in_tie(reported: Sequence[tuple[str, str, str, list[str]]], name: str, allowed: set[str]) -> bool:
    for _, effect, place, others in reported:
        for one in [f"{effect} at {place}", *others]:
            for part in one.split(" + "):
                what, _, where = part.partition(" at ")
                if what == name and _at(where, allowed):
                    return True
    return False


def _true_tie(
    reported: Sequence[tuple[str, str, str, list[str]]],
    targets: list[tuple[str, set[str]]],
    folder: Path,
    result: Path,
    answer: dict[str, Any],
) -> bool:
    """Whether every rival that was reported ties by the truth generator's own computation.

    A rival that the generator has no counterpart of cannot be checked, and does not count against the report.
    """
    plant = PLANTS[answer["plant"]]
    rivals = set()
    for _, effect, place, others in reported:
        for one in [f"{effect} at {place}", *others]:
            parts = [_site(plant, *part.split(" at ")) for part in one.split(" + ")]
            if None not in parts and not all(_is(part, targets) for part in parts):
                rivals.add(tuple(sorted(str(part) for part in parts)))
    kept = folder / "ties" / f"{result.name}.json"
    known = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    missing = [r for r in sorted(rivals) if "+".join(r) not in known]
    if missing:
        for rival in tie_class(from_answers(answer), missing):
            known["+".join(sorted(f"{effect}@{place}" for effect, place in rival.effects))] = rival.distance
        kept.parent.mkdir(exist_ok=True)
        kept.write_text(json.dumps(known, indent=1), encoding="utf-8")
    return all(known["+".join(r)] < FLOOR for r in rivals)


def _site(plant: Plant, effect: str, place: str) -> Site | None:
    able = (s for s in sites(plant) if s.effect.name == effect and _at(place, {s.place, *s.same}))
    return next(able, None)


def _is(site: Site | None, targets: list[tuple[str, set[str]]]) -> bool:
    return site is not None and any(site.effect.name == name and site.place in allowed for name, allowed in targets)


def _covered(found: dict[str, Any], concealed: list[dict[str, Any]]) -> list[tuple[str, bool]]:
    rows = []
    for c in concealed:
        for f in found["findings"]:
            if f["effect"] != c["effect"] or f["status"] not in ("named", "tie"):
                continue
            for key, row in f["parameters"].items():
                if key in c["parameters"] and isinstance(c["parameters"][key], int | float):
                    value = float(c["parameters"][key])
                    rows.append((f"{c['effect']}.{key}", bool(row["low"] <= value <= row["high"])))
    return rows
