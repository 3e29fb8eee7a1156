"""What a spring of the scenario leaves out of itself: another law in its place, or, in a mount, compliance and play."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from blocks.registry import find
from diagnosis.effects.effect import Candidate, EffectParameter, Sizes, combinations, shares, with_unit
from diagnosis.effects.places import Place, slides
from diagnosis.effects.scales import OperatingScales
from engine.block import Block
from scenarios.amend import Edit, Replace, Set

GIVES = (0.003, 0.02, 0.1, 0.3)
"""Starting sizes of what a mount gives way by under the force that acts, as shares of the travel."""

PLAYS = (0.003, 0.03, 0.15, 0.4)
"""Starting sizes of play in a mount, as shares of the travel."""


def is_linear_spring(block: Block) -> bool:
    """Whether a block, with the values it has, is a linear spring and damper between two flanges."""
    return bool(block.spring_parameters) and all(block.values[key] == value for key, value in block.spring_when)


def at_spring(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """Other laws in place of a linear spring, with its stiffness, damping and preload; along a slide their twins."""
    name, block = place.target, scales.system.blocks[place.target]
    if not is_linear_spring(block):
        return
    sliding = slides(scales.system, f"{name}.a")
    stiffness, damping = (_value(block, key) for key in block.spring_parameters[:2])
    ends = scales.ends(name)
    torque = max((end.torque for end in ends), default=1.0)
    twist = torque / stiffness

    def candidate(
        effect: str,
        type_name: str,
        starts: tuple[Sizes, ...],
        *parameters: EffectParameter,
        option: str = "",
        **given: Any,
    ) -> Candidate:
        twin, called = _twin(type_name) if sliding else (type_name, {})

        def own(sizes: Sizes) -> Sizes:
            return {called.get(key, key): value for key, value in sizes.items()}

        def edits(values: Sizes) -> list[Edit]:
            return [_replaced(name, block, twin, values, given)]

        known = tuple(replace(p, name=called.get(p.name, p.name)) for p in parameters)
        return Candidate(effect, name, name, name, edits, known, tuple(own(start) for start in starts), option=option)

    cubic = stiffness**3 / torque**2
    yield candidate(
        "hardening_spring",
        "HardeningSpring",
        combinations(cubic_stiffness=shares(cubic, 1e-3, 0.01, 0.1, 1.0)),
        EffectParameter("cubic_stiffness", cubic),
    )
    if not sliding:  # play in a slide comes with the compliance of its mount
        yield candidate(
            "backlash",
            "Backlash",
            combinations(half_gap=shares(twist, 1e-3, 0.01, 0.1, 0.5, 2.0)),
            EffectParameter("half_gap", twist),
            law="push_only",
        )
    if damping:
        yield candidate("one_sided_contact", "Backlash", ({},), half_gap="0 m" if sliding else "0 rad", law="push_only")
    yield candidate(
        "hysteresis",
        "BoucWenSpring",
        combinations(yield_twist=shares(twist, 3.0, 1.0, 0.2), residual_share=(0.95, 0.6)),
        EffectParameter("yield_twist", twist),
        EffectParameter("residual_share", 0.5, usual=1.0),
    )
    yield candidate(
        "hysteresis",
        "BoucWenSpring",
        combinations(yield_twist=shares(twist, 3.0, 1.0, 0.3), residual_share=(0.6,), loading_share=(-0.4,)),
        EffectParameter("yield_twist", twist),
        EffectParameter("residual_share", 0.5, usual=1.0),
        EffectParameter("loading_share", 1.0, signed=True),
        option="stiffening under load",
        unloading_share=1.0,
    )
    centre = math.sqrt(stiffness / min((end.inertia for end in ends), default=1.0))
    # What is faster than the recordings show need not be simulated.
    fastest = max(min(30 * centre, 5 / scales.sample), 3 * centre)
    yield candidate(
        "structural_damping",
        "StructuralSpring",
        combinations(loss_factor=sorted({0.01, 0.05, min(max(damping * centre / stiffness, 1e-3), 0.3)})),
        EffectParameter("loss_factor", 0.05, usual=1.0),
        lowest_frequency=with_unit(centre / 300, "rad/s"),
        highest_frequency=with_unit(fastest, "rad/s"),
    )


def at_mount(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """Compliance and play of a translational spring: its stiffness was given for a mount that has neither."""
    name, block = place.target, scales.system.blocks[place.target]
    if not is_linear_spring(block) or not slides(scales.system, f"{name}.a"):
        return
    stiff, lossy = block.spring_parameters[:2]
    ends = scales.ends(name)
    force = max((end.torque for end in ends), default=1.0)
    travel = max((end.angle for end in ends), default=1.0)
    mass = min((end.inertia for end in ends), default=1.0)

    def springs(stiffness: str, damping: str) -> tuple[Sizes, ...]:
        rows = []
        for k in (force / give for give in shares(travel, *GIVES)):
            rows.append({stiffness: k} | ({damping: 0.1 * math.sqrt(k * mass)} if damping else {}))
        return tuple(rows)

    def parameters(rows: tuple[Sizes, ...]) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter(key, value) for key, value in rows[1].items())

    def softer(values: Sizes) -> list[Edit]:
        return [Set(name, key, with_unit(values[key], block.unit_of(key))) for key in values]

    def loose(values: Sizes) -> list[Edit]:
        return [_replaced(name, block, "TranslationalBacklash", values, {"law": "push_only"})]

    soft, contacts = springs(stiff, lossy), springs("stiffness", "damping")
    yield Candidate("joint_flexibility", name, name, name, softer, parameters(soft), soft)
    plays = tuple({"half_gap": gap, **s} for gap in shares(travel, *PLAYS) for s in contacts)
    gap = EffectParameter("half_gap", travel)
    yield Candidate("backlash", name, name, name, loose, (gap, *parameters(contacts)), plays)


def _twin(type_name: str) -> tuple[str, dict[str, str]]:
    """The type of a law along a slide, and what it calls otherwise."""
    made = find(type_name)
    return made.slide_twin, dict(made.slide_names)


def _value(block: Block, key: str) -> float:
    return float(block.values[key]) if key else 0.0


def _replaced(name: str, block: Block, type_name: str, sizes: Sizes, given: dict[str, Any]) -> Replace:
    """The spring turned into a block of another law, with what both know: stiffness, damping and preload.

    Args:
        name: of the spring.
        block: the spring.
        type_name: another law; it calls the three as the library's springs do.
        sizes: of the other law's parameters.
        given: its further parameters and options.
    """
    made = find(type_name)
    rest = "rest_distance" if "rest_distance" in made.parameters else "rest_angle"
    carried = {}
    for own, other in zip(block.spring_parameters, ("stiffness", "damping", rest), strict=True):
        # Under the same name it stays as the user wrote it.
        if own and own != other and other in made.parameters and other not in sizes:
            carried[other] = with_unit(block.values[own], block.unit_of(own))
    kept = {*made.parameters, *made.options} - {*carried}
    drop = tuple(key for key in block.values if key not in kept)
    fitted = {key: with_unit(value, made.parameters[key].unit) for key, value in sizes.items()}
    return Replace(name, type_name, {**carried, **given, **fitted}, drop)
