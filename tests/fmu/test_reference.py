"""The exported reference arm against equations written by hand in C (also timed by benchmarks/bench_fmu.py)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fmu
from benchmarks.reference_arm import ByHand, model
from engine.simulate import Drive


@pytest.mark.parametrize("payload", [0.0, 0.03])
def test_outputs_equal_those_of_hand_written_c(payload: float, tmp_path: Path) -> None:
    """The second time the FMU is made for another payload and tuned to this one."""
    path = fmu.export(model(payload / 2), tmp_path / "arm.fmu", platforms=["linux64"])
    tuned = {"link.payload": payload} if payload else {}
    trace = fmu.cosim(path, 1.0, drive=Drive([0.0], [[1.5]]), parameters=tuned)
    hand = ByHand(payload)
    rows = [hand.outputs(1.5)]
    for _ in range(1000):
        hand.run(1.5, 1e-3, 1)
        rows.append(hand.outputs(1.5))
    assert np.abs(trace.values - np.array(rows)).max() < 1e-9
