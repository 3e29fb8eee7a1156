"""Which models agree with a finding, on made-up models."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from blocks.actuators.spring_damper import SpringDamper
from blocks.links.inertia import Inertia
from diagnosis.effects.effect import Candidate, EffectParameter
from diagnosis.estimation.least_squares import Interval
from diagnosis.estimation.leftover import Leftover
from diagnosis.estimation.parameters import FreeParameter
from diagnosis.search.scored_model import ScoredModel
from diagnosis.thresholds import WORDING
from diagnosis.verdict import verdict as verdicts
from diagnosis.verdict.verdict import _says_the_same, untold_sizes
from diagnosis.verdict.wording import _both_ways, finding_sentence

STIFFNESS = FreeParameter("shaft.stiffness", 2.0, 0.2, True)
MASS = FreeParameter("load.mass", 1.0, 0.1, True)


NOISE = Leftover(np.array([100.0]), np.array([100.0]), np.ones(1), ((0, 0),), np.array([[100.0]]), np.array([[100.0]]))
REFIT = SimpleNamespace(hold_out=9.0, together=9.0, left=NOISE, strain=0.0, bent=False)


def model(x: tuple[float, float], *effects: Candidate) -> Any:
    problem = SimpleNamespace(free=(STIFFNESS, MASS))
    made = SimpleNamespace(effects=effects, fit=SimpleNamespace(problem=problem, x=x))
    made.far_off = ScoredModel.far_off.fget(made)  # type: ignore[attr-defined]
    return made


def wrong(f: FreeParameter) -> Candidate:
    return Candidate("wrong_parameter", f.name, "shaft", "shaft", lambda sizes: [], freed=f)


@pytest.mark.parametrize(("tolerances", "same"), [(WORDING.far + 0.5, True), (WORDING.far - 0.5, False)])
def test_nothing_with_the_same_parameter_far_off_is_no_rival_of_a_wrong_parameter(
    tolerances: float, same: bool
) -> None:
    """Both say that the stiffness is wrong; they differ in whether it may be."""
    assert _says_the_same(model((tolerances, 0.0)), wrong(STIFFNESS)) == same
    assert _says_the_same(model((-tolerances, 0.0)), wrong(STIFFNESS)) == same
    assert not _says_the_same(model((tolerances, 0.0)), wrong(MASS))


def test_a_model_with_an_effect_is_a_rival_of_a_wrong_parameter_and_nothing_of_an_effect() -> None:
    lag = Candidate("lag", "u", "u", "found_lag", lambda sizes: [])
    assert not _says_the_same(model((9.0, 0.0), lag), wrong(STIFFNESS))
    assert not _says_the_same(model((9.0, 0.0)), lag)


def test_a_machine_that_turns_back_is_not_driven_in_one_direction() -> None:
    """Under a reference that never changes its sign the force does; noise around zero is no way back."""

    def recorded(*signals: list[float]) -> Any:
        return SimpleNamespace(measured=np.array(signals).T, sigma=np.full(len(signals), 0.1))

    position, force = [0.0, 1.0, 2.0, np.nan], [3.0, 0.0, -3.0, 0.0]
    assert _both_ways(recorded(position, force))
    assert not _both_ways(recorded(position, [3.0, 0.0, -0.3, 0.0]))
    assert not _both_ways(recorded(position))


@pytest.mark.parametrize(("x", "named"), [(-1e3, False), (0.0, True)])
def test_an_effect_at_an_end_of_its_range_has_no_name(x: float, named: bool) -> None:
    """A lag slower than the recordings are long passes nothing on: the sensor is dead, or something else is wrong."""
    size = EffectParameter("corner_frequency", 1000.0, least=1e-3)
    lag = Candidate("sensor_lag", "tacho", "tacho", "found_lag", lambda sizes: [], (size,))
    fit = SimpleNamespace(problem=SimpleNamespace(free=tuple(lag.free({"corner_frequency": 300.0}))), x=(x,))
    left = SimpleNamespace(noise=np.ones(1), count=np.ones(1))
    chosen: Any = SimpleNamespace(effects=(lag,), fit=fit, hold_out=1.0, together=1.0, strain=0.0, own=0, left=left)
    chosen.at_an_end = ScoredModel.at_an_end.fget(chosen)  # type: ignore[attr-defined]
    assert chosen.at_an_end == ([] if named else ["corner_frequency of sensor_lag at tacho"])
    study: Any = SimpleNamespace(refit=REFIT, chosen=chosen, tried=10)
    said = finding_sentence(lag, "named" if named else "unknown", 0.9, study, ())
    assert ("corner_frequency of sensor_lag at tacho at an end of its range" in said) != named


@pytest.mark.parametrize("tried", ["nothing", "joint_flexibility", "elsewhere", "rival"])
@pytest.mark.parametrize("bounded", [True, False])
def test_a_richer_law_whose_own_size_nothing_bounds_has_no_name_unless_the_simpler_one_was_tried(
    tried: str, bounded: bool
) -> None:
    """A gap of nothing is a joint that gives: where that may not be told, it is not told as backlash.

    A joint that is told as a rival may be anywhere, as on the other side of a gear.
    """
    sizes = tuple(EffectParameter(name, 1.0) for name in ("half_gap", "stiffness"))
    backlash = Candidate("backlash", "a -> b", "a -> b", "found_backlash", lambda sizes: [], sizes)
    place = "a -> b" if tried == "joint_flexibility" else "c -> d"
    spring = Candidate("joint_flexibility", place, "x", "y", lambda sizes: [])
    tries: Any = [SimpleNamespace(effects=(c,)) for c in ([backlash] if tried == "nothing" else [backlash, spring])]
    gap = (1e-3, 2e-3) if bounded else (-math.inf, math.inf)
    rows = [
        Interval("found_backlash.half_gap", 1.5e-3, *gap, "rad", 1e-3),
        Interval("found_backlash.stiffness", 9.0, 8.0, 10.0, "N.m/rad", 9.0),
        Interval("load.inertia", 1.0, -math.inf, math.inf, "kg.m2", 1.0),
    ]
    scenario = SimpleNamespace(system=SimpleNamespace(blocks={}))
    study: Any = SimpleNamespace(scenario=scenario, trials=tries, refit=REFIT)
    found = untold_sizes(study, backlash, rows, tries[1:] if tried == "rival" else [])
    assert found == ([] if bounded or tried in ("joint_flexibility", "rival") else ["half_gap"])
    if found:
        left = SimpleNamespace(noise=np.ones(1), count=np.ones(1))
        study.chosen, study.tried = (
            SimpleNamespace(hold_out=1.0, together=1.0, strain=0.0, own=0, at_an_end=[], left=left),
            10,
        )
        said = finding_sentence(backlash, "unknown", 0.9, study, (), found)
        assert "but whatever its half_gap: a simpler law that was not tried may do as well" in said


@pytest.mark.parametrize("linear", [True, False])
def test_a_richer_law_in_the_place_of_the_users_spring_has_the_simpler_one_there(linear: bool) -> None:
    """A coupling that hardens a little: the user's own, which is linear, was fitted, and left more."""
    hard = Candidate(
        "hardening_spring", "coupling", "coupling", "coupling", lambda s: [], (EffectParameter("cubic_stiffness", 1.0),)
    )
    rows = [Interval("coupling.cubic_stiffness", 2.7e3, -math.inf, math.inf, "N.m/rad3", 1e3)]
    own = SpringDamper(stiffness="40 N.m/rad") if linear else Inertia(inertia="1 kg.m2")
    scenario = SimpleNamespace(system=SimpleNamespace(blocks={"coupling": own}))
    study: Any = SimpleNamespace(scenario=scenario, trials=[SimpleNamespace(effects=(hard,))])
    assert untold_sizes(study, hard, rows, []) == ([] if linear else ["cubic_stiffness"])


