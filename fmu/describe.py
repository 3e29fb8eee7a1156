"""modelDescription.xml of an FMI 2.0 or FMI 3.0 FMU."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator

from fmu.arrays import Array
from fmu.plan import Plan
from fmu.structure import KINDS
from fmu.units import definition
from fmu.variables import (
    CLOCK,
    COORDINATE,
    DERIVATIVE,
    INDICATOR,
    INPUT,
    MEMORY,
    MODE,
    OUTPUT,
    PARAMETER,
    STATE,
    TIME_KIND,
    FmuVariable,
)

TOLERANCE = 1e-6
"""Relative tolerance that is suggested to integrators of Model Exchange."""

Dependent = list[tuple[int, list[tuple[int, str]]]]
"""Unknowns by reference, each with what it depends on: reference and kind of dependence."""

_CATEGORIES = {
    "logEvents": "what happens inside a step",
    "logStatusWarning": "warnings",
    "logStatusDiscard": "values that were refused",
    "logStatusError": "errors",
    "logAll": "everything",
}


def number(value: float) -> str:
    """A double that reads back to the same bits."""
    return repr(float(value))


def text(root: ET.Element) -> str:
    """An XML document with its declaration, indented."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def fmi2(plan: Plan, guid: str) -> str:
    """The description of an FMI 2.0 FMU.

    Args:
        plan: what is exported.
        guid: identity that binary and description share.
    """
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0",
            "modelName": plan.model.name or plan.identifier,
            "guid": guid,
            "description": plan.model.description,
            "generationTool": plan.tool,
            "variableNamingConvention": "structured",
            "numberOfEventIndicators": str(plan.model.equations.guards.numel()),
        },
    )
    both = {
        "modelIdentifier": plan.identifier,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "false",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    }
    slave = {
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "true",
        "maxOutputDerivativeOrder": "1",
        "canRunAsynchronuously": "false",
    }
    for kind, own in (("ModelExchange", {"completedIntegratorStepNotNeeded": "true"}), ("CoSimulation", slave)):
        element = ET.SubElement(root, kind, both | own)
        ET.SubElement(ET.SubElement(element, "SourceFiles"), "File", {"name": "all.c"})
    _common(root, plan)
    listed = ET.SubElement(root, "ModelVariables")
    for variable in plan.variables:
        if variable.kind != CLOCK:
            _variable(listed, variable, plan)
    _structure(ET.SubElement(root, "ModelStructure"), plan)
    return text(root)


def fmi3(plan: Plan, token: str) -> str:
    """The description of an FMI 3.0 FMU; see `fmi2`."""
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "3.0",
            "modelName": plan.model.name or plan.identifier,
            "instantiationToken": token,
            "description": plan.model.description,
            "generationTool": plan.tool,
            "variableNamingConvention": "structured",
        },
    )
    both = {
        "modelIdentifier": plan.identifier,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
        "providesAdjointDerivatives": "true",
    }
    slave = {
        "canHandleVariableCommunicationStepSize": "true",
        **({"fixedInternalStepSize": number(plan.step)} if plan.variable_step is None else {}),
        "maxOutputDerivativeOrder": "1",
        "hasEventMode": "true",
        "mightReturnEarlyFromDoStep": "true",
    }
    ET.SubElement(root, "ModelExchange", both | {"needsCompletedIntegratorStep": "false"})
    ET.SubElement(root, "CoSimulation", both | slave)
    _common(root, plan)
    listed = ET.SubElement(root, "ModelVariables")
    heads = {array.first: array for array in plan.arrays}
    shown = _heads(plan)
    for variable in plan.variables:
        if shown[variable.reference] == variable.reference:
            _variable3(listed, variable, plan, heads.get(variable.reference))
    _structure3(ET.SubElement(root, "ModelStructure"), plan)
    return text(root)


