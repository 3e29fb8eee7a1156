"""Block diagrams: nothing lies on anything else, every net joins its ends, and texts stay texts."""

from __future__ import annotations

import itertools
import random
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flexarm.plotting.wiring.diagram import diagram, write
from flexarm.plotting.wiring.graph import FLANGE, graph
from flexarm.plotting.wiring.layout import Item, Link, arrange
from flexarm.plotting.wiring.places import lit
from scenarios.load import load, shipped_names
from tests.report.conftest import HOSTILE, axes, chain

SVG = "{http://www.w3.org/2000/svg}"


def _segments(lines: Any) -> list[Any]:
    return [s for line in lines for s in itertools.pairwise(line)]


def _overlap(a: Any, b: Any, slack: float = 0.1) -> Any:
    """Whether two rectangles (left, top, right, bottom) overlap."""
    return a[0] < b[2] - slack and b[0] < a[2] - slack and a[1] < b[3] - slack and b[1] < a[3] - slack


def _on(point: Any, segment: Any, slack: float = 0.6) -> Any:
    (x0, y0), (x1, y1) = segment
    return (
        min(x0, x1) - slack <= point[0] <= max(x0, x1) + slack
        and min(y0, y1) - slack <= point[1] <= max(y0, y1) + slack
    )


def _touch(a: Any, b: Any) -> Any:
    crossing = (a[0][0] == a[1][0]) != (b[0][0] == b[1][0]) and any(
        _on(p, b) and _on(p, a) for p in ((a[0][0], b[0][1]), (b[0][0], a[0][1]))
    )
    return crossing or any(_on(p, b) for p in a) or any(_on(p, a) for p in b)


def _joined(segments: Any) -> bool:
    """Whether the segments hang together."""
    reaches_floor, waiting = segments[:1], segments[1:]
    while waiting:
        more = [s for s in waiting if any(_touch(s, r) for r in reaches_floor)]
        if not more:
            return False
        reaches_floor, waiting = reaches_floor + more, [s for s in waiting if s not in more]
    return True


def _check(items: Any, links: Any, placed: Any) -> None:
    boxes = {i.key: (x, y, x + i.width, y + i.height) for i in items for x, y in [placed.corners[i.key]] if i.width}
    for first, second in itertools.combinations(boxes.values(), 2):
        assert not _overlap(first, second)
    drawn = {}
    for link in links:
        segments = drawn[link.key] = _segments(placed.lines[link.key])
        by_key = {i.key: i for i in items}
        ends = [(link.source, "right"), *((t, "left") for t in link.targets)]
        for (key, port), side in ends:
            x, y = placed.corners[key]
            item = by_key[key]
            at = (x + item.width, y + item.right[port]) if side == "right" else (x, y + item.left[port])
            assert any(_on(at, s) for s in segments), f"{link.key} does not reach {key}.{port}"
        assert _joined(segments), f"{link.key} falls apart"
        for (x0, y0), (x1, y1) in segments:
            assert x0 == x1 or y0 == y1, f"{link.key} runs aslant"
            line = (min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1))
            for key, (left, top, right, bottom) in boxes.items():
                inside = line[0] < right - 1 and line[2] > left + 1 and line[1] < bottom - 1 and line[3] > top + 1
                assert not inside, f"{link.key} crosses {key}"
    for (one, a), (other, b) in itertools.combinations(drawn.items(), 2):
        for (p, q), (r, s) in itertools.product(a, b):
            for k in (0, 1):
                along = 1 - k
                if p[k] == q[k] and r[k] == s[k] and abs(p[k] - r[k]) < 1:
                    shared = min(max(p[along], q[along]), max(r[along], s[along])) - max(
                        min(p[along], q[along]), min(r[along], s[along])
                    )
                    assert shared < 1, f"{one} and {other} lie on each other"


