"""How FMUs that were cut from one another are coupled, so that a master that only passes values stays right and stable.

At a cut one side, the owner, keeps the motion and the other follows it. Between two communication points

* the follower moves its flange on: angle + speed s + acceleration s^2 / 2 + jerk s^3 / 6, with s = time - the instant
  at which the values it was given held, which is sent along; a master that steps one FMU before the other gives values
  of the end of the step, and then s is negative;
* the owner does not hold the torque either, but lets it answer its own motion: torque + rate s + offset
  - stiffness angle - damping speed - inertia acceleration.

Stiffness, damping and inertia are the exact derivatives of the follower's torque by its flange's motion in the present
modes, offset = stiffness angle + damping speed at the motion for which the torque was worked out, and rate is the
torque's rate of change by the follower's own states. So the owner feels the spring and the inertia behind the cut
inside the step, and only the motion of what lies beyond them is a step late. Rigid cuts, with inertia on both sides,
work alike.

After [Sicklinger 2014], with the Jacobian sent along as signals, since masters do not ask for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from engine.model import FRICTION, SWITCH, Model, Variable

NEVER = -1e9
"""Instant (s) of values that nobody sent: then they are held."""


def elapsed(time: ca.SX, sent: ca.SX) -> ca.SX:
    """Time since values were sent; 0 if they never were."""
    return ca.if_else(sent > NEVER / 2, time - sent, 0)


def motion(angle: ca.SX, speed: ca.SX, acceleration: ca.SX, jerk: ca.SX, s: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Angle, speed and acceleration after a time s."""
    return (
        angle + speed * s + acceleration * s**2 / 2 + jerk * s**3 / 6,
        speed + acceleration * s + jerk * s**2 / 2,
        acceleration + jerk * s,
    )


@dataclass(frozen=True)
class Coupling:
    """What an export must know of the inputs at its cuts.

    Attributes:
        inputs: inputs that come from the other side of a cut; derivatives that a master gives of them are not used.
        typical: input name -> value for which the internal step is chosen; 0 for the others.
    """

    inputs: tuple[str, ...] = ()
    typical: Mapping[str, float] = field(default_factory=dict)

    def starts(self) -> dict[str, float]:
        """Start values of the inputs that do not start at zero."""
        return {name: NEVER for name in self.inputs if name.endswith(".sent")}


@dataclass(frozen=True)
class Answers:
    """What a follower sends of its torque, by the suffix of the signal.

    Attributes:
        model: the follower's model with the further outputs.
        typical: of those that are not zero for every motion, the largest magnitude over the modes at the start.
    """

    model: Model
    typical: dict[str, float]


UNITS = {
    "torque": {"rate": "N.m/s", "offset": "N.m", "stiffness": "N.m/rad", "damping": "N.m.s/rad", "inertia": "kg.m2"},
    "force": {"rate": "N/s", "offset": "N", "stiffness": "N/m", "damping": "N.s/m", "inertia": "kg"},
}
"""Units of what is sent along with a torque or force."""


