"""How costs grow: with modes, links, recordings and cores."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_engine import ARM, inner
from benchmarks.concealed.case import draw
from benchmarks.concealed.scenario import write
from diagnosis.api import fit
from diagnosis.binding import find_recording
from engine.batch import Case, batch
from engine.model import Model
from engine.spread import cores
from scenarios.load import load

Growth = dict[str, Any]
"""``what``, ``unit``, ``sizes``, ``costs``, ``exponent`` (of cost against size, fitted), ``over`` (from which size)."""


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Slope of log cost against log size, by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def _growth(what: str, unit: str, sizes: Sequence[int], costs: Sequence[float], first: int = 0) -> Growth:
    slope = exponent(sizes[first:], costs[first:])
    return {
        "what": what,
        "unit": unit,
        "sizes": list(sizes),
        "costs": list(costs),
        "exponent": slope,
        "over": sizes[first],
    }


def in_turns(repeats: int, *actions: Callable[[], float]) -> list[float]:
    """Median of what each action returns, run in turns so that what else the machine does meets all alike."""
    found: list[list[float]] = [[] for _ in actions]
    for _ in range(repeats):
        for spent, action in zip(found, actions, strict=True):
            spent.append(action())
    return [statistics.median(spent) for spent in found]


def _step_costs(models: Sequence[Model]) -> list[float]:
    """Median microseconds of an RK4 step of each model."""
    made = [inner(model, 2.0) for model in models]

    def timed(action: Callable[[], float]) -> float:
        begin = time.process_time()
        action()
        return time.process_time() - begin

    seconds = in_turns(15, *(lambda action=action: timed(action) for action, _ in made))
    return [1e6 * s / last[0].steps for s, (_, last) in zip(seconds, made, strict=True)]


def modes() -> Growth:
    """A step against the modes of one link."""
    sizes = (2, 4, 8, 16, 32, 64)
    models = [load("reference-a", [f"link.modes={n}"]).build() for n in sizes]
    return _growth("modes of a link: an RK4 step of reference model A", "us", sizes, _step_costs(models), 2)


def links() -> Growth:
    """A step against the links of a serial arm."""
    sizes = (1, 2, 4, 8, 16, 32)
    models = [load("reference-c", text=ARM.format(links=n)).build() for n in sizes]
    return _growth("links of a serial arm, two modes each: an RK4 step", "us", sizes, _step_costs(models), 2)


def recordings() -> Growth:
    """A fit against the number of recordings, each the same data under another name."""
    sizes = (1, 2, 4, 8)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(draw("geared-two-mass", ["offset"], [3.0], 1), folder / "case", folder / "answers")
        scenario = load(folder / "case" / "scenario.yaml")
        given = find_recording(scenario, "rec1")
        copies = [[replace(given, name=f"copy{k}", role="train") for k in range(n)] for n in sizes]

        def timed(chosen: list[Any]) -> float:
            begin = time.process_time()
            fit(scenario, chosen, workers=1)
            return time.process_time() - begin

        timed(copies[0])  # compiles
        costs = in_turns(3, *(lambda chosen=chosen: timed(chosen) for chosen in copies))
    return _growth("recordings of 4 s at 1 kHz: a fit of 11 parameters, one thread", "s", sizes, costs)


def threads() -> Growth:
    """Many runs against the cores used."""
    sizes = tuple(n for n in (1, 2, 4, 8, 16, 32) if n <= cores())
    model = load("reference-b").build()

    def timed(workers: int) -> float:
        cases = (Case({"motor.resistance": float(v)}) for v in np.linspace(2.2, 3.0, 100))
        begin = time.perf_counter()
        for _ in batch(model, cases, 10.0, workers=workers):
            pass
        return time.perf_counter() - begin

    timed(1)
    costs = in_turns(7, *(lambda n=n: timed(n) for n in sizes))
    what = "cores: 100 runs of 10 s of reference model B"
    if len(sizes) > 1:
        return _growth(what, "s", sizes, costs)
    return {"what": what, "unit": "s", "sizes": list(sizes), "costs": costs, "exponent": None, "over": 1}


def every() -> list[Growth]:
    """All of them."""
    return [modes(), links(), recordings(), threads()]
