"""Running cases blind: drawn into a folder, diagnosed by the command line in a process of its own, then left alone."""

from __future__ import annotations

import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchmarks.concealed.case import draw
from benchmarks.concealed.rigs.hidden import drawn
from benchmarks.concealed.scenario import write
from benchmarks.concealed.simulator import Diverged
from benchmarks.proof.frozen import ROOT, code_state
from benchmarks.proof.suites import DRAWN, Spec, from_json
from engine.files import writing
from engine.spread import Spread

TOLD = 2 / 3
"""Share of the processor time after which a diagnosis is stopped that it is told to keep to: it counts operations, a
second of which takes half a second to one and a half."""

LONGEST = 1800
"""Seconds after which a diagnosis is stopped and counted as a failure."""

UNDRAWN = "cannot be drawn"
"""How the failure of a case begins from whose seed nothing can be drawn."""

TOOL = (sys.executable, "-m", "flexarm")
PLAN = "plan.json"


def run(
    specs: Sequence[Spec],
    folder: Path,
    workers: int,
    tell: Callable[[str], None] = print,
    scheduler: str | None = None,
    commit: str = "",
    longest: float | None = None,
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
        longest: seconds of processor time after which a diagnosis is stopped; absent: `LONGEST` seconds that pass.

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
    tasks = [(asdict(spec), str(folder), commit, longest) for spec in specs]
    with Spread(workers, scheduler) as spread:
        for number, (spec, line) in enumerate(zip(specs, spread.map(_task, tasks), strict=True), 1):
            tell(f"{number:4d} of {len(specs)}  {spec.suite:10s} {spec.name}  {line}")


def plan(folder: Path) -> dict[str, Any]:
    """Every case that was ever asked for in a folder: name -> `Spec` as JSON."""
    path = folder / PLAN
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def _task(task: tuple[Mapping[str, Any], str, str, float | None]) -> str:
    spec, folder, commit, longest = task
    return one(from_json(spec), Path(folder), commit, longest)


def one(spec: Spec, folder: Path, commit: str = "", longest: float | None = None) -> str:
    """Draw and diagnose one case, unless its result is there; returns a line about it.

    A case that cannot be drawn has a result too, so that it is counted; so has one that is stopped: after ``longest``
    seconds of processor time, or after `LONGEST` seconds where that is absent.
    """
    result = folder / "results" / spec.name
    if (result / "run.json").exists():
        return "done before"
    for left in (result, partial := result.with_name(result.name + ".partial")):
        shutil.rmtree(left, ignore_errors=True)
    partial.mkdir(parents=True)
    numbers = _draw(spec, folder)
    known = resolved(spec, folder / "answers" / f"{spec.name}.json")
    numbers = numbers or diagnose(known, folder / "cases" / spec.name, partial, longest)
    about = {"spec": asdict(known), "frozen": commit, "code": code_state(), **numbers}
    (partial / "run.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    partial.rename(result)
    return f"{numbers['verdict']}  {numbers['seconds']:.0f} s  {numbers['failure'][:120]}".rstrip()


def _draw(spec: Spec, folder: Path) -> dict[str, Any] | None:
    """Write the case and its answer, unless they are there; what to note if it cannot be drawn."""
    case, answers = folder / "cases" / spec.name, folder / "answers"
    if (answers / f"{spec.name}.json").exists():
        return None
    shutil.rmtree(case, ignore_errors=True)
    withheld = spec.withheld
    try:
        if DRAWN in spec.effects:
            asked, made = drawn(spec.seed)
            withheld = asked.withheld
        else:
            made = draw(spec.plant, spec.effects, spec.sizes, spec.seed, spec.options)
    except (ValueError, ArithmeticError, Diverged) as error:
        return {"verdict": "failed", "seconds": 0.0, "cpu": 0.0, "failure": f"{UNDRAWN}: {error}"}
    write(made, case, answers, withheld)
    return None


def resolved(spec: Spec, sealed: Path) -> Spec:
    """A case whose effects were drawn with its rig, with what they are; any other as it is.

    The runner opens the answer for this alone: to tell the tool what it may not try, and to note what was run.
    """
    if DRAWN not in spec.effects:
        return spec
    if not sealed.exists():
        return replace(spec, effects=())
    answer = json.loads(sealed.read_text(encoding="utf-8"))
    concealed = answer["concealed"]
    return from_json(
        {
            "suite": spec.suite,
            "plant": spec.plant,
            "seed": spec.seed,
            "effects": [f"{c['effect']}@{c['place']}" for c in concealed],
            "sizes": [c["size_asked"] for c in concealed],
            "options": answer["options"],
            "withheld": answer["withheld"],
        }
    )


def diagnose(spec: Spec, case: Path, result: Path, longest: float | None = None) -> dict[str, Any]:
    """Run the tool on a copy of the case, in a folder that holds nothing else.

    Neither the tool's arguments nor its working folder tell the case's name or where its answer lies.

    Args:
        spec: the case.
        case: folder with the scenario and the recordings.
        result: folder that gets ``diagnosis.json``.
        longest: seconds of processor time after which it is stopped, whatever else the machine does, and `TOLD` of
            which it is told to keep to; absent: `LONGEST` seconds that pass.

    Returns:
        verdict, seconds, cpu (s, of the tool and what it started) and failure, empty if it ended well.
    """
    command = [*TOOL, "diagnose", "scenario.yaml", "--json", "--workers", "1"]
    if longest is not None:
        command += ["--longest", f"{TOLD * longest:g} s"]
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
            status, cpu, stopped = _finish(child, LONGEST, longest)
            seconds = time.perf_counter() - begin
            printed, said = (_read(stream) for stream in (out, err))
    told = f"{longest:g} s of processor time" if longest else f"{LONGEST} s"
    failure = f"stopped after {told}" if stopped else said[-2000:] or f"exit code {status}" if status else ""
    verdict = "failed"
    if not failure:
        try:
            verdict = json.loads(printed)["verdict"]
            (result / "diagnosis.json").write_text(printed, encoding="utf-8")
        except (ValueError, KeyError) as error:
            failure = f"what it printed is no diagnosis: {error}"
    return {"verdict": verdict, "seconds": seconds, "cpu": cpu, "failure": failure}


def _finish(child: subprocess.Popen[bytes], longest: float, cpu: float | None = None) -> tuple[int, float, bool]:
    """Wait for a child, at most so long, or so much processor time: its exit code, CPU seconds, and whether stopped."""
    stopped = threading.Event()
    if cpu is not None:
        limit = math.ceil(cpu)
        resource.prlimit(child.pid, resource.RLIMIT_CPU, (limit, limit + 5))
        longest = math.inf

    def stop() -> None:
        stopped.set()
        os.kill(child.pid, signal.SIGKILL)  # Popen.kill might reap the child, and its usage with it

    alarm = threading.Timer(longest, stop) if math.isfinite(longest) else None
    if alarm:
        alarm.start()
    try:
        _, status, usage = os.wait4(child.pid, 0)
    except BaseException:
        os.kill(child.pid, signal.SIGKILL)
        raise
    finally:
        if alarm:
            alarm.cancel()
    child.returncode = os.waitstatus_to_exitcode(status)
    spent = child.returncode in (-signal.SIGXCPU, -signal.SIGKILL) and cpu is not None
    return child.returncode, usage.ru_utime + usage.ru_stime, stopped.is_set() or spent


def _read(stream: Any) -> str:
    stream.seek(0)
    return str(stream.read().decode("utf-8", errors="replace"))
