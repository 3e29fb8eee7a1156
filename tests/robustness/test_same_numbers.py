"""Thread counts and hash seeds do not change a result: the same bytes from every command."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.diagnosis.plants import case
from tests.robustness.killed import command

WAYS = [("0", "1"), ("1", "2"), ("4242", "4")]
"""PYTHONHASHSEED, and threads of OpenBLAS and OpenMP."""


def results(folder: Path, arguments: list[str], written: list[str]) -> list[dict[str, bytes]]:
    """What a command prints and writes, for each way."""
    found = []
    for seed, threads in WAYS:
        done = command(
            arguments,
            folder,
            PYTHONHASHSEED=seed,
            OPENBLAS_NUM_THREADS=threads,
            OMP_NUM_THREADS=threads,
            MKL_NUM_THREADS=threads,
        )
        assert done.returncode == 0, done.stderr
        found.append({name: (folder / name).read_bytes() for name in written})
        for name in written:
            (folder / name).unlink()
        # The line with the time spent is the only one that may differ.
        shown = [line for line in done.stdout.splitlines() if " s of work" not in line]
        found[-1]["stdout"] = "\n".join(shown).encode()
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "written"),
    [
        (["run", "reference-b", "--stop", "1 s", "-o", "x.csv"], ["x.csv"]),
        (["run", "two-link-flexible", "--stop", "0.2 s", "-o", "x.parquet"], ["x.parquet"]),
        (["linearise", "two-link-flexible", "-o", "x.json", "-o", "x.npz"], ["x.json", "x.npz"]),
        (["linearise", "quanser-single-link", "-o", "x.json", "-o", "x.m"], ["x.json", "x.m"]),
        (
            ["sweep", "srv02-3mass-b2", "-v", "*~tolerance", "-n", "20", "--stop", "0.5 s", "-o", "x.parquet"],
            ["x.parquet"],
        ),
        (["export", "srv02-bare", "--platform", "linux64", "-o", "x.fmu"], ["x.fmu"]),
        (["check", "reference-c"], []),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, list) else None,
)
def test_the_same_bytes(arguments: list[str], written: list[str], tmp_path: Path) -> None:
    first, *others = results(tmp_path, arguments, written)
    for other in others:
        assert other == first


@pytest.mark.slow
def test_a_fit_gives_the_same_numbers(tmp_path: Path) -> None:
    """Two recordings to fit, one held out; the workers are threads."""
    path = case(tmp_path, coulomb=0.0, seed=5)
    answers = []
    for k, (seed, threads) in enumerate(WAYS):
        asked = ["fit", path.name, "steps", "chirp", "--hold-out", "ramp", "--json", "--workers", str(k + 1)]
        done = command(asked, tmp_path, PYTHONHASHSEED=seed, OPENBLAS_NUM_THREADS=threads, OMP_NUM_THREADS=threads)
        assert done.returncode == 0, done.stderr
        answers.append(done.stdout)
        shutil.rmtree(tmp_path / "cache", ignore_errors=True)
    assert answers[1] == answers[0]
    assert answers[2] == answers[0]
