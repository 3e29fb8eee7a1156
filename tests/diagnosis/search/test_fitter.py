"""Where models are fitted: what a fit that runs away leaves, and what is given and not fitted."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.concealed.case import draw
from benchmarks.concealed.drawing import Options
from benchmarks.concealed.scenario import write
from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.least_squares import descend as real
from diagnosis.estimation.parameters import FreeParameter
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.estimation.tones import tones
from diagnosis.problems import resolved
from diagnosis.search import fitter as fitting
from diagnosis.search.dask_fitter import Order, Task, perform
from diagnosis.search.fitter import CandidateFitter, end_of
from diagnosis.search.partial_fit import PartialFit, StartingPoint, ended, standing
from diagnosis.search.screening import courses
from diagnosis.thresholds import COARSE, EVIDENCE
from engine.errors import SimulationError
from engine.work import counted
from scenarios.files import packed
from scenarios.load import load
from tests.diagnosis.plants import case


@pytest.fixture(scope="module")
def fitter(tmp_path_factory: pytest.TempPathFactory) -> CandidateFitter:
    """A motor with 25 mV of dead zone, integrated without flexarm."""
    scenario = load(case(tmp_path_factory.mktemp("motor"), dead=0.025))
    return CandidateFitter(scenario, gather(scenario, [], []), 1)


@pytest.fixture(scope="module")
def listed(fitter: CandidateFitter) -> Any:
    return candidates(operating_scales(fitter.base))


def test_a_fit_that_runs_away_is_left_at_its_last_good_place(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a model cannot be differentiated, descending gives no cost."""
    zone = next(c for c in listed if c.effect == "dead_zone")
    partial = replace(fitter.partial_fit((zone,), [standing(fitter.refit.fit)]), converged=False)
    monkeypatch.setattr(fitting, "descend", lambda problem, x, *rest, **more: (x + 9.0, math.inf, False))
    after = fitter.finish(partial)
    assert after.fit.cost == partial.point.cost
    np.testing.assert_array_equal(after.fit.x, partial.point.x)
    assert after.hold_out < 1.2  # it is a good place
    again = fitter.retried(after)
    assert again.fit.cost == after.fit.cost
    assert again.added() == after.added()


def test_a_fit_that_ended_in_a_hollow_goes_on_where_all_recordings_together_lead_out_of_it(
    fitter: CandidateFitter, listed: Any
) -> None:
    """A dead zone that stands half as wide as it is, as if nothing led on; it ends where `finish` ends."""
    zone = next(c for c in listed if c.effect == "dead_zone")
    right = fitter.finish(fitter.partial_fit((zone,), [{}]))
    point = end_of(right)
    x = np.array(
        [
            f.position(f.value(at) / 2) if "upper" in f.name else at
            for f, at in zip(point.problem.free, point.x, strict=True)
        ]
    )
    stuck = fitter._trial(
        PartialFit((zone,), replace(point, x=x, cost=point.problem.cost(x, point.problem.training)), True)
    )
    assert stuck.fit.cost > right.fit.cost + 100
    after = fitter.followed(stuck)
    assert after.fit.cost == pytest.approx(right.fit.cost, abs=1.0)
    assert after.log_evidence == pytest.approx(right.log_evidence, abs=1.0)
    kept = fitter.followed(right)
    np.testing.assert_array_equal(kept.fit.x, right.fit.x)


