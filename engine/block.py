"""Declarations of a block: parameters, options, flanges and signals, each declared once.

A block is a class. Its declarations become validation, schema, documentation, FMU variables and fitting bounds; its
``stamp`` writes the law, once, as ordinary Python on CasADi symbols::

    class Inertia(Block):
        '''Rotating inertia. J w' = sum of torques.'''

        inertia = parameter("kg.m2", ..., "moment of inertia about the axis", gt=0, tolerance=0.1)
        shaft = flange("the rotating body")

        def stamp(self, net: Net) -> None:
            net.inertia(self.shaft, self.inertia)

On an ordinary instance ``block.inertia`` is a number; inside ``stamp`` it is a symbol of the model.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self

from engine.errors import ParameterError, nearest
from engine.ports import ROTATIONAL, Port
from engine.quantity import Option, Parameter, SameAs, coherent, compatible, split
from engine.relations import Relation
from engine.slides import KINDS, NAMES, along_slide, in_words

if TYPE_CHECKING:
    from engine.net import Net


class _Declared:
    """A declaration: on the class itself, on an instance its value, and inside ``stamp`` its symbol."""

    def __init__(self, made: Any) -> None:
        self.made = made
        self.attribute = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.attribute = name

    def __get__(self, instance: Block | None, owner: type) -> Any:
        if instance is None:
            return self
        bound = instance._bound
        if bound is not None and self.attribute in bound:
            return bound[self.attribute]
        if isinstance(self.made, Port):
            return self.made
        return instance.values[self.attribute]

    def __set__(self, instance: Block, value: object) -> None:
        raise AttributeError(f"'{self.attribute}' is declared; give it when the block is made")


class _Renamed:
    """A declaration of a turning law under its old name: what its sliding twin has in its place."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get__(self, instance: Block | None, owner: type) -> Any:
        return getattr(owner if instance is None else instance, self.name)


def parameter(
    unit: str,
    default: Any,
    doc: str,
    *,
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
    tolerance: float | None = None,
    size: str = "",
    structural: bool = False,
    nonzero: bool = False,
) -> Any:
    """Declare a parameter; see `engine.quantity.Parameter` for the meaning of each argument."""
    return _Declared(Parameter("", unit, default, doc, gt, ge, lt, le, tolerance, size, structural, nonzero))


def option(
    kind: type,
    default: Any,
    doc: str,
    *,
    choices: tuple[str, ...] = (),
    ge: int | None = None,
    le: int | None = None,
    size: str = "",
) -> Any:
    """Declare a choice that shapes the equations; see `engine.quantity.Option`."""
    return _Declared(Option("", kind, default, doc, choices, ge, le, size))


def flange(doc: str, *, kind: str = ROTATIONAL, name: str = "") -> Any:
    """Declare a mechanical connector: motion shared, effort balanced."""
    return _Declared(Port(name, "flange", doc, kind=kind))


def signal_in(unit: str, doc: str, *, default: float | None = None, name: str = "", like: str = "") -> Any:
    """Declare a causal input; with a default it may stay unconnected; ``like`` another input it has the same unit."""
    return _Declared(Port(name, "input", doc, unit=unit, default=default, like=like))


def signal_out(unit: str, doc: str, *, name: str = "", like: str = "") -> Any:
    """Declare a causal output; with a unit that fits any, it has that of the input ``like``, or of the first such."""
    return _Declared(Port(name, "output", doc, unit=unit, like=like))


