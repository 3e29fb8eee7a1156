"""A drawn rig as a plant: its topology as a mechanism, as a scenario, and the places where effects may be concealed."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.concealed import beam
from benchmarks.concealed.mechanism import Mechanism, Port, Readout
from benchmarks.concealed.plants.base import (
    Body,
    Control,
    Excitation,
    Habits,
    JointLaw,
    LinkOptions,
    Plant,
    Quantity,
    Sensor,
    Sites,
    plain_spring,
)
from benchmarks.concealed.plants.srv02 import combined, flexible_link
from benchmarks.concealed.rigs.topology import DRIVES, Piece, Probe, Topology

ORDERS = {"angle": 0, "speed": 1, "tacho": 1, "acceleration": 2, "tip": 0, "tip_acceleration": 2, "strain": 0}

TOLERANCES = {
    "resistance": 0.15,
    "torque_constant": 0.15,
    "back_emf_constant": 0.15,
    "efficiency": 0.10,
    "rotor_inertia": 0.10,
    "viscous_friction": 0.30,
    "gain": 0.20,
    "inertia": 0.10,
    "mass": 0.10,
    "stiffness": 0.20,
    "damping": 0.30,
    "flexural_rigidity": 0.20,
    "hub_inertia": 0.10,
    "damping_ratio": 0.50,
    "sensitivity": 0.05,
}
"""Tolerances as the blocks declare them, by the parameter's key."""

PECULIAR = {"gauge.sensitivity": 0.10, "belt.damping": 0.50, "gear1.stiffness": 0.30, "gear1.damping": 0.50}
"""Those of a strain gauge, a toothed belt and an elastic gear, which declare others."""

SLIDING = frozenset(
    {
        "dead_zone",
        "saturation",
        "uneven_gain",
        "offset",
        "delay",
        "lag",
        "coulomb_friction",
        "stribeck_friction",
        "direction_dependent_friction",
        "viscous_friction",
        "quadratic_drag",
        "stray_spring",
        "joint_flexibility",
        "backlash",
        "sensor_bias",
        "sensor_scale",
        "sensor_lag",
        "rectified_sensor",
    }
)
"""What can be concealed where bodies slide: the effects for which a scenario has a block there today."""

TURNING_ONLY = (
    "gravity",
    "torque_ripple",
    "outside_vibration",
    "extra_mode",
    "hardening_spring",
    "hysteresis",
    "structural_damping",
)


def key_of(name: str) -> str:
    """The last part of a parameter's name."""
    return name.rpartition(".")[2]


