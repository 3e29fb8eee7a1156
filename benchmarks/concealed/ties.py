"""Which truths nobody could tell apart: another effect, fitted with the nominal parameters, gives the same recordings.

Computed from the truth alone, on its noise-free recordings. Two truths tie if, after a fit on the training recordings,
what is left between them on the held-out ones is below the noise floor.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from benchmarks.concealed.bench import Bench
from benchmarks.concealed.case import Case, draw
from benchmarks.concealed.drawing import Options, conceal
from benchmarks.concealed.effects import CATALOGUE, TURNED, Concealed
from benchmarks.concealed.plants.base import Plant
from benchmarks.concealed.refit import WIDEST, GaussNewton, Small, least_squares, refit
from benchmarks.concealed.rigs.rig import Rig
from benchmarks.concealed.rigs.ways import ways
from benchmarks.concealed.simulator import Diverged
from benchmarks.concealed.sites import Site, find, scales, sites
from benchmarks.concealed.truth import JOINT_LAWS, Nuisance, Truth

Array = NDArray[np.float64]

FLOOR = 1.0
"""Held-out distance, in floors, below which two truths tie."""

FIXED = frozenset({"order", "modes", "sharpness", "unloading_share", "share", "rectified", "forward"})
"""Parameters that a fit leaves alone."""

ADDITIVE = frozenset({"offset", "bias", "phase", "hanging_angle", "rest_angle"})
"""Parameters that may change sign; the others keep it, and move on a logarithmic scale."""

FURTHER = {"stray_spring": {"rest_angle": 0.0}}
"""Parameters that a rival has and a truth does not."""

SAME: dict[tuple[str, str], Callable[[Mapping[str, float]], dict[str, float] | None]] = {
    ("gravity", "torque_ripple"): lambda p: {
        "amplitude": p["moment"],
        "order": 1.0,
        "phase": math.pi - p["hanging_angle"],
    },
    ("torque_ripple", "gravity"): lambda p: (
        {"moment": p["amplitude"], "hanging_angle": math.pi - p["phase"]} if p["order"] == 1.0 else None
    ),
    ("torque_ripple", "cogging"): dict,
    ("cogging", "torque_ripple"): dict,
    ("joint_flexibility", "hardening_spring"): lambda p: {**p, "cubic_stiffness": 0.0},
    ("joint_flexibility", "backlash"): lambda p: {**p, "half_gap": 0.0},
    ("coulomb_friction", "direction_dependent_friction"): lambda p: {
        **p,
        "coulomb_friction_backward": p["coulomb_friction"],
    },
    ("coulomb_friction", "load_dependent_friction"): lambda p: {**p, "coefficient": 0.0},
    ("load_dependent_friction", "quadratic_load_friction"): lambda p: {**p, "quadratic_coefficient": 0.0},
    ("coulomb_friction", "stribeck_friction"): lambda p: {
        **p,
        "static_friction": p["coulomb_friction"],
        "stribeck_velocity": 1.0,
    },
}
"""(truth, rival): the rival's parameters that make it the truth, where some do: gravity is a torque ripple of order one
(and such a ripple is gravity), cogging is a ripple of many waves, and what contains the truth has a size that may be
nothing."""

ENOUGH = 0.01
"""Squared distance, in floors, that is as good as none: the search ends."""

CUTS = JOINT_LAWS - {"belt_slack", "structural_damping"}
"""Laws of a joint that need no spring that is there: they may cut a rigid connection."""

WRONG = "wrong_parameter"
"""Name of a nominal parameter that an explanation lets leave its tolerance."""

FARTHEST = 30.0
"""By what factor such a parameter may be wrong, either way."""

FACTORS = (1.0, 0.2, 5.0)
"""Factors by which it is wrong where a fit begins."""

SHARES = (0.03, 0.3, 3.0)
DRAWS = 4
STARTS = 2
"""Sizes and draws of its features that a rival is tried at, and from how many of them it is fitted."""


@dataclass(frozen=True)
class Rival:
    """Another explanation of a case.

    Attributes:
        effects: (effect, place) of each part, `WRONG` with the name of a parameter; empty for none.
        distance: to the truth on the held-out recordings, in floors, after the fit.
        parameters: of its effects, fitted.
        more: free parameters beyond those of the truth's effects. A rival with more of them that contains the truth
            as a special case always ties; whoever prefers the fewest parameters still names the truth.
    """

    effects: tuple[tuple[str, str], ...]
    distance: float
    parameters: tuple[dict[str, float], ...]
    more: int = 0

    @property
    def tied(self) -> bool:
        """Whether nobody could tell."""
        return self.distance < FLOOR

    @property
    def name(self) -> str:
        """Effects and places."""
        return " + ".join(f"{effect}@{place}" for effect, place in self.effects) or "none"


def from_answers(answers: Mapping[str, Any]) -> Case:
    """The case that a sealed answer belongs to, drawn again."""
    options = dict(answers["options"])
    for key in ("sensors", "kinds"):
        options[key] = tuple(options[key])
    options["wrong"] = tuple((name, factor) for name, factor in options["wrong"])
    effects = [f"{c['effect']}@{c['place']}" for c in answers["concealed"]]
    asked = [c["size_asked"] for c in answers["concealed"]]
    return draw(answers["plant"], effects, asked, answers["seed"], Options(**options))


def tie_class(case: Case, rivals: Iterable[Sequence[str]] | None = None) -> list[Rival]:
    """Rivals of a case, nearest first; those with ``tied`` make its tie class, together with the truth itself.

    Args:
        case: the truth.
        rivals: each a sequence of ``effect`` or ``effect@place``, or ``wrong_parameter@name``; by default none, and
            every single effect the plant can hide from the sensors it has. A joint ``X -> Y`` may be one of any two
            flanges of a node of a rig, and is then cut in every way that the name allows: see `cuts_a_node`.

    Raises:
        ValueError: the plant has no such effect or parameter.
    """
    bench, base = case.bench, _within(case.bench, case.truth.bare())
    target = bench.outputs(replace(case.truth, nuisance=Nuisance()))
    loose: list[tuple[str, ...]]
    if rivals is None:
        own = [(site,) for site in case.sites] if len(case.sites) == 1 else []
        chosen: list[tuple[Site, ...]] = [(), *((site,) for site in sites(case.plant))]
        chosen = [c for c in chosen if c not in own and all(_recorded(bench, site) for site in c)]
        loose = [()] * len(chosen)
    else:
        parted = [_parted(case.plant, rival) for rival in rivals]
        chosen, loose = [acting for acting, _ in parted], [names for _, names in parted]
    quick = bool(case.plant.habits.hidden)
    nearest = GaussNewton(bench, base).refit(target) if quick else refit(bench, base, target)
    own_count = sum(len(_free(c, base)) for c in case.truth.concealed)
    pairs = zip(chosen, loose, strict=True)
    fit = _fit_each_way if rivals is not None else fit_rival
    found = [fit(bench, nearest, target, rival, case.truth, names) for rival, names in pairs]
    return sorted((replace(r, more=r.more - own_count) for r in found), key=lambda rival: rival.distance)


def _within(bench: Bench, truth: Truth) -> Truth:
    """The same with each nominal parameter at most `WIDEST` tolerances from its value, where a fit may begin."""
    changed = {}
    for name, width in bench.tolerance.items():
        far = math.exp(WIDEST * width)
        changed[name] = min(max(truth.parameters[name], bench.centre[name] / far), bench.centre[name] * far)
    return replace(truth, parameters=dict(truth.parameters) | changed)


def _parted(plant: Plant, rival: Sequence[str]) -> tuple[tuple[Site, ...], tuple[str, ...]]:
    """The effects of an explanation, and the parameters that are wrong by it."""
    wrong = tuple(part.partition("@")[2] for part in rival if part.partition("@")[0] == WRONG)
    able = [q.name for q in plant.parameters]
    for name in wrong:
        if name not in able:
            raise ValueError(f"{plant.name} has no parameter '{name}'; it has {', '.join(able)}")
    return tuple(_site(plant, part) for part in rival if part != "none" and part.partition("@")[0] != WRONG), wrong


def _site(plant: Plant, part: str) -> Site:
    """The site of ``effect`` or ``effect@place``, which may be a cut of a rig that is not a site of its own."""
    effect, _, place = part.partition("@")
    if cuts_a_node(plant, effect, place):
        return Site(CATALOGUE[effect], place)
    return find(plant, part)


def cuts_a_node(plant: Plant, effect: str, place: str) -> bool:
    """Whether an effect at a place is a joint ``X -> Y`` of two flanges of one node of a rig.

    The name says less than a cut: which other flanges are on Y's side, and on which side a sensor sits, is open.
    """
    return isinstance(plant, Rig) and effect in CUTS and plant.topology.joined(place) is not None


def _recorded(bench: Bench, site: Site) -> bool:
    return site.effect.kind != "sensor" or site.place in bench.signals


def _in_other_words(truth: Truth, site: Site) -> Concealed | None:
    """What a truth conceals, as the law at a site that is the same, or has the same as a special case; behind a gear in
    the sizes that it has there. None if no such law is known."""
    for c in sorted(truth.concealed, key=lambda c: (c.place != site.place, c.effect != site.effect.name)):
        law = _as_law(c, site)
        if law and law.place in site.same:
            law = replace(law, place=site.place)
        elif law and law.place != site.place:
            law = _across(truth, law, site)
        if law:
            return law
    return None


def _as_law(c: Concealed, site: Site) -> Concealed | None:
    """What is concealed, as the law of a site, where it is."""
    if c.effect == site.effect.name:
        return c
    same = SAME.get((c.effect, site.effect.name))
    parameters = same(c.parameters) if same else None
    return Concealed(site.effect.name, c.place, parameters) if parameters else None


def _across(truth: Truth, c: Concealed, site: Site) -> Concealed | None:
    """The same law at another place, as if no gear between lost power; None if its parameters do not go by a ratio."""
    if any(key not in TURNED for key in c.parameters if key not in FIXED):
        return None
    here, there = (truth.plant.ratio(place.split(" -> ")[0]) for place in (c.place, site.place))
    changed = {key: value * (here / there) ** TURNED.get(key, 0) for key, value in c.parameters.items()}
    return replace(c, place=site.place, parameters=changed)


def _fit_each_way(
    bench: Bench, nearest: Truth, target: Sequence[Array], rival: Sequence[Site], truth: Truth, wrong: Sequence[str]
) -> Rival:
    """A rival whose joints are cut in each way that their names allow: as near as the nearest, or the first that ties.

    What the truth conceals too is where the truth has it.
    """
    plant, own = truth.plant, {(c.effect, c.place) for c in truth.concealed}
    joints = [(site.effect.name, site.place) for site in rival if site.effect.name in JOINT_LAWS]
    free = [place for effect, place in joints if (effect, place) not in own and cuts_a_node(plant, effect, place)]
    places = [place for _, place in joints]
    if not isinstance(plant, Rig) or not free or len({*places}) < len(places):
        return fit_rival(bench, nearest, target, rival, truth, wrong)
    found = []
    for cut in ways(plant, free, [place for place in places if place not in free]):
        there = replace(nearest, plant=cut), replace(truth, plant=cut)
        found.append(fit_rival(bench, there[0], target, rival, there[1], wrong))
        if found[-1].tied:
            break
    return min(found, key=lambda one: one.distance, default=Rival(_names(rival, wrong), math.inf, ()))


def _names(rival: Sequence[Site], wrong: Sequence[str]) -> tuple[tuple[str, str], ...]:
    return (*((site.effect.name, site.place) for site in rival), *((WRONG, name) for name in wrong))


def fit_rival(
    bench: Bench,
    nearest: Truth,
    target: Sequence[Array],
    rival: Sequence[Site],
    truth: Truth | None = None,
    wrong: Sequence[str] = (),
) -> Rival:
    """Fit an explanation to noise-free outputs.

    Args:
        bench: the recordings.
        nearest: the nominal model refitted to them, where the search begins.
        target: outputs in units of the floor.
        rival: effects at places; none of them for the nominal model.
        truth: if known, the search begins at its parameters too, and what both conceal, at its size there.
        wrong: nominal parameters that may leave their tolerances.
    """
    names = _names(rival, wrong)
    joints = [site.place for site in rival if site.effect.name in JOINT_LAWS]
    if len({*joints}) < len(joints):
        return Rival(names, math.inf, ())  # a joint has one law here: whether two are as good cannot be told
    if not names:
        return Rival((), bench.distance(bench.outputs(nearest), target), ())
    train = bench.training()
    wanted = [y for y, hold in zip(target, bench.held_out, strict=True) if not hold]
    best, fitted = math.inf, None
    for start in _begun(train, nearest, wanted, rival, truth, wrong):
        made, cost = _descend(train, start, wanted, wrong)
        if cost < best:
            best, fitted = cost, made
        if cost < ENOUGH * sum(np.size(y) for y in wanted):
            break
    if fitted is None:
        return Rival(names, math.inf, ())
    try:
        distance = bench.distance(bench.outputs(fitted), target)
    except Diverged:
        distance = math.inf
    count = sum(len(_free(c, fitted)) for c in fitted.concealed) + len(wrong)
    return Rival(names, distance, tuple(dict(c.parameters) for c in fitted.concealed), count)


def _begun(
    train: Bench,
    nearest: Truth,
    wanted: Sequence[Array],
    rival: Sequence[Site],
    truth: Truth | None,
    wrong: Sequence[str],
) -> Iterator[Truth]:
    """Where the search begins: at the truth's own parameters, if it is known, then at the refitted ones.

    What lets parameters leave their tolerances begins where it ends with all of them held, too.
    """
    bases: list[tuple[Truth, Truth | None]] = [(nearest, None)]
    if truth is not None:
        bases.insert(0, (replace(nearest, parameters=truth.parameters), truth))
    for base, known in bases:
        small, starts = Small(train, base, wanted), _starts(train, base, rival, known)
        if wrong:
            yield from (_descend(train, start, wanted, ())[0] for start in _best_starts(small, starts))
        yield from _best_starts(small, _freed(starts, wrong))


def _freed(starts: list[Truth], wrong: Sequence[str]) -> list[Truth]:
    """The same starts with parameters that may leave their tolerances wrong by some factors."""
    found = []
    for start, factors in itertools.product(starts, itertools.product(FACTORS, repeat=len(wrong))):
        changed = {name: start.parameters[name] * factor for name, factor in zip(wrong, factors, strict=True)}
        found.append(replace(start, parameters=dict(start.parameters) | changed))
    return found


def _starts(train: Bench, nearest: Truth, rival: Sequence[Site], truth: Truth | None = None) -> list[Truth]:
    """The rival at several sizes, with several draws of its features; what a truth conceals too, as it is there."""
    rng = default_rng(20)
    each: list[list[Concealed]] = []
    for site in rival:
        said = _in_other_words(truth, site) if truth is not None else None
        begun = _fresh(train, nearest, site, rng)
        if said:
            # The law itself is where the truth has it; at another place, how it is there is a guess like others.
            begun = [said] if truth and any(c.place == site.place for c in truth.concealed) else [said, *begun]
        each.append(begun)
    thinned = max(1, len(each[0]) // 64) if each else 1
    return [replace(nearest, concealed=parts) for parts in itertools.product(*each)][::thinned]


def _fresh(train: Bench, nearest: Truth, site: Site, rng: Generator) -> list[Concealed]:
    """A site's effect at several sizes, with several draws of its features; none where these recordings show none."""
    try:
        here = scales(train, nearest, site)
    except ValueError:
        return []
    drawn = [site.effect.draw(rng, here) for _ in range(DRAWS)]
    unlike = [f for k, f in enumerate(drawn) if f not in drawn[:k]]
    sizes = [1.0] if site.effect.natural else [share * site.effect.first(here) for share in SHARES]
    more = FURTHER.get(site.effect.name, {})
    fresh = [conceal(site, size, f, here) for size in sizes for f in unlike]
    return [replace(c, parameters={**c.parameters, **more}) for c in fresh]


