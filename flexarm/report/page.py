"""Putting a page together: one HTML file that holds its style, its script and its data, and fetches nothing."""

from __future__ import annotations

import base64
import difflib
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnosis.estimation.least_squares import interval_in_words
from engine.files import writing
from engine.names import CONTROL
from flexarm.plotting.wiring.places import share
from flexarm.report.series import Chart, as_json, fitting

HTML = (".html", ".htm")
FOLDER = Path(__file__).parent


def render(template: str, charts: Sequence[Chart], **values: Any) -> str:
    """A page from its template; every value is escaped.

    Args:
        template: name of a file in ``templates``.
        charts: what is plotted; the template places each by its key.
        values: what the template shows.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(FOLDER / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_printable,
    )
    environment.filters["sig"] = significant
    environment.filters["interval"] = interval
    environment.filters["share"] = share
    environment.filters["plainunit"] = plain_unit
    script = (FOLDER / "report.js").read_text(encoding="utf-8")
    made = fitting(charts)
    return environment.get_template(template).render(
        style=Markup((FOLDER / "report.css").read_text(encoding="utf-8")),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        data=Markup(as_json(made)),
        charts={chart.key: chart for chart in made},
        **values,
    )


def _printable(value: Any) -> Any:
    """Control characters of a text, which a file's name or a command line may hold, as escapes."""
    if type(value) is not str:
        return value
    return CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), value)


def write_page(path: Path, text: str) -> Path:
    """Write a page, whole or not at all.

    Raises:
        FlexarmError: another suffix than .html, or the file cannot be written.
    """
    with writing(path, HTML) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
    return path


def view_of(text: str, chart: Chart) -> str:
    """The view of a chart that shows the recording which a sentence names; empty if it names none that is shown."""
    names = {name: name.rpartition(" (")[0] if name.endswith(")") else name for name, _ in chart.views}
    found = [view for view, recording in names.items() if f"recording '{recording}'" in text]
    return found[0] if found else ""


def significant(value: float, digits: int = 4) -> str:
    """A number in a few digits, with a true minus sign."""
    return _typeset(f"{value:.{digits}g}")


def interval(row: Mapping[str, Any]) -> str:
    """An interval in words, with true minus signs."""
    return _typeset(interval_in_words(row))


def _typeset(text: str) -> str:
    return text.replace("-", "−").replace("e−0", "e−").replace("e+0", "e+")


def plain_unit(unit: str) -> str:
    """A unit as it is read: nothing for a pure number."""
    return "" if unit in ("1", "*") else unit.replace(".", "·")


@dataclass(frozen=True)
class Row:
    """A line of a comparison: ``same``, ``added``, ``removed`` or ``hunk``, with its sign and text."""

    kind: str
    sign: str
    text: str


def difference(before: str, after: str) -> list[Row]:
    """What changed from one text to another, with three lines of context."""
    rows = []
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=3)
    for line in list(lines)[2:]:
        sign, text = line[:1], line[1:]
        kind = {"+": "added", "-": "removed", "@": "hunk"}.get(sign, "same")
        rows.append(Row(kind, "" if kind == "hunk" else sign.replace("-", "−"), line if kind == "hunk" else text))
    return rows
