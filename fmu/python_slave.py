"""The slave of a pythonfmu FMU: it passes pythonfmu's calls to `fmu.python_core.Core`.

pythonfmu's faults are repaired here: the whole state is kept and restored, values that are not finite are refused, and
the description is our own, with ModelStructure and initial unknowns. No exception may reach pythonfmu's binary: it
would free the instance, and the importer's next call would crash.
"""

from __future__ import annotations

import importlib
import json
import math
from pathlib import Path
from typing import Any, ClassVar

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from engine.errors import FlexarmError
from fmu.plan import plan
from fmu.python_core import Core
from fmu.python_state import Standing, from_bytes, to_bytes

RECIPE = "recipe.json"

owed: list[dict[str, Any]] = []
"""References to the names of the FMU's module: pythonfmu's binary releases one more than it took whenever it makes an
instance, and in the end the module would be gone while it is in use."""


class Slave(Fmi2Slave):  # type: ignore[misc]
    """An instance. ``resources/recipe.json`` names what gives the model: a function of the folder and the recipe.

    Attributes:
        identity: changes when the model changes.
    """

    identity: ClassVar[str] = ""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        folder = Path(self.resources)
        recipe = json.loads((folder / RECIPE).read_text(encoding="utf-8"))
        module, _, name = recipe["loader"].partition(":")
        model = getattr(importlib.import_module(module), name)(folder, recipe)
        self._refused = ""
        self._core = Core(plan(model, recipe["step"], recipe["stop"], settable=False))

    def _refuse(self, error: Exception) -> None:
        """Log an error; the run continues only after a valid value is set."""
        self._refused = error.message if isinstance(error, FlexarmError) else f"{type(error).__name__}: {error}"
        self.log(self._refused, Fmi2Status.error)

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Remember the start."""
        self._core.begin(start_time)

    def get_real(self, references: list[int]) -> list[float]:
        """Values of real variables; not a number where there is none."""
        try:
            return self._core.get(references)
        except Exception as error:
            self._refuse(error)
            return [math.nan] * len(references)

    def get_integer(self, references: list[int]) -> list[int]:
        """Modes; 0 where there is none."""
        return [0 if math.isnan(value) else int(value) for value in self.get_real(references)]

    def set_real(self, references: list[int], values: list[float]) -> None:
        """Set inputs and parameters; what does not fit is logged, changes nothing and keeps the run from going on."""
        try:
            self._core.set(list(references), list(values))
        except Exception as error:
            self._refuse(error)
        else:
            self._refused = ""

    def set_integer(self, references: list[int], values: list[int]) -> None:
        """Refuse: no integer variable can be set."""
        self._refuse(FlexarmError("modes are calculated and cannot be set"))

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Do a step; errors are logged."""
        if self._refused:
            self.log(f"no step is done after an error: {self._refused}", Fmi2Status.error)
            return False
        try:
            self._core.step(current_time, step_size)
        except FlexarmError as error:
            self.log(error.message, Fmi2Status.error)
            return False
        except Exception as error:
            self._refuse(error)
            return False
        return True

    def _get_fmu_state(self) -> Standing | str:
        try:
            return self._core.snapshot()
        except Exception as error:
            self._refuse(error)
            return str(error)

    def _set_fmu_state(self, state: Standing | str) -> None:
        try:
            if isinstance(state, str):
                raise FlexarmError(state)
            self._core.restore(state)
        except Exception as error:
            self._refuse(error)
        else:
            self._refused = ""

    @classmethod
    def _fmu_state_to_bytes(cls, state: Standing | str) -> bytes:
        try:
            return b"" if isinstance(state, str) else to_bytes(state, cls.identity)
        except Exception:
            return b""

    @classmethod
    def _fmu_state_from_bytes(cls, text: bytes) -> Standing | str:
        try:
            return from_bytes(text, cls.identity)
        except Exception as error:
            return str(error)
