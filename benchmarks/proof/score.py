"""Scoring: the answers are opened here and nowhere else."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.concealed.named import plant as plant_of
from benchmarks.concealed.plants.base import Plant
from benchmarks.concealed.sites import drive_sites, sites
from benchmarks.concealed.ties import ENOUGH, FLOOR, WRONG, cuts_a_node, from_answers, tie_class
from benchmarks.proof.intervals import covered
from benchmarks.proof.run import UNDRAWN, plan
from diagnosis.search.study import LEAST_ODDS

RIGHT = frozenset({"named", "tie", "none", "equal"})
"""Outcomes that are right where no true effect was withheld."""

NOTHING = "nothing"
"""The rival without any effect. What is concealed can be seen, so it never does what the truth does."""

LOADED = frozenset({"load_dependent_friction", "quadratic_load_friction"})
"""Friction that grows with the load, which is another one at each block."""


@dataclass(frozen=True)
class Score:
    """One case, judged.

    Attributes:
        name, suite, plant, spec: of the case; ``spec`` as JSON, enough to draw it again.
        truth: what was concealed, ``effect@place``.
        visible: how large it was, in noise floors after a refit.
        reported: the findings, (status, effect, place) each.
        verdict: status, effect and place that were reported, and what it could not be told from.
        outcome: ``named``, ``tie`` (a true one, with the truth in it), ``none`` (rightly), ``missed``, ``unknown``,
            ``half`` (of two effects), ``wrong`` (a wrong name claimed), ``wrong tie``, ``loose tie`` (the truth is in
            it, but so is what the recordings exclude), ``equal`` (the truth was withheld, or part of it is not claimed,
            and what is claimed does the same on these recordings by the truth generator's own computation), ``false
            alarm``, ``failed``, ``not run``.
        found: how many of the concealed effects were named, or are in a true tie.
        claimed: whether a name was claimed, alone, that is not the truth.
        placed: whether the place is right; None where none was to be found.
        errors: held-out error (mean square over the true floor) of nominal, refit and amended; None if it failed.
        covered: (parameter, inside its interval) for each interval whose true value is known.
        seconds, cpu: of the diagnosis; cpu None where it was not measured.
        failure: what went wrong.
        frozen, code: commit that the seeds follow from, or nothing; hash of the program that ran.
        proposal: kind of the next experiment, if one was proposed.
        sizes: of what was concealed, in detection thresholds.
        claims: for each finding that claims a name, whether it is the truth at its place.
        odds: for each finding with a name, in a tie too, the probability that it is given and whether it is the truth
            at its place.
        converged: of the models that hold a thousandth of the probability or more, how many fits have converged, and
            how many there are; None where the diagnosis does not say.
        recognised: whether the verdict is ``unknown``, although the model that came closest on the held-out recordings
            holds the true effects at their places.
        early: whether the search ended before its end, for the time that was allowed.
        settled: whether that experiment, carried out, made the tie a right name; None if it was not carried out.
    """

    name: str
    suite: str
    plant: str
    spec: dict[str, Any]
    truth: tuple[str, ...]
    visible: tuple[float, ...] = ()
    reported: tuple[tuple[str, str, str], ...] = ()
    verdict: str = "failed"
    outcome: str = "failed"
    found: int = 0
    claimed: bool = False
    placed: bool | None = None
    errors: tuple[float, float, float] | None = None
    covered: tuple[tuple[str, bool], ...] = ()
    seconds: float = 0.0
    cpu: float | None = None
    failure: str = ""
    frozen: str = ""
    code: str = ""
    proposal: str = ""
    settled: bool | None = None
    sizes: tuple[float, ...] = ()
    claims: tuple[bool, ...] = ()
    odds: tuple[tuple[float, bool], ...] = ()
    converged: tuple[int, int] | None = None
    recognised: bool = False
    early: bool = False

    @property
    def drawn(self) -> bool:
        """Whether there was a case to diagnose: a seed may give none."""
        return not self.failure.startswith(UNDRAWN)

    @property
    def right(self) -> bool:
        """Whether the verdict is the truth, or a tie that the truth generator confirms.

        Where the true effect was withheld, ``unknown`` is right, or another law that is the same. So is a part of what
        was concealed that does as much as the whole: a dead zone with unequal ends is one with an offset before it.
        """
        return self.outcome in (("unknown", "equal") if self.spec["withheld"] else RIGHT)


def wilson(hits: int, total: int) -> tuple[float, float]:
    """95 % bounds of a rate [Wilson 1927]."""
    if total == 0:
        return 0.0, 1.0
    z = 1.959963984540054
    rate, weight = hits / total, z**2 / total
    middle = (rate + weight / 2) / (1 + weight)
    half = z / (1 + weight) * math.sqrt(rate * (1 - rate) / total + weight / (4 * total))
    return max(0.0, middle - half), min(1.0, middle + half)


def scores(folder: Path) -> list[Score]:
    """Every case that was asked for in a folder that `benchmarks.proof.run` filled; none is left out."""
    rows, seen = [], set()
    for result in sorted((folder / "results").glob("*")):
        if (result / "run.json").exists():
            rows.append(_score(folder, result))
            seen.add(result.name)
    missing = {name: spec for name, spec in plan(folder).items() if name not in seen}
    return rows + [replace(_failed(name, spec), outcome="not run", verdict="not run") for name, spec in missing.items()]


def _failed(name: str, spec: dict[str, Any]) -> Score:
    effects = [(e, "") for e in spec["effects"]] + [("wrong_parameter", p) for p, _ in spec["options"]["wrong"]]
    truth = tuple(f"{effect}@{place}" if place else effect for effect, place in effects)
    return Score(name, spec["suite"], spec["plant"], spec, truth, placed=False if truth else None)


def _score(folder: Path, result: Path) -> Score:
    run = json.loads((result / "run.json").read_text(encoding="utf-8"))
    spec = run["spec"]
    about = {key: run[key] for key in ("seconds", "cpu", "failure", "frozen", "code") if key in run}
    base = replace(_failed(result.name, spec), **about)
    sealed = folder / "answers" / f"{result.name}.json"
    if not sealed.exists():
        return base
    answer = json.loads(sealed.read_text(encoding="utf-8"))
    concealed, wrong = answer["concealed"], [name for name, _ in spec["options"]["wrong"]]
    truth = [f"{c['effect']}@{c['place']}" for c in concealed] + [f"{WRONG}@{name}" for name in wrong]
    base = replace(
        base,
        truth=tuple(truth),
        visible=tuple(float(c["excess_in_floors"]) for c in concealed),
        sizes=tuple(float(c.get("size_in_thresholds") or 0.0) for c in concealed),
    )
    if run["failure"]:
        return base
    found = json.loads((result / "diagnosis.json").read_text(encoding="utf-8"))
    targets = list(_targets(answer).values())
    outcome, placed = _outcome(found, targets, folder, result, answer)
    hits, held = _hits(found, targets), _held(found, targets)
    if outcome == "wrong tie" and any(held) and _true_tie(_reported(found), folder, result, answer):
        hits = held  # what is in the tie is found, though another effect is missing in all of it
    part = outcome == "half" and sum(hits) == len([f for f in found["findings"] if f["status"] != "none"])
    if spec["withheld"] and outcome in ("wrong", "wrong tie", "half"):
        outcome = "equal" if _stands_in(found, folder, result, answer, FLOOR) else outcome
    elif part and _stands_in(found, folder, result, answer, ENOUGH):
        outcome = "equal"
    reported = tuple((f["status"], f["effect"], f["place"]) for f in found["findings"] if f["status"] != "none")
    floor = spec["options"]["sigma_error"] ** 2  # the tool's errors are over the floor that the scenario states
    fit = found["fit"]["hold_out"]
    return replace(
        base,
        reported=reported,
        verdict=_words(found),
        outcome=outcome,
        placed=placed,
        found=len(targets) if outcome in ("named", "tie") or (outcome == "equal" and part) else sum(hits),
        claimed=outcome != "equal"
        and any(_is_claim(*row) and not any(_meets(row, t) for t in targets) for row in reported),
        errors=(_pooled(fit["nominal"]) * floor, _pooled(fit["refit"]) * floor, _pooled(fit["amended"]) * floor),
        covered=tuple(covered(found, answer)),
        proposal=(found["next_experiment"] or {}).get("kind", ""),
        settled=_settled(folder, result, targets),
        odds=tuple(
            (f["probability"], any(f["effect"] == name and _at(f["place"], allowed) for name, allowed in targets))
            for f in found["findings"]
            if f["status"] in ("named", "wrong_parameter", "tie") and "probability" in f
        ),
        converged=_converged(found),
        claims=tuple(any(_meets(row, t) for t in targets) for row in reported if _is_claim(*row)),
        recognised=outcome == "unknown" and _recognised(found, targets),
        early=bool(found.get("ended_early")),
    )


def _targets(answer: dict[str, Any]) -> dict[str, tuple[str, set[str]]]:
    """Each part of the truth, ``effect@place``: what it is called, and the names of its place."""
    found = {f"{c['effect']}@{c['place']}": (_name(c), {c["place"], *c["same_place"]}) for c in answer["concealed"]}
    return found | {f"{WRONG}@{name}": (WRONG, {name}) for name, _ in answer["options"]["wrong"]}


def _name(concealed: dict[str, Any]) -> str:
    """Name of a concealed effect; a ripple of one wave per revolution is gravity."""
    once = concealed["effect"] == "torque_ripple" and concealed["parameters"]["order"] == 1
    return "gravity" if once else str(concealed["effect"])


def _converged(found: dict[str, Any]) -> tuple[int, int] | None:
    """Of the models that take part in the choice, how many fits have converged, and how many there are."""
    chosen = [t["converged"] for t in found.get("trials", ()) if t.get("probability", 0.0) >= LEAST_ODDS]
    return (sum(chosen), len(chosen)) if chosen else None


def _recognised(found: dict[str, Any], targets: list[tuple[str, set[str]]]) -> bool:
    """Whether the trial that left least on the held-out recordings holds the truth."""
    tried = [t for t in found.get("trials", ()) if t["hold_out_chi2"] is not None]
    if not tried:
        return False
    best = min(tried, key=lambda t: t["hold_out_chi2"])
    parts = [one.partition(" at ") for one in best["effects"]]
    return all(any(name == what and _at(where, allowed) for what, _, where in parts) for name, allowed in targets)


def _settled(folder: Path, result: Path, targets: list[tuple[str, set[str]]]) -> bool | None:
    """Whether the diagnosis after the proposed experiment names the truth; None if it was not carried out."""
    again = folder / "settled" / result.name
    if not (again / "run.json").exists():
        return None
    if not (again / "diagnosis.json").exists():
        return False
    found = json.loads((again / "diagnosis.json").read_text(encoding="utf-8"))
    return all(_hits(found, targets)) and not any(f["status"] == "tie" for f in found["findings"])


def _is_claim(status: str, effect: str, place: str) -> bool:
    return status in ("named", "wrong_parameter")


def _meets(row: tuple[str, str, str], target: tuple[str, set[str]]) -> bool:
    """Whether a finding claims a target by name, at its place."""
    return _is_claim(*row) and row[1] == target[0] and _at(row[2], target[1])


def _hits(found: dict[str, Any], targets: list[tuple[str, set[str]]]) -> list[bool]:
    rows = [(f["status"], f["effect"], f["place"]) for f in found["findings"]]
    return [any(_meets(row, target) for row in rows) for target in targets]


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
    reported = _reported(found)
    if not targets:
        return ("none" if not reported else "false alarm"), None
    if not reported:
        return "missed", False
    placed = all(any(_at(place, allowed) for _, _, place, _ in reported) for _, allowed in targets)
    named = _hits(found, targets)
    if all(named) and len(reported) == len(targets):
        return "named", placed
    if any(status == "tie" for status, *_ in reported):
        held = _held(found, targets)
        if all(held) and _true_tie(reported, folder, result, answer):
            return "tie", True
        return ("loose tie" if all(held) else "wrong tie"), placed or all(held)
    if any(status == "unknown" for status, *_ in reported):
        return "unknown", placed
    return ("half" if any(named) else "wrong"), placed


def _reported(found: dict[str, Any]) -> list[tuple[str, str, str, list[str]]]:
    """Status, effect and place of each finding, and what it cannot be told from."""
    return [
        (f["status"], f["effect"], f["place"], f["indistinguishable_from"])
        for f in found["findings"]
        if f["status"] != "none"
    ]


def _held(found: dict[str, Any], targets: list[tuple[str, set[str]]]) -> list[bool]:
    """Which targets are named, or are in a tie."""
    reported = _reported(found)
    return [
        _in_tie(reported, name, allowed) or hit
        for (name, allowed), hit in zip(targets, _hits(found, targets), strict=True)
    ]


def _in_tie(reported: Sequence[tuple[str, str, str, list[str]]], name: str, allowed: set[str]) -> bool:
    for _, effect, place, others in reported:
        for one in [f"{effect} at {place}", *others]:
            for part in one.split(" + "):
                what, _, where = part.partition(" at ")
                if what == name and _at(where, allowed):
                    return True
    return False


def _true_tie(
    reported: Sequence[tuple[str, str, str, list[str]]], folder: Path, result: Path, answer: dict[str, Any]
) -> bool:
    """Whether every rival that was reported ties by the truth generator's own computation.

    A rival that the generator has no counterpart of cannot be checked, and does not count against the report.
    """
    plant, truth = plant_of(answer["plant"]), _targets(answer)
    rivals = set()
    # What is found belongs together; what it cannot be told from is a whole model each time.
    models = [" + ".join(f"{effect} at {place}" for _, effect, place, _ in reported)]
    for one in [*models, *(other for *_, others in reported for other in others)]:
        if one == NOTHING:
            return False
        parts = _parts(plant, one, truth)
        told = [part for part in parts if part is not None]
        if len(told) == len(parts) and not Counter(told) <= Counter(truth.keys()):
            rivals.add(tuple(sorted(told)))
    return _tied(rivals, folder, result, answer)


def _stands_in(found: dict[str, Any], folder: Path, result: Path, answer: dict[str, Any], within: float) -> bool:
    """Whether everything that is claimed together, and each of its rivals, does what the truth does.

    Args:
        found: the diagnosis.
        folder, result, answer: of the case.
        within: distance from the truth on held-out recordings, in floors.
    """
    plant, truth = plant_of(answer["plant"]), _targets(answer)
    claims = [" + ".join(f"{f['effect']} at {f['place']}" for f in found["findings"])]
    claims += [one for f in found["findings"] for one in f["indistinguishable_from"]]
    rivals = set()
    for one in claims:
        if one == NOTHING:
            return False
        parts = _parts(plant, one, truth)
        told = [part for part in parts if part is not None]
        if len(told) < len(parts):
            return False
        rivals.add(tuple(sorted(told)))
    return _tied(rivals, folder, result, answer, within)


def _tied(
    rivals: set[tuple[str, ...]], folder: Path, result: Path, answer: dict[str, Any], within: float = FLOOR
) -> bool:
    """Whether none of these explanations can be told from the truth, by the truth generator; computed once."""
    kept = folder / "ties" / f"{result.name}.json"
    known = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    missing = [r for r in sorted(rivals) if "+".join(r) not in known]
    if missing:
        for rival in tie_class(from_answers(answer), missing):
            known["+".join(sorted(f"{effect}@{place}" for effect, place in rival.effects))] = rival.distance
        kept.parent.mkdir(exist_ok=True)
        kept.write_text(json.dumps(known, indent=1), encoding="utf-8")
    return all(known["+".join(r)] < within for r in rivals)


def _parts(plant: Plant, explanation: str, truth: dict[str, tuple[str, set[str]]]) -> list[str | None]:
    """The parts of an explanation, as the truth generator has them; None for one that it has no counterpart of.

    A part that meets one of the truth is that, at its true place. Only one part is: the same effect once more in the
    same node is another cut. Where several could be, it is one that ends at the true flange.
    """
    parts = [part.split(" at ") for part in explanation.split(" + ")]
    own: dict[int, str] = {}
    for text, (name, allowed) in truth.items():
        meeting = [k for k, (effect, place) in enumerate(parts) if effect == name and _at(place, allowed)]
        end = text.rpartition("@")[2].split(" -> ")[-1]
        meeting = sorted((k for k in meeting if k not in own), key=lambda k: parts[k][1].split(" -> ")[-1] != end)
        own |= dict.fromkeys(meeting[:1], text)
    return [own.get(k) or _part(plant, effect, place) for k, (effect, place) in enumerate(parts)]


def _part(plant: Plant, effect: str, place: str) -> str | None:
    """A part of an explanation that is not the truth, as the truth generator has it; None if it has no counterpart.

    A joint of two flanges of a rig's node keeps its name: which cuts that may be, `benchmarks.concealed.ties` knows.
    Friction that grows with a load grows with what that block bears at whose flange it is told; the generator's own
    grows with the drive's torque alone.
    """
    if effect == WRONG:
        return f"{WRONG}@{place}" if any(q.name == place for q in plant.parameters) else None
    able = [s for s in [*sites(plant), *drive_sites(plant)] if s.effect.name == effect]
    if any(place == site.place for site in able) or cuts_a_node(plant, effect, place):
        return f"{effect}@{place}"
    if effect in LOADED:
        return None
    return next((str(site) for site in able if _at(place, {site.place, *site.same})), None)
