"""A ripple is solved for from one that is hardly there, alone, beside an offset, and where it falls out of step."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import operating_scales
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.partial_fit import PartialFit, StartingPoint, ended, standing
from diagnosis.search.wave_starts import solved
from scenarios.load import load
from tests.diagnosis import plants
from tests.diagnosis.plants import case

NOISE = 0.05


def rippled(t: Any, u: Any, *, amplitude: Any, order: Any, phase: Any, offset: float = 0.0) -> NDArray[Any]:
    """Motor speed with a ripple of the angle, the input held between samples, by an adaptive Runge-Kutta method."""
    constant = plants.EFFICIENCY * plants.TORQUE_CONSTANT / plants.RESISTANCE
    damping = plants.VISCOUS + constant * plants.TORQUE_CONSTANT
    state, rows = np.zeros(2), []
    for volt in u:
        rows.append(state[1])

        def rate(_: Any, y: Any, volt: Any = volt) -> list[Any]:
            torque = constant * (volt + offset) - damping * y[1] + amplitude * math.sin(order * y[0] + phase)
            return [y[1], torque / plants.INERTIA]

        state = solve_ivp(rate, (0, t[1] - t[0]), state, rtol=1e-8, atol=1e-10).y[:, -1]
    return np.array(rows)


def bench(folder: Any, seed: Any, **truth: Any) -> tuple[Any, dict[Any, Any]]:
    """The motor with ``truth`` in it: where it is fitted, and the candidates at its shaft and its input."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plants, "speed", rippled)
        scenario = load(case(folder, noise=NOISE, seed=seed, **truth))
    fitter = CandidateFitter(scenario, gather(scenario, [], []), 1)
    listed = candidates(operating_scales(fitter.base))
    return fitter, {c.effect: c for c in listed if c.place == "motor.shaft" or c.effect == "offset"}


@pytest.fixture(scope="module")
def strong(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return bench(tmp_path_factory.mktemp("strong"), 1, amplitude=3e-4, order=3.0, phase=2.4)


def test_a_strong_ripple_is_solved_for_from_one_that_is_hardly_there(strong: Any) -> None:
    fitter, listed = strong
    ripple, refit = listed["torque_ripple"], fitter.refit
    found = fitter.finish(fitter.partial_fit((ripple,), [standing(refit.fit)]))
    assert refit.hold_out > 100
    assert found.hold_out < 1.2
    sizes = found.added()
    assert sizes["torque_ripple.order"] == 3.0
    assert sizes["torque_ripple.phase"] % (2 * math.pi) == pytest.approx(2.4, abs=0.01)
    # Torque and inertia are known by their ratio.
    share = found.fit.parameters()["motor.rotor_inertia"] / plants.INERTIA
    assert sizes["torque_ripple.amplitude"] == pytest.approx(3e-4 * share, rel=0.01)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return bench(tmp_path_factory.mktemp("pushed"), 2, amplitude=2e-5, order=2.0, phase=2.4, offset=0.01)


def test_an_order_is_solved_for_beside_another_effect(pushed: Any) -> None:
    """The offset alone has bent the motor's parameters; beside it the ripple is found, and a wrong order does worse."""
    fitter, listed = pushed
    ripple, offset = listed["torque_ripple"], listed["offset"]
    alone = fitter.finish(fitter.partial_fit((offset,), [standing(fitter.refit.fit)]))
    kept = ended(alone, alone.effects[0])
    pair = fitter.finish(fitter.partial_fit((kept, ripple), [standing(alone.fit)]))
    assert pair.added()["torque_ripple.order"] == 2.0
    assert pair.added()["torque_ripple.phase"] % (2 * math.pi) == pytest.approx(2.4, abs=0.05)
    assert pair.added()["offset.offset"] == pytest.approx(0.01, rel=0.1)
    assert pair.fit.chi2 < 1.2
    wrong = replace(ripple, starts=({"order": 4.0, "amplitude": 2e-5, "phase": 0.0},))
    held = fitter.finish(fitter.partial_fit((kept, wrong), [standing(alone.fit)]))
    assert held.fit.cost > pair.fit.cost + 1000


def test_the_linear_solution_ranks_the_orders(pushed: Any) -> None:
    fitter, listed = pushed
    effects = (listed["torque_ripple"], replace(listed["offset"], starts=({"offset": 0.01},)))
    best, second, *_ = solved(fitter, effects, 0, standing(fitter.refit.fit))
    assert best.sizes[0]["order"] == 2.0
    assert best.cost < 0.5 * second.cost


def of_twelve(listed: dict[Any, Any]) -> Candidate:
    """A ripple of twelve waves a turn that is hardly there."""
    start = {"order": 12.0, "amplitude": 1e-7, "phase": 0.0}
    ripple: Candidate = listed["torque_ripple"]
    assert ripple.wave is not None
    return replace(ripple, starts=(start,), wave=replace(ripple.wave, starts=(start,)))


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A motor that turns 24 times while its speed is off by a fifth: no wave of a whole recording is in step."""
    return bench(tmp_path_factory.mktemp("turning"), 3, amplitude=3e-4, order=12.0, phase=1.0)


def test_a_wave_that_falls_out_of_step_is_fitted_from_the_beginning(turning: Any) -> None:
    fitter, listed = turning
    ripple, refit = of_twelve(listed), fitter.refit
    found = fitter.finish(fitter.partial_fit((ripple,), [standing(refit.fit)]))
    assert refit.fit.chi2 > 500
    assert found.fit.chi2 < 1.2
    share = found.fit.parameters()["motor.rotor_inertia"] / plants.INERTIA
    assert found.added()["torque_ripple.amplitude"] == pytest.approx(3e-4 * share, rel=0.01)


@pytest.fixture(scope="module")
def ends(turning: Any) -> tuple[Any, PartialFit, PartialFit]:
    """Where a fit begins with a wave out of step, and where it ends on whole recordings: out of step too."""
    fitter, listed = turning
    ripple = of_twelve(listed)
    sizes = ({"order": 12.0, "amplitude": 1e-4, "phase": 2.5},)
    ((made, x, _),) = fitter.placed((ripple,), [sizes], standing(fitter.refit.fit))
    begun = PartialFit((ripple,), StartingPoint(math.inf, made, x, sizes, sizes), False)
    return fitter, begun, fitter._descended(begun, whole=True)


def test_a_fit_that_leaves_much_is_begun_again_over_the_beginning(ends: Any) -> None:
    fitter, begun, lost = ends
    assert lost.point.problem.chi2(lost.point.x, lost.point.problem.training) > 100
    direct, there = fitter._descended(begun, noise="white"), fitter._in_step(begun)
    made = there.point.problem
    assert made.chi2(there.point.x, made.training) < 1.2 < made.chi2(direct.point.x, made.training)
    found = fitter.compute_finish(begun)
    assert found.point.problem.chi2(found.point.x, found.point.problem.training) < 1.2, (
        "the end that leaves less counts"
    )


def test_whole_recordings_that_show_more_than_coarse_ones_are_fitted_again(ends: Any) -> None:
    fitter, begun, lost = ends
    found = fitter._back_in_step(begun, fitter._in_step(begun), lost)
    assert found.point.problem.chi2(found.point.x, found.point.problem.training) < 1.2
    assert fitter._back_in_step(begun, begun, found) is found, "what is in step stays"
