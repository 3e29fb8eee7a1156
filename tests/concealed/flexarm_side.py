"""The other side of the comparison: what flexarm's own blocks say about a case, true parameters and effects put in."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.concealed.scenario import text, write
from benchmarks.concealed.truth import MAXWELL_BAND, Nuisance, fine
from diagnosis.binding import bind, row_interval
from diagnosis.recordings.mapping import from_scenario
from diagnosis.recordings.types import Recording
from engine.simulate import simulate
from scenarios.amend import AtFlange, Between, Feed, InSignal, OnSensor, Replace, Set, Wire, amended
from scenarios.load import load

NOT_IN_THE_LIBRARY = frozenset({"rectified_sensor"})


SLIDING = {
    "BearingFriction": ("TranslationalBearingFriction", "slide"),
    "QuadraticDrag": ("TranslationalQuadraticDrag", "slide"),
    "GroundSpring": ("TranslationalGroundSpring", "slide"),
    "SpringDamper": ("TranslationalSpringDamper", "a"),
    "Backlash": ("TranslationalBacklash", "a"),
    "EndStop": ("TranslationalEndStop", "slide"),
    "WarmingFriction": ("TranslationalWarmingFriction", "slide"),
}
UNITS = {
    "N.m": "N",
    "N.m.s/rad": "N.s/m",
    "N.m.s2/rad2": "N.s2/m2",
    "N.m/rad": "N/m",
    "rad": "m",
    "rad/s": "m/s",
}


def slid(type_: Any, parameters: Any, port: Any) -> Any:
    """A block of rotation and its parameters, told for a slide."""
    if type_ not in SLIDING:
        return type_, parameters, port
    kind, flange = SLIDING[type_]
    made = {}
    for key, value in parameters.items():
        number, _, unit = str(value).partition(" ")
        made[key] = f"{number} {UNITS.get(unit, unit)}" if unit else value
    return kind, made, flange if port == "shaft" else port


def winding(true: Any) -> Any:
    """What a law before a motor's voltage is told of its winding."""
    back_emf = true.get("motor.back_emf_constant", true["motor.torque_constant"])
    return {"resistance": f"{true['motor.resistance']} ohm", "back_emf_constant": f"{back_emf} V.s/rad"}


