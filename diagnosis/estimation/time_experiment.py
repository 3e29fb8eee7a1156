"""A recording over time as an experiment: the model is simulated with its input and compared at its samples."""

from __future__ import annotations

import functools
import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import scipy.fft

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.initial_states import FirstSamples, Start, Statics
from diagnosis.estimation.parameters import Array, FreeParameter
from diagnosis.thresholds import FITTING, NOISE
from engine.errors import FlexarmError, ParameterError, SimulationError
from engine.model import Model
from engine.native import Job
from engine.simulate import Drive, carried_out, prepare, simulate
from engine.start import starting_names
from engine.tangent import tangents

if TYPE_CHECKING:
    from diagnosis.recordings.types import Assumed
    from scenarios.load import Scenario

WINDOW = 0.2
"""Length (s) of the pieces of time in which a residual is said to be large."""


@dataclass(frozen=True, kw_only=True)
class TimeExperiment(Experiment):
    """Signals over time.

    Attributes:
        step: interval (s) of the simulated rows.
        every: simulated rows per sample.
        drive: inputs, in the model's order.
        from_first: for each signal, whether it counts from the first sample.
        uneven: whether ``time`` is not a multiple of the rows' interval: the rows are then simulated at these instants.
        outliers: for each signal, how many samples were left out as spikes.
        logged: for each signal, its unit over a number as it was logged.
        loop, assumed, wraps: as of the recording.
        noise_stated: for each signal, whether the user stated its noise; none if that is not known.
        stated: starting values that the user gave (SI).
        first: what was recorded at first, before any resampling; None if the model's own start is meant.
        begin: where the state begins on the model; see `on_model`.
        merged: interval of the simulated rows over that of the recording as it was prepared, and over ``thinned``.
    """

    sparse: ClassVar[bool] = False

    step: float
    every: int
    drive: Drive | None
    from_first: tuple[bool, ...]
    uneven: bool = False
    outliers: tuple[int, ...] = ()
    logged: tuple[float, ...] = ()
    loop: str = "open"
    assumed: Mapping[tuple[str, ...], Assumed] = field(default_factory=dict)
    wraps: Mapping[str, bool] = field(default_factory=dict)
    noise_stated: tuple[bool, ...] = ()
    stated: dict[str, float] = field(default_factory=dict)
    merged: float = 1.0
    first: FirstSamples | None = None
    begin: Start = field(default_factory=Start)

    def on_model(self, statics: Statics, *, as_measured: bool = False) -> TimeExperiment:
        """The experiment with the starting values that its first samples and the model's statics give.

        Raises:
            RecordingError: starting values that the model does not have, or that contradict each other.
        """
        if not (self.free or self.stated or as_measured):
            return self
        samples = self.first or self._first_samples(len(statics.model.inputs))
        made = statics.at(self.settings).start(
            samples, self.free, self.stated, as_measured=as_measured, before=self.begin
        )
        told = {place: made.free for place in self.assumed if place[-2:] == ("initial", "free")}
        return replace(
            self,
            free=made.free,
            initial=dict(made.values),
            deviations=dict(made.deviations),
            measured_starts=made.measured,
            begin=made,
            first=samples,
            assumed={**self.assumed, **told},
        )

    def _first_samples(self, inputs: int) -> FirstSamples:
        first = np.zeros(0)
        if self.drive is not None and inputs:
            first = np.asarray(self.drive.values, dtype=float).reshape(-1, inputs)[0]
        keep = FITTING.first_samples
        whole = np.isfinite(self.measured).all(axis=1).cumsum() >= keep
        # What was measured long after the start does not tell it.
        end = min(int(np.argmax(whole)) + 1 if whole.any() else len(self.time), FITTING.first_rows)
        known = self.noise_stated or (False,) * len(self.sigma)
        return FirstSamples(self.name, self.time[:end], self.measured[:end], self.sigma, known, self.from_first, first)

    @property
    def stop(self) -> float:
        """End of the simulation (s)."""
        if self.uneven:
            return float(self.time[-1])
        return float(self.step * self.every * (len(self.time) - 1))

    @property
    def longest_step(self) -> float:
        """Time (s) between simulated rows, which no integration step exceeds."""
        return self.step

    @property
    def interval(self) -> float:
        """Time (s) between samples."""
        return self.step * self.every

    @property
    def finest_step(self) -> float:
        """The shortest integration step (s) that a model is given; what needs shorter ones, the samples cannot show."""
        return self.step / self.thinned / self.merged / FITTING.finest

    @property
    def shortest(self) -> float:
        """The shortest time (s) that it resolves: the interval between the samples that were recorded."""
        return self.interval / self.thinned

    @property
    def longest(self) -> float:
        """The longest time constant (s) that it can tell from a longer one: as long as it is itself."""
        return float(self.time[-1] - self.time[0])

    def sampled(self, rows: Array) -> Array:
        """Simulated rows at the recorded instants, shape (samples, ...)."""
        return rows if self.uneven else rows[:: self.every][: len(self.time)]

    @property
    def _instants(self) -> Array | None:
        """Where the simulated rows are (s); None: at multiples of ``step``."""
        return self.time if self.uneven else None

    def cut(self, share: float) -> TimeExperiment:
        """The first part of it, at least eight samples."""
        if share >= 1:
            return self
        keep = max(8, int(np.searchsorted(self.time, share * float(self.time[-1]))))
        return replace(self, time=self.time[:keep], measured=self.measured[:keep])

    def averaged(self, count: int) -> TimeExperiment:
        """The experiment at every ``count``-th sample, smoothed there, with the mean input from it to the next.

        The first and the last sample are left out, for they have no others on one side.
        """
        drive = self.drive
        if drive is not None:
            drive = _mean_drive(drive, self.interval * count, self.stop)
        return replace(
            self,
            time=self.time[::count],
            measured=self.smoothed(self.measured, count),
            sigma=self.sigma * math.sqrt(float(np.sum(_smoother(count) ** 2))),
            drive=drive,
            step=self.interval * count,
            every=1,
            merged=self.merged * self.every,
            thinned=self.thinned * count,
            coarse=True,
        )

    def stepped(self, parts: int) -> TimeExperiment:
        """The same samples with so many simulated rows for each; as it is if the recording itself has no more."""
        if self.uneven or parts == self.every or parts > self.every * self.thinned:
            return self
        return replace(
            self,
            step=self.interval / parts,
            every=parts,
            merged=self.merged * self.every / parts,
            coarse=True,
        )

    def smoothed(self, rows: Array, count: int) -> Array:
        """Every ``count``-th sample (samples, columns) of a cubic through those around it [Savitzky 1964].

        NaN where one of them is missing, and at the ends.
        """
        size = len(self.time[::count])
        padded = np.full((size * count + count + 1, rows.shape[1]), np.nan)
        padded[count : count + len(rows)] = rows[: len(padded) - count]
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * count + 1, axis=0)[::count][:size]
        return np.asarray(windows @ _smoother(count))

    def outputs(
        self, model: Model, parameters: dict[str, float], starts: dict[str, float], longest: float | None
    ) -> Array:
        """Simulated outputs, shape (rows, signals), at integration steps of at most ``longest`` (s).

        Raises:
            SimulationError: the run diverged.
        """
        return carried_out(model, self.job(model, parameters, starts, longest))[1].y

    def visited(
        self, model: Model, parameters: dict[str, float], starts: dict[str, float], longest: float | None
    ) -> Array:
        """States that a run passes through, at most `FITTING.visited` rows of them; arguments as of `outputs`.

        Raises:
            SimulationError: the run diverged.
        """
        states = carried_out(model, self.job(model, parameters, starts, longest, record_states=True))[1].states
        assert states is not None
        return states[:: math.ceil(len(states) / FITTING.visited)]

    def job(
        self,
        model: Model,
        parameters: dict[str, float],
        starts: dict[str, float],
        longest: float | None,
        *,
        record_states: bool = False,
    ) -> Job:
        """The run that gives the outputs, and the states if asked for; arguments as of `outputs`.

        Raises:
            ParameterError, SimulationError: it cannot be begun.
        """
        return prepare(
            model,
            self.stop,
            self.step,
            parameters={**parameters, **self.settings},
            drive=self.drive,
            initial=self.begin.complete(starts),
            internal_step=longest,
            record_states=record_states,
            log_capacity=0,
            rows=self._instants,
        )

    def linearised(
        self,
        model: Model,
        free: Sequence[FreeParameter],
        x: Array,
        starts: dict[str, float],
        longest: float | None,
        only: Sequence[int] | None = None,
    ) -> tuple[Array, Array]:
        """Residual, flat, and its Jacobian with respect to the search vector, by tangents; see `Experiment`.

        Raises:
            SimulationError: the run diverged.
        """
        parameters = {f.name: f.value(v) for f, v in zip(free, x, strict=True) if not f.recording}
        asked = range(len(free)) if only is None else only
        mine = [i for i in asked if free[i].recording in ("", self.name) and free[i].name not in self.settings]
        names = [free[i].name for i in mine]
        followers = [name for name, shares in self.begin.follows.items() if not shares.keys().isdisjoint(names)]
        own_starts = Counter(f.recording for f in free if f.recording)
        room = max(own_starts.values(), default=0) + len(self.begin.follows)
        if not all(free[i].recording for i in mine):
            room += sum(not f.recording for f in free)
        try:
            found = tangents(
                model,
                self.stop,
                self.step,
                wrt=[*names, *followers],
                parameters={**parameters, **self.settings},
                drive=self.drive,
                initial=self.begin.complete(starts),
                internal_step=longest,
                rows=self._instants,
                room=room,
            )
        except ParameterError as error:
            raise SimulationError(error.message) from error
        r = np.clip(self.residual(found.result.values), -FITTING.huge, FITTING.huge).ravel()
        slopes = self.slopes(found.values).reshape(len(r), len(names) + len(followers))
        for k, follower in enumerate(followers):
            for name, share in self.begin.follows[follower].items():
                if name in names:
                    slopes[:, names.index(name)] += share * slopes[:, len(names) + k]
        with np.errstate(over="ignore"):  # what overflows is beyond the bounds below
            own = slopes[:, : len(names)] * np.array([free[i].slope(x[i]) for i in mine])
        # NaN is not within bounds either.
        if own.size and not (own.max() <= FITTING.huge**2 and own.min() >= -(FITTING.huge**2)):
            raise SimulationError("the sensitivities grow without bound")
        if mine == list(range(len(free))):
            return r, own
        J = np.zeros((len(free), len(r))).T
        J[:, mine] = own
        return r, J

    def residual(self, simulated: Array) -> Array:
        """(measured - simulated) / sigma, zero where nothing was recorded; shape (samples, signals)."""
        rows = self.sampled(simulated)
        if any(self.from_first):
            rows = rows - np.where(self.from_first, rows[0], 0.0)
        with np.errstate(over="ignore"):  # a run that nearly diverges: its residual is bounded by whoever asks
            made = np.asarray((self.measured - rows) / self._sigmas)
        if self._unknown is not None:
            made[self._unknown] = 0.0
        return made if np.isfinite(made).all() else np.nan_to_num(made, nan=0.0)

    @functools.cached_property
    def _unknown(self) -> Array | None:
        """Where nothing was recorded; None if everything was."""
        unknown = np.isnan(self.measured)
        return unknown if unknown.any() else None

    @functools.cached_property
    def _sigmas(self) -> Array:
        """The noise of each sample: arrays of one shape are divided in one go."""
        return np.tile(self.sigma, (len(self.measured), 1))

    def slopes(self, values: Array) -> Array:
        """Derivative of the residual, shape (samples, signals, directions), from that of the outputs."""
        rows = self.sampled(values)
        if any(self.from_first):
            rows = rows - np.where(np.asarray(self.from_first)[:, None], rows[0], 0.0)
        made = (rows.transpose(2, 0, 1) / -self._sigmas).transpose(1, 2, 0)
        if self._unknown is not None:
            made[self._unknown] = 0.0
        return made

    def on_variant(
        self, scenario: Scenario, inputs: Sequence[str], outputs: Sequence[str], others: Sequence[Experiment]
    ) -> tuple[Model, list[Experiment]]:
        """The model, and the experiments as they are: inputs and samples do not depend on the model.

        Raises:
            FlexarmError: the variant has no meaning, or lost a state that recordings start from.
        """
        model = scenario.build(inputs, outputs, variant=True, smooth_readings=True)
        if len(model.outputs) < len(outputs):
            twice = next(name for k, name in enumerate(outputs) if name in outputs[:k])
            raise FlexarmError(f"two sensors would both read '{twice}'")
        lost = {name for e in others for name in e.free} - set(starting_names(model))
        if lost:
            raise FlexarmError(f"'{min(lost)}', which a recording starts from, is no state of the amended model")
        statics = Statics(model)
        return model, [e.on_model(statics) if isinstance(e, TimeExperiment) else e for e in others]

    def fingerprint(self) -> list[Array]:
        """Instants, samples, noise, the input if there is one, and what the recording begins from and sets."""
        driven = [np.asarray(self.drive.values, dtype=float)] if self.drive is not None else []
        own = [np.array([v for _, v in sorted(part.items())]) for part in (self.initial, self.settings)]
        return [self.time, self.measured, self.sigma, *driven, *own]

    def evenly(self, r: Array) -> tuple[Array, float]:
        """Residuals at even instants, shape (samples, signals), and the interval (s): a spectrum needs both."""
        if not self.uneven:
            return r, float(self.time[1] - self.time[0])
        even = np.linspace(self.time[0], self.time[-1], len(self.time))
        columns = [np.interp(even, self.time, column) for column in r.T]
        return np.column_stack(columns), float(even[1] - even[0])

    def components(self, rows: Array) -> Array:
        """Rows (samples, ...) as amplitudes of cosines, whose squares sum to the same [Ahmed 1974]."""
        even = self.even(rows)
        if rows.ndim < 3:
            return np.asarray(scipy.fft.dct(even, axis=0, norm="ortho"))
        return np.asarray(scipy.fft.dct(even.transpose(2, 0, 1), axis=1, norm="ortho")).transpose(1, 2, 0)

    def even(self, rows: Array) -> Array:
        """Rows (samples, ...) at even instants."""
        if not self.uneven:
            return rows
        return self.evenly(rows.reshape(len(rows), -1))[0].reshape(rows.shape)

    def bands(self, fewest: int) -> list[tuple[int, slice]]:
        """Bands of a third of an octave, numbered from 1 Hz; the lowest cosines are one band."""
        n = len(self.time)
        lowest = 1 / (2 * float(self.time[-1] - self.time[0]))  # Hz, of the first cosine
        number = np.zeros(n, dtype=int)
        number[1:] = np.floor(3 * np.log2(lowest * np.arange(1, n)))
        number[: min(fewest + 1, n)] = number[min(fewest, n - 1)]
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), n]
        return [(int(number[a]), slice(a, b)) for a, b in itertools.pairwise(edges)]

    def lines(self, r: Array, most: int) -> dict[float, float]:
        """The frequencies (rad/s) of the ``most`` largest peaks of a residual's spectrum, with their power."""
        if len(self.time) < NOISE.fewest:
            return {}
        r, _ = self.evenly(r)
        power = np.sum(power_spectrum(r), axis=1)
        rate = 2 * math.pi / float(self.time[-1] - self.time[0])
        peaks = [k for k in range(2, len(power) - 1) if power[k] == power[k - 2 : k + 3].max()]
        return {k * rate: float(power[k]) for k in sorted(peaks, key=lambda k: -power[k])[:most]}

    def disturbed_inputs(self, size: float, delay: float) -> list[TimeExperiment]:
        """The same with a larger and with a later input; nothing if no input was recorded."""
        if self.drive is None:
            return []
        larger = replace(self.drive, values=np.asarray(self.drive.values, dtype=float) * (1 + size))
        later = replace(self.drive, time=np.asarray(self.drive.time, dtype=float) + delay * self.shortest)
        return [replace(self, drive=larger), replace(self, drive=later)]

    def largest_inputs(self, count: int) -> Array:
        """Largest magnitude of each input, shape (count,); empty if none was recorded."""
        if self.drive is None:
            return np.zeros(0)
        values = np.asarray(self.drive.values, dtype=float).reshape(-1, count)
        return np.asarray(np.abs(values).max(axis=0))

    def spans(
        self, scenario: Scenario, model: Model, names: Sequence[str], longest: float | None
    ) -> dict[str, tuple[float, float]]:
        """Peak to peak and root mean square of signals, simulated with the recorded input."""
        run = simulate(model, self.stop, self.step, parameters=self.settings, drive=self.drive, internal_step=longest)
        return {name: (float(np.ptp(run[name])), float(np.sqrt(np.mean(run[name] ** 2)))) for name in names}

    def where_residual_is_large(self, r: Array, names: Sequence[str]) -> tuple[str, str]:
        """When half of the residual's energy occurs, and the frequency of its largest spectral line."""
        r, dt = self.evenly(r)
        energy = np.sum(r**2, axis=1)
        length = max(1, round(WINDOW / dt))
        edges = np.arange(0, len(energy), length)
        blocks = np.add.reduceat(energy, edges)
        order = np.argsort(-blocks)
        count = int(np.searchsorted(np.cumsum(blocks[order]), 0.5 * blocks.sum())) + 1
        starts = sorted(float(edges[i] * dt) for i in order[:count])
        when = (
            f"half of it within {count * length * dt:.2g} s of {len(energy) * dt:.2g} s, "
            f"from {_merged(starts, length * dt)}"
        )
        k = int(np.argmax(np.sum(r**2, axis=0)))
        peak = int(np.argmax(power_spectrum(r[:, [k]])[1:])) + 1
        return when, f"strongest at {peak / (len(r) * dt):.3g} Hz, in {names[k]}"


