"""What a random rig conceals: drawn with the rig's seed, and kept only if its recordings can show it.

Of ten rigs one has a wrong parameter and one conceals an effect that the tool may not name; of the others one in six
conceals nothing, three in six one effect, three in twelve two and one in twelve three. Effects are drawn evenly among
those that the rig can hide, then their places; sizes from 1 to 30 detection thresholds, evenly on a logarithmic scale.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from zlib import crc32

from numpy.random import Generator, SeedSequence, default_rng

from benchmarks.concealed.case import Case, draw
from benchmarks.concealed.drawing import Options, Unseen
from benchmarks.concealed.refit import refit
from benchmarks.concealed.rigs.drawn import made
from benchmarks.concealed.rigs.numbers import log_uniform
from benchmarks.concealed.rigs.rig import Rig
from benchmarks.concealed.simulator import Diverged
from benchmarks.concealed.sites import Site, sites

SIZES = (1.0, 30.0)
WITHHELD = (3.0, 30.0)
FACTORS = (1.6, 3.0)
"""By how much a wrong parameter is wrong, or its inverse."""

NUMBERS = ((0, 1 / 6), (1, 1 / 2), (2, 1 / 4), (3, 1 / 12))
WRONG_FROM, TRIES = 3.0, 12
"""What a refit leaves of a wrong parameter at least, in floors, and how often another is drawn until one does."""

RUBS = frozenset({"coulomb_friction", "stribeck_friction", "direction_dependent_friction"})


@dataclass(frozen=True)
class Asked:
    """A random rig and what it conceals, as `benchmarks.concealed.case.draw` takes it.

    Attributes:
        plant: its name.
        effects, sizes, seed, options: as there.
        withheld: effects that the tool is not to try.
    """

    plant: str
    effects: tuple[str, ...]
    sizes: tuple[float, ...]
    seed: int
    options: Options
    withheld: tuple[str, ...] = ()


@functools.lru_cache(maxsize=2)
def drawn(seed: int) -> tuple[Asked, Case]:
    """What the rig of a seed conceals, and the case.

    Raises:
        Unseen: nothing was found that it can.
    """
    rng = default_rng(SeedSequence([seed, crc32(b"hidden")]))
    plant, options = made(seed)
    lot = rng.random()
    if lot < 0.1 and (one := _wrong(plant, options, seed, rng)) is not None:
        return one
    secret = 0.1 <= lot < 0.2  # no wrong parameter of this rig can be seen: then effects, as everywhere else
    count = 1 if secret else int(rng.choice([n for n, _ in NUMBERS], p=[share for _, share in NUMBERS]))
    for _ in range(TRIES):
        chosen = _effects(plant, count, rng)
        low, high = WITHHELD if secret else SIZES
        sizes = tuple(round(log_uniform(rng, low, high), 2) for _ in chosen)
        texts = tuple(str(site) for site in chosen)
        if len(chosen) != count:
            continue
        try:
            case = draw(plant, texts, sizes, seed, options)
        except (Diverged, ArithmeticError, ValueError):
            continue
        withheld = tuple(site.effect.name for site in chosen) if secret else ()
        return Asked(plant.name, texts, sizes, seed, options, withheld), case
    raise Unseen(f"{plant.name}: of {TRIES} drawings of {count} effects none can be seen")


def _effects(plant: Rig, count: int, rng: Generator) -> list[Site]:
    """Effects at places, none in the way of another."""
    able = sites(plant)
    chosen: list[Site] = []
    for _ in range(4 * count):
        if len(chosen) == count:
            break
        names = sorted({s.effect.name for s in able if all(_apart(s, c) for c in chosen)})
        if not names:
            break
        name = str(rng.choice(names))
        here = [s for s in able if s.effect.name == name and all(_apart(s, c) for c in chosen)]
        site = here[int(rng.integers(len(here)))]
        if site.effect.natural and count > 1:
            continue  # it has no size of its own: among others it would be as large as it happens to be
        chosen.append(site)
    return chosen


def _apart(one: Site, other: Site) -> bool:
    """Whether two effects can be concealed together and be told as two."""
    if one.effect.name == other.effect.name:
        return False
    if one.effect.kind == other.effect.kind == "joint":
        return not {one.place, *one.same} & {other.place, *other.same}
    return not (one.effect.name in RUBS and other.effect.name in RUBS)


def _wrong(plant: Rig, options: Options, seed: int, rng: Generator) -> tuple[Asked, Case] | None:
    """A parameter far outside its tolerance, which a refit within three cannot make good; None if there is none."""
    names = [q.name for q in plant.parameters]
    for _ in range(TRIES):
        name, factor = str(rng.choice(names)), round(log_uniform(rng, *FACTORS), 2)
        limit = next(q.ceiling for q in plant.parameters if q.name == name)
        if rng.random() < 0.5 or limit < 1:
            factor = round(1 / factor, 3)
        tried = replace(options, wrong=((name, factor),))
        try:
            case = draw(plant, [], [], seed, replace(tried, nuisance=0.0))
        except (Diverged, ArithmeticError, ValueError):
            continue
        if _left(case) >= WRONG_FROM:
            return Asked(plant.name, (), (), seed, tried), draw(plant, [], [], seed, tried)
    return None


def _left(case: Case) -> float:
    """What a refit from the nominal parameters leaves, in floors, held out."""
    base = case.truth.bare()
    target = case.bench.outputs(base)
    fitted = refit(case.bench, replace(base, parameters=case.nominal), target)
    return case.bench.distance(case.bench.outputs(fitted), target)
