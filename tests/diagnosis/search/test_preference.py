"""The rules of the choice on made-up residuals: what is noise, what pays, which of equals is taken, what rivals it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from diagnosis.effects.effect import Candidate, EffectParameter
from diagnosis.estimation.least_squares import Fit
from diagnosis.estimation.parameters import FreeParameter
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.recordings.types import Channel, Recording
from diagnosis.search import preference as choice
from diagnosis.search import search as select
from diagnosis.search.scored_model import ScoredModel, by_chance, gain_band, outside_tolerances
from diagnosis.search.study import Study
from diagnosis.thresholds import NOISE, PREFERENCE

N = 20_000
"""Rows of a long residual: its mean square is known to about one per cent."""


@dataclass(frozen=True)
class Still(Problem):
    """A problem whose residuals are given, whatever the parameters."""

    rows: dict[str, np.ndarray] = field(default_factory=dict)

    def residual(self, x: Any, e: Any) -> Any:
        return self.rows[e.name]


def still(free: int = 0, **rows: Any) -> Still:
    """Residuals by name; those whose name begins with ``train`` are fitted, the others held out."""
    made, experiments = {}, []
    for name, r in rows.items():
        r = np.atleast_2d(np.asarray(r, dtype=float).T).T
        made[name] = np.nan_to_num(r)
        role = "train" if name.startswith("train") else "hold_out"
        sigma = np.ones(r.shape[1])
        time = 1e-3 * np.arange(len(r), dtype=float)
        experiments.append(
            TimeExperiment(
                name=name,
                role=role,
                time=time,
                step=1e-3,
                every=1,
                drive=None,
                measured=r,
                sigma=sigma,
                from_first=(False,) * r.shape[1],
            )
        )
    names = tuple(FreeParameter(f"p{k}", 1.0, 0.1, True) for k in range(free))
    nothing: Any = None
    return Still(nothing, nothing, tuple(experiments), names, rows=made)


def effect(name: str, place: str = "a.shaft", parameters: int = 1) -> Candidate:
    rows = tuple(EffectParameter(f"k{k}", 1.0) for k in range(parameters))
    return Candidate(name, place, "a", f"found_{name}", lambda values: [], rows)


def trial(
    hold_out: float, *effects: Candidate, fitted: float | None = None, x: tuple[float, ...] = (), **more: Any
) -> ScoredModel:
    """A trial with the same held-out error everywhere, over a residual that is white and of the stated size."""
    problem = more.pop("problem", None) or still(len(x), held=np.random.default_rng(1).normal(size=64))
    samples = more.pop("samples", 10_000)
    chi2 = hold_out if fitted is None else fitted
    fit = Fit(problem, np.array(x), more.pop("cost", chi2 * samples), chi2, True, np.zeros((len(x), len(x))))
    errors = more.pop("errors", np.full(50, hold_out * samples / 50))
    return ScoredModel(effects, fit, ({},) * len(effects), hold_out, errors, samples)


@pytest.fixture
def white() -> Any:
    return np.random.default_rng(7).normal(size=(N, 2))


@pytest.fixture
def silent(monkeypatch: pytest.MonkeyPatch) -> None:
    """The floor is exactly 1, so that shares are exact."""
    monkeypatch.setattr(choice, "noise_floor", lambda t: 1.0)


# -- the floor


@pytest.mark.parametrize("scale", [1.3, 2.0])
def test_the_floor_of_white_noise_is_its_variance(white: Any, scale: float) -> None:
    made = trial(1.0, problem=still(held=scale * white))
    assert choice.noise_floor(made) == pytest.approx(scale**2, rel=0.03)


def test_the_floor_is_not_below_what_was_stated(white: Any) -> None:
    assert choice.noise_floor(trial(1.0, problem=still(held=0.6 * white))) == 1.0


def test_what_a_model_leaves_out_is_not_noise(white: Any) -> None:
    """A slow error of twenty standard deviations, and one that ends in a jump."""
    t = 1e-3 * np.arange(N)
    slow = 20 * np.sin(2 * np.pi * 3.0 * t)[:, None]
    assert choice.noise_floor(trial(400.0, problem=still(held=1.3 * white + slow))) == pytest.approx(1.69, rel=0.03)
    jump = 10.0 * (t > t[-1] / 2)[:, None]
    assert choice.noise_floor(trial(50.0, problem=still(held=1.3 * white + jump))) == pytest.approx(1.69, rel=0.03)


def test_kinks_are_not_noise(white: Any) -> None:
    """Where a friction is not quite right a residual has a kink at each reversal: here every 1.6 s, of 50 sigma."""
    rows = 1.3 * white
    rows[100::1600] += 50.0
    assert choice.noise_floor(trial(1.0, problem=still(held=rows))) == pytest.approx(1.69, rel=0.05)


def test_the_floor_of_slow_rows_is_not_too_low(white: Any) -> None:
    """At 20 Hz a piece of 0.2 s has four rows, the median of whose squares is far below their mean."""
    made = still(held=2.0 * white[:4_000])
    first = made.experiments[0]
    assert isinstance(first, TimeExperiment)
    slow = replace(first, time=0.05 * np.arange(4_000, dtype=float), step=0.05)
    assert choice.noise_floor(trial(1.0, problem=replace(made, experiments=(slow,)))) == pytest.approx(4.0, rel=0.05)


def test_the_floor_is_that_of_held_out_data_where_there_are_some(white: Any) -> None:
    both = still(train=3.0 * white, held=1.3 * white)
    assert choice.noise_floor(trial(1.0, problem=both)) == pytest.approx(1.69, rel=0.03)
    assert choice.noise_floor(trial(1.0, problem=still(train=3.0 * white))) == pytest.approx(9.0, rel=0.03)


def test_the_floor_averages_over_recordings_and_signals(white: Any) -> None:
    made = still(one=white * [1.2, 2.0], other=white[::-1] * 1.6)
    assert choice.noise_floor(trial(1.0, problem=made)) == pytest.approx((1.44 + 4.0 + 2 * 2.56) / 4, rel=0.03)


def test_the_floor_counts_only_what_was_recorded(white: Any) -> None:
    """A signal that is read in every fourth row, one with gaps, and a model's error beside them."""
    rows = 2.0 * white + 20 * np.sin(2 * np.pi * 3e-3 * np.arange(N))[:, None]
    rows[np.arange(N) % 4 != 0, 0] = np.nan
    rows[5_000:9_000, 1] = np.nan
    assert choice.noise_floor(trial(1.0, problem=still(held=rows))) == pytest.approx(4.0, rel=0.06)
    assert choice.noise_floor(trial(1.0, problem=still(held=np.full((N, 1), np.nan)))) == 1.0


