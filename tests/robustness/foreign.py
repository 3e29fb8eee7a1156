"""Properties of files that somebody else wrote, and of texts that go into files: tables, MATLAB, anchors, pages."""

from __future__ import annotations

import base64
import functools
import hashlib
import io
import json
import re
import tempfile
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from engine.errors import FlexarmError
from engine.names import CONTROL
from tests.robustness.guard import REFUSED, RESULT, bounded, explained
from tests.robustness.strategies import mangled

SECRET = "hunter2"
"""Stands in cells that are no numbers; no message may repeat it."""


def _rows() -> list[list[str]]:
    return [
        ["time", "u", "note"],
        *[[f"{0.1 * k:.1f}", f"{k * k}", "a" if k % 3 else f'"{SECRET}\n{k}"'] for k in range(12)],
    ]


LINES = [
    "",
    "#",
    f"# {SECRET}",
    f"{SECRET},{SECRET}",
    f'"{SECRET}',
    "1,2,3,",
    ",,",
    "1;2;3",
    "\x00",
    "9" * 200_000,
    "0.4,1",
]
LINES += [f"root:x:0:0:{SECRET}:/root:/bin/sh", "time,u,note", "time,u,u", "1_0,2_0,", f"12:30,{SECRET},x", "1,5;2,5;x"]


@st.composite
def csv(draw: st.DrawFn) -> bytes:
    """A table with lines put in, taken out and ended otherwise, then perhaps mangled."""
    lines = [",".join(row) for row in _rows()]
    for _ in range(draw(st.integers(0, 3))):
        i = draw(st.integers(0, len(lines) - 1)) if lines else 0
        action = draw(st.sampled_from(["insert", "drop", "first", "comma", "cell", "all commas"]))
        if action == "insert":
            lines.insert(i, draw(st.sampled_from(LINES)))
        elif action == "first":
            lines[0:1] = [draw(st.sampled_from(LINES))]
        elif action == "all commas":
            lines = [line + "," for line in lines]
        elif lines:
            if action == "drop":
                del lines[i]
            elif action == "comma":
                lines[i] += ","
            else:
                lines[i] = lines[i].replace("1", draw(st.sampled_from([SECRET, "1e999", "-", "1,1", '"1"', "١"])), 1)
    end = draw(st.sampled_from(["\n", "\n", "\n", "\r\n", "\r", "\n\n"]))
    content = end.join(lines).encode("utf-8", "surrogatepass")
    content = draw(st.sampled_from([b"", b"", b"\xef\xbb\xbf", b"\xff\xfe"])) + content
    return draw(mangled(content)) if draw(st.integers(0, 3)) == 0 else content


@functools.cache
def _sound_mat(form: str, packed: bool) -> bytes:
    from scipy.io import savemat

    content: dict[str, Any] = {"time": np.arange(12.0), "u": np.arange(12.0) ** 2, "A": np.array([[0.5]])}
    content |= {"B": np.array([[1.0]]), "C": np.array([[1.0]]), "dt": 0.1, "note": SECRET}
    if form == "5":
        content |= {
            "log": {"a": np.arange(12), "b": {"c": SECRET}},
            "cells": np.array([np.arange(12.0), "x"], dtype=object),
        }
        content |= {"flags": np.arange(12) > 5, "small": np.arange(12, dtype=np.int16)}
    buffer = io.BytesIO()
    savemat(buffer, content, format=form, do_compression=packed)
    return buffer.getvalue()


