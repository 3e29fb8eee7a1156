"""An effect at a place, as edits to the scenario with parameters that start from sizes that matter."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from diagnosis.estimation.parameters import FreeParameter
from scenarios.amend import Between, Edit

NAME = "found"
"""First part of the name of every block that is put in."""

SIZE_STEP = 0.3
"""Change of the logarithm of a size per unit of its search variable."""

ANY = math.log(10)
"""Standard deviation of the logarithm of a size of which nothing is known: a factor of ten either way."""

SMALL = 0.1
"""Usual size of an effect, as a share of a size that would matter most."""

Sizes = dict[str, float]


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an inserted effect.

    Attributes:
        name: of the parameter of the inserted or changed block.
        reference: a size that matters (SI).
        signed: whether it may change its sign; else it keeps that of its start and moves on a logarithmic scale.
        fixed: whether it is only chosen among its starting sizes: the model has no derivative with respect to it.
        unit: of one that is only chosen.
        least, most: multiples of ``reference`` between which it stays, if there are any: beyond is another effect. Of
            one that is ``signed``: ``most`` to either side of zero.
        like: another parameter that is about as large, which speaks for it where the recordings do not reach it. Of one
            that is ``signed``: the two before it, the nearer first, about on whose line it is.
        apart: standard deviation of its distance from that line, in multiples of ``reference``.
        usual: multiple of ``reference`` at which such parts usually are.
        spread: standard deviation of its logarithm, or of a signed one about zero in multiples of ``reference``.
        anywhere: whether it is the same wherever the effect sits, as a vibration's frequency is.
        step: change (SI) of one that is ``signed`` over which what it does is about in proportion; a fifth of it, if
            None.
    """

    name: str
    reference: float
    signed: bool = False
    fixed: bool = False
    unit: str = "1"
    least: float = 0.0
    most: float | None = None
    like: tuple[str, ...] = ()
    apart: float = 1.0
    usual: float = SMALL
    spread: float = ANY
    anywhere: bool = False
    step: float | None = None


@dataclass(frozen=True)
class Wave:
    """What an effect whose torque is amplitude * sin(... + phase) starts from: both sizes can be solved for.

    Attributes:
        amplitude, phase: their parameters.
        starts: waves that are hardly there, one for each order or frequency.
    """

    amplitude: str
    phase: str
    starts: tuple[Sizes, ...]


@dataclass(frozen=True)
class Candidate:
    """An effect at a place.

    Attributes:
        effect: machine name.
        place: where, in the words of the block diagram.
        block: the block of the user's scenario it belongs to.
        name: of the block that is put in or changed.
        edits: what to do to the scenario, with starting sizes in place of its parameters.
        parameters: its own, to be fitted or chosen.
        starts: sizes to start from, the least effect first, so that no fit ends worse than without the effect.
        freed: for ``wrong_parameter``, the parameter that may leave its tolerance.
        finer: for sizes that are only chosen, those at a distance from others, above them or (negative) below, in
            distances between starting sizes; None where there are none.
        held: further parameters of the block, which are given and not fitted.
        wave: for a torque that is a wave, what its amplitude and phase are solved from.
        option: which of several ways to put it in there, in words; models that differ in it alone are one model.
        beyond: cuts, as of `cuts`, that part its place from another one, at which it would act without them.
    """

    effect: str
    place: str
    block: str
    name: str
    edits: Callable[[Sizes], list[Edit]]
    parameters: tuple[EffectParameter, ...] = ()
    starts: tuple[Sizes, ...] = ({},)
    freed: FreeParameter | None = None
    finer: Callable[[Sizes, float], Sizes | None] | None = None
    held: tuple[str, ...] = ()
    wave: Wave | None = None
    option: str = ""
    beyond: frozenset[tuple[str, str]] = frozenset()

    @property
    def key(self) -> str:
        """Effect and place, for tables."""
        return f"{self.effect} at {self.place}"

    def structures(self) -> list[list[Sizes]]:
        """The starts, those together that share one model: they differ in parameters that are fitted alone."""
        fixed = [k.name for k in self.parameters if k.fixed]
        groups: dict[tuple[float, ...], list[Sizes]] = {}
        for start in self.starts:
            groups.setdefault(tuple(start[name] for name in fixed), []).append(start)
        return list(groups.values())

    def way(self, sizes: Sizes) -> tuple[float, ...]:
        """What tells one wave of an effect from another: all sizes but the amplitude. Empty where it makes no waves.

        What a wave adds to a recording is in proportion to its amplitude, as long as that is small.
        """
        return () if self.wave is None else tuple(v for name, v in sizes.items() if name != self.wave.amplitude)

    @property
    def model(self) -> tuple[str, str, tuple[tuple[float, ...], ...]]:
        """What tells it from others wherever a fit begins: its key, its option, and what is chosen for good."""
        fixed = () if self.finer else tuple(k.name for k in self.parameters if k.fixed)
        return self.key, self.option, tuple({tuple(start[name] for name in fixed): None for start in self.starts})

    def choices(self) -> list[Candidate]:
        """The effect with each of the values, such as a wave's order, that are only chosen and not looked for finer."""
        groups = self.structures()
        if self.finer or len(groups) < 2:
            return [self]
        fixed = [k.name for k in self.parameters if k.fixed]
        found = []
        for group in groups:
            there = [group[0][name] for name in fixed]
            wave = self.wave
            if wave is not None:
                kept = tuple(start for start in wave.starts if [start[name] for name in fixed] == there)
                wave = replace(wave, starts=kept) if kept else None
            found.append(replace(self, starts=tuple(group), wave=wave))
        return found

    def free(self, start: Sizes) -> list[FreeParameter]:
        """The parameters to fit, from given starting sizes."""
        rows = [self.freed] if self.freed else []
        for parameter in self.parameters:
            if parameter.fixed:
                continue
            value, name = start[parameter.name], f"{self.name}.{parameter.name}"
            like = tuple(f"{self.name}.{other}" for other in parameter.like)
            if parameter.signed:
                end = parameter.most * parameter.reference if parameter.most else math.inf
                scale = parameter.step or max(0.2 * abs(value), 0.02 * parameter.reference)
                spread, centre = parameter.spread * parameter.reference / scale, -value / scale
                made = FreeParameter(name, value, scale, False, -end, end, prior=False, like=like)
                rows.append(replace(made, spread=spread, centre=centre, apart=parameter.apart * parameter.reference))
            else:
                largest = math.copysign(parameter.most * parameter.reference, value) if parameter.most else 1e6 * value
                low, high = sorted((math.copysign(parameter.least * parameter.reference, value), largest))
                step, usual = SIZE_STEP, math.copysign(parameter.usual * parameter.reference, value)
                made = FreeParameter(name, value, step, True, low, high, prior=False, like=like)
                rows.append(replace(made, spread=parameter.spread / step, centre=math.log(usual / value) / step))
        return rows