@pytest.mark.parametrize(("after", "share"), [(2.0, "100%"), (52.0, "50%")])
def test_no_finding_explains_more_than_there_is(after: float, share: str) -> None:
    """Where luck leaves four times the noise on average, a run may leave less."""
    left = SimpleNamespace(noise=np.array([4.0]), count=np.array([100.0]))
    chosen = SimpleNamespace(hold_out=after, together=after, left=left)
    study: Any = SimpleNamespace(refit=SimpleNamespace(hold_out=100.0, together=100.0), chosen=chosen)
    lag: Any = SimpleNamespace(effect="lag", place="motor.voltage", option="")
    assert f"({share} of what was unexplained)" in finding_sentence(lag, "named", 1.0, study, [])


@pytest.mark.parametrize(
    ("status", "said"),
    [
        ("wrong_parameter", "Parameter arm lies outside its tolerance: with it freed, the others stay closer to"),
        (
            "named",
            "with it, parameters stay closer to their values, and the held-out error is 0.871 times the noise floor "
            "(0.853 without).",
        ),
    ],
)
def test_no_error_is_said_to_fall_that_rises(status: str, said: str) -> None:
    """A payload that is three times as heavy bends the other masses, which follow the recordings as well."""
    left = SimpleNamespace(noise=np.ones(1) / 2, count=np.array([100.0]))
    chosen = SimpleNamespace(hold_out=0.871, together=0.871, left=left)
    study: Any = SimpleNamespace(refit=SimpleNamespace(hold_out=0.853, together=0.853), chosen=chosen)
    effect: Any = SimpleNamespace(effect="payload", place="arm", option="")
    assert said in finding_sentence(effect, status, 1.0, study, [])


