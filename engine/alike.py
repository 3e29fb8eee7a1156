"""Systems that differ in values alone are assembled once.

The search for what a model lacks builds each effect at several sizes, and every fit of it anew. A block's parameters
are symbols in its law, so a system that differs from another in their values has the same equations, unless the
assembly looked at a value: a spring without stiffness is a rigid joint. What it looked at is noted, and a model stands
for another system only where that answers alike.
"""

from __future__ import annotations

import copy
import threading
from collections import OrderedDict
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, cast

import casadi as ca
import numpy as np

from engine.block import Block
from engine.mechanics import Masses
from engine.model import Model
from engine.parameters import Parameters
from engine.ports import Expression
from engine.stamps import ModelParameter
from engine.system import Formula, System

MOST = 100
"""Forms of systems whose models are kept."""
ALIKE = 8
"""Models that are kept of one form."""


@dataclass
class Looked:
    """What the assembly of a system asked of its values.

    Attributes:
        values: of parameters of blocks, by block and name.
        answers: whether such a value differs from a number.
        parameters: names of parameters of the model.
    """

    values: dict[tuple[str, str], Any] = field(default_factory=dict)
    answers: dict[tuple[str, str, float], bool] = field(default_factory=dict)
    parameters: set[str] = field(default_factory=set)

    def note(self, expression: Expression) -> None:
        """The value of an expression of parameters counts."""
        self.parameters.update(symbol.name() for symbol in ca.symvar(expression))

    def at(self, name: str, block: Block) -> Block:
        """A copy of a block that notes here what is asked of its values."""
        made = copy.copy(block)
        watched = _Watched(block.values, name, self)
        made.values, made._differs = cast("dict[str, Any]", watched), watched.differs
        return made


class _Watched(Mapping[str, Any]):
    """The values of a block, each noted when it is read."""

    def __init__(self, values: Mapping[str, Any], block: str, looked: Looked) -> None:
        self._values, self._block, self._looked = values, block, looked

    def __getitem__(self, name: str) -> Any:
        value = self._values[name]
        self._looked.values[self._block, name] = value
        return value

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def differs(self, name: str, other: float) -> bool:
        answer = bool(self._values[name] != other)
        self._looked.answers[self._block, name, other] = answer
        return answer


class _Same:
    """Something that is equal to itself alone."""

    def __init__(self, it: object) -> None:
        self._it = it

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other._it is self._it

    def __hash__(self) -> int:
        return id(self._it)


def form(system: System, inputs: list[str], outputs: list[str] | None, energy: bool, smooth_readings: bool) -> Hashable:
    """Equal for systems that differ in the values of parameters alone, of the same arguments as `engine.assemble`."""
    shared = [
        (block, name, _Same(given) if isinstance(given, Formula) else given)
        for block, names in system.shared.items()
        for name, given in names.items()
    ]
    return (
        (system.name, system.description, energy, smooth_readings),
        tuple((name, block._form) for name, block in system.blocks.items()),
        tuple(connection.ends for connection in system.connections),
        tuple(shared),
        tuple(system.initial.items()),
        tuple(system.exposed.items()),
        tuple(inputs),
        None if outputs is None else tuple(outputs),
    )


@dataclass(frozen=True)
class Assembled:
    """A model, and when it stands for another system of its form.

    Attributes:
        model: it.
        blocks: names of those that it is made of; inputs from outside may leave some out.
        looked: what was asked of values.
        decisive: values of the parameters that count.
        masses: the mass matrix, if anything moves.
    """

    model: Model
    blocks: tuple[str, ...]
    looked: Looked
    decisive: Mapping[str, float]
    masses: Masses | None

    def at(self, system: System, parameters: Mapping[str, ModelParameter]) -> Model | None:
        """The model of another system of the form; None if that may have other equations.

        Args:
            system: it.
            parameters: those of its blocks.
        """
        blocks, looked = system.blocks, self.looked
        alike = (
            all(blocks[block].values[name] == value for (block, name), value in looked.values.items())
            and all(
                blocks[block].differs(name, other) == answer for (block, name, other), answer in looked.answers.items()
            )
            and all(parameters[name].value == value for name, value in self.decisive.items())
        )
        if not alike:
            return None
        values = np.array([entry.value for entry in parameters.values()])
        if self.masses is not None and self.masses.lacking(values) is not None:
            return None
        return self.model.with_parameters([parameters[entry.name] for entry in self.model.parameters])


_kept: OrderedDict[Hashable, list[Assembled]] = OrderedDict()
_lock = threading.Lock()


def known(key: Hashable, system: System) -> Model | None:
    """The model of a system, if one of its form was assembled whose equations are the same.

    Raises:
        FlexarmError: blocks share a parameter and give it different values.
    """
    with _lock:
        found = list(_kept.get(key, ()))
        if found:
            _kept.move_to_end(key)
    parameters = Parameters(system).of_blocks(found[0].blocks) if found else {}
    return next((model for one in found if (model := one.at(system, parameters)) is not None), None)


def keep(key: Hashable, made: Assembled) -> None:
    """Keep a model for systems of its form."""
    with _lock:
        found = _kept.setdefault(key, [])
        found.insert(0, made)
        del found[ALIKE:]
        while len(_kept) > MOST:
            _kept.popitem(last=False)
