"""Relations between parameters of one block: declared once, for scenarios and for FMUs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from engine.errors import ParameterError

BELOW, NOT_ABOVE, NOT_BELOW = range(3)
_MEANINGS = {
    "is less than": BELOW,
    "is not above": NOT_ABOVE,
    "is not after": NOT_ABOVE,
    "does not exceed": NOT_ABOVE,
    "is not below": NOT_BELOW,
}


@dataclass(frozen=True)
class Relation:
    """What must not be said of two parameters, such as ``static_friction is less than coulomb_friction``.

    Attributes:
        first, second: the parameters.
        words: ``is less than``, ``is not above``, ``is not after``, ``does not exceed`` or ``is not below``.
        remedy: what to do about it.
    """

    first: str
    words: str
    second: str
    remedy: str = ""

    @property
    def meaning(self) -> int:
        """`BELOW`, `NOT_ABOVE` or `NOT_BELOW`."""
        return _MEANINGS[self.words]

    def broken(self, first: float, second: float) -> bool:
        """Whether it is true of these values."""
        meaning = self.meaning
        return first < second if meaning == BELOW else first <= second if meaning == NOT_ABOVE else first >= second

    def check(self, values: Mapping[str, float], units: Mapping[str, str]) -> None:
        """Check the values by name; with the units, as texts in front of which a number stands.

        Raises:
            ParameterError: it is true of them.
        """
        a, b = values[self.first], values[self.second]
        if self.broken(a, b):
            first, second = (f"{name} = {values[name]:g}{units.get(name, '')}" for name in (self.first, self.second))
            raise ParameterError(f"{first} {self.words} {second}", remedy=self.remedy)
