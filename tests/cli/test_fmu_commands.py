"""``flexarm export``, ``cosim`` and ``linearise``: options, refusals, and files that are whole or absent."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("version", ["2", "3"])
def test_export_and_cosim(version: str, base: Path, command: Callable[..., Any]) -> None:
    made = command("export", base.name, "--fmi", version, "--platforms", "linux64", "--linear-twin", "-o", "arm.fmu")
    assert made.code == 0, made.err
    assert _names(base.parent) == {"base.yaml", "arm.fmu", "arm_linear.mat", "arm_linear.m"}
    assert "written: arm_linear.m" in made.out
    given = ["--input", "motor.voltage=2 V", "--stop", "0.5 s", "--scenario", base.name]
    answer = command("cosim", "arm.fmu", *given)
    assert answer.code == 0, answer.err
    assert "input motor_voltage = 2 V" in answer.out
    assert "load_shaft_angle_lin" in answer.out
    largest = float(answer.out.splitlines()[-1].removeprefix("largest difference: "))
    assert largest <= 1e-12


def test_a_step_that_does_not_divide_the_run_is_compared_too(base: Path, command: Callable[..., Any]) -> None:
    command("export", base.name, "--platforms", "linux64", "-o", "arm.fmu")
    given = ["--scenario", base.name, "--step", "3 ms", "--stop"]
    ends = [command("cosim", "arm.fmu", *given, stop) for stop in ("0.2 s", "0.201 s")]
    assert [answer.code for answer in ends] == [0, 0], ends[0].err
    # Inside steps of 3 ms the FMU and the runner choose steps of their own.
    largest = [float(answer.out.splitlines()[-1].removeprefix("largest difference: ")) for answer in ends]
    assert largest[0] == largest[1] < 1e-7


def test_scripts_have_names_that_matlab_can_call(base: Path, command: Callable[..., Any]) -> None:
    made = command("export", base.name, "--platforms", "linux64", "-o", "2-mass arm.fmu")
    assert made.code == 0, made.err
    script = "x2_mass_arm_linear.m"
    assert _names(base.parent) == {"base.yaml", "2-mass arm.fmu", "2-mass arm_linear.mat", script}
    assert f"written: {script}" in made.out
    for name, better in (("my-plant", "my_plant"), ("2nd", "x2nd")):
        answer = command("linearise", base.name, "-o", f"{name}.m")
        assert answer.code == 1
        assert f"MATLAB cannot run a script that is called '{name}.m'\n  write it as {better}.m" in answer.err


def test_cosim_takes_the_parameters_of_the_fmu(base: Path, command: Callable[..., Any]) -> None:
    """An FMU exported with another value agrees with the scenario as it stands, because its own value is used."""
    command("export", base.name, "-s", "load.inertia=0.004 kg.m2", "--platforms", "linux64", "-o", "arm.fmu")
    answer = command("cosim", "arm.fmu", "--scenario", base.name, "--stop", "0.2 s")
    assert float(answer.out.splitlines()[-1].removeprefix("largest difference: ")) <= 1e-12


def test_refusals_write_nothing(base: Path, command: Callable[..., Any]) -> None:
    for bad, piece in (
        (["--fmi", "1"], "allowed: 2, 3"),
        (["--platforms", "linux64,amiga"], "amiga"),
        (["--backend", "rust"], "allowed: c, python"),
        (["--inputs", "motor.volt"], "motor.voltage"),
        (["--outputs", "load.shaft.angel"], "load.shaft.angle"),
        (["-o", "nowhere/arm.fmu"], "no folder"),
        (["--split", "a=motor", "--split", "a=load"], "--split a=load: two FMUs are called 'a'"),
        (["--split", "a=load", "--at", "motor.shaft.angle=1"], "--at"),
    ):
        answer = command("export", base.name, *bad)
        assert answer.code == 1, (bad, answer.out)
        assert piece in answer.err
    (base.parent / "arm_linear.m").mkdir()
    answer = command("export", base.name, "--platforms", "linux64", "-o", "arm.fmu")
    assert answer.code == 1
    assert "arm_linear.m" in answer.err
    assert _names(base.parent) == {"base.yaml", "arm_linear.m"}


def test_cosim_refusals(base: Path, command: Callable[..., Any]) -> None:
    (base.parent / "broken.fmu").write_bytes(b"no archive")
    command("export", base.name, "--platforms", "linux64", "-o", "arm.fmu")
    for arguments, piece in (
        (["missing.fmu"], "no file"),
        (["broken.fmu"], "no FMU that can be read"),
        (["base.yaml"], "neither FMU nor SSP"),
        (["arm.fmu", "--input", "motor.volt=1 V"], "motor_voltage"),
        (["arm.fmu", "--input", "motor.voltage=1 rad"], "rad"),
        (["arm.fmu", "--scenario", "lumped-arm-pulse"], "inputs are"),
        (["arm.fmu", "-s", "load.inertia=1"], "--scenario"),
        (["arm.fmu", "--analysis", "plant"], "--analysis is of a scenario, and none is given"),
    ):
        answer = command("cosim", *arguments)
        assert answer.code == 1, arguments
        assert piece in answer.err, answer.err


def test_cosim_compares_what_was_exported_with_chosen_inputs(base: Path, command: Callable[..., Any]) -> None:
    chosen = ["-u", "zone.in", "-y", "load.shaft.speed"]
    made = command("export", base.name, *chosen, "--platforms", "linux64", "-o", "zone.fmu")
    assert made.code == 0, made.err
    wrong = command("cosim", "zone.fmu", "--scenario", base.name)
    assert wrong.code == 1
    assert "--inputs and --outputs" in wrong.err
    right = command("cosim", "zone.fmu", "--scenario", base.name, *chosen, "--stop", "0.2 s")
    assert right.code == 0, right.err
    assert "largest difference: 0\n" in right.out
    alone = command("cosim", "zone.fmu", *chosen)
    assert alone.code == 1
    assert "add --scenario NAME" in alone.err


def test_linearise_says_when_the_point_is_no_equilibrium(base: Path, command: Callable[..., Any]) -> None:
    rest = command("linearise", base.name)
    assert "not an equilibrium" not in rest.out
    driven = command("linearise", base.name, "--at", "motor.voltage=1 V", "-o", "p.json")
    assert driven.code == 0, driven.err
    assert "not an equilibrium" in driven.out
    stated = json.loads((base.parent / "p.json").read_text())
    # Torque through the gear over the inertia at the motor: kt V / R / (J + JL / n^2) at the load's side.
    rate = 7.68e-3 / 2.6 / (4.6e-7 + 2e-3 / 70**2) / 70
    assert not stated["equilibrium"]
    assert stated["moving"] == {"gear.output.speed": pytest.approx(rate, rel=1e-9)}
    assert stated["point"]["motor.voltage"] == 1.0
    # A steady turn under a voltage that balances the back-EMF is one: only the angle moves, on which nothing depends.
    turning = command("linearise", base.name, "--at", "load.shaft.speed=1 rad/s", "--at", "motor.voltage=0.5376 V")
    assert "not an equilibrium" not in turning.out, turning.out


def test_linearise_refuses_the_edge_of_a_dead_zone(base: Path, command: Callable[..., Any]) -> None:
    free = ["linearise", base.name, "--inputs", "zone.in", "--outputs", "load.shaft.speed"]
    text = base.read_text()
    edge = next(line for line in text.splitlines() if "DeadZone" in line)
    upper = edge.split("upper:")[1].split("}")[0].strip().rstrip(",")
    answer = command(*free, "--at", f"zone.in={upper}", "-o", "p.json")
    assert answer.code == 1
    assert "--mode 'zone.zone=inside' or --mode 'zone.zone=above'" in answer.err
    assert not (base.parent / "p.json").exists()
    chosen = command(*free, "--at", f"zone.in={upper}", "--mode", "zone.zone=above", "-o", "p.json")
    assert chosen.code == 0
    assert json.loads((base.parent / "p.json").read_text())["modes"]["zone.zone"] == "above"


def test_linearise_in_discrete_time(command: Callable[..., Any], tmp_path: Path) -> None:
    kinds = ["json", "npz", "mat", "m"]
    arguments = [piece for kind in kinds for piece in ("-o", str(tmp_path / f"b.{kind}"))]
    answer = command(
        "linearise",
        "reference-b",
        "-u",
        "pi.reference",
        "-y",
        "link.hub.angle",
        "--mode",
        "zone.zone=inside",
        *arguments,
    )
    assert answer.code == 0, answer.err
    assert "in discrete time, every 0.001 s" in answer.out
    stated = json.loads((tmp_path / "b.json").read_text())["discrete"]
    assert stated["dt"] == 1e-3
    arrays = np.load(tmp_path / "b.npz")
    cells = loadmat(tmp_path / "b.mat", simplify_cells=True)
    for key in "ABCD":
        np.testing.assert_array_equal(arrays[f"discrete_{key}"], stated[key])
        np.testing.assert_array_equal(np.atleast_2d(cells["discrete"][key]).reshape(np.shape(stated[key])), stated[key])
    assert list(arrays["discrete_states"]) == stated["states"] == list(cells["discrete"]["states"])
    assert list(arrays["modes"][:, 0]) == list(stated["modes"])
    assert "reference_b_discrete = ss(" in (tmp_path / "b.m").read_text()


def test_a_block_with_one_mode_gives_it_its_name(base: Path, command: Callable[..., Any]) -> None:
    free = ["linearise", base.name, "--inputs", "zone.in", "--outputs", "load.shaft.speed"]
    short, whole = (command(*free, "--mode", f"{name}=above") for name in ("zone", "zone.zone"))
    assert short.code == 0, short.err
    assert short.out == whole.out
    assert "above" in short.out


def test_a_family_is_not_reduced(base: Path, command: Callable[..., Any]) -> None:
    """It was written whole, and nothing said so."""
    answer = command("linearise", base.name, "--grid", "load.inertia=1e-3:2e-3:2", "--reduce", 1, "-o", "f.json")
    assert answer.code == 1
    assert "--reduce: a family is not reduced" in answer.err
    assert not (base.parent / "f.json").exists()


@pytest.mark.parametrize("option", ["--grid load.inertia=1e-3:2e-3:2", "--at load.shaft.speed=1", "--mode zone=inside"])
def test_a_name_is_given_once(option: str, base: Path, command: Callable[..., Any]) -> None:
    """The last one counted, and a grid of two became one of one."""
    answer = command("linearise", base.name, *option.split(), *option.split())
    assert answer.code == 1
    assert f"{option.split()[0]}: '{option.split()[1].partition('=')[0]}' is given twice" in answer.err
