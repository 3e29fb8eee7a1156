"""The recordings of a case before noise: what is played, what is measured, and how well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.concealed.truth import Truth, coarse, simulator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bench:
    """What a plant is made to do.

    Attributes:
        signals: measured signals.
        sigma: their noise floors (SI).
        commands: of all recordings; in a closed loop what its controller does to the bare truth.
        held_out: for each recording, whether it is kept from a refit.
        interval: sample interval (s).
        tolerance: of the nominal parameters, by name.
        centre: their nominal values.
        slow: for each recording the course of a slow disturbance, shape (samples + 1,).
        start: the session's clock at the start of each recording (s).
        references: what a closed loop follows; empty in an open one.
        released: for each recording the angle from which the plant is let go at its start (rad).
    """

    signals: tuple[str, ...]
    sigma: Array
    commands: tuple[Array, ...]
    held_out: tuple[bool, ...]
    interval: float
    tolerance: dict[str, float]
    centre: dict[str, float]
    slow: tuple[Array, ...]
    start: tuple[float, ...]
    references: tuple[Array, ...] = ()
    released: tuple[float, ...] = ()

    def outputs(self, truth: Truth, step: float | None = None) -> list[Array]:
        """Noise-free outputs in units of the floor, one array per recording.

        Args:
            truth: what is simulated.
            step: of the integration (s); chosen for speed if absent.

        Raises:
            Diverged: it ran away.
        """
        made = simulator(truth, self.signals, self.interval, step or coarse(truth))
        runs = zip(self.commands, self.slow, self.start, self.released, strict=True)
        return [
            made.run(u, series=slow, start=start, initial=made.at(angle)).clean / self.sigma
            for u, slow, start, angle in runs
        ]

    def scaled(self, factor: float) -> Bench:
        """The same, driven harder."""
        return replace(
            self,
            commands=tuple(factor * c for c in self.commands),
            references=tuple(factor * r for r in self.references),
        )

    def training(self) -> Bench:
        """The recordings to train on alone."""

        def keep(values: tuple) -> tuple:  # type: ignore[type-arg]
            return tuple(v for v, hold in zip(values, self.held_out, strict=True) if not hold)

        return replace(
            self,
            commands=keep(self.commands),
            held_out=keep(self.held_out),
            slow=keep(self.slow),
            start=keep(self.start),
            released=keep(self.released),
            references=keep(self.references) if self.references else (),
        )

    def distance(self, a: Sequence[Array], b: Sequence[Array], held_out: bool = True) -> float:
        """Root mean square difference in units of the floor, over the recordings of one role, signals pooled."""
        parts = [np.ravel(x - y) for x, y, hold in zip(a, b, self.held_out, strict=True) if hold == held_out]
        return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
