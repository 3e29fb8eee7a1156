"""How large things are where an effect may act: inputs, torques, speeds and inertias at the places of a system.

Places along which something slides are told in the same words: torque stands for force, angle for position, inertia for
mass.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from blocks.registry import registry
from diagnosis.estimation.problem import Array, Experiment, Problem
from diagnosis.frequency_response.table_experiment import UNSEEN, TableExperiment
from diagnosis.recordings.feedback import plant_inputs
from engine.assemble import build
from engine.linearise import linearise
from engine.ports import MOTION, ROTATIONAL, TRANSLATIONAL
from engine.simulate import simulate
from engine.system import Connection, System

FACTORS = (0.3, 0.5, 2.0, 3.0)
"""What a parameter of a table's model may be multiplied by."""


@dataclass
class OperatingScales:
    """What the recordings say about sizes at the places of a system.

    Attributes:
        problem: the nominal problem.
        inputs: driven input, or one where a controller meets the plant -> largest |value|.
        units: unit of each of them.
        slides: flanges in ``groups`` that slide rather than turn.
        groups: places that move together: name of the flange that stands for them, and all their flanges.
        torque: flange -> size of the torques that act there.
        speed, angle: flange -> size of its motion.
        inertia: flange -> inertia felt there.
        lines: frequencies (rad/s) that stand out in what the refitted model leaves over.
    """

    problem: Problem
    inputs: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    slides: set[str] = field(default_factory=set)
    groups: dict[str, list[str]] = field(default_factory=dict)
    torque: dict[str, float] = field(default_factory=dict)
    speed: dict[str, float] = field(default_factory=dict)
    angle: dict[str, float] = field(default_factory=dict)
    inertia: dict[str, float] = field(default_factory=dict)
    lines: list[float] = field(default_factory=list)

    @property
    def sample(self) -> float:
        """The shortest time (s) that the recordings resolve."""
        return min(e.shortest for e in self.problem.experiments)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Effects that recordings of this kind do not show."""
        return UNSEEN if any(isinstance(e, TableExperiment) for e in self.problem.experiments) else ()

    @property
    def factors(self) -> tuple[float, ...]:
        """Factors by which a parameter may be wrong, to start from: a few rows leave a fit in local optima."""
        return FACTORS if self.unseen else ()

    def spins(self, flange: str) -> bool:
        """Whether a flange turns over by whole turns at a table's lowest frequency: gravity then averages out there."""
        lowest = [float(e.frequency.min()) for e in self.problem.experiments if isinstance(e, TableExperiment)]
        return bool(lowest) and self.speed[flange] / min(lowest) > math.pi

    def ratio(self, one: str, other: str) -> float:
        """How far ``other`` moves while ``one`` moves by one; 1 where one of them is held or moved from outside."""
        model = self.problem.model
        transform = np.array(model.functions["transform"](model.parameter_values).full())
        a, b = (float(np.linalg.norm(transform[model.motions[flange]])) for flange in (one, other))
        return b / a if a > 0 and b > 0 else 1.0


def operating_scales(problem: Problem) -> OperatingScales:
    """Simulate the nominal model on the training recordings and see how large things are."""
    found = OperatingScales(problem)
    experiments = problem.chosen("train", "repeat")
    for k, variable in enumerate(problem.model.inputs):
        values = [
            np.asarray(e.drive.values, dtype=float).reshape(-1, len(problem.model.inputs))
            for e in experiments
            if e.drive
        ] + [e.amplitude[:, None] for e in experiments if isinstance(e, TableExperiment)]
        found.inputs[variable.name] = max((float(np.abs(v[:, k]).max()) for v in values), default=1.0) or 1.0
        found.units[variable.name] = variable.unit
    system = problem.scenario.system
    transform = np.array(problem.model.functions["transform"](problem.model.parameter_values).full())
    for flange, row in problem.model.motions.items():
        held = not np.abs(transform[row]).any()
        if held and not _imposed(system, flange):
            continue
        same = _sliding(system, flange)
        home = next(
            (g for g in found.groups if (g in found.slides) == same and _together(problem, transform, g, flange, held)),
            None,
        )
        if home is None:
            found.groups[flange] = [flange]
            if same:
                found.slides.add(flange)
        else:
            found.groups[home].append(flange)
    for flange in found.groups:
        found.inertia[flange] = _inertia(problem, flange)
    _sizes(found, experiments)
    return found


