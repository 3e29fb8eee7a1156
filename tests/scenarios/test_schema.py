"""The JSON Schema tells an editor what every key means and in which unit it is."""

from __future__ import annotations

import pytest

from blocks.registry import registry
from engine.quantity import SameAs
from scenarios.jsonschema import json_schema

SCHEMA = json_schema()


def test_every_key_says_what_it_means() -> None:
    silent = [
        f"{section}.{key}"
        for section, made in [("", SCHEMA), *SCHEMA["$defs"].items()]
        for key, described in made.get("properties", {}).items()
        if not str(described.get("description", "")).strip()
    ]
    assert silent == []


@pytest.mark.parametrize("name", sorted(registry()))
def test_a_block_shows_its_declarations(name: str) -> None:
    """Meaning, unit, default and tolerance of each parameter; an unknown key is marked."""
    cls, made = registry()[name], SCHEMA["$defs"][f"block {name}"]
    assert made["description"] == cls.summary()
    # An FMU in a file brings parameters of its own, numbers and quantities.
    further = made["additionalProperties"]
    assert further is False if name != "FMU" else further["anyOf"][0] == {"type": "number"}
    assert set(made["properties"]) == {"type", *cls.parameters, *cls.options}
    for key, declared in cls.parameters.items():
        shown = made["properties"][key]
        assert shown["description"].startswith(declared.doc)
        assert shown["x-unit"] == declared.unit
        assert declared.unit == "1" or f"[{declared.unit}]" in shown["description"]
        assert shown.get("x-tolerance") == declared.tolerance
        assert declared.required == (key in made["required"])
        if not declared.required and not isinstance(declared.default, SameAs):
            assert "default" in shown
