"""``flexarm damping RECORDING``: damping ratios of a free decay."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.errors import FlexarmError, ParameterError, Where
from engine.files import folder_made, json_text

if TYPE_CHECKING:
    from diagnosis.decay.evolving_spectra import Waterfall
    from diagnosis.decay.log_decrement import Decrement
    from diagnosis.decay.report import DampingReport


def damping(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A .csv, .mat or .parquet file.")],
    column: Annotated[
        str | None, typer.Option("--column", "-c", metavar="NAME", help="The signal, if there are several.")
    ] = None,
    time: Annotated[
        str | None, typer.Option("--time", "-t", metavar="NAME", help="The time; 'time' or 't' by default.")
    ] = None,
    frequency: Annotated[
        list[str] | None,
        typer.Option("--frequency", "-f", metavar="F", help="Of a mode, in Hz; repeatable. Found if not given."),
    ] = None,
    window: Annotated[str | None, typer.Option(metavar="TIME", help="Length of a window, such as '0.4 s'.")] = None,
    hop: Annotated[str | None, typer.Option(metavar="TIME", help="From one window to the next.")] = None,
    windows: Annotated[int | None, typer.Option(metavar="N", help="How many; by default all that fit.")] = None,
    taper: Annotated[str, typer.Option(metavar="NAME", help="hann or rectangular.")] = "hann",
    start: Annotated[str | None, typer.Option(metavar="TIME", help="Begin of the free decay.")] = None,
    rest: Annotated[
        float | None, typer.Option(metavar="VALUE", help="Value about which it swings; found if not given.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Folder for figures and damping.json.")
    ] = None,
) -> None:
    """Estimate damping ratios from a free decay: evolving spectra and logarithmic decrement."""
    from diagnosis.decay.record import read_decay
    from diagnosis.decay.report import analyse_decay

    modes = [_quantity(text, "Hz", "--frequency") for text in frequency or []]
    span, step = _seconds(window, "--window"), _seconds(hop, "--hop")
    begin = _seconds(start, "--start", zero=True) or 0.0
    record = read_decay(recording, column, time)
    try:
        report = analyse_decay(
            record, modes, window=span, hop=step, windows=windows, taper=taper, start=begin, rest=rest
        )
    except FlexarmError as error:
        raise error.at(Where(str(recording))) from None
    if output is not None:
        folder_made(output)
    numbers = {"recording": str(recording), **report.numbers()}
    if not as_json:
        typer.echo(_page(report, recording))
    written = _write(output, report, recording, numbers) if output is not None else []
    if as_json:
        typer.echo(json_text(numbers, indent=2))
    else:
        for path in written:
            typer.echo(f"written: {path}")


def _quantity(text: str, unit: str, option: str) -> float:
    from engine.quantity import convert

    try:
        return convert(text, unit)
    except ParameterError as error:
        raise error.at(Where(option)) from None


def _seconds(text: str | None, option: str, *, zero: bool = False) -> float | None:
    if text is None:
        return None
    value = _quantity(text, "s", option)
    if value < 0 or (value == 0 and not zero):
        raise ParameterError(f"'{text}' is not a positive time", Where(option), f"write for example {option} '0.4 s'")
    return value


def _write(output: Path, report: DampingReport, recording: Path, numbers: dict[str, object]) -> list[Path]:
    from engine.files import writing
    from flexarm.plotting.decay import plot_decay, plot_decrement, plot_waterfall

    title = f"{recording.stem}: {report.record.name}"
    written = []
    if report.waterfall is not None:
        written.append(plot_waterfall(report.waterfall, output / "waterfall.png", title))
        written.append(plot_decay(report.waterfall, output / "decay.png", title))
    if report.decrement is not None:
        written.append(plot_decrement(report.record, report.decrement, output / "decrement.png", title))
    with writing(output / "damping.json", (".json",)) as temporary:
        temporary.write_text(json_text(numbers, indent=2) + "\n", encoding="utf-8")
    return [*written, output / "damping.json"]


def _page(report: DampingReport, recording: Path) -> str:
    from flexarm.console.text import number

    record = report.record
    unit = f" [{record.unit}]" if record.unit else ""
    parts = [
        f"{recording.name}: {record.name}{unit}, {len(record.values)} samples, {number(record.step)} s apart, "
        f"{number(record.length)} s"
    ]
    parts += [f"  {note}" for note in report.notes]
    if report.waterfall is not None:
        parts.append(_waterfall_page(report.waterfall))
    if report.decrement is not None:
        parts.append(_decrement_page(report.decrement))
    return "\n".join(parts)


def _waterfall_page(waterfall: Waterfall) -> str:
    from flexarm.console.text import columns, number

    rows = [
        [
            number(mode.frequency),
            f"{mode.ratio:.5g}",
            f"{mode.standard_error:.2g}",
            f"{mode.interval[0]:.4g} to {mode.interval[1]:.4g}",
            f"{mode.two_point:.5g}",
            str(mode.used),
            (mode.envelopes.verdict if mode.envelopes is not None else "") if mode.reliable else "unreliable",
        ]
        for mode in waterfall.modes
    ]
    heads = ["mode [Hz]", "damping ratio", "std. error", "95 %", "two-point", "windows", "decay"]
    return (
        f"evolving spectra: {len(waterfall.times)} windows of {number(waterfall.window)} s, {waterfall.taper}, "
        f"{number(waterfall.hop)} s apart\n" + columns(heads, rows)
    )


def _decrement_page(found: Decrement) -> str:
    from flexarm.console.text import columns, number

    rows = [
        [
            number(found.natural_frequency),
            f"{found.ratio:.5g}",
            f"{found.standard_error:.2g}",
            f"{found.interval[0]:.4g} to {found.interval[1]:.4g}",
            f"{found.two_point:.5g}",
            str(len(found.peaks)),
        ]
    ]
    page = f"logarithmic decrement: delta = {found.delta:.5g}, rest = {number(found.rest)}\n" + columns(
        ["mode [Hz]", "damping ratio", "std. error", "95 %", "two-point", "peaks"], rows
    )
    laws = found.envelopes
    if laws is None:
        return page
    fits = [[fit.law, f"{100 * fit.rms / float(found.extremes[0]):.3g}"] for fit in laws.fits]
    return f"{page}\n{columns(['envelope', 'residual [% of first amplitude]'], fits)}\n  {laws.sentence}"
