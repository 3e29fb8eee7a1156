"""Running a model: the compiled runtime where a compiler works, else the interpreter."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engine import external, interpret, native
from engine.errors import CompilerUnavailable, ParameterError, SimulationError, nearest
from engine.model import Model, Vector
from engine.native import Job, Outcome
from engine.start import start_values
from engine.step import fastest
from engine.step import internal_step as choose_step

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


@dataclass(frozen=True)
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
        names = self.names
        if name not in names:
            raise ParameterError(f"no output '{name}' was recorded", remedy=nearest(name, names))
        return np.asarray(self.values[:, names.index(name)])


def rational(value: float) -> Fraction:
    """A time as the fraction that was meant, so that 0.1 is a tenth."""
    return Fraction(value).limit_denominator(10**9)


def common_tick(instants: list[float]) -> Fraction:
    """The longest tick of which all given instants are whole multiples."""
    tick = Fraction(0)
    for value in instants:
        fraction = rational(value)
        if fraction:
            tick = Fraction(
                math.gcd(tick.numerator * fraction.denominator, fraction.numerator * tick.denominator),
                tick.denominator * fraction.denominator,
            )
    return tick


def simulate(
    model: Model,
    stop: float,
    step: float = 1e-3,
    *,
    parameters: dict[str, float] | None = None,
    drive: Drive | None = None,
    initial: dict[str, float] | None = None,
    internal_step: float | None = None,
    record_states: bool = False,
    backend: str = "auto",
    log_capacity: int = 100_000,
    step_tolerance: float | None = None,
) -> Result:
    """Simulate from rest, or from the initial values, at time 0.

    Args:
        model: the model.
        stop: end (s); the last row is the last multiple of ``step`` not beyond it.
        step: time between rows (s).
        parameters: values that replace the model's, SI units.
        drive: the external inputs; zero if None.
        initial: starting values by name, SI units.
        internal_step: longest integration step (s); chosen from the fastest mode if None.
        record_states: also keep states and modes at every row.
        backend: ``c``, ``interpreter`` or ``auto`` (c where a compiler works).
        log_capacity: how many events are kept.
        step_tolerance: if given, the run is repeated with half the internal step, and a warning names the fastest mode
            if some output changes by more than this share of its range.

    Raises:
        ParameterError: a name or value that does not fit.
        SimulationError: the run diverged or chattered; the message says when and which state or mode.
    """
    job = prepare(
        model,
        stop,
        step,
        parameters=parameters,
        drive=drive,
        initial=initial,
        internal_step=internal_step,
        record_states=record_states,
        log_capacity=log_capacity,
    )
    used, outcome = _execute(model, job, backend)
    if outcome.status:
        raise SimulationError(explain(model, outcome)) from outcome.cause
    result = as_result(model, job, outcome, step, used, parameters)
    if step_tolerance is not None:
        _check_step(model, job, result, used, step_tolerance)
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


def as_result(
    model: Model, job: Job, outcome: Outcome, step: float, backend: str, parameters: dict[str, float] | None
) -> Result:
    """A finished run with its names."""
    names = [mode.name for mode in model.modes]
    return Result(
        model=model,
        time=np.arange(job.outputs + 1, dtype=np.float64) * np.float64(rational(step)),
        values=outcome.y,
        states=outcome.states,
        modes=outcome.modes,
        events=tuple((float(t), names[int(k)], float(v)) for t, k, v in outcome.log),
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
) -> Job:
    """Everything one run needs, checked and in the runtime's form; see `simulate` for the arguments."""
    for name, value in (("stop", stop), ("step", step)):
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(f"{name} is {value}", remedy=f"give a {name} time above zero, in seconds")
    if internal_step is not None and not (math.isfinite(internal_step) and internal_step > 0):
        raise ParameterError(f"internal_step is {internal_step}", remedy="give a time above zero, in seconds")
    p = model.parameter_vector(parameters)
    x0 = start_values(model, p, initial)
    knots, values, linear = _driven(model, drive)
    instants = [step, *[c.period for c in model.clocks], *[c.offset for c in model.clocks]]
    tick = common_tick(instants)
    if (np.abs(knots - np.round(knots / float(tick)) * float(tick)) > 0.5e-9).any():
        tick = common_tick([*instants, 1e-9])
    if tick < Fraction(1, 10**13):
        raise ParameterError(
            f"step and sample periods {instants} have no common tick", remedy="make them multiples of one another"
        )
    outputs = int(Fraction(stop + 1e-9 * step) / rational(step))
    if outputs > 200_000_000:
        raise ParameterError(f"{outputs} rows are too many", remedy="give a longer step or an earlier stop")
    return Job(
        p=p,
        x0=x0,
        d0=np.array(model.functions["memory_start"](p).full()).ravel(),
        m0=np.full(len(model.modes), np.nan),
        resolution=float(tick),
        hmax=internal_step or choose_step(model, p, x0, step),
        outputs=outputs,
        output_ticks=int(rational(step) / tick),
        period=[int(rational(c.period) / tick) for c in model.clocks],
        offset=[int(rational(c.offset) / tick) for c in model.clocks],
        knot=np.round(knots / float(tick)).astype(np.int64),
        value=values,
        linear=linear,
        record_states=record_states,
        log_capacity=log_capacity,
    )


def _driven(model: Model, drive: Drive | None) -> tuple[Vector, NDArray[np.float64], list[int]]:
    n = len(model.inputs)
    if drive is None:
        return np.zeros(1), np.zeros((1, n)), [0] * n
    time = np.atleast_1d(np.asarray(drive.time, dtype=float))
    values = np.asarray(drive.values, dtype=float).reshape(len(time), -1)
    if values.shape[1] != n:
        raise ParameterError(f"the drive has {values.shape[1]} columns but the model has {n} inputs")
    if not (np.isfinite(time).all() and np.isfinite(values).all()):
        raise ParameterError("the drive holds values that are not finite")
    if (np.diff(time) <= 0).any():
        raise ParameterError(f"the drive's time runs backwards at row {int(np.argmax(np.diff(time) <= 0)) + 1}")
    holds = (drive.hold,) * n if isinstance(drive.hold, str) else drive.hold
    if time[0] > 0:
        time, values = np.concatenate([[0.0], time]), np.vstack([values[:1], values])
    return time, values, [int(hold == "linear") for hold in holds]


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


def explain(model: Model, outcome: Any) -> str:
    """Why a run stopped early, in a sentence."""
    at = f"at t = {outcome.t1:.9g} s"
    if outcome.status == native.NOT_FINITE:
        return f"the simulation diverged {at}: state '{model.states[outcome.culprit].name}' is not finite"
    if outcome.status == native.CANCELLED:
        return f"the simulation was cancelled {at}"
    if outcome.status == native.EXTERNAL:
        return f"{external.explain(model, outcome.culprit, outcome.cause)}, {at}"
    name = model.modes[outcome.culprit].name if model.modes else "?"
    if outcome.status == native.CHATTER:
        return f"more than {native.EVENTS_PER_STEP} switches within one step {at}: '{name}' chatters"
    return f"no consistent mode was found {at}: '{name}' switches back and forth"
