"""An FMU whose model runs in Python, for models with Python functions.

Its binary, ``heads/process.c``, starts a Python process for each instance (ADR 22); that process runs a slave of
pythonfmu. So it needs Python with flexarm where it is imported, and says so by ``needsExecutionTool``. It has no Model
Exchange and no directional derivatives.
"""

from __future__ import annotations

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from engine.child_process import python_program
from engine.model import Model
from fmu import describe, documentation, python_start
from fmu.build import DEFAULT, PLATFORMS, check, library
from fmu.package import check_target, write_archive
from fmu.plan import Plan
from fmu.plan import plan as make_plan
from fmu.python_core import RECIPE, names_of
from fmu.source import headers

_HEADS = Path(__file__).parent / "heads"
_SOURCES = ("process.c", "process_posix.c", "process_windows.c")
OLDEST = (3, 11)
"""The oldest Python that runs flexarm."""


def export_python(
    model: Model,
    path: str | Path,
    loader: str,
    recipe: Mapping[str, Any],
    files: Mapping[str, bytes],
    *,
    step: float = 1e-3,
    stop: float = 10.0,
    platforms: Sequence[str] = DEFAULT,
) -> Path:
    """Write a model as an FMI 2 Co-Simulation FMU that runs in Python.

    Args:
        model: what is exported.
        path: the file to write.
        loader: ``module:function`` that gives the model when the FMU is loaded; it is called with the folder of
            ``resources`` and the recipe.
        recipe: what the loader needs to know, fit for JSON.
        files: what the loader needs to read, by path in ``resources``.
        step: cell of the internal grid (s), and the communication step that is suggested.
        stop: end of the default experiment (s).
        platforms: for which the binary is compiled; see `fmu.build`.

    Returns:
        The path written.

    Raises:
        FlexarmError: a platform is unknown, or the file cannot be written.
        CompilerUnavailable: no compiler runs, or it fails.
    """
    target = Path(path)
    check_target(target)
    plan = make_plan(model, step, stop, settable=False)
    digest = hashlib.sha256(_description(plan, "").encode() + repr((loader, sorted(recipe.items()))).encode())
    for name in sorted(files):
        digest.update(name.encode() + files[name])
    digest.update(model.signature.encode())
    identity = digest.hexdigest()
    guid = "{" + "-".join(identity[a:b] for a, b in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32))) + "}"
    chosen = check(platforms)
    python = {
        "executable": python_program(),
        "folder": str(Path(__file__).resolve().parent.parent),
        "flexarm": _version(),
        "oldest": OLDEST,
    }
    given = {"loader": loader, "step": step, "stop": stop, "identity": identity, "names": names_of(plan)}
    lines = (guid, f"flexarm {_version()}".strip(), ".".join(map(str, OLDEST)), python_program())
    sources = {name: (_HEADS / name).read_text(encoding="utf-8") for name in _SOURCES} | headers(2)
    made = {"modelDescription.xml": _description(plan, guid).encode()}
    for name in chosen:
        entry = PLATFORMS[name]
        made[f"binaries/{entry.folder}/{plan.identifier}{entry.suffix}"] = library(sources, name)
    made["resources/python.txt"] = ("\n".join(lines) + "\n").encode()
    made["resources/start.py"] = Path(python_start.__file__).read_bytes()
    made[f"resources/{RECIPE}"] = (json.dumps({**recipe, **given, "python": python}, indent=1) + "\n").encode()
    made |= {f"resources/{name}": files[name] for name in sorted(files)}
    made["documentation/index.html"] = documentation.page(plan, chosen, python=True).encode()
    write_archive(target, made)
    return target


def _version() -> str:
    try:
        return metadata.version("flexarm")
    except metadata.PackageNotFoundError:
        return ""


def _description(plan: Plan, guid: str) -> str:
    root = ET.fromstring(describe.fmi2(plan, guid))
    exchange = root.find("ModelExchange")
    assert exchange is not None
    root.remove(exchange)
    root.attrib.pop("numberOfEventIndicators", None)
    slave = root.find("CoSimulation")
    assert slave is not None
    slave.attrib.update(
        needsExecutionTool="true",
        providesDirectionalDerivative="false",
        canInterpolateInputs="false",
        maxOutputDerivativeOrder="0",
        canNotUseMemoryManagementFunctions="true",
    )
    for child in list(slave):
        slave.remove(child)
    categories = root.find("LogCategories")
    assert categories is not None
    ET.SubElement(categories, "Category", {"name": "logPython", "description": "what Python functions print"})
    if plan.model.externals:
        for unknown in root.iter("Unknown"):
            # What a Python function makes of its inputs is unknown, so everything may depend on everything.
            unknown.attrib.pop("dependencies", None)
            unknown.attrib.pop("dependenciesKind", None)
    return describe.text(root)