def beside(kept: Sequence[Candidate], effect: Candidate) -> Candidate | None:
    """An effect as it can be put in beside others, or None: a place has it once, a block of the user one change.

    A place that only a cut parts from another one is none without it.

    What is put in a second time, elsewhere, gets blocks of another name.
    """
    if any(c.key == effect.key for c in kept) or not effect.beyond <= cuts(kept):
        return None
    taken = {c.name for c in kept}
    if effect.name not in taken:
        return effect
    other = f"{effect.name}_2"
    if other in taken or not effect.name.startswith(NAME):
        return None

    def edits(sizes: Sizes) -> list[Edit]:
        return [_renamed(edit, effect.name, other) for edit in effect.edits(sizes)]

    return replace(effect, name=other, edits=edits)


def able_beside(kept: Sequence[Candidate], among: Sequence[Candidate]) -> list[Candidate]:
    """Effects that can be put in beside others."""
    return [able for c in among if (able := beside(kept, c)) is not None]


def cuts(effects: Sequence[Candidate]) -> frozenset[tuple[str, str]]:
    """Places and options at which effects cut a node in two, as a joint does."""
    return frozenset(
        (c.place, c.option) for c in effects if any(isinstance(edit, Between) for edit in c.edits(c.starts[0]))
    )


def across(one: Candidate, other: Candidate) -> frozenset[str]:
    """The flanges that two joints have on different sides of the node they cut; none if they do not cut the same."""
    mine, theirs = _inner(one), _inner(other)
    return frozenset(mine) ^ frozenset(theirs) if mine[:1] == theirs[:1] else frozenset()


def _inner(effect: Candidate) -> tuple[str, ...]:
    """The flanges on the inner side of where an effect cuts a node; none if it cuts none."""
    for edit in effect.edits(effect.starts[0]):
        if isinstance(edit, Between):
            return (edit.target, *edit.beside)
    return ()


def together(effects: Sequence[Candidate], sizes: Sequence[Sizes]) -> list[Edit]:
    """The edits of several effects; nodes are cut first, so that what is put in at a flange stays on its side."""
    edits = [edit for c, s in zip(effects, sizes, strict=True) for edit in c.edits(s)]
    return sorted(edits, key=lambda edit: not isinstance(edit, Between))


def all_beside(kept: Sequence[Candidate], effects: Sequence[Candidate]) -> tuple[Candidate, ...] | None:
    """Others with effects put in beside them one by one; None if one of them cannot be."""
    rows = list(kept)
    for effect in effects:
        able = beside(rows, effect)
        if able is None:
            return None
        rows.append(able)
    return tuple(rows)


def _renamed(edit: Edit, name: str, other: str) -> Edit:
    """An edit with another name for the blocks that an effect puts in, whose names begin with its own."""

    def told(value: str) -> str:
        return other + value[len(name) :] if value.startswith(name) else value

    changed: dict[str, Any] = {}
    for f in fields(edit):
        value = getattr(edit, f.name)
        if isinstance(value, str):
            changed[f.name] = told(value)
        elif isinstance(value, tuple):
            changed[f.name] = tuple(told(end) for end in value)
    return replace(edit, **changed)


def combinations(**values: Sequence[float]) -> tuple[Sizes, ...]:
    """Starting sizes: every combination of the values of each parameter."""
    return tuple(dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values()))


def shares(reference: float, *values: float) -> list[float]:
    """Multiples of a reference."""
    return [reference * value for value in values]


def with_unit(value: float, unit: str) -> str:
    """The number as text, with its unit if it has one."""
    return f"{float(value):.10g} {unit}" if unit not in ("1", "", "*") else f"{float(value):.10g}"
