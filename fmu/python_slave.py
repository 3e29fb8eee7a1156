"""The slave of an FMU that runs in Python: what the importer asks, done by `fmu.python_core.Core` in the right order.

It is a slave of pythonfmu, with its names of calls, its statuses and its log. What pythonfmu leaves open is settled
here: the whole state is kept, values that are not finite are refused, and a call out of order is an error.
"""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from engine.errors import FlexarmError, ParameterError
from fmu.plan import plan
from fmu.python_core import RECIPE, Core, names_of
from fmu.python_state import (
    ERROR,
    INITIALIZATION,
    INSTANTIATED,
    STEP,
    TERMINATED,
    Standing,
    check,
    from_bytes,
    to_bytes,
)
from fmu.variables import INPUT, PARAMETER, TIME_KIND

_WORDS = {
    INSTANTIATED: "instantiated",
    INITIALIZATION: "in initialization mode",
    STEP: "in step mode",
    TERMINATED: "terminated",
    ERROR: "in error",
}


class Refused(Exception):
    """A call that is not obeyed and has changed nothing.

    Attributes:
        status: of FMI.
        text: why.
    """

    def __init__(self, status: Fmi2Status, text: str) -> None:
        super().__init__(text)
        self.status, self.text = status, text


def _error(text: str) -> Refused:
    return Refused(Fmi2Status.error, text)


class Slave(Fmi2Slave):  # type: ignore[misc]
    """An instance. ``resources/recipe.json`` names what gives the model: a function of the folder and the recipe.

    Attributes:
        identity: changes when the model changes.

    Raises:
        FlexarmError: the model cannot be loaded, or is not the one that was exported.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        folder = Path(self.resources)
        recipe = json.loads((folder / RECIPE).read_text(encoding="utf-8"))
        module, _, name = recipe["loader"].partition(":")
        model = getattr(importlib.import_module(module), name)(folder, recipe)
        self.identity: str = recipe["identity"]
        self._plan = plan(model, recipe["step"], recipe["stop"], settable=False)
        if names_of(self._plan) != recipe["names"]:
            raise FlexarmError(
                "the flexarm of this Python makes another model of the scenario", remedy="export it again"
            )
        self._core = Core(self._plan)

    # -- life ---------------------------------------------------------------------------------------------------------

    def _allowed(self, *phases: str) -> None:
        if self._core.phase not in phases:
            raise _error(f"not allowed while the instance is {_WORDS[self._core.phase]}")

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """A failed run, and whatever nobody foresaw, puts the instance into error."""
        try:
            yield
        except FlexarmError:
            if self._core.failed:
                self._core.phase = ERROR
            raise
        except BaseException:
            self._core.phase = ERROR
            raise

    @property
    def time(self) -> float:
        """Where the run stands (s)."""
        return self._core.time

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Remember start and end."""
        self._allowed(INSTANTIATED)
        if tolerance is not None and not 0 <= tolerance <= 1:
            raise _error("the tolerance lies outside 0 to 1")
        if not (math.isfinite(start_time) and start_time + self._plan.step > start_time):
            raise _error("startTime is not finite, or so large that a step is lost in rounding")
        if stop_time is not None and not stop_time >= start_time:
            raise _error("stopTime lies before startTime")
        self._core.begin(start_time, math.inf if stop_time is None else stop_time)

    def enter_initialization_mode(self) -> None:
        """Begin the initialization."""
        self._allowed(INSTANTIATED)
        self._core.phase = INITIALIZATION

    def exit_initialization_mode(self) -> None:
        """End the initialization: the values at the start are worked out."""
        self._allowed(INITIALIZATION)
        with self._failing():
            self._core.evaluate()
        self._core.phase = STEP

    def terminate(self) -> None:
        """End the run."""
        self._allowed(STEP)
        with self._failing():
            self._core.evaluate()
        self._core.phase = TERMINATED

    # -- values -------------------------------------------------------------------------------------------------------

    def _get(self, references: Sequence[int], real: bool) -> list[float]:
        variables = self._plan.variables
        for reference in references:
            if reference >= len(variables) or variables[reference].is_real != real:
                raise self._invalid("no variable of this type", reference)
        given = (TIME_KIND, PARAMETER, INPUT)
        if self._core.phase in (INSTANTIATED, ERROR) and any(variables[r].kind not in given for r in references):
            raise _error("outputs and states have no value before initialization or after an error")
        with self._failing():
            return self._core.get(list(references))

    def _invalid(self, what: str, reference: int) -> Refused:
        known = reference < len(self._plan.variables)
        name = f", {self._plan.variables[reference].name}" if known else ""
        return _error(f"{what}: value reference {reference}{name}")

    def get_real(self, references: Sequence[int]) -> list[float]:
        """Values of real variables."""
        return self._get(references, True)

    def get_integer(self, references: Sequence[int]) -> list[int]:
        """Modes."""
        return [int(value) for value in self._get(references, False)]

    def refuse_type(self, references: Sequence[int]) -> None:
        """Refuse: no variable can be used so."""
        raise self._invalid("no variable of this type can be used so", references[0])

    def set_real(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Set inputs and parameters, all of them or none."""
        self._allowed(INSTANTIATED, INITIALIZATION, STEP)
        for reference in references:
            if reference >= len(self._plan.variables):
                raise self._invalid("neither an input nor a parameter", reference)
        try:
            self._core.set(list(references), list(values))
        except ParameterError as error:
            raise Refused(Fmi2Status.discard, error.message) from error

    # -- steps and states ---------------------------------------------------------------------------------------------

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Do a step."""
        self._allowed(STEP)
        with self._failing():
            self._core.step(current_time, step_size)
        return True

    def _get_fmu_state(self) -> Standing:
        if self._core.phase == ERROR:
            raise _error("there is no state to save after an error")
        return self._core.snapshot()

    def _set_fmu_state(self, state: Standing) -> None:
        self._core.restore(state)

    def _fmu_state_to_bytes(self, state: Standing) -> bytes:
        return to_bytes(state, self.identity)

    def _fmu_state_from_bytes(self, text: bytes) -> Standing:
        state = from_bytes(text, self.identity)
        check(state, self._plan.model)
        return state
