"""What may be missing in the mechanics: at shafts, in joints, in links."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from diagnosis.effects.effect import NAME, Candidate, EffectParameter, Sizes, Wave, grid, shares, with_unit
from diagnosis.effects.scales import OperatingScales
from scenarios.amend import AtFlange, Between, Edit, Replace, Set

LEVELS = (1e-3, 5e-3, 0.03, 0.15, 0.5)
"""Starting sizes of torques, as shares of the torques that act."""

TWISTS = (1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1)
"""Starting sizes of what a joint gives way by, as shares of the range of its angle."""

ORDERS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
"""Waves per revolution of a torque ripple."""

HARDLY = 2e-4
"""Size of a wave whose amplitude is solved for, as a share of the torques that act."""

PHASES = (0.0, 1.5708, 3.1416, -1.5708)


def at_shaft(scales: OperatingScales, flange: str) -> Iterator[Candidate]:
    """Friction, drag, springs, gravity, ripple, vibration and further bodies at a shaft."""
    block = scales.problem.scenario.system.split(flange)[0]
    torque, speed, angle, inertia = (d[flange] for d in (scales.torque, scales.speed, scales.angle, scales.inertia))

    made = _maker(flange, block)
    levels = shares(torque, *LEVELS)
    dry, back = EffectParameter("coulomb_friction", torque), EffectParameter("coulomb_friction_backward", torque)
    yield made("coulomb_friction", "BearingFriction", {"coulomb_friction": "N.m"}, grid(coulomb_friction=levels), dry)
    yield made(
        "stribeck_friction",
        "BearingFriction",
        {"coulomb_friction": "N.m", "static_friction": "N.m", "stribeck_velocity": "rad/s"},
        tuple(
            {"coulomb_friction": s, "static_friction": 1.5 * s, "stribeck_velocity": v * speed}
            for s in levels
            for v in (0.03, 0.2)
        ),
        dry,
        EffectParameter("static_friction", torque),
        EffectParameter("stribeck_velocity", speed),
        tidy=lambda v: v | {"static_friction": max(v["static_friction"], v["coulomb_friction"])},
    )
    yield made(
        "direction_dependent_friction",
        "BearingFriction",
        {"coulomb_friction": "N.m", "coulomb_friction_backward": "N.m"},
        tuple({"coulomb_friction": s, "coulomb_friction_backward": s * r} for s in levels for r in (0.7, 1.4)),
        dry,
        back,
    )
    yield made(
        "viscous_friction",
        "BearingFriction",
        {"viscous_friction": "N.m.s/rad"},
        grid(viscous_friction=shares(torque / speed, *LEVELS)),
        EffectParameter("viscous_friction", torque / speed),
    )
    yield made(
        "quadratic_drag",
        "QuadraticDrag",
        {"drag": "N.m.s2/rad2"},
        grid(drag=shares(torque / speed**2, *LEVELS)),
        EffectParameter("drag", torque / speed**2),
    )
    yield made(
        "stray_spring",
        "GroundSpring",
        {"stiffness": "N.m/rad", "rest_angle": "rad"},
        grid(stiffness=shares(torque / angle, *LEVELS), rest_angle=[0.01 * angle]),
        EffectParameter("stiffness", torque / angle),
        # One that is at rest farther away pulls evenly: an offset, which is another effect.
        EffectParameter("rest_angle", angle, signed=True, most=3.0),
    )
    yield made(
        "payload",
        "Inertia",
        {"inertia": "kg.m2"},
        grid(inertia=shares(inertia, 0.003, 0.05, 0.3)),
        EffectParameter("inertia", inertia),
    )
    swing = math.sqrt(torque / (inertia * angle))
    yield made(
        "outside_vibration",
        "Vibration",
        {"amplitude": "N.m", "frequency": "rad/s", "phase": "rad"},
        grid(amplitude=[0.02 * torque], frequency=scales.lines or [3 * swing], phase=PHASES),
        EffectParameter("amplitude", torque),
        EffectParameter("frequency", swing, signed=True),
        EffectParameter("phase", 1.0, signed=True),
    )
    swings = [
        *scales.lines,
        *(w for w in (20.0, 50.0, 120.0, 300.0) if all(abs(w - a) > 0.2 * w for a in scales.lines)),
    ]
    mode = made(
        "extra_mode",
        "Resonator",
        {"inertia": "kg.m2", "frequency": "rad/s", "damping_ratio": "1"},
        grid(inertia=shares(inertia, 1e-3, 0.03), frequency=swings, damping_ratio=[0.02]),
        # A heavier body hardly moves: a spring and a damper to the ground, which are other effects.
        EffectParameter("inertia", inertia, most=2.0),
        EffectParameter("frequency", 100.0),
        EffectParameter("damping_ratio", 0.02),
    )
    yield replace(mode, bold=grid(inertia=[0.3 * inertia], frequency=swings[:2], damping_ratio=[0.02]))


def at_turns(scales: OperatingScales, flange: str) -> Iterator[Candidate]:
    """What depends on the angle itself: a flange for each ratio at which members of a group turn."""
    tried: list[float] = []
    for member in scales.groups[flange]:
        ratio = scales.ratio(flange, member)
        if any(abs(ratio / other - 1) < 1e-6 for other in tried):
            continue
        tried.append(ratio)
        torque = scales.torque[flange] / ratio
        made = _maker(member, scales.problem.scenario.system.split(member)[0])
        if not scales.spins(flange):
            yield made(
                "gravity",
                "GravityTorque",
                {"mass": "kg", "hanging_angle": "rad"},
                grid(mass=shares(torque / 9.81, 1e-3, 0.02, 0.15), hanging_angle=PHASES),
                EffectParameter("mass", torque / 9.81),
                EffectParameter("hanging_angle", 1.0, signed=True),
                wave=Wave("mass", "hanging_angle", grid(mass=[HARDLY * torque / 9.81], hanging_angle=[0.0])),
                radius="1 m",
            )
        yield made(
            "torque_ripple",
            "TorqueRipple",
            {"amplitude": "N.m", "phase": "rad", "order": "1"},
            grid(order=ORDERS, amplitude=shares(torque, 2e-4, 2e-3, 0.05), phase=PHASES),
            EffectParameter("order", 1.0, fixed=True),
            EffectParameter("amplitude", torque),
            EffectParameter("phase", 1.0, signed=True),
            wave=Wave("amplitude", "phase", grid(order=ORDERS, amplitude=[HARDLY * torque], phase=[0.0])),
        )


def _maker(flange: str, block: str) -> Callable[..., Candidate]:
    """What makes a candidate at a flange, from its effect, type, units, starts and parameters."""

    def made(
        effect: str,
        kind: str,
        units: dict[str, str],
        starts: tuple[Sizes, ...],
        *parameters: EffectParameter,
        tidy: Callable[[Sizes], Sizes] = dict,
        wave: Wave | None = None,
        **fixed: Any,
    ) -> Candidate:
        name = f"{NAME}_{effect}"

        def edits(values: Sizes) -> list[Edit]:
            values = tidy(values)  # a fit does not mind where a block does
            given = {key: with_unit(values[key], unit) for key, unit in units.items() if key in values}
            return [AtFlange(name, kind, flange, "shaft", {**fixed, **given})]

        return Candidate(effect, flange, block, name, edits, parameters, starts, held=tuple(fixed), wave=wave)

    return made


def at_joints(scales: OperatingScales) -> Iterator[Candidate]:
    """Compliance, play, hardening and hysteresis where a shaft can be cut, with inertia left on both sides."""
    system = scales.problem.scenario.system
    for flange, members in scales.groups.items():
        for cut in members:
            ratio = scales.ratio(flange, cut)
            inertia, torque = scales.inertia[flange] / ratio**2, scales.torque[flange] / ratio
            angle = scales.angle[flange] * ratio
            block, port = system.split(cut)
            node = next((c for c in system.connections if cut in c.ends), None)
            if node is None or len(node.ends) < 2 or not _drives(type(system.blocks[block]).__name__, port):
                continue
            place = f"{cut} -> {next(end for end in node.ends if end != cut)}"
            springs = []
            for twist in shares(angle, *TWISTS):
                stiffness = torque / twist
                springs.append({"stiffness": stiffness, "damping": 0.1 * math.sqrt(stiffness * inertia)})
            stiff, loss = (
                EffectParameter("stiffness", springs[3]["stiffness"]),
                EffectParameter("damping", springs[3]["damping"]),
            )
            yield _joint("joint_flexibility", "SpringDamper", block, place, cut, tuple(springs), (stiff, loss))
            plays = tuple({"half_gap": gap, **s} for gap in shares(angle, *TWISTS[:-1]) for s in springs[1:5:2])
            yield _joint(
                "backlash",
                "Backlash",
                block,
                place,
                cut,
                plays,
                (EffectParameter("half_gap", angle), stiff, loss),
                law="push_only",
            )
            cubic = tuple(
                {"cubic_stiffness": share * s["stiffness"] ** 3 / torque**2, **s}
                for s in springs
                for share in (0.1, 10.0)
            )
            law = (stiff, EffectParameter("cubic_stiffness", stiff.reference**3 / torque**2), loss)
            # Soft ones move the user's own parameters far, and are no worse for that.
            soft = tuple({"cubic_stiffness": s["stiffness"] ** 3 / torque**2, **s} for s in springs[4:6])
            hard = _joint("hardening_spring", "HardeningSpring", block, place, cut, cubic, law)
            yield replace(hard, bold=soft)
            loops = tuple(
                {"yield_twist": share * torque / s["stiffness"], "residual_share": 0.5, **s}
                for s in springs[:-1]
                for share in (0.3,)
            )
            slips = (stiff, EffectParameter("yield_twist", angle), EffectParameter("residual_share", 0.5), loss)
            shape = ("sharpness", "unloading_share")
            yield _joint("hysteresis", "BoucWenSpring", block, place, cut, loops, slips, held=shape)


def _joint(
    effect: str,
    kind: str,
    block: str,
    place: str,
    cut: str,
    starts: tuple[Sizes, ...],
    parameters: tuple[EffectParameter, ...],
    held: tuple[str, ...] = (),
    **fixed: Any,
) -> Candidate:
    name = f"{NAME}_{effect}"

    def edits(values: Sizes) -> list[Edit]:
        given = {key: with_unit(values[key], _UNITS[key]) for key in _UNITS if key in values}
        return [Between(name, kind, cut, "a", "b", {**fixed, **given})]

    return Candidate(effect, place, block, name, edits, parameters, starts, held=held)


def _drives(kind: str, port: str) -> bool:
    """Whether cutting behind this port separates the drive from the load."""
    return (kind, port) in (
        ("DCMotor", "shaft"),
        ("Gear", "output"),
        ("HarmonicDrive", "output"),
        ("Torque", "shaft"),
        ("Force", "flange"),
        ("PrescribedMotion", "shaft"),
        ("TranslationalPrescribedMotion", "flange"),
    )


_UNITS = {
    "stiffness": "N.m/rad",
    "damping": "N.m.s/rad",
    "half_gap": "rad",
    "cubic_stiffness": "N.m/rad3",
    "yield_twist": "rad",
    "residual_share": "1",
}


def at_links(scales: OperatingScales) -> Iterator[Candidate]:
    """What a link or a spring of the scenario leaves out of itself."""
    for name, block in scales.problem.scenario.system.blocks.items():
        if type(block).__name__ == "AssumedModesLink":
            yield from _link(name, block)
        elif type(block).__name__ == "SpringDamper" or _is_spring(block):
            yield from _spring(scales, name, block)


def _link(name: str, block: Any) -> Iterator[Candidate]:
    modes = int(block.values["modes"])

    def more(values: Sizes) -> list[Edit]:
        return [Set(name, "modes", modes + 1)]

    yield Candidate("extra_mode", name, name, name, more)
    if not block.values["foreshortening"]:

        def spun(values: Sizes) -> list[Edit]:
            return [Set(name, "nonlinear", True), Set(name, "foreshortening", True)]

        yield Candidate("centrifugal_stiffening", name, name, name, spun)
    mass = float(block.values["mass"])
    if not block.values["payload"]:

        def loaded(values: Sizes) -> list[Edit]:
            return [Set(name, "payload", with_unit(values["payload"], "kg"))]

        sizes = grid(payload=shares(mass, 0.005, 0.05, 0.3))
        yield Candidate("payload", name, name, name, loaded, (EffectParameter("payload", mass),), sizes)


def _is_spring(block: Any) -> bool:
    """Whether a block of another kind is a plain spring and damper as it stands."""
    return type(block).__name__ == "Backlash" and block.values["law"] == "two_sided" and not block.values["half_gap"]


def _spring(scales: OperatingScales, name: str, block: Any) -> Iterator[Candidate]:
    stiffness, damping = float(block.values["stiffness"]), float(block.values["damping"])
    torque = max((t for f, t in scales.torque.items() if f.startswith(f"{name}.")), default=0.0)
    torque = torque or max(scales.torque.values(), default=1.0)
    twist = torque / stiffness

    def replaced(
        effect: str,
        kind: str,
        units: dict[str, str],
        starts: tuple[Sizes, ...],
        *parameters: EffectParameter,
        **fixed: Any,
    ) -> Candidate:
        drop: tuple[str, ...] = ("rest_angle",) if kind != "StructuralSpring" else ("rest_angle", "damping")
        drop += () if kind == "Backlash" else ("half_gap", "law")

        def edits(values: Sizes) -> list[Edit]:
            given = {key: with_unit(values[key], unit) for key, unit in units.items() if key in values}
            return [Replace(name, kind, {**fixed, **given}, drop)]

        return Candidate(effect, name, name, name, edits, parameters, starts)

    cubic = stiffness**3 / torque**2
    yield replaced(
        "hardening_spring",
        "HardeningSpring",
        {"cubic_stiffness": "N.m/rad3"},
        grid(cubic_stiffness=shares(cubic, 1e-3, 0.01, 0.1, 1.0)),
        EffectParameter("cubic_stiffness", cubic),
    )
    yield replaced(
        "backlash",
        "Backlash",
        {"half_gap": "rad"},
        grid(half_gap=shares(twist, 1e-3, 0.01, 0.1, 0.5, 2.0)),
        EffectParameter("half_gap", twist),
        law="push_only",
    )
    if damping:
        yield replaced("one_sided_contact", "Backlash", {}, ({},), half_gap="0 rad", law="push_only")
    yield replaced(
        "hysteresis",
        "BoucWenSpring",
        {"yield_twist": "rad", "residual_share": "1"},
        grid(yield_twist=shares(twist, 3.0, 1.0, 0.2), residual_share=(0.95, 0.6)),
        EffectParameter("yield_twist", twist),
        EffectParameter("residual_share", 0.5),
    )
    centre = math.sqrt(stiffness / min(scales.inertia.values(), default=1.0))
    # What is faster than the recordings show need not be simulated.
    fastest = max(min(30 * centre, 5 / scales.sample), 3 * centre)
    yield replaced(
        "structural_damping",
        "StructuralSpring",
        {"loss_factor": "1"},
        grid(loss_factor=sorted({0.01, 0.05, min(max(damping * centre / stiffness, 1e-3), 0.3)})),
        EffectParameter("loss_factor", 0.05),
        lowest_frequency=with_unit(centre / 300, "rad/s"),
        highest_frequency=with_unit(fastest, "rad/s"),
    )
