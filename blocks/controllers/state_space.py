"""Linear controllers in state space, continuous or sampled."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock, clock, sample_offset
from blocks.controllers.matrices import collect, numbered, shaped, system, times
from blocks.controllers.periods import period_of, stated_period
from engine.block import option, parameter
from engine.errors import ParameterError
from engine.ports import Expression, Port

if TYPE_CHECKING:
    from engine.net import Net

_FILE = "a .json or .mat file that holds the matrices which are not given"


class _StateSpace(SignalBlock):
    """Matrices and ports; subclasses write the law."""

    files: ClassVar[tuple[str, ...]] = ("file",)
    """Options that name files; a scenario resolves them from where it stands."""

    A = option(list, (), "n by n matrix of the states; leave it out for a gain without states")
    B = option(list, (), "n by m matrix from inputs to states")
    C = option(list, (), "p by n matrix from states to outputs")
    D = option(list, (), "p by m matrix from inputs to outputs; zero if left out")
    start = option(list, (), "states at the beginning, n numbers; zero if left out")
    file = option(str, "", _FILE)
    unit = option(str, "*", OUTPUT_UNIT)

    def check(self) -> None:
        """The matrices must fit each other."""
        super().check()
        given = {name: self.values[name] for name in ("A", "B", "C", "D", "start")}
        found = collect(given, self.values["file"], ("A", "B", "C", "D", "start", "dt"))
        self._a, self._b, self._c, self._d = system(found)
        n = len(self._a)
        self._x0 = shaped("start", found.get("start"), n, 1, f"give {n} numbers").ravel()
        self._found = found

    def further_ports(self) -> Iterable[Port]:
        """One input and one output for each column and row of D."""
        yield from numbered("input", "in", self._d.shape[1], "input of the system")
        yield from numbered("output", "out", self._d.shape[0], "output of the system")

    def _inputs(self) -> list[Expression]:
        return [self.port(port.name) for port in self.ports.values() if port.role == "input"]

    def _law(self, x: list[Expression]) -> tuple[list[Expression], list[Expression]]:
        """A x + B u and C x + D u."""
        u = self._inputs()
        after = [a + b for a, b in zip(times(self._a, x), times(self._b, u), strict=True)]
        return after, [c + d for c, d in zip(times(self._c, x), times(self._d, u), strict=True)]

    def _give(self, net: Net, values: Iterable[Expression]) -> None:
        outputs = [port for port in self.ports.values() if port.role == "output"]
        for port, value in zip(outputs, values, strict=True):
            net.output(port.name, value, self.unit, port.doc)


class StateSpace(_StateSpace):
    """Continuous linear system: x' = A x + B u, y = C x + D u, x(0) = start.

    The inputs u are ``in``, or ``in1``, ``in2``, ... where there are several, and the outputs y ``out``, or ``out1``,
    ... A row of numbers stands for a column where B or ``start`` is one. The matrices are numbers in SI units and
    cannot be tuned afterwards. A ``file`` is JSON, ``{"A": [[...]], ...}``, or MATLAB up to version 7, and holds what
    is not given here; what `flexarm linearise` writes fits. See `from_control` for python-control systems.
    """

    def check(self) -> None:
        """The matrices must not be those of a sampled system."""
        super().check()
        stated = stated_period(self._found)
        if stated:
            raise ParameterError(
                f"the matrices of '{self.values['file']}' are sampled every {stated:g} s (dt)",
                remedy="use DiscreteStateSpace",
            )

    def stamp(self, net: Net) -> None:
        x = [net.state(f"x{k + 1}", "*", start=float(x0)) for k, x0 in enumerate(self._x0)]
        rates, outputs = self._law(x)
        for state, rate in zip(x, rates, strict=True):
            net.derivative(state, rate)
        self._give(net, outputs)


class DiscreteStateSpace(_StateSpace):
    """Sampled linear system: x after = A x + B u, y = C x + D u at each instant; y holds until the next one.

    ``period`` may come from the file as ``dt``. Ports, shapes and files are those of `StateSpace`.
    """

    period = parameter("s", 0.0, "sample period; 0 takes dt of the file", ge=0, structural=True)
    sample_offset = sample_offset()

    def check(self) -> None:
        """There must be a period."""
        super().check()
        self.values["period"] = period_of(self.values["period"], self._found)

    def stamp(self, net: Net) -> None:
        ticks = clock(net, self)
        x = [net.memory(f"x{k + 1}", "*", ticks, start=float(x0)) for k, x0 in enumerate(self._x0)]
        after, outputs = self._law(x)
        for memory, value in zip(x, after, strict=True):
            net.update(memory, value)
        held = [net.memory(f"y{k + 1}", "*", ticks, held=True) for k in range(len(outputs))]
        for memory, value in zip(held, outputs, strict=True):
            net.update(memory, value)
        self._give(net, held)


def spectral_radius(block: DiscreteStateSpace) -> float:
    """Largest magnitude of the eigenvalues of A; the system is stable below 1."""
    return float(np.abs(np.linalg.eigvals(block._a)).max(initial=0.0))