def test_a_model_that_stands_far_off_is_begun_from_the_parameters_of_another_one(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A dead zone with parameters two tolerances off, beside one that is where it fits best; no step leads on."""
    zone = next(c for c in listed if c.effect == "dead_zone")
    right = fitter.finish(fitter.partial_fit((zone,), [{}]))
    point = end_of(right)
    x = np.array([at + 2 * f.prior for f, at in zip(point.problem.free, point.x, strict=True)])
    cost = point.problem.cost(x, point.problem.training)
    off = fitter._trial(PartialFit((zone,), replace(point, x=x, cost=cost), False))
    monkeypatch.setattr(fitting, "descend", lambda made, x, *rest, **more: (x, made.cost(x, made.training), True))
    after = fitter.begun_from(off, right)
    np.testing.assert_allclose(after.fit.x, right.fit.x)
    assert after.fit.converged
    assert fitter.begun_from(right, off) is right


def test_a_model_is_likelier_by_half_of_what_its_fit_costs_less(fitter: CandidateFitter, listed: Any) -> None:
    """Where recordings are as short as these, what effects are looked at on is all of them."""
    zone = next(c for c in listed if c.effect == "dead_zone")
    right = fitter.finish(fitter.partial_fit((zone,), [{}]))
    assert fitter.likelier(right) == pytest.approx(0.5 * (fitter.refit.fit.cost - right.fit.cost), abs=0.01)
    assert fitter.likelier(fitter.refit) == 0.0


def test_a_fit_is_made_once_for_all_costs_that_it_is_to_reach(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless it was left early, and is now asked to reach less."""
    compute, asked = CandidateFitter.compute_finish, list[float]()

    def counted(self: CandidateFitter, partial: PartialFit, reach: float = math.inf) -> PartialFit:
        asked.append(reach)
        return compute(self, partial, reach)

    monkeypatch.setattr(CandidateFitter, "compute_finish", counted)
    near, far = (
        fitter.partial_fit((next(c for c in listed if c.effect == name),), [standing(fitter.refit.fit)])
        for name in ("uneven_gain", "sensor_bias")
    )
    found = fitter.finish(near, 1e12)
    assert fitter.finish(near) is found
    assert fitter.finish(near, 2e12) is found
    early = fitter.finish(far, -1e12)
    assert fitter.finish(far, -2e12) is early
    assert fitter.finish(far).fit.cost <= early.fit.cost
    assert asked == [1e12, -1e12, math.inf]


def test_no_model_is_judged_on_coarse_recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They have fewer samples to leave something over of, and a model judged on them would win against all others."""
    monkeypatch.setattr("diagnosis.search.coarse.COARSE", replace(COARSE, samples=800))
    scenario = load(case(tmp_path, dead=0.025, seed=2))
    fitter = CandidateFitter(scenario, gather(scenario, [], []), 1)
    assert fitter.coarse is not fitter.base
    zone = next(c for c in candidates(operating_scales(fitter.base)) if c.effect == "dead_zone")
    partial = fitter.partial_fit((zone,), [standing(fitter.refit.fit)])

    def descend(problem: Problem, x: Any, *rest: Any, **more: Any) -> Any:
        whole = not any(e.coarse for e in problem.experiments)
        return (x, math.inf, False) if whole else real(problem, x, *rest, **more)

    monkeypatch.setattr(fitting, "descend", descend)
    with pytest.raises(SimulationError, match="coarse recordings only"):
        fitter.finish(partial)


def _friction_and_dead_zone(path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[CandidateFitter, Candidate, Any]:
    """A motor with both, its recordings coarse: where it is fitted, the dead zone, and the model with the friction."""
    monkeypatch.setattr("diagnosis.search.coarse.COARSE", replace(COARSE, samples=800))
    scenario = load(case(path, coulomb=4.0e-4, dead=0.025, seed=2))
    made = CandidateFitter(scenario, gather(scenario, [], []), 1)
    found = candidates(operating_scales(made.base))
    friction = next(c for c in found if c.key == "coulomb_friction at motor.shaft")
    zone = next(c for c in found if c.effect == "dead_zone")
    return made, zone, made.finish(made.partial_fit((friction,), [standing(made.refit.fit)]))


def test_recordings_are_made_coarse_around_the_model_that_others_are_put_in_beside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There the residual is that of the whole recordings, smoothed; made coarse around the refit it is another one."""
    fitter, _, model = _friction_and_dead_zone(tmp_path, monkeypatch)
    near = fitter.near(model)
    assert fitter.near(fitter.refit) is fitter
    assert fitter.near(model) is near
    point = end_of(model)
    apart = []
    for one in (near, fitter):
        made, rows = one.build(model.effects, point.built), []
        for e, whole in zip(made.experiments, model.fit.problem.experiments, strict=True):
            assert isinstance(whole, TimeExperiment)
            assert e.thinned > 1
            smooth = whole.smoothed(model.fit.problem.residual(point.x, whole), e.thinned) * whole.sigma / e.sigma
            known = np.isfinite(e.measured)
            rows.append(np.abs((made.residual(point.x, e) - smooth)[known]).max())
        apart.append(max(rows))
    assert apart[0] < 1e-6
    assert apart[1] > 0.1


def test_a_fit_begun_there_is_finished_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the recordings that it was begun on, wherever it is asked for; a worker of a cluster does the same."""
    fitter, zone, model = _friction_and_dead_zone(tmp_path, monkeypatch)
    near = fitter.near(model)
    effects, values = (*(ended(model, c) for c in model.effects), zone), [standing(model.fit)]
    partial = near.partial_fit(effects, values)
    on = {id(e.measured) for e in near.coarse.experiments}
    assert {id(e.measured) for e in partial.point.problem.experiments} == on
    seen: list[set[int]] = []

    def descend(problem: Problem, x: Any, *rest: Any, **more: Any) -> Any:
        if any(e.coarse for e in problem.experiments):
            seen.append({id(e.measured) for e in problem.experiments})
        return real(problem, x, *rest, **more)

    monkeypatch.setattr(fitting, "descend", descend)
    finished = fitter.finish(partial)
    assert seen
    assert all(each == on for each in seen)
    assert not any(e.coarse for e in finished.fit.problem.experiments)
    assert finished.hold_out < 1.2

    order = Order(packed(fitter.scenario), (), fitter.recordings, 0, fitter.digest)
    assert near.centre is not None
    around = (near.centre.effects, near.centre.row())
    assert perform((order, Task(effects, tuple(values), around=around))) == partial.row()
    with counted() as work:
        end = near.compute_finish(partial)
    assert perform((order, Task(effects, (), partial.row(), around=around))) == replace(end, work=work.done).row()


def test_the_shape_of_a_loop_is_given_and_not_fitted(tmp_path: Path) -> None:
    """Of a Bouc-Wen joint recordings tell stiffness, yield, what is left of it and losses (the shape hardly shows)."""
    write(draw("pendulum", [], [], 1, Options(seconds=0.5, nuisance=0.0)), tmp_path / "case", tmp_path / "sealed")
    scenario = load(tmp_path / "case" / "scenario.yaml")
    made = CandidateFitter(scenario, gather(scenario, [], []), 1)
    yields = next(
        c for c in candidates(operating_scales(made.base)) if c.key == "hysteresis at gear.output -> arm.shaft"
    )
    names = [f.name.rpartition(".") for f in made.build((yields,), (yields.starts[0],)).free]
    assert {key for block, _, key in names if block == yields.name} == {
        "stiffness",
        "damping",
        "yield_twist",
        "residual_share",
    }


def test_effects_are_screened_beside_a_law_that_is_as_fast_as_the_motion_with_the_step_that_it_needs(
    tmp_path: Path,
) -> None:
    """A joint at rest is slow; moving, a Bouc-Wen element forgets within its yield over the speed.

    At the step that suits its rest it runs away, and nothing could be looked at beside it.
    """
    write(draw("pendulum", [], [], 1, Options(seconds=0.5, nuisance=0.0)), tmp_path / "case", tmp_path / "sealed")
    scenario = load(tmp_path / "case" / "scenario.yaml")
    made = CandidateFitter(scenario, gather(scenario, [], []), 1)
    listed = candidates(operating_scales(made.base))
    joint = next(c for c in listed if c.key == "hysteresis at gear.output -> arm.shaft")
    soft = next(sizes for sizes in joint.starts if sizes["stiffness"] < 200)
    yields = replace(joint, starts=({**soft, "yield_twist": 0.1 * soft["yield_twist"]},))
    values = standing(made.refit.fit)
    alone = made.build((yields,), (yields.starts[0],))
    resting = resolved(alone, np.zeros(len(alone.free)))
    assert resting is not None
    with pytest.raises(SimulationError, match="diverged"):
        resting.linearised(np.zeros(len(resting.free)), resting.training[0])
    origin = made.origin((yields,), values)
    assert origin is not None
    assert origin.problem.internal_step is not None
    assert resting.internal_step is not None
    assert origin.problem.internal_step < resting.internal_step
    friction = next(c for c in listed if c.effect == "coulomb_friction")
    steps = {
        m.internal_step for m, *_ in made.placed((yields, friction), [(yields.starts[0], friction.starts[0])], values)
    }
    assert steps == {origin.problem.internal_step}
    assert courses(origin, friction)


def test_a_vibration_answers_in_proportion_to_a_small_step_of_its_frequency(tmp_path: Path) -> None:
    """A hundred periods: half a line of the spectrum to either side loses a whole turn until the end, a tenth does not.

    By the shares of the change that tangents miss, of central differences over a tenth of a step of the fit.
    """
    drawn = draw("geared-two-mass", ["outside_vibration"], [8.0], 1, Options(seconds=20.0, rate=200.0))
    write(drawn, tmp_path / "case", tmp_path / "sealed")
    scenario = load(tmp_path / "case" / "scenario.yaml")
    made = CandidateFitter(scenario, gather(scenario, [], []), 1)
    refit = made.refit.fit
    left = {e.name: refit.problem.residual(refit.x, e) for e in refit.problem.training}
    scales = replace(operating_scales(made.base), tones=tones(refit.problem.training, left, 3))
    truth = drawn.answers()["concealed"][0]
    vibration = next(
        c for c in candidates(scales) if c.effect == "outside_vibration" and c.place in truth["same_place"]
    )
    fit = made.settled(made.finish(made.partial_fit((vibration,), [standing(refit)]))).fit
    name = f"{vibration.name}.frequency"
    assert fit.converged
    assert fit.parameters()[name] == pytest.approx(
        2 * math.pi * truth["parameters"]["frequency"], abs=0.1 * math.pi / 10
    )
    k = [f.name for f in fit.problem.free].index(name)
    step = np.where(np.arange(len(fit.x)) == k, 0.1, 0.0)
    for e in fit.problem.training:
        slope = fit.problem.linearised(fit.x, e)[1].reshape(*e.measured.shape, len(fit.x))[..., k]
        change = fit.problem.residual(fit.x + step, e) - fit.problem.residual(fit.x - step, e)
        assert np.sum((change - 0.2 * slope) ** 2) < 0.1 * np.sum(change**2)


def test_candidates_are_built_without_reading_anything_again(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Recordings are prepared once a study, and a candidate edits the system in memory."""

    def refuse(*given: Any, **more: Any) -> None:
        raise AssertionError("read again")

    for name in ("diagnosis.problems.experiment", "diagnosis.problems.bind", "scenarios.load.load"):
        monkeypatch.setattr(name, refuse)
    monkeypatch.setattr("scenarios.document.parse", refuse)
    zone = next(c for c in listed if c.effect == "dead_zone")
    made = fitter.build((zone,), (zone.starts[0],))
    assert made.model.inputs[0].name == f"{zone.name}.in"
    assert made.experiments == fitter.base.experiments


def test_a_fit_that_was_tried_again_and_kept_is_the_same_model(fitter: CandidateFitter, listed: Any) -> None:
    """Its search vector counts from the sizes that the model was built with, not from those that were asked for."""
    zone = next(c for c in listed if c.effect == "dead_zone")
    built, asked = {"lower": -0.01, "upper": 0.01}, {"lower": -0.02, "upper": 0.03}
    made = fitter.build((zone,), (built,))
    given = {f"{zone.name}.{key}": value for key, value in asked.items()}
    x = np.array([f.position(given[f.name]) if f.name in given else 0.0 for f in made.free])
    cost = made.cost(x, made.training)
    begun = fitter._trial(PartialFit((zone,), StartingPoint(cost, made, x, (asked,), (built,)), False))
    kept: dict[str, Any] = {}
    storing = CandidateFitter(fitter.scenario, fitter.recordings, 1, store=kept)
    first = storing.retried(begun)
    assert len(kept) == 1
    again = storing.retried(begun)
    assert first.fit.cost < begun.fit.cost
    assert again.fit.parameters() == first.fit.parameters()
    assert again.log_evidence == pytest.approx(first.log_evidence)


def test_a_fit_is_tried_again_until_two_tries_end_as_low_as_the_lowest(
    fitter: CandidateFitter, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And each is left where it would not come that low, nor to the cost that counts."""
    refit = fitter.refit
    for ends, tries, converged in (
        ([0.5, -0.2], 2, True),
        ([5.0, -9.0, -8.5, 7.0, -8.6], 5, True),
        ([-9.0] * 3, 3, True),
    ):
        left, reaches = list(ends), list[float]()

        def descended(problem: Problem, x: np.ndarray, *rest: Any, reach: float, left: Any = left, **_: Any) -> Any:
            reaches.append(reach - refit.fit.cost)  # noqa: B023
            return x, refit.fit.cost + left.pop(0), True

        monkeypatch.setattr(fitting, "descend", descended)
        again = fitter.retried(refit, refit.fit.cost + 0.4)
        assert len(reaches) == tries
        assert again.fit.converged == converged
        assert again.fit.cost == pytest.approx(refit.fit.cost + min([*ends[:tries], 0.0]))
        lowest = [min([0.0, *ends[:k]]) + 1.0 for k in range(tries)]
        assert reaches == pytest.approx([min(low, 0.4) for low in lowest])


def test_of_several_starts_each_is_to_come_as_low_as_the_best_before_it(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only one goes on from there."""
    zone, made = next(c for c in listed if c.effect == "dead_zone"), fitter.base
    points = [StartingPoint(9.0, made, np.full(1, k), (zone.starts[k],), (zone.starts[k],)) for k in range(3)]
    monkeypatch.setattr(fitter, "_begun", lambda *_: points)
    monkeypatch.setattr(fitter, "_refined", lambda partial: partial)
    costs, reaches = [7.0, 8.0, 5.0], list[float]()

    def descended(problem: Problem, x: np.ndarray, *rest: Any, reach: float, **_: Any) -> Any:
        reaches.append(reach)
        return x, costs[int(x[0])], True

    monkeypatch.setattr(fitting, "descend", descended)
    assert fitter.compute_partial_fit((zone,), [{}]).point.sizes == (zone.starts[2],)
    assert reaches == [math.inf, 7.0, 7.0]


@pytest.mark.parametrize(("gain", "kept"), [(1.0, True), (-1.0, False)])
def test_a_limit_beyond_all_commands_is_begun_anew_from_where_it_acts(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch, gain: float, kept: bool
) -> None:
    """It has no slope where it stands: nothing says how much nearer it belongs."""
    limit = next(c for c in listed if c.effect == "saturation")
    commands = np.concatenate([np.asarray(e.drive.values).ravel() for e in over_time(fitter.base.training) if e.drive])
    sizes = {"lower": 1.5 * float(commands.min()), "upper": 0.9 * float(commands.max())}
    made = fitter.build((limit,), (sizes,))
    x = np.zeros(len(made.free))
    partial = PartialFit(
        (limit,), StartingPoint(made.cost(x, made.training, noise="white"), made, x, (sizes,), (sizes,)), False
    )
    begun: list[dict[str, float]] = []

    def descended(given: PartialFit, **_: Any) -> PartialFit:
        begun.append(given.point.problem.values(given.point.x)[0])
        return replace(given, point=replace(given.point, cost=partial.point.cost - gain))

    monkeypatch.setattr(fitter, "_descended", descended)
    after = fitter._acting(partial)
    (there,) = begun
    acting = [start["lower"] for start in limit.starts if start["lower"] > commands.min()]
    assert there[f"{limit.name}.lower"] == pytest.approx(min(acting))
    assert there[f"{limit.name}.upper"] == pytest.approx(sizes["upper"])
    assert (after is not partial) == kept


def test_states_of_a_block_that_was_put_in_are_no_sizes(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a further mode begins is nothing that it could be begun with, though no recording answers to it."""
    mode = next(c for c in listed if c.effect == "extra_mode")
    made = fitter.build((mode,), (mode.starts[0],))
    begins = FreeParameter(f"{mode.name}.body.angle", 0.0, 1.0, False, recording=made.training[0].name)
    idle = replace(made, free=(*made.free, begins))
    monkeypatch.setattr(fitting, "_is_idle", lambda point, number: point.problem.free[number] is begins)
    x = np.zeros(len(idle.free))
    partial = PartialFit((mode,), StartingPoint(0.0, idle, x, (mode.starts[0],), (mode.starts[0],)), False)
    assert fitter._acting(partial) is partial


def test_a_model_that_is_compared_with_a_richer_one_is_begun_from_its_end_too(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its own and the user's parameters there: where a cost has many low points, like is compared with like."""
    zone = next(c for c in listed if c.effect == "dead_zone")
    model = fitter.finish(fitter.partial_fit((zone,), [standing(fitter.refit.fit)]))
    richer = replace(model, fit=replace(model.fit, x=model.fit.x + 0.1))
    begun: list[np.ndarray] = []

    def descended(problem: Problem, x: np.ndarray, *rest: Any, **more: Any) -> Any:
        begun.append(x)
        return real(problem, x, *rest, **more)

    monkeypatch.setattr(fitting, "descend", descended)
    end = fitter.closest(model, [richer])
    np.testing.assert_allclose(begun, [model.fit.x, model.fit.x + 0.1], rtol=1e-12)
    assert end.fit.chi2 <= model.fit.chi2 * (1 + 1e-9)


def test_an_amended_model_is_not_told_with_parameters_that_follow_a_nuisance(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slow drift counts little by likelihood; at the least squared error it bends what recordings say little of."""
    zone = next(c for c in listed if c.effect == "dead_zone")
    refit = fitter.refit
    model = fitter.finish(fitter.partial_fit((zone,), [standing(refit.fit)]))
    own = np.array([9.0 if f.prior and not f.recording else 0.0 for f in model.fit.problem.free])
    left = replace(model.left, energies=0.9 * model.left.energies)
    closer = replace(model, left=left)
    bent = replace(closer, fit=replace(model.fit, x=model.fit.x + own))
    assert bent.bent
    assert not model.bent
    for end, told in ((closer, closer), (bent, model)):
        monkeypatch.setattr(fitter, "_trial", lambda *_, end=end: end)
        assert fitter.closest(model).fit is told.fit
        assert (fitter.closest(model).left is left) == (end is closer)
    monkeypatch.setattr(fitter, "_trial", lambda *_: bent)
    assert fitter.closest(replace(model, fit=bent.fit)).left is left
    assert fitter.closest(refit).left is left  # the user's own model bends where an effect is missing
    far = replace(model, left=replace(model.left, energies=9 * model.left.energies))
    assert fitter.closest(far).left is left  # so does one that leaves much: the closest is asked for


def test_an_end_that_is_none_takes_no_place_of_one(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where friction sticks, the squared error has kinks at which every step stops, and no interval could be told."""
    zone = next(c for c in listed if c.effect == "dead_zone")
    model = fitter.finish(fitter.partial_fit((zone,), [standing(fitter.refit.fit)]))
    ended, left_early = (replace(model, fit=replace(model.fit, converged=ends)) for ends in (True, False))
    for known, end, told in (
        (ended, ended, "closer"),
        (ended, left_early, "known"),
        (left_early, left_early, "closer"),
        (left_early, ended, "closer"),
    ):
        closer = replace(end, hold_out=0.9 * end.hold_out)
        monkeypatch.setattr(fitter, "_trial", lambda *_, closer=closer: closer)
        found = fitter.closest(known)
        assert found.hold_out == (closer if told == "closer" else known).hold_out
        assert found.fit.converged == (known.fit.converged or end.fit.converged)
    far = replace(ended, fit=replace(ended.fit, chi2=1e6), hold_out=1e6)
    for share, stays in ((0.4, False), (0.6, True)):  # where it leaves far less, it is told without intervals
        less = replace(left_early, fit=replace(left_early.fit, chi2=share * 1e6), hold_out=share * 1e6)
        monkeypatch.setattr(fitter, "_trial", lambda *_, less=less: less)
        assert fitter.closest(far).fit.converged == stays
    refit = replace(fitter.refit, fit=replace(fitter.refit.fit, converged=True))
    closer = replace(refit, hold_out=0.9 * refit.hold_out, fit=replace(refit.fit, converged=False))
    monkeypatch.setattr(fitter, "_trial", lambda *_: closer)
    assert fitter.closest(refit).hold_out == closer.hold_out  # of the user's own the error is told, however it ended


def test_a_model_may_be_judged_where_another_end_of_its_fit_was(fitter: CandidateFitter, listed: Any) -> None:
    zone = next(c for c in listed if c.effect == "dead_zone")
    model = fitter.finish(fitter.partial_fit((zone,), [standing(fitter.refit.fit)]))
    made = model.judged_as(fitter.refit)
    assert (made.effects, made.fit, made.sizes, made.hold_out) == (
        model.effects,
        model.fit,
        model.sizes,
        model.hold_out,
    )
    there = fitter.refit
    assert (made.left, made.unseen, made.log_evidence) == (there.left, there.unseen, there.log_evidence)
    assert (made.foretold, made.owed) == (there.foretold, there.owed)
    assert made.likeliest is there.likeliest


def test_a_bent_parent_does_not_take_the_turn_of_the_given_values(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parameters bent in the place of an effect leave little before it is fitted, and nothing for it to explain."""
    zone = next(c for c in listed if c.effect == "dead_zone")

    def point(cost: float) -> StartingPoint:
        return StartingPoint(cost, fitter.base, np.zeros(1), (zone.starts[0],), (zone.starts[0],))

    costs = {"bent": [100.0, 101.0], "given": [900.0, 950.0]}
    monkeypatch.setattr(fitter, "origin", lambda effects, values: next(iter(values)))
    monkeypatch.setattr(fitting, "begun", lambda *args, bold: [point(cost) for cost in costs[args[0]]])
    begun = fitter._begun((zone,), [{"bent": 1.0}, {"given": 1.0}])
    assert [start.cost for start in begun] == [100.0, 101.0, 900.0]
    assert [start.cost for start in fitter._begun((zone,), [{"given": 1.0}])] == [900.0, 950.0]


@pytest.mark.parametrize("reach", [math.inf, 40.0])
def test_a_fit_from_the_beginnings_is_left_where_it_would_come_no_lower_than_the_one_that_it_is_to_better(
    monkeypatch: pytest.MonkeyPatch, reach: float
) -> None:
    """What lacks physics is lost on the way. It is not asked how likely it is there, which two runs would have told."""
    asked: list[float] = []

    def descend(problem: Any, x: Any, *rest: Any, reach: float, **more: Any) -> Any:
        asked.append(reach)
        return x, 60.0, False

    monkeypatch.setattr(fitting, "grown", lambda made, starts: np.array([1.0]))
    monkeypatch.setattr(fitting, "descend", descend)
    problem: Any = SimpleNamespace(chi2=lambda x, experiments: 9.0, training=())
    whole = PartialFit((), StartingPoint(50.0, problem, np.zeros(1), (), ()), True)
    where: Any = SimpleNamespace(tables=False, _likelier=lambda ends: ends[-1], _is_smooth=lambda *where: False)
    assert CandidateFitter._back_in_step(where, whole, whole, whole, reach) is whole
    assert asked == [min(reach, 50.0)]
    where._is_smooth = lambda *where: True
    assert CandidateFitter._back_in_step(where, whole, whole, whole, reach) is whole
    assert len(asked) == 1, "what is smooth is not begun again"


def test_what_answers_smoothly_has_not_lost_its_way_unless_it_is_a_wave(
    fitter: CandidateFitter, listed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The user's model of a motor with a dead zone; tangents that hold nowhere stand for a machine that sticks."""
    zone, wave = (next(c for c in listed if c.effect == name) for name in ("dead_zone", "torque_ripple"))
    point = end_of(fitter.refit)
    assert point.problem.chi2(point.x, point.problem.training) > EVIDENCE.stated
    assert CandidateFitter._is_smooth((zone,), point)
    assert not CandidateFitter._is_smooth((zone, wave), point)
    monkeypatch.setattr(fitting, "foretell", lambda problem, x, experiments: False)
    assert not CandidateFitter._is_smooth((zone,), point)
