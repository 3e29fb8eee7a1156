"""What a sweep runs: the texts of ``--vary`` as axes and samples, and the values of each run by its number."""

from __future__ import annotations

import fnmatch
import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.quantity import coherent, convert, factor, number_or_text, split
from flexarm.sweeps.metrics import Metric
from flexarm.sweeps.samples import USAGE, Sample, correlated, read_law

if TYPE_CHECKING:
    from engine.model import Model
    from scenarios.load import Scenario

MOST_RUNS = 100_000_000
"""Runs of one sweep."""

MOST_VALUES = 100_000
"""Values of one axis."""

_RANGE = re.compile(r"^([^:]+):([^:]+):\s*(\d+)\s*(?::\s*(log)\s*)?$")
_USAGE = "write KEY=START:STOP:N, KEY=A,B,C or KEY~tolerance, for example --vary gear.ratio=14:70:5"
_RANGES = "write START:STOP:N, START:STOP:N:log or A,B,C, for example 14:70:5 or 0.5 Hz:20 Hz:15:log"


@dataclass(frozen=True)
class Axis:
    """A key with the values it takes, each with each of every other axis.

    Attributes:
        key: as ``--set`` takes it.
        texts: the values, as ``--set`` takes them.
        numbers: the values in ``unit``; empty where they are no numbers.
        unit: of the numbers.
        names: the model's parameters that the key sets; empty where each value needs a model of its own.
    """

    key: str
    texts: tuple[str, ...]
    numbers: tuple[float, ...]
    unit: str
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Run:
    """One run: its number, what its model is built with, and where it lies on the axes and in the samples.

    Attributes:
        number: from 0.
        structure: ``--set`` texts beyond those of the scenario.
        parameters: values by name, SI units.
        shares: of each sample's interval, from 0 to 1.
        point: index of the value on each axis.
    """

    number: int
    structure: tuple[str, ...]
    parameters: dict[str, float]
    shares: tuple[float, ...]
    point: tuple[int, ...]


@dataclass(frozen=True)
class SweepPlan:
    """Everything that the numbers of a sweep depend on.

    Attributes:
        scenario: file as given.
        digest: of the scenario's files, of the files its blocks read, and of its overrides.
        overrides: ``--set`` texts of every run.
        axes: those that need models of their own first; the first varies slowest.
        samples: parameters that are drawn.
        draws: runs at each point of the axes.
        seed: of the draws. The k-th run at each point draws the same shares, so that points can be compared.
        outputs: signals that are summed up, with their units.
        stop, step, keep: times in seconds; None for those of the scenario, and for no trajectories.
        version: of flexarm.
        metrics: further numbers of each run.
        correlation: of the normal numbers behind the first samples, those of a fit.
        files: the scenario's files by relative path, the main one first, where workers do not share the disk.
    """

    scenario: str
    digest: str
    overrides: tuple[str, ...]
    axes: tuple[Axis, ...]
    samples: tuple[Sample, ...]
    draws: int
    seed: int
    outputs: tuple[tuple[str, str], ...]
    stop: float | None
    step: float | None
    keep: float | None
    version: str
    metrics: tuple[Metric, ...] = ()
    correlation: tuple[tuple[float, ...], ...] = ()
    files: tuple[tuple[str, bytes], ...] = field(default=(), repr=False)

    @property
    def total(self) -> int:
        """Number of runs."""
        return math.prod(len(axis.texts) for axis in self.axes) * self.draws

    def numbers(self) -> dict[str, Any]:
        """The plan as plain data; the place of the scenario is no part of it."""
        made = asdict(self)
        del made["files"], made["scenario"]
        return json.loads(json.dumps(made, default=str))  # type: ignore[no-any-return]

    @property
    def hash(self) -> str:
        """Equal for sweeps that give the same numbers."""
        return hashlib.sha256(json.dumps(self.numbers(), sort_keys=True).encode()).hexdigest()[:16]

    def run(self, number: int) -> Run:
        """A run by its number."""
        where, draw = divmod(number, self.draws)
        lengths = [len(axis.texts) for axis in self.axes]
        point = tuple(int(k) for k in np.unravel_index(where, lengths)) if lengths else ()
        structure: list[str] = []
        parameters: dict[str, float] = {}
        for axis, k in zip(self.axes, point, strict=True):
            if axis.names:
                parameters |= dict.fromkeys(axis.names, axis.numbers[k])
            else:
                structure.append(f"{axis.key}={axis.texts[k]}")
        shares: tuple[float, ...] = ()
        if self.samples:
            shares = tuple(np.random.default_rng([self.seed, draw]).random(len(self.samples)).tolist())
            shares = tuple(correlated(shares, self.correlation))
        return Run(number, tuple(structure), parameters, shares, point)


