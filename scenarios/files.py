"""The files of a scenario: its own, those it refers to, and those its blocks read; packing them for another machine."""

from __future__ import annotations

import hashlib
import os
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenarios.load import Scenario

Shipment = tuple[tuple[str, bytes], ...]
"""Files by path below a common folder, the scenario's own first."""

_unpacking = threading.Lock()
_folders: dict[str, tempfile.TemporaryDirectory[str]] = {}


def block_files(scenario: Scenario) -> list[Path]:
    """Files that blocks of a scenario name."""
    found = []
    for block in scenario.system.blocks.values():
        for option in getattr(type(block), "files", ()):
            if getattr(block, option):
                found.append(Path(getattr(block, option)))
    return found


def scenario_files(scenario: Scenario) -> tuple[str, dict[str, bytes]]:
    """Name of the scenario's file, and it and the files it reads, by path below a common folder."""
    paths = [path.resolve() for path in (*scenario.flat.files, *block_files(scenario))]
    root = Path(os.path.commonpath([path.parent for path in paths]))
    files = {f"scenario/{path.relative_to(root).as_posix()}": path.read_bytes() for path in paths}
    return f"scenario/{scenario.path.resolve().relative_to(root).as_posix()}", files


def packed(scenario: Scenario) -> Shipment:
    """The files of a scenario, for a process that does not share the disk."""
    main, files = scenario_files(scenario)
    return (main, files.pop(main)), *files.items()


def unpacked(files: Shipment) -> Path:
    """The scenario's file, written with the others to a folder that lasts as long as this process."""
    made = hashlib.sha256()
    for name, content in files:
        made.update(f"{name} {len(content)} ".encode() + content)
    key = made.hexdigest()
    with _unpacking:
        if key not in _folders:
            folder = tempfile.TemporaryDirectory(prefix="flexarm-scenario-")
            for name, content in files:
                target = Path(folder.name) / name
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(content)
            _folders[key] = folder
    return Path(_folders[key].name) / files[0][0]
