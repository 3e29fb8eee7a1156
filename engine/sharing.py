"""Jacobians by way of what several results share, so that a product with one takes fewer operations.

All accelerations of a flexible link depend on that of its hub, and that on every state: written out, each row is full.
With the hub's acceleration as a value of its own, whose row comes first, the other rows hold little more than itself.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from engine.algebra import STATE, Graph
from engine.ports import Expression

_TRIED = 12
"""Nodes for which it is counted out, in each turn, what they would save."""
_FLAT = frozenset(
    {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_NOT, ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL}
)
"""Operations whose derivative is zero."""


@dataclass(frozen=True)
class Jacobian:
    """Where a Jacobian is not zero: by x, t, u, d, the parameters that are directions, and values that rows share.

    Attributes:
        height: number of results; the rows of shared values come after theirs, and are worked out before.
        rows, columns: of each value.
        shared: the column of the first shared value.
    """

    height: int
    rows: list[int]
    columns: list[int]
    shared: int

    @property
    def order(self) -> list[int]:
        """Rows in the order in which they are worked out."""
        last = max(self.rows, default=-1)
        return [*range(self.height, last + 1), *range(self.height)]


def shared_nodes(graph: Graph, results: Sequence[int], columns: Mapping[tuple[Any, ...], int]) -> list[int]:
    """Nodes by way of which the Jacobian of the results has fewest values, in order.

    Args:
        graph: holds the function.
        results: the function's.
        columns: of each input by which it is differentiated, by the input's key.
    """
    masks = [0] * len(graph.nodes)

    def reads(node: int) -> tuple[int, ...]:
        key = graph.nodes[node]
        if key[0] in ("const", "input") or key[0] in _FLAT:
            return ()
        return tuple(key[2:] if key[0] == ca.OP_IF_ELSE_ZERO else key[1:])

    operands = [reads(node) for node in range(len(graph.nodes))]
    for node, key in enumerate(graph.nodes):
        if key[0] == "input" and key in columns:
            masks[node] = 1 << columns[key]
        for operand in operands[node]:
            masks[node] |= masks[operand]
    users: dict[int, set[int]] = {}
    meets = [0] * len(graph.nodes)
    for row, node in enumerate(results):
        meets[node] |= 1 << row
    for node in reversed(range(len(graph.nodes))):
        if meets[node]:
            for operand in operands[node]:
                meets[operand] |= meets[node]
                users.setdefault(operand, set()).add(node)
    reached = [node for node in range(len(graph.nodes)) if meets[node] and graph.levels[node] == STATE]

    def count(chosen: Collection[int]) -> int:
        """Values of the Jacobian by way of some nodes."""
        found, total = list(masks), 0
        for node in reached:
            if operands[node]:
                mask = 0
                for operand in operands[node]:
                    mask |= found[operand]
                if node in chosen:
                    total += mask.bit_count()
                    mask = 1 << (len(columns) + node)
                found[node] = mask
        return total + sum(found[node].bit_count() for node in results)

    candidates = [node for node in reached if operands[node] and len(users.get(node, ())) + results.count(node) > 1]
    chosen: set[int] = set()
    least = count(chosen)
    while True:
        gains = {
            node: (masks[node].bit_count() - 1) * (meets[node].bit_count() - 1)
            for node in candidates
            if node not in chosen
        }
        tried = sorted((node for node in gains if gains[node] > 0), key=lambda node: (-gains[node], node))[:_TRIED]
        best = min(((count({*chosen, node}), node) for node in tried), default=(least, -1))
        if best[0] >= least:
            return sorted(chosen)
        least = best[0]
        chosen.add(best[1])


def expressions(
    graph: Graph, results: Sequence[int], inputs: Mapping[str, Expression], named: Mapping[int, Expression]
) -> tuple[list[Expression], list[Expression]]:
    """Expressions of the results, and of the named nodes, in which these stand as symbols.

    Args:
        graph: holds them.
        results: nodes.
        inputs: symbols of the function's arguments by name.
        named: symbols of some nodes.
    """
    made: list[Expression] = []
    defined = {}
    for node, (operation, *parts) in enumerate(graph.nodes):
        if operation == "const":
            value = ca.SX(parts[0])
        elif operation == "input":
            value = inputs[parts[0]][parts[1]]
        elif len(parts) == 1:
            value = ca.SX.unary(operation, made[parts[0]])
        else:
            value = ca.SX.binary(operation, made[parts[0]], made[parts[1]])
        if node in named:
            defined[node] = value
            value = named[node]
        made.append(value)
    return [made[node] for node in results], [defined[node] for node in named]