def make_axes(
    scenario: Scenario, model: Model, vary: Sequence[str], rebuild: Any
) -> tuple[tuple[Axis, ...], tuple[Sample, ...]]:
    """The axes and samples of ``--vary`` texts.

    Args:
        scenario: what is varied.
        model: of the scenario.
        vary: the texts.
        rebuild: returns the model of the scenario with one further override.

    Raises:
        FlexarmError: a text that cannot be read, a key that leads nowhere, a value that does not fit.
    """
    axes: list[Axis] = []
    places: dict[str, str] = {}
    samples: dict[str, Sample] = {}
    stated = scenario.tolerances_of(model)
    for text in vary:
        where = Where(f"--vary {text}")
        found = re.match(r"^\s*([^=~]+?)\s*([=~])\s*(.*?)\s*$", text, re.DOTALL)
        if not found:
            raise FlexarmError(f"'{text}' varies nothing", where, _USAGE)
        key, sign, value = found.groups()
        try:
            if sign == "=":
                for place in parameters_of(model, key) or (_plain(key),):  # one place has several keys
                    other = places.setdefault(place, key)
                    if other != key or any(axis.key == key for axis in axes):
                        also = f", as '{other}' too" if other != key else ""
                        raise FlexarmError(f"'{key}' is varied twice{also}", remedy="give all its values in one --vary")
                axes.append(_axis(model, key, value, rebuild))
            else:
                if not parameters_of(model, key) and (common := scenario.system.followed(key)):
                    shown = ", ".join(f"--vary '{name}~{value}'" for name in common)
                    raise ParameterError(f"'{key}' follows {' and '.join(common)}", remedy=f"draw that: {shown}")
                for made in _samples(model, key, value, stated):
                    samples[made.name] = made
        except FlexarmError as error:
            if error.where is not None and error.where.file.startswith(f"--set {key}="):
                error.where = where  # as the user gave it; a model is built for each of the values
            raise error.at(where) from None
    taken = {name: axis.key for axis in axes for name in axis.names}
    for name in samples:
        if name in taken:
            raise FlexarmError(
                f"'{name}' is on an axis and is drawn as well", Where(f"--vary {taken[name]}"), "leave out one of them"
            )
    # What needs a model of its own varies slowest, so that each is built once and its runs follow one another.
    return tuple(sorted(axes, key=lambda axis: bool(axis.names))), tuple(samples.values())


def _axis(model: Model, key: str, value: str, rebuild: Any) -> Axis:
    texts = texts_of(value)
    names = parameters_of(model, key)
    if names:
        declared = [model.parameters[model.parameter_index(name)].declared for name in names]
        if declared[0].unit not in ("1", "*"):  # a signal keeps its unit only if the value is given with it
            texts = tuple(
                text if isinstance(number_or_text(text), str) else f"{text} {declared[0].unit}" for text in texts
            )
        numbers = tuple(declared[0].check(number_or_text(text)) for text in texts)
        if all(_is_same(model, names, text, rebuild(f"{key}={text}")) for text in _probes(texts, numbers)):
            return Axis(key, texts, numbers, declared[0].unit, names)
        return Axis(key, texts, numbers, declared[0].unit)
    for text in texts:
        rebuild(f"{key}={text}", load_only=True)
    try:
        read = [split(text) if isinstance(number_or_text(text), str) else (float(text), "") for text in texts]
        units = {coherent(unit)[1] for _, unit in read if unit}
        if len(units) <= 1:
            numbers = tuple(number * (coherent(unit)[0] if unit else 1.0) for number, unit in read)
            return Axis(key, texts, numbers, units.pop() if units else "")
    except (FlexarmError, ValueError):
        pass
    return Axis(key, texts, (), "")