def _sliding(system: System, flange: str) -> bool:
    block, port = system.split(flange)
    return system.blocks[block].ports[port].kind == TRANSLATIONAL


def _node(system: System, flange: str) -> tuple[str, ...]:
    return next((c.ends for c in system.connections if flange in c.ends), (flange,))


def _imposed(system: System, flange: str) -> str:
    """The signal of the effort that imposes the motion of a flange, if one does."""
    for end in _node(system, flange):
        block = system.split(end)[0]
        if type(system.blocks[block]).__name__.endswith("PrescribedMotion"):
            return f"{block}.{'force' if _sliding(system, end) else 'torque'}"
    return ""


def _together(problem: Problem, transform: Array, one: str, other: str, held: bool) -> bool:
    """Whether two flanges move in proportion; imposed motions do where they are one node."""
    a, b = transform[problem.model.motions[one]], transform[problem.model.motions[other]]
    if held or not np.abs(a).any():
        return other in _node(problem.scenario.system, one)
    return bool(abs(a @ b) > (1 - 1e-9) * np.linalg.norm(a) * np.linalg.norm(b))


def _inertia(problem: Problem, flange: str) -> float:
    """Inertia felt at a flange: torque over acceleration at rest; 1 where the motion is imposed."""
    system = problem.scenario.system
    kind, port, effort = ("Force", "flange", "force") if _sliding(system, flange) else ("Torque", "shaft", "torque")
    if _imposed(system, flange):
        return 1.0
    probed = System(
        {**system.blocks, "probe": registry()[kind]()},
        [*system.connections, Connection((flange, f"probe.{port}"))],
        system.shared,
        {},
        system.places,
    )
    inputs = [f"probe.{effort}", *(v.name for v in problem.model.inputs)]
    model = build(probed, inputs=inputs, outputs=[f"{flange}.acceleration"])
    sliding = {mode.name: "sliding forward" for mode in model.modes if mode.kind == "friction"}
    gain = float(linearise(model, modes=sliding).D[0, 0])
    return 1 / gain if gain > 0 else 1.0


def _sizes(found: OperatingScales, experiments: Sequence[Experiment]) -> None:
    problem = found.problem
    system, driven = problem.scenario.system, [v.name for v in problem.model.inputs]
    wanted = {}
    for flange in found.groups:
        kind = TRANSLATIONAL if flange in found.slides else ROTATIONAL
        wanted[flange] = [f"{flange}.{quantity}" for quantity, _ in MOTION[kind][:3]]
    efforts = {flange: effort for flange in found.groups if (effort := _imposed(system, flange))}
    meets = {end: source[0] for end in plant_inputs(system, driven) if (source := system.source_of(end)) is not None}
    names = [*dict.fromkeys(name for row in wanted.values() for name in row), *efforts.values(), *meets.values()]
    model = build(system, driven, list(dict.fromkeys(names)))
    top = dict.fromkeys(names, 0.0)
    for e in experiments:
        if isinstance(e, TableExperiment):
            for name, (spanned, rms) in e.sizes(problem.scenario, names).items():
                top[name] = max(top[name], spanned if name.endswith((".angle", ".position")) else rms)
            continue
        run = simulate(model, e.stop, e.step, drive=e.drive, internal_step=problem.internal_step)
        for name in names:
            values = run[name]
            place = name.endswith((".angle", ".position"))
            size = float(np.ptp(values)) if place else float(np.sqrt(np.mean(values**2)))
            top[name] = max(top[name], size)
    for flange, (angle, speed, acceleration) in wanted.items():
        found.angle[flange] = top[angle] or 1.0
        found.speed[flange] = top[speed] or 1.0
        felt = top[efforts[flange]] if flange in efforts else found.inertia[flange] * top[acceleration]
        found.torque[flange] = felt or 1e-3
    units = {v.name: v.unit for v in model.outputs}
    for end, signal in meets.items():
        found.inputs[end] = 2 * top[signal] or 1.0
        found.units[end] = units[signal]
