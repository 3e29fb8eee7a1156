"""The process of the python backend: hosts without Python, Pythons that will not do, and processes that die."""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import re
import select
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException

import fmu
from engine.errors import FlexarmError
from engine.simulate import simulate
from flexarm.api import export
from flexarm.cut import cut
from fmu.loaded import described, instance
from fmu.package import write_archive
from fmu.python_child import Request
from fmu.source import headers
from fmu.verify import references, slave
from tests.fmu.makers import Unpacked, python_arm, wave
from tests.fmu.test_importers import _imported

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="the hosts load the linux64 binary"),
    pytest.mark.filterwarnings("ignore:.*PythonController of the scenario names it"),
]
HEADS = Path(fmu.__file__).parent / "heads"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return python_arm(tmp_path_factory.mktemp("process") / "made")


@pytest.fixture
def unpacked(host: Path, made: Path, tmp_path: Path) -> Unpacked:
    return Unpacked(host, made, tmp_path / "m")


@contextmanager
def running(path: Path) -> Iterator[tuple[Any, list[int], list[str]]]:
    """An instance in step mode, its inputs, and its messages."""
    with slave(path) as (made, description, messages):
        made.setupExperiment(startTime=0.0)
        made.enterInitializationMode()
        made.exitInitializationMode()
        messages.clear()
        yield made, references(description, "input"), messages


def _steps(instance: Any, first: int, last: int) -> None:
    for k in range(first, last):
        instance.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)


def _children(process: int) -> list[int]:
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended meanwhile
        if int(fields[1]) == process:
            found.append(int(entry.parent.name))
    return found


def _gone(process: int) -> bool:
    """Wait for the end of a process that need not be a child of this one."""
    try:
        watched = os.pidfd_open(process)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([watched], [], [], 300)[0])
    finally:
        os.close(watched)


# -- hosts without Python ----------------------------------------------------------------------------------------------


def test_a_host_without_python_agrees_with_the_runner(unpacked: Unpacked, made: Path) -> None:
    """With an empty environment, and the resources found beside the binary: this host does not tell where they are."""
    given = [float.fromhex(word) for word in unpacked.run("run", 300, 1e-3)]
    model = cut(made.parent / "arm.yaml", "export").model
    expected = simulate(model, 0.3, drive=wave(300)).values[-1]
    assert np.allclose(given, expected, rtol=1e-12, atol=1e-12)


def test_instances_and_threads_do_not_disturb_one_another(unpacked: Unpacked) -> None:
    assert unpacked.run("instances", 3, 20) == ["0"]
    assert unpacked.run("threads", 8, 20) == ["0"]


def test_loading_and_freeing_leaves_no_handle(unpacked: Unpacked) -> None:
    assert unpacked.run("reload", 3) == ["0"]


def test_symbols_are_functions_of_fmi_alone(unpacked: Unpacked) -> None:
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("nm is not installed")
    run = subprocess.run([nm, "-D", unpacked.library], capture_output=True, text=True, check=True).stdout
    defined = {line.split()[2] for line in run.splitlines() if len(line.split()) == 3 and line.split()[1] not in "wU"}
    standard = set(re.findall(r"FMI2_Export fmi2\w+TYPE\s+(fmi2\w+);", headers(2)["fmi2Functions.h"]))
    assert defined < standard
    assert standard - defined == {
        *("fmi2EnterEventMode", "fmi2NewDiscreteStates", "fmi2EnterContinuousTimeMode", "fmi2CompletedIntegratorStep"),
        *("fmi2SetTime", "fmi2SetContinuousStates", "fmi2GetDerivatives", "fmi2GetEventIndicators"),
        *("fmi2GetContinuousStates", "fmi2GetNominalsOfContinuousStates"),
    }
    needed = {tuple(map(int, v.split("."))) for v in re.findall(r"GLIBC_([\d.]+)", run)}
    assert max(needed) <= (2, 17)


