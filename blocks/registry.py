"""Every block by its type name: those of flexarm, and those that other packages register.

A package adds blocks by the entry point group ``flexarm.blocks``; the name is the type name in scenario files::

    [project.entry-points."flexarm.blocks"]
    HarmonicDrive = "my_package.drives:HarmonicDrive"
"""

from __future__ import annotations

import functools
import importlib
import warnings
from importlib.metadata import EntryPoint, entry_points

from blocks.shipped import SHIPPED
from engine.block import Block
from engine.errors import ParameterError, nearest

GROUP = "flexarm.blocks"

_REPLACED = {
    "FeedForward": "use RigidFeedForward (masses: 1), TwoMassFeedForward (masses: 2) or ThreeMassFeedForward "
    "(masses: 3) without the key 'masses'; for masses: 0 give any of them active: false",
}
"""Type names of earlier versions: what to write now."""

_MODULES = {name: module for module, names in SHIPPED.items() for name in names.split()}
"""Type name -> module below `blocks`."""


@functools.cache
def registry() -> dict[str, type[Block]]:
    """Type name -> class of every block, shipped ones first; modules are imported at the first call.

    A registered block that cannot be imported, is not a `Block`, or takes a name in use is left out with a warning.
    """
    found = {name: _shipped(name) for name in _MODULES}
    for entry in entry_points(group=GROUP):
        problem = _add(found, entry)
        if problem:
            warnings.warn(f"block '{entry.name}' ({entry.value}) is not available: {problem}", stacklevel=2)
    return found


def _add(found: dict[str, type[Block]], entry: EntryPoint) -> str:
    """Add a registered block; the reason why not, if it cannot be."""
    if entry.name in found:
        return "the name is in use"
    try:
        loaded = entry.load()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if not (isinstance(loaded, type) and issubclass(loaded, Block)):
        return "it is not a subclass of engine.block.Block"
    found[entry.name] = loaded
    return ""


def _shipped(name: str) -> type[Block]:
    made: type[Block] = getattr(importlib.import_module(f"blocks.{_MODULES[name]}"), name)
    return made


def find(name: str) -> type[Block]:
    """The block of a type name.

    Of a shipped block only its module is imported. The whole registry would take a seventh of ``flexarm run``: it
    imports the library and looks through what is installed for blocks of other packages, none of which can have a
    shipped block's name.

    Raises:
        ParameterError: there is none; the message names the nearest.
    """
    if name in _MODULES:
        return _shipped(name)
    try:
        return registry()[name]
    except KeyError:
        remedy = _REPLACED.get(name) or nearest(name, registry())
        if remedy.endswith(" more"):
            remedy += "; 'flexarm blocks' says what each is"
        raise ParameterError(f"there is no block type '{name}'", remedy=remedy) from None
