"""Archives with odd content: an exported FMU and an SSP, changed in their XML, names, entries and bytes."""

from __future__ import annotations

import functools
import io
import struct
import tempfile
import warnings
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from engine.errors import FlexarmError
from engine.simulate import simulate
from scenarios.load import load
from tests.robustness.guard import RESULT, bounded, explained
from tests.robustness.strategies import TEXTS, mangled

Files = dict[str, bytes]

SSD = "SystemStructure.ssd"
DESCRIPTION = "modelDescription.xml"

HOST = """\
schema: 1
name: host
blocks:
  source: {type: Step, height: 1 V}
  plant: {type: FMU, file: plant.fmu, period: 1 ms}
connect: []
simulate: {stop: 3 ms, step: 1 ms}
"""

EVIL_NAMES = [
    "../x",
    "a/../../x",
    "/tmp/flexarm-escaped",
    "C:/x",
    "..\\x",
    "resources/..",
    "./../x",
    "a\0b",
    "x" * 5000,
]

DOCTYPES = [
    b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
    b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;">]>',
    b'<!DOCTYPE a SYSTEM "http://127.0.0.1:9/x.dtd">',
    b'<!DOCTYPE a [<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;]>',
]


@functools.cache
def fmu() -> Files:
    """The files of a small FMU for this machine."""
    from flexarm.api import export as write
    from flexarm.cut import cut

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = cut(load("srv02-bare"), "export", inputs=["motor.voltage"], outputs=["motor.shaft.speed"])
        path = write(made, Path(folder) / "plant.fmu", platforms=["linux64"], beside=False)
        with zipfile.ZipFile(path) as archive:
            kept = [n for n in archive.namelist() if n.startswith("binaries/") or n == DESCRIPTION]
            return {name: archive.read(name) for name in kept}


@functools.cache
def ssp() -> Files:
    """The files of a package with that FMU."""
    from fmu.ssp import Connector, Structure, write

    u, y = "motor_voltage", "motor_shaft_speed"
    own = (Connector(u, "input", "V"), Connector(y, "output", "rad/s"))
    wires = ((("", u), ("plant", u)), (("plant", y), ("", y)))
    made = Structure("system", own, {"plant": own}, {"plant": "resources/plant.fmu"}, wires, 0.003, 0.001)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.ssp"
        write(path, made, {"resources/plant.fmu": packed(fmu())})
        with zipfile.ZipFile(path) as archive:
            return {name: archive.read(name) for name in archive.namelist()}


def packed(files: Files, modes: dict[str, int] | None = None) -> bytes:
    """A zip archive; ``modes`` are the Unix modes of entries."""
    content = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        warnings.simplefilter("ignore")
        for name, data in files.items():
            entry = zipfile.ZipInfo(name)
            entry.filename = name  # past the class's own repair of names
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (modes or {}).get(name, 0o100644) << 16
            archive.writestr(entry, data)
    return content.getvalue()


@st.composite
def odd_xml(draw: st.DrawFn, content: bytes) -> bytes:
    """XML with one to three changes: of attributes, of elements, of bytes, or with a document type."""
    if draw(st.integers(0, 9)) == 0:
        head, sep, rest = content.partition(b"?>")
        return head + sep + draw(st.sampled_from(DOCTYPES)) + rest
    if draw(st.integers(0, 4)) == 0:
        return draw(mangled(content))
    root = ET.fromstring(content)
    values = st.sampled_from([t for t in TEXTS if _printable(t)]) | st.sampled_from(
        ["0", "-1", "1e300", "1e-300", "4294967295", "99999999999999999999", "true", "Real", "output", "input", "exact"]
    )
    for _ in range(draw(st.integers(1, 3))):
        elements = list(root.iter())
        element = elements[draw(st.integers(0, len(elements) - 1))]
        action = draw(st.sampled_from(["set", "set", "set", "drop", "remove", "copy", "tag", "exchange"]))
        keys = sorted(element.attrib)
        if action in ("set", "drop", "exchange") and keys:
            key = draw(st.sampled_from(keys))
            other = elements[draw(st.integers(0, len(elements) - 1))].attrib
            if action == "drop":
                del element.attrib[key]
            elif action == "exchange" and other:
                element.set(key, other[draw(st.sampled_from(sorted(other)))])
            else:
                element.set(key, draw(values))
        elif action in ("remove", "copy") and len(element):
            child = element[draw(st.integers(0, len(element) - 1))]
            element.remove(child) if action == "remove" else element.append(child)
        elif action == "tag":
            element.tag = draw(st.sampled_from([e.tag for e in elements]) | st.just("Odd"))
    written: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return written


