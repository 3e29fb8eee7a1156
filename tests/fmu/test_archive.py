"""The archive: valid, reproducible, self-contained, rebuildable; and exports that must fail."""

from __future__ import annotations

import os
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu

import fmu
from blocks.links.inertia import Inertia
from engine import compile as engine_compile
from engine.assemble import build
from engine.block import Block, parameter, signal_in, signal_out
from engine.errors import FlexarmError
from engine.model import Model
from engine.simulate import Drive, simulate
from engine.system import Connection, System
from fmu import package
from fmu.source import headers
from fmu.units import definition
from fmu.variables import flat, per_second, structured

MODELS = ["smooth_model", "switching_model", "timed_model"]
each_model = pytest.mark.parametrize("name", MODELS)
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks into the linux64 binary")


def _unpack(path: Path, folder: Path) -> Path:
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder


@each_model
def test_fmpy_finds_no_problem(name: str, exported: Any, request: pytest.FixtureRequest) -> None:
    path = exported(request.getfixturevalue(name))
    assert fmu.validate(path) == []
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None


def test_fmpy_simulates_it_as_anyone_would(smooth_model: Model, exported: Any) -> None:
    rows = simulate_fmu(
        str(exported(smooth_model)), stop_time=1.0, output_interval=1e-2, start_values={"gear.ratio": 60}
    )
    assert np.array_equal(rows["link_hub_angle"], np.zeros(101))
    signal = np.array([(0.0, 1.0), (1.0, 1.0)], dtype=[("time", float), ("motor_voltage", float)])
    rows = simulate_fmu(str(exported(smooth_model)), stop_time=1.0, output_interval=1e-2, input=signal)
    expected = simulate(smooth_model, 1.0, drive=Drive([0.0], [[1.0]]))["link.hub.angle"][::10]
    assert np.allclose(rows["link_hub_angle"], expected, rtol=1e-12, atol=1e-12)


def test_the_description_says_what_the_model_is(switching_model: Model, exported: Any) -> None:
    description = read_model_description(str(exported(switching_model)))
    by_name = {v.name: v for v in description.modelVariables}
    voltage = by_name["controller_reference"]
    assert (voltage.causality, voltage.variability, voltage.start) == ("input", "continuous", "0.0")
    efficiency = by_name["gear.efficiency"]
    assert (efficiency.max, efficiency.start) == ("1.0", "0.9")
    assert 0 < float(efficiency.min) < 1e-300  # zero itself is refused, and XML has closed bounds alone
    assert (efficiency.variability, efficiency.unit, efficiency.causality) == ("tunable", "1", "parameter")
    assert by_name["motor.resistance"].nominal == "2.6"
    assert by_name["der(gear.output.speed)"].unit == "rad/s2"
    assert by_name["der(gear.output.speed)"].derivative is by_name["gear.output.speed"]
    assert "+1" in by_name["play.contact.mode"].description
    assert [unit.name for unit in description.unitDefinitions] == sorted(u.name for u in description.unitDefinitions)
    slave = description.coSimulation
    assert slave.canGetAndSetFMUstate
    assert slave.canSerializeFMUstate
    assert slave.providesDirectionalDerivative
    assert slave.canHandleVariableCommunicationStepSize
    assert not slave.needsExecutionTool
    unknowns = {unknown.variable.name for unknown in description.initialUnknowns}
    assert unknowns >= {flat(output.name) for output in switching_model.outputs}


@pytest.mark.parametrize(
    ("unit", "exponents", "factor"),
    [
        ("N.m/rad", {"kg": 1, "m": 2, "s": -2, "rad": -1}, 1.0),
        ("kg.m2", {"kg": 1, "m": 2}, 1.0),
        ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}, 1.0),
        ("ohm", {"kg": 1, "m": 2, "s": -3, "A": -2}, 1.0),
        ("rad/s", {"rad": 1, "s": -1}, 1.0),
        ("g", {"kg": 1}, 1e-3),
        ("1", {}, 1.0),
    ],
)
def test_units_by_their_base_units(unit: str, exponents: dict[str, int], factor: float) -> None:
    made = definition(unit)
    assert made is not None
    assert made.exponents == exponents
    assert made.factor == pytest.approx(factor, rel=1e-15)


def test_names_for_importers() -> None:
    assert flat("link.hub.angle") == "link_hub_angle"
    assert flat("link.damping_ratio[2]") == "link_damping_ratio_2"
    assert structured("link.damping_ratio[2]") == "link.damping_ratio[2]"
    assert structured("it's + b.x") == r"'it\'s + b'.x"
    assert [per_second(u) for u in ("rad", "rad/s", "V", "N.m.s/rad", "1/m", "")] == [
        "rad/s",
        "rad/s2",
        "V/s",
        "N.m.s/(rad.s)",
        "1/(m.s)",
        "",
    ]


