"""Many runs of one model over all cores: in order, streamed, interruptible.

Threads suffice, because the compiled runtime holds no interpreter lock. Each run is computed by itself, or beside
others in lanes that give the same numbers (`engine.lanes`), so the results depend neither on how many threads there are
nor on which runs are neighbours. Only a bounded number of runs is in flight at a time.
"""

from __future__ import annotations

import ctypes
import itertools
import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

from engine import interpret, native
from engine.errors import CompilerUnavailable, FlexarmError, SimulationError
from engine.lanes import lanes_of
from engine.model import Model
from engine.native import Job, Outcome
from engine.simulate import Drive, Result, as_result, fault, prepare

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Case:
    """One run of a batch: what differs from the model's own values.

    Attributes:
        parameters: values by name, SI units.
        drive: external inputs.
        initial: starting values by name, SI units.
    """

    parameters: dict[str, float] = field(default_factory=dict)
    drive: Drive | None = None
    initial: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Failure:
    """A run that could not be carried to its end, in the place of its result."""

    case: Case
    reason: str


def batch(
    model: Model,
    cases: Iterable[Case | Mapping[str, float]],
    stop: float,
    step: float = 1e-3,
    *,
    internal_step: float | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    log_capacity: int = 1000,
) -> Generator[Result | Failure, None, None]:
    """Run the cases and yield their results in the order of the cases.

    Args:
        model: the model.
        cases: read as they are needed, so they may be a generator of any length; a mapping of parameters is a case too.
        stop: end of every run (s).
        step: time between rows (s).
        internal_step: longest integration step (s); chosen for each case if None.
        workers: threads; as many as cores if None.
        progress: called with the number of results yielded so far.
        log_capacity: events kept per run.

    Yields:
        A `Result`, or a `Failure` where a run diverged or chattered. Closing the generator, or interrupting it, cancels
        the runs in flight.
    """
    cancel = ctypes.c_int32(0)
    count = workers or os.cpu_count() or 1
    lanes = lanes_of(model)

    def prepared(case: Case) -> Job | Failure | FlexarmError:
        try:
            job = prepare(
                model,
                stop,
                step,
                parameters=case.parameters,
                drive=case.drive,
                initial=case.initial,
                internal_step=internal_step,
                log_capacity=log_capacity,
            )
        except SimulationError as error:
            return Failure(case, error.message)
        except FlexarmError as error:  # ends the batch, after the results before
            return error
        job.cancel = cancel
        return job

    def alone(job: Job) -> tuple[str, Outcome]:
        try:
            outcome = native.run(model, job)
        except CompilerUnavailable:
            return "interpreter", interpret.run(model, job)
        lanes.note(model, job)
        return "c", outcome

    def some(given: list[Case]) -> list[Result | Failure | FlexarmError]:
        found: list[Any] = [prepared(case) for case in given]
        places = [place for place, one in enumerate(found) if isinstance(one, Job)]
        jobs = [found[place] for place in places]
        for group in lanes.groups(jobs):
            if len(group) > 1:
                outcomes = [("c", outcome) for outcome in lanes.run(model, [jobs[k] for k in group])]
            else:
                outcomes = [alone(jobs[k]) for k in group]
            for k, (backend, outcome) in zip(group, outcomes, strict=True):
                case, reason = given[places[k]], fault(model, jobs[k], outcome)
                made = as_result(model, jobs[k], outcome, backend, case.parameters) if not reason else None
                found[places[k]] = made or Failure(case, reason)
        return found

    waiting: deque[Future[list[Result | Failure | FlexarmError]]] = deque()
    source, done = iter(cases), 0
    with ThreadPoolExecutor(count, thread_name_prefix="flexarm-batch") as pool:
        try:
            more = True
            while more or waiting:
                # Enough that no thread waits for the caller, and no more: each holds a run's results.
                while more and len(waiting) < (4 if lanes.width == 1 else 2) * count:
                    given = [
                        case if isinstance(case, Case) else Case(parameters=dict(case))
                        for case in itertools.islice(source, lanes.width)
                    ]
                    more = bool(given)
                    if given:
                        waiting.append(pool.submit(some, given))
                for found in waiting.popleft().result() if waiting else ():
                    if isinstance(found, FlexarmError):
                        raise found
                    yield found
                    done += 1
                    if progress:
                        progress(done)
        finally:
            cancel.value = 1
            for future in waiting:
                future.cancel()
