"""Ready-made lists of cases: the core effects, pairs, and designed ties."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.concealed.drawing import Options

CORE = (
    "dead_zone",
    "saturation",
    "coulomb_friction",
    "stribeck_friction",
    "backlash",
    "joint_flexibility",
    "hardening_spring",
    "extra_mode",
    "gravity",
    "delay",
    "lag",
    "torque_ripple",
    "offset",
)
"""The effects that must be named first."""

PAIRS = {
    "srv02-flexible": (
        ("dead_zone", "coulomb_friction"),
        ("saturation", "joint_flexibility"),
        ("coulomb_friction", "delay"),
        ("extra_mode", "offset"),
        ("torque_ripple", "stray_spring"),
    ),
    "geared-two-mass": (
        ("backlash", "coulomb_friction@load.shaft"),
        ("dead_zone", "hardening_spring"),
        ("stribeck_friction", "lag"),
        ("torque_ripple", "offset"),
        ("gravity", "saturation"),
    ),
    "harmonic-arm": (
        ("joint_flexibility", "coulomb_friction"),
        ("backlash", "gravity"),
        ("hardening_spring", "stribeck_friction"),
        ("torque_ripple", "delay"),
        ("extra_mode", "dead_zone"),
    ),
    "pendulum": (
        ("coulomb_friction", "quadratic_drag"),
        ("stray_spring", "viscous_friction"),
        ("dead_zone", "joint_flexibility"),
        ("offset", "lag"),
        ("torque_ripple", "backlash"),
    ),
}
"""Twenty pairs of effects; each member at its own multiple of its own threshold."""

_ONE_WAY = ("steps_up", "chirp_up", "steps_up", "chirp_up", "steps_up", "chirp_up")


@dataclass(frozen=True)
class DesignedTie:
    """A truth, and another explanation that its recordings cannot exclude.

    Attributes:
        plant, effects, sizes, options: the case.
        rival: effects of the other explanation.
        because: why.
    """

    plant: str
    effects: tuple[str, ...]
    sizes: tuple[float, ...]
    options: Options
    rival: tuple[str, ...]
    because: str


TIES = (
    DesignedTie(
        "srv02-flexible",
        ("coulomb_friction",),
        (3.0,),
        Options(kinds=_ONE_WAY),
        ("offset",),
        "driven in one direction, friction is a constant torque",
    ),
    DesignedTie(
        "srv02-flexible",
        ("dead_zone",),
        (3.0,),
        Options(kinds=_ONE_WAY),
        ("coulomb_friction",),
        "driven in one direction, a dead zone takes a constant voltage off",
    ),
    DesignedTie(
        "geared-two-mass",
        ("dead_zone",),
        (3.0,),
        Options(kinds=_ONE_WAY),
        ("offset",),
        "driven in one direction, a dead zone is an offset",
    ),
    DesignedTie(
        "srv02-flexible",
        ("direction_dependent_friction",),
        (10.0,),
        Options(),
        ("coulomb_friction", "offset"),
        "an offset shifts the friction of both directions, moving or stuck",
    ),
    DesignedTie(
        "pendulum",
        ("direction_dependent_friction",),
        (10.0,),
        Options(),
        ("coulomb_friction", "offset"),
        "an offset shifts the friction of both directions, moving or stuck",
    ),
    DesignedTie(
        "srv02-flexible",
        ("lag",),
        (10.0,),
        Options(sensors=("enc",)),
        ("sensor_lag@link.hub.angle",),
        "with one sensor a lag before a linear plant is a lag behind it",
    ),
    DesignedTie(
        "harmonic-arm",
        ("lag",),
        (10.0,),
        Options(sensors=("enc",)),
        ("sensor_lag@rotor.shaft.angle",),
        "with one sensor a lag before a linear plant is a lag behind it",
    ),
    DesignedTie(
        "srv02-flexible",
        ("delay",),
        (2.0,),
        Options(),
        ("lag",),
        "below the bandwidth of the plant a short delay is a short lag",
    ),
    DesignedTie(
        "srv02-flexible",
        ("inductance",),
        (2.0,),
        Options(),
        ("lag",),
        "a small inductance is a short lag",
    ),
    DesignedTie(
        "srv02-flexible",
        ("joint_flexibility",),
        (3.0,),
        Options(),
        ("joint_flexibility@motor.shaft -> gear.input",),
        "a stiff joint before the gear looks like one behind it",
    ),
)
"""Ten ties; that they are ties is computed by `benchmarks.concealed.ties` and tested."""
