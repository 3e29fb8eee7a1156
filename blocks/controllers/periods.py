"""The sample period of a block whose matrices come from a file: the one given, or the file's."""

from __future__ import annotations

import math
from collections.abc import Mapping

from blocks.controllers.matrices import Matrix
from engine.errors import ParameterError


def stated_period(matrices: Mapping[str, Matrix]) -> float | None:
    """``dt`` of a file (s), 0 for a continuous system; None where the file does not say.

    Raises:
        ParameterError: it is no time.
    """
    stated = matrices.get("dt")
    if stated is None:
        return None
    if not (stated.size == 1 and 0 <= stated.item() < math.inf):
        what = f"{stated.item():g}" if stated.size == 1 else f"{stated.shape[0]} by {stated.shape[1]} numbers"
        raise ParameterError(f"'dt' of the file is {what}", remedy="it is the sample period, one number of seconds")
    return stated.item()


def same_period(given: float | None, matrices: Mapping[str, Matrix], file: str) -> float:
    """The sample period (s) of a block that may be continuous (0): the one given, or ``dt`` of its file.

    Args:
        given: None where the scenario gives none.
        matrices: of the file.
        file: its name.

    Raises:
        ParameterError: both, and different: the matrices are those of another period.
    """
    stated = stated_period(matrices)
    if given is None or stated is None:
        return given or stated or 0.0
    if not math.isclose(given, stated, rel_tol=1e-9):
        made = f"sampled every {stated:g} s" if stated else "continuous"
        raise ParameterError(
            f"period = {given:g} s, but the matrices of '{file}' are {made} (dt = {stated:g})",
            remedy=f"design for a period of {given:g} s, or leave the period out" if given else "leave the period out",
        )
    return given


def period_of(given: float, matrices: Mapping[str, Matrix]) -> float:
    """The sample period (s) of a block that is sampled: the one given, or ``dt`` of the file.

    Raises:
        ParameterError: neither, or both and different.
    """
    found = stated_period(matrices) or 0.0
    if given and found and not math.isclose(given, found, rel_tol=1e-9):
        raise ParameterError(f"period = {given:g} s, but the file says dt = {found:g} s", remedy="leave the period out")
    if not (given or found > 0):
        raise ParameterError("no sample period is given", remedy="give period, or dt in the file")
    return given or found
