"""An FMU from elsewhere as a block of a scenario: ``type: FMU``."""

from __future__ import annotations

import hashlib
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
from engine.quantity import coherent
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

    Inputs that nothing feeds keep the FMU's start value. Units are converted where the FMU names one that is known.
    ``unit`` tells those of connectors to which the FMU gives none, as ``u=V; w=rad/s``, or ``V`` for the only such
    output; without it their numbers are passed as they are, to and from any unit.

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
    set = option(str, "", "start values of the FMU's parameters in its own units: NAME=VALUE; NAME=VALUE")

    unit = option(str, "", "units of connectors to which the FMU gives none: UNIT, or NAME=UNIT; NAME=UNIT")

    _description: Any

    def __init__(self, **values: Any) -> None:
        self._description = _read(str(values.get("file", "")))
        super().__init__(**values)

    def check(self) -> None:
        """Parameters and connectors that are named must be the FMU's own."""
        self.start_values()
        self.scales()

    def start_values(self) -> dict[str, float]:
        """Start values asked for by name.

        Raises:
            ParameterError: the FMU has no such parameter, or the value is not a number.
        """
        known = [v.name for v in self._description.modelVariables if v.causality in ("parameter", "input")]
        found = {}
        for text in filter(None, (part.strip() for part in self.set.split(";"))):
            name, _, value = (part.strip() for part in text.partition("="))
            if name not in known:
                raise ParameterError(f"the FMU has no parameter '{name}'", remedy=nearest(name, known))
            try:
                found[name] = float(value)
            except ValueError:
                raise ParameterError(f"'{text}' gives no number", remedy="write NAME=VALUE") from None
        return found

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
        warnings.warn(f"'{path}' is run: an FMU block of the scenario names it", RuntimeWarning, stacklevel=2)
        inputs, outputs = self.variables("input"), self.variables("output")
        start = self.start_values()
        scales = self.scales()
        units = [(f"held{k + 1}", scales[v.name][1]) for k, v in enumerate(outputs)]
        identity = f"{path} {hashlib.sha256(path.read_bytes()).hexdigest()[:16]} {sorted(start.items())} {self.unit}"
        clock = net.clock(self.period, self.sample_offset)
        given = [self.port(v.name) for v in inputs]
        held = net.external("fmu", clock, given, units, lambda: Stepped(path, inputs, outputs, start, scales), identity)
        for v, value in zip(outputs, held, strict=True):
            net.output(self.ports[v.name], value)


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


def _is_number(text: Any) -> bool:
    try:
        float(text)
    except (TypeError, ValueError):
        return False
    return True
