"""A scenario split into FMUs and an SSP: it converges to the scenario as the step shrinks."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssd

import fmu
from engine.errors import FlexarmError
from engine.simulate import Drive, simulate
from flexarm.cut import cut
from flexarm.splitting.split import split
from fmu.ssp import cosim_ssp, read
from scenarios.load import load

STEP = Drive([0.0], [[1.0]])


def _split(tmp_path_factory: pytest.TempPathFactory, name: str, groups: dict[str, list[str]]) -> tuple[Path, Any]:
    made = cut(load(name), "export")
    path = tmp_path_factory.mktemp("ssp") / f"{name}.ssp"
    return split(made, path, groups, platforms=["linux64"], stop=1.0), made.model


@pytest.fixture(scope="module")
def linear(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """Cut at the spring between gearbox and link: the link keeps the motion."""
    return _split(tmp_path_factory, "srv02-3mass-b4", {"link": ["link", "bearing"]})


@pytest.fixture(scope="module")
def switching(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """Cut at the backlash: the drive, with dry friction at rest, keeps the motion of the gear's output."""
    return _split(tmp_path_factory, "reference-b", {"arm": ["contact", "link", "bearing"]})


def _errors(path: Path, model: Any, stop: float, steps: list[float], **settings: Any) -> np.ndarray:
    found = []
    for step in steps:
        run = simulate(model, stop, step, drive=STEP, internal_step=min(2.5e-4, step))
        trace = cosim_ssp(path, stop, step, drive=STEP, **settings)
        found.append(np.abs(trace.values[-1] - run.values[-1]).max())
    return np.array(found)


def test_the_package_is_valid_and_wired_by_cause(linear: tuple[Path, Any]) -> None:
    path, _ = linear
    described = read_ssd(str(path))  # validates against the schema of SSP 1.0
    assert {element.name for element in described.system.elements} == {"link", "rest"}
    structure = read(path)
    assert (("link", "link_shaft_angle"), ("rest", "cut_spring_b_angle")) in structure.connections
    assert (("link", "link_shaft_speed"), ("rest", "cut_spring_b_speed")) in structure.connections
    assert (("rest", "cut_spring_b_torque"), ("link", "cut_spring_b_torque_torque")) in structure.connections
    with zipfile.ZipFile(path) as archive:
        for source in structure.sources.values():
            (path.parent / "one.fmu").write_bytes(archive.read(source))
            assert fmu.validate(path.parent / "one.fmu") == []


def test_converges_with_order_two_when_rates_are_passed_on(
    linear: tuple[Path, Any], record_property: Callable[[str, object], None]
) -> None:
    errors = _errors(*linear, 0.5, [1e-3, 5e-4, 2.5e-4])
    orders = np.log2(errors[:-1] / errors[1:])
    record_property("orders", ", ".join(f"{order:.2f}" for order in orders))
    assert errors[-1] < 0.02
    assert (np.abs(orders - 2) < 0.3).all(), (errors, orders)


def test_converges_with_order_two_when_values_are_held(linear: tuple[Path, Any]) -> None:
    path, model = linear
    steps = [4e-5, 2e-5, 1e-5]
    errors = _errors(path, model, 0.05, steps, extrapolated=False)
    orders = np.log2(errors[:-1] / errors[1:])
    assert (np.abs(orders - 2) < 0.1).all(), (errors, orders)


def test_converges_in_fmpys_own_co_simulation(linear: tuple[Path, Any]) -> None:
    path, model = linear
    expected = simulate(model, 0.05, 1e-3, drive=STEP)["motor.shaft.speed"][-1]
    errors = []
    for step in (4e-5, 2e-5, 1e-5):
        run = simulate_ssp(str(path), stop_time=0.05 - step / 2, step_size=step, input={"motor_voltage": lambda t: 1.0})
        errors.append(abs(run["motor_shaft_speed"][-1] - expected))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (np.abs(orders - 1) < 0.1).all(), (errors, orders)


