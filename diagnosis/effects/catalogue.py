"""What may be missing: every effect at every place of a scenario where it can act.

An effect is an ordinary block or block option. Its parameters start from sizes that matter in the recordings at hand: a
share of the driving signal's range, or of the torques that act at the place. Other packages may register further ones.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from diagnosis.effects.belt import at_belt
from diagnosis.effects.command import at_command
from diagnosis.effects.drive import at_driven_shaft, at_gear, at_loaded_shaft, at_motor_bridge, at_motor_input
from diagnosis.effects.effect import Candidate
from diagnosis.effects.end_stop import at_measured_shaft
from diagnosis.effects.friction_heat import at_bearing
from diagnosis.effects.joint import at_joint
from diagnosis.effects.link import at_link
from diagnosis.effects.parameter import wrong_parameters
from diagnosis.effects.places import BLOCK, INPUT, JOINT, SENSOR, SHAFT, Place
from diagnosis.effects.registered import RegisteredEffect, registered
from diagnosis.effects.scales import OperatingScales
from diagnosis.effects.shaft import at_shaft
from diagnosis.effects.signal import at_input, at_sensor
from diagnosis.effects.spring import at_mount, at_spring
from diagnosis.effects.supply import at_motor_supply
from diagnosis.effects.warm_up import at_motor_winding
from engine.errors import FlexarmError, nearest

EFFECTS = (
    "dead_zone",
    "saturation",
    "offset",
    "uneven_gain",
    "lag",
    "delay",
    "inductance",
    "coulomb_friction",
    "stribeck_friction",
    "direction_dependent_friction",
    "viscous_friction",
    "quadratic_drag",
    "stray_spring",
    "payload",
    "outside_vibration",
    "extra_mode",
    "gravity",
    "torque_ripple",
    "joint_flexibility",
    "backlash",
    "hardening_spring",
    "hysteresis",
    "one_sided_contact",
    "structural_damping",
    "centrifugal_stiffening",
    "wrong_parameter",
    "sensor_bias",
    "sensor_scale",
    "sensor_lag",
    "rectified_sensor",
    "load_dependent_friction",
    "current_limit",
    "cogging",
    "transmission_error",
    "rate_limit",
    "command_quantisation",
    "supply_sag",
    "belt_slack",
    "end_stop",
    "warm_up",
    "friction_warm_up",
    "quadratic_load_friction",
    "dead_time",
)
"""Machine names of the catalogue's own effects."""

Rule = Callable[[OperatingScales, Place], Iterator[Candidate]]

MECHANICAL: tuple[tuple[str, tuple[Rule, ...]], ...] = (
    (INPUT, (at_input, at_motor_input, at_command, at_motor_supply, at_motor_bridge)),
    (SHAFT, (at_shaft, at_loaded_shaft, at_driven_shaft, at_measured_shaft)),
    (JOINT, (at_joint,)),
    (BLOCK, (at_mount,)),
    (BLOCK, (at_link, at_spring, at_gear, at_belt, at_motor_winding, at_bearing)),
)
"""What lies in front of a sensor: kind of place, and the rules that say what may be missing there."""


def candidates(scales: OperatingScales, without: Collection[str] = ()) -> list[Candidate]:
    """Every effect of the catalogue, and every registered one, at every place of the scenario where it can act.

    Args:
        scales: how large things are in the recordings.
        without: effects that are left out; a registered one is then not even imported.

    Raises:
        FlexarmError: a registered effect cannot be used.
    """
    rows: list[Candidate] = []
    for kind, rules in MECHANICAL:
        for place in scales.places(kind):
            for rule in rules:
                rows += rule(scales, place)
    rows += wrong_parameters(scales)
    for place in scales.places(SENSOR):
        rows += at_sensor(scales, place)
    for effect in _registered().values():
        if effect.name not in without:
            rows += effect.candidates(scales)
    return [c for c in rows if c.effect not in scales.unseen and c.effect not in without]


def check_names(effects: Collection[str]) -> None:
    """Check names of effects that a user gave.

    Raises:
        FlexarmError: there is no such effect; the message names the nearest.
    """
    known = [*EFFECTS, *_registered()]
    for name in effects:
        if name not in known:
            raise FlexarmError(f"there is no effect '{name}'", remedy=nearest(name, known))


def _registered() -> dict[str, RegisteredEffect]:
    return registered(EFFECTS)
