"""FMUs of other makers: names as Modelica gives them, and binaries that do what no FMU should; each ends in words."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from blocks.registry import registry
from engine import compile as compiling
from engine.errors import FlexarmError, SimulationError
from engine.simulate import Drive, simulate
from fmu import host as hosting
from fmu.block import FMU
from fmu.host import host
from fmu.verify import cosim
from scenarios.load import load
from tests.fmu.makers import foreign_binary

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the binary is one of linux64")

WAYS = ("sound", "nan", "null", "segv", "abort", "exit", "print", "read", "talk", "inf", "hang", "refuse")
DESCRIPTION = """\
<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g">
<CoSimulation modelIdentifier="m" canHandleVariableCommunicationStepSize="true"/>
<DefaultExperiment startTime="0" stopTime="0.01" stepSize="0.001"/>
<ModelVariables>
<ScalarVariable name={input} valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name={output} valueReference="1" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="how" valueReference="2" causality="parameter" variability="fixed">
<Real start="0"/></ScalarVariable>
</ModelVariables><ModelStructure><Outputs><Unknown index="2"/></Outputs></ModelStructure></fmiModelDescription>
"""
Make = Callable[..., Path]


@pytest.fixture(scope="module")
def binary(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return foreign_binary("foreign.c")


@pytest.fixture
def make(binary: bytes, tmp_path: Path) -> Make:
    def made(name: str = "m.fmu", input: str = "u", output: str = "y", keep: int | None = None) -> Path:
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            text = DESCRIPTION.format(input=quoteattr(input), output=quoteattr(output))
            archive.writestr("modelDescription.xml", text)
            archive.writestr("binaries/linux64/m.so", binary[:keep])
        return tmp_path / name

    return made


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    if "FMU" not in registry():
        monkeypatch.setitem(registry(), "FMU", FMU)


def _way(name: str) -> dict[str, float]:
    return {"how": float(WAYS.index(name))}


NAMES = [
    ("supply.v", "motor.w"),
    ("a[1].b[2,3]", "der(motor.phi)"),
    ("'odd name'.x", "rotor 1"),
    ("period", "file"),
    ("set", "stamp"),
    ("values", "ports"),
    ("motor.w[1]", "motor.w[2]"),
    ("a.b", "a_b"),
    ("größe", "y\u00b2"),
]


@pytest.mark.parametrize(("input", "output"), NAMES)
def test_any_name_is_run(make: Make, input: str, output: str) -> None:
    trace = cosim(make(input=input, output=output), 0.01, 1e-3, drive=Drive([0.0], [[0.25]]))
    assert (trace[output] == 0.25).all()


@pytest.mark.parametrize(("input", "output"), NAMES)
def test_any_name_is_a_port_of_a_block(make: Make, tmp_path: Path, input: str, output: str) -> None:
    make(input=input, output=output)
    ends = [name.replace("\\", "\\\\").replace('"', '\\"') for name in (input, output)]
    (tmp_path / "s.yaml").write_text(
        "schema: 1\nname: s\nblocks:\n  s: {type: Step, height: 0.5}\n"
        "  f: {type: FMU, file: m.fmu, period: 1 ms}\n  g: {type: Gain, gain: 2}\n"
        f'connect:\n  - [s.out, "f.{ends[0]}"]\n  - ["f.{ends[1]}", g.in]\n'
        f'simulate: {{stop: 0.01 s, step: 1 ms, record: ["f.{ends[1]}", g.out]}}\n',
        encoding="utf-8",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load(tmp_path / "s.yaml").build()
    assert simulate(model, 0.01, 1e-3)["g.out"][-1] == 1.0


@pytest.mark.parametrize("way", ["sound", "null", "print", "read", "talk"])
def test_what_does_no_harm_is_run(make: Make, way: str) -> None:
    """A message that is NULL or endless, text on standard output, reading from standard input."""
    path = make()
    trace = cosim(path, 0.003, 1e-3, drive=Drive([0.0], [[2.0]]), parameters=_way(way))
    assert (trace["y"] == 2.0).all()


@pytest.mark.parametrize(
    ("way", "said"),
    [
        ("nan", r"'y' of the FMU is nan at t = 0 s"),
        ("inf", r"'y' of the FMU is inf"),
        ("segv", r"SIGSEGV"),
        ("abort", r"SIGABRT"),
        ("exit", r"exit code 0"),
        ("refuse", r"no more"),
    ],
)
def test_what_it_does_wrong_is_said(make: Make, way: str, said: str) -> None:
    with pytest.raises(SimulationError, match=said):
        cosim(make(), 0.01, 1e-3, parameters=_way(way))


@pytest.mark.parametrize("keep", [0, 100, 1500, 4096, -600, -1])
def test_a_truncated_binary_is_refused(make: Make, keep: int) -> None:
    """Before it is loaded, or by its loader."""
    with pytest.raises(FlexarmError, match=r"is damaged|cannot be loaded"):
        cosim(make(keep=keep), 0.01, 1e-3)


def test_a_library_that_never_loads_is_given_up(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """A constructor that waits; the limit is lowered."""
    text = "#include <unistd.h>\n__attribute__((constructor)) static void wait(void) { for (;;) pause(); }\n"
    path = make()
    with zipfile.ZipFile(path) as archive:
        description = archive.read("modelDescription.xml")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.writestr("binaries/linux64/m.so", compiling.binary({"wait.c": text}, ["-s"], ".so"))
    monkeypatch.setattr(hosting, "LOADING", 3.0)
    with pytest.raises(FlexarmError, match="did not load within 3 s"):
        cosim(path, 0.01, 1e-3)


def test_an_fmu_that_dies_in_a_scenario_is_named(make: Make, tmp_path: Path) -> None:
    make()
    (tmp_path / "s.yaml").write_text(
        "schema: 1\nname: s\nblocks:\n  s: {type: Step, height: 0.5}\n"
        "  f: {type: FMU, file: m.fmu, period: 1 ms, set: how=3}\n"
        "connect:\n  - [s.out, f.u]\nsimulate: {stop: 0.01 s, step: 1 ms}\n"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load(tmp_path / "s.yaml").build()
    with pytest.raises(SimulationError, match=r"'f\.fmu' failed.*SIGSEGV.*at t = 0.001 s"):
        simulate(model, 0.01, 1e-3)


def test_a_process_serves_one_file_again_and_again(make: Make) -> None:
    first, other = make(), make("other.fmu", output="z")
    seen = []
    for path in (first, first, other, first):
        with host(path) as instance, instance.starting():
            seen.append(instance._child)
    assert seen[0] is seen[1] is seen[3]
    assert seen[2] is not seen[0]
    with pytest.raises(SimulationError):
        cosim(first, 0.01, 1e-3, parameters=_way("abort"))
    assert all(child._process.poll() is None for _, child in hosting._idle)


def test_ctrl_c_ends_an_fmu_that_hangs(make: Make) -> None:
    path = make()
    with host(path) as warm, warm.starting():
        pass
    child = hosting._idle[-1][1]
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        cosim(path, 0.01, 1e-3, parameters=_way("hang"))
    assert child._process.poll() is not None


def test_no_child_outlives_its_parent(make: Make) -> None:
    program = (
        "import os, sys\nfrom fmu.host import host\n"
        "with host(sys.argv[1]) as instance:\n    instance.set(['how'], [10.0])\n    instance._waiting and None\n"
        '    instance._child._process.stdin.write(b\'[["enter", 0.0, null], ["leave"]]\\n\')\n'
        '    instance._child._process.stdin.write(b\'[["set", ["how"], [10.0], []], ["step", 0.0, 0.1]]\\n\')\n'
        "    instance._child._process.stdin.flush()\n"
        "    print(instance._child._process.pid, flush=True)\n    os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, make()], capture_output=True, text=True, check=False)
    pid = int(done.stdout)
    deadline = time.time() + 60
    while Path(f"/proc/{pid}").exists() and time.time() < deadline:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        if state == "Z":
            break
        time.sleep(0.1)
    else:
        assert not Path(f"/proc/{pid}").exists()


def test_a_module_of_the_current_folder_is_not_taken(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("json", "fmpy", "engine"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('taken')\n")
    while hosting._idle:
        hosting._idle.pop()[1].kill()
    assert cosim(make(), 0.003, 1e-3)["y"][-1] == 0.0
