"""Draw docs/systems/figures/two-link-arm.png: the two-link arm of [Mohan 2010] on made-up torques.

Run ``python -m tools.figures.two_link_arm``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from engine.files import writing
from flexarm.api import simulate
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "two-link-arm.png"


def draw(target: Path = TARGET) -> Path:
    """Torques, joint angles, deflections of the links' tips and path of the arm's end."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    result = simulate(load("two-link-flexible"))
    with writing(target, (".png",)) as temporary:
        figure, axes = plt.subplots(2, 2, figsize=(9, 5.4), layout="constrained")
        (torque, bend), (angle, path) = axes
        for i, colour in ((1, "C0"), (2, "C1")):
            torque.plot(result.time, 1e3 * result[f"torque{i}.out"], colour, lw=1, label=f"joint {i}")
            angle.plot(result.time, np.degrees(result[f"arm.joint{i}.angle"]), colour, lw=1)
            bend.plot(result.time, 1e3 * result[f"arm.link{i}.deflection"], colour, lw=0.8)
        x, y = result["arm.tip.x"], result["arm.tip.y"]
        path.plot(x, y, "k", lw=1)
        for row, alpha in ((0, 0.35), (600, 0.35), (len(x) - 1, 0.9)):
            first = result["arm.joint1.angle"][row]
            elbow = 0.24 * np.array([np.cos(first), np.sin(first)])
            path.plot([0, elbow[0], x[row]], [0, elbow[1], y[row]], "C2o-", lw=2, ms=4, alpha=alpha)
        path.set(aspect="equal", xlabel="x, m", ylabel="y, m")
        for axis, label in ((torque, "torque, mN.m"), (angle, "joint angle, degrees"), (bend, "deflection, mm")):
            axis.set(xlabel="s", ylabel=label, xlim=(0, 2))
        torque.legend(loc="upper right")
        figure.savefig(temporary, dpi=80)
        plt.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
