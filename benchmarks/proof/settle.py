"""Carrying out the experiment that was proposed for a tie, on the same concealed truth, and diagnosing again."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.random import default_rng
from numpy.typing import NDArray

from benchmarks.concealed.case import Case
from benchmarks.concealed.drawing import SESSION
from benchmarks.concealed.nuisance import slow_course
from benchmarks.concealed.recording import as_columns, record
from benchmarks.concealed.scenario import _recording
from benchmarks.concealed.simulator import Diverged
from benchmarks.concealed.ties import from_answers
from benchmarks.concealed.truth import fine, simulator
from benchmarks.proof.frozen import code_state
from benchmarks.proof.run import diagnose
from benchmarks.proof.suites import from_json
from diagnosis.verdict.experiment_design import menu
from engine.spread import Spread

Array = NDArray[np.float64]

AGAIN = 0.8
"""Factor on the input of the second run, which is held out."""


def run(
    folder: Path, workers: int, tell: Callable[[str], None] = print, scheduler: str | None = None, suite: str = "ties"
) -> None:
    """Carry out every proposed experiment of a suite; those done already are left as they are.

    Args:
        folder: as `benchmarks.proof.run.run` left it; gets ``settled/NAME``.
        workers: processes at a time.
        tell: told about each case.
        scheduler: address of a dask scheduler.
        suite: whose cases.
    """
    names = sorted(path.name for path in (folder / "results").glob(f"{suite}-*") if (path / "run.json").exists())
    tasks = [(name, str(folder.resolve())) for name in names]
    with Spread(workers, scheduler) as spread:
        for name, line in zip(names, spread.map(_task, tasks), strict=True):
            tell(f"{name}  {line}")


def _task(task: tuple[str, str]) -> str:
    name, folder = task
    return one(name, Path(folder))


def one(name: str, folder: Path) -> str:
    """Carry out one experiment; returns a line about it."""
    result, found = folder / "settled" / name, folder / "results" / name / "diagnosis.json"
    if (result / "run.json").exists():
        return "done before"
    diagnosis = json.loads(found.read_text(encoding="utf-8")) if found.exists() else {}
    proposal = diagnosis.get("next_experiment")
    if not proposal or not any(f["status"] == "tie" for f in diagnosis["findings"]):
        return "no tie with an experiment proposed"
    partial, case = result.with_name(name + ".partial"), folder / "cases-settled" / name
    for left in (result, partial, case):
        shutil.rmtree(left, ignore_errors=True)
    partial.mkdir(parents=True)
    answer = json.loads((folder / "answers" / f"{name}.json").read_text(encoding="utf-8"))
    if not extend(from_answers(answer), folder / "cases" / name, case, proposal["kind"]):
        shutil.rmtree(partial)
        return f"'{proposal['kind']}' cannot be carried out here"
    spec = from_json(json.loads((folder / "results" / name / "run.json").read_text(encoding="utf-8"))["spec"])
    numbers = diagnose(spec, case, partial)
    about = {"kind": proposal["kind"], "code": code_state(), **numbers}
    (partial / "run.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    partial.rename(result)
    return f"{proposal['kind']}: {numbers['verdict']}  {numbers['seconds']:.0f} s"


def extend(case: Case, old: Path, new: Path, kind: str) -> bool:
    """Add two runs of an experiment to a copy of a case: one to train, and one with a smaller input to hold out.

    Args:
        case: with the truth.
        old, new: folders of the case and of its copy.
        kind: of the tool's menu; its input is as large as the largest so far, or as the plant's reach allows.

    Returns:
        Whether it could be done: not for a kind that is no input, nor in a closed loop.
    """
    largest = max(float(np.abs(r.command).max()) for r in case.recordings)
    known = menu(largest, case.bench.interval)
    if kind not in known or case.bench.references:
        return False
    _, time, drive = known[kind]
    interval = case.bench.interval
    instants = interval * np.arange(round(time[-1] / interval))
    command = _within_reach(case, np.interp(instants, time, drive))
    rng, count = default_rng([case.seed, 4711]), len(case.recordings)
    bench = replace(
        case.bench,
        commands=(command, AGAIN * command),
        held_out=(False, True),
        slow=tuple(slow_course(rng, len(command) + 1, interval) for _ in range(2)),
        start=(SESSION * count, SESSION * (count + 1)),
        released=(0.0, 0.0),
    )
    made = record(bench, case.truth, case.sensors, [kind, kind], rng)
    shutil.copytree(old, new)
    with (new / "scenario.yaml").open("a", encoding="utf-8") as scenario:
        for k, recorded in enumerate(made):
            named = replace(recorded, name=f"rec{count + 1 + k}")
            columns = as_columns(named, case.sensors)
            header = ",".join(columns)
            rows = np.column_stack(list(columns.values()))
            np.savetxt(new / f"{named.name}.csv", rows, fmt="%.9g", delimiter=",", header=header, comments="")
            scenario.write(_recording(case, named, released=False))
    return True


def _within_reach(case: Case, command: Array) -> Array:
    """The input in steps of the command's resolution, made smaller until the plant stays where it may go."""
    e = case.plant.excitation
    plant = simulator(case.truth, [case.plant.sensors[0].signal], case.bench.interval, fine(case.truth))
    while True:
        rounded = np.asarray(np.round(command / e.resolution) * e.resolution)
        try:
            if not np.isfinite(e.reach) or np.abs(plant.run(rounded).clean).max() <= e.reach:
                return rounded
        except Diverged:
            pass
        command = 0.85 * command
