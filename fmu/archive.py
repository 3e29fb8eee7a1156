"""FMU and SSP archives from elsewhere: their entries are checked before anything is unpacked or parsed."""

from __future__ import annotations

import re
import stat
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.parsers import expat

from engine.errors import FlexarmError

MOST_FILES = 20_000
"""Files in an archive."""

LARGEST = 4_000_000_000
"""Bytes that an archive may unpack to."""

FREE, RATIO = 100_000_000, 50
"""An archive may unpack to ``FREE`` bytes whatever its size, and to ``RATIO`` times its size."""

LARGEST_XML = 64_000_000
"""Bytes of an XML file."""

MOST_ELEMENTS = 1_000_000
"""Elements of an XML file."""

DEEPEST = 100
"""Levels of elements."""

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_REMEDY = "do not use this file; ask where it comes from for a sound one"
_BAD = (OSError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, ValueError, EOFError)


def check(path: Path) -> None:
    """Refuse an archive that would write outside of its folder, or fill the disk.

    Raises:
        FlexarmError: it is not a zip archive, or it holds such a name, a link, an encrypted file, or too much data.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except FileNotFoundError as error:
        raise FlexarmError(f"there is no file '{path}'") from error
    except _BAD as error:
        raise FlexarmError(f"{_unreadable(path)}: {error}") from error
    if len(entries) > MOST_FILES:
        raise FlexarmError(f"'{path}' holds {len(entries)} files; at most {MOST_FILES} are unpacked", remedy=_REMEDY)
    seen: set[str] = set()
    for entry in entries:
        reason = _reason(entry, seen)
        if reason:
            raise FlexarmError(f"'{path}' is refused: its entry {entry.filename[:80]!r} {reason}", remedy=_REMEDY)
    total = sum(entry.file_size for entry in entries)
    allowed = min(LARGEST, FREE + RATIO * path.stat().st_size)
    if total > allowed:
        raise FlexarmError(
            f"'{path}' would unpack to {total / 1e6:.0f} MB; at most {allowed / 1e6:.0f} MB are unpacked of its "
            f"{path.stat().st_size / 1e6:.3g} MB",
            remedy=_REMEDY,
        )


def _unreadable(path: Path) -> str:
    return f"'{path}' is no {'SSP' if path.suffix.lower() == '.ssp' else 'FMU'} that can be read"


def _reason(entry: zipfile.ZipInfo, seen: set[str]) -> str:
    """What is wrong with an entry, if anything."""
    # `filename` has been cut at a zero byte and had its separators changed; what the archive says is the original.
    for name in (entry.filename, entry.orig_filename):
        if "\0" in name or "\\" in name or ":" in name:
            return "has a character that no portable path holds"
        if name.startswith("/"):
            return "is an absolute path"
        if ".." in name.split("/"):
            return "leads out of the archive"
    mode = entry.external_attr >> 16
    if stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "is a link or another special file"
    if entry.flag_bits & 0x1:
        return "is encrypted"
    if entry.filename.rstrip("/") in seen:
        return "is there twice"
    seen.add(entry.filename.rstrip("/"))
    return ""


def unpack(path: Path, folder: Path) -> None:
    """Check an archive and unpack it.

    Raises:
        FlexarmError: it is refused, or damaged.
    """
    check(path)
    try:
        # Each file is read up to the size that the directory of the archive states, so `check` has bounded the total.
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
    except _BAD as error:
        raise FlexarmError(f"'{path}' cannot be unpacked: {error}") from error


def xml(path: Path, name: str) -> bytes:
    """An XML file of an archive. A document type is refused, so entities are too.

    Raises:
        FlexarmError: the file is missing, too large, too deep or not XML, or it declares a document type.
    """
    check(path)
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo(name).file_size > LARGEST_XML:
                raise FlexarmError(
                    f"'{name}' in '{path}' has {archive.getinfo(name).file_size / 1e6:.0f} MB; at most "
                    f"{LARGEST_XML / 1e6:.0f} MB are read",
                    remedy=_REMEDY,
                )
            data = archive.read(name)
    except KeyError as error:
        raise FlexarmError(f"{_unreadable(path)}: it holds no '{name}'") from error
    except _BAD as error:
        raise FlexarmError(f"'{name}' in '{path}' cannot be read: {error}") from error
    try:
        _plain(data)
    except FlexarmError as error:
        raise FlexarmError(f"'{name}' in '{path}' is refused: {error.message}", remedy=error.remedy) from None
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise FlexarmError(f"'{name}' in '{path}' is not XML: {error}") from error
    return data


def _plain(data: bytes) -> None:
    """Refuse XML with a document type, too many elements, or elements too deep."""
    count = depth = 0

    def begin(tag: str, attributes: Any) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > MOST_ELEMENTS:
            raise FlexarmError(f"it has more than {MOST_ELEMENTS} elements", remedy=_REMEDY)
        if depth > DEEPEST:
            raise FlexarmError(f"its elements are nested more than {DEEPEST} levels deep", remedy=_REMEDY)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1

    def doctype(*declared: Any) -> None:
        raise FlexarmError(
            "it declares a document type, through which entities expand or read other files",
            remedy="FMI and SSP need none: remove the line <!DOCTYPE ...>",
        )

    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = doctype
    parser.Parse(data, True)


def description(path: str | Path) -> Any:
    """The model description of an FMU, as FMPy reads it, once the archive and the XML are found to be sound.

    Raises:
        FlexarmError: the file does not exist, or is not an FMU that can be read.
    """
    from io import BytesIO

    from fmpy import read_model_description

    data = xml(Path(path), "modelDescription.xml")
    sole = BytesIO()  # what has been checked is what is parsed
    with zipfile.ZipFile(sole, "w") as archive:
        archive.writestr("modelDescription.xml", data)
    try:
        found = read_model_description(sole, validate=False)
    except Exception as error:
        raise FlexarmError(f"{_unreadable(Path(path))}: {str(error)[:300]}") from error
    _check_identifiers(
        str(path),
        (getattr(found.coSimulation, "modelIdentifier", ""), getattr(found.modelExchange, "modelIdentifier", "")),
    )
    seen: set[str] = set()
    for variable in found.modelVariables:
        if variable.name in seen:
            raise FlexarmError(
                f"{_unreadable(Path(path))}: it has two variables '{variable.name[:80]}'", remedy=_REMEDY
            )
        seen.add(variable.name)
    return found


def _check_identifiers(path: str, identifiers: Iterable[str | None]) -> None:
    """The identifier becomes a file name, so it must be what the standard says: a name of C."""
    for identifier in identifiers:
        if identifier and not _IDENTIFIER.fullmatch(identifier):
            raise FlexarmError(
                f"'{path}' is refused: its model identifier {identifier[:80]!r} is not a C identifier", remedy=_REMEDY
            )
