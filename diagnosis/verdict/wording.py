"""What a verdict says: effects in words, a sentence for each finding, and what makes it less sure."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from diagnosis.effects.effect import Candidate
from diagnosis.estimation.least_squares import Fit
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.search.posterior import floor, may_imitate, strained
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import Study
from diagnosis.thresholds import WORDING
from diagnosis.verdict.table_report import absorbed, remarks

WORDS = {
    "rate_limit": "a rate limit",
    "command_quantisation": "steps of the command",
    "supply_sag": "a supply that sags",
    "dead_time": "a dead time of the amplifier",
    "belt_slack": "slack of the belt",
    "end_stop": "an end stop",
    "warm_up": "warm-up of the winding",
    "friction_warm_up": "friction that falls as it warms up",
    "dead_zone": "a dead zone",
    "saturation": "saturation",
    "uneven_gain": "a gain that differs between the directions",
    "offset": "an offset",
    "lag": "a first-order lag",
    "delay": "a delay",
    "coulomb_friction": "Coulomb friction",
    "stribeck_friction": "Stribeck friction",
    "direction_dependent_friction": "friction that differs between the directions",
    "viscous_friction": "viscous friction",
    "quadratic_drag": "quadratic drag",
    "joint_flexibility": "a flexible joint",
    "one_sided_contact": "one-sided contact",
    "hardening_spring": "a hardening spring",
    "extra_mode": "a further bending mode",
    "torque_ripple": "torque ripple",
    "stray_spring": "a stray spring",
    "load_dependent_friction": "friction that grows with the load",
    "quadratic_load_friction": "friction that grows with the load and its square",
    "current_limit": "a limit of the current",
    "transmission_error": "a transmission error",
}

SCALES = {
    "degrees and radians": math.degrees(1),
    "thousands": 1000.0,
    "rpm and rad/s": 60 / math.tau,
    "turns and radians": math.tau,
    "inches and millimetres": 25.4,
}
"""Factors between units that are taken for one another."""


def name_of(effect: str) -> str:
    """An effect in words."""
    return WORDS.get(effect, effect.replace("_", " "))


def finding_sentence(
    found: Candidate,
    status: str,
    explained: float,
    study: Study,
    rivals: Sequence[ScoredModel],
    untold: Sequence[str] = (),
) -> str:
    """The finding as a sentence, with the held-out error before and after.

    Args:
        found: what was found.
        status: of the finding.
        explained: share of the held-out excess that it explains.
        study: what was tried.
        rivals: that the recordings cannot tell from it.
        untold: sizes that would tell it from a simpler law which was not tried, and that nothing bounds.
    """
    effect, place = found.effect, found.place + (f" ({found.option})" if found.option else "")
    what = name_of(effect)
    before, after = study.refit.hold_out, study.chosen.hold_out
    # Bent parameters may follow as closely: then what they return to speaks for the effect.
    falls = float(f"{after:.3g}") < float(f"{before:.3g}")
    numbers = f"the held-out error falls from {before:.3g} to {after:.3g} times the noise floor"
    if not falls:
        numbers = (
            f"parameters stay closer to their values, and the held-out error is {after:.3g} times the noise floor "
            f"({before:.3g} without)"
        )
    if status == "wrong_parameter" and not falls:
        return f"Parameter {place} lies outside its tolerance: with it freed, the others stay closer to their values."
    if status == "wrong_parameter":
        return f"Parameter {place} lies outside its tolerance: with it freed, {numbers}."
    if status == "tie":
        others = "; ".join(t.label for t in rivals[:8])
        left = f" {numbers.capitalize()}." if after > WORDING.left else ""
        return f"{what.capitalize()} at {place} explains {explained:.0%}, but these do as well: {others}.{left}"
    if effect == "unknown":
        return f"Something without a name is missing at {place}: with its measured law, a curve, {numbers}."
    if status == "unknown" and may_imitate(study.refit, study.chosen):
        return (
            f"Something is missing near {place}; the best effect, {what}, explains {explained:.0%} of it, and may only "
            f"imitate it: {numbers}."
        )
    if status == "unknown" and strained(study.chosen, study.tried):
        return (
            f"Something is missing near {place}. {what.capitalize()} would explain {explained:.0%}, but only with "
            f"parameters far from their values: {', '.join(_farthest(study.chosen.fit))}. If they may be that far off, "
            f"state their tolerances; a recording in another unit does this too."
        )
    if status == "unknown" and study.chosen.at_an_end:
        return (
            f"Something is missing near {place}. {what.capitalize()} would explain {explained:.0%}, but only with "
            f"{' and '.join(study.chosen.at_an_end)} at an end of its range, where it becomes another effect."
        )
    if status == "unknown" and untold:
        return (
            f"Something is missing near {place}. {what.capitalize()} would explain {explained:.0%}, but whatever its "
            f"{' and '.join(untold)}: a simpler law that was not tried may do as well."
        )
    if status == "unknown":
        return (
            f"{what.capitalize()} at {place} would explain {explained:.0%}, but a recording looks wrong: "
            f"see the warnings."
        )
    excess = before - floor(study.chosen)
    # Where a hair's breadth decides how a machine goes on, a run may come nearer than the right model does on average.
    share = f" ({min((before - after) / excess, 1.0):.0%} of what was unexplained)" if excess > 0 and falls else ""
    together = study.chosen.together
    further = f"; fitted to all recordings, it leaves {together:.3g} times" if 2 * together < after else ""
    return f"The model lacks {what} at {place}: with it, {numbers}{share}{further}."


def nothing_sentence(study: Study, status: str, near: Candidate | None) -> str:
    """What is said where nothing was found: nothing is missing, or nothing that has a name.

    Args:
        study: what was tried.
        status: ``none`` or ``unknown``.
        near: the effect that did best, if something is missing.
    """
    error = study.refit.hold_out
    if status == "none":
        return (
            f"Nothing is missing that these recordings show: with its parameters fitted within their tolerances the "
            f"model stands at {error:.2f} times the noise floor on held-out data, and no effect of the catalogue "
            f"accounts for more."
        )
    best = f"; the best, {name_of(near.effect)}, is at {near.place}" if near else ""
    return (
        f"Something is missing (held-out error {error:.1f} times the floor), but no effect of the catalogue accounts "
        f"for it{best}."
    )


def traits(trial: ScoredModel) -> tuple[str, str]:
    """When and at which frequency the residual of a model is large, in words."""
    problem = trial.fit.problem
    e = problem.judged[0]
    return e.where_residual_is_large(problem.residual(trial.fit.x, e), [v.name for v in problem.model.outputs])


def _farthest(made: Fit) -> list[str]:
    """The three parameters of the user's own that a fit has put farthest from their values, in tolerances."""
    own = [(abs(x), f.name) for f, x in zip(made.problem.free, made.x, strict=True) if f.prior and not f.recording]
    return [name for _, name in sorted(own, reverse=True)[:3]]


