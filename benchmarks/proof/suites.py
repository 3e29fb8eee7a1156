"""The suites: which cases are drawn, from which seeds."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from benchmarks.concealed.drawing import Options
from benchmarks.concealed.plants import PLANTS
from benchmarks.concealed.rigs.drawn import PREFIX, made
from benchmarks.concealed.rigs.hard import HARD
from benchmarks.concealed.sites import drive_sites, sites
from benchmarks.concealed.suites import CORE, PAIRS, TIES

SIZES = (1.0, 3.0, 10.0)
"""Effect sizes, in detection thresholds; what a suite does not vary stands at the middle one."""


DRAWN = "drawn"
"""In place of effects: what is concealed is drawn by `benchmarks.concealed.rigs.hidden`."""


@dataclass(frozen=True)
class Spec:
    """One case to draw.

    Attributes:
        suite: it belongs to.
        plant, effects, sizes, seed, options: as `benchmarks.concealed.case.draw` takes them.
        withheld: effects that the tool is not to try.

    A random rig's effects, sizes and options are drawn with it: ``effects`` is then `DRAWN` alone.
    """

    suite: str
    plant: str
    effects: tuple[str, ...]
    sizes: tuple[float, ...]
    seed: int
    options: Options = field(default_factory=Options)
    withheld: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Of the case's folder: unique, and silent about what is concealed."""
        text = repr((self.suite, self.plant, self.effects, self.sizes, self.seed, self.options, self.withheld))
        return f"{self.suite}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"


def from_json(data: Mapping[str, Any]) -> Spec:
    """The case that was written down by ``dataclasses.asdict``."""
    options = dict(data["options"])
    for key in {"sensors", "kinds"} & options.keys():
        options[key] = tuple(options[key])
    if "wrong" in options:
        options["wrong"] = tuple((name, factor) for name, factor in options["wrong"])
    lists = {key: tuple(data[key]) for key in ("effects", "sizes", "withheld")}
    return Spec(data["suite"], data["plant"], seed=data["seed"], options=Options(**options), **lists)


def hosts(effect: str) -> list[str]:
    """The plants that can hide an effect, in the order in which they are used."""
    return [name for name, plant in PLANTS.items() if any(s.effect.name == effect for s in sites(plant))]


def core(seeds: list[int], size: float = 3.0) -> Iterator[Spec]:
    """The core effects on two plants each."""
    for effect in CORE:
        for k, plant in enumerate(_two(effect)):
            for seed in seeds:
                yield Spec("core", plant, (effect,), (size,), 100 * seed + k)


def catalogue(seeds: list[int], size: float = 3.0) -> Iterator[Spec]:
    """Every other effect that a plant can hide, on two plants where there are two."""
    effects = sorted({s.effect.name for plant in PLANTS.values() for s in sites(plant)} - set(CORE))
    for effect in effects:
        for k, plant in enumerate(_two(effect)):
            for seed in seeds:
                yield Spec("catalogue", plant, (effect,), (size,), 100 * seed + k)


def power(seeds: list[int]) -> Iterator[Spec]:
    """Core effects at one and ten thresholds; three is the suite of core effects."""
    for effect in CORE:
        for k, plant in enumerate(_two(effect)):
            for size in (SIZES[0], SIZES[2]):
                for seed in seeds:
                    yield Spec("power", plant, (effect,), (size,), 100 * seed + k)


def nothing(seeds: list[int], count: int | None = None) -> Iterator[Spec]:
    """Nothing concealed; the stated noise is off by up to 30 %. 40 cases, or 20 for each seed if that is more."""
    count = count or max(40, 20 * len(seeds))
    plants, errors = sorted(PLANTS), (1.0, 0.77, 1.3, 1.0, 0.85, 1.15)
    for k in range(count):
        seed = 1000 * seeds[k % len(seeds)] + k
        yield Spec("none", plants[k % len(plants)], (), (), seed, Options(sigma_error=errors[k % len(errors)]))


def pairs(seeds: list[int]) -> Iterator[Spec]:
    """Two effects at once."""
    for plant, combinations in PAIRS.items():
        for effects in combinations:
            for seed in seeds:
                yield Spec("pairs", plant, effects, (3.0, 3.0), seed)


def fewer(seeds: list[int]) -> Iterator[Spec]:
    """Core effects with the encoder alone, and in a closed loop."""
    for effect in CORE:
        plant = _two(effect)[0]
        for seed in seeds:
            yield Spec("encoder", plant, (effect,), (3.0,), seed, Options(sensors=("enc",)))
            yield Spec("closed", plant, (effect,), (3.0,), seed, Options(loop="closed"))


def withheld(seeds: list[int]) -> Iterator[Spec]:
    """Core effects that the tool may not name."""
    for effect in CORE:
        for seed in seeds:
            yield Spec("withheld", _two(effect)[0], (effect,), (10.0,), seed, withheld=(effect,))


def wrong(seeds: list[int]) -> Iterator[Spec]:
    """A parameter far outside its tolerance, and nothing else."""
    for plant, parameter, factor in (
        ("srv02-flexible", "motor.resistance", 1.8),
        ("srv02-flexible", "link.flexural_rigidity", 0.4),
        ("geared-two-mass", "load.inertia", 1.8),
        ("geared-two-mass", "shaft.stiffness", 2.0),
        ("harmonic-arm", "rotor.inertia", 1.8),
        ("pendulum", "weight.mass", 0.55),
    ):
        for seed in seeds:
            yield Spec("wrong", plant, (), (), seed, Options(wrong=((parameter, factor),)))


