"""Layered layout: boxes in columns from left to right, joined by lines of horizontal and vertical pieces.

The steps are those of Sugiyama: turn round what would close a cycle, put each box right of what feeds it, order the
boxes of a column so that few lines cross, then place them so that lines run straight where they can. Lines that pass a
column take a place in it of their own. Between two columns every net has a vertical track of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby

from flexarm.plotting.wiring.channels import Gap, Lane, Pin, tracks
from flexarm.plotting.wiring.columns import Link, columns

BETWEEN = 22.0
"""Least distance between two boxes of a column."""
LINE = 12.0
"""Least distance of a line from what lies above and below it."""
MARGIN, TRACK = 20.0, 11.0
"""Between a column and the first track beside it, and between two tracks."""
SWEEPS = 12


@dataclass
class Item:
    """A box: size, and the heights at which its ports lie on its left and right side, from its top.

    ``free`` ports may change places with others of their side.
    """

    key: str
    width: float
    height: float
    left: dict[str, float] = field(default_factory=dict)
    right: dict[str, float] = field(default_factory=dict)
    free: bool = True


__all__ = ["Item", "Link", "Placed", "arrange"]

Line = tuple[tuple[float, float], ...]


@dataclass
class Placed:
    """Where things lie: upper left corner of each item, lines and junctions of each link, and the size of it all."""

    width: float
    height: float
    corners: dict[str, tuple[float, float]]
    lines: dict[str, list[Line]]
    dots: dict[str, list[tuple[float, float]]]


@dataclass
class _Node:
    """An item, or the place where a link passes a column (then ``link`` names it)."""

    key: str
    height: float
    item: Item | None = None
    y: float = 0.0

    def offset(self, side: str, port: str) -> float:
        if self.item is None:
            return 0.0
        return (self.item.left if side == "left" else self.item.right)[port]


def arrange(
    items: Sequence[Item], links: Sequence[Link], first: Sequence[str] = (), last: Sequence[str] = ()
) -> Placed:
    """Lay out items and links.

    Args:
        items: in the order in which to prefer them from top to bottom.
        links: between them.
        first: items that stand alone in the leftmost column.
        last: items that stand alone in the rightmost column.
    """
    return _Arrangement(list(items), list(links), set(first), set(last)).result()


class _Arrangement:
    def __init__(self, items: list[Item], links: list[Link], first: set[str], last: set[str]) -> None:
        self.items = {item.key: item for item in items}
        self.links = links
        self.layer = columns(links, list(self.items), first, last)
        self.columns: list[list[_Node]] = [[] for _ in range(max(self.layer.values(), default=0) + 1)]
        self.nodes: dict[str, _Node] = {}
        for item in items:
            self._add(_Node(item.key, item.height, item), self.layer[item.key])
        self.gaps: list[list[Gap]] = [[] for _ in range(len(self.columns) + 1)]
        for link in links:
            self._chain(link)
        self._order()
        self._sort_ports()
        self._heights()

    def _add(self, node: _Node, column: int) -> None:
        self.nodes[node.key] = node
        self.columns[column].append(node)

    # -- lines through columns -----------------------------------------------------------------------------------------

    def _chain(self, link: Link) -> None:
        """Cut a link into pieces between neighbouring columns, with a place in each column that it passes."""
        start = self.layer[link.source[0]]
        ahead = [(t, p) for t, p in link.targets if self.layer[t] > start]
        behind = [(t, p) for t, p in link.targets if self.layer[t] <= start]
        before = Pin(link.source[0], link.source[1])
        pieces: dict[int, Gap] = {}

        def gap(number: int) -> Gap:
            if number not in pieces:
                pieces[number] = Gap(link.key)
                self.gaps[number].append(pieces[number])
            return pieces[number]

        def passing(column: int, way: str) -> Pin:
            key = f"{link.key}|{way}{column}"
            if key not in self.nodes:
                self._add(_Node(key, 0.0), column)
            return Pin(key, "")

        gap(start + 1).left.append(before)
        far = max((self.layer[t] for t, _ in ahead), default=start)
        for column in range(start + 1, far + 1):
            into = gap(column)
            if column > start + 1:
                into.left.append(passing(column - 1, "on"))
            into.right += [Pin(t, p) for t, p in ahead if self.layer[t] == column]
            if column < far:
                into.right.append(passing(column, "on"))
        near = min((self.layer[t] for t, _ in behind), default=start + 1)
        for column in range(start, near - 1, -1):
            gap(column + 1).left.append(passing(column, "back"))
            into = gap(column)
            into.right += [passing(column, "back"), *(Pin(t, p) for t, p in behind if self.layer[t] == column)]

    # -- order within columns ------------------------------------------------------------------------------------------

    def _order(self) -> None:
        best, fewest = [list(c) for c in self.columns], self._crossings()
        for sweep in range(SWEEPS):
            forward = sweep % 2 == 0
            numbers = range(1, len(self.columns)) if forward else range(len(self.columns) - 2, -1, -1)
            for number in numbers:
                self._by_neighbours(number, forward)
            crossings = self._crossings()
            if crossings < fewest:
                best, fewest = [list(c) for c in self.columns], crossings
        self.columns = best
        for number in range(1, len(self.columns)):
            self._centre(number, fewest)

    def _centre(self, number: int, fewest: int) -> None:
        """Among boxes that hang on one line, put those from which it goes on into the middle: chains run straight."""
        hung = {}
        for gap in self.gaps[number]:
            if len(gap.left) == 1:
                hung.update({pin.node: gap.link for pin in gap.right})
        onward = {pin.node for gap in self.gaps[number + 1] for pin in gap.left}
        before = list(self.columns[number])
        made: list[_Node] = []
        for _, group in groupby(before, key=lambda n: hung.get(n.key, n.key)):
            members = list(group)
            ends = [n for n in members if n.key not in onward]
            goes = [n for n in members if n.key in onward]
            made += [*ends[: len(ends) // 2], *goes, *ends[len(ends) // 2 :]]
        self.columns[number] = made
        if self._crossings() > fewest:
            self.columns[number] = before

    def _by_neighbours(self, number: int, forward: bool) -> None:
        place = self._places()
        wanted: dict[str, list[float]] = {}
        for gap in self.gaps[number if forward else number + 1]:
            mine, others = (gap.right, gap.left) if forward else (gap.left, gap.right)
            for pin in mine:
                wanted.setdefault(pin.node, []).extend(place[p.node] + self._share(p, forward) for p in others)
        column = self.columns[number]
        keys = {n.key: sum(w) / len(w) if (w := wanted.get(n.key)) else place[n.key] for n in column}
        column.sort(key=lambda n: keys[n.key])

    def _share(self, pin: Pin, right: bool) -> float:
        """Height of a port as a share of its box, so that ports of one box differ."""
        node = self.nodes[pin.node]
        return node.offset("right" if right else "left", pin.port) / max(node.height, 1.0) * 0.9 if node.item else 0.5

    def _places(self) -> dict[str, float]:
        return {n.key: i + 0.0 for column in self.columns for i, n in enumerate(column)}

    def _crossings(self) -> int:
        place = self._places()
        total = 0
        for gaps in self.gaps:
            ends = [
                (place[a.node] + self._share(a, True), place[b.node] + self._share(b, False), gap.link)
                for gap in gaps
                for a in gap.left
                for b in gap.right
            ]
            total += sum(
                (a[0] - b[0]) * (a[1] - b[1]) < 0 for i, a in enumerate(ends) for b in ends[:i] if a[2] != b[2]
            )
        return total

    def _sort_ports(self) -> None:
        """Let the ports of a box stand in the order of what they are joined to."""
        place = self._places()
        wanted: dict[tuple[str, str, str], list[float]] = {}
        for gaps in self.gaps:
            for gap in gaps:
                for mine, others, side in ((gap.left, gap.right, "right"), (gap.right, gap.left, "left")):
                    for pin in mine:
                        rows = wanted.setdefault((pin.node, pin.port, side), [])
                        rows += [place[p.node] + self._share(p, side == "left") for p in others]
                        # A line that turns back leaves below the others.
                        rows += [1e3 for p in mine if p is not pin and not others]
        for item in self.items.values():
            if not item.free:
                continue
            for side in ("left", "right"):
                ports = item.left if side == "left" else item.right
                heights = sorted(ports.values())

                def key(port: str, item: Item = item, side: str = side) -> float:
                    rows = wanted.get((item.key, port, side), [0.0])
                    return sum(rows) / max(len(rows), 1)

                ports.update(zip(sorted(ports, key=key), heights, strict=True))

    # -- coordinates ---------------------------------------------------------------------------------------------------

    def _heights(self) -> None:
        for column in self.columns:
            y = 0.0
            for above, node in zip([None, *column], column, strict=False):
                y += 0.0 if above is None else self._apart(above, node)
                node.y = y
        for sweep in range(3 * SWEEPS):
            forward = sweep % 2 == 0
            both = sweep >= 2 * SWEEPS
            numbers = range(len(self.columns)) if forward else range(len(self.columns) - 1, -1, -1)
            for number in numbers:
                self._pull(number, forward or both, not forward or both)
        for number in range(len(self.columns)):
            self._pull(number, True, False, nearest=True)
        for number in range(len(self.columns) - 2, -1, -1):
            self._pull(number, False, True, nearest=True, only_unfed=True)
        top = min((n.y for c in self.columns for n in c), default=0.0)
        for column in self.columns:
            for node in column:
                node.y = round(node.y - top, 2)

    @staticmethod
    def _apart(above: _Node, below: _Node) -> float:
        space = BETWEEN if above.item and below.item else LINE
        return above.height + space

    def _pull(self, number: int, left: bool, right: bool, *, nearest: bool = False, only_unfed: bool = False) -> None:
        """Move the boxes of a column to where their lines run straight, in order and apart (least squares).

        With ``nearest`` each box goes by one line alone, which then is straight; with ``only_unfed`` boxes that have
        lines on their left stay.
        """
        fed = {pin.node for gap in self.gaps[number] for pin in gap.right if gap.left}
        wanted: dict[str, list[tuple[float, float]]] = {}
        for use, gaps, mine_right in ((left, self.gaps[number], True), (right, self.gaps[number + 1], False)):
            for gap in gaps if use else ():
                mine, others = (gap.right, gap.left) if mine_right else (gap.left, gap.right)
                sides = ("left", "right") if mine_right else ("right", "left")
                for pin in mine:
                    offset = self.nodes[pin.node].offset(sides[0], pin.port)
                    for other in others:
                        node = self.nodes[other.node]
                        weight = (1.0 if node.item else 3.0) * (1.0 if self.nodes[pin.node].item else 3.0) / len(others)
                        target = node.y + node.offset(sides[1], other.port) - offset
                        wanted.setdefault(pin.node, []).append((target, weight))
        column = self.columns[number]
        shift, goals = 0.0, []
        for above, node in zip([None, *column], column, strict=False):
            shift += 0.0 if above is None else self._apart(above, node)
            rows = wanted.get(node.key) or [(node.y, 1e-3)]
            if only_unfed and node.key in fed:
                rows = [(node.y, 10.0)]
            elif nearest and len(rows) > 1:
                rows = [min(rows, key=lambda row: (-row[1], abs(row[0] - node.y)))]
            total = sum(w for _, w in rows)
            goals.append((sum(t * w for t, w in rows) / total - shift, total, shift))
        for node, value, (_, _, moved) in zip(column, _rising([g[:2] for g in goals]), goals, strict=True):
            node.y = value + moved

    def result(self) -> Placed:
        """Coordinates of everything."""
        x, lefts, widths, starts = 0.0, [], [], []
        chosen = []
        for number in range(len(self.columns) + 1):
            laid = tracks(self.gaps[number], self._pin_height)
            chosen.append(laid)
            count = max((lane.last for lane in laid.values()), default=-1) + 1
            starts.append(x)
            outer = number in (0, len(self.columns))
            x += (MARGIN + TRACK * count if count else 0.0) if outer else 2 * MARGIN + TRACK * max(count - 1, 0)
            if number < len(self.columns):
                wide = max((n.item.width for n in self.columns[number] if n.item), default=0.0)
                lefts.append(x)
                widths.append(wide)
                x += wide
        placed = Placed(x, 0.0, {}, {link.key: [] for link in self.links}, {link.key: [] for link in self.links})
        for number, column in enumerate(self.columns):
            for node in column:
                if node.item is not None:
                    placed.corners[node.key] = (lefts[number] + (widths[number] - node.item.width) / 2, node.y)
                else:
                    link = node.key.rpartition("|")[0]
                    placed.lines[link].append(((lefts[number], node.y), (lefts[number] + widths[number], node.y)))
        for number, gaps in enumerate(self.gaps):
            for gap in gaps:
                first = starts[number] + (MARGIN if number else TRACK)
                self._draw(placed, gap, chosen[number].get(gap, Lane(0)), first, number, lefts, widths)
        bottoms = [n.y + n.height for c in self.columns for n in c]
        placed.height = max(
            [*bottoms, *(y for rows in placed.lines.values() for line in rows for _, y in line)], default=0
        )
        return placed

    def _pin_height(self, pin: Pin, side: str) -> float:
        node = self.nodes[pin.node]
        return round(node.y + node.offset(side, pin.port), 2)

    def _draw(
        self, placed: Placed, gap: Gap, lane: Lane, first: float, number: int, lefts: list[float], widths: list[float]
    ) -> None:
        """Draw the piece of a link between two columns; its tracks are counted from ``first``."""
        left: list[tuple[float, float]] = []
        right: list[tuple[float, float]] = []
        for pin in gap.left:
            item = self.nodes[pin.node].item
            edge = placed.corners[pin.node][0] + item.width if item else lefts[number - 1] + widths[number - 1]
            left.append((edge, self._pin_height(pin, "right")))
        for pin in gap.right:
            edge = placed.corners[pin.node][0] if self.nodes[pin.node].item else lefts[number]
            right.append((edge, self._pin_height(pin, "left")))
        if len(left) + len(right) < 2:
            return
        lines = placed.lines[gap.link]
        if len(left) == len(right) == 1 and abs(left[0][1] - right[0][1]) < 0.5:
            lines.append((left[0], (right[0][0], left[0][1])))
        elif lane.second is None:
            self._trunk(placed, gap.link, first + TRACK * lane.first, left + right)
        else:
            one, two = first + TRACK * lane.first, first + TRACK * lane.second
            self._trunk(placed, gap.link, one, [*left, (two, lane.height)])
            self._trunk(placed, gap.link, two, [*right, (two, lane.height)])

    @staticmethod
    def _trunk(placed: Placed, link: str, x: float, ends: list[tuple[float, float]]) -> None:
        """An upright piece at ``x`` with a horizontal one to each end, and dots where three or more meet."""
        if len(ends) == 2:
            (xa, ya), (xb, yb) = ends
            placed.lines[link].append(((xa, ya), (x, ya), (x, yb), (xb, yb)))
            return
        heights = [y for _, y in ends]
        placed.lines[link].append(((x, min(heights)), (x, max(heights))))
        for edge, y in ends:
            placed.lines[link].append(((edge, y), (x, y)))
        for y in dict.fromkeys(heights):
            directions = sum(h == y and edge != x for edge, h in ends) + (y > min(heights)) + (y < max(heights))
            if directions > 2:
                placed.dots[link].append((x, y))


def _rising(goals: Sequence[tuple[float, float]]) -> list[float]:
    """The rising sequence nearest to weighted goals (pool adjacent violators)."""
    pools: list[tuple[float, float, int]] = []
    for value, weight in goals:
        pool = (value, weight, 1)
        while pools and pools[-1][0] > pool[0]:
            v, w, n = pools.pop()
            pool = ((v * w + pool[0] * pool[1]) / (w + pool[1]), w + pool[1], n + pool[2])
        pools.append(pool)
    return [value for value, _, count in pools for _ in range(count)]