def test_a_few_rows_have_no_floor_of_their_own(white: Any) -> None:
    assert choice.noise_floor(trial(1.0, problem=still(held=5.0 * white[:63]))) == 1.0


# -- chance


def test_the_band_of_a_gain_is_that_of_a_sum() -> None:
    """Blocks that differ by chance: mean +- 1.96 sqrt(n) s, by the central limit theorem."""
    random = np.random.default_rng(3)
    blocks, samples = 300, 30_000
    worse = random.gamma(20.0, 6.0, blocks)
    gain = random.normal(2.0, 15.0, blocks)
    better = trial(1.0, errors=worse - gain, samples=samples)
    low, high = gain_band(better, trial(1.0, errors=worse, samples=samples), draws=4000)
    half = 1.96 * math.sqrt(blocks) * gain.std() / samples
    assert (low + high) / 2 == pytest.approx(gain.sum() / samples, abs=0.1 * half)
    assert (high - low) / 2 == pytest.approx(half, rel=0.05)


def test_the_band_of_a_gain_that_is_the_same_everywhere_has_no_width() -> None:
    found = gain_band(trial(1.0), trial(1.5))
    assert found == pytest.approx((0.5, 0.5))
    assert gain_band(trial(1.5), trial(1.0)) == pytest.approx((-0.5, -0.5))


