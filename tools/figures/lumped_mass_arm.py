"""Draw docs/systems/figures/lumped-mass-arm.png: response of the lumped arm, with the poles and zeros of Table 2.

Run ``python -m tools.figures.lumped_mass_arm``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexarm.api import linearise, simulate
from scenarios.load import load
from tools.fit_lumped_arm import JOINTS, published

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "lumped-mass-arm.png"


def draw(target: Path = TARGET) -> Path:
    """Bode magnitude of hub angle over torque, and the bends after a pulse, of the shipped scenario."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    scenario = load("lumped-arm")
    plant, run = linearise(scenario), simulate(scenario)
    rates = np.geomspace(2, 500, 4000)
    gain = np.array([plant.gain(w)[plant.outputs.index("link.hub.angle"), 0] for w in rates])
    pairs = published()[1:].reshape(-1, 2)

    figure, (top, bottom) = pyplot.subplots(2, 1, figsize=(7, 6.4), layout="constrained")
    top.loglog(rates, np.abs(gain), color="k", lw=1.2)
    for pair, style, label in ((pairs[:JOINTS], "--", "poles, Table 2"), (pairs[JOINTS:], ":", "zeros, Table 2")):
        for i, (_, rate) in enumerate(pair):
            top.axvline(rate, ls=style, lw=1, color="C3" if style == "--" else "C0", label=None if i else label)
    top.set(xlabel="rad/s", ylabel="hub angle / torque, rad/(N.m)", xlim=(2, 500))
    top.legend()

    for i in range(1, JOINTS + 1):
        bottom.plot(run.time, 1e3 * run[f"link.strain{i}"], lw=1, label=f"$e_{i}$")
    bottom.set(xlabel="s", ylabel="bend of each joint, mrad", xlim=(0, 1.5))
    bottom.legend(loc="lower right")
    angle = bottom.twinx()
    angle.plot(run.time, np.degrees(run["link.hub.angle"]), color="k", lw=1)
    angle.set_ylabel("hub angle, degrees")
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=80)
    pyplot.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