def answers(model: Model, torque: str, inputs: Sequence[str]) -> Answers:
    """Add to a follower's outputs how its torque answers the motion of its flange.

    Args:
        model: the follower's.
        torque: the output with the torque on the owner. What the acceleration adds to it moves to the inertia.
        inputs: its angle, speed, acceleration and jerk.
    """
    e = model.equations
    names = [variable.name for variable in model.inputs]
    head, _, kind = torque.rpartition(".")
    row = [variable.name for variable in model.outputs].index(torque)
    angle, speed, acceleration, jerk = (e.u[names.index(name)] for name in inputs)
    s, effort = elapsed(e.t, e.u[names.index(f"{head}.sent")]), e.outputs[row]
    stiffness = -ca.jacobian(effort, angle)
    damping = -ca.jacobian(effort, speed) - s * stiffness
    inertia = -ca.jacobian(effort, acceleration) - s * damping - s**2 / 2 * stiffness
    inertia, damping, stiffness = (ca.densify(ca.simplify(part)) for part in (inertia, damping, stiffness))
    position, velocity, moved = motion(angle, speed, acceleration, jerk, s)
    held = effort + inertia * moved
    passing = ca.jacobian(s, e.t)  # 0 where values are held
    moving = ca.jtimes(held, ca.vertcat(e.t, e.x), ca.vertcat(1, e.derivative))
    moving += passing * (stiffness * velocity + damping * moved)
    found = {
        "rate": ca.substitute(moving, ca.vertcat(acceleration, jerk), ca.DM([0, 0])),
        "offset": stiffness * position + damping * velocity,
        "stiffness": stiffness,
        "damping": damping,
        "inertia": inertia,
    }
    typical = {}
    for key in ("stiffness", "damping", "inertia"):
        size = _largest(model, found[key])
        if size:
            typical[key] = size
        else:
            del found[key]
    if not {"stiffness", "damping"} & found.keys():
        del found["offset"]
    others = ca.vertsplit(e.outputs)
    outputs = ca.vertcat(*others[:row], held, *others[row + 1 :])
    added = [Variable(f"{head}.{key}", UNITS[kind][key], f"{key} of the {kind} at the cut") for key in found]
    equations = replace(e, outputs=ca.densify(ca.vertcat(outputs, *found.values())))
    return Answers(replace(model, equations=equations, outputs=(*model.outputs, *added)), typical)


def with_jerk(model: Model, acceleration: str) -> Model:
    """Add to an owner's outputs the rate of change of the acceleration of a flange."""
    e = model.equations
    row = [variable.name for variable in model.outputs].index(acceleration)
    rate = ca.jtimes(e.outputs[row], ca.vertcat(e.t, e.x), ca.vertcat(1, e.derivative))
    unit = model.outputs[row].unit.replace("s2", "s3")
    added = Variable(f"{acceleration.rpartition('.')[0]}.jerk", unit, "rate of change of the acceleration")
    equations = replace(e, outputs=ca.densify(ca.vertcat(e.outputs, rate)))
    return replace(model, equations=equations, outputs=(*model.outputs, added))


SLOW = 1.0
"""Frequency (rad/s) at which an inertia is felt: below the vibrations of any arm."""


def felt_inertia(model: Model) -> float:
    """|torque / acceleration| of a follower at a low frequency, joints sliding: its rigid inertia.

    Args:
        model: with angle, speed and acceleration of the flange as its first inputs, and the torque as its only output.
    """
    e, p = model.equations, model.parameter_values
    blocks = [ca.jacobian(f, s) for f in (e.derivative, e.outputs) for s in (e.x, e.u[:3])]
    function = ca.Function("felt", e.arguments, [ca.densify(block) for block in blocks])
    x = np.array(model.functions["start"](p).full()).ravel()
    d = np.array(model.functions["memory_start"](p).full()).ravel()
    m = [1.0 if mode.kind == FRICTION else 0.0 for mode in model.modes]
    a, b, c, direct = (np.array(block.full()) for block in function(0, x, np.zeros(e.u.numel()), d, m, p))
    motion_of = np.array([1 / (1j * SLOW) ** 2, 1 / (1j * SLOW), 1.0])
    states = np.linalg.lstsq(1j * SLOW * np.eye(len(a)) - a, b @ motion_of, rcond=None)[0] if len(a) else np.zeros(0)
    value = abs(complex((c @ states + direct @ motion_of).item()))
    return value if np.isfinite(value) else 0.0


def _largest(model: Model, expression: ca.SX) -> float:
    """The largest magnitude over switches open and closed, joints sliding, at the start."""
    e, p = model.equations, model.parameter_values
    function = ca.Function("size", e.arguments, [expression])
    x = np.array(model.functions["start"](p).full()).ravel()
    d = np.array(model.functions["memory_start"](p).full()).ravel()
    found = 0.0
    for level in (0.0, 1.0, -1.0):
        m = [{FRICTION: 1.0, SWITCH: level}.get(mode.kind, 0.0) for mode in model.modes]
        value = abs(float(function(0, x, np.zeros(e.u.numel()), d, m, p)))
        found = max(found, value if np.isfinite(value) else 0.0)
    return found