@pytest.mark.parametrize("samples", [20, 200, 2000])
def test_noise_alone_exceeds_chance_once_in_twenty_times(samples: int) -> None:
    """Against chi-squared itself; a normal curve stands in for it, so a few rows exceed it a little more often."""
    draws = np.random.default_rng(samples).chisquare(samples, 40_000) / samples
    over = np.mean(draws > 1 + by_chance(trial(1.0, samples=samples)))
    assert 0.04 < over < 0.075
    assert by_chance(trial(1.0, samples=0)) == pytest.approx(NOISE.chance * math.sqrt(2))


def test_parameters_far_outside_their_tolerances_are_told() -> None:
    assert outside_tolerances(trial(1.0, x=(PREFERENCE.believed + 0.1, 0.3, -PREFERENCE.believed - 0.1))) == [
        "p0",
        "p2",
    ]


# -- whether something is left, and whether it is worth it


def test_what_lies_near_the_floor_needs_no_explanation(silent: Any) -> None:
    assert not choice.unexplained(trial(1 + 0.9 * PREFERENCE.least), 1.0)
    assert choice.unexplained(trial(1 + 1.1 * PREFERENCE.least), 1.0)
    assert not choice.unexplained(trial(3.0), 3.0)
    assert choice.unexplained(trial(3.0), 1.5)


def test_few_rows_need_more_to_be_unexplained(silent: Any) -> None:
    few = trial(1 + 1.1 * PREFERENCE.least, samples=20)
    assert by_chance(few) > 1.1 * PREFERENCE.least
    assert not choice.unexplained(few, 1.0)


def test_where_the_fitted_data_are_at_the_floor_nothing_is_unexplained(silent: Any) -> None:
    assert not choice.unexplained(trial(2.0, fitted=1 + 0.9 * PREFERENCE.fitted), 1.0)
    assert choice.unexplained(trial(2.0, fitted=1 + 1.1 * PREFERENCE.fitted), 1.0)


@pytest.mark.parametrize(("count", "share"), [(1, PREFERENCE.pays), (2, PREFERENCE.pays_again)])
def test_an_effect_must_take_its_share_of_the_excess(silent: Any, count: int, share: Any) -> None:
    effects = [effect(f"e{k}") for k in range(count)]
    worse = trial(11.0, *effects[1:])
    assert choice.worth_adding(trial(11 - 10 * (share + 0.02), *effects), worse)
    assert not choice.worth_adding(trial(11 - 10 * (share - 0.02), *effects), worse)


def test_a_gain_that_comes_from_few_blocks_does_not_pay(silent: Any) -> None:
    """Half the excess, all in one block of fifty, with losses elsewhere: the bootstrap often misses that block."""
    worse = trial(11.0)
    errors = worse.errors + 100.0
    errors[7] = worse.errors[7] - 5.0 * worse.samples - 4900.0
    better = trial(6.0, effect("e"), errors=errors)
    assert worse.errors.sum() - errors.sum() == pytest.approx(5.0 * worse.samples)
    assert gain_band(better, worse)[0] <= 0
    assert not choice.worth_adding(better, worse)


def test_the_share_explained_is_that_of_the_excess(silent: Any) -> None:
    assert choice.explained(trial(21.0), trial(6.0, effect("e"))) == pytest.approx(0.75)
    assert choice.explained(trial(21.0), trial(0.9, effect("e"))) == 1.0
    assert choice.explained(trial(21.0), trial(22.0, effect("e"))) == 0.0
    # Nothing held out is unexplained: then it is the strain on the tolerances that went.
    freed = trial(1.0, effect("wrong_parameter"), x=(0.0, 2.0))
    assert choice.explained(trial(1.0, x=(4.0, 0.0)), freed) == pytest.approx(1 - 4 / 16)


