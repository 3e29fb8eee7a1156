"""The property of blocks: each type with odd parameters and options, those that fix its structure too."""

from __future__ import annotations

import functools
import json
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from blocks import find, registry
from engine.assemble import build
from engine.block import Block
from engine.errors import FlexarmError
from engine.simulate import simulate
from engine.system import Connection, System
from tests.robustness.guard import RESULT, bounded, refused

SOUND: dict[str, dict[str, Any]] = {
    "BrakeChopper": {"resistance": 1, "switch_on": 2, "switch_off": 1},
    "Cogging": {"pole_pairs": 2, "slots": 6, "amplitude": [1.0]},
    "Curve": {"lower": 0, "upper": 1},
    "DeadZone": {"lower": -1, "upper": 1},
    "DiscreteStateSpace": {"file": "system.json"},
    "StateSpace": {"A": [[-1]], "B": [[1]], "C": [[1]]},
    "FieldOrientedController": {"pole_pairs": 2},
    "FeedForward": {"resistance": 1, "torque_constant": 1, "masses": 1},
    "LumpedMassLink": {"length": 1.0, "mass": 1.0, "joint_stiffness": 1.0},
    "Observer": {"A": [[-1]], "B": [[1]], "C": [[1]], "L": [[1]]},
    "PMSM": {"pole_pairs": 2},
    "Saturation": {"lower": -1, "upper": 1},
    "SerialArm": {"links": 1, "length": [1.0], "mass": [1.0], "modes": [0]},
    "Spline": {"file": "table.csv", "column": "u"},
    "Table": {"file": "table.csv", "column": "u"},
    "StateFeedback": {"gain": [1.0]},
    "StructuralSpring": {"stiffness": 1, "loss_factor": 0.1, "lowest_frequency": 1, "highest_frequency": 10},
    "TorqueCurve": {"lower": 0, "upper": 1},
}
"""What a block needs where ones for all that it requires do not do."""

LEFT_OUT = {"FMU", "PythonController"}
"""Blocks that run what a file holds."""

NUMBERS = [0.0, -0.0, 5e-324, 1e-300, 1e-160, 1e-30, 1e-9, 0.5, 2.0, 1e9, 1e30, 1e160, 1e300, 1.7e308]
NUMBERS += [-5e-324, -1e-300, -1.0, -1e30, -1e300, math.inf, math.nan, 10**400]
CHOICES: dict[type, list[Any]] = {
    int: [0, -1, 1, 2, 3, 10**9, 10**400],
    str: ["", "a\0b", "x" * 5000, "/dev/zero", ".", "\x07", "time"],
    bool: [True, False],
    list: [[], [[]], [[1e308]], [["x"]], [[1, 2], [3]], [[math.nan]], [1.0, 2.0]],
}


@functools.cache
def _library() -> dict[str, tuple[type[Block], dict[str, Any]]]:
    """Every block with values that it takes."""
    made = {}
    for name, cls in sorted(registry().items()):
        if name in LEFT_OUT or not cls.__module__.startswith("blocks."):
            continue
        values = dict(SOUND.get(name, {}))
        for key, parameter in cls.parameters.items():
            if parameter.required:
                values.setdefault(key, [1.0] if parameter.size else 1.0)
        made[name] = cls, values
    return made


@st.composite
def odd_blocks(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    """A type of block, and its values with one to three of them odd."""
    name = draw(st.sampled_from(sorted(_library())))
    cls, values = _library()[name]
    made = dict(values)
    for _ in range(draw(st.sampled_from([1, 1, 2, 3]))):
        keys = [*cls.parameters, *cls.options]
        if not keys:
            break
        key = draw(st.sampled_from(keys))
        if key in cls.parameters:
            number = draw(st.sampled_from(NUMBERS) | st.floats())
            made[key] = [number] if cls.parameters[key].size and draw(st.booleans()) else number
        else:
            option = cls.options[key]
            made[key] = draw(st.sampled_from([*CHOICES[option.kind], *option.choices]))
    return name, made


def _surrounded(block: Block) -> System:
    """The block with a body on every flange and a step at every input."""
    parts, wires = {"dut": block}, []
    for port in block.ports.values():
        if port.role == "flange" and port.kind == "rotational":
            parts[f"body_{port.name}"] = find("Inertia")(inertia=1.0)
            wires.append(Connection((f"dut.{port.name}", f"body_{port.name}.shaft")))
        elif port.role == "flange":
            parts[f"body_{port.name}"] = find("Mass")(mass=1.0)
            wires.append(Connection((f"dut.{port.name}", f"body_{port.name}.flange")))
        elif port.role == "input":
            parts[f"step_{port.name}"] = find("Step")(height=1.0, start=1e-3)
            wires.append(Connection((f"step_{port.name}.out", f"dut.{port.name}")))
    return System(parts, wires)


def check_block(given: tuple[str, dict[str, Any]]) -> str:
    """A block that is built and runs for three rows, or is refused."""
    name, values = given
    with tempfile.TemporaryDirectory() as folder, bounded(60):
        table, system = Path(folder) / "table.csv", Path(folder) / "system.json"
        table.write_text("time,u\n0,0\n0.001,1\n0.004,2\n0.02,3\n")
        system.write_text(json.dumps({"A": [[0.5]], "B": [[1]], "C": [[1]], "dt": 0.001}))
        here = {"table.csv": str(table), "system.json": str(system)}
        values = {key: here.get(value, value) if isinstance(value, str) else value for key, value in values.items()}
        try:
            model = build(_surrounded(find(name)(**values)))
            result = simulate(model, 3e-3, 1e-3, record_states=True, backend="interpreter")
        except FlexarmError as error:
            return refused(error)
        assert result.states is not None
        assert np.isfinite(result.values).all()
        assert np.isfinite(result.states).all()
        return RESULT
