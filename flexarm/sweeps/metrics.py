"""Numbers of a run that a user names: overshoot, settling time and the like, or a Python function of the result."""

from __future__ import annotations

import hashlib
import importlib.util
import math
import re
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.quantity import convert, number_or_text

if TYPE_CHECKING:
    from engine.simulate import Result

Vector = NDArray[np.float64]

_CALL = re.compile(r"^\s*(?:([A-Za-z_]\w*)\s*=\s*)?([a-z_]+)\s*\(\s*([^(),]+?)\s*((?:,[^()]*)?)\)\s*$")
_FILE = re.compile(r"^\s*(?:([A-Za-z_]\w*)\s*=\s*)?(.+\.py)\s*:\s*([A-Za-z_]\w*)\s*$")
USAGE = "write NAME=overshoot(SIGNAL), settling_time(SIGNAL, band=2%), rms(SIGNAL, after=1 s) or NAME=FILE.py:FUNCTION"


def overshoot(time: Vector, y: Vector, target: float) -> float:
    """How far the signal goes beyond its target, as a share of the way from its first value; 0 if it does not."""
    way = target - y[0]
    return max(0.0, float(((y - target) / way).max())) if way else math.nan


def settling_time(time: Vector, y: Vector, target: float, band: float = 0.02) -> float:
    """When the signal stays within a band about its target, a share of the way from its first value; NaN if never."""
    outside = np.flatnonzero(np.abs(y - target) > band * abs(target - y[0]))
    if not len(outside):
        return 0.0
    return float(time[outside[-1] + 1] - time[0]) if outside[-1] + 1 < len(time) else math.nan


def rise_time(time: Vector, y: Vector, target: float) -> float:
    """Time from 10 % to 90 % of the way from the first value to the target; NaN if it does not come so far."""
    way = (y - y[0]) / (target - y[0]) if target != y[0] else np.zeros_like(y)
    if not (way >= 0.9).any():
        return math.nan
    return _crossing(time, way, 0.9) - _crossing(time, way, 0.1)


def _crossing(time: Vector, way: Vector, level: float) -> float:
    k = int(np.argmax(way >= level))
    if k == 0:
        return float(time[0])
    share = (level - way[k - 1]) / (way[k] - way[k - 1])
    return float(time[k - 1] + share * (time[k] - time[k - 1]))


def rms(time: Vector, y: Vector) -> float:
    """Root mean square over the rows."""
    return math.sqrt(float(np.mean(np.square(y))))


def peak_to_peak(time: Vector, y: Vector) -> float:
    """Greatest less least value."""
    return float(np.ptp(y))


def mean(time: Vector, y: Vector) -> float:
    """Mean over the rows."""
    return float(y.mean())


def largest(time: Vector, y: Vector) -> float:
    """Greatest magnitude."""
    return float(np.abs(y).max())


_TARGETED: dict[str, tuple[Callable[..., float], str]] = {
    "overshoot": (overshoot, "1"),
    "settling_time": (settling_time, "s"),
    "rise_time": (rise_time, "s"),
}
_PLAIN: dict[str, Callable[..., float]] = {"rms": rms, "peak_to_peak": peak_to_peak, "mean": mean, "largest": largest}


@dataclass(frozen=True)
class Metric:
    """A number of each run.

    Attributes:
        name: its column.
        function: one of the named ones, or ``FILE.py:FUNCTION``.
        signal: what it is of; empty for a Python function, which is given the whole result.
        unit: of the number, empty where that is not known.
        settings: ``target``, ``band`` (a share) and ``after`` (s), where they are given.
        digest: of the file of a Python function.
    """

    name: str
    function: str
    signal: str
    unit: str
    settings: tuple[tuple[str, float], ...] = ()
    digest: str = ""

    def of(self, result: Result) -> float:
        """The number.

        Raises:
            FlexarmError: the Python function raised, or gave no number.
        """
        if not self.signal:
            return _called(self.function, result)
        settings = dict(self.settings)
        time, y = result.time, result[self.signal]
        since = settings.pop("after", None)
        if since is not None:
            time, y = time[time >= since], y[time >= since]
        if not len(y):
            return math.nan
        if self.function in _TARGETED:
            return _TARGETED[self.function][0](time, y, **({"target": float(y[-1])} | settings))
        return _PLAIN[self.function](time, y)