def test_a_right_law_reaches_the_floor(silent: Any) -> None:
    refit = trial(101.0)
    small = 1 + 0.9 * PREFERENCE.reached
    assert choice.reaches_floor(refit, trial(small, effect("e")))
    assert choice.reaches_floor(refit, trial(1 + 90 * PREFERENCE.left_over, effect("e")))
    assert not choice.reaches_floor(refit, trial(1 + 110 * PREFERENCE.left_over, effect("e")))
    # Or the fitted data are there, and no more is left of the others than the parameters may be uncertain by.
    at_floor, less = 1 + 0.5 * PREFERENCE.fitted, trial(11.0)
    assert choice.reaches_floor(less, trial(1 + 9.9 * PREFERENCE.uncertain, effect("e"), fitted=at_floor))
    assert not choice.reaches_floor(less, trial(1 + 10.1 * PREFERENCE.uncertain, effect("e"), fitted=at_floor))


def test_a_law_that_misses_what_it_was_fitted_to_is_not_right(silent: Any) -> None:
    refit = trial(5.0, fitted=46.0)
    assert choice.reaches_floor(refit, trial(1.3, effect("e"), fitted=1.3))
    assert not choice.reaches_floor(refit, trial(1.3, effect("e"), fitted=29.0))


def test_a_share_of_a_huge_mismatch_is_not_little(silent: Any) -> None:
    """Thousands of floors are far from the noise, however small a part they are of what was there before."""
    refit, at_floor = trial(1e6), 1 + 0.5 * PREFERENCE.fitted
    assert choice.reaches_floor(refit, trial(1 + 0.9 * PREFERENCE.left_at_most, effect("e")))
    assert not choice.reaches_floor(refit, trial(1 + 1.1 * PREFERENCE.left_at_most, effect("e")))
    assert choice.reaches_floor(refit, trial(1 + 0.9 * PREFERENCE.uncertain_at_most, effect("e"), fitted=at_floor))
    assert not choice.reaches_floor(refit, trial(1 + 1.1 * PREFERENCE.uncertain_at_most, effect("e"), fitted=at_floor))


def test_a_name_must_reach_the_floor_where_the_noise_was_stated(silent: Any) -> None:
    values = np.zeros(4)
    stated = Recording("r", "r.csv", values, (), (Channel("y", "rad", values, noise=0.1),))
    unstated = replace(stated, measurements=(Channel("y", "rad", values),))
    refit, halfway = trial(101.0), trial(21.0, effect("e"))
    assert choice.explained(refit, halfway) == pytest.approx(0.8)
    assert PREFERENCE.explains < 0.8
    assert not choice.accounts_for_mismatch([stated], refit, halfway)
    assert not choice.accounts_for_mismatch([stated, unstated], refit, trial(1 + 99 * PREFERENCE.explains, effect("e")))
    assert choice.accounts_for_mismatch([unstated], refit, halfway)
    assert choice.accounts_for_mismatch([stated, unstated], refit, halfway)
    assert choice.accounts_for_mismatch([stated], refit, trial(1.1, effect("e")))
    assert not choice.accounts_for_mismatch([unstated], refit, refit)


# -- which one


def test_the_price_counts_parameters_and_strain() -> None:
    made = trial(1.0, effect("e", parameters=2), effect("wrong_parameter", parameters=0), x=(1.0, -3.0), samples=1000)
    assert made.prior_cost == pytest.approx(10.0)
    assert choice.complexity_cost(made) == pytest.approx(10.0 + 3 * math.log(1000))
    assert made.merit == pytest.approx(1.0 + 10.0 / 1000)


