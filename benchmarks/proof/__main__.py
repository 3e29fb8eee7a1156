"""Command line: ``python -m benchmarks.proof run | show | page | rigs | drives | one | freeze | settle``."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks.concealed.drawing import Options
from benchmarks.concealed.plants import DRIVEN, PLANTS
from benchmarks.concealed.rigs.hard import HARD
from benchmarks.proof import data, drives, frozen, page, rigs, settle
from benchmarks.proof.run import one, plan, run
from benchmarks.proof.score import Score, scores
from benchmarks.proof.suites import SUITES, Spec, from_json
from engine.errors import FlexarmError, nearest


def main(arguments: list[str] | None = None) -> int:
    """Run a command; 1 means a problem with what was asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.proof", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    running = commands.add_parser("run", help="draw and diagnose the cases of suites; goes on where it was stopped")
    running.add_argument("suite", nargs="+", choices=[*sorted(SUITES), "all"])
    seeds = running.add_mutually_exclusive_group()
    seeds.add_argument("--seeds", type=int, nargs="+", default=[1])
    seeds.add_argument("--frozen", action="store_true", help="seeds from the frozen commit; refuses if rules changed")
    running.add_argument("--count", type=int, default=5, help="seeds of each suite, with --frozen")
    running.add_argument("--first", type=int, default=0, metavar="K", help="leave out the first K of these seeds")
    _folder(running)
    _workers(running)
    running.add_argument("--longest", type=float, metavar="S", help="stop a diagnosis after S s of processor time")
    running.add_argument("--plant", help="only cases of this plant")
    running.add_argument("--effect", action="append", help="only cases with this effect; repeatable")
    running.set_defaults(act=_run)
    showing = commands.add_parser("show", help="open the answers and print a line per case")
    _folder(showing)
    showing.set_defaults(act=_show)
    paging = commands.add_parser("page", help="score, and write the page and its data file")
    paging.add_argument("-o", "--output", type=Path, metavar="DIR", help="folder of the results; absent: the data file")
    paging.add_argument("--add", action="store_true", help="keep the data file's other cases of the same frozen commit")
    paging.add_argument("--page", type=Path, default=frozen.ROOT / "docs" / "proof.md")
    paging.add_argument("--data", type=Path, default=data.DATA)
    paging.set_defaults(act=_page)
    rigging = commands.add_parser("rigs", help="score random rigs and hard cases, and write their page and data file")
    rigging.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="folder of the results; absent: the data file"
    )
    rigging.add_argument("--page", type=Path, default=rigs.PAGE)
    rigging.add_argument("--data", type=Path, default=rigs.DATA)
    rigging.set_defaults(act=_rigs)
    driving = commands.add_parser("drives", help="score the suite of drives, and write its page and data file")
    driving.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="folder of the results; absent: the data file"
    )
    driving.add_argument("--add", action="store_true", help="keep the data file's other cases, of whatever program")
    driving.add_argument("--page", type=Path, default=drives.PAGE)
    driving.add_argument("--data", type=Path, default=drives.DATA)
    driving.set_defaults(act=_drives)
    single = commands.add_parser("one", help="diagnose one case before your eyes, then open its answer")
    single.add_argument("name", nargs="?", help="such as core-15e1e2a691, of the page or of the folder given by -o")
    single.add_argument("--plant", choices=sorted([*PLANTS, *DRIVEN]))
    single.add_argument("--effect", action="append", default=[], metavar="EFFECT[@PLACE]", help="repeat for a pair")
    single.add_argument("--size", type=float, default=3.0, help="in detection thresholds")
    single.add_argument("--seed", type=int, default=1)
    single.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="keep the case, its answer and the result here"
    )
    single.set_defaults(act=_one)
    freezing = commands.add_parser("freeze", help="write down the present commit: from it the seeds that count follow")
    freezing.set_defaults(act=_freeze)
    settling = commands.add_parser("settle", help="carry out the experiments proposed for ties, and diagnose again")
    _folder(settling)
    _workers(settling)
    settling.set_defaults(act=_settle)
    given = parser.parse_args(arguments)
    try:
        return int(given.act(given))
    except FlexarmError as error:
        print(error, file=sys.stderr)
        return 1


def _folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")


def _workers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of a dask cluster that sees the same folder")


def _say(line: str) -> None:
    print(line, flush=True)


def _known(what: str, name: str, able: Iterable[str]) -> None:
    """Refuse a plant or an effect that no case has.

    Raises:
        FlexarmError: it is none of them.
    """
    names = sorted(able)
    if name not in names:
        raise FlexarmError(f"none of these cases has the {what} '{name}'", remedy=nearest(name, names))


def _run(given: argparse.Namespace) -> int:
    if given.first and not given.frozen:
        raise FlexarmError("'--first' counts the seeds of the frozen commit", remedy="give '--frozen' too")
    if given.frozen and not 0 <= given.first < given.count:
        raise FlexarmError(
            f"of {given.count} seeds of each suite, all but the first {given.first} are none",
            remedy=f"give '--count' more than {given.first}, or '--first' less than {given.count}",
        )
    commit = frozen.insist().commit if given.frozen else ""
    names = (
        [name for name in SUITES if name not in ("quick", "rigs", "hard", "drives")]
        if "all" in given.suite
        else given.suite
    )
    specs: list[Spec] = []
    for name in names:
        specs += SUITES[name](frozen.seeds(commit, name, given.count)[given.first :] if commit else given.seeds)
    if given.plant:
        _known("plant", given.plant, {s.plant for s in specs})
        specs = [s for s in specs if s.plant == given.plant]
    for effect in given.effect or ():
        _known("effect", effect, {one for s in specs for one in s.effects})
    if given.effect:
        specs = [s for s in specs if set(s.effects) & set(given.effect)]
    run(specs, given.output, given.workers, _say, given.scheduler, commit, given.longest)
    return 0


