"""The two problems that every tool gets, and their solutions: one closed, one by a tight solver with events."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from engine.linearise import linearise
from engine.model import Model
from scenarios.load import load

Array = NDArray[np.float64]

STOP, STEP = 10.0, 1e-3
ROWS = round(STOP / STEP)
ON, OFF = 500, 5500
"""Rows at which the voltage comes and goes."""

LINEAR = """
schema: 1
name: linear
blocks:
  source: {type: Step, height: 1 V, start: 0.5 s, stop: 5.5 s}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.606e-7 kg.m2}
  gear: {type: Gear, ratio: 70, inertia: 4.8754e-5 kg.m2}
  bearing: {type: BearingFriction, viscous_friction: 0.004 N.m.s/rad}
  link: {type: AssumedModesLink, length: 0.419 m, mass: 65 g, flexural_rigidity: 0.137422 N.m2, hub_inertia: 3e-4 kg.m2,
         damping_ratio: 0.01, modes: 2}
connect:
  - [source.out, motor.voltage]
  - [motor.shaft, gear.input]
  - [gear.output, link.hub, bearing.shaft]
simulate: {stop: 10 s, step: 1 ms, record: [link.hub.speed]}
"""

INERTIA, SPRING, DAMPER, TORQUE, FREQUENCY, FRICTION = 1e-3, 0.5, 1e-3, 0.15, 0.5, 0.05
SLIDING = f"""
schema: 1
name: sliding
blocks:
  source: {{type: Sine, amplitude: {TORQUE} N.m, frequency: {FREQUENCY} Hz}}
  drive: {{type: Torque}}
  load: {{type: Inertia, inertia: {INERTIA} kg.m2}}
  spring: {{type: GroundSpring, stiffness: {SPRING} N.m/rad, damping: {DAMPER} N.m.s/rad}}
  bearing: {{type: BearingFriction, coulomb_friction: {FRICTION} N.m}}
connect:
  - [source.out, drive.torque]
  - [drive.shaft, load.shaft, spring.shaft, bearing.shaft]
simulate: {{stop: 10 s, step: 1 ms, record: [load.shaft.angle]}}
"""

LENGTHS, MASSES, GRAVITY = (0.4, 0.3), (1.2, 0.8), 9.81
JOINT_SPRING, JOINT_DAMPING, RAISED = 3.0, 0.02, (1.2, -0.6)
TWO_LINKS = f"""
schema: 1
name: two-links
blocks:
  arm: {{type: SerialArm, links: 2, modes: 0, length: [{LENGTHS[0]} m, {LENGTHS[1]} m],
         mass: [{MASSES[0]} kg, {MASSES[1]} kg], viscous_friction: {JOINT_DAMPING} N.m.s/rad, gravity: true}}
  spring: {{type: GroundSpring, stiffness: {JOINT_SPRING} N.m/rad}}
connect:
  - [spring.shaft, arm.joint2]
simulate: {{stop: 10 s, step: 1 ms, record: [arm.joint1.angle]}}
"""


@dataclass(frozen=True)
class StateSpace:
    """``x' = A x + b u, y = c x``; shapes (n, n), (n,), (n,). The voltage u is 1 V from row `ON` to row `OFF`."""

    A: Array
    b: Array
    c: Array


def model(text: str) -> Model:
    """flexarm's own model of a problem."""
    return load("reference-a", text=text).build()


def state_space() -> StateSpace:
    """The linear problem as matrices; states on which the output does not depend are left out."""
    m = linearise(load("reference-a", text=LINEAR).build(["motor.voltage"], ["link.hub.speed"]))
    seen = [i for i in range(len(m.A)) if np.any(m.A[:, i]) or np.any(m.C[:, i])]
    return StateSpace(m.A[np.ix_(seen, seen)].copy(), m.B[seen, 0].copy(), m.C[0, seen].copy())


def voltage(t: float) -> float:
    """Input of the linear problem."""
    return 1.0 if ON * STEP <= t < OFF * STEP else 0.0