def _difference(train: Bench, truth: Truth, wanted: Sequence[Array]) -> Array:
    return np.concatenate([np.ravel(a - b) for a, b in zip(train.outputs(truth), wanted, strict=True)])


def _best_starts(small: Small, starts: list[Truth]) -> list[Truth]:
    """Starts of the least cost, after what small changes of the nominal parameters can absorb."""
    ranked = []
    for k, start in enumerate(starts):
        try:
            ranked.append((small.size(small.bench.outputs(start)), k))
        except Diverged:
            continue
    return [starts[k] for _, k in sorted(ranked)[:STARTS]]


def _descend(train: Bench, start: Truth, wanted: Sequence[Array], wrong: Sequence[str]) -> tuple[Truth, float]:
    """Fit the nominal parameters, but for those that are wrong within their tolerances, and those of the effects."""
    names = list(train.tolerance)
    width = np.array([math.log(FARTHEST) / WIDEST if name in wrong else train.tolerance[name] for name in names])
    held = np.array([name not in wrong for name in names])
    centre = np.array([train.centre[name] for name in names])
    knobs = [(i, key) for i, c in enumerate(start.concealed) for key in _free(c, start)]
    origin = np.log(np.array([start.parameters[name] for name in names]) / centre) / width
    x = np.concatenate([np.clip(origin, -WIDEST, WIDEST), np.zeros(len(knobs))])

    def made(x: Array) -> Truth:
        values = dict(zip(names, (centre * np.exp(width * x[: len(names)])).tolist(), strict=True))
        parts = [dict(c.parameters) for c in start.concealed]
        for (i, key), move in zip(knobs, x[len(names) :], strict=True):
            old = parts[i][key]
            moved = old + (abs(old) or 1.0) * float(move) if key in ADDITIVE else old * math.exp(float(move))
            parts[i][key] = min(moved, 1.0) if key == "residual_share" else moved
        concealed = tuple(replace(c, parameters=p) for c, p in zip(start.concealed, parts, strict=True))
        return replace(start, parameters=dict(start.parameters) | values, concealed=concealed)

    def residual(x: Array) -> Array:
        return np.concatenate([_difference(train, made(x), wanted), np.where(held, x[: len(names)], 0.0)])

    high = np.concatenate([np.full(len(names), WIDEST), np.full(len(knobs), 12.0)])
    x, cost = least_squares(residual, x, low=-high, high=high, iterations=15)
    return made(x), cost


def _free(c: Concealed, truth: Truth) -> list[str]:
    """Parameters that a fit moves; an existing spring keeps its own stiffness and damping."""
    ignored = {"stiffness", "damping"} if c.place in truth.plant.sites.springs else set()
    return [key for key, value in c.parameters.items() if key not in FIXED | ignored and (value or key in ADDITIVE)]
