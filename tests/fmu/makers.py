"""Small FMUs as another maker would write them: C of their own, with nothing of this library in it."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from engine import compile as compiling

_HERE = Path(__file__).parent


def foreign_binary(name: str) -> bytes:
    """The library for linux64 of a C file beside this one."""
    names = (name, "foreign_unused.h")
    return compiling.binary({file: (_HERE / file).read_text(encoding="utf-8") for file in names}, ["-s"], ".so")


def foreign_fmu(path: Path, binary: bytes, variables: Sequence[tuple[str, str, float | None]]) -> Path:
    """An FMI 2 Co-Simulation FMU ``m``.

    Args:
        path: the file to write.
        binary: its library.
        variables: name, causality and start of each, by value reference.
    """
    lines = []
    for reference, (name, causality, start) in enumerate(variables):
        kept = ' variability="fixed"' if causality == "parameter" else ""
        value = "" if start is None else f' start="{start!r}"'
        lines.append(
            f'<ScalarVariable name={quoteattr(name)} valueReference="{reference}" causality="{causality}"{kept}>'
            f"<Real{value}/></ScalarVariable>"
        )
    outputs = [k for k, (_, causality, _) in enumerate(variables, 1) if causality == "output"]
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g">'
        '<CoSimulation modelIdentifier="m" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{''.join(lines)}</ModelVariables><ModelStructure><Outputs>"
        + "".join(f'<Unknown index="{k}"/>' for k in outputs)
        + "</Outputs></ModelStructure></fmiModelDescription>"
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr("binaries/linux64/m.so", binary)
    return path