class Block:
    """A component of the library. Subclasses declare parameters and ports and write their law in `stamp`.

    Args:
        values: parameters and options by name; numbers in the declared unit, or texts with a unit.

    Attributes:
        given: parameters and options as they were given, by name.
        values: parameters and options by name, in the declared unit.
        ports: connectors by name; those of the class, and `further_ports`.

    Raises:
        ParameterError: unknown name, missing value, wrong unit or range.
    """

    parameters: ClassVar[dict[str, Parameter]] = {}
    options: ClassVar[dict[str, Option]] = {}
    ports: Mapping[str, Port] = MappingProxyType({})
    _port_attributes: Mapping[str, str] = MappingProxyType({})
    _bound: dict[str, Any] | None = None
    _differs: Callable[[str, float], bool] | None = None

    # What the block is, for tools that ask what its model leaves out (`flexarm diagnose`). Each names declared
    # parameters, options or flanges; a subclass inherits them. None is needed for a simulation.

    cut_after: ClassVar[tuple[str, ...]] = ()
    """Flanges at which a drive hands on its motion: between one of them and what it is connected to, a joint may give
    way, have play, harden or slip."""

    imposes_motion: ClassVar[tuple[str, ...]] = ()
    """Flanges whose motion is an input, whatever effort that takes; the output ``torque`` or ``force`` tells it."""

    spring_parameters: ClassVar[tuple[str, ...]] = ()
    """For a linear spring and damper between flanges ``a`` and ``b``: its stiffness, its damping, and the angle or
    distance at which it is slack. Other laws may take its place, with these values; the last two may be absent ("")."""

    spring_when: ClassVar[tuple[tuple[str, Any], ...]] = ()
    """Values of further parameters and options with which the block is that linear spring."""

    winding_parameters: ClassVar[tuple[str, ...]] = ()
    """Resistance and inductance of a winding; an inductance of 0 leaves it out."""

    back_emf_parameter: ClassVar[str] = ""
    """Voltage per speed of that winding, whose input is ``voltage`` and whose rotor is at ``cut_after``."""

    loads: ClassVar[tuple[str, ...]] = ()
    """Flanges at which gears and bearings carry the effort that ``torque`` or ``force``, an output or an input of the
    block, tells; friction may grow with it."""

    modes_option: ClassVar[str] = ""
    """Option with the number of bending modes that are kept."""

    spin_options: ClassVar[tuple[str, ...]] = ()
    """Switches that together let rotation stiffen a flexible body."""

    payload_parameters: ClassVar[tuple[str, ...]] = ()
    """Mass at the tip of a link, 0 where there is none, and the mass of the link."""

    slide_twin: ClassVar[str] = ""
    """For a rotational law: type of the block with the same law along a slide. A twin that is made from this class sets
    it, see `engine.slides`."""

    slide_names: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Parameters that the twin calls otherwise: name here, name there; set with ``slide_twin``."""

    _slides: ClassVar[bool] = False

    def __init_subclass__(
        cls, slide: Mapping[str, str | None] | None = None, keeps: tuple[str, ...] = (), **kwargs: Any
    ) -> None:
        super().__init_subclass__(**kwargs)
        if slide is None:
            parameters, options, ports = dict(cls.parameters), dict(cls.options), dict(cls.ports)
            attributes = dict(cls._port_attributes)
        else:
            parameters, options, ports, attributes = {}, {}, {}, {}
            _move_to_slide(cls, slide, keeps)
        for attribute, declared in list(vars(cls).items()):
            if not isinstance(declared, _Declared):
                continue
            made = declared.made
            if isinstance(made, Port):
                made = replace(made, name=made.name or attribute)
                ports[made.name] = made
                attributes[attribute] = made.name
            else:
                made = replace(made, name=attribute)
                (parameters if isinstance(made, Parameter) else options)[attribute] = made
            declared.made = made
        cls.parameters, cls.options, cls.ports, cls._port_attributes = parameters, options, ports, attributes
        _check_traits(cls)

    def here(self, unit: str) -> str:
        """Unit of what a turning law has in ``unit``, as this block has it: along a slide N.m is N, and rad is m."""
        return along_slide(unit) if self._slides else unit

    def __init__(self, **values: Any) -> None:
        cls = type(self)
        further_parameters = {declared.name: declared for declared in cls.further_parameters(values)}
        known = [*cls.parameters, *cls.options, *further_parameters]
        for name in values:
            if name not in known:
                raise ParameterError(f"{cls.__name__} has no parameter '{name}'", remedy=nearest(name, known))
        self.given: dict[str, Any] = dict(values)
        self.values: dict[str, Any] = {}
        self._aliases: dict[str, str] = {}
        self._units: dict[str, str] = {}
        for name, choice in cls.options.items():
            self.values[name] = self._given(choice, values, lambda v, c=choice: self._checked(c, v))
        for name, declared in cls.parameters.items():
            if name not in values and isinstance(declared.default, SameAs):
                self._aliases[name] = declared.default.choose(values)
            else:
                self.values[name] = self._given(declared, values, lambda v, d=declared: self._checked(d, v))
        for name, other in self._aliases.items():
            self.values[name] = self.values[other]
        for name in values:
            if name in further_parameters:
                self.values[name] = further_parameters[name].check(values[name])
        try:
            for relation in self.relations():
                relation.check(self.values, {name: self._shown_unit(name) for name in cls.parameters})
            self.check()
        except ArithmeticError as error:
            raise ParameterError(
                f"the values of {cls.__name__} are too large or too small to compute with: {error.args[-1]}",
                remedy="check their units",
            ) from error
        further = {port.name: port for port in self.further_ports()}
        if further:
            self.ports = {**cls.ports, **further}
            # Not by their bare names, which may be those of parameters.
            self._port_attributes = {**cls._port_attributes, **{f"port {name}": name for name in further}}

    @classmethod
    def further_parameters(cls, values: Mapping[str, Any]) -> Iterable[Parameter]:
        """Parameters that only blocks made with these values have, such as those of the FMU in a file.

        They are structural, and have a value in ``values`` alone where one is given.
        """
        return ()

    def further_ports(self) -> Iterable[Port]:
        """Ports that only this instance has, such as one per joint; `port` reads them inside `stamp`."""
        return ()

    def port(self, name: str) -> Any:
        """A port by its name: inside `stamp` its symbol or motion, elsewhere the `Port`."""
        if self._bound is None:
            return self.ports[name]
        attribute = next(a for a, port in self._port_attributes.items() if port == name)
        return self._bound.get(attribute, self.ports[name])

    def _given(self, declared: Parameter | Option, values: dict[str, Any], check: Any) -> Any:
        value = values.get(declared.name, declared.default)
        if isinstance(declared, Parameter) and declared.unit == "*":
            self._units[declared.name] = _unit_given(value)
        if value is ...:
            unit = f" in {declared.unit}" if isinstance(declared, Parameter) and declared.unit not in "1*" else ""
            raise ParameterError(
                f"{type(self).__name__} needs '{declared.name}': {declared.doc}", remedy=f"give {declared.name}{unit}"
            )
        return check(value)

    def unit_of(self, name: str) -> str:
        """Unit of a parameter's value. Where any unit fits, the unit of the given value (``*`` for a bare number)."""
        return self._units.get(name, type(self).parameters[name].unit)

    def _checked(self, declared: Parameter | Option, value: Any) -> Any:
        if not declared.size:
            return declared.check(value)
        size = self.values[declared.size]
        length = sum(size) if isinstance(size, tuple) else int(size)
        items = list(value) if isinstance(value, list | tuple) else [value] * length
        if len(items) != length:
            raise ParameterError(
                f"{declared.name} has {len(items)} values",
                remedy=f"give {length}, one per {declared.size}, or a single number for all",
            )
        return tuple(declared.check(item) for item in items)

    def same_as(self, name: str) -> str | None:
        """The parameter whose value ``name`` takes by its default `SameAs`, if ``name`` was not given; else None."""
        return self._aliases.get(name)

    def differs(self, name: str, other: float = 0.0) -> bool:
        """Whether a parameter's value is another than that at which the law does without a part, such as a stiffness.

        A law that asks this way shares its equations among blocks whose answers agree; one that reads `values` shares
        them among blocks of equal values.
        """
        return self._differs(name, other) if self._differs is not None else bool(self.values[name] != other)

    @functools.cached_property
    def _form(self) -> Hashable:
        """Equal for blocks that differ in the values of parameters alone, those that are structural apart.

        Whoever keeps more than values, such as what a file says, or reads a file is like itself alone.
        """
        if vars(self).keys() - _KEPT or getattr(type(self), "files", None):
            return self
        cls = type(self)
        fixed = [*cls.options, *(name for name, declared in cls.parameters.items() if declared.structural)]
        try:
            values = tuple(_plain(self.values[name]) for name in fixed)
        except TypeError:
            return self
        sizes = tuple(len(self.values[name]) for name, declared in cls.parameters.items() if declared.size)
        names = (tuple(self._aliases.items()), tuple(self._units.items()), tuple(sorted(self.given)))
        return cls, values, sizes, names, tuple(vars(self).get("ports", {}).items())

    def _shown_unit(self, name: str) -> str:
        unit = self.unit_of(name)
        return "" if unit in ("", "1", "*") else f" {unit}"

    def relations(self) -> Iterable[Relation]:
        """What must not be said of two parameters; FMUs refuse values that an importer sets against one."""
        return ()

    def check(self) -> None:
        """Check what `relations` cannot say, and raise `ParameterError` where it does not hold."""

    def stamp(self, net: Net) -> None:
        """Write the block's law into the net.

        Raises:
            NotImplementedError: the subclass does not define its law.
        """
        raise NotImplementedError(f"{type(self).__name__} does not say how it is stamped")

    def bind(self, symbols: dict[str, Any]) -> Self:
        """A copy whose declarations read as the given symbols; used by the net while stamping."""
        bound = copy.copy(self)
        bound._bound = symbols
        return bound

    @classmethod
    def summary(cls) -> str:
        """First line of the block's documentation."""
        return (cls.__doc__ or "").strip().split("\n", 1)[0]

    @classmethod
    def is_physical(cls) -> bool:
        """Whether the block has a flange, and so belongs to the plant rather than to the signals."""
        return any(port.role == "flange" for port in cls.ports.values())

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={value!r}" for name, value in self.values.items())
        return f"{type(self).__name__}({given})"


