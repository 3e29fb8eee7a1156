"""The time that is allowed for a search, counted in operations: neither the clock nor the machine decides."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from engine.work import Work


class OutOfTime(Exception):
    """Between two fits: nothing more is to be fitted."""


@dataclass(frozen=True)
class Spent:
    """What a diagnosis has taken so far.

    Attributes:
        most: operations that are allowed for.
        work: what it took.
    """

    most: float = math.inf
    work: Work = field(default_factory=Work)

    def is_over(self, share: float = 1.0) -> bool:
        """Whether a share of what is allowed has been spent."""
        return self.work.done >= share * self.most
