"""Python on symbols in a law: named with file, line and what to write instead."""

from __future__ import annotations

import math
from typing import Any

import pytest

from engine.assemble import build
from engine.block import Block, flange, option, parameter
from engine.errors import StructureError
from engine.net import Net
from engine.system import System


class Base(Block):
    """A law to be spoilt."""

    size = parameter("1", 1.0, "size")
    count = option(int, 2, "how many")
    shaft = flange("shaft")

    def torque(self) -> Any:
        """The torque."""
        return 0.0

    def stamp(self, net: Net) -> None:
        net.inertia(self.shaft, 1.0)
        net.force(self.shaft, self.torque())


class Sine(Base):
    def torque(self) -> Any:
        return math.sin(self.shaft.angle)  # here


class Branch(Base):
    def torque(self) -> Any:
        if self.size > 1:  # here
            return 1.0
        return 2.0


class Greatest(Base):
    def torque(self) -> Any:
        return max(self.shaft.speed, 0)  # here


class Whole(Base):
    def torque(self) -> Any:
        return [0.0] * int(self.size)  # here


class Pick(Base):
    def torque(self) -> Any:
        return [1.0, 2.0][self.shaft.angle]  # here


class Numbers(Base):
    """What is allowed: numbers stay numbers."""

    def torque(self) -> Any:
        return math.sin(self.count) * (1.0 if self.count > 1 else 0.0) * self.shaft.angle


@pytest.mark.parametrize(
    ("kind", "remedy"),
    [(Sine, "symbolic.sin"), (Branch, "choose"), (Greatest, "greatest"), (Whole, "structural"), (Pick, "select")],
)
def test_the_line_and_the_remedy_are_named(kind: type[Base], remedy: str) -> None:
    with pytest.raises(StructureError) as caught:
        build(System({"mine": kind()}, []))
    assert f"the law of 'mine' ({kind.__name__})" in caught.value.message
    assert __file__ in caught.value.message
    assert "# here" in caught.value.message
    assert remedy in caught.value.remedy


def test_numbers_are_numbers() -> None:
    build(System({"mine": Numbers()}, []))
    with pytest.raises(TypeError):
        math.sin("1")  # type: ignore[arg-type]
