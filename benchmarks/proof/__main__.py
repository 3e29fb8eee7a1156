"""Command line: ``python -m benchmarks.proof run | show``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.proof.run import run
from benchmarks.proof.score import scores
from benchmarks.proof.suites import SUITES, Spec


def main(arguments: list[str] | None = None) -> int:
    """Run a command; 1 means a problem with what was asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.proof", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    running = commands.add_parser("run", help="draw and diagnose the cases of suites; goes on where it was stopped")
    running.add_argument("suite", nargs="+", choices=sorted(SUITES))
    running.add_argument("--seeds", type=int, nargs="+", default=[1])
    running.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    running.add_argument("--workers", type=int, default=2, help="processes at a time")
    running.add_argument("--plant", help="only cases of this plant")
    running.add_argument("--effect", action="append", help="only cases with this effect; repeatable")
    running.set_defaults(act=_run)
    showing = commands.add_parser("show", help="open the answers and print a line per case")
    showing.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    showing.set_defaults(act=_show)
    given = parser.parse_args(arguments)
    return int(given.act(given))


def _run(given: argparse.Namespace) -> int:
    specs: list[Spec] = [spec for suite in given.suite for spec in SUITES[suite](given.seeds)]
    if given.plant:
        specs = [s for s in specs if s.plant == given.plant]
    if given.effect:
        specs = [s for s in specs if set(s.effects) & set(given.effect)]
    run(specs, given.output, given.workers)
    return 0


def _show(given: argparse.Namespace) -> int:
    rows = scores(given.output)
    for row in sorted(rows, key=lambda r: (r.suite, r.plant, r.truth)):
        print(
            f"{row.outcome:12s} {'+'.join(row.truth) or 'none':48s} {row.plant:16s} {row.seconds:5.0f} s  "
            f"{row.hold_out[0]:9.3g} {row.hold_out[1]:9.3g}  {row.verdict}  [{row.name}]"
        )
    for suite in sorted({r.suite for r in rows}):
        mine = [r for r in rows if r.suite == suite]
        good = sum(r.outcome in ("named", "tie", "none") for r in mine)
        placed = [r.placed for r in mine if r.placed is not None]
        print(f"{suite}: {good} of {len(mine)} right, {sum(placed)} of {len(placed)} placed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
