"""Feedback of the full state."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from blocks.controllers.labels import labels
from blocks.controllers.matrices import collect, numbered, shaped, times
from blocks.controllers.periods import same_period
from engine.block import option, signal_in
from engine.errors import ParameterError
from engine.ports import Port

if TYPE_CHECKING:
    from engine.net import Net


class StateFeedback(SignalBlock):
    """State feedback: u = N r - K x, K = gain, N = reference_gain.

    The states x are the inputs ``x1``, ``x2``, ...: sensors, motions of flanges, or the outputs of an `Observer`. u is
    ``out``, or ``out1``, ... where K has several rows. A ``period`` above 0 reads x and r at sample instants and holds
    u. The gains are numbers in SI units and cannot be tuned afterwards; ``file`` (.json or .mat) may hold K and N.
    Where it says ``dt``, that is the period; where it names the states with their units, as that of
    `flexarm.design.save` does, wires that say otherwise are refused. See `lqr` for a design.
    """

    files: ClassVar[tuple[str, ...]] = ("file",)
    """Options that name files; a scenario resolves them from where it stands."""

    gain = option(list, (), "matrix K, a row for each output and a column for each state")
    reference_gain = option(list, (), "column N, a number for each output; zero if left out")
    file = option(str, "", "a .json or .mat file that holds K, and N")
    unit = option(str, "V", "coherent SI unit of the output")
    period = period()
    sample_offset = sample_offset()

    reference = signal_in("*", "reference r", default=0.0)

    def check(self) -> None:
        """There must be gains, and they must fit."""
        super().check()
        given = {"K": self.values["gain"], "N": self.values["reference_gain"]}
        file = self.values["file"]
        found = collect(given, file, ("K", "N", "dt"))
        if "K" not in found:
            raise ParameterError("no gain is given", remedy="give gain: [k1, k2, ...], or a file that holds K")
        self._k = found["K"]
        self.values["period"] = same_period(self.values["period"] if "period" in self.given else None, found, file)
        self._states = labels(file).fitting("states", self._k.shape[1], file)
        self._n = shaped("reference_gain", found.get("N"), len(self._k), 1, "give one number for each row of the gain")

    def further_ports(self) -> Iterable[Port]:
        """An input for each state, an output for each row of the gain."""
        for k, (name, unit) in enumerate(self._states):
            yield Port(f"x{k + 1}", "input", f"state {k + 1}{f': {name}' if name else ''}", "", unit, carries=name)
        yield from numbered("output", "out", len(self._k), "command u")

    def stamp(self, net: Net) -> None:
        x = [self.port(f"x{k + 1}") for k in range(self._k.shape[1])]
        for row, (kx, n) in enumerate(zip(times(self._k, x), self._n[:, 0], strict=True)):
            u = float(n) * self.reference - kx if n else -kx
            if self.period > 0:
                held = net.memory(f"command{row + 1}", self.unit, clock(net, self), held=True)
                net.update(held, u)
                u = held
            port = self.ports["out" if len(self._k) == 1 else f"out{row + 1}"]
            net.output(port.name, u, self.unit, port.doc)
