"""Writing what the tool may see: a scenario with the nominal model, and recordings as CSV files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.concealed.case import Case
from benchmarks.concealed.plants.base import Sensor
from benchmarks.concealed.recording import Recorded, as_columns


def text(case: Case) -> str:
    """The scenario, as YAML. It says nothing about what is concealed."""
    plant, nested = case.plant, _Nested()
    for q in plant.parameters:
        nested.put(q.name, repr(float(case.nominal[q.name])))
    seconds = case.options.seconds
    head = f"""# {plant.title}: the nominal model, and recordings of a rig that may not obey it.
schema: 1
name: {plant.name}
description: {plant.title}; nominal parameters as on the data sheet.

blocks:{plant.blocks.format(**nested.blocks)}
simulate: {{stop: {seconds:g} s, step: 1 ms}}

recordings:
"""
    each = zip(case.recordings, case.bench.released, strict=True)
    return head + "".join(_recording(case, r, released != 0) for r, released in each)


def _recording(case: Case, recorded: Recorded, released: bool) -> str:
    plant = case.plant
    drive = f"{{column: u, unit: {plant.drive_unit}, tap: before_limit, hold: zero_order}}"
    lines = [
        f"  {recorded.name}:",
        f"    file: {recorded.name}.csv",
        "    time: {column: t, unit: s}",
        f"    drive: {{{plant.drive}: {drive}}}",
        "    measurements:",
        *(f"      {s.signal}: {_measurement(s, case.options.sigma_error)}" for s in case.sensors),
        f"    loop: {case.options.loop}",
        f"    role: {recorded.role}",
    ]
    if released:
        free = ", ".join(plant.habits.free) or plant.sensors[0].signal
        lines.insert(5 + len(case.sensors), f"    initial: {{state: at_rest, free: [{free}]}}")
    return "\n".join(lines) + "\n"


def _measurement(sensor: Sensor, sigma_error: float) -> str:
    if sensor.counts:
        noise = sigma_error / np.sqrt(12)
        return f"{{column: {sensor.column}, unit: count, counts_per_rev: {sensor.counts}, noise: {noise:.5g}}}"
    return f"{{column: {sensor.column}, unit: {sensor.unit}, noise: {sigma_error * sensor.sigma:.5g}}}"


class _Nested:
    """``block.key`` values for str.format, which reads a dot as an attribute."""

    def __init__(self) -> None:
        self.blocks: dict[str, _Keys] = {}

    def put(self, name: str, value: str) -> None:
        block, key = name.split(".")
        setattr(self.blocks.setdefault(block, _Keys()), key, value)


class _Keys:
    """Values of one block."""


def write(case: Case, folder: Path, answers: Path, withheld: Sequence[str] = ()) -> Path:
    """Write the case to a folder, and its answers to another.

    Args:
        case: what was drawn.
        folder: gets scenario.yaml and the recordings.
        answers: gets NAME.json, NAME the name of ``folder``.
        withheld: effects that the tool is not to try, noted with the answers.

    Returns:
        The file with the answers.

    Raises:
        ValueError: the answers would lie where the tool can see them.
    """
    folder, answers = folder.resolve(), answers.resolve()
    if answers == folder or folder in answers.parents:
        raise ValueError(f"the answers must not lie in the case's folder: '{answers}' is in '{folder}'")
    folder.mkdir(parents=True, exist_ok=True)
    answers.mkdir(parents=True, exist_ok=True)
    (folder / "scenario.yaml").write_text(text(case), encoding="utf-8")
    for recorded in case.recordings:
        columns = as_columns(recorded, case.sensors)
        counting = {s.column for s in case.sensors if s.counts}
        formats = ["%.6f", "%.9g", *("%d" if name in counting else "%.7g" for name in list(columns)[2:])]
        table = np.column_stack(list(columns.values()))
        np.savetxt(
            folder / f"{recorded.name}.csv", table, fmt=formats, delimiter=",", header=",".join(columns), comments=""
        )
    sealed = answers / f"{folder.name}.json"
    told = case.answers() | {"withheld": list(withheld)}
    sealed.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    return sealed
