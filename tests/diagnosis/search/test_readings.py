"""How a file is read where that is open, against a slide whose motion is known in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.api import diagnose, gather
from diagnosis.api import fit as fit_to
from diagnosis.effects.catalogue import EFFECTS
from diagnosis.effects.effect import Candidate
from diagnosis.problems import problem
from diagnosis.recordings.time_axis import even_instants
from diagnosis.recordings.types import Recorded, Recording
from diagnosis.search import readings
from diagnosis.search.first_effects import FirstEffects
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.placing import Placing
from diagnosis.search.readings import as_they_were_taken, likelier
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.search import study
from diagnosis.search.study import Study
from scenarios.amend import with_readings
from scenarios.load import load

MASS, FRICTION, INTERVAL, NOISE = 0.2, 0.5, 2e-3, 1e-6

SCENARIO = """\
schema: 1
name: slide
blocks:
  drive: {type: Force}
  table: {type: Mass, mass: 0.21 kg}
  guide: {type: TranslationalBearingFriction, viscous_friction: 0.48 N.s/m}
connect:
  - [drive.flange, table.flange, guide.slide]
simulate: {stop: 1 s, step: 2 ms}
recordings:
  swing:
    file: swing.csv
    time: {column: t, unit: s}
    drive: {drive.force: {column: u, unit: N}}
    measurements:
      table.flange.position: {column: x, unit: m, noise: 1e-6}
"""

Array = NDArray[np.float64]


def driven(instants: Array, force: Array) -> Array:
    """Position of m v' = u - c v at the instants between which u is held; the exact solution from step to step."""
    x, v, out = 0.0, 0.0, [0.0]
    for wait, u in zip(np.diff(instants), force[:-1], strict=True):
        end, decay = u / FRICTION, math.exp(-FRICTION / MASS * wait)
        x += end * wait + (v - end) * (1 - decay) * MASS / FRICTION
        v = end + (v - end) * decay
        out.append(x)
    return np.array(out)


def written(folder: Path, time: Array, force: Array, position: Array) -> Path:
    """The scenario, beside its recording."""
    rows = np.column_stack([time, force, position])
    np.savetxt(folder / "swing.csv", rows, delimiter=",", header="t,u,x", comments="", fmt="%.9f")
    path = folder / "slide.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


def logged(folder: Path, *, evenly: bool) -> Path:
    """A recording whose stamps stray by 20 % of an interval; the samples were taken evenly, or at the stamps."""
    rng = np.random.default_rng(4)
    even = INTERVAL * np.arange(3000)
    stamps = even + np.concatenate([[0.0], 0.2 * INTERVAL * rng.uniform(-1, 1, 2999)])
    force = np.repeat(rng.choice([-1.0, 1.0], 300), 10)
    x = driven(np.asarray(even if evenly else stamps), force) + NOISE * rng.standard_normal(3000)
    return written(folder, stamps, force, x)


@pytest.mark.parametrize("evenly", [True, False])
def test_the_model_tells_when_samples_were_taken(tmp_path: Path, evenly: bool) -> None:
    scenario = load(logged(tmp_path, evenly=evenly))
    (found,) = as_they_were_taken(scenario, gather(scenario, (), ()), 1)
    assert isinstance(found, Recording)
    assert found.assumed == ({("recordings", "swing", "time", "clock"): "even"} if evenly else {})
    if evenly:
        np.testing.assert_allclose(found.time, INTERVAL * np.arange(3000), rtol=1e-9)


def test_a_fit_follows_the_even_clock_and_writes_it_down(tmp_path: Path) -> None:
    path = logged(tmp_path, evenly=True)
    made, scores = fit_to(path, workers=1)
    values = made.parameters()
    assert scores["fitted"] == pytest.approx(1.0, abs=0.1)
    assert values["table.mass"] == pytest.approx(MASS, rel=2e-3)
    assert values["guide.viscous_friction"] == pytest.approx(FRICTION, rel=2e-3)
    text = with_readings(path.read_text(encoding="utf-8"), made.problem.assumed)
    assert "clock: even" in text
    path.write_text(text, encoding="utf-8")
    scenario = load(path)
    (again,) = gather(scenario, (), ())
    assert isinstance(again, Recording)
    np.testing.assert_array_equal(again.time, INTERVAL * np.arange(3000))


