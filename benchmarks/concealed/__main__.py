"""Command line: ``python -m benchmarks.concealed make | rig | list | ties``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchmarks.concealed.case import draw
from benchmarks.concealed.drawing import Options
from benchmarks.concealed.excitation import KINDS
from benchmarks.concealed.named import plant as plant_of
from benchmarks.concealed.plants import DRIVEN, PLANTS
from benchmarks.concealed.rigs.hidden import drawn
from benchmarks.concealed.scenario import write
from benchmarks.concealed.sites import sites
from benchmarks.concealed.ties import from_answers, tie_class


def main(arguments: list[str] | None = None) -> int:
    """Run a command; 1 means a problem with what was asked for."""
    given = _parser().parse_args(arguments)
    try:
        return int(given.run(given))
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.concealed", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    make = commands.add_parser("make", help="draw a case: a folder for the tool, and a sealed answer elsewhere")
    make.add_argument("--plant", required=True, choices=sorted([*PLANTS, *DRIVEN]))
    make.add_argument(
        "--effect", action="append", default=[], metavar="EFFECT[@PLACE]", help="repeat for a pair; none if absent"
    )
    make.add_argument(
        "--size", action="append", type=float, default=[], metavar="N", help="in detection thresholds; one or each"
    )
    make.add_argument("--seed", type=int, required=True)
    make.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the case")
    make.add_argument("--answers", type=Path, required=True, metavar="DIR", help="folder of the sealed answers")
    usual = Options()
    make.add_argument("--seconds", type=float, default=usual.seconds)
    make.add_argument("--rate", type=float, default=usual.rate, help="samples per second")
    make.add_argument("--sensors", default="", help="columns, such as enc or enc,strain; the usual ones if absent")
    make.add_argument("--loop", choices=("open", "closed"), default=usual.loop)
    make.add_argument("--sigma-error", type=float, default=usual.sigma_error, help="factor on the stated noise")
    make.add_argument("--nuisance", type=float, default=usual.nuisance, help="factor on the small disturbances")
    make.add_argument("--kinds", default="", help=f"kinds, training first: {', '.join(KINDS)}")
    make.add_argument("--one-way", action="store_true", help="use the magnitudes of the commands")
    make.add_argument("--amplitude", type=float, default=usual.amplitude, help="factor on the commands")
    make.add_argument("--exact", action="store_true", help="the scenario holds the true parameters")
    make.add_argument(
        "--wrong",
        action="append",
        default=[],
        metavar="BLOCK.KEY=FACTOR",
        help="a parameter far from its nominal value",
    )
    make.set_defaults(run=_make)

    random = commands.add_parser("rig", help="draw a random rig with what it conceals: all of it follows from the seed")
    random.add_argument("seed", type=int)
    random.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder of the case")
    random.add_argument("--answers", type=Path, required=True, metavar="DIR", help="folder of the sealed answers")
    random.set_defaults(run=_rig)

    listing = commands.add_parser("list", help="the plants, the effects each can hide, and where")
    listing.add_argument("--plant", metavar="NAME", help="one of the four, rig-SEED, rig-SEED-PART or hard-CASE")
    listing.add_argument("--json", action="store_true")
    listing.set_defaults(run=_list)

    ties = commands.add_parser("ties", help="which other effects would have given the same recordings")
    ties.add_argument("answer", type=Path, help="sealed answer of a case")
    ties.add_argument(
        "--rival", action="append", default=[], metavar="EFFECT[@PLACE][+...]", help="all single effects if absent"
    )
    ties.set_defaults(run=_ties)
    return parser


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _factor(text: str) -> tuple[str, float]:
    name, _, factor = text.partition("=")
    return name, float(factor)


def _make(given: argparse.Namespace) -> int:
    options = Options(
        given.seconds,
        given.rate,
        _words(given.sensors),
        given.loop,
        given.sigma_error,
        given.nuisance,
        _words(given.kinds),
        given.one_way,
        given.amplitude,
        given.exact,
        tuple(_factor(text) for text in given.wrong),
    )
    case = draw(given.plant, given.effect, given.size, given.seed, options)
    sealed = write(case, given.output, given.answers)
    print(f"{given.output}: {len(case.recordings)} recordings; answers sealed in {sealed}")
    return 0


def _rig(given: argparse.Namespace) -> int:
    asked, case = drawn(given.seed)
    sealed = write(case, given.output, given.answers, asked.withheld)
    print(f"{given.output}: {case.plant.title}, {len(case.recordings)} recordings; answers sealed in {sealed}")
    return 0


def _list(given: argparse.Namespace) -> int:
    chosen = [plant_of(given.plant)] if given.plant else list(PLANTS.values())
    if given.json:
        rows = {p.name: [[s.effect.name, s.place, *s.same] for s in sites(p)] for p in chosen}
        print(json.dumps(rows, indent=1))
        return 0
    for plant in chosen:
        print(f"{plant.name}: {plant.title}")
        print(f"  drive {plant.drive} ({plant.drive_unit}); sensors", end=" ")
        print(", ".join(f"{s.column} = {s.signal}" + (" (extra)" if s.extra else "") for s in plant.sensors))
        for site in sites(plant, extra=True):
            print(f"  {site.effect.name:30s} {site.place:32s} size: {site.effect.size}")
    return 0


def _ties(given: argparse.Namespace) -> int:
    answers = json.loads(given.answer.read_text(encoding="utf-8"))
    case = from_answers(answers)
    rivals = [tuple(r.split("+")) for r in given.rival] or None
    for rival in tie_class(case, rivals):
        mark = f"tie ({rival.more:+d} parameters)" if rival.tied else ""
        print(f"{rival.distance:10.3f} floors  {mark:20s} {rival.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
