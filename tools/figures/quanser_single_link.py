"""Draw docs/systems/figures/quanser-single-link.png: the arm of [Gao X. n.d.] with and without its dead zone.

Run ``python -m tools.figures.quanser_single_link``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from engine.files import writing
from flexarm.api import simulate
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "quanser-single-link.png"


def draw(target: Path = TARGET) -> Path:
    """Hub angle and tip deflection for 1 V over 1 s."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    runs = {
        "without dead zone": simulate(load("quanser-single-link-no-dead-zone")),
        "dead zone -0.09 V, +0.18 V": simulate(load("quanser-single-link")),
    }
    with writing(target, (".png",)) as temporary:
        figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 4.6), layout="constrained")
        for (label, run), style in zip(runs.items(), ("C3--", "C0-"), strict=True):
            above.plot(run.time, np.degrees(run["link.hub.angle"]), style, lw=1.3, label=label)
            below.plot(run.time, 1000 * run["link.tip.deflection"], style, lw=1.3)
        above.set(ylabel="hub angle, degrees", xlim=(0, 2.5))
        below.set(ylabel="tip deflection, mm", xlabel="s")
        above.legend(loc="lower right")
        for axis in (above, below):
            axis.grid(True, color="#e4e4e4", lw=0.6)
        figure.savefig(temporary, dpi=85)
        plt.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
