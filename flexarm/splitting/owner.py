"""Which part keeps the motion of a flange that is cut: weighed by whether a part can follow, and by inertia."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca

from engine.assemble import build
from engine.errors import FlexarmError
from engine.system import Connection, System
from flexarm.splitting.flanges import effort_of, follow, follower_of, kind_of
from flexarm.splitting.parts import Part
from fmu.coupling import felt_inertia


def owner_of(system: System, connection: Connection, ends: Mapping[str, list[str]], parts: Mapping[str, Part]) -> str:
    """The side that keeps the motion: one that cannot follow, else one with inertia at the cut, else the heavier."""
    groups = list(ends)
    weights = {group: _weight(system, parts[group], own[0]) for group, own in ends.items()}
    fixed = [group for group in groups if weights[group] is None]
    if len(fixed) > 1:
        raise FlexarmError(
            f"the cut through {' - '.join(connection.ends)} has a side to follow the other on neither end: "
            f"{' and '.join(fixed)} cannot have their motion imposed there",
            connection.where,
            "friction or another imposed motion holds it; cut elsewhere, or leave "
            f"{', '.join(dict.fromkeys(system.split(end)[0] for end in connection.ends))} in one FMU",
        )
    return fixed[0] if fixed else max(groups, key=lambda group: weights[group] or (False, 0.0))


def _weight(system: System, part: Part, end: str) -> tuple[bool, float] | None:
    """Whether a flange has inertia of its own, and the inertia felt there; None if its motion cannot be imposed."""
    name, port, wanted = follower_of(system, end)
    signals = [f"{name}.{signal}" for signal in wanted]
    trial = replace(part.system, blocks=dict(part.system.blocks), connections=list(part.system.connections))
    trial.initial = {}
    follow(trial, end, name, port, kind_of(system, end))
    free = [endpoint for endpoint in trial.inputs() if _open(trial, endpoint) and endpoint not in signals]
    try:
        model = build(trial, inputs=[*signals, *free], outputs=[f"{name}.{effort_of(system, end)}"])
    except FlexarmError:
        return None
    own = ca.jacobian_sparsity(model.equations.outputs, model.equations.u[len(signals) - 1]).nnz()
    return bool(own), felt_inertia(model)


def _open(system: System, endpoint: str) -> bool:
    block, port = system.split(endpoint)
    return system.source_of(endpoint) is None and system.blocks[block].ports[port].default is None
