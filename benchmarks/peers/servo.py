"""Fits six published friction laws to the recordings of the XL330 servo: ``python -m benchmarks.peers.servo``.

Written from the equations of [Duclusaud 2025], not from its code: J q'' = tm + te + tf, tf the torque that would stop
the joint within a step, held between +-F, and F, the friction that there can be, by the law:

    M1  Kc + Kv |v|
    M2  M1 + s Kcs,                     s = exp(-|v / vs|^a)
    M3  M1 + Kl |tm - te|
    M4  M3 + s (Kcs + Kls |tm - te|)
    M5  M1 + |Km tm - Ke te| + s (Kcs + |Kms tm - Kes te|)
    M6  M5 + s Q,                       Q = Keq te^2 where |tm| > |te|, else Kmq tm^2

tm = torque of the motor, te = torque of the weight. All are fitted alike: least squares on the position, on the gains
100 and 400; torque constant, resistance and armature with the law's own numbers; Levenberg-Marquardt from several
starts, of which the lowest cost counts. Judged on gain 200, mean absolute error, each recording counting as much.
FLEXARM_RECORDINGS says where the recordings lie; they are not part of this repository.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MASS, LENGTH, GRAVITY, HORN, SUPPLY = 0.49, 0.1, 9.81, 0.029, 7.4
"""Known: point mass (kg), its radius (m), gravity (m/s2), offset of the horn (rad), voltage that is switched (V)."""

DUTY = 4096 / (2 * np.pi) / (256 * 885)
"""Duty per radian and unit of the firmware's gain."""

STEP = 1e-3
"""Integration step (s)."""

COMMON = {"torque_constant": 0.38, "resistance": 3.4, "armature": 1.9e-3, "Kc": 9e-3, "Kv": 4.4e-3}
STRIBECK = {"Kcs": 9e-3, "vs": 0.3, "a": 1.0}
LAWS: dict[str, dict[str, float]] = {
    "M1": COMMON,
    "M2": COMMON | STRIBECK,
    "M3": COMMON | {"Kl": 0.1},
    "M4": COMMON | STRIBECK | {"Kl": 0.1, "Kls": 0.05},
    "M5": COMMON | STRIBECK | {"Km": 0.1, "Ke": 0.1, "Kms": 0.05, "Kes": 0.05},
    "M6": COMMON | STRIBECK | {"Km": 0.1, "Ke": 0.1, "Kms": 0.05, "Kes": 0.05, "Keq": 0.05, "Kmq": 0.05},
}
"""Parameters of each law, and about where they are (SI); all are positive and searched on a logarithmic scale."""

KNOWN = ("torque_constant", "resistance", "armature")
"""Those that the makers of the logs have published: starts vary by a factor of `NEAR`, the others by `FAR`."""

NEAR, FAR = 1.5, 4.0
ITERATIONS = 60


@dataclass(frozen=True)
class Log:
    """One recording.

    Attributes:
        name: of its file.
        gain: duty per radian.
        time, position: of the samples (s, rad).
        goal, on: at every step: angle asked for (rad), and whether the motor is on (share).
        speed: at the start (rad/s).
    """

    name: str
    gain: float
    time: Array
    position: Array
    goal: Array
    on: Array
    speed: float


def read(file: Path) -> Log:
    """Read a recording."""
    given = json.loads(file.read_text(encoding="utf-8"))
    rows = given["entries"]
    time, position, goal, on = (
        np.array([float(row[key]) for row in rows])
        for key in ("timestamp", "position", "goal_position", "torque_enable")
    )
    time = time - time[0]
    steps = STEP * np.arange(int(np.ceil(time[-1] / STEP)) + 1)
    speed = float(np.polyfit(time[:4], position[:4], 1)[0])
    return Log(
        file.stem, DUTY * given["kp"], time, position, np.interp(steps, time, goal), np.interp(steps, time, on), speed
    )


