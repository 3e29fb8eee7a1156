"""Other tools on the recordings of the XL330 servo: ``python -m benchmarks.peers.servo_tools``.

Beside the published laws of `benchmarks.peers.servo`, on the same recordings and judged alike.

*mujoco*: a hinge with a point mass, ``armature``, ``damping`` and ``frictionloss``; the duty law sets the motor's
torque at every step. Fitted by MuJoCo's own least squares (`mujoco.minimize`), the tool of its tutorial on system
identification, with torque constant and resistance free as for the laws.

*pysindy*, *gplearn*: M1 is fitted first. While the joint slides, position tells the friction: tm + te - J q''. What M1
leaves of it is regressed on speed and torques, sparsely [Kaheman 2019] or symbolically, and put back into the simulated
law, which is judged. PySR is not among them: it needs Julia. gplearn stands for it: genetic programming too, in Python.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import UnivariateSpline

from benchmarks.peers import servo
from benchmarks.peers.servo import GRAVITY, HORN, LENGTH, MASS, STEP, SUPPLY, Log, Rig

Array = NDArray[np.float64]
Friction = Callable[[Array, Array, Array], Array]

MUJOCO = ("torque_constant", "resistance", "armature", "frictionloss", "damping")
START = (0.38, 3.4, 1.9e-3, 9e-3, 4.4e-3)

SPACING, ITERATIONS = 1e-4, 40
"""Of MuJoCo's least squares: a friction that sticks and slips is no smooth function of its parameters."""

SLIDING = 0.3
"""Speed (rad/s) from which on the joint slides."""

SMOOTH = 1.5e-3
"""Error (rad) with which positions are smoothed: of the encoder, whose step is 1.5 mrad."""

THRESHOLDS = (0.002, 0.005, 0.01, 0.02, 0.05)
"""Of the sparse regression (N.m): the best on the fitted recordings counts."""


class Hinge:
    """The servo as MuJoCo has it."""

    def __init__(self, logs: Sequence[Log]) -> None:
        import mujoco

        self.mujoco, self.logs = mujoco, tuple(logs)
        self.model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{STEP}" gravity="0 0 -{GRAVITY}" integrator="implicitfast"/><worldbody>
            <body><joint name="j" type="hinge" axis="0 -1 0" armature="2e-3" damping="4e-3" frictionloss="9e-3"/>
            <inertial pos="0 0 -{LENGTH}" mass="{MASS}" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
            <actuator><motor joint="j"/></actuator></mujoco>"""
        )

    def errors(self, values: Sequence[float]) -> list[Array]:
        """Measured less simulated positions of each recording (rad)."""
        torque, resistance, armature, loss, damping = values
        model, mujoco = self.model, self.mujoco
        model.dof_armature[0], model.dof_frictionloss[0] = armature, loss
        drive, brake = torque / resistance, torque**2 / resistance
        found = []
        for log in self.logs:
            data = mujoco.MjData(model)
            # The horn is turned: MuJoCo's angle counts from where the mass hangs.
            data.qpos[0], data.qvel[0] = log.position[0] + HORN, log.speed
            made = np.empty(len(log.goal))
            for k in range(len(made)):
                made[k] = data.qpos[0] - HORN
                duty = min(max(log.gain * (log.goal[k] - made[k]), -1.0), 1.0)
                model.dof_damping[0] = damping + brake * log.on[k]
                data.ctrl[0] = log.on[k] * drive * SUPPLY * duty
                mujoco.mj_step(model, data)
            found.append(log.position - np.interp(log.time, STEP * np.arange(len(made)), made))
        return found


def with_mujoco(training: Rig, judged: Sequence[Rig]) -> tuple[str, list[float]]:
    """Fit MuJoCo's parameters; what they are, and the mean absolute errors (rad)."""
    from mujoco import minimize

    hinge = Hinge(training.logs)
    start = np.log(START)

    def residual(x: Array) -> Array:
        columns = [np.concatenate(hinge.errors(np.exp(start + column))) for column in np.atleast_2d(x.T)]
        return np.column_stack(columns)

    x, _ = minimize.least_squares(np.zeros(len(start)), residual, eps=SPACING, max_iter=ITERATIONS, verbose=0)
    values = np.exp(start + x.ravel())
    told = ", ".join(f"{name} {value:.3g}" for name, value in zip(MUJOCO, values, strict=True))
    errors = [float(np.mean([np.abs(e).mean() for e in Hinge(rig.logs).errors(values)])) for rig in judged]
    return told, errors


def sliding(logs: Sequence[Log], p: dict[str, float]) -> tuple[Array, Array]:
    """Speed, torques of motor and weight, shape (samples, 3), and the friction against the motion (N.m)."""
    rows, friction = [], []
    inertia = MASS * LENGTH**2 + p["armature"]
    for log in logs:
        course = UnivariateSpline(log.time, log.position, k=5, s=len(log.time) * SMOOTH**2)
        v, a, q = course.derivative(1)(log.time), course.derivative(2)(log.time), course(log.time)
        instants = STEP * np.arange(len(log.goal))
        goal, on = np.interp(log.time, instants, log.goal), np.interp(log.time, instants, log.on)
        duty = np.clip(log.gain * (goal - log.position), -1.0, 1.0)
        tm = on * (p["torque_constant"] * SUPPLY * duty - p["torque_constant"] ** 2 * v) / p["resistance"]
        te = -MASS * GRAVITY * LENGTH * np.sin(q + HORN)
        slides = np.abs(v) > SLIDING
        rows.append(np.column_stack([v, tm, te])[slides])
        friction.append(((tm + te - inertia * a) * np.sign(v))[slides])
    return np.concatenate(rows), np.concatenate(friction)


