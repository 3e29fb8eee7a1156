"""The documentation builds without a warning; its reference, figures and notebooks are made by that build."""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

from tools import gallery, notebooks

ROOT = Path(__file__).resolve().parents[2]


def build(folder: Any) -> None:
    """Build the pages. ``--strict`` makes every warning an error: a link, an anchor, a page outside the navigation."""
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1", "MPLBACKEND": "Agg"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stdout + done.stderr


def page(site: Path, name: str) -> str:
    return (site / name / "index.html").read_text(encoding="utf-8")


def every_claim_of_the_front_page_leads_somewhere(site: Any) -> None:
    rows = re.findall(r"<tr>\s*<td>(.*?)</td>\s*<td>(.*?)</td>", page(site, "."), re.DOTALL)
    assert len(rows) >= 12
    for claim, shown in rows:
        links = re.findall(r'href="([^"#]+)', shown)
        assert links, claim
        for link in links:
            assert (site / link / "index.html").exists(), (claim, link)


def every_block_is_in_the_reference(site: Any) -> None:
    from blocks.registry import registry

    index = page(site, "reference/blocks")
    families = {
        f: page(site, f"reference/blocks/{f}") for f in ("sources", "actuators", "links", "controllers", "sensors")
    }
    for name, cls in registry().items():
        if not cls.__module__.startswith("blocks."):
            continue
        assert f">{name}</a>" in index
        text = families[cls.__module__.split(".")[1]]
        assert f'id="{name.lower()}"' in text
        section = text.split(f'id="{name.lower()}"', 1)[1].split("<h2", 1)[0]
        for key in (*cls.parameters, *cls.options, *cls.ports):
            assert f"<code>{key}</code>" in section, (name, key)


def every_command_and_public_name_is_in_the_reference(site: Any) -> None:
    import flexarm
    from flexarm.cli import app

    commands, names = page(site, "reference/cli"), page(site, "reference/api")
    for command in app.registered_commands:
        assert command.callback is not None
        called = command.name or command.callback.__name__
        assert f'id="{called}"' in commands
    assert "--hold-out" in commands
    for name in flexarm.__all__:
        assert f">{name}<" in names, name


def every_figure_of_the_gallery_is_drawn_and_shown(site: Any) -> None:
    text = page(site, "gallery")
    for name in gallery.FIGURES:
        assert f"figures/gallery/{name}" in text, name
        content = (site / "figures" / "gallery" / name).read_bytes()
        if name.endswith(".png"):
            width, height = struct.unpack(">II", content[16:24])
            assert width >= 700
            assert height >= 300
        else:
            assert content.lstrip().startswith(b"<")
    assert text.count("<img") == len(gallery.FIGURES)


def the_notebooks_ran_to_their_end(site: Any) -> None:
    """The cells of a notebook assert what matters; their outputs stand on the page."""
    arm, diagnosis = page(site, "notebooks/first-arm"), page(site, "notebooks/diagnosis")
    assert "18.849558" in arm
    assert "coulomb_friction at motor.shaft" in diagnosis
    assert diagnosis.count("<img") == 2
    assert arm.count("<img") == 1


def test_the_documentation_builds_and_holds_what_it_promises(tmp_path: Path) -> None:
    """One test, so that parallel workers do not build the same pages twice."""
    build(tmp_path)
    every_claim_of_the_front_page_leads_somewhere(tmp_path)
    every_block_is_in_the_reference(tmp_path)
    every_command_and_public_name_is_in_the_reference(tmp_path)
    every_figure_of_the_gallery_is_drawn_and_shown(tmp_path)
    the_notebooks_ran_to_their_end(tmp_path)


def test_notebooks_are_kept_without_outputs() -> None:
    import nbformat

    found = sorted(notebooks.FOLDER.glob("*.ipynb"))
    assert [path.name for path in found] == ["diagnosis.ipynb", "first-arm.ipynb"]
    for path in found:
        for cell in nbformat.read(path, as_version=4).cells:  # type: ignore[no-untyped-call]
            assert not cell.get("outputs")
            assert cell.get("execution_count") is None
