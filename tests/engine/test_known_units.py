"""What pint said of units, kept on disk: the same numbers bit by bit, and nothing from a file that is not sound."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from engine import cache

ROOT = Path(__file__).resolve().parents[2]
ASK = """
import json, sys
from engine.quantity import base_units, coherent, compatible, convert, factor
units = ["mN.m/A", "deg", "rpm", "kg.m2", "N.m/rad", "1/min", "Hz", "%", "1", "mm/s2", "kohm"]
said = [[coherent(u), base_units(u)] for u in units]
said.append([factor("deg/s", "rad/s"), factor("rpm", "Hz"), convert("7.68 mN.m/A", "N.m/A"), compatible("N.m", "J"),
             compatible("m", "s")])
try:
    convert("2 furlongz", "m")
except Exception as error:
    said.append(str(error))
print(json.dumps([said, "pint" in sys.modules]))
"""


def ask(folder: Path, *, without_error: bool = False) -> list[object]:
    """What a new process says of some units, and whether it needed pint."""
    program = ASK.replace('convert("2 furlongz", "m")', "pass") if without_error else ASK
    environment = os.environ | {"FLEXARM_CACHE": str(folder), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def test_the_second_process_says_the_same_without_pint(tmp_path: Path) -> None:
    first, second = ask(tmp_path, without_error=True), ask(tmp_path, without_error=True)
    assert first[1]
    assert not second[1]
    assert first[0] == second[0]
    # Errors are found anew, in the same words.
    assert ask(tmp_path)[0] == ask(tmp_path / "empty")[0]


@pytest.mark.parametrize("content", [b"", b"{}", b'{"x": 1}', cache.sealed(b"[1, 2]"), cache.sealed(b"not json")])
def test_a_damaged_file_is_passed_over(content: bytes, tmp_path: Path) -> None:
    first = ask(tmp_path, without_error=True)
    (file,) = tmp_path.glob("units-*.json")
    file.write_bytes(content)
    assert ask(tmp_path, without_error=True) == first
    assert cache.opened(file)


def test_a_folder_that_cannot_be_written_to_costs_only_time(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    assert ask(blocked, without_error=True)[0] == ask(tmp_path, without_error=True)[0]
