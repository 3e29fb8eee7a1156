"""Arguments and options that commands share, and how their texts are read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.errors import FlexarmError, ParameterError, Where
from flexarm.console import completion

if TYPE_CHECKING:
    from scenarios.load import Scenario

ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A scenario file, or the name of a shipped scenario.",
        autocompletion=completion.scenarios,
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        "-s",
        metavar="KEY=VALUE",
        help="Change a value, such as gear.ratio=14; repeatable.",
        autocompletion=completion.keys,
    ),
]
AnalysisOption = Annotated[
    str | None, typer.Option("--analysis", "-a", metavar="NAME", help="An analysis of the file; the first by default.")
]
InputsOption = Annotated[
    list[str] | None,
    typer.Option("--inputs", "-u", metavar="NAME", help="Inputs in place of the file's; repeatable, or with commas."),
]
OutputsOption = Annotated[
    list[str] | None,
    typer.Option("--outputs", "-y", metavar="NAME", help="Outputs in place of the file's; repeatable, or with commas."),
]
ModeOption = Annotated[
    list[str] | None,
    typer.Option("--mode", metavar="NAME=VALUE", help="State of a friction or contact: its label, or -1, 0, 1."),
]
AtOption = Annotated[
    list[str] | None,
    typer.Option("--at", metavar="NAME=VALUE", help="Operating point, such as 'link.hub.angle=10 deg'; repeatable."),
]
TrimOption = Annotated[
    str | None,
    typer.Option(
        "--trim",
        metavar="NAME",
        help="Linearise at the equilibrium of this analysis of kind trim; 'auto': the nearest to the point.",
    ),
]
RecordingsArgument = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[RECORDING]...", help="Recordings of the scenario, by name, or files; all it describes by default."
    ),
]
HoldOutOption = Annotated[
    list[str] | None,
    typer.Option("--hold-out", metavar="RECORDING", help="A recording to judge on, not to fit; repeatable."),
]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Threads; as many as cores if not given.")]
SeedOption = Annotated[int, typer.Option(help="Of everything random.")]

AUTOMATIC = ":automatic:"
"""Stands for ``--plot`` without a file name."""


def seconds(text: str | None, option: str) -> float | None:
    """A positive time given with its unit.

    Raises:
        ParameterError: it is none.
    """
    if text is None:
        return None
    from engine.quantity import convert

    try:
        number = convert(text, "s")
    except ParameterError as error:
        raise error.at(Where(option)) from None
    if number <= 0:
        raise ParameterError(f"'{text}' is not a positive time", Where(option), f"write for example {option} '10 s'")
    return number


def pairs(given: list[str] | None, option: str) -> dict[str, str]:
    """NAME=VALUE texts as a mapping.

    Raises:
        FlexarmError: a text without an equals sign, or a name twice.
    """
    found: dict[str, str] = {}
    for text in given or []:
        name, equals, value = text.partition("=")
        if not equals:
            raise FlexarmError(f"'{text}' sets nothing", Where(option), "write NAME=VALUE")
        if name.strip() in found:
            raise FlexarmError(f"'{name.strip()}' is given twice", Where(option), "give it once, with all it takes")
        found[name.strip()] = value.strip()
    return found


def names(given: list[str] | None) -> list[str] | None:
    """Names given one by one or with commas."""
    if given is None:
        return None
    return [name.strip() for text in given for name in text.split(",") if name.strip()]


def load(scenario: str, overrides: list[str] | None) -> Scenario:
    """The scenario of a file or shipped name, with its overrides."""
    from scenarios.load import load as read

    return read(scenario, overrides or ())


def file_name(scenario: Scenario) -> str:
    """The scenario's name without what a file name cannot hold, which is at most 255 bytes with its ending."""
    plain = "".join(c if c.isalnum() or c in "-_. " else "_" for c in scenario.name)
    return plain.encode()[:200].decode(errors="ignore").strip(". ") or "scenario"


def picture(plot: Path | None, scenario: Scenario, ending: str = "") -> Path | None:
    """The file of ``--plot``: the one named, else NAME.png, or NAME-2.png and so on beside another file's picture.

    Raises:
        FlexarmError: it is of no kind that can be written, or has no folder.
    """
    import hashlib
    import itertools

    from engine import figures
    from engine.files import check_suffix
    from flexarm.plotting.results import FIGURES

    if plot is None:
        return None
    what = f"flexarm {hashlib.sha256(str(scenario.path.resolve()).encode()).hexdigest()[:32]}"
    figures.origin.set(what)
    if str(plot) == AUTOMATIC:
        stem = f"{file_name(scenario)}{ending}"
        free = (Path(f"{stem}{'' if k == 1 else f'-{k}'}.png") for k in itertools.count(1))
        plot = next(path for path in free if not path.is_file() or figures.is_of(path, what))
    check_suffix(plot, FIGURES)
    return plot


def say_bypassed(blocks: tuple[str, ...], by: str) -> None:
    """Tell which blocks a freed input replaces."""
    if blocks:
        typer.echo(f"bypassed by {by}: {', '.join(blocks)}")
