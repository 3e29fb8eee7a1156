"""What may be missing: each effect as edits to the scenario, at every place where it can act.

An effect is an ordinary block or block option. Its parameters start from sizes that matter in the recordings at hand: a
share of the driving signal's range, or of the torques that act at the place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blocks.registry import registry
from diagnosis.problem import Free
from diagnosis.surroundings import Surroundings
from scenarios.amend import AtFlange, Between, Edit, InSignal, OnSensor, Replace, Set

NAME = "found"
"""First part of the name of every block that is put in."""


@dataclass(frozen=True)
class Knob:
    """A parameter of an inserted effect: tried at ``reference`` times each of ``shares``, then fitted.

    Attributes:
        parameter: of the inserted or changed block.
        reference: a size that matters (SI).
        shares: multiples of it to start from.
        signed: whether it may be negative; else it stays positive and moves on a logarithmic scale.
        fixed: whether it is only chosen among its starting sizes: the model has no derivative with respect to it.
    """

    parameter: str
    reference: float
    shares: tuple[float, ...]
    signed: bool = False
    fixed: bool = False


@dataclass(frozen=True)
class Candidate:
    """An effect at a place.

    Attributes:
        effect: machine name.
        place: where, in the words of the block diagram.
        block: the block of the user's scenario it belongs to.
        name: of the block that is put in or changed.
        edits: what to do to the scenario, with starting values in place of ``{parameter}``.
        knobs: its parameters.
        loosened: for ``wrong_parameter``, the parameter that may leave its tolerance.
    """

    effect: str
    place: str
    block: str
    name: str
    edits: Callable[[dict[str, float]], list[Edit]]
    knobs: tuple[Knob, ...]
    loosened: Free | None = None

    @property
    def key(self) -> str:
        """Effect and place, for tables."""
        return f"{self.effect} at {self.place}"

    def free(self, starts: dict[str, float]) -> list[Free]:
        """The parameters to fit, from given starting values."""
        rows = [self.loosened] if self.loosened else []
        for knob in self.knobs:
            if knob.fixed:
                continue
            value = starts[knob.parameter]
            name = f"{self.name}.{knob.parameter}"
            if knob.signed:
                rows.append(Free(name, value, max(0.2 * abs(value), 0.02 * knob.reference), False, prior=False))
            else:
                rows.append(Free(name, value, 0.3, True, 0.0, 1e4 * knob.reference, prior=False))
        return rows


def candidates(around: Surroundings) -> list[Candidate]:
    """Every effect of the catalogue at every place of the scenario where it can act."""
    rows: list[Candidate] = []
    for target, size in around.inputs.items():
        rows += _at_input(around, target, size)
    for flange in around.groups:
        rows += _at_shaft(around, flange)
    rows += _at_joints(around)
    rows += _at_links(around)
    rows += _parameters(around)
    for channel in around.problem.model.outputs:
        rows += _at_sensor(around, channel.name)
    known = registry()
    return [c for c in rows if all(_type(e) in known for e in c.edits({k.parameter: k.reference for k in c.knobs}))]


def _type(edit: Edit) -> str:
    return "Gain" if isinstance(edit, Set) else edit.type


def _unit(value: float, unit: str) -> str:
    return f"{float(value):.10g} {unit}" if unit not in ("1", "", "*") else f"{float(value):.10g}"


def _in(name: str, kind: str, target: str, unit: str, keys: dict[str, str], fixed: dict[str, Any] | None = None) -> Any:
    """Edits that put a block into a signal; ``keys`` gives the unit of each parameter."""

    def edits(values: dict[str, float]) -> list[Edit]:
        made = {key: _unit(values[key], keys[key] or unit) for key in keys if key in values}
        return [InSignal(name, kind, target, {**(fixed or {}), **made})]

    return edits


def _at_input(around: Surroundings, target: str, size: float) -> Iterator[Candidate]:
    unit = next(v.unit for v in around.problem.model.inputs if v.name == target)
    block = around.problem.scenario.system.split(target)[0]
    place = f"signal -> {target}"

    def made(effect: str, kind: str, keys: dict[str, str], *knobs: Knob, **fixed: Any) -> Candidate:
        name = f"{NAME}_{effect}"
        return Candidate(effect, place, block, name, _in(name, kind, target, unit, keys, fixed), knobs)

    few, band = (0.03, 0.1, 0.3), (0.02, 0.08, 0.2)
    yield made(
        "dead_zone", "DeadZone", {"lower": "", "upper": ""}, Knob("lower", -size, band, True), Knob("upper", size, band)
    )
    yield made(
        "saturation",
        "Saturation",
        {"lower": "", "upper": ""},
        Knob("lower", -size, (0.9, 0.7), True),
        Knob("upper", size, (0.9, 0.7)),
    )
    yield made("offset", "Offset", {"offset": ""}, Knob("offset", size, (0.02, -0.02), True))
    yield made(
        "uneven_gain", "UnevenGain", {"forward": "1", "backward": "1"}, Knob("backward", 1.0, (0.95, 1.05)), forward=1.0
    )
    yield made("lag", "LowPass", {"corner_frequency": "rad/s"}, Knob("corner_frequency", 100.0, (*few, 1.0, 3.0)))
    sample = min(e.step * e.every for e in around.problem.experiments)
    waits = tuple(float(n) for n in (1, 2, 3, 5, 8, 12, 20))
    wait = Knob("delay", sample, waits, fixed=True)
    yield made("delay", "Delay", {"delay": "s"}, wait, period=_unit(sample, "s"))
    system = around.problem.scenario.system
    if type(system.blocks[block]).__name__ == "DCMotor" and system.blocks[block].values["inductance"] == 0:
        reference = system.blocks[block].values["resistance"] * 1e-3

        def edits(values: dict[str, float]) -> list[Edit]:
            return [Set(block, "inductance", _unit(values["inductance"], "H"))]

        yield Candidate("inductance", block, block, block, edits, (Knob("inductance", reference, (1.0, 5.0)),))


def _at_shaft(around: Surroundings, flange: str) -> Iterator[Candidate]:
    block = around.problem.scenario.system.split(flange)[0]
    torque, speed, angle, inertia = (d[flange] for d in (around.torque, around.speed, around.angle, around.inertia))

    def made(
        effect: str, kind: str, units: dict[str, str], *knobs: Knob, port: str = "shaft", **fixed: Any
    ) -> Candidate:
        name = f"{NAME}_{effect}"

        def edits(values: dict[str, float]) -> list[Edit]:
            given = {key: _unit(values[key], unit) for key, unit in units.items() if key in values}
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


def _at_joints(around: Surroundings) -> Iterator[Candidate]:
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
        given = {key: _unit(values[key], _UNITS[key]) for key in _UNITS if key in values}
        return [Between(name, kind, cut, "a", "b", {**fixed, **given})]

    return edits


def _at_links(around: Surroundings) -> Iterator[Candidate]:
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
                        {"cubic_stiffness": _unit(values["cubic_stiffness"], "N.m/rad3")},
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
                        {"half_gap": _unit(values["half_gap"], "rad"), "law": "push_only"},
                        ("rest_angle",),
                    )
                ]

            yield Candidate("backlash", name, name, name, loose, (Knob("half_gap", 1.0, (0.001, 0.01, 0.03, 0.1)),))


def _parameters(around: Surroundings) -> Iterator[Candidate]:
    """Each parameter with a tolerance, let go of it."""
    for f in around.problem.free:
        if f.recording:
            continue
        block = f.name.rpartition(".")[0]
        free = replace(f, prior=False)
        yield Candidate("wrong_parameter", f.name, block or f.name, block or f.name, lambda values: [], (), free)


def _at_sensor(around: Surroundings, signal: str) -> Iterator[Candidate]:
    unit = next(v.unit for v in around.problem.model.outputs if v.name == signal)
    k = [v.name for v in around.problem.model.outputs].index(signal)
    measured = [e.measured[:, k] for e in around.problem.chosen("train", "repeat")]
    size = max(float(np.nanmax(np.abs(m))) for m in measured) or 1.0
    for effect, kind, key, key_unit, knob in (
        ("sensor_bias", "Offset", "offset", unit, Knob("offset", size, (0.02, -0.02), True)),
        ("sensor_scale", "Gain", "gain", "1", Knob("gain", 1.0, (1.05, 0.95))),
        ("rectified_sensor", "RectifiedSensor", "sensitivity", "1", Knob("sensitivity", 1.0, (1.0,))),
        ("sensor_lag", "LowPass", "corner_frequency", "rad/s", Knob("corner_frequency", 100.0, (0.3, 1.0, 3.0))),
    ):
        name = f"{NAME}_{effect}"

        def edits(
            values: dict[str, float], name: str = name, kind: str = kind, key: str = key, u: str = key_unit
        ) -> list[Edit]:
            return [OnSensor(name, kind, signal, {key: _unit(values[key], u)})]

        yield Candidate(effect, signal, signal, name, edits, (knob,))
