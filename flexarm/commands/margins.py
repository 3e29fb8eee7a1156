"""``flexarm margins SCENARIO``: margins of a loop."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexarm.console.options import (
    AnalysisOption,
    AtOption,
    ModeOption,
    ScenarioArgument,
    SetOption,
    TrimOption,
    load,
    pairs,
    picture,
    seconds,
)

if TYPE_CHECKING:
    from flexarm.design.margins import LoopMargins


def margins(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    loop: Annotated[
        str | None, typer.Option("--loop", metavar="INPUT", help="Where the loop is opened, such as motor.voltage.")
    ] = None,
    returns: Annotated[
        str | None, typer.Option(metavar="SIGNAL", help="What comes back; what feeds the input by default.")
    ] = None,
    grid: Annotated[
        list[str] | None,
        typer.Option("--grid", metavar="NAME=START:STOP:N", help="A family, as of 'flexarm linearise'; repeatable."),
    ] = None,
    delay: Annotated[str | None, typer.Option(metavar="TIME", help="Of the computation, put into the loop.")] = None,
    mode: ModeOption = None,
    at: AtOption = None,
    trim: TrimOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="[PNG]", help="Draw loop, sensitivity and step; NAME-margins.png by default."),
    ] = None,
) -> None:
    """Gain, phase, delay and disk margins of a loop, over a family if there is a grid."""
    from engine.files import json_text
    from flexarm.design.margins import loop_cut
    from flexarm.design.margins import margins as run

    loaded = load(scenario, overrides)
    plot = picture(plot, loaded, "-margins")
    made = loop_cut(loaded, analysis, loop, returns)
    found = run(
        made,
        grid=pairs(grid, "--grid") if grid else None,
        delay=seconds(delay, "--delay") or 0.0,
        modes=pairs(mode, "--mode"),
        at=pairs(at, "--at"),
        trim=trim,
    )
    if as_json:
        typer.echo(json_text(_numbers(found, loaded.name), indent=2))
    else:
        typer.echo(margins_page(found, loaded.name))
    if plot is not None:
        from flexarm.plotting.margins import plot_margins

        written = plot_margins(found, plot, f"{loaded.name}, loop opened at {found.input}")
        if not as_json:
            typer.echo(f"written: {written}")


def _numbers(found: LoopMargins, name: str) -> dict[str, Any]:
    from dataclasses import asdict

    rows = [asdict(m) for m in found.members]
    for row in rows:
        row["gain"] = list(row["gain"])
    plain = [{k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()} for row in rows]
    for row in plain:
        row["gain"] = [None if not math.isfinite(v) else v for v in row["gain"]]
    return {"name": name, "loop": found.input, "returns": found.returns, "worst": found.worst, "members": plain}


def margins_page(found: LoopMargins, name: str) -> str:
    """Margins as text; of a family the worst and the best of each."""
    from flexarm.console.text import columns, number

    assumed = f"; assumed: {'; '.join(found.assumed)}" if found.assumed else ""
    parts = [f"{name}, loop opened at {found.input}, where {found.returns} comes back{assumed}"]
    worst = found.members[found.worst]
    unstable = sum(not m.stable for m in found.members)
    many = len(found.members) > 1
    if many:
        where = ""
        if found.family is not None:
            import numpy as np

            place = np.unravel_index(found.worst, found.family.shape)
            axes = zip(found.family.axes, place, strict=True)
            where = ", at " + ", ".join(f"{a.name} = {number(float(a.values[k]))} {a.unit}".strip() for a, k in axes)
        parts.append(
            f"  {len(found.members)} loops, {unstable} of them unstable; the worst is number {found.worst}{where}"
        )
    elif unstable:
        parts.append("  the closed loop is unstable")

    def row(label: str, unit: str, get: Any) -> list[str]:
        values = [get(m) for m in found.members]
        best = [v for v in values if math.isfinite(v)]
        cells = [label, number(get(worst)), unit]
        return [*cells, f"{number(min(best))} ... {number(max(best))}" if best else "-"] if many else cells

    rows = [
        row("gain margin, upwards", _decibels(worst.gain[1]), lambda m: m.gain[1]),
        row("gain margin, downwards", _decibels(worst.gain[0]), lambda m: m.gain[0]),
        row("phase margin", "deg", lambda m: m.phase),
        row("delay margin", "s", lambda m: m.delay),
        row("crossover", "rad/s", lambda m: m.crossover),
        row("disk margin", "", lambda m: m.disk),
        row("peak of the sensitivity", "", lambda m: m.sensitivity),
        row("peak of the complementary one", "", lambda m: m.complementary),
    ]
    parts.append(columns(["", "worst" if many else "value", "unit", *(["all"] if many else [])], rows))
    return "\n".join(parts)


def _decibels(gain: float) -> str:
    """A gain in dB, beside the factor; nothing where the loop takes any gain."""
    return f"({20 * math.log10(gain):.1f} dB)" if 0 < gain < math.inf else ""
