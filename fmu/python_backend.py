"""An FMU whose model runs in Python, through pythonfmu, for models with Python functions.

It needs Python with flexarm where it is imported, and says so by ``needsExecutionTool``. Its description is ours,
without Model Exchange and directional derivatives; its binaries are pythonfmu's.
"""

from __future__ import annotations

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from engine.errors import FlexarmError
from engine.model import Model
from fmu import describe, documentation
from fmu.package import check_target, write_archive
from fmu.plan import Plan
from fmu.plan import plan as make_plan
from fmu.python_slave import RECIPE

_MODULE = '''"""Made by flexarm; pythonfmu runs it."""

from fmu.python_slave import Slave, owed


class {name}(Slave):
    """The model of recipe.json."""

    identity = "{identity}"

    def __init__(self, **settings):
        owed.append(globals())
        super().__init__(**settings)
'''


def export_python(
    model: Model,
    path: str | Path,
    loader: str,
    recipe: Mapping[str, Any],
    files: Mapping[str, bytes],
    *,
    step: float = 1e-3,
    stop: float = 10.0,
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

    Returns:
        The path written.

    Raises:
        FlexarmError: pythonfmu has no binaries, or the file cannot be written.
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
    module = f"flexarm_{identity[:16]}"
    whole = {**recipe, "loader": loader, "step": step, "stop": stop}
    made = {"modelDescription.xml": _description(plan, guid).encode()}
    platforms = []
    for folder, name, content in _binaries():
        made[f"binaries/{folder}/{plan.identifier}{Path(name).suffix}"] = content
        platforms.append(folder)
    made["resources/slavemodule.txt"] = module.encode()
    made[f"resources/{module}.py"] = _MODULE.format(name=f"Model{identity[:16]}", identity=identity).encode()
    made[f"resources/{RECIPE}"] = (json.dumps(whole, indent=1) + "\n").encode()
    made |= {f"resources/{name}": files[name] for name in sorted(files)}
    made["documentation/index.html"] = documentation.page(plan, platforms, python=True).encode()
    write_archive(target, made)
    return target


def _binaries() -> list[tuple[str, str, bytes]]:
    try:
        import pythonfmu
    except ImportError as error:
        raise FlexarmError(
            f"the python backend needs pythonfmu, which cannot be imported: {error}", remedy="pip install pythonfmu"
        ) from error
    folder = Path(pythonfmu.__file__).parent / "resources" / "binaries"
    found = sorted(file for file in folder.rglob("*") if file.suffix in (".so", ".dll", ".dylib"))
    if not found:
        raise FlexarmError(f"pythonfmu has no binaries in {folder}", remedy="pip install --force-reinstall pythonfmu")
    return [(file.parent.name, file.name, file.read_bytes()) for file in found]


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
    if plan.model.externals:
        for unknown in root.iter("Unknown"):
            # What a Python function makes of its inputs is unknown, so everything may depend on everything.
            unknown.attrib.pop("dependencies", None)
            unknown.attrib.pop("dependenciesKind", None)
    return describe.text(root)