def warnings_of(study: Study) -> tuple[str, ...]:
    """What makes a verdict less sure, in sentences."""
    rows: list[str] = []
    problem = study.refit.fit.problem
    driven = [e for e in over_time(problem.training) if e.drive is not None]
    drives = [np.asarray(e.drive.values) for e in driven if e.drive is not None]
    one_way = bool(drives) and (all((d >= 0).all() for d in drives) or all((d <= 0).all() for d in drives))
    # A reference of a loop need not change its sign for the machine to turn back: then its command or speed does.
    if one_way and not any(_both_ways(e) for e in driven):
        rows.append(
            "the training recordings drive in one direction only: names given from one direction deserve distrust"
        )
    if drives and len({round(float(np.abs(d).max()), 6) for d in drives}) == 1 and len(drives) > 1:
        rows.append(
            "all training recordings have one amplitude: effects that depend on amplitude are hard to tell apart"
        )
    rows += remarks(problem) + absorbed(study) + _units(study)
    if not problem.held_out:
        rows.append("no recording was held out: gains are judged on the data that were fitted")
    if not study.refit.fit.converged:
        rows.append("the fit of the model's own parameters did not converge")
    if not study.chosen.fit.converged:
        rows.append("the fit of the chosen model did not converge")
    if far := study.chosen.far_off:
        rows.append(f"more than {WORDING.far:g} tolerances from the given value: {', '.join(far)}")
    return tuple(rows)


def _both_ways(e: TimeExperiment) -> bool:
    """Whether something that was measured is beyond the sensor's noise on either side of zero."""
    far = WORDING.seen * e.sigma
    return bool(((e.measured > far).any(axis=0) & (e.measured < -far).any(axis=0)).any())


def _units(study: Study) -> list[str]:
    """What a sensor's or input's scale that is near the factor between two units suggests."""
    rows = []
    for trial in (study.chosen, *study.trials[:1]):
        for key, value in trial.added().items():
            if key == "sensor_scale.gain" and value:
                off = {what: abs(abs(math.log(abs(value))) / math.log(factor) - 1) for what, factor in SCALES.items()}
                what = min(off, key=lambda k: off[k])
                if off[what] < WORDING.unit:
                    place = next((c.place for c in trial.effects), "")
                    rows.append(f"a scale of {value:.4g} at {place} is near that between {what}: is its unit right?")
    return list(dict.fromkeys(rows))
