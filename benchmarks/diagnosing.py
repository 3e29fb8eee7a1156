"""What a diagnosis costs: whole processes on concealed cases of one effect, each on a fresh copy."""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.concealed.case import draw
from benchmarks.concealed.drawing import Options
from benchmarks.concealed.scenario import write

CONCEALED = (
    ("srv02-flexible", "coulomb_friction"),
    ("geared-two-mass", "backlash"),
    ("geared-two-mass", "torque_ripple"),
    ("harmonic-arm", "stray_spring"),
    ("pendulum", "viscous_friction"),
    ("belt-axis", "delay"),
)
"""Plants of the proof, and what is concealed in each."""

SIZE = 10.0
"""Of the effect, in detection thresholds."""

SHORT = Options(seconds=1.6, rate=500.0, kinds=("multi_step", "chirp", "prbs"))
LONG = Options(seconds=4.0, rate=1000.0, kinds=("multi_step", "chirp", "prbs", "ramp"))


def diagnoses() -> Iterator[tuple[str, str, str]]:
    """Median processor time over the cases, and the most memory; code of the models is made beforehand."""
    memory = []
    for told, options, goal in (
        ("three recordings of 800 rows", SHORT, "<= 5 s"),
        ("four recordings of 4000 rows", LONG, "<= 15 s"),
    ):
        costs = [_cost(plant, effect, options) for plant, effect in CONCEALED]
        times = sorted(seconds for seconds, _ in costs)
        memory += [size for _, size in costs]
        measured = f"{statistics.median(times):.1f} s ({times[0]:.1f} to {times[-1]:.1f} s, {len(times)} cases)"
        yield f"diagnosis of {told}, one effect: processor time, median", measured, goal
    yield "the most memory of these diagnoses", f"{max(memory):.0f} MB", "< 500 MB"


def _cost(plant: str, effect: str, options: Options) -> tuple[float, float]:
    """Processor time (s) and memory (MB) of the second of two diagnoses: the first makes the code of the models.

    Raises:
        OSError: a diagnosis failed.
    """
    case = draw(plant, [effect], [SIZE], 1, options)
    for _ in range(2):
        with tempfile.TemporaryDirectory() as folder:
            write(case, Path(folder) / "case", Path(folder) / "sealed")
            found = _diagnosed(Path(folder) / "case")
    return found


def _diagnosed(folder: Path) -> tuple[float, float]:
    command = [sys.executable, "-m", "flexarm", "diagnose", str(folder / "scenario.yaml"), "--json", "--workers", "1"]
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS")}
    nowhere = [(os.POSIX_SPAWN_OPEN, n, os.devnull, os.O_WRONLY, 0) for n in (1, 2)]
    child = os.posix_spawn(sys.executable, command, {**os.environ, **threads}, file_actions=nowhere)
    _, status, used = os.wait4(child, 0)
    if status != 0:
        raise OSError(f"'{' '.join(command)}' ended with status {status}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
