"""Running a model: the compiled runtime where a compiler works, else the interpreter."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from html import escape
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engine import external, interpret, lanes, native, result_files
from engine.display import counts, number, spark, table
from engine.errors import CompilerUnavailable, ParameterError, SimulationError, nearest
from engine.model import TIME, Model, Vector
from engine.native import Job, Outcome, Timetable
from engine.start import start_values
from engine.step import fastest
from engine.step import internal_step as choose_step
from engine.work import DIRECTION, EACH, EACH_NUMBER, counting

MOST_BEGUN = 64
"""Starts that a model keeps, and internal steps; see `prepare`."""
MOST_STEPS = 1_000_000_000
"""Internal steps, sample instants or time events of one run; more would take hours."""

MOST_VALUES = 500_000_000
"""Recorded numbers of one run (4 GB)."""

SHORTEST = 1e-9
"""Steps and sample periods (s): time is counted in whole fractions of at most a thousand million a second."""

HOLDS = ("zero_order", "linear")
"""What may happen between the rows of a drive."""

NEVER = 2**62
"""Ticks beyond which no run goes."""

_warned: set[str] = set()


@dataclass(frozen=True)
class Drive:
    """External inputs over time.

    Attributes:
        time: instants (s), rising, shape (n,); the first values hold before the first instant, the last after the last.
        values: shape (n, inputs), in the order of the model's inputs.
        hold: ``zero_order`` or ``linear`` for each input, or one for all.
    """

    time: ArrayLike
    values: ArrayLike
    hold: str | tuple[str, ...] = "zero_order"

    def rows(self, count: int) -> tuple[Vector, NDArray[np.float64]]:
        """The instants, shape (n,), and the values of so many inputs, shape (n, count).

        Values of one input may be of shape (n,), and those of a single instant of shape (count,).

        Raises:
            ParameterError: the values have another shape, or are not finite; or the instants do not rise.
        """
        time = np.atleast_1d(np.asarray(self.time, dtype=float))
        values = np.asarray(self.values, dtype=float)
        if time.ndim != 1 or not len(time):
            raise ParameterError(f"the drive's instants have shape {time.shape}", remedy="give a list of at least one")
        if values.ndim < 2 and 1 in (count, len(time)) and values.size == len(time) * count:
            values = values.reshape(len(time), count)
        if values.shape != (len(time), count):
            raise ParameterError(
                f"the drive's values have shape {values.shape}; it has {counts(instants=len(time))} and the model "
                f"{counts(inputs=count)}",
                remedy=f"give shape ({len(time)}, {count}): a row for each instant, a column for each input",
            )
        if not (np.isfinite(time).all() and np.isfinite(values).all()):
            raise ParameterError("the drive holds values that are not finite")
        if (np.diff(time) <= 0).any():
            raise ParameterError(f"the drive's time runs backwards at row {int(np.argmax(np.diff(time) <= 0)) + 1}")
        return time, values

    def holds(self, count: int) -> tuple[str, ...]:
        """How each of so many inputs is held.

        Raises:
            ParameterError: there is no such hold, or there are not as many as inputs.
        """
        holds = (self.hold,) * count if isinstance(self.hold, str) else tuple(self.hold)
        for hold in holds:
            if hold not in HOLDS:
                raise ParameterError(f"a drive has no hold '{hold}'", remedy=nearest(hold, HOLDS))
        if len(holds) != count:
            raise ParameterError(
                f"the drive has {counts(holds=len(holds))} for {counts(inputs=count)}",
                remedy="give one for each input, or one text for all",
            )
        return holds

    @functools.cached_property
    def timetables(self) -> dict[Hashable, tuple[Vector, Vector, Timetable]]:
        """Those of runs with this drive, and the instants and values that they were made of: see `prepare`."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "timetables"}


