"""Friction that falls while a recording runs: what it takes warms the oil or grease it is made in."""

from __future__ import annotations

from collections.abc import Iterator

from blocks.registry import find
from diagnosis.effects.effect import Candidate, EffectParameter, Sizes, with_unit
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales
from engine.block import Block
from scenarios.amend import Edit, Replace

WARMING = {
    "BearingFriction": "WarmingFriction",
    "TranslationalBearingFriction": "TranslationalWarmingFriction",
}
"""The friction that warms up, for each that does not; the first flange of either is what it acts on."""

FALLS = (3e-3, 0.03, 0.3)
"""Starting sizes of the fall of the friction in a recording at the usual speed, as shares."""

TIME = 100.0
"""Thermal time constant (s) of a joint: small servos have a minute, robots an hour."""


def at_bearing(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """The friction that warms up in place of one that does not, only where there is friction that can fall.

    How much a kelvin takes cannot be told from the heat capacity: the former is held at what the block has.
    """
    name, block = place.target, scales.system.blocks[place.target]
    warm = next((new for old, new in WARMING.items() if type(block) is find(old)), "")
    seconds = max((float(e.time[-1] - e.time[0]) for e in scales.problem.training), default=0.0)
    lost = power(scales, place, block) if warm else 0.0
    if not lost or not seconds:
        return
    share = float(find(warm).parameters["temperature_coefficient"].default)
    capacities = [share * lost * seconds / fall for fall in FALLS]
    usual = capacities[1]

    def edits(values: Sizes) -> list[Edit]:
        given = {
            "heat_capacity": with_unit(values["heat_capacity"], "J/K"),
            "thermal_resistance": with_unit(values["thermal_resistance"], "K/W"),
            "temperature_coefficient": with_unit(values["temperature_coefficient"], "1/K"),
        }
        return [Replace(name, warm, given)]

    yield Candidate(
        "friction_warm_up",
        name,
        name,
        name,
        edits,
        (
            EffectParameter("heat_capacity", usual, usual=1.0),
            EffectParameter("thermal_resistance", TIME / usual, usual=1.0),
            # Given, not fitted; the heat capacity means nothing to a reader without it.
            EffectParameter("temperature_coefficient", share, fixed=True, unit="1/K"),
        ),
        tuple(
            {"heat_capacity": capacity, "thermal_resistance": TIME / capacity, "temperature_coefficient": share}
            for capacity in capacities
        ),
        held=("temperature_coefficient", "dry_temperature_coefficient"),
    )


def power(scales: OperatingScales, place: Place, block: Block) -> float:
    """What a friction takes at the usual speed of what it acts on (W); 0 where that does not move."""
    flange = f"{place.target}.{next(port.name for port in block.ports.values() if port.role == 'flange')}"
    there = scales.at(flange)
    if there is None:
        return 0.0
    speed = there.speed
    values = block.values
    dry = (values["coulomb_friction"] + values["coulomb_friction_backward"]) / 2
    return float((dry + values["viscous_friction"] * speed) * speed)
