"""``flexarm blocks [NAME]``: the library."""

from __future__ import annotations

from typing import Annotated

import typer

from engine.errors import FlexarmError
from flexarm.console import completion


def blocks(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A block.", autocompletion=completion.blocks)
    ] = None,
) -> None:
    """List the blocks, or show one: its law, parameters and connectors."""
    from blocks.registry import find, registry
    from flexarm.console.text import block_page, columns

    if name is not None:
        alike = [key for key in sorted(registry()) if name.lower() in key.lower()]
        if alike and name not in alike:
            raise FlexarmError(f"there is no block type '{name}'", remedy=f"with it in the name: {', '.join(alike)}")
        typer.echo(block_page(name, find(name)))
        return
    typer.echo(columns(["block", "what it is"], [[key, cls.summary()] for key, cls in sorted(registry().items())]))