class Rig:
    """Recordings side by side, as lanes of one simulation."""

    def __init__(self, logs: Sequence[Log]) -> None:
        """Pad the recordings to one length."""
        self.logs = tuple(logs)
        self.steps = max(len(log.goal) for log in logs)

        def padded(rows: Sequence[Array]) -> Array:
            return np.array([np.pad(row, (0, self.steps - len(row)), mode="edge") for row in rows])

        self.goal, self.on = padded([log.goal for log in logs]), padded([log.on for log in logs])
        self.gain = np.array([log.gain for log in logs])

    def simulate(self, law: str, p: Mapping[str, Array]) -> Array:
        """Positions, shape (steps, sets, logs); each parameter has shape (sets, 1)."""
        sets = len(p["Kc"])
        shape = (sets, len(self.logs))
        q = np.broadcast_to([log.position[0] for log in self.logs], shape).copy()
        v = np.broadcast_to([log.speed for log in self.logs], shape).copy()
        J = MASS * LENGTH**2 + p["armature"]
        drive, brake = p["torque_constant"] / p["resistance"], p["torque_constant"] ** 2 / p["resistance"]
        out = np.empty((self.steps, *shape))
        for k in range(self.steps):
            out[k] = q
            duty = np.clip(self.gain * (self.goal[:, k] - q), -1.0, 1.0)
            tm = self.on[:, k] * (drive * SUPPLY * duty - brake * v)
            te = -MASS * GRAVITY * LENGTH * np.sin(q + HORN)
            most = self.most(law, p, v, tm, te)
            push = J * v / STEP + tm + te
            v = (push - np.clip(push, -most, most)) * STEP / J
            q = q + STEP * v
        return out

    def most(self, law: str, p: Mapping[str, Array], v: Array, tm: Array, te: Array) -> Array:
        """The friction that there can be (N.m)."""
        return friction(law, p, v, tm, te)

    def errors(self, law: str, p: Mapping[str, Array]) -> list[Array]:
        """Measured less simulated positions at the samples of each recording, shape (sets, samples)."""
        made = self.simulate(law, p)
        found = []
        for j, log in enumerate(self.logs):
            place = np.minimum(log.time / STEP, self.steps - 1.000001)
            below = place.astype(int)
            share = (place - below)[:, None]
            there = made[below, :, j] * (1 - share) + made[below + 1, :, j] * share
            found.append(log.position - there.T)
        return found


def friction(law: str, p: Mapping[str, Array], v: Array, tm: Array, te: Array) -> Array:
    """The friction that there can be (N.m)."""
    most = p["Kc"] + p["Kv"] * np.abs(v)
    number = int(law[1])
    if number in (3, 4):
        load = np.abs(tm - te)
        most = most + p["Kl"] * load
    if number in (5, 6):
        most = most + np.abs(p["Km"] * tm - p["Ke"] * te)
    if number in (2, 4, 5, 6):
        slow = p["Kcs"]
        if number == 4:
            slow = slow + p["Kls"] * load
        if number in (5, 6):
            slow = slow + np.abs(p["Kms"] * tm - p["Kes"] * te)
        if number == 6:
            slow = slow + np.where(np.abs(tm) > np.abs(te), p["Keq"] * te**2, p["Kmq"] * tm**2)
        most = most + slow * np.exp(-np.minimum((np.abs(v) / p["vs"]) ** p["a"], 700.0))
    return np.asarray(most)


