"""The moves of the search, in a made-up world: what each set of effects leaves over is written down, not simulated."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.effects.effect import Candidate, EffectParameter, Wave
from diagnosis.effects.scales import OperatingScales
from diagnosis.estimation.leftover import Leftover
from diagnosis.estimation.parameters import FreeParameter
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.search import search as searching
from diagnosis.search import tried_models
from diagnosis.search.allowance import OutOfTime
from diagnosis.search.board import Board
from diagnosis.search.growing import Growing
from diagnosis.search.laws import Laws, _grown_from
from diagnosis.search.partial_fit import PartialFit, StartingPoint
from diagnosis.search.patience import Patience
from diagnosis.search.placing import Placing
from diagnosis.search.posterior import energy, probabilities, told_as
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import Looked
from diagnosis.search.varying import Varying
from diagnosis.thresholds import EVIDENCE, SEARCH
from engine.errors import FlexarmError
from engine.system import Connection
from engine.work import Work
from scenarios.amend import Between

COUNT = 1000.0
"""Recorded values, all in one band, the noise as stated."""

Excess = Callable[[frozenset[str]], float]
"""What a set of effects, by key and option, leaves beyond the noise."""


def effect(name: str, place: str = "shaft", *, option: str = "", sizes: int = 1) -> Candidate:
    rows = tuple(EffectParameter(f"p{k}", k + 1.0) for k in range(sizes))  # of a kind each
    start = {row.name: 0.1 for row in rows}
    return Candidate(name, place, place, f"found_{name}", lambda sizes: [], rows, (start,), option=option)


class World:
    """Stands in for a fitter: it knows what each model leaves over, and keeps which were fitted.

    Args:
        excess: see `Excess`.
        promise: by how much an effect, by key and option, promises to raise the likelihood; 50 where it is not said.
        shapes: what an effect, by key, changes of the recordings; nothing where it is not said.
        fit: work that the fit of one effect takes.
        dearer: how many times as much each further effect takes.
        allowed: work that is allowed for all.
    """

    workers, tables = 1, False
    scenario = SimpleNamespace(system=SimpleNamespace(connections=[Connection(("gear.out", "load.shaft", "belt.a"))]))

    def __init__(
        self,
        excess: Excess,
        promise: Mapping[str, float] | None = None,
        shapes: Mapping[str, Sequence[float]] | None = None,
        fit: int = 0,
        allowed: float = math.inf,
        dearer: int = 10,
    ) -> None:
        self.work, self.fit, self.allowed, self.dearer = Work(), fit, allowed, dearer
        self.spent = SimpleNamespace(work=Work(), is_over=self.is_over)
        self.excess = self.excess_at_end = excess
        self.promise, self.shapes = promise or {}, shapes or {}
        self.fitted: list[frozenset[str]] = []
        self.options: set[str] = set()
        """In which ways effects were put in."""
        self.retries: list[frozenset[str]] = []
        self.retry_reaches: list[float] = []
        """What each second try of a fit was to reach."""
        self.settlings: list[frozenset[str]] = []
        self.bad: set[frozenset[str]] = set()
        """Models of which no fit converges before it is tried again."""
        self.reaches: list[tuple[frozenset[str], float]] = []
        """What each fit to the end was to reach."""
        self.begun: list[tuple[frozenset[str], frozenset[str]]] = []
        """Models that were begun from the parameters of another one, and that."""
        self.closer: dict[frozenset[str], Excess] = {}
        """What models leave once they are."""
        self.refit = self.made(())

    def made(self, effects: tuple[Candidate, ...], *, after: Excess | None = None) -> Any:
        names = frozenset(f"{c.key}{c.option and ' ' + c.option}" for c in effects)
        left = self.left((after or self.excess)(names))
        fit = SimpleNamespace(
            converged=True,
            cost=float(left.energy[0]),
            parameters=lambda: {f"{c.name}.p{k}": 0.2 for c in effects for k in range(len(c.parameters))},
            problem=SimpleNamespace(free=(), held_out=()),
            x=(),
        )
        return SimpleNamespace(
            effects=effects,
            keys=frozenset(c.key for c in effects),
            size=sum(len(c.parameters) for c in effects),
            sizes=tuple(c.starts[0] for c in effects),
            left=left,
            unseen=left,
            hold_out=float(left.energy[0]) / COUNT,
            together=float(left.energy[0]) / COUNT,
            given=math.inf,
            log_evidence=left.log_likelihood,
            foretold=left.log_likelihood,
            cost=float(left.energy[0]),
            strain=0.0,
            room=left.unexplained,
            bent=False,
            far_off=[],
            bent_blocks=set(),
            own=0,
            owed=0.0,
            fit=fit,
        )

    def left(self, excess: float) -> Leftover:
        there, count = np.array([COUNT + excess]), np.array([COUNT])
        # Of two recordings one shows it all: it varies, as physics does.
        energies, counts = np.array([[COUNT / 2], [COUNT / 2 + excess]]), np.array([[COUNT / 2], [COUNT / 2]])
        return Leftover(there, count, np.ones(1), ((0, 0),), energies, counts)

    def origin(self, effects: tuple[Candidate, ...], values: Any) -> Any:
        return SimpleNamespace(builder=self, likelihood=0.0, effects=effects, refused={})

    def near(self, model: Any) -> World:
        return self

    @property
    def early(self) -> World:
        return self

    def likelier(self, model: Any) -> float:
        return float(model.left.log_likelihood - self.refit.left.log_likelihood)

    def forget(self) -> None:
        pass

    def is_over(self, share: float = 1.0) -> bool:
        return self.work.done >= share * self.allowed

    def partial_fit(self, effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
        self.work.add(self.fit * self.dearer ** (len(effects) - 1))
        left = self.made(effects).left
        problem: Any = SimpleNamespace(cost=lambda x, e: -left.log_likelihood, training=())
        point = StartingPoint(float(left.energy[0]), problem, np.zeros(0), tuple(c.starts[0] for c in effects), ())
        return PartialFit(effects, point, True)

    def finish(self, partial: PartialFit, reach: float = math.inf) -> Any:
        self.work.add(self.fit * self.dearer ** (len(partial.effects) - 1))
        made = self.made(partial.effects, after=self.excess_at_end)
        self.reaches.append((made.keys, reach))
        made.fit.converged = made.keys not in self.bad
        self.fitted.append(made.keys)
        self.options |= {c.option for c in partial.effects if c.option}
        return made

    def settled(self, model: Any) -> Any:
        self.settlings.append(model.keys)
        return model

    def begun_from(self, model: Any, other: Any) -> Any:
        self.begun.append((model.keys, other.keys))
        closer = self.closer.get(model.keys)
        return model if closer is None else self.made(model.effects, after=closer)

    def retried(self, model: Any, reach: float = math.inf) -> Any:
        self.retries.append(model.keys)
        self.retry_reaches.append(reach)
        return self.made(model.effects)


class Beside(World):
    """An effect promises much beside another one alone.

    Args:
        excess, shapes: as of `World`.
        effect: which.
        other: beside which.
    """

    def __init__(
        self, excess: Excess, effect: Candidate, other: Candidate, shapes: Mapping[str, Sequence[float]] | None = None
    ) -> None:
        super().__init__(excess, shapes=shapes)
        self.effect, self.other = effect, other

    def origin(self, effects: tuple[Candidate, ...], values: Any) -> Any:
        self.promise = {self.effect.key: 3000.0 if [c.key for c in effects] == [self.other.key] else 20.0}
        return super().origin(effects, values)


def seen_as(monkeypatch: pytest.MonkeyPatch, courses: Callable[[Any, Candidate], list[Any]]) -> None:
    """What effects change beside a model is what is given here, wherever the search asks for it."""
    for module in ("board", "pairs", "promises"):
        monkeypatch.setattr(f"diagnosis.search.{module}.courses", courses)


@pytest.fixture(autouse=True)
def no_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Courses come from the world's promises, and blocks take every size."""

    def courses(origin: Any, c: Candidate) -> list[Any]:
        world = origin.builder
        likelihood = world.promise.get(f"{c.key}{c.option and ' ' + c.option}", 50.0)
        return [SimpleNamespace(likelihood=likelihood, values=np.array(world.shapes.get(c.key, (0.0, 0.0))))]

    seen_as(monkeypatch, courses)
    monkeypatch.setattr("diagnosis.search.pairs.together", lambda found, origin, most, gained: [])
    monkeypatch.setattr(tried_models, "edited", lambda scenario, edits: None)


def begun_in(
    world: World, listed: Sequence[Candidate], beside: Callable[[ScoredModel], list[Candidate]] | None = None
) -> Any:
    """A search in a world that has only begun, with the effects that are listed in it; `beside` as of `Board`."""
    return searching._Search(Board(world, world.refit, listed, None, beside))  # type: ignore[arg-type]


def run(world: World, listed: Sequence[Candidate], most: int = 3) -> Any:
    made = begun_in(world, listed)
    made.run(most)
    return made


def by(table: Mapping[str, float], otherwise: float = 1e6) -> Excess:
    """What sets of effects leave, written as 'a at x + b at y'; others leave what the best part of them does."""
    rows = {frozenset(k for k in key.split(" + ") if k): left for key, left in table.items()}

    def excess(names: frozenset[str]) -> float:
        return min((left for key, left in rows.items() if key <= names), default=otherwise)

    return excess


FRICTION, STRIBECK, LAG = effect("coulomb_friction"), effect("stribeck_friction", sizes=3), effect("lag", "u")
NONE = np.zeros(2)
OTHERS = [effect(f"other_{k}", f"place {k}") for k in range(12)]


def test_what_leads_beside_a_simpler_law_is_varied_in_its_turn() -> None:
    """Drag beside Coulomb friction takes the place of Stribeck friction, and a lag that imitates it does better yet."""
    drag, lag = effect("quadratic_drag"), effect("sensor_lag", "sensor")
    pairs = {f"{FRICTION.key} + {drag.key}": 100.0, f"{FRICTION.key} + {lag.key}": 0.0}
    promise = {FRICTION.key: 2000.0, STRIBECK.key: 3000.0, drag.key: 1000.0, lag.key: 1.0}
    shapes = {drag.key: (0.0, 1.0), lag.key: (0.1, 1.0)}
    world = World(by({FRICTION.key: 9e4, STRIBECK.key: 1e4} | pairs), promise, shapes=shapes)
    assert run(world, [FRICTION, STRIBECK, drag, lag]).known.best.keys == {FRICTION.key, lag.key}


