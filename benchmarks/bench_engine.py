"""Costs of the engine, as a table: ``make bench``. Figures are of the machine at hand; ratios are from one run.

What is compared is run in turns, and the least time of each counts, since other work on the machine only adds.
"""

from __future__ import annotations

import ctypes
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import oracle, reference
from benchmarks.diagnosing import diagnoses
from engine import lanes, native
from engine.batch import Case, Failure, batch
from engine.compile import FLAGS, version
from engine.model import Model
from engine.native import Outcome
from engine.simulate import prepare, simulate
from engine.tangent import tangents
from scenarios.load import load

RESULTS = Path(__file__).parent / "results.md"
TUNED = [
    "motor.resistance",
    "motor.torque_constant",
    "motor.back_emf_constant",
    "motor.rotor_inertia",
    "friction.coulomb_friction",
    "friction.static_friction",
    "friction.stribeck_velocity",
    "contact.stiffness",
    "contact.half_gap",
    "zone.upper",
    "link.flexural_rigidity",
    "link.mass",
]
Row = tuple[str, str, str]


def least(repeats: int, *actions: Callable[[], float]) -> list[float]:
    """Least seconds of each action, run in turns."""
    found = [float("inf")] * len(actions)
    for _ in range(repeats):
        found = [min(best, action()) for best, action in zip(found, actions, strict=True)]
    return found


def timed(function: Callable[..., Any], *arguments: Any, **settings: Any) -> Callable[[], float]:
    """An action that calls the function and returns the seconds of processor time spent in it."""

    def action() -> float:
        started = time.process_time()
        function(*arguments, **settings)
        return time.process_time() - started

    return action


def processor(function: Callable[..., Any], *arguments: Any) -> Callable[[], float]:
    """An action that calls the function and returns the processor time (s) of the processes that it ran."""

    def action() -> float:
        begun = os.times()
        function(*arguments)
        ended = os.times()
        return ended.children_user + ended.children_system - begun.children_user - begun.children_system

    return action


def inner(model: Model, stop: float, internal_step: float | None = None) -> tuple[Callable[[], float], list[Outcome]]:
    """An action that runs the compiled code and returns the seconds spent in it; a list that keeps its last outcome."""
    job, function = prepare(model, stop, 1e-3, internal_step=internal_step), native.entry(model)
    outcomes: list[Outcome] = []

    def action() -> float:
        spent: list[float] = []

        def call(c: Any) -> int:
            spent.append(timed(function, ctypes.byref(c), None)())
            return 0

        outcomes[:] = [native.call(model, job, call)]
        return spent[0]

    return action, outcomes


def against_hand() -> Iterator[Row]:
    """The reference models, 10 s at 1 kHz in steps of 1 ms, against C written by hand."""
    for name, goal in (("a", "1.1"), ("b", "1.1"), ("c", "-")):
        model, run = load(f"reference-{name}").build(), reference.loop(name)
        y = np.zeros((10_001, reference.OUTPUTS[name]))
        action, last = inner(model, 10.0, 1e-3)

        def first(model: Model = model) -> None:
            model.begun.clear()  # as with parameters that this model was never run with
            model.steps.clear()
            simulate(model, 10.0)

        hand, ours, theirs, again, new = least(
            60, timed(run, 10_000, 1, y), action, inner(model, 10.0)[0], timed(simulate, model, 10.0), timed(first)
        )
        apart = reference.disagreement(last[0].y, y)
        assert apart < 1e-9, f"model {name}: the hand-written loop gives other outputs ({apart:.2g})"
        yield (
            f"model {name.upper()}, 10 s: time in compiled code / hand-written C loop",
            f"{ours / hand:.2f} ({ours * 1e3:.2f} ms / {hand * 1e3:.2f} ms)",
            f"<= {goal}" if goal != "-" else "-",
        )
        for what, whole in (("begun like a run before", again), ("begun as none before", new)):
            yield (
                f"model {name.upper()}, 10 s: `simulate()` as called from Python / its compiled code, {what}",
                f"{whole / theirs:.2f} ({whole * 1e3:.2f} ms / {theirs * 1e3:.2f} ms)",
                "<= 1.2" if whole == again else "-",
            )
        yield f"model {name.upper()}: outputs apart from the loop's, relative", f"{apart:.1e}", "<= 1e-9"


