"""When a search gives up: once it has gained nothing for as long again as it took to find what leads, or half a minute.

How long to look for what may not be there, no threshold of evidence tells: machines that are far from any listed effect
leave much over whatever is tried. What came to lead soon, where nothing has been gained for long, is seldom bettered.
"""

from __future__ import annotations

import math
from collections.abc import Set
from dataclasses import dataclass

from diagnosis.thresholds import SEARCH


@dataclass
class Patience:
    """What leads in a search, and when it came to lead.

    Attributes:
        led: work that was done when it did; that of the first effects at least.
        leading: effects, by key, of the model that leads by its worth.
        level: its worth.
    """

    led: int = 0
    leading: Set[str] = frozenset()
    level: float = -math.inf

    def note(self, keys: Set[str], worth: float, spent: int) -> None:
        """A model that was fitted.

        Args:
            keys: its effects.
            worth: its evidence less its price.
            spent: work so far.
        """
        if worth > self.level + (SEARCH.effort if keys != self.leading else 0.0):
            if keys != self.leading:
                self.led, self.leading = spent, keys
            self.level = worth

    def at_least(self, spent: int) -> None:
        """What leads is taken to have been found with this work at the soonest."""
        self.led = max(self.led, spent)

    def is_over(self, spent: int) -> bool:
        """Whether nothing was gained for so long that the search is to end."""
        return spent - self.led > max(SEARCH.patience * self.led, SEARCH.least_work)