def build_description(plan: Plan) -> str:
    """``sources/buildDescription.xml`` of an FMI 3.0 FMU."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": plan.identifier})
    files = ET.SubElement(configuration, "SourceFileSet", {"language": "C11"})
    ET.SubElement(files, "SourceFile", {"name": "all.c"})
    ET.SubElement(configuration, "Library", {"name": "m", "external": "true"})
    return text(root)


def _common(root: ET.Element, plan: Plan) -> None:
    _units(root, plan)
    categories = ET.SubElement(root, "LogCategories")
    for name, meaning in _CATEGORIES.items():
        ET.SubElement(categories, "Category", {"name": name, "description": meaning})
    ET.SubElement(
        root,
        "DefaultExperiment",
        {
            "startTime": "0.0",
            "stopTime": number(plan.stop),
            "tolerance": number(TOLERANCE),
            "stepSize": number(plan.step),
        },
    )


def _units(root: ET.Element, plan: Plan) -> None:
    names = sorted({variable.unit for variable in plan.variables})
    made = [d for d in (definition(name) for name in names) if d is not None]
    if not made:
        return
    parent = ET.SubElement(root, "UnitDefinitions")
    for unit in made:
        element = ET.SubElement(parent, "Unit", {"name": unit.name})
        base = {symbol: str(power) for symbol, power in unit.exponents.items() if power}
        if unit.factor != 1.0:
            base["factor"] = number(unit.factor)
        ET.SubElement(element, "BaseUnit", base)
        for name, factor in unit.shown_as:
            ET.SubElement(element, "DisplayUnit", {"name": name, "factor": number(factor)})


_CAUSALITY = {TIME_KIND: "independent", PARAMETER: "parameter", INPUT: "input", OUTPUT: "output"}


def _role(variable: FmuVariable) -> dict[str, str]:
    """Causality, variability, initial and description, which both versions spell alike."""
    kind = variable.kind
    if kind == PARAMETER:
        variability = "tunable" if variable.tunable else "fixed"
    else:
        variability = "discrete" if kind in (MEMORY, MODE) else "continuous"
    role = {"causality": _CAUSALITY.get(kind, "local"), "variability": variability}
    if variable.doc:
        role["description"] = variable.doc
    if kind == PARAMETER or (kind in (STATE, COORDINATE) and variable.start is not None):
        role["initial"] = "exact"
    elif kind not in (TIME_KIND, INPUT):
        role["initial"] = "calculated"
    return role


def _numbers(variable: FmuVariable) -> dict[str, str]:
    """Unit, bounds, nominal and start."""
    if variable.kind == MODE:
        return {"min": "-1", "max": "1"}
    found: dict[str, str] = {}
    if variable.unit not in ("", "*"):
        found["unit"] = variable.unit
    for name, bound in (("min", variable.minimum), ("max", variable.maximum)):
        if math.isfinite(bound):
            found[name] = number(bound)
    if variable.nominal is not None:
        found["nominal"] = number(variable.nominal)
    if variable.start is not None:
        found["start"] = number(variable.start)
    return found


def _variable(parent: ET.Element, variable: FmuVariable, plan: Plan) -> None:
    named = {"name": variable.name, "valueReference": str(variable.reference)}
    element = ET.SubElement(parent, "ScalarVariable", named | _role(variable))
    typed = _numbers(variable)
    if variable.kind == DERIVATIVE:
        typed["derivative"] = str(plan.position(STATE, variable.reference - plan.first(DERIVATIVE)))
    ET.SubElement(element, "Real" if variable.is_real else "Integer", typed)


def _heads(plan: Plan) -> list[int]:
    """For each reference the one under which FMI 3 shows it: of elements, that of their array."""
    shown = list(range(len(plan.variables)))
    for array in plan.arrays:
        shown[array.first : array.first + array.size] = [array.first] * array.size
    return shown


def _array(array: Array, elements: list[FmuVariable]) -> dict[str, str]:
    """What an array has in place of its first element's attributes. The nominal value, one for all, is the smallest."""
    made = {"name": array.name, "description": "; ".join(dict.fromkeys(v.doc for v in elements if v.doc))}
    made["start"] = " ".join(number(v.start) for v in elements if v.start is not None)
    nominal = [v.nominal for v in elements if v.nominal is not None]
    made["nominal"] = number(min(nominal)) if len(nominal) == len(elements) else ""
    return made


def _variable3(parent: ET.Element, variable: FmuVariable, plan: Plan, array: Array | None) -> None:
    if variable.kind == CLOCK:
        named = {"name": variable.name, "valueReference": str(variable.reference), "description": variable.doc}
        ET.SubElement(parent, "Clock", named | {"causality": "output", "intervalVariability": "triggered"})
        return
    attributes = {"name": variable.name, "valueReference": str(variable.reference)}
    attributes |= _role(variable) | _numbers(variable)
    if variable.kind == DERIVATIVE:
        attributes["derivative"] = str(plan.first(STATE) + variable.reference - plan.first(DERIVATIVE))
    if array is not None:
        elements = plan.variables[array.first : array.first + array.size]
        attributes = {name: text for name, text in (attributes | _array(array, elements)).items() if text}
    element = ET.SubElement(parent, "Float64" if variable.is_real else "Int32", attributes)
    if array is not None:
        ET.SubElement(element, "Dimension", {"start": str(array.size)})


