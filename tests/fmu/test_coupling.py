"""Parts of a split coupled by masters that only pass values: right and stable at 1 ms (fault 3 of the importers' list).

The masters: twenty lines of Jacobi and Gauss-Seidel here, libcosim and Ecos. The reference is the whole scenario.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description

from engine.errors import FlexarmError
from engine.simulate import Drive, simulate
from flexarm.cut import cut
from flexarm.splitting.split import split
from fmu import archive
from fmu.host import Host, host
from fmu.ssp import Structure, read
from scenarios.load import load
from tests.fmu.test_importers import _imported

STOP, STEP = 0.5, 1e-3

HEAD = "schema: 1\nname: pair\nblocks:\n"
MOTOR = "  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7 kg.m2}\n"
GEAR = "  gear: {type: Gear, ratio: 70, efficiency: 0.9}\n"
ROTOR = 4.6e-7 * 70**2
"""Inertia of the rotor at the gear's output (kg.m2)."""


def _scenario(blocks: str, wires: str, outputs: str) -> str:
    return f"{HEAD}{blocks}connect:\n{wires}" + (
        f"simulate: {{stop: 0.5 s, step: 1 ms, record: [{outputs}]}}\n"
        f"analyses:\n  fmu: {{kind: export, inputs: [motor.voltage], outputs: [{outputs}]}}\n"
    )


def motor_and_link(ratio: float) -> tuple[str, dict[str, list[str]]]:
    """A motor of a tenth of the ratio's inertia drives a flexible link directly: a rigid cut."""
    mass = ratio * ROTOR * 3 / 0.419**2
    link = f"  link: {{type: AssumedModesLink, length: 0.419 m, mass: {mass} kg, flexural_rigidity: {2.1 * mass} N.m2, "
    link += "modes: 2, damping_ratio: [0.01, 0.01]}\n"
    wires = "  - [motor.shaft, gear.input]\n  - [gear.output, link.hub]\n"
    return _scenario(MOTOR + GEAR + link, wires, "link.hub.speed, link.tip.deflection"), {"link": ["link"]}


def geared_load(ratio: float) -> tuple[str, dict[str, list[str]]]:
    """Motor and gear turn a rigid load with friction of its bearing: a rigid cut between two inertias."""
    load = f"  load: {{type: Inertia, inertia: {ratio * ROTOR} kg.m2}}\n"
    inertia = ratio * ROTOR
    load += f"  brake: {{type: SpringDamper, stiffness: {30 * inertia} N.m/rad, damping: {inertia} N.m.s/rad}}\n"
    load += f"  tail: {{type: Inertia, inertia: {0.5 * inertia} kg.m2}}\n"
    wires = "  - [motor.shaft, gear.input]\n  - [gear.output, load.shaft, brake.a]\n  - [brake.b, tail.shaft]\n"
    return _scenario(MOTOR + GEAR + load, wires, "load.shaft.speed, tail.shaft.speed"), {
        "load": ["load", "brake", "tail"]
    }


def two_links(ratio: float) -> tuple[str, dict[str, list[str]]]:
    """Two bodies in a row behind the gear, each on its spring; cut at the spring of the second."""
    blocks = MOTOR + GEAR
    wires = "  - [motor.shaft, gear.input]\n  - [gear.output, spring1.a]\n"
    wires += "  - [spring1.b, link1.shaft, spring2.a]\n  - [spring2.b, link2.shaft]\n"
    for k, size in ((1, 1.0), (2, ratio)):
        inertia = size * ROTOR
        blocks += (
            f"  spring{k}: {{type: SpringDamper, stiffness: {900 * inertia} N.m/rad, damping: {inertia} N.m.s/rad}}\n"
        )
        blocks += f"  link{k}: {{type: Inertia, inertia: {inertia} kg.m2}}\n"
    return _scenario(blocks, wires, "link1.shaft.speed, link2.shaft.speed"), {"second": ["spring2", "link2"]}


PAIRS = {"motor and link": motor_and_link, "geared load": geared_load, "two links": two_links}


class Package:
    """A scenario, cut, and the whole it must agree with."""

    def __init__(self, text: str, groups: dict[str, list[str]], folder: Path) -> None:
        file = folder / "pair.yaml"
        file.write_text(text, encoding="utf-8")
        made = cut(load(file), "export")
        self.whole = split(made, folder / "whole.ssp", groups, platforms=["linux64"], stop=STOP)
        self.bare = split(made, folder / "bare.ssp", groups, platforms=["linux64"], stop=STOP, bare=True)
        self.structure = read(self.whole)
        self.expected = simulate(made.model, STOP, STEP, drive=Drive([0.0], [[1.0]]), internal_step=1e-4).values

    def error(self, rows: np.ndarray) -> float:
        """The largest difference, relative to each signal's range."""
        expected = self.expected if len(rows) == len(self.expected) else self.expected[-len(rows) :]
        return float((np.abs(rows - expected).max(axis=0) / np.ptp(self.expected, axis=0)).max())


@contextmanager
def hosts(path: Path, structure: Structure) -> Iterator[dict[str, Host]]:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        archive.unpack(path, folder)
        yield {name: stack.enter_context(host(folder / file, name)) for name, file in structure.sources.items()}