def test_fmusim(made: Path, tmp_path: Path) -> None:
    tool = os.environ.get("FLEXARM_FMUSIM") or shutil.which("fmusim")
    if not tool:
        pytest.skip("fmusim is not installed: build it from the sources of the Reference FMUs")
    result = tmp_path / "rows.csv"
    command = [tool, "--interface-type", "cs", "--stop-time", "0.3", "--output-interval", "0.01"]
    command += ["--start-value", "control_in1", "2", "--output-file", str(result), str(made)]
    run = subprocess.run(command, env={}, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    rows = np.genfromtxt(result, delimiter=",", names=True, deletechars="")
    plain = simulate_fmu(str(made), stop_time=0.3, output_interval=1e-2, start_values={"control_in1": 2})
    assert len(rows) == len(plain) == 31
    for name in plain.dtype.names[1:]:
        assert np.ptp(plain[name]) > 0
        assert np.allclose(rows[name], plain[name], rtol=1e-12, atol=1e-12), name


def test_resources_are_found_where_the_importer_says(made: Path, tmp_path: Path) -> None:
    """By a URL, as the standard has it, by what importers write instead, or beside the binary."""
    with zipfile.ZipFile(made) as archive:
        archive.extractall(tmp_path / "m")
    odd = tmp_path / "a folder, 100% ümläut #1"
    shutil.move(tmp_path / "m" / "resources", odd / "resources")
    folder, quoted = str(odd / "resources"), (odd / "resources").as_uri()
    assert "%25" in quoted
    plain = quoted.removeprefix("file://")
    with slave(made) as (loaded, description, messages):

        def instantiated(location: str | None) -> Any:
            text = None if location is None else location.encode()
            arguments = (b"x", 1, description.guid.encode(), text, ctypes.byref(loaded.callbacks), 0, 1)
            library = ctypes.CDLL(str(next((tmp_path / "m").glob("binaries/linux64/*.so"))))
            library.fmi2Instantiate.restype = ctypes.c_void_p
            return library, library.fmi2Instantiate(*arguments)

        for location in (quoted, quoted + "/", f"file:{plain}", f"file://localhost{plain}", folder):
            library, found = instantiated(location)
            assert found, (location, messages)
            library.fmi2FreeInstance(ctypes.c_void_p(found))
        for wrong in (None, "", "file:///nowhere", "%", "file:", "file://", "x" * 10_000):
            messages.clear()
            assert not instantiated(wrong)[1]
            assert "resources are not found" in messages[0]


def test_the_same_scenario_gives_the_same_bytes(made: Path, tmp_path: Path) -> None:
    again = export(made.parent / "arm.yaml", tmp_path / "arm.fmu", backend="python", platforms=["linux64"])
    assert again.read_bytes() == made.read_bytes()


def test_requests_have_the_numbers_of_the_binary() -> None:
    text = (HEADS / "process.c").read_text()
    [listed] = re.findall(r"enum \{\s*(FP_OPEN = 1,[^}]*)\}", text)
    names = [name.strip().partition(" ")[0] for name in listed.split(",")]
    assert names == [f"FP_{request.name}" for request in Request]
    assert [request.value for request in Request] == list(range(1, len(names) + 1))


# -- which Python ------------------------------------------------------------------------------------------------------


def _program(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def _changed(made: Path, target: Path, change: Callable[[dict[str, Any], list[str]], None]) -> Path:
    """The FMU with another recipe and other lines for its binary."""
    with zipfile.ZipFile(made) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    recipe, lines = json.loads(files["resources/recipe.json"]), files["resources/python.txt"].decode().splitlines()
    change(recipe, lines)
    files["resources/recipe.json"] = json.dumps(recipe).encode()
    files["resources/python.txt"] = ("\n".join(lines) + "\n").encode()
    write_archive(target, files)
    return target


def _refusal(path: Path) -> str:
    with pytest.raises(FlexarmError) as caught, slave(path):
        pass
    return str(caught.value)


def test_the_chosen_python_must_do(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No other one is taken instead; the log says which was tried, what is the matter, and what is needed."""
    log = tmp_path / "log"
    for program, words in (
        (tmp_path / "none", "No such file"),
        (tmp_path, "Permission denied"),
        (_program(tmp_path / "dies", "echo nothing here >&2; exit 3"), "exit code 3; its last words: nothing here"),
        (_program(tmp_path / "killed", "kill -9 $$"), "signal 9"),
        (_program(tmp_path / "talks", "cat /dev/zero | head -c 1000 >&0"), "ended"),
        (_program(tmp_path / "bare", f"exec {sys.executable} -I -S $1 $2"), "it has no flexarm"),
    ):
        monkeypatch.setenv("FLEXARM_PYTHON", str(program))
        said = _refusal(made)
        assert f"FLEXARM_PYTHON={program}" in said
        assert words in said
        assert "flexarm 0." in said
        assert "Python 3.11 or newer" in said
        assert "on the PATH" not in said
    monkeypatch.setenv("FLEXARM_PYTHON", str(_program(tmp_path / "good", f"echo x > {log}; exec {sys.executable} $1")))
    with running(made) as (found, _, _):
        _steps(found, 0, 2)
    assert log.exists()


def test_the_exporting_python_then_the_one_on_the_path(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FLEXARM_PYTHON", raising=False)
    log = tmp_path / "log"

    def moved(_: dict[str, Any], lines: list[str]) -> None:
        lines[-1] = str(tmp_path / "gone" / "python")

    path = _changed(made, tmp_path / "moved.fmu", moved)
    _program(tmp_path / "bin" / "python3", f"echo x > {log}; exec {sys.executable} $1")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=":")
    with running(path) as (found, _, _):
        _steps(found, 0, 2)
    assert log.exists()
    _program(tmp_path / "bin" / "python3", "exit 9")
    said = _refusal(path)
    assert f"{tmp_path}/gone/python: cannot be started" in said
    assert "python3 on the PATH: ended with exit code 9" in said
    with running(made) as (found, _, _):
        _steps(found, 0, 2)


def test_another_version_is_refused(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEXARM_PYTHON", sys.executable)

    def newer(recipe: dict[str, Any], _: list[str]) -> None:
        recipe["python"]["flexarm"] = "9.9"

    assert "it has flexarm 0." in _refusal(_changed(made, tmp_path / "newer.fmu", newer))

    def later(recipe: dict[str, Any], _: list[str]) -> None:
        recipe["python"]["oldest"] = [99, 0]

    assert "it is Python 3." in _refusal(_changed(made, tmp_path / "later.fmu", later))

    def other(recipe: dict[str, Any], _: list[str]) -> None:
        recipe["names"] = "0"

    said = _refusal(_changed(made, tmp_path / "other.fmu", other))
    assert "makes another model of the scenario; export it again" in said
    assert "Tried" not in said

    def guid(_: dict[str, Any], lines: list[str]) -> None:
        lines[0] = "{wrong}"

    assert "GUID" in _refusal(_changed(made, tmp_path / "guid.fmu", guid))


def test_a_missing_pythonfmu_is_told(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The Python part is a slave of pythonfmu; an export needs nothing of it."""
    (tmp_path / "pythonfmu.py").write_text("raise ModuleNotFoundError(\"No module named 'pythonfmu'\")\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("FLEXARM_PYTHON", sys.executable)
    assert "flexarm cannot be imported: ModuleNotFoundError: No module named 'pythonfmu'" in _refusal(made)
    code = "import sys; sys.path.insert(0, sys.argv[1]); import fmu.python_backend"
    root = Path(__file__).parent.parent.parent
    subprocess.run([sys.executable, "-c", code, str(root)], cwd=tmp_path, check=True)


def test_an_environment_of_the_importers_own_python_does_not_matter(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MATLAB and others set PYTHONHOME for the Python in them, with which no other one starts."""
    monkeypatch.setenv("PYTHONHOME", "/nowhere")
    with running(made) as (found, _, _):
        _steps(found, 0, 2)
        assert found.getRealStatus(2) == pytest.approx(2e-3)  # the time that it reached


def test_the_importers_folder_lends_no_modules(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit(5)\n")
    monkeypatch.chdir(tmp_path)
    with running(made) as (found, _, _):
        _steps(found, 0, 2)
        assert found.getRealStatus(2) == pytest.approx(2e-3)  # the time that it reached


# -- processes that die or talk ----------------------------------------------------------------------------------------

DEATHS = {
    "leaves": ("os._exit(7)", "with exit code 7; its last words: goodbye"),
    "crashes": ("os.kill(os.getpid(), signal.SIGSEGV)", "by signal 11"),
    "is killed": ("os.kill(os.getpid(), signal.SIGKILL)", "by signal 9"),
    "shuts its pipes": ("os.closerange(0, 100)", "ended"),
}
DEADLY = """\
import os, signal, sys

class Deadly:
    def __init__(self):
        self.calls = 0

    def __call__(self, t, u):
        self.calls += 1
        if u[0] > 1.5:
            print("goodbye", file=sys.stderr)
            {deed}
        return u[0]
"""


@pytest.mark.parametrize("death", DEATHS)
def test_a_process_that_dies_is_an_error_with_its_last_words(death: str, tmp_path: Path) -> None:
    """Never a hang; the other instance goes on, and resetting starts another process."""
    deed, words = DEATHS[death]
    path = python_arm(tmp_path / "d", DEADLY.format(deed=deed), "Deadly")
    with running(path) as (found, u, messages), running(path) as (other, _, _):
        _steps(found, 0, 12)
        state = found.getFMUstate()
        found.setReal(u, [2.0])
        with pytest.raises(FMICallException) as caught:
            _steps(found, 12, 30)
        assert caught.value.status == 3
        assert words in messages[-1]
        for call in (lambda: found.getReal(u), lambda: found.setReal(u, [1.0]), found.terminate, found.getFMUstate):
            messages.clear()
            with pytest.raises(FMICallException):
                call()
            assert "reset" in messages[0]
        _steps(other, 0, 12)
        found.reset()
        with pytest.raises(FMICallException):
            found.setFMUstate(state)
        assert "lost" in messages[-1]
        found.freeFMUstate(state)
        found.setupExperiment(startTime=0.0)
        found.enterInitializationMode()
        found.exitInitializationMode()
        _steps(found, 0, 12)


def test_what_python_prints_is_logged(tmp_path: Path) -> None:
    """However much it is: a full pipe would stop the process."""
    text = "def speak(t, u):\n    print('first %s #')\n    print('x' * 300_000)\n    print('last')\n    return 0.0\n"
    with running(python_arm(tmp_path / "s", text, "speak")) as (found, _, messages):
        _steps(found, 0, 6)
        said = [message for message in messages if message in ("first _s _", "last")]
        assert said[:2] == ["first _s _", "last"]
        found.setDebugLogging(False, ["logPython"])
        messages.clear()
        _steps(found, 6, 12)
        assert messages == []


def test_a_function_that_wants_to_leave_only_fails(tmp_path: Path) -> None:
    text = "import sys\n\ndef leave(t, u):\n    return sys.exit(4) if u[0] > 1.5 else u[0]\n"
    with running(python_arm(tmp_path / "l", text, "leave")) as (found, u, messages):
        found.setReal(u, [2.0])
        with pytest.raises(FMICallException):
            _steps(found, 0, 12)
        assert "SystemExit" in messages[-1]
        found.reset()


WITHOUT_PIPE_SIGNAL = """\
import os, signal, sys
from fmpy.fmi1 import FMICallException
from tests.fmu.test_python_process import _children, _steps, running
from pathlib import Path
signal.signal(signal.SIGPIPE, signal.SIG_DFL)
with running(Path(sys.argv[1])) as (found, u, messages):
    [child] = _children(os.getpid())
    assert os.getpgid(child) != os.getpgid(0)
    os.kill(child, signal.SIGINT)
    _steps(found, 0, 3)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0) if sys.argv[2] == "reaped" else os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)
    try:
        _steps(found, 3, 4)
    except FMICallException:
        print(messages[-1])
"""


@pytest.mark.parametrize(("who", "words"), [("reaped", "somebody else"), ("not reaped", "by signal 9")])
def test_signals(who: str, words: str, made: Path) -> None:
    """A process that is gone sends no SIGPIPE to the importer; Ctrl-C is the importer's alone."""
    command = [sys.executable, "-c", WITHOUT_PIPE_SIGNAL, str(made), who]
    root = Path(__file__).parent.parent.parent
    run = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert run.returncode == 0, (run.returncode, run.stderr)
    assert words in run.stdout


ENDLESS = """\
import sys

def run(t, u):
    if t > 0.004:
        print("endless", flush=True)
        while True:
            pass
    return 0.0
"""


@pytest.mark.parametrize("busy", [False, True])
def test_the_process_ends_with_its_host(busy: bool, host: Path, made: Path, tmp_path: Path) -> None:
    """The host is killed while it steps; busy: in the midst of a Python function that never returns."""
    path = python_arm(tmp_path / "e", ENDLESS, "run") if busy else made
    unpacked = Unpacked(host, path, tmp_path / "m")
    running = subprocess.Popen(unpacked.words("long", 10**9), env={}, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        while not (children := _children(running.pid)):
            assert running.poll() is None
        if busy:
            # It has reached the endless loop once the host waits for an answer: its processor time grows.
            stat = Path(f"/proc/{children[0]}/stat")
            while int(stat.read_text().rpartition(")")[2].split()[11]) < 100:
                assert running.poll() is None
    finally:
        running.kill()
        running.communicate()
    assert all(_gone(child) for child in children)


def test_freeing_leaves_no_process(made: Path, tmp_path: Path) -> None:
    before = set(_children(os.getpid()))
    with zipfile.ZipFile(made) as archive:
        archive.extractall(tmp_path)
    loaded = instance(described(made), str(tmp_path), "one")
    [child] = set(_children(os.getpid())) - before
    loaded.raw.freeInstance()
    assert set(_children(os.getpid())) == before
    assert not Path(f"/proc/{child}").exists()


def test_a_forked_copy_of_the_host_leaves_it_alone(made: Path) -> None:
    """Two processes would read one another's answers."""
    with running(made) as (found, u, messages):
        _steps(found, 0, 2)
        copy = os.fork()
        if copy == 0:
            try:
                found.getReal(u)
            except FMICallException:
                os._exit(0 if "copy" in messages[-1] else 2)
            os._exit(3)
        assert os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1]) == 0
        _steps(found, 2, 4)


def test_sanitizers_find_nothing(made: Path, tmp_path: Path) -> None:
    """In the binary, built by gcc, under a host of the same kind; leaks count."""
    program = shutil.which("gcc")
    if program is None:
        pytest.skip("gcc is not installed")
    for name, text in headers(2).items():
        (tmp_path / name).write_text(text)
    for file in (*HEADS.glob("process*.c"), Path(__file__).parent / "host.c"):
        shutil.copy(file, tmp_path)
    flags = ["-std=c11", "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-Wall", "-Wextra"]
    library = [*flags, "-Werror", "-fvisibility=hidden", "-fPIC", "-shared", "process.c", "-o", "library.so"]
    run = subprocess.run([program, *library], cwd=tmp_path, capture_output=True, text=True, check=False)
    if "libasan" in run.stderr or "libubsan" in run.stderr:
        pytest.skip("gcc has no address sanitizer: install libasan and libubsan")
    assert run.returncode == 0, run.stderr
    rest = ["-std=gnu11", *flags[1:5], "host.c", "-o", "host", "-lm", "-ldl", "-lpthread"]
    subprocess.run([program, *rest], cwd=tmp_path, check=True)
    unpacked = Unpacked(tmp_path / "host", made, tmp_path / "m")
    shutil.copy(tmp_path / "library.so", unpacked.library)
    assert unpacked.run("instances", 2, 10) == ["0"]
    assert unpacked.run("threads", 3, 5) == ["0"]


@pytest.mark.parametrize("importer", ["libcosimpy", "ecospy"])
def test_other_importers(importer: str, made: Path) -> None:
    """Each has its own way to say where the resources are."""
    loaded = _imported(importer)
    plain = simulate_fmu(str(made), stop_time=0.1, output_interval=1e-3, start_values={"control_in1": 2})
    description = described(made)
    u, y = references(description, "input"), references(description, "output")
    if importer == "libcosimpy":
        parts = {name: importlib.import_module(f"libcosimpy.Cosim{name}") for name in ("Execution", "Manipulator")}
        observer, local = (importlib.import_module(f"libcosimpy.Cosim{name}") for name in ("Observer", "Slave"))
        run = parts["Execution"].CosimExecution.from_step_size(1_000_000)
        index = run.add_local_slave(local.CosimLocalSlave(fmu_path=str(made), instance_name="arm"))
        seen = observer.CosimObserver.create_last_value()
        run.add_observer(seen)
        hand = parts["Manipulator"].CosimManipulator.create_override()
        run.add_manipulator(hand)
        hand.slave_real_values(index, u, [2.0])
        assert run.simulate_until(100_000_000)
        given = seen.last_real_values(index, y)
    else:
        ecos = loaded
        names = {v.valueReference: v.name for v in description.modelVariables if v.type == "Real"}
        with ecos.EcosSimulationStructure() as structure:
            structure.add_model("arm", str(made))
            structure.add_parameter_set("start", {f"arm::{names[u[0]]}": 2.0})
            with ecos.EcosSimulation(structure=structure, step_size=1e-3) as simulation:
                simulation.init(parameter_set="start")
                simulation.step(100)
                given = [simulation.get_real(f"arm::{names[r]}") for r in y]
    names_of = [v.name for v in description.modelVariables if v.causality == "output"]
    assert np.allclose(given, [plain[name][-1] for name in names_of], rtol=1e-12, atol=1e-12)
