"""An effect at a place, as edits to the scenario with parameters that start from sizes that matter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from diagnosis.problem import Free
from scenarios.amend import Edit

NAME = "found"
"""First part of the name of every block that is put in."""


@dataclass(frozen=True)
class Knob:
    """A parameter of an inserted effect: tried at ``reference`` times each of ``shares``, then fitted.

    Attributes:
        parameter: of the inserted or changed block.
        reference: a size that matters (SI).
        shares: multiples of it to start from.
        signed: whether it may be negative; else it stays positive and moves on a logarithmic scale.
        fixed: whether it is only chosen among its starting sizes: the model has no derivative with respect to it.
    """

    parameter: str
    reference: float
    shares: tuple[float, ...]
    signed: bool = False
    fixed: bool = False


@dataclass(frozen=True)
class Candidate:
    """An effect at a place.

    Attributes:
        effect: machine name.
        place: where, in the words of the block diagram.
        block: the block of the user's scenario it belongs to.
        name: of the block that is put in or changed.
        edits: what to do to the scenario, with starting values in place of ``{parameter}``.
        knobs: its parameters.
        loosened: for ``wrong_parameter``, the parameter that may leave its tolerance.
    """

    effect: str
    place: str
    block: str
    name: str
    edits: Callable[[dict[str, float]], list[Edit]]
    knobs: tuple[Knob, ...]
    loosened: Free | None = None

    @property
    def key(self) -> str:
        """Effect and place, for tables."""
        return f"{self.effect} at {self.place}"

    def free(self, starts: dict[str, float]) -> list[Free]:
        """The parameters to fit, from given starting values."""
        rows = [self.loosened] if self.loosened else []
        for knob in self.knobs:
            if knob.fixed:
                continue
            value = starts[knob.parameter]
            name = f"{self.name}.{knob.parameter}"
            if knob.signed:
                rows.append(Free(name, value, max(0.2 * abs(value), 0.02 * knob.reference), False, prior=False))
            else:
                rows.append(Free(name, value, 0.3, True, 0.0, 1e4 * knob.reference, prior=False))
        return rows


def with_unit(value: float, unit: str) -> str:
    """The number as text, with its unit if it has one."""
    return f"{float(value):.10g} {unit}" if unit not in ("1", "", "*") else f"{float(value):.10g}"
