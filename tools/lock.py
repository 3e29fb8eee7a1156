"""Write requirements.lock: the versions that pip chooses today to run, develop and document the project.

The file holds names and versions only, no addresses and no paths. It is used as a constraint (``pip install -c``), so
a package that a platform does not need is not installed there, and one that only another platform needs is not pinned.
"""

from __future__ import annotations

import json
import platform
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXTRAS = ("dev", "docs")


def wanted() -> list[str]:
    """The requirements that pyproject.toml names."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    found = [*project["dependencies"]]
    waiting = [line for extra in EXTRAS for line in extras[extra]]
    while waiting:
        line = waiting.pop(0)
        # An extra may name others of the project itself.
        own = re.fullmatch(rf"{project['name']}\[([^]]*)\]", line)
        if own:
            waiting = [inner for extra in own[1].split(",") for inner in extras[extra.strip()]] + waiting
        elif line not in found:
            found.append(line)
    return found


def resolve(requirements: list[str]) -> dict[str, str]:
    """Name and version of every package that pip would install into an empty environment.

    Raises:
        subprocess.CalledProcessError: pip found no versions that fit together.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        venv.create(place / "venv", with_pip=True)
        python = place / "venv" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
        report = place / "report.json"
        command = [str(python), "-m", "pip", "install", "--dry-run", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*command, "--report", str(report), *requirements], check=True)
        chosen = json.loads(report.read_text(encoding="utf-8"))["install"]
    packages = [package["metadata"] for package in chosen]
    return {re.sub(r"[-_.]+", "-", data["name"]).lower(): data["version"] for data in packages}


def main() -> int:
    """Resolve and write."""
    print("resolving the dependencies (about a minute)", flush=True)
    try:
        pins = resolve(wanted())
    except subprocess.CalledProcessError as error:
        print("requirements.lock is unchanged: pip could not resolve pyproject.toml", file=sys.stderr)
        return error.returncode
    made = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    lines = [f"# Written by `make lock` with {made}; a constraints file, see tools/lock.py."]
    lines += [f"{name}=={version}" for name, version in sorted(pins.items())]
    (ROOT / "requirements.lock").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"requirements.lock: {len(pins)} packages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
