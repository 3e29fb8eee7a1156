"""Measures flexarm beside other tools and writes the page: ``python -m benchmarks.peers [--page-only]``.

Needs the extra ``peers`` for pathsim and bdsim; without them their rows are missing and the page says so. Takes about
two minutes. What is compared runs in turns in one process, and medians count.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import platform
import statistics
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.peers import problems, scaling, tools
from engine.compile import version as compiler
from engine.files import writing

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "benchmarks" / "results" / "peers.json"
FMU = ROOT / "benchmarks" / "results" / "fmu.json"
PAGE = ROOT / "docs" / "benchmarks" / "peers.md"
PACKAGES = ("numpy", "scipy", "control", "pathsim", "bdsim", "casadi")
ROUNDS, FEW = 41, 3
"""Rounds, and of how many of them a slow tool takes part."""


def compare(chosen: list[tools.Tool], exact: tools.Array) -> list[dict[str, Any]]:
    """Median seconds of processor time and relative rms error of each tool."""
    spent: list[list[float]] = [[] for _ in chosen]
    outputs: list[tools.Array] = []
    for tool in chosen:  # once beforehand: what is compiled or cached is so afterwards
        outputs.append(np.array(_quiet(tool)))
    for k in range(ROUNDS):
        for tool, seconds in zip(chosen, spent, strict=True):
            if k < FEW or not tool.slow:
                begin = time.process_time()
                _quiet(tool)
                seconds.append(time.process_time() - begin)
    size = float(np.sqrt(np.mean(exact**2)))
    return [
        {
            "tool": tool.name,
            "how": tool.how,
            "seconds": statistics.median(seconds),
            "repeats": len(seconds),
            "error": float(np.sqrt(np.mean((y - exact) ** 2))) / size,
        }
        for tool, seconds, y in zip(chosen, spent, outputs, strict=True)
    ]


def _quiet(tool: tools.Tool) -> tools.Array:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return tool.run()


def measure() -> dict[str, Any]:
    """Every figure."""
    state_space = problems.state_space()
    found: dict[str, Any] = {
        "load": os.getloadavg()[1],
        "cores": os.cpu_count(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()},"
        f" {compiler().splitlines()[0]}",
        "versions": {name: version(name) for name in PACKAGES if tools.installed(name)},
        "missing": [name for name in PACKAGES if not tools.installed(name)],
        "linear": compare(tools.linear(), problems.linear_solution(state_space)),
        "states": len(state_space.A),
        "sliding": compare(tools.sliding(), problems.sliding_solution()),
    }
    found["scaling"] = scaling.every()
    return found


HEAD = """# Beside other tools

Written by `python -m benchmarks.peers` (with `pip install 'flexarm[peers]'`) from `benchmarks/results/peers.json`. What
is compared ran in turns in one process on one thread. Times are processor time, medians of repeats; the machine was
shared (load {load:.1f} on {cores} cores), so that ratios mean more than seconds. Each tool solves the same 10 s and
gives 10 001 rows; what it can prepare beforehand it may (flexarm compiles the model once, which takes about a second
the first time and is cached; pathsim and bdsim put their few blocks together within the run, which is not what takes
them long). Errors are relative, root mean square over all rows.

{machine}; {versions}.
{missing}"""

LINEAR = """
## A linear model

A DC motor with gear turns a flexible link of two modes ({states} states); 1 V comes at 0.5 s and goes at 5.5 s; output
is the speed of the hub. Compared with the matrix exponential, which is exact here because the steps fall on rows (and
which is what python-control computes).

"""

SLIDING = """
## A joint that sticks and slips

An inertia on a spring, driven by a slow sine torque, with dry friction: it sticks at every reversal. Compared with
DOP853 at a relative tolerance of 1e-12, restarted at every switch. Where a tool was not given events, friction is
smoothed by tanh(v / {smooth:g} rad/s); that error does not fall with the tolerance.

"""

FMU_STEP = """
## A step of an FMU

From `python -m benchmarks.bench_fmu`: one `fmi2DoStep` of 1 ms of an arm with 8 states, called from C.

"""

SCALING = """
## How costs grow

Cost ~ size^exponent, fitted over the sizes from the one named on. An exponent of -1 for cores would be perfect, on
cores that nobody else uses; theirs is elapsed time, the others' is processor time.

"""


def page(found: dict[str, Any]) -> str:
    """The page, in Markdown."""
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    missing = f"Not installed, and so not measured: {', '.join(found['missing'])}.\n" if found["missing"] else ""
    parts = [HEAD.format(versions=versions, missing=missing, **{k: found[k] for k in ("machine", "load", "cores")})]
    parts += [LINEAR.format(states=found["states"]), _table(found["linear"])]
    parts += [SLIDING.format(smooth=tools.SMOOTH), _table(found["sliding"])]
    if FMU.exists():
        step = json.loads(FMU.read_text(encoding="utf-8"))
        rows = (
            ("hand-written C", step["hand_written_ns"], step["ratio_to_hand_written"] ** -1, "-"),
            ("flexarm", step["step_ns"], 1.0, f"{step['difference_from_hand_written']:.0e}"),
            ("pythonfmu", step["pythonfmu_ns"], step["pythonfmu_ratio"], f"{step['pythonfmu_difference']:.0e}"),
        )
        lines = [f"| {tool} | {ns / 1000:.3g} us | {ratio:.3g} | {apart} |" for tool, ns, ratio, apart in rows]
        head = ["| FMU | a step | times flexarm's | outputs apart from hand-written C |", "|---|---|---|---|"]
        parts += [FMU_STEP, "\n".join([*head, *lines, ""])]
    lines = ["| what | sizes | cost | exponent |", "|---|---|---|---|"]
    for g in found["scaling"]:
        costs = ", ".join(f"{c:.3g}" for c in g["costs"])
        slope = "one core only" if g["exponent"] is None else f"{g['exponent']:.2f} (from {g['over']})"
        lines.append(f"| {g['what']} | {', '.join(map(str, g['sizes']))} | {costs} {g['unit']} | {slope} |")
    parts += [SCALING, "\n".join([*lines, ""])]
    return "".join(parts)


def _table(rows: list[dict[str, Any]]) -> str:
    ours = next(row["seconds"] for row in rows if row["tool"] == "flexarm")
    lines = ["| tool | how | 10 s take | times flexarm's | error | repeats |", "|---|---|---|---|---|---|"]
    for row in rows:
        milliseconds, ratio = 1e3 * row["seconds"], row["seconds"] / ours
        told = f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"
        cells = (row["tool"], row["how"], f"{milliseconds:.3g} ms", told, f"{row['error']:.1e}", str(row["repeats"]))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; or write again from what was measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--page-only", action="store_true", help="write the page from the data file")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--page", type=Path, default=PAGE)
    given = parser.parse_args(arguments)
    if not given.page_only:
        with threadpool_limits(1):  # processor time would count every thread of the linear algebra
            found = measure()
        with writing(given.data, (".json",)) as temporary:
            temporary.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    found = json.loads(given.data.read_text(encoding="utf-8"))
    given.page.parent.mkdir(parents=True, exist_ok=True)
    with writing(given.page, (".md",)) as temporary:
        temporary.write_text(page(found), encoding="utf-8")
    print(given.page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
