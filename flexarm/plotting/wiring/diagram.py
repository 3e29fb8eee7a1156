"""The block diagram of a scenario: blocks as boxes, flanges as lines, signals as arrows, sub-assemblies as frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from engine.files import writing
from flexarm.plotting.wiring.graph import DRIVEN, FLANGE, MEASURED, RECORDED, End, Graph, Net, graph
from flexarm.plotting.wiring.icons import SIZE, icon
from flexarm.plotting.wiring.layout import Item, Link, Placed, arrange
from flexarm.plotting.wiring.places import Lit, lit, share
from flexarm.plotting.wiring.shapes import Box, Disc, Group, Label, Picture, Poly, Shape, text_width

if TYPE_CHECKING:
    from scenarios.load import Scenario

PICTURES = (".svg", ".png", ".pdf")
HEAD, ROW, PAD = 40.0, 17.0, 8.0
EDGE = 16.0
"""Between the picture's edge and what is drawn."""
MOST_MARKS = 4
SIGNS = {DRIVEN: "▶", MEASURED: "●", RECORDED: "○"}
WORDS = {DRIVEN: "driven by a recording", MEASURED: "measured", RECORDED: "recorded by run"}


def diagram(scenario: Scenario, highlight: Mapping[str, float] | None = None) -> Picture:
    """Draw a scenario's wiring.

    Args:
        scenario: what to draw.
        highlight: place -> odds (0 to 1) of the places to light up: a block, ``block.port``, ``block.parameter``, or a
            connection such as ``a.out -> b.in``. Places that the scenario does not have are left out.
    """
    made = graph(scenario)
    return _Drawing(made, lit(made, highlight or {})).picture()


def write(picture: Picture, path: Path) -> Path:
    """Write a picture as .svg, .png or .pdf.

    Raises:
        FlexarmError: another suffix, or the file cannot be written.
    """
    with writing(path, PICTURES) as temporary:
        if path.suffix.lower() == ".svg":
            temporary.write_text(picture.svg(), encoding="utf-8")
        else:
            picture.draw(temporary)
    return path


@dataclass
class _Level:
    """The picture's ground, or one frame: its children laid out, and where its nets cross its edge."""

    key: str
    placed: Placed
    items: dict[str, Item]
    nets: dict[str, Net]
    inner: dict[str, _Level] = field(default_factory=dict)


