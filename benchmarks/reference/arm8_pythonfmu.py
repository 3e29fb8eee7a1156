"""The 8-state reference arm as pythonfmu has it: a Python class; equations as in arm8.c."""

from __future__ import annotations

import math
from typing import Any

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

N, R, KT, KE, ETA, J, GEAR, JG, B = 70, 2.6, 7.68e-3, 7.68e-3, 0.69, 4.606e-7, 0.9, 4.8754e-5, 0.004
L, M, EI, XI = 0.419, 0.065, 0.137422, 0.01
ROOTS = (1.8751040687119611, 4.694091132974175, 7.854757438237613)
COUPLING = [2 * M * L / b**2 for b in ROOTS]
STIFFNESS = [EI * b**4 / L**3 for b in ROOTS]
DAMPING = [2 * XI * math.sqrt(k * M) for k in STIFFNESS]
INERTIA = GEAR * N**2 * J + JG + M * L**2 / 3 - sum(c**2 / M for c in COUPLING)


def rates(x: Any, voltage: Any) -> list[Any]:
    """The derivative of the state."""
    w, a, v = x[4], x[1:4], x[5:]
    held = INERTIA + M * (a[0] ** 2 + a[1] ** 2 + a[2] ** 2)
    load = GEAR * N * ETA * KT * (voltage - KE * N * w) / R - B * w
    force = [(M * w * w - STIFFNESS[i]) * a[i] - DAMPING[i] * v[i] for i in range(3)]
    load -= sum(2 * M * w * a[i] * v[i] + COUPLING[i] / M * force[i] for i in range(3))
    acceleration = load / held
    return [w, *v, acceleration, *((force[i] - COUPLING[i] * acceleration) / M for i in range(3))]


class Arm8(Fmi2Slave):  # type: ignore[misc]
    """Voltage in; angle of the hub and deflection of the tip out."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.voltage = 0.0
        self.x = [0.0] * 8
        self.register_variable(Real("voltage", causality=Fmi2Causality.input, variability=Fmi2Variability.continuous))
        outputs = {"angle": lambda: self.x[0], "deflection": lambda: 2 * (self.x[1] - self.x[2] + self.x[3])}
        for name, getter in outputs.items():
            self.register_variable(Real(name, causality=Fmi2Causality.output, getter=getter))

    def do_step(self, current_time: Any, step_size: Any) -> bool:
        """One step of the classical Runge-Kutta method."""
        x, u, h = self.x, self.voltage, step_size
        k1 = rates(x, u)
        k2 = rates([a + h / 2 * b for a, b in zip(x, k1, strict=True)], u)
        k3 = rates([a + h / 2 * b for a, b in zip(x, k2, strict=True)], u)
        k4 = rates([a + h * b for a, b in zip(x, k3, strict=True)], u)
        self.x = [a + h / 6 * (p + 2 * (q + r) + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True)]
        return True