@functools.cache
def _smoother(count: int) -> Array:
    """Weights of a cubic through ``2 count + 1`` samples, at its middle; it bends no signal that is slow there.

    [Savitzky 1964]. SciPy has them too, in a package that takes half a second to import.
    """
    return np.asarray(np.linalg.pinv(np.vander(np.linspace(-1.0, 1.0, 2 * count + 1), 4, increasing=True))[0])


def _mean_drive(drive: Drive, interval: float, stop: float) -> Drive:
    """The drive held over intervals at its mean there."""
    time = np.asarray(drive.time, dtype=float)
    values = np.asarray(drive.values, dtype=float).reshape(len(time), -1)
    edges = np.arange(int(stop / interval + 1e-6) + 2) * interval
    columns = []
    for column, hold in zip(values.T, drive.holds(values.shape[1]), strict=True):
        rise = np.diff(time) * (column[:-1] if hold == "zero_order" else (column[:-1] + column[1:]) / 2)
        area = np.concatenate([[0.0], np.cumsum(rise)])
        k = np.clip(np.searchsorted(time, edges, side="right") - 1, 0, len(time) - 1)
        later = edges - time[k]
        slope = np.zeros(len(edges))
        if hold != "zero_order":
            inside = k < len(time) - 1
            slope[inside] = np.diff(column)[k[inside]] / np.diff(time)[k[inside]]
        columns.append(np.diff(area[k] + column[k] * later + 0.5 * slope * later**2) / interval)
    return Drive(edges[:-1], np.column_stack(columns), "zero_order")


def power_spectrum(r: Array, length: int | None = None) -> Array:
    """Squared magnitude of the Fourier transform of windowed columns without their mean, shape (lines, columns).

    Args:
        r: shape (samples, columns).
        length: samples of the transform, zeros behind those given; as many as those if None.
    """
    windowed = (r - r.mean(axis=0)) * np.hanning(len(r))[:, None]
    return np.asarray(np.abs(np.fft.rfft(windowed, length, axis=0)) ** 2)


def _merged(starts: Sequence[float], width: float) -> str:
    """Pieces of time that touch each other as spans, in words."""
    merged: list[list[float]] = []
    for begin in starts:
        if merged and begin - merged[-1][1] < 1e-9 + 0.5 * width:
            merged[-1][1] = begin + width
        else:
            merged.append([begin, begin + width])
    shown = [f"{a:.2f}-{b:.2f} s" for a, b in merged[:4]]
    return ", ".join(shown) + (", ..." if len(merged) > 4 else "")


def over_time(experiments: Sequence[Experiment]) -> list[TimeExperiment]:
    """Those of some experiments that are recordings over time."""
    return [e for e in experiments if isinstance(e, TimeExperiment)]
