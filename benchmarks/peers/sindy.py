"""PySINDy's discrepancy modelling on the cases of the proof: ``python -m benchmarks.peers.sindy -o DIR``.

After [Kaheman 2019]: what the nominal model does not explain of the acceleration is regressed sparsely on a library of
functions. The nominal model is flexarm's linear one. Its states come from the sensors: as many sensors as coordinates,
speeds and accelerations by smoothed differentiation. Both sides are smoothed by the same kernel, so that smoothing does
not act as a discrepancy. What an error of a parameter can be (q, v, u, and the pendulum's own sin q) is fitted first,
as a refit of the nominal model would, and does not count as found. Smoothing, thresholds and the choice among them were
tuned in the method's favour on cases of development.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from diagnosis.recordings.mapping import from_scenario
from diagnosis.recordings.types import Recording
from engine.errors import FlexarmError
from engine.files import writing
from engine.linearise import linearise
from scenarios.load import Scenario, load

Array = NDArray[np.float64]

WINDOW, DEGREE = 101, 4
"""Samples and degree of the smoothing polynomial."""

THRESHOLDS = (0.01, 0.02, 0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5)
"""Of the sequentially thresholded regression, in standard deviations of the acceleration left over."""

PATIENCE = 1.02
"""The sparsest model whose held-out error is within this factor of the best is taken."""

ALIKE = 1e-2
"""A term of which the linear ones leave a smaller share than this cannot be told from them."""

ORDERS = (1, 2, 3, 6)
LINEAR = "linear"

TERMS: dict[str, tuple[str, ...]] = {
    "dead_zone": ("sign u",),
    "uneven_gain": ("|u|",),
    "offset": ("1",),
    "coulomb_friction": ("sign v",),
    "stribeck_friction": ("sign v",),
    "direction_dependent_friction": ("sign v", "1"),
    "quadratic_drag": ("v|v|",),
    "hardening_spring": ("e^3",),
    "gravity": ("sin", "cos"),
    "torque_ripple": ("sin", "cos"),
}
"""Effects that a term of the library can be, by the beginning of its name."""


class DoesNotApplyError(Exception):
    """The method needs something that the recordings do not give."""


def select(folder: Path) -> list[str]:
    """The nonlinear terms that the method selects from a case's recordings.

    Args:
        folder: with ``scenario.yaml`` and the recordings.

    Raises:
        DoesNotApplyError: the sensors do not give the states.
    """
    scenario = load(folder / "scenario.yaml")
    names = list(scenario.recordings)
    parts = [_equations(scenario, name) for name in names]
    hold = [scenario.recordings[name].role == "hold_out" for name in names]
    chosen: set[str] = set()
    for row in range(len(parts[0][1])):
        train, test = (
            (
                np.concatenate([p[0] for p, h in zip(parts, hold, strict=True) if h == role]),
                np.concatenate([p[1][row] for p, h in zip(parts, hold, strict=True) if h == role]),
            )
            for role in (False, True)
        )
        chosen |= _regress(train, test, parts[0][2])
    return sorted(chosen)


def _equations(scenario: Scenario, name: str) -> tuple[Array, list[Array], list[str]]:
    """Library of one recording, shape (samples, terms), accelerations left over, and the names of the terms."""
    recording = from_scenario(scenario, name)
    if not isinstance(recording, Recording):
        raise DoesNotApplyError("a frequency table holds no time series")
    model = linearise(
        scenario.build([c.name for c in recording.drive], [c.name for c in recording.measurements]),
    )
    count = len(model.states) // 2
    if len(model.outputs) != count:
        raise DoesNotApplyError(f"{len(model.outputs)} sensors do not give {count} coordinates")
    step = float(recording.time[1] - recording.time[0])
    motions = []
    sensing = np.zeros((count, count))
    for k, channel in enumerate(recording.measurements):
        position, speed = model.C[k, :count], model.C[k, count:]
        values = np.asarray(channel.values, dtype=float)
        if np.any(speed):
            if np.any(position):
                raise DoesNotApplyError(f"'{channel.name}' mixes position and speed")
            values = cumulative_trapezoid(values, dx=step, initial=0.0)
        sensing[k] = speed if np.any(speed) else position
        motions.append(values)
    if np.linalg.cond(sensing) > 1e6:
        raise DoesNotApplyError("the sensors do not tell the coordinates apart")
    raw = np.linalg.solve(sensing, np.array(motions))
    q, v, a = (savgol_filter(raw, WINDOW, DEGREE, deriv=d, delta=step, axis=1) for d in range(3))
    u = np.asarray(recording.drive[0].values, dtype=float)
    left = a - model.A[count:] @ np.vstack([q, v]) - model.B[count:, :1] @ _smooth(u[None])
    inside = slice(WINDOW, -WINDOW)
    library = {name: _smooth(values[None])[0][inside] for name, values in _library(scenario, q, v, u).items()}
    return np.column_stack(list(library.values())), [row[inside] for row in left], list(library)


def _smooth(values: Array) -> Array:
    return np.asarray(savgol_filter(values, WINDOW, DEGREE, axis=1))


def _library(scenario: Scenario, q: Array, v: Array, u: Array) -> dict[str, Array]:
    """Functions of the states: those that parameters could be (linear), and others."""
    from benchmarks.concealed.plants import PLANTS

    terms = {"1": np.ones_like(u), "sign u": np.sign(u), "|u|": np.abs(u), f"{LINEAR} u": u}
    for i in range(len(q)):
        terms |= {f"{LINEAR} q{i}": q[i], f"{LINEAR} v{i}": v[i]}
        terms |= {f"sign v{i}": np.sign(v[i]), f"v|v|{i}": v[i] * np.abs(v[i]), f"q{i}^3": q[i] ** 3}
    if len(q) == 2 and scenario.name == "geared-two-mass":  # its twist, well-conditioned; the arms have it as q1
        del terms["q1^3"], terms[f"{LINEAR} q1"], terms[f"{LINEAR} v1"]
        twist, rate = q[0] - q[1], v[0] - v[1]
        terms |= {f"{LINEAR} e": twist, f"{LINEAR} e'": rate, "e^3": twist**3}
    elif len(q) == 2:
        terms["e^3"] = terms.pop("q1^3")
    ratio = PLANTS[scenario.name].fixed.get("gear.ratio", 1.0) if scenario.name in PLANTS else 1.0
    for turns in sorted({1.0, ratio}):
        for order in ORDERS:
            angle = order * turns * q[0]
            terms |= {f"sin {order * turns:g} q0": np.sin(angle), f"cos {order * turns:g} q0": np.cos(angle)}
    if scenario.name == "pendulum":  # its own weight
        terms[f"{LINEAR} sin q0"] = terms.pop("sin 1 q0")
    return terms


def _regress(train: tuple[Array, Array], test: tuple[Array, Array], names: Sequence[str]) -> set[str]:
    """Terms of one equation: the linear ones fitted first, the others sparsely to what they leave."""
    from pysindy import STLSQ

    linear = np.array([name.startswith(LINEAR) for name in names])
    others = [name for name in names if not name.startswith(LINEAR)]
    weights = np.linalg.lstsq(train[0][:, linear], np.column_stack([train[0][:, ~linear], train[1]]), rcond=1e-10)[0]
    (terms, left), (test_terms, test_left) = (
        (rest[:, :-1], rest[:, -1])
        for x, y in (train, test)
        for rest in [np.column_stack([x[:, ~linear], y]) - x[:, linear] @ weights]
    )
    scale = np.std(terms, axis=0)
    hidden = scale < ALIKE * np.std(train[0][:, ~linear], axis=0) + 1e-12
    hidden[others.index("1")] = scale[others.index("1")] < ALIKE
    scale[hidden] = np.inf
    size = float(np.std(left)) or 1.0
    found: list[tuple[float, int, set[str]]] = []
    for threshold in THRESHOLDS:
        optimizer = STLSQ(threshold=threshold, alpha=1e-3, max_iter=30)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            optimizer.fit(terms / scale, left / size)
        chosen = np.ravel(optimizer.coef_)
        error = float(np.mean((test_left / size - test_terms / scale @ chosen) ** 2))
        found.append((error, int(np.sum(chosen != 0)), {n for n, w in zip(others, chosen, strict=True) if w}))
    best = min(error for error, _, _ in found)
    return min((f for f in found if f[0] <= PATIENCE * best), key=lambda f: (f[1], f[0]))[2]


def judge(terms: Sequence[str], effects: Sequence[str]) -> dict[str, Any]:
    """Whether the right terms were selected, and nothing else; for nothing concealed, whether none was."""
    if not effects:
        return {"applies": True, "reason": "", "selected": not terms, "alone": not terms}
    missing = [effect for effect in effects if effect not in TERMS]
    if missing:
        return {"applies": False, "reason": f"no term is {missing[0]}", "selected": False, "alone": False}
    expected = [TERMS[effect] for effect in effects]
    selected = all(any(t.startswith(start) for t in terms for start in starts) for starts in expected)
    every = tuple(start for starts in expected for start in starts)
    return {
        "applies": True,
        "reason": "",
        "selected": selected,
        "alone": selected and all(t.startswith(every) for t in terms),
    }


def one(folder: Path, name: str) -> dict[str, Any]:
    """Select blind, then open the answer."""
    begin = time.perf_counter()
    try:
        terms: list[str] = select(folder / "cases" / name)
    except DoesNotApplyError as error:
        return {"applies": False, "reason": str(error), "selected": False, "alone": False, "terms": [], "seconds": 0.0}
    seconds = time.perf_counter() - begin
    answer = json.loads((folder / "answers" / f"{name}.json").read_text(encoding="utf-8"))
    effects = [c["effect"] for c in answer["concealed"]]
    return {**judge(terms, effects), "terms": terms, "seconds": seconds}


def main(arguments: list[str] | None = None) -> int:
    """Run the method on every case of a folder that `benchmarks.proof` filled."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.sindy", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    given = parser.parse_args(arguments)
    try:
        import pysindy  # noqa: F401
    except ImportError:
        print("pysindy is not installed; remedy: pip install 'flexarm[peers]'", file=sys.stderr)
        return 1
    kept = given.output / "sindy"
    kept.mkdir(parents=True, exist_ok=True)
    for path in sorted((given.output / "answers").glob("*.json")):
        target = kept / path.name
        if path.stem.startswith(("wrong", "withheld")) or target.exists():
            continue
        try:
            found = one(given.output, path.stem)
        except FlexarmError as error:
            print(f"{path.stem}: {error}", file=sys.stderr)
            continue
        with writing(target, (".json",)) as temporary:
            temporary.write_text(json.dumps(found) + "\n", encoding="utf-8")
        print(f"{path.stem}: {', '.join(found['terms']) or found['reason'] or 'nothing'}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
