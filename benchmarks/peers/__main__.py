"""Measures flexarm beside other tools and writes the page: ``python -m benchmarks.peers [--page-only]``.

Needs the extra ``peers``; rows of tools that are not there are missing, and the page says so. Takes some
minutes. What is compared runs in turns in one process, and medians count.
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
from benchmarks.peers.tool import SMOOTH, Tool, installed
from engine.compile import version as compiler
from engine.files import writing

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "benchmarks" / "results" / "peers.json"
FMU = ROOT / "benchmarks" / "results" / "fmu.json"
PAGE = ROOT / "docs" / "benchmarks" / "peers.md"
PACKAGES = ("numpy", "scipy", "casadi", "control", "pathsim", "bdsim", "drake", "mujoco", "diffrax", "jax", "exudyn")
_MODULES = {"drake": "pydrake"}
ROUNDS, FEW = 41, 3
"""Rounds, and of how many of them a slow tool takes part."""


def compare(chosen: list[Tool], exact: tools.Array) -> list[dict[str, Any]]:
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
            "setup": tool.setup,
            "error": float(np.sqrt(np.mean((y - exact) ** 2))) / size,
        }
        for tool, seconds, y in zip(chosen, spent, outputs, strict=True)
    ]


def _quiet(tool: Tool) -> tools.Array:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return tool.run()


def _has(package: str) -> bool:
    return installed(_MODULES.get(package, package))


def measure() -> dict[str, Any]:
    """Every figure."""
    state_space = problems.state_space()
    found: dict[str, Any] = {
        "load": os.getloadavg()[1],
        "cores": os.cpu_count(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()},"
        f" {compiler().splitlines()[0]}",
        "versions": {name: version(name) for name in PACKAGES if _has(name)},
        "missing": [name for name in PACKAGES if not _has(name)],
        "linear": compare(tools.linear(), problems.linear_solution(state_space)),
        "states": len(state_space.A),
        "sliding": compare(tools.sliding(), problems.sliding_solution()),
        "two_links": compare(tools.two_links(), problems.links_solution()),
    }
    found["scaling"] = scaling.every()
    return found


HEAD = """# Beside other tools

Written by `python -m benchmarks.peers` (with `pip install 'flexarm[peers]'`) from `benchmarks/results/peers.json`. What
is compared ran in turns in one process on one thread. Times are processor time, medians of repeats; the machine was
shared (load {load:.1f} on {cores} cores), so that ratios mean more than seconds. Each tool solves the same 10 s and
gives 10 001 rows; what it can prepare beforehand it may (flexarm compiles the model once, which takes about a second
the first time and is cached; pathsim and bdsim put their few blocks together within the run, which is not what takes
them long). Set-up, where it was measured, stands apart. Errors are relative, root mean square over all rows.

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

TWO_LINKS = """
## Two links

Two uniform rods hinged in a vertical plane, with a spring and damping at the joints, swing for 10 s; output is the
first angle. flexarm, Drake, MuJoCo and Exudyn are given bodies and joints; the others the equations, written by
hand. Compared with DOP853 at a relative tolerance of 1e-12.

"""

READING = """
## How to read this

* Each tool was given the form that suits it best, and a tolerance for an error of about 1e-6 where it reaches that.
  Set-up is the processor time of putting the problem together and of what a later run no longer takes: XLA's
  compiler for diffrax, 150 runs by machine code for flexarm, and the C compiler where its cache has not the model.
* **Steps.** RK4 takes one step for each row of 1 ms, 10 000 in all, which gives the two links an error of 1e-9. The
  fifth order with a variable step (diffrax) needs 489 steps for 5e-7 there, and 1160 for 5e-9; most of its time
  goes into interpolating 10 001 rows. With a row every 10 ms, diffrax takes 0.60 ms for an error of 5e-7, and
  flexarm at 5 ms 0.27 ms for 6e-7. Where modes are fast and the error small, as in the linear problem, a variable
  step is no longer: 4768.
* **Friction.** Only what was given events follows a joint that sticks. tanh leaves an error of 1e-4 and makes the
  problem stiff, so that Drake and diffrax need implicit methods. MuJoCo's friction is a soft constraint, which
  creeps; its error falls with the step.
* **Bodies.** Drake, MuJoCo and Exudyn compute any mechanism in three dimensions, and decide in each step what it
  consists of; flexarm writes C for the model at hand, where what is planar, constant or zero is left out.
* MuJoCo has no general linear systems, so the first problem is not for it. Exudyn calls Python for the torque of
  the second, and is put together anew for each run.
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
    parts += [SLIDING.format(smooth=SMOOTH), _table(found["sliding"])]
    parts += [TWO_LINKS, _table(found["two_links"]), READING]
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
    lines = ["| tool | how | 10 s take | times flexarm's | error | set-up | repeats |", "|---|---|---|---|---|---|---|"]
    for row in rows:
        milliseconds, ratio = 1e3 * row["seconds"], row["seconds"] / ours
        told = f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"
        setup = "-" if row.get("setup") is None else f"{row['setup']:.2g} s" if row["setup"] >= 0.01 else "< 0.01 s"
        took = f"{milliseconds:.3g} ms"
        cells = (row["tool"], row["how"], took, told, f"{row['error']:.1e}", setup, str(row["repeats"]))
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
