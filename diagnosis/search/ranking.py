"""Effects in the order in which they are looked at and fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence

from diagnosis.effects.effect import Candidate


def best_ways(ranked: Sequence[Candidate]) -> list[Candidate]:
    """Of several ways to put an effect in at a place, the first."""
    found: dict[str, Candidate] = {}
    for c in ranked:
        found.setdefault(c.key, c)
    return list(found.values())


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


def ranked(able: Sequence[Candidate], promise: dict[int, float]) -> list[Candidate]:
    """Effects that can be put in, those that promise most first."""
    found = sorted(able, key=lambda c: -promise[id(c)])
    return [c for c in found if promise[id(c)] > -math.inf]
