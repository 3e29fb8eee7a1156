"""What the end of a run and the time between its rows must be to each other."""

from __future__ import annotations

from engine.errors import ParameterError


def check_rows(stop: float, step: float) -> None:
    """Refuse rows that are farther apart than the run is long: it would have a single one.

    Args:
        stop: end (s).
        step: time between rows (s).

    Raises:
        ParameterError: the step is longer than the run.
    """
    if step > stop > 0:
        raise ParameterError(
            f"the step ({step:g} s) is longer than the simulation ({stop:g} s)",
            remedy="give a shorter step, or a later stop",
        )
