"""Runs of one model that are worked on together, one in each lane of a processor's vectors.

A single run is bound by operations that wait for one another; as many runs as a vector has lanes take little longer
than two or three. Each gives the numbers of a single run to the bit (``runtime/lanes.c``, `engine.forms`).

`Lanes` are compiled, for many runs of one model, as in batches. Byte code has lanes too, of machine code that is there
at once, for a few runs of each of many models, as in diagnoses: `groups` says which, `run_together` carries them out.
"""

from __future__ import annotations

import logging
import math
import platform
import threading
from collections import OrderedDict
from collections.abc import Hashable, Sequence
from ctypes import c_int64, c_void_p
from typing import Any

from engine import native
from engine.codegen import lanes_source
from engine.compile import known, library
from engine.errors import CompilerUnavailable
from engine.model import Model
from engine.native import Job, Outcome

log = logging.getLogger("flexarm.lanes")

SAVED = 0.08e-9
"""Time (s) that lanes save of each operation of a run alone by its own code, measured."""

DEARER = 2.5
"""How many times as long as a model's own code this takes to compile, measured: it holds that too."""

MOST = 100
"""Models of which it is known whether lanes pay."""


class Lanes:
    """The compiled code of a model for runs in lanes, once that pays; made with `lanes_of`.

    Args:
        model: the model.
        possible: False if runs are to be carried out alone in any case.

    Attributes:
        width: how many runs are worked on together; 1 as long as each is carried out alone.
    """

    def __init__(self, model: Model, *, possible: bool = True) -> None:
        self.width = 1
        self._function: Any = None
        self._lost = 0.0
        self._possible = possible and not model.externals and platform.machine().lower() in ("x86_64", "amd64")
        self._looked = False
        self._lock = threading.Lock()

    def note(self, model: Model, job: Job) -> None:
        """Count a run that was carried out alone; once the time lost is that of compiling, the code is made.

        As for a single run's own code (`native.Way`), the cache is searched sooner.
        """
        if not self._possible or not self._lock.acquire(blocking=False):
            return  # while one thread compiles, the others go on
        try:
            operations = 4 * model.operations
            self._lost += native.steps_of(job) * operations * SAVED
            enough = self._lost > DEARER * (native.ENOUGH + native.ENOUGH_FOR_EACH * operations)
            if enough or (not self._looked and self._lost > native.LOOK):
                self._looked = True
                if enough or known(lanes_source(model)):
                    self._possible = False
                    self.make(model)
        except CompilerUnavailable as error:
            log.info("runs are carried out one by one: %s", error)
            self._possible = False
        finally:
            self._lock.release()

    def make(self, model: Model) -> None:
        """Make the code now.

        Raises:
            CompilerUnavailable: no compiler runs.
        """
        loaded = library(lanes_source(model))
        loaded.fa_lanes_width.restype = c_int64
        width = loaded.fa_lanes_width()
        if width > 1:
            self._function = _entry(loaded)
            self.width = width

    def run(self, model: Model, jobs: Sequence[Job]) -> list[Outcome]:
        """Carry out runs that are alike (`alike`), at most `width`; their outcomes in the same order."""
        return native.call_together(model, jobs, self._function, None)

    def groups(self, jobs: Sequence[Job]) -> list[list[int]]:
        """Places of jobs that are worked on together; those of a group of one are carried out alone.

        With less than half of the lanes used, as many runs alone take no longer.
        """
        found = _by_likeness(jobs)
        together = [places for places in found if 2 <= self.width <= 2 * len(places)]
        return together + [[place] for places in found if places not in together for place in places]


def alike(job: Job) -> Hashable:
    """Equal for runs that share rows, clocks and knots; and the number of steps between rows, as lanes take them."""
    between = math.ceil(job.timetable.apart / job.hmax)
    return job.t0, job.timetable.mark, between, job.record_states, id(job.cancel)


def _by_likeness(jobs: Sequence[Job]) -> list[list[int]]:
    """Places of jobs that are alike."""
    found: dict[Hashable, list[int]] = {}
    for place, job in enumerate(jobs):
        found.setdefault(alike(job), []).append(place)
    return list(found.values())


WIDTH = 4
"""Runs of byte code that are worked on together."""

TOGETHER = 3.4
"""Runs by the model's own code that take as long as these, measured; one by byte code takes as long as two of them."""

STEPS_OF_SWITCH = 10
"""Steps that a lane takes alone to find a switch."""


def groups(model: Model, jobs: Sequence[Job]) -> list[list[int]]:
    """Places of jobs that `run_together` is to be given at once."""
    if len(jobs) < 2:
        return [[place] for place in range(len(jobs))]
    try:
        code = native.way_of(model).code
    except CompilerUnavailable:
        code = None
    if code is None or not code.in_lanes:
        return [[place] for place in range(len(jobs))]
    found = []
    for places in _by_likeness(jobs):
        size = 1 if jobs[places[0]].record_states else WIDTH
        found += [places[k : k + size] for k in range(0, len(places), size)]
    return found


def run_together(model: Model, jobs: Sequence[Job]) -> list[Outcome]:
    """Carry out a group of `groups`, several runs in lanes of byte code; their outcomes in the same order.

    Lanes that are full take less time than the model's own code, with few switches; what it would save is counted.

    Raises:
        CompilerUnavailable: no compiler runs.
    """
    way = native.way_of(model)
    if len(jobs) == 1:
        return [native.run(model, jobs[0])]
    saved = len(jobs) * (1 - way.alone) - TOGETHER
    if saved > 0 or not way.chosen(-saved * native.steps_of(jobs[0])):
        made = native.call_together(model, jobs, native.interpreter(None, _in_byte_code), way.code)
    else:
        made = [native.run(model, job) for job in jobs]
    way.alone = STEPS_OF_SWITCH * sum(one.events for one in made) / max(sum(one.steps for one in made), 1)
    return made


def _in_byte_code(source: str) -> Any:
    return _entry(library(source))


def _entry(loaded: Any) -> Any:
    function = loaded.fa_simulate_lanes
    function.argtypes, function.restype = [c_void_p, c_int64], None
    return function


_lanes: OrderedDict[str, Lanes] = OrderedDict()
_lanes_lock = threading.Lock()


def lanes_of(model: Model) -> Lanes:
    """The lanes of a model, kept from batch to batch."""
    with _lanes_lock:
        found = _lanes.setdefault(model.law, Lanes(model))
        _lanes.move_to_end(model.law)
        while len(_lanes) > MOST:
            _lanes.popitem(last=False)
    return found


def forget() -> None:
    """Begin again as in a new process."""
    with _lanes_lock:
        _lanes.clear()
