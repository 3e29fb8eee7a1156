"""Choosing what is missing: each candidate put in, refitted with equal care, and judged on data it has not seen."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import Surroundings, surroundings
from diagnosis.estimation.least_squares import Fit
from diagnosis.estimation.problem import Array
from diagnosis.recordings.mapping import Channel, Recorded, Recording
from diagnosis.search.equivalent_effects import lookalike, same_laws
from diagnosis.search.fitter import MOST, Workshop
from diagnosis.search.nonparametric import laws
from diagnosis.search.partial_fit import Draft, ended
from diagnosis.search.preference import (
    AT_MOST,
    FITTED,
    LEFT_OVER,
    accounted,
    better,
    choose,
    floor,
    missing,
    near,
    pays,
    reached,
    relieved,
    unexplained,
)
from diagnosis.search.promising_pairs import promising
from diagnosis.search.scored_model import Trial, at_end
from diagnosis.search.wrong_parameters import pairs, suspects
from engine.errors import FlexarmError
from engine.spread import Spread
from scenarios.load import Scenario

FINISHED, PROMISING, EXCHANGED = 15, 0.2, 6
"""At most so many effects are fitted to the end, of those that gained this share of what the best gained; of those that
take the place of half a pair, so many."""

SECONDS, LEADERS = 12, 2
"""A second effect is sought among all others beside the first of so many leaders, among so many beside the rest."""

SECONDS_AT_TABLES, LEADERS_AT_TABLES = 3, 1
"""The same for tables, which are dear to simulate for the few numbers they give."""

TOGETHER, ROUNDS = 20, 2
"""So many pairs are fitted that look best taken together, and halves are exchanged so often at most."""

SWAPS = 0.2
"""Share of the held-out excess that the best pair must take away for its halves to be exchanged."""

BLIND = 5.0
"""Held-out excess, in floors, that calls for another recording to be fitted where one effect brings the fitted ones to
the floor."""

UNSEEN = 0.5
"""Held-out excess, in floors, that calls for another recording to be fitted where the fitted ones are at the floor."""

PART = 0.5
"""Length (s) of the parts into which a recording is cut that alone shows a mismatch."""

LINES = 3
"""How many frequencies of what is left over are tried as a vibration from outside."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Study:
    """A scenario and its recordings, and everything tried on them.

    Attributes:
        scenario: the user's.
        recordings: of all roles.
        nominal: mean squared residual of the model as given, (train, hold-out).
        refit: the user's model with its parameters fitted.
        trials: single effects, best first, and pairs that may be taken for the chosen one.
        chosen: the best model found, of one or more effects, or the refit.
        around: sizes at the places.
        failures: candidates that could not be built, with the reason.
        notes: what was done differently from what was asked, in sentences.
    """

    scenario: Scenario
    recordings: tuple[Recorded, ...]
    nominal: tuple[float, float]
    refit: Trial
    trials: tuple[Trial, ...]
    chosen: Trial
    around: Surroundings
    failures: tuple[tuple[str, str], ...]
    notes: tuple[str, ...] = ()


