"""An FMU from elsewhere as a block of a scenario: ``type: FMU``."""

from __future__ import annotations

import functools
import hashlib
import re
import warnings
import weakref
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from engine.block import Block, option, parameter
from engine.errors import FlexarmError, ParameterError, nearest
from engine.ports import Port
from engine.quantity import Parameter, coherent, convert
from fmu import archive
from fmu.host import host
from fmu.loaded import NUMBERS

if TYPE_CHECKING:
    from engine.model import Vector
    from engine.net import Net


class FMU(Block):
    """A Co-Simulation FMU, FMI 2 or 3, stepped at a clock: its inputs and outputs are the connectors.

    At each instant the FMU does the step that ends there, with the inputs of the instant before; then it is given the
    inputs of this instant, and its outputs are read and held until the next. An output that depends on its input
    directly is therefore not delayed; one that is computed inside a step is delayed by one step. Outputs are 0 before
    the first instant.

    The FMU's parameters are set by their names, as the block's own are (``limit: 10 V``, ``--set control.limit=8``,
    ``--vary control.limit=6:12:4``), which goes before ``set``, a text for several. Where the FMU gives no unit they
    are plain numbers.

    Inputs that nothing feeds keep the FMU's start value. Units are converted where the FMU names one that is known.
    ``unit`` tells those of connectors to which the FMU gives none, as ``u=V; w=rad/s``, or ``V`` for the only such
    output, and 1 for a plain number; without it their numbers are passed as they are, to and from any unit, which a
    warning says.

    The FMU's binary runs in a process of its own, so that one that crashes ends the run and not this program, but with
    all the rights of the user: a warning names it when it is loaded, which happens only where a scenario names it.
    There is no derivative of it and no C form: fits by gradients refuse the model, and it exports by the python backend
    alone.
    """

    files: ClassVar[tuple[str, ...]] = ("file",)
    """Options that name files; a scenario resolves them from where it stands."""

    file = option(str, ..., "the .fmu file")
    period = parameter("s", ..., "sample period, which is the communication step", gt=0, structural=True)
    sample_offset = parameter("s", 0.0, "instant of the first sample", ge=0, structural=True)
    set = option(str, "", "start values of the FMU's parameters and inputs in its own units: NAME=VALUE; NAME=VALUE")

    unit = option(str, "", "units of connectors to which the FMU gives none: UNIT, or NAME=UNIT; NAME=UNIT")

    _description: Any

    def __init__(self, **values: Any) -> None:
        self._description = _read(str(values.get("file", "")))
        super().__init__(**values)

    @classmethod
    def further_parameters(cls, values: Mapping[str, Any]) -> Iterable[Parameter]:
        """The FMU's own parameters that are numbers, but for those with the name of one of the block's."""
        file = str(values.get("file", ""))
        if not Path(file).is_file():
            return
        for v in _read(file).modelVariables:
            if v.causality == "parameter" and v.type in NUMBERS and not v.dimensions and v.name not in _OWN:
                doc = v.description or "parameter of the FMU"
                yield Parameter(v.name, _own_unit(v.unit), None, doc, structural=True)

    def check(self) -> None:
        """Parameters and connectors that are named must be the FMU's own."""
        self.start_values()
        self.scales()

    def start_values(self) -> dict[str, float]:
        """Start values asked for by name.

        Raises:
            ParameterError: the FMU has no such parameter, or the value is not a number.
        """
        known = {v.name: v for v in self._description.modelVariables if v.causality in ("parameter", "input")}
        found: dict[str, float] = {}
        for text in filter(None, (part.strip() for part in self.set.split(";"))):
            name, equals, value = (part.strip() for part in text.partition("="))
            if not equals:
                raise ParameterError(f"set: '{text}' sets nothing", remedy="write NAME=VALUE; NAME=VALUE")
            if name not in known:
                raise ParameterError(f"set: the FMU has no parameter '{name}'", remedy=nearest(name, known))
            if name in found:
                raise ParameterError(f"set: '{name}' is given twice", remedy="keep one of them")
            found[name] = _start_value(name, value, _own_unit(known[name].unit))
        return found | {name: value for name, value in self.values.items() if name in known and name not in _OWN}

    def variables(self, causality: str) -> list[Any]:
        """The FMU's inputs or outputs that are numbers."""
        return [
            v
            for v in self._description.modelVariables
            if v.causality == causality and v.type in NUMBERS and not v.dimensions
        ]

    def further_ports(self) -> Iterable[Port]:
        """The FMU's own inputs and outputs."""
        scales = self.scales()
        for v in self.variables("input"):
            factor, unit = scales[v.name]
            start = float(v.start) * factor if _is_number(v.start) else 0.0
            yield Port(v.name, "input", v.description or "input of the FMU", unit=unit, default=start)
        for v in self.variables("output"):
            unit = scales[v.name][1]
            yield Port(v.name, "output", v.description or "output of the FMU", unit=unit, like="*")

    def scales(self) -> dict[str, tuple[float, str]]:
        """Factor to SI and coherent unit of each connector; 1 and ``*`` where neither the FMU nor ``unit`` tells one.

        Raises:
            ParameterError: ``unit`` names no connector, one with a unit of its own, or no unit.
        """
        outputs = self.variables("output")
        found = {v.name: _scale(v.unit) for v in (*self.variables("input"), *outputs)}
        for name, unit in self._units_given([v.name for v in outputs if found[v.name][1] == "*"]):
            if name not in found:
                raise ParameterError(f"unit: the FMU has no connector '{name}'", remedy=nearest(name, list(found)))
            if found[name][1] != "*":
                raise ParameterError(
                    f"unit: the FMU itself gives '{name}' in {found[name][1]}", remedy="leave it out of unit"
                )
            factor, coherent_unit = coherent(unit)
            found[name] = float(factor), str(coherent_unit)
        return found

    def _units_given(self, unitless: Sequence[str]) -> Iterable[tuple[str, str]]:
        parts = [part.strip() for part in self.unit.split(";") if part.strip()]
        for part in parts:
            name, equals, unit = (text.strip() for text in part.partition("="))
            if equals:
                yield name, unit
            elif len(unitless) == 1:
                yield unitless[0], name
            else:
                named = ", ".join(unitless) or "none"
                raise ParameterError(
                    f"unit: '{part}' names no connector, and outputs without a unit are: {named}",
                    remedy="write NAME=UNIT; NAME=UNIT",
                )

    def stamp(self, net: Net) -> None:
        """Call the FMU at the instants of its clock."""
        path = Path(self.file)
        scales = self.scales()
        untold = [name for name, (_, unit) in scales.items() if unit == "*"]
        if untold:
            named = ", ".join(untold[:8]) + (", ..." if len(untold) > 8 else "")
            warnings.warn(
                f"'{path}' gives no units to {named}: their numbers pass unchecked; "
                f"tell them by 'unit: {untold[0]}=...', 1 for a plain number",
                RuntimeWarning,
                stacklevel=2,
            )
        warnings.warn(f"'{path}' is run: an FMU block of the scenario names it", RuntimeWarning, stacklevel=2)
        inputs, outputs = self.variables("input"), self.variables("output")
        start = self.start_values()
        units = [(f"held{k + 1}", scales[v.name][1]) for k, v in enumerate(outputs)]
        identity = f"{path} {hashlib.sha256(path.read_bytes()).hexdigest()[:16]} {sorted(start.items())} {self.unit}"
        clock = net.clock(self.period, self.sample_offset)
        given = [self.port(v.name) for v in inputs]
        held = net.external("fmu", clock, given, units, lambda: Stepped(path, inputs, outputs, start, scales), identity)
        for v, value in zip(outputs, held, strict=True):
            net.output(self.ports[v.name], value)


