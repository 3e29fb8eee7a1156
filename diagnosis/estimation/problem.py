"""What a fit works on: a model, its experiments, its free parameters; and where chi2 is counted."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.estimation import parameters
from diagnosis.estimation.experiment import TRAINING, Experiment
from diagnosis.estimation.leftover import Bands, Leftover, Noise, left_by
from diagnosis.estimation.parameters import Array, FreeParameter
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.thresholds import EVIDENCE, FITTING
from engine import lanes
from engine.errors import ParameterError, SimulationError
from engine.model import Model
from engine.native import Job
from engine.simulate import carried_out_together
from engine.step import FOLLOWED, StepRule

if TYPE_CHECKING:
    from diagnosis.recordings.types import Assumed
    from scenarios.load import Scenario


@dataclass(frozen=True)
class SignalFit:
    """How well a signal is met.

    Attributes:
        nrmse: 100 (1 - |e| / |y - mean y|), per cent; 100 is perfect.
        chi2: mean squared residual over the noise variance.
    """

    nrmse: float
    chi2: float


@dataclass(frozen=True)
class Problem:
    """A model, its experiments and its free parameters.

    Attributes:
        scenario: where the model comes from.
        model: inputs and outputs in the order of the experiments' columns.
        experiments: all recordings, whatever their role.
        free: what may move.
        internal_step: longest integration step (s), the same for every evaluation, so that comparisons are fair.
        steps: how long integration steps may be.
        reference: whether what drives the user's model is a controller's reference: it is known exactly.
    """

    scenario: Scenario
    model: Model
    experiments: tuple[Experiment, ...]
    free: tuple[FreeParameter, ...]
    internal_step: float | None = None
    steps: StepRule = FOLLOWED
    reference: bool = False

    @property
    def training(self) -> list[Experiment]:
        """Experiments that are fitted."""
        return [e for e in self.experiments if e.role in TRAINING]

    @property
    def held_out(self) -> list[Experiment]:
        """Experiments that are not fitted."""
        return [e for e in self.experiments if e.role == "hold_out"]

    @property
    def judged(self) -> list[Experiment]:
        """Experiments that a model is judged on: those held out, or those fitted where none is."""
        return self.held_out or self.training

    @property
    def assumed(self) -> dict[tuple[str, ...], Assumed]:
        """What was found of files that the scenario leaves open: keys from the scenario's top -> value."""
        return {place: value for e in over_time(self.experiments) for place, value in e.assumed.items()}

    @property
    def sparse(self) -> bool:
        """Whether few readings were recorded rather than thousands of samples."""
        return any(e.sparse for e in self.experiments)

    @property
    def shortest(self) -> float:
        """The shortest time (s) that the recordings resolve."""
        return min(e.shortest for e in self.experiments)

    @property
    def longest(self) -> float:
        """The longest time constant (s) that the recordings can tell from a longer one."""
        return max(e.longest for e in self.experiments)

    def values(self, x: Array, experiment: Experiment | None = None) -> tuple[dict[str, float], dict[str, float]]:
        """Parameters and starting values at a search vector."""
        place = x.tobytes()
        last, parameters = self._last
        if place != last:
            parameters = {f.name: f.value(v) for f, v in zip(self.free, x.tolist(), strict=True) if not f.recording}
            self.__dict__["_last"] = place, parameters
        starts = dict(experiment.initial) if experiment else {}
        for i in self._begun.get(experiment.name, ()) if experiment else ():
            starts[self.free[i].name] = self.free[i].value(float(x[i]))
        return dict(parameters), starts

    @functools.cached_property
    def _last(self) -> tuple[bytes, dict[str, float]]:
        """The search vector that was asked for last, and its parameters: those of all experiments are the same."""
        return b"", {}

    @functools.cached_property
    def _begun(self) -> dict[str, list[int]]:
        """Numbers of the free starting values, by the experiment that begins there."""
        found: dict[str, list[int]] = {}
        for i, f in enumerate(self.free):
            if f.recording:
                found.setdefault(f.recording, []).append(i)
        return found

    def simulate(self, x: Array, experiment: Experiment) -> Array:
        """Outputs, shape (rows, signals).

        Raises:
            SimulationError: the run diverged.
        """
        return experiment.outputs(self.model, *self.values(x, experiment), self.internal_step)

    def residual(self, x: Array, experiment: Experiment) -> Array:
        """Residual of one experiment, or a huge one where the simulation fails."""
        return self.residuals(x, [experiment])[0]

    def residuals(
        self,
        x: Array,
        experiments: Sequence[Experiment],
        split: Callable[[Experiment, Array], Array] = lambda _, r: r,
        over: Callable[..., Iterable[list[Array]]] = map,
    ) -> list[Array]:
        """The residual of each of some experiments at a search vector; arguments as of `residuals_of`."""
        return self.residuals_of([(x, e) for e in experiments], split, over)

    def residuals_of(
        self,
        cases: Sequence[tuple[Array, Experiment]],
        split: Callable[[Experiment, Array], Array] = lambda _, r: r,
        over: Callable[..., Iterable[list[Array]]] = map,
    ) -> list[Array]:
        """Residuals, one for each search vector and experiment; runs that are alike are worked on together.

        Args:
            cases: search vectors, shape (n,), and experiments, of any role.
            split: what is made of a residual.
            over: as `map`, such as that of a pool of threads.
        """
        jobs: dict[int, Job] = {}
        for n, (x, e) in enumerate(cases):
            if isinstance(e, TimeExperiment):
                with contextlib.suppress(ParameterError, SimulationError):
                    jobs[n] = e.job(self.model, *self.values(x, e), self.internal_step)
        places = list(jobs)
        groups = [[places[k] for k in group] for group in lanes.groups(self.model, list(jobs.values()))]
        groups += [[n] for n in range(len(cases)) if n not in jobs]

        def answers(group: Sequence[int]) -> list[Array | None]:
            if group[0] not in jobs:
                try:
                    return [self.simulate(*cases[group[0]])]
                except (ParameterError, SimulationError):
                    return [None]
            made = carried_out_together(self.model, [jobs[n] for n in group])
            return [None if isinstance(one, SimulationError) else one.y for one in made]

        def worked_out(group: Sequence[int]) -> list[Array]:
            pairs = [(cases[n][1], answer) for n, answer in zip(group, answers(group), strict=True)]
            return [split(e, _failed(e.measured.shape) if y is None else _clipped(e.residual(y))) for e, y in pairs]

        found: dict[int, Array] = {}
        for group, rows in zip(groups, over(worked_out, groups), strict=True):
            found.update(zip(group, rows, strict=True))
        return [found[n] for n in range(len(cases))]

    def linearised(self, x: Array, experiment: Experiment, only: Sequence[int] | None = None) -> tuple[Array, Array]:
        """Residual, flat, and its Jacobian with respect to the search vector; ``only`` as of `Experiment.linearised`.

        Raises:
            SimulationError: the run diverged.
        """
        starts = self.values(x, experiment)[1]
        return experiment.linearised(self.model, self.free, x, starts, self.internal_step, only)

    def prior(self, x: Array) -> tuple[Array, Array]:
        """Residual and Jacobian of the prior; see `parameters.prior`."""
        return parameters.prior(self.free, x)

    def prior_cost(self, x: Array) -> float:
        """Cost of the prior: squared distances from the values given, in tolerances."""
        return float(np.sum(self.prior(x)[0] ** 2))

    def leftover(self, x: Array, experiments: Sequence[Experiment], changes: Sequence[Array] = ()) -> Leftover:
        """What the model leaves over of experiments, each band of a signal summed over all of them.

        Args:
            x: search vector, shape (n,).
            experiments: of any role.
            changes: of the residual of each, shape (samples, signals), that no parameter makes; none if empty.
        """
        points = [x, *parameters.sides(self.free, x, EVIDENCE.hair, range(len(x)))]
        rows, count = self.residuals_of([(point, e) for point in points for e in experiments]), len(experiments)
        if changes:
            rows = [r + change for r, change in zip(rows, [*changes] * len(points), strict=True)]
        at, *beside = (rows[number * count : (number + 1) * count] for number in range(len(points)))
        return left_by(experiments, at, beside)

    def unexplained(self, x: Array, experiments: Sequence[Experiment]) -> float:
        """By how much the logarithm of their likelihood could rise if only the sensors' noise were left of them."""
        return left_by(experiments, self.residuals(x, experiments)).unexplained

    def misfit(self, x: Array, experiments: Sequence[Experiment], *, noise: Noise = "coloured") -> float:
        """Minus twice the logarithm of the likelihood of experiments.

        Args:
            x: search vector, shape (n,).
            experiments: of any role.
            noise: as of `Bands`.
        """
        bands = Bands(experiments, noise=noise)
        return bands.misfit(bands.energies(self.residuals(x, experiments, bands.components)))

    def cost(self, x: Array, experiments: Sequence[Experiment], *, noise: Noise = "coloured") -> float:
        """What a fit makes small: the misfit of experiments and the cost of the prior; arguments as of `misfit`."""
        return self.misfit(x, experiments, noise=noise) + self.prior_cost(x)

    def chi2(self, x: Array, experiments: Sequence[Experiment]) -> float:
        """Mean of the squared residuals of experiments, as `Experiment.squares` counts them; 1 is the noise."""
        rows = self.residuals(x, experiments, lambda e, r: e.squares(r))
        total = sum(float(np.sum(squares)) for squares in rows)
        return total / max(counted(experiments), 1)

    def by_signal(self, x: Array, experiments: Sequence[Experiment]) -> dict[str, SignalFit]:
        """How well each signal that was recorded is met, by name."""
        rows, residuals = {}, self.residuals(x, experiments)
        for k, variable in enumerate(self.model.outputs):
            error = spread = squares = 0.0
            count = 0
            for e, left in zip(experiments, residuals, strict=True):
                r, y = left[:, k], e.measured[:, k]
                error += float(np.sum((r * e.sigma[k]) ** 2))
                spread += float(np.nansum((y - np.nanmean(y)) ** 2))
                squares += float(np.sum(r**2))
                count += int(np.isfinite(y).sum())
            if count:
                nrmse = 100 * (1 - math.sqrt(error / spread)) if spread > 0 else -math.inf
                rows[variable.name] = SignalFit(nrmse, squares / count)
        return rows


def _clipped(r: Array) -> Array:
    return np.asarray(np.clip(r, -FITTING.huge, FITTING.huge))


def _failed(shape: tuple[int, ...]) -> Array:
    """The residual of a simulation that fails, huge at every frequency.

    A constant is nothing but the lowest, and with coloured noise likelier than any model that leaves noise.
    """
    return np.asarray(FITTING.huge * np.random.default_rng(0).choice([-1.0, 1.0], shape))


def counted(experiments: Sequence[Experiment]) -> int:
    """Number of recorded values."""
    return sum(e.count for e in experiments)