def study(
    shop: Workshop,
    *,
    most: int = 2,
    without: Sequence[str] = (),
    progress: Progress | None = None,
    told: Sequence[str] = (),
) -> Study:
    """Refit, try every candidate, then pairs with the best, and keep what pays on held-out data.

    Args:
        shop: the user's model and the recordings, training and held-out, and where they are fitted.
        most: at most so many effects.
        without: effects that are not to be tried.
        progress: told what is done, how many of how many.
        told: what was done differently from what was asked, before.
    """
    if progress:
        progress("fitting the model's own parameters", 0, 1)
    refit, notes = shop.refit(), list(told)
    swapped = None if notes else exchanged(shop, refit)
    if swapped:
        shop = shop.again(swapped[0])
        refit, notes = shop.refit(), [swapped[1]]
    base = shop.base
    zero = np.zeros(len(base.free))
    nominal = Fit(base, zero, 0.0, 0.0, True, np.zeros((len(zero), len(zero))))
    before = (nominal.score(base.chosen("train", "repeat")), nominal.score(base.chosen("hold_out")))
    around = surroundings(base)
    around.lines = lines(refit)
    listed = [c for c in candidates(around) if c.effect not in without]
    trials, failures = _try_all(shop, [(c,) for c in listed], refit.fit, progress)
    trials.sort(key=lambda t: (t.merit, t.size))
    chosen = choose(refit, trials)
    if most > 1 and unexplained(chosen, floor(chosen)):
        suspected, found = suspects(shop, listed, refit), list[Trial]()
        for start, beside in pairs(shop, suspected, trials):
            found += _try_all(shop, beside, replace(start, cost=refit.fit.cost), progress)[0]
        found.sort(key=lambda t: (t.merit, t.size))
        chosen = relieved(choose(chosen, found), found)
        notes += [s.told() for s in suspected if s.candidate.key in {c.key for c in chosen.effects}]
        trials += found
    lead = min(trials, key=lambda t: t.fit.chi2, default=refit)
    if not (notes or shop.tables or reached(refit, chosen)) and lead.hold_out - floor(lead) > BLIND * floor(lead):
        ground = floor(lead)
        swapped = exchanged(shop, lead, max(FITTED, min(LEFT_OVER * (refit.fit.chi2 - ground) / ground, AT_MOST)))
        if swapped:
            return study(shop.again(swapped[0]), most=most, without=without, progress=progress, told=[swapped[1]])
    if most > 1 and len(chosen.effects) <= 1 and unexplained(chosen, floor(chosen)):
        chosen, tried = _second(shop, refit, chosen, [t for t in trials if len(t.effects) == 1], progress)
        trials += tried
    chosen = shop.polish(chosen)
    pair = lookalike(chosen, trials)
    for made in (shop.polish(t) for t in _try_all(shop, [pair] if pair else [], refit.fit, progress)[0]):
        trials.append(made)
        simpler = made.size <= chosen.size and made.hold_out < chosen.hold_out and better(made, chosen)
        if simpler or (at_end(chosen) and made in near(chosen, [made], refit)):
            chosen = made
    twins = same_laws(chosen, listed)
    alike = [{c.key for c in twin} for twin in twins]
    trials = [t for t in trials if {c.key for c in t.effects} not in alike]
    trials += [shop.polish(t) for t in _try_all(shop, twins, chosen.fit, progress)[0]]
    whole = Study(
        shop.scenario, shop.recordings, before, refit, tuple(trials), chosen, around, tuple(failures), tuple(notes)
    )
    return whole if accounted(whole.recordings, refit, chosen) else _unnamed(shop, whole, progress)


def _unnamed(shop: Workshop, study: Study, progress: Progress | None) -> Study:
    """The study with a law without a name, where none with a name accounts for what the refit leaves over.

    If that is little, nothing is.
    """
    refit = study.refit
    if not unexplained(refit, floor(refit)):
        return study
    if not missing(refit):
        return replace(study, chosen=refit)
    curves = [(c,) for c in laws(replace(study, chosen=refit))]
    found, _ = _try_all(shop, curves, refit.fit, progress)
    found = [t for t in sorted(found, key=lambda t: t.merit) if pays(t, study.chosen)]
    if not found:
        return study
    return replace(study, chosen=min(shop.polish(found[0]), found[0], key=lambda t: t.hold_out))


def exchanged(shop: Workshop, refit: Trial, slack: float = FITTED) -> tuple[list[Recorded], str] | None:
    """The recordings with the worst held-out one fitted in place of none, where only held-out data show a mismatch.

    What no recording to fit shows cannot be fitted: an amplifier that saturates in the held-out recordings alone. Where
    a single recording shows it, that one is fitted in part and judged in part, for the others could not judge.

    Args:
        shop: of the study.
        refit: a model that brings the fitted recordings to the floor, or to this share above it:
        slack: share.
    """
    base, ground = shop.base, floor(refit)
    held = base.chosen("hold_out")
    if len(held) < 2 or refit.fit.chi2 - ground > slack * ground or refit.hold_out - ground < UNSEEN * ground:
        return None
    errors = {e.name: refit.fit.score([e]) for e in held}
    worst = max(held, key=lambda e: errors[e.name])
    told = f"what the recordings to fit show can be fitted, and what '{worst.name}' shows cannot: "
    if any(error - ground > UNSEEN * ground for name, error in errors.items() if name != worst.name):
        moved = [replace(r, role="train") if r.name == worst.name else r for r in shop.recordings]
        return moved, told + "it was fitted too, and the rest is held out"
    rows = [r for r in shop.recordings if r.name != worst.name]
    only = next(r for r in shop.recordings if r.name == worst.name)
    if not isinstance(only, Recording):
        return None
    fitted, judged = halves(only)
    return [*rows, fitted, judged], told + f"of it, every other {PART:g} s was fitted and the rest held out"


