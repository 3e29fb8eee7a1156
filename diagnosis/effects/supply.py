"""A supply whose voltage sags under the current that a motor draws."""

from __future__ import annotations

from collections.abc import Iterator

from diagnosis.effects.effect import NAME, Candidate, EffectParameter, Sizes, combinations, shares, with_unit
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales
from scenarios.amend import Edit, Feed, InSignal, Wire

LOSSES = (2e-3, 0.02, 0.1, 0.4)
"""Starting sizes of the supply's resistance, as shares of the winding's."""

ABOVE = 2.0
"""Voltage of the supply over the largest command: how far it lies above it only scales its resistance."""

QUICK = 0.15
"""Time constant of the bus, in samples: with no inductance the winding's current would need the voltage at once.

It is the same at every resistance: a lag that grew with it would speak against large ones.
"""


def at_motor_supply(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """A supply with resistance and the bridge that it feeds, only before the voltage of a motor with a winding.

    The command is then taken for the share of the supply's voltage that the bridge lets through: V = u v / E. Only
    R / E^2 shows, R of a supply of voltage E: what is lost goes by the square of the command.
    """
    motor = place.block
    block, name = scales.system.blocks[motor], f"{NAME}_supply_sag"
    wound = block.winding_parameters and block.back_emf_parameter and block.cut_after and "current" in block.ports
    if not wound or not place.target.endswith(".voltage"):
        return
    resistance, inductance = (block.values[key] for key in block.winding_parameters)
    voltage = ABOVE * place.size
    # At a command of the size of the largest it counts as (1 / ABOVE)^2 of a resistance of the winding.
    reference = resistance * ABOVE**2

    def edits(values: Sizes) -> list[Edit]:
        given = {
            "source_voltage": with_unit(values["source_voltage"], "V"),
            "resistance": with_unit(values["resistance"], "ohm"),
        }
        if not inductance:
            given["time_constant"] = with_unit(QUICK * scales.sample, "s")
        duty, bridge, full = f"{name}_duty", f"{name}_bridge", f"{name}_full"
        return [
            InSignal(duty, "Product", place.target, {"operation": "divide", "unit": "1"}, entry="a"),
            Feed(full, "Constant", f"{duty}.b", {"value": with_unit(values["source_voltage"], "V")}),
            InSignal(bridge, "Bridge", place.target, entry="duty"),
            Feed(name, "Supply", f"{bridge}.supply", given, exit="voltage"),
            Wire(f"{name}_motor", (f"{motor}.current", f"{bridge}.current")),
            Wire(f"{name}_drawn", (f"{bridge}.supply_current", f"{name}.current")),
        ]

    yield Candidate(
        "supply_sag",
        place.name,
        motor,
        name,
        edits,
        (
            EffectParameter("resistance", reference),
            # Given, not fitted; the resistance means nothing to a reader without it.
            EffectParameter("source_voltage", voltage, fixed=True, unit="V"),
        ),
        combinations(resistance=shares(reference, *LOSSES), source_voltage=[voltage]),
        held=("source_voltage", "time_constant"),
    )
