"""Systems that differ in values alone share what is worked out from their equations, and nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blocks.actuators.friction import BearingFriction
from blocks.actuators.gear import Gear
from engine import alike
from engine.assemble import build as assembled
from engine.block import Block, flange, option, parameter
from engine.errors import ConnectionProblem, ParameterError, StructureError
from engine.model import Model
from engine.net import Net
from engine.simulate import simulate
from engine.system import Formula, System
from tests.engine.parts import Anchor, Body, Gearing, Spring, system


@pytest.fixture(autouse=True)
def nothing_kept() -> None:
    """Each test begins as a new process does."""
    alike._kept.clear()


def build(made: System, **options: Any) -> Model:
    """The model of one of many systems that are alike."""
    return assembled(made, variant=True, **options)


def swinging(stiffness: float, inertia: float = 0.5, **values: float) -> System:
    parts = {"m": Body(inertia=inertia), "s": Spring(stiffness=stiffness, **values), "end": Anchor()}
    return system(parts, ("m.shaft", "s.a"), ("s.b", "end.shaft"))


def course(model: Model) -> np.ndarray[Any, Any]:
    return simulate(model, 1.0, 0.1, initial={model.states[0].name: 0.3}).values


def test_other_values_have_the_same_equations_and_their_own_course() -> None:
    first, second = build(swinging(2.0)), build(swinging(7.0, 0.25))
    assert second.equations is first.equations
    assert second.law == first.law
    assert second.signature != first.signature
    assert second.parameter_values.tolist() == [0.25, 7.0, 0.0]
    fresh = assembled(swinging(7.0, 0.25))
    assert fresh.equations is not first.equations
    assert fresh.signature == second.signature
    assert np.array_equal(course(second), course(fresh))
    assert not np.array_equal(course(second), course(first))


def test_another_structure_has_its_own() -> None:
    first = build(swinging(2.0))
    others = [swinging(2.0) for _ in range(3)]
    others[0].initial["m.shaft.angle"] = 0.1
    others[1].name = "another"
    others[2].connections.reverse()
    for other in others:
        assert build(other).equations is not first.equations
    assert build(swinging(2.0), outputs=["m.shaft.angle"]).equations is not first.equations
    assert build(swinging(2.0), energy=True).equations is not first.equations
    assert build(swinging(2.0)).equations is first.equations


class Asking(Block):
    """A brake whose law asks for values in both ways, and has an option and a structural number."""

    level = parameter("N.m.s/rad", ..., "without it nothing brakes", ge=0)
    edge = parameter("1", 1.0, "above 2 it brakes twice", ge=0)
    count = parameter("1", 1, "number of times", structural=True)
    way = option(str, "plain", "way", choices=("plain", "other"))
    shaft = flange("braked")

    def stamp(self, net: Net) -> None:
        if not self.differs("level"):
            return
        twice = 2 if self.values["edge"] > 2 else 1
        net.force(self.shaft, -self.level * self.count * twice * self.shaft.speed)


def braked(**values: Any) -> Model:
    return build(system({"m": Body(inertia=1.0), "f": Asking(**values)}, ("m.shaft", "f.shaft")))


def test_what_the_law_asks_for_tells_whether_equations_are_shared() -> None:
    first = braked(level=1.0)
    assert braked(level=2.0).equations is first.equations
    assert braked(level=0.0).equations is not first.equations
    assert braked(level=0.0).equations is braked(level=0.0).equations
    for other in ({"edge": 1.5}, {"edge": 3.0}, {"count": 2}, {"way": "other"}):
        assert braked(level=1.0, **other).equations is not first.equations
    assert [p.name for p in braked(level=1.0, edge=3.0).parameters] == ["m.inertia", "f.level"]


def test_frictions_and_gears_of_the_library_share_theirs() -> None:
    def geared(level: float, stiffness: float) -> Model:
        parts = {
            "m": Body(inertia=1.0),
            "f": BearingFriction(coulomb_friction=level),
            "g": Gear(ratio=3.0, stiffness=stiffness),
            "load": Body(inertia=2.0),
        }
        return build(system(parts, ("m.shaft", "f.shaft", "g.input"), ("g.output", "load.shaft")))

    first = geared(1.0, 4.0)
    assert geared(0.5, 7.0).equations is first.equations
    assert len(geared(0.5, 0.0).states) < len(first.states)
    assert not geared(0.0, 4.0).modes


def test_a_ratio_that_shapes_the_coordinates_counts() -> None:
    def geared(ratio: float, inertia: float) -> Model:
        parts = {"m": Body(inertia=inertia), "g": Gearing(ratio=ratio), "s": Spring(stiffness=2.0), "end": Anchor()}
        return build(system(parts, ("m.shaft", "g.input"), ("g.output", "s.a"), ("s.b", "end.shaft")))

    first = geared(3.0, 1.0)
    assert geared(3.0, 5.0).equations is first.equations
    assert geared(4.0, 1.0).equations is not first.equations


class Weight(Block):
    """Inertia that may be nothing."""

    inertia = parameter("kg.m2", ..., "moment of inertia", ge=0)
    shaft = flange("the body")

    def stamp(self, net: Net) -> None:
        net.inertia(self.shaft, self.inertia)


def test_values_that_cannot_be_are_refused_as_ever() -> None:
    def weighted(inertia: float) -> Model:
        parts = {"m": Weight(inertia=inertia), "s": Spring(stiffness=1.0), "end": Anchor()}
        return build(system(parts, ("m.shaft", "s.a"), ("s.b", "end.shaft")))

    weighted(1.0)
    with pytest.raises(StructureError, match=r"m\.shaft.* has no inertia"):
        weighted(0.0)
    with pytest.raises(ParameterError, match="stiffness"):
        build(swinging(2.0)).parameter_vector({"s.stiffness": -1.0})


def test_shared_values_and_formulas_stay_what_they_were() -> None:
    def sprung(first: float, second: float, given: dict[str, str | Formula]) -> System:
        parts = {"a": Body(inertia=first), "s": Spring(stiffness=1.0), "b": Body(inertia=second)}
        made = system(parts, ("a.shaft", "s.a"), ("s.b", "b.shaft"))
        made.shared = {"a": given, "b": given}
        return made

    common: dict[str, str | Formula] = {"inertia": "J"}
    one, other = (build(sprung(value, value, common)) for value in (1.0, 2.0))
    assert other.equations is one.equations
    assert ("J", 2.0) in [(p.name, p.value) for p in other.parameters]
    with pytest.raises(ConnectionProblem, match=r"'J' is 1\.0 in a\.inertia but 2\.0 in b\.inertia"):
        build(sprung(1.0, 2.0, common))

    def followed(factor: float) -> Model:
        law = Formula("k J", {"J": ("kg.m2", 3.0)}, lambda known: factor * known["J"])
        return build(sprung(factor * 3.0, factor * 3.0, {"inertia": law}))

    assert followed(1.0).equations is not followed(2.0).equations


def test_what_moves_nothing_counts_in_the_energy_that_is_stored() -> None:
    """A body that nothing accelerates has no inertia in its equations; their stored energy holds its value."""
    first, second = (build(system({"m": Body(inertia=value)})) for value in (1.0, 2.0))
    assert not second.parameters
    assert second.equations is not first.equations


class Keeping(Body):
    """A body that keeps something besides its values."""

    def check(self) -> None:
        self.noted = "as read from a file"


def test_a_block_that_keeps_more_is_like_itself_alone() -> None:
    one, other = Keeping(inertia=1.0), Keeping(inertia=1.0)
    first = build(system({"m": one}))
    assert build(system({"m": one})).equations is first.equations
    assert build(system({"m": other})).equations is not first.equations


def test_only_so_many_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alike, "MOST", 2)
    monkeypatch.setattr(alike, "ALIKE", 2)
    for k in range(4):
        braked(level=1.0, edge=3.0 + k)
        build(system({f"m{k}": Body(inertia=1.0)}))
    assert len(alike._kept) == 2
    assert all(len(found) <= 2 for found in alike._kept.values())