def straight(folder: Path, *, held: bool) -> Path:
    """A slide under 0.1 sin(40 t), 25 samples to a period, that was held between them, or not."""
    t = np.asarray(3 * INTERVAL * np.arange(3000))
    force = 0.1 * np.sin(40 * t)
    if held:
        x = driven(t, force)
    else:  # m x'' + c x' = F sin(w t) from rest, by undetermined coefficients
        w, m, c, size = 40.0, MASS, FRICTION, 0.1
        a, b = -size * m / (m**2 * w**2 + c**2), -size * c / (w * (m**2 * w**2 + c**2))
        x = a * np.sin(w * t) + b * (np.cos(w * t) - 1) - a * w * m / c * (1 - np.exp(-c / m * t))
    x = x + NOISE * np.random.default_rng(2).standard_normal(len(t))
    return written(folder, t, force, x)


@pytest.mark.parametrize("held", [True, False])
def test_the_model_tells_whether_an_input_was_held(tmp_path: Path, held: bool) -> None:
    path = straight(tmp_path, held=held)
    scenario = load(path)
    (found,) = as_they_were_taken(scenario, gather(scenario, (), ()), 1)
    assert isinstance(found, Recording)
    assert found.assumed == ({} if held else {("recordings", "swing", "drive", "drive.force", "hold"): "linear"})
    said = path.read_text(encoding="utf-8").replace("{column: u, unit: N}", "{column: u, unit: N, hold: zero_order}")
    path.write_text(said, encoding="utf-8")
    given = gather(load(path), (), ())
    assert as_they_were_taken(load(path), given, 1)[0] is given[0]


def jerked(
    folder: Path,
    *,
    first: bool,
    steps: bool = True,
    odd: float = 0.0,
    late: float = 0.0,
    jitter: float = 0.0,
    stray: bool = False,
) -> Path:
    """m a = u - c v under held steps: the acceleration of a row is that of the step before, or of its own.

    Without steps the force is constant. The acceleration of the first row is ``odd`` by so much. The force acts
    ``late`` by a share of an interval. Samples ``jitter`` by a share of it at most; or their stamps ``stray`` alone.
    """
    even = np.asarray(INTERVAL * np.arange(2000))
    moved = np.round(even + jitter * INTERVAL * np.random.default_rng(6).uniform(0, 1, len(even)) * (even > 0), 9)
    t, stamps = (even, moved) if stray else (moved, moved)
    force = np.repeat(np.random.default_rng(4).choice([-1.0, 1.0], 200), 10) if steps else np.ones(len(t))
    before = np.concatenate([[0.0], force[:-1]])
    instants = np.column_stack([t, t + late * INTERVAL]).ravel()
    x = driven(instants, np.column_stack([before, force]).ravel())[::2]
    v = np.zeros(len(t))
    for k in range(1, len(t)):
        v[k] = v[k - 1]
        for u, lasting in ((before[k - 1], late * INTERVAL), (force[k - 1], t[k] - t[k - 1] - late * INTERVAL)):
            v[k] = u / FRICTION + (v[k] - u / FRICTION) * math.exp(-FRICTION / MASS * lasting)
    acting = before if first or late else force
    rng = np.random.default_rng(8)
    a = (acting - FRICTION * v) / MASS + 1e-3 * rng.standard_normal(len(t))
    a[0] += odd
    rows = np.column_stack([stamps, force, x + NOISE * rng.standard_normal(len(t)), a])
    np.savetxt(folder / "swing.csv", rows, delimiter=",", header="t,u,x,a", comments="", fmt="%.9f")
    measured = "      table.flange.position: {column: x, unit: m, noise: 1e-6}\n"
    path = folder / "slide.yaml"
    path.write_text(
        SCENARIO.replace("unit: N}", "unit: N, hold: zero_order}").replace(
            measured, measured + "      table.flange.acceleration: {column: a, unit: m/s2, noise: 1e-3}\n"
        ),
        encoding="utf-8",
    )
    return path