def test_models_that_do_equally_well_are_near(silent: Any) -> None:
    parent, best = trial(50.0), trial(1.0, effect("best"))
    close = trial(1.0 + 0.9 * PREFERENCE.near, effect("close"))
    far = trial(1.0 + 1.1 * PREFERENCE.near, effect("far"))
    noisy = replace(far, errors=far.errors + 3000 * np.where(np.arange(50) % 2, 1.0, -1.0))
    assert choice.equally_good(best, [best, close, far, noisy], parent) == [best, close, noisy]
    few = [replace(t, samples=40) for t in (best, far)]
    assert choice.equally_good(few[0], few, parent) == few


@pytest.mark.parametrize(("left", "apart"), [(0.03, 0.05), (0.2, 0.2), (3.0, 0.25)])
def test_what_the_best_leaves_over_may_favour_one_law_or_another(silent: Any, left: float, apart: float) -> None:
    """Models are as near as that, no nearer than a twentieth and no farther than a quarter of the floor."""
    parent, best = trial(500.0), trial(1 + left, effect("best"))
    reach = max(apart, PREFERENCE.near * (1 + left))
    close, far = (trial(1 + left + share * reach, effect("e")) for share in (0.95, 1.05))
    assert choice.equally_good(best, [best, close, far], parent) == [best, close]


def test_a_model_that_misses_the_fitted_recordings_is_not_near() -> None:
    """Held-out data that hardly show what is missing cannot make up for it."""
    parent, best = trial(1.1, fitted=20.0), trial(1.03, effect("best"), fitted=1.0)
    blind, almost = trial(1.04, effect("blind"), fitted=15.0), trial(1.04, effect("almost"), fitted=1.2)
    assert choice.equally_good(best, [best, blind, almost], parent) == [best, almost]
    huge = trial(500.0, fitted=600.0)
    told = trial(1.04, effect("told"), fitted=1.0 + 0.9 * PREFERENCE.left_over * 599)
    assert choice.equally_good(best, [best, told], huge) == [best, told]


def test_of_equals_the_one_with_fewest_parameters_is_taken(silent: Any) -> None:
    parent = trial(50.0)
    rich, plain = trial(1.00, effect("rich", parameters=3)), trial(1.02, effect("plain"))
    assert choice.choose(parent, [rich, plain]) is plain
    assert choice.choose(parent, [rich, trial(9.0, effect("plain"))]) is rich


def test_strain_speaks_against_a_model(silent: Any) -> None:
    parent = trial(50.0)
    bent = trial(1.0, effect("bent"), x=(0.0, 6.0))
    straight = trial(1.0, effect("straight", parameters=2), x=(0.0, 0.1))
    assert choice.choose(parent, [bent, straight]) is straight


def test_nothing_is_chosen_where_nothing_pays(silent: Any) -> None:
    parent = trial(50.0)
    assert choice.choose(parent, []) is parent
    assert choice.choose(parent, [trial(45.0, effect("e"))]) is parent
    assert choice.choose(trial(1.05), [trial(1.0, effect("e"))]).effects == ()


def test_a_parameter_is_freed_where_the_refit_had_to_bend_it(silent: Any) -> None:
    bent = trial(1.0, x=(PREFERENCE.believed + 2.0,), cost=500.0)
    payload, wrong = (trial(1.0, effect(n), cost=480.0) for n in ("payload", "wrong_parameter"))
    assert choice.choose(bent, [payload, wrong]) is wrong
    assert choice.choose(bent, [trial(1.0, effect("e"), cost=500.0 - 0.5 * PREFERENCE.decisive)]) is bent
    assert choice.choose(bent, [trial(1.5, effect("e"), cost=100.0)]) is bent


def test_a_strained_model_is_relieved_by_a_wrong_parameter_beside_it(silent: Any) -> None:
    """If the fit gains decisively, of what is there beside the same effect, and held-out data do as well."""
    law, wrong = effect("law"), effect("wrong_parameter", "a.inertia", 0)
    bent = trial(1.0, law, x=(PREFERENCE.believed + 2.0,), cost=500.0)
    eased = trial(1.05, law, wrong, cost=480.0)
    assert choice.with_parameter_freed(bent, [eased]) is eased
    assert choice.with_parameter_freed(bent, []) is bent
    for other in (
        trial(1.05, law, wrong, cost=500.0 - 0.5 * PREFERENCE.decisive),
        trial(1.2, law, wrong, cost=480.0),
        trial(1.05, effect("other"), wrong, cost=480.0),
    ):
        assert choice.with_parameter_freed(bent, [other]) is bent
    straight = trial(1.0, law, x=(PREFERENCE.believed - 0.5,), cost=500.0)
    assert choice.with_parameter_freed(straight, [eased]) is straight