def master(path: Path, step: float, *, seidel: bool) -> np.ndarray:
    """Values are read, then handed on; in Gauss-Seidel each FMU has those of the FMUs that stepped before it."""
    structure, rows = read(path), []
    with hosts(path, structure) as parts, ExitStack() as starting:

        def values() -> dict[tuple[str, str], float]:
            return {start: parts[start[0]].get([start[1]])[0] for start, _ in structure.connections if start[0]}

        def give(known: dict[tuple[str, str], float]) -> None:
            for start, end in structure.connections:
                if end[0]:
                    parts[end[0]].set([end[1]], [known.get(start, 1.0)])

        for part in parts.values():
            starting.enter_context(part.starting(0.0, STOP))
        for _ in range(2):
            give(values())
        starting.close()
        for k in range(round(STOP / step)):
            known = values()
            rows.append([known[start] for start, end in structure.connections if not end[0]])
            give(known)
            for part in parts.values():
                part.step(k * step, step)
                if seidel:
                    give(values())
        known = values()
        rows.append([known[start] for start, end in structure.connections if not end[0]])
    return np.array(rows)


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, float], Package]:
    made: dict[tuple[str, float], Package] = {}

    def make(pair: str, ratio: float) -> Package:
        if (pair, ratio) not in made:
            made[pair, ratio] = Package(*PAIRS[pair](ratio), tmp_path_factory.mktemp("pair"))
        return made[pair, ratio]

    return make


each_pair = pytest.mark.parametrize("pair", PAIRS)
each_ratio = pytest.mark.parametrize("ratio", [0.01, 0.1, 1.0, 10.0, 100.0])


@each_pair
@each_ratio
@pytest.mark.parametrize("seidel", [False, True])
def test_a_master_of_twenty_lines(
    pair: str, ratio: float, seidel: bool, packages: Any, record_property: Callable[[str, object], None]
) -> None:
    made = packages(pair, ratio)
    error = made.error(master(made.whole, STEP, seidel=seidel))
    record_property("error", f"{100 * error:.2f} %")
    assert error <= 0.02


@each_pair
@pytest.mark.parametrize("ratio", [0.01, 1.0, 100.0])
@pytest.mark.parametrize("importer", ["libcosimpy", "ecospy"])
def test_libcosim_and_ecos(importer: str, pair: str, ratio: float, packages: Any, tmp_path: Path) -> None:
    made = packages(pair, ratio)
    rows = {"libcosimpy": _in_libcosimpy, "ecospy": _in_ecospy}[importer](made, tmp_path)
    assert made.error(rows) <= 0.02


def _ends(made: Package) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    wires = made.structure.connections
    return [end for start, end in wires if not start[0]], [start for start, end in wires if not end[0]]


def _in_libcosimpy(made: Package, folder: Path) -> np.ndarray:
    execution, observer = _imported("libcosimpy.CosimExecution"), _imported("libcosimpy.CosimObserver")
    archive.unpack(made.bare, folder)
    references = {}
    for name, source in made.structure.sources.items():
        variables = read_model_description(str(folder / source)).modelVariables
        references[name] = {variable.name: variable.valueReference for variable in variables}
    inputs, outputs = _ends(made)
    run = execution.CosimExecution.from_ssp_file(str(made.bare), round(STEP * 1e9))
    index = {name: run.slave_index_from_instance_name(name) for name in references}
    for name, variable in inputs:
        assert run.real_initial_value(index[name], references[name][variable], 1.0)
    seen = observer.CosimObserver.create_last_value()
    run.add_observer(seen)
    rows = []
    for k in range(1, round(STOP / STEP) + 1):
        assert run.simulate_until(round(k * STEP * 1e9))
        rows.append([seen.last_real_values(index[n], [references[n][v]])[0] for n, v in outputs])
    return np.array(rows)


def _in_ecospy(made: Package, folder: Path) -> np.ndarray:
    inputs, outputs = _ends(made)
    rows = []
    with _imported("ecospy").EcosSimulation(STEP, ssp_path=str(made.bare)) as run:
        for name, variable in inputs:
            run.set_real(f"{name}::{variable}", 1.0)
        run.init()
        for _ in range(round(STOP / STEP)):
            run.step(1)
            rows.append([run.get_real(f"{name}::{variable}") for name, variable in outputs])
    return np.array(rows)


def test_the_error_falls_with_the_square_of_the_step(packages: Any) -> None:
    made = packages("two links", 1.0)
    errors = [
        np.abs(master(made.whole, step, seidel=False)[-1] - made.expected[-1]).max() for step in (2e-3, 1e-3, 5e-4)
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (orders > 1.7).all(), (errors, orders)


def test_friction_on_both_sides_of_a_rigid_cut_is_refused(tmp_path: Path) -> None:
    """A stuck joint cannot follow a motion that is imposed on it, so one side must be free of friction at the cut."""
    friction = "{type: BearingFriction, coulomb_friction: 1 mN.m}"
    blocks = MOTOR + GEAR + f"  rub1: {friction}\n  rub2: {friction}\n  load: {{type: Inertia, inertia: 1 g.m2}}\n"
    wires = "  - [motor.shaft, gear.input, rub1.shaft]\n  - [gear.output, load.shaft, rub2.shaft]\n"
    file = tmp_path / "rub.yaml"
    file.write_text(_scenario(blocks, wires, "load.shaft.speed"), encoding="utf-8")
    with pytest.raises(FlexarmError) as caught:
        split(cut(load(file), "export"), tmp_path / "x.ssp", {"load": ["load", "rub2"]}, platforms=["linux64"])
    assert "neither end" in str(caught.value)
    assert "or leave gear, load, rub2 in one FMU" in str(caught.value.remedy)
    assert not (tmp_path / "x.ssp").exists()
