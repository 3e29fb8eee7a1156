"""Run the commands that a page of the documentation shows, compare their output, or write it into the page.

A fenced block of kind ``console`` holds commands after ``$`` and what they print; ``...`` stands for lines left out. A
fenced block with a title is a file. ``python -m tools.console docs/tutorial/*.md`` runs the pages in a temporary folder
and puts the real output into them.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(r"^```(\w+)(?: +title=\"([^\"]+)\")?[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
SPENT = re.compile(r"[\d.]+ s of work|\b[\d.]+ kB|\d+\.\d+\.\w+")
LEFT_OUT = "..."


@dataclass(frozen=True)
class Command:
    """A command, and the lines that the page shows under it."""

    line: str
    shown: tuple[str, ...]

    @property
    def fails(self) -> bool:
        """Whether the page shows an error."""
        return bool(self.shown) and self.shown[0].startswith("error:")


@dataclass(frozen=True)
class File:
    """A file that the page tells the reader to write."""

    name: str
    text: str


def steps(text: str) -> Iterator[Command | File]:
    """The commands and files of a page, in order."""
    for kind, title, body in FENCE.findall(text):
        if title:
            yield File(title, body)
        elif kind == "console":
            for part in re.split(r"^\$ ", body, flags=re.MULTILINE)[1:]:
                line, *shown = part.rstrip("\n").split("\n")
                yield Command(line, tuple(shown))


def prepare(folder: Path) -> None:
    """Make a folder look like the root of the repository as far as the pages need it."""
    (folder / "docs").symlink_to(ROOT / "docs", target_is_directory=True)


def run(command: Command, folder: Path, timeout: float = 300.0) -> list[str]:
    """Lines that a command prints, errors if it shows one; ``make demo`` runs without make what the Makefile runs.

    Raises:
        RuntimeError: it failed, or should have.
    """
    # No shell prompt of the user's, and no terminal: the width of tables follows neither.
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "MPLBACKEND": "Agg",
        "COLUMNS": "120",
    }
    line = command.line.replace("make demo", f"{sys.executable} -m flexarm.demo")
    done = subprocess.run(
        ["/bin/sh", "-c", line],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    if bool(done.returncode) != command.fails:
        raise RuntimeError(f"{line}\nended with {done.returncode}\n{done.stdout}{done.stderr}")
    return (done.stderr if command.fails else done.stdout).rstrip("\n").replace(str(folder), "~").split("\n")


def same(shown: str, printed: str, tolerance: float) -> bool:
    """Whether two lines say the same, numbers within a relative tolerance, times and sizes of files apart."""
    a, b = (" ".join(SPENT.sub("~", line).split()) for line in (shown, printed))
    if NUMBER.sub("#", a) != NUMBER.sub("#", b):
        return False
    pairs = zip(NUMBER.findall(a), NUMBER.findall(b), strict=True)
    # Residues near zero depend on the platform's last digit.
    return all(abs(float(x) - float(y)) <= tolerance * abs(float(x)) + 1e-12 for x, y in pairs)


def differences(command: Command, printed: list[str], tolerance: float = 2e-3) -> list[str]:
    """Shown lines that were not printed, or printed lines that are not shown and not left out."""
    wrong, rest = [], list(printed)
    skipping = False
    for line in command.shown:
        if line.strip() == LEFT_OUT:
            skipping = True
            continue
        while skipping and rest and not same(line, rest[0], tolerance):
            rest.pop(0)
        skipping = False
        if not rest or not same(line, rest[0], tolerance):
            wrong.append(f"shown {line!r}, printed {rest[0] if rest else None!r}")
        if rest:
            rest.pop(0)
    if command.shown and rest and not skipping:
        wrong += [f"printed, not shown: {line!r}" for line in rest if line.strip()]
    return wrong


def refresh(text: str, folder: Path) -> str:
    """A page with the output of its commands as it is today; output that leaves lines out is kept if it still fits."""

    def block(match: re.Match[str]) -> str:
        kind, title, body = match.groups()
        if title:
            (folder / title).parent.mkdir(parents=True, exist_ok=True)
            (folder / title).write_text(body, encoding="utf-8")
        if title or kind != "console":
            return match[0]
        made = []
        for step in steps(match[0]):
            assert isinstance(step, Command)
            print(f"$ {step.line}", flush=True)
            printed = run(step, folder)
            if any(line.strip() == LEFT_OUT for line in step.shown):
                for problem in differences(step, printed):
                    print(f"  to be repaired by hand: {problem}")
                printed = list(step.shown)
            made += [f"$ {step.line}", *(printed if printed != [""] else [])]
        return "```console\n" + "\n".join(made) + "\n```"

    return FENCE.sub(block, text)


def main(pages: list[str]) -> int:
    """Refresh pages in place, one after the other in one folder."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        prepare(folder)
        for page in map(Path, pages):
            new = refresh(page.read_text(encoding="utf-8"), folder)
            page.write_text(new, encoding="utf-8")
        shutil.rmtree(folder / "demo-results", ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