# -- what rivals it


def test_equals_elsewhere_are_rivals_and_others_are_not(silent: Any) -> None:
    refit, chosen = trial(50.0), trial(1.0, effect("chosen"))
    equal, worse = trial(1.01, effect("equal", "b.shaft")), trial(3.0, effect("worse"))
    costly = trial(1.0, effect("costly", parameters=9))
    assert choice.complexity_cost(costly) - choice.complexity_cost(chosen) > 3 * PREFERENCE.decisive
    assert choice.rivals(chosen, refit, [chosen, equal, worse, costly]) == (equal,)


def test_a_richer_law_is_a_rival_only_if_it_does_better(silent: Any) -> None:
    refit, chosen = trial(50.0), trial(2.0, effect("coulomb_friction"))
    same = trial(2.0 * (1 - 0.5 * PREFERENCE.richer), effect("stribeck_friction", parameters=3))
    better = trial(2.0 * (1 - 1.5 * PREFERENCE.richer), effect("stribeck_friction", parameters=3))
    assert choice.rivals(chosen, refit, [same]) == ()
    assert choice.rivals(chosen, refit, [better]) == (better,)
    elsewhere = replace(same, effects=(effect("stribeck_friction", "b.shaft"),))
    assert choice.rivals(chosen, refit, [elsewhere]) == (elsewhere,)


def test_a_pair_with_an_offset_rivals_a_single_effect(silent: Any) -> None:
    refit, chosen = trial(50.0), trial(1.0, effect("direction_dependent_friction", parameters=2))
    pair = trial(1.0, effect("coulomb_friction"), effect("offset", "u -> a"))
    other = trial(1.0, effect("coulomb_friction"), effect("lag", "u -> a"))
    assert choice.rivals(chosen, refit, [pair, other]) == (pair,)


def test_a_rival_that_only_contains_another_rival_is_none(silent: Any) -> None:
    refit, chosen = trial(50.0), trial(2.0, effect("lag", "u -> a"), effect("coulomb_friction"))
    delay = trial(2.0, effect("delay", "u -> a"), effect("coulomb_friction"))
    richer = trial(1.99, effect("delay", "u -> a"), effect("stribeck_friction", parameters=3))
    assert choice.rivals(chosen, refit, [delay, richer]) == (delay,)
    better = trial(
        2.0 * (1 - 1.5 * PREFERENCE.richer), effect("delay", "u -> a"), effect("stribeck_friction", parameters=3)
    )
    assert choice.rivals(chosen, refit, [delay, better]) == (better, delay)


def test_a_rival_that_was_fitted_twice_is_told_once(silent: Any) -> None:
    refit, chosen = trial(50.0), trial(2.0, effect("direction_dependent_friction", parameters=2))
    pair = trial(2.0, effect("coulomb_friction"), effect("offset", "u -> a"))
    again = trial(2.001, effect("offset", "u -> a"), effect("coulomb_friction"))
    assert choice.rivals(chosen, refit, [again, pair]) == (pair,)


def ended(hold_out: float, share: float) -> ScoredModel:
    """A spring that is at rest so far away, as a share of how far it may be."""
    spring = effect("stray_spring", "b.shaft")
    spring = replace(spring, parameters=(EffectParameter("rest_angle", 2.0, signed=True, most=3.0),))
    return replace(trial(hold_out, spring), sizes=({"rest_angle": -6.0 * share},))