def each_reading(recording: Recording) -> list[Recording]:
    """A recording read in each way: open, before its input acts, after it."""
    return [replace(recording, sampled=said) for said in ("either", "before_input", "after_input")]


@pytest.mark.parametrize("first", [True, False])
def test_the_model_tells_whether_a_row_was_read_before_its_input_acted(tmp_path: Path, first: bool) -> None:
    path = jerked(tmp_path, first=first)
    made, scores = fit_to(path, workers=1)
    assert made.problem.assumed == ({("recordings", "swing", "sampled"): "before_input"} if first else {})
    assert scores["fitted"] == pytest.approx(1.0, abs=0.1)
    assert made.parameters()["table.mass"] == pytest.approx(MASS, rel=2e-3)
    if first:
        text = with_readings(path.read_text(encoding="utf-8"), made.problem.assumed)
        (again,) = gather(load(path, text=text), (), ())
        assert isinstance(again, Recording)
        assert again.sampled == "before_input"


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("stray", [True, False])
def test_the_model_tells_whether_a_row_was_read_first_where_stamps_are_uneven_too(
    tmp_path: Path, first: bool, stray: bool
) -> None:
    """Stamps may stray about an even clock, or be the instants at which samples were taken."""
    path = jerked(tmp_path, first=first, jitter=0.2, stray=stray)
    made, scores = fit_to(path, workers=1)
    told = {("recordings", "swing", "sampled"): "before_input"} if first else {}
    clock = {("recordings", "swing", "time", "clock"): "even"} if stray else {}
    assert made.problem.assumed == told | clock
    assert scores["fitted"] == pytest.approx(1.0, abs=0.1)
    assert made.parameters()["table.mass"] == pytest.approx(MASS, rel=2e-3)


def test_an_odd_first_sample_does_not_tell_it(tmp_path: Path) -> None:
    """It is left out unless rows are known to be read after their input acts: what acted before is not known."""
    scenario = load(jerked(tmp_path, first=False, steps=False, odd=0.05))
    (found,) = as_they_were_taken(scenario, gather(scenario, (), ()), 1)
    assert isinstance(found, Recording)
    assert found.assumed == {}
    counted = [posed.experiments[0].count for posed in (problem(scenario, [r]) for r in each_reading(found))]
    assert counted == [3999, 3999, 4000]


