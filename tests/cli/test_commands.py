"""The commands on good input."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest


def test_run_writes_every_kind_with_units(base: Path, command: Callable[..., Any]) -> None:
    import pyarrow.parquet
    from scipy.io import loadmat

    for suffix in ("csv", "parquet", "mat"):
        answer = command("run", base.name, "-o", f"r.{suffix}")
        assert answer.code == 0, answer.err
        assert f"written: r.{suffix}" in answer.out
    names = ["source.out", "zone.out", "load.shaft.angle"]
    header, *lines = (base.parent / "r.csv").read_text().splitlines()
    assert header == "time [s],source.out [V],zone.out [V],load.shaft.angle [rad]"
    values = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    assert values.shape == (101, 4)
    table = pyarrow.parquet.read_table(base.parent / "r.parquet")
    stated = json.loads(table.schema.metadata[b"flexarm"])
    assert stated["units"] == {"time": "s", "source.out": "V", "zone.out": "V", "load.shaft.angle": "rad"}
    assert stated["scenario"] == "base"
    assert len(stated["scenario_hash"]) == 16
    matlab = loadmat(base.parent / "r.mat", simplify_cells=True)
    assert list(matlab["flexarm_names"]) == ["time", *names]
    assert list(matlab["flexarm_units"]) == ["s", "V", "V", "rad"]
    for k, name in enumerate(names, 1):
        np.testing.assert_array_equal(table.column(name).to_numpy(), values[:, k])
        np.testing.assert_array_equal(matlab[name.replace(".", "_")], values[:, k])
    assert values[1, 2] == pytest.approx(1.0 - 0.18)


def test_run_takes_changes(base: Path, command: Callable[..., Any]) -> None:
    answer = command(
        "run", base.name, "--set", "supply=500 mV", "--set", "zone.upper=0.1", "--stop", "20 ms", "--step", "1 ms"
    )
    assert answer.code == 0
    rows = {line.split()[0]: line.split() for line in answer.out.splitlines() if line.startswith("  ")}
    assert rows["zone.out"][2] == "0.4"
    assert "0.02 s in 21 rows" in answer.out


def test_run_says_where_rows_end_before_the_run(base: Path, command: Callable[..., Any]) -> None:
    answer = command("run", base.name, "--stop", "0.1 s", "--step", "30 ms")
    assert "the last row is at 0.09 s: the step does not divide the 0.1 s" in answer.out
    assert "the last row" not in command("run", base.name, "--stop", "0.1 s", "--step", "1 ms").out


def test_plot_is_a_figure(base: Path, command: Callable[..., Any]) -> None:
    assert command("run", base.name, "--plot").code == 0
    assert command("run", "--plot", "other.svg", base.name).code == 0
    assert (base.parent / "base.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (base.parent / "other.svg").read_text()[:1000]
    assert {path.name for path in base.parent.iterdir()} == {"base.yaml", "base.png", "other.svg"}


def test_check_says_what_there_is(base: Path, command: Callable[..., Any]) -> None:
    answer = command("check", base.name)
    assert answer.code == 0
    assert "5 blocks, 4 connections, 2 states" in answer.out
    assert "bypassed by analysis plant: zone, source" in answer.out
    assert "no problems found" in answer.out


def test_blocks(command: Callable[..., Any]) -> None:
    listed = command("blocks").out
    assert "AssumedModesLink" in listed
    page = command("blocks", "DCMotor").out
    assert "torque_constant" in page
    assert "N.m/A" in page
    assert "V = R i + L di/dt" in page
    wrong = command("blocks", "DCMoter")
    assert wrong.code == 1
    assert "did you mean 'DCMotor'?" in wrong.err
    part = command("blocks", "friction")
    assert part.code == 1
    assert "BearingFriction, ElastoPlasticFriction, " in part.err
    assert "Gear" not in part.err


def test_a_picture_of_another_kind_is_refused_by_name(base: Path, command: Callable[..., Any]) -> None:
    answer = command("run", base.name, "--plot", "step.jpg")
    assert answer.code == 1
    assert "'step.jpg' is of no kind that can be written here\n  end it in .png, .pdf, .svg" in answer.err
    assert [path.name for path in base.parent.iterdir()] == ["base.yaml"]


def test_signals_of_very_different_size_get_panels_of_their_own() -> None:
    from flexarm.plotting.results import panels

    units = {"motor": "rad", "u": "V", "twist": "rad", "load": "rad", "none": "rad"}
    assert panels(units) == [("rad", ["motor", "twist", "load", "none"]), ("V", ["u"])]
    sizes = {"motor": 180.0, "u": 1.0, "twist": 1e-3, "load": 9.0, "none": 0.0}
    assert panels(units, sizes) == [("rad", ["motor", "load", "none"]), ("rad", ["twist"]), ("V", ["u"])]


def test_schema_is_json(base: Path, command: Callable[..., Any]) -> None:
    assert "$defs" in json.loads(command("schema").out)
    assert command("schema", "-o", "s.json").code == 0
    assert "$defs" in json.loads((base.parent / "s.json").read_text())


def test_linearise(base: Path, command: Callable[..., Any]) -> None:
    """Motor and gear: 0 and -km kt / (R J) with J the inertia seen by the motor."""
    from scipy.io import loadmat

    inertia = 4.6e-7 + 2e-3 / 70**2
    pole = -(7.68e-3**2) / 2.6 / inertia
    answer = command("linearise", base.name, "-o", "p.json")
    assert answer.code == 0, answer.err
    assert "bypassed by motor.voltage: zone, source" in answer.out
    stated = json.loads((base.parent / "p.json").read_text())
    np.testing.assert_allclose(np.sort([re for re, _ in stated["poles"]]), [pole, 0], rtol=1e-9, atol=1e-9)
    assert stated["units"]["load.shaft.angle"] == "rad"
    for suffix in ("npz", "mat", "m"):
        assert command("linearise", base.name, "-o", f"p.{suffix}").code == 0
    np.testing.assert_array_equal(np.load(base.parent / "p.npz")["A"], stated["A"])
    np.testing.assert_array_equal(loadmat(base.parent / "p.mat")["A"], stated["A"])
    assert "InputName = {'motor.voltage'};" in (base.parent / "p.m").read_text()


def test_linearise_through_the_dead_zone(base: Path, command: Callable[..., Any]) -> None:
    free = ["linearise", base.name, "--inputs", "zone.in", "--outputs", "load.shaft.speed"]
    inside = command(*free, "--mode", "zone.zone=inside", "-o", "a.json")
    above = command(*free, "--mode", "zone.zone=above", "-o", "b.json")
    number = command(*free, "--mode", "zone.zone=1", "-o", "c.json")
    assert (inside.code, above.code, number.code) == (0, 0, 0)
    gains = [np.abs(json.loads((base.parent / f"{n}.json").read_text())["B"]).max() for n in "abc"]
    assert gains[0] == 0
    assert gains[1] == gains[2] > 0
    open_ = command(*free, "-o", "d.json")
    first = open_.out.splitlines()[0]
    assert "with zone.zone above; assumed: 'zone.zone' is above, not inside as at the point" in first
    assert "zone.in would move no output" in first
    assert np.abs(json.loads((base.parent / "d.json").read_text())["B"]).max() == gains[1]
    wrong = command(*free, "--mode", "zone.zone=abov")
    assert wrong.code == 1
    assert "did you mean 'above'?" in wrong.err


def test_an_input_that_feeds_nothing_is_refused(base: Path, command: Callable[..., Any]) -> None:
    answer = command("linearise", base.name, "--inputs", "zone.in,motor.voltage", "--outputs", "load.shaft.angle")
    assert answer.code == 1
    assert "leave 'zone.in' out" in answer.err


def test_export(base: Path, command: Callable[..., Any]) -> None:
    """The FMU stands at the scenario's step, says what it bypasses, and passes FMPy's validation."""
    import fmu

    answer = command("export", base.name, "--platform", "linux64", "--inputs", "motor.voltage", "-o", "arm.fmu")
    assert answer.code == 0, answer.err
    assert "bypassed by motor.voltage: zone, source" in answer.out
    assert "outputs: load.shaft.angle [rad]" in answer.out
    assert fmu.validate(base.parent / "arm.fmu") == []
    for bad, piece in ((["-o", "arm.zip"], ".fmu"), (["--platform", "amiga", "-o", "b.fmu"], "amiga")):
        answer = command("export", base.name, *bad)
        assert answer.code == 1
        assert piece in answer.err
    assert {path.name for path in base.parent.iterdir()} == {"base.yaml", "arm.fmu", "arm_linear.mat", "arm_linear.m"}


def test_version(command: Callable[..., Any]) -> None:
    answer = command("--version")
    assert answer.code == 0
    assert answer.out.startswith("flexarm ")


def test_public_api() -> None:
    import flexarm

    for name in flexarm.__all__:
        assert getattr(flexarm, name) is not None
    result = flexarm.simulate("quanser-single-link", stop=0.1)
    assert result.units["link.hub.angle"] == "rad"
    with pytest.raises(AttributeError, match="nonsense"):
        _ = flexarm.nonsense


@pytest.mark.parametrize("effect", ["unknown", "wrong_parameter"])
def test_a_verdict_in_sentences_shows_no_unit_where_there_is_none(effect: str) -> None:
    """The points of a curve are not listed; a value of a vector, such as the mass of one link, is."""
    from types import SimpleNamespace as Made

    from flexarm.commands.diagnose import page

    sizes = {"gain": (58.4, "*"), "share": (0.5, "1"), "torque": (2.5, "N.m"), "heights[1]": (1.0, "N.m")}
    finding = {
        "effect": effect,
        "sentence": "A sentence.",
        "parameters": {n: {"value": v, "low": v / 2, "high": 2 * v, "unit": unit} for n, (v, unit) in sizes.items()},
        "when": "half of it within 1 s of 6 s, from 0.20-1.20 s",
        "frequency": "strongest at 0.7 Hz, in tip",
    }
    refit, chosen = Made(fit=Made(chi2=3.0), hold_out=2.0), Made(effects=())
    study = Made(scenario=Made(name="arm"), nominal=(9.0, 8.0), refit=refit, chosen=chosen, place_odds={}, failures=())
    made: Any = Made(verdict="named", findings=[finding], study=study, proposal=None, warnings=())
    text = page(made)
    assert "    gain = 58.4  (95 %: 29.2 " in text
    assert "    share = 0.5  (95 %: 0.25 " in text
    assert "    torque = 2.5 N.m  (95 %: 1.25 to 5)" in text
    curve = "    a curve of 1 point; its values are in diagnosis.json and amended.yaml\n"
    assert (curve in text) == (effect == "unknown")
    assert ("heights[1] = 1 N.m" in text) == (effect != "unknown")
    assert "    the mismatch: half of it within 1 s of 6 s, from 0.20-1.20 s; strongest at 0.7 Hz, in tip\n" in text


def test_a_figure_leaves_the_backend_of_a_notebook_alone(tmp_path: Path) -> None:
    """A backend that nothing here would choose is the same after every kind of figure that a model gives."""
    import matplotlib as mpl

    import flexarm
    from flexarm.plotting.frequency import plot_linear
    from flexarm.plotting.results import plot

    before = mpl.get_backend()
    mpl.use("svg")
    try:
        plot(flexarm.simulate("quanser-single-link"), tmp_path / "run.png")
        plot_linear(flexarm.linearise("quanser-single-link"), tmp_path / "bode.png")
        assert mpl.get_backend().lower() == "svg"
    finally:
        mpl.use(before)
    assert {p.name for p in tmp_path.iterdir()} == {"run.png", "bode.png"}


def test_check_names_flanges_that_nothing_is_connected_to(tmp_path: Path, command: Any) -> None:
    """A gear whose input was forgotten can be built and turns freely: that is worth a word."""
    (tmp_path / "loose.yaml").write_text(
        "schema: 1\nname: loose\nblocks:\n  gear: {type: Gear, ratio: 5, inertia: 1 g.m2}\n"
        "  arm: {type: Inertia, inertia: 1 kg.m2}\nconnect:\n  - [gear.output, arm.shaft]\n"
    )
    answer = command("check", str(tmp_path / "loose.yaml"))
    assert answer.code == 0, answer.err
    assert "connected to nothing: gear.input; is a connection missing?\n" in answer.out
    assert "connected to nothing" not in command("check", "quanser-single-link").out


def test_an_automatic_picture_never_replaces_that_of_another_file(command: Callable[..., Any], base: Path) -> None:
    folder = base.parent
    text = "schema: 1\nname: same\nblocks:\n  s: {type: Sine, amplitude: 1, frequency: 1 Hz}\nsimulate: {stop: 0.1 s}\n"
    for name in ("one", "two"):
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    (folder / "same-2.png").write_bytes(b"a photograph of the rig")
    for name, written in (("one", "same.png"), ("two", "same-3.png"), ("one", "same.png"), ("two", "same-3.png")):
        answer = command("run", f"{name}.yaml", "--plot")
        assert f"written: {written}\n" in answer.out, answer.out + answer.err
    assert (folder / "same-2.png").read_bytes() == b"a photograph of the rig"
    # Named, it is written where the user says.
    assert "written: same.png" in command("run", "two.yaml", "--plot", "same.png").out


def test_the_commands_are_all_there_whichever_is_called() -> None:
    """Only the command that is called is put in with its parameters; the list and mistakes know every one."""
    import typer

    from flexarm.cli import COMMANDS, application

    whole = typer.main.get_command(application())
    names = list(whole.commands)  # type: ignore[attr-defined]
    assert names == [command.__name__ for command in COMMANDS]
    for given in ([], ["--help"], ["nothing"], ["--version"]):
        some = typer.main.get_command(application(given))
        assert list(some.commands) == names  # type: ignore[attr-defined]
        for name, command in some.commands.items():  # type: ignore[attr-defined]
            assert command.get_short_help_str() == whole.commands[name].get_short_help_str()  # type: ignore[attr-defined]
    one = typer.main.get_command(application(["run", "x.yaml"]))
    assert list(one.commands) == ["run"]  # type: ignore[attr-defined]
    assert [p.name for p in one.commands["run"].params] == [p.name for p in whole.commands["run"].params]  # type: ignore[attr-defined]


def test_amplitudes_of_sines_as_a_range(base: Path, command: Callable[..., Any]) -> None:
    """As frequencies are given; '0.5:1.5:3' was a number with the unknown unit ':1.5:3'."""
    asked = ["describe", base, "-u", "motor.voltage", "-y", "motor.shaft.speed", "--frequencies", "1"]
    answer = command(*asked, "--amplitudes", "0.5 V:1500 mV:3")
    assert answer.code == 0, answer.err
    rows = answer.out.splitlines()
    assert [float(row.split()[0]) for row in rows[-3:]] == pytest.approx([0.5, 1.0, 1.5])
    answer = command(*asked, "--amplitudes", "0.5:1")
    assert answer.code == 1
    assert "--amplitudes: '0.5:1' is no range" in answer.err
