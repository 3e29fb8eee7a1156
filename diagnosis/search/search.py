"""Choosing what is missing: each candidate put in, refitted with equal care, and judged on data it has not seen."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.least_squares import Fit
from diagnosis.recordings.types import Recorded
from diagnosis.search.equivalent_effects import lookalike, same_laws
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.nonparametric import laws
from diagnosis.search.partial_fit import PartialFit, ended
from diagnosis.search.preference import (
    accounts_for_mismatch,
    better,
    choose,
    equally_good,
    missing,
    noise_floor,
    reaches_floor,
    unexplained,
    with_parameter_freed,
    worth_adding,
)
from diagnosis.search.promising_pairs import promising
from diagnosis.search.scored_model import ScoredModel, at_end
from diagnosis.search.study import Study
from diagnosis.search.wrong_parameters import pairs, suspects
from diagnosis.thresholds import EXCHANGE, INSERTION, PAIRS, PREFERENCE
from engine.errors import FlexarmError
from engine.spread import Spread

Progress = Callable[[str, int, int], None]


def study(
    fitter: CandidateFitter,
    *,
    most: int = 2,
    without: Sequence[str] = (),
    progress: Progress | None = None,
    told: Sequence[str] = (),
) -> Study:
    """Refit, try every candidate, then pairs with the best, and keep what pays on held-out data.

    Args:
        fitter: the user's model and the recordings, training and held-out, and where they are fitted.
        most: largest number of effects.
        without: effects that are not to be tried.
        progress: told what is done, how many of how many.
        told: what was done differently from what was asked, before.
    """
    if progress:
        progress("fitting the model's own parameters", 0, 1)
    refit, notes = fitter.refit(), list(told)
    swapped = None if notes else exchanged(fitter, refit)
    if swapped:
        fitter = fitter.again(swapped[0])
        refit, notes = fitter.refit(), [swapped[1]]
    base = fitter.base
    zero = np.zeros(len(base.free))
    before = (base.chi2(zero, base.training), base.chi2(zero, base.held_out))
    scales = operating_scales(base)
    scales.lines = lines(refit)
    listed = candidates(scales, without)
    trials, failures = _try_all(fitter, [(c,) for c in listed], refit.fit, progress)
    trials.sort(key=lambda t: (t.merit, t.size))
    chosen = choose(refit, trials)
    if most > 1 and unexplained(chosen, noise_floor(chosen)):
        suspected, found = suspects(fitter, listed, refit), list[ScoredModel]()
        for start, beside in pairs(fitter, suspected, trials):
            found += _try_all(fitter, beside, replace(start, cost=refit.fit.cost), progress)[0]
        found.sort(key=lambda t: (t.merit, t.size))
        chosen = with_parameter_freed(choose(chosen, found), found)
        notes += [s.told() for s in suspected if s.candidate.key in {c.key for c in chosen.effects}]
        trials += found
    lead = min(trials, key=lambda t: t.fit.chi2, default=refit)
    floor = noise_floor(lead)
    blind = lead.hold_out - floor > EXCHANGE.blind * floor
    if blind and not (notes or fitter.tables or reaches_floor(refit, chosen)):
        left = min(PREFERENCE.left_over * (refit.fit.chi2 - floor) / floor, PREFERENCE.left_at_most)
        swapped = exchanged(fitter, lead, max(PREFERENCE.fitted, left))
        if swapped:
            return study(fitter.again(swapped[0]), most=most, without=without, progress=progress, told=[swapped[1]])
    if most > 1 and len(chosen.effects) <= 1 and unexplained(chosen, noise_floor(chosen)):
        chosen, tried = _second(fitter, refit, chosen, [t for t in trials if len(t.effects) == 1], progress)
        trials += tried
    chosen = fitter.polish(chosen)
    pair = lookalike(chosen, trials)
    for made in (fitter.polish(t) for t in _try_all(fitter, [pair] if pair else [], refit.fit, progress)[0]):
        trials.append(made)
        simpler = made.size <= chosen.size and made.hold_out < chosen.hold_out and better(made, chosen)
        if simpler or (at_end(chosen) and made in equally_good(chosen, [made], refit)):
            chosen = made
    twins = same_laws(chosen, listed)
    alike = [{c.key for c in twin} for twin in twins]
    trials = [t for t in trials if {c.key for c in t.effects} not in alike]
    trials += [fitter.polish(t) for t in _try_all(fitter, twins, chosen.fit, progress)[0]]
    whole = Study(
        fitter.scenario, fitter.recordings, before, refit, tuple(trials), chosen, scales, tuple(failures), tuple(notes)
    )
    return whole if accounts_for_mismatch(whole.recordings, refit, chosen) else _unnamed(fitter, whole, progress)


def _unnamed(fitter: CandidateFitter, done: Study, progress: Progress | None) -> Study:
    """The study with a nonparametric law where no effect of the catalogue accounts for the mismatch.

    Where the mismatch is small, nothing is missing, and the refit is chosen.
    """
    refit = done.refit
    if not unexplained(refit, noise_floor(refit)):
        return done
    if not missing(refit):
        return replace(done, chosen=refit)
    curves = [(c,) for c in laws(replace(done, chosen=refit))]
    found, _ = _try_all(fitter, curves, refit.fit, progress)
    found = [t for t in sorted(found, key=lambda t: t.merit) if worth_adding(t, done.chosen)]
    if not found:
        return done
    return replace(done, chosen=min(fitter.polish(found[0]), found[0], key=lambda t: t.hold_out))


def exchanged(
    fitter: CandidateFitter, refit: ScoredModel, slack: float = PREFERENCE.fitted
) -> tuple[list[Recorded], str] | None:
    """The recordings with the worst held-out one moved to training, where only held-out data show a mismatch.

    An effect that no training recording excites cannot be fitted, such as an amplifier that saturates in the held-out
    recordings alone. Where one recording alone shows it, it is fitted in part and judged in part.

    Args:
        fitter: of the study.
        refit: a model that explains the training recordings.
        slack: share above the floor within which they count as explained.
    """
    base, floor = fitter.base, noise_floor(refit)
    held = base.held_out
    if len(held) < 2 or refit.fit.chi2 - floor > slack * floor or refit.hold_out - floor < EXCHANGE.unseen * floor:
        return None
    model = refit.fit.problem
    errors = {e.name: model.chi2(refit.fit.x, [e]) for e in held}
    worst = max(held, key=lambda e: errors[e.name])
    told = f"'{worst.name}' shows a mismatch that the training recordings do not show: "
    if any(error - floor > EXCHANGE.unseen * floor for name, error in errors.items() if name != worst.name):
        moved = [replace(r, role="train") if r.name == worst.name else r for r in fitter.recordings]
        return moved, told + "it was fitted too, and the rest is held out"
    rows = [r for r in fitter.recordings if r.name != worst.name]
    parts = next(r for r in fitter.recordings if r.name == worst.name).split(EXCHANGE.part)
    if parts is None:
        return None
    return [*rows, *parts], told + f"of it, every other {EXCHANGE.part:g} s was fitted and the rest held out"


def lines(refit: ScoredModel) -> list[float]:
    """Frequencies (rad/s) that stand out in what the refitted model leaves over of the training recordings."""
    problem, found = refit.fit.problem, dict[float, float]()
    for e in problem.training:
        found |= e.lines(problem.residual(refit.fit.x, e), INSERTION.lines)
    return sorted(found, key=lambda w: -found[w])[: INSERTION.lines]


def _second(
    fitter: CandidateFitter,
    refit: ScoredModel,
    chosen: ScoredModel,
    singles: Sequence[ScoredModel],
    progress: Progress | None,
) -> tuple[ScoredModel, list[ScoredModel]]:
    """The best pair if it pays, and all pairs tried: what looks best together, what leads, then each half exchanged.

    Two effects that are missing may hide each other, so that neither pays alone: all pairs are looked at together
    first. Where none of them reaches the floor, a second effect is sought beside the best, and beside the one that the
    fitted recordings ask for most.
    """
    tried: list[ScoredModel] = []
    if not fitter.tables:
        together = promising(fitter, refit, [t.effects[0] for t in singles], PAIRS.together)
        tried = _try_all(fitter, together, refit.fit, progress)[0]
        tried.sort(key=lambda t: (t.merit, t.size))
    if not (tried and _settled(refit, tried[0])):
        for k, leader in enumerate(_leaders(fitter, chosen, singles)):
            others = singles if k == 0 else singles[: PAIRS.seconds]
            tried += _beside(fitter, leader, leader.effects[0], others, tried, progress)
    tried.sort(key=lambda t: (t.merit, t.size))
    left = chosen.hold_out - noise_floor(chosen)
    if not tried or not (worth_adding(tried[0], chosen) or chosen.hold_out - tried[0].hold_out > PAIRS.swaps * left):
        return chosen, tried
    for _ in range(PAIRS.rounds):
        best, nearest = tried[0], min(tried, key=lambda t: t.fit.cost)
        for pair in [best] if best is nearest or _settled(refit, best) else [best, nearest]:
            tried += _around(fitter, refit, pair, singles, tried, progress)
        tried.sort(key=lambda t: (t.merit, t.size))
        if not worth_adding(tried[0], chosen):
            return chosen, tried
        if tried[0] is best:
            break
    best = choose(chosen, tried)
    # One of the two may only have helped the other out of a local optimum.
    alone: list[ScoredModel] = []
    for effect in best.effects if len(best.effects) > 1 else ():
        with contextlib.suppress(FlexarmError):
            alone.append(fitter.reduced(best, effect))
    alone.sort(key=lambda t: t.merit)
    if not alone or worth_adding(best, alone[0]):
        return best, [*alone, *tried]
    # Then it is the model's own parameters that were helped, and the other effects are fitted from there as well.
    known = alone[0].effects[0].key
    again = [(t.effects[0],) for t in singles[: PAIRS.seconds] if t.effects[0].key != known]
    alone += _try_all(fitter, again, alone[0].fit, progress)[0]
    alone.sort(key=lambda t: (t.merit, t.size))
    return choose(refit, alone), [*alone, *tried]


def _settled(refit: ScoredModel, pair: ScoredModel) -> bool:
    """Whether a pair leaves nothing to look for."""
    return reaches_floor(refit, pair) and not unexplained(pair, noise_floor(pair))


def _leaders(fitter: CandidateFitter, chosen: ScoredModel, singles: Sequence[ScoredModel]) -> list[ScoredModel]:
    """The single effects beside which a second one is sought."""
    leaders: list[ScoredModel] = []
    wished = [*([chosen] if chosen.effects else []), *sorted(singles, key=lambda t: t.fit.cost)[:1], *singles]
    for t in wished:
        known = {c.effect for leader in leaders for c in leader.effects}
        if (
            len(leaders) < (PAIRS.leaders_at_tables if fitter.tables else PAIRS.leaders)
            and t.effects[0].effect not in known
        ):
            leaders.append(t)
    return leaders


def _beside(
    fitter: CandidateFitter,
    start: ScoredModel,
    kept: Candidate,
    singles: Sequence[ScoredModel],
    done: Sequence[ScoredModel],
    progress: Progress | None,
    finish_at_most: int = INSERTION.finished,
) -> list[ScoredModel]:
    """One effect kept, every other one beside it."""
    known = {frozenset(c.key for c in t.effects) for t in done}
    others = [t for t in singles if t.effects[0].effect != kept.effect and len(t.effects) == 1]
    others = [t for t in others if frozenset((kept.key, t.effects[0].key)) not in known]
    # It goes on from where it ended, so that no pair ends worse than what it began with.
    begun = ended(start, kept) if kept in start.effects else kept
    wanted = [(begun, t.effects[0]) for t in others]
    if fitter.tables:
        wanted = [(begun, ended(t, t.effects[0])) for t in others[: PAIRS.seconds_at_tables]]
    return _try_all(fitter, wanted, start.fit, progress, finish_at_most)[0]


def _around(
    fitter: CandidateFitter,
    refit: ScoredModel,
    pair: ScoredModel,
    singles: Sequence[ScoredModel],
    done: Sequence[ScoredModel],
    progress: Progress | None,
) -> list[ScoredModel]:
    """A pair with each half exchanged: for what acts at its place, for what does best alone, for itself elsewhere.

    Beside another effect a wide law may be a narrow one, and alone other places may have looked poor.
    """
    found: list[ScoredModel] = []
    # Pairs with a higher cost may sit in a local optimum, and are tried again from here.
    known = [t for t in done if t.fit.cost <= pair.fit.cost]
    begun = replace(pair, fit=replace(pair.fit, cost=refit.fit.cost))  # what they gain is counted from there
    for kept, moved in (pair.effects, pair.effects[::-1]):
        alike = [t for t in singles if moved.place == t.effects[0].place or moved.effect == t.effects[0].effect]
        others = [*([] if fitter.tables else alike), *singles[: PAIRS.seconds]]
        unlike = list({id(t): t for t in others}.values())
        found += _beside(fitter, begun, kept, unlike, [*known, *found], progress, PAIRS.exchanged)
    return found


def _try_all(
    fitter: CandidateFitter,
    combinations: Sequence[tuple[Candidate, ...]],
    start: Fit,
    progress: Progress | None,
    finish_at_most: int = INSERTION.finished,
) -> tuple[list[ScoredModel], list[tuple[str, str]]]:
    partials: list[PartialFit] = []
    failures: list[tuple[str, str]] = []

    def one(effects: tuple[Candidate, ...]) -> PartialFit | tuple[str, str]:
        try:
            return fitter.partial_fit(effects, start)
        except FlexarmError as error:
            return effects[-1].key, error.message

    with Spread(fitter.workers, threads=True) as pool:
        for done, found in enumerate(pool.map(one, combinations), 1):
            if isinstance(found, PartialFit):
                partials.append(found)
            else:
                failures.append(found)
            if progress:
                progress("trying effects", done, len(combinations))
        partials.sort(key=lambda partial: partial.point.cost)
        best = start.cost - partials[0].point.cost if partials else 0.0
        worth_finishing = [
            d for d in partials[:finish_at_most] if start.cost - d.point.cost > INSERTION.promising * best
        ]
        left = [INSERTION.most_steps if k < len(worth_finishing) else 0 for k in range(len(partials))]
        trials = []
        tasks = zip(partials, left, strict=True)
        for done, trial in enumerate(pool.map(lambda task: fitter.finish(*task), tasks), 1):
            trials.append(trial)
            if progress:
                progress("fitting the promising ones", done, len(partials))
    return trials, failures
