"""The repairs of the page on recordings make a file readable that is refused without them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.binding import find_recording
from diagnosis.recordings.types import Recording
from scenarios.load import load
from tools import console

PAGE = console.ROOT / "docs" / "how-to" / "recordings.md"

SCENARIO = """\
schema: 1
name: rig
blocks:
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7}
recordings:
  run:
    file: clean.csv
    time: {column: Zeit, unit: s}
    drive: {motor.voltage: {column: U, unit: V}}
    measurements: {motor.shaft.angle: {column: 'Winkel [°]', unit: deg}}
"""

HEADER = "Zeit,U,Winkel [°]\n"
TIME = [102.346 + 0.002 * k for k in range(50)]
ROWS = "".join(f"{t:.3f},{-1.5 if k % 20 else 2.25},{0.125 * k}\n" for k, t in enumerate(TIME))

FILES = {
    "tr , .": (HEADER + ROWS).replace(",", ";").replace(".", ",").encode(),
    "sed 2d": (HEADER + "s,V,deg\n" + ROWS).encode(),
    "tail -n +4": ("Logger 3\n2024-03-01, 10:22\n\n" + HEADER + ROWS).encode(),
    "iconv -f LATIN1": (HEADER + ROWS).encode("latin-1"),
}
"""Files as loggers write them, by how they were repaired by hand before they were read as they are."""


@pytest.mark.parametrize("begin", FILES)
def test_a_file_of_a_logger_is_read_as_it_is(begin: str, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(SCENARIO, encoding="utf-8")
    (tmp_path / "clean.csv").write_bytes(FILES[begin])
    found = find_recording(load(tmp_path / "rig.yaml"), "run")
    assert isinstance(found, Recording)
    np.testing.assert_allclose(found.time, np.array(TIME) - TIME[0], atol=1e-9)
    assert len(found.drive[0].values) == len(TIME)
    np.testing.assert_allclose(found.drive[0].values[:2], [2.25, -1.5], rtol=1e-12)
    np.testing.assert_allclose(found.measurements[0].values, np.radians(0.125 * np.arange(50)), rtol=1e-12)