def test_what_was_found_is_fitted_again_where_a_reading_turns_out_to_be_another_at_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It explains all there too: nothing is sought again."""
    path = jerked(tmp_path, first=False)
    path.write_text(path.read_text(encoding="utf-8").replace("0.48 N.s/m", "1 mN.s/m"), encoding="utf-8")
    begun: list[int] = []
    seek = FirstEffects._seek

    def counted(first: FirstEffects) -> None:
        begun.append(len(first.known.models))
        seek(first)

    monkeypatch.setattr(FirstEffects, "_seek", counted)
    monkeypatch.setattr("diagnosis.api.taken_otherwise", lambda fitter, model: list(fitter.recordings))
    found = diagnose(path, workers=1, without=sorted(set(EFFECTS) - {"viscous_friction", "coulomb_friction"}))
    assert found.study.chosen.effects
    assert begun == [1]


def test_a_search_that_had_no_time_takes_no_place_of_what_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The time was over before anything was fitted in the other reading: the friction that was found was lost."""
    path = jerked(tmp_path, first=False)
    path.write_text(path.read_text(encoding="utf-8").replace("0.48 N.s/m", "1 mN.s/m"), encoding="utf-8")
    studies: list[Study] = []

    def studied(fitter: CandidateFitter, **given: Any) -> Study:
        if not studies:
            studies.append(study(fitter, **given))
        else:
            studies.append(replace(studies[0], chosen=studies[0].refit, trials=(), ended_early=True))
        return studies[-1]

    monkeypatch.setattr("diagnosis.api.study", studied)
    monkeypatch.setattr("diagnosis.api.taken_otherwise", lambda fitter, model: list(fitter.recordings))
    found = diagnose(path, workers=1, without=sorted(set(EFFECTS) - {"viscous_friction", "coulomb_friction"}))
    assert len(studies) == 2
    assert found.study.chosen.effects


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> list[Sequence[Recorded]]:
    """The recordings of each search of a diagnosis."""
    rows: list[Sequence[Recorded]] = []

    def studied(fitter: CandidateFitter, **given: Any) -> Study:
        rows.append(fitter.recordings)
        return study(fitter, **given)

    monkeypatch.setattr("diagnosis.api.study", studied)
    return rows


@pytest.mark.parametrize("late", [0.8, 0.1])
def test_a_force_that_comes_late_is_no_row_that_was_read_first(
    tmp_path: Path, searched: list[Sequence[Recorded]], late: float
) -> None:
    """By a share of an interval: the acceleration of a row is that of the step before, and the position tells the rest.

    A lag does beside rows that were read first, whether the delay comes near beside it or only in its place.
    """
    path = jerked(tmp_path, first=False, late=late)
    scenario = load(path)
    (taken,) = as_they_were_taken(scenario, gather(scenario, (), ()), 1)
    assert isinstance(taken, Recording)
    assert taken.sampled == "before_input", "without a delay it looks like that"
    tried = {"delay", "lag", "sensor_lag", "coulomb_friction"}
    found = diagnose(path, workers=1, without=sorted(set(EFFECTS) - tried))
    (finding,) = found.findings
    assert (found.verdict, finding["effect"], len(searched)) == ("named", "delay", 2)
    assert finding["parameters"]["delay"]["value"] == pytest.approx(late * INTERVAL, rel=0.02)
    assert found.study.chosen.fit.problem.assumed == {}
    assert found.study.chosen.fit.parameters()["table.mass"] == pytest.approx(MASS, rel=5e-3)


def test_a_search_of_recordings_as_described_begins_with_what_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two lags were, which do not explain all there; the delay is found beside them.

    What effects promise beside the user's model is not looked at again: the readings are less than a sample apart.
    """
    path = jerked(tmp_path, first=False, late=0.8)
    begun: list[list[str]] = []
    looked: list[FirstEffects] = []
    known, seek = Placing.fit_known, FirstEffects._seek

    def fit_known(placing: Placing, models: Sequence[ScoredModel]) -> None:
        known(placing, models)
        begun.append(sorted({c.effect for m in placing.known.models for c in m.effects}))

    def counted(first: FirstEffects) -> None:
        looked.append(first)
        seek(first)

    monkeypatch.setattr(Placing, "fit_known", fit_known)
    monkeypatch.setattr(FirstEffects, "_seek", counted)
    tried = {"delay", "lag", "sensor_lag", "coulomb_friction"}
    found = diagnose(path, workers=1, without=sorted(set(EFFECTS) - tried))
    assert [c.effect for c in found.study.chosen.effects] == ["delay"]
    assert begun[0] == []
    assert {"lag", "sensor_lag"} <= set(begun[1])
    assert len(looked) == 1


def test_a_row_that_was_read_first_stays_so_beside_an_effect(
    tmp_path: Path, searched: list[Sequence[Recorded]]
) -> None:
    """Friction that the model lacks does not make another time of the input, and is not sought with one again."""
    path = jerked(tmp_path, first=True)
    path.write_text(path.read_text(encoding="utf-8").replace("0.48 N.s/m", "1 mN.s/m"), encoding="utf-8")
    found = diagnose(path, workers=1, without=sorted(set(EFFECTS) - {"viscous_friction", "coulomb_friction", "delay"}))
    assert found.verdict in {"named", "wrong_parameter", "tie"}
    assert len(searched) == 1
    assert found.study.chosen.fit.problem.assumed == {("recordings", "swing", "sampled"): "before_input"}


TWO = """\
schema: 1
name: sledge
blocks:
  drive: {type: Force}
  carriage: {type: Mass, mass: 0.3 kg}
  spring: {type: TranslationalSpringDamper, stiffness: 40 N/m, damping: 0.2 N.s/m}
  table: {type: Mass, mass: 0.2 kg}
