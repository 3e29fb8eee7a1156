"""Run the quick tests on each version of Python that the project supports, in an environment of its own.

Interpreters are found by name on the path, then by `uv` and by `pyenv` where those are installed. Nothing is downloaded
but the project's dependencies. What was not run is named at the end.

Usage: python tools/matrix.py [--strict] [--versions 3.11,3.12] [PYTEST_ARGUMENTS...]

Exit code 0: the tests pass wherever they ran. 1: they fail somewhere, or ran nowhere; with --strict also where an
interpreter is missing.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def versions() -> list[str]:
    """The versions that ``pyproject.toml`` names among its classifiers, such as ``3.11``."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = (re.fullmatch(r"Programming Language :: Python :: (\d+\.\d+)", text) for text in project["classifiers"])
    return [match[1] for match in found if match]


def candidates(version: str) -> Iterator[str]:
    """Interpreters that may be of a version, the likeliest first."""
    yield from filter(None, (shutil.which(f"python{version}"), sys.executable, shutil.which("python3")))
    for asked in (["uv", "python", "find", "--offline", version], ["pyenv", "prefix", version]):
        if shutil.which(asked[0]):
            done = subprocess.run(asked, capture_output=True, text=True, check=False)
            if done.returncode == 0 and (line := done.stdout.strip()):
                yield line if asked[0] == "uv" else str(Path(line) / "bin" / "python")
    if shutil.which("pyenv"):  # `pyenv prefix 3.12` knows only versions named in full
        done = subprocess.run(["pyenv", "root"], capture_output=True, text=True, check=False)
        for path in sorted(Path(done.stdout.strip()).glob(f"versions/{version}.*/bin/python"), reverse=True):
            yield str(path)


def interpreter(version: str) -> str | None:
    """An interpreter that runs and is of that version; a name on the path alone may be a shim without one behind it."""
    told = "import sys; print('%d.%d' % sys.version_info[:2])"
    for path in dict.fromkeys(candidates(version)):
        try:
            done = subprocess.run([path, "-c", told], capture_output=True, text=True, check=False)
        except OSError:
            continue
        if done.returncode == 0 and done.stdout.strip() == version:
            return path
    return None


def run(version: str, python: str, arguments: list[str]) -> bool:
    """Make or update the environment of a version and run the tests in it; whether they pass."""
    venv = ROOT / f".venv-{version}"
    install = [python, str(ROOT / "tools" / "install.py"), str(venv), "-c", "requirements.lock", "-e", ".[dev,docs]"]
    if subprocess.run(install, cwd=ROOT, check=False).returncode:
        return False
    command = [str(venv / "bin" / "python"), "-m", "pytest", *arguments]
    return subprocess.run(command, cwd=ROOT, check=False).returncode == 0


def main(arguments: list[str] | None = None) -> int:
    """Run the matrix; returns the exit code."""
    parser = argparse.ArgumentParser(description="run the quick tests on every supported version of Python")
    parser.add_argument("--strict", action="store_true", help="fail where an interpreter is missing")
    parser.add_argument(
        "--versions", default=",".join(versions()), help="with commas; by default those of pyproject.toml"
    )
    given, rest = parser.parse_known_args(arguments)
    said: dict[str, str] = {}
    for version in given.versions.split(","):
        python = interpreter(version)
        if python is None:
            said[version] = f"not run: there is no python{version}; install it, or: uv python install {version}"
            continue
        print(f"== Python {version}: {python}", flush=True)
        said[version] = "passed" if run(version, python, rest) else "FAILED"
    print("\n".join(["", *(f"Python {version}: {text}" for version, text in said.items())]))
    missing = [version for version, text in said.items() if text.startswith("not run")]
    failed = "FAILED" in said.values() or len(missing) == len(said) or (given.strict and missing)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
