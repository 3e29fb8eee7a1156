"""What drives leave out: how often it is named where it is concealed, and the page that says so."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.proof import frozen
from benchmarks.proof.data import Proof
from benchmarks.proof.page import table
from benchmarks.proof.score import Score
from benchmarks.proof.summary import of, rate
from engine.files import writing

DATA = frozen.ROOT / "benchmarks" / "results" / "drives.json"
PAGE = frozen.ROOT / "docs" / "drive-effects.md"

HEAD = """# Effects of drives

Friction that grows with the load, a limit of the current and cogging, concealed on the plants of [the proof](proof.md)
and on [random rigs](random-rigs.md) by the same simulator, which shares nothing with flexarm and integrates these laws
by itself (`benchmarks/concealed`): the friction with a level without load in half of the cases, cogging of 18 to 90
waves per revolution of the motor, as far as the recordings resolve them. Beside them stands plain Coulomb friction,
alone and together with each of the other two, for which it must not be taken. Sizes are in detection thresholds.

    .venv/bin/python -m benchmarks.proof run drives --seeds 1 -o DIR
    .venv/bin/python -m benchmarks.proof drives -o DIR

*named* and *tie* are right: a tie is counted only if the truth generator confirms it. *half*: one name too many, or one
of two. Cases stand in `benchmarks/results/drives.json`, one line each.

"""

TRUTHS = """
The friction's load is the motor's torque on both sides. A gear's own torque is that less what accelerates the rotor; a
truth that takes it so has not been tried. The transmission error of an elastic gear is tested on a joint that scipy
integrates (`tests/diagnosis/effects/test_drive.py`): 60 microradians of two waves per revolution are named, where a
ripple of the motor of the same order is the nearest rival. With 0.2 mrad, ten times the noise of the arm's encoder, the
fit of the right law ended elsewhere: this joint turns freely, and the refit without the error ends too far away.

Of the cases with Coulomb friction, nine ran after this table was made, and their ties are not confirmed: alone, seven
of eight were named, one tied with load-dependent friction at a spring; with a limit of the current beside it, one ended
as unknown at the motor's input.

Not in the catalogue yet: a rate limit, steps of the command, a supply that sags, a belt that goes slack, end stops,
warm-up. Play of a belt or a screw is `backlash`, which is tried at every spring of a slide.
"""


def write(proof: Proof, page: Path) -> None:
    """Write the page.

    Args:
        proof: cases of the suite `drives`, those that have not run among them.
        page: file.

    Raises:
        FlexarmError: the file cannot be written.
    """
    every = of(proof.rows, "drives")
    rows = [r for r in every if r.outcome != "not run"]
    told = f"{len(rows)} of the {len(every)} cases that were asked for have run. {proof.about['machine']}, "
    told += "shared with other work.\n\n"
    with writing(page, (".md",)) as temporary:
        temporary.write_text(HEAD + told + _summary(rows) + "\n" + _cases(rows) + TRUTHS, encoding="utf-8")


def _effects(row: Score) -> str:
    return " + ".join(part.partition("@")[0] for part in row.truth) or " + ".join(row.spec["effects"])


def _summary(rows: Sequence[Score]) -> str:
    groups: dict[str, list[Score]] = {}
    for row in rows:
        groups.setdefault(_effects(row), []).append(row)
    listed = []
    for effects, mine in groups.items():
        drawn = [r for r in mine if not r.failure.startswith("cannot be drawn")]
        rest = f"{len(mine) - len(drawn)} cannot be drawn" if len(drawn) < len(mine) else ""
        listed.append([effects, rate(sum(r.right for r in drawn), len(drawn)), rest])
    return table(["concealed", "right", ""], listed)


def _cases(rows: Sequence[Score]) -> str:
    listed = []
    for row in sorted(rows, key=lambda r: (_effects(r), r.plant, r.spec["sizes"])):
        errors = f"{row.errors[1]:.3g} -> {row.errors[2]:.3g}" if row.errors else ""
        sizes = " and ".join(f"{size:g}" for size in dict.fromkeys(row.spec["sizes"]))
        what = row.verdict if not row.failure else row.failure.splitlines()[0][:100]
        listed.append([f"`{row.name}`", row.plant, _effects(row), sizes, row.outcome, what, errors])
    head = ["case", "plant", "concealed", "thresholds", "outcome", "reported", "held out, refit -> amended"]
    return table(head, listed)
