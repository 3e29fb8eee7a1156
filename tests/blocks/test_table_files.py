"""Tables from MATLAB and JSON files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from blocks.sources.table import Table
from engine.assemble import build
from engine.errors import ParameterError
from engine.simulate import simulate
from engine.system import System

TIMES, VALUES = [0.0, 0.4, 1.0], [1.0, 3.0, -1.0]


def _written(folder: Path, kind: str, **vectors: list[float]) -> str:
    path = folder / f"log{kind}"
    if kind == ".mat":
        savemat(path, {name: np.array(values) for name, values in vectors.items()})
    else:
        path.write_text(json.dumps(vectors), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("kind", [".mat", ".json"])
def test_a_vector_is_held_or_interpolated(tmp_path: Path, kind: str) -> None:
    file = _written(tmp_path, kind, time=TIMES, u=VALUES)
    for hold in ("zero_order", "linear"):
        block = Table(file=file, column="u", hold=hold, scale="2 V")
        run = simulate(build(System({"log": block}, [])), 1.2, 0.1)
        line = np.interp(run.time, TIMES, VALUES)
        steps = np.array(VALUES)[np.searchsorted(TIMES, run.time + 1e-9, side="right") - 1]
        assert run["log.out"] == pytest.approx(2.0 * (line if hold == "linear" else steps), abs=1e-12)


@pytest.mark.parametrize(
    ("vectors", "said"),
    [
        ({"time": TIMES, "v": VALUES}, "no vector 'u'"),
        ({"time": TIMES, "u": VALUES[:2]}, "3 times but 2 values"),
        ({"time": [0.0, 0.5, 0.5], "u": VALUES}, "does not come after"),
        ({"time": TIMES, "u": [1.0, float("nan"), 2.0]}, "not a finite number"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, vectors: dict[str, list[float]], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        Table(file=_written(tmp_path, ".mat", **vectors), column="u")