class Rig(Plant):
    """A plant whose topology and numbers were drawn.

    Args:
        name: ``rig-SEED``.
        topology: what it consists of.
        values: nominal parameters (SI), those with a tolerance.
        units: of these, as the scenario spells them.
        fixed: values without a tolerance.
        spread: of the parameters whose truth differs by more than the usual share.
    """

    def __init__(
        self,
        name: str,
        topology: Topology,
        values: Mapping[str, float],
        units: Mapping[str, str],
        fixed: Mapping[str, float],
        spread: Mapping[str, float],
    ) -> None:
        """Everything but sensors, excitation, control and habits, which follow from what the rig does."""
        self.topology, self.name, self.fixed = topology, name, dict(fixed)
        self.cuts = {topology.cut(i): (i, topology.far(i)) for i, after in enumerate(topology.cuts) if after}
        self.orders = (1, 2, 3, 4, 6, 12)
        self.units = dict(units)
        self.title = f"{'A slide' if topology.slides else 'A drive'} of {_count(topology)}"
        self.drive, self.drive_unit = DRIVES[topology.drive], topology.drive
        self.parameters = tuple(
            Quantity(
                key,
                value,
                units[key],
                _tolerance(key),
                spread.get(key, 0.30 if key_of(key) in ("damping", "damping_ratio", "viscous_friction") else 0.10),
                0.99 if key_of(key) == "efficiency" else float("inf"),
            )
            for key, value in values.items()
        )
        self.sensors: tuple[Sensor, ...] = ()
        self.excitation = Excitation(1.0, (0.1, 0.5), 0.5, 10.0, 0.05, 1e-6)
        self.control = Control("", 0.0, 0.0, 0.0, 0.0, 0.0)
        self.habits = Habits()
        self.main = _main(topology)
        self.sites = Sites(f"source.out -> {self.drive}", ())
        self.inductance = 0.0

    # -- the mechanism ------------------------------------------------------------------------------------------------

    def assemble(
        self, p: Mapping[str, float], laws: Mapping[str, JointLaw], link: LinkOptions, inductance: float
    ) -> Body:
        """Coordinates from the load to the drive: one for each body that a spring, or a cut that gives, sets free."""
        t, m = self.topology, Mechanism()
        ports: dict[str, Port] = {}
        meshes: dict[str, tuple[Port, Port]] = {}
        here, turned, loose = m.coordinate("end"), 1.0, True
        m.released = {0: 1.0} if self.habits.preload else None
        for index in reversed(range(len(t.nodes))):
            ports |= self._node(m, index, here, laws, turned if loose else 0.0)
            here = ports[t.nodes[index][0]]
            if not index:
                break
            part = t.between[index - 1]
            if not part.gives:
                here = here.geared(part.ratio, p[f"{part.name}.efficiency"] if part.lossy else 1.0)
                turned *= part.ratio
            else:
                loose = False  # what is twisted at the start is the last spring of the chain
                values = p[f"{part.name}.stiffness"], p[f"{part.name}.damping"]
                behind = here
                here = self._parted(m, here, laws.get(part.name, plain_spring), 0.0, *values, ratio=part.ratio)
                if part.kind == "mesh":
                    meshes[part.name] = here, here.geared(1 / part.ratio).against(behind)
        for flange, body in t.bodies.items():
            m.inertia(ports[flange], p[f"{body}.{self._inertial(body)}"])
        for part in t.between:
            if part.massive:
                m.inertia(ports[part.ends[1]], p[f"{part.name}.inertia"])
        for flange, bearing in t.bearings.items():
            m.spring(ports[flange], 0.0, p[f"{bearing}.viscous_friction"])
        self._drive(m, ports[t.nodes[0][0]], p, inductance)
        made, amplitudes = self._link(m, ports.get("link.hub"), p, link)
        signals = {s.signal: self._reading(s, ports, p, made, amplitudes) for s in self.sensors}
        return Body(m, ports, signals, meshes)

    @staticmethod
    def _inertial(body: str) -> str:
        if body == "motor":
            return "rotor_inertia"
        return "mass" if body in ("carriage", "table", "stage", "head") else "inertia"

    def pieces(self, index: int, places: Iterable[str]) -> list[Piece]:
        """What is left of a node where all of these places that are its cuts give.

        Raises:
            ValueError: the cuts cross, or two of them are the same.
        """
        mine = {place: self.cuts[place] for place in places if place in self.cuts}
        return self.topology.pieces(index, {place: far for place, (i, far) in mine.items() if i == index})

    def _node(
        self, m: Mechanism, index: int, here: Port, laws: Mapping[str, JointLaw], turned: float
    ) -> dict[str, Port]:
        """The flanges of a node, whose last one is ``here``: a coordinate for each piece that its cuts set free."""
        pieces = self.pieces(index, laws)
        at = [here]
        for piece in pieces[1:]:
            at.append(self._parted(m, at[piece.beside], laws[piece.place], turned, away=piece.far))
        return {f: port for piece, port in zip(pieces, at, strict=True) for f in piece.flanges}

    def _parted(
        self,
        m: Mechanism,
        behind: Port,
        law: JointLaw,
        turned: float,
        stiffness: float = 0.0,
        damping: float = 0.0,
        ratio: float = 1.0,
        away: bool = False,
    ) -> Port:
        """A new coordinate towards the drive, joined to what lies behind it, ``ratio`` times as fast; or ``away`` from
        the drive, joined to what lies before it."""
        new = m.coordinate(f"part{len(m.names)}")
        if m.released is not None:
            m.released[len(m.names) - 1] = turned
        twist = behind.against(new) if away else new.geared(1 / ratio).against(behind)
        law(m, twist, stiffness, damping)
        return new

    def _drive(self, m: Mechanism, port: Port, p: Mapping[str, float], inductance: float) -> None:
        if self.drive_unit != "V":
            gain = p["amplifier.gain"] if self.drive_unit == "A" else 1.0
            m.torque(Port(port.sense, {i: gain * c for i, c in port.act.items()}))
            return
        m.spring(port, 0.0, p["motor.viscous_friction"])
        constant, known = p["motor.torque_constant"], self.fixed.get("motor.inductance", 0.0)
        torque, back_emf = p.get("motor.efficiency", 1.0) * constant, p.get("motor.back_emf_constant", constant)
        m.motor(port, p["motor.resistance"], known or inductance, torque, back_emf)

    def _link(
        self, m: Mechanism, hub: Port | None, p: Mapping[str, float], link: LinkOptions
    ) -> tuple[beam.Modes | None, list[Port]]:
        if hub is None:
            return None, []
        m.inertia(hub, p["link.hub_inertia"])
        made = beam.modes(
            self.fixed["link.length"], p["link.mass"], p["link.flexural_rigidity"], link.payload, link.modes
        )
        return made, flexible_link(m, hub, made, p["link.damping_ratio"], link.centrifugal)

    def _reading(
        self,
        sensor: Sensor,
        ports: Mapping[str, Port],
        p: Mapping[str, float],
        made: beam.Modes | None,
        amplitudes: list[Port],
    ) -> Readout:
        probe = self.probe(sensor.signal)
        order, port = ORDERS[probe.kind], ports[probe.at]
        if made is not None and probe.kind in ("strain", "tip", "tip_acceleration"):
            length = self.fixed["link.length"]
            if probe.kind == "strain":
                return combined(port, 0.0, amplitudes, p["gauge.sensitivity"] * made.curvature)
            return combined(port, length, amplitudes, made.tip, order)
        factor = p["tacho.sensitivity"] if probe.kind == "tacho" else 1.0
        if probe.kind == "acceleration":
            factor = self.fixed.get("accelerometer.radius", 1.0)
        return Readout({i: factor * c for i, c in port.sense.items()}, order)

    def probe(self, signal: str) -> Probe:
        """The sensor behind a signal."""
        return next(q for q in self.topology.probes if self.signal(q) == signal)

    def signal(self, probe: Probe) -> str:
        """What the scenario calls a sensor's signal."""
        blocks = {
            "tacho": "tacho.out",
            "acceleration": "accelerometer.out",
            "strain": "gauge.out",
            "tip": "link.tip.position",
            "tip_acceleration": "link.tip.acceleration",
        }
        motion = "position" if probe.kind == "angle" and not self.topology.turns(probe.read) else probe.kind
        return blocks.get(probe.kind, f"{probe.read}.{motion}")

    def ratio(self, place: str) -> float:
        """How far a flange moves while the last of its rigid body moves by one."""
        known = any(place in node for node in self.topology.nodes)
        return self.topology.ratio(place) if known else 1.0

    def lossy(self, one: str, other: str) -> bool:
        """Whether a gear between two flanges loses power."""
        return self.topology.losses(one, other)

    # -- other cuts ----------------------------------------------------------------------------------------------------

    def also_cut(self, cuts: Mapping[str, tuple[int, frozenset[str]]]) -> Rig:
        """A copy that may be cut at further places, or otherwise at its own; rigid where no law says how it gives.

        Args:
            cuts: place -> node, and the flanges on the far side. The chain may go on from the near side.
        """
        made = copy.copy(self)
        made.cuts = self.cuts | dict(cuts)
        joints = tuple(dict.fromkeys((*self.sites.joints, *cuts)))
        names = {place: tuple(self.topology.nodes[index]) for place, (index, _) in cuts.items()}
        made.sites = replace(
            self.sites,
            joints=joints,
            extra=dict(self.sites.extra) | {"joint_flexibility": joints},
            same=dict(self.sites.same) | names,
        )
        return made

    def seated(self, seats: Mapping[str, str]) -> Rig:
        """A copy whose sensors sit elsewhere: signal -> flange. What they are called, and read, stays."""
        made = copy.copy(self)
        probes = [replace(q, at=seats.get(self.signal(q), q.at)) for q in self.topology.probes]
        made.topology = replace(self.topology, probes=probes)
        return made

    def can_give(self, places: Sequence[str]) -> bool:
        """Whether all of these joints can give at once: cuts that do not cross, and inertia on each piece."""
        try:
            body = self.assemble(self.nominal(), dict.fromkeys(places, plain_spring), LinkOptions(), 0.0)
        except ValueError:
            return False
        return bool(np.all(np.diag(body.mechanism.mass_matrix()) > 0))

    # -- the places ---------------------------------------------------------------------------------------------------

    def find_sites(self) -> Sites:
        """Where effects may be concealed; needs the sensors."""
        t = self.topology
        groups = [tuple(_first_mass(t, group, [f for i in group for f in t.nodes[i]])) for group in t.groups()]
        joints = [t.cut(i) for i in range(len(t.nodes)) if t.cuts[i]]
        springs = tuple(part.name for part in t.between if part.gives and part.kind != "mesh")
        return Sites(
            input=f"source.out -> {self.drive}",
            shafts=tuple(groups),
            joints=tuple(joints),
            springs=springs,
            links=("link",) if t.link else (),
            sensors=self._on_sensors(),
            extra=self._extra([group[0] for group in groups], tuple(joints), springs) | self._of_drives(groups),
            same={place: self._names(place) for place in joints} | self._input_names() | self._block_names(),
        )

    def _on_sensors(self) -> dict[str, tuple[str, ...]]:
        kinds = {s.signal: self.probe(s.signal).kind for s in self.sensors}
        analog = tuple(s.signal for s in self.sensors if not s.quantum and kinds[s.signal] != "tip")
        known = ("tacho", "strain")  # their sensitivity is a parameter with a tolerance
        scaled = tuple(name for name, kind in kinds.items() if kind not in known and len(kinds) > 1)
        return {
            "sensor_bias": analog,
            "sensor_scale": scaled,
            "sensor_lag": tuple(kinds),
            "rectified_sensor": tuple(name for name in analog if kinds[name] != "acceleration"),
        }

    def _extra(
        self, shafts: list[str], joints: tuple[str, ...], springs: tuple[str, ...]
    ) -> dict[str, tuple[str, ...]]:
        t = self.topology
        damped = {shafts[k] for k, group in enumerate(t.groups()) if self._damped(group)}
        last = shafts[-1]
        found: dict[str, tuple[str, ...]] = {
            "viscous_friction": tuple(s for s in shafts if s not in damped),
            "joint_flexibility": joints,
            "gravity": (last,),
            "torque_ripple": tuple(dict.fromkeys((t.nodes[0][0], last))),
            "extra_mode": (*(s for s in shafts if not (t.link and s == last)), *(("link",) if t.link else ())),
            "structural_damping": springs,
        }
        if self.drive_unit != "V" or self.fixed.get("motor.inductance"):
            found["inductance"] = ()
        if t.slides:
            found |= dict.fromkeys(TURNING_ONLY, ())
        return found

    def _of_drives(self, groups: list[tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
        """Where effects of drives are that need a part: shafts whose position is measured have stops."""
        t = self.topology
        measured = {q.at for q in t.probes if q.kind == "angle"}
        return {
            "belt_slack": tuple(part.name for part in t.between if part.kind == "belt"),
            "transmission_error": tuple(part.name for part in t.between if part.kind == "mesh"),
            "warm_up": ("motor",) if t.lossless else (),
            "friction_warm_up": tuple(t.bearings),
            "end_stop": tuple(group[0] for group in groups if measured & set(group)),
        }

    def _block_names(self) -> dict[str, tuple[str, ...]]:
        """Blocks that are a place, and their flanges or inputs."""
        meshes = {part.name: part.ends for part in self.topology.between if part.kind == "mesh"}
        bearings = {flange: (name,) for flange, name in self.topology.bearings.items()}
        return {"motor": ("motor.voltage", f"source.out -> {self.drive}"), **meshes, **bearings}

    def _damped(self, group: list[int]) -> bool:
        flanges = {f for i in group for f in self.topology.nodes[i]}
        return bool(flanges & self.topology.bearings.keys()) or "motor.shaft" in flanges

    def _names(self, place: str) -> tuple[str, ...]:
        """Every flange of the node that is cut, and of others that part the same bodies if they are."""
        t = self.topology
        index = next(i for i in range(len(t.nodes)) if t.cuts[i] and t.cut(i) == place)
        mine = self._towards_drive(index)
        group = next(g for g in t.groups() if index in g)
        alike = [i for i in group if i == index or (t.cuts[i] and self._towards_drive(i) == mine)]
        return tuple(f for i in alike for f in t.nodes[i])

    def _towards_drive(self, index: int) -> frozenset[str]:
        t = self.topology
        group = next(g for g in t.groups() if index in g)
        before = [f for i in group if i < index for f in t.nodes[i]] + t.nodes[index][: t.cuts[index]]
        return frozenset(f for f in before if t.masses(f))

    def _input_names(self) -> dict[str, tuple[str, ...]]:
        if self.drive_unit != "A":
            return {}
        # A gain is all that lies between: before it or behind it, the same law in another unit.
        names = ("source.out", "amplifier.in", "amplifier.out", "drive.torque", "amplifier.out -> drive.torque")
        return {f"source.out -> {self.drive}": names}


def _tolerance(key: str) -> float:
    return PECULIAR.get(key, TOLERANCES[key_of(key)])


def _main(t: Topology) -> str:
    return next(f for f in reversed(t.nodes[-1]) if t.masses(f) or f == t.nodes[-1][0])


def _first_mass(t: Topology, group: list[int], flanges: list[str]) -> list[str]:
    """The flanges of a rigid body, one that carries something in front: behind its gears, where there is one."""
    carried = [f for f in flanges if t.masses(f)]
    behind = [f for f in carried if t.node_of(f) == group[-1]]
    front = (behind or carried)[0]
    return [front, *(f for f in flanges if f != front)]


def _count(t: Topology) -> str:
    bodies = len(t.bodies) + t.link
    return f"{bodies} {'body' if bodies == 1 else 'bodies'}" + (", one of them a flexible link" if t.link else "")
