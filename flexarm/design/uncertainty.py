"""Uncertainty from evidence: a family of linear models from a fit's covariance, and what it leaves over as a weight.

Parameters are drawn from the normal distribution of the fit's search vector, whose covariance is that of
`diagnosis.estimation.covariance`. What recordings that were not fitted still leave over, beyond what the draws and the
noise predict, is covered by a weight W(s) of low order on each signal: measured = (1 + W D) predicted, with a D of gain
1 that nobody knows. The bound is to hold 95 % of the bins of a spectrum; it is calibrated on one part of the held-out
data and scored on another, never on the same.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from engine.errors import FlexarmError, ParameterError
from engine.family import Axis, LinearFamily, collect
from engine.linearise import operating_point
from flexarm.cut import Cut
from flexarm.design.point import point, start_of

if TYPE_CHECKING:
    import control

    from diagnosis.estimation.least_squares import Fit
    from diagnosis.estimation.time_experiment import TimeExperiment

LEVEL = 0.95
"""Share of the bins of a spectrum that the bound is to hold."""

SMOOTH = 9
"""Bins over which spectra are averaged where a weight is fitted."""

LOWEST_BIN = 2
"""First bin of a window that counts: the mean and the trend of a record are not its response."""

ORDER = 2
"""Highest order of a weight."""


@dataclass(frozen=True)
class Weight:
    """A stable, minimum-phase weight, gain (1 + s/z1) ... / ((1 + s/p1) ...).

    Attributes:
        signal: it stands on.
        zeros, poles: rad/s, as positive numbers.
        gain: at rest.
    """

    signal: str
    zeros: tuple[float, ...]
    poles: tuple[float, ...]
    gain: float

    def __call__(self, frequency: Any) -> Any:
        """Gain at frequencies (rad/s)."""
        s = 1j * np.asarray(frequency, dtype=float)
        value = np.full(s.shape, complex(self.gain))
        for z in self.zeros:
            value = value * (1 + s / z)
        for p in self.poles:
            value = value / (1 + s / p)
        return np.abs(value)

    def to_control(self) -> control.StateSpace:
        """As a python-control system."""
        import control

        top = np.poly1d([self.gain])
        for z in self.zeros:
            top = top * np.poly1d([1 / z, 1])
        bottom = np.poly1d([1.0])
        for p in self.poles:
            bottom = bottom * np.poly1d([1 / p, 1])
        return control.tf2ss(control.tf(top.coeffs, bottom.coeffs))


@dataclass(frozen=True)
class Band:
    """A held-out response and the bound predicted for it.

    Attributes:
        recording, signal, unit: what it is of.
        part: the part of the recording, from 0 to 1.
        frequency: rad/s, shape (k,).
        measured, predicted: amplitudes of the response, shape (k,).
        left: amplitude of measured - predicted, shape (k,).
        bound: on it, shape (k,); calibrated on other data.
        parametric: what the draws alone predict, shape (k,).
    """

    recording: str
    signal: str
    unit: str
    part: tuple[float, float]
    frequency: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    left: NDArray[np.float64]
    bound: NDArray[np.float64]
    parametric: NDArray[np.float64]

    @property
    def coverage(self) -> float:
        """Share of the bins whose response lies within the bound."""
        return float(np.mean(self.left <= self.bound))

    @property
    def coverage_excited(self) -> float:
        """The same over the bins in which the predicted response is within 40 dB of its peak."""
        there = self.predicted >= 0.01 * self.predicted.max()
        return float(np.mean((self.left <= self.bound)[there]))


@dataclass(frozen=True)
class UncertainModel:
    """What recordings say of a model, for control design.

    Attributes:
        nominal: number of the fitted model in the family: 0.
        family: linear models over ``sample``; the first is the fitted one.
        samples: parameter values of each, SI units.
        names: of the fitted parameters.
        covariance: of these parameters at the fit, to first order, SI units, shape (p, p).
        weights: unstructured uncertainty of each measured signal.
        bands: held-out responses with their bounds; each calibrated on other data.
        fit: the fit.
    """

    family: LinearFamily
    samples: tuple[dict[str, float], ...]
    names: tuple[str, ...]
    covariance: NDArray[np.float64]
    weights: dict[str, Weight]
    bands: tuple[Band, ...]
    fit: Fit = field(repr=False)
    nominal: int = 0

    @property
    def coverage(self) -> float:
        """Share of all bins of all held-out responses within their bounds; nan without held-out data."""
        bins = sum(len(band.frequency) for band in self.bands)
        return sum(band.coverage * len(band.frequency) for band in self.bands) / bins if bins else math.nan

    def to_control(self) -> tuple[Any, list[Any], dict[str, Any]]:
        """Nominal model, samples and weights, as python-control systems."""
        every = self.family.to_control()
        return every[0], list(every[1:]), {name: weight.to_control() for name, weight in self.weights.items()}


def uncertain(
    made: Cut,
    fit: Fit,
    *,
    samples: int = 50,
    seed: int = 0,
    modes: Any = None,
    at: Any = None,
    trim: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> UncertainModel:
    """A family of linear models, and a bound on held-out responses, from a fit.

    Args:
        made: inputs and outputs of the linear models.
        fit: of the same scenario, with held-out recordings for the bound.
        samples: members of the family beside the fitted one.
        seed: of the draws.
        modes: as of `flexarm.api.linearise`, and the next two.
        at: the point otherwise.
        trim: an analysis of kind ``trim``.
        progress: told the fraction of the simulations done.

    Raises:
        FlexarmError: no sample, or as of the linear models.
    """
    from diagnosis.estimation.held_out_starts import with_held_out_starts

    if samples < 1:
        raise ParameterError(f"{samples} samples are no family", remedy="give 1 or more")
    x = with_held_out_starts(fit.problem, fit.x)
    draws = _draws(fit, x, samples, seed)
    known = {p.name for p in made.model.parameters}
    values = [{k: v for k, v in fit.problem.values(d)[0].items() if k in known} for d in draws]
    asked = point(made, modes, at)
    there = start_of(made, asked, trim, at)
    there = _heard(made, there, asked, values[0])
    points = [operating_point(made.model, **there, parameters=p) for p in values]
    labels = ("fitted", *(str(k) for k in range(1, len(draws))))
    axis = Axis("sample", "", np.arange(len(draws), dtype=float), labels)
    family = collect(made.model, [axis], points, values)
    bands, weights = _bounds(fit, draws, progress)
    free = [i for i, f in enumerate(fit.problem.free) if not f.recording]
    slope = np.array([fit.problem.free[i].slope(fit.x[i]) for i in free])
    covariance = fit.covariance[np.ix_(free, free)] * np.outer(slope, slope)
    names = tuple(fit.problem.free[i].name for i in free)
    return UncertainModel(family, tuple(values), names, covariance, weights, bands, fit)


def _heard(made: Cut, there: dict[str, Any], asked: dict[str, Any], parameters: dict[str, float]) -> dict[str, Any]:
    """The point in modes in which every input moves some output, as `flexarm.api.linearise` takes them."""
    from engine.linear_modes import audible
    from engine.linearise import linearise

    here = linearise(made.model, **there, parameters=parameters)
    heard = audible(made.model, here, **{**there, "modes": asked["modes"], "parameters": parameters})
    return {**there, "modes": dict(heard.modes)} if heard.modes else there


def _draws(fit: Fit, x: NDArray[np.float64], count: int, seed: int) -> list[NDArray[np.float64]]:
    """The search vector, then draws about it. Starting values of recordings stay."""
    values, vectors = np.linalg.eigh((fit.covariance + fit.covariance.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    still = np.array([bool(f.recording) for f in fit.problem.free])
    random = np.random.default_rng(seed)
    rows = [x]
    for _ in range(count):
        change = root @ random.standard_normal(len(x))
        rows.append(x + np.where(still, 0.0, change))
    return rows


@dataclass(frozen=True)
class _Piece:
    """Spectra of a part of a held-out recording, shape (k,); ``variance`` is that of the draws."""

    recording: str
    signal: str
    unit: str
    part: tuple[float, float]
    frequency: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    left: NDArray[np.float64]
    variance: NDArray[np.float64]


def _bounds(
    fit: Fit, draws: Sequence[NDArray[np.float64]], progress: Callable[[float], None] | None
) -> tuple[tuple[Band, ...], dict[str, Weight]]:
    """Bounds on every part of every held-out recording, each calibrated on all others, and weights from all."""
    from diagnosis.estimation.time_experiment import TimeExperiment

    held = [e for e in fit.problem.held_out if isinstance(e, TimeExperiment)]
    pieces: list[_Piece] = []
    for number, e in enumerate(held):
        pieces += _pieces(fit, draws, e, halves=len(held) < 2)
        if progress is not None:
            progress((number + 1) / len(held))
    bands: list[Band] = []
    weights: dict[str, Weight] = {}
    for signal in dict.fromkeys(piece.signal for piece in pieces):
        mine = [piece for piece in pieces if piece.signal == signal]
        whole = _calibrated(mine)
        weights[signal] = replace(whole.weight, gain=whole.weight.gain * whole.factor)
        for piece in mine:
            others = [other for other in mine if other is not piece]
            if not others:
                continue
            bands.append(_band(piece, _calibrated(others)))
    return tuple(bands), weights


def _pieces(fit: Fit, draws: Sequence[NDArray[np.float64]], e: TimeExperiment, halves: bool) -> list[_Piece]:
    """Spectra of a held-out recording, of its two halves where it is the only one."""
    from engine.errors import SimulationError

    simulated = fit.problem.simulate(draws[0], e)
    nominal, left = e.sampled(simulated), e.residual(simulated) * e.sigma
    spread = []
    for draw in draws[1:]:
        try:
            spread.append(e.sampled(fit.problem.simulate(draw, e)) - nominal)
        except SimulationError:
            continue
    rows, step = len(e.time), float(np.median(np.diff(e.time)))
    ends = [(0, rows // 2), (rows // 2, rows)] if halves else [(0, rows)]
    made = []
    for first, last in ends:
        count = last - first
        if count < 8 * SMOOTH:
            raise FlexarmError(
                f"recording '{e.name}' has {rows} rows, too few for a spectrum", remedy="hold out a longer one"
            )
        window = np.hanning(count)
        size = math.sqrt(float(np.sum(window**2)))
        keep = slice(LOWEST_BIN, None)
        omega = np.asarray(2 * np.pi * np.fft.rfftfreq(count, step)[keep], dtype=np.float64)

        def spectrum(values: Any, window: Any = window, size: float = size, keep: slice = keep) -> Any:
            plain = np.nan_to_num(values - np.nanmean(values))
            return np.abs(np.fft.rfft(plain * window)[keep]) / size

        for k, variable in enumerate(fit.problem.model.outputs):
            changes = np.array([spectrum(row[first:last, k]) ** 2 for row in spread] or [np.zeros(len(omega))])
            variance = changes.mean(axis=0)
            made.append(
                _Piece(
                    e.name,
                    variable.name,
                    variable.unit,
                    (first / rows, last / rows),
                    omega,
                    spectrum(e.measured[first:last, k]),
                    spectrum(nominal[first:last, k]),
                    spectrum(left[first:last, k]),
                    variance,
                )
            )
    return made


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over `SMOOTH` neighbouring bins, fewer at the ends."""
    kernel = np.ones(SMOOTH)
    return np.asarray(np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same"))


@dataclass(frozen=True)
class _Calibration:
    """What is predicted for the difference, times a factor: draws, a white floor, and what they leave over.

    What is left over goes with the response, by a weight, or does not, as a disturbance; whichever is more.

    Attributes:
        weight: on the response.
        floor: mean square of a bin.
        knots, disturbance: rad/s, and the logarithm of the mean square left over about each, linear between them.
        factor: of the whole.
    """

    weight: Weight
    floor: float
    knots: NDArray[np.float64]
    disturbance: NDArray[np.float64]
    factor: float = 1.0

    def bound(self, piece: _Piece) -> NDArray[np.float64]:
        """On the amplitude of each bin."""
        follows = (self.weight(piece.frequency) ** 2) * _smooth(piece.predicted**2)
        stays = np.exp(np.interp(np.log(piece.frequency), np.log(self.knots), self.disturbance))
        return np.asarray(self.factor * np.sqrt(piece.variance + self.floor + np.maximum(follows, stays)))


def _calibrated(pieces: Sequence[_Piece]) -> _Calibration:
    """A weight and a floor that cover what pieces leave over, and the factor by which 95 % of their bins are held.

    The floor is the typical square in the upper quarter of the bins, not the noise that is stated: that may be an
    offset. Bins count by the logarithm of their frequency, so that the few about a resonance weigh as much as the many
    in which there is noise alone.
    """
    omega = np.concatenate([p.frequency for p in pieces])
    upper = np.concatenate([p.left[3 * len(p.left) // 4 :] for p in pieces])
    floor = float(np.median(upper**2)) / math.log(2)
    squares = [_smooth(p.left**2) for p in pieces]
    over = np.concatenate([np.maximum(s - p.variance - floor, 0.02 * s) for s, p in zip(squares, pieces, strict=True)])
    drive = np.concatenate([_smooth(p.predicted**2) + 1e-300 for p in pieces])
    knots, means = _binned(omega, over)
    weight = _weight(pieces[0].signal, omega, np.sqrt(over / drive))
    rough = _Calibration(weight, floor, knots, np.log(np.maximum(means, 1e-300)))
    ratios = np.concatenate([p.left / rough.bound(p) for p in pieces])
    order = np.argsort(ratios)
    share = np.cumsum((1 / omega)[order])
    weighted = float(ratios[order][int(np.searchsorted(share, LEVEL * share[-1]))])
    # Whichever asks for more: the bins as they are, or weighed by their frequency.
    return replace(rough, factor=max(weighted, float(np.quantile(ratios, LEVEL))))


def _binned(omega: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Mean frequencies and mean values of 24 intervals of equal ratio; of those that hold bins."""
    place = np.digitize(omega, np.geomspace(float(omega.min()), float(omega.max()) * (1 + 1e-9), 25))
    found = np.unique(place)
    return tuple(np.array([rows[place == k].mean() for k in found]) for rows in (omega, values))


def _weight(signal: str, omega: NDArray[np.float64], size: NDArray[np.float64]) -> Weight:
    """The weight of lowest order that fits log gains, least squares over log frequency."""
    low, high = float(omega.min()), float(omega.max())
    w, mean = _binned(omega, size**2)
    target = np.log(np.maximum(np.sqrt(mean), 1e-9))
    best = Weight(signal, (), (), float(np.exp(target.mean())))
    cost = float(np.sum((target - target.mean()) ** 2))
    for order in range(1, ORDER + 1):
        side = np.repeat([1.0, -1.0], order)  # zeros raise the gain, poles lower it

        def squares(v: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray((w[:, None] / np.exp(v[1:])) ** 2)

        def left(v: NDArray[np.float64], side: Any = side) -> NDArray[np.float64]:
            return np.asarray(v[0] + np.log1p(squares(v)) @ side / 2 - target)

        def slope(v: NDArray[np.float64], side: Any = side) -> NDArray[np.float64]:
            share = squares(v) / (1 + squares(v))
            return np.column_stack([np.ones(len(w)), -share * side])

        spots = np.log(np.geomspace(low, high, 2 * order + 2)[1:-1])
        for begin in (
            np.concatenate([[target[0]], spots[::2], spots[1::2]]),
            np.concatenate([[target[0]], spots[1::2], spots[::2]]),
        ):
            span = math.log(10)
            lowest = np.concatenate([[-25.0], np.full(2 * order, math.log(low) - span)])
            highest = np.concatenate([[25.0], np.full(2 * order, math.log(high) + span)])
            found = least_squares(left, np.clip(begin, lowest + 1e-6, highest - 1e-6), slope, bounds=(lowest, highest))
            if 2 * found.cost < 0.8 * cost:
                v, cost = found.x, 2 * float(found.cost)
                best = Weight(
                    signal, tuple(np.exp(v[1 : order + 1])), tuple(np.exp(v[order + 1 :])), float(np.exp(v[0]))
                )
    return best


def _band(piece: _Piece, calibration: _Calibration) -> Band:
    # The amplitude of a complex normal bin keeps within sqrt(-ln 0.05) of its deviation in 95 of 100.
    bound, alone = calibration.bound(piece), math.sqrt(-math.log(1 - LEVEL)) * np.sqrt(piece.variance)
    return Band(
        piece.recording,
        piece.signal,
        piece.unit,
        piece.part,
        piece.frequency,
        piece.measured,
        piece.predicted,
        piece.left,
        bound,
        alone,
    )


def write(made: UncertainModel, path: Path, name: str) -> list[Path]:
    """Write a family with its weights as .json or .mat, or as a MATLAB script with its MAT-file; returns the files.

    Raises:
        FlexarmError: an unknown kind of file, or it cannot be written.
    """
    from engine import family_files
    from engine.files import json_text, writing
    from engine.names import identifier

    plain = identifier(name)
    weights = {signal: (w.to_control(), w) for signal, w in made.weights.items()}

    def json() -> bytes:
        import json as reader

        rows = {
            signal: {"zeros": list(w.zeros), "poles": list(w.poles), "gain": w.gain}
            for signal, (_, w) in weights.items()
        }
        extra = {
            "weights": rows,
            "parameters": {"names": list(made.names), "covariance": made.covariance.tolist()},
            "samples": list(made.samples),
            "coverage": made.coverage if math.isfinite(made.coverage) else None,
        }
        return (json_text(reader.loads(family_files.as_json(made.family, name)) | extra, indent=1) + "\n").encode()

    def mat() -> bytes:
        from scipy.io import loadmat, savemat

        whole = {k: v for k, v in loadmat(io.BytesIO(family_files.as_mat(made.family))).items() if k[0] != "_"}
        whole["parameter_names"] = np.array(made.names, dtype=object)[:, None]
        whole["parameter_covariance"] = made.covariance
        whole["parameter_samples"] = np.array([[row.get(k, np.nan) for k in made.names] for row in made.samples])
        whole["weights"] = {
            identifier(signal): {"A": s.A, "B": s.B, "C": s.C, "D": s.D, "signal": signal}
            for signal, (s, _) in weights.items()
        }
        buffer = io.BytesIO()
        savemat(buffer, whole, long_field_names=True)
        return buffer.getvalue()

    def script(data: str) -> bytes:
        lines = [
            f"% {name}: uncertain model by flexarm. {plain}_nominal is the fitted model, {plain}_samples the draws",
            "% from its covariance; of each signal, measured = (1 + W * Delta) * predicted, Delta of gain 1 (ultidyn).",
            f"data = load('{data}');",
            f"{plain}_samples = ss(data.A, data.B, data.C, data.D);",
            f"{plain}_samples.SamplingGrid = data.sampling_grid;",
            f"{plain}_nominal = {plain}_samples(:, :, 1);",
            f"{plain}_parametric = ucover({plain}_samples(:, :, 2:end), {plain}_nominal, 2); % covers the draws",
        ]
        for signal in weights:
            field_name = identifier(signal)
            lines += [
                f"w = data.weights.{field_name};",
                f"W_{field_name} = ss(w.A, w.B, w.C, w.D);",
                f"U_{field_name} = 1 + W_{field_name} * ultidyn('Delta_{field_name}', [1 1]);",
            ]
        return ("\n".join(lines) + "\n").encode()

    kind = path.suffix.lower()
    files: dict[Path, Callable[[], bytes]] = {}
    if kind == ".m":
        files[path.with_suffix(".mat")] = mat
        files[path] = lambda: script(path.with_suffix(".mat").name)
    else:
        files[path] = {".json": json, ".mat": mat}.get(kind, json)
    for file, content in files.items():
        with writing(file, (".json", ".mat", ".m")) as temporary:
            temporary.write_bytes(content())
    return list(files)
