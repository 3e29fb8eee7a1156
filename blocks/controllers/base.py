"""Base of the signal blocks: the unit of the output, and the sample instants."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from engine.block import Block, parameter
from engine.errors import ParameterError
from engine.ports import Expression
from engine.quantity import coherent

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Clock

OUTPUT_UNIT = "coherent SI unit of the output; * takes that of the input"


class SignalBlock(Block):
    """A block from signals to one signal, ``out``."""

    def check(self) -> None:
        """The unit of the output must be coherent SI, since values are."""
        unit = self.values.get("unit", "*")
        if unit != "*" and coherent(unit)[0] != 1.0:
            raise ParameterError(f"unit '{unit}' is not a coherent SI unit", remedy=f"use '{coherent(unit)[1]}'")

    def publish(self, net: Net, value: Expression, unit: str = "*") -> None:
        """Give ``out`` its value in ``unit``; ``*`` is the unit of the input."""
        net.output("out", value, unit, type(self).ports["out"].doc)


def period() -> Any:
    """The declaration of a sample period."""
    return parameter("s", 0.0, "sample period; 0 makes the block continuous", ge=0, structural=True)


def sample_offset() -> Any:
    """The declaration of the instant of the first sample."""
    return parameter("s", 0.0, "instant of the first sample, when sampled", ge=0, structural=True)


def clock(net: Net, block: Any) -> Clock:
    """The clock of a block that declares ``period`` and ``sample_offset``."""
    return net.clock(block.period, block.sample_offset)