@pytest.mark.parametrize(
    ("together", "further"), [(17.0, "; fitted to all recordings, it leaves 17 times."), (9e2, ".")]
)
def test_what_held_out_recordings_tell_of_a_size_is_said(together: float, further: str) -> None:
    """A limit that the fitted ones hardly reach follows the others closely, once they are fitted too."""
    left = SimpleNamespace(noise=np.ones(1), count=np.array([100.0]))
    chosen = SimpleNamespace(hold_out=1.2e3, together=together, left=left)
    study: Any = SimpleNamespace(refit=SimpleNamespace(hold_out=8e3, together=9e3), chosen=chosen)
    limit: Any = SimpleNamespace(effect="saturation", place="motor.voltage", option="")
    said = finding_sentence(limit, "named", 1.0, study, [])
    assert said.endswith("falls from 8e+03 to 1.2e+03 times the noise floor (85% of what was unexplained)" + further)


def test_what_may_only_imitate_something_is_said_to() -> None:
    """A bias beside a vibration that nobody lists explains four fifths, and leaves 20 times the noise."""
    noise, count = np.ones(1), np.array([100.0])
    there = np.array([2e3])
    left = Leftover(there, count, noise, ((0, 0),), there[None, :], count[None, :])
    bias = Candidate("sensor_bias", "rotor.shaft.angle", "rotor", "found_bias", lambda sizes: [])
    chosen: Any = SimpleNamespace(
        effects=(bias,), hold_out=20.0, together=20.0, left=left, unseen=left, room=1.0, at_an_end=[]
    )
    study: Any = SimpleNamespace(
        refit=SimpleNamespace(hold_out=96.0, together=96.0, left=NOISE, strain=10.0, bent=False),
        chosen=chosen,
        tried=10,
    )
    said = finding_sentence(bias, "unknown", 0.8, study, ())
    assert said == (
        "Something is missing near rotor.shaft.angle; the best effect, sensor bias, explains 80% of it, and may only "
        "imitate it: the held-out error falls from 96 to 20 times the noise floor."
    )