def test_a_spring_that_is_at_rest_outside_its_range_is_no_rival_of_a_constant(silent: Any) -> None:
    refit, chosen = trial(50.0), trial(1.0, effect("offset", "u -> a"))
    spring, other = (
        trial(1.0, effect("stray_spring", "b.shaft", parameters=2)),
        trial(1.0, effect("gravity", parameters=2)),
    )
    assert choice.rivals(chosen, refit, [spring, other]) == (other,)


def test_a_size_that_went_as_far_as_it_may_is_another_effect(silent: Any) -> None:
    """It is no rival, is not chosen where another effect reaches the floor, and is not named where none does."""
    refit, zone = trial(50.0), trial(1.3, effect("dead_zone", "u -> a"))
    far, near = ended(1.0, 1.0), ended(1.0, 0.9)
    assert choice.rivals(zone, refit, [far, near]) == (near,)
    assert choice.choose(refit, [far, zone]) is zone
    assert choice.choose(refit, [near, zone]) is near
    worse = trial(9.0, effect("dead_zone", "u -> a"))
    assert choice.choose(refit, [far, worse]) is far
    assert choice.implausible(refit, far) == ["stray_spring.rest_angle"]
    assert not choice.accounts_for_mismatch([], refit, far)
    assert choice.accounts_for_mismatch([], refit, near)


def test_where_little_is_left_over_that_no_effect_accounts_for_nothing_is_missing(
    silent: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise a curve is looked for."""
    monkeypatch.setattr(select, "noise_floor", lambda t: 1.0)
    monkeypatch.setattr(select, "laws", lambda study: 1 / 0)
    half = trial(1.2, effect("e"))
    refit = trial(1 + 0.9 * PREFERENCE.unknown)
    nothing: Any = None
    study = Study(nothing, (), (9.0, 9.0), refit, (half,), half, nothing, ())
    assert not choice.missing(refit)
    assert select._unnamed(nothing, study, None).chosen is refit
    much = trial(1 + 1.1 * PREFERENCE.unknown)
    assert choice.missing(much)
    with pytest.raises(ZeroDivisionError):
        select._unnamed(nothing, replace(study, refit=much), None)


def test_what_needs_a_parameter_far_from_what_was_given_has_no_name(silent: Any) -> None:
    refit = trial(50.0, x=(1.0, -PREFERENCE.bent - 1))
    bent, straight = (
        trial(1.0, effect("e"), x=(x, -PREFERENCE.bent - 1)) for x in (PREFERENCE.bent + 1, PREFERENCE.bent - 1)
    )
    assert choice.implausible(refit, bent) == ["p0"]
    assert not choice.accounts_for_mismatch([], refit, bent)
    assert choice.implausible(refit, straight) == []
    assert choice.accounts_for_mismatch([], refit, straight)


def test_what_takes_most_of_the_strain_away_accounts_for_it(silent: Any) -> None:
    """A parameter that relieves is told by the same share as one that is named."""
    refit = trial(1.0, x=(9.0,))
    eased = trial(1.0, effect("wrong_parameter", "a.mass"), x=(9.0 * math.sqrt(PREFERENCE.relieves) - 0.1,))
    kept = trial(1.0, effect("wrong_parameter", "a.mass"), x=(9.0 * math.sqrt(PREFERENCE.relieves) + 0.1,))
    assert choice.accounts_for_mismatch([], refit, eased)
    assert not choice.accounts_for_mismatch([], refit, kept)


def test_where_only_tolerances_are_strained_rivals_cost_as_little(silent: Any) -> None:
    refit, chosen = trial(1.0, x=(9.0,)), trial(1.0, effect("wrong_parameter", "a.inertia"), cost=100.0)
    close = trial(1.0, effect("payload"), cost=100.0 + 0.5 * PREFERENCE.decisive)
    dear = trial(1.0, effect("spring"), cost=100.0 + 1.5 * PREFERENCE.decisive)
    assert choice.rivals(chosen, refit, [close, dear]) == (close,)