@dataclass(frozen=True, repr=False)
class Result:
    """What a simulation gave.

    Attributes:
        model: the model that ran.
        time: instants (s), shape (n,).
        values: outputs, shape (n, outputs).
        states: states, shape (n, states), if they were recorded.
        modes: modes, shape (n, modes), if the states were recorded.
        events: (time, mode name, new value) in order.
        event_count: number of switches, also beyond the log's capacity.
        steps: internal steps taken.
        internal_step: longest internal step (s).
        final_state, final_memory, final_modes: at the end.
        backend: ``c`` or ``interpreter``.
    """

    model: Model
    time: Vector
    values: NDArray[np.float64]
    states: NDArray[np.float64] | None
    modes: NDArray[np.float64] | None
    events: tuple[tuple[float, str, float], ...]
    event_count: int
    steps: int
    internal_step: float
    final_state: Vector
    final_memory: Vector
    final_modes: Vector
    backend: str
    parameters: dict[str, float] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the outputs, in the order of the columns of ``values``."""
        return [variable.name for variable in self.model.outputs]

    @property
    def units(self) -> dict[str, str]:
        """Unit of each output."""
        return {variable.name: variable.unit for variable in self.model.outputs}

    def __getitem__(self, name: str) -> Vector:
        """One output over time, shape (n,).

        Raises:
            ParameterError: no such output.
        """
        names, meant = self.names, self.model.resolve(name)
        if meant not in names:
            raise ParameterError(f"no output '{name}' was recorded", remedy=nearest(name, names))
        return np.asarray(self.values[:, names.index(meant)])

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame`: a row for each instant, a column for each output; units in ``attrs["units"]``."""
        import pandas

        frame = pandas.DataFrame(self.values, index=pandas.Index(self.time, name="time"), columns=self.names)
        frame.attrs["units"] = {"time": "s", **self.units}
        return frame

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` over ``time``, with the unit of each variable in its attribute ``units``."""
        import xarray

        docs = {variable.name: variable.doc for variable in self.model.outputs}
        columns = {
            name: ("time", self.values[:, k], {"units": unit, "long_name": docs[name] or name})
            for k, (name, unit) in enumerate(self.units.items())
        }
        return xarray.Dataset(columns, coords={"time": ("time", self.time, {"units": "s"})}, attrs=self._source())

    def save(self, path: str | Path) -> Path:
        """Write it as .csv, .parquet or .mat; returns the path. `flexarm.read` reads it back.

        Raises:
            FlexarmError: an unknown kind of file, or it cannot be written.
        """
        result_files.write(Path(path), self, self._source())
        return Path(path)

    def _source(self) -> dict[str, str]:
        changed = " ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return {"scenario": self.model.name, "model": self.model.signature, "parameters": changed}

    def __repr__(self) -> str:
        end = self.time[-1] if len(self.time) else 0.0
        sizes = counts(signals=len(self.names))
        switches = f"{self.event_count} switch{'' if self.event_count == 1 else 'es'}"
        return f"<result of '{self.model.name}': {len(self.time)} rows to {end:g} s, {sizes}, {switches}>"

    def _repr_html_(self) -> str:
        rows = [
            [escape(name), escape(unit), *(number(float(v)) for v in (y[-1], y.min(), y.max())), spark(y)]
            for (name, unit), y in zip(self.units.items(), self.values.T, strict=True)
        ]
        return table(["signal", "unit", "end", "least", "greatest", ""], rows, repr(self).strip("<>"))


@functools.lru_cache(maxsize=1024)
def rational(value: float) -> Fraction:
    """A time as an exact fraction: 0.1 becomes 1/10."""
    return Fraction(value).limit_denominator(10**9)


def common_tick(instants: Iterable[float]) -> Fraction:
    """The longest tick of which all given instants are whole multiples."""
    return _common_tick(tuple(instants))


@functools.lru_cache(maxsize=256)
def _common_tick(instants: tuple[float, ...]) -> Fraction:
    tick = Fraction(0)
    for value in instants:
        fraction = rational(value)
        if fraction:
            tick = Fraction(
                math.gcd(tick.numerator * fraction.denominator, fraction.numerator * tick.denominator),
                tick.denominator * fraction.denominator,
            )
    return tick


class SimulationKeywords(TypedDict, total=False):
    """The fields of `SimulationOptions` as keyword arguments.

    A script reads better with ``simulate(model, 4.0, drive=drive)`` than with an object made for one call, and a type
    checker knows keywords from a TypedDict alone, not from a dataclass (PEP 692). So there are both, field by field;
    ``tests/test_options.py`` holds them against each other.
    """

    parameters: dict[str, float] | None
    drive: Drive | None
    initial: dict[str, float] | None
    internal_step: float | None
    record_states: bool | Callable[[Model], bool]
    rows: ArrayLike | None
    backend: str
    log_capacity: int
    step_tolerance: float | None


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """How to simulate.

    Attributes:
        parameters: values that replace the model's, SI units.
        drive: the external inputs of a model built with inputs; zero if None.
        initial: starting values by name, SI units.
        internal_step: longest integration step (s); chosen from the fastest mode if None.
        record_states: also keep states and modes at every row; or a function of the model that says so.
        rows: instants of the rows (s), rising, the first zero, shape (n,); every ``step`` from zero on if None.
        backend: ``c``, ``interpreter`` or ``auto`` (c where a compiler works).
        log_capacity: how many events are kept.
        step_tolerance: if given, the run is repeated with half the internal step, and a warning names the fastest mode
            if some output changes by more than this share of its range.
    """

    parameters: dict[str, float] | None = None
    drive: Drive | None = None
    initial: dict[str, float] | None = None
    internal_step: float | None = None
    record_states: bool | Callable[[Model], bool] = False
    rows: ArrayLike | None = None
    backend: str = "auto"
    log_capacity: int = 100_000
    step_tolerance: float | None = None


def simulate(
    model: Model,
    stop: float,
    step: float = 1e-3,
    options: SimulationOptions | None = None,
    **given: Unpack[SimulationKeywords],
) -> Result:
    """Simulate from rest, or from the initial values, at time 0.

    Args:
        model: the model.
        stop: end (s); the last row is the last multiple of ``step`` not beyond it.
        step: time between rows (s).
        options: how to simulate.
        **given: fields of `SimulationOptions`, over those of ``options``.

    Raises:
        ParameterError: a name or value that does not fit.
        SimulationError: the run diverged or chattered; the message says when and which state or mode.
    """
    o = replace(options or SimulationOptions(), **given)
    job = prepare(
        model,
        stop,
        step,
        parameters=o.parameters,
        drive=o.drive,
        initial=o.initial,
        internal_step=o.internal_step,
        record_states=o.record_states(model) if callable(o.record_states) else o.record_states,
        log_capacity=o.log_capacity,
        rows=None if o.rows is None else np.asarray(o.rows, dtype=float),
    )
    used, outcome = carried_out(model, job, o.backend)
    result = as_result(model, job, outcome, used, o.parameters)
    if o.step_tolerance is not None:
        _check_step(model, job, result, used, o.step_tolerance)
    return result


def _check_step(model: Model, job: Job, result: Result, backend: str, tolerance: float) -> None:
    """Warn if half the internal step gives other outputs."""
    finer = _execute(model, replace(job, hmax=job.hmax / 2), backend)[1]
    if finer.status:
        return
    span = np.ptp(finer.y, axis=0)
    change = np.abs(finer.y - result.values).max(axis=0) / np.where(span > 0, span, 1.0)
    worst = int(np.argmax(change)) if change.size else 0
    if change.size and change[worst] > tolerance:
        mode = fastest(model, job.p, job.x0)
        warnings.warn(
            f"half the internal step of {job.hmax:.3g} s changes '{result.names[worst]}' by {change[worst]:.2g} of its "
            f"range, more than {tolerance:.2g}; the fastest mode moves '{mode.state}' at {mode.rate:.4g} 1/s: give a "
            f"shorter internal_step",
            RuntimeWarning,
            stacklevel=3,
        )


def as_result(model: Model, job: Job, outcome: Outcome, backend: str, parameters: dict[str, float] | None) -> Result:
    """A finished run with its names."""
    names = [mode.name for mode in model.modes]
    instants, switched, values = outcome.log.reshape(-1, 3).T.tolist()
    return Result(
        model=model,
        time=job.timetable.time.copy(),
        values=outcome.y,
        states=outcome.states,
        modes=outcome.modes,
        events=tuple(zip(instants, [names[int(k)] for k in switched], values, strict=True)),
        event_count=outcome.events,
        steps=outcome.steps,
        internal_step=job.hmax,
        final_state=outcome.x1,
        final_memory=outcome.d1,
        final_modes=outcome.m1,
        backend=backend,
        parameters=dict(parameters or {}),
    )


def prepare(
    model: Model,
    stop: float,
    step: float,
    *,
    parameters: dict[str, float] | None = None,
    drive: Drive | None = None,
    initial: dict[str, float] | None = None,
    internal_step: float | None = None,
    record_states: bool = False,
    log_capacity: int = 100_000,
    rows: Vector | None = None,
) -> Job:
    """Everything one run needs, checked and in the runtime's form; see `SimulationOptions` for the arguments."""
    for name, value in (("stop", stop), ("step", step)):
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(f"{name} is {value}", remedy=f"give a {name} time above zero, in seconds")
    if internal_step is not None and not (math.isfinite(internal_step) and internal_step > 0):
        raise ParameterError(f"internal_step is {internal_step}", remedy="give a time above zero, in seconds")
    if step < SHORTEST:
        raise ParameterError(f"step is {step:g} s", remedy=f"give at least {SHORTEST:g} s")
    for k, clock in enumerate(model.clocks):
        if clock.period < SHORTEST or clock.period * MOST_STEPS < stop:
            raise SimulationError(
                f"{stop:g} s hold too many sample instants of '{_ticking(model, k)}', every {clock.period:g} s",
                remedy=f"give a longer sample period (at least {SHORTEST:g} s), or an earlier stop",
            )
    p = model.parameter_vector(parameters)
    x0, d0 = _begin(model, p, initial)
    shared = _timetable(model, stop, step, drive, len(model.outputs) + record_states * _whole_state(model), rows)
    hmax = _checked_step(model, p, x0, step, stop, internal_step)
    return Job(
        p=p,
        x0=x0,
        d0=d0,
        m0=np.full(len(model.modes), np.nan),
        hmax=hmax,
        timetable=shared,
        record_states=record_states,
        log_capacity=log_capacity,
    )


def _whole_state(model: Model) -> int:
    return len(model.states) + len(model.modes)


def _timetable(
    model: Model, stop: float, step: float, drive: Drive | None, columns: int, rows: Vector | None
) -> Timetable:
    """The instants of a run, worked out once for all runs with the same drive, as long as its lists stay what they are.

    Arguments are as of `prepare`, and the numbers that are recorded in a row.
    """
    if drive is None:
        return _new_timetable(model, stop, step, drive, columns, rows)
    same = (stop, step, len(model.inputs), model.clocks, columns, None if rows is None else rows.tobytes())
    time, values = np.asarray(drive.time), np.asarray(drive.values)
    before = drive.timetables.get(same)
    if before is not None and np.array_equal(before[0], time) and np.array_equal(before[1], values):
        return before[2]
    found = _new_timetable(model, stop, step, drive, columns, rows)
    if len(drive.timetables) >= MOST_BEGUN:
        drive.timetables.clear()
    drive.timetables[same] = time.copy(), values.copy(), found
    return found


def _new_timetable(
    model: Model, stop: float, step: float, drive: Drive | None, columns: int, rows: Vector | None
) -> Timetable:
    knots, values, linear = _driven(model, drive)
    instants = [step, *[c.period for c in model.clocks], *[c.offset for c in model.clocks]]
    tick = common_tick(instants)
    uneven = knots if rows is None else np.concatenate([knots, _checked_rows(rows, stop)])
    if (np.abs(uneven - np.round(uneven / float(tick)) * float(tick)) > 0.5e-9).any():
        tick = common_tick([*instants, 1e-9])
    if tick < Fraction(1, 10**13):
        raise ParameterError(
            f"step and sample periods {instants} have no common tick", remedy="make them multiples of one another"
        )
    if rows is None and stop / step > min(200_000_000, MOST_VALUES / max(columns, 1)):
        raise ParameterError(
            f"{stop / step:.3g} rows of {columns} numbers are too many", remedy="give a longer step or an earlier stop"
        )
    if stop > 1e300:
        raise ParameterError(f"stop is {stop:g} s", remedy="give an earlier stop")
    farthest = max(stop, float(np.abs(knots).max())) / float(tick)
    if farthest > NEVER:
        raise ParameterError(
            f"times up to {farthest * float(tick):g} s do not go with a tick of {float(tick):g} s",
            remedy="give an earlier stop or drive, or sample periods that are multiples of a longer time",
        )
    if rows is None:
        number = np.arange(int(Fraction(stop + 1e-9 * step) / rational(step)) + 1)
        each = int(rational(step) / tick) if len(number) > 1 else 0  # a step beyond the end may be any
        ticks, time = number * each, number * np.float64(rational(step))
    else:
        ticks, time = np.round(rows / float(tick)).astype(np.int64), rows.copy()
    return Timetable(
        resolution=float(tick),
        rows=ticks,
        time=time,
        period=np.array([_ticks(c.period, tick) for c in model.clocks], dtype=np.int64),
        offset=np.array([_ticks(c.offset, tick) for c in model.clocks], dtype=np.int64),
        knot=np.round(knots / float(tick)).astype(np.int64),
        value=np.ascontiguousarray(values, dtype=np.float64),
        linear=np.array(linear, dtype=np.int32),
    )


def _checked_rows(rows: Vector, stop: float) -> Vector:
    """Instants of rows, which can be had.

    Raises:
        ParameterError: they do not begin at zero, do not rise, or go on after the end.
    """
    if rows.ndim != 1 or not len(rows) or rows[0] != 0 or not np.isfinite(rows).all():
        raise ParameterError("the instants of rows are not a list of finite numbers that begins with zero")
    close = np.diff(rows) < SHORTEST * (1 - 1e-6)
    if close.any():
        row = int(np.argmax(close)) + 1
        raise ParameterError(
            f"row {row} is at {rows[row]:.9g} s and the one before it at {rows[row - 1]:.9g} s",
            remedy=f"let instants rise by at least {SHORTEST:g} s",
        )
    if rows[-1] > stop * (1 + 1e-12):
        raise ParameterError(f"the last row is at {rows[-1]:.9g} s, after the stop at {stop:.9g} s")
    return rows


def _ticks(time: float, tick: Fraction) -> int:
    """A time of a clock in ticks; one that no run reaches stays within the integers of C."""
    return min(int(rational(time) / tick), NEVER)


def _begin(model: Model, p: Vector, initial: dict[str, float] | None) -> tuple[Vector, Vector]:
    """States and memories at the start, worked out once for all parameters that give the same."""
    initial = {model.resolve(name): value for name, value in (initial or {}).items()}
    same = (p[model.shapes].tobytes(), *(tuple((given or {}).items()) for given in (model.initial, initial)))
    before = model.begun.get(same)
    if before is None:
        before = start_values(model, p, initial), model.at("memory_start")(p).ravel()
        if len(model.begun) >= MOST_BEGUN:
            model.begun.clear()
        model.begun[same] = before
    return before[0].copy(), before[1].copy()


def _checked_step(model: Model, p: Vector, x0: Vector, step: float, stop: float, internal_step: float | None) -> float:
    """The internal step, chosen once for runs that differ in their drive alone.

    Raises:
        SimulationError: the run would not end within hours.
    """
    if internal_step and not model.count(TIME):
        _check_cost(model, p, x0, stop, min(internal_step, step))
        return internal_step
    same = (p.tobytes(), x0.tobytes(), step, stop, internal_step)
    hmax = model.steps.get(same)
    if hmax is None:
        hmax = internal_step or choose_step(model, p, x0, step, stop)
        _check_cost(model, p, x0, stop, min(hmax, step))
        if len(model.steps) >= MOST_BEGUN:
            model.steps.clear()
        model.steps[same] = hmax
    return hmax


def _ticking(model: Model, clock: int) -> str:
    """What a clock drives."""
    names = [memory.name for memory, k in zip(model.memories, model.memory_clock, strict=True) if k == clock]
    return [*names, *(external.name for external in model.externals if external.clock == clock), f"clock {clock}"][0]


def _check_cost(model: Model, p: Vector, x0: Vector, stop: float, hmax: float) -> None:
    """Refuse a run that would not end within hours."""
    if hmax * MOST_STEPS < stop:
        mode = fastest(model, p, x0)
        raise SimulationError(
            f"{stop:g} s in internal steps of {hmax:.3g} s exceed {MOST_STEPS:.3g} steps; the fastest mode moves "
            f"'{mode.state}' at {mode.rate:.4g} 1/s",
            remedy="reduce the stiffness or raise the inertia behind this mode, stop earlier, or give an internal_step",
        )
    timed = [mode.name for mode in model.modes if mode.kind == TIME]
    if timed:
        first, later = (model.at("following")(np.full(len(model.modes), count), p).ravel() for count in (1.0, 3.0))
        with np.errstate(invalid="ignore"):
            hasty = np.flatnonzero((later - first) / 2 * MOST_STEPS < stop)
        if len(hasty):
            name = timed[int(hasty[0])]
            raise SimulationError(f"'{name}' changes more than {MOST_STEPS:.3g} times within {stop:g} s")


def _driven(model: Model, drive: Drive | None) -> tuple[Vector, NDArray[np.float64], list[int]]:
    n = len(model.inputs)
    if drive is None:
        return np.zeros(1), np.zeros((1, n)), [0] * n
    time, values = drive.rows(n)
    if time[0] > 0:
        time, values = np.concatenate([[0.0], time]), np.vstack([values[:1], values])
    return time, values, [int(hold == "linear") for hold in drive.holds(n)]


def _execute(model: Model, job: Job, backend: str) -> tuple[str, Outcome]:
    if backend not in ("auto", "c", "interpreter"):
        raise ParameterError(f"unknown backend '{backend}'", remedy=nearest(backend, ["auto", "c", "interpreter"]))
    if backend != "interpreter":
        try:
            return "c", native.run(model, job)
        except CompilerUnavailable as error:
            if backend == "c":
                raise
            if "compiler" not in _warned:
                _warned.add("compiler")
                warnings.warn(f"{error.message}; using the slower interpreter", RuntimeWarning, stacklevel=3)
    return "interpreter", interpret.run(model, job)


def carried_out(model: Model, job: Job, backend: str = "auto") -> tuple[str, Outcome]:
    """A run that was prepared: what carried it out, and what came of it.

    Raises:
        SimulationError: it diverged or chattered.
    """
    used, outcome = _execute(model, job, backend)
    note_work(model, [outcome])
    reason = fault(model, job, outcome)
    if reason:
        raise SimulationError(reason) from outcome.cause
    return used, outcome


def carried_out_together(model: Model, jobs: Sequence[Job]) -> list[Outcome | SimulationError]:
    """A group of runs that were prepared, as of `lanes.groups`: what came of each, or why that cannot be used."""
    try:
        outcomes = lanes.run_together(model, jobs)
    except CompilerUnavailable:
        outcomes = [_execute(model, job, "auto")[1] for job in jobs]
    note_work(model, outcomes)
    reasons = [fault(model, job, outcome) for job, outcome in zip(jobs, outcomes, strict=True)]
    pairs = zip(outcomes, reasons, strict=True)
    return [SimulationError(reason) if reason else outcome for outcome, reason in pairs]


def note_work(model: Model, outcomes: Sequence[Outcome], directions: int = 0) -> None:
    """Count what runs of a model took, if this thread's are counted (`engine.work`).

    Args:
        model: the model.
        outcomes: of the runs.
        directions: of the tangents that each of them carried along.
    """
    work = counting()
    if work is not None:
        steps, numbers = sum(o.steps for o in outcomes), sum(o.y.size for o in outcomes)
        runs = round(steps * model.operations * (1 + DIRECTION * directions))
        work.add(runs + len(outcomes) * EACH + (1 + directions) * numbers * EACH_NUMBER)


def fault(model: Model, job: Job, outcome: Outcome) -> str:
    """Why the values of a run cannot be used, in a sentence; empty if they can."""
    if outcome.status:
        return explain(model, outcome)
    if not np.isfinite(outcome.y).all():
        row, column = np.argwhere(~np.isfinite(outcome.y))[0]
        time = job.t0 + float(job.timetable.time[row])
        return f"the simulation diverged at t = {time:.9g} s: output '{model.outputs[column].name}' is not finite"
    if not np.isfinite(outcome.d1).all():
        name = model.memories[int(np.argmin(np.isfinite(outcome.d1)))].name
        return f"the simulation diverged by t = {outcome.t1:.9g} s: memory '{name}' is not finite"
    return ""


def explain(model: Model, outcome: Any) -> str:
    """Why a run stopped early, in a sentence."""
    at = f"at t = {outcome.t1:.9g} s"
    if outcome.status == native.NOT_FINITE:
        name = model.states[outcome.culprit].name
        if np.isfinite(outcome.x1[outcome.culprit]):
            hint = ": its inertia may be zero, or a value too large or too small" if outcome.t1 == 0 else ""
            return f"the simulation diverged {at}: the rate of state '{name}' is not finite{hint}"
        return f"the simulation diverged {at}: state '{name}' is not finite"
    if outcome.status == native.CANCELLED:
        return f"the simulation was cancelled {at}"
    if outcome.status == native.EXTERNAL:
        return f"{external.explain(model, outcome.culprit, outcome.cause)}, {at}"
    name = model.modes[outcome.culprit].name if model.modes else "?"
    if outcome.status == native.CHATTER:
        return f"more than {native.EVENTS_PER_STEP} switches within one step {at}: '{name}' chatters"
    return f"no consistent mode was found {at}: '{name}' switches back and forth"
