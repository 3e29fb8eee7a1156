"""The papers' own tables, as they are shipped in scenarios/data."""

import csv
from pathlib import Path

import numpy as np

DATA = Path(__file__).parents[2] / "scenarios" / "data"


def table(name):
    """The rows of a file as dictionaries of text."""
    lines = [line for line in (DATA / f"{name}.csv").read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def column(name, heading):
    """One column as numbers."""
    return np.array([float(row[heading]) for row in table(name)])
