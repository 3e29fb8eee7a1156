"""CSV as loggers write it: each file holds the same numbers, and what was assumed is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.recordings.columns import read_columns
from engine.errors import FlexarmError

T = 0.01 * np.arange(40)
U = np.round(np.sin(9 * T), 6)
W = np.round(100 * np.cos(3 * T), 4)


def rows(delimiter: str = ",", *, comma: bool = False) -> str:
    lines = [delimiter.join(f"{x:.10g}" for x in row) for row in zip(T, U, W, strict=True)]
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


CASES = {
    "decimal commas": ("t;u;w\n" + rows(";", comma=True), "utf-8", "commas are taken for decimal points"),
    "tabs and commas": ("t\tu\tw\n" + rows("\t", comma=True), "utf-8", "commas are taken for decimal points"),
    "units": ("t,u,w\ns,V,rad/s\n" + rows(), "utf-8", "the row under the header is taken for units"),
    "units in brackets": ("t;u;w\n[s];[V];[rad/s]\n" + rows(";"), "utf-8", "taken for units"),
    "preamble": (
        "Logger X, serial 12\nDate: 2026-01-01\nComment; none\n\nt,u,w\n" + rows(),
        "utf-8",
        "before the header are left out",
    ),
    "all of it": (
        "Messung Prüfstand\nDatum: 1.2.2026\n\nt;u;w\ns;V;rad/s\n" + rows(";", comma=True),
        "cp1252",
        "the file is taken to be in cp1252",
    ),
    "utf-16": ("t\tu\tw\n" + rows("\t"), "utf-16", "the file is taken to be in utf-16"),
    "a name too few": ("u,w\n" + rows(), "utf-8", "the first column is called [1]"),
    "blanks": ("t u w\n" + rows(" "), "utf-8", ""),
    "matlab comment": ("% t u w\n" + rows(" "), "utf-8", ""),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("ending", [".csv", ".log", ""])
def test_what_loggers_write_is_read_and_told(name: str, ending: str, tmp_path: Path) -> None:
    text, encoding, note = CASES[name]
    path = tmp_path / f"run{ending}"
    path.write_bytes(text.encode(encoding))
    read = read_columns(path)
    time = "[1]" if name == "a name too few" else "t"
    assert read.names == [time, "u", "w"]
    for column, values in ((time, T), ("u", U), ("w", W)):
        np.testing.assert_allclose(read.number(column), values, atol=1e-9)
    assert note in " ".join(read.notes)
    if "units" in name:
        assert read.units["w"] == "rad/s"


def test_a_tidy_table_is_read_without_a_guess(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t,u,w\n" + rows())
    assert read_columns(tmp_path / "run.csv").notes == ()


@pytest.mark.parametrize(
    "stamp",
    [
        lambda t: f"2026-03-01 23:59:59.{round(1000 * t):03d}" if t < 0.999 else "",
        lambda t: f"01.03.2026 12:00:00,{round(1000 * t):03d}",
        lambda t: f"12:34:56.{round(1000 * t):03d}",
        lambda t: f"2026-03-01T10:00:00.{round(1000 * t):03d}Z",
    ],
)
def test_dates_and_clocks_become_seconds(stamp: object, tmp_path: Path) -> None:
    assert callable(stamp)
    lines = [f"{stamp(t)};{u:.6g}" for t, u in zip(T, U, strict=True)]
    (tmp_path / "run.csv").write_text("when;u\n" + "\n".join(lines) + "\n")
    read = read_columns(tmp_path / "run.csv")
    np.testing.assert_allclose(read.number("when"), T, atol=1e-6)
    assert any("seconds from the first" in note for note in read.notes)


def test_a_clock_that_passes_midnight(tmp_path: Path) -> None:
    stamps = ["23:59:59.90", "23:59:59.95", "00:00:00.00", "00:00:00.05", "00:00:00.10"]
    (tmp_path / "run.csv").write_text("when,u\n" + "\n".join(f"{s},{k}" for k, s in enumerate(stamps)) + "\n")
    np.testing.assert_allclose(read_columns(tmp_path / "run.csv").number("when"), 0.05 * np.arange(5), atol=1e-9)


def test_words_of_a_sensor_that_gave_no_value(tmp_path: Path) -> None:
    text = ("t;u;w\n" + rows(";", comma=True)).splitlines()
    text[9] = "0,08;ERR;" + text[9].split(";")[2]
    (tmp_path / "run.csv").write_text("\n".join(text) + "\n")
    read = read_columns(tmp_path / "run.csv")
    assert np.isnan(read.number("u")[8])
    assert np.isfinite(np.delete(read.number("u"), 8)).all()
    assert any("words in column 'u' count as empty cells: 1 of" in note for note in read.notes)


def test_what_is_no_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.xyz").write_bytes(bytes(range(256)) * 20)
    with pytest.raises(FlexarmError, match="is of no known kind") as caught:
        read_columns(tmp_path / "run.xyz")
    assert "format: csv" in caught.value.remedy
    (tmp_path / "text.csv").write_text("dear diary\nnothing was measured today\n")
    with pytest.raises(FlexarmError):
        read_columns(tmp_path / "text.csv")
