"""What a sweep draws: a parameter and the law that its values follow, with the text that says so."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import ndtr, ndtri

from engine.errors import FlexarmError, ParameterError, nearest
from engine.quantity import Parameter, convert, number_or_text

LAWS = ("uniform", "normal", "lognormal", "triangular")
USAGE = (
    "write KEY~tolerance, KEY~10%, KEY~LOW:HIGH, KEY~normal(10%), KEY~normal(MEAN, DEVIATION), "
    "KEY~lognormal(10%), KEY~lognormal(MEDIAN, 10%) or KEY~triangular(LOW, PEAK, HIGH)"
)
_CALL = re.compile(r"^\s*([a-z]+)\s*\((.*)\)\s*$")


@dataclass(frozen=True)
class Sample:
    """A parameter drawn for each run.

    Attributes:
        name: of the model's parameter.
        low, high: of a uniform or triangular law, in ``unit``, or, where ``relative``, multiples of the model's own
            value.
        unit: of the parameter.
        relative: the drawn number multiplies the model's own value.
        floor, ceiling: bounds that the block declares; a law that reaches beyond is cut there, and is one again.
        law: one of `LAWS`.
        centre: mean of a normal law, median of a log-normal one, peak of a triangular one; relative as ``low`` is.
        spread: standard deviation of a normal law in the same sense; of the logarithm for a log-normal one.
    """

    name: str
    low: float
    high: float
    unit: str
    relative: bool
    floor: float = -math.inf
    ceiling: float = math.inf
    law: str = "uniform"
    centre: float = 1.0
    spread: float = 0.0

    def at(self, share: float, own: float) -> float:
        """The value below which a share of the law lies, for a model whose own value is ``own``.

        NaN where a normal or log-normal law has nothing between the bounds.
        """
        scale = own if self.relative else 1.0
        if self.law == "normal":
            mean, deviation = self.centre * scale, self.spread * abs(scale)
            return mean + deviation * self._within(share, lambda end: (end - mean) / deviation)
        if self.law == "lognormal":
            median = self.centre * scale
            floor, ceiling = sorted(end / median for end in (self.floor, self.ceiling))
            low, high = (ndtr(math.log(end) / self.spread) if end > 0 else 0.0 for end in (floor, ceiling))
            if not low < high:
                return math.nan
            return float(median * math.exp(self.spread * ndtri(low + (high - low) * share)))
        ends_here = sorted((self.low * scale, self.high * scale))
        if self.law == "triangular":
            return self._triangular(share, ends_here[0], ends_here[1], self.centre * scale)
        low, high = max(ends_here[0], self.floor), min(ends_here[1], self.ceiling)
        return low + (high - low) * share

    def _within(self, share: float, standard: Callable[[float], float]) -> float:
        """The standard normal number at a share of what lies between the bounds."""
        low, high = (float(ndtr(standard(end))) for end in (self.floor, self.ceiling))
        if not low < high:
            return math.nan
        return float(ndtri(low + (high - low) * share))

    def _triangular(self, share: float, low: float, high: float, peak: float) -> float:
        def below(x: float) -> float:
            if x <= low:
                return 0.0
            if x >= high:
                return 1.0
            if x < peak:
                return (x - low) ** 2 / ((high - low) * (peak - low))
            return 1 - (high - x) ** 2 / ((high - low) * (high - peak))

        first, last = below(self.floor), below(self.ceiling)
        part = first + (last - first) * share
        if part * (high - low) < peak - low:
            return low + math.sqrt(part * (high - low) * (peak - low))
        return high - math.sqrt((1 - part) * (high - low) * (high - peak))


def read_law(name: str, text: str, declared: Parameter, own: float, bounds: tuple[float, float]) -> Sample | None:
    """The sample of a text such as ``normal(10%)``; None if it is no call of a law.

    Raises:
        ParameterError: an unknown law, or values that do not fit it.
    """
    found = _CALL.match(text)
    if not found:
        return None
    law, given = found[1], [part.strip() for part in found[2].split(",") if part.strip()]
    if law not in LAWS:
        raise ParameterError(f"'{law}' is no law to draw by", remedy=nearest(law, LAWS))
    wanted = {"uniform": (2,), "normal": (1, 2), "lognormal": (1, 2), "triangular": (1, 3)}[law]
    if len(given) not in wanted:
        raise ParameterError(f"{law} takes {' or '.join(map(str, wanted))} values, not {len(given)}", remedy=USAGE)
    unit = declared.unit

    def number(part: str) -> float:
        return convert(number_or_text(part), unit)

    def share(part: str) -> float:
        value = convert(part, "1") if part.endswith("%") else math.nan
        if not value > 0:
            raise ParameterError(f"'{part}' is no share", remedy=f"write for example {name}~{law}(10%)")
        return value

    relative = len(given) == 1 and given[0].endswith("%")
    if relative and own == 0:
        raise ParameterError(f"'{name}' is 0, and a share of it as well", remedy=USAGE)
    if law in ("uniform", "triangular"):
        rows = [1 - share(given[0]), 1.0, 1 + share(given[0])] if len(given) == 1 else [number(part) for part in given]
        low, high = rows[0], rows[-1]
        peak = rows[1] if len(rows) == 3 else (low + high) / 2
        if not low < high or not low <= peak <= high:
            raise ParameterError(f"'{text}' is empty: {', '.join(given)} do not rise")
        return Sample(name, low, high, unit, relative, *bounds, law=law, centre=peak)
    if law == "lognormal":
        deviation = share(given[-1])
        centre = 1.0 if len(given) == 1 else number(given[0])
        if centre == 0:
            raise ParameterError(f"a log-normal '{name}' cannot have the median 0", remedy=USAGE)
        return Sample(
            name, 0.0, 0.0, unit, relative, *bounds, law=law, centre=centre, spread=math.sqrt(math.log1p(deviation**2))
        )
    if relative:
        return Sample(name, 0.0, 0.0, unit, True, *bounds, law=law, spread=share(given[0]))
    deviation = number(given[-1])
    if not deviation > 0:
        raise ParameterError(f"'{given[-1]}' is no standard deviation", remedy="give one above 0")
    centre = own if len(given) == 1 else number(given[0])
    return Sample(name, 0.0, 0.0, unit, False, *bounds, law=law, centre=centre, spread=deviation)


def from_fit(
    path: Path, known: dict[str, tuple[Parameter, tuple[float, float]]]
) -> tuple[tuple[Sample, ...], tuple[tuple[float, ...], ...]]:
    """The samples and their correlations that ``flexarm fit --json`` found: what it left uncertain, and together.

    Args:
        path: the file.
        known: declaration and bounds of the model's parameters.

    Raises:
        FlexarmError: the file is not one, or names a parameter that the model does not have.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        spread, values = content["spread"], content["parameters"]
        names, logarithmic, deviations = spread["names"], spread["logarithmic"], spread["deviation"]
        correlation = np.array(spread["correlation"], dtype=float)
        if correlation.shape != (len(names), len(names)) or not len(names) == len(logarithmic) == len(deviations):
            raise ValueError("sizes")
    except OSError as error:
        raise FlexarmError(f"'{path}' cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise FlexarmError(
            f"'{path}' is no result of a fit with its spread", remedy="write it by: flexarm fit ... --json > fit.json"
        ) from None
    made = []
    for name, log, deviation in zip(names, logarithmic, deviations, strict=True):
        if name not in known:
            raise FlexarmError(f"'{path}': the model has no parameter '{name}'", remedy=nearest(name, known))
        declared, bounds = known[name]
        law = "lognormal" if log else "normal"
        centre = float(values[name]["value"])
        made.append(
            Sample(name, 0.0, 0.0, declared.unit, False, *bounds, law=law, centre=centre, spread=float(deviation))
        )
    return tuple(made), tuple(tuple(float(c) for c in row) for row in correlation)


def correlated(shares: Sequence[float], correlation: Sequence[Sequence[float]]) -> list[float]:
    """Shares of which the first follow a correlation: a Gaussian copula, by the symmetric root of the matrix."""
    n = len(correlation)
    if not n:
        return list(shares)
    values, vectors = np.linalg.eigh(np.asarray(correlation, dtype=float))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    mixed = ndtr(root @ ndtri(np.asarray(shares[:n])))
    return [*np.clip(mixed, 1e-15, 1 - 1e-15).tolist(), *shares[n:]]