def _random_case(seed: Any) -> tuple[Any, Any]:
    """Boxes with free ports and links among them, with cycles, fan-outs and loops on one box."""
    rng = random.Random(seed)
    count = rng.randint(2, 14)
    items = [Item(f"b{i}", rng.uniform(60, 140), 100.0) for i in range(count)]
    links = []
    for n in range(rng.randint(1, 2 * count)):
        source = rng.choice(items)
        targets = rng.sample(items, rng.randint(1, min(3, count)))
        source.right[f"o{n}"] = 0.0
        for t in targets:
            t.left[f"i{n}"] = 0.0
        links.append(Link(f"n{n}", (source.key, f"o{n}"), tuple((t.key, f"i{n}") for t in targets)))
    for item in items:
        for side in (item.left, item.right):
            for i, port in enumerate(side):
                side[port] = 48 + 17 * (i + 0.5)
        item.height = 60 + 17 * max(len(item.left), len(item.right), 1)
    return items, links


@pytest.mark.parametrize("seed", range(60))
def test_random_wirings_are_laid_out_cleanly(seed: Any) -> None:
    items, links = _random_case(seed)
    _check(items, links, arrange(items, links))


def _number(node: ET.Element, key: str) -> float:
    text = node.get(key)
    assert text is not None
    return float(text)


def _texts(svg: Any) -> Iterator[tuple[Any, tuple[Any, Any, Any, Any]]]:
    """Place of every text of an SVG by a generous measure of its own, as (text, left, top, right, bottom)."""
    for node in ET.fromstring(svg).iter(f"{SVG}text"):
        size, text = _number(node, "font-size"), node.text or ""
        width = 0.5 * size * len(text)
        x, y = _number(node, "x"), _number(node, "y")
        left = x - {"middle": width / 2, "end": width}.get(node.get("text-anchor", ""), 0.0)
        yield text, (left, y - 0.7 * size, left + width, y + 0.2 * size)


def _scenarios(folder: Any) -> Iterator[Any]:
    yield from (load(name) for name in shipped_names())
    yield load(axes(folder, 3))
    yield load(chain(folder, 9))


def test_every_scenario_is_drawn_without_overlaps(tmp_path: Path) -> None:
    for scenario in _scenarios(tmp_path):
        svg = diagram(scenario).svg()
        root = ET.fromstring(svg)
        width, height = _number(root, "width"), _number(root, "height")
        boxes = []
        for rect in root.iter(f"{SVG}rect"):
            x, y, w, h = (float(rect.get(k, 0)) for k in ("x", "y", "width", "height"))
            assert min(x, y, width + 1 - x - w, height + 1 - y - h) >= 0, scenario.name
            if rect.get("class") == "fx-box":
                boxes.append((x, y, x + w, y + h))
        assert len(boxes) == len(scenario.system.blocks)
        for a, b in itertools.combinations(boxes, 2):
            assert not _overlap(a, b), scenario.name
        texts = list(_texts(svg))
        for (one, a), (other, b) in itertools.combinations(texts, 2):
            assert not _overlap(a, b, 0.5), f"{scenario.name}: '{one}' on '{other}'"
        shown = [t for t, _ in texts]
        for name in scenario.system.blocks:
            assert name.rpartition(".")[2] in shown


def test_every_connection_of_the_file_is_drawn(tmp_path: Path) -> None:
    for scenario in _scenarios(tmp_path):
        made = graph(scenario)
        for connection in scenario.system.connections:
            ends = set(connection.ends)
            assert any(ends <= {e.name for e in net.ends} for net in made.nets), connection.ends
        for net in made.nets:
            flange = [scenario.system.is_flange(e.name) for e in net.ends]
            assert all(flange) if net.kind == FLANGE else not any(flange)


def test_flanges_run_from_the_drive_outwards() -> None:
    nets = {n.source.name: [e.name for e in n.targets] for n in graph(load("reference-b")).nets if n.kind == FLANGE}
    assert set(nets["motor.shaft"]) == {"friction.shaft", "tachometer.shaft", "gear.input"}
    assert nets["gear.output"] == ["contact.a"]


