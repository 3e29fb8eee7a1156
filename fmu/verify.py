"""Checks of an exported FMU with FMPy: its description, a run, and the difference from flexarm's own run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import FlexarmError, SimulationError, nearest
from engine.model import Model, Vector
from engine.simulate import Drive, simulate
from fmu.host import Host, host
from fmu.loaded import loaded
from fmu.variables import flat

MOST_POINTS = 100_000_000
"""Communication steps of one run."""


@dataclass(frozen=True)
class Trace:
    """Results of a run of an FMU.

    Attributes:
        time: communication points (s), shape (n,).
        values: outputs at each, with the inputs of that instant set, shape (n, outputs).
        names: of the outputs.
    """

    time: Vector
    values: NDArray[np.float64]
    names: tuple[str, ...]

    def __getitem__(self, name: str) -> Vector:
        """One output over time, by its flat name or the model's, shape (n,).

        Raises:
            FlexarmError: no such output.
        """
        return np.asarray(self.values[:, self.names.index(find(name, self.names, "output"))])


def find(name: str, names: Sequence[str], what: str) -> str:
    """The one of an FMU's names that is meant: the name itself, or else the only one that is the same when flat.

    Raises:
        FlexarmError: there is none, or there are several.
    """
    if name in names:
        return name
    alike = [known for known in names if flat(known) == flat(name)]
    if len(alike) == 1:
        return alike[0]
    if alike:
        raise FlexarmError(f"the FMU has several {what}s like '{name}'", remedy=f"write one of {', '.join(alike)}")
    raise FlexarmError(f"the FMU has no {what} '{name}'", remedy=nearest(name, names))


def validate(path: str | Path) -> list[str]:
    """Problems that FMPy finds in an FMU's description and structure; empty if there are none."""
    from fmpy.validation import validate_fmu

    return [str(problem) for problem in validate_fmu(str(path))]


@contextmanager
def slave(path: str | Path, name: str = "instance") -> Iterator[tuple[Any, Any, list[str]]]:
    """An instance of an FMI 2 Co-Simulation FMU in this process, not yet set up, for calls one by one.

    Yields:
        (fmpy's `FMU2Slave`, its model description, the list into which its log messages go).
    """
    with loaded(path, name) as made:
        yield made.raw, made.description, made.messages


def references(description: Any, causality: str) -> list[int]:
    """Value references of the variables of a causality, clocks aside, in the order of the description."""
    return [v.valueReference for v in description.modelVariables if v.causality == causality and v.type != "Clock"]


def reference(description: Any, name: str) -> int:
    """Value reference of a variable.

    Raises:
        FlexarmError: no such variable.
    """
    known = {v.name: v.valueReference for v in description.modelVariables}
    if name not in known:
        raise FlexarmError(f"the FMU has no variable '{name}'", remedy=nearest(name, known))
    return int(known[name])


def cosim(
    path: str | Path,
    stop: float,
    step: float | Sequence[float] = 1e-3,
    *,
    drive: Drive | None = None,
    parameters: dict[str, float] | None = None,
) -> Trace:
    """Run a Co-Simulation FMU of FMI 2 or 3 with FMPy.

    At each communication point inputs are set before outputs are read.

    Args:
        path: the FMU.
        stop: end (s).
        step: communication step (s), or several that are used in turn.
        drive: inputs in the order of the FMU's; zero if None.
        parameters: values by name, set before the start, SI units.

    Raises:
        SimulationError: a call failed; the message is the FMU's.
        FlexarmError: no such parameter.
    """
    with host(path) as instance:
        inputs, outputs = instance.names("input"), instance.names("output")
        instance.set(list(parameters or {}), list((parameters or {}).values()))
        times, rows = [0.0], []
        with instance.starting(0.0, stop):
            _apply(instance, inputs, drive, 0.0)
        rows.append(instance.get(outputs))
        for begin, end in points(stop, step):
            instance.step(begin, end - begin)
            _apply(instance, inputs, drive, end)
            times.append(end)
            rows.append(instance.get(outputs))
        instance.end()
    return Trace(np.array(times), np.array(rows).reshape(len(times), -1), outputs)


def points(stop: float, step: float | Sequence[float]) -> Iterator[tuple[float, float]]:
    """Begin and end of every communication step.

    Raises:
        SimulationError: there would be more than `MOST_POINTS`, or none.
    """
    steps = [step] if isinstance(step, int | float) else list(step)
    if not (min(steps) > 0 and stop / min(steps) <= MOST_POINTS):
        raise SimulationError(
            f"{stop:g} s in communication steps of {min(steps):g} s cannot be run",
            remedy=f"give times above zero, and at most {MOST_POINTS:.0e} steps",
        )
    cycle, count, begin = sum(steps), 0, 0.0
    while begin < stop * (1 - 1e-12):
        turns, part = divmod(count + 1, len(steps))
        end = min(turns * cycle + sum(steps[:part]), stop)
        yield begin, end
        begin, count = end, count + 1


def _apply(instance: Host, inputs: Sequence[str], drive: Drive | None, time: float) -> None:
    if drive is not None and inputs:
        values, slopes = present(drive, len(inputs), time)
        instance.set(inputs, values.tolist(), slopes.tolist())


def present(drive: Drive | None, count: int, time: float) -> tuple[Vector, Vector]:
    """Values and slopes of a drive's signals from an instant on; shape (count,) each."""
    if drive is None:
        return np.zeros(count), np.zeros(count)
    knots, values = drive.rows(count)
    k = max(int(np.searchsorted(knots, time + 1e-9, side="right")) - 1, 0)
    now, slopes = values[k].copy(), np.zeros(count)
    if k + 1 < len(knots) and knots[0] <= time:
        for i, hold in enumerate(drive.holds(count)):
            if hold == "linear":
                slopes[i] = (values[k + 1, i] - values[k, i]) / (knots[k + 1] - knots[k])
                now[i] += slopes[i] * (time - knots[k])
    return now, slopes


def compare_with_runner(
    model: Model,
    path: str | Path,
    stop: float,
    step: float = 1e-3,
    *,
    drive: Drive | None = None,
    parameters: dict[str, float] | None = None,
) -> float:
    """The largest difference between an FMU's outputs and those of `engine.simulate` at the same step.

    Args:
        model: what was exported.
        path: the FMU.
        stop: end (s).
        step: communication step (s), that of the FMU's internal grid.
        drive: inputs, piecewise constant with its knots on communication points.
        parameters: values by name, SI units.

    Returns:
        max over outputs and rows of |difference| / max(1, largest |value| of the output).

    Raises:
        SimulationError: either run failed.
    """
    run = simulate(model, stop, step, drive=drive, parameters=parameters)
    trace = cosim(path, stop, step, drive=drive, parameters=parameters)
    if run.values.shape != trace.values.shape:
        raise SimulationError(f"the runner gave {run.values.shape} values, the FMU {trace.values.shape}")
    scale = np.maximum(1.0, np.abs(run.values).max(axis=0, initial=0.0))
    return float((np.abs(run.values - trace.values) / scale).max(initial=0.0))
