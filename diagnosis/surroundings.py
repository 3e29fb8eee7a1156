"""How large things are where an effect may act: inputs, torques, speeds and inertias at the places of a system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from blocks.registry import registry
from diagnosis.problem import Array, Experiment, Problem
from engine.assemble import build
from engine.block import ROTATIONAL
from engine.linearise import linearise
from engine.simulate import simulate
from engine.system import Connection, System


@dataclass
class Surroundings:
    """What the recordings say about sizes at the places of a system.

    Attributes:
        problem: the nominal problem.
        inputs: driven input -> largest |value|.
        groups: places that move together: name of the flange that stands for them, and all their flanges.
        torque: flange -> size of the torques that act there.
        speed, angle: flange -> size of its motion.
        inertia: flange -> inertia felt there.
        lines: frequencies (rad/s) that stand out in what the refitted model leaves over.
    """

    problem: Problem
    inputs: dict[str, float] = field(default_factory=dict)
    groups: dict[str, list[str]] = field(default_factory=dict)
    torque: dict[str, float] = field(default_factory=dict)
    speed: dict[str, float] = field(default_factory=dict)
    angle: dict[str, float] = field(default_factory=dict)
    inertia: dict[str, float] = field(default_factory=dict)
    lines: list[float] = field(default_factory=list)


def surroundings(problem: Problem) -> Surroundings:
    """Simulate the nominal model on the training recordings and see how large things are."""
    found = Surroundings(problem)
    experiments = problem.chosen("train", "repeat")
    for k, variable in enumerate(problem.model.inputs):
        values = [
            np.asarray(e.drive.values, dtype=float).reshape(-1, len(problem.model.inputs))
            for e in experiments
            if e.drive
        ]
        found.inputs[variable.name] = max((float(np.abs(v[:, k]).max()) for v in values), default=1.0) or 1.0
    system = problem.scenario.system
    transform = np.array(problem.model.functions["transform"](problem.model.parameter_values).full())
    for flange, row in problem.model.motions.items():
        block, port = system.split(flange)
        if system.blocks[block].ports[port].kind != ROTATIONAL or not np.abs(transform[row]).any():
            continue
        home = next((g for g in found.groups if _parallel(transform, problem, g, row)), None)
        if home is None:
            found.groups[flange] = [flange]
        else:
            found.groups[home].append(flange)
    for flange in found.groups:
        found.inertia[flange] = _inertia(problem, flange)
    _sizes(found, experiments)
    return found


def _parallel(transform: Array, problem: Problem, flange: str, row: int) -> bool:
    a, b = transform[problem.model.motions[flange]], transform[row]
    return bool(abs(a @ b) > (1 - 1e-9) * np.linalg.norm(a) * np.linalg.norm(b))


def _inertia(problem: Problem, flange: str) -> float:
    """Inertia felt at a flange: torque over acceleration at rest."""
    system = problem.scenario.system
    torque = registry()["Torque"]()
    probed = System(
        {**system.blocks, "probe": torque},
        [*system.connections, Connection((flange, "probe.shaft"))],
        system.shared,
        {},
        system.places,
    )
    inputs = ["probe.torque", *(v.name for v in problem.model.inputs)]
    model = build(probed, inputs=inputs, outputs=[f"{flange}.acceleration"])
    sliding = {mode.name: "sliding forward" for mode in model.modes if mode.kind == "friction"}
    gain = float(linearise(model, modes=sliding).D[0, 0])
    return 1 / gain if gain > 0 else 1.0


def _sizes(found: Surroundings, experiments: Sequence[Experiment]) -> None:
    problem = found.problem
    names = [f"{flange}.{quantity}" for flange in found.groups for quantity in ("angle", "speed", "acceleration")]
    model = build(problem.scenario.system, [v.name for v in problem.model.inputs], names)
    top = dict.fromkeys(names, 0.0)
    for e in experiments:
        run = simulate(model, e.stop, e.step, drive=e.drive, internal_step=problem.internal_step)
        for name in names:
            values = run[name]
            size = float(np.ptp(values)) if name.endswith(".angle") else float(np.sqrt(np.mean(values**2)))
            top[name] = max(top[name], size)
    for flange in found.groups:
        found.angle[flange] = top[f"{flange}.angle"] or 1.0
        found.speed[flange] = top[f"{flange}.speed"] or 1.0
        found.torque[flange] = found.inertia[flange] * top[f"{flange}.acceleration"] or 1e-3
