"""A missing law without a name: a curve against speed, angle or input, fitted like any other effect.

Where no effect of the catalogue accounts for a mismatch, the force recovered at the most likely places is written down
as straight lines through a few heights, and the heights are refitted. The curve is evidence and model at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from diagnosis.effects.effect import NAME, Candidate, EffectParameter, Sizes, with_unit
from diagnosis.search.force_recovery import Curve, place_of, recover
from diagnosis.search.study import Study
from diagnosis.thresholds import RECOVERY
from scenarios.amend import AtFlange, Edit, InSignal


def laws(study: Study) -> Iterator[Candidate]:
    """Curves at the places where effects of the catalogue did best.

    Args:
        study: whose chosen model is the refit, so that the force is what the user's model lacks.
    """
    places: list[tuple[str, str]] = []
    for trial in study.trials:
        found = place_of(trial.effects[0], study) if len(trial.effects) == 1 else ("", "")
        if found[0] and found not in places and found[0] not in study.scales.slides:
            places.append(found)
    for place, unit in places[: RECOVERY.places]:
        force = recover(study, place, unit)
        # A curve at an input depends on that input alone, one at a shaft on the shaft's own motion.
        own = [c for c in (force.curves if force else ()) if c.x_label.startswith(place)]
        for curve in own[: RECOVERY.curves]:
            yield _law(study, place, unit, curve)


def _law(study: Study, place: str, unit: str, curve: Curve) -> Candidate:
    lower, upper = curve.reach  # held beyond its ends, a curve that is too short bends the model's own parameters
    abscissas = np.linspace(lower, upper, RECOVERY.heights)
    heights = np.interp(abscissas, curve.x, curve.y)
    size = float(np.abs(heights).max()) or 1.0
    names = [f"heights[{k + 1}]" for k in range(RECOVERY.heights)]
    name, block = f"{NAME}_law", study.scenario.system.split(place)[0]
    point = place in study.scales.inputs

    def edits(values: Sizes) -> list[Edit]:
        rows = [with_unit(values[n], unit) for n in names]
        ends = {"lower": lower, "upper": upper}
        if point:
            given = {key: with_unit(value, curve.x_unit) for key, value in ends.items()}
            return [InSignal(name, "Curve", place, {"points": RECOVERY.heights, **given, "heights": rows})]
        of = "speed" if curve.x_label.endswith(".speed") else "angle"
        return [
            AtFlange(
                name, "TorqueCurve", place, "shaft", {"of": of, "points": RECOVERY.heights, **ends, "heights": rows}
            )
        ]

    before = [(), (), *itertools.pairwise(names)]
    parameters = tuple(
        EffectParameter(n, size, signed=True, like=like[::-1], apart=RECOVERY.bend, spread=RECOVERY.unknown)
        for n, like in zip(names, before, strict=False)
    )
    return Candidate(
        "unknown", place, block, name, edits, parameters, (dict(zip(names, heights.tolist(), strict=True)),)
    )
