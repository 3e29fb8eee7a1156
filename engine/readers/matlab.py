"""MATLAB files of version 5 to 7 and of version 4, read element by element with every size checked before it is used.

The format's sizes and types lead a reader into memory, and a reader in C out of it. Here a size is compared with what
the file still holds before anything is made of it, so that a file can be wrong but not harmful. "MAT-File Format",
The MathWorks; https://www.mathworks.com/help/pdf_doc/matlab/matfile_format.pdf
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from engine.readers.regular import FileProblem, content, problem, shown

LARGEST = 2_000_000_000
"""Bytes of a file."""

UNPACKED = 50
"""A file may unpack to so many times its size, and to `UNPACKED_ANYWAY` in any case."""

UNPACKED_ANYWAY = 100_000_000
"""Bytes."""

MOST_ARRAYS = 100_000
"""Arrays in a file, those in cells and structures included."""

DEEPEST = 32
"""Levels of cells and structures."""

_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMBERS = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_COMPLEX, _LOGICAL = 0x0800, 0x0200
_NEWER = "save it with save(..., '-v7'), or as .parquet or .csv"


class _Damaged(Exception):
    """The file is not what its header says; the text says how."""


@dataclass
class _Budget:
    """What may still be unpacked and made of the whole file."""

    unpacked: int
    arrays: int = MOST_ARRAYS

    def count(self) -> None:
        self.arrays -= 1
        if self.arrays < 0:
            raise _Damaged(f"it holds more than {MOST_ARRAYS} arrays")


@dataclass
class _Part:
    """A stretch of bytes that is read from its beginning."""

    data: memoryview
    order: Literal["<", ">"]
    budget: _Budget
    place: int = field(default=0)

    def left(self) -> int:
        return len(self.data) - self.place

    def take(self, count: int) -> memoryview:
        if not 0 <= count <= self.left():
            raise _Damaged("an element reaches beyond its end")
        self.place += count
        return self.data[self.place - count : self.place]

    def element(self) -> tuple[int, memoryview]:
        """Type and bytes of the next element."""
        first = struct.unpack(self.order + "I", self.take(4))[0]
        if first >> 16:  # a small element: size and type share a word, and the data another
            kind, count = first & 0xFFFF, first >> 16
            if count > 4:
                raise _Damaged("a small element of more than four bytes")
            return kind, self.take(4)[:count]
        count = struct.unpack(self.order + "I", self.take(4))[0]
        data = self.take(count)
        if first != _COMPRESSED:
            self.take(min(-count % 8, self.left()))
        return first, data

    def part(self, data: memoryview) -> _Part:
        return _Part(data, self.order, self.budget)

    def numbers(self) -> np.ndarray[Any, Any]:
        kind, data = self.element()
        if kind not in _KINDS:
            raise _Damaged("numbers of an unknown type")
        dtype = np.dtype(_KINDS[kind]).newbyteorder(self.order)
        if len(data) % dtype.itemsize:
            raise _Damaged("numbers that end in the middle of one")
        return np.frombuffer(data, dtype)

    def name(self) -> str:
        kind, data = self.element()
        if kind not in (1, 2, 16):
            raise _Damaged("a name that is no text")
        return bytes(data).split(b"\0")[0].decode("utf-8", "replace")


def read_mat(path: Path, largest: int = LARGEST) -> dict[str, Any]:
    """Every variable of a MATLAB file, by name.

    Numbers and truth values are arrays of at least two dimensions; texts are str, or lists of str for several rows;
    cell arrays are arrays of objects; structures are dictionaries, and arrays of objects where there are several.
    What holds no plain data (sparse matrices, objects, functions) is None.

    Raises:
        FileProblem: no regular file, no MATLAB file, one of version 7.3, or one that is damaged.
    """
    data = content(path, largest)
    try:
        return _variables(path, data)
    except _Damaged as error:
        raise problem(path, f"the MATLAB file is damaged: {error}", "save it anew, or as .csv or .parquet") from None


def _variables(path: Path, data: bytes) -> dict[str, Any]:
    if data[:8] == b"\x89HDF\r\n\x1a\n" or data[512:520] == b"\x89HDF\r\n\x1a\n":
        raise problem(path, "this is a MATLAB file of version 7.3", _NEWER)
    budget = _Budget(UNPACKED_ANYWAY + UNPACKED * len(data))
    if len(data) >= 20 and 0 in data[:4]:
        return _version_4(data, budget)
    order: Literal["<", ">"] = "<" if data[126:128] == b"IM" else ">"
    if data[126:128] not in (b"IM", b"MI"):
        raise problem(path, "this is not a MATLAB file", _NEWER)
    version = struct.unpack(order + "H", data[124:126])[0]
    if version == 0x0200:
        raise problem(path, "this is a MATLAB file of version 7.3", _NEWER)
    if version != 0x0100:
        raise problem(path, "this is a MATLAB file of a version that is not read here", _NEWER)
    part = _Part(memoryview(data)[128:], order, budget)
    made: dict[str, Any] = {}
    while part.left() >= 8:
        kind, element = part.element()
        if kind == _COMPRESSED:
            kind, element = part.part(_unpacked(element, budget)).element()
        if kind != _MATRIX:
            raise _Damaged("an element that is no array")
        name, value = _array(part.part(element), 0)
        if not name:  # what MATLAB keeps for objects and functions
            continue
        if name in made:
            raise FileProblem(f"'{path}' holds two variables called '{shown(name)}'", remedy="save it anew")
        made[name] = value
    return made


def _unpacked(element: memoryview, budget: _Budget) -> memoryview:
    inflate = zlib.decompressobj()
    try:
        data = inflate.decompress(element, budget.unpacked + 1)
    except zlib.error:
        raise _Damaged("compressed data that cannot be unpacked") from None
    budget.unpacked -= len(data)
    if budget.unpacked < 0:
        raise _Damaged("it unpacks to out of all proportion to its size")
    if not inflate.eof:
        raise _Damaged("compressed data that end early")
    return memoryview(data)


def _array(part: _Part, depth: int) -> tuple[str, Any]:
    """Name and value of a matrix element."""
    part.budget.count()
    if depth > DEEPEST:
        raise _Damaged(f"cells and structures are nested more than {DEEPEST} levels deep")
    if not part.left():
        return "", np.zeros((0, 0))
    flags = part.numbers()
    if flags.dtype.kind != "u" or flags.dtype.itemsize != 4 or len(flags) != 2:
        raise _Damaged("array flags of the wrong type or length")
    kind, marks = int(flags[0]) & 0xFF, int(flags[0])
    if kind == _OPAQUE:
        return part.name(), None
    given = part.numbers()
    # Some writers give dimensions without a sign.
    shape = tuple(int(size) for size in given)
    if given.dtype.kind not in "iu" or given.dtype.itemsize != 4 or not 2 <= len(shape) <= 32:
        raise _Damaged("dimensions of the wrong type or number")
    if min(shape) < 0 or max(shape) >= 2**31:
        raise _Damaged("dimensions out of range")
    name = part.name()
    if kind in _NUMBERS:
        return name, _number_array(part, kind, marks, shape)
    if kind == _CHAR:
        return name, _text(part, shape)
    if kind == _CELL:
        return name, _cells(part, shape, depth)
    if kind == _STRUCT:
        return name, _structures(part, shape, depth)
    if kind in (_OBJECT, _SPARSE, _FUNCTION):
        return name, None
    raise _Damaged("an array of an unknown class")


def _number_array(part: _Part, kind: int, marks: int, shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
    def read() -> np.ndarray[Any, Any]:
        values = part.numbers()
        if len(values) != math.prod(shape):
            raise _Damaged("an array with more or fewer numbers than its dimensions say")
        return values.reshape(shape, order="F")

    real = read()
    if marks & _COMPLEX:
        return np.asarray(real + 1j * read(), dtype=complex)
    if marks & _LOGICAL:
        return np.asarray(real != 0)
    with np.errstate(all="ignore"):
        return np.asarray(real.astype(_NUMBERS[kind]))


def _text(part: _Part, shape: tuple[int, ...]) -> str | list[str]:
    kind, data = part.element()
    if kind not in _TEXTS:
        raise _Damaged("a text of an unknown type")
    coding = _TEXTS[kind]
    if coding in ("utf-16", "utf-32"):
        coding += "-le" if part.order == "<" else "-be"
    text = bytes(data).decode(coding, "replace")
    rows, wide = shape[0], math.prod(shape[1:])
    if rows <= 1:
        return text
    if rows > MOST_ARRAYS or len(text) != rows * wide:
        raise _Damaged("a text of another length than its dimensions say")
    return [text[k::rows] for k in range(rows)]


def _cells(part: _Part, shape: tuple[int, ...], depth: int) -> np.ndarray[Any, Any]:
    count = _few(part, math.prod(shape))
    made = np.empty(count, dtype=object)
    for k in range(count):
        made[k] = _inner(part, depth)
    return made.reshape(shape, order="F")


def _structures(part: _Part, shape: tuple[int, ...], depth: int) -> Any:
    longest = part.numbers()
    if longest.dtype.kind != "i" or len(longest) != 1 or longest[0] <= 0:
        raise _Damaged("a structure without the length of its names")
    _, names = part.element()
    wide = int(longest[0])
    if len(names) % wide:
        raise _Damaged("a structure whose names have other lengths than it says")
    keys = [bytes(names[k : k + wide]).split(b"\0")[0].decode("utf-8", "replace") for k in range(0, len(names), wide)]
    if len(set(keys)) < len(keys):
        raise _Damaged("a structure with two fields of one name")
    count = math.prod(shape)
    _few(part, count * max(1, len(keys)) if keys or count > MOST_ARRAYS else 0)
    made = np.empty(count, dtype=object)
    for k in range(count):
        made[k] = {key: _inner(part, depth) for key in keys}
    return made[0] if count == 1 else made.reshape(shape, order="F")


def _few(part: _Part, count: int) -> int:
    """So many arrays, if the bytes that are left can hold them: each takes at least its tag of eight."""
    if count > min(part.left() // 8, MOST_ARRAYS):
        raise _Damaged("cells or structures with more entries than it holds")
    return count


def _inner(part: _Part, depth: int) -> Any:
    kind, element = part.element()
    if kind != _MATRIX:
        raise _Damaged("a cell or field that is no array")
    return _array(part.part(element), depth + 1)[1]


def _version_4(data: bytes, budget: _Budget) -> dict[str, Any]:
    """Variables of a file of version 4: a header of five integers each, the name, and the numbers."""
    made: dict[str, Any] = {}
    order: Literal["<", ">"] = "<" if struct.unpack("<i", data[:4])[0] in range(5000) else ">"
    part = _Part(memoryview(data), order, budget)
    while part.left() >= 20:
        budget.count()
        mopt, rows, columns, imaginary, length = struct.unpack(order + "5i", part.take(20))
        coded, zero, kind, matrix = mopt // 1000, mopt // 100 % 10, mopt // 10 % 10, mopt % 10
        if coded not in (0, 1) or zero or kind > 5 or matrix > 2 or min(rows, columns, length) < 0 or mopt < 0:
            raise _Damaged("a header that is none")
        name = bytes(part.take(length)).split(b"\0")[0].decode("latin-1")
        dtype = np.dtype(("f8", "f4", "i4", "i2", "u2", "u1")[kind]).newbyteorder(order)
        count = rows * columns

        def read(count: int = count, dtype: np.dtype[Any] = dtype) -> np.ndarray[Any, Any]:
            return np.frombuffer(part.take(count * dtype.itemsize), dtype)

        real = read().reshape((rows, columns), order="F")
        value: Any = real.astype(float)
        if imaginary:
            value = value + 1j * read().reshape((rows, columns), order="F")
        if matrix == 1:
            with np.errstate(all="ignore"):
                letters = real.astype("u1")
            lines = ["".join(map(chr, row)) for row in letters[:MOST_ARRAYS]]
            value = lines[0] if len(lines) == 1 else lines
        elif matrix == 2:
            value = None
        if name in made:
            raise _Damaged(f"two variables called '{shown(name)}'")
        made[name] = value
    if not made:
        raise _Damaged("it holds no variables")
    return made


def simplified(value: Any) -> Any:
    """A value of `read_mat` without dimensions of length one; a cell array of one cell is what the cell holds."""
    if isinstance(value, dict):
        return {key: simplified(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        if value.size == 1:
            return simplified(value.ravel()[0])
        made = np.empty(value.size, dtype=object)
        for k, inner in enumerate(value.ravel()):
            made[k] = simplified(inner)
        return np.squeeze(made.reshape(value.shape))
    if isinstance(value, np.ndarray):
        return np.squeeze(value)
    return value