@st.composite
def mat(draw: st.DrawFn) -> bytes:
    """A MATLAB file of version 4 or 5 with bytes, words and stretches changed."""
    form = draw(st.sampled_from(["5", "5", "4"]))
    data = bytearray(_sound_mat(form, draw(st.booleans()) and form == "5"))
    for _ in range(draw(st.integers(0, 4))):
        place = draw(st.integers(0, max(len(data) - 1, 0)))
        action = draw(st.sampled_from(["byte", "byte", "word", "word", "cut", "copy"]))
        if action == "byte":
            data[place : place + 1] = bytes([draw(st.sampled_from([0, 1, 2, 4, 6, 9, 14, 15, 17, 100, 128, 255]))])
        elif action == "word":
            place -= place % 4
            word = draw(st.sampled_from([0, 1, 5, 14, 15, 100, 2**14, 2**28, 2**31 - 1, 2**31, 2**32 - 1]))
            data[place : place + 4] = word.to_bytes(4, "little")
        elif action == "cut":
            del data[place : place + draw(st.integers(1, 200))]
        else:
            data[place:place] = data[place : place + draw(st.integers(1, 200))]
    return bytes(data)


JSON = {"time": list(range(12)), "u": [k * k for k in range(12)], "A": [[0.5]], "B": [[1]], "C": [[1]], "dt": 0.1}
ODD_JSON = [
    "1" + "0" * 400,
    "-" + "9" * 5000,
    "NaN",
    "Infinity",
    "1e999",
    "[]",
    "{}",
    "[[1], [1, 2]]",
    "null",
    '"x"',
    "[" * 2000,
]
ODD_JSON += ["true", '{"a": {"a": [1, 2]}}', "[null, 1]", f'"{SECRET}"', f'["{SECRET}"]']


@st.composite
def json_file(draw: st.DrawFn) -> bytes:
    """A JSON file with values replaced and entries doubled, then perhaps mangled."""
    entries = {key: json.dumps(value) for key, value in JSON.items()}
    for _ in range(draw(st.integers(0, 3))):
        key = draw(st.sampled_from(sorted(entries)))
        entries[key] = draw(st.sampled_from(ODD_JSON))
    pairs = [f'"{key}": {value}' for key, value in entries.items()]
    if draw(st.integers(0, 5)) == 0:
        pairs.append(draw(st.sampled_from(pairs)))
    content = ("{" + ", ".join(pairs) + "}").encode()
    return draw(mangled(content)) if draw(st.integers(0, 3)) == 0 else content


@functools.cache
def _sound_parquet() -> Any:
    import pyarrow

    return pyarrow.table({"time": np.arange(12.0), "u": np.arange(12.0) ** 2, "note": [SECRET] * 12})


@st.composite
def parquet(draw: st.DrawFn) -> bytes:
    """A Parquet file with odd metadata, or with bytes changed."""
    import pyarrow.parquet

    said = draw(
        st.sampled_from([b"{", b"[]", b'{"units": 3}', b'{"units": {"u": 3}}', b"null", b"\xff", b"[" * 5000, b"{}"])
    )
    table = _sound_parquet()
    if draw(st.booleans()):
        table = table.replace_schema_metadata({b"flexarm": said})
    if draw(st.integers(0, 3)) == 0:
        table = table.rename_columns(["time", "u", "u"])
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(table, buffer)
    return draw(mangled(buffer.getvalue())) if draw(st.booleans()) else buffer.getvalue()


def foreign_files() -> st.SearchStrategy[tuple[str, bytes]]:
    """A suffix and the content of a file."""
    made = {".csv": csv(), ".mat": mat(), ".json": json_file(), ".parquet": parquet(), ".dat": csv()}
    return st.sampled_from([".csv", ".csv", ".mat", ".mat", ".json", ".parquet", ".dat"]).flatmap(
        lambda kind: st.tuples(st.just(kind), made[kind])
    )


