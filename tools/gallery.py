"""The figures of docs/gallery.md, drawn from shipped scenarios while the documentation is built.

``python -m tools.gallery DIR`` draws them into a folder.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from engine.simulate import Result
from flexarm.api import compare, linearise, simulate
from scenarios.load import load

ROOT = Path(__file__).resolve().parent.parent
GAPS = ("0 rad", "0.03 rad", "0.1 rad")
BLUE, RED, GREEN, GREY = "#1b6ca8", "#d1495b", "#2e8b57", "#5c5c5c"


def _axes(rows: int, columns: int, size: tuple[float, float], **settings: Any) -> tuple[Any, Any]:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False, **settings)
    for axis in axes.flat:
        axis.grid(True, color="#dddddd", linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _png(figure: Any) -> bytes:
    from matplotlib import pyplot as plt

    page = io.BytesIO()
    # No date and no version: the same scenario gives the same file.
    figure.savefig(page, format="png", dpi=100, metadata={"Software": None})
    plt.close(figure)
    return page.getvalue()


def step_with_gap() -> bytes:
    """Motor and load after a voltage step, through gaps of three sizes."""
    figure, axes = _axes(3, 1, (8, 6), sharex=True)
    gap, motor, load_ = axes[:, 0]
    outputs = ["motor.shaft.speed", "load.shaft.speed", "contact.offset"]
    for half, colour in zip(GAPS, (GREY, BLUE, RED), strict=True):
        settings = ["contact.law=push_only", f"contact.half_gap={half}", "friction.coulomb_friction=2.25e-4"]
        scenario = load("srv02-2mass-b3", [*settings, "source.stop=0.15 s"])
        run = simulate(scenario.build(outputs=outputs), 0.25, 2e-4)
        motor.plot(run.time, run["motor.shaft.speed"], color=colour, lw=1.2, label=f"half gap {half}")
        load_.plot(run.time, run["load.shaft.speed"], color=colour, lw=1.2)
        gap.plot(run.time, run["contact.offset"], color=colour, lw=1.2)
    gap.set_ylabel("twist of the joint [rad]")
    motor.set_ylabel("motor [rad/s]")
    motor.legend(frameon=False)
    load_.set(ylabel="load [rad/s]", xlabel="time [s]", xlim=(0, 0.25))
    return _png(figure)


def stick_slip() -> bytes:
    """Hub and link after a torque pulse; grey where the hub is stuck."""
    figure, axes = _axes(2, 2, (9, 4.6), sharex=True, sharey="row")
    for column, width in zip(axes.T, ("0.05 s", "0.5 s"), strict=True):
        run = simulate(load("lumped-arm-pulse", [f"width={width}"]), stop=2.0)
        for axis in column:
            for begin, end in _stuck(run):
                axis.axvspan(begin, end, color="0.9", lw=0)
        column[0].plot(run.time, run["link.hub.speed"], color=BLUE, lw=1.2)
        column[1].plot(run.time, 1e3 * run["link.tip.deflection"], color=RED, lw=1.0)
        column[0].set_title(f"pulse of {width}", fontsize=10)
        column[1].set(xlabel="time [s]", xlim=(0, 2))
    axes[0, 0].set_ylabel("hub speed [rad/s]")
    axes[1, 0].set_ylabel("tip deflection [mm]")
    return _png(figure)


def _stuck(run: Result) -> list[tuple[float, float]]:
    """Intervals in which the friction sticks."""
    events = [(0.0, 0), *((instant, value) for instant, name, value in run.events if name == "friction")]
    ends = [*(instant for instant, _ in events[1:]), float(run.time[-1])]
    return [(begin, end) for (begin, value), end in zip(events, ends, strict=True) if value == 0]


def harmonic_ripple() -> bytes:
    """Torque in a harmonic drive whose ripple crosses the resonance during a run-up."""
    source = ROOT / "docs" / "gallery" / "harmonic-drive-ripple.yaml"
    run = simulate(source)
    swing = max(abs(pole.imag) for pole in linearise(source).poles())
    figure, axes = _axes(1, 2, (9, 3.6))
    left, right = axes[0]
    left.plot(run.time, run["rotor.shaft.speed"], color=BLUE, lw=0.8)
    left.axhline(swing / 2, color=GREY, ls=":", lw=1.2)
    left.set(xlabel="time [s]", ylabel="wave generator [rad/s]", xlim=(0, 8))
    right.plot(run["rotor.shaft.speed"], run["drive.torque"], color=RED, lw=0.5)
    right.axvline(swing / 2, color=GREY, ls=":", lw=1.2, label=f"half of the resonance, {swing / 2:.0f} rad/s")
    right.set(xlabel="wave generator [rad/s]", ylabel="torque in the drive [N.m]")
    right.legend(frameon=False, fontsize=8, loc="upper right")
    return _png(figure)


def serial_arm() -> bytes:
    """Two flexible links swung by torques at both joints, every 0.15 s, bent as they are."""
    from blocks.links.mode_shapes import shape

    scenario = load("reference-c", ["torque1.amplitude=40 mN.m", "torque2.amplitude=6 mN.m"])
    run = simulate(scenario, stop=1.8, record_states=True)
    lengths, x = (0.24, 0.19), np.linspace(0, 1, 25)
    figure, axes = _axes(1, 2, (9, 4), width_ratios=[1.2, 1])
    left, right = axes[0]
    rows = range(0, len(run.time), 150)
    for k in rows:
        root, direction = np.zeros(2), 0.0
        for i, length in enumerate(lengths, start=1):
            direction += float(run[f"arm.joint{i}.angle"][k])
            amplitudes = [_state(run, f"arm.link{i}.mode{j}.position")[k] for j in (1, 2)]
            bend = sum(a * shape(j, x) for j, a in enumerate(amplitudes, start=1))
            slope = sum(a * shape(j, 1.0, 1) for j, a in enumerate(amplitudes, start=1)) / length
            along = np.array([np.cos(direction), np.sin(direction)])
            across = np.array([-along[1], along[0]])
            line = root[:, None] + np.outer(along, length * x) + np.outer(across, bend)
            left.plot(*line, color=(BLUE, RED)[i - 1], lw=1.6, alpha=0.25 + 0.75 * k / rows[-1])
            root, direction = line[:, -1], direction + float(slope)
    left.plot(run["arm.tip.x"], run["arm.tip.y"], color=GREY, lw=0.7, ls=":")
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    for i, colour in ((1, BLUE), (2, RED)):
        right.plot(run.time, 1e3 * run[f"arm.link{i}.deflection"], color=colour, lw=1, label=f"link {i}")
    right.set(xlabel="time [s]", ylabel="deflection of the link's tip [mm]", xlim=(0, run.time[-1]))
    right.legend(frameon=False)
    return _png(figure)


def _state(run: Result, name: str) -> Any:
    assert run.states is not None
    return run.states[:, [variable.name for variable in run.model.states].index(name)]


def mode_shapes() -> bytes:
    """The shapes in which an assumed-modes link bends, and how few of them the slow motions need."""
    from blocks.links.mode_shapes import root, shape

    x = np.linspace(0, 1, 200)
    figure, axes = _axes(1, 2, (9, 3.6))
    left, right = axes[0]
    counts = range(1, 9)
    rates = [_bending(count) for count in (*counts, 14)]
    for mode, colour in zip((1, 2, 3, 4), (BLUE, RED, GREEN, GREY), strict=True):
        left.plot(x, shape(mode, x), color=colour, lw=1.4, label=f"{mode}: beta L = {root(mode):.4f}")
        known = [n for n in counts if n >= mode]
        errors = [rates[n - 1][mode - 1] / rates[-1][mode - 1] - 1 for n in known]
        right.semilogy(known, errors, "o-", color=colour, ms=3, lw=1, label=f"pole pair {mode}")
    left.set(xlabel="s / L", ylabel="shape Q", xlim=(0, 1))
    right.set(xlabel="number of assumed modes", ylabel="frequency above that with 14 modes", ylim=(1e-6, 1))
    for axis in (left, right):
        axis.legend(frameon=False, fontsize=8)
    return _png(figure)


def _bending(modes: int) -> Any:
    """Rates of the pole pairs (rad/s) of the single-link arm in low gear, slowest first."""
    light = ["gear.ratio=5", "gear.inertia=5e-6 kg.m2", "bearing.viscous_friction=0"]
    poles = linearise(load("quanser-single-link-no-dead-zone", [*light, f"link.modes={modes}"])).poles()
    return np.sort(poles.imag[poles.imag > 1])


def bode_with_gap() -> bytes:
    """Measured speeds of the SRV02 at 2 V, the linear model's Bode plot, and the model with friction and a gap."""
    figure, axes = _axes(1, 1, (8, 4))
    axis = axes[0, 0]
    settings = ["friction.coulomb_friction=2.25e-4", "contact.law=push_only", "contact.half_gap=0.03"]
    error = next(iter(compare(load("srv02-2mass-b3", settings), "table_a2").signals.values()))
    linear = linearise("srv02-2mass-b3", inputs=["motor.voltage"], outputs=["motor.shaft.speed"])

    def gain(rate: float) -> float:
        return float(np.abs(linear.gain(rate)[0, 0]))

    measured = 20 * np.log10(error.measured / 2)
    missed = np.sqrt(np.mean((measured - [20 * np.log10(gain(rate)) for rate in error.axis]) ** 2))
    fine = np.geomspace(error.axis[0], error.axis[-1], 400)
    axis.semilogx(error.axis, measured, "o", color=BLUE, ms=4, label="measured, Gao's Table A.2")
    bode = 20 * np.log10([gain(rate) for rate in fine])
    axis.semilogx(fine, bode, color=GREY, lw=1.4, label=f"linear: {missed:.2f} dB rms")
    label = f"with dry friction and a half gap of 0.03 rad: {error.rms_db:.2f} dB rms"
    axis.semilogx(error.axis, 20 * np.log10(error.simulated / 2), color=RED, lw=1.4, label=label)
    axis.set(xlabel="rad/s", ylabel="motor speed / voltage [dB re 1 rad/(s.V)]", ylim=(-8, 55))
    axis.legend(frameon=False, loc="upper right")
    return _png(figure)


