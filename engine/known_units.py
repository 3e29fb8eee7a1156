"""What pint said of units, kept from one process to the next: importing it and its definitions takes longer than a run.

A file in the cache folder (`engine.cache`) holds answers as JSON, which gives every number back bit by bit. It belongs
to one version of pint and of `engine.quantity`. Errors are not kept, and without a folder to write to nothing is.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

from engine import cache
from engine.errors import CompilerUnavailable

MOST = 5000
"""Answers that are kept."""

P = ParamSpec("P")
T = TypeVar("T")


def known(function: Callable[P, T]) -> Callable[P, T]:
    """Ask the file before the function, and remember what the function says: numbers, texts, lists of them.

    Answers that are lists come back as tuples.
    """
    name = function.__name__

    @functools.cache
    def asked(*texts: str) -> Any:
        key = json.dumps([name, *texts])
        if key in _answers():
            return _thawed(_answers()[key])
        answer = function(*texts)  # type: ignore[call-arg, arg-type]
        if len(_answers()) < MOST:
            _answers()[key] = answer
            _new[key] = answer
        return answer

    return cast("Callable[P, T]", functools.wraps(function)(asked))


def _thawed(value: Any) -> Any:
    return tuple(_thawed(item) for item in value) if isinstance(value, list) else value


_new: dict[str, Any] = {}
"""Answers that the file does not have yet."""


@functools.cache
def _answers() -> dict[str, Any]:
    path = _file()
    atexit.register(write)
    return _read(path) if path is not None else {}


@functools.cache
def _file() -> Path | None:
    from importlib.metadata import PackageNotFoundError, version

    try:
        source = Path(__file__).with_name("quantity.py").read_bytes()
        what = hashlib.sha256(version("pint").encode() + source).hexdigest()[:16]
        return cache.folder() / f"units-{what}.json"
    except (CompilerUnavailable, OSError, PackageNotFoundError):
        return None


def _read(path: Path) -> dict[str, Any]:
    content = cache.opened(path)
    if content is None:
        return {}
    try:
        found = json.loads(content)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def write() -> None:
    """Put new answers into the file, beside those that others wrote meanwhile."""
    path = _file()
    if not _new or path is None:
        return
    whole = _read(path) | _new
    _new.clear()
    with contextlib.suppress(OSError):
        cache.put(path, json.dumps(whole, sort_keys=True).encode())
