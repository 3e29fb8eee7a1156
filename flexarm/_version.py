"""The version of the installed distribution."""

from __future__ import annotations


def version() -> str:
    """Version of the installed distribution; ``0+source`` where only the source is there."""
    from importlib import metadata

    try:
        return metadata.version("flexarm")
    except metadata.PackageNotFoundError:
        return "0+source"
