"""The tutorial as a reader follows it: its files are written, its commands run, and they print what the pages show."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tools import console

TUTORIAL = console.ROOT / "docs" / "tutorial"
PAGES = ("first-arm.md", "own-arm.md", "linear-and-fmu.md", "first-diagnosis.md")
# Fits and intervals follow the optimiser's path, which compilers and libraries change a little.
FITTED = ("fit", "diagnose", "compare found")
TRUE_FRICTION = 5.057179e-5
"""N.m; `python -m benchmarks.concealed make` seals it with the recordings of the last page."""


def follow(page: Any, folder: Any, leave_out: Any = ()) -> Any:
    """Do what a page says; its earlier pages' files are there already."""
    console.prepare(folder)
    for earlier in PAGES[: PAGES.index(page)]:
        for step in console.steps((TUTORIAL / earlier).read_text(encoding="utf-8")):
            if isinstance(step, console.File):
                (folder / step.name).write_text(step.text, encoding="utf-8")
    wrong, commands = [], 0
    for step in console.steps((TUTORIAL / page).read_text(encoding="utf-8")):
        if isinstance(step, console.File):
            (folder / step.name).write_text(step.text, encoding="utf-8")
            continue
        if any(word in step.line for word in leave_out):
            continue
        commands += 1
        tolerance = 0.1 if any(f"flexarm {word}" in step.line for word in FITTED) else 2e-3
        wrong += [f"{step.line}: {line}" for line in console.differences(step, console.run(step, folder), tolerance)]
    assert not wrong, "\n".join([f"{page}; `python -m tools.console` writes the output of today into it", *wrong])
    return commands


@pytest.mark.parametrize("page", PAGES[:3])
def test_the_tutorial_does_what_it_shows(page: Any, tmp_path: Path) -> None:
    assert follow(page, tmp_path, leave_out=("make demo",)) >= 3


@pytest.mark.slow
def test_the_demonstration_prints_what_the_first_page_shows(tmp_path: Path) -> None:
    assert follow(PAGES[0], tmp_path) >= 4
    assert (tmp_path / "demo-results" / "quanser.fmu").exists()


@pytest.mark.slow
def test_the_first_diagnosis_finds_what_was_put_in(tmp_path: Path) -> None:
    follow(PAGES[3], tmp_path)
    found = json.loads((tmp_path / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    (finding,) = found["findings"]
    assert (finding["effect"], finding["place"]) == ("coulomb_friction", "motor.shaft")
    size = finding["parameters"]["coulomb_friction"]
    assert size["low"] < TRUE_FRICTION < size["high"]


def test_every_page_of_the_tutorial_is_followed() -> None:
    assert {page.name for page in TUTORIAL.glob("*.md")} == {*PAGES, "index.md"}


def test_the_recordings_are_those_that_the_page_says(tmp_path: Path) -> None:
    """Made again from the seed on the page, they are the files that are shipped, to a count and the noise's digits."""
    from benchmarks.concealed.__main__ import main

    text = (TUTORIAL / "first-diagnosis.md").read_text(encoding="utf-8")
    line = text[text.index("python -m benchmarks.concealed make") :].split("-o case")[0].replace("\\\n", " ")
    case, sealed = tmp_path / "case", tmp_path / "sealed"
    assert main([*line.split()[3:], "-o", str(case), "--answers", str(sealed)]) == 0
    (answer,) = json.loads((sealed / "case.json").read_text(encoding="utf-8"))["concealed"]
    assert answer["parameters"]["coulomb_friction"] == pytest.approx(TRUE_FRICTION, rel=1e-6)
    for k, name in enumerate(("steps", "chirp", "reversal", "ramp"), start=1):
        made = np.loadtxt(case / f"rec{k}.csv", delimiter=",", skiprows=1)
        shipped = np.loadtxt(TUTORIAL / "data" / f"{name}.csv", delimiter=",", skiprows=1)
        np.testing.assert_allclose(made[:, :3], shipped[:, :3], atol=1.01)
        np.testing.assert_allclose(made[:, 3], shipped[:, 3], atol=1e-5)
