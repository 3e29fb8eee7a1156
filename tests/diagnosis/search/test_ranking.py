"""Effects are ranked by what they promise at each point that fits begin from, in turn."""

from __future__ import annotations

import math

from diagnosis.effects.effect import Candidate
from diagnosis.search.ranking import ranked


def named(name: str) -> Candidate:
    return Candidate(name, "shaft", "shaft", name, lambda sizes: [], (), ({},))


def order(gains: dict[str, list[float]]) -> list[str]:
    listed = {name: named(name) for name in gains}
    return [c.effect for c in ranked(list(listed.values()), {id(c): gains[name] for name, c in listed.items()})]


def test_from_one_point_the_greatest_gain_comes_first_and_what_cannot_be_put_in_not_at_all() -> None:
    assert order({"drag": [3.0], "offset": [8.0], "cut": [-math.inf]}) == ["offset", "drag"]
    assert order({}) == []


def test_an_effect_that_promises_much_from_the_given_parameters_is_not_ranked_behind_all_that_do_from_bent_ones() -> (
    None
):
    """A payload in whose place all parameters are bent promises nothing beside them."""
    bent, payload = {f"e{k}": [20.0 - k, 1.0] for k in range(9)}, {"payload": [2.0, 100.0]}
    assert order(bent | payload)[:3] == ["e0", "payload", "e1"]


def test_where_it_cannot_be_put_in_at_one_point_the_other_counts() -> None:
    assert order({"drag": [3.0, 1.0], "delay": [-math.inf, 5.0]}) == ["drag", "delay"]
