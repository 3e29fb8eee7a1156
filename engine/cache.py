"""Compiled code kept from one process to the next: each file ends in the length and the hash of what comes before.

A loader of libraries does not mind what follows them. What a full disk, a crash or a copy made of an entry is seen
before it is loaded or packed, and it is made again.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import stat
import tempfile
from pathlib import Path

from engine.errors import CompilerUnavailable

log = logging.getLogger("flexarm.compile")

_MARK = b"flexarm1"
_SEAL = len(_MARK) + 8 + 32


def user_folder() -> Path | None:
    """The user's cache folder; None where the system knows of no home."""
    base = os.environ.get("LOCALAPPDATA") or os.environ.get("XDG_CACHE_HOME")
    if base:
        return Path(base)
    try:
        return Path.home() / ".cache"
    except RuntimeError:
        return None


def folder() -> Path:
    """Where compiled models are kept: ``$FLEXARM_CACHE``, else the user's cache folder, else a private temporary one.

    Raises:
        CompilerUnavailable: the temporary one cannot be made, or is not ours alone.
    """
    chosen = os.environ.get("FLEXARM_CACHE")
    if chosen:
        return Path(chosen)
    user = user_folder()
    return user / "flexarm" if user else private("flexarm-cache")


def private(name: str) -> Path:
    """A folder of that name and this user in the system's temporary folder, which nobody else can write to.

    Raises:
        CompilerUnavailable: it cannot be made, or it is there and is somebody else's or open to others.
    """
    user = str(os.getuid()) if hasattr(os, "getuid") else "user"
    made = Path(tempfile.gettempdir()) / f"{name}-{user}"
    remedy = f"remove '{made}', or name a folder of your own in XDG_CACHE_HOME"
    try:
        with contextlib.suppress(FileExistsError):
            made.mkdir(mode=0o700)
        found = made.lstat()
        if not stat.S_ISDIR(found.st_mode):
            raise CompilerUnavailable(f"'{made}' is no folder", remedy=remedy)
        if hasattr(os, "getuid"):
            if found.st_uid != os.getuid():
                raise CompilerUnavailable(f"the folder '{made}' belongs to another user", remedy=remedy)
            if found.st_mode & 0o022:
                raise CompilerUnavailable(f"others may write to the folder '{made}'", remedy=remedy)
            made.chmod(0o700)
    except OSError as error:
        raise CompilerUnavailable(f"cannot make the folder '{made}': {error.strerror}", remedy=remedy) from error
    return made


def writable(path: Path) -> bool:
    """Whether files can be made in a folder, which is made if need be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            return True
    except OSError:
        return False


def sealed(content: bytes) -> bytes:
    """The content with its seal."""
    return content + _MARK + len(content).to_bytes(8, "little") + hashlib.sha256(content).digest()


def put(path: Path, content: bytes) -> None:
    """Write an entry, whole or not at all.

    Raises:
        OSError: the folder cannot be written to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=".entry-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(sealed(content))
        Path(name).replace(path)
    finally:
        Path(name).unlink(missing_ok=True)


def opened(path: Path) -> bytes | None:
    """The content of an entry; None if there is none, or it is damaged."""
    try:
        whole = path.read_bytes()
    except OSError:
        return None
    content = whole[:-_SEAL]
    if whole and sealed(content) == whole:
        return content
    log.info("'%s' is damaged and is made again", path)
    return None
