"""Transfer functions by their coefficients, continuous and sampled."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock, clock, sample_offset
from engine.block import option, parameter, signal_in, signal_out
from engine.errors import ParameterError
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class _TransferFunction(SignalBlock):
    """Coefficients and the controller canonical form; subclasses write the law."""

    numerator = option(list, ..., "coefficients of the numerator, highest power first")
    denominator = option(list, ..., "coefficients of the denominator, highest power first")
    unit = option(str, "*", OUTPUT_UNIT)

    input = signal_in("*", "input u", name="in")
    out = signal_out("*", "output y")

    def check(self) -> None:
        """One row each, no more zeros than poles, and a leading coefficient."""
        super().check()
        rows = {name: self.values[name] for name in ("numerator", "denominator")}
        for name, row in rows.items():
            if len(row) != 1:
                raise ParameterError(f"{name} must be one row of numbers", remedy="write for example [1, 0.5]")
        above, below = (list(rows[name][0]) for name in ("numerator", "denominator"))
        while len(above) > 1 and above[0] == 0:
            above.pop(0)
        if below[0] == 0:
            raise ParameterError("the first coefficient of the denominator is 0", remedy="leave it out")
        if len(above) > len(below):
            raise ParameterError(
                f"the numerator is of order {len(above) - 1}, above the denominator's {len(below) - 1}",
                remedy="such a system differentiates; add a filter to the denominator",
            )
        lead, n = below[0], len(below) - 1
        b = [0.0] * (n + 1 - len(above)) + [c / lead for c in above]
        self._a = [c / lead for c in below[1:]]
        self._d = b[0]
        self._c = [bk - ak * b[0] for bk, ak in zip(b[1:], self._a, strict=True)]

    def _law(self, x: list[Expression]) -> tuple[list[Expression], Expression]:
        """What follows the states (their rates, or the next ones), and the output."""
        lead = self.input - sum((a * state for a, state in zip(self._a, x, strict=True)), 0.0)
        after = [lead, *x[:-1]] if x else []
        return after, sum((c * state for c, state in zip(self._c, x, strict=True)), self._d * self.input)


class TransferFunction(_TransferFunction):
    """Transfer function: y = N(s) / D(s) u, coefficients highest power first, at rest at the beginning.

    ``numerator: [1, 5], denominator: [1, 2, 10]`` is (s + 5) / (s^2 + 2 s + 10). The coefficients are numbers in SI
    units, and cannot be tuned afterwards; N has at most the order of D. A gain that changes the quantity needs
    ``unit``. Controller canonical form: x1' = u - a1 x1 - ... - an xn, x2' = x1, ... For many inputs or coefficients
    that lie far apart use `StateSpace`.
    """

    def stamp(self, net: Net) -> None:
        x = [net.state(f"x{k + 1}", "*", doc=f"state {k + 1} of the canonical form") for k in range(len(self._a))]
        rates, y = self._law(x)
        for state, rate in zip(x, rates, strict=True):
            net.derivative(state, rate)
        self.publish(net, y, self.unit)


class DiscreteTransferFunction(_TransferFunction):
    """Sampled transfer function: y = N(z) / D(z) u at each instant, coefficients highest power first.

    ``numerator: [1, 0], denominator: [1, -0.9]`` is z / (z - 0.9): y = 0.9 y before + u. In powers of 1/z, as filters
    are written, both rows have equal length. y holds until the next instant; all is 0 before the first.
    """

    period = parameter("s", ..., "sample period", gt=0, structural=True)
    sample_offset = sample_offset()

    def stamp(self, net: Net) -> None:
        ticks = clock(net, self)
        x = [net.memory(f"x{k + 1}", "*", ticks) for k in range(len(self._a))]
        after, y = self._law(x)
        for memory, value in zip(x, after, strict=True):
            net.update(memory, value)
        held = net.memory("y", "*", ticks, held=True)
        net.update(held, y)
        self.publish(net, held, self.unit)
