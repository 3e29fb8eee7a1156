"""FMUs of other makers as a property: see ``tests/fmu/foreign.c`` for what the binary can do."""

from __future__ import annotations

import functools
import tempfile
import zipfile
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from hypothesis import strategies as st

from engine.errors import FlexarmError
from fmu.verify import cosim
from tests.fmu.makers import foreign_binary
from tests.fmu.test_foreign import DESCRIPTION, NAMES, WAYS
from tests.robustness.guard import RESULT, bounded, explained


@functools.cache
def _binary() -> bytes:
    return foreign_binary("foreign.c")


def foreign() -> st.SearchStrategy[Any]:
    """Names of input and output, what the binary does, and how much of it is there."""
    names = st.sampled_from([name for pair in NAMES for name in pair]) | st.text(
        st.characters(min_codepoint=32, max_codepoint=0x2FF), min_size=1, max_size=12
    )
    ways = st.sampled_from([k for k, way in enumerate(WAYS) if way != "hang"])
    return st.tuples(names, names, ways, st.none() | st.floats(0, 1))


def check_foreign(given: tuple[str, str, int, float | None]) -> str:
    """Co-simulate three steps."""
    input, output, way, share = given
    binary = _binary()
    with tempfile.TemporaryDirectory() as folder, bounded():
        path = Path(folder) / "m.fmu"
        with zipfile.ZipFile(path, "w") as archive:
            text = DESCRIPTION.format(input=quoteattr(input), output=quoteattr(output))
            archive.writestr("modelDescription.xml", text)
            archive.writestr("binaries/linux64/m.so", binary[: None if share is None else int(share * len(binary))])
        try:
            found = cosim(path, 0.003, 1e-3, parameters={"how": float(way)})
        except FlexarmError as error:
            return explained(error)
        assert np.isfinite(found.values).all()
        return RESULT
