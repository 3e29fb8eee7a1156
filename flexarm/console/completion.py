"""What the shell offers when Tab is pressed: scenarios, keys of ``--set``, blocks. Nothing is raised or printed."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import typer

Offer = tuple[str, str]
"""A word and what it means; shells that show no meanings leave it out."""


def scenarios(incomplete: str) -> list[str]:
    """Shipped scenarios by name, then scenario files and folders where the path begun so far leads."""
    import importlib.util

    found: list[str] = []
    with contextlib.suppress(Exception):
        if "/" not in incomplete:
            # Found without importing the package, whose imports would be felt at the prompt.
            places = importlib.util.find_spec("scenarios")
            for place in (places.submodule_search_locations or []) if places else []:
                found += sorted(path.stem for path in Path(place).glob("*.yaml"))
        parent, _, _ = incomplete.rpartition("/")
        folder = Path(parent or ("/" if incomplete.startswith("/") else "."))
        for path in sorted(folder.expanduser().iterdir()):
            shown = f"{parent}/{path.name}" if "/" in incomplete else path.name
            if path.name.startswith("."):
                continue
            if path.is_dir():
                found.append(f"{shown}/")
            elif path.suffix in (".yaml", ".yml"):
                found.append(shown)
    return [name for name in found if name.startswith(incomplete)]


def keys(context: typer.Context, incomplete: str) -> list[Offer]:
    """Keys that ``--set`` and ``--vary`` take in the scenario given before, with unit and meaning."""
    # An option without its value ends the parsing, and leaves the words before it in `args`.
    scenario = context.params.get("scenario") or next(iter(context.args), None)
    if not scenario or "=" in incomplete or "~" in incomplete:
        return []
    offers: list[Offer] = []
    with contextlib.suppress(Exception), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        offers = list(_keys(scenario))
    return [offer for offer in offers if offer[0].startswith(incomplete)]


def _keys(scenario: str) -> Iterator[Offer]:
    from scenarios.load import load

    loaded = load(scenario)
    for name in loaded.file.parameters:
        yield name, "parameter of the scenario"
    for name, block in loaded.system.blocks.items():
        for key, declared in type(block).parameters.items():
            yield f"{name}.{key}", f"{declared.doc}{'' if declared.unit in ('1', '*') else f' [{declared.unit}]'}"
        for key, option in type(block).options.items():
            yield f"{name}.{key}", option.doc
    for key in ("stop", "step", "internal_step"):
        yield f"simulate.{key}", "time [s]"


def blocks(incomplete: str) -> list[Offer]:
    """Blocks of the library, with what they are."""
    found: list[Offer] = []
    with contextlib.suppress(Exception):
        from blocks.registry import registry

        found = [(name, made.summary()) for name, made in sorted(registry().items())]
    return [offer for offer in found if offer[0].lower().startswith(incomplete.lower())]
