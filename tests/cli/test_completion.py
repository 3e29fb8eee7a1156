"""What the shell is offered: asked through the protocol that the installed scripts use."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from blocks.registry import find, registry
from scenarios.load import load, shipped_names

ROOT = Path(__file__).resolve().parents[2]


def ask(line: str, folder: Path, shell: str = "bash", program: str = "", **settings: str) -> list[str]:
    """What is offered for the last word of a command line, an empty word if it ends in a space; after a program."""
    words = line.split(" ")
    environment = os.environ | {"PYTHONPATH": str(ROOT), "_FLEXARM_COMPLETE": f"complete_{shell}"} | settings
    environment |= {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1), "_TYPER_COMPLETE_ARGS": line}
    run = [sys.executable, "-c", f"{program}from flexarm.cli import main; main()"]
    done = subprocess.run(run, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.stderr == ""
    return [line for line in done.stdout.splitlines() if line]


def test_commands_and_shipped_scenarios(tmp_path: Path) -> None:
    assert "sweep" in ask("flexarm sw", tmp_path)
    for command in ("run", "check", "linearise", "export", "sweep"):
        assert ask(f"flexarm {command} quanser", tmp_path) == [n for n in shipped_names() if n.startswith("quanser")]
    assert ask("flexarm run ", tmp_path) == shipped_names()


HEAVY = {"blocks", "casadi", "control", "diagnosis", "matplotlib", "numpy", "pandas", "pint", "pyarrow", "scipy"}
"""Packages whose import would be felt at the prompt."""


def test_names_are_offered_without_heavy_imports(tmp_path: Path) -> None:
    program = "import atexit, sys; from pathlib import Path\n"
    program += "atexit.register(lambda: Path('modules').write_text(' '.join(sys.modules)))\n"
    assert ask("flexarm run ", tmp_path, program=program) == shipped_names()
    imported = set((tmp_path / "modules").read_text().split())
    assert "flexarm.cli" in imported
    assert not imported & HEAVY


def test_own_files_and_folders(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").touch()
    (tmp_path / "arms").mkdir()
    (tmp_path / "arms" / "two.yml").touch()
    (tmp_path / "arms" / "notes.txt").touch()
    (tmp_path / ".arm.yaml").touch()
    assert ask("flexarm run arm", tmp_path) == ["arm.yaml", "arms/"]
    assert ask("flexarm run arms/", tmp_path) == ["arms/two.yml"]
    assert ask(f"flexarm run {tmp_path}/ar", tmp_path) == [f"{tmp_path}/arm.yaml", f"{tmp_path}/arms/"]
    assert ask("flexarm run nowhere/", tmp_path) == []


@pytest.mark.parametrize("option", ["run quanser-single-link --set", "sweep quanser-single-link --vary"])
def test_keys_of_the_scenario(option: str, tmp_path: Path) -> None:
    """All that the block declares, and each key is one that --set accepts."""
    Gear = find("Gear")
    offered = ask(f"flexarm {option} gear.", tmp_path)
    assert sorted(offered) == sorted(f"gear.{key}" for key in (*Gear.parameters, *Gear.options))
    assert {"gear.ratio", "gear.efficiency"} <= set(offered)
    for key in ("gear.ratio", "link.mass", "supply", "simulate.stop"):
        assert key in ask(f"flexarm {option} {key[:-2]}", tmp_path)
        load("quanser-single-link", [f"{key}=0.5"])
    assert ask("flexarm run no-such-scenario --set gear.", tmp_path) == []


def test_blocks_with_their_meaning(tmp_path: Path) -> None:
    assert ask("flexarm blocks Harm", tmp_path) == ["HarmonicDrive"]
    shown = ask("flexarm blocks ", tmp_path, "fish", _TYPER_COMPLETE_FISH_ACTION="get-args")
    assert sorted(line.split("\t")[0] for line in shown if "\t" in line) == sorted(registry())
    assert any(line.startswith("HarmonicDrive\tHarmonic drive") for line in shown)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts_are_shown_and_installed(shell: str, tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "HOME": str(tmp_path), "SHELL": f"/bin/{shell}"}
    environment["_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION"] = "1"
    run = [sys.executable, "-m", "flexarm"]
    shown = subprocess.run([*run, "--show-completion", shell], env=environment, capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr
    assert "_FLEXARM_COMPLETE" in shown.stdout
    done = subprocess.run([*run, "--install-completion", shell], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert any("flexarm" in path.name for path in tmp_path.rglob("*flexarm*"))
    if shell == "bash" and shutil.which("bash"):
        script = tmp_path / "shown.sh"
        script.write_text(shown.stdout)
        assert subprocess.run(["bash", "-n", script]).returncode == 0