def test_two_that_promise_most_together_are_fitted_before_a_second_beside_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A mixture of a spring and a drag promises most alone; beside it neither gains anything, and both explain all."""
    mixture, spring, drag = effect("hysteresis", "joint"), effect("spring", "arm"), effect("drag", "load")
    asked: list[float] = []

    def together(found: Any, origin: Any, most: int, gained: float) -> list[tuple[Candidate, ...]]:
        asked.append(gained)
        return [(spring, drag)]

    monkeypatch.setattr("diagnosis.search.pairs.together", together)
    table = {mixture.key: 8e4, f"{spring.key} + {drag.key}": 0.0}
    world = World(by(table), {mixture.key: 3000.0, spring.key: 100.0, drag.key: 90.0})
    found = run(world, [mixture, *OTHERS, spring, drag])
    pair = frozenset({spring.key, drag.key})
    assert found.known.best.keys == pair
    assert all(len(keys) < 2 for keys in world.fitted[: world.fitted.index(pair)])
    # They are to promise more than the mixture has gained.
    assert asked[0] == world.likelier(world.made((mixture,))) > 0


def test_what_leads_is_extended_however_long_pairs_have_taken_that_are_no_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spring, drag = effect("spring", "arm"), effect("drag", "load")
    monkeypatch.setattr("diagnosis.search.pairs.together", lambda found, origin, most, gained: [(spring, drag)])
    world = World(by({FRICTION.key: 5e4, f"{FRICTION.key} + {LAG.key}": 0.0}), fit=SEARCH.least_work)
    found = run(world, [FRICTION, LAG, spring, drag])
    assert frozenset({spring.key, drag.key}) in world.fitted
    assert found.known.best.keys == {FRICTION.key, LAG.key}


@pytest.mark.parametrize(("alone", "begun"), [(3.1e4, "lag"), (9.9e5, "coulomb_friction")])
def test_of_two_that_lead_together_what_does_as_well_alone_is_extended(
    monkeypatch: pytest.MonkeyPatch, alone: float, begun: str
) -> None:
    """A lag promised too little to be fitted alone. Beside a drag it leads, and most of what both explain is its own.

    The friction, which promised most and led alone, is extended only if the lag alone is worth less.
    """
    drag, zone = effect("drag", "load"), effect("dead_zone", "v")
    monkeypatch.setattr("diagnosis.search.pairs.together", lambda found, origin, most, gained: [(drag, LAG)])
    rows = {FRICTION.key: 9e5, LAG.key: alone, f"{drag.key} + {LAG.key}": 3e4, f"{LAG.key} + {zone.key}": 0.0}
    monkeypatch.setattr(World, "early", World(by({}), {FRICTION.key: 3000.0}))
    world = World(by(rows), {FRICTION.key: 3000.0, zone.key: 100.0, LAG.key: 1.0})
    found = run(world, [FRICTION, zone, drag, *OTHERS, LAG])
    assert found.known.best.keys == {LAG.key, zone.key}
    pairs = [keys for keys in world.fitted if len(keys) == 2 and keys != {drag.key, LAG.key}]
    (first,) = [c for c in (FRICTION, LAG) if c.effect == begun]
    assert first.key in pairs[0]


def test_a_pair_with_what_leads_or_a_law_of_its_kind_is_left_to_its_extension(monkeypatch: pytest.MonkeyPatch) -> None:
    """A joint leads: a joint or a spring that hardens at its place, beside a lag, is tried once the joint is in."""
    joint, hard = effect("joint_flexibility", "joint"), effect("hardening_spring", "joint", sizes=3)
    drag = effect("drag", "load")
    pairs = [(joint, LAG), (LAG, hard), (LAG, drag)]
    monkeypatch.setattr("diagnosis.search.pairs.together", lambda found, origin, most, gained: pairs)
    world = World(by({joint.key: 5e4, LAG.key: 6e5}))
    made = begun_in(world, [joint, hard, LAG, drag])
    made.first.begin()
    world.fitted.clear()
    made.growing.pairs.at_once(3)
    assert world.fitted == [frozenset({LAG.key, drag.key})]


@pytest.mark.parametrize(("strain", "whole"), [(0.0, False), (850.0, True)])
def test_beside_bent_parameters_a_second_effect_is_strong_and_begins_with_the_first(
    monkeypatch: pytest.MonkeyPatch, strain: float, whole: bool
) -> None:
    """Stribeck friction leaves nothing with parameters 20 tolerances off, which make up for a lag.

    From where it ended, the lag gains nothing; the pair begun together does, and is fitted only if they are bent.
    """

    class Bent(World):
        def made(self, effects: tuple[Candidate, ...], *, after: Excess | None = None) -> Any:
            ended = any(c.key == STRIBECK.key and c.starts[0] == {"p0": 0.2, "p1": 0.2, "p2": 0.2} for c in effects)
            made = super().made(effects, after=by({STRIBECK.key: 10.0}) if ended else after)
            made.strain = strain if STRIBECK.key in made.keys and (ended or len(effects) == 1) else 0.0
            made.bent = made.strain > made.own
            made.room += 0.5 * made.strain
            made.log_evidence -= 0.5 * made.strain
            return made

    monkeypatch.setattr("diagnosis.search.pairs.together", lambda found, origin, most, gained: [(STRIBECK, LAG)])
    world = Bent(by({STRIBECK.key: 10.0, f"{STRIBECK.key} + {LAG.key}": 0.0}))
    found = run(world, [STRIBECK, LAG, *OTHERS])
    assert (found.known.best.keys == {STRIBECK.key, LAG.key}) == whole


def test_beside_parameters_that_are_far_off_the_best_model_without_such_is_extended_too() -> None:
    """A backlash explains all of a friction and a lag with parameters far off; the friction leads with them right.

    The lag gains nothing beside the backlash.
    """
    backlash, other = effect("backlash", "gear"), effect("payload", "arm")

    class Bent(World):
        def made(self, effects: tuple[Candidate, ...], *, after: Excess | None = None) -> Any:
            made = super().made(effects, after=after)
            made.strain = 400.0 if backlash.key in made.keys else 0.0
            made.bent = made.strain > made.own
            made.room += 0.5 * made.strain
            made.log_evidence -= 0.5 * made.strain
            return made

    rows = {backlash.key: 10.0, FRICTION.key: 4e5, other.key: 6e5}
    world = Bent(by(rows | {f"{FRICTION.key} + {LAG.key}": 0.0}), {LAG.key: 200.0})
    found = run(world, [backlash, FRICTION, LAG, other], most=2)
    assert found.known.best.keys == {FRICTION.key, LAG.key}


def test_where_no_parameters_drawn_back_have_tangents_effects_are_screened_where_the_fit_ended() -> None:
    """With parameters that are not its own a model may run away; what is missing beside it shows where it stands."""
    ended = {"coulomb_friction.p0": 0.2}

    class Runaway(World):
        def made(self, effects: tuple[Candidate, ...], *, after: Excess | None = None) -> Any:
            made = super().made(effects, after=after)
            made.bent = made.keys == {FRICTION.key}
            made.strain = 100.0 if made.bent else 0.0
            return made

        def origin(self, effects: tuple[Candidate, ...], values: Any) -> Any:
            return None if effects and values.keys() != ended.keys() else super().origin(effects, values)

    world = Runaway(by({FRICTION.key: 2e4, f"{FRICTION.key} + {LAG.key}": 0.0}))
    made = begun_in(world, [FRICTION, LAG])
    model = world.made((FRICTION,))
    assert made.placing.promises.origins((FRICTION,), model, [{}, ended])
    assert not made.placing.promises.origins((FRICTION,), model, [{}, {}])


def test_beside_bent_parameters_a_second_effect_is_looked_at_from_those_that_are_given() -> None:
    """Gravity leaves nothing with parameters six tolerances off. A part of the way back a drag looks like a delay."""

    class Bent(World):
        def made(self, effects: tuple[Candidate, ...], *, after: Excess | None = None) -> Any:
            made = super().made(effects, after=after)
            made.strain = 115.0 if made.keys == {gravity.key} else 0.0
            made.fit.problem.free, made.fit.x = (FreeParameter("arm.inertia", 1.0, 0.1, True, 0.0),), (0.6,)
            made.bent = made.strain > made.own
            made.room += 0.5 * made.strain
            made.log_evidence -= 0.5 * made.strain
            return made

        def origin(self, effects: tuple[Candidate, ...], values: Any) -> Any:
            promise = {drag.key: 3000.0 if effects and not values else -math.inf}
            world = SimpleNamespace(promise=promise, shapes={})
            return SimpleNamespace(builder=world, likelihood=0.0, effects=effects, refused={})

    gravity, drag = effect("gravity", "arm"), effect("viscous_friction", "motor")
    world = Bent(by({gravity.key: 10.0, f"{gravity.key} + {drag.key}": 0.0}))
    assert run(world, [gravity, *OTHERS, drag]).known.best.keys == {gravity.key, drag.key}


def test_a_pair_that_is_no_better_over_the_beginnings_than_what_leads_is_not_fitted_to_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It promises more there than the friction that leads, which leaves as little once it is fitted there."""
    spring, drag = effect("spring", "arm"), effect("drag", "load")
    early = World(by({f"{drag.key} + {spring.key}": 40.0, FRICTION.key: 0.0}))
    monkeypatch.setattr(World, "early", early)
    monkeypatch.setattr(
        "diagnosis.search.pairs.together",
        lambda found, origin, most, gained: [(drag, spring)] if origin.builder is early else [],
    )
    world = World(by({FRICTION.key: 5e4, f"{drag.key} + {spring.key}": 4e4}))
    made = begun_in(world, [FRICTION, LAG, spring, drag])
    made.first.begin()
    made.growing.pairs.of_beginnings(made.known.best)
    both = frozenset({drag.key, spring.key})
    assert both in early.fitted
    assert both not in world.fitted


@pytest.mark.parametrize(("left", "looked"), [(5e4, True), (0.0, False)])
def test_pairs_that_promise_most_over_the_beginnings_are_fitted_there_and_the_best_to_all(
    monkeypatch: pytest.MonkeyPatch, left: float, looked: bool
) -> None:
    """Over whole recordings no pair promises anything. The one that leaves least of the beginnings comes first."""
    spring, drag = effect("spring", "arm"), effect("drag", "load")
    pairs = [(drag, spring), (spring, LAG)]
    early = World(by({f"{drag.key} + {spring.key}": 9e4, f"{spring.key} + {LAG.key}": 0.0}))
    monkeypatch.setattr(World, "early", early)
    monkeypatch.setattr(
        "diagnosis.search.pairs.together", lambda found, origin, most, gained: pairs if origin.builder is early else []
    )
    world = World(by({FRICTION.key: left, f"{spring.key} + {LAG.key}": 0.0}))
    found = run(world, [FRICTION, LAG, spring, drag])
    assert (frozenset({spring.key, LAG.key}) in early.fitted) == looked
    pairs_of_all = [keys for keys in world.fitted if len(keys) == 2]
    assert not looked or pairs_of_all[0] == {spring.key, LAG.key}
    assert found.known.best.keys == ({spring.key, LAG.key} if looked else {FRICTION.key})


def test_a_wave_of_a_pair_is_raced_in_all_of_its_orders() -> None:
    """What promises most over a short way is one order of several that are alike there."""
    starts = tuple({"order": order, "amplitude": 0.1, "phase": 0.0} for order in (2.0, 3.0))
    wave = replace(effect("torque_ripple"), starts=starts, wave=Wave("amplitude", "phase", starts))
    world = World(by({}))
    made = begun_in(world, [wave, LAG])
    made.first.begin()
    pair = made.board.with_all_orders((replace(wave, starts=starts[1:]), LAG))
    assert [(c.key, c.starts) for c in pair] == [(LAG.key, LAG.starts), (wave.key, starts)]


@pytest.mark.parametrize(("left", "fitted"), [(0.0, False), (4e5, True)])
def test_beside_what_explains_all_what_promises_little_is_not_fitted(left: float, fitted: bool) -> None:
    """Models near the best gain at most some times what they promise."""
    world = World(by({FRICTION.key: left}), {FRICTION.key: 3000.0} | {c.key: 20.0 for c in OTHERS})
    run(world, [*OTHERS, FRICTION], most=1)
    assert world.fitted[0] == {FRICTION.key}
    assert any(frozenset({c.key}) in world.fitted for c in OTHERS) == fitted


def test_laws_that_are_alike_leave_their_turn_to_another_place() -> None:
    """Six laws of a joint come near in few steps; a lag is behind them then, and ends before them."""
    laws = [effect(f"law_{k}", "joint") for k in range(6)]
    world = World(by({law.key: 100.0 + k for k, law in enumerate(laws)} | {LAG.key: 150.0}))
    world.excess_at_end = by({law.key: 100.0 + 300 * k for k, law in enumerate(laws)} | {LAG.key: 0.0})
    found = run(world, [*laws, LAG, *OTHERS])
    assert found.known.best.keys == {LAG.key}


@pytest.mark.parametrize(("left", "told"), [(200.0, FRICTION), (400.0, STRIBECK)])
def test_a_law_that_explains_little_more_is_held_against_other_effects_beside_the_simpler_one(
    left: float, told: Candidate
) -> None:
    """Beside friction an offset that promises nothing alone does as well as the richer law, or does not."""
    offset = effect("offset", "u")
    table = {FRICTION.key: 400.0, STRIBECK.key: 200.0, f"{FRICTION.key} + {offset.key}": left}
    world = World(by(table), {FRICTION.key: 3000.0, STRIBECK.key: 3000.0, offset.key: 60.0})
    found = run(world, [FRICTION, STRIBECK, offset], most=2)
    odds = probabilities(found.known.told, found.known.tried)
    assert max(odds, key=lambda keys: odds[keys]) == {told.key}


@pytest.mark.parametrize(("simple", "rich", "found"), [(9e4, 1e4, True), (6e5, 1e4, False), (9e4, 0.0, False)])
def test_a_richer_law_is_held_against_a_second_effect_beside_the_simpler_one(
    simple: float, rich: float, found: bool
) -> None:
    """Coulomb friction leaves nine times what Stribeck friction does, and nothing beside a drag.

    Where it does not explain most of what the richer law does, or that leaves nothing, it is not extended.
    """
    drag = effect("quadratic_drag")
    table = {FRICTION.key: simple, STRIBECK.key: rich, f"{FRICTION.key} + {drag.key}": 0.0}
    world = World(by(table), {FRICTION.key: 2000.0, STRIBECK.key: 3000.0, drag.key: 1000.0})
    run(world, [FRICTION, STRIBECK, drag])
    assert (frozenset({FRICTION.key, drag.key}) in world.fitted) == found


@pytest.mark.parametrize(("left", "ways"), [(5e3, {"upper", "both"}), (0.0, {"upper"})])
def test_where_an_effect_leaves_much_it_is_put_in_otherwise_too(left: float, ways: set[str]) -> None:
    """A stop at one end promises as much as stops at both, and fits the few touches of one."""
    stops = [effect("end_stop", option=option) for option in ("upper", "both")]
    upper, both = (f"{s.key} {s.option}" for s in stops)
    world = World(by({upper: left, both: 0.0}), {upper: 5e3, both: 4e3} | {c.key: 10.0 for c in OTHERS})
    found = run(world, [*stops, *OTHERS], most=2)
    assert world.options == ways
    assert found.known.best.keys == {stops[0].key}
    assert found.known.best.left.energy[0] == COUNT


def test_a_search_that_gains_nothing_for_long_ends() -> None:
    """All that is tried leaves much, as where the effect is not listed: what leads was found soon, and is not bettered.

    It ends within one move after as much work again as the first effects took, or `SEARCH.least_work`.
    """

    def of(fit: int) -> tuple[World, Any]:
        world = World(by({c.key: 8e4 + 1e4 * k for k, c in enumerate(OTHERS)}), fit=fit)
        begun = begun_in(world, OTHERS)
        begun.first.begin()
        first = world.work.done
        begun.run(3)
        return world, first

    endless, _ = of(0)
    unit = SEARCH.least_work // 19  # the first effects take 19 of these
    world, first = of(unit)
    assert first > 0
    assert len(world.fitted) < len(endless.fitted)
    most = first + max(SEARCH.patience * first, SEARCH.least_work)
    assert most < world.work.done < most + 10 * unit * len(OTHERS)


