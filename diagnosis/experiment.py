"""The next experiment: of a menu of inputs, the one on which the rivals' predictions differ most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from diagnosis.problem import Array, Problem
from diagnosis.sines import Sines
from diagnosis.sines_report import SEPARATED, choose
from engine.errors import FlexarmError
from engine.simulate import Drive, simulate

if TYPE_CHECKING:
    from diagnosis.trial import Trial

DURATION = 6.0


@dataclass(frozen=True)
class Proposal:
    """An input to run on the rig.

    Attributes:
        kind: name in the menu.
        sentence: what to do.
        separates: the rivals' labels.
        expected: smallest expected log Bayes factor between two rivals.
        time, drive: instants (s) and input, shape (n,).
        input, unit: name and unit of the driven input.
        predictions: what each rival predicts, label -> shape (n, signals).
        signals: names of the signals.
        axis: what ``time`` is: for the rows of a table to measure, frequencies, with ``drive`` the amplitudes.
    """

    kind: str
    sentence: str
    separates: tuple[str, ...]
    expected: float
    time: Array
    drive: Array
    input: str
    unit: str
    predictions: dict[str, Array]
    signals: tuple[str, ...]
    axis: str = "t [s]"

    def numbers(self) -> dict[str, Any]:
        """As it stands in ``diagnosis.json``."""
        return {
            "kind": self.kind,
            "sentence": self.sentence,
            "separates": list(self.separates),
            "expected_log_bayes_factor": self.expected,
        }


def menu(size: float) -> dict[str, tuple[str, Array, Array]]:
    """Inputs worth trying: name -> (what to do, instants, values), scaled to the largest input recorded so far."""
    t: Array = np.arange(0.0, DURATION + 1e-9, 1e-3)
    rise = np.clip(t / DURATION, 0, 1)
    random = np.random.default_rng(7)
    bits = np.repeat(random.choice([-1.0, 1.0], 61), 100)[: len(t)]
    bits = np.pad(bits, (0, len(t) - len(bits)), mode="edge")
    return {
        "repeat": ("repeat the present inputs", t, size * np.sin(2 * np.pi * 0.5 * t)),
        "ramp": ("ramp slowly up and down through zero", t, size * (1 - 4 * np.abs(rise - 0.5) * 2 / 2)),
        "reversal": ("reverse a constant input every second", t, size * np.sign(np.sin(np.pi * t + 1e-9))),
        "prbs": ("apply a random binary sequence", t, 0.7 * size * bits),
        "amplitude_sweep": ("apply a sine whose amplitude grows", t, size * rise * np.sin(2 * np.pi * t)),
        "fast_amplitude_sweep": ("apply a 4 Hz sine whose amplitude grows", t, size * rise * np.sin(8 * np.pi * t)),
        "free_decay": ("drive for a second, then let it coast", t, np.where(t < 1.0, size, 0.0)),
        "both_ways_decay": ("drive back for a second, then let it coast", t, np.where(t < 1.0, -size, 0.0)),
    }


def propose(rivals: Sequence[Trial], most: int = 4) -> Proposal | None:
    """The input of the menu that best separates the two rivals hardest to tell apart.

    Args:
        rivals: fitted models; the first ``most`` count.
        most: how many.
    """
    problem = rivals[0].fit.problem
    e = problem.experiments[0]
    if isinstance(e, Sines):
        return _rows(rivals, problem)
    rivals = list(rivals)[:most]
    if e.drive is None or len(problem.model.inputs) != 1:
        return None
    size = max(float(np.abs(np.asarray(x.drive.values)).max()) for x in problem.experiments if x.drive is not None)
    best: Proposal | None = None
    for kind, (sentence, time, drive) in menu(size).items():
        try:
            predictions = {r.label: _predict(r, time, drive) for r in rivals}
        except FlexarmError:
            continue
        gap = _least_gap(list(predictions.values()), e.sigma)
        if best is None or gap > best.expected:
            best = Proposal(
                kind,
                sentence,
                tuple(predictions),
                gap,
                time,
                drive,
                problem.model.inputs[0].name,
                problem.model.inputs[0].unit,
                predictions,
                tuple(v.name for v in problem.model.outputs),
            )
    return best


def _rows(rivals: Sequence[Trial], problem: Problem) -> Proposal | None:
    """The rows of a frequency-response table to measure next."""
    found = choose(rivals)
    if found is None:
        return None
    apart = {label: value for label, value in found.factors.items() if value >= SEPARATED}
    return Proposal(
        found.kind,
        found.sentence,
        (rivals[0].label, *apart),
        min((apart or found.factors).values()),
        found.rows.frequency,
        found.rows.amplitude,
        found.rows.input,
        found.rows.unit,
        found.predictions,
        tuple(v.name for v in problem.model.outputs),
        "frequency [rad/s]",
    )


def _predict(trial: Trial, time: Array, drive: Array) -> Array:
    problem = trial.fit.problem
    run = simulate(
        problem.model,
        float(time[-1]),
        1e-3,
        parameters=trial.fit.parameters(),
        drive=Drive(time, drive[:, None]),
        internal_step=problem.internal_step,
    )
    return run.values


def _least_gap(predictions: Sequence[Array], sigma: Array) -> float:
    """Smallest expected log Bayes factor, after a scale and a shift of each signal that a refit could absorb."""
    gaps = []
    for i, a in enumerate(predictions):
        for b in predictions[i + 1 :]:
            total = 0.0
            for k, s in enumerate(sigma):
                basis = np.column_stack([a[:, k], np.ones(len(a))])
                rest = b[:, k] - basis @ np.linalg.lstsq(basis, b[:, k], rcond=None)[0]
                total += 0.5 * float(np.sum((rest / s) ** 2)) / 10.0
            gaps.append(total)
    return min(gaps, default=0.0)
