"""Starting values that belong to a recording: where a fit of them begins."""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array, FreeParameter
from diagnosis.recordings.columns import RecordingError
from diagnosis.recordings.types import Recording
from diagnosis.thresholds import FITTING
from engine.errors import nearest
from engine.model import Model
from engine.ports import MOTION
from engine.start import start_values, starting_names

_RATES = [(f".{names[1][0]}", f".{names[0][0]}") for names in MOTION.values()]


def starting_values(model: Model, recording: Recording, measured: Array) -> dict[str, float]:
    """First guesses of a recording's free starting values: its first sample or slope where measured, else the model's.

    Args:
        model: of the experiment.
        recording: names them.
        measured: shape (samples, signals), in the model's units.

    Raises:
        RecordingError: a name that has no starting value.
    """
    known = starting_names(model)
    made: dict[str, float] = {}
    at_rest = dict(zip((s.name for s in model.states), start_values(model, model.parameter_values), strict=True))
    for name in recording.free:
        if name not in known:
            raise RecordingError(
                f"'{name}' in 'initial: free' of recording '{recording.name}' has no starting value",
                remedy=nearest(name, known),
            )
        made[name] = _first(model, name, recording, measured, float(model.initial.get(name, at_rest.get(name, 0.0))))
    return made


def _first(model: Model, name: str, recording: Recording, measured: Array, otherwise: float) -> float:
    names = [v.name for v in model.outputs]
    whole = [k for k, c in enumerate(recording.measurements) if not c.from_first]
    for k in whole:
        there = np.flatnonzero(np.isfinite(measured[:, k]))[: FITTING.first_samples]
        if names[k] == name and there.size:
            return float(measured[there[0], k])
    for rate, motion in _RATES:
        if name.endswith(rate) and name.removesuffix(rate) + motion in names:
            column = measured[:, names.index(name.removesuffix(rate) + motion)]
            there = np.flatnonzero(np.isfinite(column))[: FITTING.first_samples]
            if there.size > 3:
                return float(np.polyfit(recording.time[there], column[there], 2)[1])
    return otherwise


def free_starts(experiment: Experiment) -> list[FreeParameter]:
    """The free starting values of an experiment, with a prior of 10 % of the value or `FITTING.usual_start`."""
    rows = []
    for name in experiment.free:
        value = experiment.initial.get(name, 0.0)
        rows.append(
            FreeParameter(name, value, max(0.1 * abs(value), FITTING.usual_start), False, recording=experiment.name)
        )
    return rows