connect:
  - [drive.flange, carriage.flange, spring.a]
  - [spring.b, table.flange]
simulate: {stop: 1 s, step: 2 ms}
recordings:
  release:
    file: release.csv
    time: {column: t, unit: s}
    drive: {drive.force: {column: u, unit: N, hold: zero_order}}
    measurements:
      table.flange.position: {column: x, unit: m, noise: 1e-6}
    initial: {state: at_rest, free: [table.flange.position]}
    role: ROLE
"""


@pytest.mark.parametrize(("twist", "role"), [(0.01, "train"), (0.01, "hold_out"), (0.0, "train")])
def test_the_model_tells_whether_a_spring_was_let_go_of_stretched(tmp_path: Path, twist: float, role: str) -> None:
    """Two masses on a spring, let go of: their centre stays, and their distance rings with the reduced mass."""
    first, second, k, c = 0.3, 0.2, 40.0, 0.2
    t = np.asarray(INTERVAL * np.arange(1500))
    mass, decay = first * second / (first + second), c / 2 * (1 / first + 1 / second)
    rate = math.sqrt(k / mass - decay**2)
    distance = twist * np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))
    centre = twist * second / (first + second)  # the carriage begins at zero, the table at the twist
    x = centre + distance * first / (first + second) + NOISE * np.random.default_rng(3).standard_normal(len(t))
    rows = np.column_stack([t, 0 * t, x])
    np.savetxt(tmp_path / "release.csv", rows, delimiter=",", header="t,u,x", comments="", fmt="%.9f")
    path = tmp_path / "sledge.yaml"
    path.write_text(TWO.replace("ROLE", role), encoding="utf-8")
    if role == "hold_out":  # one that is fitted and rests
        np.savetxt(
            tmp_path / "rest.csv",
            np.column_stack([t, 0 * t, NOISE * np.random.default_rng(5).standard_normal(len(t))]),
            delimiter=",",
            header="t,u,x",
            comments="",
            fmt="%.9f",
        )
        resting = TWO[TWO.index("  release:") : TWO.index("    initial:")].replace("release", "rest")
        path.write_text(path.read_text(encoding="utf-8") + resting, encoding="utf-8")
    scenario = load(path)
    found = as_they_were_taken(scenario, gather(scenario, (), ()), 1)[0]
    assert isinstance(found, Recording)
    place, names = ("recordings", "release", "initial", "free"), ("table.flange.position", "drive.flange.position")
    assert found.assumed == ({place: names} if twist else {})
    if twist:
        text = with_readings(path.read_text(encoding="utf-8"), found.assumed)
        again = next(r for r in gather(load(path, text=text), (), ()) if r.name == "release")
        assert isinstance(again, Recording)
        assert again.free == names


def test_parts_of_a_split_recording_write_down_what_holds_for_the_whole(tmp_path: Path) -> None:
    path = logged(tmp_path, evenly=True)
    scenario = load(path)
    (found,) = as_they_were_taken(scenario, gather(scenario, (), ()), 1)
    parts = found.split(0.5)
    assert parts is not None
    text = with_readings(path.read_text(encoding="utf-8"), problem(scenario, parts).assumed)
    assert text.count("clock: even") == 1


def test_what_the_user_says_of_the_clock_is_not_tried(tmp_path: Path) -> None:
    path = logged(tmp_path, evenly=True)
    said = path.read_text(encoding="utf-8").replace("unit: s}", "unit: s, clock: as_logged}")
    path.write_text(said, encoding="utf-8")
    scenario = load(path)
    given = gather(scenario, (), ())
    (found,) = as_they_were_taken(scenario, given, 1)
    assert isinstance(found, Recording)
    assert "even" not in found.assumed.values()


def test_stamps_without_a_clock_stay_as_they_are() -> None:
    rng = np.random.default_rng(1)
    assert even_instants(np.cumsum(rng.uniform(0.5, 1.5, 200))) is None  # a walk, which no clock follows
    gap = np.delete(np.arange(50.0), [20, 21]) + 0.1 * rng.uniform(-1, 1, 48)
    found = even_instants(gap - gap[0])
    assert found is not None
    np.testing.assert_allclose(np.diff(found)[[18, 19, 20]], [1, 3, 1], rtol=0.02)


@pytest.mark.parametrize(
    ("evidence", "luck", "effects", "expected"),
    [
        (100.0, 0.0, 2, True),  # better by what is evidence
        (100.0, 200.0, 2, False),  # by luck, with an effect more
        (-100.0, 0.0, 1, False),
        (-100.0, 200.0, 1, True),
        (-100.0, 200.0, 2, False),
    ],
)
def test_of_two_readings_that_luck_parts_the_one_with_fewer_effects_counts(
    evidence: float, luck: float, effects: int, expected: bool
) -> None:
    """As described, and as taken with one effect and an evidence of nothing; prices of effects are small beside."""

    def found(log_evidence: float, count: int) -> Any:
        there = tuple(Candidate(f"law{k}", "shaft", "shaft", f"found_{k}", lambda sizes: [], ()) for k in range(count))
        left = SimpleNamespace(luck=luck if count == effects else 0.0)
        model = SimpleNamespace(effects=there, log_evidence=log_evidence, own=3, left=left)
        refit = SimpleNamespace(effects=(), log_evidence=-1e5, own=3, left=SimpleNamespace(luck=0.0))
        return SimpleNamespace(refit=refit, trials=(model,), chosen=model, tried=20)

    assert likelier(found(evidence, effects), found(0.0, 1)) is expected


@pytest.mark.parametrize("without", [(), ("delay",)])
def test_beside_another_reading_no_delay_is_tried_that_is_not_to_be_tried(
    monkeypatch: pytest.MonkeyPatch, without: tuple[str, ...]
) -> None:
    delay, friction = (Candidate(e, "u", "u", f"found_{e}", lambda sizes: []) for e in ("delay", "coulomb_friction"))
    fitted: list[tuple[Candidate, ...]] = []

    class Known:
        price = 5.0

        def __init__(self, *_: object) -> None:
            pass

        def fit(self, wanted: Any, finish: int, **_: object) -> list[Any]:
            fitted.extend(effects for effects, _ in wanted)
            return []

    monkeypatch.setattr(readings, "TriedModels", Known)
    monkeypatch.setattr(readings, "candidates", lambda scales, left=(): [c for c in [delay] if c.effect not in left])
    chosen = SimpleNamespace(
        effects=(friction,),
        sizes=({},),
        fit=SimpleNamespace(parameters=dict, problem=SimpleNamespace(free=()), x=()),
    )
    taken: Any = SimpleNamespace(chosen=chosen, scales=None, tried=9)
    described: Any = SimpleNamespace(refit=None)
    assert readings.near_as_described(described, taken, without) == []
    names = [{c.effect for c in effects} for effects in fitted]
    late = [{"coulomb_friction", "delay"}, {"delay"}]
    assert names == [{"coulomb_friction"}, *(late if not without else [])]
