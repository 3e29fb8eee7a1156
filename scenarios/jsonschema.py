"""JSON Schema of scenario files, for editors: the fixed structure and every known block's parameters."""

from __future__ import annotations

from typing import Any

from engine.block import Block
from engine.quantity import Option, Parameter, SameAs
from scenarios.schema import ASSEMBLY_PATTERN, EXPRESSION_PATTERN, QUANTITY_PATTERN, ScenarioFile

REFERENCE = rf"^({EXPRESSION_PATTERN})$"


def json_schema() -> dict[str, Any]:
    """The schema (draft 2020-12) of a scenario file; each ``type`` of block brings its own parameters."""
    from blocks.registry import registry

    schema = ScenarioFile.model_json_schema(by_alias=True)
    blocks = registry()
    definitions = schema["$defs"]
    definitions["Assembly"] = {
        "type": "object",
        "description": "a sub-assembly: another scenario file, with changes to its parameters",
        "properties": {
            "type": {"type": "string", "pattern": ASSEMBLY_PATTERN, "description": "path of the other file"},
            "parameters": {"type": "object", "description": "values of the sub-assembly's own parameters"},
        },
        "required": ["type"],
        "additionalProperties": True,
    }
    names: list[str] = []
    for name in sorted(blocks):
        definitions[f"block {name}"] = _block(name, blocks[name])
        names.append(f"block {name}")
    known = {"properties": {"type": {"enum": sorted(blocks)}}, "required": ["type"]}
    definitions["BlockEntry"] = {
        "type": "object",
        "required": ["type"],
        "properties": {
            "type": {
                "anyOf": [{"enum": sorted(blocks)}, {"type": "string", "pattern": ASSEMBLY_PATTERN}],
                "description": "name of a block, or path of another scenario file",
            },
        },
        "if": known,
        "then": {"oneOf": [{"$ref": f"#/$defs/{_pointer(name)}"} for name in names]},
        "else": {"$ref": "#/$defs/Assembly"},
    }
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "flexarm scenario"
    return schema


def _pointer(name: str) -> str:
    return name.replace("~", "~0").replace("/", "~1").replace(" ", "%20")


def _block(name: str, cls: type[Block]) -> dict[str, Any]:
    declared: dict[str, Parameter | Option] = {**cls.parameters, **cls.options}
    required = ["type", *[key for key, made in declared.items() if made.required]]
    properties: dict[str, Any] = {"type": {"const": name, "description": cls.summary()}}
    for key, made in declared.items():
        properties[key] = _parameter(made) if isinstance(made, Parameter) else _option(made)
    # Of an FMU in a file the schema does not know the parameters.
    own = "further_parameters" in {key for base in cls.__mro__[:-1] for key in vars(base) if base is not Block}
    further = {"anyOf": [{"type": "number"}, {"type": "string", "pattern": QUANTITY_PATTERN}]}
    return {
        "type": "object",
        "description": cls.summary(),
        "properties": properties,
        "required": required,
        "additionalProperties": further if own else False,
    }


def _parameter(made: Parameter) -> dict[str, Any]:
    bounds: dict[str, Any] = {
        keyword: bound
        for keyword, bound in (
            ("exclusiveMinimum", made.gt),
            ("minimum", made.ge),
            ("exclusiveMaximum", made.lt),
            ("maximum", made.le),
        )
        if bound is not None
    }
    if made.nonzero:
        bounds["not"] = {"const": 0}
    single: list[dict[str, Any]] = [{"type": "number", **bounds}, {"type": "string", "pattern": QUANTITY_PATTERN}]
    if made.size:
        single.append({"type": "array", "items": {"anyOf": list(single)}, "description": f"one per {made.size}"})
    unit = "" if made.unit == "1" else f" [{made.unit}]"
    described: dict[str, Any] = {"anyOf": single, "description": f"{made.doc}{unit}", "x-unit": made.unit}
    if isinstance(made.default, SameAs):
        described["description"] += f"; that of {made.default} if absent"
    elif not made.required:
        described["default"] = list(made.default) if isinstance(made.default, tuple) else made.default
    if made.tolerance is not None:
        described["x-tolerance"] = made.tolerance
    return described


def _option(made: Option) -> dict[str, Any]:
    kinds = {int: "integer", bool: "boolean", str: "string", list: "array"}
    own: dict[str, Any] = {"type": kinds[made.kind]}
    if made.kind is list:
        number = {"anyOf": [{"type": "number"}, {"type": "string", "pattern": REFERENCE}]}
        row = {"type": "array", "items": number, "minItems": 1}
        own = {"anyOf": [number, row, {"type": "array", "items": row}]}
    if made.choices:
        own["enum"] = list(made.choices)
    if made.ge is not None:
        own["minimum"] = made.ge
    if made.le is not None:
        own["maximum"] = made.le
    described: dict[str, Any] = {"description": made.doc}
    single = [own] if made.kind is str else [own, {"type": "string", "pattern": REFERENCE}]
    if made.size:
        single.append({"type": "array", "items": {"anyOf": list(single)}, "description": f"one per {made.size}"})
    described |= own if len(single) == 1 else {"anyOf": single}
    if not made.required:
        described["default"] = made.default
    return described
