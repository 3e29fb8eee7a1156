"""The saved state of the python backend is data: it comes back whole, and nothing that is read from it is a program."""

from __future__ import annotations

import hashlib
import json
import math
import pickle
import threading
import warnings
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.errors import FlexarmError
from flexarm.cut import cut
from fmu.plan import plan
from fmu.python_core import Core
from fmu.python_state import Standing, fill, from_bytes, to_bytes
from tests.fmu.makers import PYTHON_SCENARIO

CONTROLLER = """\
import random
import math
from collections import deque
import numpy as np

class Filter:
    def __init__(self):
        self.value = 0.0

class Integrator:
    def __init__(self):
        self.sum, self.filters, self.law = 0.0, [Filter(), Filter()], math.tanh
        self.window, self.noise = deque(maxlen=3), np.random.default_rng(7)
        self.seen, self.matrix = {(1, 2): "x"}, np.eye(2)

    def __call__(self, t, u):
        self.sum += 0.005 * (u[0] - u[1])
        for one in self.filters:
            one.value += 0.1 * (u[0] - one.value)
        self.window.append(u[1])
        self.matrix *= 1.01
        wiggle = 0.01 * self.noise.normal()
        return self.law(sum(f.value for f in self.filters) + sum(self.window) + self.sum + wiggle + self.matrix[0, 0])
"""


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("state")
    (folder / "code").mkdir()
    (folder / "code" / "controller.py").write_text(CONTROLLER)
    (folder / "arm.yaml").write_text(PYTHON_SCENARIO)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = plan(cut(folder / "arm.yaml", "export").model)
    return lambda: Core(made)


def _outputs(core: Core, first: int, last: int) -> list[float]:
    for k in range(first, last):
        core.step(k * 1e-3, 1e-3)
    return core.get([v.reference for v in core.plan.variables if v.kind == "output"])


def _started(core: Core) -> Core:
    core.begin(0.0)
    core.set([next(v.reference for v in core.plan.variables if v.kind == "input")], [3.0])
    return core


def _text(content: Any, identity: str = "i") -> bytes:
    body = json.dumps(content).encode()
    return hashlib.sha256(identity.encode() + body).digest() + body


def test_objects_arrays_queues_and_noise_come_back(core: Any) -> None:
    one, other = _started(core()), _started(core())
    _outputs(one, 0, 40)
    saved = to_bytes(one.snapshot(), "i")
    expected = _outputs(one, 40, 90)
    other.restore(from_bytes(saved, "i"))
    assert _outputs(other, 40, 90) == expected
    one.restore(from_bytes(saved, "i"))
    assert _outputs(one, 40, 90) == expected


class Evil:
    def __reduce__(self) -> Any:
        return (Path.touch, (Path("touched"),))


def test_a_pickle_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bytes of an earlier format, with a sound check sum."""
    monkeypatch.chdir(tmp_path)
    body = pickle.dumps(Evil())
    with pytest.raises(FlexarmError, match="cannot be read"):
        from_bytes(hashlib.sha256(b"i" + body).digest() + body, "i")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_data_is_refused_by_name() -> None:
    class Function:
        lock = None

    held = Function()
    held.lock = threading.Lock()  # type: ignore[assignment]
    with pytest.raises(FlexarmError, match="'lock' is a lock"):
        to_bytes(Standing(np.zeros(1), np.zeros(0), functions=[vars(held)]), "i")
    circle: list[Any] = []
    circle.append(circle)
    with pytest.raises(FlexarmError, match="too deep"):
        to_bytes(Standing(np.zeros(1), np.zeros(0), functions=[{"a": circle}]), "i")


def test_no_object_is_made_and_code_stays(core: Any) -> None:
    """Attributes go into objects that are there; where none is, the state is refused and nothing has changed."""
    one = _started(core())
    _outputs(one, 0, 10)
    content = json.loads(to_bytes(one.snapshot(), "i")[32:])
    expected = to_bytes(one.snapshot(), "i")
    for place, value in (
        ("sum", {"object": {"a": 1}}),
        ("law", {"object": {"__code__": 1}}),
        ("noise", {"generator": {"dict": [["bit_generator", "os"]]}}),
        ("filters", [{"object": {"value": 1.0}}] * 3),
    ):
        changed = json.loads(json.dumps(content))
        changed["functions"][0][place] = value
        with pytest.raises(FlexarmError):
            one.restore(from_bytes(_text(changed), "i"))
        assert to_bytes(one.snapshot(), "i") == expected


BAD: dict[str, tuple[Any, ...]] = {
    "p": ([], [1e400], [None], "x", {"a": 1}),
    "u": ([math.nan], [math.inf], [0.0, 0.0], None),
    "start": (math.nan, "0", None, [0]),
    "tick": (-1, 2**70, 0.5, True),
    "pending": (["os.system"], "x", None, 3),
    "phase": ("error", "x", None, 3),
    "stop": (-1.0, math.nan, "x", None),
    "simulation": ({"t": 0.0}, {}, [], "x"),
    "functions": ([], [{}, {}], [{"a": {"pickle": "x"}}], {"a": 1}),
}
BAD_FIELDS = {
    "t": (math.nan, "x"),
    "x": ([math.nan, 0.0], [0.0], [1e400, 0.0]),
    "m": ([7.0], [0.5], [math.nan], []),
    "d": ([], [math.inf, 0.0]),
    "cursor": ([5], [-2], [0.5]),
    "returned": ([], [math.nan], ["x"]),
    "steps": (-1, 0.5),
    "base": ([], [math.nan]),
    "g": ([math.nan, 0.0], []),
}


def test_every_field_is_checked(core: Any) -> None:
    """With a sound check sum, which anybody can work out."""
    one = _started(core())
    _outputs(one, 0, 10)
    whole = to_bytes(one.snapshot(), "i")
    for name, values in (*BAD.items(), *((f"simulation {name}", values) for name, values in BAD_FIELDS.items())):
        for value in values:
            content = json.loads(whole[32:])
            (content["simulation"] if " " in name else content)[name.rpartition(" ")[2]] = value
            with pytest.raises(FlexarmError):
                one.restore(from_bytes(_text(content), "i"))
            assert to_bytes(one.snapshot(), "i") == whole, (name, value)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary() | st.complex_numbers(),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.tuples(inner, inner)
        | st.dictionaries(st.text() | st.integers(), inner, max_size=3)
        | st.lists(inner, max_size=3).map(lambda v: deque(v, 5))
    ),
    max_leaves=10,
)


class _Holder:
    pass


@given(PLAIN)
def test_plain_values_come_back_the_same(value: Any) -> None:
    back = from_bytes(to_bytes(Standing(np.zeros(1), np.zeros(0), functions=[{"a": value}]), "i"), "i")
    holder = _Holder()
    fill(holder, back.functions[0])
    assert repr(holder.a) == repr(value)  # type: ignore[attr-defined]


@given(st.binary(max_size=200) | st.recursive(st.none() | st.floats() | st.text(), st.lists).map(json.dumps))
def test_any_bytes_are_refused_in_words(core: Any, text: bytes | str) -> None:
    body = text.encode() if isinstance(text, str) else text
    with pytest.raises(FlexarmError):
        core().restore(from_bytes(hashlib.sha256(b"i" + body).digest() + body, "i"))
