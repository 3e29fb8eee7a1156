"""documentation/index.html: variables and behaviour of the FMU, written from the model."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence

from fmu.plan import Plan
from fmu.variables import COORDINATE, INDICATOR, INPUT, MODE, OUTPUT, PARAMETER, RESULT, STATE, FmuVariable

_STYLE = (
    "body{font-family:sans-serif;max-width:60em;margin:2em auto;padding:0 1em;line-height:1.4}"
    "table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #bbb;padding:.2em .6em;text-align:left}"
    "th{background:#eee}code{background:#f4f4f4}"
)

_DERIVATIVES = (
    "<h2>Derivatives</h2>",
    "<p>Directional derivatives are exact, of outputs and state derivatives by states and inputs, with modes and "
    "sampled memories held.</p>",
    "<h2>Rebuild</h2>",
)
_PYTHON = (
    "<h2>What it needs</h2>",
    "<p>The model holds Python functions and runs in Python. Each instance starts a Python process of its own, which "
    "ends with it; nothing of Python is loaded into the importer. That Python must have the version of flexarm that "
    "made this FMU. It is the one that the environment variable <code>FLEXARM_PYTHON</code> names; if that is not set, "
    "the one that exported, or else <code>python3</code> on the PATH (<code>python.exe</code> on Windows). If none "
    "will do, the log says which were tried. Co-Simulation only; a step costs a hundred times that of compiled C.</p>",
    "<p>What the Python functions print comes as log messages of the category <code>logPython</code>. If the process "
    "ends by itself, the call is an error with its last words; resetting the instance starts another process.</p>",
)

_INDICATORS = (
    "<h2>Event indicators</h2>\n"
    "<p>For Model Exchange, two for each mode and in this order; positive while the mode holds.</p>"
)
_EVENTS = (
    "<h2>Event mode</h2>",
    "<p>Co-Simulation has event mode, and steps return early where that is allowed: before switches, knots of tables, "
    "edges of sources and ticks of clocks. Values before event mode are limits from the left. The clocks "
    "<code>sample_clock_1</code> and so on tick by themselves.</p>",
)
_SLOPES = ", or follow the slope given by fmi2SetRealInputDerivatives for one step"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    top = "".join(f"<th>{html.escape(head)}</th>" for head in heads)
    body = "\n".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>\n<tr>{top}</tr>\n{body}\n</table>" if body else "<p>None.</p>"


def _bounds(variable: FmuVariable) -> str:
    low, high = variable.minimum, variable.maximum
    if math.isinf(low) and math.isinf(high):
        return ""
    return f"{low:g} to {high:g}"


def _integration(plan: Plan) -> str:
    grid = f"on a grid of {plan.step:g} s, aligned at the start time;"
    if plan.variable_step is not None:
        return (
            f"Runge-Kutta of order 4 {grid} inside a cell with a variable step: the estimated error of a step stays "
            f"below the importer's relative tolerance, or {plan.variable_step:g} if it gives none, times magnitude "
            "plus nominal value of every state."
        )
    return (
        f"Fixed-step Runge-Kutta of order 4 {grid} each cell is divided into steps of at most {plan.hmax:.6g} s, "
        "chosen for the parameters when initialization ends and kept when parameters are tuned."
    )


def _relations(plan: Plan) -> str:
    names = {v.source: v.name for v in plan.variables if v.kind == PARAMETER}
    parameters = plan.model.parameters
    said = [
        f"{names[parameters[first].name]} {relation.words} {names[parameters[second].name]}"
        for first, relation, second in plan.model.relations
    ]
    if not said:
        return ""
    return (
        "<p>Set against one another, parameters are refused when they begin to count: at the end of initialization, or "
        f"at the next step, event or value asked for, if {html.escape('; or '.join(said))}.</p>"
    )


def page(plan: Plan, platforms: Sequence[str], version: int = 2, python: bool = False) -> str:
    """The page for an export; ``python`` for one that runs in Python."""

    def of(kind: str) -> list[FmuVariable]:
        return [variable for variable in plan.variables if variable.kind == kind]

    model = plan.model
    clocks = [f"{clock.period:g} s, first at {clock.offset:g} s" for clock in model.clocks]
    signals = ("name", "in the scenario", "unit", "meaning")
    further = ("<h2>Further signals</h2>", _table(signals, [(v.name, v.source, v.unit, v.doc) for v in of(RESULT)]))
    parts = [
        f"<h1>{html.escape(model.name or plan.identifier)}</h1>",
        f"<p>{html.escape(model.description)}</p>" if model.description else "",
        f"<p>Made by {html.escape(plan.tool)} for {', '.join(platforms)}.</p>",
        "<h2>Inputs</h2>",
        _table(signals, [(v.name, v.source, v.unit, v.doc) for v in of(INPUT)]),
        "<h2>Outputs</h2>",
        _table(signals, [(v.name, v.source, v.unit, v.doc) for v in of(OUTPUT)]),
        *(further if plan.results else ()),
        "<h2>Parameters</h2>",
        "<p>Values are in SI units. A value out of range is refused and the old one kept. Fixed parameters act on the "
        "start only.</p>",
        _table(
            ("name", "start", "unit", "range", "can be tuned", "meaning"),
            [
                (v.name, f"{v.start:.9g}", v.unit, _bounds(v), "yes" if v.tunable else "before the start", v.doc)
                for v in of(PARAMETER)
            ],
        ),
        _relations(plan),
        "<h2>States</h2>",
        "<p>A state with a start can be set before the run; stuck joints, gaps and contacts follow. Where a twist is "
        "the state in place of an angle, or its rate in place of a speed, the start is that of the angle or speed.</p>",
        _table(
            ("name", "start", "nominal", "unit", "meaning"),
            [
                (
                    v.name,
                    "" if v.start is None else f"{v.start:.9g}",
                    "" if v.kind == COORDINATE else f"{v.nominal or 1:.3g}",
                    v.unit,
                    v.doc,
                )
                for v in of(STATE) + of(COORDINATE)
            ],
        ),
        "<h2>Modes</h2>",
        _table(("name", "meaning"), [(v.name, v.doc) for v in of(MODE)]),
        *([] if python else [_INDICATORS, _table(("name", "meaning"), [(v.name, v.doc) for v in of(INDICATOR)])]),
        "<h2>Time</h2>",
        f"<p>{_integration(plan)} Switches (stick-slip, contacts, limits) are located inside a step. Communication "
        "points may lie anywhere; on the grid, the result does not depend on how the time is divided. Inputs hold "
        f"between communication points{_SLOPES if version == 2 and not python else ''}.</p>",
        f"<p>Sample clocks: {html.escape('; '.join(clocks)) or 'none'}. A clock that is due at a communication point "
        "uses the inputs set there: set inputs first, then read outputs.</p>",
        *(_EVENTS if version == 3 else ()),
        *(_PYTHON if python else _DERIVATIVES),
        ""
        if python
        else f"<p><code>gcc -O2 -ffp-contract=off -shared -fPIC sources/all.c -lm -o {plan.identifier}.so</code></p>",
    ]
    body = "\n".join(part for part in parts if part)
    title = html.escape(model.name or plan.identifier)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )
