"""A Co-Simulation FMU loaded into this process, FMI 2 or FMI 3, by FMPy: the same few calls for both.

What it does wrong, it does to this process; `fmu.host` loads it into another one.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from engine.errors import FlexarmError, SimulationError, nearest
from fmu.archive import description as checked_description
from fmu.archive import unpack

_GROUPS = {
    "Real": "Real",
    "Integer": "Integer",
    "Enumeration": "Integer",
    "Boolean": "Boolean",
}
_GROUPS3 = {f"{sign}Int{bits}": f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)} | {
    "Float64": "Float64",
    "Float32": "Float32",
    "Boolean": "Boolean",
    "Enumeration": "Int64",
}

_LONGEST = 4000
"""Bytes of a log message that are kept."""

NUMBERS = frozenset(_GROUPS) | frozenset(_GROUPS3)
"""Types of variables that hold a number."""


class Described:
    """What the description of an FMU tells of its variables.

    Attributes:
        description: of the FMU, as FMPy reads it.
    """

    def __init__(self, description: Any) -> None:
        self.description = description
        self._version3 = description.fmiVersion.startswith("3")
        self._groups = _GROUPS3 if self._version3 else _GROUPS
        self._variables = {variable.name: variable for variable in description.modelVariables}

    def names(self, causality: str) -> tuple[str, ...]:
        """Variables of a causality that hold one number each, in the order of the description."""
        return tuple(
            v.name
            for v in self.description.modelVariables
            if v.causality == causality and v.type in self._groups and not v.dimensions
        )

    def variable(self, name: str) -> Any:
        """A variable of the description.

        Raises:
            FlexarmError: there is none of that name that holds a number.
        """
        found = self._variables.get(name)
        if found is None:
            raise FlexarmError(f"the FMU has no variable '{name}'", remedy=nearest(name, self._variables))
        if found.type not in self._groups:
            raise FlexarmError(f"the FMU's variable '{name}' is a {found.type}, not a number")
        return found

    @property
    def gives_rates(self) -> bool:
        """Whether rates of change of outputs are known."""
        return not self._version3 and (self.description.coSimulation.maxOutputDerivativeOrder or 0) > 0

    @property
    def takes_rates(self) -> bool:
        """Whether inputs may go on with a slope over the next step."""
        return not self._version3 and bool(self.description.coSimulation.canInterpolateInputs)


class Loaded(Described):
    """An instance of an FMU in this process, from its start to its end; made by `loaded`.

    Attributes:
        messages: what the FMU logged.
        raw: FMPy's `FMU2Slave` or `FMU3Slave`.
    """

    def __init__(self, instance: Any, description: Any, messages: list[str]) -> None:
        super().__init__(description)
        self.messages = messages
        self.raw = instance

    def set(self, names: Sequence[str], values: Sequence[float], slopes: Sequence[float] = ()) -> None:
        """Set variables; with slopes (FMI 2 alone), inputs that go on rising until the next step's end."""
        reals: list[tuple[int, float]] = []
        for name, value in zip(names, values, strict=True):
            variable = self.variable(name)
            group = self._groups[variable.type]
            if group in ("Real", "Float64"):
                reals.append((variable.valueReference, float(value)))
            else:
                number = bool(value > 0.5) if group == "Boolean" else value if group == "Float32" else round(value)
                self._call(f"set{group}", [variable.valueReference], [number])
        if reals:
            self._call("setFloat64" if self._version3 else "setReal", [r for r, _ in reals], [v for _, v in reals])
        if any(slopes) and not self._version3:
            references = [self.variable(name).valueReference for name in names]
            self._call("setRealInputDerivatives", references, [1] * len(references), list(slopes))

    def get(self, names: Sequence[str]) -> list[float]:
        """Values of variables, finite or not."""
        variables = [self.variable(name) for name in names]
        groups = [self._groups[variable.type] for variable in variables]
        if groups and set(groups) <= {"Real", "Float64"}:
            return [float(v) for v in self._call(f"get{groups[0]}", [v.valueReference for v in variables])]
        return [
            float(self._call(f"get{group}", [variable.valueReference])[0])
            for group, variable in zip(groups, variables, strict=True)
        ]

    def rate(self, name: str) -> float:
        """Rate of change of an output, per second."""
        return float(self._call("getRealOutputDerivatives", [self.variable(name).valueReference], [1])[0])

    def enter(self, start: float = 0.0, stop: float | None = None) -> None:
        """Enter initialization mode, in which inputs may be set; parameters are set before."""
        if self._version3:
            self._call("enterInitializationMode", startTime=start, stopTime=stop)
        else:
            self._call("setupExperiment", startTime=start, stopTime=stop)
            self._call("enterInitializationMode")

    def leave(self) -> None:
        """Leave initialization mode."""
        self._call("exitInitializationMode")

    @contextmanager
    def starting(self, start: float = 0.0, stop: float | None = None) -> Iterator[None]:
        """Initialization mode, from its start to its end."""
        self.enter(start, stop)
        yield
        self.leave()

    def step(self, begin: float, length: float) -> None:
        """Go on from ``begin`` by ``length`` (s).

        Raises:
            SimulationError: the FMU refuses, ends the run or stops early.
        """
        answer = self._call("doStep", currentCommunicationPoint=begin, communicationStepSize=length)
        if self._version3:
            _, terminate, early, last = answer
            if terminate or early:
                raise SimulationError(f"the FMU ended the run at t = {last:g} s")

    def end(self) -> None:
        """Terminate the run."""
        self._call("terminate")

    def _call(self, name: str, *arguments: Any, **settings: Any) -> Any:
        from fmpy.fmi1 import FMICallException

        count = len(self.messages)
        try:
            return getattr(self.raw, name)(*arguments, **settings)
        except FMICallException as error:
            said = self.messages[count:]
            raise SimulationError(said[-1] if said else str(error)) from error