def wiring() -> bytes:
    """The wiring of the switching reference model, as ``flexarm diagram`` draws it."""
    from flexarm.plotting.wiring.diagram import diagram

    return diagram(load("reference-b")).svg().encode()


def drives() -> bytes:
    """Four drives: a belt that goes slack, a bus under braking, an arm that its gear shakes, a servo that lags."""
    figure, axes = _axes(2, 2, (10, 6))
    belt, bus, arm, servo = axes.flat
    for pretension, colour in (("300 N", GREY), ("30 N", RED)):
        scenario = load("belt-axis", [f"belt.pretension={pretension}"])
        run = simulate(scenario.build(outputs=["belt.stretch"]), 0.35, 5e-4)
        belt.plot(run.time, 1e3 * run["belt.stretch"], color=colour, lw=1.0, label=f"pretension {pretension}")
    belt.set(ylabel="stretch of the belt [mm]", xlim=(0, 0.35))
    belt.legend(frameon=False, fontsize=8)
    for resistance, colour, label in (
        ("1 kohm", GREY, "brake resistor of 1 kohm"),
        ("3 ohm", BLUE, "brake resistor of 3 ohm"),
    ):
        run = simulate(load("ball-screw-axis", [f"chopper.resistance={resistance}"]), stop=0.7)
        bus.plot(run.time, run["rectifier.voltage"], color=colour, lw=1.0, label=label)
    bus.set(ylabel="bus voltage [V]", xlim=(0, 0.7))
    bus.legend(frameon=False, fontsize=8)
    for error, colour, label in (("0.15 mrad, 0.04 mrad", RED, "with"), ("0 rad, 0 rad", GREY, "without")):
        run = simulate(load("pmsm-joint", [f"drive.error_amplitude=[{error}]"]), stop=0.8)
        arm.plot(run.time, run["arm.shaft.acceleration"], color=colour, lw=0.8, label=f"{label} transmission error")
    arm.set(xlabel="time [s]", ylabel="arm [rad/s²]", xlim=(0, 0.8))
    arm.legend(frameon=False, fontsize=8)
    run = simulate("robot-servo")
    servo.plot(run.time, np.degrees(run["target.out"]), color="black", ls=":", lw=1.0, label="asked")
    for share, colour in (("0", GREY), ("0.12", GREEN)):
        run = simulate(load("robot-servo", [f"loaded.coefficient={share}", f"lifted.coefficient={share}"]))
        angle = np.degrees(run["motor.shaft.angle"])
        servo.plot(run.time, angle, color=colour, lw=1.2, label=f"friction {share} of the load")
    servo.set(xlabel="time [s]", ylabel="servo [deg]", xlim=(0, 4))
    servo.legend(frameon=False, fontsize=8)
    return _png(figure)


FIGURES: dict[str, Callable[[], bytes]] = {
    "step-with-gap.png": step_with_gap,
    "stick-slip.png": stick_slip,
    "harmonic-drive-ripple.png": harmonic_ripple,
    "drives.png": drives,
    "serial-arm.png": serial_arm,
    "mode-shapes.png": mode_shapes,
    "bode-with-gap.png": bode_with_gap,
    "wiring.svg": wiring,
}
"""Name of the file: what draws it."""


def main(arguments: list[str]) -> int:
    """Draw all figures into a folder and say how long each took."""
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in FIGURES.items():
        begun = time.perf_counter()
        (folder / name).write_bytes(draw())
        print(f"{name:28} {time.perf_counter() - begun:6.2f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