def test_a_search_ends_where_its_time_is_over_and_keeps_a_share_of_it_for_rivals() -> None:
    """Nothing explains all, and further effects are sought until two thirds of the time are over."""

    def of(allowed: float) -> tuple[World, Any]:
        world = World(by({c.key: 8e4 + 1e4 * k for k, c in enumerate(OTHERS)}), fit=1, allowed=allowed)
        return world, begun_in(world, OTHERS)

    world, search = of(math.inf)
    search.run(3)
    endless, pairs = world.work.done, 2 * 10 * 2 * SEARCH.few
    allowed = endless // 2
    world, search = of(allowed)
    search.near = lambda: grown.append(world.work.done) or []  # type: ignore[func-returns-value]
    grown: list[int] = []
    search.run(3)
    assert SEARCH.growing * allowed <= grown[0] < SEARCH.growing * allowed + pairs
    assert search.ended_early
    world, search = of(5)
    with pytest.raises(OutOfTime):
        search.run(3)
    assert 5 <= world.work.done < 5 + len(OTHERS) + pairs
    assert len(search.known.best.effects) == 1


@pytest.mark.parametrize("share", [1 / 3, 1.0])
def test_first_effects_wait_once_they_had_their_share(monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """Friction leads after a few; all fourteen would take the time in which a lag is put in beside it."""
    monkeypatch.setattr("diagnosis.search.first_effects.SEARCH", replace(SEARCH, first=share))
    listed = [FRICTION, LAG, *OTHERS]
    alone = {c.key: 5e4 + 5 + k for k, c in enumerate(OTHERS)} | {FRICTION.key: 5e4, LAG.key: 7e4}
    world = World(by(alone | {f"{FRICTION.key} + {LAG.key}": 0.0}), fit=1, allowed=27)
    search = begun_in(world, listed)
    with pytest.raises(OutOfTime):
        search.run(3)
    waits = share < SEARCH.growing
    assert search.known.best.keys == ({FRICTION.key, LAG.key} if waits else {FRICTION.key})


def test_first_effects_that_waited_are_fitted_where_time_is_left() -> None:
    listed = [FRICTION, LAG, *OTHERS]
    alone = {c.key: 8e4 for c in OTHERS} | {FRICTION.key: 5e4, LAG.key: 7e4}
    table = by(alone | {f"{FRICTION.key} + {LAG.key}": 0.0})

    def fitted(allowed: float) -> tuple[set[frozenset[str]], set[frozenset[str]]]:
        world = World(table, fit=1, allowed=allowed, dearer=1)
        search = begun_in(world, listed)
        search.first.begin()
        before = set(world.fitted)
        search.run(3)
        assert search.known.best.keys == {FRICTION.key, LAG.key}
        return before, set(world.fitted)

    before, after = fitted(45)
    assert before < fitted(math.inf)[0] <= after


def test_what_leads_a_round_is_fitted_to_the_end_although_the_time_is_over() -> None:
    """The few steps of all took the time: without a fit to the end what they have told would be lost."""
    listed = [FRICTION, LAG, *OTHERS]
    world = World(by({FRICTION.key: 0.0}), fit=1, allowed=len(listed))
    known = tried_models.TriedModels(world, world.refit, len(listed))  # type: ignore[arg-type]
    known.bounded = True
    with pytest.raises(OutOfTime):
        known.fit([((c,), [{}]) for c in listed], len(listed))
    assert world.fitted == [frozenset({FRICTION.key})]
    assert known.best.keys == {FRICTION.key}


def test_where_the_time_for_adding_effects_is_over_what_leads_gets_its_rivals() -> None:
    """A lag came last beside the friction; a delay that changes the recordings as it does explains as much there."""
    delay = effect("delay", "command")
    shapes = {LAG.key: (0.0, 1.0), delay.key: (0.1, 1.0)}
    alone = {FRICTION.key: 5e4, LAG.key: 5e5, delay.key: 9e5}
    both = {f"{FRICTION.key} + {LAG.key}": 300.0, f"{FRICTION.key} + {delay.key}": 0.0}
    world = Beside(by(alone | both), delay, FRICTION, shapes)
    made = begun_in(world, [FRICTION, LAG, *OTHERS, delay])
    made.first.begin()

    def grow(most: int) -> None:
        made.known.keep(world.made((FRICTION, LAG)))
        raise OutOfTime

    made.growing.grow = grow
    made.run(3)
    assert made.ended_early
    assert made.known.best.keys == {FRICTION.key, delay.key}


def test_what_leads_is_reduced_to_the_simpler_law_although_the_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stribeck friction beside a lag leads, and Coulomb friction, which does as well there, has had no turn yet."""
    both = {f"{STRIBECK.key} + {LAG.key}": 0.0, f"{FRICTION.key} + {LAG.key}": 0.0}
    world = World(by({STRIBECK.key: 5e4, FRICTION.key: 6e4} | both))

    def grow(self: Any, most: int) -> None:
        self.known.keep(world.made((STRIBECK, LAG)))
        world.allowed = 0.0

    monkeypatch.setattr(Growing, "grow", grow)
    found = between_recordings(monkeypatch, lambda model: False, world, [FRICTION, STRIBECK, LAG])
    assert found.ended_early
    assert found.best == {FRICTION.key, LAG.key}


@pytest.mark.parametrize("new", [True, False])
def test_what_takes_the_lead_last_is_varied_unless_it_was(monkeypatch: pytest.MonkeyPatch, new: bool) -> None:
    """A node that is cut otherwise may explain all, and the search ends: the same law elsewhere has had no turn."""
    world = World(by({FRICTION.key: 5e3, LAG.key: 0.0}))
    varied: list[frozenset[str]] = []

    def grow(self: Any, most: int) -> None:
        if new:
            self.known.keep(world.made((LAG,)))

    monkeypatch.setattr(Growing, "grow", grow)
    monkeypatch.setattr(Varying, "_varied", lambda self, model: varied.append(model.keys))
    run(world, [FRICTION, *OTHERS])
    assert varied == [frozenset({FRICTION.key}), *([frozenset({LAG.key})] if new else [])]


def test_what_takes_part_is_fitted_to_its_end_although_the_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rival that is nearly as probable is no less likely for having had no time."""
    world = World(by({LAG.key: 0.0, FRICTION.key: 0.0, OTHERS[0].key: 1e5}))
    rival, far = world.made((FRICTION,)), world.made((OTHERS[0],))
    rival.fit.converged = far.fit.converged = False
    rival.log_evidence -= 2 * EVIDENCE.temperature

    def grow(self: Any, most: int) -> None:
        for made in (rival, far):
            self.known._models[made.keys] = made
        world.allowed = 0.0

    monkeypatch.setattr(Growing, "grow", grow)
    found = between_recordings(monkeypatch, lambda model: False, world, [FRICTION, LAG, *OTHERS])
    assert found.ended_early
    assert {FRICTION.key} in world.settlings
    assert {OTHERS[0].key} not in world.settlings


def test_what_is_akin_to_the_best_and_has_no_turn_is_not_lost() -> None:
    """Of seven dropped fits at the place of what leads the first few come nowhere near, and the search goes on."""
    world = World(by({FRICTION.key: 0.0}, otherwise=9e5))
    made = begun_in(world, [FRICTION, *OTHERS])
    leads = world.made((FRICTION,))
    made.known.keep(leads)
    akin = [world.partial_fit((effect(f"law_{k}"),), [{}]) for k in range(7)]
    made.known.dropped = list(akin)
    made.varying._finish_dropped(leads, set())
    assert made.known.dropped == akin[SEARCH.few :]


def test_other_ways_to_put_in_an_effect_are_told_from_its_own_way() -> None:
    """A stop at both ends leads beside a joint: the same stop at one end is tried, the joint as it is cut is not."""
    ends = [effect("end_stop", "link", option=at) for at in ("both", "upper")]
    joints = [effect("joint_flexibility", "gear", option=at) for at in ("load", "motor")]
    world = World(by({f"{ends[0].key} both + {joints[0].key} load": 0.0}))
    made = begun_in(world, [*ends, *joints])
    made.board.looked = Looked((*ends, *joints), (), None)
    made.known.keep(world.made((ends[0], joints[0])))
    for c in (ends[0], joints[0]):
        made.known.keep(world.made((c,)))
    world.options.clear()
    made.growing._other_laws()
    assert {"upper", "motor"} <= world.options
    assert not {"both", "load"} & world.options


def test_what_leads_is_fitted_to_its_end_although_the_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an end that is none no interval is told."""
    world = World(by({LAG.key: 5e4, f"{FRICTION.key} + {LAG.key}": 0.0}))
    pair = world.made((FRICTION, LAG))
    pair.fit.converged = False

    def grow(self: Any, most: int) -> None:
        self.known.keep(pair)
        world.allowed = 0.0

    monkeypatch.setattr(Growing, "grow", grow)
    found = between_recordings(monkeypatch, lambda model: False, world, [FRICTION, LAG])
    assert found.ended_early
    assert world.settlings == [pair.keys]


@pytest.mark.parametrize(("owed", "least", "followed"), [(5.0, 0.0, True), (0.1, 0.0, False), (5.0, 4e4, False)])
def test_what_owes_a_step_what_it_promised_is_followed_where_it_may_come_near_the_best(
    owed: float, least: float, followed: bool
) -> None:
    """Friction is told by held-out recordings where it is followed; nothing follows what the fitted ones rule out."""

    class Owing(World):
        def made(self, effects: tuple[Candidate, ...], *, after: Excess | None = None) -> Any:
            made = super().made(effects, after=after)
            made.unseen = self.left(max(self.excess(frozenset(c.key for c in effects)) - least, 0.0))
            made.owed = owed if effects and effects[0].key == FRICTION.key else 0.0
            return made

        def followed(self, model: Any) -> Any:
            follows.append(model.keys)
            made = self.made(model.effects)
            made.owed, made.log_evidence = 0.0, 0.0
            return made

    follows: list[frozenset[str]] = []
    world = Owing(by({LAG.key: 100.0, FRICTION.key: 4e4}))
    found = run(world, [LAG, FRICTION], most=1)
    assert (frozenset({FRICTION.key}) in follows) == followed
    assert len(follows) <= 1
    assert found.known.best.keys == {FRICTION.key if followed else LAG.key}


def test_a_gain_renews_the_patience_of_a_search_and_a_hairs_breadth_does_not() -> None:
    patience, found = Patience(), 10 * SEARCH.least_work
    patience.note(frozenset("a"), 100.0, found)
    patience.note(frozenset("b"), 100.0 + 0.9 * SEARCH.effort, int(1.3 * found))
    patience.note(frozenset("a"), 100.5, int(1.4 * found))  # what leads, fitted again
    end = int(found * (1 + SEARCH.patience))
    assert (patience.is_over(end), patience.is_over(end + 1)) == (False, True)
    patience.note(frozenset("b"), 101.0 + SEARCH.effort, int(1.5 * found))
    assert not patience.is_over(end + 1)


def test_what_is_found_at_once_leaves_a_search_a_minute() -> None:
    patience = Patience()
    patience.note(frozenset("a"), 100.0, 10)
    assert (patience.is_over(10 + SEARCH.least_work), patience.is_over(11 + SEARCH.least_work)) == (False, True)


@pytest.mark.parametrize("times", [0.5, 2.0])
def test_what_would_come_nowhere_near_the_best_if_it_kept_many_times_its_promise_is_not_fitted(times: float) -> None:
    """Friction leaves a little, the lag much; beside the lag something must promise a share of what is between them."""
    world = World(by({FRICTION.key: 2e4, LAG.key: 5e5}))
    likelihoods = [world.left(excess).log_likelihood for excess in (2e4, 5e5)]
    wanting = (likelihoods[0] - likelihoods[1]) / SEARCH.promised
    world.promise = {FRICTION.key: 1e3, LAG.key: 9e2} | {c.key: times * wanting for c in OTHERS}
    run(world, [FRICTION, LAG, *OTHERS], most=2)
    beside = [keys for keys in world.fitted if len(keys) > 1 and LAG.key in keys and FRICTION.key not in keys]
    assert bool(beside) is (times > 1)


def test_a_pair_is_looked_for_beside_the_better_of_the_two_alone() -> None:
    world = World(by({FRICTION.key: 2e5, LAG.key: 3e5, STRIBECK.key: 4e5}))
    begun = [keys for keys in _begun(world, [FRICTION, LAG, STRIBECK, *OTHERS]) if len(keys) == 2]
    assert begun.count((FRICTION.key, LAG.key)) == 1
    assert (LAG.key, FRICTION.key) not in begun


def _begun(world: World, listed: Sequence[Candidate]) -> list[tuple[str, ...]]:
    """The effects of all models whose fits were begun in a search for two, in their order."""
    begun: list[tuple[str, ...]] = []
    partial_fit = world.partial_fit

    def noted(effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
        begun.append(tuple(c.key for c in effects))
        return partial_fit(effects, parents)

    world.partial_fit = noted  # type: ignore[method-assign]
    run(world, listed, most=2)
    return begun


@pytest.mark.parametrize(("fitted", "begun"), [(-1.0, [0.7]), (-3.2, [0.04, None]), (-4.0, [0.0, None])])
def test_where_a_friction_was_fitted_to_nearly_nothing_effects_begin_from_the_given_value_too(
    fitted: float, begun: list[float | None]
) -> None:
    """Four tolerances of 30 % below its value a friction is nothing: what makes it fall shows from its value alone.

    Where it was fitted to a twenty-fifth, what makes it fall promised nothing, and was not fitted.
    """
    friction = FreeParameter("bearing.viscous_friction", 1.0, 0.3, True, 0.0, math.inf, may_vanish=True)
    world = World(by({"": 1e5}))
    world.refit.fit.problem, world.refit.fit.x = SimpleNamespace(free=(friction,)), (fitted,)
    world.refit.far_off = ScoredModel.far_off.fget(world.refit)  # type: ignore[attr-defined]
    made = begun_in(world, [])
    assert [values.get(friction.name) for values in made.placing.alone_from()] == [pytest.approx(b) for b in begun]


def test_two_effects_are_found_one_beside_the_other() -> None:
    world = World(by({FRICTION.key: 2e4, LAG.key: 5e5, f"{FRICTION.key} + {LAG.key}": 0.0}))
    found = run(world, [FRICTION, LAG, *OTHERS])
    assert found.known.best.keys == {FRICTION.key, LAG.key}


@pytest.mark.parametrize(("shape", "found_as"), [((0.1, 1.0), "delay"), ((1.0, 0.1), "lag")])
def test_what_changes_recordings_as_an_effect_does_is_tried_in_its_place(
    shape: tuple[float, float], found_as: str
) -> None:
    """A delay that promised less than all others beside the user's model gains more than the lag beside a friction."""
    delay = effect("delay", "command")
    promise = {delay.key: 60.0} | {c.key: 70.0 for c in (FRICTION, LAG, *OTHERS)}
    shapes = {LAG.key: (0.0, 1.0), delay.key: shape}
    alone = {FRICTION.key: 2e4, LAG.key: 5e5, delay.key: 6e5}
    beside = {f"{FRICTION.key} + {LAG.key}": 300.0, f"{FRICTION.key} + {delay.key}": 0.0}
    found = run(World(by(alone | beside), promise, shapes), [FRICTION, LAG, *OTHERS, delay], most=2)
    assert {c.effect for c in found.known.best.effects} == {"coulomb_friction", found_as}


def test_what_is_found_in_the_place_of_what_leads_is_varied_in_its_turn() -> None:
    """Beside friction a delay is no better than the lag; beside the richer law, found meanwhile, it explains all."""
    delay = effect("delay", "u")
    rows = {FRICTION.key: 4e5, LAG.key: 8e5, STRIBECK.key: 1e6, delay.key: 8e5}
    rows |= {f"{FRICTION.key} + {LAG.key}": 2e5, f"{FRICTION.key} + {delay.key}": 3e5}
    rows |= {f"{STRIBECK.key} + {LAG.key}": 1e5, f"{STRIBECK.key} + {delay.key}": 0.0}
    world = World(by(rows))
    listed = [STRIBECK, LAG, delay, FRICTION, *OTHERS]
    made = begun_in(world, listed)
    made.known.fit([((FRICTION, LAG), [{}])], 1)
    made.varying.vary()
    assert made.known.best.keys == {STRIBECK.key, delay.key}


def test_beside_what_is_put_in_the_place_of_its_like_the_order_of_a_wave_is_chosen_anew() -> None:
    """Gravity leaves another order for the ripple than the offset does that it imitates."""
    starts = tuple({"order": order, "amplitude": 0.1, "phase": 0.0} for order in (2.0, 3.0))
    wave = replace(effect("torque_ripple"), starts=starts, wave=Wave("amplitude", "phase", starts))
    gravity, offset = effect("gravity", "arm"), effect("offset", "u")
    raced: list[tuple[dict[str, float], ...]] = []

    class Waves(World):
        def partial_fit(self, effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
            raced.extend(c.starts for c in effects if c.wave is not None and offset.key in {k.key for k in effects})
            return super().partial_fit(effects, parents)

    rows = {gravity.key: 3e5, offset.key: 4e5, f"{gravity.key} + {wave.key}": 5e4}
    world = Waves(by(rows), {wave.key: 10.0}, {gravity.key: (0.0, 1.0), offset.key: (0.1, 1.0)})
    made = begun_in(world, [gravity, offset, wave])
    made.first.begin()
    found = made.known.fit([((gravity, replace(wave, starts=starts[:1])), [{}])], 1)
    raced.clear()
    made.varying._varied(found[0])
    assert starts in raced


def test_what_imitates_the_best_is_fitted_to_the_end_though_a_few_steps_left_more() -> None:
    """An offset came behind eight others after a few steps, of which a weight leads; the offset explains all."""
    weight, offset = effect("gravity", "arm"), effect("offset", "u")
    others = OTHERS[: SEARCH.finished]
    shapes = {weight.key: (0.0, 1.0), offset.key: (0.1, 1.0)}
    world = World(by({c.key: 100.0 for c in others} | {weight.key: 50.0, offset.key: 200.0}), shapes=shapes)
    world.excess_at_end = by({c.key: 500.0 for c in others} | {weight.key: 100.0, offset.key: 0.0})
    assert run(world, [*others, weight, offset]).known.best.keys == {offset.key}


def test_what_imitates_the_best_does_not_wait_to_be_fitted_to_the_end() -> None:
    """Three joints had their turn and came nowhere near a delay that explains all; a sensor's lag waited, which does.

    It acts elsewhere, and by another law: that the recordings do not tell them apart is what says it is akin.
    """
    delay, lag = effect("delay", "u"), effect("sensor_lag", "sensor")
    shapes = {delay.key: (0.0, 1.0), lag.key: (0.1, 1.0)}
    left = {c.key: 50.0 + k for k, c in enumerate(OTHERS[:6])}
    promise = {c.key: 2900.0 for c in (*OTHERS[:6], lag)} | {delay.key: 3000.0}
    world = World(by({delay.key: 0.0, lag.key: 300.0} | left), promise, shapes=shapes)
    world.excess_at_end = by({delay.key: 0.0, lag.key: 1.0} | dict.fromkeys(left, 900000.0))
    found = run(world, [delay, *OTHERS[:6], lag])
    assert frozenset({lag.key}) in world.fitted
    assert len(probabilities(found.known.told, found.known.tried)) > 1


def test_what_imitates_an_effect_has_a_turn_whatever_else_does_so_at_more_places() -> None:
    """A weight is likest to itself at seven other places; an offset is nearly as like."""
    weights = [effect("gravity", f"shaft {k}") for k in range(8)]
    offset = effect("offset", "u")
    shapes = {c.key: (0.0, 1.0) for c in weights} | {offset.key: (0.1, 1.0)}
    world = World(by({}), shapes=shapes)
    made = begun_in(world, [*weights, offset])
    made.first.begin()
    found = made.board.mimics(weights[0])
    assert (len(found), found[1].key) == (SEARCH.exchanged, offset.key)


def test_what_led_alone_is_put_in_the_place_of_each_of_two() -> None:
    """Friction led alone; a bias beside an offset explains nearly all, and the bias beside the friction does so."""
    bias, offset = effect("sensor_bias", "gauge"), effect("offset", "u")
    alone = {FRICTION.key: 4e5, offset.key: 5e5, bias.key: 5e5}
    both = {f"{bias.key} + {offset.key}": 5000.0, f"{bias.key} + {FRICTION.key}": 0.0}
    world = Beside(by(alone | both), FRICTION, bias)
    listed = [bias, offset, *OTHERS, FRICTION]
    made = begun_in(world, listed)
    made.first.begin()
    made.known.fit([((FRICTION,), [{}])], 1)
    assert made.known.best.keys == {FRICTION.key}
    made.known.fit([((bias, offset), [{}])], 1)
    made.varying.vary()
    assert made.known.best.keys == {bias.key, FRICTION.key}


def test_what_leads_is_varied_though_the_time_for_first_effects_was_over_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    varied: list[frozenset[str]] = []
    listed = [FRICTION, LAG, *OTHERS]
    world = World(by({c.key: 8e4 for c in OTHERS} | {FRICTION.key: 0.0, LAG.key: 7e4}), fit=1)
    search = begun_in(world, listed)
    vary = search.varying.vary

    def noted() -> None:
        varied.append(search.known.best.keys)
        vary()

    def ended() -> None:
        monkeypatch.setattr(search.varying, "vary", noted)
        raise OutOfTime

    monkeypatch.setattr(search.varying, "vary", ended)
    search.run(3)
    assert varied == [frozenset({FRICTION.key})]


def test_models_that_take_part_in_the_choice_are_begun_from_the_best_one_too() -> None:
    """An offset ended in a hollow; what is far behind, and the user's own model, need no second beginning."""
    offset, far = effect("offset", "u"), effect("lag", "far")
    world = World(by({FRICTION.key: 0.0, offset.key: 5.0, far.key: 5e5}))
    world.closer[frozenset({offset.key})] = lambda names: 1.0
    known = run(world, [FRICTION, offset, far], most=1).known
    assert world.begun == [(frozenset({offset.key}), frozenset({FRICTION.key}))]
    before = known.worth(world.made((offset,)))
    assert known.worth(known[frozenset({offset.key})]) > before


def test_where_one_effect_leaves_the_noise_no_further_is_sought() -> None:
    world = World(by({FRICTION.key: 0.0}))
    found = run(world, [FRICTION, LAG, *OTHERS])
    assert found.known.best.keys == {FRICTION.key}
    assert max(len(keys) for keys in world.fitted) == 1


@pytest.mark.parametrize(("refit", "strain", "sought"), [(400.0, 1.0, False), (2000.0, 1.0, True), (400.0, 30.0, True)])
def test_where_the_users_model_leaves_no_more_than_noise_no_second_effect_is_sought(
    refit: float, strain: float, sought: bool
) -> None:
    """What one effect leaves of so little may be a nuisance as well as a further effect, unless it bends parameters."""

    class Bent(World):
        def made(self, effects: tuple[Candidate, ...], *, after: Excess | None = None) -> Any:
            made = super().made(effects, after=after)
            made.strain = strain
            return made

    world = Bent(by({"": refit, FRICTION.key: 150.0, f"{FRICTION.key} + {LAG.key}": 0.0}))
    found = run(world, [FRICTION, LAG, *OTHERS])
    assert FRICTION.key in found.known.best.keys
    assert any(len(keys) > 1 for keys in world.fitted) == sought


def test_where_the_first_pair_leaves_the_noise_what_leads_less_is_not_extended() -> None:
    lesser = {c.key: 1e5 + k for k, c in enumerate(OTHERS[:4])}
    world = World(by({FRICTION.key: 2e4, LAG.key: 5e5, f"{FRICTION.key} + {LAG.key}": 0.0} | lesser))
    found = run(world, [FRICTION, LAG, *OTHERS])
    assert found.known.best.keys == {FRICTION.key, LAG.key}
    assert [keys for keys in world.fitted if len(keys) > 1 and not keys & {FRICTION.key, LAG.key}] == []


def test_only_models_near_the_best_are_fitted_to_the_end() -> None:
    """What is beyond reach cannot become the best by some steps more."""
    world = World(by({FRICTION.key: 0.0, LAG.key: 9e5}))
    world.bad = {frozenset({FRICTION.key}), frozenset({LAG.key})}
    found = run(world, [FRICTION, LAG, *OTHERS])
    assert frozenset({LAG.key}) in found.known
    assert world.settlings == [frozenset({FRICTION.key})]


def settled(likelier: float, *, begun: float = 4e3) -> tuple[Any, Any, World]:
    """A model whose fit was left early, what it is once it has ended, so much likelier, and the world."""

    class Ended(World):
        def settled(self, model: Any) -> Any:
            super().settled(model)
            made = self.made(model.effects)
            made.log_evidence = model.log_evidence + likelier
            made.judged_as = lambda other: SimpleNamespace(**{**vars(made), "log_evidence": other.log_evidence})
            return made

    world = Ended(by({FRICTION.key: begun}))
    known = begun_in(world, [FRICTION]).known
    model = world.made((FRICTION,))
    model.fit.converged = False
    known.keep(model)
    return known, known.settled(model), world


@pytest.mark.parametrize(("likelier", "judged"), [(3.0, 3.0), (0.0, 0.0), (-100.0, 0.0)])
def test_a_fit_that_is_led_to_its_end_does_not_lose_where_all_recordings_are_likelier(
    likelier: float, judged: float
) -> None:
    """Ends that leave as much of the fitted recordings may foretell the others differently by a hundred units."""
    known, made, world = settled(likelier)
    assert made.fit.converged
    assert made.log_evidence - world.made((FRICTION,)).log_evidence == pytest.approx(judged)
    assert known[made.keys] is made


def test_a_second_try_does_not_lose_where_all_recordings_are_likelier() -> None:
    world = World(by({FRICTION.key: 4e3}))
    known = begun_in(world, [FRICTION]).known
    model = world.made((FRICTION,))
    model.fit.converged = False
    known.keep(model)

    def retried(model: Any, reach: float = math.inf) -> Any:
        made = world.made(model.effects)
        made.log_evidence -= 100.0
        made.judged_as = lambda other: SimpleNamespace(**{**vars(made), "log_evidence": other.log_evidence})
        return made

    world.retried = retried  # type: ignore[method-assign]
    made = known.confirmed(model)
    assert made.fit.converged
    assert made.log_evidence == model.log_evidence


def test_a_fit_that_takes_the_place_of_one_that_has_ended_is_led_to_its_end_too() -> None:
    known, made, world = settled(3.0)
    assert known.settled(made) is made
    later = world.made((FRICTION,))
    later.fit.converged, later.log_evidence = False, made.log_evidence + 1.0
    known.keep(later)
    assert known.settled(later).fit.converged
    assert len(world.settlings) == 2


def test_what_the_last_moves_leave_on_its_way_is_led_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A closer fit of the best model may come last, from another model's parameters."""
    world = World(by({FRICTION.key: 4e3}))

    def evened(search: Any) -> None:
        later = world.made((FRICTION,), after=by({FRICTION.key: 3e3}))
        later.fit.converged = False
        search.known.keep(later)

    monkeypatch.setattr(Laws, "evened", evened)
    run(world, [FRICTION, *OTHERS])
    assert world.settlings == [frozenset({FRICTION.key})]


@pytest.mark.parametrize(
    ("more", "ends", "kept"), [(0.4, True, False), (0.6, True, True), (-0.4, False, True), (-0.6, False, False)]
)
def test_what_is_no_evidence_does_not_move_where_others_begin_from(more: float, ends: bool, kept: bool) -> None:
    """Half a unit is none. An end takes the place of what was left on its way, unless that is worth more."""
    world = World(by({FRICTION.key: 4e3}))
    known = begun_in(world, [FRICTION]).known
    first, second = world.made((FRICTION,)), world.made((FRICTION,))
    first.fit.converged = ends
    second.log_evidence = first.log_evidence + more
    known.keep(first)
    known.keep(second)
    assert (known[first.keys] is second) == kept


def test_every_model_that_takes_part_in_the_choice_is_fitted_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """One e^-5 times as probable as the best, tempered, is not near it and takes part; e^-9 times is no part of it."""
    world = World(by({FRICTION.key: 0.0}))
    part, none = effect("delay", "u"), effect("payload", "arm")

    def evened(search: Any) -> None:
        best = search.known.worth(search.known.leading[1])
        for late, behind in ((part, 5.0), (none, 9.0)):
            made = world.made((late,))
            made.log_evidence += best - behind * EVIDENCE.temperature - search.known.worth(made)
            made.fit.converged = False
            search.known.keep(made)

    monkeypatch.setattr(Laws, "evened", evened)
    run(world, [FRICTION, *OTHERS])
    assert 5.0 * EVIDENCE.temperature > SEARCH.effort + math.log(2 * (1 + len(OTHERS)))
    assert world.settlings == [frozenset({part.key})]


def test_what_is_not_akin_to_the_best_has_a_cost_to_reach_once_that_is_known() -> None:
    """And what the best may be told as has none: a simpler law at its place is compared with it however far it is."""
    pair = f"{STRIBECK.key} + {LAG.key}"
    world = World(by({STRIBECK.key: 2e4, FRICTION.key: 5e4, LAG.key: 5e5, pair: 0.0}))
    found = run(world, [STRIBECK, FRICTION, LAG, *OTHERS])
    assert found.known.best.keys == {STRIBECK.key, LAG.key}
    (first, *later) = world.reaches
    assert first == (frozenset({STRIBECK.key}), math.inf)
    assert {reach for keys, reach in later if keys == {FRICTION.key}} <= {math.inf}
    (lag,) = {reach for keys, reach in later if keys == {LAG.key} and math.isfinite(reach)}
    assert lag == pytest.approx(world.made((STRIBECK,)).fit.cost + 2 * (found.known.price + SEARCH.effort))


def test_what_had_no_turn_waits_until_a_second_effect_tells_what_it_is_to_reach() -> None:
    """Beside one effect that leaves much each would be fitted to its end; the pair leaves the noise, as none does."""
    pair = f"{STRIBECK.key} + {LAG.key}"
    world = World(by({STRIBECK.key: 2e4, FRICTION.key: 5e4, LAG.key: 5e5, pair: 0.0}))
    found = run(world, [STRIBECK, FRICTION, LAG, *OTHERS])
    early, *waited = (r for keys, r in world.reaches if len(keys) == 1 and keys & {c.key for c in OTHERS})
    assert early > 2e4
    assert len(waited) > 2
    nothing_more = world.made((STRIBECK, LAG)).fit.cost + 2 * (2 * found.known.price + SEARCH.effort)
    assert waited == pytest.approx([nothing_more] * len(waited))


def test_a_model_that_ended_twice_at_the_same_cost_is_not_begun_a_third_time() -> None:
    known = Board(World(by({LAG.key: 5.0})), World(by({})).refit, [LAG], None).known  # type: ignore[arg-type]
    begun = [replace(LAG, starts=({"p0": size},)) for size in (0.1, 0.2, 0.3)]
    assert [len(known.fit([((c,), [{}])], 1, whole=True)) for c in begun] == [1, 1, 0]
    known.fitter.excess_at_end = by({LAG.key: 9.0})  # type: ignore[attr-defined]
    joined = [replace(c, option="on the other side") for c in begun]
    assert [len(known.fit([((c,), [{}])], 1, whole=True)) for c in joined] == [1, 1, 0]  # another model


def test_what_looked_worse_after_a_few_steps_is_fitted_before_a_third_effect_is_sought() -> None:
    """On coarse recordings six effects come nearer than a short lag, which is what is missing; one of them is near."""
    others = OTHERS[:6]
    world = World(by({c.key: 3e3 if c is others[0] else 100.0 for c in others} | {LAG.key: 4e3}))
    world.excess_at_end = by({c.key: 3e3 if c is others[0] else 5e5 for c in others} | {LAG.key: 0.0})
    found = run(world, [*others, LAG])
    assert found.known.best.keys == {LAG.key}
    assert max(len(keys) for keys in world.fitted) == 2


def test_what_had_no_turn_is_fitted_to_the_end_if_it_acts_elsewhere_as_the_best_does() -> None:
    """A weight on the link is behind eight others after a few steps; the same weight at the base leads in the end."""
    here, there = effect("gravity", "link"), effect("gravity", "base")
    others = OTHERS[: SEARCH.finished]
    world = World(by({c.key: 100.0 for c in others} | {there.key: 50.0, here.key: 200.0}))
    world.excess_at_end = by({c.key: 500.0 for c in others} | {there.key: 100.0, here.key: 0.0})
    found = run(world, [*others, there, here])
    assert found.known.best.keys == {here.key}
    assert max(len(keys) for keys in world.fitted) == 1


def test_what_had_no_turn_and_is_not_akin_to_the_best_is_left() -> None:
    others = OTHERS[: SEARCH.finished]
    world = World(by({c.key: 100.0 for c in others} | {LAG.key: 200.0}))
    world.excess_at_end = by({c.key: 0.0 for c in others} | {LAG.key: 500.0})
    run(world, [*others, LAG])
    assert frozenset({LAG.key}) not in world.fitted


def test_where_the_best_leaves_much_all_laws_at_its_place_are_fitted() -> None:
    """Play promises nothing in proportion to its gap; where a hardening spring leaves much, it is tried."""
    hardening, play = effect("hardening_spring", "mount"), effect("backlash", "mount")
    elsewhere = effect("backlash", "gear")
    left = {hardening.key: 1e5, play.key: 0.0, elsewhere.key: 9e5}
    world = World(by(left), {play.key: -1.0, elsewhere.key: -1.0})
    found = run(world, [hardening, play, elsewhere, *OTHERS])
    assert found.known.best.keys == {play.key}
    assert {elsewhere.key} not in world.fitted[: world.fitted.index(frozenset({play.key}))]
    assert all(len(keys) < 3 for keys in world.fitted), "no third effect was sought"


def test_a_simpler_law_is_tried_beside_the_nuisance_that_made_the_richer_one_better() -> None:
    """Friction seems to have an edge at low speed for want of a weak lag; beside that the plain law does as well."""
    left = {FRICTION.key: 3e5, STRIBECK.key: 1.2e4}
    left |= {f"{law.key} + {LAG.key}": 7e3 for law in (FRICTION, STRIBECK)}
    world = World(by(left), {FRICTION.key: -1.0})
    run(world, [FRICTION, STRIBECK, LAG, *OTHERS])
    assert frozenset({STRIBECK.key, LAG.key}) in world.fitted
    assert frozenset({FRICTION.key, LAG.key}) in world.fitted


def test_where_a_second_effect_is_not_believed_no_third_is_sought() -> None:
    """Something is left that nothing explains: the search ends, it does not try triples."""
    world = World(by({FRICTION.key: 9e4}))
    found = run(world, [FRICTION, LAG, *OTHERS])
    assert found.known.best.keys == {FRICTION.key}
    assert max(len(keys) for keys in world.fitted) == 2


@pytest.mark.parametrize(("pair", "sought"), [(7e5, False), (1e5, True)])
def test_where_two_effects_explain_less_than_most_no_third_is_sought(pair: float, sought: bool) -> None:
    zone = effect("dead_zone", "v")
    rows = {FRICTION.key: 9e5, f"{FRICTION.key} + {LAG.key}": pair, f"{FRICTION.key} + {LAG.key} + {zone.key}": 0.0}
    world = World(by(rows))
    found = run(world, [FRICTION, LAG, zone, *OTHERS])
    assert (found.known.best.keys == {FRICTION.key, LAG.key, zone.key}) == sought
    assert any(len(keys) > 2 for keys in world.fitted) == sought


def test_a_second_effect_that_is_told_only_beside_a_third_does_not_end_the_search() -> None:
    """Beside a dead zone the lag owes little while the friction is missing, and the model is told as the dead zone."""
    zone = effect("dead_zone", "u")
    alone, pair = zone.key, f"{zone.key} + {LAG.key}"
    world = World(by({alone: 1e5, pair: 9e4, f"{pair} + {FRICTION.key}": 0.0}))
    found = run(world, [zone, LAG, FRICTION, *OTHERS[:4]])
    assert found.known.best.keys == {zone.key, LAG.key, FRICTION.key}


def test_a_pair_that_is_told_as_one_effect_is_extended_before_what_leads_less() -> None:
    """A sensor's bias leaves so much that the lag beside the dead zone counts as a nuisance until it is in."""
    zone, bias = effect("dead_zone", "u"), effect("sensor_bias", "sensor")
    alone, pair = zone.key, f"{zone.key} + {LAG.key}"
    world = World(by({alone: 1e5, LAG.key: 5e5, pair: 9e4, f"{pair} + {bias.key}": 0.0}))
    found = run(world, [zone, LAG, bias, *OTHERS])
    assert found.known.best.keys == {zone.key, LAG.key, bias.key}
    before = world.fitted[: world.fitted.index(found.known.best.keys)]
    assert all(zone.key in keys for keys in before if len(keys) == 2)


def test_two_weak_effects_beside_a_strong_one_are_found_though_each_alone_owes_too_little() -> None:
    """Beside a dead zone that explains nearly all: neither is told without the other, and both together leave noise."""
    zone, joint = effect("dead_zone", "u"), effect("joint_flexibility", "joint")
    pair = f"{zone.key} + {joint.key}"
    world = World(by({zone.key: 5e3, pair: 3e3, f"{pair} + {FRICTION.key}": 0.0}))
    found = run(world, [zone, joint, FRICTION, *OTHERS[:4]])
    assert found.known.best.keys == {zone.key, joint.key, FRICTION.key}


def test_where_no_pair_explains_all_effects_that_lead_less_are_extended_before_a_third_is_sought() -> None:
    """Four single effects leave less than the lag, as a limit of the rate did; only beside the lag is there a pair."""
    left = {c.key: 5e5 + 1e4 * k for k, c in enumerate(OTHERS[:4])}
    world = World(by(left | {LAG.key: 6e5, f"{LAG.key} + {FRICTION.key}": 0.0}))
    found = run(world, [*OTHERS[:4], LAG, FRICTION])
    assert found.known.best.keys == {LAG.key, FRICTION.key}
    assert max(len(keys) for keys in world.fitted) == 2


def test_a_third_effect_is_sought_beside_the_pair_that_leads_before_anything_else() -> None:
    """Before three that explain all are known no pair without the first one is fitted, and no single effect more."""
    zone = effect("dead_zone", "v")
    pair = f"{FRICTION.key} + {LAG.key}"
    world = World(by({FRICTION.key: 5e5, pair: 1e5, f"{pair} + {zone.key}": 0.0}))
    found = run(world, [FRICTION, LAG, zone, *OTHERS])
    assert found.known.best.keys == {FRICTION.key, LAG.key, zone.key}
    before = world.fitted[: world.fitted.index(found.known.best.keys)]
    assert {keys for keys in before if len(keys) == 2 and FRICTION.key not in keys} == set()
    assert len([keys for keys in before if len(keys) == 1]) <= SEARCH.finished


def test_of_effects_that_change_recordings_alike_one_is_extended() -> None:
    """Six of a kind lead alone, as many as are extended, and only the friction that leads less has a partner."""
    kin = [effect(f"delay_{k}", f"signal {k}") for k in range(SEARCH.parents)]
    shapes = {c.key: (0.0, 1.0) for c in kin} | {FRICTION.key: (1.0, 0.0)}
    left = {c.key: 5e5 + 1e4 * k for k, c in enumerate(kin)}
    world = Beside(by(left | {FRICTION.key: 8e5, f"{FRICTION.key} + {LAG.key}": 0.0}), LAG, FRICTION, shapes)
    found = run(world, [*kin, FRICTION, LAG])
    assert found.known.best.keys == {FRICTION.key, LAG.key}
    assert max(len(keys) for keys in world.fitted) == 2


def test_where_two_of_three_effects_imitate_one_the_pair_with_that_is_found() -> None:
    """The rate limit leads alone, and explains all beside the friction if a delay helps it; the lag needs none."""
    limit, delay = effect("rate_limit", "v"), effect("delay", "v")
    rows = {limit.key: 4e5, FRICTION.key: 6e5, LAG.key: 9e5, f"{limit.key} + {FRICTION.key}": 5e4}
    rows |= {f"{limit.key} + {FRICTION.key} + {delay.key}": 0.0, f"{LAG.key} + {FRICTION.key}": 0.0}
    found = run(Beside(by(rows), LAG, FRICTION), [limit, FRICTION, delay, *OTHERS, LAG])
    assert found.known.best.keys == {LAG.key, FRICTION.key}


def test_a_pair_that_is_far_from_the_best_is_not_extended_by_a_third_effect() -> None:
    """The friction and the lag lead; the lag and a dead zone leave twice as much, and are left as they are."""
    zone = effect("dead_zone", "v")
    rows = {FRICTION.key: 5e5, LAG.key: 6e5, f"{FRICTION.key} + {LAG.key}": 1e5, f"{LAG.key} + {zone.key}": 2e5}
    world = World(by(rows))
    run(world, [FRICTION, LAG, zone, *OTHERS])
    triples = [keys for keys in world.fitted if len(keys) == 3]
    assert triples
    assert all({FRICTION.key, LAG.key} < keys for keys in triples)


def test_beside_another_an_effect_is_fitted_in_every_way() -> None:
    """The side that promises least may be the one that fits best, once the other effect is in."""
    sides = [effect("joint_flexibility", "joint", option=f"side {k}") for k in range(4)]
    names = [f"{s.key} {s.option}" for s in sides]
    left = {FRICTION.key: 3e5} | dict.fromkeys(names, 4e5)
    left |= {f"{FRICTION.key} + {n}": 5e4 for n in names} | {f"{FRICTION.key} + {names[3]}": 0.0}
    promise = {n: 90.0 - k for k, n in enumerate(names)}
    world = World(by(left), promise)
    found = run(world, [FRICTION, *sides, *OTHERS])
    best = found.known.best
    assert best.keys == {FRICTION.key, sides[0].key}
    assert [c.option for c in best.effects if c.effect == "joint_flexibility"] == ["side 3"]


def test_a_richer_law_that_promised_nothing_is_tried_from_where_the_simpler_one_ended() -> None:
    world = World(by({FRICTION.key: 1e5, STRIBECK.key: 0.0}), {STRIBECK.key: -1.0})
    found = run(world, [FRICTION, STRIBECK, *OTHERS])
    assert found.known.best.keys == {STRIBECK.key}
    begun = next(c for c in found.known.best.effects)
    assert begun.starts[0]["p0"] == 0.2  # where the simpler law ended; what it has not stays at its start
    assert begun.starts[0]["p2"] == 0.1


def test_a_richer_law_that_leaves_more_than_the_simpler_one_is_tried_from_where_that_ended() -> None:
    """The richer one contains the simpler, and could not leave more if its fit had not lost its way."""

    class LosesItsWay(World):
        def finish(self, partial: PartialFit, reach: float = math.inf) -> Any:
            lost = {c.key for c in partial.effects} == {STRIBECK.key} and partial.effects[0].starts[0]["p0"] == 0.1
            made = self.made(partial.effects, after=by({}, 1e5) if lost else None)
            self.fitted.append(made.keys)
            return made

    world = LosesItsWay(by({FRICTION.key: 1e4, STRIBECK.key: 0.0}))
    found = run(world, [FRICTION, STRIBECK, *OTHERS], most=1)
    assert world.fitted.count(frozenset({STRIBECK.key})) == 2
    assert found.known.best.keys == {STRIBECK.key}
    assert found.known.best.left.energy[0] == COUNT


def test_a_richer_law_is_tried_before_a_third_effect_is_sought() -> None:
    """Alone the richer law does no better than the simpler one; beside the lag it explains all."""
    rows = {
        FRICTION.key: 4e5,
        STRIBECK.key: 4e5,
        f"{FRICTION.key} + {LAG.key}": 1e5,
        f"{STRIBECK.key} + {LAG.key}": 0.0,
    }
    world = World(by(rows), {STRIBECK.key: 10.0})
    found = run(world, [FRICTION, LAG, STRIBECK, *OTHERS])
    assert found.known.best.keys == {STRIBECK.key, LAG.key}
    assert all(len(keys) < 3 for keys in world.fitted)


def test_the_order_of_a_wave_is_chosen_anew_beside_a_richer_law() -> None:
    """Beside Coulomb friction the second order comes closer, beside Stribeck friction, once fitted, the third."""
    starts = tuple({"order": order, "amplitude": 0.1, "phase": 0.0} for order in (2.0, 3.0))
    wave = replace(effect("torque_ripple"), starts=starts, wave=Wave("amplitude", "phase", starts))
    raced: list[tuple[dict[str, float], ...]] = []

    class Waves(World):
        def partial_fit(self, effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
            if effects[0].key == STRIBECK.key and effects[0].starts[0]["p2"] == 0.2:  # where it ended
                raced.append(effects[-1].starts)
            return super().partial_fit(effects, parents)

    rows = {FRICTION.key: 3e5, f"{FRICTION.key} + {wave.key}": 5e4, f"{STRIBECK.key} + {wave.key}": 4e4}
    made = begun_in(Waves(by(rows)), [FRICTION, STRIBECK, wave])
    made.first.begin()
    found = made.known.fit([((FRICTION, replace(wave, starts=starts[:1])), [{}])], 1)
    raced.clear()
    made.laws.enriched(found[0])
    assert raced == [starts]


def test_what_a_richer_law_has_of_a_size_s_kind_keeps_its_ratio_to_it() -> None:
    """Stribeck friction from Coulomb friction that was found to be 6: static friction half as large again."""
    rows = [("coulomb_friction", 4.0), ("static_friction", 4.0), ("stribeck_velocity", 0.1)]
    starts = tuple(
        {"coulomb_friction": s, "static_friction": 1.5 * s, "stribeck_velocity": v}
        for s in (1.0, 20.0)
        for v in (0.1, 2.0)
    )
    parameters = tuple(EffectParameter(name, reference) for name, reference in rows)
    law = Candidate("stribeck_friction", "shaft", "shaft", "found_law", lambda sizes: [], parameters, starts)
    assert _grown_from({"coulomb_friction": 6.0}, law) == (
        {"coulomb_friction": 6.0, "static_friction": 9.0, "stribeck_velocity": 0.1},
        {"coulomb_friction": 6.0, "static_friction": 9.0, "stribeck_velocity": 2.0},
    )


def test_beside_the_best_pair_what_promised_least_alone_is_looked_at_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """An offset promises nothing while a delay and a payload are missing, and leaves the noise beside both."""
    others = [effect(f"other_{k}", f"place {k}") for k in range(SEARCH.beside)]
    payload, offset = effect("payload", "link"), effect("offset", "w")
    left = {LAG.key: 5e5, payload.key: 9e5, f"{LAG.key} + {payload.key}": 1e5}
    world = World(by(left | {f"{LAG.key} + {payload.key} + {offset.key}": 0.0}))

    def courses(origin: Any, c: Candidate) -> list[Any]:
        alone = -1.0 if c is offset else 60.0 if c in others else 70.0
        return [SimpleNamespace(likelihood=80.0 if c is offset and len(origin.effects) == 2 else alone, values=NONE)]

    seen_as(monkeypatch, courses)
    found = run(world, [LAG, payload, *others, offset])
    assert found.known.best.keys == {LAG.key, payload.key, offset.key}


def test_what_only_shows_once_something_larger_is_in_is_sought_then() -> None:
    """No order of a cogging stands out in what the user's model leaves; one does in what friction leaves."""
    cogging = effect("cogging")
    world = World(by({FRICTION.key: 3e5, f"{FRICTION.key} + {cogging.key}": 0.0}), {cogging.key: 60.0})
    listed = [FRICTION, *OTHERS]
    seen: list[Any] = []

    def beside(model: Any) -> list[Candidate]:
        seen.append(model.keys)
        return [*listed, cogging] if FRICTION.key in model.keys else listed

    made = begun_in(world, listed, beside)
    made.run(3)
    assert made.known.best.keys == {FRICTION.key, cogging.key}
    assert seen[0] == {FRICTION.key}


def test_frequencies_are_those_of_what_a_model_leaves_over() -> None:
    time = np.arange(0.0, 4.0, 0.01)
    left = {"run": np.sin(2 * math.pi * 3.0 * time)[:, None]}
    e = TimeExperiment(
        name="run",
        role="train",
        time=time,
        step=1e-3,
        every=10,
        drive=None,
        measured=left["run"],
        sigma=np.ones(1),
        from_first=(False,),
    )
    problem = SimpleNamespace(training=[e], free=(), residual=lambda x, e: left[e.name])
    model: Any = SimpleNamespace(effects=(), fit=SimpleNamespace(problem=problem, x=np.zeros(0)))
    nominal: Any = SimpleNamespace(free=(), residual=lambda x, e: 0 * left[e.name])
    scales = searching._seen_beside(OperatingScales(nominal), model)
    assert scales.lines[0] == pytest.approx(2 * math.pi * 3.0, rel=0.02)
    assert scales.tones[0] == pytest.approx(2 * math.pi * 3.0, rel=0.02)
    assert scales.residual(e) is left["run"]
    assert not OperatingScales(nominal).residual(e).any()


def test_laws_at_one_place_leave_their_turn_beside_another_effect_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three laws of a joint promise most and gain nothing; what explains all the rest acts elsewhere."""
    joints = [effect(name, "motor.shaft -> gear.in") for name in ("hysteresis", "hardening_spring", "backlash")]
    payload = effect("payload", "link")
    world = World(by({LAG.key: 1e5, payload.key: 8e5, f"{LAG.key} + {payload.key}": 0.0}))

    def courses(origin: Any, c: Candidate) -> list[Any]:
        alone, more = 900.0 if c is LAG else -1.0, 700.0 if c is payload else 800.0
        return [SimpleNamespace(likelihood=more if origin.effects else alone, values=NONE)]

    seen_as(monkeypatch, courses)
    found = run(world, [LAG, *joints, payload], 2)
    assert found.known.best.keys == {LAG.key, payload.key}


@pytest.mark.parametrize(("left", "tried"), [(0.0, True), (4e5, False)])
def test_what_explains_all_is_put_elsewhere_with_the_size_that_it_has(left: float, tried: bool) -> None:
    """Behind a gear usual sizes are four times as large; so is what was found, which promises nothing as it begins."""
    here = effect("hardening_spring", "joint")
    there = replace(effect("hardening_spring", "gear"), starts=({"p0": 0.4},))
    world = World(by({here.key: left, there.key: left}), {here.key: 3000.0, there.key: 1.0})
    begun = list[float]()
    before = world.partial_fit

    def partial_fit(effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
        begun.extend(c.starts[0]["p0"] for c in effects if c.key == there.key and len(effects) == 1)
        return before(effects, parents)

    world.partial_fit = partial_fit  # type: ignore[method-assign]
    run(world, [here, *OTHERS, there], 1)
    assert begun == ([pytest.approx(0.2 * 4)] if tried else [])


def test_where_a_joint_leaves_much_the_blocks_joined_there_are_looked_at() -> None:
    """Twenty effects promise more than the loss of a belt, which explains all where a joint at its end gains much."""
    joint, loss = effect("joint_flexibility", "gear.out -> load.shaft"), effect("structural_damping", "belt")
    elsewhere = effect("structural_damping", "other_belt")
    others = [effect(f"effect_{k}", f"place_{k}") for k in range(20)]
    world = World(by({joint.key: 3e5, loss.key: 0.0, elsewhere.key: 0.0}), {loss.key: 20.0, elsewhere.key: 20.0})
    run(world, [joint, *others, loss, elsewhere])
    assert frozenset({elsewhere.key}) not in world.fitted[: world.fitted.index(frozenset({loss.key}))]


def test_the_far_side_of_a_joint_is_a_place_beside_that_joint_alone() -> None:
    """Without it, both sides are one shaft, and the same friction would tie with itself."""
    joint = replace(
        effect("joint_flexibility", "drive -> load"),
        edits=lambda sizes: [Between("found_joint_flexibility", "SpringDamper", "drive", "a", "b")],
    )
    near, far = effect("viscous_friction", "drive"), effect("viscous_friction", "load")
    others = {f"{joint.key} + {near.key}": 2e5, f"{joint.key} + {far.key}": 0.0}
    world = World(by({joint.key: 4e5, near.key: 8e5, far.key: 8e5} | others))
    listed = [joint, near, *OTHERS]

    def beside(model: Any) -> list[Candidate]:
        return [*listed, far] if joint.key in model.keys else listed

    made = begun_in(world, listed, beside)
    made.run(3)
    assert made.known.best.keys == {joint.key, far.key}
    assert all(joint.key in keys for keys in world.fitted if far.key in keys)
    assert sum(c.key == far.key for c in made.board.listed) == 1


def test_a_node_is_cut_with_bodies_on_the_other_side_whose_parameters_are_far_off() -> None:
    """With the load on the wrong side the inertias of hub and load make up for it; the link's is where it was given."""

    def joint(*beside: str) -> Candidate:
        outer = next(end for end in ("hub.shaft", "arm.load.shaft", "link.hub", "end.shaft") if end not in beside)
        cut = Between("found_joint", "SpringDamper", "drive.shaft", "a", "b", {}, beside)
        return replace(effect("joint", f"drive.shaft -> {outer}", option=str(beside)), edits=lambda sizes: [cut])

    wrong, right = joint("hub.shaft"), joint("hub.shaft", "arm.load.shaft")
    listed = [wrong, right, joint(), joint("hub.shaft", "link.hub"), joint("link.hub", "arm.load.shaft")]
    left = {f"{c.key} {c.option}": 5e3 for c in listed} | {f"{right.key} {right.option}": 0.0}
    world = World(by(left))
    made = begun_in(world, listed)
    model = world.made((wrong,))
    made.known.keep(model)
    assert made.varying.cut_anew(model) is model
    model.far_off, model.bent_blocks = ["hub.inertia"], {"hub", "arm.load"}
    assert made.varying.cut_anew(model).effects[0].option == right.option
    assert world.options == {right.option, joint().option}
    assert all(
        start == {"p0": 0.2} for start in (m.sizes[0] for m in made.known.models if m.effects and m is not model)
    )


def test_what_does_as_well_alone_is_tried_beside_the_second_effect_too() -> None:
    """A lag of the sensor and one of the input tie alone; seven others promise more, so that neither is tried again."""
    sensor, gain = effect("sensor_lag", "sensor"), effect("uneven_gain", "v")
    left = {LAG.key: 1e5, sensor.key: 1e5, gain.key: 8e5}
    left |= {f"{c.key} + {gain.key}": 0.0 for c in (LAG, sensor)}
    world = World(by(left), {c.key: 60.0 for c in OTHERS} | {gain.key: 65.0})
    found = run(world, [LAG, sensor, gain, *OTHERS[: SEARCH.exchanged + 1]])
    odds = probabilities(told_as(found.known.models, world.refit), 20)
    assert odds[frozenset({LAG.key, gain.key})] == pytest.approx(0.5, abs=0.01)
    assert odds[frozenset({sensor.key, gain.key})] == pytest.approx(0.5, abs=0.01)


def test_where_one_model_has_a_turn_both_that_lead_after_a_few_steps_have_one() -> None:
    """Beside a strong effect, one leaves less of the largest errors, and one bends the parameters less."""
    strong, bending, right = effect("dead_zone", "u"), effect("extra_mode", "drive"), effect("payload", "link")
    world = World(by({f"{strong.key} + {right.key}": 0.0, f"{strong.key} + {bending.key}": 30.0}))
    begun = world.partial_fit

    def partial_fit(effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
        made = begun(effects, parents)
        white = {bending.key: 1.0, right.key: 10.0}.get(effects[-1].key, 50.0)
        return replace(made, point=replace(made.point, cost=white))

    world.partial_fit = partial_fit  # type: ignore[method-assign]
    known = tried_models.TriedModels(world, world.refit, 20)  # type: ignore[arg-type]
    tasks: list[Any] = [((strong, c), [{}]) for c in (bending, right, *OTHERS)]
    made = known.fit(tasks, 1)
    assert {m.keys for m in made} == {frozenset({strong.key, c.key}) for c in (bending, right)}
    assert len(known.dropped) == len(OTHERS)


@pytest.mark.parametrize(("apart", "turns"), [(0.5, 2), (4.0, 1)])
def test_what_comes_as_close_as_a_leader_but_for_what_is_no_evidence_has_a_turn(apart: float, turns: int) -> None:
    """A delay after a few steps beside a lag: either may be the better one at the end."""
    delay = effect("delay", "u")
    world = World(by({LAG.key: 0.0, delay.key: 2 * apart * SEARCH.effort}))
    known = tried_models.TriedModels(world, world.refit, 20)  # type: ignore[arg-type]
    assert len(known.fit([((c,), [{}]) for c in (LAG, *OTHERS, delay)], 1)) == turns


@pytest.mark.parametrize("finish", [1, 8, 14])
def test_what_comes_as_close_as_a_leader_does_not_wait_for_others(finish: int) -> None:
    """Two laws at one place: the second stands behind all other places, whose models come nowhere near."""
    laws = [effect(f"law_{k}", "joint") for k in range(2)]
    world = World(by({LAG.key: 0.0} | {law.key: 1.0 + k for k, law in enumerate(laws)}))
    known = tried_models.TriedModels(world, world.refit, 20)  # type: ignore[arg-type]
    known.fit([((c,), [{}]) for c in (LAG, *laws, *OTHERS)], finish)
    assert {frozenset({law.key}) for law in laws} <= set(world.fitted)
    assert not [p for p in (*known.waiting, *known.dropped) if p.effects[0].place == "joint"]


def test_what_promised_most_has_a_turn_whatever_a_few_steps_have_brought() -> None:
    strong, quick, right = effect("dead_zone", "u"), effect("gravity", "link"), effect("offset", "u")
    world = World(by({f"{strong.key} + {quick.key}": 30.0}))
    known = tried_models.TriedModels(world, world.refit, 20)  # type: ignore[arg-type]
    tasks: list[Any] = [((strong, c), [{}]) for c in (right, quick, *OTHERS)]
    made = known.fit(tasks, 1)
    assert {m.keys for m in made} == {frozenset({strong.key, c.key}) for c in (right, quick)}


def test_where_no_pair_explains_all_those_that_had_no_turn_beside_the_best_are_fitted_to_the_end() -> None:
    """A dead zone beside backlash: after a few steps another effect leaves less, and gains little more."""
    gap, zone, quick = effect("backlash", "joint"), effect("dead_zone", "u"), effect("hysteresis", "gear")
    pair = f"{gap.key} + {zone.key}"
    left = {c.key: 4e5 + 1e4 * k for k, c in enumerate(OTHERS[:8])}
    left |= {gap.key: 3e5, pair: 2.8e5, f"{gap.key} + {quick.key}": 2.5e5}
    world = World(by(left), {OTHERS[0].key: 70.0, zone.key: 60.0})
    world.excess_at_end = by(left | {pair: 0.0})
    assert run(world, [gap, zone, quick, *OTHERS], 2).known.best.keys == {gap.key, zone.key}


def test_of_nuisances_beside_a_rival_no_simpler_laws_are_fitted() -> None:
    """Either of two further bodies may be a nuisance beside the friction; that of the best model is looked into."""
    modes = [effect("extra_mode", place, sizes=3) for place in ("arm", "leg")]
    plain = [effect("viscous_friction", place) for place in ("arm", "leg")]
    left = {FRICTION.key: 5e3} | {f"{FRICTION.key} + {mode.key}": 1e3 + k for k, mode in enumerate(modes)}
    world = World(by(left))
    made = begun_in(world, [FRICTION, *modes, *plain])
    for effects in ((FRICTION,), (FRICTION, modes[0]), (FRICTION, modes[1])):
        made.known.keep(world.made(effects))
    made.first.begun = False
    made.run(3)
    assert made.known.best.keys == {FRICTION.key}
    assert frozenset({FRICTION.key, plain[0].key}) in world.fitted
    assert frozenset({FRICTION.key, plain[1].key}) not in world.fitted


def test_at_last_what_was_only_chosen_of_a_rival_is_chosen_anew() -> None:
    """Over a short way waves of two and three a turn are alike: which leaves less is told by the whole fit."""
    rows = (EffectParameter("order", 1.0, fixed=True), EffectParameter("amplitude", 1.0))
    starts = tuple({"order": order, "amplitude": 0.1} for order in (2.0, 3.0))
    ripple = replace(effect("torque_ripple"), parameters=rows, starts=starts)

    tried: list[float] = []

    class Waves(World):
        def finish(self, partial: PartialFit, reach: float = math.inf) -> Any:
            waves = [c.starts[0]["order"] for c in partial.effects if c.key == ripple.key]
            tried.extend(waves if len(partial.effects) == 1 else [])
            self.excess_at_end = by({ripple.key: 12.0 if waves == [2.0] else 1.0, LAG.key: 2.0})
            return super().finish(partial, reach)

    world = Waves(by({ripple.key: 12.0, LAG.key: 2.0}))
    found = run(world, [ripple, LAG, *OTHERS])
    assert found.known.best.keys == {ripple.key}
    assert found.known.best.sizes[0]["order"] == 3.0
    assert tried == [2.0, 3.0], "what was fitted to its end is not fitted again"


def test_at_last_what_changes_recordings_alike_is_put_in_the_place_of_a_rivals_effect() -> None:
    """Friction that differs between the directions is one with an offset, and over a short way so is gravity."""
    both = effect("direction_dependent_friction", sizes=2)
    offset, gravity = effect("offset", "u"), effect("gravity", "arm")
    table = {both.key: 0.0, f"{FRICTION.key} + {offset.key}": 1.0, f"{FRICTION.key} + {gravity.key}": 1.0}
    shapes = {offset.key: (0.0, 1.0), gravity.key: (0.1, 1.0)}
    world = Beside(by(table), gravity, FRICTION, shapes)
    found = run(world, [both, FRICTION, offset, *OTHERS, gravity])
    assert found.known.best.keys == {both.key}
    assert frozenset({FRICTION.key, gravity.key}) in found.known


def test_at_last_each_effect_is_taken_away_once_more() -> None:
    """A pair came from elsewhere, and one of its effects explains nothing beside the other: that one alone is told."""
    zone = effect("dead_zone", "u")
    world = World(by({zone.key: 0.0, LAG.key: 8e5, f"{zone.key} + {LAG.key}": 0.0}))
    made = begun_in(world, [LAG])
    made.known.keep(world.made((LAG, zone)))
    made.run(3)
    assert made.known.best.keys == {zone.key}


@pytest.mark.parametrize(("simple", "again"), [(100.0, True), (9e5, False)])
def test_a_simpler_law_that_does_most_of_what_the_richer_one_does_is_tried_again(simple: float, again: bool) -> None:
    """It may have ended at a jump of the cost; what does next to nothing has not."""
    world = World(by({FRICTION.key: simple, STRIBECK.key: 0.0}))
    made = begun_in(world, [FRICTION, STRIBECK])
    made.known.keep(world.made((STRIBECK,)))
    rich = world.made((STRIBECK,))
    made.laws.simplified(rich)
    assert (frozenset({FRICTION.key}) in world.retries) == again
    # A cost from which it would owe the richer law more than a nuisance may.
    owed = EVIDENCE.share * (energy(world.refit) - energy(rich))
    assert world.retry_reaches == pytest.approx(
        [rich.cost + owed + 2 * (made.known.price + SEARCH.effort)] * len(world.retries)
    )


def test_a_simpler_law_keeps_its_own_start_where_the_richer_one_ended_at_nothing() -> None:
    """A cubic spring's linear part, which is the user's, may be fitted to nothing; a size has a logarithm."""
    world = World(by({FRICTION.key: 3e5, STRIBECK.key: 0.0}))
    begun: list[dict[str, float]] = []
    put_in = world.partial_fit

    def partial_fit(effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
        begun.extend(c.starts[0] for c in effects if c.effect == FRICTION.effect)
        return put_in(effects, parents)

    world.partial_fit = partial_fit  # type: ignore[method-assign]
    made = begun_in(world, [FRICTION, STRIBECK])
    rich = world.made((STRIBECK,))
    rich.fit.parameters = lambda: {f"{STRIBECK.name}.p0": 0.0}
    made.laws.simplified(rich)
    assert begun == [{"p0": 0.1}]


def test_rivals_get_the_nuisances_that_fit_beside_the_best() -> None:
    """A lag gains a little beside either effect: without it beside the rival, that would lose by the lag alone."""
    offset = effect("offset", "u")
    left = {FRICTION.key: 300.0, offset.key: 310.0, f"{FRICTION.key} + {LAG.key}": 250.0, LAG.key: 9e5}
    left |= {f"{offset.key} + {LAG.key}": 255.0}
    world = World(by(left))
    made = begun_in(world, [FRICTION, offset, LAG])
    for effects in ((FRICTION,), (offset,), (FRICTION, LAG)):
        made.known.keep(world.made(effects))
    made.laws.evened()
    assert {offset.key, LAG.key} in world.fitted
    odds = probabilities(told_as(made.known.models, made.known.refit), made.known.tried)
    assert odds[frozenset({offset.key})] > 0.05
    assert math.isclose(sum(odds.values()), 1.0)


def test_a_pair_that_is_one_law_has_room_for_two_nuisances() -> None:
    """Coulomb friction with an offset does what friction that differs between the directions does: both get them."""
    rich, offset, scale = effect("direction_dependent_friction", sizes=2), effect("offset", "u"), effect("gain", "s")
    nuisances = f"{LAG.key} + {scale.key}"
    both = f"{FRICTION.key} + {offset.key}"
    world = World(
        by({rich.key: 300.0, f"{rich.key} + {nuisances}": 250.0, both: 301.0, f"{both} + {nuisances}": 251.0})
    )
    made = begun_in(world, [rich, FRICTION, offset, LAG, scale])
    for effects in ((rich,), (FRICTION, offset), (rich, LAG, scale)):
        made.known.keep(world.made(effects))
    made.laws.evened()
    odds = probabilities(made.known.told, made.known.tried)
    assert odds[frozenset({FRICTION.key, offset.key})] > 0.05


def test_models_that_were_known_are_fitted_again_from_where_they_ended() -> None:
    world = World(by({FRICTION.key: 0.0}))
    made = begun_in(world, [])
    made.placing.fit_known([world.made((FRICTION,))])
    assert world.fitted == [frozenset({FRICTION.key})]
    assert made.known.best.effects[0].starts == ({"p0": 0.2},)


def test_beside_a_known_model_that_explains_all_other_first_effects_are_fitted_too() -> None:
    """Hysteresis explained all of other recordings; in these a joint, of which nothing was known, does as well."""
    joint = effect("joint_flexibility", "joint")
    world = World(by({FRICTION.key: 10.0, joint.key: 0.0}))
    made = begun_in(world, [FRICTION, joint])
    made.placing.fit_known([world.made((FRICTION,))])
    made.first.begin()
    assert made.known.best.keys == {joint.key}


def test_a_known_model_that_cannot_begin_where_it_ended_begins_anew_effect_by_effect() -> None:
    """A fit may end at a size that is faster than one may begin from."""
    world = World(by({f"{FRICTION.key} + {LAG.key}": 0.0}))
    put_in = world.partial_fit

    def partial_fit(effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
        if any(c.key == LAG.key and c.starts == ({"p0": 0.2},) for c in effects):
            raise FlexarmError("it would move faster than these recordings can show")
        return put_in(effects, parents)

    world.partial_fit = partial_fit  # type: ignore[method-assign]
    made = begun_in(world, [FRICTION, LAG])
    made.placing.fit_known([world.made((FRICTION, LAG))])
    assert world.fitted == [frozenset({FRICTION.key, LAG.key})]
    assert made.known.best.keys == {FRICTION.key, LAG.key}


def test_what_could_not_begin_once_and_was_fitted_then_counts_as_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(by({FRICTION.key: 0.0}))
    found = run(world, [FRICTION, LAG])
    found.known.failures += [(FRICTION.key, "too fast"), ("gravity at arm", "no place"), ("gravity at arm", "no place")]
    monkeypatch.setattr(searching, "Study", lambda *fields, **more: SimpleNamespace(failures=fields[9]))
    world.recordings = ()  # type: ignore[attr-defined]
    assert found.study((1.0, 1.0), None, ()).failures == (("gravity at arm", "no place"),)


def test_the_best_model_is_tried_again_if_its_fit_did_not_converge() -> None:
    world = World(by({FRICTION.key: 0.0}))
    world.bad = {frozenset({FRICTION.key})}
    found = run(world, [FRICTION, *OTHERS])
    assert world.retries == [frozenset({FRICTION.key})]
    assert found.known.best.fit.converged


@pytest.mark.parametrize("bent", [True, False])
def test_the_best_model_is_begun_again_with_its_parameters_drawn_back_where_they_are_bent(bent: bool) -> None:
    """Its parameters may make up for a delay that ended a little off."""
    world = World(by({LAG.key: 4e3}))
    known = begun_in(world, [LAG]).known
    model = world.made((LAG,))
    model.bent, model.fit.problem.free, model.fit.x = bent, (FreeParameter("a", 1.0, 0.1, True, 0.0),), (7.0,)
    known.keep(model)
    begun: list[Any] = []
    put_in = world.partial_fit

    def partial_fit(effects: tuple[Candidate, ...], parents: Any) -> PartialFit:
        begun.append((effects[0].starts, parents))
        return put_in(effects, parents)

    world.partial_fit = partial_fit  # type: ignore[method-assign]
    world.excess_at_end = by({LAG.key: 0.0})
    for _ in range(2):
        assert known.confirmed(known[frozenset({LAG.key})]).fit.cost == COUNT + 4e3 * (not bent)
    within = FreeParameter("a", 1.0, 0.1, True, 0.0).value(SEARCH.drawn)
    assert begun == ([(({"p0": 0.2},), [{"a": pytest.approx(within)}])] if bent else [])


def test_a_model_that_leaves_little_but_misses_recordings_is_tried_again() -> None:
    """Contacts that bounce: half a per cent is left, three times the noise, and a second try ends at the noise."""
    world = World(by({FRICTION.key: 3e3}, otherwise=1e6))
    made = begun_in(world, [FRICTION])
    made.known.keep(world.made((FRICTION,)))
    world.excess = by({FRICTION.key: 0.0})
    made.known.confirmed(made.known.best)
    assert world.retries == [frozenset({FRICTION.key})]
    assert made.known.best.hold_out == pytest.approx(1.0)


def test_what_cannot_be_fitted_is_told_and_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(by({FRICTION.key: 0.0, LAG.key: 9e4}))
    real = world.finish

    def finish(partial: PartialFit, reach: float = math.inf) -> Any:
        if partial.effects[-1] is FRICTION:
            raise FlexarmError("it follows coarse recordings only")
        return real(partial)

    monkeypatch.setattr(world, "finish", finish)
    found = run(world, [FRICTION, LAG])
    assert found.known.best.keys == {LAG.key}
    assert (FRICTION.key, "it follows coarse recordings only") in found.known.failures


@pytest.mark.parametrize(("gain", "best"), [(100.0, LAG.key), (2.0, "")])
def test_the_best_by_training_alone_need_not_follow_what_was_held_out(gain: float, best: str) -> None:
    """A limit that only held-out recordings reach hides there that the lag is right; chance alone has no such gain."""
    world = World(by({}))
    known = tried_models.TriedModels(world, world.refit, 40)  # type: ignore[arg-type]
    world.refit.fit.cost = 1000.0
    made = world.made((LAG,), after=by({LAG.key: 2e6}))
    made.fit.cost = 1000.0 - 2 * gain
    known.keep(made)
    assert known.best.keys == frozenset()
    assert known.best_fitted.keys == frozenset(filter(None, [best]))


class Steady(World):
    """What is missing shows in both recordings alike."""

    def left(self, excess: float) -> Leftover:
        made = super().left(excess)
        return replace(made, energies=np.array([made.energy / 2, made.energy / 2]))


@pytest.mark.parametrize(("remains", "found"), [(5 * COUNT, True), (0.5 * COUNT, False)])
def test_what_is_more_than_noise_is_looked_for_though_it_is_as_strong_in_all_recordings(
    remains: float, found: bool
) -> None:
    """The best single effect is not part of the truth; others are extended too, unless a sensor's noise may be it."""
    gravity, offset = effect("gravity"), effect("offset", "u")
    table = {gravity.key: remains, offset.key: 1.5 * remains, f"{offset.key} + {FRICTION.key}": 0.0}
    known = run(Steady(by(table, 20 * COUNT), {FRICTION.key: 100.0}), [gravity, offset, FRICTION, *OTHERS]).known
    assert (known.best.keys == {offset.key, FRICTION.key}) is found


def test_a_vibration_is_tried_elsewhere_at_the_frequency_that_it_has() -> None:
    """Begun at another frequency, a resonance's, the right place leaves nearly all."""

    def vibration(place: str) -> Candidate:
        made = effect("outside_vibration", place, sizes=2)
        first, second = made.parameters
        return replace(made, parameters=(first, replace(second, anywhere=True)))

    motor, load = vibration("motor"), vibration("load")
    started: list[tuple[float, ...]] = []

    class Resonant(World):
        def finish(self, partial: PartialFit, reach: float = math.inf) -> Any:
            (last,) = partial.effects[-1:]
            if last.key == load.key:
                started.append(tuple(start["p1"] for start in last.starts))
                self.excess_at_end = by({load.key: 0.0 if last.starts[0]["p1"] == 0.2 else 9e5, motor.key: 2e5})
            return super().finish(partial)

    world = Resonant(by({motor.key: 2e5, load.key: 9e5}))
    assert run(world, [motor, load, *OTHERS], 2).known.best.keys == {load.key}
    assert started[:2] == [(0.1,), (0.2,)]


def test_why_effects_were_refused_is_told_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads find out in any order; and what goes in one way is not refused because another does not."""
    friction, joint = effect("coulomb_friction"), effect("joint_flexibility", option="the other side")
    same = effect("joint_flexibility")
    world = World(by({"": 1e5}))
    given = {(joint.key, joint.option): "no inertia there", (LAG.key, ""): "too fast", (friction.key, ""): "no speed"}
    origin: Any = SimpleNamespace(likelihood=0.0, effects=(), refused=given)
    goes: list[Any] = [SimpleNamespace(likelihood=50.0)]
    seen_as(monkeypatch, lambda o, c: goes if c is same else [])
    made = begun_in(world, [friction, joint, same, LAG])
    made.placing.promises.screened([origin], made.board.listed)
    assert made.known.failures == [(friction.key, "no speed"), (LAG.key, "too fast")]


def test_what_did_far_better_alone_is_no_equal_of_the_weaker_effect_of_a_pair() -> None:
    """A lag explains most, and all laws of a joint that mimic it do nearly as well: none of them ties with the drag."""
    drag, bias = effect("quadratic_drag", "shaft"), effect("sensor_bias", "sensor")
    mimics = [effect(law, "joint") for law in ("hysteresis", "joint_flexibility", "hardening_spring")]
    world = World(by({LAG.key: 1e5, drag.key: 9e5, bias.key: 9e5} | {c.key: 1.1e5 for c in mimics}))
    made = begun_in(world, [])
    for c in (LAG, drag, bias, *mimics):
        made.known.keep(world.made((c,)))
    world.excess_at_end = by({f"{LAG.key} + {drag.key}": 0.0})
    made.known.keep(pair := world.made((LAG, drag), after=world.excess_at_end))
    made.varying.put_in_place_of_equals(pair)
    assert world.fitted == [frozenset({LAG.key, bias.key})]


def between_recordings(
    monkeypatch: pytest.MonkeyPatch,
    asked: Callable[[Any], bool],
    world: Any = None,
    listed: Sequence[Candidate] = (FRICTION, LAG, *OTHERS),
) -> Any:
    """A study whose recordings are exchanged, once, where a model asks for it; as its search left it.

    Args:
        asked: whether a model asks for it.
        world: friction and a lag are missing in it, if it is not given.
        listed: effects that are tried.
    """
    world = world or World(by({FRICTION.key: 1e5, f"{FRICTION.key} + {LAG.key}": 0.0}))
    world.base = SimpleNamespace(free=(), training=(), held_out=(), chi2=lambda x, e: 1.0)
    world.again = lambda recordings: world

    def exchanged(fitter: Any, model: Any, price: float, *, searched: bool) -> Any:
        return ([], "rec3 was fitted too") if asked(model) else None

    monkeypatch.setattr(searching, "operating_scales", lambda base: None)
    monkeypatch.setattr(searching, "_seen_beside", lambda scales, model: scales)
    monkeypatch.setattr(searching, "candidates", lambda scales, without: list(listed))
    monkeypatch.setattr(searching, "taken_otherwise", lambda fitter, model: None)
    monkeypatch.setattr(searching, "exchanged", exchanged)
    monkeypatch.setattr(
        searching._Search,
        "study",
        lambda self, before, scales, told: SimpleNamespace(
            notes=told, ended_early=self.ended_early, best=self.known.best.keys
        ),
    )
    monkeypatch.setattr(searching._Search, "add_curves", lambda self, named: False)
    return searching.study(world)


@pytest.mark.parametrize("begun", [True, False])
def test_a_held_out_recording_that_alone_shows_what_is_missing_is_asked_for_before_and_after_the_search(
    monkeypatch: pytest.MonkeyPatch, begun: bool
) -> None:
    """Where the first effect leaves nothing of the fitted recordings, no second one can be learned from them."""
    counted: list[int] = []
    run_all = searching._Search.run

    def run(self: Any, most: int) -> None:
        counted.append(most)
        run_all(self, most)

    monkeypatch.setattr(searching._Search, "run", run)
    found = between_recordings(monkeypatch, lambda model: begun or len(model.keys) == 2)
    assert list(found.notes) == ["rec3 was fitted too"]
    assert not found.ended_early
    assert len(counted) == (1 if begun else 2)


def test_only_models_near_the_best_go_on_in_other_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    """All others are looked at there anew, with what leads known."""
    went_on: list[list[frozenset[str]]] = []
    own = Placing.fit_known

    def fit_known(self: Any, models: Sequence[Any]) -> None:
        went_on.append([m.keys for m in models])
        own(self, models)

    monkeypatch.setattr(Placing, "fit_known", fit_known)
    world = World(by({FRICTION.key: 1e4, STRIBECK.key: 1e4 - 2, LAG.key: 5e5}))
    between_recordings(monkeypatch, lambda model: bool(model.effects), world, (FRICTION, STRIBECK, LAG))
    assert went_on[0] == []
    assert sorted(map(sorted, went_on[1])) == [[FRICTION.key], [STRIBECK.key]]


def test_that_a_search_was_cut_short_is_told_of_its_models_in_other_recordings_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    grow, cut = Growing.grow, [True]

    def once(self: Any, most: int) -> None:
        if cut:
            cut.pop()
            raise OutOfTime
        grow(self, most)

    monkeypatch.setattr(Growing, "grow", once)
    found = between_recordings(monkeypatch, lambda model: not cut)
    assert list(found.notes) == ["rec3 was fitted too"]
    assert found.ended_early
