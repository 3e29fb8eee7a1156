"""Draw docs/systems/figures/trajectory.png: the paper's trajectory, and one with a cruise and flat jerk.

Run ``python -m tools.figures.trajectory``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from engine.simulate import simulate
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "trajectory.png"
LIMITS = {"velocity": 1.8, "acceleration": 4.0, "jerk": 16.0, "snap": 240.0}
UNITS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s2", "jerk": "rad/s3", "snap": "rad/s4"}


def draw(target: Path = TARGET) -> Path:
    """Position and four derivatives of two trajectories."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    outputs = [f"trajectory.{order}" for order in UNITS]
    trapezoidal = [f"trajectory.{name}_limit={value}" for name, value in LIMITS.items()]
    cases = {
        "Gao: all limits met together, triangular jerk": [],
        "other limits, trapezoidal jerk": ["trajectory.profile=trapezoidal", *trapezoidal],
    }
    figure, panels = pyplot.subplots(5, 1, figsize=(8, 7.5), layout="constrained", sharex=True)
    for label, changes in cases.items():
        run = simulate(load("srv02-tracking", changes).build(outputs=outputs), 2.4, 2e-3)
        for axes, (order, unit) in zip(panels, UNITS.items(), strict=True):
            axes.plot(run.time, run[f"trajectory.{order}"], lw=1, label=label)
            axes.set_ylabel(f"{order}\n{unit}", fontsize=8)
    for axes in panels:
        axes.grid(lw=0.3)
    panels[0].legend(fontsize=8)
    panels[-1].set(xlabel="s", xticks=np.arange(0, 2.5, 0.25))
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=80)
    pyplot.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
