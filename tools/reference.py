"""The reference pages of the documentation, written from what the code declares; called while the docs are built.

`pages` gives Markdown by path: the blocks of each family, the command line, the Python API and the scenario file.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from engine.block import Block

FAMILIES = {
    "sources": "Sources: what drives a model",
    "actuators": "Drives, friction, contacts and springs",
    "links": "Links and inertias",
    "controllers": "Controllers and signal laws",
    "sensors": "Sensors",
    "fmu": "Other people's models",
}
"""Package of blocks: its title."""

SECTIONS = ("Args", "Returns", "Raises", "Yields", "Attributes")
PIECES = re.compile(r"(`+[^`]*`+)")
ENTRY = re.compile(r"^([\w*., ]+?)( \([^)]*\))?: (.*)$")


def pages() -> dict[str, str]:
    """Every reference page: path below ``docs`` and Markdown."""
    made = {"reference/blocks/index.md": _index()}
    made |= {f"reference/blocks/{family}.md": _family(family) for family in _families()}
    made["reference/cli.md"] = cli_page()
    made["reference/api.md"] = api_page()
    made["reference/effects.md"] = effects_page()
    made["reference/scenario.md"] = scenario_page()
    return made


# -- Markdown ----------------------------------------------------------------------------------------------------------


def prose(text: str) -> str:
    """Plain text with ``code`` in it as Markdown: signs that Markdown reads as its own are kept as they are."""
    lines = []
    for line in text.splitlines():
        parts = PIECES.split(line)
        parts[::2] = [re.sub(r"([*_|\[\]])", r"\\\1", part).replace("<", "&lt;") for part in parts[::2]]
        lines.append(line if line.startswith("    ") else "".join(parts))
    return "\n".join(lines)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; cells are Markdown already."""
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(cell.replace("\n", " ") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def code(text: object) -> str:
    """Text as code; empty if there is none. The bar between choices does not end a cell of a table."""
    shown = str(text)
    return f"`{shown}`" if shown and "|" not in shown else " or ".join(f"`{s.strip()}`" for s in shown.split("|") if s)


def google(text: str) -> str:
    """A docstring of the Google convention as Markdown: its sections as lists."""
    made: list[str] = []
    listed = named = False
    for line in inspect.cleandoc(text).splitlines():
        name = line[:-1] if line.endswith(":") else ""
        if name in SECTIONS:
            made += ["", f"**{name}**", ""]
            listed, named = True, name in ("Args", "Attributes", "Raises")
        elif listed and line.startswith("    ") and not line.startswith("     "):
            entry = ENTRY.match(line.strip())
            if entry and named:
                made.append(f"* `{entry[1]}`: {prose(entry[3])}")
            else:
                made.append(("* " if not made[-1] else "  ") + prose(line.strip()))
        elif listed and line.startswith("     "):
            made.append("  " + prose(line.strip()))
        else:
            listed = listed and not line
            made.append(prose(line))
    return re.sub(r"\n{3,}", "\n\n", re.sub(r"::\n", ":\n", "\n".join(made))).strip()


# -- blocks ------------------------------------------------------------------------------------------------------------


def _family_of(cls: type[Block]) -> str:
    parts = cls.__module__.split(".")
    return parts[1] if parts[0] == "blocks" else parts[0]


def _families() -> dict[str, dict[str, type[Block]]]:
    """Blocks by family and name; those of other packages that happen to be installed are left out."""
    from blocks.registry import registry

    found: dict[str, dict[str, type[Block]]] = {family: {} for family in FAMILIES}
    for name, cls in sorted(registry().items()):
        if _family_of(cls) in found:
            found[_family_of(cls)][name] = cls
    return found


def _index() -> str:
    parts = [
        "# Blocks",
        "",
        "Written from the declarations of the blocks themselves, by the build of these pages; `flexarm blocks NAME` "
        "prints the same. The tolerance of a parameter says how far a fit may move it, where the scenario says nothing "
        "else.",
    ]
    for family, members in _families().items():
        rows = [[f"[{name}]({family}.md#{name.lower()})", prose(cls.summary())] for name, cls in members.items()]
        parts += ["", f"## {FAMILIES[family]}", "", table(["block", "what it is"], rows)]
    return "\n".join(parts) + "\n"


def _family(family: str) -> str:
    parts = [f"# {FAMILIES[family]}"]
    for name, cls in _families()[family].items():
        parts += ["", f"## {name}", "", block(cls)]
    return "\n".join(parts) + "\n"


def block(cls: type[Block]) -> str:
    """A block's law, parameters, options and connectors."""
    summary, _, rest = inspect.cleandoc(cls.__doc__ or "").partition("\n")
    parts = [f"**{prose(summary)}**", "", prose(rest.strip())]
    if cls.parameters:
        rows = []
        for key, made in cls.parameters.items():
            value = made.default
            default = (
                "required"
                if made.required
                else f"{value:g}"
                if isinstance(value, int | float)
                else f"as {code(str(value).replace(' or ', '|'))}"
            )
            doc = prose(made.doc) + (f" (one per `{made.size}`, or one for all)" if made.size else "")
            tolerance = "" if made.tolerance is None else f"{100 * made.tolerance:g} %"
            unit = "any" if made.unit == "*" else made.unit
            rows.append([code(key), unit, default, prose(made.limits), tolerance, doc])
        parts += ["", table(["parameter", "unit", "default", "bounds", "tolerance", "meaning"], rows)]
    if cls.options:
        kinds = {int: "whole number", bool: "true or false", str: "text", list: "matrix"}
        rows = []
        for key, choice in cls.options.items():
            shown = str(choice.default).lower() if choice.kind is bool else str(choice.default)
            default = "required" if choice.required else "none" if choice.default in ("", ()) else shown
            doc = prose(choice.doc) + (f" (one per `{choice.size}`, or one for all)" if choice.size else "")
            allowed = ", ".join(code(c) for c in choice.choices) or kinds[choice.kind]
            rows.append([code(key), allowed, default, doc])
        parts += ["", table(["option", "allowed", "default", "meaning"], rows)]
    rows = []
    for port in cls.ports.values():
        kind = f"{port.kind} flange" if port.role == "flange" else f"{port.role} signal"
        unit = "" if port.role == "flange" else "any" if port.unit == "*" else port.unit
        doc = prose(port.doc) + (f" ({port.default:g} if not connected)" if port.default is not None else "")
        rows.append([code(port.name), kind, unit, doc])
    return "\n".join([*parts, "", table(["connector", "kind", "unit", "meaning"], rows)])


# -- command line ------------------------------------------------------------------------------------------------------


def cli_page() -> str:
    """Every command with its arguments and options."""
    from flexarm.cli import app

    parts = [
        "# Command line",
        "",
        "Written from the commands themselves; `flexarm COMMAND --help` prints the same. Exit code 0: done. 1: a "
        "problem with what was given, explained on stderr. 2: wrong usage.",
    ]
    for command in app.registered_commands:
        called: Any = command.callback
        name = command.name or called.__name__.replace("_", "-")
        words, rows = [], []
        for key, argument in inspect.signature(called, eval_str=True).parameters.items():
            word, row = _argument_or_option(key, argument)
            words += [word] if word else []
            rows.append(row)
        parts += ["", f"## {name}", "", prose(inspect.cleandoc(command.help or called.__doc__ or "")), ""]
        parts += [f"    flexarm {' '.join([name, *words])} [OPTIONS]", "", table(["", "value", "meaning"], rows)]
    return "\n".join(parts) + "\n"


def _argument_or_option(key: str, argument: inspect.Parameter) -> tuple[str, list[str]]:
    """For an argument its word on the command line, else an empty text; and the row of the table."""
    from typer.models import ArgumentInfo

    kind, info = argument.annotation.__origin__, argument.annotation.__metadata__[0]
    meaning = prose(info.help or "")
    if isinstance(info, ArgumentInfo):
        word = info.metavar or key.upper()
        return word, [f"`{word}`", "", meaning]
    # In an annotation the first name is given in the place of the default.
    given = [name for name in (info.default, *(info.param_decls or ())) if isinstance(name, str)]
    names = given or [f"--{key.replace('_', '-')}"]
    value = "" if kind is bool else code(info.metavar or getattr(kind, "__name__", "").upper())
    if kind is not bool and argument.default not in (None, argument.empty, ""):
        meaning += f" Default: `{argument.default}`."
    return "", [", ".join(f"`{name}`" for name in names), value, meaning]


# -- Python ------------------------------------------------------------------------------------------------------------


def api_page() -> str:
    """The public names of ``flexarm``."""
    import flexarm

    parts = ["# Python API", "", "Everything here is imported from `flexarm`; quantities are in SI units.", ""]
    objects = {name: getattr(flexarm, name) for name in flexarm.__all__}
    constants = {name: made for name, made in objects.items() if isinstance(made, str)}
    functions = {name: made for name, made in objects.items() if not inspect.isclass(made) and name not in constants}
    for title, group in (
        ("Functions", functions),
        ("Classes", {n: o for n, o in objects.items() if inspect.isclass(o)}),
    ):
        parts += [f"## {title}", ""]
        for name, made in group.items():
            parts += [f"### {name}", "", _signature(name, made), "", google(inspect.getdoc(made) or ""), ""]
            if inspect.isclass(made):
                parts += _members(made)
    rows = [[code(name), code(repr(value)), "kind of a flange"] for name, value in constants.items()]
    parts += ["## Constants", "", table(["name", "value", "meaning"], rows), ""]
    parts += ["## Designing controllers", "", google(inspect.getdoc(flexarm.design) or ""), ""]
    for name in flexarm.design.__all__:
        made = getattr(flexarm.design, name)
        parts += [f"### design.{name}", "", _signature(name, made), "", google(inspect.getdoc(made) or ""), ""]
    parts += ["## Functions for laws", "", google(inspect.getdoc(flexarm.symbolic) or ""), ""]
    laws = {name: getattr(flexarm.symbolic, name) for name in flexarm.symbolic.__all__}
    rows = [
        [
            code(f"{name}({', '.join(inspect.signature(made).parameters)})"),
            prose((inspect.getdoc(made) or "").split("\n")[0]),
        ]
        for name, made in laws.items()
        if inspect.isfunction(made)
    ]
    return "\n".join([*parts, table(["function", "value"], rows), ""])


def effects_page() -> str:
    """The public names of ``flexarm.effects``, for authors of effects."""
    from flexarm import effects

    parts = [
        "# Effects for `flexarm diagnose`",
        "",
        "What authors of effects need, imported from `flexarm.effects`; quantities are in SI units. "
        "[Register an effect](../how-to/register-an-effect.md) goes through one.",
        "",
    ]
    objects = {name: getattr(effects, name) for name in effects.__all__}
    kinds = [code(name) for name, value in objects.items() if isinstance(value, str) and name != "NAME"]
    parts.append(f"The kinds of places are the constants {', '.join(kinds)}.")
    for name, made in objects.items():
        if inspect.isfunction(made) or isinstance(made, type):
            parts += ["", f"## {name}", "", _signature(name, made), "", google(inspect.getdoc(made) or ""), ""]
        if isinstance(made, type):
            parts += _members(made)
    return "\n".join(parts)


def _signature(name: str, made: Callable[..., Any]) -> str:
    try:
        text = str(inspect.signature(made))
    except (TypeError, ValueError):
        text = "(...)"
    if inspect.isclass(made):
        text = re.sub(r" -> None$", "", text)
    text = re.sub(r"<object object at 0x[0-9a-f]+>", "...", text)
    line = f"{name}{text}"
    if len(line) > 100:
        inner = inspect.signature(made)
        rows = [f"    {_argument(p)}," for p in inner.parameters.values()]
        keyword = next(
            (i for i, p in enumerate(inner.parameters.values()) if p.kind is inspect.Parameter.KEYWORD_ONLY), None
        )
        if keyword is not None and not any(p.kind is p.VAR_POSITIONAL for p in inner.parameters.values()):
            rows.insert(keyword, "    *,")
        back = inner.return_annotation
        end = "" if back is inspect.Signature.empty or inspect.isclass(made) else f" -> {back}"
        line = "\n".join([f"{name}(", *rows, f"){end}"])
    return f"```python\n{line}\n```"


def _argument(parameter: inspect.Parameter) -> str:
    several = "*" if parameter.kind is parameter.VAR_POSITIONAL else ""
    text = f"{'**' if parameter.kind is parameter.VAR_KEYWORD else several}{parameter.name}"
    if parameter.annotation is not parameter.empty:
        text += f": {parameter.annotation!s}"
    return text if parameter.default is parameter.empty else f"{text} = {parameter.default!r}"


def _members(cls: type) -> list[str]:
    """Public methods and properties of a class, with their documentation."""
    rows = []
    for name, made in vars(cls).items():
        plain: Any = made.__func__ if isinstance(made, classmethod | staticmethod) else made
        plain = plain.fget if isinstance(plain, property) else plain
        text = inspect.getdoc(plain) if inspect.isfunction(plain) else None
        if name.startswith("_") or not text:
            continue
        head = f"`{name}`" if isinstance(made, property) else f"`{name}{_short(plain)}`"
        first, _, rest = text.partition("\n")
        body = google(rest) if rest.strip() else ""
        rows += [f"#### {head}", "", prose(first), "", body, ""]
    return rows


def _short(function: Callable[..., Any]) -> str:
    """Names of the arguments, without types."""
    found = inspect.signature(function).parameters.values()
    shown = [
        p.name if p.default is p.empty else f"{p.name}={p.default!r}" for p in found if p.name not in ("self", "cls")
    ]
    return f"({', '.join(shown)})"


# -- scenario files ----------------------------------------------------------------------------------------------------


def scenario_page() -> str:
    """Every key of a scenario file, from the JSON Schema."""
    from scenarios.jsonschema import json_schema

    schema = json_schema()
    parts = [
        "# Scenario file",
        "",
        "YAML 1.2. A value is a number in SI units, a text with a unit such as `7.68 mN.m/A`, or `$name` for one of "
        "the scenario's parameters; `--set block.key=value` changes it. Written from the JSON Schema that `flexarm "
        "schema` prints ([for editors](../how-to/editor.md)); blocks have [pages of their own](blocks/index.md).",
        "",
        _keys(schema),
    ]
    for name, made in schema["$defs"].items():
        if not name.startswith("block ") and made.get("properties") and name != "BlockEntry":
            parts += ["", f"## {name}", "", prose(made.get("description", "")), "", _keys(made)]
    return "\n".join(parts) + "\n"


def _keys(made: dict[str, Any]) -> str:
    required = made.get("required", ())
    rows = []
    for key, described in made["properties"].items():
        default = described.get("default")
        shown = "required" if key in required else "" if default in (None, {}, []) else code(_yaml(default))
        rows.append([code(key), _kind(described), shown, prose(described.get("description", ""))])
    return table(["key", "value", "default", "meaning"], rows)


def _yaml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _kind(described: dict[str, Any]) -> str:
    """What a key holds, in a word or two."""
    if "$ref" in described:
        name = described["$ref"].rsplit("/", 1)[-1]
        return "a [block](blocks/index.md)" if name == "BlockEntry" else f"[{name}](#{name.lower()})"
    if "const" in described:
        return code(described["const"])
    if "enum" in described:
        return " or ".join(code(item) for item in described["enum"])
    options = described.get("anyOf") or described.get("oneOf")
    if options:
        kinds = list(dict.fromkeys(_kind(o) for o in options if o.get("type") != "null"))
        return "quantity" if kinds == ["number", "quantity"] else " or ".join(kinds)
    kind = described.get("type", "")
    if kind == "array":
        return f"list of {_kind(described['items'])}" if isinstance(described.get("items"), dict) else "list"
    if kind == "object":
        inner = described.get("additionalProperties")
        return f"names with {_kind(inner)} each" if isinstance(inner, dict) else "names and values"
    if kind == "string" and "pattern" in described and "0-9_" in described["pattern"]:
        return "quantity"
    return {"string": "text", "integer": "whole number", "boolean": "true or false"}.get(kind, kind or "any")
