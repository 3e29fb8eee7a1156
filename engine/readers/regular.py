"""Opening a file that somebody else named: a regular file of bounded size, no pipe and no device."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from engine.errors import FlexarmError, Where

LONGEST_NAME = 60
"""Characters of a foreign file's column name that a message repeats."""
_PIECE = 1 << 24


class FileProblem(FlexarmError):
    """A file of data cannot be read. Its messages repeat nothing of the file but names of columns."""


def problem(path: Path, message: str, remedy: str = "", line: int = 0) -> FileProblem:
    """A problem with a file, at a line of it if one is to blame."""
    return FileProblem(message, Where(str(path), line), remedy)


def shown(name: str) -> str:
    """A column's name for a message, cut if it is long."""
    return name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}..."


def opened(path: Path, largest: float, remedy: str = "save a part of it") -> BinaryIO:
    """A regular file, open for reading.

    A pipe would wait for its writer, and a device may have no end, so that neither is opened.

    Args:
        path: the file.
        largest: bytes that it may hold.
        remedy: what to do about a larger one.

    Raises:
        FileProblem: no such file, no regular file, too large, or not readable.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise problem(path, "this is no regular file", "name a file, no folder, pipe or device")
        # A pipe put there since then does not block the opening, and the check below meets it.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except ValueError:
        raise problem(Path(repr(str(path))[1:-1]), "a file name holds no NUL", "check the name") from None
    except OSError as error:
        raise problem(path, f"cannot read the file: {error.strerror or error}", "check the path") from None
    file = os.fdopen(handle, "rb")
    found = os.fstat(handle)
    if not stat.S_ISREG(found.st_mode):
        file.close()
        raise problem(path, "this is no regular file", "name a file, no folder, pipe or device")
    if found.st_size > largest:
        file.close()
        raise problem(
            path, f"the file holds {found.st_size / 1e6:.1f} MB; at most {largest / 1e6:g} MB are read", remedy
        )
    return file


def content(path: Path, largest: int, remedy: str = "save a part of it") -> bytes:
    """The bytes of a regular file; see `opened`. A file that grows meanwhile is refused like a large one."""
    read = bytearray()
    with opened(path, largest, remedy) as file:
        try:
            while piece := file.read(_PIECE):
                read += piece
                if len(read) > largest:
                    raise problem(path, f"the file holds more than {largest / 1e6:g} MB", remedy)
        except OSError as error:
            raise problem(path, f"cannot read the file: {error.strerror or error}", "check the path") from None
    return bytes(read)