class _Drawing:
    def __init__(self, made: Graph, marked: Lit) -> None:
        self.graph, self.lit = made, marked
        self.nets = {f"net{i}": net for i, net in enumerate(made.nets)}
        self.frames: list[Shape] = []
        self.lines: list[Shape] = []
        self.boxes: list[Shape] = []

    def picture(self) -> Picture:
        level = self.level("")
        legend = self.legend()
        width = max(level.placed.width, sum(w for _, _, w in legend)) + 2 * EDGE
        height = level.placed.height + 2 * EDGE + (26 if legend else 0)
        self.paint(level, EDGE, EDGE)
        x = EDGE
        for kind, text, wide in legend:
            self.boxes.append(Label(kind, x, height - 10, text, 10.5))
            x += wide
        return Picture(
            width, height, f"Block diagram of {self.graph.name}", self.words(), self.frames + self.lines + self.boxes
        )

    # -- levels --------------------------------------------------------------------------------------------------------

    def child(self, prefix: str, block: str) -> str:
        """The child of a level in which a block lies: the block itself or a frame; empty if it lies outside."""
        if prefix and not block.startswith(f"{prefix}."):
            return ""
        rest = block[len(prefix) + 1 if prefix else 0 :]
        first, dot, _ = rest.partition(".")
        return (f"{prefix}.{first}" if prefix else first) if dot or rest else ""

    def level(self, prefix: str) -> _Level:
        """Lay out the ground (no prefix) or a frame with all it holds."""
        children = list(dict.fromkeys(c for b in self.graph.blocks if (c := self.child(prefix, b))))
        level = _Level(prefix, Placed(0, 0, {}, {}, {}), {}, {})
        ports: dict[str, dict[str, dict[str, str]]] = {}
        links, first, last = [], [], []
        for key, net in self.nets.items():
            source = self.child(prefix, net.source.block)
            at = (source, self.port(source, key, net.source))
            targets = []
            for end in net.targets:
                child = self.child(prefix, end.block)
                if child and (child != source or child in self.graph.blocks):
                    targets.append((child, self.port(child, key, end)))
            inside = bool(source) or bool(targets)
            outside = any(not self.child(prefix, end.block) for end in net.targets)
            if not inside or (not targets and not (source and outside)):
                continue
            if not source:
                at = (f"{key}>", "")
                first.append(at[0])
            if source and outside:
                last.append(f">{key}")
                targets.append((last[-1], ""))
            for (child, port), side in ((at, "right"), *((t, "left") for t in dict.fromkeys(targets))):
                ports.setdefault(child, {"left": {}, "right": {}})[side][port] = key
            links.append(Link(key, at, tuple(dict.fromkeys(targets))))
            level.nets[key] = net
        for child in children:
            if child in self.graph.blocks:
                level.items[child] = self.box(child, ports.get(child, {"left": {}, "right": {}}))
            else:
                level.inner[child] = self.level(child)
                level.items[child] = self.frame(level.inner[child], ports.get(child, {"left": {}, "right": {}}))
        edges = [Item(key, 0.0, 0.0, {"": 0.0}, {"": 0.0}, free=False) for key in (*first, *last)]
        level.placed = arrange([*level.items.values(), *edges], links, first, last)
        return level

    def port(self, child: str, net: str, end: End) -> str:
        """Name of an end on a child: the block's port, or the net where it enters a frame."""
        return end.port if child in self.graph.blocks else net

    def frame(self, inner: _Level, ports: dict[str, dict[str, str]]) -> Item:
        corner = inner.placed.corners
        top = HEAD - 12
        left = {net: corner[f"{net}>"][1] + top for net in ports["left"].values()}
        right = {net: corner[f">{net}"][1] + top for net in ports["right"].values()}
        width = max(inner.placed.width, text_width(inner.key.rpartition(".")[2], 12, True) + 2 * PAD)
        return Item(inner.key, width, inner.placed.height + top + PAD, left, right, free=False)

    def box(self, name: str, ports: dict[str, dict[str, str]]) -> Item:
        rows = max(len(ports["left"]), len(ports["right"]))
        sides = {
            side: {port: HEAD + PAD + ROW * (i + 0.5) for i, port in enumerate(ports[side])}
            for side in ("left", "right")
        }
        short, kind = name.rpartition(".")[2], self.graph.blocks[name]
        head = SIZE + 6 + max(text_width(short, 12, True), text_width(kind, 10.5))
        labels = {s: max((text_width(p, 10.5) for p in ports[s]), default=0.0) for s in ("left", "right")}
        foot = max((text_width(text, 10.5, k == "odds") for k, text in self.notes(name)), default=0.0)
        width = max(84.0, head + 2 * PAD, sum(labels.values()) + 4 * PAD, foot + 2 * PAD)
        foot_height = len(self.notes(name)) * 15 + (5 if self.notes(name) else 0)
        height = HEAD + (ROW * rows + 2 * PAD if rows else 0) + foot_height
        return Item(name, width, height, sides["left"], sides["right"])

    def notes(self, name: str) -> list[tuple[str, str]]:
        """Lines at the foot of a box: the odds of its places, and what is recorded there."""
        rows = [("odds", f"◆ {share(odds)} {where}".rstrip()) for where, odds in self.lit.notes.get(name, [])]
        marks = self.graph.marks.get(name, [])
        rows += [(m.kind, f"{SIGNS[m.kind]} {m.port}") for m in marks[:MOST_MARKS]]
        if len(marks) > MOST_MARKS:
            rows.append((marks[-1].kind, f"{SIGNS[marks[-1].kind]} and {len(marks) - MOST_MARKS} more"))
        return rows

    # -- painting ------------------------------------------------------------------------------------------------------

    def paint(self, level: _Level, x: float, y: float) -> None:
        for key, net in level.nets.items():
            self.net(key, net, level, x, y)
        for key, item in level.items.items():
            dx, dy = level.placed.corners[key]
            if key in level.inner:
                name = key.rpartition(".")[2]
                self.frames.append(Box("frame", x + dx, y + dy, item.width, item.height, 6))
                self.boxes.append(Label("name", x + dx + PAD, y + dy + 17, name, 12))
                self.paint(level.inner[key], x + dx, y + dy + HEAD - 12)
            else:
                self.boxes.append(self.block(key, item, x + dx, y + dy))

    def net(self, key: str, net: Net, level: _Level, x: float, y: float) -> None:
        kind = "flange" if net.kind == FLANGE else "signal"
        lines = [tuple((x + a, y + b) for a, b in line) for line in level.placed.lines[key]]
        hot = self.lit.net(net)
        shapes: list[Shape] = [Poly(hot, line) for line in lines] if hot else []
        shapes += [Poly(kind, line) for line in lines]
        dot = "knot" if kind == "flange" else "dot"
        shapes += [Disc(dot, x + a, y + b, 3.4 if kind == "flange" else 2.8) for a, b in level.placed.dots[key]]
        for end in net.targets if kind == "signal" else ():
            if end.block in level.items and end.port in level.items[end.block].left:
                dx, dy = level.placed.corners[end.block]
                tip = (x + dx, y + dy + level.items[end.block].left[end.port])
                shapes.append(Poly("arrow", (tip, (tip[0] - 8, tip[1] - 4), (tip[0] - 8, tip[1] + 4)), True))
        unit = f" [{net.unit}]" if net.unit not in ("", "1", "*") else ""
        join = " — " if kind == "flange" else " → "
        title = net.source.name + join + ", ".join(end.name for end in net.targets) + unit
        self.lines.append(Group(tuple(shapes), title, net.source.name))

    def block(self, name: str, item: Item, x: float, y: float) -> Group:
        kind, folder = self.graph.blocks[name], self.graph.kinds.get(name, "")
        shapes: list[Shape] = []
        hot = self.lit.block(name)
        if hot:
            shapes.append(Box(hot, x - 3, y - 3, item.width + 6, item.height + 6, 6))
        shapes.append(Box("box", x, y, item.width, item.height))
        shapes += icon(kind, folder, x + PAD, y + 9)
        text = x + PAD + SIZE + 6
        shapes.append(Label("name", text, y + 17, name.rpartition(".")[2], 12))
        shapes.append(Label("type", text, y + 31, kind, 10.5))
        if item.left or item.right:
            shapes.append(Poly("rule", ((x + 1, y + HEAD), (x + item.width - 1, y + HEAD))))
        for side, ports, edge in (("left", item.left, x), ("right", item.right, x + item.width)):
            for port, height in ports.items():
                inward = 1 if side == "left" else -1
                hot = self.lit.port(name, port)
                if hot:
                    shapes.append(Disc(hot, edge, y + height, 6))
                if self.is_flange(name, port):
                    shapes.append(Box("port", edge - 3.5, y + height - 3.5, 7, 7, 0))
                anchor = "start" if side == "left" else "end"
                shapes.append(Label("pin", edge + inward * PAD, y + height + 3.6, port, 10.5, anchor))
        notes = self.notes(name)
        base = y + item.height - 15 * len(notes) + 7
        shapes += [Label(k, x + PAD, base + 15 * i, line, 10.5) for i, (k, line) in enumerate(notes)]
        return Group(tuple(shapes), f"{name}: {kind}", name)

    def is_flange(self, block: str, port: str) -> bool:
        return any(n.kind == FLANGE and End(block, port) in n.ends for n in self.graph.nets)

    # -- words ---------------------------------------------------------------------------------------------------------

    def legend(self) -> list[tuple[str, str, float]]:
        """Kind, text and width of each entry; only what the picture holds."""
        rows = []
        for kind, what in WORDS.items():
            if any(m.kind == kind for marks in self.graph.marks.values() for m in marks):
                rows.append((kind, f"{SIGNS[kind]} {what}"))
        if self.lit.notes:
            rows.append(("odds", "◆ odds that something is missing here"))
        return [(kind, text, text_width(text, 10.5, kind == "odds") + 18) for kind, text in rows]

    def words(self) -> str:
        """The wiring as sentences, for those who do not see the picture."""
        parts = [f"{name} is a {kind}." for name, kind in self.graph.blocks.items()]
        for net in self.graph.nets:
            others = ", ".join(end.name for end in net.targets)
            parts.append(f"{net.source.name} {'is joined to' if net.kind == FLANGE else 'feeds'} {others}.")
        parts += [
            f"{WORDS[m.kind].capitalize()}: {b}.{m.port}." for b, marks in self.graph.marks.items() for m in marks
        ]
        for block, rows in self.lit.notes.items():
            parts += [f"Odds at {f'{block} {where}'.strip()}: {share(odds)}." for where, odds in rows]
        return " ".join(parts)
