"""Running cases blind: drawn into a folder, diagnosed by the command line in a process of its own, then left alone."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.concealed.case import draw
from benchmarks.concealed.scenario import write
from benchmarks.proof.suites import Spec

LONGEST = 1800
"""Seconds after which a diagnosis is stopped and counted as a failure."""


def run(specs: Sequence[Spec], folder: Path, workers: int, tell: Callable[[str], None] = print) -> None:
    """Draw and diagnose cases; those that are done already are left as they are.

    Args:
        specs: the cases.
        folder: holds ``cases/NAME`` (what the tool sees), ``answers/NAME.json`` and ``results/NAME``.
        workers: processes at a time, one thread each.
        tell: told about each case.
    """
    with ThreadPoolExecutor(workers) as pool:
        jobs = {pool.submit(one, spec, folder): spec for spec in specs}
        for number, (job, spec) in enumerate(jobs.items(), 1):
            tell(f"{number:4d} of {len(jobs)}  {spec.suite:10s} {spec.name}  {job.result()}")


def one(spec: Spec, folder: Path) -> str:
    """Draw and diagnose one case, unless its result is there; returns a line about it."""
    result = folder / "results" / spec.name
    if (result / "run.json").exists():
        return "done before"
    case = folder / "cases" / spec.name
    if not (folder / "answers" / f"{spec.name}.json").exists():
        shutil.rmtree(case, ignore_errors=True)
        try:
            made = draw(spec.plant, spec.effects, spec.sizes, spec.seed, spec.options)
        except (ValueError, ArithmeticError) as error:
            return f"cannot be drawn: {error}"
        write(made, case, folder / "answers")
    shutil.rmtree(result, ignore_errors=True)
    partial = result.with_name(result.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    numbers = _diagnose(spec, case, partial)
    (partial / "run.json").write_text(json.dumps({"spec": asdict(spec), **numbers}, indent=1) + "\n")
    partial.rename(result)
    return f"{numbers['verdict']}  {numbers['seconds']:.0f} s"


def _diagnose(spec: Spec, case: Path, result: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "flexarm", "diagnose", str(case / "scenario.yaml"), "--json", "--workers", "1"]
    for effect in spec.withheld:
        command += ["--without", effect]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    begin, failure, verdict = time.perf_counter(), "", "failed"
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, env=environment, check=False)
        failure = done.stderr[-2000:] if done.returncode else ""
    except subprocess.TimeoutExpired:
        failure = f"stopped after {LONGEST} s"
    seconds = time.perf_counter() - begin
    if not failure:
        (result / "diagnosis.json").write_text(done.stdout, encoding="utf-8")
        verdict = json.loads(done.stdout)["verdict"]
    return {"verdict": verdict, "seconds": seconds, "failure": failure}