@pytest.mark.parametrize(("after", "status"), [(20.0, "unknown"), (5.0, "named"), (1.5, "named")])
def test_what_may_only_imitate_something_has_no_name(
    monkeypatch: pytest.MonkeyPatch, after: float, status: str
) -> None:
    """A bias leaves 20 of 96 times the noise; of what leaves 5 nine tenths are explained."""
    noise, count = np.ones(1), np.array([100.0])
    there = after * count
    left = Leftover(there, count, noise, ((0, 0),), there[None, :], count[None, :])
    bias = Candidate("sensor_bias", "rotor.shaft.angle", "rotor", "found_bias", lambda sizes: [])
    chosen: Any = SimpleNamespace(
        effects=(bias,), keys=frozenset({bias.key}), hold_out=after, together=after, left=left, unseen=left
    )
    chosen.fit, chosen.room, chosen.strain, chosen.own, chosen.at_an_end = None, 1.0, 0.0, 1, []
    refit: Any = SimpleNamespace(
        effects=(), keys=frozenset(), hold_out=96.0, together=96.0, left=NOISE, strain=10.0, bent=False
    )
    study: Any = SimpleNamespace(chosen=chosen, refit=refit, trials=[chosen], odds={chosen.keys: 1.0}, tried=10)
    study.ended_early, study.notes = False, ()
    monkeypatch.setattr(verdicts, "with_covariance", lambda fit, excess: SimpleNamespace(intervals=list))
    monkeypatch.setattr(verdicts, "_remarks", lambda study: [])
    monkeypatch.setattr(verdicts, "warnings_of", lambda study: ())
    monkeypatch.setattr(verdicts, "untold_sizes", lambda *_: [])
    monkeypatch.setattr(verdicts, "place_of", lambda effect, study: ())
    monkeypatch.setattr(verdicts, "recover", lambda study: None)
    monkeypatch.setattr(verdicts, "_finding", lambda study, k, status, *rest: {"status": status})
    assert verdicts.judge(study).verdict == status


def test_a_rival_that_has_a_law_beside_the_richer_one_does_not_stand_for_the_simpler_law(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whether backlash is no more than a joint is answered by a joint in its place, not by one more joint elsewhere."""
    backlash = Candidate("backlash", "a -> b", "a -> b", "found_backlash", lambda sizes: [])
    joint = Candidate("joint_flexibility", "c -> d", "c -> d", "found_joint", lambda sizes: [])
    rows = [((backlash,), 0.5), ((backlash, joint), 0.3), ((joint,), 0.2)]
    trials: list[Any] = [SimpleNamespace(effects=e, keys=frozenset(c.key for c in e), left=NOISE) for e, _ in rows]
    for trial in trials:
        trial.fit, trial.hold_out, trial.at_an_end = SimpleNamespace(problem=SimpleNamespace(model=None)), 1.0, []
    study: Any = SimpleNamespace(chosen=trials[0], refit=SimpleNamespace(effects=(), keys=frozenset()), trials=trials)
    study.odds = {trial.keys: share for trial, (_, share) in zip(trials, rows, strict=True)}
    study.refit.fit, study.tried, study.ended_early, study.notes = trials[0].fit, 10, False, ()
    asked: list[Any] = []

    def untold(study: Any, effect: Any, intervals: Any, rivals: Any) -> list[str]:
        asked.append(rivals)
        return []

    monkeypatch.setattr(verdicts, "with_covariance", lambda fit, excess: SimpleNamespace(intervals=list))
    monkeypatch.setattr(verdicts, "_remarks", lambda study: [])
    monkeypatch.setattr(verdicts, "warnings_of", lambda study: ())
    monkeypatch.setattr(verdicts, "explained", lambda refit, model: 1.0)
    monkeypatch.setattr(verdicts, "may_imitate", lambda refit, model: False)
    monkeypatch.setattr(verdicts, "strained", lambda model, tried: False)
    monkeypatch.setattr(verdicts, "untold_sizes", untold)
    monkeypatch.setattr(verdicts, "propose", lambda models, model: None)
    monkeypatch.setattr(verdicts, "place_of", lambda effect, study: ())
    monkeypatch.setattr(verdicts, "recover", lambda study: None)
    monkeypatch.setattr(verdicts, "_finding", lambda study, k, status, *rest: {"status": status})
    verdicts.judge(study)
    assert asked == [[trials[2]]]