_KEPT = {"given", "values", "_aliases", "_units", "ports", "_port_attributes"}
"""What every block keeps."""


def _plain(value: Any) -> Hashable:
    """A value by which forms are compared.

    Raises:
        TypeError: it is not made of numbers and texts.
    """
    if isinstance(value, tuple | list):
        return tuple(_plain(item) for item in value)
    if not isinstance(value, bool | int | float | str | None):
        raise TypeError
    return type(value).__name__, repr(value)


def _move_to_slide(cls: type[Block], given: Mapping[str, str | None], keeps: tuple[str, ...]) -> None:
    """Give a class, made from a turning law, that law's declarations along a slide, in their order.

    Raises:
        ParameterError: a name that the turning law does not declare.
    """
    turning = next(base for base in cls.__mro__[1:] if issubclass(base, Block))
    declared: dict[str, _Declared] = {}
    for base in reversed(turning.__mro__):
        declared |= {name: item for name, item in vars(base).items() if isinstance(item, _Declared)}
    own = {name: item for name, item in vars(cls).items() if isinstance(item, _Declared)}
    for name in (*given, *keeps):
        if name not in declared:
            raise ParameterError(f"{cls.__name__}: {turning.__name__} declares no '{name}'")
    # Those of the turning class in its own order: parameters, options, ports.
    ranked = [*turning.parameters, *turning.options, *turning._port_attributes]
    names: dict[str, str | None] = {
        name: given.get(name, NAMES.get(name, name)) for name in sorted(declared, key=ranked.index)
    }
    for name in own:
        if name in vars(cls):
            delattr(cls, name)
    for name, there in names.items():
        if there is None:
            if name not in vars(cls):
                setattr(cls, name, _Renamed(f"{name}, which {cls.__name__} does not have"))
            continue
        moved = declared[name].made if name in keeps else _along(declared[name].made, name, there, names)
        made = own.pop(there, None) or _Declared(moved)
        made.attribute = there
        setattr(cls, there, made)
        if there != name:
            setattr(cls, name, _Renamed(there))
    for name, made in own.items():
        setattr(cls, name, made)
    for trait, kind in _TRAITS.items():
        if kind and trait not in vars(cls):
            value = getattr(turning, trait)
            setattr(cls, trait, names.get(value, value) if isinstance(value, str) else _renamed(value, names))
    cls.slide_twin, cls.slide_names, cls._slides = "", (), True
    if any(names.get(name) is None for name in turning.parameters):
        return  # it has other parameters, and cannot stand in its place
    turning.slide_twin = cls.__name__
    turning.slide_names = tuple(
        (name, there) for name, there in names.items() if name in turning.parameters and there and there != name
    )


