"""Nominal values of states, by which importers scale their absolute tolerance in Model Exchange.

An integrator's error in a state is held to its relative tolerance times the state's nominal. With a nominal of 1, a
deflection of a millimetre is lost in it; so nominals follow the magnitudes that the states reach when the model runs.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from engine.errors import FlexarmError
from engine.model import Model
from engine.simulate import Drive, simulate
from fmu.twists import Twist, twists

log = logging.getLogger("flexarm.export")

SHARE = 0.1
"""Nominal of a state over its largest magnitude: errors add up over a run, and much of it passes far below the peak."""

FLOORS = {"rad": 1e-4, "rad/s": 1e-3, "m": 1e-5, "m/s": 1e-4, "A": 1e-3, "V": 1e-3, "N": 1e-3, "N.m": 1e-4}
"""Least nominal by unit: what is smaller matters to nobody, and costs an integrator steps."""

FLOOR = 1e-6
"""The same for every other unit."""

LONGEST = 20.0
"""Seconds of a run that are looked at."""


TWIST_SHARE, TWIST_FLOOR = 1e-3, 1e-7
"""Both for twists and their rates. Stiff springs turn small ones into torques that matter, and when a contact opens or
closes hangs on rates far below their peak."""


def nominals(model: Model, magnitudes: Mapping[str, float], twists: Sequence[Twist] = ()) -> dict[str, float]:
    """Nominal of each state and twist: a share of its magnitude, and at least the floor of its unit.

    A linear twin's states take the nominals of the states that they follow.
    """
    found = {}
    for state in model.states:
        followed = state.name.removeprefix("linear.") if state.name not in magnitudes else state.name
        found[state.name] = max(SHARE * magnitudes.get(followed, 0.0), FLOORS.get(state.unit, FLOOR))
    for twist in twists:
        found[twist.name] = max(TWIST_SHARE * magnitudes.get(twist.name, 0.0), TWIST_FLOOR)
    return found


def magnitudes(model: Model, stop: float, step: float) -> dict[str, float]:
    """Largest magnitude of each state and twist in runs with inputs of 0 and of 1 in SI units; of those that succeed.

    Args:
        model: the model; a scenario's own, with its sources, has no inputs and is run once.
        stop: end (s), of which no more than `LONGEST` is run.
        step: output step (s).
    """
    found: dict[str, float] = {}
    if not model.states or model.externals:
        return found
    levels = (0.0, 1.0) if model.inputs else (0.0,)
    for level in levels:
        drive = Drive([0.0], [[level] * len(model.inputs)]) if model.inputs else None
        end = max(step, min(stop, LONGEST))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                run = simulate(model, end, step, drive=drive, record_states=True)
        except FlexarmError as error:
            log.warning("a run for the nominal values of the states fails: %s", error.message)
            continue
        assert run.states is not None
        columns = {state.name: run.states[:, k] for k, state in enumerate(model.states)}
        columns |= {twist.name: twist.of(run.states) for twist in twists(model)}
        for name, values in columns.items():
            found[name] = max(found.get(name, 0.0), float(np.abs(values).max()))
    return found