def halves(recording: Recording) -> tuple[Recording, Recording]:
    """A recording twice: with one part of its measurements, to fit, and with the other, to judge on."""
    mine = np.floor(np.asarray(recording.time) / PART).astype(int) % 2 == 0

    def only(keep: Array) -> tuple[Channel, ...]:
        return tuple(replace(c, values=np.where(keep, c.values, np.nan)) for c in recording.measurements)

    return (
        replace(recording, name=f"{recording.name} (fitted part)", role="train", measurements=only(mine)),
        replace(recording, name=f"{recording.name} (held-out part)", role="hold_out", measurements=only(~mine)),
    )


def lines(refit: Trial) -> list[float]:
    """Frequencies (rad/s) that stand out in what the refitted model leaves over of the training recordings."""
    problem = refit.fit.problem
    found: dict[float, float] = {}
    for e in problem.chosen("train", "repeat"):
        if len(e.time) < 64:
            return []
        r = problem.residual(refit.fit.x, e)
        power = np.sum(np.abs(np.fft.rfft((r - r.mean(axis=0)) * np.hanning(len(r))[:, None], axis=0)) ** 2, axis=1)
        rate = 2 * math.pi / float(e.time[-1] - e.time[0])
        peaks = [k for k in range(2, len(power) - 1) if power[k] == power[k - 2 : k + 3].max()]
        for k in sorted(peaks, key=lambda k: -power[k])[:LINES]:
            found[k * rate] = float(power[k])
    return sorted(found, key=lambda w: -found[w])[:LINES]


def _second(
    shop: Workshop, refit: Trial, chosen: Trial, singles: Sequence[Trial], progress: Progress | None
) -> tuple[Trial, list[Trial]]:
    """The best pair if it pays, and all pairs tried: what looks best together, what leads, then each half exchanged.

    Two effects that are missing may hide each other, so that neither pays alone: all pairs are looked at together
    first. Where none of them reaches the floor, a second effect is sought beside the best, and beside the one that the
    fitted recordings ask for most.
    """
    pairs: list[Trial] = []
    if not shop.tables:
        together = promising(shop, refit, [t.effects[0] for t in singles], TOGETHER)
        pairs = _try_all(shop, together, refit.fit, progress)[0]
        pairs.sort(key=lambda t: (t.merit, t.size))
    if not (pairs and _settled(refit, pairs[0])):
        for k, leader in enumerate(_leaders(shop, chosen, singles)):
            others = singles if k == 0 else singles[:SECONDS]
            pairs += _beside(shop, leader, leader.effects[0], others, pairs, progress)
    pairs.sort(key=lambda t: (t.merit, t.size))
    left = chosen.hold_out - floor(chosen)
    if not pairs or not (pays(pairs[0], chosen) or chosen.hold_out - pairs[0].hold_out > SWAPS * left):
        return chosen, pairs
    for _ in range(ROUNDS):
        best, nearest = pairs[0], min(pairs, key=lambda t: t.fit.cost)
        for pair in [best] if best is nearest or _settled(refit, best) else [best, nearest]:
            pairs += _around(shop, refit, pair, singles, pairs, progress)
        pairs.sort(key=lambda t: (t.merit, t.size))
        if not pays(pairs[0], chosen):
            return chosen, pairs
        if pairs[0] is best:
            break
    best = choose(chosen, pairs)
    # One of the two may only have helped the other out of a local optimum.
    alone: list[Trial] = []
    for effect in best.effects if len(best.effects) > 1 else ():
        with contextlib.suppress(FlexarmError):
            alone.append(shop.reduced(best, effect))
    alone.sort(key=lambda t: t.merit)
    if not alone or pays(best, alone[0]):
        return best, [*alone, *pairs]
    # Then it is the model's own parameters that were helped, and the other effects are fitted from there as well.
    known = alone[0].effects[0].key
    again = [(t.effects[0],) for t in singles[:SECONDS] if t.effects[0].key != known]
    alone += _try_all(shop, again, alone[0].fit, progress)[0]
    alone.sort(key=lambda t: (t.merit, t.size))
    return choose(refit, alone), [*alone, *pairs]