def read_metrics(texts: Sequence[str], outputs: Mapping[str, str], taken: Container[str] = ()) -> tuple[Metric, ...]:
    """The metrics of ``--metric`` texts.

    Args:
        texts: as `USAGE` says.
        outputs: signal -> unit, of those the runs record.
        taken: names of the table's other columns.

    Raises:
        ParameterError: a text that cannot be read, a signal that is not recorded, or two columns of one name.
    """
    made: dict[str, Metric] = {}
    for text in texts:
        where = Where(f"--metric {text}")
        try:
            metric = _from_file(text) or _from_call(text, outputs)
        except FlexarmError as error:
            raise error.at(where) from None
        if metric.name in made:
            raise ParameterError(f"two metrics are called '{metric.name}'", where, "name one: NAME=...")
        if metric.name in taken:
            raise ParameterError(
                f"the table has a column '{metric.name}' already", where, "give the metric another name: NAME=..."
            )
        made[metric.name] = metric
    return tuple(made.values())


def _from_file(text: str) -> Metric | None:
    found = _FILE.match(text)
    if not found:
        return None
    path = Path(found[2]).resolve()
    if not path.is_file():
        raise ParameterError(f"there is no file '{found[2]}'")
    place = f"{path}:{found[3]}"
    _function(place)
    return Metric(found[1] or found[3], place, "", "", digest=hashlib.sha256(path.read_bytes()).hexdigest()[:16])


def _from_call(text: str, outputs: Mapping[str, str]) -> Metric:
    found = _CALL.match(text)
    if not found:
        raise ParameterError(f"'{text}' is no metric", remedy=USAGE)
    name, function, signal, rest = found.groups()
    known = [*_TARGETED, *_PLAIN]
    if function not in known:
        raise ParameterError(f"there is no metric '{function}'", remedy=nearest(function, known))
    if signal not in outputs:
        raise ParameterError(f"'{signal}' is not among the outputs", remedy=nearest(signal, outputs))
    allowed = [
        "after",
        *(["target"] if function in _TARGETED else []),
        *(["band"] if function == "settling_time" else []),
    ]
    units = {"target": outputs[signal], "band": "1", "after": "s"}
    settings: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in rest.split(","))):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or key not in allowed:
            raise ParameterError(
                f"'{part}' is no setting of {function}", remedy=f"allowed: {', '.join(sorted(allowed))}"
            )
        settings[key] = convert(number_or_text(value), units[key])
    unit = _TARGETED[function][1] if function in _TARGETED else outputs[signal]
    return Metric(name or f"{function}({signal})", function, signal, unit, tuple(sorted(settings.items())))


def _function(place: str) -> Callable[[Any], Any]:
    path, _, name = place.rpartition(":")
    described = importlib.util.spec_from_file_location(f"flexarm_metric_{Path(path).stem}", path)
    assert described is not None
    assert described.loader is not None
    module = importlib.util.module_from_spec(described)
    try:
        described.loader.exec_module(module)
    except Exception as error:
        raise ParameterError(f"'{path}' cannot be imported: {type(error).__name__}: {error}") from error
    found = getattr(module, name, None)
    if not callable(found):
        names = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
        raise ParameterError(f"'{path}' has no function '{name}'", remedy=nearest(name, names))
    return found  # type: ignore[no-any-return]


_loaded: dict[str, Callable[[Any], Any]] = {}


def _called(place: str, result: Result) -> float:
    if place not in _loaded:
        _loaded[place] = _function(place)
    try:
        return float(_loaded[place](result))
    except Exception as error:
        raise FlexarmError(f"metric {Path(place).name}: {type(error).__name__}: {error}") from error