_OWN = frozenset((*FMU.parameters, *FMU.options))
"""What the block itself is given; parameters of an FMU that are called so are set by ``set``."""


class Stepped:
    """One run of an FMU: called with an instant (s) and its inputs, answers with its outputs, SI units.

    Raises:
        FlexarmError: it cannot be loaded or refuses a start value.
    """

    def __init__(
        self,
        path: Path,
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        start: Mapping[str, float],
        scales: Mapping[str, tuple[float, str]],
    ) -> None:
        self._inputs, self._outputs = [v.name for v in inputs], [v.name for v in outputs]
        self._in = np.array([1 / scales[v.name][0] for v in inputs])
        self._out = np.array([scales[v.name][0] for v in outputs])
        self._stack = ExitStack()
        self._time: float | None = None
        try:
            self._host = self._stack.enter_context(host(path, path.stem))
            self._host.set(list(start), list(start.values()))
        except BaseException:
            self._stack.close()
            raise
        weakref.finalize(self, self._stack.close)

    def __call__(self, time: float, inputs: Vector) -> Vector:
        """Step to ``time``, set the inputs, read the outputs."""
        values = (inputs * self._in).tolist()
        if self._time is None:
            with self._host.starting(time):
                self._host.set(self._inputs, values)
        else:
            self._host.step(self._time, time - self._time)
            self._host.set(self._inputs, values)
        self._time = time
        return np.asarray(np.array(self._host.get(self._outputs)) * self._out)


def _read(file: str) -> Any:
    if not file or not Path(file).is_file():
        raise ParameterError(f"there is no FMU '{file}'", remedy="give file: the path of an .fmu from the scenario")
    state = Path(file).stat()
    return _described(file, state.st_mtime_ns, state.st_size)


@functools.lru_cache(32)
def _described(file: str, changed: int, size: int) -> Any:
    try:
        description = archive.description(file)
    except FlexarmError as error:
        raise ParameterError(error.message, remedy=error.remedy) from error
    if description.coSimulation is None or description.fmiVersion.startswith("1"):
        raise ParameterError(f"'{file}' has no Co-Simulation of FMI 2 or 3", remedy="export it for Co-Simulation")
    return description


def _scale(given: str | None) -> tuple[float, str]:
    """Factor to SI and coherent unit of a variable's unit; 1 and any unit where it has none that is known."""
    if not given:
        return 1.0, "*"
    try:
        factor, unit = coherent(given)
    except FlexarmError:
        return 1.0, "*"
    return float(factor), str(unit)


def _own_unit(given: str | None) -> str:
    """A variable's own unit; 1 where it has none that is known."""
    return given if given and _scale(given)[1] != "*" else "1"


def _start_value(name: str, text: str, unit: str) -> float:
    """What is written for a start value, in the FMU's own unit.

    Raises:
        ParameterError: no number, or a unit that does not fit.
    """
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return convert(text, unit)
    except ParameterError as error:
        # The number alone is what was meant, where a unit was written that the FMU knows nothing of.
        number = re.match(r"[-+.\deE]*\d[-+.\deE]*", text)
        remedy = f"the FMU gives '{name}' no unit; write its number alone: {name}={number[0] if number else 'NUMBER'}"
        raise ParameterError(
            f"set: '{name}={text}': {error.message}", remedy=error.remedy if unit != "1" else remedy
        ) from None


def _is_number(text: Any) -> bool:
    try:
        float(text)
    except (TypeError, ValueError):
        return False
    return True
