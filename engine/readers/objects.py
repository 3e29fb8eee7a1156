"""JSON files that hold an object."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from engine.readers.regular import content, problem, shown

LARGEST = 200_000_000
"""Bytes; a JSON file takes some ten times its size of memory."""

LINES = (".jsonl", ".ndjson")
"""Endings of files that hold an object in each line."""

LONGEST_INTEGER = 300
"""Digits; longer ones are beyond what a number in the computer can hold."""

_REMEDY = 'write {"name": [...], ...}'


def read_json(path: Path, largest: int = LARGEST, *, records: bool = False) -> dict[str, Any]:
    """The object of a JSON file, as plain Python values.

    Args:
        path: the file.
        largest: bytes that are read at most.
        records: a list of objects is taken too, and so are objects line by line (JSON Lines); it stands under "".

    Raises:
        FileProblem: no regular file, no JSON, no object, two entries of one name, or an integer beyond all numbers.
    """

    def whole(digits: str) -> int:
        if len(digits) > LONGEST_INTEGER:
            raise problem(
                path, f"an integer of {len(digits)} digits, which no number can hold", "is it meant as a text?"
            )
        return int(digits)

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for k, name in enumerate(names) if name in names[:k])
            raise problem(path, f"two entries are called '{shown(twice)}'", "rename one of them")
        return made

    data = content(path, largest, "save it as .parquet or .csv, or a part of it")
    try:
        text = data.decode("utf-8-sig")
        if records and path.suffix.lower() in LINES:
            text = f"[{','.join(line for line in text.splitlines() if line.strip())}]"
        found = json.loads(text, parse_int=whole, object_pairs_hook=once)
    except UnicodeDecodeError:
        raise problem(path, "the file is not UTF-8 text", "save it as UTF-8") from None
    except RecursionError:
        raise problem(path, "the JSON file is nested too deep", _REMEDY) from None
    except json.JSONDecodeError as error:
        raise problem(path, f"the file is not JSON: {error.msg}", _REMEDY, error.lineno) from None
    if records and isinstance(found, list) and found and all(isinstance(entry, dict) for entry in found):
        return {"": found}
    if not isinstance(found, dict):
        raise problem(path, "the file holds no JSON object", _REMEDY)
    return found
