"""The compiler's cache: shared, read-only, full, interrupted, corrupted; and life without a compiler."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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
    assert [path.name for path in cache.iterdir()] == [Path(names.pop()).name]


def test_the_key_holds_source_flags_compiler_and_cpu(cache: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    compiling.library(SOURCE % 1)
    compiling.library(SOURCE % 1)
    assert len(list(cache.iterdir())) == 1
    compiling.library(SOURCE % 2)
    monkeypatch.setattr(compiling, "FLAGS", (*compiling.FLAGS, "-DOTHER"))
    compiling.library(SOURCE % 1)
    monkeypatch.setattr(compiling, "_cpu", lambda: "another machine")
    compiling.library(SOURCE % 1)
    monkeypatch.setattr(compiling, "version", lambda: "another compiler")
    compiling.library(SOURCE % 1)
    assert len(list(cache.iterdir())) == 5


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
    assert not list(cache.iterdir())


def test_a_corrupted_entry_is_replaced(cache: Any) -> None:
    compiling.library(SOURCE % 9)
    entry = next(cache.iterdir())
    entry.unlink()
    entry.write_bytes(b"not a library")
    assert _answer(compiling.library(SOURCE % 9)) == 9


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
    native._loaded.cache_clear()
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
