"""Draw docs/systems/figures/rigid-pendulum.png: the pendulum of [Mohan 2010] with right and printed joint damping.

Run ``python -m tools.figures.rigid_pendulum``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from engine.files import writing
from flexarm.api import simulate
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "rigid-pendulum.png"


def draw(target: Path = TARGET) -> Path:
    """Angle of the shipped scenario, and with the printed 0.0308 as a joint damping."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    right = simulate(load("rigid-pendulum"))
    literal = simulate(load("rigid-pendulum", ["arm.viscous_friction=0.0308"]))
    with writing(target, (".png",)) as temporary:
        figure, axis = plt.subplots(figsize=(8, 3), layout="constrained")
        axis.plot(right.time, np.degrees(right["arm.joint1.angle"]), "C0", lw=1, label="1.242e-3 N.m.s/rad")
        envelope = 7 * np.exp(-0.0142 * 6.6626 * right.time)
        axis.plot(right.time, envelope, "k:", lw=1, label="ratio 0.0142")
        axis.plot(right.time, -envelope, "k:", lw=1)
        axis.plot(
            literal.time, np.degrees(literal["arm.joint1.angle"]), "C3", lw=1.2, label="0.0308 N.m.s/rad, as printed"
        )
        axis.set(xlabel="s", ylabel="joint angle, degrees", xlim=(0, 12), ylim=(-8, 10))
        axis.legend(loc="upper right", ncols=3)
        figure.savefig(temporary, dpi=85)
        plt.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
