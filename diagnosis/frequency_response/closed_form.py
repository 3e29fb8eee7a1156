"""The response of a linear model to a sine, C (iw - A)^-1 B + D, where it meets no switch."""

from __future__ import annotations

import functools
import math
from typing import Any

import casadi as ca
import numpy as np

from diagnosis.frequency_response.period import PeriodicSolution
from engine.casadi_lock import symbolic_property
from engine.errors import SimulationError
from engine.model import FRICTION, SWITCH, TIME, Model, Vector
from engine.roundings import has_rounding
from engine.simulate import simulate

Array = Any

PHASES = 96
"""Number of instants per period at which the response is checked for switches."""

UNSTABLE = 1e-7
"""Real part of a pole, relative to the fastest pole, above which the model is unstable and not at a rounding error."""


class ClosedForm:
    """Responses of a model with one open input, where it is linear.

    Args:
        model: its input is what the sine drives.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self._sharp = model.count(SWITCH) > 0

    @symbolic_property
    def _state_space(self) -> Any:
        """State space, and derivatives at x = u = 0, as functions of (modes, parameters); None if it is not linear."""
        model, e = self.model, self.model.equations
        if model.count(FRICTION) or model.clocks or model.tables or len(model.inputs) != 1:
            return None
        both = ca.vertcat(e.x, e.u)
        if has_rounding(ca.vertcat(e.derivative, e.outputs)):
            return None
        slopes = ca.jacobian(ca.vertcat(e.derivative, e.outputs), both)
        timed = [e.m[k] for k, mode in enumerate(model.modes) if mode.kind == TIME]
        if ca.depends_on(slopes, ca.vertcat(e.t, both, *timed)):
            return None
        at_rest = ca.substitute(ca.vertcat(e.derivative, e.guards, e.outputs), both, ca.SX.zeros(both.numel()))
        if ca.depends_on(at_rest, e.t):
            return None
        rest = ca.Function("rest", [e.m, e.p], [at_rest[: e.x.numel()]])
        return ca.Function("slopes", [e.m, e.p], [slopes]), rest

    @functools.cached_property
    def _modes(self) -> Vector:
        """Modes at rest."""
        if not self.model.modes:
            return np.zeros(0)
        run = simulate(self.model, 1e-6, 1e-6, log_capacity=0)
        return np.asarray(run.final_modes)

    def solve(
        self, parameters: dict[str, float], frequency: Vector, amplitude: Vector
    ) -> list[PeriodicSolution | None]:
        """The responses to sines; None for each row that meets a switch, and for all if the model is not linear.

        Args:
            parameters: values that replace the model's (SI).
            frequency: rad/s, shape (rows,).
            amplitude: of the sines (SI), shape (rows,).

        Raises:
            SimulationError: the model is unstable, or resonates without damping at one of the frequencies.
        """
        nothing: list[PeriodicSolution | None] = [None] * len(frequency)
        if self._state_space is None:
            return nothing
        slopes, rest = self._state_space
        p, m, n = self.model.parameter_vector(parameters), self._modes, len(self.model.states)
        matrix = np.array(slopes(m, p).full())
        constant = np.array(rest(m, p).full()).ravel()
        if not np.isfinite(matrix).all():
            return nothing
        A, B, C, D = matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]
        rest_at = np.linalg.lstsq(A, -constant, rcond=1e-12)[0] if n else np.zeros(0)
        if self._sharp and np.abs(A @ rest_at + constant).max(initial=0.0) > 1e-9 * np.abs(constant).max(initial=0.0):
            return nothing
        poles = np.linalg.eigvals(A) if n else np.zeros(1)
        if poles.real.max() > UNSTABLE * max(np.abs(poles).max(), 1.0):
            raise SimulationError("the model is unstable, so its response to a sine is never periodic")
        resolvent = 1j * frequency[:, None, None] * np.eye(n) - A
        try:
            x = np.linalg.solve(resolvent, B[None].astype(complex))[:, :, 0] * amplitude[:, None]
        except np.linalg.LinAlgError:
            undamped = poles[np.argmin(np.abs(poles[:, None] - 1j * frequency).min(axis=1))].imag
            raise SimulationError(
                f"the model resonates without damping at {abs(undamped):g} rad/s, and its response grows for ever",
                remedy="give it damping, or leave the row out",
            ) from None
        y = np.abs(x @ C.T + amplitude[:, None] * D[:, 0])
        meets = self._switches(p, m, x, rest_at, amplitude) if self._sharp else np.zeros(len(y), dtype=bool)
        return [None if bad else PeriodicSolution(row, row / math.sqrt(2)) for row, bad in zip(y, meets, strict=True)]

    def _switches(self, p: Vector, m: Vector, x: Array, rest: Vector, amplitude: Vector) -> Array:
        """For each row, whether the closed form about ``rest`` meets a switch, shape (rows,)."""
        guards, memory = self.model.functions["guards"], np.zeros(self.model.equations.d.numel())
        phases = np.exp(2j * np.pi * np.arange(PHASES) / PHASES)
        states = (x.T[:, :, None] * phases).real.reshape(len(x.T), -1) + rest[:, None]
        inputs = (amplitude[:, None] * phases.real).reshape(1, -1)
        found = np.array(guards(0, states, inputs, memory, m, p).full())
        return np.asarray(found.reshape(len(found), len(x), PHASES).max(axis=(0, 2)) > 0)
