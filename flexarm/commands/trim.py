"""``flexarm trim SCENARIO``: an equilibrium."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.errors import FlexarmError, Where
from flexarm.console.options import (
    AnalysisOption,
    AtOption,
    InputsOption,
    ModeOption,
    OutputsOption,
    ScenarioArgument,
    SetOption,
    load,
    names,
    pairs,
    say_bypassed,
)

if TYPE_CHECKING:
    from engine.linearise import LinearModel
    from engine.trim import Equilibrium


def trim(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    inputs: InputsOption = None,
    outputs: OutputsOption = None,
    fix: Annotated[
        list[str] | None,
        typer.Option("--fix", metavar="NAME=VALUE", help="A motion, state, input or output that has this value."),
    ] = None,
    free: Annotated[
        list[str] | None, typer.Option("--free", metavar="INPUT", help="An input that is searched for; repeatable.")
    ] = None,
    bound: Annotated[
        list[str] | None,
        typer.Option("--bound", metavar="NAME=LOW:HIGH", help="Least and greatest value of a state or a free input."),
    ] = None,
    mode: ModeOption = None,
    at: AtOption = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write .json.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
) -> None:
    """Find an equilibrium: values of states and free inputs at which nothing changes, and the modes that hold there."""
    from engine.files import check_suffix, json_text, writing
    from engine.linearise import linearise
    from flexarm.api import trim as find
    from flexarm.cut import cut

    if output is not None:
        check_suffix(output, (".json",))
    loaded = load(scenario, overrides)
    made = cut(loaded, "trim", analysis, inputs=names(inputs), outputs=names(outputs))
    found = find(
        made,
        modes=pairs(mode, "--mode"),
        at=pairs(at, "--at"),
        fix=pairs(fix, "--fix"),
        free=names(free),
        bounds={name: _ends(text) for name, text in pairs(bound, "--bound").items()},
    )
    linear = linearise(made.model, **found.arguments())
    if as_json:
        typer.echo(json_text(_numbers(found, loaded.name), indent=2))
    else:
        say_bypassed(made.bypassed, ", ".join(made.settings.inputs))
        typer.echo(trim_page(found, loaded.name, linear))
    if output is not None:
        with writing(output, (".json",)) as temporary:
            temporary.write_text(json_text(_numbers(found, loaded.name), indent=1) + "\n")
        if not as_json:
            typer.echo(f"written: {output}")


def _ends(text: str) -> tuple[str, str]:
    low, colon, high = text.partition(":")
    if not colon:
        raise FlexarmError(f"'{text}' is no range", Where("--bound"), "write NAME=LOW:HIGH, such as 'x=-5 V:5 V'")
    from engine.quantity import split

    unit = split(high)[1]
    alone = not unit or split(low)[1]  # LOW may leave its unit to HIGH
    return (low if alone else f"{low} {unit}"), high


def _numbers(found: Equilibrium, name: str) -> dict[str, Any]:
    return {
        "name": name,
        "states": found.states,
        "inputs": found.inputs,
        "outputs": found.outputs,
        "units": found.units,
        "modes": found.modes,
        "turning": found.turning,
        "kept": found.kept,
        "others": list(found.others),
    }


def trim_page(found: Equilibrium, name: str, linear: LinearModel) -> str:
    """An equilibrium as text: modes, values, what was kept, what turns, other equilibria, and whether it is stable."""
    from flexarm.console.text import columns, number

    modes = ", ".join(f"{mode} {label}" for mode, label in found.modes.items())
    parts = [f"{name}, equilibrium{f' with {modes}' if modes else ''}"]
    rows = [
        [kind, key, number(value), found.units.get(key, "").strip("*"), _remark(found, key) if kind == "state" else ""]
        for kind, values in (("state", found.states), ("input", found.inputs), ("output", found.outputs))
        for key, value in values.items()
    ]
    parts.append(columns(["", "name", "value", "unit", ""], rows))
    if any(why == "indifferent" for why in found.kept.values()):
        parts.append("  indifferent: nothing depends on it, and it stays where the search began")
    # What nothing depends on gives a pole at zero, by rounding on either side.
    fast = [p for p in linear.poles() if p.real > 1e-7 * max(1.0, abs(linear.poles()).max())]
    parts.append(
        f"  unstable: a deviation grows at {number(max(p.real for p in fast))} 1/s"
        if fast
        else "  stable, or on the edge of it: no deviation grows"
    )
    for other in found.others:
        differs = [k for k, v in other.items() if abs(v - found.states[k]) > 1e-6 * (1 + abs(v))]
        values = ", ".join(f"{key} = {number(other[key])}" for key in differs[:4])
        parts.append(f"  another equilibrium: {values}; begin there (--at) for it")
    return "\n".join(parts)


def _remark(found: Equilibrium, name: str) -> str:
    from flexarm.console.text import number

    turns = f"moves at {number(found.turning[name])} per second" if name in found.turning else ""
    return ", ".join(part for part in (found.kept.get(name, ""), turns) if part)
