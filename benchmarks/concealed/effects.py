"""The catalogue: what can be concealed, its one size, its random features, and its parameters.

Each effect has one ``size`` that makes it vanish at zero (save for the *natural* ones, which are there or not), and
features drawn once per case: an asymmetry, a frequency, a sign. `parameters` turns both into SI values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from numpy.random import Generator

Features = dict[str, float]

TURNED = {
    "stiffness": 2,
    "damping": 2,
    "cubic_stiffness": 4,
    "half_gap": -1,
    "yield_twist": -1,
    "coulomb_friction": 1,
    "coulomb_friction_backward": 1,
    "static_friction": 1,
    "forward": 1,
    "backward": 1,
    "amplitude": 1,
    "viscous_friction": 2,
    "stribeck_velocity": -1,
}
"""Where the same law sits on a shaft that turns less, a parameter of it is multiplied by the ratio to this power."""


@dataclass(frozen=True)
class Scales:
    """What is large and small at a place, from a run without anything concealed.

    Attributes:
        command: largest command (SI).
        torque, speed, angle: root mean square torque and speed, and range of the angle, at the place.
        largest: torque of a belt on a random rig; 0 elsewhere.
        inertia: felt at the place; of the lighter side for a joint.
        signal: root mean square of the sensor's signal.
        orders: waves per revolution to choose from.
        cogging: the same of a cogging whose waves the recordings resolve.
        meshing: the same of a transmission error, per revolution of the gear's input.
        current: the largest through a motor's winding.
        stiffness, damping: of a spring that is there already, else 0; at a shaft the damping of a bearing.
        resonance: band in which hidden resonances lie (Hz).
    """

    command: float = 1.0
    torque: float = 1.0
    speed: float = 1.0
    angle: float = 1.0
    inertia: float = 1.0
    largest: float = 0.0
    signal: float = 1.0
    orders: tuple[int, ...] = (1, 2, 3)
    cogging: tuple[int, ...] = ()
    meshing: tuple[int, ...] = ()
    current: float = 1.0
    stiffness: float = 0.0
    damping: float = 0.0
    resonance: tuple[float, float] = (5.0, 12.0)


Draw = Callable[[Generator, Scales], Features]
Make = Callable[[float, Features, Scales], dict[str, float]]


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    Attributes:
        name: machine name.
        kind: input, shaft, joint, link or sensor: the kind of place it lives at.
        size: what the size means, with its unit.
        first: size to start the search for the threshold from.
        make: parameters (SI) from size and features.
        draw: features.
        most: largest size that makes sense, in units of ``first``.
        natural: it has no size; then the excitation is scaled in its place, or nothing if ``loud`` is False.
        loud: see ``natural``.
        only: plants' drive units it applies to; empty for all.
    """

    name: str
    kind: str
    size: str
    first: Callable[[Scales], float]
    make: Make
    draw: Draw = field(default=lambda rng, s: {})
    most: float = 1e3
    natural: bool = False
    loud: bool = True
    only: tuple[str, ...] = ()


def _sign(rng: Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _skew(rng: Generator, s: Scales) -> Features:
    return {"skew": float(rng.uniform(0.6, 1.6))}


def _signed(rng: Generator, s: Scales) -> Features:
    return {"sign": _sign(rng)}


def _spring(size: float, s: Scales) -> dict[str, float]:
    """A joint spring that twists by ``size`` under the typical torque, lightly damped."""
    stiffness = s.torque / size
    return {"stiffness": stiffness, "damping": 2 * 0.06 * math.sqrt(stiffness * s.inertia)}


def _contact(size: float, f: Features, s: Scales) -> dict[str, float]:
    """Stops at +-size: the existing spring, or faces so stiff that the lighter side rings at 200 Hz on them."""
    stiffness = s.stiffness or s.inertia * (2 * math.pi * 200.0) ** 2
    damping = s.damping or 2 * 0.1 * math.sqrt(stiffness * s.inertia)
    return {"half_gap": size, "stiffness": stiffness, "damping": damping}


def _hardening(size: float, f: Features, s: Scales) -> dict[str, float]:
    if s.stiffness:
        return {"stiffness": s.stiffness, "damping": s.damping, "cubic_stiffness": size}
    linear = _spring(size, s)
    return {
        "stiffness": 0.4 * linear["stiffness"],
        "damping": linear["damping"],
        "cubic_stiffness": 0.6 * s.torque / size**3,
    }


def _bouc_wen(size: float, f: Features, s: Scales) -> dict[str, float]:
    """Stiffness beyond the yield twist falls to a share; an existing spring keeps its stiffness at small twist."""
    if s.stiffness:
        stiffness, damping, share, twist = s.stiffness, s.damping, 1 - size, f["yield"] * s.torque / s.stiffness
    else:
        linear = _spring(size, s)
        stiffness, damping, share, twist = 2.5 * linear["stiffness"], linear["damping"], 0.35, 0.4 * size
    return {
        "stiffness": stiffness,
        "damping": damping,
        "residual_share": share,
        "yield_twist": twist,
        "sharpness": 1.0,
        "unloading_share": 0.5,
    }


def _resonator(size: float, f: Features, s: Scales) -> dict[str, float]:
    inertia = size * s.inertia
    stiffness = inertia * f["frequency"] ** 2
    return {
        "inertia": inertia,
        "stiffness": stiffness,
        "damping": 2 * f["damping_ratio"] * math.sqrt(stiffness * inertia),
    }


COPPER = 0.0039
"""Rise of the resistance of copper (1/K)."""


def _winding_heat(size: float, f: Features, s: Scales) -> dict[str, float]:
    """A winding that the largest current warms by size / COPPER in a second; its housing has thirty times its heat."""
    capacity = COPPER * s.command * s.current / size
    thermal = f["time"] / capacity
    return {
        "coefficient": COPPER,
        "capacity": capacity,
        "insulation": thermal,
        "housing": 30 * capacity,
        "cooling": 2 * thermal,
    }


THINNING = 0.03
"""Share of its damping that an oil loses per kelvin: half of it in 23 K."""


def _oil_heat(size: float, f: Features, s: Scales) -> dict[str, float]:
    """An oil that a second at the typical speed warms by size / THINNING, as long as it keeps its heat."""
    capacity = THINNING * s.damping * s.speed**2 / size
    return {
        "viscous_friction": s.damping,
        "coefficient": THINNING,
        "capacity": capacity,
        "resistance": f["time"] / capacity,
    }


def _bumpers(size: float, f: Features, s: Scales) -> dict[str, float]:
    """Stops on both sides of the start, on which what moves rings well damped."""
    stiffness = s.inertia * f["frequency"] ** 2
    reach = s.angle / (1 + size)
    return {
        "stiffness": stiffness,
        "damping": 2 * 0.25 * math.sqrt(stiffness * s.inertia),
        "lower": -reach * f["skew"],
        "upper": reach / f["skew"],
    }


def _phase(rng: Generator) -> float:
    return float(rng.uniform(-math.pi, math.pi))


def _torque(s: Scales) -> float:
    return 0.05 * s.torque


CATALOGUE: dict[str, Effect] = {
    e.name: e
    for e in (
        Effect(
            "dead_zone",
            "input",
            "upper end, in the unit of the drive",
            lambda s: 0.03 * s.command,
            lambda z, f, s: {"lower": -z * f["skew"], "upper": z},
            _skew,
            most=20,
        ),
        Effect(
            "saturation",
            "input",
            "largest command / limit - 1",
            lambda s: 0.1,
            lambda z, f, s: {"lower": -s.command / (1 + f["skew"] * z), "upper": s.command / (1 + z)},
            _skew,
            most=60,
        ),
        Effect(
            "uneven_gain",
            "input",
            "gain backward differs from 1 by this",
            lambda s: 0.05,
            lambda z, f, s: {"forward": 1.0, "backward": 1 + f["sign"] * z},
            _signed,
            most=12,
        ),
        Effect(
            "offset",
            "input",
            "in the unit of the drive",
            lambda s: 0.03 * s.command,
            lambda z, f, s: {"offset": f["sign"] * z},
            _signed,
            most=20,
        ),
        Effect("delay", "input", "s", lambda s: 4e-3, lambda z, f, s: {"delay": z}, most=50),
        Effect(
            "lag", "input", "time constant, s", lambda s: 4e-3, lambda z, f, s: {"corner_frequency": 1 / z}, most=75
        ),
        Effect("inductance", "input", "H", lambda s: 1e-2, lambda z, f, s: {"inductance": z}, most=100, only=("V",)),
        Effect("coulomb_friction", "shaft", "N.m", _torque, lambda z, f, s: {"coulomb_friction": z}, most=40),
        Effect(
            "stribeck_friction",
            "shaft",
            "sliding friction, N.m",
            _torque,
            lambda z, f, s: {
                "coulomb_friction": z,
                "static_friction": f["ratio"] * z,
                "stribeck_velocity": f["velocity"],
            },
            lambda rng, s: {
                "ratio": float(rng.uniform(1.6, 2.4)),
                "velocity": s.speed * float(rng.uniform(0.1, 0.3)),
            },
            most=40,
        ),
        Effect(
            "direction_dependent_friction",
            "shaft",
            "mean of both directions, N.m",
            _torque,
            lambda z, f, s: {
                "coulomb_friction": z * (1 + f["skew"]),
                "coulomb_friction_backward": z * (1 - f["skew"]),
            },
            lambda rng, s: {"skew": _sign(rng) * float(rng.uniform(0.3, 0.6))},
            most=40,
        ),
        Effect(
            "viscous_friction",
            "shaft",
            "N.m.s/rad",
            lambda s: 0.05 * s.torque / s.speed,
            lambda z, f, s: {"viscous_friction": z},
            most=100,
        ),
        Effect(
            "quadratic_drag",
            "shaft",
            "N.m.s2/rad2",
            lambda s: 0.05 * s.torque / s.speed**2,
            lambda z, f, s: {"drag": z},
            most=200,
        ),
        Effect(
            "backlash",
            "joint",
            "half gap, rad",
            lambda s: 0.3 * s.torque / s.stiffness if s.stiffness else 2e-3 * s.angle,
            _contact,
            most=200,
        ),
        Effect(
            "joint_flexibility",
            "joint",
            "twist at the typical torque, rad",
            lambda s: s.torque / (s.inertia * (2 * math.pi * 15.0) ** 2),
            lambda z, f, s: _spring(z, s),
            most=300,
        ),
        Effect(
            "hardening_spring",
            "joint",
            "cubic stiffness, N.m/rad3; twist at the typical torque (rad) where the joint was rigid",
            lambda s: (
                0.1 * s.stiffness / (s.torque / s.stiffness) ** 2
                if s.stiffness
                else s.torque / (s.inertia * (2 * math.pi * 15.0) ** 2)
            ),
            _hardening,
            most=3000,
        ),
        Effect(
            "hysteresis",
            "joint",
            "share of the stiffness that yields; twist at the typical torque (rad) where the joint was rigid",
            lambda s: 0.05 if s.stiffness else s.torque / (s.inertia * (2 * math.pi * 15.0) ** 2),
            _bouc_wen,
            lambda rng, s: {"yield": float(rng.uniform(0.3, 0.8))},
            most=16,
        ),
        Effect(
            "extra_mode",
            "shaft",
            "inertia of a resonator / inertia of the shaft",
            lambda s: 0.02,
            _resonator,
            lambda rng, s: {
                "frequency": 2 * math.pi * float(rng.uniform(*s.resonance)),
                "damping_ratio": float(rng.uniform(0.01, 0.03)),
            },
            most=20,
        ),
        Effect(
            "centrifugal_stiffening",
            "link",
            "(that of a thin beam)",
            lambda s: 1.0,
            lambda z, f, s: {"share": 1.0},
            natural=True,
        ),
        Effect(
            "structural_damping",
            "joint",
            "(a loss factor of 0.04 to 0.12 in place of the viscous damper)",
            lambda s: 1.0,
            lambda z, f, s: {"stiffness": s.stiffness, "loss_factor": f["loss_factor"]},
            lambda rng, s: {"loss_factor": float(rng.uniform(0.04, 0.12))},
            natural=True,
        ),
        Effect(
            "gravity",
            "shaft",
            "weight times radius, N.m",
            _torque,
            lambda z, f, s: {"moment": z, "hanging_angle": f["phase"]},
            lambda rng, s: {"phase": _phase(rng)},
            most=100,
        ),
        Effect("payload", "link", "mass at the tip, kg", lambda s: 2e-3, lambda z, f, s: {"payload": z}, most=100),
        Effect(
            "stray_spring",
            "shaft",
            "N.m/rad",
            lambda s: 0.02 * s.torque / s.angle,
            lambda z, f, s: {"stiffness": z},
            most=300,
        ),
        Effect(
            "torque_ripple",
            "shaft",
            "N.m",
            _torque,
            lambda z, f, s: {"amplitude": z, "order": f["order"], "phase": f["phase"]},
            lambda rng, s: {"order": float(rng.choice(s.orders)), "phase": _phase(rng)},
            most=60,
        ),
        Effect(
            "outside_vibration",
            "shaft",
            "N.m",
            _torque,
            lambda z, f, s: {"amplitude": z, "frequency": f["frequency"], "phase": f["phase"]},
            lambda rng, s: {"frequency": float(rng.uniform(2.0, 9.0)), "phase": _phase(rng)},
            most=60,
        ),
        Effect(
            "sensor_bias",
            "sensor",
            "in the unit of the sensor (SI)",
            lambda s: 0.02 * s.signal,
            lambda z, f, s: {"bias": f["sign"] * z},
            _signed,
            most=50,
        ),
        Effect(
            "sensor_scale",
            "sensor",
            "differs from 1 by this",
            lambda s: 0.01,
            lambda z, f, s: {"scale": 1 + f["sign"] * z},
            _signed,
            most=40,
        ),
        Effect(
            "sensor_lag",
            "sensor",
            "time constant, s",
            lambda s: 3e-3,
            lambda z, f, s: {"corner_frequency": 1 / z},
            most=100,
        ),
        Effect(
            "rectified_sensor",
            "sensor",
            "(the magnitude is given)",
            lambda s: 1.0,
            lambda z, f, s: {"rectified": 1.0},
            natural=True,
            loud=False,
        ),
    )
}

COGGING = (18, 24, 30, 36, 42, 60, 72, 84, 90)
"""Waves per revolution of a motor's cogging: least common multiples of usual numbers of poles and slots, above those of
a torque ripple (2 and 9, 8 and 6, 10 and 6, 4 and 18, 14 and 6, 10 and 12, 8 and 18, 14 and 12, 10 and 9)."""

MESHING = (1, 2, 4)
"""Waves per revolution of a gear's input: an eccentric pinion, and both sides of a wave generator."""

DRIVES: dict[str, Effect] = {
    e.name: e
    for e in (
        Effect(
            "load_dependent_friction",
            "shaft",
            "share of the motor's torque that goes into friction; with it a level without load",
            lambda s: 0.03,
            lambda z, f, s: {"coefficient": z, "coulomb_friction": f["level"] * z * s.torque},
            lambda rng, s: {"level": float(rng.choice([0.0, rng.uniform(0.2, 1.0)]))},
            most=20,
        ),
        Effect(
            "current_limit",
            "input",
            "largest current / limit - 1",
            lambda s: 0.1,
            lambda z, f, s: {"current_limit": s.current / (1 + z)},
            most=60,
            only=("V",),
        ),
        Effect(
            "cogging",
            "shaft",
            "N.m",
            _torque,
            lambda z, f, s: {"amplitude": z, "order": f["order"], "phase": f["phase"]},
            lambda rng, s: {"order": float(rng.choice(s.cogging)), "phase": _phase(rng)},
            most=60,
        ),
        Effect(
            "rate_limit",
            "input",
            "time that the largest command takes, s",
            lambda s: 5e-3,
            lambda z, f, s: {"rate": s.command / z},
            most=200,
        ),
        Effect(
            "command_quantisation",
            "input",
            "step of the command, in the unit of the drive",
            lambda s: 0.03 * s.command,
            lambda z, f, s: {"step": z},
            most=20,
        ),
        Effect(
            "supply_sag",
            "input",
            "resistance of the supply / ohm, of a supply whose voltage is the largest command",
            lambda s: 0.02 * s.command / s.current,
            lambda z, f, s: {"resistance": z, "voltage": s.command},
            most=100,
            only=("V",),
        ),
        Effect(
            "warm_up",
            "input",
            "rise of the resistance by a second of the largest current, as a share",
            lambda s: 0.01,
            _winding_heat,
            lambda rng, s: {"time": float(rng.uniform(8.0, 40.0))},
            most=100,
            only=("V",),
        ),
        Effect(
            "quadratic_load_friction",
            "shaft",
            "share of the motor's torque that goes into friction; with it a share of its square",
            lambda s: 0.02,
            lambda z, f, s: {
                "coefficient": z,
                "coulomb_friction": 0.0,
                "quadratic_coefficient": f["square"] * z / s.torque,
            },
            lambda rng, s: {"square": float(rng.uniform(1.0, 3.0))},
            most=20,
        ),
        Effect(
            "friction_warm_up",
            "shaft",
            "fall of the viscous friction in a second at the typical speed, as a share",
            lambda s: 0.01,
            _oil_heat,
            lambda rng, s: {"time": float(rng.uniform(20.0, 200.0))},
            most=100,
        ),
        Effect(
            "belt_slack",
            "joint",
            "largest force, of the belt axis five times the typical one, / twice the pretension, less 1",
            lambda s: 0.5,
            lambda z, f, s: {"pretension": (s.largest / 2 or 2.5 * s.torque) / (1 + z)},
            most=200,
        ),
        Effect(
            "transmission_error",
            "joint",
            "amplitude at the output, rad",
            lambda s: 0.1 * s.torque / s.stiffness,
            lambda z, f, s: {"amplitude": z, "order": f["order"], "phase": f["phase"]},
            lambda rng, s: {"order": float(rng.choice(s.meshing)), "phase": _phase(rng)},
            most=100,
        ),
        Effect(
            "end_stop",
            "shaft",
            "range of the position / distance of the stops from the start, less 1",
            lambda s: 0.5,
            _bumpers,
            lambda rng, s: {
                "skew": float(rng.uniform(0.8, 1.25)),
                "frequency": 2 * math.pi * float(rng.uniform(12.0, 40.0)),
            },
            most=100,
        ),
        Effect(
            "dead_time",
            "input",
            "voltage that is lost against the current, V",
            lambda s: 0.01 * s.command,
            lambda z, f, s: {"lost_voltage": z, "ripple_current": f["ripple"]},
            lambda rng, s: {"ripple": s.current * float(rng.uniform(0.01, 0.1))},
            most=30,
            only=("V",),
        ),
    )
}
"""Effects of drives, kept apart: the catalogue above is drawn from, and the cases of a seed stay what they are."""

BEAM_MODE = Effect(
    "extra_mode", "link", "(the beam's second mode)", lambda s: 1.0, lambda z, f, s: {"modes": 2.0}, natural=True
)
"""The extra mode of a plant whose link is a beam."""

NAMES: tuple[str, ...] = ("none", *CATALOGUE)


@dataclass(frozen=True)
class Concealed:
    """An effect at a place, with its parameters (SI)."""

    effect: str
    place: str
    parameters: Mapping[str, float]
