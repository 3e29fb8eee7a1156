"""What a picture is made of, and writing it: as SVG whose text stays text, or through matplotlib as PNG and PDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from engine.figures import save

FONT = "Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"

STYLES: dict[str, dict[str, str]] = {
    "frame": {"fill": "#f3f6f9", "stroke": "#8fa3b5", "stroke-dasharray": "5 3"},
    "box": {"fill": "#ffffff", "stroke": "#44525f", "stroke-width": "1.2"},
    "hot1": {"fill": "none", "stroke": "#c2410c", "stroke-width": "4"},
    "hot2": {"fill": "none", "stroke": "#ea8a4a", "stroke-width": "3"},
    "hot3": {"fill": "none", "stroke": "#f2bd94", "stroke-width": "2.5"},
    "flange": {"fill": "none", "stroke": "#44525f", "stroke-width": "2.4"},
    "signal": {"fill": "none", "stroke": "#1b6ca8", "stroke-width": "1.3"},
    "arrow": {"fill": "#1b6ca8", "stroke": "none"},
    "dot": {"fill": "#1b6ca8", "stroke": "none"},
    "knot": {"fill": "#44525f", "stroke": "none"},
    "port": {"fill": "#44525f", "stroke": "none"},
    "icon": {"fill": "none", "stroke": "#5b6b7a", "stroke-width": "1.4"},
    "rule": {"fill": "none", "stroke": "#d5dce3", "stroke-width": "1"},
    "icon-text": {"fill": "#5b6b7a", "font-weight": "bold"},
    "name": {"fill": "#17212b", "font-weight": "bold"},
    "type": {"fill": "#55636f"},
    "pin": {"fill": "#33404c"},
    "driven": {"fill": "#7a3e9d"},
    "measured": {"fill": "#1d7a4c"},
    "recorded": {"fill": "#55636f"},
    "odds": {"fill": "#a3360a", "font-weight": "bold"},
    "legend": {"fill": "#55636f"},
    "page": {"fill": "#ffffff", "stroke": "none"},
}
"""How each kind of shape looks; in SVG a style sheet around it may say otherwise through ``--fx-KIND-PROPERTY``."""

_NARROW, _WIDE = set("iljtfrI.,:;'|! ()[]-"), set("mwMW@%")


def text_width(text: str, size: float, bold: bool = False) -> float:
    """An upper estimate of the width of a text, true for the wider of the usual fonts."""
    widths = (
        0.42 if c in _NARROW else 0.98 if c in _WIDE else 0.72 if c.isupper() or ord(c) > 127 else 0.64 for c in text
    )
    return size * sum(widths) * (1.1 if bold else 1.0)


@dataclass(frozen=True)
class Box:
    """A rectangle with rounded corners."""

    kind: str
    x: float
    y: float
    width: float
    height: float
    radius: float = 3.0


@dataclass(frozen=True)
class Poly:
    """Straight pieces through points; closed shapes are filled."""

    kind: str
    points: tuple[tuple[float, float], ...]
    closed: bool = False


@dataclass(frozen=True)
class Disc:
    """A circle."""

    kind: str
    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class Label:
    """A text whose baseline begins (``start``), is centred (``middle``) or ends (``end``) at a point."""

    kind: str
    x: float
    y: float
    text: str
    size: float = 11.0
    anchor: str = "start"


@dataclass(frozen=True)
class Group:
    """Shapes that belong together, with what a pointer over them shows, and the block or net they stand for."""

    shapes: tuple[Shape, ...]
    title: str = ""
    about: str = ""


Shape = Box | Poly | Disc | Label | Group


@dataclass
class Picture:
    """Shapes from back to front, their size in pixels, and what they show, in a title and in words."""

    width: float
    height: float
    title: str
    words: str
    shapes: list[Shape] = field(default_factory=list)

    def svg(self, prefix: str = "fx") -> str:
        """As SVG text, with nothing that has to be fetched; ``prefix`` keeps its names apart on a page with others."""
        w, h = round(self.width), round(self.height)
        rules = "".join(_rule(prefix, kind, style) for kind, style in STYLES.items())
        body = "\n".join(_svg(shape, prefix) for shape in self.shapes)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="{prefix}-picture" viewBox="0 0 {w} {h}" width="{w}" '
            f'height="{h}" role="img" aria-labelledby="{prefix}-title {prefix}-words" font-family="{escape(FONT)}">\n'
            f'<title id="{prefix}-title">{_text(self.title)}</title>\n'
            f'<desc id="{prefix}-words">{_text(self.words)}</desc>\n<style>{rules}</style>\n'
            f'<rect class="{prefix}-page" width="{w}" height="{h}"/>\n{body}\n</svg>\n'
        )

    def draw(self, path: Path, dpi: float = 160.0) -> None:
        """Write as a .png or .pdf file."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        scale = min(1.0, 60 * 96 / max(self.width, self.height, 1.0))
        figure = Figure(figsize=(self.width / 96 * scale, self.height / 96 * scale), dpi=dpi)
        FigureCanvasAgg(figure)
        axis = figure.add_axes((0, 0, 1, 1))
        axis.set_xlim(0, self.width)
        axis.set_ylim(self.height, 0)
        axis.axis("off")
        for shape in self.shapes:
            _paint(axis, shape, scale)
        save(figure, path, dpi=dpi, facecolor="white")


