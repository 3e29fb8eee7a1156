"""A diagnosis that is interrupted or killed goes on where it stopped, to the verdict it would have come to."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from diagnosis.api import gather
from diagnosis.effects.catalogue import EFFECTS
from diagnosis.search.allowance import Spent
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.search import study
from diagnosis.verdict.verdict import judge
from engine.errors import FlexarmError
from engine.spread import JsonStore
from flexarm.commands.diagnose import PROGRESS
from flexarm.console.interrupt import INTERRUPTED
from scenarios.load import load
from tests.diagnosis.plants import case
from tests.robustness.killed import ROOT, wait_for_group

TRUTH: dict[str, Any] = {"coulomb": 4.0e-4, "seed": 3}
LEFT_OUT = (
    *("inductance", "gravity", "torque_ripple", "extra_mode", "outside_vibration", "stray_spring", "payload"),
    *("sensor_scale", "sensor_lag", "sensor_bias", "rectified_sensor", "wrong_parameter", "delay"),
    *("load_dependent_friction", "current_limit", "cogging", "transmission_error"),
    *("rate_limit", "command_quantisation", "supply_sag", "belt_slack", "end_stop", "warm_up", "friction_warm_up"),
    *("quadratic_load_friction", "dead_time"),
)
FITS = 3
"""Fits that are done when the command is stopped."""
LONGEST = 900.0


def started(folder: Any, workers: Any, output: Any) -> Any:
    flags = [part for effect in LEFT_OUT for part in ("--without", effect)]
    asked = ["diagnose", "scenario.yaml", "-o", output, "--workers", str(workers), *flags]
    return subprocess.Popen(
        [sys.executable, "-m", "flexarm", *asked],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "120"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def finished(folder: Any, workers: Any, output: Any) -> tuple[Any, bytes]:
    process = started(folder, workers, output)
    said, complaint = process.communicate(timeout=LONGEST)
    assert process.returncode == 0, complaint
    assert (folder / output / "report.html").exists()
    assert not (folder / output / PROGRESS).exists()
    return said, (folder / output / "diagnosis.json").read_bytes()


def stopped(folder: Any, workers: Any, output: Any, number: Any) -> tuple[Any, Any, list[Any]]:
    """Start it, and send a signal when some fits are done; what it said on stderr, its code, and the fits kept."""
    process = started(folder, workers, output)
    kept = folder / output / PROGRESS
    deadline = time.monotonic() + LONGEST
    while len(list(kept.glob("[!.]*.json"))) < FITS:
        assert process.poll() is None, f"it ended before it was stopped: {process.communicate()[1]}"
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(number)
    _, complaint = process.communicate(timeout=LONGEST)
    wait_for_group(process.pid)
    return complaint, process.returncode, sorted(kept.glob("[!.]*.json"))


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("bench")
    case(folder, **TRUTH)
    return folder


@pytest.fixture(scope="module")
def calm(bench: Any) -> Any:
    """What a command that nothing disturbs writes."""
    return finished(bench, 2, "calm")[1]


def resumed(bench: Any, calm: Any, output: Any, workers: Any) -> None:
    assert not (bench / output / "diagnosis.json").exists()
    for path in (bench / output / PROGRESS).glob("[!.]*.json"):
        assert {"x", "cost"} <= set(json.loads(path.read_text())["value"])
    assert finished(bench, workers, output)[1] == calm


def test_interrupted_it_says_so_and_goes_on(bench: Any, calm: Any) -> None:
    complaint, code, kept = stopped(bench, 2, "interrupted", signal.SIGINT)
    assert code == INTERRUPTED == 130
    assert "interrupted" in complaint
    assert "goes on where it stopped" in complaint
    assert "Traceback" not in complaint
    assert len(kept) >= FITS
    resumed(bench, calm, "interrupted", 2)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_killed_it_goes_on(bench: Any, calm: Any, workers: int) -> None:
    """Twice in a row, and then to the end."""
    output = f"killed{workers}"
    fits = 0
    for _ in range(2):
        _, code, kept = stopped(bench, workers, output, signal.SIGKILL)
        assert code == -signal.SIGKILL
        assert len(kept) >= max(FITS, fits)
        fits = len(kept)
    resumed(bench, calm, output, workers)


@pytest.mark.slow
def test_one_thread_comes_to_the_same_bytes(bench: Any, calm: Any) -> None:
    assert finished(bench, 1, "alone")[1] == calm


class Counted(dict[str, Any]):
    """A store that counts what is put in, and stops the study when there is enough."""

    def __init__(self, given: Any = (), most: Any = None) -> None:
        super().__init__(given)
        self.put, self.most = 0, most

    def __setitem__(self, key: Any, value: Any) -> None:
        if self.put == self.most:
            raise KeyboardInterrupt
        self.put += 1
        super().__setitem__(key, json.loads(json.dumps(value)))


@pytest.fixture(scope="module")
def quick(bench: Any) -> Any:
    """In this process, with two effects alone."""
    scenario = load(bench / "scenario.yaml")
    few: tuple[str, ...] = (
        *LEFT_OUT,
        *("saturation", "uneven_gain", "offset", "lag", "quadratic_drag", "viscous_friction"),
    )
    few = (*few, "stribeck_friction", "direction_dependent_friction")

    def run(store: Any = None, seed: int = 0, most: float = math.inf) -> Any:
        recordings = gather(scenario, [], [])
        return study(CandidateFitter(scenario, recordings, 1, seed, store, Spent(most)), without=few)

    return run


def numbers(made: Any) -> Any:
    return json.dumps(judge(made).numbers(), sort_keys=True)


def test_what_is_kept_is_not_fitted_again(quick: Any) -> None:
    """However far it came: the rest is fitted, nothing twice, and every number is that of a study without a store."""
    whole = Counted()
    expected = numbers(quick())
    assert numbers(quick(whole)) == expected
    assert whole.put == len(whole) >= 3
    for far in (1, len(whole) - 1):
        part = Counted(most=far)
        with pytest.raises(KeyboardInterrupt):
            quick(part)
        assert len(part) == far
        rest = Counted(part)
        assert numbers(quick(rest)) == expected
        assert rest.put == len(whole) - far
        assert dict(rest) == dict(whole)


def test_a_study_whose_time_is_over_tells_what_it_found_and_goes_on_with_more(quick: Any) -> None:
    """The refit alone takes more than one operation; with all that it takes, it is the study without a limit."""
    store = Counted()
    early = judge(quick(store, most=1.0))
    assert early.study.ended_early
    assert early.numbers()["ended_early"]
    assert any("time that was allowed was over" in warning for warning in early.warnings)
    assert not early.study.trials
    first = len(store)
    assert numbers(quick(store)) == numbers(quick())
    assert store.put > first
    again = quick(Counted(store), most=1.0)
    assert again.ended_early
    assert not again.trials


def test_what_a_study_takes_hangs_neither_on_threads_nor_on_what_was_kept(bench: Any) -> None:
    """So a time that is allowed ends it at the same fit."""
    scenario, store = load(bench / "scenario.yaml"), Counted()
    tried = {"coulomb_friction", "dead_zone", "lag"}
    took = list[int]()
    for workers in (1, 2, 2):
        spent = Spent()
        fitter = CandidateFitter(scenario, gather(scenario, [], []), workers, 0, store if took else None, spent)
        study(fitter, without=sorted(set(EFFECTS) - tried))
        took.append(spent.work.done)
    assert took[0] > 0
    assert took == took[:1] * 3


def test_fits_of_another_seed_or_other_data_are_not_taken(quick: Any, bench: Any, tmp_path: Path) -> None:
    first = Counted()
    quick(first)
    again = Counted(first)
    quick(again)
    assert again.put == 0
    quick(again, seed=1)
    assert again.put > 0
    path = case(tmp_path, **(TRUTH | {"seed": 4}))
    scenario = load(path)
    other = Counted(first)
    study(CandidateFitter(scenario, gather(scenario, [], []), 1, store=other), without=[*LEFT_OUT, "dead_zone"], most=1)
    assert other.put > 0


def test_a_fit_that_was_not_written_to_its_end_does_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = JsonStore(tmp_path / "kept")
    store["a"] = {"x": [1.0, 0.1 + 0.2]}

    def half(self: Any, text: Any, **rest: Any) -> None:
        with self.open("w") as out:
            out.write(text[: len(text) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(type(tmp_path), "write_text", half)
    with pytest.raises((OSError, FlexarmError), match="No space left"):
        store["b"] = {"x": [2.0, 3.0]}
    assert "b" not in store
    assert store["a"] == {"x": [1.0, 0.1 + 0.2]}
