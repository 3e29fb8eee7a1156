"""What blocks and nets share: connectors, the kinds of flanges with their units, and expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Expression = Any
"""A CasADi SX expression, or a number where the value is structural."""

ROTATIONAL = "rotational"
TRANSLATIONAL = "translational"

MOTION = {
    ROTATIONAL: (("angle", "rad"), ("speed", "rad/s"), ("acceleration", "rad/s2"), ("torque", "N.m")),
    TRANSLATIONAL: (("position", "m"), ("speed", "m/s"), ("acceleration", "m/s2"), ("force", "N")),
}
"""For each kind of flange, the names and units of its motion (three) and of its effort."""


@dataclass(frozen=True)
class Port:
    """A connector of a block.

    Attributes:
        name: the port's name in scenario files; may contain dots.
        role: ``flange``, ``input`` or ``output``.
        doc: one sentence.
        kind: for a flange, ``rotational`` or ``translational``.
        unit: for a signal; ``*`` fits any unit.
        default: value of an input that nothing feeds; None means it must be connected.
        like: an input of the block that has the same unit, where ``unit`` fits any; of an output ``*``: none has.
        carries: name of the signal that a design says is here, such as the state ``link.hub.angle``; wires that say
            otherwise are refused.
    """

    name: str
    role: str
    doc: str
    kind: str = ""
    unit: str = ""
    default: float | None = None
    like: str = ""
    carries: str = ""
