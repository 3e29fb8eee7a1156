"""The parameters of a scenario that its values refer to: ``$name``, and expressions of several."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from engine.errors import ParameterError, Where, nearest
from engine.quantity import coherent, split
from scenarios.document import Node
from scenarios.expressions import DEEPEST, PLAIN, Amount, Powers, amount, evaluate, is_expression
from scenarios.validate import ScenarioError

NAME = re.compile(r"\$([A-Za-z_]\w*)")


@dataclass(frozen=True)
class Common:
    """A scenario parameter: its full name in the model, and the value written for it."""

    name: str
    node: Node
    scope: Scope = field(default_factory=dict, repr=False, compare=False)


Scope = dict[str, Common]


@dataclass(frozen=True)
class Term:
    """An expression with its parameters looked up: each the name of a common parameter, or an expression again.

    Attributes:
        text: the expression.
        leaves: name in the text -> what it stands for.
    """

    text: str
    leaves: dict[str, Term | Leaf]

    def amount(self, values: Mapping[str, Any]) -> Amount:
        """Its amount, for values (numbers or symbols, SI) of the common parameters by name."""
        return evaluate(self.text, lambda name: self.leaves[name].amount(values))

    def __call__(self, values: Mapping[str, Any]) -> Any:
        """Its value alone."""
        return self.amount(values).value

    def common(self) -> dict[str, Leaf]:
        """Every common parameter in it."""
        return {name: leaf for part in self.leaves.values() for name, leaf in part.common().items()}


@dataclass(frozen=True)
class Leaf:
    """A common parameter: its name, coherent SI unit, value and powers of base units."""

    name: str
    unit: str
    value: float
    powers: Powers

    def amount(self, values: Mapping[str, Any]) -> Amount:
        """Its amount, for values of the common parameters by name."""
        return Amount(values[self.name], self.powers)

    def common(self) -> dict[str, Leaf]:
        """Itself."""
        return {self.name: self}


def root_scope(document: Node) -> Scope:
    """The parameters of the outermost file."""
    scope: Scope = {}
    scope |= {name: Common(name, node, scope) for name, node in (document.get("parameters") or Node({})).items()}
    return scope


def lookup(text: str, scope: Scope, where: Where) -> Common:
    """The parameter that ``$name`` stands for.

    Raises:
        ScenarioError: no such parameter.
    """
    name = text[1:].strip()
    if name not in scope:
        raise ScenarioError(f"'${name}' names no parameter of the scenario", where, nearest(name, scope))
    return scope[name]


def substitute(node: Node, scope: Scope, where: Where) -> Any:
    """The plain value with every ``$name`` replaced by the parameter's value, and every expression worked out.

    Raises:
        ScenarioError: no such parameter, an expression that cannot be read, or units that do not fit.
    """
    scope = node.scope if node.scope is not None else scope
    if isinstance(node.value, list):
        return [substitute(item, scope, where) for item in node.value]
    made = term(node.value, scope, where)
    if made is not None:
        return worked_out(made, where)
    if isinstance(node.value, str) and node.value.startswith("$"):
        return lookup(node.value, scope, where).node.value
    return node.plain()


def read_by(node: Node, scope: Scope, where: Where) -> list[str]:
    """Names of the common parameters that a value, or any value of a list, is or reads."""
    scope = node.scope if node.scope is not None else scope
    if isinstance(node.value, list):
        return [name for item in node.value for name in read_by(item, scope, where)]
    if (made := term(node.value, scope, where)) is not None and made.leaves:
        return list(made.common())
    plain = isinstance(node.value, str) and PLAIN.fullmatch(node.value)
    return [lookup(node.value, scope, where).name] if plain else []


def worked_out(made: Term, where: Where) -> float | str:
    """The value of an expression as a scenario would state it: a number, or a text with its unit."""
    try:
        found = made.amount({name: leaf.value for name, leaf in made.common().items()})
    except ParameterError as error:
        raise error.at(where) from None
    return float(found.value) if not found.powers else f"{float(found.value)!r} {found.unit}"


def term(value: object, scope: Scope, where: Where, above: tuple[str, ...] = ()) -> Term | None:
    """The expression that a value is, or that the parameter is which it names; None for anything else.

    Raises:
        ScenarioError: no such parameter, or one that depends on itself.
    """
    if isinstance(value, str) and PLAIN.fullmatch(value):
        common = lookup(value, scope, where)
        inner = common.node.scope if common.node.scope is not None else common.scope
        if common.name in above:
            raise ScenarioError(
                f"parameter '{common.name}' depends on itself: {' -> '.join((*above, common.name))}", where
            )
        return term(common.node.value, inner, common.node.where(), (*above, common.name))
    if not is_expression(value):
        return None
    if len(above) > DEEPEST:
        raise ScenarioError(f"parameters depend on each other over more than {DEEPEST} steps", where)
    text, leaves = str(value), dict[str, Term | Leaf]()
    for name in dict.fromkeys(NAME.findall(text)):
        found, common = term(f"${name}", scope, where, above), lookup(f"${name}", scope, where)
        if found is not None and not found.leaves:  # an expression of numbers is a parameter like a number
            made = found.amount({})
            leaves[name] = Leaf(common.name, made.unit, made.value, made.powers)
        else:
            leaves[name] = found if found is not None else _leaf(common)
    return Term(text, leaves)


def _leaf(common: Common) -> Leaf:
    given = common.node.value
    try:
        found = amount(given)
        unit = coherent(split(given)[1])[1] if isinstance(given, str) and split(given)[1] else "1"
    except ParameterError as error:
        raise ScenarioError(f"${common.name.rsplit('.', 1)[-1]}: {error.message}", common.node.where()) from None
    return Leaf(common.name, unit, found.value, found.powers)
