"""Sums and products of a function in the order that costs least, before any code is made of it.

What depends on parameters or modes alone is multiplied out and added up beforehand: ``c (k x)`` becomes ``(c k) x``,
``k (x - y - g)`` becomes ``k (x - y) + (-k g)``, and what a mode adds or takes away a coefficient, ``(s ? k : 0) x``.
What is left is summed as it becomes known: a step waits for what follows from the newest speeds, so these come last.

A function is seen as terms, a coefficient times atoms each. An atom is an input, the result of another operation, or
a sum or product that several terms share. Nothing is multiplied out where that would take more operations.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import casadi as ca

from engine.operations import CALLED, COSTLY

CONSTANT, PARAMETER, MODE, STATE = range(4)
"""Levels of nodes: what they depend on, and so how often they are computed."""

_FEW, _DIVISION, _ROOT, _CALL = 4, 14, 18, 50
_TIMES = {ca.OP_NEG: 1, ca.OP_IF_ELSE_ZERO: 3, ca.OP_DIV: _DIVISION, ca.OP_INV: _DIVISION, ca.OP_SQRT: _ROOT}
_EARLY = -1000
"""When what is not a state is known."""
_STAGE = 2 * _FEW
"""Cycles that an operation takes, about; and those from a rate to the state of the next stage."""
_FACTORED = frozenset({ca.OP_NEG, ca.OP_TWICE, ca.OP_MUL, ca.OP_SQ, ca.OP_INV, ca.OP_DIV})
_MOST = 12
"""Factors of a coefficient that are told apart."""

_LEAST = 1e-100
"""Numbers beyond this and its reciprocal are not worked with."""

Factors = tuple[int, ...]
Coefficient = tuple[float, Factors]
"""A number, and nodes that it is multiplied by, in order."""
Form = dict[Factors, Coefficient]
"""A sum of products: the coefficient of each product of atoms; that of no atom is a constant."""
ONE: Coefficient = (1.0, ())


class Graph(Protocol):
    """Of scalar operations; see `engine.codegen.Emitter`."""

    nodes: list[tuple[Any, ...]]
    levels: list[int]

    def node(self, *key: Any) -> int:
        """The node of an operation and its operands, of ``"const"`` and a number, or of ``"input"`` and its place."""


def copied(source: Graph, nodes: Sequence[int], target: Graph, known: dict[int, int] | None = None) -> list[int]:
    """Nodes of the target like those of the source; what is known is not copied again."""
    made = {} if known is None else known
    queue = list(reversed(nodes))
    while queue:
        node = queue[-1]
        key = source.nodes[node]
        operands = () if key[0] in ("const", "input") else key[1:]
        if node not in made and (wanted := [operand for operand in operands if operand not in made]):
            queue += reversed(wanted)
            continue
        queue.pop()
        if node not in made:
            made[node] = target.node(key[0], *(made[o] for o in operands)) if operands else target.node(*key)
    return [made[node] for node in nodes]


class Algebra:
    """Writes a function anew.

    Args:
        source: holds the function as it is given.
        results: the function's.
        target: receives the new one.
        rates: whether the results are those of the states, in order, so that each stage of a step waits for the last.
    """

    def __init__(self, source: Graph, results: Sequence[int], target: Graph, *, rates: bool) -> None:
        self._source, self._results, self._target = source, results, target
        self._copies: dict[int, int] = {}
        self._coefficients: dict[int, Coefficient] = {}
        self._forms: dict[int, Form] = {}
        self._atoms: dict[Any, int] = {}
        self._parts: list[tuple[Any, ...]] = []
        self._tame: list[bool] = []
        self._made: dict[int, int] = {}
        self._pairs: Counter[tuple[Coefficient, int]] = Counter()
        self._scales: dict[int, tuple[Coefficient, Coefficient]] = {}
        self._ready: dict[int, int] = {}
        self._order = self._reached(results)
        self._uses = Counter(results)
        self._shifted: Counter[int] = Counter()
        for node in self._order:
            operands = self._operands(node)
            self._uses.update(operands)
            if source.nodes[node][0] in (ca.OP_ADD, ca.OP_SUB) and not all(map(self._changes, operands)):
                self._shifted.update(operands)
        self._late: dict[int, int] = {}
        given = self._times()
        if rates:
            last = [given.get(node, 0) for node in results]
            self._late = {place: time + _STAGE - max(last, default=0) for place, time in enumerate(last)}
            given = self._times()
        self._given = given

    def results(self) -> list[int]:
        """Nodes of the target that have the results as values."""
        for node in self._order:
            self._forms[node] = self._form(node)
        forms = [self._forms[node] if self._changes(node) else None for node in self._results]
        needed, atoms = self._needed([form for form in forms if form is not None])
        self._rescale(needed)
        for form in needed:
            for factors, coefficient in self._terms(form):
                if len(factors) > 1 and not _is_unit(coefficient):
                    self._pairs.update((_plain(coefficient), atom) for atom in set(factors))
        for atom in sorted(atoms):  # in which each follows those that it is made of
            self._made[atom] = self._atomic(atom)
        pairs = zip(self._results, forms, strict=True)
        return [self._copied(node) if form is None else self._sum(form) for node, form in pairs]

    # -- the function as it is given ---------------------------------------------------------------------------------

    def _changes(self, node: int) -> bool:
        return self._source.levels[node] == STATE

    def _operands(self, node: int) -> tuple[int, ...]:
        key = self._source.nodes[node]
        return () if key[0] in ("const", "input") else key[1:]

    def _reached(self, results: Sequence[int]) -> list[int]:
        seen: set[int] = set()
        queue = [node for node in results if self._changes(node)]
        while queue:
            node = queue.pop()
            if node not in seen:
                seen.add(node)
                queue += [operand for operand in self._operands(node) if self._changes(operand)]
        return sorted(seen)

    def _times(self) -> dict[int, int]:
        """When each node is known, in cycles from when the last state is."""
        found: dict[int, int] = {}
        for node in self._order:
            key = self._source.nodes[node]
            if key[0] == "input":
                found[node] = self._late.get(key[2], 0) if key[1] == "x" else _EARLY
            else:
                found[node] = max(found.get(o, _EARLY) for o in key[1:]) + _TIMES.get(
                    key[0], _CALL if key[0] in COSTLY else _FEW
                )
        return found

    # -- coefficients ------------------------------------------------------------------------------------------------

    def _copied(self, node: int) -> int:
        """A node of the target for one that does not change all the time."""
        return copied(self._source, [node], self._target, self._copies)[0]

    def _coefficient(self, node: int) -> Coefficient:
        """The factors of a node that does not change all the time."""
        known, queue = self._coefficients, [node]
        while queue:
            last = queue[-1]
            operation, *operands = self._source.nodes[last]
            wanted = [operand for operand in operands if operand not in known] if operation in _FACTORED else []
            if wanted:
                queue += wanted
            else:
                known[last] = self._factored(last) or (1.0, (self._copied(last),))
                queue.pop()
        return known[node]

    def _factored(self, node: int) -> Coefficient | None:
        known, (operation, *operands) = self._coefficients, self._source.nodes[node]
        if operation == "const":
            return (float(operands[0]), ())
        if operation == ca.OP_NEG:
            return _scaled(known[operands[0]], -1.0)
        if operation == ca.OP_TWICE:
            return _scaled(known[operands[0]], 2.0)
        if operation in (ca.OP_MUL, ca.OP_SQ):
            return self._product(known[operands[0]], known[operands[-1]])
        if operation == ca.OP_INV:
            return self._inverse(known[operands[0]])
        if operation == ca.OP_DIV:
            below = self._inverse(known[operands[1]])
            return None if below is None else self._product(known[operands[0]], below)
        return None

    def _product(self, a: Coefficient, b: Coefficient) -> Coefficient | None:
        factors = list(a[1])
        for factor in b[1]:
            inverse = self._inverted(factor)
            if inverse in factors:
                factors.remove(inverse)
            else:
                factors.append(factor)
        number = a[0] * b[0]
        if len(factors) > _MOST or not _LEAST < abs(number) < 1 / _LEAST:
            return None
        return number, tuple(sorted(factors))

    def _multiple(self, a: Coefficient, b: Coefficient) -> Coefficient:
        return self._product(a, b) or (1.0, (self._target.node(ca.OP_MUL, self._value(a), self._value(b)),))

    def _inverse(self, a: Coefficient) -> Coefficient | None:
        if not _LEAST < abs(a[0]) < 1 / _LEAST:
            return None
        return 1.0 / a[0], tuple(sorted(self._inverted(factor) for factor in a[1]))

    def _inverted(self, factor: int) -> int:
        key = self._target.nodes[factor]
        return int(key[1]) if key[0] == ca.OP_INV else self._target.node(ca.OP_INV, factor)

    def _value(self, a: Coefficient) -> int:
        """The node of a coefficient."""
        number, factors = a
        factors = tuple(sorted(factors, key=lambda factor: (self._target.levels[factor], factor)))
        made = None
        for factor in factors:
            made = factor if made is None else self._target.node(ca.OP_MUL, made, factor)
            if number != 1 and made == factors[0]:
                made = self._target.node(ca.OP_MUL, self._target.node("const", number), made)
        return self._target.node("const", number) if made is None else made

    def _total(self, a: Coefficient, b: Coefficient) -> Coefficient:
        if a[1] == b[1]:
            return a[0] + b[0], a[1]
        if b[0] < 0:
            return (1.0, (self._target.node(ca.OP_SUB, self._value(a), self._value(_scaled(b, -1.0))),))
        return (1.0, (self._target.node(ca.OP_ADD, self._value(a), self._value(b)),))

    # -- terms -------------------------------------------------------------------------------------------------------

    def _form(self, node: int) -> Form:
        """What stands for a node where it is used; to several users a sum or a product is one atom.

        A constant stays beside it if all of them add another one.
        """
        form = self._expanded(node)
        if self._uses[node] == 1:
            return form
        terms = {factors: coefficient for factors, coefficient in form.items() if factors}
        if len(terms) > 1:
            if self._shifted[node] < self._uses[node]:
                return self._single(form)
            return self._single(terms) | {factors: c for factors, c in form.items() if not factors}
        return {self._bound(factors): coefficient for factors, coefficient in form.items()}

    def _bound(self, factors: Factors) -> Factors:
        return factors if len(factors) < 2 else (self._atom("product", factors),)

    def _of(self, node: int) -> Form:
        """What stands for an operand."""
        return self._forms[node] if self._changes(node) else {(): self._coefficient(node)}

    def _expanded(self, node: int) -> Form:
        operation, *operands = self._source.nodes[node]
        if operation == "input":
            return {(self._atom("input", *operands),): ONE}
        if operation in (ca.OP_ADD, ca.OP_SUB):
            return self._added(self._of(operands[0]), self._of(operands[1]), -1.0 if operation == ca.OP_SUB else 1.0)
        if operation in (ca.OP_NEG, ca.OP_TWICE):
            return self._scale(self._of(operands[0]), (-1.0 if operation == ca.OP_NEG else 2.0, ()))
        if operation in (ca.OP_MUL, ca.OP_SQ):
            first, second = operands[0], operands[-1]
            for one, other in ((first, second), (second, first)):
                if not self._changes(one):
                    return self._scale(self._of(other), self._coefficient(one))
            return self._multiplied(self._of(first), self._of(second))
        if operation == ca.OP_DIV and all(self._changes(operand) for operand in operands):
            return self._divided(*operands)
        if operation == ca.OP_IF_ELSE_ZERO and not self._changes(operands[0]):
            return self._conditional(self._copied(operands[0]), self._of(operands[1]))
        parts = [
            self._key(self._of(operand)) if self._changes(operand) else self._copied(operand) for operand in operands
        ]
        return {(self._atom(operation, *parts),): ONE}

    def _added(self, a: Form, b: Form, sign: float) -> Form:
        sums = dict(a)
        for factors, coefficient in b.items():
            other = _scaled(coefficient, sign)
            sums[factors] = self._total(sums[factors], other) if factors in sums else other
            if sums[factors][0] == 0:
                del sums[factors]
        return sums

    def _scale(self, form: Form, by: Coefficient) -> Form:
        """A multiple; multiplied out where the terms have coefficients of their own."""
        if by[0] == 0:
            return {}
        if not _is_unit(by):
            form = self._gathered(form)
        return {factors: self._multiple(coefficient, by) for factors, coefficient in form.items()}

    def _gathered(self, form: Form) -> Form:
        """A sum as it is, or as one atom and a constant if to multiply each of its terms would take more operations."""
        terms = {factors: coefficient for factors, coefficient in form.items() if factors}
        bare = sum(_is_unit(coefficient) for coefficient in terms.values())
        if len(terms) < 2 or (bare < 2 and len({_plain(coefficient) for coefficient in terms.values()}) > 1):
            return form
        return self._single(terms) | {factors: coefficient for factors, coefficient in form.items() if not factors}

    def _single(self, form: Form) -> Form:
        """A sum as one term: an atom, times what all of its terms are multiplied by."""
        if len(form) < 2:
            return dict(form) or {(): (0.0, ())}
        common = {_plain(coefficient) for coefficient in form.values()}
        by = ONE
        if len(common) == 1:
            by = common.pop()
            form = {factors: (coefficient[0] / by[0], ()) for factors, coefficient in form.items()}
        return {(self._atom("sum", self._key(form)),): by}

    def _multiplied(self, a: Form, b: Form) -> Form:
        ((first, one),), ((second, other),) = self._single(a).items(), self._single(b).items()
        if one[0] == 0 or other[0] == 0:
            return {}
        return {tuple(sorted((*first, *second))): self._multiple(one, other)}

    def _divided(self, above: int, below: int) -> Form:
        """A quotient; a product with the reciprocal where that is known before."""
        ((over, one),), ((under, other),) = self._single(self._of(above)).items(), self._single(self._of(below)).items()
        inverse = self._inverse(other)
        if inverse is None:
            return {(self._atom(ca.OP_DIV, self._key(self._of(above)), self._key(self._of(below))),): ONE}
        by = self._multiple(one, inverse)
        if self._given[below] + _DIVISION - _FEW < self._given[above] or not over:
            return {tuple(sorted((*over, self._atom(ca.OP_INV, self._key({under: ONE}))))): by}
        return {(self._atom(ca.OP_DIV, self._key({over: ONE}), self._key({under: ONE})),): by}

    def _conditional(self, condition: int, form: Form) -> Form:
        """What holds in some modes; the condition is one of coefficients where nothing can be infinite elsewhere."""
        if all(self._tame[atom] for factors in form for atom in factors):
            return {
                factors: self._where(condition, coefficient) for factors, coefficient in self._gathered(form).items()
            }
        ((factors, coefficient),) = self._single(form).items()
        atom = self._atom(ca.OP_IF_ELSE_ZERO, condition, self._key({factors: ONE}))
        return {(atom,): self._where(condition, coefficient) if not _is_unit(coefficient) else coefficient}

    def _where(self, condition: int, coefficient: Coefficient) -> Coefficient:
        return (1.0, (self._target.node(ca.OP_IF_ELSE_ZERO, condition, self._value(coefficient)),))

    @staticmethod
    def _key(form: Form) -> tuple[tuple[Factors, Coefficient], ...]:
        return tuple(sorted(form.items()))

    def _atom(self, *key: Any) -> int:
        if key not in self._atoms:
            self._atoms[key] = len(self._parts)
            self._parts.append(key)
            inside = {atom for form in self._forms_in(self._atoms[key]) for factors in form for atom in factors}
            self._tame.append(isinstance(key[0], str) and all(self._tame[atom] for atom in inside))
        return self._atoms[key]

    # -- the function anew -------------------------------------------------------------------------------------------

    def _forms_in(self, atom: int) -> list[Form]:
        """The sums that an atom is made of."""
        operation, *parts = self._parts[atom]
        if operation == "input":
            return []
        if operation == "product":
            return [{parts[0]: ONE}]
        return [dict(part) for part in parts if isinstance(part, tuple)]

    def _needed(self, results: list[Form]) -> tuple[list[Form], set[int]]:
        """The results and the sums that they need, and their atoms."""
        forms, seen = list(results), set[int]()
        for form in forms:  # which grows
            for factors in form:
                for atom in factors:
                    if atom not in seen:
                        seen.add(atom)
                        forms += self._forms_in(atom)
        return forms, seen

    def _rescale(self, needed: list[Form]) -> None:
        """Take a division by a parameter from a sum's users into its coefficients, where fewer products are left."""
        uses: dict[int, list[Coefficient]] = {}
        for form in needed:
            for factors, coefficient in form.items():
                for atom in factors:
                    if self._parts[atom][0] == "sum":
                        uses.setdefault(atom, []).append(_plain(coefficient))
        for atom, coefficients in uses.items():
            for by in dict.fromkeys(coefficients):
                if by[1] and all(self._target.nodes[factor][0] == ca.OP_INV for factor in by[1]):
                    back = self._inverse(by)
                    assert back is not None
                    inside = [coefficient for _, coefficient in self._parts[atom][1]]
                    if self._products(inside, by) + self._products(coefficients, back) < 0:
                        self._scales[atom] = by, back
                        break

    def _products(self, coefficients: Sequence[Coefficient], by: Coefficient) -> int:
        """How many multiplications more there are once these are multiplied."""
        return sum(_is_unit(c) - _is_unit(self._multiple(c, by)) for c in coefficients)

    def _terms(self, form: Form) -> list[tuple[Factors, Coefficient]]:
        """The terms of a sum, for atoms as they are scaled."""
        terms = []
        for factors, coefficient in sorted(form.items()):
            for atom in factors:
                if atom in self._scales:
                    coefficient = self._multiple(coefficient, self._scales[atom][1])
            terms.append((factors, coefficient))
        return terms

    def _node(self, *key: Any) -> int:
        made = self._target.node(*key)
        if made not in self._ready:
            if key[0] == "input":
                time = self._late.get(key[2], 0) if key[1] == "x" else _EARLY
            elif key[0] == "const":
                time = _EARLY
            else:
                known = (self._ready.get(o, _EARLY) for o in self._target.nodes[made][1:])
                time = max(known) + _TIMES.get(key[0], _CALL if key[0] in COSTLY else _FEW)
            self._ready[made] = time if self._target.levels[made] == STATE else _EARLY
        return made

    def _when(self, node: int) -> int:
        """When a node is known, as `_times`."""
        return self._ready.get(node, _EARLY)

    def _atomic(self, atom: int) -> int:
        """The node of an atom, once those that it is made of have theirs."""
        operation, *parts = self._parts[atom]
        if operation == "input":
            return self._node("input", *parts)
        if operation == "product":
            return self._sum({parts[0]: ONE})
        if operation == "sum":
            by = self._scales.get(atom, (ONE, ONE))[0]
            return self._sum({factors: self._multiple(coefficient, by) for factors, coefficient in parts[0]})
        return self._node(operation, *(self._sum(dict(part)) if isinstance(part, tuple) else part for part in parts))

    def _joined(self, factors: Factors, first: int | None = None) -> int:
        """The product of atoms, and of another node."""
        nodes = [self._made[atom] for atom in factors] + ([] if first is None else [first])
        return self._reduced([(node, 1) for node in nodes], lambda a, b: (self._node(ca.OP_MUL, a[0], b[0]), 1))[0]

    def _reduced(self, parts: list[tuple[int, int]], join: Callable[..., tuple[int, int]]) -> tuple[int, int]:
        """What is left of nodes and their signs when two at a time are joined, those first that are known first."""
        heap = [(self._when(node), place, (node, sign)) for place, (node, sign) in enumerate(parts)]
        heapq.heapify(heap)
        count = len(heap)
        while len(heap) > 1:
            (_, p, a), (_, q, b) = heapq.heappop(heap), heapq.heappop(heap)
            made = join(a, b) if p < q else join(b, a)
            heapq.heappush(heap, (self._when(made[0]), count, made))
            count += 1
        result: tuple[int, int] = heap[0][2]
        return result

    def _term(self, factors: Factors, coefficient: Coefficient) -> tuple[int, int]:
        """Node and sign of a term."""
        sign = -1 if coefficient[0] < 0 else 1
        plain = _plain(coefficient)
        if not factors:
            return self._value(plain), sign
        if plain == ONE:
            return self._joined(factors), sign
        value = self._value(plain)
        nodes = {atom: self._made[atom] for atom in factors}
        if self._target.levels[value] == MODE and any(self._parts[atom][0] in CALLED for atom in factors):
            product = self._node(ca.OP_MUL, value, self._joined(factors))
            return self._node(ca.OP_IF_ELSE_ZERO, value, product), sign
        chosen = min(factors, key=lambda atom: (-self._pairs[plain, atom], self._when(nodes[atom]), atom))
        others = list(factors)
        others.remove(chosen)
        return self._joined(tuple(others), self._node(ca.OP_MUL, value, nodes[chosen])), sign

    def _sum(self, form: Form) -> int:
        """The node of a sum; what several terms are multiplied by is multiplied once."""
        groups: dict[Coefficient, list[tuple[Factors, Coefficient]]] = {}
        for factors, coefficient in self._terms(form):
            groups.setdefault(_plain(coefficient) if factors else ONE, []).append((factors, coefficient))
        parts = []
        for plain, terms in groups.items():
            if plain == ONE or len(terms) == 1:
                parts += [self._term(*term) for term in terms]
            else:
                inner, sign = self._reduced(
                    [self._term(factors, (c[0] / plain[0], ())) for factors, c in terms], self._plus
                )
                parts.append((self._node(ca.OP_MUL, self._value(plain), inner), sign))
        if not parts:
            return self._target.node("const", 0.0)
        node, sign = self._reduced(parts, self._plus)
        return node if sign > 0 else self._node(ca.OP_NEG, node)

    def _plus(self, a: tuple[int, int], b: tuple[int, int]) -> tuple[int, int]:
        if a[1] == b[1]:
            return self._node(ca.OP_ADD, a[0], b[0]), a[1]
        one, other = (a, b) if a[1] > 0 else (b, a)
        return self._node(ca.OP_SUB, one[0], other[0]), 1


def _scaled(a: Coefficient, by: float) -> Coefficient:
    return a[0] * by, a[1]


def _plain(a: Coefficient) -> Coefficient:
    """Without its sign."""
    return abs(a[0]), a[1]


def _is_unit(a: Coefficient) -> bool:
    return abs(a[0]) == 1 and not a[1]
