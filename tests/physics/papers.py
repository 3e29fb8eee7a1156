"""The papers' own tables, as they are shipped in scenarios/data."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

DATA = Path(__file__).parents[2] / "scenarios" / "data"


def table(name: Any) -> list[Any]:
    """The rows of a file as dictionaries of text."""
    lines = [line for line in (DATA / f"{name}.csv").read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def column(name: Any, heading: Any) -> NDArray[Any]:
    """One column as numbers."""
    return np.array([float(row[heading]) for row in table(name)])
