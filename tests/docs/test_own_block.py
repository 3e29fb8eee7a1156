"""The package of "Write your own block" and "Register an effect": built, installed, used, and its own tests run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tools import console

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "examples" / "flexarm-own-block"
PAGE = ROOT / "docs" / "how-to" / "write-your-own-block.md"
EFFECT_PAGE = ROOT / "docs" / "how-to" / "register-an-effect.md"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    """A copy of the package, and the environment in which its wheel is installed; nothing is downloaded."""
    folder = tmp_path_factory.mktemp("own-block")
    copy = shutil.copytree(PACKAGE, folder / "package", ignore=shutil.ignore_patterns("__pycache__", "dist", "build"))
    target = folder / "site"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run([*command, "--target", str(target), str(copy)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return copy, os.environ | {"PYTHONPATH": str(target), "MPLBACKEND": "Agg"}


def call(arguments: Any, folder: Any, environment: Any) -> Any:
    return subprocess.run(
        [sys.executable, "-m", *arguments], cwd=folder, env=environment, capture_output=True, text=True, timeout=240
    )


def test_the_command_line_knows_and_runs_the_block(installed: tuple[Any, Any]) -> None:
    copy, environment = installed
    shown = call(["flexarm", "blocks", "EddyBrake"], copy, environment)
    assert shown.returncode == 0, shown.stderr
    assert "greatest_torque  N.m" in shown.stdout
    done = call(["flexarm", "run", "run-down.yaml", "-o", "run-down.csv"], copy, environment)
    assert done.returncode == 0, done.stderr
    assert (copy / "run-down.csv").exists()


def test_without_the_package_the_block_is_unknown(tmp_path: Path) -> None:
    shown = call(["flexarm", "blocks", "EddyBrake"], tmp_path, dict(os.environ))
    assert shown.returncode == 1
    assert "there is no block type 'EddyBrake'" in shown.stderr


def test_its_own_tests_pass(installed: tuple[Any, Any]) -> None:
    copy, environment = installed
    done = call(["pytest", "-q", "-p", "no:cacheprovider", "tests"], copy, environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "8 passed" in done.stdout


def follow(installed: Any, monkeypatch: pytest.MonkeyPatch, fast: Any) -> list[Any]:
    """Run the commands of the page on effects; what they print differs from what it shows in these lines."""
    copy, environment = installed
    monkeypatch.setenv("PYTHONPATH", environment["PYTHONPATH"])
    commands = [s for s in console.steps(EFFECT_PAGE.read_text(encoding="utf-8")) if isinstance(s, console.Command)]
    chosen = [c for c in commands if c.fails or not (fast and "diagnose" in c.line)]
    assert len(chosen) == (2 if fast else 3)
    # Where the bar of a long command was, an empty line stays.
    printed = [[line for line in console.run(c, copy) if line] for c in chosen]
    return [line for c, lines in zip(chosen, printed, strict=True) for line in console.differences(c, lines, 0.1)]


def test_the_page_on_effects_prints_what_it_shows(installed: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    assert not follow(installed, monkeypatch, fast=True)


@pytest.mark.slow
def test_the_diagnosis_on_the_page_names_the_registered_effect(
    installed: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not follow(installed, monkeypatch, fast=False)


def test_the_page_shows_the_files_as_they_are() -> None:
    """What stands indented under a file's name is in that file, line by line."""
    text = PAGE.read_text(encoding="utf-8") + EFFECT_PAGE.read_text(encoding="utf-8")
    blocks = re.findall(r'```\w+ title="([^"]+)"\n(.*?)```', text, re.DOTALL)
    sources = {f"src/flexarm_own_block/{name}.py" for name in ("eddy_brake", "torque_motor", "effects")}
    assert {name for name, _ in blocks} >= {"pyproject.toml", "run-down.yaml", "wheel.yaml", *sources}
    for name, shown in blocks:
        assert shown in (PACKAGE / name).read_text(encoding="utf-8"), name


def test_the_block_takes_about_forty_lines() -> None:
    lines = (PACKAGE / "src" / "flexarm_own_block" / "eddy_brake.py").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 40


def test_what_blocks_need_from_inside_is_public() -> None:
    """Every name that the library's own blocks import from the engine, and every function for laws, but for helpers."""
    import ast

    import blocks.symbolic
    import flexarm

    helpers = {"coherent", "compatible", "convert", "json_text", "nearest", "writing"}
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / "blocks").rglob("*.py")]
    needed = {
        alias.name
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("engine.")
        # A block of another package reads its files as it likes.
        if not (node.module or "").startswith("engine.readers.")
        for alias in node.names
    }
    assert len(needed) > 10
    assert needed - helpers <= {*flexarm.__all__, *flexarm.symbolic.__all__}
    functions = {
        name for name, made in vars(blocks.symbolic).items() if getattr(made, "__module__", "") == "blocks.symbolic"
    }
    assert functions <= set(flexarm.symbolic.__all__)


def test_examples_and_pages_import_from_flexarm_alone() -> None:
    inside = re.compile(r"^\s*(?:from|import) (?:engine|blocks|scenarios|fmu|diagnosis)\b", re.MULTILINE)
    for path in (*(ROOT / "examples").rglob("*.py"), PAGE):
        assert not inside.search(path.read_text(encoding="utf-8")), path
