"""The parameters of a system: each block's own, those that several share, and those that formulas read."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import casadi as ca

from engine.errors import ConnectionProblem
from engine.ports import Expression
from engine.quantity import Parameter
from engine.stamps import ModelParameter
from engine.system import Formula, System


class Parameters:
    """Parameters in the order in which they are met.

    Args:
        system: whose blocks have them.

    Attributes:
        entries: by name.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self.entries: dict[str, ModelParameter] = {}
        self._unbounded: set[str] = set()  # those that so far only formulas read, which no block bounds

    def of_blocks(self, names: Iterable[str]) -> dict[str, ModelParameter]:
        """The parameters of some blocks, by name.

        Raises:
            ConnectionProblem: several blocks share one and give it different values.
        """
        for block in names:
            for declared in self.system.blocks[block].parameters:
                self.of(block, declared)
        return self.entries

    def of(self, block_name: str, name: str) -> Any:
        """What a block's law has for a parameter: a symbol, an expression of others, or a structural value."""
        block = self.system.blocks[block_name]
        declared, value = block.parameters[name], block.values[name]
        if declared.structural:
            return value
        alias = block.same_as(name)
        if alias is not None:
            return self.of(block_name, alias)
        if declared.unit == "*":
            declared = replace(declared, unit=block.unit_of(name))
        own = f"{block_name}.{name}"
        common = self.system.shared.get(block_name, {}).get(name)
        if declared.size:
            return ca.vertcat(*[self._symbol(f"{own}[{i + 1}]", v, declared, own) for i, v in enumerate(value)])
        if isinstance(common, Formula):
            return common.law({name: self._argument(name, *given, own) for name, given in common.arguments.items()})
        return self._symbol(common or own, value, declared, own)

    def _argument(self, name: str, unit: str, value: float, user: str) -> Expression:
        """The symbol of a parameter that a formula reads: that of a block which has it too, or one without bounds."""
        known = self.entries.get(name)
        if known is None:
            self._unbounded.add(name)
            made = ModelParameter(name, ca.SX.sym(name), value, Parameter(name, unit, ..., "parameter of the scenario"))
            known = self.entries[name] = made
        if not math.isclose(known.value, value, rel_tol=1e-12):
            raise ConnectionProblem(f"parameter '{name}' is {known.value} in {known.users[0]} but {value} in {user}")
        known.users.append(user)
        return known.symbol

    def _symbol(self, name: str, value: float, declared: Any, user: str) -> Expression:
        known = self.entries.get(name)
        if known is None:
            known = ModelParameter(name, ca.SX.sym(name), float(value), declared.signed(float(value)))
            self.entries[name] = known
        elif name in self._unbounded and math.isclose(known.value, value, rel_tol=1e-12):
            known.value, known.declared = float(value), declared.signed(float(value))
            self._unbounded.discard(name)
        elif known.value != value:
            raise ConnectionProblem(f"parameter '{name}' is {known.value} in {known.users[0]} but {value} in {user}")
        known.users.append(user)
        return known.symbol