def _unknowns(plan: Plan) -> Iterator[tuple[str, int, list[tuple[int, str]]]]:
    """Every unknown of the running model: kind, reference, and what it depends on by reference."""
    found = plan.structure
    for kind, rows in ((OUTPUT, found.outputs), (DERIVATIVE, found.rates)):
        for k, row in enumerate(rows):
            if kind == OUTPUT and plan.model.outputs[k].name in plan.results:
                continue
            known = sorted((plan.first(STATE if what == "state" else INPUT) + j, how) for what, j, how in row)
            yield kind, plan.first(kind) + k, known


def _initial_unknowns(plan: Plan) -> Iterator[tuple[int, list[tuple[int, str]]]]:
    """The same for values at the start, which depend on inputs, parameters and the starts of states."""
    found = plan.structure
    starts = ((OUTPUT, found.initial_outputs), (STATE, found.initial_states), (DERIVATIVE, found.initial_rates))
    for kind, initial in starts:
        for k, (inputs, parameters, states) in enumerate(initial):
            if kind == OUTPUT and plan.model.outputs[k].name in plan.results:
                continue
            if kind == STATE and plan.variables[plan.first(STATE) + k].start is not None:
                continue
            known = [plan.first(PARAMETER) + j for j in parameters] + [plan.first(INPUT) + j for j in inputs]
            known += [plan.start_reference(j) for j in states if found.exact[j]]
            yield plan.first(kind) + k, [(reference, "dependent") for reference in known]


def _dependencies(known: list[tuple[int, str]], shift: int) -> dict[str, str]:
    return {
        "dependencies": " ".join(str(reference + shift) for reference, _ in known),
        "dependenciesKind": " ".join(how for _, how in known),
    }


def _structure(parent: ET.Element, plan: Plan) -> None:
    """FMI 2 counts variables from 1 in the order of their references."""
    for heading, kind in (("Outputs", OUTPUT), ("Derivatives", DERIVATIVE)):
        rows = [(reference, known) for what, reference, known in _unknowns(plan) if what == kind]
        _unknown_list(parent, heading, rows)
    _unknown_list(parent, "InitialUnknowns", list(_initial_unknowns(plan)))


def _unknown_list(parent: ET.Element, heading: str, rows: list[tuple[int, list[tuple[int, str]]]]) -> None:
    if not rows:
        return
    element = ET.SubElement(parent, heading)
    for reference, known in rows:
        ET.SubElement(element, "Unknown", {"index": str(reference + 1), **_dependencies(known, 1)})


def _structure3(parent: ET.Element, plan: Plan) -> None:
    names = {OUTPUT: "Output", DERIVATIVE: "ContinuousStateDerivative"}
    clocks: Dependent = [(variable.reference, []) for variable in plan.variables if variable.kind == CLOCK]
    shown, unknowns = _heads(plan), list(_unknowns(plan))
    for kind, further in ((OUTPUT, clocks), (DERIVATIVE, [])):
        rows = [(reference, known) for what, reference, known in unknowns if what == kind] + further
        for reference, known in _of_arrays(rows, shown):
            ET.SubElement(parent, names[kind], {"valueReference": str(reference), **_dependencies(known, 0)})
    for reference, known in _of_arrays([*_initial_unknowns(plan), *clocks], shown):
        ET.SubElement(parent, "InitialUnknown", {"valueReference": str(reference), **_dependencies(known, 0)})
    for variable in plan.variables:
        if variable.kind == INDICATOR:
            ET.SubElement(parent, "EventIndicator", {"valueReference": str(variable.reference)})


def _of_arrays(rows: Dependent, shown: list[int]) -> Dependent:
    """The rows with all elements of an array in one, whose dependence is of the least constant kind."""
    found: dict[int, dict[int, str]] = {}
    for reference, known in rows:
        merged = found.setdefault(shown[reference], {})
        for other, how in known:
            merged[shown[other]] = max(merged.get(shown[other], how), how, key=KINDS.index)
    return [(reference, list(merged.items())) for reference, merged in found.items()]
