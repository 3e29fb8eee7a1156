"""Fits to ever more of the recordings: how far they are followed, and which of several models keep up."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.concealed.case import draw
from benchmarks.concealed.scenario import write
from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import beside
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation import growing
from diagnosis.estimation.least_squares import descend
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.partial_fit import standing
from diagnosis.search.search import _seen_beside
from diagnosis.search.wave_starts import solved
from diagnosis.thresholds import SEARCH
from engine.threads import Threads
from scenarios.load import load

Vector = NDArray[np.float64]


class Followed:
    """A made-up model: a recording is followed over a share that is small beside how exactly its parameter is known.

    The parameter is an error, as small as the root of all that is followed is large.

    Args:
        hardness: of each recording; a share times the error times this is to be less than one.
        begins: what each leaves of its beginning.
    """

    def __init__(self, hardness: Sequence[float], begins: Sequence[float]) -> None:
        self.hardness, self.begins = hardness, begins
        self.training = tuple(range(len(hardness)))
        self.shares: list[tuple[float, ...]] = []

    def fitted(self, _: Any, x: Vector, __: Any, shares: Sequence[float], *___: Any) -> tuple[Vector, list[float]]:
        """As of `growing._followed`."""
        self.shares.append(tuple(shares))
        fits = [h * share * x[0] < 1 for h, share in zip(self.hardness, shares, strict=True)]
        leaves = [b if fit else 100.0 for b, fit in zip(self.begins, fits, strict=True)]
        return np.array([sum(shares) ** -0.5]) if all(fits) else 10 * x, leaves


def grown(world: Followed, monkeypatch: pytest.MonkeyPatch) -> float:
    monkeypatch.setattr(growing, "_followed", world.fitted)
    made: Any = world
    found = growing.grown(made, [np.array([4.0])])
    assert found is not None
    return float(found[0])


def test_what_is_lost_goes_on_in_smaller_strides_and_the_others_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    world = Followed([0.1, 1.3], [1.0, 1.0])
    found = grown(world, monkeypatch)
    assert world.shares[0] == (SEARCH.beginning, SEARCH.beginning)
    assert world.shares[-1] == (1.0, 1.0)
    assert found == pytest.approx(0.5**0.5), "by both, whole"
    ahead = [first for first, second in world.shares if second < 1]
    assert max(ahead) == 1.0, "the first is whole before the second"
    steps = sorted({second for _, second in world.shares})
    assert min(b / a for a, b in itertools.pairwise(steps)) < 2**0.5


def test_what_cannot_be_followed_stays_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    """As exactly as both recordings tell the parameter, 0.395 of the second can be followed."""
    world = Followed([0.1, 3.0], [1.0, 1.0])
    second = grown(world, monkeypatch) ** -2 - 1.0
    assert any(first == 1.0 and other == pytest.approx(second) for first, other in world.shares)
    assert 0.395 / 2**SEARCH.stride < second < 0.395
    assert len(world.shares) < 40, "it ends"


def test_what_leaves_twice_as_much_over_an_octave_is_lost_however_short_its_strides(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A model that lacks physics leaves a little more with every stride; twice as much of each octave it leaves."""

    class Lacking(Followed):
        def fitted(self, _: Any, x: Vector, __: Any, shares: Sequence[float], *___: Any) -> tuple[Vector, list[float]]:
            self.shares.append(tuple(shares))
            return x, [
                1.5 * (share / SEARCH.beginning) ** slope for share, slope in zip(shares, (0.0, 2.0), strict=True)
            ]

    world = Lacking([0.0, 0.0], [1.0, 1.0])
    grown(world, monkeypatch)
    assert max(second for first, second in world.shares if first == 1.0) < 2.0**0.5 * SEARCH.beginning
    assert len(world.shares) < 16


def test_no_stride_becomes_longer_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """What lacks physics would be lost in every other stride, if each that is followed made the next one longer."""
    strides: list[float] = []

    class Strides(Followed):
        followed = SEARCH.beginning

        def fitted(self, _: Any, x: Vector, __: Any, shares: Sequence[float], *___: Any) -> tuple[Vector, list[float]]:
            (share,) = shares
            fits = share < 1.2 * self.followed or share == SEARCH.beginning
            if share > SEARCH.beginning and share < 1:  # the last one ends with the recording
                strides.append(share / self.followed)
            self.followed = share if fits else self.followed
            return x, [1.0 if fits else 100.0]

    grown(Strides([0.0], [1.0]), monkeypatch)
    assert strides == sorted(strides, reverse=True)
    assert strides[-1] == pytest.approx(2**0.25)


