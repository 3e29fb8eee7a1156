"""The ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange

if TYPE_CHECKING:
    from engine.net import Net


class Fixed(Block):
    """Ground of rotation: angle of the shaft = 0. It takes any torque and does no work."""

    shaft = flange("what is held")

    def stamp(self, net: Net) -> None:
        net.tie({self.shaft: 1})


class TranslationalFixed(Fixed, slide={"shaft": "flange"}):
    """Ground of translation: position of the flange = 0. It takes any force and does no work."""
