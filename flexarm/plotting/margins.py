"""A loop in one picture: Bode, Nyquist, sensitivity and the step of the closed loop, of every member of a family."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.figures import save
from engine.files import writing
from engine.model import Vector
from flexarm.plotting.axes import FLOOR, clean, degrees
from flexarm.plotting.axes import phase as phase_of
from flexarm.plotting.results import COLOURS, FIGURES

if TYPE_CHECKING:
    from flexarm.design.margins import LoopMargins

MOST_DRAWN = 60


def plot_margins(found: LoopMargins, path: str | Path, title: str = "") -> Path:
    """Draw the loops; the worst one stands out.

    Raises:
        FlexarmError: the file cannot be written.
    """
    import control
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 8), layout="constrained")
    grid = figure.add_gridspec(2, 4)
    gain, nyquist = figure.add_subplot(grid[0, :2]), figure.add_subplot(grid[0, 2:])
    phase = figure.add_subplot(grid[1, :2], sharex=gain)
    sensitivity, step = figure.add_subplot(grid[1, 2]), figure.add_subplot(grid[1, 3])
    chosen = np.unique(np.linspace(0, len(found.loops) - 1, min(len(found.loops), MOST_DRAWN)).astype(int)).tolist()
    chosen = [*(k for k in chosen if k != found.worst), found.worst]
    crossings = [m.crossover for m in found.members if math.isfinite(m.crossover)]
    middle = float(np.median(crossings)) if crossings else 1.0
    reach = 1e3 / middle if not crossings else 1e2
    horizon = 30 / middle
    phases = []
    for k in chosen:
        loop, member = found.loops[k], found.members[k]
        top = min(middle * reach, math.pi / loop.dt * 0.999) if loop.dt else middle * reach
        omega = _dense(loop, middle / reach, top)
        answer = np.asarray(loop(np.exp(1j * omega * loop.dt) if loop.dt else 1j * omega)).ravel()
        worst = k == found.worst
        looks: dict[str, Any] = {
            "color": COLOURS[1] if worst and len(chosen) > 1 else COLOURS[0],
            "lw": 1.6 if worst else 0.7,
        }
        looks |= {"alpha": 1.0 if worst else 0.5}
        gain.semilogx(omega, 20 * np.log10(np.maximum(np.abs(answer), FLOOR)), **looks)
        phases.append(phase_of(answer, omega))
        phase.semilogx(omega, phases[-1], **looks)
        nyquist.plot(answer.real, answer.imag, **looks)
        sensitivity.semilogx(omega, 20 * np.log10(np.maximum(np.abs(1 / (1 + answer)), FLOOR)), **looks)
        if member.stable:
            time = np.arange(0, horizon, loop.dt) if loop.dt else np.linspace(0, horizon, 800)
            if 2 <= len(time) < 200_000:
                response = control.step_response(control.feedback(loop, 1), time)
                step.plot(response.time, np.asarray(response.outputs).ravel(), **looks)
    around = np.linspace(0, 2 * np.pi, 200)
    alpha = found.members[found.worst].disk
    if 0 < alpha < 2:
        # The disk of balanced gain and phase margins in the Nyquist plane: from -(2+a)/(2-a) to -(2-a)/(2+a).
        ends = (-(2 + alpha) / (2 - alpha), -(2 - alpha) / (2 + alpha))
        centre, radius = sum(ends) / 2, (ends[1] - ends[0]) / 2
        nyquist.fill(centre + radius * np.cos(around), radius * np.sin(around), color="#dddddd", zorder=0)
    nyquist.plot([-1], [0], "+", color="#333333", ms=10, mew=1.6)
    nyquist.set_xlim(-3, 1.5)
    nyquist.set_ylim(-2.5, 2)
    nyquist.set_aspect("equal", adjustable="box")
    gain.axhline(0, color="#999999", lw=0.8)
    gain.set_ylabel("loop gain [dB]")
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("angular frequency [rad/s]")
    degrees(phase.yaxis, min(p.min() for p in phases), max(p.max() for p in phases))
    nyquist.set_xlabel("real part")
    nyquist.set_ylabel("imaginary part")
    nyquist.set_title("Nyquist, with the disk of the worst member", fontsize=9)
    sensitivity.axhline(0, color="#999999", lw=0.8)
    sensitivity.set_title("sensitivity [dB]", fontsize=9)
    sensitivity.set_xlabel("angular frequency [rad/s]")
    sensitivity.set_ylim(bottom=-40)
    step.axhline(1, color="#999999", lw=0.8)
    step.set_title("step of the closed loop", fontsize=9)
    step.set_xlabel("time [s]")
    for axis in (gain, phase, nyquist, sensitivity, step):
        clean(axis)
    unstable = sum(not m.stable for m in found.members)
    more = f"\n{len(found.members)} members, {unstable} of them unstable; the worst in red" if len(chosen) > 1 else ""
    figure.suptitle(title + more, fontsize=11)
    with writing(Path(path), FIGURES) as temporary:
        save(figure, temporary)
    return Path(path)


def _dense(loop: object, low: float, high: float) -> Vector:
    from flexarm.design.margins import frequencies_of_a_loop

    found = frequencies_of_a_loop(loop)
    return np.unique(np.concatenate([np.geomspace(low, high, 600), found[(found > low) & (found < high)]]))
