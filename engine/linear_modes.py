"""Modes to linearise in: which inputs a model does not hear in the modes of a point, and in which modes it does."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from engine.errors import FlexarmError
from engine.linearise import LinearModel, linearise
from engine.model import TIME, Model


def deaf(linear: LinearModel) -> list[str]:
    """Inputs that move no output of a linear model: the joint is stuck, or the input ends inside a dead zone."""
    moves, passes = linear.A != 0, linear.C != 0
    found = []
    for j, name in enumerate(linear.inputs):
        reached = linear.B[:, j] != 0
        for _ in linear.states:
            reached = reached | (moves @ reached)
        if not (linear.D[:, j] != 0).any() and not (passes @ reached).any():
            found.append(name)
    return found


def hearing(model: Model, linear: LinearModel, keep: Iterable[str] = (), **point: Any) -> list[LinearModel]:
    """Linear models of the modes in which inputs that now move no output do: stuck joints sliding, zones left.

    Each mode is changed alone, then all of them together; a model is kept if more inputs move an output in it, and its
    modes are not those of one that is kept already.

    Args:
        model: the model.
        linear: its linear model in the modes of the operating point.
        keep: modes that are not changed.
        point: further arguments of `engine.linearise.linearise`: ``at``, ``inputs``, ``modes``.
    """
    silent, asked, kept = len(deaf(linear)), dict(point.pop("modes", None) or {}), set(keep)
    if not silent:
        return []
    free = [
        mode
        for mode in model.modes
        if mode.kind != TIME and mode.name not in kept and linear.modes[mode.name] == mode.labels[1]
    ]
    trials = [{mode.name: label} for mode in free for label in (mode.labels[2], mode.labels[0])]
    trials += [{mode.name: mode.labels[2] for mode in free}] if len(free) > 1 else []
    found: dict[tuple[tuple[str, str], ...], LinearModel] = {}
    for trial in trials:
        try:
            made = linearise(model, modes={**asked, **trial}, **point)
        except FlexarmError:
            continue
        if len(deaf(made)) < silent:
            found.setdefault(tuple(made.modes.items()), made)
    return list(found.values())


def audible(model: Model, linear: LinearModel, **point: Any) -> LinearModel:
    """The linear model itself, or, where some input moves no output in it, one of the modes in which most do.

    Modes that ``point`` asks for stay. What was changed stands in ``assumed``; see `LinearModel`.
    """
    asked = dict(point.get("modes") or {})
    others = hearing(model, linear, asked, **point)
    if not others:
        return linear
    best = min(others, key=lambda made: len(deaf(made)))  # the first of those that hear most: the fewest changes
    changed = [
        f"'{name}' is {best.modes[name]}, not {label} as at the point"
        for name, label in linear.modes.items()
        if best.modes[name] != label
    ]
    silent = ", ".join(name for name in deaf(linear) if name not in deaf(best))
    why = f"{' and '.join(changed)}, where {silent} would move no output"
    return replace(best, assumed=(why,), ambiguous={})
