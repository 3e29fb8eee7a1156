"""``flexarm schema``: the JSON Schema of scenario files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def schema(
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write it to a file.")] = None,
) -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from engine.files import writing
    from scenarios.jsonschema import json_schema

    text = json.dumps(json_schema(), indent=2)
    if output is None:
        typer.echo(text)
        return
    with writing(output, (".json",)) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    typer.echo(f"written: {output}")