def edits_for(concealed: Any, plant: Any, true: Any = None) -> Any:
    """The effect in flexarm's words."""
    p, place, effect = concealed.parameters, concealed.place, concealed.effect
    unit, ground = plant.drive_unit, f"{plant.drive}"
    sensor = {s.signal: s for s in plant.sensors}.get(place)
    signal_unit = "rad" if sensor and sensor.counts else getattr(sensor, "unit", "")
    corner = f"{p.get('corner_frequency')} rad/s"
    spring = {"stiffness": f"{p.get('stiffness')} N.m/rad", "damping": f"{p.get('damping', 0.0)} N.m.s/rad"}

    def joint(type_: Any, parameters: Any, drop: Any = ()) -> list[Between] | list[Replace]:
        if " -> " in place:
            return [Between("x", type_, place.split(" -> ")[0], "a", "b", parameters)]
        return [Replace(place, type_, parameters, drop)]

    def friction(**levels: Any) -> list[AtFlange]:
        return [AtFlange("x", "BearingFriction", place, "shaft", levels)]

    if effect in ("dead_zone", "saturation"):
        kind = {"dead_zone": "DeadZone", "saturation": "Saturation"}[effect]
        return [InSignal("x", kind, ground, {"lower": f"{p['lower']} {unit}", "upper": f"{p['upper']} {unit}"})]
    if effect == "uneven_gain":
        return [InSignal("x", "UnevenGain", ground, {"forward": p["forward"], "backward": p["backward"]})]
    if effect == "offset":
        return [InSignal("x", "Offset", ground, {"offset": f"{p['offset']} {unit}"})]
    if effect == "lag":
        return [InSignal("x", "LowPass", ground, {"corner_frequency": corner})]
    if effect == "delay":
        return [InSignal("x", "Delay", ground, {"delay": f"{p['delay']} s", "period": "0.1 ms"})]
    if effect == "inductance":
        return [Set("motor", "inductance", f"{p['inductance']} H")]
    if effect == "viscous_friction":
        return friction(viscous_friction=f"{p['viscous_friction']} N.m.s/rad")
    if effect in ("coulomb_friction", "stribeck_friction", "direction_dependent_friction"):
        units = {"stribeck_velocity": "rad/s"}
        return friction(**{key: f"{value} {units.get(key, 'N.m')}" for key, value in p.items()})
    if effect == "quadratic_drag":
        return [AtFlange("x", "QuadraticDrag", place, "shaft", {"drag": f"{p['drag']} N.m.s2/rad2"})]
    if effect == "gravity":
        law = {"mass": f"{p['moment'] / 9.81} kg", "radius": "1 m", "hanging_angle": f"{p['hanging_angle']} rad"}
        return [AtFlange("x", "GravityTorque", place, "shaft", law)]
    if effect == "stray_spring":
        return [AtFlange("x", "GroundSpring", place, "shaft", {"stiffness": f"{p['stiffness']} N.m/rad"})]
    if effect in ("load_dependent_friction", "quadratic_load_friction"):
        law = {"coefficient": p["coefficient"], "coulomb_friction": f"{p['coulomb_friction']} N.m"}
        law["quadratic_coefficient"] = f"{p.get('quadratic_coefficient', 0.0)} 1/(N.m)"
        made: list[Any] = [AtFlange("x", "LoadDependentFriction", place, "shaft", law)]
        if place == "motor.shaft":
            return [*made, Wire("w", ("motor.torque", "x.load"))]
        return [
            InSignal("y", "Offset", ground, {"offset": f"0 {unit}"}),
            *made,
            Wire("w", ("y.out", "x.load")),
        ]
    if effect == "rate_limit":
        rate = {"rising": f"{p['rate']} {unit}/s", "time_constant": "0.5 us"}
        return [InSignal("x", "RateLimiter", ground, rate)]
    if effect == "command_quantisation":
        return [InSignal("x", "Quantiser", ground, {"step": f"{p['step']} {unit}"})]
    if effect == "supply_sag":
        bus = {"source_voltage": f"{p['voltage']} V", "resistance": f"{p['resistance']} ohm"}
        bus["capacitance"] = f"{2e-5 / p['resistance']} F"
        return [
            InSignal("duty", "Gain", ground, {"gain": f"{1 / p['voltage']} 1/V", "unit": "1"}),
            InSignal("x", "Bridge", ground, entry="duty"),
            Feed("bus", "Supply", "x.supply", bus, exit="voltage"),
            Wire("w", ("motor.current", "x.current")),
            Wire("v", ("x.supply_current", "bus.current")),
        ]
    if effect == "belt_slack":
        return [Set(place, "pretension", f"{p['pretension']} N")]
    if effect == "transmission_error":
        wave = {"amplitude": f"{p['amplitude']} rad", "order": p["order"], "phase": f"{p['phase']} rad"}
        return [Set(place, "error_waves", 1), *(Set(place, f"error_{key}", [value]) for key, value in wave.items())]
    if effect == "end_stop":
        law = {"lower": f"{p['lower']} rad", "upper": f"{p['upper']} rad"}
        law |= {"stiffness": f"{p['stiffness']} N.m/rad", "damping": f"{p['damping']} N.m.s/rad"}
        return [AtFlange("x", "EndStop", place, "shaft", law)]
    if effect == "warm_up":
        thermal = {
            "winding_heat_capacity": f"{p['capacity']} J/K",
            "winding_thermal_resistance": f"{p['insulation']} K/W",
            "housing_heat_capacity": f"{p['housing']} J/K",
            "housing_thermal_resistance": f"{p['cooling']} K/W",
            "magnet_coefficient": "0 1/K",
        }
        return [Replace("motor", "ThermalDCMotor", thermal)]
    if effect == "friction_warm_up":
        law = {"temperature_coefficient": f"{p['coefficient']} 1/K", "heat_capacity": f"{p['capacity']} J/K"}
        law["thermal_resistance"] = f"{p['resistance']} K/W"
        return [Replace(place.partition(".")[0], "WarmingFriction", law)]
    if effect == "current_limit":
        law = {"current_limit": f"{p['current_limit']} A"} | winding(true)
        return [InSignal("x", "CurrentLimiter", ground, law), Wire("w", ("motor.shaft.speed", "x.speed"))]
    if effect == "dead_time":
        law = {"lost_voltage": f"{p['lost_voltage']} V", "ripple_current": f"{p['ripple_current']} A"} | winding(true)
        if getattr(plant, "fixed", {}).get("motor.inductance"):
            return [
                InSignal("x", "DeadTime", ground, {**law, "inductance": True}),
                Wire("w", ("motor.current", "x.current")),
            ]
        return [InSignal("x", "DeadTime", ground, law), Wire("w", ("motor.shaft.speed", "x.speed"))]
    if effect in ("torque_ripple", "cogging"):
        law = {"amplitude": f"{p['amplitude']} N.m", "order": p["order"], "phase": f"{p['phase']} rad"}
        return [AtFlange("x", "TorqueRipple", place, "shaft", law)]
    if effect == "outside_vibration":
        wave = {"frequency": f"{p['frequency']} Hz", "phase": f"{p['phase']} rad"}
        wave["amplitude"] = f"{p['amplitude']} N.m"
        return [AtFlange("x", "Torque", place, "shaft"), InSignal("y", "Sine", "x.torque", wave)]
    if effect == "joint_flexibility":
        return joint("SpringDamper", spring)
    if effect == "backlash":
        return joint("Backlash", spring | {"half_gap": f"{p['half_gap']} rad", "law": "push_only"})
    if effect == "hardening_spring":
        return joint("HardeningSpring", spring | {"cubic_stiffness": f"{p['cubic_stiffness']} N.m/rad3"})
    if effect == "hysteresis":
        shape = {key: p[key] for key in ("residual_share", "sharpness", "unloading_share")}
        return joint("BoucWenSpring", spring | shape | {"yield_twist": f"{p['yield_twist']} rad"})
    if effect == "structural_damping":
        low, high = MAXWELL_BAND
        band = {"lowest_frequency": f"{low} rad/s", "highest_frequency": f"{high} rad/s", "elements": 17}
        return joint("StructuralSpring", {"loss_factor": p["loss_factor"]} | band, ("damping",))
    if effect == "extra_mode" and "modes" in p:
        return [Set(place, "modes", 2)]
    if effect == "extra_mode":
        inertia = {"inertia": f"{p['inertia']} kg.m2"}
        return [AtFlange("x", "SpringDamper", place, "a", spring), AtFlange("y", "Inertia", "x.b", "shaft", inertia)]
    if effect == "centrifugal_stiffening":
        return [Set(place, "nonlinear", True), Set(place, "foreshortening", True)]
    if effect == "payload":
        return [Set(place, "payload", f"{p['payload']} kg")]
    if effect == "sensor_bias":
        return [OnSensor("x", "Offset", place, {"offset": f"{p['bias']} {signal_unit}"})]
    if effect == "sensor_scale":
        return [OnSensor("x", "Gain", place, {"gain": p["scale"]})]
    assert effect == "sensor_lag"
    return [OnSensor("x", "LowPass", place, {"corner_frequency": corner})]


