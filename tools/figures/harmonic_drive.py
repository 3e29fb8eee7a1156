"""Draw docs/systems/figures/harmonic-drive.png: how the elastic drive tends to the rigid one.

Run ``python -m tools.figures.harmonic_drive``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexarm.api import linearise, simulate
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "harmonic-drive.png"


def poles(stiffness: float) -> Any:
    """The three slowest pole pairs of the arm behind a drive of some stiffness (N.m/rad), upper halves."""
    found = linearise(load("harmonic-drive-arm", [f"drive.stiffness={stiffness}"])).poles()
    return np.sort_complex(1j * found[found.imag > 1])[::-1][:3] / 1j


def draw(target: Path = TARGET) -> Path:
    """Distance of the poles from the rigid limit against stiffness, and the link's motion for three drives."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    rigid = linearise(load("lumped-arm")).poles()
    wanted = np.sort_complex(1j * rigid[rigid.imag > 1])[::-1] / 1j
    stiffness = np.geomspace(100, 1e6, 9)
    errors = np.array([np.abs(poles(k) / wanted - 1) for k in stiffness])

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    for i in range(3):
        left.loglog(stiffness, errors[:, i], "o-", ms=3, lw=1, label=f"pole pair {i + 1}, {wanted[i].imag:.4g} rad/s")
    left.loglog(stiffness, 1 / stiffness, "k:", lw=1, label="1 / K")
    left.set(xlabel="drive stiffness K, N.m/rad", ylabel="relative distance from the rigid limit")
    left.legend(fontsize=8)

    for k in (10.0, 100.0, 1000.0):
        run = simulate(load("harmonic-drive-arm", [f"drive.stiffness={k}", "width=0.05"]), stop=0.6)
        right.plot(run.time, np.degrees(run["link.hub.angle"]), lw=1, label=f"K = {k:g} N.m/rad")
    run = simulate(load("lumped-arm-pulse"), stop=0.6)
    right.plot(run.time, np.degrees(run["link.hub.angle"]), "k--", lw=1, label="rigid")
    right.set(xlabel="s", ylabel="hub angle of the link, degrees")
    right.legend(fontsize=8)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=85)
    pyplot.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
