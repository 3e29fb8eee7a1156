"""Draw docs/systems/figures/srv02-frequency-response.png: tables A.1 and A.2 against linear models and backlash.

Run ``python -m tools.figures.srv02_frequency_response``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.compare import compare
from flexarm.api import linearise
from scenarios.load import load

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "srv02-frequency-response.png"
SPEED = "motor.shaft.speed"
GAP = ("friction.coulomb_friction=2.25e-4", "contact.law=push_only")
REFIT_A2 = (
    "load.inertia=6.04e-5",
    "contact.damping=3.6e-4",
    "contact.stiffness=2.31e-2",
    "contact.half_gap=0.041",
    "bearing.coulomb_friction=1.16e-4",
    "bearing.viscous_friction=6.1e-7",
)
REFIT_A1 = (
    "load.inertia=1.77e-5",
    "contact.damping=5.65e-4",
    "contact.stiffness=4.98e-3",
    "contact.half_gap=0.093",
    "bearing.coulomb_friction=3.3e-5",
    "bearing.viscous_friction=3e-7",
)


def linear(axes: Any, scenario: str, frequency: Any, label: str, style: str) -> None:
    """The gain of a scenario's linear model."""
    model = linearise(load(scenario))
    gain = [abs(model.gain(float(w))[0, 0]) for w in frequency]
    axes.semilogx(frequency, 20 * np.log10(gain), style, lw=1, label=label)


def simulated(axes: Any, scenario: str, recording: str, changes: tuple[str, ...], label: str, style: str) -> None:
    """What a sine of 2 V gives at the table's frequencies, and the table's own values."""
    error = compare(load(scenario, changes), recording).signals[SPEED]
    axes.semilogx(
        error.axis, 20 * np.log10(error.simulated / 2), style, ms=3, lw=1, label=f"{label}, {error.rms_db:.2f} dB"
    )


def draw(target: Path = TARGET) -> Path:
    """Measured gains, linear models, backlash with the published parameters, and refits."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharey=True)
    cases = (
        ("Table A.2, flexible link", "table_a2", "srv02-2mass-b3", "B.3", "srv02-3mass-b4", "B.4", 0.03, REFIT_A2),
        ("Table A.1, rigid link", "table_a1", "srv02-2mass-b1", "B.1", "srv02-3mass-b2", "B.2", 0.03, REFIT_A1),
    )
    for axes, (title, recording, two, b2, three, b3, gap, refit) in zip(panels, cases, strict=True):
        measured = compare(load(two), recording).signals[SPEED]
        axes.semilogx(measured.axis, 20 * np.log10(measured.measured / 2), "ko", ms=4, mfc="none", label="measured")
        fine = np.geomspace(measured.axis[0], measured.axis[-1], 400)
        linear(axes, two, fine, f"two masses, {b2}, linear", "C0-")
        linear(axes, three, fine, f"three masses, {b3}, linear", "C1--")
        changes = (*GAP, f"contact.half_gap={gap}")
        simulated(axes, two, recording, changes, f"{b2} with a half gap of {gap:g} rad", "C2.-")
        simulated(axes, two, recording, (*GAP, *refit), "refit of five values", "C3.-")
        axes.set(title=title, xlabel="rad/s", ylim=(-2, 50))
        axes.legend(fontsize=7, loc="lower left")
    panels[0].set_ylabel("motor speed over voltage, dB")
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=85)
    pyplot.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
