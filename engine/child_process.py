"""A part of flexarm in a process of its own, which may die: what is not trusted runs there."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from engine.errors import FlexarmError


def python_command(statement: str) -> list[str]:
    """The command that runs a statement with this interpreter, and the current folder kept out of its path.

    Raises:
        FlexarmError: no interpreter is found.
    """
    # In the current folder any file could pass itself off as a module.
    return [python_program(), "-P", "-c", statement]


def environment() -> dict[str, str]:
    """The environment of this process, with its own path of modules."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(str(Path(entry).resolve()) for entry in sys.path if entry)}


def ending(code: int) -> str:
    """How a process ended, in words, from its return code."""
    if code >= 0:
        return f"with exit code {code}"
    with suppress(ValueError):
        name = signal.Signals(-code).name
        return f"by {name} ({(signal.strsignal(-code) or '').lower()})"
    return f"by signal {-code}"


def python_program() -> str:
    """This interpreter; inside of another program that embeds Python, the one that belongs to its library.

    Raises:
        FlexarmError: there is none.
    """
    for found in (Path(sys.executable or "."), *(Path(sys.prefix) / name for name in ("bin/python3", "python.exe"))):
        if found.is_file() and found.stem.lower().startswith("python"):
            return str(found)
    raise FlexarmError("no Python is found in which a file could be read", remedy=f"there is none in '{sys.prefix}'")
