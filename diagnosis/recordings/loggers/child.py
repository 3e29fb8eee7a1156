"""The process in which a library reads a foreign file; see `diagnosis.recordings.loggers.host`."""

from __future__ import annotations

import importlib
import json
import os
import sys
import warnings
from contextlib import suppress
from pathlib import Path

MEMORY = 6_000_000_000
"""Bytes of address space; a file that makes its reader ask for more ends the process, not the machine."""
TIME = 1200
"""Seconds of processor time: years of a loop that a damaged file may lead into."""


def main() -> None:
    """Read the file that the standard input names, and write its columns to the standard output."""
    asked = json.loads(sys.stdin.buffer.read())
    answer = os.fdopen(os.dup(1), "wb")
    # What a library prints must not stand among the numbers.
    os.dup2(2, 1)
    warnings.simplefilter("ignore")
    _limit()
    from diagnosis.recordings.loggers.found import Found, Unreadable

    found = Found()
    try:
        reader = importlib.import_module(f"diagnosis.recordings.loggers.{asked['module']}")
        found = reader.read(Path(asked["path"]))
        if not found.columns:
            raise Unreadable("it holds no columns of numbers")
        head = {
            "names": list(found.columns),
            "lengths": [len(values) for values in found.columns.values()],
            "clocks": found.clocks,
            "units": found.units,
            "odd": found.odd,
            "notes": found.notes,
            "rows": found.rows,
        }
    except Unreadable as error:
        head = {"error": [error.message, error.remedy]}
    except MemoryError:
        head = {"error": ["it asks for more memory than a file of its kind may have", "save a part of it"]}
    except Exception as error:
        # What a library says may repeat the file, so that its kind alone is told.
        head = {"error": [f"it is damaged, or no such file ({type(error).__name__})", "save it anew, or as .csv"]}
    answer.write(json.dumps(head).encode() + b"\n")
    if "error" not in head:
        for values in found.columns.values():
            answer.write(values.tobytes())
    answer.close()
    # A library's threads and destructors have nothing more to say.
    os._exit(0)


def _limit() -> None:
    with suppress(ImportError, ValueError, OSError):
        import resource

        for kind, most in ((resource.RLIMIT_AS, MEMORY), (resource.RLIMIT_CPU, TIME)):
            hard = resource.getrlimit(kind)[1]
            resource.setrlimit(kind, (most if hard < 0 else min(most, hard), hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
