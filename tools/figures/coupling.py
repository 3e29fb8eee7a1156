"""Draw docs/explanation/figures/coupling.png: where two FMUs that were cut from one another stay right and stable.

Run ``python -m tools.figures.coupling``. A motor's inertia drives a load through a spring; each point is a run of both
FMUs by a Jacobi master with steps of 1 ms, compared with the whole model. On the left the master passes angle, speed
and torque alone, and the FMUs hold them; on the right it passes all that `fmu.coupling` sends.
"""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine.errors import FlexarmError
from engine.simulate import Drive, simulate
from flexarm.cut import cut
from flexarm.splitting.split import split
from fmu import archive
from fmu.host import host
from fmu.ssp import read
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "explanation" / "figures" / "coupling.png"
ROTOR, STEP, STOP = 2.25e-3, 1e-3, 0.3
RATIOS = np.logspace(-2, 2, 5)
PERIODS = np.logspace(-2, 0.5, 6)
"""Step times the frequency sqrt(k / J) of the rotor on the spring."""

HELD = ("angle", "speed", "torque")
_TEXT = f"""schema: 1
name: pair
blocks:
  motor: {{type: Torque}}
  rotor: {{type: Inertia, inertia: {ROTOR} kg.m2}}
  bearing: {{type: BearingFriction, viscous_friction: 10 mN.m.s/rad}}
  spring: {{type: SpringDamper, stiffness: {(PERIODS[-1] / STEP) ** 2 * ROTOR} N.m/rad, damping: 0.1 N.m.s/rad}}
  load: {{type: Inertia, inertia: {ROTOR} kg.m2}}
connect:
  - [motor.shaft, rotor.shaft, bearing.shaft, spring.a]
  - [spring.b, load.shaft]
simulate: {{stop: {STOP} s, step: 1 ms, record: [rotor.shaft.speed, load.shaft.speed]}}
analyses:
  fmu: {{kind: export, inputs: [motor.torque], outputs: [rotor.shaft.speed, load.shaft.speed]}}
"""


class Pair:
    """The two FMUs, exported once at the stiffest spring; the rest are parameters that are set before a run."""

    def __init__(self, folder: Path) -> None:
        (folder / "pair.yaml").write_text(_TEXT, encoding="utf-8")
        made = cut(load(folder / "pair.yaml"), "export")
        self.model = made.model
        self.path = split(made, folder / "pair.ssp", {"load": ["spring", "load"]}, platforms=["linux64"], stop=STOP)

    def error(self, ratio: float, period: float, *, whole_coupling: bool) -> float:
        """Largest difference from the whole, over each signal's range; infinite if the run fails."""
        stiffness = (period / STEP) ** 2 * ROTOR
        damping = 0.02 * float(np.sqrt(stiffness * ROTOR * min(ratio, 1.0)))
        values = {"spring.stiffness": stiffness, "spring.damping": damping, "load.inertia": ratio * ROTOR}
        expected = simulate(self.model, STOP, STEP, drive=Drive([0.0], [[1.0]]), parameters=values).values
        try:
            given = _run(self.path, whole_coupling, values)
        except FlexarmError:
            return np.inf
        return float((np.abs(given - expected).max(axis=0) / np.ptp(expected, axis=0)).max())


def _run(path: Path, whole_coupling: bool, values: dict[str, float]) -> NDArray[np.float64]:
    structure, rows = read(path), []
    wires = [
        (start, end)
        for start, end in structure.connections
        if start[0] and end[0] and (whole_coupling or end[1].rpartition("_")[2] in HELD)
    ]
    outputs = [start for start, end in structure.connections if not end[0]]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        archive.unpack(path, folder)
        parts = {name: stack.enter_context(host(folder / file, name)) for name, file in structure.sources.items()}

        parts["load"].set(list(values), list(values.values()))

        def exchange() -> None:
            sent = [parts[start[0]].get([start[1]])[0] for start, _ in wires]
            for (_, end), value in zip(wires, sent, strict=True):
                parts[end[0]].set([end[1]], [value])

        with ExitStack() as starting:
            for part in parts.values():
                starting.enter_context(part.starting(0.0, STOP))
            for start, end in structure.connections:
                if not start[0]:
                    parts[end[0]].set([end[1]], [1.0])
            exchange()
            exchange()
        for k in range(round(STOP / STEP) + 1):
            rows.append([parts[name].get([variable])[0] for name, variable in outputs])
            if np.abs(rows[-1]).max() > 1e9:
                raise FlexarmError("the coupled run diverges")
            exchange()
            for part in parts.values():
                part.step(k * STEP, STEP) if k < round(STOP / STEP) else None
    return np.array(rows)


def draw(target: Path = TARGET) -> Path:
    """Both maps side by side."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained", sharey=True)
    titles = ("values held", "with the answer of the torque and the motion carried on")
    image = None
    with tempfile.TemporaryDirectory() as folder:
        pair = Pair(Path(folder))
        maps = [
            np.array([[pair.error(r, p, whole_coupling=whole) for r in RATIOS] for p in PERIODS])
            for whole in (False, True)
        ]
    for plot, title, found in zip(axes, titles, maps, strict=True):
        shown = np.clip(np.log10(found), -5, 1)
        image = plot.imshow(shown, cmap="RdYlGn_r", vmin=-5, vmax=1, origin="lower", aspect="auto")
        for (i, j), value in np.ndenumerate(found):
            label = "unstable" if value > 10 else f"{100 * value:.2g} %"
            plot.text(j, i, label, ha="center", va="center", fontsize=7)
        plot.set_xticks(range(len(RATIOS)), [f"{ratio:g}" for ratio in RATIOS])
        plot.set_yticks(range(len(PERIODS)), [f"{period:.2g}" for period in PERIODS])
        plot.set_xlabel("inertia of the load / of the rotor")
        plot.set_title(title, fontsize=9)
    axes[0].set_ylabel("step x frequency of the rotor on the spring (rad)")
    assert image is not None
    figure.colorbar(image, ax=axes, label="log10 of the error over the range")
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=90)
    pyplot.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
