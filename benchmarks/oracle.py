"""Reference model B once more, by scipy's variable-step solvers with events, restarted at each sample.

An oracle for accuracy and a yardstick for speed. It shares no code with the engine: the equations are those in
`benchmarks/reference/model_b.c`, with the mass matrix assembled and solved numerically.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Vector = NDArray[np.float64]

RATIO, GEAR, RESISTANCE, TORQUE, MOTOR = 70.0, 0.9, 2.6, 7.68e-3, 0.69
BEARING, MASS, LENGTH, RIGIDITY, HUB, DAMPING = 0.004, 0.065, 0.419, 0.137422, 3e-4, 0.01
COULOMB, STATIC, STRIBECK, VISCOUS = 2.25e-4, 3.4e-4, 2.0, 1.26e-6
STIFFNESS, CONTACT, HALF_GAP = 20.0, 0.02, 2e-3
PROPORTIONAL, INTEGRAL, PERIOD, LOWER, UPPER = 3.0, 40.0, 1e-3, -0.09, 0.18
TACHOMETER, CORNER = 1.5e-3 * 30 / math.pi, 20 * math.pi

_ROOTS = np.array([1.8751040687119611, 4.694091132974174, 7.854757438237613, 10.995540734875467])
_FIRST = 2 * MASS * LENGTH / _ROOTS**2
_STIFF = RIGIDITY / LENGTH**3 * _ROOTS**4
_DAMPED = 2 * DAMPING * np.sqrt(_STIFF * MASS)
_BEFORE = GEAR * RATIO**2 * 4.606e-7 + 4.8754e-5
_HOLD = GEAR * RATIO * STATIC


def _velocity(t: float) -> float:
    """Velocity of the fourth-order motion there (from 0.5 s) and back (from 5 s)."""
    value = 0.0
    for start, sign in ((0.5, 1.0), (5.0, -1.0)):
        for k, change in enumerate((1, -2, 0, 2, -2, 2, 0, -2, 1)):
            value += sign * 76.8 * change * max(t - start - k / 4, 0.0) ** 3 / 6
    return value


class Arm:
    """Model B between two samples: modes that hold, and guards that end them.

    State: angle before the play, angle of the hub, four modes, their rates in the same order, filtered tachometer.
    """

    def __init__(self) -> None:
        self.voltage = 0.0
        self.slip = 0
        self.contact = 0
        self._matrix = np.zeros((5, 5))
        self._matrix[0, 1:] = self._matrix[1:, 0] = _FIRST
        self._matrix[range(1, 5), range(1, 5)] = MASS

    def force(self, x: Vector, contact: int) -> float:
        """Torque of a face on the hub."""
        return float(STIFFNESS * (x[0] - x[1] - contact * HALF_GAP) + CONTACT * (x[6] - x[7])) if contact else 0.0

    def push(self, x: Vector) -> float:
        """Torque on the rotor without its dry friction, at the gear's output."""
        current = (self.voltage - TORQUE * RATIO * x[6]) / RESISTANCE
        driving = GEAR * RATIO * (MOTOR * TORQUE * current - VISCOUS * RATIO * x[6])
        return float(driving - self.force(x, self.contact))

    def rates(self, _: float, x: Vector) -> Vector:
        """dx/dt."""
        a, w, b = x[2:6], x[7], x[8:12]
        turned = 0.0
        if self.slip:
            level = COULOMB + (STATIC - COULOMB) * math.exp(-((RATIO * x[6] / STRIBECK) ** 2))
            turned = (self.push(x) - self.slip * GEAR * RATIO * level) / _BEFORE
        self._matrix[0, 0] = HUB + MASS * LENGTH**2 / 3 + MASS * (a @ a)
        right = np.empty(5)
        right[0] = self.force(x, self.contact) - BEARING * w - 2 * MASS * w * (a @ b)
        right[1:] = MASS * a * w**2 - _STIFF * a - _DAMPED * b
        filtered = CORNER * (TACHOMETER * RATIO * x[6] - x[12])
        return np.concatenate([x[6:12], [turned], np.linalg.solve(self._matrix, right), [filtered]])

    def friction_guard(self, _: float, x: Vector) -> float:
        """Positive where sticking or sliding is over."""
        return float(-self.slip * x[6]) if self.slip else abs(self.push(x)) - _HOLD

    def contact_guard(self, _: float, x: Vector) -> float:
        """Positive where a contact or the gap is over."""
        if self.contact:
            return -self.contact * self.force(x, self.contact)
        play = x[0] - x[1]
        return float(max(min(s * play - HALF_GAP, s * self.force(x, s)) for s in (1, -1)))

    def switch(self, x: Vector, friction: bool, contact: bool) -> None:
        """Carry out what the guards ask for."""
        if contact:
            self.contact = 0 if self.contact else (1 if x[0] > x[1] else -1)
        if friction and self.slip:
            self.slip, x[6] = 0, 0.0
            friction = abs(self.push(x)) > _HOLD
        if friction:
            self.slip = 1 if self.push(x) > 0 else -1


def run(stop: float, method: str, rtol: float, begin: float = 0.0) -> tuple[Vector, float]:
    """Motor speed (rad/s) at each sample up to ``stop``, and the processor time (s) from ``begin`` on."""
    arm, x, integral = Arm(), np.zeros(13), 0.0
    guards: list[Callable[..., Any]] = []
    for name in ("friction_guard", "contact_guard"):

        def guard(t: float, x: Vector, name: str = name) -> float:
            return float(getattr(arm, name)(t, x))

        guard.terminal, guard.direction = True, 1  # type: ignore[attr-defined]
        guards.append(guard)
    samples = round(stop / PERIOD)
    speed, started = np.zeros(samples + 1), time.process_time()
    for k in range(samples + 1):
        now = k * PERIOD
        if k == round(begin / PERIOD):
            started = time.process_time()
        speed[k] = RATIO * x[6]
        error = TACHOMETER * RATIO * _velocity(now) - x[12]
        command = PROPORTIONAL * error + INTEGRAL * integral
        integral += PERIOD * error
        arm.voltage = command - min(max(command, LOWER), UPPER)
        if not arm.slip and abs(arm.push(x)) > _HOLD:
            arm.switch(x, True, False)
        end = (k + 1) * PERIOD
        while k < samples and now < end:
            found = solve_ivp(arm.rates, (now, end), x, method, events=guards, rtol=rtol, atol=rtol * 1e-3)
            now, x = float(found.t[-1]), found.y[:, -1].copy()
            if found.status == 1:
                arm.switch(x, *(len(times) > 0 for times in found.t_events))
    return speed, time.process_time() - started
