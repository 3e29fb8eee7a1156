"""Draw docs/how-to/figures/robust.png: a controller for one model and one for all that recordings allow, on the rig.

Run ``python -m tools.figures.robust``. It runs the Python of docs/how-to/control-design.md on docs/how-to/data, and
the two closed scenarios for every member of the family. ``--recordings`` first makes the rig's recordings anew: a
simulation at `TRUTH` with noise of 1 rad/s.
"""

from __future__ import annotations

import contextlib
import re
import runpy
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from engine.simulate import Drive, simulate
from scenarios.load import load

HOW_TO = Path(__file__).resolve().parents[2] / "docs" / "how-to"
PAGE, DATA, TARGET = HOW_TO / "control-design.md", HOW_TO / "data", HOW_TO / "figures" / "robust.png"
TRUTH = ("hub.inertia=0.01", "joint.stiffness=10", "joint.damping=0.01", "bearing.viscous_friction=0.06")
NOISE, LENGTH, STEP = 1.0, 1.5, 5e-3


def record() -> None:
    """Make the recordings: torques of either sign, which changes by chance every 0.1 s."""
    rig = load(DATA / "rig.yaml", [*TRUTH, "initial.arm.shaft.speed=0"])
    model = rig.build(["motor.torque"], ["arm.shaft.speed"])
    random = np.random.default_rng(5)
    time = np.arange(0, LENGTH, STEP)
    for name in ("fitted", "held-out"):
        u = np.repeat(random.choice([-0.2, 0.2], len(time) // 20 + 1), 20)[: len(time)]
        y = simulate(model, time[-1], STEP, drive=Drive(time, u)).values[: len(time), 0]
        rows = np.column_stack([time, u, y + random.normal(0, NOISE, len(time))])
        np.savetxt(DATA / f"rig-{name}.csv", rows, delimiter=",", header="t,u,y", comments="", fmt="%.6g")


def follow(folder: Path) -> dict[str, Any]:
    """Run the page's fenced Python in a folder, which gets the rig's files; its variables at the end."""
    for file in DATA.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (folder / "page.py").write_text("\n".join(blocks), encoding="utf-8")
    with contextlib.chdir(folder):
        return runpy.run_path("page.py")


def main(arguments: list[str]) -> None:
    """Draw the figure."""
    import matplotlib.pyplot as plt

    if "--recordings" in arguments:
        record()
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), sharex=True, layout="constrained")
    with tempfile.TemporaryDirectory() as folder:
        samples = follow(Path(folder))["made"].samples
        for ax, name in zip(axes, ("one", "all"), strict=True):
            scenario = load(Path(folder) / f"closed-{name}.yaml")
            model, planned = scenario.build(), scenario.simulation
            assert planned is not None
            for sample in samples[::-1]:
                run = simulate(model, planned.stop, planned.step, parameters=sample)
                fitted = sample is samples[0]
                ax.plot(run.time, run.values[:, 0], color="C3" if fitted else "0.6", lw=1.4 if fitted else 0.6)
            ax.set(
                ylim=(-8, 8), xlabel="time (s)", title=f"designed for {'the fitted model' if name == 'one' else name}"
            )
    axes[0].set_ylabel("speed of the arm (rad/s)")
    TARGET.parent.mkdir(exist_ok=True)
    figure.savefig(TARGET, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1:])
