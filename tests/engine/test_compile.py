"""The compiler's cache: shared, read-only, full, interrupted, corrupted; and life without a compiler."""

from __future__ import annotations

import errno
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine import cache as cached
from engine import compile as compiling
from engine import native, simulate
from engine.assemble import build
from engine.errors import CompilerUnavailable
from tests.engine.parts import Anchor, Body, Spring, system

SOURCE = '__attribute__((visibility("default"))) double answer(void) { return %d; }\n'
PROGRAM = "import sys, engine.compile as c; print(c.library(sys.argv[1])._name)"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    folder = tmp_path / "cache"
    monkeypatch.setenv("FLEXARM_CACHE", str(folder))
    return folder


def _answer(library: Any) -> Any:
    import ctypes

    library.answer.restype = ctypes.c_double
    return library.answer()


def test_two_processes_share_one_cache(cache: Any) -> None:
    commands = [[sys.executable, "-c", PROGRAM, SOURCE % 41]] * 2
    started = [subprocess.Popen(c, stdout=subprocess.PIPE, text=True, cwd=Path.cwd()) for c in commands]
    names = {process.communicate(timeout=1800)[0].strip() for process in started}
    assert len(names) == 1
    assert [path.name for path in cache.glob("*.so")] == [Path(names.pop()).name]