def parameters_of(model: Model, key: str) -> tuple[str, ...]:
    """The model's parameters that a ``--set`` key names: one, those of a vector, or none."""
    plain = _plain(key)
    names = [parameter.name for parameter in model.parameters]
    return tuple(name for name in names if name == plain or re.fullmatch(re.escape(plain) + r"\[\d+\]", name))


def _plain(key: str) -> str:
    """A key without the name of its section."""
    return re.sub(r"^(parameters|blocks)\.", "", key)


def _probes(texts: tuple[str, ...], numbers: tuple[float, ...]) -> list[str]:
    """Values at which a model is built to see that a tuned model is the same: ends, and zero, a special value."""
    zeros = [text for text, number in zip(texts, numbers, strict=True) if number == 0]
    return list(dict.fromkeys([texts[0], texts[-1], *zeros]))


def _is_same(model: Model, names: tuple[str, ...], text: str, built: Model) -> bool:
    """Whether the model tuned to a value is the model built with it."""
    if shape(model) != shape(built):
        return False
    first = model.parameters[model.parameter_index(names[0])]
    if first.fixed:
        return False
    check = first.declared.check
    tuned = model.parameter_vector(dict.fromkeys(names, check(number_or_text(text))))
    return bool(np.array_equal(tuned, built.parameter_values))


def check_draws(model: Model, samples: Sequence[Sample]) -> None:
    """Refuse to draw a parameter of the scenario that also gives what no draw changes, such as a start.

    Raises:
        ParameterError: something that it gives would stay as it is.
    """
    for sample in samples:
        try:
            model.parameters[model.parameter_index(sample.name)].check_free(
                "a draw", f"put it on an axis, for which models are built: {sample.name}=A,B,C"
            )
        except ParameterError as error:
            raise error.at(Where(f"--vary {sample.name}")) from None


def shape(model: Model) -> str:
    """Hash of a model without its parameters' values."""
    digest = hashlib.sha256()
    for name, function in model.functions.items():
        digest.update(f"{name} {function.serialize()}".encode())
    names = [(p.name, p.declared) for p in model.parameters]
    digest.update(repr((model.states, model.inputs, model.outputs, names, model.modes, model.tables)).encode())
    digest.update(repr((model.clocks, model.memory_clock, model.memories, sorted(model.initial.items()))).encode())
    digest.update(repr([(e.name, e.clock, e.identity) for e in model.externals]).encode())
    return digest.hexdigest()


def texts_of(text: str) -> tuple[str, ...]:
    """The values of ``START:STOP:N`` or ``A,B,C``."""
    found = _RANGE.match(text)
    if found:
        return _range(*found.groups())
    if re.match(r"^[-+.\d][^:,]*:", text):
        raise FlexarmError(f"'{text}' is no range", remedy=_RANGES)
    parts = _apart(text)
    if not all(parts):
        raise FlexarmError("a value is missing", remedy=_RANGES)
    if len(parts) > MOST_VALUES:
        raise FlexarmError(f"{len(parts)} values are too many", remedy=f"at most {MOST_VALUES}")
    return tuple(parts)


def _range(first: str, last: str, count: str, spacing: str | None) -> tuple[str, ...]:
    (start, start_unit), (stop, unit) = split(first), split(last)
    number = int(count)
    if not 2 <= number <= MOST_VALUES:
        raise FlexarmError(f"{count} values cannot span a range", remedy=f"give 2 to {MOST_VALUES}")
    if start_unit and not unit:
        raise FlexarmError(
            f"'{first}' has a unit and '{last}' has none", remedy="write the unit at the end of the range"
        )
    if start_unit and start_unit != unit:
        start *= factor(start_unit, unit)
    if not (math.isfinite(start) and math.isfinite(stop)):
        raise FlexarmError(f"'{first}:{last}' is no finite range", remedy=_USAGE)
    if spacing and not start * stop > 0:
        raise FlexarmError(
            f"'{first}:{last}' has no logarithmic spacing", remedy="both ends must be of one sign, not 0"
        )
    values = np.geomspace(start, stop, number) if spacing else np.linspace(start, stop, number)
    # Whole numbers stay whole, so that counts can be swept.
    whole = all(re.fullmatch(r"[-+]?\d+", end.strip()) for end in (first, last)) and (values == np.rint(values)).all()
    return tuple(f"{int(value)}" if whole else f"{value!r} {unit}".strip() for value in values.tolist())


