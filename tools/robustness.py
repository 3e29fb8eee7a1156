"""Run the robustness properties with many examples and write docs/robustness.md: ``python -m tools.robustness``.

The counts are those of one run with a fixed seed; a property that fails ends the run with its example.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from datetime import timedelta
from pathlib import Path

import hypothesis
from hypothesis import HealthCheck, given, seed, settings

from tests.robustness.guard import LONGEST, REFUSED, RESULT
from tests.robustness.properties import PROPERTIES, Property

PAGE = Path(__file__).resolve().parent.parent / "docs" / "robustness.md"

SHARES = {
    "documents": 1.0,
    "files": 1.0,
    "overrides": 1.0,
    "parameters": 2.0,
    "recordings": 1.5,
    "runs": 2.0,
    "quantities": 3.0,
    "blocks": 5.0,
    "points": 1.0,
    "foreign": 10.0,
    "anchors": 1.0,
    "pages": 0.5,
    "archives": 5.0,
    "states": 2.0,
    "caches": 0.5,
    "sweeps": 0.5,
    "foreign_fmus": 0.5,
}
"""Examples of each property, as a multiple of ``--examples``."""

HEAD = """\
# Robustness

This page is written by `python -m tools.robustness`; the properties are in `tests/robustness/properties.py` and
the modules beside it.

Each example is odd input: a shipped scenario, a recording, a set of parameter values or the arguments of a run,
changed at random (keys deleted, doubled or renamed; values of other kinds, huge, not finite, with other units; bytes
that are not UTF-8; deep nesting; time that runs backwards; parameters from their bounds to 1e308; tables, MATLAB,
JSON and Parquet files that are not what they say; values shared by anchors; markup and control characters in names;
archives with links, paths that lead out, document types and sizes that are not theirs). Every example must end in one
of two ways: a **result** without NaN or infinity, or a **refusal** with a message that says what is wrong and where.
Another exception, a crash, NaN in a result, or more than {longest} s for one example is a failure.

{examples} examples, seed {seed}, hypothesis {version}, {spent} of work. No failures.

| property | what is changed | examples | results | refusals | slowest example |
|---|---|---:|---:|---:|---:|
"""

FOOT = """
While the properties run, the bound on internal steps (`engine.simulate.MOST_STEPS`, 1e9) is lowered, so that this
refusal is met too: a very stiff mode is refused with its state and rate instead of running for hours. `make test`
runs the same properties with fewer examples and fixed choices, and `tests/robustness/test_hostile_input.py` holds
explicit cases: files of a million lines, aliases that multiply, text that is not UTF-8, masses that make the mass
matrix singular, stiff and unstable modes.

## Archives

FMU and SSP files are checked before anything of them is unpacked or parsed (`fmu/archive.py`), wherever they are
read: `flexarm cosim`, `type: FMU`, the FMUs inside of an SSP. Refused are entries that lead out of the archive (`..`,
absolute paths, drive letters, backslashes), links and special files, two entries of one name, encrypted entries, more
than 20000 entries, more than 100 MB plus 50 times the file's size or 4 GB unpacked, XML of more than 64 MB, a million
elements or 100 levels, any document type (so that no entity is expanded, no file and no address read), a model
identifier that is not a C identifier (it names the library to load), components outside of the package, two variables,
components or connectors of one name, connections to nothing, times that are not numbers.
`tests/robustness/test_hostile_archives.py` holds cases of these for each way in, with bounds on time and memory. An
FMU that passes is still a program of its maker's and runs with all rights of the user, in a process of its own: one
that crashes ends that process, and the run with a message. Its names may be any; what it gives must be finite.

## What is kept

Compiled models lie in the cache with their length and hash, and are checked before they are loaded or packed. The saved
state of an FMU in Python is JSON; it names no code, and every field is checked before any is taken over. The parts of a
sweep and the results of a diagnosis that was interrupted are checked before they count, and computed again where they
are damaged. `tests/engine/test_compile.py`, `tests/fmu/test_python_state.py`, `tests/fmu/test_foreign.py` and
`tests/cli/test_sweep.py` hold cases of each. Ctrl-C is heard while C runs (`tests/cli/test_interrupt.py`).

## Files of data

