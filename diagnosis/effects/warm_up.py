"""A winding that warms up while a recording runs: its resistance rises with its temperature."""

from __future__ import annotations

from collections.abc import Iterator

from blocks.registry import find
from diagnosis.effects.effect import Candidate, EffectParameter, Sizes, with_unit
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales
from engine.block import Block
from scenarios.amend import Edit, Replace

COLD, WARM = "DCMotor", "ThermalDCMotor"

RISES = (3e-3, 0.03, 0.2)
"""Starting sizes of the rise of the resistance in a recording at full voltage, as shares."""

TIME = 20.0
"""Thermal time constant (s) of a winding against its housing: data sheets of small motors have 5 to 60."""

HOUSING = 30.0
"""Heat that a housing takes, over that of the winding: it hardly warms while a recording runs."""


def at_motor_winding(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """The motor with heat in place of one without, only where both are one motor while they are cold.

    That is one without losses besides those of winding and bearing, and with one constant for torque and back-emf.
    """
    name, block = place.target, scales.system.blocks[place.target]
    if type(block) is not find(COLD) or not one_motor(block):
        return
    driven = [size for target, size in scales.inputs.items() if target == f"{name}.voltage"]
    seconds = max((float(e.time[-1] - e.time[0]) for e in scales.problem.training), default=0.0)
    if not driven or not seconds:
        return
    warm = find(WARM)
    known = [key for key in warm.parameters if key in block.given]
    copper = float(warm.parameters["resistance_coefficient"].default)
    # Heat of the largest voltage on a motor at rest, for the whole recording.
    heat = driven[0] ** 2 / block.values["resistance"] * seconds
    usual = copper * heat / RISES[1]

    def edits(values: Sizes) -> list[Edit]:
        given = {
            "winding_heat_capacity": with_unit(values["winding_heat_capacity"], "J/K"),
            "winding_thermal_resistance": with_unit(values["winding_thermal_resistance"], "K/W"),
            "housing_heat_capacity": with_unit(HOUSING * usual, "J/K"),
            "housing_thermal_resistance": with_unit(TIME / usual, "K/W"),
        }
        return [Replace(name, WARM, given, tuple(key for key in block.given if key not in known))]

    yield Candidate(
        "warm_up",
        name,
        name,
        name,
        edits,
        (
            EffectParameter("winding_heat_capacity", usual, usual=1.0),
            EffectParameter("winding_thermal_resistance", TIME / usual, usual=1.0),
        ),
        tuple(
            {"winding_heat_capacity": capacity, "winding_thermal_resistance": TIME / capacity}
            for capacity in (copper * heat / rise for rise in RISES)
        ),
        held=(
            "housing_heat_capacity",
            "housing_thermal_resistance",
            "resistance_coefficient",
            "magnet_coefficient",
        ),
    )


def one_motor(block: Block) -> bool:
    """Whether a motor has no further losses, and one constant for torque and voltage."""
    values = block.values
    return bool(values["efficiency"] == 1.0 and block.same_as("back_emf_constant") == "torque_constant")
