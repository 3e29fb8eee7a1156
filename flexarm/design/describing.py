"""What the nonlinear model answers to sines: describing functions with their harmonics, by amplitude and frequency.

The answer y to u = a sin(w t) is sum_k Im(Y_k exp(i k w t)) plus its mean, and the describing function is Y_1 / a. The
periodic answer itself is that of `diagnosis.frequency_response`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagnosis.frequency_response.period import PeriodicSolution
from diagnosis.frequency_response.periodic_solver import PeriodicSolver
from diagnosis.frequency_response.sine_model import settling_time, sine_model
from diagnosis.recordings.types import Channel, FrequencyTable
from engine.errors import FlexarmError, ParameterError, Where
from engine.linear_modes import audible, hearing
from engine.linearise import LinearModel, linearise, linearise_at, operating_point
from engine.model import Vector
from engine.quantity import convert
from engine.simulate import simulate
from flexarm.cut import Cut
from flexarm.sweeps.plan import texts_of

POINTS = 4096
"""Smallest number of steps in the period from which harmonics are read: a jump is placed to half a step."""

MOST = 20_000
"""Sines of one description."""


@dataclass(frozen=True)
class Description:
    """Answers of a model to sines on one input.

    Attributes:
        input: name of the input.
        outputs: names, m of them.
        units: name -> unit.
        amplitude: of the sines, shape (a,).
        frequency: rad/s, shape (w,).
        harmonics: complex amplitudes Y_k, k = 1, 2, ..., shape (a, w, m, harmonics).
        mean: of each output over a period, shape (a, w, m).
        half_range: half the peak to peak of each output, shape (a, w, m).
        settled: whether a periodic answer was found, shape (a, w).
        linear: linear models beside it, by what they are called.
    """

    input: str
    outputs: tuple[str, ...]
    units: dict[str, str]
    amplitude: Vector
    frequency: Vector
    harmonics: NDArray[np.complex128]
    mean: NDArray[np.float64]
    half_range: NDArray[np.float64]
    settled: NDArray[np.bool_]
    linear: dict[str, LinearModel] = field(default_factory=dict, repr=False)

    @property
    def gain(self) -> NDArray[np.complex128]:
        """Describing functions, shape (a, w, m)."""
        return np.asarray(self.harmonics[..., 0] / self.amplitude[:, None, None])

    @property
    def distortion(self) -> NDArray[np.float64]:
        """Root of the summed squares of the higher harmonics over the first, shape (a, w, m)."""
        higher = np.sqrt(np.sum(np.abs(self.harmonics[..., 1:]) ** 2, axis=-1))
        return np.asarray(higher / np.maximum(np.abs(self.harmonics[..., 0]), 1e-300))

    def to_xarray(self) -> Any:
        """Everything as an xarray Dataset over amplitude, frequency, output and harmonic."""
        import xarray as xr

        dims = ("amplitude", "frequency", "output")
        return xr.Dataset(
            {
                "gain": (dims, self.gain),
                "harmonics": ((*dims, "harmonic"), self.harmonics),
                "mean": (dims, self.mean),
                "half_range": (dims, self.half_range),
                "settled": (dims[:2], self.settled),
            },
            {
                "amplitude": ("amplitude", self.amplitude, {"units": self.units.get(self.input, "")}),
                "frequency": ("frequency", self.frequency, {"units": "rad/s"}),
                "output": list(self.outputs),
                "harmonic": np.arange(1, self.harmonics.shape[-1] + 1),
            },
        )


def frequencies_of(given: str | Sequence[float | str] | Vector) -> Vector:
    """Frequencies in rad/s from ``START:STOP:N:log`` or ``A,B,C`` with Hz or rad/s, or numbers and texts one by one.

    Raises:
        FlexarmError: a text that cannot be read, or a frequency that is not above zero.
    """
    where = Where("--frequencies")
    try:
        every = texts_of(given) if isinstance(given, str) else given
        values = np.array([convert(one if isinstance(one, str) else float(one), "rad/s") for one in every])
    except FlexarmError as error:
        raise error.at(where) from None
    if not (np.isfinite(values).all() and (values > 0).all()):
        raise ParameterError("frequencies must be above zero", where, "write for example '0.1 Hz:100 Hz:30:log'")
    return values


def describe(
    made: Cut,
    amplitudes: Sequence[float] | Vector,
    frequencies: Sequence[float] | Vector,
    *,
    harmonics: int = 5,
    progress: Callable[[float], None] | None = None,
) -> Description:
    """Answers to sines of every amplitude at every frequency.

    Args:
        made: the model, with one input.
        amplitudes: of the sines (SI).
        frequencies: rad/s.
        harmonics: highest that is given.
        progress: told the fraction done.

    Raises:
        FlexarmError: not one input, amplitudes or frequencies that are not above zero, no harmonic, an unstable model.
    """
    if len(made.settings.inputs) != 1:
        raise FlexarmError(
            f"a sine drives one input, and here are {len(made.settings.inputs)}",
            remedy="name one with -u, or in 'inputs:' of the analysis",
        )
    a, w = np.asarray(amplitudes, dtype=float), np.asarray(frequencies, dtype=float)
    for name, values in (("amplitudes", a), ("frequencies", w)):
        if not (len(values) and np.isfinite(values).all() and (values > 0).all()):
            raise ParameterError(f"the {name} must be above zero", remedy="give at least one")
    if harmonics < 1:
        raise ParameterError(f"{harmonics} harmonics are none", remedy="give at least 1, which is the sine itself")
    if len(a) * len(w) > MOST:
        raise ParameterError(f"{len(a) * len(w)} sines are too many", remedy=f"at most {MOST}")
    (driven,) = made.settings.inputs
    unit = made.model.inputs[0].unit
    outputs = list(made.settings.outputs)
    channels = tuple(Channel(name, "", np.zeros(0)) for name in outputs)
    table = FrequencyTable("", "", driven, np.zeros(0), np.zeros(0), unit if unit != "*" else "1", channels)
    solver = PeriodicSolver(made.model, sine_model(made.scenario, table))
    rows = np.array([(x, y) for x in a for y in w])
    if solver.model.states or solver.model.memories:
        found = solver.solve({}, rows[:, 1], rows[:, 0], {}, progress)
    else:  # a law without memory answers at once
        found = [_static(solver, float(size), float(speed)) for size, speed in rows]
    y = [
        _read(made, solver, one, float(row[0]), float(row[1]), harmonics) for one, row in zip(found, rows, strict=True)
    ]
    shape = (len(a), len(w), len(outputs))
    units = {v.name: v.unit for v in (*made.model.inputs, *made.model.outputs)}
    return Description(
        driven,
        tuple(outputs),
        units,
        a,
        w,
        np.array([row[0] for row in y]).reshape(*shape, harmonics),
        np.array([row[1] for row in y]).reshape(shape),
        np.array([one.amplitudes for one in found]).reshape(shape),
        np.array([one.settled for one in found]).reshape(shape[:2]),
        _beside(made),
    )


def _values(solver: PeriodicSolver, amplitude: float, frequency: float) -> dict[str, float]:
    sine = solver.driven.sine
    return {f"{sine}.amplitude": amplitude, f"{sine}.frequency": frequency / (2 * math.pi)}


def _static(solver: PeriodicSolver, amplitude: float, frequency: float) -> PeriodicSolution:
    """The answer of a model without states."""
    p, step = solver.model.parameter_vector(_values(solver, amplitude, frequency)), 2 * math.pi / frequency / POINTS
    job = solver.periods.job(p, np.zeros(0), step, POINTS)
    run = solver.periods.run(job)
    return PeriodicSolution(solver.periods.half_range(job, run), run.y[1:].std(axis=0), np.zeros(0))


def _read(
    made: Cut, solver: PeriodicSolver, found: PeriodicSolution, amplitude: float, frequency: float, count: int
) -> tuple[NDArray[np.complex128], Vector]:
    """Harmonics, shape (outputs, count), and means of one periodic answer."""
    period = 2 * math.pi / frequency
    model, values = solver.model, _values(solver, amplitude, frequency)
    if found.run is None and found.x is None and not model.clocks:
        return _linear(made, amplitude, frequency, count)
    if model.clocks:
        # A run with clocks does not go on from its states alone: the last period of a long one is read.
        p = model.parameter_vector(values)
        cycles = max(4, 2 * math.ceil(settling_time(model, p, 6.0) / period))
        rows = max(POINTS // 4, math.ceil(4 * period / min(clock.period for clock in model.clocks)))
        run = simulate(model, cycles * period, period / rows, parameters=values, log_capacity=0)
        y = run.values[-rows - 1 : -1]
        shift = (run.time[-rows - 1] % period) * frequency
        return _fourier(y, count, shift)
    x = found.run.x if found.run is not None and found.run.begin == 0 else found.x
    rows = max(POINTS, found.run.rows if found.run is not None else POINTS)
    job = solver.periods.job(model.parameter_vector(values), x, period / rows, rows)
    return _fourier(solver.periods.run(job).y[:-1], count, 0.0)


def _fourier(y: NDArray[np.float64], count: int, shift: float) -> tuple[NDArray[np.complex128], Vector]:
    """Harmonics and means of one period of samples that begins at phase ``shift`` (rad)."""
    spectrum = np.fft.rfft(y, axis=0) * 2j / len(y)
    order = np.arange(1, count + 1)
    return (spectrum[1 : count + 1] * np.exp(-1j * order * shift)[:, None]).T, np.asarray(y.mean(axis=0))


def _linear(made: Cut, amplitude: float, frequency: float, count: int) -> tuple[NDArray[np.complex128], Vector]:
    """The same of a model that meets no switch at this amplitude: about where it would come to rest."""
    model, point = made.model, operating_point(made.model)
    linear = linearise_at(model, point)
    rates, rest = (np.array(model.functions[key](*point.arguments).full()).ravel() for key in ("derivative", "outputs"))
    if len(rates):
        rest = rest + linear.C @ np.linalg.lstsq(linear.A, -rates, rcond=1e-12)[0]
    gain = linear.gain(frequency)[:, 0]
    found = np.zeros((len(gain), count), dtype=complex)
    found[:, 0] = gain * amplitude
    return found, rest


def _beside(made: Cut) -> dict[str, LinearModel]:
    """Linear models to draw beside the curves: that of the point, and those in which more inputs are heard."""
    model = made.model
    here = linearise(model)
    rows = [here, *hearing(model, here), audible(model, here)]
    found: dict[str, LinearModel] = {}
    for row in rows:
        label = ", ".join(f"{name} {value}" for name, value in row.modes.items()) or "linear"
        found.setdefault(label, row)
    return found
