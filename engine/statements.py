"""C statements that compute the nodes of a graph: straight lines, and loops over what repeats.

Inside a loop, ``a7`` is the eighth value of a turn and ``b7`` that of the turn before. What a loop reads of other
places in turn lies in arrays in which its turns are equally far apart: parameters' values are prepared in such an order
(`Shelf`), and values of the function itself lie in ``w``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, Protocol

from engine.forms import SCALAR, Form, Term, constant
from engine.rolling import Line, Section, sections

_MARGIN = 2
"""Places left free in ``w`` on either side of a loop's values, for those that another loop reads in turn with them."""


class Graph(Protocol):
    """Of scalar operations; see `engine.codegen.Emitter`."""

    nodes: list[tuple[Any, ...]]

    def is_computed(self, node: int) -> bool:
        """Whether a node is the result of an operation."""

    def groups(
        self, nodes: list[int], results: Sequence[int] | None = None
    ) -> Iterable[tuple[frozenset[int], list[int]]]:
        """The computed ones of some nodes in order, each group with the conditions without which nothing uses it."""


class Shelf:
    """Values that functions read from an array, in which a loop's are equally far apart; some lie there twice.

    Attributes:
        name: of the array.
        order: the nodes in it.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.order: list[int] = []
        self._place: dict[int, int] = {}
        self._lines: dict[tuple[int, ...], tuple[int, int]] = {}

    def put(self, nodes: Iterable[int]) -> None:
        """Add those that are not there."""
        for node in nodes:
            if node not in self._place:
                self._append(node)

    def _append(self, node: int) -> None:
        self._place.setdefault(node, len(self.order))
        self.order.append(node)

    def text(self, node: int) -> str:
        """C of a value."""
        return f"{self.name}[{self._place.get(node, 0)}]"

    def line(self, sequence: Sequence[int]) -> tuple[int, int]:
        """Where the first of a sequence lies, and how far apart they are; they are added if they do not lie so."""
        key = tuple(sequence)
        found = self._lines.get(key) or even([self._place.get(node, -1) for node in sequence])
        if found is None:
            found = len(self.order), 1
            for node in sequence:
                self._append(node)
        self._lines[key] = found
        return found


def even(places: Sequence[int]) -> tuple[int, int] | None:
    """The first of some places and how far apart they are; None if that differs, or a place is negative."""
    first, stride = places[0], places[1] - places[0]
    if min(places) < 0 or stride == 0 or any(b - a != stride for a, b in itertools.pairwise(places)):
        return None
    return first, stride


def _indexed(array: str, first: int, stride: int) -> str:
    turn = "k" if stride == 1 else "-k" if stride == -1 else f"{stride} * k"
    if first == 0:
        return f"{array}[{turn}]"
    return f"{array}[{first} - {turn[1:]}]" if turn.startswith("-") else f"{array}[{first} + {turn}]"


class Statements:
    """What a function computes.

    Args:
        graph: holds the nodes.
        nodes: to be computed, in order.
        shelf: where a computed node that is not among them lies; None if there is none such.
        results: nodes that the function is for; given these, costly ones are computed only where a mode needs them.
        rolled: whether what repeats is written as loops.
    """

    def __init__(
        self,
        graph: Graph,
        nodes: list[int],
        shelf: Callable[[int], Shelf] | None = None,
        results: Sequence[int] | None = None,
        *,
        rolled: bool = False,
    ) -> None:
        self._graph, self._shelf = graph, shelf
        self._order: list[int] = []
        self._conditions: list[tuple[int, ...]] = []
        for conditions, group in graph.groups(nodes, results):
            self._order += group
            self._conditions += [tuple(sorted(conditions))] * len(group)
        self._line = {node: k for k, node in enumerate(self._order)}
        self._sections = sections([self._described(k) for k in range(len(self._order))]) if rolled else []
        self._own: dict[int, tuple[Section, int, int]] = {}
        for section in self._sections:
            for k in range(section.first, section.end):
                self._own[self._order[k]] = (section, *section.turn_and_slot(k))
        self._rooms: dict[tuple[int, int], int] = {}
        self._lent: dict[int, int] = {}
        self._copies: dict[tuple[int, ...], int] = {}
        self._wanted: dict[int, list[tuple[str, int]]] = {}
        self._width = 0
        self._form: Form = SCALAR

    def __len__(self) -> int:
        """How many values are computed."""
        return len(self._order)

    def _reads(self, k: int) -> tuple[int, ...]:
        return (*self._graph.nodes[self._order[k]][1:], *self._conditions[k])

    def _described(self, k: int) -> Line:
        reads = self._reads(k)
        shape = (self._graph.nodes[self._order[k]][0], len(self._conditions[k]), *map(self._kind, reads))
        return Line(shape, tuple(self._line.get(node) for node in reads))

    def _kind(self, node: int) -> Hashable:
        """Of what a line reads: a constant, an argument's element, a value made here, or one from a shelf."""
        key = self._graph.nodes[node]
        if key[0] == "const":
            return repr(key[1])
        if key[0] == "input":
            return str(key[1])
        if node in self._line or self._shelf is None:
            return None
        return 0, self._shelf(node).name

    # -- text --------------------------------------------------------------------------------------------------------

    def text(self, targets: Sequence[tuple[str, int]], form: Form = SCALAR) -> list[str]:
        """Lines of C.

        Args:
            targets: arrays and the nodes that are put into them, an array's in its order.
            form: how values are written.
        """
        self._form = form
        for _ in range(2 if self._sections else 1):  # the first time tells what has to lie in `w`
            lines = self._written(targets)
        if self._width:
            lines.insert(0, f"  {form.number} w[{self._width}];")
        return lines

    def reserve(self) -> None:
        """Put what loops read in turn onto its shelves."""
        if self._sections:
            self._written([])

    def _written(self, targets: Sequence[tuple[str, int]]) -> list[str]:
        pending = self._placed(targets)
        self._wanted = {}
        for where, node in pending.items():
            self._wanted.setdefault(node, []).append(where)
        lines: list[str] = []
        at = 0
        for section in self._sections:
            lines += self._straight(at, section.first)
            lines += self._loop(section, pending)
            at = section.end
        lines += self._straight(at, len(self._order))
        for (array, place), node in pending.items():
            lines.append(f"  {array}[{place}] = {self._whole(node)};")
        return lines

    @staticmethod
    def _placed(targets: Sequence[tuple[str, int]]) -> dict[tuple[str, int], int]:
        counts: dict[str, int] = {}
        placed = {}
        for array, node in targets:
            place = counts.get(array, 0)
            counts[array] = place + 1
            placed[array, place] = node
        return placed

    def _whole(self, node: int) -> str:
        """C of a node by itself in a straight line."""
        return self._form.whole(self.operand(node))

    def operand(self, node: int) -> Term:
        """A node in a straight line."""
        key = self._graph.nodes[node]
        if key[0] == "const":
            return constant(key[1])
        if key[0] == "input":
            return self._form.read(key[1], "t" if key[1] == "t" else f"{key[1]}[{key[2]}]")
        if node in self._own:
            section, turn, slot = self._own[node]
            return Term(f"w[{self._room(section, slot) + turn}]")
        if node in self._line:
            return Term(f"v{node}")
        assert self._shelf is not None
        shelf = self._shelf(node)
        return self._form.read(shelf.name, shelf.text(node))

    def _straight(self, first: int, end: int) -> list[str]:
        lines: list[str] = []
        for conditions, run in itertools.groupby(range(first, end), lambda k: self._conditions[k]):
            texts = {self._order[k]: self._value(k, [self.operand(o) for o in self._reads(k)]) for k in run}
            if conditions:
                zeros = ", ".join(f"v{node} = {self._form.zero}" for node in texts)
                lines.append(f"  {self._form.number} {zeros};")
                lines.append(f"  if ({self._form.test([self.operand(c) for c in conditions])}) {{")
                lines += [f"    v{node} = {text};" for node, text in texts.items()]
                lines.append("  }")
            else:
                lines += [f"  const {self._form.number} v{node} = {text};" for node, text in texts.items()]
            lines += [f"  w[{self._lent[node]}] = v{node};" for node in texts if node in self._lent]
        return lines

    def _value(self, k: int, operands: Sequence[Term]) -> str:
        return self._form.value(self._graph.nodes[self._order[k]][0], operands)

    # -- loops -------------------------------------------------------------------------------------------------------

    def _loop(self, section: Section, pending: dict[tuple[str, int], int]) -> list[str]:
        before: list[str] = []
        carried: dict[tuple[int, int], str] = {}
        values, tests = [], []
        for slot in range(section.period):
            k = section.first + slot
            reads = [self._read(section, slot, i, before, carried) for i in range(len(self._reads(k)))]
            count = len(reads) - len(self._conditions[k])
            values.append(self._value(k, reads[:count]))
            tests.append(tuple(reads[count:]))
        lines = [f"  for (int k = 0; k < {section.turns}; k++) {{"]
        for conditions, run in itertools.groupby(range(section.period), lambda slot: tests[slot]):
            slots = list(run)
            if conditions:
                zeros = ", ".join(f"a{slot} = {self._form.zero}" for slot in slots)
                lines.append(f"    {self._form.number} {zeros};")
                lines.append(f"    if ({self._form.test(conditions)}) {{")
                lines += [f"      a{slot} = {values[slot]};" for slot in slots]
                lines.append("    }")
            else:
                lines += [f"    const {self._form.number} a{slot} = {values[slot]};" for slot in slots]
            for slot in slots:
                lines += self._kept(section, slot, pending)
        lines += [f"    {name} = a{slot};" for (slot, _), name in carried.items()]
        first = [f"  {self._form.number} {name} = {self._whole(node)};" for (_, node), name in carried.items()]
        return ["  {", *before, *first, *lines, "  }", "  }"]

    def _nodes(self, section: Section, slot: int) -> list[int]:
        return self._order[section.first + slot : section.end : section.period]

    def _kept(self, section: Section, slot: int, pending: dict[tuple[str, int], int]) -> list[str]:
        """Stores of a slot's value, in the function's results as far as they are equally far apart, and in ``w``."""
        lines = []
        nodes = self._nodes(section, slot)
        if targets := self._targets(pending, nodes):
            (array, first), (_, second) = targets[:2]
            for place in targets:
                del pending[place]
            lines.append(f"    {_indexed(array, first, second - first)} = a{slot};")
        if (section.first, slot) in self._rooms:
            lines.append(f"    {_indexed('w', self._rooms[section.first, slot], 1)} = a{slot};")
        return lines

    def _targets(self, pending: dict[tuple[str, int], int], nodes: Sequence[int]) -> list[tuple[str, int]]:
        """Equally distant elements of a result that are these nodes; none if there are none."""
        for array, first in self._wanted.get(nodes[0], ()):
            for other, second in self._wanted.get(nodes[1], ()):
                line = [(array, first + turn * (second - first)) for turn in range(len(nodes))]
                if other == array and all(pending.get(p) == node for p, node in zip(line, nodes, strict=True)):
                    return line
        return []

    def _read(
        self, section: Section, slot: int, place: int, before: list[str], carried: dict[tuple[int, int], str]
    ) -> Term:
        """What a slot reads."""
        sequence = [self._reads(k)[place] for k in range(section.first + slot, section.end, section.period)]
        last = self._own.get(sequence[-1])
        if last is not None and last[0] is section:
            if last[1] == section.turns - 1:
                return Term(f"a{last[2]}")
            return Term(carried.setdefault((last[2], sequence[0]), f"b{last[2]}_{sequence[0]}"))
        if all(node == sequence[0] for node in sequence):
            return self.operand(sequence[0])
        key = self._graph.nodes[sequence[0]]
        if key[0] == "input":
            found = even([self._graph.nodes[node][2] for node in sequence])
            if found is not None:
                return self._form.read(key[1], _indexed(key[1], *found))
        elif sequence[0] not in self._line:
            assert self._shelf is not None
            shelf = self._shelf(sequence[0])
            return self._form.read(shelf.name, _indexed(shelf.name, *shelf.line(sequence)))
        else:
            found = self._in_line(sequence)
            if found is not None:
                return Term(_indexed("w", *found))
        return Term(_indexed("w", self._copied(sequence, before), 1))

    def _room(self, section: Section, slot: int) -> int:
        """Where in ``w`` the first turn of a slot lies."""
        where = (section.first, slot)
        if where not in self._rooms:
            self._rooms[where] = self._width + _MARGIN
            self._width += section.turns + 2 * _MARGIN
        return self._rooms[where]

    def _in_line(self, sequence: Sequence[int]) -> tuple[int, int] | None:
        """Where in ``w`` a sequence lies, most of it from one slot of a loop; and how far apart."""
        inside = [(turn, self._own[node]) for turn, node in enumerate(sequence) if node in self._own]
        if len(inside) < 2:
            return None
        (turn, (section, made, slot)), (_, (_, last, _)) = inside[0], inside[-1]
        stride = 1 if last > made else -1
        for at, node in enumerate(sequence):
            source = self._own.get(node)
            place = made + stride * (at - turn)
            if source is None:
                if not (-_MARGIN <= place < 0 or section.turns <= place < section.turns + _MARGIN):
                    return None
                lent = self._room(section, slot) + place
                if self._lent.get(node, lent) != lent or any(p == lent and n != node for n, p in self._lent.items()):
                    return None
            elif source[0] is not section or source[1:] != (place, slot):
                return None
        first = self._room(section, slot)
        for at, node in enumerate(sequence):
            if node not in self._own:
                self._lent[node] = first + made + stride * (at - turn)
        return first + made - stride * turn, stride

    def _copied(self, sequence: Sequence[int], before: list[str]) -> int:
        """Where in ``w`` a sequence is copied to before the loop."""
        key = tuple(sequence)
        if key not in self._copies:
            self._copies[key] = self._width
            self._width += len(sequence)
        first = self._copies[key]
        before += [f"  w[{first + turn}] = {self._whole(node)};" for turn, node in enumerate(sequence)]
        return first
