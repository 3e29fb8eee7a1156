"""What may be missing in a drive: friction that grows with the load, and limits of its current."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from diagnosis.effects.effect import Candidate, EffectParameter, Sizes, Wave, combinations, shares, with_unit
from diagnosis.effects.insertion import at_flange, in_signal
from diagnosis.effects.orders import standing_out
from diagnosis.effects.places import Place, node
from diagnosis.effects.scales import OperatingScales
from diagnosis.effects.shaft import HARDLY, PHASES
from engine.system import System
from scenarios.amend import Edit, Set

COEFFICIENTS = (0.003, 0.02, 0.08, 0.3)
"""Starting sizes of the share of a load that goes into friction."""

SQUARES = (0.03, 0.3)
"""Starting sizes of a friction that grows with the square of the load, as shares of the torques that act."""

LEVELS = (1e-3, 0.02, 0.15)
"""Starting sizes of the friction without load, as shares of the torques that act."""

LIMITS = (2.5, 1.9, 1.5, 1.2, 1.0, 0.85, 0.7, 0.55, 0.4, 0.3, 0.2, 0.12)
"""Starting sizes of a limit of the current, as shares of what the largest voltage drives through a motor at rest: one
that is reversed at full speed draws nearly twice as much."""

COGGING = range(13, 101)
"""Waves per revolution of a motor's cogging; fewer are a torque ripple."""

MOST_ORDERS = 5
"""Of these, the orders that are tried: each costs a model of its own."""

GEAR_ORDERS = (1.0, 2.0, 4.0)
"""Waves of a transmission error per revolution of a gear's input; the first two of its output too."""

LOST = (1e-3, 5e-3, 0.02, 0.08)
"""Starting sizes of the voltage that a dead time takes, as shares of the largest command."""

RIPPLES = (0.01, 0.1)
"""Starting sizes of the current above which all of it is taken, as shares of that at rest under the largest command."""

NO_LIMIT_KNOWN = 10.0
"""Widening of the prior of a limit: how far an amplifier goes is not known before."""