def against_scipy() -> Iterator[Row]:
    """Speed and accuracy on B against scipy with events."""
    model = load("reference-b").build()
    spent = oracle.run(1.5, "RK45", 1e-6, begin=0.5)[1]
    ours = least(20, timed(simulate, model, 10.0, internal_step=1e-3))[0]
    yield (
        "model B: scipy `solve_ivp` (RK45, rtol 1e-6, events, restarted each sample) / `simulate()`",
        f"{spent * 10 / ours:.0f} (scipy {spent:.2f} s per simulated second, over 0.5 to 1.5 s)",
        ">= 300",
    )
    exact = oracle.run(10.0, "DOP853", 1e-11)[0]
    for step, goal in ((1e-3, "2e-4"), (2.5e-4, "1e-5")):
        speed = simulate(model, 10.0, internal_step=step)["motor.shaft.speed"]
        error = np.sqrt(np.mean((speed - exact) ** 2) / np.mean(exact**2))
        what = f"model B, 10 s: rms error of the motor's speed at {step * 1e3:g} ms against DOP853, rtol 1e-11"
        yield what, f"{error:.1e}", f"<= {goal}"


def derivatives() -> Iterator[Row]:
    """Tangents against one simulation, both by C of their own."""
    model, enough = load("reference-b").build(), native.ENOUGH
    native.forget()
    native.ENOUGH = -math.inf
    one, twelve = least(
        20,
        timed(simulate, model, 10.0, internal_step=1e-3),
        timed(tangents, model, 10.0, wrt=TUNED, internal_step=1e-3),
    )
    native.ENOUGH = enough
    yield (
        "model B, 10 s: run with tangents to 12 parameters / run, both compiled",
        f"{twelve / one:.1f} ({twelve * 1e3:.1f} ms / {one * 1e3:.1f} ms)",
        "<= 4",
    )


_READY = """
import os, time
from engine import lanes, native
from engine.simulate import simulate
from engine.tangent import tangents
from scenarios.amend import AtFlange
from scenarios.load import load
from scenarios.variant import edited
import blocks.registry

def spent(action, repeats=1):
    found = []
    for _ in range(repeats):
        before, own = sum(os.times()[2:4]), time.process_time()
        action()
        found.append(time.process_time() - own + sum(os.times()[2:4]) - before)
    return min(found)

def first():
    native.forget()
    simulate(load({name!r}).build(), 10.0)

def ready():
    native.forget()
    made = load({name!r}).build()
    simulate(made, 1e-3)
    native.entry(made)

scenario = load({name!r})
names = [p.name for p in scenario.build().parameters][:8]
drags = iter(range(1, 100))

def variant():
    native.forget()
    edit = AtFlange("drag", "QuadraticDrag", {flange!r}, "shaft", {{"drag": f"{{next(drags)}} uN.m.s2/rad2"}})
    made = edited(scenario, [edit]).build()
    simulate(made, 1.0)
    tangents(made, 1.0, wrt=["drag.drag", *names])

known = load("quanser-single-link").build()
simulate(known, 0.1)
tangents(known, 0.1, wrt=[p.name for p in known.parameters][:9])
{then}
print(spent(first), spent(ready), spent(ready, 5), spent(variant), spent(variant, 5))
"""


def readiness() -> Iterator[Row]:
    """Processor time from a scenario file to a first run, in fresh processes that do not know it; and of variants."""
    for name, flange in (("reference-b", "motor.shaft"), ("reference-c", "arm.joint1")):
        rows = []
        for _ in range(4):
            with tempfile.TemporaryDirectory() as cache:
                # What a user has after the first diagnosis: units, compiler and byte code are known, this model is not.
                made = {"FLEXARM_CACHE": cache}
                for then in ("raise SystemExit", ""):
                    text = _run([sys.executable, "-c", _READY.format(name=name, flange=flange, then=then)], made)
                rows.append([float(part) for part in text.split()])
        first, own, known, variant, later = (min(column) for column in zip(*rows, strict=True))
        what = "processor time, the compiler's too"
        yield f"{name}: a new scenario loaded, built and run for 10 s; {what}", f"{first:.2f} s", "< 0.5 s"
        yield f"{name}: the same with C of its own generated and compiled", f"{own:.2f} s", "-"
        yield f"{name}: the same in a process that knows it", f"{known:.3f} s", "< 0.1 s"
        yield (
            f"{name}: an effect put in, built, run for 1 s, and for 1 s with tangents to 9 parameters; {what}",
            f"{later:.3f} s (the first in a process {variant:.3f} s)",
            "< 0.25 s",
        )


def _run(command: list[str], extra: dict[str, str] | None = None) -> str:
    root = str(Path(__file__).resolve().parents[1])
    environment = os.environ | {"PYTHONPATH": root} | (extra or {})
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True, cwd=root).stdout


