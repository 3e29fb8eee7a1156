"""``flexarm describe SCENARIO``: frequency responses by amplitude."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.errors import FlexarmError, Where
from flexarm.console.options import (
    AnalysisOption,
    InputsOption,
    OutputsOption,
    ScenarioArgument,
    SetOption,
    load,
    names,
    picture,
    say_bypassed,
)

if TYPE_CHECKING:
    from flexarm.design.describing import Description

KINDS = (".csv", ".json", ".mat")


def describe(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    inputs: InputsOption = None,
    outputs: OutputsOption = None,
    amplitude: Annotated[
        list[str] | None,
        typer.Option("--amplitudes", metavar="A,B,...", help="Of the sine, such as '0.5 V,2 V', or START:STOP:N."),
    ] = None,
    frequencies: Annotated[
        str | None, typer.Option(metavar="START:STOP:N:log", help="Such as '0.1 Hz:10 Hz:20:log', or A,B,C.")
    ] = None,
    harmonics: Annotated[int | None, typer.Option(min=1, max=50, help="Highest that is given; 5 by default.")] = None,
    recording: Annotated[
        str | None,
        typer.Option(metavar="TABLE", help="A frequency-response table of the scenario, for what is not given."),
    ] = None,
    output: Annotated[
        list[Path] | None, typer.Option("--output", "-o", metavar="FILE", help="Write .csv, .json or .mat; repeatable.")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="[PNG]", help="Draw the curves; NAME-describe.png without a file name."),
    ] = None,
) -> None:
    """Drive the nonlinear model by sines of several amplitudes: describing functions, and linear models beside them."""
    from engine.files import check_suffix
    from flexarm.api import describe as run
    from flexarm.console.progress import Progress
    from flexarm.cut import cut

    for path in output or []:
        check_suffix(path, KINDS)
    loaded = load(scenario, overrides)
    plot = picture(plot, loaded, "-describe")
    table = _table(loaded, recording) if recording is not None else None
    free, seen = names(inputs), names(outputs)
    if table is not None:
        free, seen = free or [table.drive], seen or [channel.name for channel in table.responses]
    made = cut(loaded, "describe", analysis, inputs=free, outputs=seen)
    with Progress(f"{loaded.name}: sines") as bar:
        found = run(
            made,
            amplitudes=_listed(amplitude) or (sorted({float(v) for v in table.amplitude}) if table else None),
            frequencies=frequencies or (sorted({float(v) for v in table.frequency}) if table else None),
            harmonics=harmonics,
            progress=bar.update,
        )
    typer.echo(f"{loaded.name}, answers to sines on {found.input}")
    say_bypassed(made.bypassed, found.input)
    typer.echo(describe_page(found))
    for path in output or []:
        _write(path, found)
        typer.echo(f"written: {path}")
    if plot is not None:
        from flexarm.plotting.describing import plot_description

        title = f"{loaded.name}, answers to sines"
        typer.echo(f"written: {plot_description(found, plot, title, _points(table, found) if table else None)}")


def _table(loaded: Any, name: str) -> Any:
    from diagnosis.binding import find_recording
    from diagnosis.recordings.types import FrequencyTable

    found = find_recording(loaded, name)
    if not isinstance(found, FrequencyTable):
        raise FlexarmError(f"'{name}' is a recording over time", remedy="give a frequency-response table")
    return found


def _points(table: Any, found: Description) -> dict[str, Any]:
    """Measured gains (dB) by output."""
    import numpy as np

    from engine.quantity import factor

    rows = {}
    for channel in table.responses:
        values = channel.values * factor(channel.unit, found.units[channel.name])
        rows[channel.name] = (table.frequency, 20 * np.log10(values / table.amplitude))
    return rows


def _listed(given: list[str] | None) -> list[str] | None:
    from flexarm.sweeps.plan import texts_of

    try:
        return None if given is None else [one for text in given for one in texts_of(text)]
    except FlexarmError as error:
        raise error.at(Where("--amplitudes")) from None


def describe_page(found: Description) -> str:
    """A row for each amplitude and frequency: gain, phase and share of higher harmonics of each output."""
    import numpy as np

    from flexarm.console.text import columns, number

    rows = []
    for i, amplitude in enumerate(found.amplitude):
        for k, frequency in enumerate(found.frequency):
            for m, output in enumerate(found.outputs):
                gain = found.gain[i, k, m]
                rows.append(
                    [
                        number(amplitude),
                        number(frequency),
                        output,
                        number(abs(gain)),
                        f"{np.degrees(np.angle(gain)):.2f}",
                        f"{100 * found.distortion[i, k, m]:.2f}",
                        "" if found.settled[i, k] else "not periodic",
                    ]
                )
    unit = found.units.get(found.input, "").replace("*", "")
    heads = [
        f"amplitude{f' [{unit}]' if unit else ''}",
        "[rad/s]",
        "output",
        "gain",
        "phase [deg]",
        "harmonics [%]",
        "",
    ]
    return columns(heads, rows)


def _write(path: Path, found: Description) -> None:
    import csv

    import numpy as np

    from engine.files import json_text, writing

    plain = {
        "input": found.input,
        "outputs": list(found.outputs),
        "units": found.units,
        "amplitude": found.amplitude,
        "frequency": found.frequency,
        "real": found.harmonics.real,
        "imaginary": found.harmonics.imag,
        "mean": found.mean,
        "half_range": found.half_range,
        "settled": found.settled,
    }
    with writing(path, KINDS) as temporary:
        if path.suffix.lower() == ".json":
            made = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in plain.items()}
            temporary.write_text(json_text(made, indent=1) + "\n")
        elif path.suffix.lower() == ".mat":
            from scipy.io import savemat

            kept = {k: v for k, v in plain.items() if k != "units"}
            savemat(temporary, kept | {"outputs": np.array(found.outputs, dtype=object)}, long_field_names=True)
        else:
            with temporary.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file, lineterminator="\n")
                unit = found.units.get(found.input, "").replace("*", "")
                heads = [f"{o} {part}" for o in found.outputs for part in ("gain", "phase [deg]", "half range")]
                writer.writerow([f"amplitude [{unit}]", "frequency [rad/s]", *heads])
                for i, amplitude in enumerate(found.amplitude):
                    for k, frequency in enumerate(found.frequency):
                        cells: list[float] = []
                        for m in range(len(found.outputs)):
                            gain = complex(found.gain[i, k, m])
                            angle = float(np.degrees(np.angle(gain)))
                            cells += [abs(gain), angle, float(found.half_range[i, k, m])]
                        writer.writerow([float(amplitude), float(frequency), *cells])
