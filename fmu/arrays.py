"""Arrays of FMI 3: numbered states and parameters of one block as one variable.

``link.mode1.position`` to ``link.mode3.position`` are the elements of ``link.mode.position``, and ``arm.length[1]`` and
``arm.length[2]`` those of ``arm.length``. The elements keep their value references, one after another; the array has
that of its first, and the others are not described. Inputs and outputs stay scalar: they are what importers wire.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmu.variables import COORDINATE, DERIVATIVE, PARAMETER, STATE, FmuVariable, structured

_KINDS = (PARAMETER, STATE, DERIVATIVE, COORDINATE)
_ELEMENT = re.compile(r"(?P<block>.+)\.(?P<word>[^.\[\]\d]+)(?P<number>[1-9]\d*)(?P<quantity>\.[^.\[\]\d]+)?")
_INDEXED = re.compile(r"(?P<stem>.+)\[(?P<number>[1-9]\d*)\]")


@dataclass(frozen=True)
class Array:
    """An array variable of one dimension.

    Attributes:
        name: unique in the FMU.
        first: value reference of the array and of its first element.
        size: how many elements there are.
    """

    name: str
    first: int
    size: int

    def element(self, k: int) -> str:
        """Name of the k-th element, from 1."""
        if self.name.startswith("der("):
            return f"{self.name[:-1]}[{k}])"
        return f"{self.name}[{k}]"


def arrays(variables: Sequence[FmuVariable]) -> tuple[Array, ...]:
    """The arrays that can be made of an FMU's variables, in the order of their references.

    Elements are numbered from 1 without a gap, stand one after another and differ in number, start, nominal value and
    description alone. Only what a block numbers inside itself counts, so ``drive1.shaft.angle`` and
    ``drive2.shaft.angle``, of two blocks, stay as they are.
    """
    taken = {variable.name for variable in variables}
    found = []
    for key, run in itertools.groupby(variables, _key):
        elements = list(run)
        numbers = [_place(variable)[1] for variable in elements]
        if key is None or numbers != list(range(1, len(elements) + 1)):
            continue
        name = _name(elements[0])
        if name not in taken and (len(elements) > 1 or elements[0].source.endswith("]")):
            taken.add(name)
            found.append(Array(name, elements[0].reference, len(elements)))
    return tuple(found)


def with_elements(variables: Sequence[FmuVariable], made: Sequence[Array]) -> list[FmuVariable]:
    """The variables, with elements of arrays called by their array: ``link.mode.position[2]``."""
    renamed = list(variables)
    for array in made:
        for k in range(array.size):
            renamed[array.first + k] = replace(renamed[array.first + k], name=array.element(k + 1))
    return renamed


def _place(variable: FmuVariable) -> tuple[str, int]:
    """Stem and number of what may be an element; ("", 0) of anything else."""
    if variable.kind in _KINDS:
        if indexed := _INDEXED.fullmatch(variable.source):
            return indexed["stem"], int(indexed["number"])
        if variable.kind != PARAMETER and (found := _ELEMENT.fullmatch(variable.source)):
            return f"{found['block']}.{found['word']}{found['quantity'] or ''}", int(found["number"])
    return "", 0


def _name(element: FmuVariable) -> str:
    stem = structured(_place(element)[0])
    return f"der({stem})" if element.kind == DERIVATIVE else stem


def _key(variable: FmuVariable) -> tuple[object, ...] | None:
    """What elements of one array share; None of what is no element."""
    stem, _ = _place(variable)
    if not stem:
        return None
    same = (variable.unit, variable.minimum, variable.maximum, variable.tunable, variable.start is None)
    return (variable.kind, stem, *same)