def _settle(given: argparse.Namespace) -> int:
    settle.run(given.output, given.workers, _say, given.scheduler)
    return 0


def _show(given: argparse.Namespace) -> int:
    rows = scores(given.output)
    for row in sorted(rows, key=lambda r: (r.suite, r.plant, r.truth)):
        refit, amended = row.errors[1:] if row.errors else (float("nan"), float("nan"))
        print(
            f"{row.outcome:12s} {'+'.join(row.truth) or 'none':48s} {row.plant:16s} {row.seconds:5.0f} s  "
            f"{refit:9.3g} {amended:9.3g}  {row.verdict}  [{row.name}]"
        )
    for suite in sorted({r.suite for r in rows}):
        mine = [r for r in rows if r.suite == suite]
        placed = [r.placed for r in mine if r.placed is not None]
        print(f"{suite}: {sum(r.right for r in mine)} of {len(mine)} right, {sum(placed)} of {len(placed)} placed")
    return 0


def _page(given: argparse.Namespace) -> int:
    _check_added(given)
    if given.output:
        made = data.gather(given.output)
        data.save(data.together(made, data.load(given.data)) if given.add else made, given.data)
    proof = data.load(given.data)
    page.write(proof, given.page, data.causes())
    print(f"{given.page}: {len(proof.rows)} cases, {sum(r.right for r in proof.rows)} right; data in {given.data}")
    return 0


def _check_added(given: argparse.Namespace) -> None:
    if given.add and not given.output:
        raise FlexarmError("'--add' joins the results of a folder to the data file", remedy="give the folder by '-o'")


def _rigs(given: argparse.Namespace) -> int:
    if given.output:
        data.save(data.gather(given.output), given.data)
    proof = data.load(given.data)
    rigs.write(proof, given.page, data.causes(), {name: case.what for name, case in HARD.items()})
    ran = [r for r in proof.rows if r.outcome != "not run"]
    print(f"{given.page}: {len(ran)} of {len(proof.rows)} ran, {sum(r.right for r in ran)} right; data in {given.data}")
    return 0


def _drives(given: argparse.Namespace) -> int:
    _check_added(given)
    if given.output:
        made = data.gather(given.output)
        data.save(data.joined(made, data.load(given.data)) if given.add else made, given.data)
    proof = data.load(given.data)
    drives.write(proof, given.page)
    ran = [r for r in proof.rows if r.outcome != "not run"]
    print(f"{given.page}: {len(ran)} of {len(proof.rows)} ran, {sum(r.right for r in ran)} right; data in {given.data}")
    return 0


def _one(given: argparse.Namespace) -> int:
    spec = _spec(given)
    with tempfile.TemporaryDirectory(prefix="proof-") as place:
        folder = given.output or Path(place)
        _say(f"{spec.name}: drawing, then diagnosing; the tool sees a scenario and six recordings ...")
        line = one(spec, folder)
        row = next(r for r in scores(folder) if r.name == spec.name)
        _say(f"{row.seconds:.0f} s, verdict {line}")
        result = folder / "results" / spec.name / "diagnosis.json"
        if result.exists():
            for finding in json.loads(result.read_text(encoding="utf-8"))["findings"]:
                _say(f"  {finding['sentence']}")
        _tell(row)
        return 0 if row.outcome != "failed" else 1


def _tell(row: Score) -> None:
    _say(f"reported:  {row.verdict}" + (f"  ({row.failure})" if row.failure else ""))
    _say(f"concealed: {' + '.join(row.truth) or 'nothing'}")
    if row.errors:
        _say("held-out error, in noise floors: nominal {:.3g}, refit {:.3g}, amended {:.3g}".format(*row.errors))
    _say(f"that is: {row.outcome}")


def _spec(given: argparse.Namespace) -> Spec:
    if not given.name:
        if not given.plant:
            raise FlexarmError("no case is given", remedy="give a name of the page, or --plant, --effect and --seed")
        sizes = (given.size,) * len(given.effect)
        return Spec("one", given.plant, tuple(given.effect), sizes, given.seed, Options())
    known = plan(given.output) if given.output else {}
    for kept in (data.DATA, rigs.DATA, drives.DATA):
        if given.name not in known and kept.exists():
            known |= {row.name: row.spec for row in data.load(kept).rows}
    if given.name not in known:
        raise FlexarmError(
            f"no case is called '{given.name}'", remedy="see docs/proof.md, or draw one by --plant, --effect and --seed"
        )
    return from_json(known[given.name])


def _freeze(_: argparse.Namespace) -> int:
    made = frozen.freeze()
    print(f"{frozen.RECORD}: commit {made.commit}, {', '.join(f'{k} {v[:12]}' for k, v in made.trees.items())}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