def many() -> Iterator[Row]:
    """A batch over threads, once its code is there; and run by run, as models go that lanes are not for."""
    model = load("reference-b").build()
    values = np.linspace(2.2, 3.0, 1000)

    def work() -> None:
        for result in batch(model, (Case({"motor.resistance": float(v)}) for v in values), 10.0, workers=2):
            assert not isinstance(result, Failure)

    def elapsed() -> float:
        started = time.perf_counter()
        work()
        return time.perf_counter() - started

    def alone() -> float:
        made, lanes._lanes[model.law] = lanes.lanes_of(model), lanes.Lanes(model, possible=False)
        try:
            return timed(work)()
        finally:
            lanes._lanes[model.law] = made

    native.entry(model)
    lanes.lanes_of(model).make(model)
    seconds, together, apart = least(4, elapsed, timed(work), alone)
    what = "model B: 1000 runs of 10 s on 2 threads"
    yield what, f"{seconds:.2f} s", "< 1.2 s"
    yield (
        f"{what}: processor time, in lanes / run by run",
        f"{together / apart:.2f} ({together:.2f} s / {apart:.2f} s)",
        "-",
    )


def command_line() -> Iterator[Row]:
    """Whole processes: the command's help, an import, and a scenario that was run before."""
    run = [sys.executable, "-m", "flexarm", "run", "quanser-single-link"]
    _run(run)
    told, imported, known = least(
        8,
        processor(_run, [sys.executable, "-m", "flexarm", "--help"]),
        processor(_run, [sys.executable, "-c", "import flexarm"]),
        processor(_run, run),
    )
    what = "whole process, processor time"
    yield f"`flexarm --help`, {what}", f"{told:.2f} s", "< 0.15 s"
    yield f"`import flexarm`, {what}", f"{imported:.2f} s", "< 0.15 s"
    yield f"`flexarm run` of a known scenario, {what}", f"{known:.2f} s", "< 0.6 s"


def growth() -> Iterator[Row]:
    """Time of an RK4 step against modes and links."""
    for modes in (2, 4, 8, 16, 32):
        model = load("reference-a", [f"link.modes={modes}"]).build()
        yield f"model A with {modes} modes: time per RK4 step", f"{_per_step(model):.2f} us", "-"
    actions, ready = [], []
    for links in _LINKS:
        started = time.perf_counter()
        model = load("reference-c", text=ARM.format(links=links)).build()
        native.entry(model)
        ready.append(time.perf_counter() - started)
        actions.append(inner(model, 0.2))
    costs = dict(zip(_LINKS, least(15, *(action for action, _ in actions)), strict=True))
    for (links, seconds), (_, last), spent in zip(costs.items(), actions, ready, strict=True):
        what = f"serial arm of {links} links with 2 modes each: time per RK4 step"
        yield what, f"{seconds / last[0].steps * 1e6:.2f} us (ready in {spent:.1f} s)", "-"
    yield "serial arm: cost of a step from 16 to 32 links", f"{costs[32] / costs[16]:.2f} x", "<= 2.1 x"


_LINKS = (1, 2, 4, 8, 16, 32)
ARM = """
schema: 1
name: arm
blocks:
  torque: {{type: Sine, amplitude: 1 mN.m, frequency: 1 Hz}}
  drive: {{type: Torque}}
  arm: {{type: SerialArm, links: {links}, modes: 2, length: 0.2 m, mass: 20 g, flexural_rigidity: 0.05 N.m2,
         hub_inertia: 5e-5 kg.m2, viscous_friction: 1e-3 N.m.s/rad, damping_ratio: 0.01}}
connect:
  - [torque.out, drive.torque]
  - [drive.shaft, arm.joint1]
simulate: {{stop: 0.2 s, record: [arm.joint1.angle]}}
"""


def _per_step(model: Model) -> float:
    action, last = inner(model, 0.2)
    return least(8, action)[0] / last[0].steps * 1e6


def main() -> None:
    """Measure, print and write the results."""
    rows: list[Row] = []
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    for part in (against_hand, derivatives, readiness, many, command_line, growth, against_scipy, diagnoses):
        for row in part():
            rows.append(row)
            print(" | ".join(row), flush=True)
    lines = [
        "# Costs of the engine and of a diagnosis",
        "",
        "Written by `make bench` (`benchmarks/bench_engine.py`). What is compared ran in turns in one process, and the",
        "least processor time of each counts. The loops in `benchmarks/reference` were written by hand for the values",
        "of the reference models, their constants worked out beforehand and, in A and B, without the payload, zero",
        "there; flexarm's code keeps every parameter tunable. Both are compiled with the same compiler and flags.",
        "Diagnoses (`benchmarks/diagnosing.py`) are of cases of the proof with one effect of ten detection thresholds.",
        "",
        f"{platform.machine()}, {os.cpu_count()} cores, {version().splitlines()[0]}, `{' '.join(FLAGS[1:5])}`,"
        f" Python {platform.python_version()}; begun at a load of {busy:.1f}, from which times suffer",
        "",
        "| what | measured | goal |",
        "|---|---|---|",
        *[f"| {what} | {measured} | {goal} |" for what, measured, goal in rows],
        "",
    ]
    RESULTS.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
