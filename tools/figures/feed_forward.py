"""Draw docs/systems/figures/feed-forward.png: tracking errors of PI with and without feed-forward.

Run ``python -m tools.figures.feed_forward``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexarm.api import simulate
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "feed-forward.png"
RIGID = (
    "feedforward={type: RigidFeedForward, ratio: 14, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, "
    "efficiency: 0.69, rotor_inertia: 4.606e-7 kg.m2, viscous_friction: 1.26e-6 N.m.s/rad, coulomb_friction: "
    "2.25e-4 N.m, load_inertia: 9.4276e-3 kg.m2, load_viscous_friction: 3.2928e-4 N.m.s/rad}"
)
CASES = {
    "PI, reference not filtered": ("feedforward.active=false", "compensation.active=false"),
    "PI": ("feedforward.active=false",),
    "PI and rigid feed-forward": (RIGID,),
    "PI and two-mass feed-forward": (),
    "the same, plant's inertia +20 %": ("load.inertia=0.01131312",),
}


def draw(target: Path = TARGET) -> Path:
    """Errors of the motor's speed and of the link's position over the motion, and the voltage."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (top, middle, bottom) = pyplot.subplots(3, 1, figsize=(8.5, 7.5), layout="constrained", sharex=True)
    for label, changes in CASES.items():
        run = simulate(load("srv02-tracking", changes), stop=3.0)
        error = run["feedforward.motor.speed"] - run["motor.shaft.speed"]
        position = 1e3 * (run["trajectory.position"] - run["load.shaft.angle"])
        most = f"{np.abs(error).max():.3g} rad/s, {np.abs(position).max():.3g} mrad"
        top.plot(run.time, error, lw=1, label=f"{label}: at most {most}")
        middle.plot(run.time, position, lw=1)
        bottom.plot(run.time, run["motor.voltage"], lw=1)
    figure.legend(fontsize=8, loc="outside upper center", ncols=1)
    top.set_ylabel("motor speed error\nrad/s", fontsize=9)
    middle.set_ylabel("link position error\nmrad", fontsize=9)
    bottom.set_ylabel("voltage\nV", fontsize=9)
    bottom.set_xlabel("s")
    for axes in (top, middle, bottom):
        axes.grid(lw=0.3)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=75)
    pyplot.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
