"""A recorded signal, interpolated by a shape-preserving spline."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from blocks.sources.table import read_columns
from engine.block import Block, option, parameter, signal_out
from engine.errors import ParameterError

if TYPE_CHECKING:
    from engine.net import Net

STEEPEST = 1e100
"""Slope (1/s) beyond which the cubics' coefficients leave the range of numbers."""


class Spline(Block):
    """Recorded signal: out = scale * s(t), s the shape-preserving cubic spline through the rows; the end values hold.

    Between the rows k and k + 1, with tau = t - t_k,

        s = y_k + tau (d_k + tau (c_k + tau b_k)),    s and s' continuous,

    the slopes d_k by Fritsch and Butland: 0 at every extremum of the rows and a weighted harmonic mean elsewhere, so
    that s rises where the rows rise, falls where they fall, and never overshoots them. The integration meets every row
    and the cubic is exact between. The file is read as by `Table`. ``pchip`` in MATLAB and SciPy [Fritsch 1980]. It
    gives the measured torque of [Mohan 2010, sec. 4.1.3].
    """

    files: ClassVar[tuple[str, ...]] = ("file",)
    """Options that name files; a scenario resolves them from where it stands."""

    file = option(str, ..., "path of the CSV file")
    column = option(str, ..., "name of the column that holds the signal")
    time = option(str, "time", "name of the column that holds the time")
    scale = parameter("*", 1.0, "value of one unit of the column, with its unit")
    time_unit = parameter("s", 1.0, "duration of one unit of the time column", gt=0, structural=True)

    out = signal_out("*", "the recorded signal")

    def check(self) -> None:
        """Read the file, so that an error in it is reported where the block is declared."""
        times, self.samples = read_columns(self.file, self.time, self.column)
        self.times = [self.time_unit * t for t in times]
        with np.errstate(all="ignore"):
            intervals = np.diff(self.times)
            slopes = np.diff(self.samples) / intervals
        if not ((intervals > 0).all() and np.isfinite(slopes).all() and (abs(slopes) < STEEPEST).all()):
            raise ParameterError(
                f"time_unit = {self.time_unit:g} s leaves slopes that no number can hold",
                remedy="give the duration of one unit of the time column, such as '1 ms'",
            )

    def stamp(self, net: Net) -> None:
        rows = _pieces(self.times, self.samples)
        knots = [row[0] for row in rows]
        start, value, slope, bend, twist = (
            net.table(name, "1", knots, column, "zero_order")
            for name, column in zip(("start", "value", "slope", "bend", "twist"), zip(*rows, strict=True), strict=True)
        )
        since = net.time - start
        signal = value + since * (slope + since * (bend + since * twist))
        net.output("out", self.scale * signal, self.unit_of("scale"), type(self).ports["out"].doc)


def _pieces(times: list[float], samples: list[float]) -> list[tuple[float, float, float, float, float]]:
    """Beginning, value, slope and further coefficients of each cubic; the first and the last piece are constant."""
    before = (times[0] - 1.0, samples[0], 0.0, 0.0, 0.0)
    after = (times[-1], samples[-1], 0.0, 0.0, 0.0)
    if len(times) < 2:
        return [before, after]
    from scipy.interpolate import PchipInterpolator

    coefficients = PchipInterpolator(times, samples).c[::-1].T.tolist()
    return [before, *((t, *c) for t, c in zip(times[:-1], coefficients, strict=True)), after]
