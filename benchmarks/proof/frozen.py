"""Freezing: the seeds that count follow from the commit that froze the rules, and the page shows what changed since."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from engine.errors import FlexarmError
from engine.files import writing

ROOT = Path(__file__).resolve().parents[2]
RECORD = Path(__file__).parent / "frozen.json"
RULES = ("diagnosis", "blocks")
"""Folders that may not change between the commit that is frozen and the score."""

JUDGES = ("benchmarks/concealed", "benchmarks/proof")
"""Folders that draw and score; their hashes are shown too."""


@dataclass(frozen=True)
class Frozen:
    """What was frozen.

    Attributes:
        commit: its hash.
        trees: folder -> hash of its tree in that commit.
    """

    commit: str
    trees: dict[str, str]


def _git(root: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=False)
    except OSError as error:
        raise FlexarmError(f"git cannot be run: {error.strerror}", remedy="freeze and score in a clone") from error
    if done.returncode:
        said = done.stderr.strip().splitlines() or ["no reason given"]
        raise FlexarmError(f"git {' '.join(arguments)}: {said[-1]}", remedy="freeze and score in a clone with git")
    return done.stdout.strip()


def trees(commit: str, root: Path = ROOT) -> dict[str, str]:
    """Hashes of the trees of the rules and the judges in a commit; a folder that is not in it is left out."""
    listed = _git(root, "ls-tree", commit, *RULES, *JUDGES).splitlines()
    return {path: head.split()[2] for head, _, path in (line.partition("\t") for line in listed)}


def changes(commit: str, root: Path = ROOT, folders: Sequence[str] = RULES) -> list[str]:
    """Files of the rules, or of other folders, that differ now from the commit; with those that git does not know."""
    changed = _git(root, "diff", "--name-only", commit, "--", *folders).splitlines()
    return changed + _git(root, "ls-files", "--others", "--exclude-standard", "--", *folders).splitlines()


def freeze(root: Path = ROOT, record: Path = RECORD) -> Frozen:
    """Write down the present commit.

    Raises:
        FlexarmError: the rules differ from it, or there is no git.
    """
    commit = _git(root, "rev-parse", "HEAD")
    if changed := changes(commit, root):
        raise FlexarmError(
            f"{_few(changed)} differ from commit {commit[:12]}, which cannot be frozen so", remedy="commit them first"
        )
    made = Frozen(commit, trees(commit, root))
    with writing(record, (".json",)) as temporary:
        temporary.write_text(json.dumps(asdict(made), indent=1) + "\n", encoding="utf-8")
    return made


def frozen(record: Path = RECORD) -> Frozen | None:
    """What was frozen, if anything was."""
    if not record.exists():
        return None
    return Frozen(**json.loads(record.read_text(encoding="utf-8")))


def insist(root: Path = ROOT, record: Path = RECORD) -> Frozen:
    """What was frozen.

    Raises:
        FlexarmError: nothing was, or the rules have changed since.
    """
    made = frozen(record)
    if made is None:
        raise FlexarmError("no rules are frozen", remedy="run: python -m benchmarks.proof freeze")
    if changed := changes(made.commit, root):
        raise FlexarmError(
            f"{_few(changed)} changed since commit {made.commit[:12]} froze the rules",
            remedy="put them back, or freeze again: the seeds change with the commit",
        )
    return made


def seeds(commit: str, suite: str, count: int) -> list[int]:
    """Seeds of a suite: the k-th is SHA-256 of commit, suite and k, its first four bytes, modulo 1e6."""
    digests = (hashlib.sha256(f"{commit}{suite}{k}".encode()).digest() for k in range(count))
    return [int.from_bytes(digest[:4]) % 1_000_000 for digest in digests]


def code_state(root: Path = ROOT) -> str:
    """A hash of the program as it is now: every source and scenario of the packages, committed or not."""
    whole = hashlib.sha256()
    for package in ("engine", "blocks", "scenarios", "fmu", "diagnosis", "flexarm"):
        for path in sorted((root / package).rglob("*")):
            if path.suffix in (".py", ".c", ".h", ".yaml", ".html", ".js", ".css") and path.is_file():
                whole.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()[:12]


def _few(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