@pytest.mark.slow
def test_converges_with_backlash_and_friction(switching: tuple[Path, Any]) -> None:
    path, model = switching
    largest = []
    for step in (1e-3, 5e-4, 2.5e-4, 1.25e-4):
        run = simulate(model, 1.0, step, drive=STEP)
        trace = cosim_ssp(path, 1.0, step, drive=STEP)
        largest.append(np.abs(trace.values - run.values).max())
    ratios = np.array(largest[:-1]) / np.array(largest[1:])
    # Of order one at least, because the switches lie inside the steps.
    assert (ratios > 1.8).all(), (largest, ratios)


def test_fmi_3(linear: tuple[Path, Any], tmp_path: Path) -> None:
    """FMI 3 gives no rates to inputs: step by step the same as FMI 2 with values alone."""
    path, model = linear
    made = cut(load("srv02-3mass-b4"), "export")
    third = split(made, tmp_path / "x.ssp", {"link": ["link", "bearing"]}, platforms=["linux64"], stop=1.0, version=3)
    read_ssd(str(third))
    with zipfile.ZipFile(third) as archive:
        for source in read(third).sources.values():
            assert read_model_description(archive.extract(source, tmp_path)).fmiVersion == "3.0"
    given, expected = (cosim_ssp(p, 0.05, 2e-5, drive=STEP, extrapolated=False) for p in (third, path))
    assert np.array_equal(given.values, expected.values)
    errors = _errors(third, model, 0.05, [2e-5, 1e-5])
    assert abs(np.log2(errors[0] / errors[1]) - 2) < 0.1


def test_without_connectors(tmp_path: Path) -> None:
    made = cut(load("srv02-3mass-b4"), "export")
    path = split(made, tmp_path / "x.ssp", {"link": ["link", "bearing"]}, platforms=["linux64"], bare=True)
    read_ssd(str(path))
    assert all(start[0] and end[0] for start, end in read(path).connections)
    with pytest.raises(FlexarmError, match="no outputs of its own") as caught:
        cosim_ssp(path, 0.1)
    assert "--bare" in caught.value.remedy


def test_refusals_write_nothing(tmp_path: Path) -> None:
    made = cut(load("reference-a"), "export")
    for groups, piece in (
        ({"arm": ["lonk"]}, "did you mean 'link'"),
        ({"a": ["link"], "b": ["link"]}, "two groups"),
        ({"arm": ["motor", "gear", "bearing", "link"]}, "leaves one FMU"),
        ({"a b": ["link"]}, "cannot name an FMU"),
    ):
        with pytest.raises(FlexarmError) as caught:
            split(made, tmp_path / "x.ssp", groups, platforms=["linux64"])
        assert piece in str(caught.value)
        assert caught.value.remedy
    assert list(tmp_path.iterdir()) == []


def test_command_line(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from flexarm.cli import app

    path = str(tmp_path / "x.ssp")
    run = CliRunner().invoke
    made = run(app, ["export", "srv02-3mass-b4", "--split", "link=link,bearing", "--platforms", "linux64", "-o", path])
    assert made.exit_code == 0, made.output
    answer = run(app, ["cosim", path, "--scenario", "srv02-3mass-b4", "--step", "0.25 ms", "--stop", "1 s"])
    assert answer.exit_code == 0, answer.output
    assert float(answer.output.splitlines()[-1].removeprefix("largest difference: ")) < 0.02


def test_options_on_the_command_line(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from flexarm.cli import app

    path = tmp_path / "x.ssp"
    run = CliRunner().invoke
    common = ["export", "srv02-3mass-b4", "--platforms", "linux64"]
    refused = run(app, [*common, "--bare", "-o", str(tmp_path / "x.fmu")])
    assert refused.exit_code == 1
    refused = run(app, [*common, "--split", "link=link,bearing", "--linear-twin", "-o", str(path)])
    assert refused.exit_code == 1
    assert list(tmp_path.iterdir()) == []
    made = run(app, [*common, "--split", "link=link,bearing", "--fmi", "3", "--bare", "-o", str(path)])
    assert made.exit_code == 0, made.output
    assert read(path).connectors == ()
    with zipfile.ZipFile(path) as archive:
        versions = {
            read_model_description(archive.extract(source, tmp_path)).fmiVersion
            for source in read(path).sources.values()
        }
    assert versions == {"3.0"}
