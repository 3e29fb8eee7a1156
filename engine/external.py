"""Python functions called during a run: their return values and their failures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import FlexarmError, SimulationError
from engine.model import Model


class Calls:
    """The external functions of one run, each made afresh.

    Attributes:
        failure: what the function that failed raised; None while all is well.

    Raises:
        SimulationError: a function cannot be made.
    """

    def __init__(self, model: Model) -> None:
        self.externals = model.externals
        self.functions: list[Any] = []
        self.failure: BaseException | None = None
        for external in model.externals:
            try:
                self.functions.append(external.make())
            except Exception as error:
                remedy = error.remedy if isinstance(error, FlexarmError) else ""
                raise SimulationError(f"'{external.name}' cannot be started: {_text(error)}", remedy=remedy) from error

    def call(self, k: int, t: float, inputs: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The answer of function ``k`` at instant ``t`` (s), or None if it failed."""
        wanted = self.externals[k].outputs
        try:
            answer = np.asarray(self.functions[k](t, inputs), dtype=float).ravel()
            if len(answer) != wanted:
                raise ValueError(f"it returned {len(answer)} values, not {wanted}")
            if not np.isfinite(answer).all():
                raise ValueError(f"it returned {answer[~np.isfinite(answer)][0]}")
        except BaseException as error:
            self.failure = error
            return None
        return answer

    def finish(self) -> None:
        """Pass on an interruption that reached Python inside a function."""
        if self.failure is not None and not isinstance(self.failure, Exception):
            raise self.failure


def _text(error: BaseException) -> str:
    return error.message if isinstance(error, FlexarmError) else f"{type(error).__name__}: {error}"


def explain(model: Model, culprit: int, cause: BaseException | None) -> str:
    """Which function failed and how."""
    return f"'{model.externals[culprit].name}' failed: {_text(cause) if cause is not None else 'no reason is known'}"
