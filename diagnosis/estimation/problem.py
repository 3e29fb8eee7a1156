"""What a fit works on: recordings as simulations with residuals, and the parameters that may move.

A residual is (measured - simulated) / sigma. A parameter moves in units of its declared tolerance, on a logarithmic
scale where its bounds keep it positive, and pays the square of that distance: the tolerance is prior knowledge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from engine.errors import ParameterError, SimulationError
from engine.model import Model
from engine.simulate import Drive, simulate
from engine.tangent import tangents
from scenarios.load import Scenario

Array = NDArray[np.float64]

ALIKE = 0.3
"""Logarithm of the ratio by which two sizes differ that are about as large (standard deviation)."""

HUGE = 1e6
"""Residuals beyond so many standard deviations count as this: the simulation runs away."""


@dataclass(frozen=True)
class FreeParameter:
    """A parameter that a fit may move.

    Attributes:
        name: of the model's parameter, or of a starting value.
        start: where it stands at first (SI).
        scale: what one step of the search variable means: a share for ``logarithmic`` ones, else an SI difference.
        logarithmic: value = start * exp(scale * x) rather than start + scale * x.
        low, high: bounds (SI).
        prior: whether distance from the start counts against the fit.
        recording: for a starting value, the recording it belongs to.
        like: another parameter, of either sign, that is about as large: the two ends of an amplifier's range.
    """

    name: str
    start: float
    scale: float
    logarithmic: bool
    low: float = -math.inf
    high: float = math.inf
    prior: bool = True
    recording: str = ""
    like: str = ""

    def value(self, x: float) -> float:
        """The parameter at search variable ``x``, kept within its bounds."""
        raw = self.start * math.exp(min(self.scale * x, 50.0)) if self.logarithmic else self.start + self.scale * x
        return min(max(raw, self.low), self.high)

    def slope(self, x: float) -> float:
        """D value / d x."""
        value = self.value(x)
        return self.scale * value if self.logarithmic else self.scale

    def position(self, value: float) -> float:
        """The search variable at which the parameter has ``value``."""
        if self.logarithmic:
            return math.log(max(value / self.start, 1e-300)) / self.scale
        return (value - self.start) / self.scale


@dataclass(frozen=True)
class Experiment:
    """One recording, made ready to be simulated.

    Attributes:
        name, role: of the recording.
        step: between simulated rows (s); ``every`` rows make one sample.
        drive: inputs, in the model's order.
        measured: shape (samples, signals), NaN where nothing was recorded.
        sigma: standard deviation of each signal's noise.
        from_first: for each signal, whether it counts from the first sample.
        free: starting values that belong to this recording.
        initial: starting values by name (SI), those that are free as they begin.
        uneven: whether ``time`` is not a multiple of the rows' interval: outputs are then interpolated between rows.
    """

    name: str
    role: str
    time: Array
    step: float
    every: int
    drive: Drive | None
    measured: Array
    sigma: Array
    from_first: tuple[bool, ...]
    free: tuple[str, ...] = ()
    initial: dict[str, float] = field(default_factory=dict)
    uneven: bool = False

    @property
    def stop(self) -> float:
        """End of the simulation (s)."""
        if self.uneven:
            return float(self.step * (math.floor(self.time[-1] / self.step + 1e-6) + 1))
        return float(self.step * self.every * (len(self.time) - 1))

    @property
    def shortest(self) -> float:
        """The shortest time (s) that it resolves."""
        return self.step * self.every

    def sampled(self, rows: Array) -> Array:
        """Simulated rows at the recorded instants, shape (samples, ...)."""
        if not self.uneven:
            return rows[:: self.every][: len(self.time)]
        place = self.time / self.step
        below = np.minimum(np.floor(place + 1e-6).astype(int), len(rows) - 2)
        share = np.maximum(place - below, 0.0).reshape(-1, *[1] * (rows.ndim - 1))
        return np.asarray(rows[below] * (1 - share) + rows[below + 1] * share)

    def cut(self, until: float) -> Experiment:
        """The same, only up to a time."""
        keep = max(8, int(np.searchsorted(self.time, until)))
        return replace(self, time=self.time[:keep], measured=self.measured[:keep])

    def outputs(
        self, model: Model, parameters: dict[str, float], starts: dict[str, float], longest: float | None
    ) -> Array:
        """Simulated outputs, shape (rows, signals), at integration steps of at most ``longest`` (s).

        Raises:
            SimulationError: the run diverged.
        """
        run = simulate(
            model,
            self.stop,
            self.step,
            parameters=parameters,
            drive=self.drive,
            initial=starts,
            internal_step=longest,
            log_capacity=0,
        )
        return run.values

    def linearised(
        self, model: Model, free: Sequence[FreeParameter], x: Array, starts: dict[str, float], longest: float | None
    ) -> tuple[Array, Array]:
        """Residual, flat, and its Jacobian with respect to the search vector, by tangents.

        Raises:
            SimulationError: the run diverged.
        """
        parameters = {f.name: f.value(v) for f, v in zip(free, x, strict=True) if not f.recording}
        mine = [i for i, f in enumerate(free) if not f.recording or f.recording == self.name]
        names = [free[i].name for i in mine]
        try:
            found = tangents(
                model,
                self.stop,
                self.step,
                wrt=names,
                parameters=parameters,
                drive=self.drive,
                initial=starts,
                internal_step=longest,
            )
        except ParameterError as error:
            raise SimulationError(error.message) from error
        r = np.clip(self.residual(found.result.values), -HUGE, HUGE).ravel()
        slopes = self.slopes(found.values).reshape(len(r), len(names))
        J = np.zeros((len(r), len(free)))
        for column, i in enumerate(mine):
            J[:, i] = slopes[:, column] * free[i].slope(x[i])
        if not np.isfinite(J).all() or np.abs(J).max(initial=0.0) > HUGE**2:
            raise SimulationError("the sensitivities grow without bound")
        return r, J

    def residual(self, simulated: Array) -> Array:
        """(measured - simulated) / sigma, zero where nothing was recorded; shape (samples, signals)."""
        rows = self.sampled(simulated)
        rows = rows - np.where(self.from_first, rows[0], 0.0)
        return np.nan_to_num((self.measured - rows) / self.sigma, nan=0.0)

    def squares(self, r: Array) -> Array:
        """What residuals count when a model is judged on data it has not seen, shape as ``r``."""
        return np.asarray(r**2)

    def slopes(self, values: Array) -> Array:
        """Derivative of the residual, shape (samples, signals, directions), from that of the outputs."""
        rows = self.sampled(values)
        rows = rows - np.where(np.asarray(self.from_first)[:, None], rows[0], 0.0)
        made = -rows / self.sigma[None, :, None]
        made[np.isnan(self.measured)] = 0.0
        return np.asarray(made)


@dataclass(frozen=True)
class Problem:
    """A model, its experiments and its free parameters.

    Attributes:
        scenario: where the model comes from.
        model: inputs and outputs in the order of the experiments' columns.
        experiments: all recordings, whatever their role.
        free: what may move.
        internal_step: longest integration step (s), the same for every evaluation, so that comparisons are fair.
    """

    scenario: Scenario
    model: Model
    experiments: tuple[Experiment, ...]
    free: tuple[FreeParameter, ...]
    internal_step: float | None = None

    def chosen(self, *roles: str) -> list[Experiment]:
        """Experiments of some roles."""
        return [e for e in self.experiments if e.role in roles]

    def values(self, x: Array, experiment: Experiment | None = None) -> tuple[dict[str, float], dict[str, float]]:
        """Parameters and starting values at a search vector."""
        parameters = {f.name: f.value(v) for f, v in zip(self.free, x, strict=True) if not f.recording}
        starts = dict(experiment.initial) if experiment else {}
        for f, v in zip(self.free, x, strict=True):
            if experiment is not None and f.recording == experiment.name:
                starts[f.name] = f.value(v)
        return parameters, starts

    def simulate(self, x: Array, experiment: Experiment) -> Array:
        """Outputs, shape (rows, signals).

        Raises:
            SimulationError: the run diverged.
        """
        return experiment.outputs(self.model, *self.values(x, experiment), self.internal_step)

    def residual(self, x: Array, experiment: Experiment) -> Array:
        """Residual of one experiment, or a huge one where the simulation fails."""
        try:
            found = experiment.residual(self.simulate(x, experiment))
        except (ParameterError, SimulationError):
            return np.full(experiment.measured.shape, HUGE)
        return np.clip(found, -HUGE, HUGE)

    def linearised(self, x: Array, experiment: Experiment) -> tuple[Array, Array]:
        """Residual, flat, and its Jacobian with respect to the search vector.

        Raises:
            SimulationError: the run diverged.
        """
        return experiment.linearised(self.model, self.free, x, self.values(x, experiment)[1], self.internal_step)


def prior(problem: Problem, x: Array) -> tuple[Array, Array]:
    """Residual and Jacobian of the prior: a row for each parameter, and for each two that are about as large."""
    weights = np.array([1.0 if f.prior else 0.0 for f in problem.free])
    r, J = weights * x, np.diag(weights)
    names = [f.name for f in problem.free]
    for i, f in enumerate(problem.free):
        if f.like in names:
            j = names.index(f.like)
            other = problem.free[j]
            row = np.zeros(len(x))
            row[[i, j]] = f.scale / ALIKE, -other.scale / ALIKE
            apart = math.log(abs(f.start / other.start)) / ALIKE + row @ x
            r, J = np.append(r, apart), np.vstack([J, row])
    return r, J
