"""Eddy-current drag: what a conducting part that turns beside a magnet adds to a model that leaves it out."""

from __future__ import annotations

from collections.abc import Iterator

from flexarm.effects import SHAFT, Candidate, EffectParameter, OperatingScales, Place, at_flange, combinations, shares


def eddy_current_drag(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """An `EddyBrake` at a shaft, starting from torques and speeds that matter there."""
    if place.kind != SHAFT:
        return
    yield from at_flange(
        place,
        "eddy_current_drag",
        "EddyBrake",
        combinations(
            greatest_torque=shares(place.torque, 0.01, 0.1, 0.5),
            critical_speed=shares(place.speed, 0.1, 0.4, 1.5),
        ),
        EffectParameter("greatest_torque", place.torque),
        EffectParameter("critical_speed", place.speed),
    )
