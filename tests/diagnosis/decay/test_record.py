"""Whatever the record and the settings: a clear error or finite numbers; and the same decay from every kind of file."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from diagnosis.decay.record import decay_record, read_decay
from diagnosis.decay.report import analyse_decay
from diagnosis.recordings.columns import RecordingError
from engine.errors import FlexarmError
from tests.diagnosis.decay.decays import LIGHT, MODES, two_modes, viscous

KINDS = {
    "decay": lambda t, f, g: np.exp(-g * f * t) * np.cos(2 * np.pi * f * t),
    "growth": lambda t, f, g: np.exp(np.minimum(g * f * t, 200)) * np.cos(2 * np.pi * f * t),
    "square": lambda t, f, g: np.sign(np.sin(2 * np.pi * f * t)),
    "counts": lambda t, f, g: np.round(5 * np.exp(-g * f * t) * np.cos(2 * np.pi * f * t)),
    "pulse": lambda t, f, g: (np.arange(len(t)) == len(t) // 2).astype(float),
    "ramp": lambda t, f, g: t,
    "creep": lambda t, f, g: np.exp(-g * f * t),
    "noise": lambda t, f, g: np.random.default_rng(3).standard_normal(len(t)),
    "walk": lambda t, f, g: np.cumsum(np.random.default_rng(3).standard_normal(len(t))),
}
number = st.floats(allow_nan=True, allow_infinity=True)
settings_of = st.fixed_dictionaries(
    {},
    optional={
        "frequencies": st.lists(st.floats(1e-3, 600.0), min_size=1, max_size=3),
        "window": st.one_of(st.floats(1e-3, 3.0), number),
        "hop": st.one_of(st.floats(1e-3, 1.0), number),
        "windows": st.integers(-2, 40),
        "taper": st.sampled_from(["hann", "rectangular"]),
        "start": st.one_of(st.floats(0, 2.0), number),
        "rest": number,
    },
)


@settings(max_examples=200)
@given(
    st.sampled_from(sorted(KINDS)),
    st.integers(2, 1500),
    st.floats(0.1, 450.0),
    st.floats(1e-4, 10.0),
    st.sampled_from([0, 0, 0, -150, -90, 90, 150]),
    st.sampled_from([0.0, 1.0, -1e6]),
    settings_of,
)
def test_a_clear_error_or_finite_numbers(
    kind: Any, samples: Any, frequency: Any, rate: Any, power: Any, offset: Any, asked: Any
) -> None:
    time = np.arange(samples) * 1e-3
    kinds: dict[Any, Any] = KINDS
    values = kinds[kind](time, frequency, rate) * 10.0**power + offset
    try:
        with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
            warnings.simplefilter("ignore")
            found = analyse_decay(decay_record(time, values), **asked).numbers()
    except FlexarmError:
        return
    json.dumps(found, allow_nan=False)
    for mode in (found["waterfall"] or {"modes": []})["modes"]:
        assert math.isfinite(mode["ratio"])


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".parquet"])
def test_the_same_decay_from_every_kind_of_file(suffix: str, tmp_path: Path) -> None:
    time, values = two_modes(1000, LIGHT)
    path = tmp_path / f"decay{suffix}"
    if suffix == ".csv":
        np.savetxt(path, np.column_stack([time, values]), delimiter=",", header="time,tip", comments="", fmt="%.17g")
    elif suffix == ".mat":
        from scipy.io import savemat

        savemat(path, {"time": time[:, None], "tip": values[:, None]})
    else:
        import pyarrow
        import pyarrow.parquet

        pyarrow.parquet.write_table(pyarrow.table({"time": time, "tip": values}), path)
    record = read_decay(path)
    assert record.name == "tip"
    assert record.values == pytest.approx(values, rel=1e-12, abs=1e-15)
    found = analyse_decay(record, MODES, window=0.4, hop=0.05, windows=6)
    assert found.waterfall is not None
    assert [mode.ratio for mode in found.waterfall.modes] == pytest.approx(LIGHT, rel=5e-3)


def test_a_record_too_short_for_windows_still_has_a_decrement() -> None:
    time = np.arange(0, 2.2, 1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = analyse_decay(decay_record(time, viscous(time, 0.96, 0.05, phase=-0.5)), (0.7,), rest=0.0)
    assert found.waterfall is None
    assert any("no evolving spectra: the record lasts 2.2 s" in note for note in found.notes)
    assert found.decrement is not None
    assert found.decrement.ratio == pytest.approx(0.05, rel=1e-3)


@pytest.mark.parametrize(
    ("time", "values", "words"),
    [
        ([0.0, 1.0], [1.0, 2.0], "2 samples"),
        (np.zeros(20), np.arange(20.0), "does not increase"),
        (np.arange(20.0), np.ones(20), "constant"),
        (np.arange(20.0), np.full(20, np.nan), "not finite"),
        (np.arange(20.0), np.arange(19.0), "shape"),
        (np.arange(20.0), np.arange(20.0) * 1e200, "choose another unit"),
    ],
)
def test_arrays_that_are_no_record(time: Any, values: Any, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        decay_record(time, values)