def _settled(refit: Trial, pair: Trial) -> bool:
    """Whether a pair leaves nothing to look for."""
    return reached(refit, pair) and not unexplained(pair, floor(pair))


def _leaders(shop: Workshop, chosen: Trial, singles: Sequence[Trial]) -> list[Trial]:
    """The single effects beside which a second one is sought."""
    leaders: list[Trial] = []
    wished = [*([chosen] if chosen.effects else []), *sorted(singles, key=lambda t: t.fit.cost)[:1], *singles]
    for t in wished:
        known = {c.effect for leader in leaders for c in leader.effects}
        if len(leaders) < (LEADERS_AT_TABLES if shop.tables else LEADERS) and t.effects[0].effect not in known:
            leaders.append(t)
    return leaders


def _beside(
    shop: Workshop,
    start: Trial,
    kept: Candidate,
    singles: Sequence[Trial],
    done: Sequence[Trial],
    progress: Progress | None,
    finished: int = FINISHED,
) -> list[Trial]:
    """One effect kept, every other one beside it."""
    known = {frozenset(c.key for c in t.effects) for t in done}
    others = [t for t in singles if t.effects[0].effect != kept.effect and len(t.effects) == 1]
    others = [t for t in others if frozenset((kept.key, t.effects[0].key)) not in known]
    # It goes on from where it ended, so that no pair ends worse than what it began with.
    begun = ended(start, kept) if kept in start.effects else kept
    wanted = [(begun, t.effects[0]) for t in others]
    if shop.tables:
        wanted = [(begun, ended(t, t.effects[0])) for t in others[:SECONDS_AT_TABLES]]
    return _try_all(shop, wanted, start.fit, progress, finished)[0]


def _around(
    shop: Workshop,
    refit: Trial,
    pair: Trial,
    singles: Sequence[Trial],
    done: Sequence[Trial],
    progress: Progress | None,
) -> list[Trial]:
    """A pair with each half exchanged: for what acts at its place, for what does best alone, for itself elsewhere.

    Beside another effect a wide law may be a narrow one, and alone other places may have looked poor.
    """
    found: list[Trial] = []
    # What ended above it may have been in a local optimum, and is tried again from here.
    known = [t for t in done if t.fit.cost <= pair.fit.cost]
    begun = replace(pair, fit=replace(pair.fit, cost=refit.fit.cost))  # what they gain is counted from there
    for kept, moved in (pair.effects, pair.effects[::-1]):
        alike = [t for t in singles if moved.place == t.effects[0].place or moved.effect == t.effects[0].effect]
        others = [*([] if shop.tables else alike), *singles[:SECONDS]]
        unlike = list({id(t): t for t in others}.values())
        found += _beside(shop, begun, kept, unlike, [*known, *found], progress, EXCHANGED)
    return found


def _try_all(
    shop: Workshop,
    combinations: Sequence[tuple[Candidate, ...]],
    start: Fit,
    progress: Progress | None,
    finished: int = FINISHED,
) -> tuple[list[Trial], list[tuple[str, str]]]:
    drafts: list[Draft] = []
    failures: list[tuple[str, str]] = []

    def one(effects: tuple[Candidate, ...]) -> Draft | tuple[str, str]:
        try:
            return shop.draft(effects, start)
        except FlexarmError as error:
            return effects[-1].key, error.message

    with Spread(shop.workers, threads=True) as pool:
        for done, found in enumerate(pool.map(one, combinations), 1):
            if isinstance(found, Draft):
                drafts.append(found)
            else:
                failures.append(found)
            if progress:
                progress("trying effects", done, len(combinations))
        drafts.sort(key=lambda draft: draft.entry.cost)
        best = start.cost - drafts[0].entry.cost if drafts else 0.0
        promising = [d for d in drafts[:finished] if start.cost - d.entry.cost > PROMISING * best]
        left = [MOST if k < len(promising) else 0 for k in range(len(drafts))]
        trials = []
        tasks = zip(drafts, left, strict=True)
        for done, trial in enumerate(pool.map(lambda task: shop.finish(*task), tasks), 1):
            trials.append(trial)
            if progress:
                progress("fitting the promising ones", done, len(drafts))
    return trials, failures