def ties(seeds: list[int]) -> Iterator[Spec]:
    """Ten truths that their recordings cannot tell from another one."""
    for tie in TIES:
        for seed in seeds:
            yield Spec("ties", tie.plant, tie.effects, tie.sizes, seed, tie.options)


def quick(seeds: list[int]) -> Iterator[Spec]:
    """Eight cases of the others, for a look within minutes."""
    for effect in ("dead_zone", "coulomb_friction", "backlash", "offset"):
        yield next(s for s in core(seeds) if s.effects == (effect,))
    yield from nothing(seeds, 2)
    yield next(wrong(seeds))
    yield next(withheld(seeds))


def rigs(seeds: list[int]) -> Iterator[Spec]:
    """Random rigs, one for each seed: what they conceal is drawn with them, and stands in the sealed answer alone."""
    for seed in seeds:
        yield Spec("rigs", f"{PREFIX}{seed}", (DRAWN,), (), seed)


def hard(seeds: list[int]) -> Iterator[Spec]:
    """The hard cases of `benchmarks.concealed.rigs.hard`."""
    for name, case in HARD.items():
        for seed in seeds:
            yield Spec("hard", name, case.effects, case.sizes, seed, case.options)


DRIVE_CASES: dict[str, tuple[str, ...]] = {
    "load_dependent_friction": ("srv02-flexible", "geared-two-mass", "harmonic-arm", "pendulum"),
    "current_limit": ("srv02-flexible", "geared-two-mass"),
    "cogging": ("geared-two-mass", "hard-belt-cogging"),
    "rate_limit": ("srv02-flexible", "belt-axis"),
    "command_quantisation": ("geared-two-mass", "belt-axis"),
    "supply_sag": ("geared-two-mass", "belt-axis"),
    "belt_slack": ("belt-axis",),
    "end_stop": ("belt-axis",),
    "warm_up": ("belt-axis",),
    "friction_warm_up": ("belt-axis",),
    "quadratic_load_friction": ("geared-two-mass", "pendulum"),
    "dead_time": ("srv02-flexible", "geared-two-mass", "belt-axis"),
    "coulomb_friction": ("srv02-flexible", "geared-two-mass", "harmonic-arm", "pendulum"),
    "coulomb_friction+current_limit": ("srv02-flexible", "geared-two-mass"),
    "coulomb_friction+cogging": ("geared-two-mass", "hard-belt-cogging"),
}
"""What drives leave out, and plain Coulomb friction for which it must not be taken, with plants that can hide it."""

DRIVE_SIZES, DRIVE_RIGS = (30.0, 300.0), 4
"""Detection thresholds; random rigs for each effect of `ON_RIGS`, at the first size that it has."""

OTHER_SIZES = {"end_stop": (2.0, 4.0)}
"""The same of effects that are there or not: a few thresholds leave an axis between its stops without room to move."""

ON_RIGS = (
    "load_dependent_friction",
    "current_limit",
    "cogging",
    "quadratic_load_friction",
    "rate_limit",
    "command_quantisation",
    "supply_sag",
    "belt_slack",
    "end_stop",
    "warm_up",
    "friction_warm_up",
    "transmission_error",
    "dead_time",
)
"""Effects of drives that are concealed on random rigs too."""

ASKED = {"belt_slack": "belt", "warm_up": "motor", "transmission_error": "gear"}
"""What a random rig is asked to have, for effects that need it."""


FURTHER = {"belt_slack": 8, "end_stop": 6, "warm_up": 5, "dead_time": 5}
"""Random rigs for effects that some rigs cannot show: so many that four can be drawn with the first seed."""


def drives(seeds: list[int]) -> Iterator[Spec]:
    """Effects of drives, on the plants that can hide them and on random rigs."""
    for names, plants in DRIVE_CASES.items():
        effects = tuple(names.split("+"))
        for plant in plants:
            options = HARD[plant].options if plant in HARD else Options()
            for size in OTHER_SIZES.get(names, DRIVE_SIZES):
                for seed in seeds:
                    yield Spec("drives", plant, effects, (size,) * len(effects), seed, options)
    for seed in seeds:
        for effect in ON_RIGS:
            part, sizes = ASKED.get(effect, ""), OTHER_SIZES.get(effect, DRIVE_SIZES)[:1]
            able = (k for k in itertools.count(1000 * seed) if _can_hide(k, part, effect))
            for k in itertools.islice(able, FURTHER.get(effect, DRIVE_RIGS)):
                rig, options = made(k, part)
                yield Spec("drives", rig.name, (effect,), sizes, k, options)


def _can_hide(seed: int, part: str, effect: str) -> bool:
    """Whether a random rig has a place for an effect of a drive."""
    plant, _ = made(seed, part)
    return any(site.effect.name == effect for site in drive_sites(plant))


SUITES = {
    "core": core,
    "none": nothing,
    "catalogue": catalogue,
    "power": power,
    "pairs": pairs,
    "fewer": fewer,
    "withheld": withheld,
    "wrong": wrong,
    "ties": ties,
    "rigs": rigs,
    "hard": hard,
    "drives": drives,
    "quick": quick,
}


def _two(effect: str) -> list[str]:
    """Two plants that can hide an effect, rotating through all of them so that each plant is used alike."""
    able = hosts(effect)
    shift = sum(effect.encode()) % len(able)
    return (able[shift:] + able[:shift])[:2]