def _apart(text: str) -> list[str]:
    """Parts between commas that stand outside of brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for c in text:
        if quote:
            quote = "" if c == quote else quote
        elif c in "'\"":
            quote = c
        elif c in "[{(":
            depth += 1
        elif c in "]})":
            depth -= 1
        if c == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += c
    return [part.strip() for part in parts]


def _samples(model: Model, key: str, text: str, stated: Mapping[str, float]) -> list[Sample]:
    """The samples of ``KEY~tolerance``, ``KEY~10%`` or ``KEY~LOW:HIGH``; the key may hold ``*``."""
    names = [parameter.name for parameter in model.parameters]
    wild = "*" in key or "?" in key
    chosen = [n for n in names if fnmatch.fnmatchcase(n, key)] if wild else list(parameters_of(model, key))
    if not chosen:
        raise ParameterError(
            f"the model has no parameter '{key}' that can be drawn",
            remedy=f"{nearest(key, names)}; what shapes a model, or is an FMU's, goes on an axis: {key}=A,B,C",
        )
    made = []
    for name in chosen:
        parameter = model.parameters[model.parameter_index(name)]
        declared, own = parameter.declared, parameter.value
        bounds = inside(declared)
        tolerance = stated.get(name, declared.tolerance)
        if text == "tolerance":
            if wild and (not tolerance or own == 0):
                continue
            if not tolerance:
                raise ParameterError(
                    f"'{name}' has no tolerance", remedy=f"give one: {name}~10%, or bounds: {name}~LOW:HIGH"
                )
            made.append(Sample(name, 1 - tolerance, 1 + tolerance, declared.unit, True, *bounds))
        elif text.endswith("%"):
            share = convert(text, "1")
            if share <= 0:
                raise ParameterError(f"'{text}' is no share to vary by", remedy=f"write for example {key}~10%")
            made.append(Sample(name, 1 - share, 1 + share, declared.unit, True, *bounds))
        elif (law := read_law(name, text, declared, own, bounds)) is not None:
            made.append(law)
        else:
            low, colon, high = text.partition(":")
            if not colon:
                raise ParameterError(f"'{text}' is no range to draw from", remedy=USAGE.replace("KEY", key))
            ends = (declared.check(number_or_text(low.strip())), declared.check(number_or_text(high.strip())))
            if not ends[0] < ends[1]:
                raise ParameterError(f"'{text}' is empty: {low.strip()} is not below {high.strip()}")
            made.append(Sample(name, *ends, declared.unit, False, *bounds))
        if made[-1].relative and own == 0:
            raise ParameterError(f"'{name}' is 0, and a share of it as well", remedy=f"give bounds: {name}~LOW:HIGH")
        if not bounds[0] <= made[-1].at(0.5, own) <= bounds[1]:
            unit = "" if declared.unit in ("1", "*") else f" {declared.unit}"
            raise ParameterError(
                f"'{text}' gives no value that '{name}' may have", remedy=f"it must be {declared.limits}{unit}"
            )
    if not made:
        raise ParameterError(f"none of the parameters '{key}' has a tolerance", remedy="give one: KEY~10%")
    return made


def inside(declared: Any) -> tuple[float, float]:
    """The least and greatest value that a parameter accepts."""
    low, high = declared.bounds
    if declared.gt is not None:
        low = math.nextafter(low, math.inf)
    if declared.lt is not None:
        high = math.nextafter(high, -math.inf)
    return low, high