def at_loaded_shaft(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """Friction that grows with the load, only where a block tells the effort that gears and bearings of a shaft carry.

    Where the shaft has dry friction already, that is the level without load; else the level is fitted too. The richer
    law has a share that grows with the load itself.
    """
    rubbing = [mode.name for mode in scales.problem.model.modes if mode.kind == "friction"]
    members = scales.groups[place.target]
    blocks = {scales.system.split(flange)[0] for flange in members}
    known = any(name == block or name.startswith(f"{block}.") for name in rubbing for block in blocks)
    for flange in members:
        name, port = scales.system.split(flange)
        block, effort = scales.system.blocks[name], "force" if place.sliding else "torque"
        if port not in block.loads or effort not in block.ports:
            continue
        here = scales.member(place, flange)
        share = EffectParameter("coefficient", 0.1, usual=1.0)
        level = EffectParameter("coulomb_friction", here.torque)
        more = {} if known else {"coulomb_friction": shares(here.torque, *LEVELS)}
        square = EffectParameter("quadratic_coefficient", 1 / here.torque)
        squares = {"quadratic_coefficient": shares(1 / here.torque, *SQUARES)}
        few = COEFFICIENTS[1::2]
        for effect, starts, parameters in (
            ("load_dependent_friction", combinations(coefficient=COEFFICIENTS if known else few, **more), (share,)),
            ("quadratic_load_friction", combinations(coefficient=few, **squares, **more), (share, square)),
        ):
            yield from at_flange(
                here,
                effect,
                "LoadDependentFriction",
                starts,
                *(parameters if known else (*parameters, level)),
                held=("static_ratio", "stribeck_velocity"),
                fed_by=f"{name}.{effort}",
                tapped=block.ports[effort].role == "input",
            )


def at_driven_shaft(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """Cogging, only at the shaft that a drive turns, and of orders that stand out in what is left over.

    It is a torque ripple of an order above those that are tried anywhere: magnets pull at the teeth of a motor, and all
    orders to a hundred are too many to be tried one by one.
    """
    for flange in scales.groups[place.target]:
        name, port = scales.system.split(flange)
        if port not in scales.system.blocks[name].cut_after or place.sliding or not drives(scales.system, name):
            continue
        here = scales.member(place, flange)
        orders = standing_out(scales.problem, scales.begun, flange, COGGING, MOST_ORDERS, scales.residual)
        if not orders:
            continue
        made = [float(order) for order in orders]
        yield from at_flange(
            here,
            "cogging",
            "TorqueRipple",
            combinations(order=made, amplitude=shares(here.torque, 2e-4, 2e-3, 0.05), phase=PHASES),
            EffectParameter("order", 1.0, fixed=True),
            EffectParameter("amplitude", here.torque),
            EffectParameter("phase", 1.0, signed=True),
            wave=Wave("amplitude", "phase", combinations(order=made, amplitude=[HARDLY * here.torque], phase=[0.0])),
        )


def drives(system: System, name: str) -> bool:
    """Whether a block brings power to a shaft: it has one flange, and inputs."""
    roles = [port.role for port in system.blocks[name].ports.values()]
    return roles.count("flange") == 1 and "input" in roles


def at_motor_input(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """A limit of the current, only before the voltage of a motor whose winding and back-emf are known.

    Where a drive is driven by its current or torque, that limit is a saturation of the input.
    """
    block, winding = scales.system.blocks[place.block], scales.system.blocks[place.block].winding_parameters
    known = winding and block.back_emf_parameter and block.cut_after
    if not known or not place.target.endswith(".voltage"):
        return
    resistance, back_emf = block.values[winding[0]], block.values[block.back_emf_parameter]
    stall = place.size / resistance
    starts = combinations(current_limit=shares(stall, *LIMITS))
    plain = EffectParameter("current_limit", stall, usual=1.0)
    limit = replace(plain, spread=NO_LIMIT_KNOWN * plain.spread)
    source = next((end for end in node(scales.system, place.target) if end != place.target), "")
    there = scales.system.split(source)[0] if source else ""
    if there and "current_limit" in scales.system.blocks[there].parameters:
        # A limiter is there, with a limit that was not reached.

        def edits(values: Sizes) -> list[Edit]:
            return [Set(there, "current_limit", with_unit(values["current_limit"], "A"))]

        yield Candidate("current_limit", place.name, place.block, there, edits, (limit,), starts)
        return
    yield from in_signal(
        place,
        "current_limit",
        "CurrentLimiter",
        starts,
        limit,
        held=False,
        reads={"speed": f"{place.block}.{block.cut_after[0]}.speed"},
        resistance=with_unit(resistance, "ohm"),
        back_emf_constant=with_unit(back_emf, "V.s/rad"),
    )


def at_motor_bridge(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """The dead time of a switching amplifier, only before the voltage of a motor whose winding is known.

    It acts against the current, which a motor with inductance tells; without, it follows from voltage and speed.
    """
    block, winding = scales.system.blocks[place.block], scales.system.blocks[place.block].winding_parameters
    known = winding and block.back_emf_parameter and block.cut_after and "current" in block.ports
    if not known or not place.target.endswith(".voltage"):
        return
    resistance, inductance = (block.values[key] for key in winding)
    stall = place.size / resistance
    yield from in_signal(
        place,
        "dead_time",
        "DeadTime",
        combinations(lost_voltage=shares(place.size, *LOST), ripple_current=shares(stall, *RIPPLES)),
        EffectParameter("lost_voltage", place.size),
        EffectParameter("ripple_current", stall),
        held=False,
        reads={"current": f"{place.block}.current"}
        if inductance
        else {"speed": f"{place.block}.{block.cut_after[0]}.speed"},
        resistance=with_unit(resistance, "ohm"),
        back_emf_constant=with_unit(block.values[block.back_emf_parameter], "V.s/rad"),
        inductance=bool(inductance),
    )


def at_gear(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """A transmission error, only of a gear that is elastic, can have one and has none: a rigid one hands no wave on.

    Its orders are those of eccentric pinions and of both sides of a wave generator, and of an eccentric wheel.
    """
    name, block = place.target, scales.system.blocks[place.target]
    if "error_waves" not in block.options or block.values["error_waves"] or not block.values["stiffness"]:
        return
    slow = scales.at(f"{name}.output")
    torque = slow.torque if slow else 1.0
    twist, ratio = torque / block.values["stiffness"], abs(block.values["ratio"])
    keys = {key: f"error_{key}[1]" for key in ("amplitude", "order", "phase")}
    orders = [*GEAR_ORDERS, *(order / ratio for order in GEAR_ORDERS[:2])]

    def edits(values: Sizes) -> list[Edit]:
        units = {"amplitude": "rad", "order": "1", "phase": "rad"}
        given = [Set(name, f"error_{key}", [with_unit(values[own], units[key])]) for key, own in keys.items()]
        return [Set(name, "error_waves", 1), *given]

    def sizes(*amplitudes: float, phases: Sequence[float]) -> tuple[Sizes, ...]:
        values = {"order": orders, "amplitude": shares(twist, *amplitudes), "phase": phases}
        return combinations(**{keys[key]: rows for key, rows in values.items()})

    yield Candidate(
        "transmission_error",
        name,
        name,
        name,
        edits,
        (
            EffectParameter(keys["order"], 1.0, fixed=True),
            EffectParameter(keys["amplitude"], twist),
            EffectParameter(keys["phase"], 1.0, signed=True),
        ),
        sizes(2e-3, 0.05, 0.5, phases=PHASES),
        wave=Wave(keys["amplitude"], keys["phase"], sizes(HARDLY, phases=(0.0,))),
    )
