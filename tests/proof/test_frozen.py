"""Seeds follow from the commit that froze the rules, and a score with other rules is refused."""

from __future__ import annotations

import hashlib
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks.proof.frozen import changes, freeze, frozen, insist, seeds
from engine.errors import FlexarmError


def git(folder: Any, *arguments: Any) -> Any:
    name = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    return subprocess.run(["git", "-C", folder, *name, *arguments], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def clone(tmp_path: Path) -> Any:
    root = tmp_path / "clone"
    for package in ("diagnosis", "blocks", "engine"):
        (root / package).mkdir(parents=True)
        (root / package / "a.py").write_text("x = 1\n")
    git(root, "init", "-q")
    git(root, "add", ".")
    git(root, "commit", "-q", "-m", "first")
    return root


def test_freeze_notes_the_commit_and_its_trees(clone: Any, tmp_path: Path) -> None:
    record = tmp_path / "frozen.json"
    made = freeze(clone, record)
    assert made.commit == git(clone, "rev-parse", "HEAD").strip()
    assert made.trees["diagnosis"] == git(clone, "rev-parse", "HEAD:diagnosis").strip()
    assert frozen(record) == made
    assert insist(clone, record) == made


def test_changed_rules_are_refused(clone: Any, tmp_path: Path) -> None:
    record = tmp_path / "frozen.json"
    freeze(clone, record)
    (clone / "engine" / "a.py").write_text("x = 2\n")  # may change: it is no rule
    insist(clone, record)
    (clone / "diagnosis" / "a.py").write_text("x = 2\n")
    with pytest.raises(FlexarmError, match=r"diagnosis/a\.py changed since commit"):
        insist(clone, record)
    with pytest.raises(FlexarmError, match="cannot be frozen"):
        freeze(clone, record)
    git(clone, "commit", "-q", "-a", "-m", "second")
    with pytest.raises(FlexarmError, match="changed since"):
        insist(clone, record)


def test_a_file_that_git_does_not_know_is_a_change(clone: Any) -> None:
    (clone / "blocks" / "new.py").write_text("")
    assert changes("HEAD", clone) == ["blocks/new.py"]


def test_nothing_frozen(clone: Any, tmp_path: Path) -> None:
    with pytest.raises(FlexarmError, match="no rules are frozen"):
        insist(clone, tmp_path / "none.json")


def test_seeds_are_those_of_the_hash() -> None:
    commit = "0123456789abcdef0123456789abcdef01234567"
    digest = hashlib.sha256((commit + "core" + "0").encode()).hexdigest()
    assert seeds(commit, "core", 5)[0] == int(digest[:8], 16) % 1_000_000
    assert seeds(commit, "core", 5) == seeds(commit, "core", 9)[:5]
    assert seeds(commit, "core", 5) != seeds(commit, "pairs", 5)
    assert len(set(seeds(commit, "none", 5))) == 5
