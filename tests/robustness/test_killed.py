"""kill -9 at seeded random moments of a sweep, a run and an export: nothing lost or half-written, no process left."""

from __future__ import annotations

import shutil
import time
import zipfile
from pathlib import Path

import pyarrow.parquet
import pytest

import flexarm
from tests.robustness.killed import command, kills

SPIN = """\
schema: 1
name: spin
blocks:
  source: {type: Step, height: 2 N.m}
  torque: {type: Torque}
  wheel: {type: Inertia, inertia: 0.5 kg.m2}
connect:
  - [source.out, torque.torque]
  - [torque.shaft, wheel.shaft]
simulate: {stop: 1 s, step: 10 ms, record: [wheel.shaft.speed]}
"""


@pytest.fixture
def spin(tmp_path: Path) -> Path:
    (tmp_path / "spin.yaml").write_text(SPIN)
    return tmp_path


def timed(arguments: list[str], folder: Path, **settings: str) -> float:
    """Run a command undisturbed; how long it took (s), so that kills fall into its work on any machine."""
    begun = time.monotonic()
    done = command(arguments, folder, **settings)
    assert done.returncode == 0, done.stderr
    return time.monotonic() - begun


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_sweep_goes_on_after_each_kill(spin: Path, workers: str) -> None:
    """After eight kills the files are those of a sweep that nothing disturbed, and parts were never lost."""
    asked = ["sweep", "spin.yaml", "-v", "wheel.inertia=1:2:5000", "--keep", "100 ms", "--workers", workers]
    spent = timed([*asked, "-o", "calm"], spin)
    asked = [*asked, "-o", "killed"]
    parts = spin / "killed" / "runs.parquet.parts"
    there: set[str] = set()
    hits = middle = 0
    seed = 20240601 + int(workers)

    def more() -> bool:
        return len(list(parts.glob("runs*.parquet"))) > len([name for name in there if name.startswith("runs")])

    for hit in kills(asked, spin, times=8, longest=0.2 * spent, seed=seed, begun=more):
        hits += hit
        if not hit:
            continue
        found = {path.name for path in parts.glob("[!.]*.parquet")}
        assert there <= found or (spin / "killed" / "runs.parquet").exists(), "whole parts are gone"
        there = found
        middle += bool(found)
        for path in parts.glob("[!.]*.parquet"):
            pyarrow.parquet.read_table(path)
    print(f"killed {hits} of 8")
    assert hits >= 3, "the commands ended before they were killed"
    assert middle, "no command was killed in the middle of its work"
    last = command(asked, spin)
    assert last.returncode == 0, last.stderr
    for name in ("runs.parquet", "trajectories.parquet"):
        assert (spin / "killed" / name).read_bytes() == (spin / "calm" / name).read_bytes()
    assert sorted(path.name for path in (spin / "killed").iterdir()) == ["runs.parquet", "trajectories.parquet"]
    speeds = flexarm.read(spin / "killed" / "runs.parquet")
    assert speeds["wheel.shaft.speed.final"] == pytest.approx(2 / speeds["wheel.inertia"], rel=1e-12)


@pytest.mark.slow
def test_an_export_is_whole_or_not_there(spin: Path) -> None:
    """Whatever the moment, the file of that name is a whole FMU; the next export does not mind what is left."""
    asked = ["export", "srv02-bare", "--platform", "linux64", "-o", "x.fmu"]
    spent = timed([*asked[:-1], "y.fmu"], spin, FLEXARM_CACHE=str(spin / "other"))
    hits = 0
    for k, hit in enumerate(kills(asked, spin, times=8, longest=0.5 * spent, seed=20240603)):
        hits += hit
        for path in spin.glob("x*.fmu"):
            with zipfile.ZipFile(path) as archive:
                assert archive.testzip() is None
        if k % 2:
            (spin / "x.fmu").unlink(missing_ok=True)
        else:
            shutil.rmtree(spin / "cache", ignore_errors=True)  # so that the compiler is among what is interrupted
    print(f"killed {hits} of 8")
    assert hits >= 3, "the commands ended before they were killed"
    assert command(asked, spin).returncode == 0
    assert (spin / "x.fmu").read_bytes() == (spin / "y.fmu").read_bytes()
    left = {path.name for path in spin.iterdir() if path.name.startswith(".")}
    assert all(name.startswith((".x-", ".x_linear-")) for name in left), left


@pytest.mark.slow
def test_a_run_writes_whole_files(spin: Path) -> None:
    """A table of 5 MB, so that some kills fall into the writing of it."""
    asked = ["run", "spin.yaml", "--stop", "100 s", "--step", "1 ms", "-o", "out.csv"]
    spent = timed([*asked[:-1], "calm.csv"], spin)
    whole = (spin / "calm.csv").read_bytes()
    hits = 0
    for hit in kills(asked, spin, times=8, longest=spent, seed=20240604):
        hits += hit
        if (spin / "out.csv").exists():
            assert (spin / "out.csv").read_bytes() == whole
            (spin / "out.csv").unlink()
    print(f"killed {hits} of 8")
    assert hits >= 3, "the commands ended before they were killed"
    assert command(asked, spin).returncode == 0
    assert (spin / "out.csv").read_bytes() == whole
