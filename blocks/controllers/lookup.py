"""Lookup tables of one and two signals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock
from blocks.symbolic import hats
from engine.block import option, parameter, signal_in, signal_out
from engine.errors import ParameterError

if TYPE_CHECKING:
    from engine.net import Net

MOST = 2000
"""Values of a two-dimensional table; each is a term of the model."""


def check_rising(name: str, values: Any) -> None:
    """Refuse breakpoints that do not rise strictly."""
    if len(values) < 2:
        raise ParameterError(f"{name} has {len(values)} values", remedy="give at least two")
    for k in range(1, len(values)):
        if values[k] <= values[k - 1]:
            raise ParameterError(
                f"{name}: {values[k]:g} does not come after {values[k - 1]:g}", remedy="give them rising, each once"
            )


def with_points(values: dict[str, Any]) -> dict[str, Any]:
    """The values of a block with as many points as it has breakpoints, where none are given."""
    rows = values.get("breakpoints")
    return {"points": len(rows), **values} if isinstance(rows, list | tuple) else values


class LookupTable(SignalBlock):
    """Lookup table: out = f(in), straight lines through ``heights`` at ``breakpoints``; beyond the ends the end value.

    Breakpoints rise strictly and may lie anywhere; each row has one unit, and the output that of ``heights``. f is
    continuous and its kinks are not located: a step of the integration across one has an error of the order of the step
    squared. For a law that adds to its signal see `Curve`, for a recorded signal `Table`.
    """

    points = option(int, 2, "how many breakpoints; as many as are given", ge=2, le=1000)
    breakpoints = parameter("*", ..., "inputs, rising, with their unit", size="points")
    heights = parameter("*", ..., "outputs at the breakpoints, with their unit", size="points", tolerance=0.3)

    input = signal_in("*", "what is looked up", name="in")
    out = signal_out("*", "the value found")

    def __init__(self, **values: Any) -> None:
        super().__init__(**with_points(values))

    def check(self) -> None:
        """Breakpoints must rise."""
        super().check()
        check_rising("breakpoints", self.values["breakpoints"])

    def stamp(self, net: Net) -> None:
        weights = hats(self.input, [self.breakpoints[k] for k in range(self.points)])
        found = sum((w * self.heights[k] for k, w in enumerate(weights)), 0.0)
        self.publish(net, found, self.unit_of("heights"))


class LookupTable2D(SignalBlock):
    """Lookup table of two signals: out = f(x, y), bilinear between the values, held beyond the ends.

    ``table`` has a row for each of ``rows`` (values of x) and a column for each of ``columns`` (values of y). All are
    numbers in SI units and cannot be tuned afterwards; the output has ``unit``.
    """

    rows = option(list, ..., "values of x, rising, one per row of the table")
    columns = option(list, ..., "values of y, rising, one per column of the table")
    table = option(list, ..., "output for each row and column")
    unit = option(str, "*", OUTPUT_UNIT)

    x = signal_in("*", "signal that chooses between rows")
    y = signal_in("*", "signal that chooses between columns")
    out = signal_out("*", "the value found")

    def check(self) -> None:
        """The table must fit its breakpoints."""
        super().check()
        for name in ("rows", "columns"):
            if len(self.values[name]) != 1:
                raise ParameterError(f"{name} must be one row of numbers")
            check_rising(name, self.values[name][0])
        shape = len(self.values["table"]), len(self.values["table"][0])
        wanted = len(self.values["rows"][0]), len(self.values["columns"][0])
        if shape != wanted:
            raise ParameterError(
                f"the table is {shape[0]} by {shape[1]}, but there are {wanted[0]} rows and {wanted[1]} columns"
            )
        if shape[0] * shape[1] > MOST:
            raise ParameterError(f"the table has {shape[0] * shape[1]} values", remedy=f"give at most {MOST}")

    def stamp(self, net: Net) -> None:
        down, across = hats(self.x, list(self.rows[0])), hats(self.y, list(self.columns[0]))
        found = sum(
            (w * sum((v * c for v, c in zip(row, across, strict=True)), 0.0))
            for w, row in zip(down, self.table, strict=True)
        )
        self.publish(net, found, self.unit)
