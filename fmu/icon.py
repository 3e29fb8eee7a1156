"""Icon and terminals of an FMU: the picture that an importer draws, and the grouping of its signals."""

from __future__ import annotations

import math
import struct
import xml.etree.ElementTree as ET
import zlib

from fmu.describe import text
from fmu.plan import Plan
from fmu.variables import INPUT, OUTPUT

_SIZE = 96


def files(plan: Plan, version: int) -> dict[str, bytes]:
    """Icon and terminals, which importers of FMI 3 read of an FMI 2 FMU too; of that also ``model.png``."""
    made = {"terminalsAndIcons/icon.png": icon(), "terminalsAndIcons/terminalsAndIcons.xml": terminals(plan).encode()}
    return made | ({"model.png": icon()} if version == 2 else {})


def terminals(plan: Plan) -> str:
    """One terminal for each block that has inputs or outputs, with its signals as members."""
    root = ET.Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    drawn = ET.SubElement(root, "GraphicalRepresentation")
    box = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    ET.SubElement(drawn, "CoordinateSystem", box | {"suggestedScalingFactorTo_mm": "0.1"})
    ET.SubElement(drawn, "Icon", box)
    groups: dict[str, list[tuple[str, str]]] = {}
    for variable in plan.variables:
        if variable.kind in (INPUT, OUTPUT):
            block, _, member = variable.source.partition(".")
            groups.setdefault(block, []).append((variable.name, member or block))
    if groups:
        parent = ET.SubElement(root, "Terminals")
        for block, members in groups.items():
            terminal = ET.SubElement(parent, "Terminal", {"name": block, "matchingRule": "bus"})
            for name, member in members:
                given = {"variableName": name, "memberName": member, "variableKind": "signal"}
                ET.SubElement(terminal, "TerminalMemberVariable", given)
    return text(root)


def icon() -> bytes:
    """A bent arm on its hub, as PNG."""
    rows = b""
    for y in range(_SIZE):
        line = b"\0"
        for x in range(_SIZE):
            line += bytes(_pixel((x + 0.5) / _SIZE, 1 - (y + 0.5) / _SIZE))
        rows += line
    head = struct.pack(">IIBBBBB", _SIZE, _SIZE, 8, 0, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b""))
    made = b"\x89PNG\r\n\x1a\n"
    for kind, body in parts:
        made += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return made


def _pixel(x: float, y: float) -> list[int]:
    """Grey level: the hub is a ring at the lower left, the arm bends up from it."""
    hub = abs(math.hypot(x - 0.22, y - 0.3) - 0.12) - 0.025
    along = (x - 0.3) / 0.6
    arm = abs(y - (0.36 + 0.42 * along**2)) - 0.035 if 0 <= along <= 1 else 1.0
    edge = min(hub, arm) * _SIZE
    return [int(255 * min(max(edge + 0.5, 0.0), 1.0))]