def _printable(text: str) -> bool:
    return all(c == "\n" or c >= " " for c in text) and "\ud800" not in text


@st.composite
def archives(draw: st.DrawFn) -> tuple[str, bytes]:
    """A kind (``fmu``, ``ssp`` or ``block``) and the bytes of the file."""
    kind = draw(st.sampled_from(["fmu", "ssp", "ssp", "block"]))
    files = dict(ssp() if kind == "ssp" else fmu())
    modes: dict[str, int] = {}
    what = draw(st.sampled_from(["xml"] * 6 + ["inner", "name", "link", "bytes", "sizes", "drop"]))
    if what == "xml":
        name = SSD if kind == "ssp" else DESCRIPTION
        files[name] = draw(odd_xml(files[name]))
    elif what == "inner" and kind == "ssp":
        inside = dict(fmu())
        inside[DESCRIPTION] = draw(odd_xml(inside[DESCRIPTION]))
        files["resources/plant.fmu"] = packed(inside)
    elif what == "name":
        name = draw(st.sampled_from(EVIL_NAMES))
        files[name] = b"escaped"
    elif what == "link":
        name = draw(st.sampled_from(["resources/link", *files]))
        modes[name] = 0o120777
        files[name] = draw(st.sampled_from([b"/etc/passwd", b"../..", b"/tmp"]))
    elif what == "drop":
        del files[draw(st.sampled_from(sorted(files)))]
    content = packed(files, modes)
    if what == "bytes":
        content = draw(mangled(content))
    elif what == "sizes":
        # The sizes and the method of an entry of the directory at the end, and its flags.
        place = content.rindex(b"PK\x01\x02")
        offset, form = draw(st.sampled_from([(20, "<I"), (24, "<I"), (10, "<H"), (8, "<H"), (42, "<I")]))
        number = draw(st.sampled_from([0, 1, 99, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF])) & (0xFFFF if form == "<H" else -1)
        content = (
            content[: place + offset] + struct.pack(form, number) + content[place + offset + struct.calcsize(form) :]
        )
    return kind, content


def check_archive(given: tuple[str, bytes]) -> str:
    """Co-simulate three steps of it, or run it as a block; nothing is written outside of its folder."""
    from flexarm.cosim import run

    kind, content = given
    escaped = Path("/tmp/flexarm-escaped")
    with tempfile.TemporaryDirectory() as folder, bounded():
        path = Path(folder) / "inner" / f"plant.{'ssp' if kind == 'ssp' else 'fmu'}"
        path.parent.mkdir()
        path.write_bytes(content)
        try:
            found = _block(path) if kind == "block" else run(path, stop=0.003, step=0.001).trace.values
            assert np.isfinite(found).all()
            return RESULT
        except FlexarmError as error:
            return explained(error)
        finally:
            assert not escaped.exists()
            assert [p.name for p in Path(folder).iterdir()] == ["inner"]


def _block(path: Path) -> Any:
    text = HOST
    (path.parent / "host.yaml").write_text(text)
    return simulate(load(path.parent / "host.yaml").build(), 0.003, 1e-3, backend="interpreter").values
