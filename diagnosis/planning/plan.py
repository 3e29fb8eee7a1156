"""The plan of an experiment judged before it is done: what would show, what ties, and what would settle the ties."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import OperatingScales, operating_scales
from diagnosis.planning.distinguish import (
    Odds,
    Truths,
    odds,
    pairs_of_effects,
    rivals,
    ties,
    truths,
    unordered,
)
from diagnosis.planning.experiment import Planned, with_signals_left
from diagnosis.planning.improve import Further, Input, inputs, sensors
from diagnosis.planning.reach import Bench
from diagnosis.planning.sizes import NEAR_ONE, Family, families
from diagnosis.planning.smallest import Smallest, smallest
from engine.errors import FlexarmError
from engine.spread import Spread
from scenarios.load import Scenario

Progress = Callable[[str, int, int], None]

MULTIPLES = (3.0, 10.0)
"""Sizes at which effects are told apart, as multiples of the smallest that shows."""

SHARE_OF = {
    "lower": "the largest input",
    "upper": "the largest input",
    "offset": "the largest value",
    "coulomb_friction": "the torques that act",
    "amplitude": "the torques that act",
    "inertia": "the inertia there",
    "half_gap": "the travel",
}
"""What a size is a share of, by the leading parameter."""

NAMES = {"lower": "width", "corner_frequency": "time constant", "backward": "gain", "mass": "mass", "gain": "gain"}
"""What a size is called where the parameter's own name does not say it."""


@dataclass(frozen=True)
class Row:
    """An effect at a place in the planned experiment.

    Attributes:
        number: of the row, from 1.
        effect, place, shape: which; ``shape`` is the order or frequency of one that has several.
        shows: whether it would be found at all, at sizes up to those that make another machine.
        parameter: what its size is, such as ``coulomb_friction``; empty for a law that is there or not.
        size, unit: the smallest that shows (SI); where none does, the largest that was tried.
        share, share_of: the same as a share of something that matters, if there is such a thing.
        relative: the same over a size that matters, as the catalogue has it.
        finest: whether smaller ones move faster than the samples, so that they were not tried.
        ties: multiple of that size -> numbers of the rows that could not be excluded.
        pairs: multiple -> numbers of two rows that together could not.
    """

    number: int
    effect: str
    place: str
    shape: str
    shows: bool
    parameter: str
    size: float | None
    unit: str
    share: float | None
    share_of: str
    relative: float | None
    finest: bool
    ties: dict[float, tuple[int, ...]]
    pairs: dict[float, tuple[tuple[int, int], ...]]

    @property
    def label(self) -> str:
        """Effect, shape and place."""
        shape = f" ({self.shape})" if self.shape else ""
        return f"{self.effect}{shape} at {self.place}"


@dataclass(frozen=True)
class Plan:
    """What a planned experiment could tell.

    Attributes:
        scenario: the user's.
        planned: the experiment.
        rows: every effect at every place.
        multiples: sizes at which effects were told apart, in smallest sizes.
        pairs: multiple -> number of pairs of effects that show.
        tied: multiple -> the pairs of rows that could not be told apart.
        inputs: of the menu, the best first, with the pairs (at the first multiple) that each settles besides.
        sensors: that could be added, the best first.
        one_input: whether one single input is driven, so that others can be tried.
        failures: effects that were not tried, and why.
    """

    scenario: Scenario
    planned: Planned
    rows: tuple[Row, ...]
    multiples: tuple[float, ...]
    pairs: dict[float, int]
    tied: dict[float, tuple[tuple[int, int], ...]]
    inputs: tuple[Input, ...]
    sensors: tuple[Further, ...]
    one_input: bool
    failures: tuple[tuple[str, str], ...]

    @property
    def shown(self) -> list[Row]:
        """The effects that would show."""
        return [row for row in self.rows if row.shows]

    def apart(self, multiple: float) -> int:
        """How many pairs could be told apart."""
        return self.pairs[multiple] - len(self.tied[multiple])

    @property
    def best_input(self) -> Input | None:
        """The input of the menu that settles most ties; None if none settles any."""
        return self.inputs[0] if self.inputs and self.inputs[0].settles else None

    @property
    def best_sensor(self) -> Further | None:
        """The sensor that settles most ties; None if none settles any."""
        return self.sensors[0] if self.sensors and self.sensors[0].settles else None

    def numbers(self) -> dict[str, Any]:
        """As it stands in ``plan.json``."""
        first = self.multiples[0]
        return {
            "scenario": self.scenario.name,
            "experiment": {
                "recordings": [
                    {"name": e.name, "duration": float(e.time[-1]), "samples": len(e.time)}
                    for e in self.planned.problem.experiments
                ],
                "inputs": [v.name for v in self.planned.problem.model.inputs],
                "sensors": [
                    {"signal": s.signal, "sigma": s.sigma, "unit": s.unit, "noise": s.noise}
                    for s in self.planned.sensors
                ],
                "assumed": list(self.planned.assumed),
            },
            "effects": [
                {
                    "number": row.number,
                    "effect": row.effect,
                    "place": row.place,
                    "shape": row.shape,
                    "shows": row.shows,
                    "parameter": row.parameter,
                    "smallest_size": row.size if row.shows else None,
                    "largest_tried": None if row.shows else row.size,
                    "unit": row.unit,
                    "share": row.share,
                    "share_of": row.share_of,
                    "at_most": row.finest,
                    "tied_with": {f"{m:g}": list(found) for m, found in row.ties.items()},
                    "tied_with_pairs": {f"{m:g}": [list(p) for p in found] for m, found in row.pairs.items()},
                }
                for row in self.rows
            ],
            "told_apart": {
                f"{m:g}": {"pairs": self.pairs[m], "apart": self.apart(m), "tied": [list(p) for p in self.tied[m]]}
                for m in self.multiples
            },
            "inputs": [
                {
                    "kind": one.kind,
                    "sentence": one.sentence,
                    "apart": self.apart(first) + len(one.settles),
                    "settles": [list(p) for p in one.settles],
                }
                for one in self.inputs
            ],
            "sensors": [
                {
                    "signal": one.sensor.signal,
                    "kind": one.sensor.kind,
                    "sigma": one.sensor.sigma,
                    "unit": one.sensor.unit,
                    "noise": one.sensor.noise,
                    "apart": self.apart(first) + len(one.settles),
                    "settles": [list(p) for p in one.settles],
                }
                for one in self.sensors
            ],
            "not_tried": [{"effect": name, "because": why} for name, why in self.failures],
        }


