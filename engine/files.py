"""Write files atomically: each is written under a temporary name beside its target and then renamed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from engine.errors import FlexarmError


def check_suffix(path: Path, allowed: Sequence[str]) -> None:
    """Refuse a file name of a kind that cannot be written, or in a folder that does not exist.

    Raises:
        FlexarmError: the name is refused; nothing has been computed yet.
    """
    if path.suffix.lower() not in allowed:
        raise FlexarmError(f"'{path}' is of no kind that can be written here", remedy=f"end it in {', '.join(allowed)}")
    if not path.parent.is_dir():
        raise FlexarmError(f"there is no folder '{path.parent}'", remedy="make it first, or write somewhere else")
    if path.is_dir():
        raise FlexarmError(f"'{path}' is a folder", remedy="give a file name")


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
