"""Commands killed (SIGKILL) at random moments, and what they leave."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def environment(folder: Path) -> dict[str, str]:
    """The environment of a command whose caches lie in a folder of its own."""
    return os.environ | {"FLEXARM_CACHE": str(folder / "cache"), "PYTHONPATH": str(ROOT)}


def command(arguments: list[str], folder: Path, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        [sys.executable, "-m", "flexarm", *arguments],
        cwd=folder,
        env=environment(folder) | settings,
        capture_output=True,
        text=True,
        timeout=1800,
    )


def kills(
    arguments: list[str],
    folder: Path,
    times: int,
    longest: float,
    seed: int,
    begun: Callable[[], bool] = lambda: True,
) -> Iterator[bool]:
    """Start a command again and again, each time killed after a random time up to ``longest`` (s).

    Only the process itself is killed, as the system does when memory runs out; what it started is left to itself.

    A time that was too long is halved for what follows. Every second time the clock starts when ``begun`` says that the
    work has, so that some kills fall into it however long the start takes.

    Yields:
        After each time, whether the command was killed before its end.
    """
    chance = random.Random(seed)
    for k in range(times):
        process = subprocess.Popen(
            [sys.executable, "-m", "flexarm", *arguments],
            cwd=folder,
            env=environment(folder),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        while k % 2 and process.poll() is None and not begun():
            time.sleep(0.01)
        try:
            process.wait(timeout=chance.uniform(0.05, longest))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
        process.wait()
        longest = longest if process.returncode else max(0.3, longest / 2)
        yield process.returncode == -signal.SIGKILL
        wait_for_group(process.pid)


def group(number: int) -> list[int]:
    """Processes of a group that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[2]) == number and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def wait_for_group(number: int, longest: float = 600.0) -> None:
    """Wait until nothing of a group runs, and assert that this comes."""
    deadline = time.monotonic() + longest
    while group(number):
        assert time.monotonic() < deadline, "processes outlive the command that started them"
        time.sleep(0.02)
