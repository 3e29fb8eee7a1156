"""Effects in the order in which they are looked at and fitted."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from diagnosis.effects.effect import Candidate

T = TypeVar("T")


def best_ways(ranked: Sequence[Candidate]) -> list[Candidate]:
    """Of several ways to put an effect in at a place, the first."""
    found: dict[str, Candidate] = {}
    for c in ranked:
        found.setdefault(c.key, c)
    return list(found.values())


def by_turns(ranked: Sequence[T], of: Callable[[T], str]) -> list[T]:
    """The first of each place, or of whatever ``of`` tells, before all others.

    What is at one place is alike: in its own order one place would take all turns.
    """
    found: dict[str, T] = {}
    for one in ranked:
        found.setdefault(of(one), one)
    return [*found.values(), *(one for one in ranked if found[of(one)] is not one)]


def related(effect: Candidate, others: Sequence[Candidate]) -> bool:
    """Whether an effect acts at the place of one of the others, or is the same elsewhere."""
    return any(effect.place == c.place or effect.effect == c.effect for c in others)


def cut(effect: Candidate) -> tuple[str, str]:
    """Where an effect sits, and how it is put in there."""
    return effect.place, effect.option


def spoken_for(able: Sequence[Candidate]) -> tuple[list[Candidate], dict[tuple[str, str], list[Candidate]]]:
    """The effects to look at first, and by their cut those that wait for what another law promises there.

    A node of many flanges can be cut in tens of ways, for each law of a joint: the law with the fewest sizes speaks for
    the others, since what lies on either side matters more.
    """
    laws: dict[tuple[str, str], list[Candidate]] = {}
    for c in able:
        if c.option:
            laws.setdefault(cut(c), []).append(c)
    first = [c for c in able if not c.option]
    for place, there in laws.items():
        spokesman = min(there, key=lambda c: len(c.starts))
        first.append(spokesman)
        laws[place] = [c for c in there if c is not spokesman]
    return first, laws


def ranked(able: Sequence[Candidate], promise: Mapping[int, Sequence[float]]) -> list[Candidate]:
    """Effects that can be put in, those that promise most first.

    Args:
        able: effects.
        promise: by the identity of each, what it promises to gain at each of the points that fits begin from. Where
            parameters are bent for want of an effect, others promise more there; so the points take turns.
    """
    if not able:
        return []
    points = range(len(promise[id(able[0])]))
    orders = [sorted(able, key=lambda c, k=k: -promise[id(c)][k]) for k in points]  # type: ignore[misc]
    turns = {id(c): c for row in zip(*orders, strict=True) for c in row}
    return [c for c in turns.values() if max(promise[id(c)]) > -math.inf]