@linux
@each_model
def test_symbols_are_exactly_the_functions_of_fmi(
    name: str, exported: Any, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    folder = _unpack(exported(request.getfixturevalue(name)), tmp_path)
    [binary] = folder.glob("binaries/linux64/*.so")
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("nm is not installed")
    run = subprocess.run([nm, "-D", binary], capture_output=True, text=True, check=True).stdout
    defined = {line.split()[2] for line in run.splitlines() if len(line.split()) == 3 and line.split()[1] not in "wU"}
    standard = set(re.findall(r"FMI2_Export fmi2\w+TYPE\s+(fmi2\w+);", headers(2)["fmi2Functions.h"]))
    assert len(standard) == 44
    assert defined == standard
    needed = {tuple(map(int, v.split("."))) for v in re.findall(r"GLIBC_([\d.]+)", run)}
    assert max(needed) <= (2, 17)


@linux
@pytest.mark.parametrize("name", ["smooth_model", "switching_model"])
def test_gcc_rebuilds_it_to_the_same_results(
    name: str, exported: Any, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("gcc is not installed")
    model = request.getfixturevalue(name)
    path = exported(model)
    folder = _unpack(path, tmp_path / "unpacked")
    [binary] = folder.glob("binaries/linux64/*.so")
    command = [gcc, "-O2", "-shared", "-fPIC", "sources/all.c", "-lm", "-o", str(binary)]
    subprocess.run(command, cwd=folder, check=True)
    rebuilt = tmp_path / "rebuilt.fmu"
    files = {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}
    package.write_archive(rebuilt, files)
    drive = Drive([0.0, 0.2], [[1.0], [-0.5]])
    given, expected = (fmu.cosim(p, 0.5, 1e-3, drive=drive).values for p in (rebuilt, path))
    assert np.allclose(given, expected, rtol=1e-12, atol=1e-12)


def test_two_exports_are_byte_identical(smooth_model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = fmu.export(smooth_model, tmp_path / "a.fmu", platforms=["linux64"]).read_bytes()
    monkeypatch.setenv("FLEXARM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", os.environ.get("ZIG_GLOBAL_CACHE_DIR", str(Path.home() / ".cache/zig")))
    again = fmu.export(smooth_model, tmp_path / "b.fmu", platforms=["linux64"]).read_bytes()
    assert list((tmp_path / "cache").glob("*.so"))
    assert first == again
    other = fmu.export(smooth_model, tmp_path / "c.fmu", platforms=["linux64"], step=5e-4)
    guids = {read_model_description(str(p)).guid for p in (tmp_path / "a.fmu", other)}
    assert len(guids) == 2


@pytest.mark.slow
def test_windows_binary_exports_the_functions(smooth_model: Model, exported: Any, tmp_path: Path) -> None:
    path = exported(smooth_model, ("linux64", "win64"))
    assert fmu.validate(path) == []
    assert path.stat().st_size < 120_000
    folder = _unpack(path, tmp_path)
    [binary] = folder.glob("binaries/win64/*.dll")
    assert binary.read_bytes()[:2] == b"MZ"
    objdump = shutil.which("x86_64-w64-mingw32-objdump") or shutil.which("objdump")
    if objdump is None:
        pytest.skip("objdump is not installed")
    run = subprocess.run([objdump, "-p", binary], capture_output=True, text=True, check=False)
    if run.returncode:
        pytest.skip("objdump does not read PE files")
    table = run.stdout.partition("[Ordinal/Name Pointer] Table")[2]
    names = set(re.findall(r"(fmi2\w+)", table))
    assert names == set(re.findall(r"FMI2_Export fmi2\w+TYPE\s+(fmi2\w+);", headers(2)["fmi2Functions.h"]))
    libraries = {name.lower() for name in re.findall(r"DLL Name: (\S+)", run.stdout)}
    assert all(name == "kernel32.dll" or name.startswith("api-ms-win-crt") for name in libraries), libraries


# -- exports that must fail --------------------------------------------------------------------------------------------


class Meter(Block):
    """Twice the input, under a name with an underscore or a dot."""

    scale = parameter("1", 2.0, "factor")
    input = signal_in("*", "in", name="in")
    first = signal_out("1", "first", name="a.b")
    second = signal_out("1", "second", name="a_b")

    def stamp(self, net: Any) -> None:
        net.output(self.first, self.scale * self.input)
        net.output(self.second, self.input)


def _simple(**blocks: Block) -> System:
    return System(blocks, [Connection(("j.shaft.angle", "m.in"))])


def test_two_outputs_of_one_flat_name(tmp_path: Path) -> None:
    model = build(_simple(j=Inertia(inertia=1.0), m=Meter()), outputs=["m.a.b", "m.a_b"])
    with pytest.raises(FlexarmError, match=r"'m\.a\.b'.*'m\.a_b'.*'m_a_b'"):
        fmu.export(model, tmp_path / "x.fmu", platforms=["linux64"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"platforms": ["linux"]}, "linux64"),
        ({"platforms": []}, "no platform"),
        ({"step": 0.0}, "step"),
        ({"step": float("nan")}, "step"),
        ({"version": 4}, "FMI 4"),
    ],
)
def test_wrong_arguments(smooth_model: Model, tmp_path: Path, change: dict[str, Any], words: str) -> None:
    with pytest.raises(FlexarmError, match=words):
        fmu.export(smooth_model, tmp_path / "x.fmu", **{"platforms": ["linux64"], **change})
    assert list(tmp_path.iterdir()) == []


def test_targets_that_cannot_be_written(smooth_model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FlexarmError, match="no folder"):
        fmu.export(smooth_model, tmp_path / "missing" / "x.fmu", platforms=["linux64"])
    with pytest.raises(FlexarmError, match="is a folder"):
        fmu.export(smooth_model, tmp_path, platforms=["linux64"])

    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    old = tmp_path / "old.fmu"
    old.write_bytes(b"old")
    monkeypatch.setattr(zipfile.ZipFile, "writestr", full)
    with pytest.raises(FlexarmError, match="No space left"):
        fmu.export(smooth_model, old, platforms=["linux64"])
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"old"]


