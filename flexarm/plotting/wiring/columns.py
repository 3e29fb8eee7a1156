"""Which column each box of a layout stands in: right of what feeds it, but for what would close a cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Link:
    """A net from one item's right side to other items' left sides; ends are (item, port)."""

    key: str
    source: tuple[str, str]
    targets: tuple[tuple[str, str], ...]


def columns(links: Sequence[Link], keys: Sequence[str], first: set[str], last: set[str]) -> dict[str, int]:
    """Number of each item's column, from the left and without gaps.

    Args:
        links: between the items.
        keys: of the items, in the order in which cycles are to be entered.
        first: items that stand alone in the leftmost column.
        last: items that stand alone in the rightmost column.
    """
    onward: dict[str, list[str]] = {key: [] for key in keys}
    for link in links:
        onward[link.source[0]] += [t for t, _ in link.targets if t != link.source[0]]
    order = _depth_first(onward)
    position = {key: i for i, key in enumerate(order)}
    edges = [(a, b) for a in order for b in dict.fromkeys(onward[a]) if position[a] < position[b]]
    column = dict.fromkeys(order, 0)
    for a, b in edges:
        column[b] = max(column[b], column[a] + 1)
    for key in reversed(order):
        # A box with more lines to the right than from the left moves to the right.
        targets = [column[b] for a, b in edges if a == key]
        if targets and sum(b == key for _, b in edges) < len(targets):
            column[key] = max(column[key], min(targets) - 1)
    if any(value == 0 and key not in first for key, value in column.items()):
        column = {key: value + 1 for key, value in column.items()}
    column.update(dict.fromkeys(first & column.keys(), 0))
    most = max((value for key, value in column.items() if key not in last), default=-1)
    column.update(dict.fromkeys(last & column.keys(), most + 1))
    used = sorted(set(column.values()))
    return {key: used.index(value) for key, value in column.items()}


def _depth_first(onward: dict[str, list[str]]) -> list[str]:
    """An order in which as many links as a depth-first walk finds run forward."""
    fed = {b for targets in onward.values() for b in targets}
    done: list[str] = []
    seen: set[str] = set()
    for root in [*(k for k in onward if k not in fed), *onward]:
        if root in seen:
            continue
        seen.add(root)
        stack = [(root, iter(onward[root]))]
        while stack:
            key, rest = stack[-1]
            following = next((t for t in rest if t not in seen), None)
            if following is None:
                done.append(key)
                stack.pop()
            else:
                seen.add(following)
                stack.append((following, iter(onward[following])))
    return done[::-1]