def check_foreign_file(given: tuple[str, bytes]) -> str:
    """A file as recording, as result file, and as file of the blocks that take its kind."""
    import flexarm
    from blocks import find
    from diagnosis.recordings.columns import read_columns

    kind, content = given
    outcomes = []
    with tempfile.TemporaryDirectory() as folder, bounded():
        path = Path(folder) / f"odd{kind}"
        path.write_bytes(content)

        def recorded() -> None:
            columns = read_columns(path)
            assert len(columns)
            for name in columns.names:
                try:
                    assert columns.number(name).shape == (len(columns),)
                except FlexarmError as error:
                    _silent(error)

        def block(name: str, **values: Any) -> None:
            find(name)(file=str(path), **values)

        ways: list[Any] = [recorded, lambda: flexarm.read(path)]
        if kind != ".parquet":
            ways.append(lambda: block("Table", column="u"))
        if kind == ".csv":
            ways.append(lambda: block("Spline", column="u"))
        if kind in (".mat", ".json"):
            ways += [lambda: block("DiscreteStateSpace"), lambda: block("StateSpace")]
        for way in ways:
            try:
                way()
                outcomes.append(RESULT)
            except FlexarmError as error:
                _silent(error)
                outcomes.append(REFUSED)
    return RESULT if RESULT in outcomes else REFUSED


def _silent(error: FlexarmError) -> None:
    """A message that says nothing of the file's content; a header's name may be repeated, cut."""
    assert error.message.strip()
    assert len(str(error)) < 2000
    assert SECRET not in str(error) or "called" in error.message or "column" in error.message, str(error)
    assert error.remedy, str(error)


# -- anchors and merge keys -------------------------------------------------------------------------------------------


@st.composite
def shared_documents(draw: st.DrawFn) -> tuple[str, str, int]:
    """A scenario whose blocks share values by anchors, aliases and merge keys; a block, and a value for its gain."""
    names = [f"b{k}" for k in range(draw(st.integers(2, 6)))]
    lines = ["schema: 1", "name: shared", "blocks:"]
    mappings: list[str] = []
    scalars: list[str] = []
    for name in names:
        way = draw(st.sampled_from(["own", "own", "alias", "merge", "list"]))
        anchor = f"&{name} " if draw(st.booleans()) else ""
        if way == "alias" and mappings:
            lines.append(f"  {name}: *{draw(st.sampled_from(mappings))}")
            continue
        gain = str(draw(st.integers(1, 9)))
        if draw(st.integers(0, 3)) == 0:
            gain = f"&s{name} {gain}"
        elif scalars and bool(draw(st.booleans())):
            gain = f"*{draw(st.sampled_from(scalars))}"
        inner = f"type: Gain, gain: {gain}"
        if way == "merge" and mappings:
            inner = f"<<: *{draw(st.sampled_from(mappings))}" + draw(st.sampled_from(["", f", gain: {gain}"]))
        elif way == "list" and len(mappings) > 1:
            inner = f"<<: [{', '.join('*' + m for m in draw(st.permutations(mappings)))}]"
        lines.append(f"  {name}: {anchor}{{{inner}}}")
        if f"&s{name} " in inner:
            scalars.append(f"s{name}")
        if anchor:
            mappings.append(name)
    lines += ["recordings:", "  one: &one {file: a.csv, time: {interval: 1 ms}, measurements: {b0.out: {column: u}}}"]
    lines += ["  two: {<<: *one, file: b.csv}"]
    return "\n".join(lines) + "\n", draw(st.sampled_from(names)), draw(st.integers(100, 999))


def check_shared(given: tuple[str, str, int]) -> str:
    """An edit changes one place, whatever shares with it; the rest stays as it was."""
    from scenarios.amend import Set, amended, relocated, without
    from scenarios.document import parse

    text, name, value = given
    with bounded():
        meant = parse(text).plain()
        meant["blocks"][name]["gain"] = value
        assert meant == parse(amended(text, [Set(name, "gain", value)])).plain()
        alone = parse(text).plain()
        del alone["blocks"]
        assert alone == parse(without(text, "blocks")).plain()
        moved = parse(relocated(text, Path("/a"), Path("/b"))).plain()
        assert [entry["file"] for entry in moved["recordings"].values()] == ["../a/a.csv", "../a/b.csv"]
    return RESULT


# -- texts in pages and descriptions ----------------------------------------------------------------------------------

