"""What may be missing between a command and the drive that gets it: the fastest change that passes, and steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from diagnosis.effects.effect import ANY, NAME, Candidate, EffectParameter, Sizes, combinations, with_unit
from diagnosis.effects.insertion import in_signal
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales
from diagnosis.effects.step_heights import NEAR, heights
from diagnosis.estimation.time_experiment import TimeExperiment
from scenarios.amend import Edit, InSignal

TIMES = (2.0, 6.0, 20.0, 60.0, 200.0, 600.0)
"""Starting sizes of the time in which a limited command rises to its largest value, in samples."""

USUAL = 30.0
"""The same, of which nothing is known but that it is a time that matters."""

UNKNOWN = 3.0 * ANY
"""Standard deviation of the logarithm of a rate: drives differ by powers of ten."""

FOLLOWS = 0.25
"""Lag of a limited command while its limit does not act, in samples, of one that does not jump."""

MOST_STEPS = 2
"""Steps that are tried: each costs a model of its own."""


def at_command(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """A limit of the rate and steps of a command, in front of a driven input."""
    size, sample = place.size, scales.sample
    rates = combinations(rising=[size / (count * sample) for count in TIMES])
    rate = EffectParameter("rising", size / (USUAL * sample), usual=1.0, spread=UNKNOWN)
    unit = "*" if place.unit == "*" else f"({place.unit})/s" if "/" in place.unit else f"{place.unit or 1}/s"
    lag = {"held_input": True} if _held(scales, place) else {"time_constant": with_unit(FOLLOWS * sample, "s")}
    yield from in_signal(replace(place, unit=unit), "rate_limit", "RateLimiter", rates, rate, **lag)
    yield from _steps(scales, place)


def _held(scales: OperatingScales, place: Place) -> bool:
    """Whether an input was recorded as one that jumps and is constant in between."""
    names = [v.name for v in scales.problem.model.inputs]
    drives = [e.drive for e in scales.problem.training if isinstance(e, TimeExperiment) and e.drive is not None]
    if place.target not in names or not drives:
        return False
    number = names.index(place.target)
    return all(d.holds(len(names))[number] == "zero_order" for d in drives)


def _steps(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """Steps of a command, of heights that stand out in what is left over, if any do."""
    problem, size, name = scales.problem, place.size, f"{NAME}_command_quantisation"
    if place.target not in [v.name for v in problem.model.inputs]:
        return  # within a loop nothing was recorded
    found = heights(problem, scales.begun, place.target, size, MOST_STEPS, scales.residual)
    if not found:
        return

    def edits(values: Sizes) -> list[Edit]:
        return [InSignal(name, "Quantiser", place.target, {"step": with_unit(values["step"], place.unit)})]

    def finer(best: Sizes, share: float) -> Sizes | None:
        step = best["step"] + share * NEAR * best["step"] ** 2 / size
        return {"step": step} if step > 0 else None

    yield Candidate(
        "command_quantisation",
        place.name,
        place.block,
        name,
        edits,
        (EffectParameter("step", size, fixed=True, unit=place.unit),),
        combinations(step=found),
        finer=finer,
    )
