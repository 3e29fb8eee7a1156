"""Make a virtual environment and install into it with pip, with progress. It needs only Python.

Usage: python tools/install.py VENV PIP_ARGUMENTS...
"""

from __future__ import annotations

import subprocess
import sys
from collections import deque
from pathlib import Path

OLDEST = (3, 11)


def interpreter(venv: Path) -> Path | None:
    """The environment's Python, if there is one that runs and is recent enough."""
    for python in (venv / "bin" / "python", venv / "Scripts" / "python.exe"):
        if python.exists():
            check = f"import sys; sys.exit(sys.version_info < {OLDEST})"
            if subprocess.run([str(python), "-c", check], capture_output=True, check=False).returncode == 0:
                return python
    return None


def create(venv: Path) -> Path | None:
    """Make the environment; None when that failed and the reason was printed."""
    version = ".".join(str(number) for number in sys.version_info[:3])
    if sys.version_info[:2] < OLDEST:
        print(f"flexarm needs Python 3.11 or later, and {sys.executable} is {version}", file=sys.stderr)
        print("  name another one: make PYTHON=python3.12 setup", file=sys.stderr)
        return None
    print(f"making {venv} with Python {version}", flush=True)
    done = subprocess.run([sys.executable, "-m", "venv", "--clear", str(venv)], check=False)
    if done.returncode:
        print(f"{sys.executable} could not make a virtual environment", file=sys.stderr)
        print("  on Debian and Ubuntu, install the system package python3-venv", file=sys.stderr)
        return None
    return interpreter(venv)


def install(python: Path, arguments: list[str]) -> int:
    """Run pip, its output reduced to a count of packages; the tail of it is shown when pip fails."""
    command = [str(python), "-m", "pip", "install", "--progress-bar=off", "--no-input", "--disable-pip-version-check"]
    tail: deque[str] = deque(maxlen=40)
    found, live = 0, sys.stdout.isatty()
    print("installing flexarm and its dependencies (the first time takes some minutes)", flush=True)
    with subprocess.Popen(
        [*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as pip:
        assert pip.stdout is not None
        for line in pip.stdout:
            tail.append(line)
            if line.startswith("Collecting "):
                found += 1
                if live:
                    print(f"\r\033[K  {found} packages found: {line.split()[1]}", end="", flush=True)
                elif found % 20 == 0:
                    print(f"  {found} packages found", flush=True)
            elif found and line.startswith("Installing collected packages"):
                lead = "\r\033[K" if live else ""
                print(f"{lead}  {found} packages found, unpacking them", flush=True)
    if pip.returncode:
        print("".join(tail), file=sys.stderr)
        print("pip could not install the dependencies; its last lines are above", file=sys.stderr)
    return pip.returncode


def main() -> int:
    """Make the environment where needed, then install."""
    if len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    venv = Path(sys.argv[1])
    python = interpreter(venv) or create(venv)
    return install(python, sys.argv[2:]) if python else 1


if __name__ == "__main__":
    sys.exit(main())
