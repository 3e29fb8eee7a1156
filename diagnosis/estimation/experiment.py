"""What a fit needs of a recording, whatever was recorded: the protocol of experiments.

A residual is (measured - simulated) / sigma. `diagnosis.estimation.time_experiment` implements it for signals over
time, `diagnosis.frequency_response.table_experiment` for frequency-response tables.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from diagnosis.estimation.parameters import Array, FreeParameter
from engine.model import Model

if TYPE_CHECKING:
    from scenarios.load import Scenario

TRAINING = ("train", "repeat")
"""Roles of recordings that are fitted."""


@dataclass(frozen=True, kw_only=True)
class Experiment(ABC):
    """One recording, ready to be simulated and compared.

    Attributes:
        name, role: of the recording.
        time: sample instants (s), or row numbers of a table, shape (samples,).
        measured: shape (samples, signals), NaN where nothing was recorded.
        sigma: standard deviation of each signal's noise, shape (signals,).
        free: names of starting values that a fit may choose for this recording.
        initial: starting values by name (SI); free ones at their first guess.
        deviations: standard deviation of what is known of each free starting value before the fit (SI).
        measured_starts: free starting values that first samples of stated noise tell.
        settings: parameters that have another value in this recording, whatever a fit moves (SI).
        thinned: samples of the recording from each of these to the next.
        coarse: whether it stands for one with more samples, or with more steps in between.
    """

    sparse: ClassVar[bool]
    """Whether it has few readings, each costly to simulate, rather than thousands of samples."""

    name: str
    role: str
    time: Array
    measured: Array
    sigma: Array
    free: tuple[str, ...] = ()
    initial: dict[str, float] = field(default_factory=dict)
    deviations: dict[str, float] = field(default_factory=dict)
    measured_starts: frozenset[str] = frozenset()
    settings: dict[str, float] = field(default_factory=dict)
    thinned: int = 1
    coarse: bool = False

    @property
    def longest_step(self) -> float | None:
        """Integration step (s) that must not be exceeded; None where the experiment chooses its steps itself."""
        return None

    @property
    def finest_step(self) -> float | None:
        """The shortest integration step (s) that a model is given; None where the experiment chooses them itself."""
        return None

    @property
    def lowest_frequency(self) -> float | None:
        """Lowest frequency (rad/s) of a table of sines; None for a recording over time."""
        return None

    @property
    def highest_frequency(self) -> float | None:
        """Highest frequency (rad/s) of a table of sines; None for a recording over time."""
        return None

    def lowest(self, share: float) -> Self:
        """The rows of the lowest frequencies, as a share of all; a recording over time whole."""
        return self

    @property
    @abstractmethod
    def interval(self) -> float:
        """Sampling interval (s), by which blocks of correlated residuals are counted; 1 for rows of a table."""

    @property
    @abstractmethod
    def shortest(self) -> float:
        """The shortest time (s) that the recording resolves."""

    @property
    @abstractmethod
    def longest(self) -> float:
        """The longest time constant (s) that the recording can tell from a longer one."""

    @property
    def count(self) -> int:
        """Number of recorded values."""
        return int(np.isfinite(self.measured).sum())

    @abstractmethod
    def on_variant(
        self, scenario: Scenario, inputs: Sequence[str], outputs: Sequence[str], others: Sequence[Experiment]
    ) -> tuple[Model, list[Experiment]]:
        """The model of a variant of the scenario, and this and other experiments of its kind as experiments on it.

        What was recorded stays as it was prepared.

        Args:
            scenario: the variant.
            inputs: what the recorded inputs are called there.
            outputs: what the recorded signals are called there.
            others: the experiments, this one among them.

        Raises:
            FlexarmError: the variant has no meaning.
        """

    @abstractmethod
    def fingerprint(self) -> list[Array]:
        """All numbers that a fit of this experiment depends on."""

    @abstractmethod
    def cut(self, share: float) -> Self:
        """The first part of it, as a share of its length; the same where there is no horizon to grow."""

    @abstractmethod
    def outputs(
        self, model: Model, parameters: dict[str, float], starts: dict[str, float], longest: float | None
    ) -> Array:
        """Simulated outputs, shape (rows, signals), at integration steps of at most ``longest`` (s).

        Raises:
            SimulationError: the run diverged.
        """

    @abstractmethod
    def residual(self, simulated: Array) -> Array:
        """(measured - simulated) / sigma, zero where nothing was recorded; shape (samples, signals)."""

    def in_units(self, r: Array) -> Array:
        """Residuals (samples, signals) in the unit of each signal rather than in standard deviations."""
        return np.asarray(r * self.sigma)

    @abstractmethod
    def linearised(
        self,
        model: Model,
        free: Sequence[FreeParameter],
        x: Array,
        starts: dict[str, float],
        longest: float | None,
        only: Sequence[int] | None = None,
    ) -> tuple[Array, Array]:
        """Residual, flat, and its Jacobian with respect to the search vector.

        Args:
            model: what is simulated.
            free: what the search vector stands for.
            x: search vector, shape (n,).
            starts: starting values by name, SI units.
            longest: longest integration step (s).
            only: numbers of the variables whose slopes are asked for; others' may be zero. All if None.

        Raises:
            SimulationError: the run diverged.
        """

    def components(self, rows: Array) -> Array:
        """Rows (samples, ...) as independent values whose squares sum to the same: those of a table as they are."""
        return rows

    def even(self, rows: Array) -> Array:
        """Rows (samples, ...) whose squares and products sum to those of their `components`, at less cost."""
        return rows

    def bands(self, fewest: int) -> list[tuple[int, slice]]:
        """Rows of `components` that share a strength of noise, by the number of their band.

        Args:
            fewest: rows in a band.
        """
        return [(0, slice(0, len(self.time)))]

    def squares(self, r: Array) -> Array:
        """Contribution of each residual to chi2, shape as ``r``; a robust one for held-out rows of a table."""
        return np.asarray(r**2)

    @abstractmethod
    def disturbed_inputs(self, size: float, delay: float) -> Sequence[Self]:
        """Two copies: the input larger by the share ``size``, and later by ``delay`` times `shortest`.

        Empty where no input was recorded.
        """

    @abstractmethod
    def largest_inputs(self, count: int) -> Array:
        """Largest magnitude of each of the model's ``count`` inputs, shape (count,); empty if none was recorded."""

    @abstractmethod
    def spans(
        self, scenario: Scenario, model: Model, names: Sequence[str], longest: float | None
    ) -> dict[str, tuple[float, float]]:
        """Peak to peak and root mean square of signals of the nominal model in this experiment, by name.

        Args:
            scenario: of the model.
            model: with these signals as outputs.
            names: signals.
            longest: integration step at most (s).
        """

    def lines(self, r: Array, most: int) -> dict[float, float]:
        """The frequencies (rad/s) of the ``most`` largest peaks of a residual's spectrum, with their power."""
        return {}

    @abstractmethod
    def where_residual_is_large(self, r: Array, names: Sequence[str]) -> tuple[str, str]:
        """When, and at which frequency, a residual (samples, signals) is large, in words."""

    def unseen_effects(self) -> tuple[str, ...]:
        """Effects that recordings of this kind do not show."""
        return ()
