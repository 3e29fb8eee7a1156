"""What may be missing at a shaft: friction, drag, springs, gravity, ripple, vibration and further bodies."""

from __future__ import annotations

import math
from collections.abc import Iterator

from diagnosis.effects.effect import Candidate, EffectParameter, Wave, combinations, shares
from diagnosis.effects.insertion import at_flange
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales

LEVELS = (1e-4, 1e-3, 5e-3, 0.03, 0.15, 0.5)
"""Starting sizes of torques, as shares of the torques that act."""

ORDERS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
"""Waves per revolution of a torque ripple."""

HARDLY = 2e-4
"""Size of a wave whose amplitude is solved for, as a share of the torques that act."""

PHASES = (0.0, 1.5708, 3.1416, -1.5708)

GRAVITY = 9.81
"""m/s2, as in `blocks.actuators.gravity_torque`."""


def at_shaft(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """What depends on the motion of a shaft or slide."""
    torque, speed, angle, inertia = place.torque, place.speed, place.angle, place.inertia
    yield from _friction(place)
    yield from at_flange(
        place,
        "quadratic_drag",
        "QuadraticDrag",
        combinations(drag=shares(torque / speed**2, *LEVELS)),
        EffectParameter("drag", torque / speed**2),
    )
    yield from at_flange(
        place,
        "stray_spring",
        "GroundSpring",
        # It may be tight when the part is where it began, which looks like an offset: so it rests to either side, too.
        combinations(stiffness=shares(torque / angle, *LEVELS), rest_angle=shares(angle, 0.01, 1.0, -1.0)),
        EffectParameter("stiffness", torque / angle),
        # One that is at rest farther away pulls evenly: an offset, which is another effect.
        EffectParameter("rest_angle", angle, signed=True, most=3.0),
    )
    yield from at_flange(
        place,
        "payload",
        "Inertia",
        combinations(inertia=shares(inertia, 0.003, 0.05, 0.3)),
        EffectParameter("inertia", inertia),
    )
    swing = math.sqrt(torque / (inertia * angle))
    tones = scales.tones or [3 * swing]
    yield from at_flange(
        place,
        "outside_vibration",
        "Vibration",
        combinations(amplitude=shares(torque, 1e-3, 0.02), frequency=tones, phase=PHASES),
        EffectParameter("amplitude", torque),
        # One that is off by a line of the recordings' spectrum loses a whole turn until their end.
        EffectParameter(
            "frequency", max([swing, *scales.tones]), signed=True, anywhere=True, step=2 * math.pi / scales.longest
        ),
        EffectParameter("phase", 1.0, signed=True),
        wave=Wave("amplitude", "phase", combinations(frequency=tones, amplitude=[HARDLY * torque], phase=[0.0])),
    )
    swings = [
        *scales.lines,
        *(w for w in (20.0, 50.0, 120.0, 300.0) if all(abs(w - a) > 0.2 * w for a in scales.lines)),
    ]
    yield from at_flange(
        place,
        "extra_mode",
        "Resonator",
        [
            *combinations(inertia=shares(inertia, 1e-3, 0.03), frequency=swings, damping_ratio=[0.02]),
            *combinations(inertia=[0.3 * inertia], frequency=swings[:2], damping_ratio=[0.02]),
        ],
        # A heavier body hardly moves: a spring and a damper to the ground, which are other effects.
        EffectParameter("inertia", inertia, most=2.0),
        EffectParameter("frequency", 100.0, usual=1.0),
        EffectParameter("damping_ratio", 0.02, usual=1.0),
    )
    averaged = scales.rotates_fully(place.target)
    for turning in scales.turns(place):
        yield from _angular(turning, averaged)


def _friction(place: Place) -> Iterator[Candidate]:
    """Laws of the friction of a bearing."""
    torque, speed = place.torque, place.speed
    levels = shares(torque, *LEVELS)
    dry, back = EffectParameter("coulomb_friction", torque), EffectParameter("coulomb_friction_backward", torque)
    yield from at_flange(place, "coulomb_friction", "BearingFriction", combinations(coulomb_friction=levels), dry)
    yield from at_flange(
        place,
        "stribeck_friction",
        "BearingFriction",
        [
            {"coulomb_friction": s, "static_friction": 1.5 * s, "stribeck_velocity": v * speed}
            for s in levels
            for v in (0.03, 0.2)
        ],
        dry,
        EffectParameter("static_friction", torque),
        EffectParameter("stribeck_velocity", speed),
        # A fit may take the static level below the sliding one, which the block does not.
        tidy=lambda v: v | {"static_friction": max(v["static_friction"], v["coulomb_friction"])},
    )
    yield from at_flange(
        place,
        "direction_dependent_friction",
        "BearingFriction",
        [{"coulomb_friction": s, "coulomb_friction_backward": s * r} for s in levels for r in (0.7, 1.4)],
        dry,
        back,
    )
    yield from at_flange(
        place,
        "viscous_friction",
        "BearingFriction",
        combinations(viscous_friction=shares(torque / speed, *LEVELS)),
        EffectParameter("viscous_friction", torque / speed),
    )


def _angular(place: Place, averaged: bool) -> Iterator[Candidate]:
    """What depends on the angle itself; gravity averages out where a shaft turns over by whole turns.

    One wave per revolution is gravity, and has that name alone.
    """
    torque, orders = place.torque, ORDERS if averaged else ORDERS[1:]
    if not averaged:
        yield from at_flange(
            place,
            "gravity",
            "GravityTorque",
            combinations(mass=shares(torque / GRAVITY, 1e-3, 0.02, 0.15), hanging_angle=PHASES),
            EffectParameter("mass", torque / GRAVITY),
            EffectParameter("hanging_angle", 1.0, signed=True),
            wave=Wave("mass", "hanging_angle", combinations(mass=[HARDLY * torque / GRAVITY], hanging_angle=[0.0])),
            radius="1 m",
        )
    yield from at_flange(
        place,
        "torque_ripple",
        "TorqueRipple",
        combinations(order=orders, amplitude=shares(torque, 2e-4, 2e-3, 0.05), phase=PHASES),
        EffectParameter("order", 1.0, fixed=True),
        EffectParameter("amplitude", torque),
        EffectParameter("phase", 1.0, signed=True),
        wave=Wave("amplitude", "phase", combinations(order=orders, amplitude=[HARDLY * torque], phase=[0.0])),
    )
