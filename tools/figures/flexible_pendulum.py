"""Draw docs/systems/figures/flexible-pendulum.png: the flexible link of [Mohan 2010] clamped, falling, and braked.

Run ``python -m tools.figures.flexible_pendulum``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from engine.files import writing
from engine.simulate import Result
from flexarm.api import simulate
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "flexible-pendulum.png"


def spectrum(result: Result, rows: Any, trend: int) -> tuple[Any, Any]:
    """Frequencies (Hz) and magnitude of the tip's deflection, Hann window, zero-padded; its greatest line is 1."""
    time, values = result.time[rows], result["arm.link1.deflection"][rows]
    values = (values - np.polyval(np.polyfit(time, values, trend), time)) * np.hanning(len(time))
    size = 32 * len(values)
    lines = np.abs(np.fft.rfft(values, size))
    return np.fft.rfftfreq(size, time[1] - time[0]), lines / lines.max()


def draw(target: Path = TARGET) -> Path:
    """The three shipped scenarios: joint angle, deflection of the tip, and its spectrum."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    clamped, falling, braked = (
        simulate(load(name)) for name in ("clamped-flexible-link", "flexible-pendulum", "flexible-arm-braked")
    )
    grips = next(time for time, name, _ in braked.events if name == "brake.grip")
    with writing(target, (".png",)) as temporary:
        figure, axes = plt.subplots(3, 3, figsize=(10, 6.6), layout="constrained")
        titles = ("clamped, released at 15 mm", "free fall from level", "driven, then braked")
        for column, title, result in zip(axes.T, titles, (clamped, falling, braked), strict=True):
            column[0].set_title(title)
            if result is clamped:
                column[0].text(0.5, 0.5, "held", ha="center", transform=column[0].transAxes)
                column[0].set_yticks([])
            else:
                column[0].plot(result.time, np.degrees(result["arm.joint1.angle"]), "k", lw=1)
            column[1].plot(result.time, 1e3 * result["arm.link1.deflection"], lw=0.8)
            for axis in column[:2]:
                axis.set(xlabel="s", xlim=(0, result.time[-1]))
        everything = np.ones(len(falling.time), dtype=bool)
        pieces = (
            (axes[2, 0], clamped, clamped.time >= 0, 0, "C0", None),
            (axes[2, 1], falling, everything, 0, "C0", None),
            (axes[2, 2], braked, braked.time < grips, 6, "C1", "before the brake grips"),
            (axes[2, 2], braked, braked.time > grips + 0.01, 0, "C0", "after"),
        )
        for axis, result, rows, trend, colour, label in pieces:
            frequency, lines = spectrum(result, rows, trend)
            axis.semilogy(frequency, np.maximum(lines, 1e-7), colour, lw=1, label=label)
        for axis, marks in zip(axes[2], ((7.622, 47.77), (31.82,), (28.45, 7.622, 47.77)), strict=True):
            for mark in marks:
                axis.axvline(mark, ls=":", color="k", lw=1)
            axis.set(xlim=(0, 80), ylim=(1e-4, 2), xlabel="Hz")
        for axis in axes[:2, 2]:
            axis.axvline(grips, ls=":", color="k", lw=1)
        for axis, label in (
            (axes[0, 1], "joint angle, degrees"),
            (axes[1, 0], "tip, mm"),
            (axes[2, 0], "spectrum of the tip"),
        ):
            axis.set_ylabel(label)
        axes[2, 2].set_ylim(1e-4, 100)
        axes[2, 2].legend(loc="upper right")
        figure.savefig(temporary, dpi=75)
        plt.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
