"""Candidates that put one block in: at a flange, into a joint, into a signal, behind a sensor.

Units, flanges and translational twins are those that the block declares.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from blocks.registry import find
from diagnosis.effects.effect import NAME, Candidate, EffectParameter, Sizes, Wave, with_unit
from diagnosis.effects.places import Place
from engine.block import Block
from engine.errors import FlexarmError, ParameterError, nearest
from scenarios.amend import AtFlange, Between, Edit, InSignal, OnSensor, ReadAt, Wire


def at_flange(
    place: Place,
    effect: str,
    type_name: str,
    starts: Sequence[Sizes],
    *parameters: EffectParameter,
    tidy: Callable[[Sizes], Sizes] = dict,
    wave: Wave | None = None,
    held: tuple[str, ...] = (),
    fed_by: str = "",
    tapped: bool = False,
    **given: Any,
) -> Iterator[Candidate]:
    """A block attached to a shaft or slide by its first flange.

    Args:
        place: a shaft. Along a slide the block's translational twin is attached, if it has one; else nothing is.
        effect: machine name.
        type_name: type of the block, for a shaft that turns.
        starts: sizes to start from, the least effect first; see `Candidate`.
        *parameters: those that are fitted.
        tidy: makes sizes that a fit may reach into sizes that the block takes.
        wave: for a torque that is a wave, what its amplitude and phase are solved from.
        held: parameters of the block that keep their defaults and are not fitted.
        fed_by: signal that the block's first input reads, if it reads one; its owner is then part of the block's name,
            since several may be attached to one shaft.
        tapped: whether that signal is an input: what drives it is read.
        **given: further parameters and options of the block, which are not fitted.

    Raises:
        FlexarmError: the block does not exist, or has no such parameter.
    """
    made = _inserted(place, effect, type_name, starts, given)
    if made is None:
        return
    port, fed = made.flanges(1)[0], next((p.name for p in made.type.ports.values() if p.role == "input"), "")
    if fed_by:
        made = replace(made, name=f"{made.name}_of_{place.block.replace('.', '_')}")

    def edits(sizes: Sizes) -> list[Edit]:
        texts = made.texts(tidy(made.before(sizes)))
        there: list[Edit] = [AtFlange(made.name, made.type_name, place.target, port, texts)]
        if not fed_by:
            return there
        if not tapped:
            return [*there, Wire(f"{made.name}_wire", (fed_by, f"{made.name}.{fed}"))]
        tap, unit = f"{made.name}_tap", made.type.ports[fed].unit
        return [
            InSignal(
                tap, "Offset", fed_by, {"offset": f"0 {unit}"}
            ),  # an input cannot be read, what stands before it can
            *there,
            Wire(f"{made.name}_wire", (f"{tap}.out", f"{made.name}.{fed}")),
        ]

    stays = (*held, *made.stays())
    yield made.candidate(place, effect, edits, parameters, starts, held=stays, wave=wave)


def in_joint(
    place: Place,
    effect: str,
    type_name: str,
    starts: Sequence[Sizes],
    *parameters: EffectParameter,
    held: tuple[str, ...] = (),
    **given: Any,
) -> Iterator[Candidate]:
    """A block between a drive and its load: its first flange joins the drive, its second the load.

    Args:
        place: a joint. Along a slide the block's translational twin is put in, if it has one; else nothing is.
        effect: machine name.
        type_name: type of the block, for a shaft that turns.
        starts: sizes to start from, the least effect first; see `Candidate`.
        *parameters: those that are fitted.
        held: parameters of the block that keep their defaults and are not fitted.
        **given: further parameters and options of the block, which are not fitted.

    Raises:
        FlexarmError: the block does not exist, or has no such parameter, or only one flange.
    """
    made = _inserted(place, effect, type_name, starts, given)
    if made is None:
        return
    inner, outer = made.flanges(2)

    def edits(sizes: Sizes) -> list[Edit]:
        texts = made.texts(made.before(sizes))
        cut = Between(made.name, made.type_name, place.target, inner, outer, texts, place.beside)
        return [cut, *(ReadAt(*change) for change in place.read_at)]

    yield made.candidate(place, effect, edits, parameters, starts, held=(*held, *made.stays()))


def in_signal(
    place: Place,
    effect: str,
    type_name: str,
    starts: Sequence[Sizes],
    *parameters: EffectParameter,
    held: bool = True,
    reads: Mapping[str, str] | None = None,
    **given: Any,
) -> Iterator[Candidate]:
    """A block with the ports ``in`` and ``out`` in front of a driven input.

    Args:
        place: an input. Parameters whose unit the block leaves open have the input's.
        effect: machine name.
        type_name: type of the block.
        starts: sizes to start from, the least effect first; see `Candidate`.
        *parameters: those that are fitted.
        held: whether what is given stays as it is; else it may move within the tolerance that the block declares.
        reads: further inputs of the block, and the signals that they read.
        **given: further parameters and options of the block.

    Raises:
        FlexarmError: the block does not exist, or has no such parameter.
    """
    made = _Inserted(f"{NAME}_{effect}", type_name, find(type_name), (), given, place.unit)
    made.check(effect, starts)

    def edits(sizes: Sizes) -> list[Edit]:
        wires = [Wire(f"{made.name}_wire", (signal, f"{made.name}.{port}")) for port, signal in (reads or {}).items()]
        return [InSignal(made.name, type_name, place.target, made.texts(sizes)), *wires]

    yield made.candidate(place, effect, edits, parameters, starts, held=made.stays() if held else ())


def behind_sensor(
    place: Place,
    effect: str,
    type_name: str,
    starts: Sequence[Sizes],
    *parameters: EffectParameter,
    unit: str | None = None,
    **given: Any,
) -> Iterator[Candidate]:
    """A block with the ports ``in`` and ``out`` between a measured signal and what was recorded of it.

    Args:
        place: a sensor.
        effect: machine name.
        type_name: type of the block.
        starts: sizes to start from, the least effect first; see `Candidate`.
        *parameters: those that are fitted.
        unit: of parameters whose unit the block leaves open; that of the signal if None.
        **given: further parameters and options of the block, which are not fitted.

    Raises:
        FlexarmError: the block does not exist, or has no such parameter.
    """
    unit = place.unit if unit is None else unit
    made = _Inserted(f"{NAME}_{effect}", type_name, find(type_name), (), given, unit)
    made.check(effect, starts)

    def edits(sizes: Sizes) -> list[Edit]:
        return [OnSensor(made.name, type_name, place.target, made.texts(sizes))]

    yield made.candidate(place, effect, edits, parameters, starts, held=made.stays())


@dataclass(frozen=True)
class _Inserted:
    """A block that is put in.

    Attributes:
        name: its own.
        type_name, type: the registered type.
        names: parameters of the rotational block that its twin calls otherwise.
        given: what is not fitted, by the names of the rotational block.
        unit: of parameters whose unit the block leaves open.
    """

    name: str
    type_name: str
    type: type[Block]
    names: tuple[tuple[str, str], ...]
    given: dict[str, Any]
    unit: str

    def flanges(self, count: int) -> list[str]:
        """The first flanges of the block.

        Raises:
            FlexarmError: it has not as many.
        """
        found = [port.name for port in self.type.ports.values() if port.role == "flange"]
        if len(found) < count:
            raise FlexarmError(
                f"'{self.type_name}' cannot be put in: it has {len(found)} flanges, and {count} are needed"
            )
        return found[:count]

    def there(self, name: str) -> str:
        """What the block calls a parameter."""
        return dict(self.names).get(name, name)

    def before(self, sizes: Sizes) -> Sizes:
        """Sizes by the names of the rotational block."""
        back = {new: old for old, new in self.names}
        return {back.get(key, key): value for key, value in sizes.items()}

    def texts(self, sizes: Sizes) -> dict[str, Any]:
        """What the scenario says of the block, from sizes by the names of the rotational block."""
        row = {self.there(key): value for key, value in self.given.items()}
        for key, value in sizes.items():
            unit = self.type.parameters[self.there(key)].unit
            row[self.there(key)] = with_unit(value, self.unit if unit == "*" else unit)
        return {key: row[key] for key in (*self.type.options, *self.type.parameters) if key in row}

    def stays(self) -> tuple[str, ...]:
        """Parameters of the block that are given and not fitted."""
        return tuple(self.there(key) for key in self.given if self.there(key) in self.type.parameters)

    def check(self, effect: str, starts: Sequence[Sizes]) -> None:
        """Check that the block has the parameters that are given and fitted.

        Raises:
            ParameterError: it has not.
        """
        known = [*self.type.parameters, *self.type.options]
        for name in dict.fromkeys([*(key for start in starts for key in start), *self.given]):
            if self.there(name) not in known:
                raise ParameterError(
                    f"effect '{effect}': '{self.type_name}' has no parameter '{self.there(name)}'",
                    remedy=nearest(self.there(name), known),
                )

    def candidate(
        self,
        place: Place,
        effect: str,
        edits: Callable[[Sizes], list[Edit]],
        parameters: Sequence[EffectParameter],
        starts: Sequence[Sizes],
        held: tuple[str, ...] = (),
        wave: Wave | None = None,
    ) -> Candidate:
        """The effect at the place."""

        def renamed(rows: Sequence[Sizes]) -> tuple[Sizes, ...]:
            return tuple({self.there(key): value for key, value in row.items()} for row in rows)

        return Candidate(
            effect,
            place.name,
            place.block,
            self.name,
            edits,
            tuple(replace(p, name=self.there(p.name), like=tuple(map(self.there, p.like))) for p in parameters),
            renamed(starts),
            held=held,
            wave=wave,
            option=place.option,
        )


def _inserted(
    place: Place, effect: str, type_name: str, starts: Sequence[Sizes], given: dict[str, Any]
) -> _Inserted | None:
    """The block for a shaft, or its twin for a slide; None if it has none."""
    made, names = find(type_name), tuple[tuple[str, str], ...]()
    if place.sliding:
        if not made.slide_twin:
            return None
        type_name, names = made.slide_twin, made.slide_names
        made = find(type_name)
    found = _Inserted(f"{NAME}_{effect}", type_name, made, names, given, "")
    found.check(effect, starts)
    return found
