"""The saved state of a run in Python as bytes: JSON, in which nothing is a program.

What a Python function remembers is written as numbers, texts, lists, dicts, arrays and the like. Objects inside of it
are written as their attributes, and reading never makes one: the attributes go into the object that the function itself
has made at that place. So no class, module or function is ever named by the bytes.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from engine.errors import FlexarmError
from engine.model import TIME, Model, Vector

PENDING = frozenset({"starting", "tuned", "driven", "clocked"})

INSTANTIATED, INITIALIZATION, STEP, TERMINATED, ERROR = "instantiated", "initialization", "step", "terminated", "error"
PHASES = frozenset({INSTANTIATED, INITIALIZATION, STEP, TERMINATED})
"""Of an instance's life, in which its state can be saved."""

ARRAYS = {
    "x": "states",
    "d": "memories",
    "m": "modes",
    "p": "parameters",
    "dx": "states",
    "g": "guards",
    "line": "lines",
}
"""Vectors of a simulation, with what there is one of for each number."""

INPUTS = ("base", "slope", "origin")
NUMBERS = ("t",)
COUNTS = ("steps", "events")
LISTS = ("cursor", "next", "returned")
FIELDS = (*NUMBERS, *COUNTS, *ARRAYS, *INPUTS, *LISTS)
"""Fields of `engine.interpret.Simulation` that change during a run."""


@dataclass
class Standing:
    """Where a run stands, apart from the simulation itself.

    Attributes:
        p, u: parameters and inputs as the importer set them.
        start, stop, tick: start time (s), time that no step passes (s), and the last instant passed, in ticks from the
            start.
        pending: what waits at this instant, of `PENDING`.
        simulation: fields of the simulation, or nothing before the start.
        functions: attributes of each Python function that is an object.
        phase: of the instance's life.
    """

    p: Vector
    u: Vector
    start: float = 0.0
    stop: float = math.inf
    tick: int = 0
    pending: set[str] = field(default_factory=lambda: {"starting"})
    simulation: dict[str, Any] = field(default_factory=dict)
    functions: list[dict[str, Any]] = field(default_factory=list)
    phase: str = INSTANTIATED


@dataclass(frozen=True)
class Held:
    """Attributes for an object that is there."""

    attributes: dict[str, Any]


@dataclass(frozen=True)
class Drawn:
    """The state of a numpy random generator that is there."""

    state: Any


class Code:
    """Something of the program, such as a function, which stays what it is."""


def to_bytes(kept: Standing, identity: str) -> bytes:
    """A standing as bytes, with a check sum over it and the identity of the model.

    Raises:
        FlexarmError: a Python function holds what cannot be written.
    """
    content = {
        "p": _plain(kept.p),
        "u": _plain(kept.u),
        "phase": kept.phase,
        "start": kept.start,
        "stop": kept.stop,
        "tick": kept.tick,
        "pending": sorted(kept.pending),
        "simulation": {name: _plain(value) for name, value in kept.simulation.items()},
        "functions": [_attributes(attributes, "") for attributes in kept.functions],
    }
    body = json.dumps(content, separators=(",", ":")).encode()
    return hashlib.sha256(identity.encode() + body).digest() + body


def _plain(value: Any) -> Any:
    return np.asarray(value).tolist()


def _attributes(attributes: dict[str, Any], where: str) -> dict[str, Any]:
    return {name: _written(value, f"{where}.{name}", 0) for name, value in attributes.items()}


_DEEPEST = 60


