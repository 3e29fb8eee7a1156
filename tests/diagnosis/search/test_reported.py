"""What of a search is told, on made-up models: what each leaves as the search fitted it, and at its least error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from diagnosis.effects.effect import Candidate
from diagnosis.search.reported import as_reported
from tests.diagnosis.search.test_posterior import COUNT, FRICTION, LAG, effect, model

Row = tuple[tuple[Candidate, ...], float, float]
"""Effects of a model, what it leaves of held-out recordings at its least squared error, and how probable it is."""


@dataclass(frozen=True)
class Found:
    """Stands in for a `Study`: what of it is read and exchanged."""

    refit: Any
    trials: tuple[Any, ...]
    odds: dict[frozenset[str], float]
    chosen: Any
    notes: tuple[str, ...] = ()
    tried: int = 40


def reported(
    rows: Sequence[Row], held_out: float, strain: float = 0.0, closest_strain: float = 0.0
) -> tuple[Any, list[frozenset[str]]]:
    """What is told of models, the first the refit, that leave so much as the search fitted them; those asked for."""
    searched = {"excess": 1e6, "held_out": held_out, "strain": strain}
    made = [model(*effects, log_evidence=-len(effects), **searched) for effects, _, _ in rows]
    given = {"excess": 1e6, "strain": closest_strain}
    ends = {m.keys: model(*m.effects, held_out=row[1], **given) for m, row in zip(made, rows, strict=True)}
    odds = {m.keys: row[2] for m, row in zip(made, rows, strict=True) if row[2]}
    asked: list[frozenset[str]] = []

    def closest(m: Any, richer: Sequence[Any] = ()) -> Any:
        asked.append(m.keys)
        return ends[m.keys]

    refit, *trials = made
    study: Any = Found(refit, tuple(trials), odds, max(made, key=lambda m: odds.get(m.keys, 0.0)))
    fitter: Any = SimpleNamespace(closest=closest)
    return as_reported(fitter, study), asked


@pytest.mark.parametrize(("with_both", "told"), [(500.0, (FRICTION, LAG)), (600.0, (FRICTION,))])
def test_an_effect_is_told_only_if_held_out_recordings_gain_by_it(with_both: float, told: tuple[Candidate]) -> None:
    """Likelier by far as the search weighs it: what counts far above the noise is the error that the user sees."""
    rows: list[Row] = [((), 2000 * COUNT, 0.0), ((FRICTION,), 550 * COUNT, 0.0), ((LAG,), 1900 * COUNT, 0.001)]
    said, _ = reported([*rows, ((FRICTION, LAG), with_both * COUNT, 0.999)], 580 * COUNT)
    assert said.chosen.keys == {c.key for c in told}
    assert said.chosen.unseen.energy[0] == COUNT * (1 + min(with_both, 550.0))
    assert said.odds[said.chosen.keys] == 0.999
    assert sum(said.odds.values()) == pytest.approx(1.0)
    assert said.trials[0].keys == said.chosen.keys
    assert len(said.notes) == (with_both > 550)
    assert all(f"{FRICTION.key} + {LAG.key} is likelier than {FRICTION.key}, but" in note for note in said.notes)


def test_at_the_noise_nothing_simpler_is_fitted() -> None:
    rows: list[Row] = [((), 2000 * COUNT, 0.0), ((FRICTION,), 10.0, 0.0), ((FRICTION, LAG), 20.0, 1.0)]
    said, asked = reported(rows, 15.0)
    assert said.chosen.keys == {FRICTION.key, LAG.key}
    assert frozenset({FRICTION.key}) not in asked


def test_of_what_leaves_more_than_twice_as_much_no_other_fit_is_asked_for() -> None:
    """As the search fitted it, all are left 580 times the noise; at the least squared error the pair leaves 200."""
    rows: list[Row] = [((), 2000 * COUNT, 0.0), ((FRICTION,), 550 * COUNT, 0.0), ((FRICTION, LAG), 200 * COUNT, 1.0)]
    said, asked = reported(rows, 580 * COUNT)
    assert said.chosen.keys == {FRICTION.key, LAG.key}
    assert frozenset({FRICTION.key}) not in asked


def test_models_that_are_told_alike_share_their_odds() -> None:
    """Beside either of two nuisances: what is left of both is the friction."""
    drift = effect("sensor_bias", "s")
    rows: list[Row] = [((), 2e6, 0.0), ((FRICTION,), 5e5, 0.0), ((FRICTION, LAG), 6e5, 0.6)]
    said, _ = reported([*rows, ((FRICTION, drift), 6e5, 0.4)], 5.5e5)
    assert said.odds == {frozenset({FRICTION.key}): pytest.approx(1.0)}


@pytest.mark.parametrize(
    ("strain", "closest_strain", "follows"), [(3.0, 90.0, False), (80.0, 90.0, True), (3, 9, True)]
)
def test_a_model_is_not_fitted_so_closely_that_its_parameters_are_not_believed(
    strain: float, closest_strain: float, follows: bool
) -> None:
    """A right law beside nuisances that leave twice the noise: at the least error its ten parameters make up for them.

    So do those of a refit, which nobody believes for that.
    """
    rows: list[Row] = [((), 1000 * COUNT, 0.0), ((FRICTION,), 1.5 * COUNT, 1.0)]
    said, _ = reported(rows, 2.5 * COUNT, strain, closest_strain)
    assert said.chosen.strain == (closest_strain if follows else strain)
    assert said.refit.strain == closest_strain


@pytest.mark.parametrize(("left", "told"), [(1.4, False), (1.2, True)])
def test_what_is_no_more_than_noise_is_told_if_most_of_it_is_explained_at_the_least_error_too(
    left: float, told: bool
) -> None:
    """A little ripple of a machine that lacks nothing: half was explained as the search weighs it, and then a third."""
    refit, ripple = model(excess=0.6 * COUNT), effect("torque_ripple")
    found = model(ripple, excess=0.2 * COUNT, log_evidence=16.0)
    ends = {m.keys: m for m in (refit, model(ripple, excess=(left - 1) * COUNT))}
    study: Any = Found(refit, (found,), {found.keys: 1.0}, found)
    fitter: Any = SimpleNamespace(closest=lambda m, richer=(): ends[m.keys])
    said = as_reported(fitter, study)
    assert bool(said.chosen.effects) == told
    assert said.odds == {said.chosen.keys: 1.0}
    assert [
        note.endswith("it explains little of what is no more than the noise without it: it is not told")
        for note in said.notes
    ] == [True] * (not told)
