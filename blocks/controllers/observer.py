"""A state observer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from blocks.controllers.labels import labels
from blocks.controllers.matrices import collect, numbered, shaped, times
from blocks.controllers.periods import same_period
from engine.block import option
from engine.errors import ParameterError
from engine.ports import Port

if TYPE_CHECKING:
    from engine.net import Net


class Observer(SignalBlock):
    """Observer: x' = A x + B u + L (y - C x - D u), x the estimate of the state of a plant A, B, C, D.

    Sampled (``period`` > 0): x after = A x + B u + L (y - C x - D u) at each instant, A and B being those of the plant
    sampled with that period; the outputs are the estimate for the instant, made from the samples before it, and hold.

    Inputs are the commands ``u``, or ``u1``, ..., and the measurements ``y``, or ``y1``, ...; outputs are the estimates
    ``x1``, ``x2``, ..., given out as plain numbers in SI units. The matrices are in SI units and cannot be tuned
    afterwards; ``file`` (.json or .mat) may hold any of A, B, C, D, L. Where it says ``dt``, that is the period; where
    it names states, inputs and outputs with their units, as that of `flexarm.design.save` does, wires that say
    otherwise are refused. See `observer` in `blocks.controllers.design` for a design. [Luenberger 1966]
    """

    files: ClassVar[tuple[str, ...]] = ("file",)
    """Options that name files; a scenario resolves them from where it stands."""

    A = option(list, (), "n by n matrix of the plant's states")
    B = option(list, (), "n by m matrix from commands to states")
    C = option(list, (), "p by n matrix from states to measurements")
    D = option(list, (), "p by m matrix from commands to measurements; zero if left out")
    L = option(list, (), "n by p matrix from the measurements' errors to the states")
    start = option(list, (), "estimate at the beginning, n numbers; zero if left out")
    file = option(str, "", "a .json or .mat file that holds the matrices which are not given")
    period = period()
    sample_offset = sample_offset()

    def check(self) -> None:
        """The matrices must fit each other."""
        super().check()
        names = ("A", "B", "C", "D", "L", "start")
        file = self.values["file"]
        found = collect({name: self.values[name] for name in names}, file, (*names, "dt"))
        self.values["period"] = same_period(self.values["period"] if "period" in self.given else None, found, file)
        for name in "ABCL":
            if name not in found:
                raise ParameterError(f"'{name}' is missing", remedy="give A, B, C and L, or a file that holds them")
        n, b, c = len(found["A"]), found["B"], found["C"]
        m, p = b.shape[1] if b.shape[0] == n else 1, c.shape[0] if c.shape[1] == n else 1
        why = f"there are {n} states, {m} commands and {p} measurements"
        self._a = shaped("A", found["A"], n, n, "A has as many columns as rows")
        self._b, self._c = shaped("B", b, n, m, why), shaped("C", c, p, n, why)
        self._d = shaped("D", found.get("D"), p, m, why)
        self._l = shaped("L", found["L"], n, p, why)
        self._x0 = shaped("start", found.get("start"), n, 1, f"give {n} numbers").ravel()
        named = labels(file)
        self._states = named.fitting("states", n, file)
        self._inputs, self._outputs = named.fitting("inputs", m, file), named.fitting("outputs", p, file)

    def further_ports(self) -> Iterable[Port]:
        """Inputs for commands and measurements, an output for each state."""
        yield from numbered("input", "u", self._b.shape[1], "command", self._inputs)
        yield from numbered("input", "y", self._c.shape[0], "measurement", self._outputs)
        for k, (name, unit) in enumerate(self._states):
            doc = f"estimate of state {k + 1}{f': {name}' if name else ''}"
            yield Port(f"x{k + 1}", "output", doc, "", unit if name and unit != "*" else "1", carries=name)

    def stamp(self, net: Net) -> None:
        inputs = [port.name for port in self.ports.values() if port.role == "input"]
        m = self._b.shape[1]
        u, y = [self.port(name) for name in inputs[:m]], [self.port(name) for name in inputs[m:]]
        names, starts = [f"x{k + 1}" for k in range(len(self._x0))], [float(value) for value in self._x0]
        if self.period == 0:
            x = [net.state(f"estimate{k + 1}", "*", start=value) for k, value in enumerate(starts)]
        else:
            ticks = clock(net, self)
            x = [net.memory(f"estimate{k + 1}", "*", ticks, start=value) for k, value in enumerate(starts)]
        expected = [c + d for c, d in zip(times(self._c, x), times(self._d, u), strict=True)]
        error = [measured - e for measured, e in zip(y, expected, strict=True)]
        parts = zip(times(self._a, x), times(self._b, u), times(self._l, error), strict=True)
        for state, (a, b, correction) in zip(x, parts, strict=True):
            (net.derivative if self.period == 0 else net.update)(state, a + b + correction)
        for k, name in enumerate(names):
            value = x[k]
            if self.period > 0:
                value = net.memory(f"held{k + 1}", "*", ticks, start=starts[k], held=True)
                net.update(value, x[k])
            net.output(name, value, self.ports[name].unit, self.ports[name].doc)
