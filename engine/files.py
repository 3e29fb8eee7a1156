"""Write files atomically: each is written under a temporary name beside its target and then renamed."""

from __future__ import annotations

import json
import math
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from engine.errors import FlexarmError
from engine.names import identifier


def check_suffix(path: Path, allowed: Sequence[str]) -> None:
    """Refuse a file name of a kind that cannot be written, or in a folder that does not exist.

    Raises:
        FlexarmError: the name is refused; nothing has been computed yet.
    """
    if path.suffix.lower() not in allowed:
        raise FlexarmError(f"'{path}' is of no kind that can be written here", remedy=f"end it in {', '.join(allowed)}")
    if path.suffix.lower() == ".m" and not re.fullmatch(r"[A-Za-z]\w*", path.stem, re.ASCII):
        raise FlexarmError(
            f"MATLAB cannot run a script that is called '{path.name}'", remedy=f"write it as {identifier(path.stem)}.m"
        )
    try:
        if not path.parent.is_dir():
            raise FlexarmError(f"there is no folder '{path.parent}'", remedy="make it first, or write somewhere else")
        if path.is_dir():
            raise FlexarmError(f"'{path}' is a folder", remedy="give a file name")
    except OSError as error:
        raise FlexarmError(f"cannot write '{path}': {error.strerror}", remedy="give another file name") from error
    if "\0" in str(path):
        raise FlexarmError(f"cannot write '{path}': a file name holds no NUL", remedy="give another file name")


def is_file(path: Path) -> bool:
    """Whether a regular file stands there; a name that no file system takes names none."""
    try:
        return path.is_file()
    except OSError:
        return False


def missing(path: Path) -> bool:
    """Whether nothing stands there; false for a name that no file system takes, which opening it explains."""
    try:
        return not path.exists()
    except OSError:
        return False


def json_text(value: Any, indent: int | None = None) -> str:
    """JSON that every reader takes: numbers that it cannot hold (NaN, infinity) as null."""
    return json.dumps(_held(value), indent=indent, allow_nan=False)


def _held(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _held(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_held(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def folder_made(folder: Path) -> Path:
    """The folder, made with those above it where it is not there.

    Raises:
        FlexarmError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FlexarmError(
            f"cannot make the folder '{folder}': {error.strerror}", remedy="remove what is there, or write elsewhere"
        ) from error
    return folder


@contextmanager
def writing(path: Path, allowed: Sequence[str]) -> Iterator[Path]:
    """A temporary file in the same folder that becomes ``path`` if the block ends well, and vanishes if not.

    Raises:
        FlexarmError: the file cannot be written.
    """
    check_suffix(path, allowed)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise FlexarmError(f"cannot write '{path}': {error.strerror}") from error
    temporary = Path(name)
    try:
        yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except OSError as error:
        raise FlexarmError(f"cannot write '{path}': {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