def test_no_compiler(smooth_model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEXARM_CC", "no-such-compiler")
    monkeypatch.setenv("FLEXARM_CACHE", str(tmp_path / "cache"))
    for cached in (engine_compile.compiler, engine_compile.version):
        cached.cache_clear()
    try:
        for platform, words in (("linux64", "does not run"), ("win64", "does not compile for win64")):
            with pytest.raises(FlexarmError, match=words) as caught:
                fmu.export(smooth_model, tmp_path / "x.fmu", platforms=[platform])
            assert isinstance(caught.value, FlexarmError)
            assert "unset FLEXARM_CC" in caught.value.remedy
    finally:
        monkeypatch.undo()
        for cached in (engine_compile.compiler, engine_compile.version):
            cached.cache_clear()
    assert not (tmp_path / "x.fmu").exists()


def test_an_operation_without_c(smooth_model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> str:
        raise NotImplementedError("CasADi operation 99 has no C form")

    monkeypatch.setattr("fmu.source.model_code", refuse)
    with pytest.raises(FlexarmError, match="operation 99 has no C form") as caught:
        fmu.export(smooth_model, tmp_path / "x.fmu", platforms=["linux64"])
    assert caught.value.remedy


@pytest.mark.parametrize(("platform", "folder", "cpu"), [("darwin-aarch64", "aarch64-darwin", 0x0100000C)])
def test_apple_silicon_binary_is_signed_and_exports_the_functions(
    platform: str, folder: str, cpu: int, smooth_model: Model, exported: Any
) -> None:
    """A Mach-O library for that processor; Apple Silicon loads none without a signature, at least an ad hoc one."""
    with zipfile.ZipFile(exported(smooth_model, (platform,))) as archive:
        data = archive.read(f"binaries/{folder}/smooth_arm.dylib")
    magic, kind, _, _, commands, _, _, _ = struct.unpack_from("<8I", data)
    assert (magic, kind) == (0xFEEDFACF, cpu)
    at, found = 32, set()
    for _ in range(commands):
        command, size = struct.unpack_from("<2I", data, at)
        found.add(command)
        at += size
    assert 0x1D in found  # LC_CODE_SIGNATURE
    assert b"_fmi2DoStep\0" in data


def test_both_versions_have_terminals(smooth_model: Model, exported: Any, tmp_path: Path) -> None:
    """One for each block, which importers that know terminals of FMI 3 find in an FMI 2 FMU as well."""
    third = fmu.export(smooth_model, tmp_path / "x.fmu", platforms=["linux64"], version=3)
    texts = []
    for path in (exported(smooth_model), third):
        with zipfile.ZipFile(path) as archive:
            texts.append(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
            assert archive.read("terminalsAndIcons/icon.png")
    assert texts[0] == texts[1]
    assert b'Terminal name="link"' in texts[0]
