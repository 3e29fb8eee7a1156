"""Choose coordinates: eliminate ties exactly, and make the relative motion of every friction a coordinate.

Each motion is a combination of coordinates, ``phi = T q``. A tie removes one motion from the basis; a friction edge
replaces one, so that its relative velocity is a coordinate and sticking means holding that coordinate still. An
efficiency scales the balance of the motions on one side of a gear: rows of ``E`` in ``T' E M T q'' = T' E f``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from engine.errors import StructureError
from engine.net import Net
from engine.ports import Expression
from engine.stamps import Friction, Motion, Prescription

Row = dict[int, Expression]
_ZERO = 1e-12


_Form = dict[int, tuple[Expression, float]]
"""Coefficient of each basis element, and its value at nominal parameters."""


def _add(total: _Form, form: _Form, share: tuple[Expression, float]) -> None:
    """Add ``share`` times a form to another."""
    for basis, (coefficient, number) in form.items():
        known, value = total.get(basis, (ca.SX(0), 0.0))
        total[basis] = known + share[0] * coefficient, value + share[1] * number


@dataclass
class Coordinates:
    """The result of the elimination.

    Attributes:
        names: one per coordinate; ``relative`` marks those that are a friction edge's relative motion.
        kinds: ``rotational`` or ``translational``.
        rows: for each motion, coordinate index -> coefficient.
        weights: for each motion, then each velocity, the efficiency weight of its balance.
        prescribed: coordinate index -> (prescription, scale): the prescribed motion is scale times the coordinate.
        frictions: coordinate index -> list of (friction, scale): its velocity is scale times the coordinate's.
    """

    names: list[str]
    kinds: list[str]
    rows: list[Row]
    weights: list[Expression]
    prescribed: dict[int, tuple[Prescription, Expression]]
    frictions: dict[int, list[tuple[Friction, Expression]]]

    def transform(self) -> Expression:
        """T, shape (motions, coordinates)."""
        matrix = ca.SX(len(self.rows), len(self.names))
        for i, row in enumerate(self.rows):
            for j, coefficient in row.items():
                matrix[i, j] = coefficient
        return matrix


class _Basis:
    """Motions as combinations of a shrinking basis, with numbers at nominal parameters beside the symbols.

    What stands for an eliminated element is kept as it was found and looked up when it is needed, so that a chain of
    ties costs, and its products share, in proportion to its length.
    """

    def __init__(
        self,
        net: Net,
        symbols: Expression,
        values: NDArray[np.float64],
        note: Callable[[Expression], object],
    ) -> None:
        self.net, self._note = net, note
        self.symbols, self.values = symbols, values
        self.names: dict[int, str] = {m.index: m.name for m in net.motions}
        self.kinds: dict[int, str] = {m.index: m.kind for m in net.motions}
        self.free = len(net.motions)
        self._replaced: dict[int, _Form] = {}

    def number(self, expression: Expression) -> float:
        if expression.is_constant():
            return float(expression)
        self._note(expression)
        function = ca.Function("value", [self.symbols], [expression])
        return float(function(self.values))

    def reduce(self, terms: Row) -> Row:
        """A linear form of motions as one of the present basis, vanishing terms dropped."""
        forms: dict[int, _Form] = {}
        total: _Form = {}
        for motion, coefficient in terms.items():
            _add(total, self._present(motion, forms), (coefficient, self.number(coefficient)))
        return {basis: c for basis, (c, number) in total.items() if abs(number) > _ZERO}

    def rows(self) -> list[Row]:
        """Every motion in the present basis."""
        forms: dict[int, _Form] = {}
        made = [self._present(motion.index, forms) for motion in self.net.motions]
        return [{basis: c for basis, (c, _) in form.items()} for form in made]

    def _present(self, element: int, forms: dict[int, _Form]) -> _Form:
        """An element in the present basis; ``forms`` keeps those that are worked out."""
        waiting = [element]
        while waiting:
            here = waiting[-1]
            replacement = self._replaced.get(here)
            if here in forms or replacement is None:
                forms.setdefault(here, {here: (ca.SX(1), 1.0)})
                waiting.pop()
                continue
            needed = [basis for basis in replacement if basis not in forms]
            if needed:
                waiting += needed
                continue
            made: _Form = {}
            for basis, share in replacement.items():
                _add(made, forms[basis], share)
            forms[here] = made
            waiting.pop()
        return forms[element]

    def substitute(self, pivot: int, replacement: Row) -> None:
        """Replace a basis element by a combination of others."""
        self._replaced[pivot] = {basis: (c, self.number(c)) for basis, c in replacement.items()}

    def pick(self, form: Row, taken: set[int]) -> int:
        """The basis element to eliminate: a unit coefficient, a flange rather than an inner coordinate."""
        candidates = [b for b in form if b not in taken]
        motions = self.net.motions

        def cost(basis: int) -> tuple[bool, bool, int]:
            unit = form[basis].is_constant() and abs(float(form[basis])) == 1.0
            inner = basis < len(motions) and motions[basis].inner
            return (not unit, inner, basis)

        return min(candidates, key=cost)


def choose(
    net: Net, symbols: Expression, values: NDArray[np.float64], note: Callable[[Expression], object]
) -> Coordinates:
    """Eliminate the ties and make every friction edge a coordinate.

    Args:
        net: what the blocks stamped.
        symbols: the parameter vector.
        values: its nominal values; they decide only what is structurally zero.
        note: told each expression whose value decides.

    Raises:
        StructureError: ties that close a loop, or a friction edge that would.
    """
    basis = _Basis(net, symbols, values, note)
    for tie in net.ties:
        form = basis.reduce(tie.terms)
        if not form:
            raise StructureError(
                f"'{tie.owner}' ties motions that are tied already ({_names(net.motions, tie.terms)})",
                remedy="remove one of the ties, or put a spring into the loop",
            )
        pivot = basis.pick(form, set())
        lead = form.pop(pivot)
        basis.substitute(pivot, {b: -c / lead for b, c in form.items()})
    prescribed: dict[int, tuple[Prescription, Expression]] = {}
    for prescription in net.prescriptions:
        _impose(basis, prescription, prescribed)
    taken: dict[int, list[tuple[Friction, Expression]]] = {}
    for friction in net.frictions:
        _place(basis, friction, taken, set(prescribed))
    rows = basis.rows()
    kept = sorted({b for row in rows for b in row})
    position = {b: i for i, b in enumerate(kept)}
    return Coordinates(
        [basis.names[b] for b in kept],
        [basis.kinds[b] for b in kept],
        [{position[b]: c for b, c in row.items()} for row in rows],
        _weights(net),
        {position[b]: entry for b, entry in prescribed.items()},
        {position[b]: entries for b, entries in taken.items()},
    )


def _impose(basis: _Basis, entry: Prescription, prescribed: dict[int, tuple[Prescription, Expression]]) -> None:
    """Make a prescribed motion a coordinate of its own."""
    form = basis.reduce({entry.motion: ca.SX(1)})
    if all(b in prescribed for b in form):
        others = [prescribed[b][0].owner for b in form] or ["the ground"]
        raise StructureError(
            f"'{entry.owner}' imposes a motion that {' and '.join(others)} fixes already",
            remedy="remove one of them, or put a spring between",
        )
    pivot = basis.pick(form, set(prescribed))
    if len(form) == 1:
        prescribed[pivot] = (entry, form[pivot])
        return
    prescribed[_relative(basis, form, pivot, f"{entry.owner}.imposed", basis.kinds[pivot])] = (entry, ca.SX(1))


def _relative(basis: _Basis, form: Row, pivot: int, name: str, kind: str) -> int:
    """Replace the pivot by the linear form itself as a new basis element."""
    form = dict(form)
    lead = form.pop(pivot)
    new = basis.free
    basis.free += 1
    basis.names[new], basis.kinds[new] = name, kind
    basis.substitute(pivot, {new: 1 / lead, **{b: -c / lead for b, c in form.items()}})
    return new


def _place(
    basis: _Basis, friction: Friction, taken: dict[int, list[tuple[Friction, Expression]]], imposed: set[int]
) -> None:
    """Give a friction edge its coordinate, sharing one when the edges move together."""
    form = basis.reduce(friction.terms)
    if not form:
        raise StructureError(
            f"friction '{friction.owner}' acts between motions that cannot move against each other",
            remedy="remove it, or remove the tie that locks it",
        )
    if len(form) == 1 and next(iter(form)) in taken:
        coordinate, scale = next(iter(form.items()))
        taken[coordinate].append((friction, scale))
        return
    if all(b in imposed for b in form):
        raise StructureError(
            f"friction '{friction.owner}' acts between imposed motions, which it cannot hold",
            remedy="remove it, or impose the motion through a spring",
        )
    if all(b in taken or b in imposed for b in form):
        owners = sorted({entry.owner for b in form for entry, _ in taken.get(b, [])})
        raise StructureError(
            f"friction '{friction.owner}' closes a loop with {', '.join(owners)}",
            remedy="several stuck joints in a loop have no unique reaction; remove one, or put a spring in the loop",
        )
    pivot = basis.pick(form, set(taken) | imposed)
    if len(form) == 1:
        taken[pivot] = [(friction, form[pivot])]
        return
    kind = basis.net.motions[next(iter(friction.terms))].kind
    taken[_relative(basis, form, pivot, f"{friction.owner}.relative", kind)] = [(friction, ca.SX(1))]


def _weights(net: Net) -> list[Expression]:
    """Efficiency weight of each balance: equal across ties, masses, velocities and friction, eta across a lossy tie."""
    weights: dict[int, Expression] = {}
    everything = [m.index for m in net.motions] + [v.index for v in net.velocities]
    edges: dict[int, list[tuple[int, Expression, str]]] = {index: [] for index in everything}

    def join(a: int, b: int, ratio: Expression, owner: str) -> None:
        edges[a].append((b, 1 / ratio, owner))
        edges[b].append((a, ratio, owner))

    for tie in net.ties:
        if tie.efficiency is not None:
            entering, leaving, eta = tie.efficiency
            join(entering, leaving, ca.SX(eta), tie.owner)
        else:
            first, *rest = tie.terms
            for other in rest:
                join(first, other, ca.SX(1), tie.owner)
    for i, j in net.masses:
        if i != j:
            join(i, j, ca.SX(1), (net.motions[i] if i >= 0 else net.velocities[-1 - i]).name)
    for velocity in net.velocities:
        for index in velocity.terms:
            join(velocity.index, index, ca.SX(1), velocity.name)
    for friction in net.frictions:
        first, *rest = friction.terms
        for other in rest:
            join(first, other, ca.SX(1), friction.owner)
    for start in sorted(everything, reverse=True):
        if start in weights:
            continue
        weights[start] = ca.SX(1)
        queue = [start]
        while queue:
            here = queue.pop()
            for there, ratio, owner in edges[here]:
                value = weights[here] * ratio
                if there not in weights:
                    weights[there] = value
                    queue.append(there)
                elif not _same(weights[there], value):
                    raise StructureError(
                        f"'{owner}' closes a loop around a gear with losses",
                        remedy="set that gear's efficiency to 1, or put a spring into the loop",
                    )
    return [weights[index] for index in everything]


def _same(a: Expression, b: Expression) -> bool:
    """Whether two products of efficiencies agree at random values of their symbols."""
    symbols = ca.symvar(ca.vertcat(a, b))
    function = ca.Function("same", [ca.vertcat(*symbols)], [a - b])
    trial = np.array([0.37 + 0.19 * i for i in range(len(symbols))])
    return abs(float(function(trial))) < 1e-12


def _names(motions: list[Motion], terms: Row) -> str:
    return ", ".join(motions[i].name for i in terms)