Tables, MATLAB and JSON files are read by `engine/readers`, for recordings and for blocks alike ([ADR
14](adr/0014-foreign-files.md)). Only regular files are opened, so that a pipe or `/dev/zero` is refused; a text file
holds at most 2 GB (200 MB for `Table` and `Spline`), a JSON file 200 MB, a MATLAB file 2 GB and 100000 arrays, and
what is compressed unpacks to at most 100 MB plus 50 times the file's size; a Parquet file to ten million cells plus
ten for each byte. One CSV reader takes every size: rows of another length than the header, two columns of one name
and unfinished quotes are refused with their line. Every size in a MATLAB file is compared with the bytes that are
left before anything is made of it. Messages repeat nothing of such a file but names of columns, each cut at 60
characters: `SECRET` stands in the files of the property `foreign`, and no message may hold it.
`tests/engine/test_readers.py` compares the MATLAB reader with SciPy on the 85 sound files of SciPy's own
collection, and lets it read its 7 damaged ones, 1200 damaged at random and 24 made by hand.

## Texts and names

A text of a scenario holds no control characters, a name at most 100 characters of one line; names of files that are
made of one are cut at 200 bytes. The property `pages` puts markup, quotes, template code and control characters into
names, descriptions and command lines: a report has the same elements and attributes as a harmless one, its script is
the one that its security policy names, its picture is well-formed XML and its data are strict JSON; so are the
descriptions of an FMU made of the same scenario. Every JSON file is written with `null` for numbers that JSON does
not have.

## Killed in the middle

`tests/robustness/test_killed.py` starts a command, kills it (SIGKILL) after a random time, and looks: eight times
each for a sweep of 5000 runs by one process (seed 20240602) and by two (20240603), an FMU export (20240603) and the
writing of a large table (20240604). No part of a sweep was ever lost or half-written, no process outlived its parent,
what lies under the name of a result is whole, and the next run gives the same bytes as one that was not disturbed. A
killed export or run may leave a hidden file `.NAME-...` beside the result, which nothing reads; a sweep removes its
own.

## The same numbers

`tests/robustness/test_same_numbers.py` runs commands with three hash seeds (0, 1, 4242) and 1, 2 and 4 threads of
OpenBLAS and OpenMP: `run`, `linearise`, `sweep`, `export`, `check` and `fit` print and write the same bytes. A sweep
gives the same file from one process, two processes, and a dask cluster of two (`tests/cli/test_sweep.py`).

## Bounds

A file is read up to 5 MB, 200000 values and 40 levels; a file at these bounds takes seconds, because the YAML parser
is written in Python. Matrices in a scenario are bounded by the same count.
"""


def count(made: Property, examples: int, start: int) -> tuple[Counter[str], float]:
    """Run one property; outcomes and the longest time of an example (s)."""
    outcomes: Counter[str] = Counter()
    slowest = 0.0

    @seed(start)
    @settings(max_examples=examples, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(made.strategy())
    def holds(example: object) -> None:
        nonlocal slowest
        begun = time.perf_counter()
        outcomes[made.check(example)] += 1
        slowest = max(slowest, time.perf_counter() - begun)

    holds()
    return outcomes, slowest


def main() -> None:
    """Run every property and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--examples", type=int, default=1000, help="examples of a property, times its share")
    parser.add_argument("--seed", type=int, default=20240601)
    arguments = parser.parse_args()
    begun, total, rows = time.perf_counter(), 0, []
    for name, made in PROPERTIES.items():
        outcomes, slowest = count(made, round(arguments.examples * SHARES[name]), arguments.seed)
        total += outcomes.total()
        cells = (name, made.title, outcomes.total(), outcomes[RESULT], outcomes[REFUSED], f"{slowest:.1f} s")
        rows.append("| " + " | ".join(str(cell) for cell in cells) + " |\n")
        print(rows[-1], end="", flush=True)
    head = HEAD.format(
        longest=LONGEST,
        examples=total,
        seed=arguments.seed,
        version=hypothesis.__version__,
        spent=timedelta(seconds=round(time.perf_counter() - begun)),
    )
    PAGE.write_text(head + "".join(rows) + FOOT, encoding="utf-8")
    print(f"written: {PAGE.name}")


if __name__ == "__main__":
    main()