def described(path: str | Path) -> Any:
    """The description of a Co-Simulation FMU.

    Raises:
        FlexarmError: the file is no FMU, or has no Co-Simulation of FMI 2 or 3.
    """
    description = checked_description(path)
    if description.coSimulation is None or description.fmiVersion.startswith("1"):
        raise FlexarmError(
            f"'{path}' is FMI {description.fmiVersion} without Co-Simulation of FMI 2 or 3",
            remedy="export it for Co-Simulation",
        )
    return description


@contextmanager
def loaded(path: str | Path, name: str = "instance") -> Iterator[Loaded]:
    """An instance of a Co-Simulation FMU in this process, not yet started.

    Raises:
        FlexarmError: the file is no FMU, has no Co-Simulation, or has no binary for this machine.
    """
    description = described(path)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        unpack(Path(path), Path(folder))
        try:
            made = instance(description, folder, name)
        except FlexarmError as error:
            raise FlexarmError(f"'{path}': {error.message}", remedy=error.remedy) from error
        try:
            yield made
        finally:
            made.raw.freeInstance()


def instance(description: Any, folder: str, name: str) -> Loaded:
    """An instance of an FMU that is unpacked; its ``raw.freeInstance()`` ends it.

    Raises:
        FlexarmError: it cannot be loaded.
    """
    messages: list[str] = []
    make = _slave3 if description.fmiVersion.startswith("3") else _slave2
    return Loaded(make(description, folder, name, messages), description, messages)


def _arguments(description: Any, folder: str, name: str) -> dict[str, Any]:
    return {
        "guid": description.guid if description.guid is not None else description.instantiationToken,
        "unzipDirectory": folder,
        "modelIdentifier": description.coSimulation.modelIdentifier,
        "instanceName": name,
    }


def _made(make: Any, start: Any, messages: list[str]) -> Any:
    try:
        instance = make()
        start(instance)
    except Exception as error:
        said = f": {messages[-1]}" if messages else ""
        raise FlexarmError(
            f"the FMU cannot be loaded: {error}{said}", remedy="it needs a binary for this machine and what that needs"
        ) from error
    return instance


def _text(message: bytes | None) -> str:
    """A log message as an FMU gives it, which may be NULL, of any length and in any encoding."""
    return (message or b"(no message)")[:_LONGEST].decode("utf-8", "replace")


def _slave2(description: Any, folder: str, name: str, messages: list[str]) -> Any:
    from fmpy import fmi2

    def log(environment: Any, instance: Any, status: int, category: Any, message: bytes | None) -> None:
        messages.append(_text(message))

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(log)
    callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
    callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
    return _made(
        lambda: fmi2.FMU2Slave(**_arguments(description, folder, name)),
        lambda instance: instance.instantiate(callbacks=callbacks, loggingOn=True),
        messages,
    )


def _slave3(description: Any, folder: str, name: str, messages: list[str]) -> Any:
    from fmpy import fmi3

    def log(environment: Any, status: int, category: bytes | None, message: bytes | None) -> None:
        messages.append(_text(message))

    return _made(
        lambda: fmi3.FMU3Slave(**_arguments(description, folder, name)),
        lambda instance: instance.instantiate(logMessage=log),
        messages,
    )
