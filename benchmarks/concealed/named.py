"""Plants by name: those of the first proof, and random rigs."""

from __future__ import annotations

from benchmarks.concealed.plants import DRIVEN, PLANTS
from benchmarks.concealed.plants.base import Plant
from benchmarks.concealed.rigs.drawn import PREFIX, rig
from benchmarks.concealed.rigs.hard import HARD, hard
from benchmarks.concealed.rigs.topology import PARTS


def plant(name: str) -> Plant:
    """A plant by its name, a random rig by ``rig-SEED`` or ``rig-SEED-PART``, that of a hard case by ``hard-WHAT``.

    Raises:
        ValueError: there is none.
    """
    if name in PLANTS or name in DRIVEN:
        return (PLANTS | DRIVEN)[name]
    if name in HARD:
        return hard(name)
    seed, _, part = name.removeprefix(PREFIX).partition("-")
    if name.startswith(PREFIX) and seed.isdecimal() and part in ("", *PARTS):
        return rig(int(seed), part)
    parts = ", ".join(f"{PREFIX}SEED-{part}" for part in PARTS)
    raise ValueError(
        f"no plant is called '{name}'; there are {', '.join([*PLANTS, *DRIVEN])}, {PREFIX}SEED for a random rig, and "
        f"{parts} for one with that part"
    )
