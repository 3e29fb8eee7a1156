"""What a 1 ms step of an exported FMU costs, beside a hand-written C loop and a pythonfmu FMU of the same model.

Prints ratios and writes them to benchmarks/results/fmu.json, from which docs/fmu-conformance.md is made.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import fmu
from benchmarks.reference_arm import FOLDER, OUTPUTS, ByHand, model
from engine.compile import library
from fmu.loaded import Loaded, loaded

RESULTS = Path(__file__).parent / "results" / "fmu.json"
STEP, VOLTAGE, STEPS, ROUNDS = 1e-3, 1.5, 20_000, 15


class Loop:
    """Steps of a started FMU in C."""

    def __init__(self, instance: Loaded) -> None:
        text = (FOLDER / "loop.c").read_text(encoding="utf-8")
        exported = '\n__attribute__((visibility("default"))) int loop_'
        loops = library(text.replace("\nint loop_", exported))
        self._run, self._states = loops.loop_run, loops.loop_states
        self._states.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_long]
        dll = instance.raw.dll
        self._pair = [ctypes.cast(f, ctypes.c_void_p) for f in (dll.fmi2GetFMUstate, dll.fmi2SetFMUstate)]
        self._run.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_long, ctypes.c_double, ctypes.c_long]
        self._step = ctypes.cast(instance.raw.dll.fmi2DoStep, ctypes.c_void_p)
        self._component, self._count = instance.raw.component, 0

    def run(self, steps: int) -> None:
        """Take steps of `STEP`."""
        status = self._run(self._step, self._component, self._count, STEP, steps)
        assert status == 0, status
        self._count += steps

    def save_and_restore(self, times: int) -> None:
        """Save the state and go back to it."""
        status = self._states(*self._pair, self._component, times)
        assert status == 0, status


def _started(path: Path, stack: contextlib.ExitStack) -> Loaded:
    instance = stack.enter_context(loaded(path))
    with instance.starting(0.0):
        instance.set(instance.names("input"), [VOLTAGE])
    return instance


def _seconds(run: Callable[[], object]) -> float:
    begun = time.perf_counter()
    run()
    return time.perf_counter() - begun


def _by_pythonfmu(folder: Path) -> Path:
    from pythonfmu.builder import FmuBuilder

    with contextlib.redirect_stdout(io.StringIO()):
        return Path(FmuBuilder.build_FMU(FOLDER / "arm8_pythonfmu.py", dest=folder))


def measure() -> dict[str, Any]:
    """Every figure."""
    arm = model()
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        begun = time.perf_counter()
        both = fmu.export(arm, folder / "both.fmu", step=STEP)
        first = time.perf_counter() - begun
        warm = _seconds(lambda: fmu.export(arm, folder / "again.fmu", step=STEP))
        instance, hand = _started(both, stack), ByHand()
        loop = Loop(instance)
        loop.run(1000)
        hand.run(VOLTAGE, STEP, 1000)
        difference = np.abs(np.array(instance.get(instance.names("output"))) - hand.outputs(VOLTAGE)).max()
        python = _started(_by_pythonfmu(folder), stack)
        slow = Loop(python)
        slow.run(1000)
        angle, deflection = python.get(["angle", "deflection"])
        beside = max(abs(angle - hand.outputs(VOLTAGE)[0]), abs(deflection - hand.outputs(VOLTAGE)[1]))
        ours, theirs, pythons, states = [], [], [], []
        for _ in range(ROUNDS):
            ours.append(_seconds(lambda: loop.run(STEPS)) / STEPS)
            states.append(_seconds(lambda: loop.save_and_restore(STEPS)) / STEPS)
            theirs.append(_seconds(lambda: hand.run(VOLTAGE, STEP, STEPS)) / STEPS)
            pythons.append(_seconds(lambda: slow.run(STEPS // 40)) / (STEPS // 40))
        return {
            "outputs": list(OUTPUTS),
            "difference_from_hand_written": float(difference),
            "pythonfmu_difference": float(beside),
            "ratio_to_hand_written": min(ours) / min(theirs),
            "states_in_steps": min(states) / min(ours),
            "pythonfmu_ratio": min(pythons) / min(ours),
            "step_ns": 1e9 * min(ours),
            "hand_written_ns": 1e9 * min(theirs),
            "pythonfmu_ns": 1e9 * min(pythons),
            "export_first_s": first,
            "export_warm_s_per_platform": warm / 2,
            "two_platforms_kB": both.stat().st_size / 1000,
        }


def main() -> None:
    """Measure, print, keep."""
    found = measure()
    print(f"outputs: FMU and hand-written C differ by {found['difference_from_hand_written']:.1e} after 1 s")
    print(f"1 ms doStep / the same step in hand-written C: {found['ratio_to_hand_written']:.3f} (bound 0.9)")
    print(f"saving and restoring the state / a 1 ms doStep: {found['states_in_steps']:.2f} (bound 2)")
    print(f"1 ms doStep of a pythonfmu FMU / of ours: {found['pythonfmu_ratio']:.0f}")
    print(f"export with a warm cache: {found['export_warm_s_per_platform']:.2f} s a platform (bound 1)")
    print(f"archive for two platforms: {found['two_platforms_kB']:.0f} kB (bound 120)")
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    assert found["difference_from_hand_written"] < 1e-9
    assert found["pythonfmu_difference"] < 1e-9


if __name__ == "__main__":
    main()
