"""System Structure and Parameterization 1.0: a package of FMUs and their wiring, written, read and co-simulated."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from engine.errors import FlexarmError, nearest
from engine.simulate import Drive
from fmu import archive
from fmu.host import Host, host
from fmu.package import check_target, write_archive
from fmu.units import definition
from fmu.verify import Trace, points, present

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_OURS = "urn:flexarm"
_PASSES = 2
"""How often values are passed on at an instant: a torque follows the motion, and other values follow the torque."""

End = tuple[str, str]
"""Component (empty for the system's own connectors) and variable."""


@dataclass(frozen=True)
class Connector:
    """A variable that can be wired."""

    name: str
    kind: str
    unit: str = ""


@dataclass(frozen=True)
class Structure:
    """What a package holds.

    Attributes:
        name: of the system.
        connectors: of the system itself.
        components: connectors of each component, in the order in which they step.
        sources: file of each component inside the package.
        connections: from an output to an input, or from and to the system's own connectors.
        stop: end of the default experiment (s).
        step: communication step that is suggested (s).
    """

    name: str
    connectors: tuple[Connector, ...]
    components: dict[str, tuple[Connector, ...]]
    sources: dict[str, str]
    connections: tuple[tuple[End, End], ...]
    stop: float = 1.0
    step: float = 1e-3


def write(path: Path, structure: Structure, files: Mapping[str, bytes]) -> None:
    """Write a package whole or not at all.

    Args:
        path: the .ssp file.
        structure: what it says.
        files: its FMUs by their paths in the package.
    """
    check_target(path)
    write_archive(path, {"SystemStructure.ssd": _document(structure).encode(), **files})


def _document(structure: Structure) -> str:
    ET.register_namespace("ssd", _SSD)
    ET.register_namespace("ssc", _SSC)
    root = ET.Element(f"{{{_SSD}}}SystemStructureDescription", {"version": "1.0", "name": structure.name})
    system = ET.SubElement(root, f"{{{_SSD}}}System", {"name": structure.name})
    _connectors(system, structure.connectors)
    elements = ET.SubElement(system, f"{{{_SSD}}}Elements")
    for name, connectors in structure.components.items():
        given = {"name": name, "type": "application/x-fmu-sharedlibrary", "source": structure.sources[name]}
        component = ET.SubElement(elements, f"{{{_SSD}}}Component", given | {"implementation": "CoSimulation"})
        _connectors(component, connectors)
    connections = ET.SubElement(system, f"{{{_SSD}}}Connections")
    for start, end in structure.connections:
        named: dict[str, str] = {}
        for prefix, (element, connector) in (("start", start), ("end", end)):
            named |= {f"{prefix}Element": element} if element else {}
            named[f"{prefix}Connector"] = connector
        ET.SubElement(connections, f"{{{_SSD}}}Connection", named)
    _units(root, structure)
    experiment = ET.SubElement(
        root, f"{{{_SSD}}}DefaultExperiment", {"startTime": "0.0", "stopTime": repr(structure.stop)}
    )
    annotations = ET.SubElement(experiment, f"{{{_SSD}}}Annotations")
    annotation = ET.SubElement(annotations, f"{{{_SSC}}}Annotation", {"type": _OURS})
    ET.SubElement(annotation, f"{{{_OURS}}}step", {"seconds": repr(structure.step)})
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _connectors(parent: ET.Element, connectors: Sequence[Connector]) -> None:
    if not connectors:  # the schema allows no empty list
        return
    listed = ET.SubElement(parent, f"{{{_SSD}}}Connectors")
    for connector in connectors:
        element = ET.SubElement(listed, f"{{{_SSD}}}Connector", {"name": connector.name, "kind": connector.kind})
        known = definition(connector.unit) is not None
        ET.SubElement(element, f"{{{_SSC}}}Real", {"unit": connector.unit} if known else {})


def _units(root: ET.Element, structure: Structure) -> None:
    everything = [*structure.connectors, *(c for listed in structure.components.values() for c in listed)]
    made = [d for d in (definition(name) for name in sorted({c.unit for c in everything})) if d is not None]
    if not made:
        return
    parent = ET.SubElement(root, f"{{{_SSD}}}Units")
    for unit in made:
        base = {symbol: str(power) for symbol, power in unit.exponents.items() if power}
        element = ET.SubElement(parent, f"{{{_SSC}}}Unit", {"name": unit.name})
        ET.SubElement(
            element, f"{{{_SSC}}}BaseUnit", base | ({"factor": repr(unit.factor)} if unit.factor != 1 else {})
        )


def read(path: str | Path) -> Structure:
    """Read a package of FMUs in one system.

    Raises:
        FlexarmError: it is not such a package, or it holds systems inside systems.
    """
    data = archive.xml(Path(path), "SystemStructure.ssd")
    try:
        root = ET.fromstring(data)
    except ET.ParseError as error:
        raise FlexarmError(f"'{path}' is not an SSP that can be read: {error}") from error
    system = root.find(f"{{{_SSD}}}System")
    if system is None:
        raise FlexarmError(f"'{path}' holds no system")
    if system.find(f"{{{_SSD}}}Elements/{{{_SSD}}}System") is not None:
        raise FlexarmError(f"'{path}' holds systems inside systems", remedy="flatten it into one system")
    listed = system.findall(f"{{{_SSD}}}Elements/{{{_SSD}}}Component")
    _check_different(path, "components", [c.get("name", "") for c in listed])
    experiment = root.find(f"{{{_SSD}}}DefaultExperiment")
    hint = root.find(f".//{{{_OURS}}}step")
    found = Structure(
        name=system.get("name", ""),
        connectors=_read_connectors(system),
        components={c.get("name", ""): _read_connectors(c) for c in listed},
        sources={c.get("name", ""): c.get("source", "") for c in listed},
        connections=tuple(
            (
                (c.get("startElement", ""), c.get("startConnector", "")),
                (c.get("endElement", ""), c.get("endConnector", "")),
            )
            for c in system.findall(f"{{{_SSD}}}Connections/{{{_SSD}}}Connection")
        ),
        stop=_time(path, experiment, "stopTime", 1.0),
        step=_time(path, hint, "seconds", 1e-3),
    )

    _check_wiring(path, found)
    return found


def _time(path: str | Path, element: ET.Element | None, key: str, default: float) -> float:
    text = element.get(key) if element is not None else None
    if text is None:
        return default
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0 < number < float("inf"):
        raise FlexarmError(
            f"'{path}' is not an SSP that can be run: its {key} is {text[:40]!r}", remedy="a time above zero, in s"
        )
    return number


def _check_different(path: str | Path, what: str, names: Sequence[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise FlexarmError(f"'{path}' has two {what} '{name[:80]}'", remedy="names must differ")
        seen.add(name)


def _check_wiring(path: str | Path, structure: Structure) -> None:
    """Names must differ, every end of a connection must exist, and every output of the system be fed."""
    for names in (
        [c.name for c in structure.connectors],
        *([c.name for c in m] for m in structure.components.values()),
    ):
        _check_different(path, "connectors", names)
    inputs = {connector.name for connector in structure.connectors if connector.kind == "input"}
    outputs = {connector.name for connector in structure.connectors if connector.kind == "output"}
    for start, end in structure.connections:
        for (element, name), own in ((start, inputs), (end, outputs)):
            known = own if not element else structure.components
            if (element or name) not in known:
                what = f"the component '{element}'" if element else f"the connector '{name}' of the system"
                raise FlexarmError(
                    f"'{path}' connects {what}, and there is none", remedy=nearest(element or name, known)
                )
    unfed = outputs - {end[1] for _, end in structure.connections if not end[0]}
    if unfed:
        raise FlexarmError(f"nothing in '{path}' feeds its output '{min(unfed)}'", remedy="connect it, or leave it out")


def _read_connectors(element: ET.Element) -> tuple[Connector, ...]:
    found = []
    for connector in element.findall(f"{{{_SSD}}}Connectors/{{{_SSD}}}Connector"):
        real = connector.find(f"{{{_SSC}}}Real")
        unit = real.get("unit", "") if real is not None else ""
        found.append(Connector(connector.get("name", ""), connector.get("kind", ""), unit))
    return tuple(found)


def describe(path: str | Path) -> tuple[tuple[str, ...], dict[str, str], float, float]:
    """Names of the system's inputs, their units, and stop time and step of its default experiment (s)."""
    found = read(path)
    inputs = [connector for connector in found.connectors if connector.kind == "input"]
    return tuple(c.name for c in inputs), {c.name: c.unit for c in inputs}, found.stop, found.step


def cosim_ssp(
    path: str | Path, stop: float, step: float = 1e-3, *, drive: Drive | None = None, extrapolated: bool = True
) -> Trace:
    """Co-simulate a package with FMPy: every FMU steps, then values are passed on.

    Args:
        path: the package.
        stop: end (s).
        step: communication step (s).
        drive: the system's inputs in their order, piecewise constant; zero if None.
        extrapolated: between FMUs that can, values go on with their rates of change over the next step.

    Returns:
        The system's outputs at every communication point.

    Raises:
        FlexarmError: the package cannot be read, or an FMU cannot be loaded.
        SimulationError: an FMU refuses a step.
    """
    structure = read(path)
    inputs = tuple(c.name for c in structure.connectors if c.kind == "input")
    outputs = tuple(c.name for c in structure.connectors if c.kind == "output")
    if not outputs:
        raise FlexarmError(
            f"the system in '{path}' has no outputs of its own",
            remedy="export it without --bare, which is for other tools",
        )
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        archive.unpack(Path(path), Path(folder))
        hosts: dict[str, Host] = {}
        for name, source in structure.sources.items():
            file = (Path(folder) / source).resolve()
            if not file.is_relative_to(Path(folder).resolve()):
                raise FlexarmError(f"component '{name}' lies outside of the package: {source}")
            hosts[name] = stack.enter_context(host(file, name))
        values: dict[End, float] = {}
        sent: dict[
            str, list[str]
        ] = {}  # all that a part sends is asked of it at once, since it lives in another process
        for (part, variable), _ in structure.connections:
            if part and variable not in sent.setdefault(part, []):
                sent[part].append(variable)

        def exchange(time: float) -> None:
            row = present(drive, len(inputs), time)[0]
            values.update({("", name): float(value) for name, value in zip(inputs, row, strict=True)})
            for _ in range(_PASSES):
                for part, names in sent.items():
                    found = hosts[part].get(names)
                    values.update({(part, name): value for name, value in zip(names, found, strict=True)})
                for start, end in structure.connections:
                    values[end] = values[start]
                    if end[0]:
                        hosts[end[0]].set([end[1]], [values[end]])

        def extrapolate() -> None:
            for _ in range(_PASSES):
                for start, end in structure.connections:
                    if start[0] and end[0] and hosts[start[0]].gives_rates and hosts[end[0]].takes_rates:
                        rate = hosts[start[0]].rate(start[1])
                        hosts[end[0]].set([end[1]], [values[end]], [rate])

        with ExitStack() as starting:
            for instance in hosts.values():
                starting.enter_context(instance.starting(0.0, stop))
            exchange(0.0)
        times, rows = [0.0], [[values[("", name)] for name in outputs]]
        for begin, end in points(stop, step):
            if extrapolated:
                extrapolate()
            for instance in hosts.values():
                instance.step(begin, end - begin)
            exchange(end)
            times.append(end)
            rows.append([values[("", name)] for name in outputs])
    return Trace(np.array(times), np.array(rows).reshape(len(times), -1), outputs)