def _written(value: Any, where: str, depth: int) -> Any:
    """A value in terms of JSON; what is not of JSON's own kinds is an object of one key."""
    if depth > _DEEPEST:
        raise FlexarmError(f"the state of a Python function cannot be written: '{where[1:80]}...' is nested too deep")
    if value is None or type(value) in (bool, int, float, str):
        return value

    def each(values: Any) -> list[Any]:
        return [_written(one, f"{where}[{k}]", depth + 1) for k, one in enumerate(values)]

    kind = type(value)
    if kind is list:
        return each(value)
    if kind in (tuple, set, frozenset):
        return {kind.__name__: each(sorted(value, key=repr) if kind is not tuple else value)}
    if kind is deque:
        return {"deque": each(value), "maxlen": value.maxlen}
    if kind is dict:
        return {"dict": [each(pair) for pair in value.items()]}
    if kind is complex:
        return {"complex": [value.real, value.imag]}
    if kind in (bytes, bytearray):
        return {kind.__name__: base64.b64encode(value).decode()}
    if isinstance(value, np.generic | np.ndarray) and value.dtype.kind in "biufc":
        array = np.asarray(value)
        array = array.astype(array.dtype.newbyteorder("<"))
        numbers = base64.b64encode(array.tobytes()).decode()
        name = "array" if isinstance(value, np.ndarray) else "scalar"
        return {name: numbers, "dtype": array.dtype.str, "shape": list(array.shape)}
    if isinstance(value, np.random.Generator):
        return {"generator": _written(value.bit_generator.state, where, depth + 1)}
    if isinstance(value, type) or not hasattr(value, "__dict__") or hasattr(value, "__code__"):
        if callable(value):
            return {"code": None}
        raise FlexarmError(
            f"the state of a Python function cannot be written: its '{where[1:]}' is a {kind.__name__}",
            remedy="keep numbers, texts, lists, dicts, arrays, or objects that hold such",
        )
    return {"object": {name: _written(one, f"{where}.{name}", depth + 1) for name, one in vars(value).items()}}


def from_bytes(text: bytes, identity: str) -> Standing:
    """The standing that `to_bytes` wrote.

    Raises:
        FlexarmError: it is damaged, that of another model, or not of this form.
    """
    head, body = text[:32], text[32:]
    if hashlib.sha256(identity.encode() + body).digest() != head:
        raise FlexarmError("the state is damaged, or that of another FMU")
    try:
        content = json.loads(body)
        return Standing(
            p=_vector(content["p"]),
            u=_vector(content["u"]),
            phase=str(content["phase"]),
            start=_number(content["start"]),
            stop=_number(content["stop"]),
            tick=_count(content["tick"]),
            pending={str(what) for what in content["pending"]},
            simulation={str(name): _field(name, value) for name, value in content["simulation"].items()},
            functions=[{str(name): _read(one) for name, one in made.items()} for made in content["functions"]],
        )
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise FlexarmError(f"the state cannot be read: {type(error).__name__}: {str(error)[:200]}") from error


def _vector(value: Any) -> Vector:
    return np.array([_number(one) for one in value], dtype=float)


def _number(value: Any) -> float:
    if type(value) not in (int, float):
        raise ValueError(f"{str(value)[:40]!r} is no number")
    return float(value)


def _count(value: Any) -> int:
    if type(value) is not int:
        raise ValueError(f"{str(value)[:40]!r} is no whole number")
    return value


def _field(name: str, value: Any) -> Any:
    if name in NUMBERS:
        return _number(value)
    if name in COUNTS:
        return _count(value)
    if name == "cursor":
        return [_count(one) for one in value]
    return [_number(one) for one in value] if name == "returned" else _vector(value)


def _read(value: Any) -> Any:
    if isinstance(value, list):
        return [_read(one) for one in value]
    if not isinstance(value, dict):
        return value
    kind = next(iter(value), "")
    reader = _READERS.get(kind)
    if reader is None:
        raise ValueError(f"'{kind[:40]}' is no kind of value")
    return reader(value)


def _array(value: dict[str, Any], name: str) -> Any:
    dtype = np.dtype(str(value["dtype"]))
    if dtype.kind not in "biufc":
        raise ValueError(f"an array of '{str(dtype)[:40]}' holds no numbers")
    raw = base64.b64decode(value[name], validate=True)
    return np.frombuffer(raw, dtype).reshape([_count(n) for n in value["shape"]]).astype(dtype.newbyteorder("="))


_READERS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "tuple": lambda v: tuple(_read(v["tuple"])),
    "set": lambda v: set(_read(v["set"])),
    "frozenset": lambda v: frozenset(_read(v["frozenset"])),
    "deque": lambda v: deque(_read(v["deque"]), None if v["maxlen"] is None else _count(v["maxlen"])),
    "dict": lambda v: {_read(key): _read(one) for key, one in v["dict"]},
    "complex": lambda v: complex(*[_number(part) for part in v["complex"]]),
    "bytes": lambda v: base64.b64decode(v["bytes"], validate=True),
    "bytearray": lambda v: bytearray(base64.b64decode(v["bytearray"], validate=True)),
    "array": lambda v: _array(v, "array"),
    "scalar": lambda v: _array(v, "scalar")[()],
    "generator": lambda v: Drawn(_read(v["generator"])),
    "object": lambda v: Held({str(name): _read(one) for name, one in v["object"].items()}),
    "code": lambda v: Code(),
}


