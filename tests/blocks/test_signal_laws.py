"""Offset and uneven gain: their static maps."""

from __future__ import annotations

from typing import Any

import numpy as np

from blocks.registry import find
from engine.assemble import build
from engine.simulate import Drive, simulate
from engine.system import System


def _map(block: Any, values: Any) -> Any:
    system = System({"b": block}, [])
    model = build(system, inputs=["b.in"], outputs=["b.out"])
    times = np.arange(len(values)) * 0.1
    return simulate(model, float(times[-1]), 0.1, drive=Drive(times, np.array(values)[:, None]))["b.out"]


def test_an_offset_is_added() -> None:
    assert _map(find("Offset")(offset=0.3), [-1.0, 0.0, 2.0]).tolist() == [-0.7, 0.3, 2.3]


def test_an_uneven_gain_has_a_slope_for_each_side() -> None:
    found = _map(find("UnevenGain")(forward=1.5, backward=0.5), [-2.0, 1.0, 0.0, -1.0, 4.0])
    assert found.tolist() == [-1.0, 1.5, 0.0, -0.5, 6.0]