class Corrected(Rig):
    """A rig whose friction has a further part."""

    def __init__(self, logs: Sequence[Log], further: Friction) -> None:
        super().__init__(logs)
        self.further = further

    def most(self, law: str, p: Mapping[str, Array], v: Array, tm: Array, te: Array) -> Array:
        """The friction that there can be (N.m), at least none."""
        there = super().most(law, p, v, tm, te) + self.further(v, tm, te)
        return np.asarray(np.maximum(there, 0.0))


TERMS: dict[str, Friction] = {
    "1": lambda v, tm, te: np.ones_like(v),
    "|v|": lambda v, tm, te: np.abs(v),
    "v^2": lambda v, tm, te: v**2,
    "exp(-|v|/0.3)": lambda v, tm, te: np.exp(-np.abs(v) / 0.3),
    "|tm|": lambda v, tm, te: np.abs(tm),
    "|te|": lambda v, tm, te: np.abs(te),
    "|tm - te|": lambda v, tm, te: np.abs(tm - te),
    "tm^2": lambda v, tm, te: tm**2,
    "te^2": lambda v, tm, te: te**2,
    "sign(v) tm": lambda v, tm, te: np.sign(v) * tm,
    "sign(v) te": lambda v, tm, te: np.sign(v) * te,
}


def with_pysindy(x: Array, y: Array, cost: Callable[[Friction], float]) -> tuple[str, Friction]:
    """Sparse regression of what is left of the friction on `TERMS`."""
    from pysindy import STLSQ

    table = np.column_stack([term(*x.T) for term in TERMS.values()])
    scale = np.sqrt(np.mean(table**2, axis=0))
    best: tuple[float, str, Friction] | None = None
    for threshold in THRESHOLDS:
        found = STLSQ(threshold=threshold, alpha=1e-6, max_iter=50).fit(table / scale, y[:, None]).coef_.ravel() / scale

        def further(v: Array, tm: Array, te: Array, found: Array = found) -> Array:
            parts = [c * term(v, tm, te) for c, term in zip(found, TERMS.values(), strict=True) if c]
            return np.asarray(sum(parts, np.zeros_like(v)))

        told = " ".join(f"{c:+.3g} {name}" for c, name in zip(found, TERMS, strict=True) if c) or "nothing"
        there = cost(further)
        if best is None or there < best[0]:
            best = (there, told, further)
    assert best is not None
    return best[1], best[2]


def with_gplearn(x: Array, y: Array, seed: int) -> tuple[str, Friction]:
    """Symbolic regression of what is left of the friction on |v|, |tm|, |te|, and both torques along the motion."""
    from gplearn.genetic import SymbolicRegressor

    def features(v: Array, tm: Array, te: Array) -> Array:
        return np.column_stack([np.abs(v), np.abs(tm), np.abs(te), np.sign(v) * tm, np.sign(v) * te])

    made = SymbolicRegressor(
        population_size=2000,
        generations=25,
        function_set=("add", "sub", "mul", "div", "sqrt", "abs", "max", "min"),
        parsimony_coefficient=1e-3,
        metric="mse",
        feature_names=["|v|", "|tm|", "|te|", "tm.v", "te.v"],
        random_state=seed,
    )
    scale = float(np.std(y))
    made.fit(features(*x.T), y / scale)

    def further(v: Array, tm: Array, te: Array) -> Array:
        flat = made.predict(features(v.ravel(), tm.ravel(), te.ravel()))
        return np.asarray(scale * flat).reshape(v.shape)

    return f"{scale:.3g} N.m * {made._program}", further


def main(arguments: list[str] | None = None) -> int:
    """Fit with the tools, and print rows for docs/real-recordings.md."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.servo_tools", description=__doc__.splitlines()[0])
    parser.add_argument("tools", nargs="*", help="mujoco, pysindy, gplearn; all if none is given")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    folder = Path(os.environ.get("FLEXARM_RECORDINGS", "")) / "bam_xl330"
    if not folder.is_dir():
        print(f"there is no folder '{folder}': set FLEXARM_RECORDINGS, see docs/real-recordings.md", file=sys.stderr)
        return 1
    by_gain = {k: Rig([servo.read(f) for f in sorted(folder.glob(f"kp{k}_*.json"))]) for k in (100, 400, 200)}
    training = Rig([*by_gain[100].logs, *by_gain[400].logs])
    for tool in given.tools or ("mujoco", "pysindy", "gplearn"):
        begin = time.process_time()
        try:
            told, errors = _run(tool, training, list(by_gain.values()), given.seed)
        except ImportError as error:
            print(f"{tool}: {error.name} is not installed; remedy: pip install {error.name}", file=sys.stderr)
            continue
        fitted, other, held = (1e3 * e for e in errors)
        seconds = time.process_time() - begin
        print(f"| {tool} | {told} | {fitted:.1f}; {other:.1f} mrad | {held:.1f} mrad | {seconds:.0f} s |", flush=True)
    return 0


def _run(tool: str, training: Rig, judged: Sequence[Rig], seed: int) -> tuple[str, list[float]]:
    if tool == "mujoco":
        return with_mujoco(training, judged)
    p, _ = servo.fit("M1", training, 1, seed)
    x, friction = sliding(training.logs, p)
    left = friction - p["Kc"] - p["Kv"] * np.abs(x[:, 0])

    def cost(further: Friction, rig: Rig = training) -> float:
        return servo.judged("M1", Corrected(rig.logs, further), p)

    told, further = with_pysindy(x, left, cost) if tool == "pysindy" else with_gplearn(x, left, seed)
    return told, [cost(further, rig) for rig in judged]


if __name__ == "__main__":
    sys.exit(main())