def test_the_key_holds_source_flags_compiler_and_cpu(cache: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    compiling.library(SOURCE % 1)
    compiling.library(SOURCE % 1)
    assert len(list(cache.glob("*.so"))) == 1
    compiling.library(SOURCE % 2)
    monkeypatch.setattr(compiling, "FLAGS", (*compiling.FLAGS, "-DOTHER"))
    compiling.library(SOURCE % 1)
    monkeypatch.setattr(compiling, "_cpu", lambda: "another machine")
    compiling.library(SOURCE % 1)
    monkeypatch.setattr(compiling, "version", lambda: "another compiler")
    compiling.library(SOURCE % 1)
    assert len(list(cache.glob("*.so"))) == 5


def test_a_cache_that_cannot_be_written_is_done_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("FLEXARM_CACHE", str(blocked / "cache"))
    assert _answer(compiling.library(SOURCE % 7)) == 7


def test_a_full_disk_is_survived(cache: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.write_text

    def full(path: Any, *args: Any, **kwargs: Any) -> Any:
        if cache in path.parents:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(path, *args, **kwargs)

    monkeypatch.setattr(Path, "write_text", full)
    assert _answer(compiling.library(SOURCE % 8)) == 8
    assert not list(cache.glob("*.so"))


def test_a_corrupted_entry_is_replaced(cache: Any) -> None:
    compiling.library(SOURCE % 9)
    entry = next(cache.glob("*.so"))
    entry.unlink()
    entry.write_bytes(b"not a library")
    assert _answer(compiling.library(SOURCE % 9)) == 9


@pytest.mark.parametrize("left", [0, 1, 1000, -1, -20])
def test_a_truncated_entry_is_seen_before_it_is_loaded(cache: Any, left: Any) -> None:
    """A mapped library whose file is too short ends the process by SIGBUS when the missing page is touched."""
    first = subprocess.run([sys.executable, "-c", PROGRAM, SOURCE % 12], capture_output=True, text=True, check=True)
    entry = Path(first.stdout.strip())
    whole = entry.read_bytes()
    entry.write_bytes(whole[:left])
    again = subprocess.run([sys.executable, "-c", PROGRAM, SOURCE % 12], capture_output=True, text=True, check=True)
    assert Path(again.stdout.strip()) == entry
    assert entry.stat().st_size == len(whole)


def test_a_changed_byte_is_seen(cache: Any) -> None:
    compiling.library(SOURCE % 13)
    entry = next(cache.glob("*.so"))
    damaged = bytearray(entry.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    entry.unlink()
    entry.write_bytes(damaged)
    assert _answer(compiling.library(SOURCE % 13)) == 13
    assert entry.read_bytes() != damaged


@pytest.mark.parametrize("left", [0, 200, -1, -40])
def test_a_truncated_export_binary_is_made_again(cache: Any, left: Any) -> None:
    files = {"a.c": SOURCE % 14}
    whole = compiling.binary(files, ["-s"], ".so")
    entry = next(cache.glob("*.so"))
    entry.write_bytes(entry.read_bytes()[:left])
    again = compiling.binary(files, ["-s"], ".so")
    assert again[:4] == whole[:4]
    assert len(again) == len(whole)
    assert compiling.binary(files, ["-s"], ".so") == again


HOMELESS = ("HOME", "XDG_CACHE_HOME", "ZIG_GLOBAL_CACHE_DIR", "FLEXARM_CACHE", "FLEXARM_CC")


def _at_home(tmp_path: Path, **changes: Any) -> Any:
    """Where a fresh process finds its library, in an environment with a temporary folder of its own."""
    environment = {name: value for name, value in os.environ.items() if name not in HOMELESS}
    environment |= {"TMPDIR": str(tmp_path), **changes}
    command = [sys.executable, "-c", PROGRAM, SOURCE % 15]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=Path.cwd())


def test_a_home_that_cannot_be_written_is_done_without(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    done = _at_home(tmp_path, HOME=str(blocked))
    assert done.returncode == 0, done.stderr
    scratch = tmp_path / f"flexarm-zig-{os.getuid()}"
    assert scratch.stat().st_mode & 0o777 == 0o700


def test_a_home_that_is_not_set_is_that_of_the_system(tmp_path: Path) -> None:
    done = _at_home(tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("kind", ["link", "open", "foreign"])
def test_a_scratch_folder_that_is_not_ours_alone_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: Any
) -> None:
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    folder = tmp_path / f"flexarm-zig-{os.getuid()}"
    if kind == "link":
        (tmp_path / "elsewhere").mkdir()
        folder.symlink_to(tmp_path / "elsewhere")
    elif kind == "open":
        folder.mkdir()
        folder.chmod(0o777)
    else:
        folder.mkdir(mode=0o700)
        owner = os.getuid()
        folder.rename(tmp_path / f"flexarm-zig-{owner + 1}")
        monkeypatch.setattr(os, "getuid", lambda: owner + 1)
    with pytest.raises(CompilerUnavailable, match=re.escape(str(tmp_path))) as refused:
        cached.private("flexarm-zig")
    assert "XDG_CACHE_HOME" in str(refused.value)


def test_a_scratch_folder_of_ours_is_closed_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    folder = tmp_path / f"flexarm-zig-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o755)
    assert cached.private("flexarm-zig") == folder
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_killed_compilation_leaves_nothing_that_is_used(cache: Any) -> None:
    """The process group is killed while the compiler works on a large source."""
    lines = "\n".join(f"double f{i}(double x) {{ return x * {i} + f{i - 1}(x); }}" for i in range(1, 20000))
    source = "double f0(double x) { return x; }\n" + lines + "\n" + SOURCE % 10
    program = "import sys, engine.compile as c; c.library(sys.stdin.read())"
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, text=True, start_new_session=True, cwd=Path.cwd()
    )
    assert process.stdin is not None
    process.stdin.write(source)
    process.stdin.close()
    deadline = time.time() + 600
    while not list(cache.glob("build-*/model.c")) and time.time() < deadline:
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not list(cache.glob("*.so"))
    left = list(cache.glob("build-*"))
    assert len(left) == 1
    os.utime(left[0], (0, 0))
    assert _answer(compiling.library(SOURCE % 11)) == 11
    assert not list(cache.glob("build-*"))


@pytest.fixture
def swinging() -> Any:
    plant = system(
        {"m": Body(inertia=0.5), "s": Spring(stiffness=8.0), "g": Anchor()}, ("m.shaft", "s.a"), ("s.b", "g.shaft")
    )
    return build(plant, outputs=["m.shaft.angle"])


def test_without_a_compiler_the_interpreter_runs_with_one_warning(
    swinging: Any, monkeypatch: pytest.MonkeyPatch, cache: Any
) -> None:
    monkeypatch.setenv("FLEXARM_CC", "no-such-compiler-anywhere")
    compiling.compiler.cache_clear()
    compiling.version.cache_clear()
    native.forget()
    simulate._warned.clear()
    try:
        with pytest.warns(RuntimeWarning, match="interpreter") as caught:
            first = simulate.simulate(swinging, 1.0, 0.01, initial={"m.shaft.angle": 1.0})
        assert len(caught) == 1
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            second = simulate.simulate(swinging, 1.0, 0.01, initial={"m.shaft.angle": 1.0})
        with pytest.raises(CompilerUnavailable, match="no-such-compiler"):
            simulate.simulate(swinging, 1.0, 0.01, backend="c")
    finally:
        monkeypatch.undo()
        compiling.compiler.cache_clear()
        compiling.version.cache_clear()
    assert first.backend == second.backend == "interpreter"
    assert np.abs(first["m.shaft.angle"] - np.cos(4.0 * first.time)).max() < 1e-6


def test_the_version_is_asked_once_for_an_installed_zig(cache: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is kept for a program, its size and date; one's own compiler may be a wrapper, and is asked each time."""
    monkeypatch.delenv("FLEXARM_CC", raising=False)
    asked: list[list[str]] = []
    real = compiling._started

    def started(arguments: list[str], folder: Path) -> Any:
        asked.append(arguments)
        return real(arguments, folder)

    monkeypatch.setattr(compiling, "_started", started)
    version = compiling.version.__wrapped__
    said = version()
    assert version() == said
    assert asked == [["--version"]]
    (kept,) = cache.glob("compiler-*.txt")
    kept.write_bytes(kept.read_bytes()[:-1])
    assert version() == said
    assert len(asked) == 2
    program = compiling.compiler()
    monkeypatch.setenv("FLEXARM_CC", " ".join(program))
    monkeypatch.setattr(compiling, "compiler", lambda: program)
    assert version() == said == version()
    assert len(asked) == 4
