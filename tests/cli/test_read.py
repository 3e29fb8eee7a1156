"""`flexarm.read`: the same numbers, names and units from every kind of result file, and what made them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexarm
from engine.errors import FlexarmError
from flexarm.table import Table
from scenarios.load import load


@pytest.mark.parametrize("ending", ["csv", "parquet", "mat"])
def test_results_come_back(base: Path, ending: str, command: Any) -> None:
    assert command("run", base, "--set", "gear.ratio=14", "-o", f"results.{ending}").code == 0
    expected = flexarm.simulate(load(base, ["gear.ratio=14"]))
    found = flexarm.read(f"results.{ending}")
    assert found.names == ["time", *expected.names]
    assert found.units == {"time": "s", **expected.units}
    assert len(found) == len(expected.time)
    assert np.array_equal(found["time"], expected.time)
    for name in expected.names:
        assert np.array_equal(found[name], expected[name]), name
    if ending == "csv":
        assert found.scenario_hash is None
    else:
        assert found.scenario_hash == load(base, ["gear.ratio=14"]).digest
        assert found.metadata["overrides"] == "gear.ratio=14"
        assert found.metadata["flexarm"] == flexarm.version()


def test_chosen_columns_and_a_frame(base: Path, command: Any) -> None:
    command("run", base, "-o", "results.parquet")
    found = flexarm.read("results.parquet", ["load.shaft.angle", "time"])
    assert found.names == ["load.shaft.angle", "time"]
    frame = flexarm.read("results.parquet").to_pandas()
    assert frame.attrs["units"]["load.shaft.angle"] == "rad"
    assert next(iter(frame.columns)) == "time"


def test_a_table_tells_what_it_holds(base: Path, command: Any) -> None:
    """Iterated it gives names, printed the range of each column: 1 V before and 0.82 V behind the dead zone."""
    command("run", base, "-o", "results.csv")
    found = flexarm.read("results.csv")
    assert list(found) == found.names
    head, heads, *rows = str(found).splitlines()
    assert head == "results.csv: 101 rows"
    assert heads.split() == ["column", "unit", "least", "greatest"]
    shown = {row.split()[0]: row.split()[1:] for row in rows}
    assert shown["source.out"] == ["V", "1", "1"]
    assert shown["zone.out"] == ["V", "0.82", "0.82"]
    assert shown["load.shaft.angle"][:2] == ["rad", "0"]
    assert float(shown["load.shaft.angle"][2]) == pytest.approx(found["load.shaft.angle"].max(), rel=1e-5)
    with pytest.raises(FlexarmError, match="has no column '0'"):
        _ = found[0]  # type: ignore[index]


def test_a_table_of_texts_and_gaps_can_be_printed() -> None:
    columns = {"run": np.arange(2.0), "end": np.array([np.nan, 3.0]), "failure": np.array(["diverged", ""], object)}
    text = str(Table(Path("t.parquet"), columns, {"end": "rad"}, {}))
    assert [line.split() for line in text.splitlines()[2:]] == [
        ["run", "0", "1"],
        ["end", "rad", "3", "3"],
        ["failure", "text", "in", "1"],
    ]


def test_what_is_refused(base: Path, command: Any) -> None:
    command("run", base, "-o", "results.parquet")
    with pytest.raises(FlexarmError, match=r"there is no file 'result\.parquet'") as caught:
        flexarm.read("result.parquet")
    assert "results.parquet" in caught.value.remedy
    with pytest.raises(FlexarmError, match=r"has no column 'load\.shaft\.angel'") as caught:
        flexarm.read("results.parquet", ["load.shaft.angel"])
    assert "load.shaft.angle" in caught.value.remedy
    with pytest.raises(FlexarmError, match="has no column 'x'"):
        _ = flexarm.read("results.parquet")["x"]
    with pytest.raises(FlexarmError, match="of no kind that can be read"):
        flexarm.read(base)
    for ending in ("parquet", "mat", "csv"):
        Path(f"odd.{ending}").write_bytes(b"\x89odd\x00\xff")
        with pytest.raises(FlexarmError, match=rf"'odd\.{ending}' is no result file that can be read"):
            flexarm.read(f"odd.{ending}")