def _rule(prefix: str, kind: str, style: dict[str, str]) -> str:
    parts = []
    for key, value in style.items():
        colour = value.startswith("#")
        parts.append(f"{key}:var(--{prefix}-{kind}-{key},{value})" if colour else f"{key}:{value}")
    return f".{prefix}-{kind}{{{';'.join(parts)}}}"


def _text(value: str) -> str:
    """Escaped, without the control characters that XML cannot hold."""
    return escape("".join(c for c in value if c >= " " and not "\ud800" <= c <= "\udfff" and c not in "\ufffe\uffff"))


def _svg(shape: Shape, prefix: str) -> str:
    if isinstance(shape, Group):
        about = f' data-about="{_text(shape.about)}"' if shape.about else ""
        title = f"<title>{_text(shape.title)}</title>" if shape.title else ""
        return f"<g{about}>{title}" + "".join(_svg(s, prefix) for s in shape.shapes) + "</g>"
    kind = f'class="{prefix}-{shape.kind}"'
    if isinstance(shape, Box):
        return (
            f'<rect {kind} x="{shape.x:.1f}" y="{shape.y:.1f}" width="{shape.width:.1f}" height="{shape.height:.1f}" '
            f'rx="{shape.radius:g}"/>'
        )
    if isinstance(shape, Disc):
        return f'<circle {kind} cx="{shape.x:.1f}" cy="{shape.y:.1f}" r="{shape.radius:g}"/>'
    if isinstance(shape, Label):
        anchor = f' text-anchor="{shape.anchor}"' if shape.anchor != "start" else ""
        where = f'x="{shape.x:.1f}" y="{shape.y:.1f}" font-size="{shape.size:g}"{anchor}'
        return f"<text {kind} {where}>{_text(shape.text)}</text>"
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in shape.points) + ("Z" if shape.closed else "")
    return f'<path {kind} d="{path}" stroke-linejoin="round"/>'


def _paint(axis: Any, shape: Shape, scale: float) -> None:
    from matplotlib.patches import Circle, FancyBboxPatch, Polygon

    if isinstance(shape, Group):
        for inner in shape.shapes:
            _paint(axis, inner, scale)
        return
    style = STYLES[shape.kind]
    points = 0.75 * scale
    if isinstance(shape, Label):
        axis.text(
            shape.x,
            shape.y,
            shape.text,
            fontsize=shape.size * points,
            color=style["fill"],
            weight=style.get("font-weight", "normal"),
            ha={"start": "left", "middle": "center", "end": "right"}[shape.anchor],
            va="baseline",
            parse_math=False,
        )
        return
    looks: dict[str, Any] = {
        "facecolor": style["fill"],
        "edgecolor": style["stroke"],
        "linewidth": float(style.get("stroke-width", "1")) * points,
        "linestyle": (0, (5, 3)) if "stroke-dasharray" in style else "-",
    }
    if isinstance(shape, Poly) and not shape.closed:
        axis.plot(
            *zip(*shape.points, strict=True), color=style["stroke"], lw=looks["linewidth"], solid_joinstyle="round"
        )
    elif isinstance(shape, Poly):
        axis.add_patch(Polygon(shape.points, closed=True, **looks))
    elif isinstance(shape, Disc):
        axis.add_patch(Circle((shape.x, shape.y), shape.radius, **looks))
    else:
        corner = f"round,pad=0,rounding_size={shape.radius}"
        axis.add_patch(FancyBboxPatch((shape.x, shape.y), shape.width, shape.height, boxstyle=corner, **looks))


def joined(shapes: Sequence[Shape]) -> str:
    """All texts of shapes, for tests and for readers that see no picture."""
    rows = []
    for shape in shapes:
        rows.append(
            joined(shape.shapes) if isinstance(shape, Group) else shape.text if isinstance(shape, Label) else ""
        )
    return " ".join(row for row in rows if row)