def fit(law: str, rig: Rig, starts: int, seed: int) -> tuple[dict[str, float], list[float]]:
    """Fit a law from several starts, all of them and their differences as lanes of one simulation.

    Returns:
        The best parameters, and the root mean square errors (rad) at which the starts ended, the lowest first.
    """
    names, centre = list(LAWS[law]), np.log(np.array(list(LAWS[law].values())))
    rng = np.random.default_rng(seed)
    width = np.log([NEAR if name in KNOWN else FAR for name in names])
    x = centre + width * np.vstack([np.zeros(len(names)), rng.uniform(-1, 1, (starts - 1, len(names)))])
    spacing, n = 1e-4, len(names)

    def errors(rows: Array) -> Array:
        p = {name: np.exp(np.clip(rows[:, [i]], -25, 8)) for i, name in enumerate(names)}
        return np.nan_to_num(np.concatenate(rig.errors(law, p), axis=1), nan=1e3, posinf=1e3, neginf=-1e3)

    r = errors(x)
    cost, damping = np.sum(r**2, axis=1), np.full(len(x), 1e-2)
    still = np.zeros(len(x), dtype=int)
    for _ in range(ITERATIONS):
        moved = (x[:, None, :] + spacing * np.eye(n)).reshape(-1, n)
        J = (errors(moved).reshape(len(x), n, -1) - r[:, None, :]) / spacing
        H, g = J @ J.transpose(0, 2, 1), (J @ r[:, :, None])[:, :, 0]
        scale = np.maximum(np.diagonal(H, axis1=1, axis2=2), 1e-8 * cost[:, None])
        tries = np.array([0.1, 1.0, 10.0, 100.0])
        steps = [
            -np.linalg.solve(H + np.eye(n) * (d * damping)[:, None, None] * scale[:, None, :], g[:, :, None])[:, :, 0]
            for d in tries
        ]
        there = np.concatenate([x + np.clip(step, -1.0, 1.0) for step in steps])
        tried = errors(there)
        costs = np.sum(tried**2, axis=1).reshape(len(tries), len(x))
        best = np.argmin(costs, axis=0)
        lane = best * len(x) + np.arange(len(x))
        better = costs.min(axis=0) < cost
        still = np.where(better & (costs.min(axis=0) < (1 - 1e-4) * cost), 0, still + 1)
        x = np.where(better[:, None], there[lane], x)
        r = np.where(better[:, None], tried[lane], r)
        cost = np.minimum(cost, costs.min(axis=0))
        damping = np.clip(np.where(better, damping * tries[best], damping * 1e3), 1e-9, 1e9)
        if (still > 2).all():
            break
    order = np.argsort(cost)
    p = {name: float(value) for name, value in zip(names, np.exp(x[order[0]]), strict=True)}
    return p, [float(np.sqrt(c / r.shape[1])) for c in cost[order]]


def judged(law: str, rig: Rig, p: Mapping[str, float]) -> float:
    """Mean absolute error (rad), each recording counting as much."""
    lanes = {name: np.array([[value]]) for name, value in p.items()}
    return float(np.mean([np.abs(error).mean() for error in rig.errors(law, lanes)]))


def main(arguments: list[str] | None = None) -> int:
    """Fit the laws, and print a table for docs/real-recordings.md."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.servo", description=__doc__.splitlines()[0])
    parser.add_argument("laws", nargs="*", help="M1 to M6; all if none is given")
    parser.add_argument("--starts", type=int, default=12, help="starts of each fit")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    folder = Path(os.environ.get("FLEXARM_RECORDINGS", "")) / "bam_xl330"
    if not folder.is_dir():
        print(f"there is no folder '{folder}': set FLEXARM_RECORDINGS, see docs/real-recordings.md", file=sys.stderr)
        return 1
    by_gain = {k: Rig([read(f) for f in sorted(folder.glob(f"kp{k}_*.json"))]) for k in (100, 200, 400)}
    training = Rig([*by_gain[100].logs, *by_gain[400].logs])
    print("| law | parameters | gain 100; 400, fitted | gain 200, held out | starts that end within 1 % of the best |")
    print("|---|---|---|---|---|")
    for law in given.laws or LAWS:
        p, ends = fit(law, training, given.starts, given.seed)
        fitted, other, held = (1e3 * judged(law, by_gain[k], p) for k in (100, 400, 200))
        alike = sum(end < 1.01 * ends[0] for end in ends)
        values = ", ".join(f"{name} {value:.3g}" for name, value in p.items())
        print(
            f"| {law} | {values} | {fitted:.1f}; {other:.1f} mrad | {held:.1f} mrad | {alike} of {len(ends)} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
