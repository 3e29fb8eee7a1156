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
        if declared.size:
            return ca.vertcat(*[self._of(block_name, f"{name}[{i}]", v, declared) for i, v in enumerate(value, 1)])
        return self._of(block_name, name, value, declared)

    def _of(self, block_name: str, name: str, value: float, declared: Parameter) -> Expression:
        """A parameter, or one value of a list: a symbol, or an expression of others."""
        own = f"{block_name}.{name}"
        common = self.system.shared.get(block_name, {}).get(name)
        if isinstance(common, Formula):
            return common.law({name: self._argument(name, *given, own) for name, given in common.arguments.items()})
        return self._symbol(common or own, value, declared, own)

    def _argument(self, name: str, unit: str, value: float, user: str) -> Expression:
        """The symbol of a parameter that a formula reads: that of a block which has it too, or one without bounds."""
        known = self.entries.get(name)
        if known is None:
            self._unbounded.add(name)
            declared = Parameter(name, unit, ..., "parameter of the scenario")
            known = ModelParameter(name, ca.SX.sym(name), value, declared, fixed=self.system.fixed_by(name))
            self.entries[name] = known
        if not math.isclose(known.value, value, rel_tol=1e-12):
            raise ConnectionProblem(f"parameter '{name}' is {known.value} in {known.users[0]} but {value} in {user}")
        known.users.append(user)
        return known.symbol

    def _symbol(self, name: str, value: float, declared: Any, user: str) -> Expression:
        known = self.entries.get(name)
        if known is None:
            declared, fixed = declared.signed(float(value)), self.system.fixed_by(name)
            known = self.entries[name] = ModelParameter(name, ca.SX.sym(name), float(value), declared, fixed=fixed)
        elif name in self._unbounded and math.isclose(known.value, value, rel_tol=1e-12):
            known.value, known.declared = float(value), declared.signed(float(value))
            self._unbounded.discard(name)
        elif known.value != value:
            raise ConnectionProblem(f"parameter '{name}' is {known.value} in {known.users[0]} but {value} in {user}")
        known.users.append(user)
        return known.symbol
