"""The linux64 binary in a host without Python: numbers, instances, threads, reloading, memory."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.simulate import simulate
from tests.fmu.makers import Unpacked, wave

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the host loads the linux64 binary")


@pytest.fixture
def unpacked(host: Path, exported: Any, request: pytest.FixtureRequest, tmp_path: Path) -> Unpacked:
    return Unpacked(host, exported(request.getfixturevalue(request.param)), tmp_path)


each_model = pytest.mark.parametrize("unpacked", ["smooth_model", "switching_model"], indirect=True)


@each_model
def test_runs_with_an_empty_environment_and_agrees_with_the_runner(
    unpacked: Unpacked, request: pytest.FixtureRequest
) -> None:
    model = request.getfixturevalue(request.node.callspec.params["unpacked"])
    given = [float.fromhex(word) for word in unpacked.run("run", 1500, 1e-3)]
    expected = simulate(model, 1.5, drive=wave(1500)).values[-1]
    assert np.allclose(given, expected, rtol=1e-12, atol=1e-12)


@each_model
def test_interleaved_instances_do_not_disturb_one_another(unpacked: Unpacked) -> None:
    assert unpacked.run("instances", 200, 50) == ["0"]


@pytest.mark.slow
@each_model
def test_a_thousand_instances(unpacked: Unpacked) -> None:
    assert unpacked.run("instances", 1000, 200) == ["0"]


@each_model
def test_threads_give_the_serial_result(unpacked: Unpacked) -> None:
    assert unpacked.run("threads", 8, 500) == ["0"]


@pytest.mark.parametrize("unpacked", ["switching_model"], indirect=True)
def test_loading_and_freeing_leaves_no_handle(unpacked: Unpacked) -> None:
    assert unpacked.run("reload", 200) == ["0"]


@pytest.mark.slow
@each_model
def test_loading_and_freeing_two_thousand_times(unpacked: Unpacked) -> None:
    assert unpacked.run("reload", 2000) == ["0"]


@each_model
def test_memory_does_not_grow(unpacked: Unpacked) -> None:
    assert int(unpacked.run("long", 20_000)[0]) < 64


@pytest.mark.slow
@each_model
def test_memory_does_not_grow_over_a_million_steps(unpacked: Unpacked) -> None:
    assert int(unpacked.run("long", 1_000_000)[0]) < 64


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
@each_model
def test_valgrind_finds_nothing(unpacked: Unpacked) -> None:
    tool = (shutil.which("valgrind") or "", "--quiet", "--error-exitcode=9", "--leak-check=full")
    unpacked.run("run", 300, 1e-3, tool=tool)