def test_marks_say_what_is_driven_and_measured() -> None:
    marks = graph(load("srv02-bare")).marks
    assert {(m.kind, m.port) for m in marks["motor"]} == {("driven", "voltage"), ("measured", "shaft.speed")}
    recorded = graph(load("quanser-single-link")).marks["link"]
    assert {m.port for m in recorded} == {"hub.angle", "hub.speed", "tip.deflection"}


def test_places_are_found_and_lit() -> None:
    made = graph(load("quanser-single-link"))
    found = lit(
        made,
        {
            "signal -> motor.voltage": 0.9,
            "link.hub.angle": 0.06,
            "gear.ratio": 0.02,
            "gear.output -> node": 0.01,
            "nowhere.at.all": 0.4,
            "bearing": 1e-9,
        },
    )
    assert found.unknown == ["nowhere.at.all"]
    assert found.block("motor") == "hot1"
    assert found.block("link") == "hot2"
    assert found.block("gear") == "hot3"
    assert found.block("bearing") == ""
    assert found.port("motor", "voltage") == "hot1"
    assert found.port("link", "hub") == "hot2"
    by_source = {n.source.name: found.net(n) for n in made.nets}
    assert by_source["zone.out"] == "hot1"
    assert by_source["gear.output"] == "hot3"
    assert by_source["source.out"] == ""
    svg = diagram(load("quanser-single-link"), {"signal -> motor.voltage": 0.9}).svg()
    assert "90 % on the way into voltage" in svg
    assert 'class="fx-hot1"' in svg
    assert 'class="fx-hot1"' not in diagram(load("quanser-single-link")).svg()


def test_names_from_files_stay_text(tmp_path: Path) -> None:
    svg = diagram(load(axes(tmp_path, 1))).svg()
    root = ET.fromstring(svg)
    assert not list(root.iter(f"{SVG}script"))
    title = root.find(f"{SVG}title")
    assert title is not None
    assert HOSTILE in (title.text or "")
    assert "http" not in svg.replace("http://www.w3.org/2000/svg", "")


def test_frames_hold_their_blocks(tmp_path: Path) -> None:
    root = ET.fromstring(diagram(load(axes(tmp_path, 2))).svg())
    rects: dict[str | None, list[tuple[float, ...]]] = {}
    for rect in root.iter(f"{SVG}rect"):
        x, y, w, h = (float(rect.get(k, 0)) for k in ("x", "y", "width", "height"))
        rects.setdefault(rect.get("class"), []).append((x, y, x + w, y + h))
    assert len(rects["fx-frame"]) == 2
    for left, top, right, bottom in rects["fx-frame"]:
        inside = [b for b in rects["fx-box"] if _overlap(b, (left, top, right, bottom))]
        assert len(inside) == 6
        assert all(b[0] > left and b[1] > top and b[2] < right and b[3] < bottom for b in inside)


def test_frames_within_frames_lie_in_front(tmp_path: Path) -> None:
    axes(tmp_path, 1)
    (tmp_path / "cell.yaml").write_text(
        "schema: 1\nname: cell\nblocks:\n  left: {type: ./axis.yaml}\n  right: {type: ./axis.yaml}\n"
        "  gain: {type: Gain, gain: 2}\nconnect:\n  - [left.reading, gain.in]\n  - [gain.out, right.command]\n"
    )
    outer = tmp_path / "outer.yaml"
    outer.write_text("schema: 1\nname: outer\nblocks:\n  cell: {type: ./cell.yaml}\n")
    root = ET.fromstring(diagram(load(outer)).svg())
    frames = [r for r in root.iter(f"{SVG}rect") if r.get("class") == "fx-frame"]
    areas = [_number(r, "width") * _number(r, "height") for r in frames]
    assert len(areas) == 3
    assert areas[0] == max(areas)


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_pictures_are_written_whole(suffix: str, tmp_path: Path) -> None:
    path = write(diagram(load("srv02-tracking")), tmp_path / f"a{suffix}")
    head = path.read_bytes()[:8]
    assert head.startswith({".svg": b"<svg", ".png": b"\x89PNG", ".pdf": b"%PDF"}[suffix])
    assert [p.name for p in tmp_path.iterdir()] == [f"a{suffix}"]
