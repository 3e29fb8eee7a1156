"""Draw docs/systems/figures/stick-slip-pulse.png: the two torque pulses of [One-link n.d.] and how the stuck arm rings.

Run ``python -m tools.figures.stick_slip_pulse``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from engine.simulate import Result
from flexarm.api import simulate
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "stick-slip-pulse.png"
WIDTHS = (0.05, 0.5)
ZEROS = (12.1, 76.19)


def stuck(result: Result) -> list[tuple[float, float]]:
    """Intervals in which the hub sticks."""
    events = [(time, value) for time, name, value in result.events if name == "friction"]
    ends = [*(time for time, _ in events[1:]), float(result.time[-1])]
    return [(begin, end) for (begin, value), end in zip(events, ends, strict=True) if value == 0]


def spectrum(result: Result, begin: float) -> tuple[Any, Any]:
    """Rates (rad/s) and amplitude of the first bend over 5 s, Hann window, zero padded; its greatest line is 1."""
    rows = (result.time > begin) & (result.time <= begin + 5)
    values = result["link.strain1"][rows]
    values = (values - values.mean()) * np.hanning(len(values))
    size = 16 * len(values)
    lines = np.abs(np.fft.rfft(values, size))
    return 2 * np.pi * np.fft.rfftfreq(size, 1e-3), lines / lines.max()


def draw(target: Path = TARGET) -> Path:
    """Speed of the hub, first bend and its spectrum once stuck, for both pulses of the shipped scenario."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, 2, figsize=(8, 7), layout="constrained", sharex="row", sharey="row")
    for column, width in zip(axes.T, WIDTHS, strict=True):
        result = simulate(load("lumped-arm-pulse", [f"width={width}"]))
        speed, bend, lines = column
        speed.plot(result.time, result["link.hub.speed"], "k", lw=1)
        bend.plot(result.time, 1e3 * result["link.strain1"], lw=1)
        for axis in (speed, bend):
            for i, (begin, end) in enumerate(stuck(result)):
                axis.axvspan(begin, end, color="0.88", lw=0, label=None if i else "stuck")
            axis.set(xlim=(0, 2), xlabel="s")
        speed.set_title(f"{width} s pulse")
        rates, size = spectrum(result, stuck(result)[-1][0])
        shown = rates < 100
        lines.semilogy(rates[shown], np.maximum(size[shown], 1e-6), "k", lw=1)
        for i, zero in enumerate(ZEROS):
            lines.axvline(zero, ls=":", color="C0", lw=1.2, label=None if i else "zeros, Table 2")
        lines.set(xlim=(0, 100), ylim=(1e-4, 2), xlabel="rad/s")
    for axis, label in zip(axes[:, 0], ("hub speed, rad/s", "first bend, mrad", "spectrum once stuck"), strict=True):
        axis.set_ylabel(label)
    axes[0, 1].legend(loc="upper right")
    axes[2, 1].legend(loc="upper right")
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=85)
    pyplot.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
