"""Figures as files, whatever the names in them say."""

from __future__ import annotations

from contextvars import ContextVar
from pathlib import Path
from typing import Any

origin: ContextVar[str] = ContextVar("origin", default="")
"""What a figure is of, as a short ASCII text; PNG files carry it, so that nobody takes one for another's."""

DPI = 130.0
"""Dots per inch of a picture: sharp on a screen, and small enough for a page of many."""


def save(figure: Any, path: Path, dpi: float = DPI, **how: Any) -> None:
    """Write a Matplotlib figure whose texts are texts: a dollar sign in a name begins no formula.

    Tick labels are Matplotlib's own, and may be formulas.
    """
    from matplotlib.text import Text

    own: set[int] = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            own.add(id(axis.get_offset_text()))
            own |= {id(label) for label in axis.get_ticklabels(which="both")}
    for text in figure.findobj(Text):
        if id(text) not in own:
            text.set_parse_math(False)
    if origin.get() and path.suffix.lower() == ".png":
        how["metadata"] = {"Source": origin.get()}
    figure.savefig(path, dpi=dpi, **how)


def is_of(path: Path, what: str) -> bool:
    """Whether a PNG file carries this origin; its text chunks are not compressed."""
    return b"tEXtSource\0" + what.encode("ascii") in path.read_bytes()