def plan(
    scenario: Scenario,
    planned: Planned,
    *,
    multiples: Sequence[float] = MULTIPLES,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    workers: int = 2,
    progress: Progress | None = None,
) -> Plan:
    """Judge a planned experiment.

    Args:
        scenario: the user's.
        planned: the experiment.
        multiples: sizes at which effects are told apart, in smallest sizes that show.
        only: effects that are looked at; all if none are named.
        without: effects that are left out.
        workers: threads; the result does not depend on them.
        progress: told what is done, how many of how many.
    """
    scales = operating_scales(planned.problem)
    listed = [c for c in first_options(candidates(scales, without)) if not only or c.effect in only]
    if not listed:
        raise FlexarmError(f"{', '.join(only) or 'no effect'} can act nowhere in '{scenario.name}'")
    planned = with_signals_left(planned, listed)
    every = [(family, _unexcited(family, scales)) for candidate in listed for family in families(candidate)]
    shapes = [family for family, why in every if not why]
    bench = Bench(planned)
    steps = _Steps(progress, len(shapes))
    found, failures = _smallest(bench, shapes, len(listed), workers, steps)
    failures = [*((family.label, why) for family, why in every if why), *failures]
    shown = [each for each in found if each.shows]
    steps.begin("telling effects apart", len(multiples) * len(shown))
    by_multiple: dict[float, tuple[Truths, list[tuple[int, int]], list[tuple[int, int, int]]]] = {}
    first_fits = Odds(np.zeros((0, 0)), np.zeros((0, 0)), {})
    for k, multiple in enumerate(multiples):
        told = truths(bench, shown, multiple, workers, steps.done, further=k == 0)
        fits = odds(bench, told, workers)
        by_multiple[multiple] = (told, ties(told, fits), list(pairs_of_effects(bench, told, fits)))
        first_fits = fits if k == 0 else first_fits
    told, tied, _ = by_multiple[multiples[0]]
    added = sensors(planned, bench, told, first_fits, tied)
    steps.begin("trying other inputs", 1)
    tried = inputs(planned, bench, told, first_fits, tied, workers, steps.at)
    number = {id(each): k for k, each in enumerate(found, 1)}

    def numbered(told: Truths) -> dict[int, int]:
        return {k: number[id(each)] for k, each in enumerate(told.found)}

    first = numbered(told)
    rows = []
    for each in found:
        against: dict[float, tuple[int, ...]] = {}
        beside: dict[float, tuple[tuple[int, int], ...]] = {}
        for multiple, (there, open_, doubles) in by_multiple.items():
            names = numbered(there)
            mine = [k for k, one in enumerate(there.found) if one is each]
            against[multiple] = tuple(
                sorted({names[j if i in mine else i] for i, j in unordered(open_) if i in mine or j in mine})
            )
            beside[multiple] = tuple((names[a], names[b]) for i, a, b in doubles if i in mine)
        rows.append(_row(bench, each, number[id(each)], against, beside))
    counted = {m: rivals(there) for m, (there, _, _) in by_multiple.items()}
    pairs = {}
    for multiple, (there, open_, _) in by_multiple.items():
        names = numbered(there)
        pairs[multiple] = tuple(sorted((names[i], names[j]) for i, j in unordered(open_)))

    def renumbered(settles: Sequence[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
        return tuple((first[i], first[j]) for i, j in settles)

    return Plan(
        scenario,
        planned,
        tuple(rows),
        tuple(multiples),
        counted,
        pairs,
        tuple(Input(one.kind, one.sentence, renumbered(one.settles)) for one in tried),
        tuple(Further(one.sensor, renumbered(one.settles)) for one in added),
        len(planned.problem.model.inputs) == 1,
        tuple(failures),
    )


class _Steps:
    """What is done of how much, over all stages."""

    def __init__(self, progress: Progress | None, count: int) -> None:
        self._progress = progress
        self.begin("looking for the smallest sizes", count)

    def begin(self, what: str, count: int) -> None:
        """Begin a stage."""
        self._what, self._count, self._done = what, max(count, 1), 0

    def done(self) -> None:
        """One more is done."""
        self.at(self._done + 1, self._count)

    def at(self, done: int, count: int) -> None:
        """So many are done."""
        self._done = done
        if self._progress is not None:
            self._progress(self._what, done, count)


def first_options(listed: Sequence[Candidate]) -> list[Candidate]:
    """Each effect at each place as the scenario draws it: the first way to put it in."""
    found: dict[str, Candidate] = {}
    for candidate in listed:
        found.setdefault(candidate.key, candidate)
    return list(found.values())


def _unexcited(family: Family, scales: OperatingScales) -> str:
    """Why a wave of the angle cannot be told by this experiment; empty if it can.

    A ripple counts as one only where the shaft passes through at least one of its periods: else it is a polynomial.
    """
    order, place = family.base.get("order"), family.candidate.place
    group = next((g for g, members in scales.groups.items() if place in members), None)
    if order is None or group is None:
        return ""
    turned = scales.angle[group] * scales.ratio(group, place)
    if order * turned >= 2 * math.pi:
        return ""
    return f"the shaft turns by {turned:.2g} rad, less than one of its periods"


def _smallest(
    bench: Bench, shapes: Sequence[Family], tried: int, workers: int, steps: _Steps
) -> tuple[list[Smallest], list[tuple[str, str]]]:
    """The smallest size of each effect, and what could not be tried."""

    def one(family: Family) -> Smallest | tuple[str, str]:
        try:
            return smallest(bench, family, tried)
        except FlexarmError as error:
            return family.label, error.message

    found, failures = [], []
    with Spread(workers, threads=True) as pool:
        for made in pool.map(one, shapes):
            steps.done()
            if isinstance(made, Smallest):
                found.append(made)
            else:
                failures.append(made)
    return found, failures


def _row(
    bench: Bench,
    each: Smallest,
    number: int,
    ties: dict[float, tuple[int, ...]],
    pairs: dict[float, tuple[tuple[int, int], ...]],
) -> Row:
    family = each.family
    candidate = family.candidate
    size = family.told(each.size) if family.sized else None
    share, share_of = None, ""
    known = {p.name: p for p in candidate.parameters}
    if size is not None and family.lead in known and family.lead in SHARE_OF:
        share, share_of = size / abs(known[family.lead].reference), SHARE_OF[family.lead]
        if candidate.effect == "offset":
            share_of = "the largest input"
    return Row(
        number,
        candidate.effect,
        candidate.place,
        family.shape,
        each.shows,
        _name(family),
        size,
        _unit(bench, each) if size is not None else "",
        share,
        share_of,
        each.size / family.matters if family.sized else None,
        each.finest,
        ties,
        pairs,
    )


def _name(family: Family) -> str:
    """What the size is called."""
    if family.candidate.freed is not None:
        return family.lead.rpartition(".")[2]
    return NAMES.get(family.lead, family.lead) if family.candidate.effect != "saturation" else "limit"


def _unit(bench: Bench, each: Smallest) -> str:
    """Unit of the number that is told."""
    family = each.family
    if family.candidate.freed is not None or family.candidate.effect in NEAR_ONE:
        return "1"
    if family.lead == "corner_frequency":
        return "s"
    name = f"{family.candidate.name}.{family.lead}"
    made, _ = bench.model(family, each.size)
    units = {p.name: p.unit for p in made.model.parameters}
    return units.get(name) or next(p.unit for p in family.candidate.parameters if p.name == family.lead)


def rows_of(found: Plan, numbers: Sequence[int]) -> Iterator[Row]:
    """Rows by number."""
    for number in numbers:
        yield found.rows[number - 1]
