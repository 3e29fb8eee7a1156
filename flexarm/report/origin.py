"""What is needed to repeat a result: versions, command line, seed, and the SHA-256 of every file that was read."""

from __future__ import annotations

import hashlib
import platform
import shlex
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm._version import version as flexarm_version

if TYPE_CHECKING:
    from scenarios.load import Scenario

LIBRARIES = ("casadi", "numpy", "scipy", "ziglang")


@dataclass(frozen=True)
class Origin:
    """Rows of (what, value), and of (file, SHA-256)."""

    rows: tuple[tuple[str, str], ...]
    files: tuple[tuple[str, str], ...]


def origin(
    scenario: Scenario, *, recordings: Iterable[str | Path] = (), seed: int | None = None, command: str = ""
) -> Origin:
    """Everything needed to repeat what was made of a scenario.

    Args:
        scenario: what was loaded.
        recordings: files of the recordings used.
        seed: of everything random, if anything is.
        command: the command line.
    """
    rows = [("flexarm", flexarm_version()), ("Python", platform.python_version())]
    for name in LIBRARIES:
        try:
            rows.append((name, version(name)))
        except PackageNotFoundError:
            continue
    rows.append(("platform", f"{platform.system()} {platform.machine()}"))
    if command:
        rows.append(("command", command))
    if seed is not None:
        rows.append(("seed", str(seed)))
    rows.append(("scenario", f"{scenario.name} ({scenario.digest})"))
    if scenario.overrides:
        rows.append(("values set", " ".join(scenario.overrides)))
    names = dict.fromkeys(str(p) for p in (*(scenario.flat.files or [scenario.path]), *recordings))
    return Origin(tuple(rows), tuple((name, sha256(Path(name))) for name in names))


def sha256(path: Path) -> str:
    """SHA-256 of a file; a dash where there is no such file."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return "-"


def command_line() -> str:
    """The command that is running, as one would type it."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