def _renamed(value: Any, names: Mapping[str, str | None]) -> Any:
    return tuple(
        (names.get(row[0], row[0]), *row[1:]) if isinstance(row, tuple) else names.get(row, row) for row in value
    )


def _along(made: Any, name: str, there: str, names: Mapping[str, str | None]) -> Any:
    """What a turning law declares, as its sliding twin does."""
    if isinstance(made, Port):
        port = there if made.name == name else made.name
        return replace(
            made, name=port, doc=in_words(made.doc), kind=KINDS.get(made.kind, made.kind), unit=along_slide(made.unit)
        )
    made = replace(made, name=there, doc=in_words(made.doc), size=names.get(made.size) or made.size)
    if isinstance(made, Option):
        return made
    default = made.default
    if isinstance(default, SameAs):
        default = SameAs(names.get(default.other) or default.other, tuple(names.get(n) or n for n in default.instead))
    return replace(made, unit=along_slide(made.unit), default=default)


_TRAITS = {
    "cut_after": "flange",
    "imposes_motion": "flange",
    "spring_parameters": "parameter",
    "spring_when": "parameter or option",
    "winding_parameters": "parameter",
    "back_emf_parameter": "parameter",
    "loads": "flange",
    "modes_option": "option",
    "spin_options": "option",
    "payload_parameters": "parameter",
    "slide_twin": "",
    "slide_names": "parameter",
}
"""Trait: what it names."""

