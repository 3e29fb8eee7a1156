"""What would settle ties: one further sensor, or one further input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.planning.distinguish import Odds, Truths, turns, unordered
from diagnosis.planning.experiment import Planned, Sensor
from diagnosis.planning.reach import Bands, Bench, Course, answer, background, fitted
from diagnosis.planning.smallest import DECISIVE
from diagnosis.thresholds import NEXT_EXPERIMENT
from diagnosis.verdict.experiment_design import menu
from engine.errors import FlexarmError
from engine.simulate import Drive
from engine.spread import Spread

Pair = tuple[int, int]


@dataclass(frozen=True)
class Further:
    """A sensor that is added.

    Attributes:
        sensor: which.
        settles: the pairs that it tells apart, as places among the truths.
    """

    sensor: Sensor
    settles: tuple[Pair, ...]


@dataclass(frozen=True)
class Input:
    """An input of the menu, run besides the planned experiment.

    Attributes:
        kind, sentence: name in the menu, and what to do.
        settles: the pairs that it tells apart.
    """

    kind: str
    sentence: str
    settles: tuple[Pair, ...]


def sensors(planned: Planned, bench: Bench, told: Truths, found: Odds, tied: Sequence[Pair]) -> list[Further]:
    """Every sensor that could be added, with the ties that it settles; those that settle most first.

    Args:
        planned: the experiment, with the sensors that could be added.
        bench: it.
        told: the effects, with courses of further sensors.
        found: how well they fit.
        tied: pairs (truth, rival) that tie.
    """
    open_: list[set[Pair]] = [set() for _ in planned.further]
    own = {i: _with_each(bench, told.forms[i], told.courses[i], found.background[:, [i]]) for i, _ in tied}
    for i, j in tied:
        forms = _forms(told, found, i, j)
        fits = _with_each(bench, forms, told.courses[i], found.background[:, [i]])
        for k in np.flatnonzero(fits > own[i] - DECISIVE):
            open_[k].add((min(i, j), max(i, j)))
    before = unordered(tied)
    rows = [Further(s, tuple(sorted(before - left))) for s, left in zip(planned.further, open_, strict=True)]
    return sorted(rows, key=lambda row: -len(row.settles))


def _forms(told: Truths, found: Odds, i: int, j: int) -> tuple[Course, ...]:
    """The courses of a rival around which it is fitted to a truth."""
    close = found.close.get((i, j))
    return told.forms[j] if close is None else (close,)


def _with_each(bench: Bench, forms: Sequence[Course], truth: Course, background: Array) -> Array:
    """How well a rival fits a truth, with each of the further sensors, shape (sensors,)."""
    made = []
    for rival in forms:
        rows = []
        for y, J in zip(truth.further - rival.further, rival.further_slopes, strict=True):
            fits = answer(rival, [truth], J.T @ J, (J.T @ y)[:, None])
            left = float(np.sum((y - J @ fits.change[:, 0]) ** 2))
            rows.append(float(fitted(bench.bands, fits, background)[0]) - 0.5 * left)
        made.append(rows)
    return np.asarray(np.max(made, axis=0))


def inputs(
    planned: Planned,
    bench: Bench,
    told: Truths,
    found: Odds,
    tied: Sequence[Pair],
    workers: int,
    done: Callable[[int, int], None],
) -> list[Input]:
    """Every input of the menu, with the ties that it settles when it is run besides; those that settle most first.

    Empty where not one single input is driven.

    Args:
        planned: the experiment.
        bench: it.
        told: the effects.
        found: how well they fit.
        tied: pairs (truth, rival) that tie.
        workers: threads.
        done: told how many inputs of how many were looked at.
    """
    first = over_time(planned.problem.experiments)[0]
    if first.drive is None or len(planned.problem.model.inputs) != 1 or not tied:
        return []
    size = max(
        float(np.abs(np.asarray(e.drive.values)).max())
        for e in over_time(planned.problem.experiments)
        if e.drive is not None
    )
    rows = []
    listed = menu(size, first.shortest)
    before = unordered(tied)
    for number, (kind, (sentence, time, drive)) in enumerate(listed.items()):
        done(number, len(listed))
        try:
            there = Bench(planned, _driven(planned.wide, first, time, drive))
        except FlexarmError:
            continue

        def joined(pair: Pair, there: Bench = there) -> list[Course]:
            """A rival in both experiments; as its own rival, the truth."""
            i, j = pair
            family, size = told.found[j].family, told.sizes[j]
            forms = _forms(told, found, i, j) if i != j else told.forms[j]
            families = turns(family) if len(forms) > 1 else [family]
            try:
                pairs = zip(families, forms, strict=True)
                return [_joined(course, there.at(one, size, course)) for one, course in pairs]
            except FlexarmError:
                return []

        wanted = [*dict.fromkeys((i, i) for i, _ in tied), *tied]
        with Spread(workers, threads=True) as pool:
            courses = dict(zip(wanted, pool.map(joined, wanted), strict=True))
        bands = bench.bands + there.bands
        left = set()
        for i, j in tied:
            truth, rival = courses[i, i], courses[i, j]
            if truth and rival:
                behind = background(bands, _joined(bench.nominal, there.nominal), truth[:1])
                own = _best(bands, truth[:1], truth[0], behind)
                if _best(bands, rival, truth[0], behind) <= own - DECISIVE:
                    continue
            left.add((min(i, j), max(i, j)))
        rows.append(Input(kind, sentence, tuple(sorted(before - left))))
    return sorted(rows, key=lambda row: -len(row.settles))


def _best(bands: Bands, forms: Sequence[Course], truth: Course, background: Array) -> float:
    """How well a rival fits a truth."""
    return max(float(fitted(bands, answer(form, [truth]), background)[0]) for form in forms)


def _driven(problem: Problem, like: TimeExperiment, time: Array, drive: Array) -> Problem:
    """The problem with one run from rest under another input, read at the instants at which the sensors are."""
    every = max(1, round(like.shortest / NEXT_EXPERIMENT.step))
    step = like.shortest / every
    count = int(time[-1] / like.shortest + 1e-6)
    rows = like.shortest * np.arange(count + 1, dtype=float)
    wide = over_time(problem.experiments)[0]
    silent = np.zeros((len(rows), len(wide.sigma)))
    made = TimeExperiment(
        name="next",
        role="train",
        time=rows,
        step=step,
        every=every,
        drive=Drive(time, drive[:, None]),
        measured=silent,
        sigma=wide.sigma,
        from_first=wide.from_first,
    )
    posed = replace(problem, experiments=(made,))
    does = made.sampled(posed.simulate(np.zeros(len(posed.free)), made))
    does = does - np.where(made.from_first, does[0], 0.0)
    return replace(posed, experiments=(replace(made, measured=does),))


def _joined(planned: Course, further: Course) -> Course:
    """An effect in the planned experiment and in another one; parameters that the other does not have are nothing."""
    places = [(f.name, f.recording) for f in further.free]
    slopes = np.zeros((len(further.values), len(planned.free)))
    for i, f in enumerate(planned.free):
        if (f.name, f.recording) in places:
            slopes[:, i] = further.slopes[:, places.index((f.name, f.recording))]
    return replace(
        planned,
        values=np.concatenate([planned.values, further.values]),
        slopes=np.vstack([planned.slopes, slopes]),
    )
