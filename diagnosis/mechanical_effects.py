"""What may be missing in the mechanics: at shafts, in joints, in links."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from blocks.registry import registry
from diagnosis.candidate import NAME, Candidate, Knob, with_unit
from diagnosis.surroundings import Surroundings
from scenarios.amend import AtFlange, Between, Edit, Replace, Set


def at_shaft(around: Surroundings, flange: str) -> Iterator[Candidate]:
    """Friction, drag, springs, gravity, ripple and further inertia at a shaft."""
    block = around.problem.scenario.system.split(flange)[0]
    torque, speed, angle, inertia = (d[flange] for d in (around.torque, around.speed, around.angle, around.inertia))

    def made(
        effect: str, kind: str, units: dict[str, str], *knobs: Knob, port: str = "shaft", **fixed: Any
    ) -> Candidate:
        name = f"{NAME}_{effect}"

        def edits(values: dict[str, float]) -> list[Edit]:
            given = {key: with_unit(values[key], unit) for key, unit in units.items() if key in values}
            return [AtFlange(name, kind, flange, port, {**fixed, **given})]

        return Candidate(effect, flange, block, name, edits, knobs)

    levels = (0.03, 0.15, 0.5)
    dry = Knob("coulomb_friction", torque, levels)
    yield made("coulomb_friction", "BearingFriction", {"coulomb_friction": "N.m"}, dry)
    yield made(
        "stribeck_friction",
        "BearingFriction",
        {"coulomb_friction": "N.m", "static_friction": "N.m", "stribeck_velocity": "rad/s"},
        dry,
        Knob("static_friction", torque, tuple(1.5 * s for s in levels)),
        Knob("stribeck_velocity", speed, (0.1, 0.1, 0.1)),
    )
    yield made(
        "direction_dependent_friction",
        "BearingFriction",
        {"coulomb_friction": "N.m", "coulomb_friction_backward": "N.m"},
        dry,
        Knob("coulomb_friction_backward", torque, levels),
    )
    viscous = Knob("viscous_friction", torque / speed, (0.03, 0.15, 0.5))
    yield made("viscous_friction", "BearingFriction", {"viscous_friction": "N.m.s/rad"}, viscous)
    yield made("quadratic_drag", "QuadraticDrag", {"drag": "N.m.s2/rad2"}, Knob("drag", torque / speed**2, levels))
    spring = Knob("stiffness", torque / angle, (0.03, 0.15, 0.5))
    rest = Knob("rest_angle", angle, (0.01,), True)
    yield made("stray_spring", "GroundSpring", {"stiffness": "N.m/rad", "rest_angle": "rad"}, spring, rest)
    yield made(
        "gravity",
        "GravityTorque",
        {"mass": "kg", "hanging_angle": "rad"},
        Knob("mass", torque / 9.81, (0.1, 0.1, 0.1, 0.5)),
        Knob("hanging_angle", 1.0, (0.1, 1.6, -1.6, 3.1), True),
        radius="1 m",
    )
    yield made("payload", "Inertia", {"inertia": "kg.m2"}, Knob("inertia", inertia, (0.05, 0.3)))
    for order in (1, 2, 3, 6):
        yield made(
            "torque_ripple",
            "TorqueRipple",
            {"amplitude": "N.m", "phase": "rad"},
            Knob("amplitude", torque, (0.1, 0.1, 0.1, 0.1)),
            Knob("phase", 1.0, (0.1, 1.6, 3.1, -1.6), True),
            order=order,
        )


def at_joints(around: Surroundings) -> Iterator[Candidate]:
    """Compliance, play and hardening where a shaft can be cut, with inertia left on both sides."""
    system, names = around.problem.scenario.system, list(registry())
    for flange, members in around.groups.items():
        for cut in members:
            block, port = system.split(cut)
            made = system.blocks[block]
            node = next((c for c in system.connections if cut in c.ends), None)
            if node is None or len(node.ends) < 2 or not _drives(type(made).__name__, port):
                continue
            inertia, angle, torque = around.inertia[flange], around.angle[flange], around.torque[flange]
            stiff = Knob("stiffness", inertia * 900.0, (0.3, 1.0, 4.0, 20.0))
            loss = Knob("damping", inertia * 3.0, (1.0, 1.0, 1.0, 1.0))
            gap = Knob("half_gap", angle, (0.003, 0.01, 0.03, 0.003))
            for effect, kind, knobs, fixed in (
                ("joint_flexibility", "SpringDamper", (stiff, loss), {}),
                ("backlash", "Backlash", (gap, stiff, loss), {"law": "push_only"}),
                (
                    "hardening_spring",
                    "HardeningSpring",
                    (stiff, Knob("cubic_stiffness", torque / angle**3, (1.0,) * 4), loss),
                    {},
                ),
            ):
                if kind in names:
                    yield Candidate(
                        effect,
                        f"{cut} -> node",
                        block,
                        f"{NAME}_{effect}",
                        _between(f"{NAME}_{effect}", kind, cut, fixed),
                        knobs,
                    )


def _drives(kind: str, port: str) -> bool:
    """Whether cutting behind this port separates the drive from the load."""
    return (kind, port) in (("DCMotor", "shaft"), ("Gear", "output"), ("HarmonicDrive", "output"), ("Torque", "shaft"))


_UNITS = {"stiffness": "N.m/rad", "damping": "N.m.s/rad", "half_gap": "rad", "cubic_stiffness": "N.m/rad3"}


def _between(name: str, kind: str, cut: str, fixed: dict[str, Any]) -> Any:
    def edits(values: dict[str, float]) -> list[Edit]:
        given = {key: with_unit(values[key], _UNITS[key]) for key in _UNITS if key in values}
        return [Between(name, kind, cut, "a", "b", {**fixed, **given})]

    return edits


def at_links(around: Surroundings) -> Iterator[Candidate]:
    """What a link or a spring of the scenario leaves out of itself."""
    for name, block in around.problem.scenario.system.blocks.items():
        if type(block).__name__ == "AssumedModesLink":
            modes = int(block.values["modes"])

            def more(values: dict[str, float], name: str = name, modes: int = modes) -> list[Edit]:
                return [Set(name, "modes", modes + 1)]

            yield Candidate("extra_mode", name, name, name, more, ())
            if not block.values["foreshortening"]:

                def spun(values: dict[str, float], name: str = name) -> list[Edit]:
                    return [Set(name, "nonlinear", True), Set(name, "foreshortening", True)]

                yield Candidate("centrifugal_stiffening", name, name, name, spun, ())
        if type(block).__name__ == "SpringDamper" and "HardeningSpring" in registry():
            size = block.values["stiffness"]

            def harder(values: dict[str, float], name: str = name) -> list[Edit]:
                return [
                    Replace(
                        name,
                        "HardeningSpring",
                        {"cubic_stiffness": with_unit(values["cubic_stiffness"], "N.m/rad3")},
                        ("rest_angle",),
                    )
                ]

            yield Candidate(
                "hardening_spring", name, name, name, harder, (Knob("cubic_stiffness", size, (1.0, 30.0, 1000.0)),)
            )

            def loose(values: dict[str, float], name: str = name) -> list[Edit]:
                return [
                    Replace(
                        name,
                        "Backlash",
                        {"half_gap": with_unit(values["half_gap"], "rad"), "law": "push_only"},
                        ("rest_angle",),
                    )
                ]

            yield Candidate("backlash", name, name, name, loose, (Knob("half_gap", 1.0, (0.001, 0.01, 0.03, 0.1)),))
