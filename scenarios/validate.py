"""Checking a document against the schema, with errors that name line, key, what is allowed and the nearest name."""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from engine.errors import FlexarmError, nearest
from scenarios.document import Key, Node
from scenarios.schema import BlockEntry, ScenarioFile


class ScenarioError(FlexarmError):
    """A scenario file that cannot be simulated."""


def validate(document: Node) -> ScenarioFile:
    """The document as a checked `ScenarioFile`.

    Raises:
        ScenarioError: the first problem found, unknown keys before missing ones.
    """
    if not isinstance(document.value, dict):
        raise ScenarioError("a scenario is a mapping of sections", document.where(), "begin with 'schema: 1'")
    version = document.get("schema")
    if version is not None and version.value != 1:
        raise ScenarioError(
            f"schema {version.value!r} is not known", document.where("schema"), "this flexarm reads 'schema: 1'"
        )
    try:
        return ScenarioFile.model_validate(document.plain())
    except ValidationError as error:
        problems = sorted(error.errors(include_url=False), key=lambda found: found["type"] != "extra_forbidden")
        raise _translate(document, dict(problems[0])) from None


def _translate(document: Node, found: dict[str, Any]) -> ScenarioError:
    location, kind = tuple(found["loc"]), found["type"]
    path = _path(document, location, kind)
    where, key = document.where(*path), str(path[-1]) if path else ""
    given = document.get(*path)
    if kind == "extra_forbidden":
        return ScenarioError(f"unknown key '{key}'", where, nearest(key, _allowed(location[:-1])))
    if kind == "missing":
        remedy = _description(location)
        return ScenarioError(f"'{key}' is missing", where, f"give {key}{': ' + remedy if remedy else ''}")
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        context = found.get("ctx", {})
        expected = [tag.strip("' ") for tag in str(context.get("expected_tags", "linearise, export")).split(",")]
        tag = given.get("kind") if given else None
        if tag is None:
            return ScenarioError("'kind' is missing", where, nearest("", expected))
        return ScenarioError(
            f"unknown kind '{tag.value}'", document.where(*path, "kind"), nearest(str(tag.value), expected)
        )
    if kind == "literal_error" and given is not None:
        allowed = _literals(location)
        return ScenarioError(f"{given.plain()!r} is not allowed", where, nearest(str(given.plain()), map(str, allowed)))
    if kind == "name":
        return ScenarioError(f"'{key}' cannot be a name: {found['msg']}", where)
    shown = "" if given is None or isinstance(given.value, dict | list | None) else f"{_cut(repr(given.value))}: "
    words = {
        "dict_type": "a mapping (key: value) is expected",
        "model_type": "a mapping (key: value) is expected",
        "model_attributes_type": "a mapping (key: value) is expected",
        "list_type": "a list is expected",
        "bool_type": "true or false is expected",
        "bool_parsing": "true or false is expected",
        "too_short": "more entries are needed",
    }
    if kind == "too_short" and path and path[0] == "connect":
        return ScenarioError("a connection needs at least two ends", where, "write [block.port, block.port]")
    return ScenarioError(shown + words.get(kind, found["msg"]), where, _description(location))


def _cut(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:70]}..."


def _path(document: Node, location: Sequence[Key], kind: str) -> tuple[Key, ...]:
    """Pydantic's location, reduced to keys of the file: without the tags of unions."""
    path: list[Key] = []
    for i, key in enumerate(location):
        last = i == len(location) - 1
        if document.get(*path, key) is not None or (last and kind == "missing"):
            path.append(key)
    return tuple(path)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The pydantic models inside a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        return
    if get_origin(annotation) in (Annotated, Union, types.UnionType, dict, list):
        for argument in get_args(annotation):
            yield from _models(argument)


def _field(model: type[BaseModel], key: Key) -> Any:
    for name, field in model.model_fields.items():
        if (field.alias or name) == key:
            return field
    return None


def _follow(location: Sequence[Key]) -> tuple[type[BaseModel] | None, Any]:
    """The model and the field that a location ends in."""
    model: type[BaseModel] | None = ScenarioFile
    field: Any = None
    choices: list[type[BaseModel]] = []
    for key in location:
        named = _field(model, key) if model is not None else None
        if named is not None:
            field = named
            choices = list(_models(named.annotation))
            model = choices[0] if len(choices) == 1 else None
        elif len(choices) > 1:
            tagged = [c for c in choices if key in get_args(c.model_fields["kind"].annotation)]
            model, choices = (tagged[0], []) if tagged else (None, choices)
    return model, field


def _allowed(location: Sequence[Key]) -> list[str]:
    model, _ = _follow(location)
    if model is None or model is BlockEntry:
        return []
    return [field.alias or name for name, field in model.model_fields.items()]


def _literals(location: Sequence[Key]) -> tuple[Any, ...]:
    _, field = _follow(location)
    annotation = field.annotation if field else None
    if get_origin(annotation) in (Union, types.UnionType):  # one that may be left out
        annotation = next((a for a in get_args(annotation) if get_origin(a) is Literal), None)
    return get_args(annotation) if get_origin(annotation) is Literal else ()


def _description(location: Sequence[Key]) -> str:
    _, field = _follow(location)
    return (field.description or "") if field is not None else ""