def simulated(case: Any, folder: Any, concealed: Any = (), internal_step: Any = None) -> Any:
    """flexarm's outputs for the case's recordings, in units of the floor, one array per recording."""
    exact = replace(case, nominal=dict(case.truth.parameters))
    write(exact, folder / "case", folder / "answers")
    file = folder / "case" / "scenario.yaml"
    source = text(exact)
    for c in concealed:
        edits = edits_for(c, case.plant, case.truth.parameters)
        for edit in edits:
            if c.place.endswith((".flange", ".slide")):
                kind, parameters, port = slid(edit.type, edit.parameters, getattr(edit, "port", ""))
                edit = replace(edit, type=kind, parameters=parameters, **({"port": port} if port else {}))
            if edit.name == "y" and isinstance(edit, InSignal) and edit.type == "Sine":
                source = _driven(source, edit)
            else:
                source = amended(source, [edit])
    file.write_text(source)
    scenario = load(str(file))
    out = []
    for recorded in case.recordings:
        recording = from_scenario(scenario, recorded.name)
        assert isinstance(recording, Recording)
        made = bind(scenario, recording)
        step, every = row_interval(recording.time, 1e-3)
        stop = step * every * (len(recording.time) - 1)
        run = simulate(made.model, stop, step, drive=made.drive, internal_step=internal_step)
        out.append(np.asarray(run.values)[::every] / case.bench.sigma)
    return out


def _driven(source: Any, edit: Any) -> Any:
    """A source block on an input that nothing drives yet."""
    import io

    from ruamel.yaml import YAML

    yaml = YAML(typ="rt")
    document = yaml.load(source)
    document["blocks"][edit.name] = {"type": edit.type, **edit.parameters}
    document["connect"].append([f"{edit.name}.out", edit.target])
    out = io.StringIO()
    yaml.dump(document, out)
    return out.getvalue()


def clean(case: Any) -> Any:
    """The truth's own outputs without noise and disturbances, in units of the floor."""
    truth = replace(case.truth, nuisance=Nuisance())
    return case.bench.outputs(truth, fine(truth))


def difference(a: Any, b: Any) -> float:
    """Root mean square difference, in floors."""
    return float(np.sqrt(np.mean(np.concatenate([np.ravel(x - y) for x, y in zip(a, b, strict=True)]) ** 2)))