def test_what_leaves_less_than_twice_as_much_over_each_octave_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nuisances of a machine whose sensors are fine: 30 times the noise over all of it."""

    class Drifting(Followed):
        def fitted(self, _: Any, x: Vector, __: Any, shares: Sequence[float], *___: Any) -> tuple[Vector, list[float]]:
            self.shares.append(tuple(shares))
            return x, [(share / SEARCH.beginning) ** 0.95 for share in shares]

    world = Drifting([0.0], [1.0])
    grown(world, monkeypatch)
    assert world.shares[-1] == (1.0,)
    assert len(world.shares) == 6


def test_a_model_that_does_not_follow_the_beginnings_is_left_there(monkeypatch: pytest.MonkeyPatch) -> None:
    world = Followed([0.0, 0.0], [1.0, 3.0])
    monkeypatch.setattr(growing, "_followed", world.fitted)
    made: Any = world
    assert growing.grown(made, [np.array([4.0])]) is None
    assert len(world.shares) == 1
    growing.doubled(made, np.array([4.0]))
    assert [share for share, _ in world.shares[1:]] == [1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2]


def test_the_first_start_that_the_beginnings_are_followed_from_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 400 the second recording is lost at once."""
    world = Followed([0.1, 1.3], [1.0, 1.0])
    monkeypatch.setattr(growing, "_followed", world.fitted)
    made: Any = world
    found = growing.grown(made, [np.array([400.0]), np.array([4.0])])
    assert found == pytest.approx(0.5**0.5)
    assert world.shares[:3] == [(1 / 32, 1 / 32)] * 2 + [(1 / 16, 1 / 16)]


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_motor_that_sticks_between_the_waves_of_its_magnets_is_followed_to_the_end(
    tmp_path: Path, share: float
) -> None:
    """Where it comes to rest hangs on every parameter: a fit to all of it ends far above the noise.

    It begins at the true order and at a share of the true friction. The first digits that a processor rounds otherwise
    decide which orders come before the true one, and where the fit to all of it ends. So does a
    thousandth of the cogging: from six of eight shares between 0.4 and 1.3 it is followed, and from four with that. So
    the case is a fixed one, of 300 thresholds as they were taken for when it was met (0.4266 and 1.1796 mN.m).
    """
    case = draw("geared-two-mass", ["coulomb_friction", "cogging"], [299.99447, 300.26917], 2)
    write(case, tmp_path / "case", tmp_path / "answers")
    truth = {e.effect: e.parameters for e in case.truth.concealed}
    scenario = load(str(tmp_path / "case" / "scenario.yaml"))
    fitter = CandidateFitter(scenario, gather(scenario, [], []), 1)
    listed = {c.key: c for c in candidates(_seen_beside(operating_scales(fitter.base), fitter.refit))}
    friction = listed["coulomb_friction at motor.shaft"]
    level = truth["coulomb_friction"]["coulomb_friction"]
    friction = replace(friction, starts=({"coulomb_friction": share * level},))
    cogging = beside([friction], listed["cogging at motor.shaft"])
    assert cogging is not None
    starts = solved(fitter, (friction, cogging), 1, standing(fitter.refit.fit))
    best = next(start for start in starts if start.sizes[1]["order"] == truth["cogging"]["order"])

    made = fitter.build((friction, cogging), best.built, whole=True)
    found = growing.grown(made, [best.x])
    assert found is not None
    with Threads(1) as pool:
        whole, *_ = descend(made, best.x, made.training, pool, iterations=SEARCH.most_steps)
    assert made.chi2(found, made.training) < SEARCH.lost
    assert made.chi2(whole, made.training) > 100.0
    sizes = made.values(found)[0]
    # Torques go by their ratios; in those to the rotor's inertia the gear's own has a share that is hardly told.
    amplitude, kinetic = sizes["found_cogging.amplitude"], sizes["found_coulomb_friction.coulomb_friction"]
    assert kinetic / amplitude == pytest.approx(level / truth["cogging"]["amplitude"], rel=0.01)
    ratio = sizes["motor.rotor_inertia"] / case.truth.parameters["motor.rotor_inertia"]
    assert amplitude == pytest.approx(ratio * truth["cogging"]["amplitude"], rel=0.05)


def test_half_of_the_models_is_dropped_at_each_doubling_once_the_recordings_tell(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Model 5 is the right one: it looks worst over the first instants, and best from an eighth on."""
    tried: dict[float, list[int]] = {}

    def fitted(made: Any, x: NDArray[np.float64], share: float, *_: Any) -> tuple[NDArray[np.float64], float]:
        tried.setdefault(share, []).append(made)
        early = share < SEARCH.telling
        return x + 1, float((9 if early else -1) if made == 5 else made)

    monkeypatch.setattr(growing, "_fitted", fitted)
    models: list[Any] = list(range(8))
    found = growing.raced([(made, np.zeros(1)) for made in models])
    assert [len(tried[share]) for share in sorted(tried)] == [8, 8, 8, 4, 2]
    ((number, x),) = found
    assert number == 5
    assert x == len(tried), "it goes on from where it ended"