TEXTS = [
    "</script><script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    '" onmouseover="alert(1)',
    "' onfocus='alert(1)' autofocus='",
    "</title></style><svg onload=alert(1)>",
    "<!--",
    "]]>",
    "<![CDATA[",
    "&lt;b&gt; &amp; &#60;script&#62;",
    "{{ 7 * 7 }}{% raw %}",
    "${7*7} $\\undefined{a}$",
    "javascript:alert(1)",
    "\u202eevil",
    "\x07\x1b[31m",
    "a\nb",
    "a\tb",
    "\u2028",
    "\ufffe",
    "\U0001f980",
    "µΩ°²",
    "x" * 100,
    "x" * 101,
    "x" * 3000,
    "",
    " ",
]

PAGE = """\
schema: 1
name: NAME
description: WORDS
blocks:
  source: {type: Step, height: 1 V}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7,
          viscous_friction: 1e-6}
connect:
  - [source.out, motor.voltage]
simulate: {stop: 3 ms, record: [motor.shaft.angle, motor.shaft.speed]}
"""


class _Skeleton(HTMLParser):
    """Elements and attribute names of a page in order, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, ...]] = []
        self.words: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, *sorted(name for name, _ in attrs)))

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def pages() -> st.SearchStrategy[tuple[str, str, str]]:
    """A scenario's name and description, and a command line."""
    texts = st.sampled_from(TEXTS) | st.text(max_size=60)
    return st.tuples(texts, texts, texts)


def _page(name: str, words: str, command: str) -> str:
    from engine.simulate import simulate
    from flexarm.report.run_page import page
    from scenarios.load import SHIPPED, load

    text = PAGE.replace("NAME", json.dumps(name)).replace("WORDS", json.dumps(words))
    scenario = load(SHIPPED / "srv02-bare.yaml", text=text)
    return page(scenario, simulate(scenario.build(), 3e-3, backend="interpreter"), command=command)


@functools.cache
def _plain_page(words: bool, command: bool) -> tuple[tuple[str, ...], ...]:
    return tuple(_Skeleton(_page("x", "x" * words, "x" * command)).elements)


def check_page(given: tuple[str, str, str]) -> str:
    """A report has the elements of a harmless one, shows the texts as texts, and runs its own script alone; an FMU's
    description, its documentation and its file names are such that every reader takes them."""
    from fmu import describe, documentation, plan
    from scenarios.load import SHIPPED, load

    name, words, command = given
    with bounded():
        try:
            made = _page(name, words, command)
        except FlexarmError as error:
            return explained(error)
        found = _Skeleton(made)
        assert tuple(found.elements) == _plain_page(bool(words), bool(command))
        shown = "".join(found.words)
        for text in (name, words):
            assert text.strip() in shown
        assert not CONTROL.search(made)
        made.encode("utf-8")
        svg = re.search(r"<svg.*?</svg>", made, re.DOTALL)
        assert svg is not None
        ET.fromstring(svg[0])
        data, script = re.findall(r"<script[^>]*>(.*?)</script>", made, re.DOTALL)
        json.loads(data, parse_constant=_refuse)
        assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() in made.partition("<script")[0]
        text = PAGE.replace("NAME", json.dumps(name)).replace("WORDS", json.dumps(words))
        unit = plan.plan(load(SHIPPED / "srv02-bare.yaml", text=text).build(["motor.voltage"]))
        for document in (describe.fmi2(unit, "{0}"), describe.fmi3(unit, "{0}"), describe.build_description(unit)):
            ET.fromstring(document)
        html = documentation.page(unit, ["linux64"])
        assert not [element for element in _Skeleton(html).elements if element[0] in ("script", "img", "svg")]
        assert re.fullmatch(r"[A-Za-z]\w{0,101}", unit.identifier, re.ASCII)
    return RESULT


def _refuse(constant: str) -> None:
    raise AssertionError(f"{constant} in JSON")