_COUNTS = {"spring_parameters": 3, "winding_parameters": 2, "payload_parameters": 2}


def _check_traits(cls: type[Block]) -> None:
    """Check that what a class says of itself names what it declares.

    Raises:
        ParameterError: it does not, or a parameter or port takes the name of a trait.
    """
    flanges = [port.name for port in cls.ports.values() if port.role == "flange"]
    known = {"flange": flanges, "parameter": [*cls.parameters], "option": [*cls.options]}
    known["parameter or option"] = [*cls.parameters, *cls.options]
    for trait, kind in _TRAITS.items():
        value = getattr(cls, trait)
        if isinstance(value, _Declared):
            raise ParameterError(f"{cls.__name__} declares '{trait}', which every block has", remedy="rename it")
        if trait in _COUNTS and len(value) not in (0, _COUNTS[trait]):
            raise ParameterError(f"{cls.__name__}.{trait} has {len(value)} names", remedy=f"give {_COUNTS[trait]}")
        if kind == "flange" and cls.further_ports is not Block.further_ports:
            continue  # an instance may have flanges that the class has not
        rows = ([value] if isinstance(value, str) else value) if kind else ()
        for name in (row if isinstance(row, str) else row[0] for row in rows):
            if name and name not in known[kind]:
                raise ParameterError(
                    f"{cls.__name__}.{trait} names '{name}', which is no {kind} of it",
                    remedy=nearest(name, known[kind]),
                )
    for port in cls.imposes_motion:
        effort = ("torque" if cls.ports[port].kind == ROTATIONAL else "force") if port in cls.ports else ""
        if effort and (effort not in cls.ports or cls.ports[effort].role != "output"):
            raise ParameterError(
                f"{cls.__name__}.imposes_motion names '{port}', but no output '{effort}' tells the effort",
                remedy=f"declare {effort} = signal_out(...)",
            )
    if cls.spring_parameters and {"a", "b"} - {*flanges}:
        raise ParameterError(
            f"{cls.__name__}.spring_parameters is for a spring between flanges 'a' and 'b'",
            remedy=f"it has {', '.join(flanges) or 'no flange'}",
        )


def _unit_given(value: Any) -> str:
    """Coherent SI unit of a text such as ``5 mV``; ``*`` for a bare number or what `Parameter.check` will refuse.

    Raises:
        ParameterError: the texts of a list have units of different dimensions.
    """
    if isinstance(value, list | tuple):
        found = list(dict.fromkeys(unit for unit in map(_unit_given, value) if unit != "*"))
        if not all(compatible(found[0], unit) for unit in found):
            raise ParameterError(f"values in {' and in '.join(found)} stand in one list", remedy="give all in one unit")
        return min(found, key=len, default="*")  # V rather than kg.m2/(A.s3)
    if not isinstance(value, str):
        return "*"
    try:
        given = split(value)[1]
        return coherent(given)[1] if given else "*"
    except ParameterError:
        return "*"
