"""The blocks and connections of a rig's scenario."""

from __future__ import annotations

from benchmarks.concealed.rigs.rig import Rig

_KINDS = {"gear": "Gear", "mesh": "Gear", "pulley": "Pulley", "belt": "Belt"}
_SOURCE = {"V": "1 V", "A": "1 A", "N.m": "1 N.m", "N": "1 N"}


def blocks(rig: Rig) -> str:
    """The text that a scenario has between ``blocks:`` and its recordings; parameters as ``{block.key}``."""
    t, lines, wires = rig.topology, [], []
    lines.append(_line("source", "Step", f"height: {_SOURCE[t.drive]}", "stop: 1 s"))
    wires.append(f"[source.out, {rig.drive}]")
    if t.drive == "A":
        lines.append(_line("amplifier", "Gain", _value(rig, "amplifier.gain"), "unit: N.m"))
        wires.append("[amplifier.out, drive.torque]")
    if t.drive != "V":
        lines.append(_line("drive", "Force" if t.drive == "N" else "Torque"))
    for flange, body in t.bodies.items():
        lines.append(_body(rig, body, t.turns(flange)))
    for flange, name in t.bearings.items():
        kind = "BearingFriction" if t.turns(flange) else "TranslationalBearingFriction"
        lines.append(_line(name, kind, _value(rig, f"{name}.viscous_friction")))
    for part in t.between:
        given = [f"ratio: {part.ratio!r}"] if part.kind in ("gear", "mesh") else []
        given += [f"radius: {1 / part.ratio:.6g} m"] if part.kind == "pulley" else []
        given += [_value(rig, f"{part.name}.efficiency")] if part.lossy else []
        given += [_value(rig, f"{part.name}.inertia")] if part.massive else []
        given += [_value(rig, f"{part.name}.{key}") for key in ("stiffness", "damping") if part.gives]
        lines.append(
            _line(part.name, _KINDS.get(part.kind, "TranslationalSpringDamper" if t.slides else "SpringDamper"), *given)
        )
    if t.link:
        keys = ("mass", "flexural_rigidity", "hub_inertia", "damping_ratio")
        values = [f"length: {rig.fixed['link.length']!r} m", *(_value(rig, f"link.{key}") for key in keys)]
        lines.append(_line("link", "AssumedModesLink", *values, "modes: 1"))
    for probe in t.probes:
        if probe.kind == "tacho":
            lines.append(_line("tacho", "Tachometer", _value(rig, "tacho.sensitivity")))
        elif probe.kind == "acceleration" and not t.turns(probe.at):
            lines.append(_line("accelerometer", "TranslationalAccelerometer"))
        elif probe.kind == "acceleration":
            radius = f"radius: {rig.fixed['accelerometer.radius']!r} m"
            lines.append(_line("accelerometer", "Accelerometer", radius))
        elif probe.kind == "strain":
            lines.append(_line("gauge", "StrainGauge", _value(rig, "gauge.sensitivity")))
            wires.append("[link.root.curvature, gauge.curvature]")
    wires += [f"[{', '.join(node)}]" for node in t.nodes if len(node) > 1]
    text = "\n".join(lines) + "\n\nconnect:\n" + "\n".join(f"  - {wire}" for wire in wires)
    return f"\n{text}\n"


def _line(name: str, kind: str, *given: str) -> str:
    return f"  {name}: {{{{" + ", ".join([f"type: {kind}", *given]) + "}}"


def _value(rig: Rig, name: str) -> str:
    unit = rig.units[name]
    return f"{name.rpartition('.')[2]}: {{{name}}}" + ("" if unit == "1" else f" {unit}")


def _body(rig: Rig, body: str, turns: bool) -> str:
    if body != "motor":
        kind, key = ("Inertia", "inertia") if turns else ("Mass", "mass")
        return _line(body, kind, _value(rig, f"{body}.{key}"))
    keys = ("resistance", "torque_constant", "back_emf_constant", "efficiency", "rotor_inertia", "viscous_friction")
    given = [_value(rig, f"motor.{key}") for key in keys if f"motor.{key}" in rig.units]
    if rig.fixed.get("motor.inductance"):
        given.append(f"inductance: {rig.fixed['motor.inductance']!r} H")
    return _line("motor", "DCMotor", *given)
