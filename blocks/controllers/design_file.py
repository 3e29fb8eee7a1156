"""A design as a file, with its period and the names and units of its signals."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from blocks.controllers.control_systems import check_observer, in_words, plant
from blocks.controllers.design import Feedback
from engine.errors import ParameterError
from engine.files import json_text, writing


def save(
    file: str | Path,
    model: Any,
    *,
    feedback: Feedback | None = None,
    observer_gain: ArrayLike | None = None,
    reference_gain: ArrayLike | None = None,
    period: float = 0.0,
) -> Path:
    """Write a design as a .json file, from which `Observer` and `StateFeedback` read it; returns its path.

    Beside A, B, C, D and K, L, N it holds the period, and the names and units of states, inputs and outputs, by which
    the blocks refuse another period and swapped wires.

    Args:
        file: ends in .json.
        model: the linear model that was designed for.
        feedback: of `lqr`.
        observer_gain: L, shape (states, outputs), of `kalman` or another design.
        reference_gain: N, a number for each input.
        period: sample period (s); that of the feedback if 0.

    Raises:
        ParameterError: feedback or observer belong to another period or other states.
        FlexarmError: the file cannot be written.
    """
    if feedback is not None:
        if period and not math.isclose(period, feedback.period, rel_tol=1e-9):
            raise ParameterError(f"the feedback is {in_words(feedback.period)}, not {in_words(period)}")
        period = feedback.period
    made = plant(model, period)
    if feedback is not None and made.period != feedback.period:
        raise ParameterError(f"the feedback is {in_words(feedback.period)}, and the model {in_words(made.period)}")
    if feedback is not None and feedback.states != made.states:
        raise ParameterError(f"the feedback is one of {', '.join(feedback.states)}, not of {', '.join(made.states)}")
    content: dict[str, Any] = {name: getattr(made, name).tolist() for name in "ABCD"}
    if feedback is not None:
        content["K"] = feedback.gain.tolist()
    if observer_gain is not None:
        check_observer(made, observer_gain)
        content["L"] = np.asarray(observer_gain, dtype=float).tolist()
    if reference_gain is not None:
        content["N"] = np.asarray(reference_gain, dtype=float).reshape(-1, 1).tolist()
    content |= {"dt": made.period, "states": made.states, "inputs": made.inputs, "outputs": made.outputs}
    content["units"] = dict(made.units)
    path = Path(file)
    with writing(path, (".json",)) as temporary:
        temporary.write_text(json_text(content, indent=1) + "\n", encoding="utf-8")
    return path
