"""The rig that wheel.yaml models, without flexarm: writes steps.csv, sine.csv and ramp.csv beside this file.

A torque motor (its iron saturates), a bearing and a flywheel with a magnet beside it, by Runge-Kutta steps of 0.5 ms.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

CONSTANT, SATURATION, INERTIA, BEARING = 0.098, 12.0, 3.3e-3, 4.2e-4
GREATEST_TORQUE, CRITICAL_SPEED = 0.2, 40.0
NOISE, STEP, PARTS = 0.3, 0.01, 20


def acceleration(current: float, speed: float) -> float:
    """Of the wheel (rad/s2), at a current (A) and a speed (rad/s)."""
    ratio = speed / CRITICAL_SPEED
    motor = CONSTANT * current / np.sqrt(1 + (current / SATURATION) ** 2)
    return float(motor - BEARING * speed - 2 * GREATEST_TORQUE * ratio / (1 + ratio**2)) / INERTIA


def speeds(time: np.ndarray, current: np.ndarray) -> np.ndarray:
    """Speed (rad/s) at each instant from rest; the current changes along straight lines between them."""
    w, h, rows = 0.0, STEP / PARTS, [0.0]
    for first, last in pairwise(current):
        for k in range(PARTS):
            a, b, c = (first + (last - first) * (k + part) / PARTS for part in (0.0, 0.5, 1.0))
            k1 = acceleration(a, w)
            k2 = acceleration(b, w + h / 2 * k1)
            k3 = acceleration(b, w + h / 2 * k2)
            w += h / 6 * (k1 + 2 * k2 + 2 * k3 + acceleration(c, w + h * k3))
        rows.append(w)
    return np.array(rows)


def main() -> None:
    """Write the recordings."""
    random, t = np.random.default_rng(1), np.arange(0.0, 4.0 + 1e-9, STEP)
    currents = {
        "steps": np.where(t < 0.1, 0, np.where(t < 1.6, 5.0, np.where(t < 2.2, 0.0, np.where(t < 3.5, -4.0, 0.0)))),
        "sine": 6.0 * np.sin(2 * np.pi * 0.6 * t) * t / 4,
        "ramp": np.interp(t, [0, 1.5, 2.5, 4.0], [0, 5.5, -3.0, 2.0]),
    }
    for name, current in currents.items():
        w = speeds(t, current) + random.normal(0.0, NOISE, len(t))
        rows = np.column_stack([t, current, w])
        np.savetxt(Path(__file__).parent / f"{name}.csv", rows, "%.6g", ",", header="t,i,w", comments="")


if __name__ == "__main__":
    main()
