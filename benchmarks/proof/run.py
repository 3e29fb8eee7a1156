"""Running cases blind: drawn into a folder, diagnosed by the command line in a process of its own, then left alone."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.concealed.case import draw
from benchmarks.concealed.scenario import write
from benchmarks.concealed.simulator import Diverged
from benchmarks.proof.frozen import ROOT, code_state
from benchmarks.proof.suites import Spec, from_json
from engine.files import writing
from engine.spread import Spread

LONGEST = 1800
"""Seconds after which a diagnosis is stopped and counted as a failure."""

TOOL = (sys.executable, "-m", "flexarm")
PLAN = "plan.json"


def run(
    specs: Sequence[Spec],
    folder: Path,
    workers: int,
    tell: Callable[[str], None] = print,
    scheduler: str | None = None,
    commit: str = "",
) -> None:
    """Draw and diagnose cases; those that are done already are left as they are.

    Args:
        specs: the cases.
        folder: holds ``plan.json`` (what was asked for), ``cases/NAME`` (what the tool sees), ``answers/NAME.json``
            and ``results/NAME``. On a cluster, all workers must see it at this path.
        workers: processes at a time, one thread each.
        tell: told about each case.
        scheduler: address of a dask scheduler, whose workers are used.
        commit: that froze the rules, if seeds follow from it.

    Raises:
        FlexarmError: a worker died, or the cluster does not answer.
    """
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    known = plan(folder)
    for spec in specs:
        known[spec.name] = asdict(spec)
    with writing(folder / PLAN, (".json",)) as temporary:
        temporary.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
    tasks = [(asdict(spec), str(folder), commit) for spec in specs]
    with Spread(workers, scheduler) as spread:
        for number, (spec, line) in enumerate(zip(specs, spread.map(_task, tasks), strict=True), 1):
            tell(f"{number:4d} of {len(specs)}  {spec.suite:10s} {spec.name}  {line}")


def plan(folder: Path) -> dict[str, Any]:
    """Every case that was ever asked for in a folder: name -> `Spec` as JSON."""
    path = folder / PLAN
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def _task(task: tuple[Mapping[str, Any], str, str]) -> str:
    spec, folder, commit = task
    return one(from_json(spec), Path(folder), commit)


def one(spec: Spec, folder: Path, commit: str = "") -> str:
    """Draw and diagnose one case, unless its result is there; returns a line about it.

    A case that cannot be drawn has a result too, so that it is counted.
    """
    result = folder / "results" / spec.name
    if (result / "run.json").exists():
        return "done before"
    for left in (result, partial := result.with_name(result.name + ".partial")):
        shutil.rmtree(left, ignore_errors=True)
    partial.mkdir(parents=True)
    numbers = _draw(spec, folder) or diagnose(spec, folder / "cases" / spec.name, partial)
    about = {"spec": asdict(spec), "frozen": commit, "code": code_state(), **numbers}
    (partial / "run.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    partial.rename(result)
    return f"{numbers['verdict']}  {numbers['seconds']:.0f} s  {numbers['failure'][:120]}".rstrip()


def _draw(spec: Spec, folder: Path) -> dict[str, Any] | None:
    """Write the case and its answer, unless they are there; what to note if it cannot be drawn."""
    case, answers = folder / "cases" / spec.name, folder / "answers"
    if (answers / f"{spec.name}.json").exists():
        return None
    shutil.rmtree(case, ignore_errors=True)
    try:
        made = draw(spec.plant, spec.effects, spec.sizes, spec.seed, spec.options)
    except (ValueError, ArithmeticError, Diverged) as error:
        return {"verdict": "failed", "seconds": 0.0, "cpu": 0.0, "failure": f"cannot be drawn: {error}"}
    write(made, case, answers)
    return None


def diagnose(spec: Spec, case: Path, result: Path) -> dict[str, Any]:
    """Run the tool on a copy of the case, in a folder that holds nothing else.

    Neither the tool's arguments nor its working folder tell the case's name or where its answer lies.

    Args:
        spec: the case.
        case: folder with the scenario and the recordings.
        result: folder that gets ``diagnosis.json``.

    Returns:
        verdict, seconds, cpu (s, of the tool and what it started) and failure, empty if it ended well.
    """
    command = [*TOOL, "diagnose", "scenario.yaml", "--json", "--workers", "1"]
    for effect in spec.withheld:
        command += ["--without", effect]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    environment = {key: value for key, value in environment.items() if key not in ("PWD", "OLDPWD")}
    with tempfile.TemporaryDirectory(prefix="case-") as place:
        for path in case.iterdir():
            shutil.copy(path, place)
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            begin = time.perf_counter()
            child = subprocess.Popen(command, stdout=out, stderr=err, cwd=place, env=environment)
            status, cpu, stopped = _finish(child, LONGEST)
            seconds = time.perf_counter() - begin
            printed, said = (_read(stream) for stream in (out, err))
    failure = f"stopped after {LONGEST} s" if stopped else said[-2000:] or f"exit code {status}" if status else ""
    verdict = "failed"
    if not failure:
        try:
            verdict = json.loads(printed)["verdict"]
            (result / "diagnosis.json").write_text(printed, encoding="utf-8")
        except (ValueError, KeyError) as error:
            failure = f"what it printed is no diagnosis: {error}"
    return {"verdict": verdict, "seconds": seconds, "cpu": cpu, "failure": failure}


def _finish(child: subprocess.Popen[bytes], longest: float) -> tuple[int, float, bool]:
    """Wait for a child, at most so long: its exit code, its CPU seconds, and whether it was stopped."""
    stopped = threading.Event()

    def stop() -> None:
        stopped.set()
        os.kill(child.pid, signal.SIGKILL)  # Popen.kill might reap the child, and its usage with it

    alarm = threading.Timer(longest, stop)
    alarm.start()
    try:
        _, status, usage = os.wait4(child.pid, 0)
    except BaseException:
        os.kill(child.pid, signal.SIGKILL)
        raise
    finally:
        alarm.cancel()
    child.returncode = os.waitstatus_to_exitcode(status)
    return child.returncode, usage.ru_utime + usage.ru_stime, stopped.is_set()


def _read(stream: Any) -> str:
    stream.seek(0)
    return str(stream.read().decode("utf-8", errors="replace"))
