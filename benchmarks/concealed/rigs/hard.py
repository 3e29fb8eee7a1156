"""Cases at which the rules failed on rigs that nobody had tuned them for, each a rig of its own with fixed numbers.

=====================  ==============================================================================================
ridge                  voltage in, lossy gear, flexible link, Coulomb friction: from voltage in and angle out, torques,
                       inertias and stiffnesses scale together, and a fit that stops on that ridge loses the name
backlash-*, joint-*    the same rig with play, or a flexible joint, between gear and link; the encoder sits on the
                       motor's side or on the link's and is read at the other flange of the rigid node in two of four
four-flanges           a torque on an arm whose rotor, bearing and link hang on one node; a flexible joint within it
held-still             a geared rigid arm under a controller, held by friction between its moves
belt-cogging           two masses on a belt; cogging of the motor, many periods in each turn of the load
low-noise              an arm with Coulomb friction, and an encoder of 20 bit
stribeck-remainder     Stribeck friction so visible that a background of 1 % of it, a ten-thousandth of its square, lies
                       far above the sensors' noise
=====================  ==============================================================================================
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from zlib import crc32

from numpy.random import default_rng

from benchmarks.concealed.drawing import Options
from benchmarks.concealed.plants.base import Excitation, Habits, Sensor
from benchmarks.concealed.rigs import equip, wording
from benchmarks.concealed.rigs.numbers import Numbers
from benchmarks.concealed.rigs.rig import Rig
from benchmarks.concealed.rigs.topology import Probe, Topology, Transmission

PREFIX = "hard-"


@dataclass(frozen=True)
class Hard:
    """A hard case.

    Attributes:
        what: it is, in words.
        make: the rig.
        effects, sizes: concealed, as `benchmarks.concealed.case.draw` takes them.
        options: how it is recorded.
    """

    what: str
    make: Callable[[str], Rig]
    effects: tuple[str, ...]
    sizes: tuple[float, ...]
    options: Options = field(default_factory=Options)


def _finished(
    name: str, t: Topology, n: Numbers, sensors: tuple[Sensor, ...], excitation: Excitation, hidden: float = 0.03
) -> Rig:
    rig = Rig(name, t, n.values, n.units, n.fixed, {})
    rig.sensors, rig.excitation = sensors, excitation
    rig.habits = Habits(training=3, hidden=hidden)
    rig.blocks, rig.sites = wording.blocks(rig), rig.find_sites()
    return rig


def _motor(n: Numbers) -> None:
    n.put("motor.resistance", 3.2, "ohm")
    n.put("motor.torque_constant", 0.021, "N.m/A")
    n.put("motor.back_emf_constant", 0.021, "V.s/rad")
    n.put("motor.efficiency", 0.85, "1")
    n.put("motor.rotor_inertia", 1.5e-6, "kg.m2")
    n.put("motor.viscous_friction", 2e-6, "N.m.s/rad")


def _link(n: Numbers, rigidity: float = 0.35) -> None:
    n.fixed["link.length"] = 0.4
    n.put("link.mass", 0.08, "kg")
    n.put("link.flexural_rigidity", rigidity, "N.m2")
    n.put("link.hub_inertia", 8e-4, "kg.m2")
    n.put("link.damping_ratio", 0.015, "1")


def _geared_link(at: str, read: str) -> Callable[[str], Rig]:
    """Motor, lossy gear and flexible link; the encoder between gear and link sits at one flange, read at another."""

    def make(name: str) -> Rig:
        t = Topology(False, "V", [["motor.shaft", "gear1.input"], ["gear1.output", "link.hub"]])
        t.between = [Transmission("gear", "gear1", 50.0, lossy=True, massive=True)]
        t.bodies, t.link, t.cuts = {"motor.shaft": "motor"}, True, [1, 1]
        t.probes = [Probe("angle", at, read), Probe("strain", "link.hub", "link.hub")]
        n = Numbers()
        _motor(n)
        n.put("gear1.efficiency", 0.8, "1")
        n.put("gear1.inertia", 6e-4, "kg.m2")
        _link(n)
        n.put("gauge.sensitivity", 1.0, "V.m")
        sensors = (
            Sensor(f"{read}.angle", "enc", "count", counts=8192, at=at),
            Sensor("gauge.out", "strain", "V", noise=4e-3),
        )
        return _finished(name, t, n, sensors, Excitation(6.0, (0.15, 0.6), 0.3, 12.0, 0.06, 1e-3))

    return make


def _four_flanges(name: str) -> Rig:
    t = Topology(False, "N.m", [["drive.shaft", "rotor.shaft", "bearing1.shaft", "link.hub"]])
    t.bodies, t.bearings, t.link, t.cuts = {"rotor.shaft": "rotor"}, {"bearing1.shaft": "bearing1"}, True, [2]
    t.probes = [Probe("angle", "rotor.shaft", "rotor.shaft"), Probe("tip", "link.hub", "link.hub")]
    n = Numbers()
    n.put("rotor.inertia", 3e-3, "kg.m2")
    n.put("bearing1.viscous_friction", 4e-3, "N.m.s/rad")
    _link(n, 0.9)
    sensors = (
        Sensor("rotor.shaft.angle", "enc", "count", counts=16384, at="rotor.shaft"),
        Sensor("link.tip.position", "tip", "m", noise=2e-4, at="link.hub"),
    )
    return _finished(name, t, n, sensors, Excitation(0.05, (0.15, 0.6), 0.3, 10.0, 0.06, 1e-5))


def _held_still(name: str) -> Rig:
    t = Topology(False, "V", [["motor.shaft", "gear1.input"], ["gear1.output", "load.shaft"]])
    t.between = [Transmission("gear", "gear1", 70.0, massive=True)]
    t.bodies, t.cuts = {"motor.shaft": "motor", "load.shaft": "load"}, [1, 1]
    t.probes = [Probe("angle", "load.shaft", "load.shaft")]
    n = Numbers()
    _motor(n)
    n.put("gear1.inertia", 6e-4, "kg.m2")
    n.put("load.inertia", 9e-3, "kg.m2")
    sensors = (Sensor("load.shaft.angle", "enc", "count", counts=16384, at="load.shaft"),)
    rig = _finished(name, t, n, sensors, Excitation(6.0, (0.3, 1.0), 0.2, 4.0, 0.1, 1e-3))
    control = equip.control(rig, HARD_LOOP, default_rng(crc32(name.encode())))
    if control is None:
        raise ValueError(f"{name}: no controller was found")
    rig.control = replace(control, reference=0.6, limit=6.0)
    return rig


def _belt(name: str) -> Rig:
    t = Topology(False, "V", [["motor.shaft", "belt1.a"], ["belt1.b", "gear1.input"], ["gear1.output", "load.shaft"]])
    t.between = [Transmission("spring", "belt1"), Transmission("gear", "gear1", 4.0)]
    t.bodies, t.cuts = {"motor.shaft": "motor", "load.shaft": "load"}, [0, 0, 0]
    t.probes = [Probe("angle", "motor.shaft", "motor.shaft"), Probe("speed", "load.shaft", "load.shaft")]
    n = Numbers()
    _motor(n)
    n.values["motor.rotor_inertia"] = 8e-5
    n.put("belt1.stiffness", 0.9, "N.m/rad")
    n.put("belt1.damping", 6e-4, "N.m.s/rad")
    n.put("load.inertia", 2.4e-3, "kg.m2")
    sensors = (
        Sensor("motor.shaft.angle", "enc", "count", counts=4096, at="motor.shaft"),
        Sensor("load.shaft.speed", "gyro", "rad/s", noise=0.02, at="load.shaft"),
    )
    rig = _finished(name, t, n, sensors, Excitation(6.0, (0.15, 0.6), 0.3, 20.0, 0.05, 1e-3))
    rig.orders = (6, 12)
    return rig


def _arm(counts: int, hidden: float) -> Callable[[str], Rig]:
    def make(name: str) -> Rig:
        t = Topology(False, "N.m", [["drive.shaft", "rotor.shaft", "bearing1.shaft"]])
        t.bodies, t.bearings, t.cuts = {"rotor.shaft": "rotor"}, {"bearing1.shaft": "bearing1"}, [0]
        t.probes = [Probe("angle", "rotor.shaft", "rotor.shaft")]
        n = Numbers()
        n.put("rotor.inertia", 0.05, "kg.m2")
        n.put("bearing1.viscous_friction", 0.04, "N.m.s/rad")
        sensors = (Sensor("rotor.shaft.angle", "enc", "count", counts=counts, at="rotor.shaft"),)
        return _finished(name, t, n, sensors, Excitation(0.6, (0.2, 0.8), 0.3, 8.0, 0.08, 1e-5), hidden)

    return make


HARD_LOOP = Options(seconds=8.0, rate=500.0, loop="closed", kinds=("multi_step", "prbs", "ramp", "reversal", "coast"))
LONG = Options(seconds=8.0, rate=500.0, kinds=("multi_step", "chirp", "ramp", "prbs", "reversal"))
GEAR_LINK = "gear1.output -> link.hub"
MOTOR_SIDE, LINK_SIDE = "gear1.output", "link.hub"

HARD: dict[str, Hard] = {
    f"{PREFIX}ridge": Hard(
        "Coulomb friction begun on a ridge", _geared_link(MOTOR_SIDE, MOTOR_SIDE), ("coulomb_friction",), (300.0,), LONG
    ),
    f"{PREFIX}backlash-motor-side": Hard(
        "backlash, encoder before it and read there",
        _geared_link(MOTOR_SIDE, MOTOR_SIDE),
        (f"backlash@{GEAR_LINK}",),
        (10.0,),
        LONG,
    ),
    f"{PREFIX}backlash-link-side": Hard(
        "backlash, encoder before it, read on the link's side of the rigid node",
        _geared_link(MOTOR_SIDE, LINK_SIDE),
        (f"backlash@{GEAR_LINK}",),
        (10.0,),
        LONG,
    ),
    f"{PREFIX}joint-link-side": Hard(
        "flexible joint, encoder behind it and read there",
        _geared_link(LINK_SIDE, LINK_SIDE),
        (f"joint_flexibility@{GEAR_LINK}",),
        (10.0,),
        LONG,
    ),
    f"{PREFIX}joint-motor-side": Hard(
        "flexible joint, encoder before it, read on the link's side of the rigid node",
        _geared_link(MOTOR_SIDE, LINK_SIDE),
        (f"joint_flexibility@{GEAR_LINK}",),
        (10.0,),
        LONG,
    ),
    f"{PREFIX}four-flanges": Hard(
        "flexible joint within a node of four flanges", _four_flanges, ("joint_flexibility",), (10.0,), LONG
    ),
    f"{PREFIX}held-still": Hard(
        "closed-loop arm held by friction", _held_still, ("coulomb_friction",), (1500.0,), HARD_LOOP
    ),
    f"{PREFIX}belt-cogging": Hard(
        "belt axis with cogging", _belt, ("torque_ripple@motor.shaft",), (300.0,), replace(LONG, rate=1000.0)
    ),
    f"{PREFIX}low-noise": Hard(
        "Coulomb friction at very low noise", _arm(2**20, 0.001), ("coulomb_friction",), (2e5,), LONG
    ),
    f"{PREFIX}stribeck-remainder": Hard(
        "Stribeck friction with a remainder of 0.01 %", _arm(2**16, 0.01), ("stribeck_friction",), (2e4,), LONG
    ),
}


@functools.cache
def hard(name: str) -> Rig:
    """The rig of a hard case."""
    return HARD[name].make(name)
