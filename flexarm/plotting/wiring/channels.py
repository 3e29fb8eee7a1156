"""Vertical tracks between two columns of a layout: one for each net, so that no two lie on each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

APART = 8.0
"""Vertical pieces on one track, and horizontal ones of two nets, are at least so far apart."""


@dataclass(frozen=True)
class Pin:
    """Where a line meets a column: a node, and its port."""

    node: str
    port: str


@dataclass(eq=False)
class Gap:
    """The piece of a link between two columns: its ends on the column to the left and on that to the right."""

    link: str
    left: list[Pin] = field(default_factory=list)
    right: list[Pin] = field(default_factory=list)


@dataclass(frozen=True)
class Lane:
    """Where a piece runs upright: on one track; or on two, joined at a height, where two lines change places."""

    first: int
    second: int | None = None
    height: float = 0.0

    @property
    def last(self) -> int:
        """The rightmost of its tracks."""
        return self.first if self.second is None else self.second


@dataclass(eq=False)
class _Trunk:
    """An upright piece: the heights of what comes from the left and of what goes to the right."""

    gap: Gap
    lefts: list[float]
    rights: list[float]
    after: _Trunk | None = None
    whole: bool = True

    @property
    def span(self) -> tuple[float, float]:
        every = self.lefts + self.rights
        return min(every), max(every)


def tracks(gaps: Sequence[Gap], height: Callable[[Pin, str], float]) -> dict[Gap, Lane]:
    """The lane of each gap, tracks counted from the left; straight lines need none.

    Args:
        gaps: the pieces between two columns.
        height: of a pin, on the side of its box that is named.
    """
    made: list[_Trunk] = []
    level: list[float] = []
    for gap in gaps:
        trunk = _Trunk(gap, [height(p, "right") for p in gap.left], [height(p, "left") for p in gap.right])
        low, high = trunk.span if gap.left or gap.right else (0.0, 0.0)
        level += trunk.lefts + trunk.rights
        straight = len(gap.left) == len(gap.right) == 1 and high - low < 0.5
        if len(trunk.lefts) + len(trunk.rights) > 1 and not straight:
            made.append(trunk)
    waiting = sorted(made, key=lambda t: _preference(t.lefts, t.rights))
    chosen: dict[_Trunk, int] = {}
    while waiting:
        ready = [t for t in waiting if not any(_before(o, t) for o in waiting)]
        cut = [] if ready else _split(waiting, level)
        if cut:
            waiting = cut
            continue
        trunk = (ready or waiting)[0]
        waiting.remove(trunk)
        track = max((n + 1 for o, n in chosen.items() if _before(o, trunk)), default=0)
        while any(n == track and _overlap(o.span, trunk.span) for o, n in chosen.items()):
            track += 1
        chosen[trunk] = track
    lanes: dict[Gap, Lane] = {}
    for trunk, track in chosen.items():
        if trunk.after is not None:
            lanes[trunk.gap] = Lane(chosen[trunk.after], track, trunk.lefts[0])
        elif trunk.gap not in lanes:
            lanes[trunk.gap] = Lane(track)
    return lanes


def _before(one: _Trunk, other: _Trunk) -> bool:
    """Whether ``one`` must lie left of ``other``, lest their horizontal pieces lie on each other."""
    return other.after is one if one.gap is other.gap else _meets(one.lefts, other.rights)


def _split(waiting: list[_Trunk], level: list[float]) -> list[_Trunk]:
    """The trunks with the first that can be cut in two cut, at a height where nothing else runs; empty if none can."""
    for i, trunk in enumerate(waiting):
        if trunk.whole and trunk.lefts and trunk.rights and any(_before(trunk, o) for o in waiting):
            low, high = trunk.span
            choices = [low + (high - low) * k / 16 for k in range(17)]
            choices += [end + sign * k * APART for k in (1.5, 3, 4.5, 6) for end, sign in ((high, 1), (low, -1))]
            cut = max(
                choices, key=lambda y: min(min(abs(y - v) for v in level), APART) - 1e-3 * abs(y - (low + high) / 2)
            )
            level.append(cut)
            left = _Trunk(trunk.gap, trunk.lefts, [cut], whole=False)
            right = _Trunk(trunk.gap, [cut], trunk.rights, left, whole=False)
            return [*waiting[:i], left, right, *waiting[i + 1 :]]
    return []


def _meets(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether horizontal pieces on the left and on the right would lie on each other."""
    return any(abs(a - b) < APART for a in one for b in other)


def _overlap(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] - APART < other[1] and other[0] - APART < one[1]


def _preference(lefts: Sequence[float], rights: Sequence[float]) -> tuple[int, float]:
    """Lines that go up take tracks from the top, lines that go down from the bottom: then they do not cross."""
    if not lefts or not rights:
        return 0, -max([*lefts, *rights])
    rise = sum(rights) / len(rights) - sum(lefts) / len(lefts)
    return (0, sum(lefts) / len(lefts)) if rise < 0 else (1, -sum(lefts) / len(lefts))