def linear_solution(s: StateSpace) -> Array:
    """Outputs at all rows by the matrix exponential: exact but for rounding, the steps fall on rows."""
    n = len(s.A)
    held = np.zeros((n + 1, n + 1))
    held[:n, :n], held[:n, n] = s.A, s.b
    whole = scipy.linalg.expm(held * STEP)
    x, y = np.zeros(n), np.zeros(ROWS + 1)
    for k in range(ROWS + 1):
        y[k] = s.c @ x
        x = whole[:n, :n] @ x + whole[:n, n] * (ON <= k < OFF)
    return y


def force(t: float, q: float, v: float) -> float:
    """What moves the load of the sliding problem, without friction (N.m)."""
    return float(TORQUE * np.sin(2 * np.pi * FREQUENCY * t) - SPRING * q - DAMPER * v)


def by_events(method: str, rtol: float) -> Array:
    """The sliding problem by scipy, restarted at every switch; angles at all rows."""
    instants = STEP * np.arange(ROWS + 1)
    y, x, now, slip = np.zeros(ROWS + 1), np.zeros(2), 0.0, 0

    def rates(t: float, x: Array) -> list[float]:
        return [x[1], (force(t, x[0], x[1]) - slip * FRICTION) / INERTIA if slip else 0.0]

    def ends(t: float, x: Array) -> float:
        return float(-slip * x[1] if slip else abs(force(t, x[0], 0.0)) - FRICTION)

    ends.terminal, ends.direction = True, 1  # type: ignore[attr-defined]
    while now < STOP:
        wanted = instants[(instants >= now) & (instants <= STOP)]
        # A mode lasts at least this long; a variable step might leap over the next switch.
        part = solve_ivp(rates, (now, STOP), x, method, wanted, events=ends, rtol=rtol, atol=rtol * 1e-3, max_step=0.02)
        y[np.searchsorted(instants, part.t - 1e-9)] = part.y[0]
        if part.status != 1:
            break
        now, x = float(part.t_events[0][-1]), np.array(part.y_events[0][-1])
        x[1] = 0.0 if slip else x[1]
        pushed = force(now, x[0], 0.0)
        slip = int(np.sign(pushed)) if slip == 0 or abs(pushed) > FRICTION else 0
    return y


def sliding_solution() -> Array:
    """Angles at all rows by DOP853 at a relative tolerance of 1e-12."""
    return by_events("DOP853", 1e-12)


def links_rates(x: Any, sin: Callable[[Any], Any], cos: Callable[[Any], Any]) -> list[Any]:
    """Rates of the two links: x = angle of the first from the vertical, of the second against it, and their speeds.

    Lagrange's equations of two uniform rods; ``sin`` and ``cos`` are those of whatever computes.
    """
    q1, q2, v1, v2 = x[0], x[1], x[2], x[3]
    (l1, l2), (m1, m2) = LENGTHS, MASSES
    shared = m2 * l1 * l2 / 2
    m22 = m2 * l2**2 / 3
    m12 = m22 + shared * cos(q2)
    m11 = m1 * l1**2 / 3 + m2 * l1**2 + m22 + 2 * shared * cos(q2)
    pull = GRAVITY * m2 * l2 / 2 * sin(q1 + q2)
    f1 = shared * sin(q2) * (2 * v1 * v2 + v2 * v2) - GRAVITY * (m1 / 2 + m2) * l1 * sin(q1) - pull - JOINT_DAMPING * v1
    f2 = -shared * sin(q2) * v1 * v1 - pull - JOINT_DAMPING * v2 - JOINT_SPRING * q2
    size = m11 * m22 - m12 * m12
    return [v1, v2, (m22 * f1 - m12 * f2) / size, (m11 * f2 - m12 * f1) / size]


def links_by(method: str, rtol: float) -> Array:
    """The first angle at all rows by scipy."""
    instants = STEP * np.arange(ROWS + 1)
    made = solve_ivp(
        lambda t, x: links_rates(x, math.sin, math.cos),
        (0, STOP),
        [*RAISED, 0, 0],
        method,
        instants,
        rtol=rtol,
        atol=rtol * 1e-3,
    )
    return np.asarray(made.y[0])


def links_solution() -> Array:
    """The first angle at all rows by DOP853 at a relative tolerance of 1e-12."""
    return links_by("DOP853", 1e-12)