# -- what is restored must fit the model ------------------------------------------------------------------------------


def check(kept: Standing, model: Model) -> None:
    """Refuse a standing that no run of this model can have.

    Raises:
        FlexarmError: a field is missing, has another length, is not finite, or is out of its range.
    """
    inputs = len(model.inputs)
    _finite("p", kept.p, len(model.parameters))
    _finite("u", kept.u, inputs)
    for parameter, value in zip(model.parameters, kept.p.tolist(), strict=True):
        parameter.declared.check(value)
    if not (math.isfinite(kept.start) and kept.stop >= kept.start and 0 <= kept.tick < 2**62):
        raise _unfit("start, stop or tick")
    if not (kept.pending <= PENDING and kept.phase in PHASES):
        raise _unfit("pending or phase")
    if not kept.simulation:
        if "starting" not in kept.pending:
            raise _unfit("pending")
        return
    s = kept.simulation
    if set(s) != set(FIELDS) or "starting" in kept.pending:
        raise _unfit("simulation")
    sizes = {
        "states": len(model.states),
        "memories": len(model.memories),
        "modes": len(model.modes),
        "parameters": len(model.parameters),
        "guards": int(model.equations.guards.numel()),
        "lines": sum(line.size for line in model.lines),
    }
    for name, what in ARRAYS.items():
        _finite(name, s[name], sizes[what])
    for name in INPUTS:
        _finite(name, s[name], inputs + len(model.tables))
    _finite("returned", np.array(s["returned"]), sum(external.outputs for external in model.externals))
    if len(s["next"]) != model.count(TIME) or np.isnan(s["next"]).any():
        raise _unfit("next")
    if not (math.isfinite(s["t"]) and min(s["steps"], s["events"]) >= 0):
        raise _unfit("t, steps or events")
    if len(s["cursor"]) != len(model.tables):
        raise _unfit("cursor")
    if any(not -1 <= c < len(table.times) for c, table in zip(s["cursor"], model.tables, strict=True)):
        raise _unfit("cursor")
    for mode, value in zip(model.modes, s["m"].tolist(), strict=True):
        if value != round(value) or (value < 0 if mode.kind == TIME else abs(value) > 1):
            raise _unfit(f"mode '{mode.name}'")
    if len(kept.functions) != len(model.externals):
        raise _unfit("functions")


def _finite(name: str, values: Vector, count: int) -> None:
    if len(values) != count or not (~np.isnan(values) if name == "g" else np.isfinite(values)).all():
        raise _unfit(name)


def _unfit(what: str) -> FlexarmError:
    return FlexarmError(f"the state is not one of this model: its {what} cannot be", remedy="save it again")


def placed(value: Any, live: Any, where: str) -> Any:
    """A value as it goes into a function, given what stands at its place now.

    Raises:
        FlexarmError: it holds attributes for an object, and there is none of its kind at that place.
    """
    if isinstance(value, Code):
        return live
    if isinstance(value, Drawn):
        if not isinstance(live, np.random.Generator):
            raise _unfit(f"'{where}'")
        try:
            live.bit_generator.state = value.state
        except (ValueError, TypeError, KeyError) as error:
            raise _unfit(f"'{where}'") from error
        return live
    if isinstance(value, Held):
        if isinstance(live, type) or not hasattr(live, "__dict__") or hasattr(live, "__code__"):
            raise FlexarmError(
                f"the state holds an object '{where}', which a fresh function does not have",
                remedy="make such objects when the function is made, not while it runs",
            )
        fill(live, value.attributes, where)
        return live
    if type(value) is dict:
        keyed = live if isinstance(live, dict) else {}
        return {key: placed(one, keyed.get(key), f"{where}[{key!r}]") for key, one in value.items()}
    if type(value) in (list, tuple, deque):
        there = list(live) if isinstance(live, list | tuple | deque) else []
        there += [None] * (len(value) - len(there))
        made = [placed(one, there[k], f"{where}[{k}]") for k, one in enumerate(value)]
        return deque(made, value.maxlen) if isinstance(value, deque) else type(value)(made)
    return value


def fill(live: Any, attributes: dict[str, Any], where: str = "") -> None:
    """Replace the attributes of an object by others, such as `from_bytes` gives."""
    before = dict(vars(live))
    made = {name: placed(one, before.get(name), f"{where}.{name}".lstrip(".")) for name, one in attributes.items()}
    vars(live).clear()
    vars(live).update(made)
