"""What a design file says of its signals beside the matrices: their names and units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from blocks.controllers.matrices import content
from engine.errors import ParameterError
from engine.quantity import coherent


@dataclass(frozen=True)
class Labels:
    """Signals that a design file names, each with its coherent SI unit, ``*`` where it tells none.

    Attributes:
        states, inputs, outputs: (name, unit) in the order of the matrices; empty where the file has no names.
    """

    states: tuple[tuple[str, str], ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    outputs: tuple[tuple[str, str], ...] = ()

    def fitting(self, key: str, count: int, file: str) -> tuple[tuple[str, str], ...]:
        """The names of one kind, or as many without a name where the file has none.

        Raises:
            ParameterError: the file has another number of names.
        """
        named: tuple[tuple[str, str], ...] = getattr(self, key)
        if named and len(named) != count:
            raise ParameterError(
                f"'{file}' names {len(named)} {key}, and its matrices have {count}",
                remedy=f"give as many names as there are {key}, or leave '{key}' out of the file",
            )
        return named or (("", "*"),) * count


def labels(file: str) -> Labels:
    """What a design file says of its signals: ``states``, ``inputs`` and ``outputs``, and their ``units``.

    Files of `flexarm.design.save` and of ``flexarm linearise`` have them; others need not.

    Raises:
        ParameterError: as `read`, or a unit that is not coherent SI, in which all matrices are.
    """
    if not file:
        return Labels()
    found = content(file)
    by_name = found.get("units")
    made: dict[str, tuple[tuple[str, str], ...]] = {}
    for key in ("states", "inputs", "outputs"):
        names = _texts(found.get(key))
        units = dict(zip(names, _texts(found.get(f"{key[:-1]}_units")), strict=False))
        if isinstance(by_name, dict):
            units |= by_name
        made[key] = tuple((name, _unit(name, units.get(name), file)) for name in names)
    return Labels(**made)


def _texts(value: Any) -> list[str]:
    items = np.ravel(np.array(value, dtype=object)).tolist() if isinstance(value, list | np.ndarray) else [value]
    return items if all(isinstance(item, str) for item in items) else []


def _unit(name: str, given: Any, file: str) -> str:
    if not isinstance(given, str) or not given:
        return "*"
    try:
        scale, unit = coherent(given)
    except ParameterError as error:
        raise ParameterError(f"'{file}': unit of '{name}': {error.message}", remedy=error.remedy) from None
    if scale != 1:
        raise ParameterError(f"'{file}': '{name}' is in {given}", remedy=f"matrices are in SI units: {unit}")
    return unit
