"""What the command prints: aligned plain text that survives a pipe."""

from __future__ import annotations

import inspect
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from engine.block import Block
from engine.display import without_rounding

if TYPE_CHECKING:
    from diagnosis.compare import Comparison
    from engine.discretise import DiscreteModel
    from engine.family import LinearFamily
    from engine.linearise import LinearModel
    from flexarm.design.reduction import Reduction


def number(value: float) -> str:
    """A number in six digits."""
    return f"{value:.6g}"


def plural(count: int, word: str) -> str:
    """A count and its word: ``1 state``, ``3 states``, ``2 memories``."""
    several = f"{word[:-1]}ies" if word.endswith("y") else f"{word}es" if word.endswith("ch") else f"{word}s"
    return f"{count} {word if count == 1 else several}"


def columns(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows under their heads, columns of numbers to the right."""
    if not rows:
        return ""
    right = [all(_numeric(row[k]) for row in rows) for k in range(len(heads))]
    widths = [max(len(heads[k]), *(len(row[k]) for row in rows)) for k in range(len(heads))]

    def line(cells: Sequence[str]) -> str:
        padded = (c.rjust(w) if r else c.ljust(w) for c, w, r in zip(cells, widths, right, strict=True))
        return ("  " + "  ".join(padded)).rstrip()

    return "\n".join([line(heads), *(line(row) for row in rows)])


def _numeric(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def block_page(name: str, cls: type[Block]) -> str:
    """Law, parameters and connectors of a block."""
    parts = [name, "", inspect.cleandoc(cls.__doc__ or "")]
    if cls.parameters:
        rows = []
        for key, made in cls.parameters.items():
            value = made.default
            default = "required" if made.required else f"{value:g}" if isinstance(value, int | float) else f"as {value}"
            tolerance = "" if made.tolerance is None else f"{100 * made.tolerance:g} %"
            doc = made.doc + (f" (one per {made.size}, or one for all)" if made.size else "")
            rows.append([key, "any" if made.unit == "*" else made.unit, default, made.limits, tolerance, doc])
        parts += ["", columns(["parameter", "unit", "default", "bounds", "tolerance", "meaning"], rows)]
    if cls.options:
        rows = []
        for key, choice in cls.options.items():
            kinds = {int: "whole number", bool: "true or false", str: "text", list: "matrix"}
            allowed = " | ".join(choice.choices) or kinds[choice.kind]
            empty = choice.default in ("", ())
            shown = str(choice.default).lower() if choice.kind is bool else str(choice.default)
            default = "required" if choice.required else "none" if empty else shown
            doc = choice.doc + (f" (one per {choice.size}, or one for all)" if choice.size else "")
            rows.append([key, allowed, default, doc])
        parts += ["", columns(["option", "allowed", "default", "meaning"], rows)]
    rows = []
    for port in cls.ports.values():
        kind = f"{port.kind} flange" if port.role == "flange" else f"{port.role} signal"
        unit = "" if port.role == "flange" else "any" if port.unit == "*" else port.unit
        doc = port.doc + (f" ({port.default:g} if not connected)" if port.default is not None else "")
        rows.append([port.name, kind, unit, doc])
    parts += ["", columns(["connector", "kind", "unit", "meaning"], rows)]
    return "\n".join(parts)


def complex_number(value: complex) -> str:
    """A root: ``-7.917 + 24.785i``."""
    if abs(value.imag) < 1e-9 * max(1.0, abs(value)):
        return f"{value.real:.6g}"
    return f"{value.real:.6g} {'+' if value.imag > 0 else '-'} {abs(value.imag):.6g}i"


def linear_head(linear: LinearModel, name: str) -> str:
    """The first line: what was linearised, in which modes, and what was assumed."""
    modes = ", ".join(f"{mode} {label}" for mode, label in linear.modes.items())
    assumed = "; ".join(linear.assumed)
    return f"{name}, linearised{f' with {modes}' if modes else ''}{f'; assumed: {assumed}' if assumed else ''}"


def family_page(family: LinearFamily, name: str) -> str:
    """A family of linear models: what it spans, the modes that occur, and the poles."""
    count = Counter(", ".join(f"{k} {v}" for k, v in modes.items()) for modes in family.modes)
    assumed = "; ".join(family.assumed)
    shape = " x ".join(str(k) for k in family.shape)
    parts = [f"{name}, {shape} linear models{f'; assumed: {assumed}' if assumed else ''}"]
    rows = [
        [axis.name, axis.unit, f"{axis.values.min():.6g} ... {axis.values.max():.6g}", str(len(axis.values))]
        for axis in family.axes
        if not axis.labels
    ]
    if rows:
        parts.append(columns(["over", "unit", "from ... to", "values"], rows))
    if any(count):
        poles = {
            label: [family.kept(k).poles() for k, modes in enumerate(family.modes) if _modes(modes) == label]
            for label in count
        }
        spans = [[label, str(n), _rightmost(poles[label])] for label, n in count.items()]
        parts.append(columns(["linearised in", "members", "rightmost pole [1/s]"], spans))
    else:
        parts.append(f"  rightmost pole: {_rightmost([member.poles() for member in family])} 1/s")
    moving = sum(bool(member.moving) for member in family)
    if moving:
        parts.append(f"  {plural(moving, 'member')} of {len(family)} are at no equilibrium: dx0 holds their rates")
    parts.append(columns(["state", "unit"], [[state, family.units.get(state, "")] for state in family.states]))
    return "\n".join(parts)


def _modes(modes: Mapping[str, str]) -> str:
    return ", ".join(f"{k} {v}" for k, v in modes.items())


def _rightmost(poles: Sequence[Any]) -> str:
    every = [p for row in poles for p in without_rounding(row)]
    return complex_number(max(every, key=lambda p: p.real)) if every else "none"


def linear_page(linear: LinearModel) -> str:
    """Modes, states, poles and zeros of a linear model."""
    parts = []
    if linear.modes:
        parts.append(columns(["mode", "linearised as"], [[name, label] for name, label in linear.modes.items()]))
    moved = [[name, number(value), linear.units.get(name, "")] for name, value in linear.point.items() if value]
    if moved:
        parts.append(columns(["operating point", "value", "unit"], moved))
    if linear.rounded:
        parts.append("  roundings, as of an encoder, count as a gain of 1")
    if linear.moving:
        rows = [[name, number(rate), linear.units.get(name, "")] for name, rate in linear.moving.items()]
        parts.append("  not an equilibrium; give another point by --at, or keep in mind that these states change:")
        parts.append(columns(["state", "rate per second", "unit"], rows))
    parts.append(columns(["state", "unit"], [[name, linear.units.get(name, "")] for name in linear.states]))
    poles = linear.poles()
    parts.append("  poles [1/s]:  " + _roots(poles))
    for output in linear.outputs:
        for driven in linear.inputs:
            parts.append(f"  zeros of {output} / {driven} [1/s]:  {_roots(linear.zeros(output, driven), poles)}")
    return "\n".join(parts)


def reduction_page(made: Reduction, whole: LinearModel) -> str:
    """What a reduction keeps, and the bound on its error."""
    parts = [
        f"reduced from {len(whole.states)} to {len(made.model.states)} states; the gain of the difference is at most "
        f"{number(made.bound)} at any frequency"
    ]
    if made.kept:
        parts.append(
            f"  {plural(made.kept, 'state')} kept because it does not decay"
            if made.kept == 1
            else f"  {made.kept} states kept because they do not decay"
        )
    if len(made.hankel):
        parts.append("  Hankel singular values: " + ", ".join(number(float(v)) for v in made.hankel[:12]))
    parts.append("  poles [1/s]:  " + _roots(made.model.poles()))
    return "\n".join(parts)


def discrete_page(discrete: DiscreteModel) -> str:
    """Period, memories and poles of a discrete-time model."""
    memories = [[name, discrete.units.get(name, "")] for name in discrete.states if name not in discrete.continuous]
    parts = [f"in discrete time, every {number(discrete.dt)} s, with the memories of the sampled blocks"]
    if memories:
        parts.append(columns(["memory", "unit"], memories))
    if discrete.drift:
        rows = [[name, number(change), discrete.units.get(name, "")] for name, change in discrete.drift.items()]
        parts.append("  not an equilibrium of these memories:")
        parts.append(columns(["memory", "change per period", "unit"], rows))
    largest = max((abs(pole) for pole in discrete.poles()), default=0.0)
    parts.append(f"  poles [z]:  {_roots(discrete.poles())}  (largest magnitude {largest:.6g})")
    return "\n".join(parts)


def _roots(values: Any, beside: Any = ()) -> str:
    shown = []
    for value in without_rounding(values, beside):
        if value.imag < -1e-9 * max(1.0, abs(value)):
            continue
        if value.imag > 1e-9 * max(1.0, abs(value)):
            real = 0.0 if abs(value.real) < 1e-9 * abs(value) else value.real
            shown.append(f"{real:.6g} +- {value.imag:.6g}i" if real else f"+-{value.imag:.6g}i")
        else:
            shown.append(complex_number(value))
    return ";  ".join(shown) or "none"


def comparison_page(comparison: Comparison, rows: bool = False) -> str:
    """Errors per signal; with ``rows`` every row of a frequency-response table."""
    parts = [f"{comparison.scenario} against {comparison.recording}"]
    if comparison.bypassed:
        parts.append(f"  bypassed by the recorded input: {', '.join(comparison.bypassed)}")
    parts += [f"  {note}" for note in comparison.notes]
    if comparison.kind == "frequency_response":
        heads = ["signal", "rms [dB]", "largest [dB]", "rows"]
        table = [
            [e.name, f"{e.rms_db or 0.0:.3f}", f"{e.max_db or 0.0:.3f}", str(len(e.axis))]
            for e in comparison.signals.values()
        ]
    else:
        heads = ["signal", "rmse", "unit", "fit [%]"]
        table = [
            [e.name, number(e.rmse), e.unit, f"{e.nrmse:.3f}" if math.isfinite(e.nrmse) else "-"]
            for e in comparison.signals.values()
        ]
    parts.append(columns(heads, table))
    if rows and comparison.kind == "frequency_response":
        for error in comparison.signals.values():
            table = [
                [number(w), number(a), number(m), number(s), f"{20 * math.log10(s / m) if s > 0 else -math.inf:.3f}"]
                for w, a, m, s in zip(error.axis, error.amplitude, error.measured, error.simulated, strict=True)
            ]
            heads = [
                "rad/s",
                f"amplitude [{comparison.amplitude_unit}]",
                f"measured [{error.unit}]",
                f"simulated [{error.unit}]",
                "difference [dB]",
            ]
            parts.append(columns(heads, table))
    return "\n".join(parts)
