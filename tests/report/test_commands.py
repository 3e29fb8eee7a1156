"""The commands that draw and report: what they write, and what they refuse before any work."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from flexarm.cli import main
from scenarios.load import load
from tests.diagnosis.plants import case


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.chdir(tmp_path)

    def run(*arguments: Any) -> tuple[Any, Any, Any]:
        code = 0
        try:
            main([str(a) for a in arguments])
        except SystemExit as end:
            code = int(end.code or 0)
        shown = capsys.readouterr()
        return code, shown.out, shown.err

    return run


def test_diagram_writes_an_svg_named_after_the_scenario(call: Any, tmp_path: Path) -> None:
    assert call("diagram", "srv02-bare") == (0, "written: srv02-bare.svg\n", "")
    assert (tmp_path / "srv02-bare.svg").read_text().startswith("<svg")
    code, out, _ = call("diagram", "srv02-bare", "-o", "a.png")
    assert (code, out) == (0, "written: a.png\n")


def test_diagram_refuses_other_kinds_of_file(call: Any, tmp_path: Path) -> None:
    code, _, err = call("diagram", "srv02-bare", "-o", "a.gif")
    assert code == 1
    assert ".svg, .png, .pdf" in err
    code, _, err = call("diagram", "srv02-bar")
    assert code == 1
    assert "srv02-bare" in err
    assert not list(tmp_path.iterdir())


def test_linearise_draws(call: Any, tmp_path: Path) -> None:
    code, out, _ = call("linearise", "lumped-arm-pulse", "-a", "slipping", "--plot", "a.svg")
    assert code == 0
    assert out.endswith("written: a.svg\n")
    assert call("linearise", "rigid-pendulum", "--plot")[1].endswith("written: rigid-pendulum-linear.png\n")
    assert (tmp_path / "rigid-pendulum-linear.png").stat().st_size > 20_000


def test_run_reports(call: Any, tmp_path: Path) -> None:
    code, out, _ = call("run", "srv02-bare", "--stop", "0.2 s", "--report", "a.html")
    assert code == 0
    assert out.endswith("written: a.html\n")
    assert "srv02-bare" in (tmp_path / "a.html").read_text()


def test_fit_and_compare_report(call: Any, tmp_path: Path) -> None:
    model = case(tmp_path, coulomb=4.0e-4, seed=3)
    code, out, _ = call("compare", model, "--report", "c.html")
    assert code == 0
    assert out.endswith("written: c.html\n")
    code, out, _ = call("fit", model, "--report", "f.html", "--workers", 1)
    assert code == 0
    assert out.endswith("written: f.html\n")
    comparison, fit = (tmp_path / "c.html").read_text(), (tmp_path / "f.html").read_text()
    for recording in load(model).recordings:
        assert recording in comparison
        assert recording in fit
    assert "95 % interval" in fit
    for command in ("compare", "fit"):
        code, out, err = call(command, model, "--report", "a.txt")
        assert (code, out) == (1, "")
        assert ".html" in err


@pytest.mark.parametrize(("name", "said"), [("a.txt", ".html"), ("nowhere/a.html", "no folder")])
def test_run_refuses_a_report_before_it_simulates(call: Any, name: str, said: str) -> None:
    code, out, err = call("run", "srv02-bare", "--report", name)
    assert (code, out) == (1, "")
    assert said in err
