"""Margins of a loop: gain, phase, delay and disk margins, sensitivity peaks and stability, over a family.

The loop is opened at one input. With G from the input to the signal that comes back to it, the loop transfer function
of the negative-feedback convention is L = -G, and the closed loop is stable where 1 + L has no zero on the right.
python-control computes the margins, on a grid that is dense at every resonance (`control.stability_margins`,
`control.disk_margins`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg

from engine.errors import FlexarmError, nearest
from engine.linearise import LinearModel
from engine.model import Vector
from flexarm.cut import Cut, Source, as_scenario, cut

if TYPE_CHECKING:
    import control

    from engine.family import LinearFamily

DRIFT = 1e-9
"""Singular value, of rows of unit length, below which a combination of states neither moves nor is seen."""

POINTS = 2000
"""Frequencies at which sensitivities and disk margins are looked at, beside those at resonances."""


@dataclass(frozen=True)
class Margins:
    """Margins of one loop.

    Attributes:
        stable: whether the closed loop is.
        gain: factors below and above 1 at which the Nyquist curve meets -1; 0 and infinite where it does not.
        phase: smallest phase margin (deg).
        delay: smallest delay (s) that takes it.
        crossover: highest frequency (rad/s) at which the loop gain is 1; nan if there is none.
        disk: balanced disk margin alpha: gain within (2 - alpha)/(2 + alpha) to its inverse and phase at once.
        sensitivity: peak of the gain of 1 / (1 + L).
        complementary: peak of the gain of L / (1 + L).
    """

    stable: bool
    gain: tuple[float, float]
    phase: float
    delay: float
    crossover: float
    disk: float
    sensitivity: float
    complementary: float


@dataclass(frozen=True)
class LoopMargins:
    """Margins of every member of a family of loops.

    Attributes:
        input, returns: where the loop is opened, and the signal that comes back.
        members: margins, in the order of the flattened family.
        loops: the loop transfer functions L, as python-control systems, in the same order.
        family: the linear models; None where there is one alone, or a sampled one.
        assumed: what was chosen and not asked for, in words.
    """

    input: str
    returns: str
    members: tuple[Margins, ...]
    loops: tuple[Any, ...] = field(repr=False)
    family: LinearFamily | None = field(repr=False, default=None)
    assumed: tuple[str, ...] = ()

    @property
    def worst(self) -> int:
        """Number of the member with the smallest disk margin; of an unstable one if there is any."""
        keys = [(m.stable, m.disk if math.isfinite(m.disk) else math.inf) for m in self.members]
        return min(range(len(keys)), key=keys.__getitem__)


def margins_of(loop: control.StateSpace, delay: float = 0.0) -> Margins:
    """Margins of a loop transfer function with one input and one output, continuous or sampled.

    What drifts unseen, such as the common angle of shafts in a loop of speeds, is no part of the loop: see
    `without_drift`. Any other hidden mode counts for stability.

    Args:
        loop: the loop.
        delay: a further delay (s) in it, as of `margins`.

    Raises:
        FlexarmError: more inputs or outputs, or a delay that cannot be.
    """
    import control

    if loop.ninputs != 1 or loop.noutputs != 1:
        raise FlexarmError(
            f"a loop has one input and one output, and here are {loop.ninputs} and {loop.noutputs}",
            remedy="open one loop at a time, the others closed",
        )
    # The poles that stand for a short delay are so fast that those of the loop itself look like drift beside them.
    bare = without_drift(control.ss(loop))
    loop = _delayed(bare, delay)
    omega = frequencies_of_a_loop(loop)
    if delay:
        omega = np.union1d(omega, frequencies_of_a_loop(bare))
        omega = np.union1d(omega, np.geomspace(omega[0], omega[-1], POINTS))  # and between them
    response = np.asarray(loop(np.exp(1j * omega * loop.dt) if loop.dt else 1j * omega)).ravel()
    keep = np.isfinite(response)
    omega, response = omega[keep], response[keep]
    with np.errstate(all="ignore"):
        gain, phase, delay, crossover = _classical(omega, response, _ends(loop))
        s = 1 / (1 + response)
        disk = float(control.disk_margins(loop, omega, skew=0.0)[0])
    poles = np.atleast_1d(control.feedback(loop, 1).poles())
    size = _size(np.atleast_1d(control.feedback(bare, 1).poles()))
    stable = bool((np.abs(poles) < 1 - 1e-9).all() if loop.dt else (poles.real < -1e-9 * size).all())
    peak, other = float(np.abs(s).max(initial=0.0)), float(np.abs(response * s).max(initial=0.0))
    return Margins(stable, gain, phase, delay, crossover, disk if stable else 0.0, peak, other)


def without_drift(system: control.StateSpace) -> control.StateSpace:
    """A system without what only drifts in it: combinations of states that change nothing, or that nothing changes.

    The first are the null vectors of A and C together, such as the common angle where only speeds and twists act; the
    second those of the transposes of A and B. Of a sampled system, A - 1 stands for A. Input to output stays the same.
    """
    import control

    A, B, C = (np.array(m, dtype=float) for m in (system.A, system.B, system.C))
    if len(A):  # states of one size, so that ranks can be told
        A, (size, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
        B, C = B / size[:, None], C * size
    while len(A):
        rate = A - np.eye(len(A)) if system.dt else A
        still = next((N for N in (_null(rate, C), _null(rate.T, B.T)) if N.size), None)
        if still is None:
            break
        keep = scipy.linalg.null_space(still.T)
        A, B, C = keep.T @ A @ keep, keep.T @ B, C @ keep
    return control.ss(A, B, C, system.D, system.dt or 0)


def _null(first: Any, second: Any) -> Any:
    """Vectors that both matrices take to zero, shape (n, k)."""
    rows = np.vstack([first, second])
    size = np.linalg.norm(rows, axis=1)
    rows = rows[size > 0] / size[size > 0, None]
    return scipy.linalg.null_space(rows, rcond=DRIFT) if len(rows) else np.eye(first.shape[0])


def _size(poles: Vector) -> float:
    return max(1.0, float(np.abs(poles).max(initial=0.0))) * 1e-3


def frequencies_of_a_loop(loop: Any) -> Vector:
    """Frequencies (rad/s), dense about every lightly damped pole of the open and the closed loop."""
    import control

    every = np.concatenate([np.atleast_1d(loop.poles()), np.atleast_1d(control.feedback(loop, 1).poles())])
    if loop.dt:
        every = np.log(np.where(every == 0, 1e-12, every).astype(complex)) / loop.dt
    sizes = np.abs(every)
    sizes = sizes[(sizes > 1e-7 * sizes.max(initial=0.0)) & (sizes > 1e-9)]
    low, high = (sizes.min() / 100, sizes.max() * 100) if len(sizes) else (1e-2, 1e3)
    high = min(high, math.pi / loop.dt * (1 - 1e-9)) if loop.dt else high
    grid = [np.geomspace(min(low, high / 10), high, POINTS)]
    for pole in every[(every.imag > 0) & (np.abs(every.real) < 0.5 * np.abs(every))]:
        width = max(abs(pole.real), 1e-4 * pole.imag)
        grid.append(pole.imag + width * np.linspace(-5, 5, 41))
    found = np.unique(np.concatenate(grid))
    return np.asarray(found[(found > 0) & (found <= high)])


def _ends(loop: Any) -> list[float]:
    """The loop at rest, and at half its rate of samples or at frequencies without end: real, where no pole is there."""
    A, B, C, D = (np.asarray(m, dtype=float) for m in (loop.A, loop.B, loop.C, loop.D))
    found = [] if loop.dt else [float(D[0, 0])]
    for z in (1.0, -1.0) if loop.dt else (0.0,):
        away = np.abs(np.atleast_1d(loop.poles()) - z)
        if (away > 1e-7 * max(1.0, away.max(initial=0.0))).all():  # no integrator, as rounding leaves it
            found.append(float((D + C @ np.linalg.solve(z * np.eye(len(A)) - A, B))[0, 0]))
    return found


def _classical(
    omega: Vector, response: Any, ends: Sequence[float] = ()
) -> tuple[tuple[float, float], float, float, float]:
    """Gain margins below and above 1, smallest phase (deg) and delay margin (s), highest crossover (rad/s).

    Between the frequencies the Nyquist curve is followed across the axis; at its ``ends`` it only meets it.
    """
    import control

    gains, phases, _, _, crossings, _ = control.stability_margins(
        control.frd(response, omega, smooth=True), returnall=True
    )
    least = 1e-9 * float(np.abs(response).max(initial=0.0))  # what is zero but for rounding
    every = [*map(float, gains), *(-1 / end for end in ends if end < -least)]
    low = max((g for g in every if 0 < g < 1), default=0.0)
    high = min((g for g in every if g >= 1), default=math.inf)
    around = [float(p) % 360.0 for p in phases]
    delays = [math.radians(p) / float(w) for p, w in zip(around, crossings, strict=True)]
    phase = min((min(p, 360.0 - p) for p in around), default=math.inf)
    return (low, high), phase, min(delays, default=math.inf), float(max(crossings, default=math.nan))


def open_loop(made: Cut) -> tuple[str, str]:
    """The input at which an analysis opens a loop, and the signal that comes back to it."""
    if len(made.settings.inputs) != 1 or len(made.settings.outputs) != 1:
        raise FlexarmError("a loop is opened at one input, to which one signal comes back")
    return made.settings.inputs[0], made.settings.outputs[0]


def loop_cut(source: Source, analysis: str | None = None, loop: str | None = None, returns: str | None = None) -> Cut:
    """A scenario with a loop opened.

    Args:
        source: a scenario, its file or shipped name.
        analysis: name of an analysis in the file; the first of kind ``margins`` if None.
        loop: the input at which the loop is opened, in place of that of the analysis.
        returns: the signal that comes back to it; what feeds the input if None.

    Raises:
        FlexarmError: no such input, nothing that feeds it, or nothing says where to open.
    """
    scenario = as_scenario(source)
    fitting = {name: found for name, found in scenario.analyses.items() if found.kind == "margins"}
    if analysis is not None and analysis not in fitting:
        raise FlexarmError(f"there is no analysis '{analysis}' of kind margins", remedy=nearest(analysis, fitting))
    planned = fitting[analysis] if analysis is not None else next(iter(fitting.values()), None)
    if loop is None and planned is None:
        raise FlexarmError("nothing says where to open the loop", remedy="name an input: --loop motor.voltage")
    end = scenario.resolve(loop) if loop is not None else planned.inputs[0]  # type: ignore[union-attr]
    back = (scenario.resolve(returns),) if returns is not None else planned.outputs if planned is not None else ()
    if not back:
        known = scenario.system.inputs()
        if end not in known:
            raise FlexarmError(f"'{end}' is not an input", remedy=nearest(end, known))
        feeding = scenario.system.source_of(end)
        if feeding is None:
            raise FlexarmError(f"nothing feeds '{end}', so that no loop is closed there", remedy="name another input")
        back = (feeding[0],)
    if planned is None:
        return cut(scenario, "margins", None, inputs=[end], outputs=back)
    return cut(scenario, "margins", planned.name, inputs=[end], outputs=back)


def margins(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    loop: str | None = None,
    returns: str | None = None,
    grid: Mapping[str, str | Sequence[float]] | None = None,
    delay: float = 0.0,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    trim: str | None = None,
) -> LoopMargins:
    """Margins of a loop of a scenario, of every member of a family if there is a grid.

    Args:
        source: a scenario, its file or shipped name, or the result of `loop_cut`.
        analysis: name of an analysis in the file; the first of kind ``margins`` if None.
        loop: the input at which the loop is opened; in place of that of the analysis.
        returns: the signal that comes back to it; what feeds the input if None.
        grid: as of `flexarm.api.linear_family`.
        delay: of the computation (s), in the loop: a Pade approximation of fifth order, exact in whole periods of a
            sampled loop.
        modes: as of `flexarm.api.linearise`, and the next two.
        at: the point otherwise.
        trim: an analysis of kind ``trim``.

    Raises:
        FlexarmError: no loop is closed there, or as of the linear models.
    """
    from flexarm.api import discretise, linear_family, linearise

    made = source if isinstance(source, Cut) else loop_cut(source, analysis, loop, returns)
    end, back = open_loop(made)
    over = grid or made.settings.options.get("grid")
    family = None
    if made.model.clocks:
        if over:
            raise FlexarmError(
                "a family of sampled loops is not made", remedy="give --set for each value, or take continuous blocks"
            )
        rows: Iterable[LinearModel] = [discretise(made, modes=modes, at=at, trim=trim)]
        assumed: tuple[str, ...] = ()
    elif over:
        family = linear_family(made, grid=over, modes=modes, at=at, trim=trim)
        rows, assumed = [family.kept(k) for k in range(len(family))], family.assumed
    else:
        one = linearise(made, modes=modes, at=at, trim=trim)
        rows, assumed = [one], one.assumed
    bare = [negated(row) for row in rows]
    loops = tuple(_delayed(one, delay) for one in bare)
    if all(not np.any(one.B) or not np.any(one.C) for one in loops) and not any(np.any(one.D) for one in loops):
        raise FlexarmError(
            f"nothing of '{end}' comes back in '{back}', so that no loop is closed there",
            remedy="open at another input, name what comes back (--returns), or take another point (--at): a block "
            "that is at its limit at this one, such as a controller, passes nothing on",
        )
    return LoopMargins(end, back, tuple(margins_of(one, delay) for one in bare), loops, family, assumed)


def negated(linear: LinearModel) -> Any:
    """L = -G as a python-control system."""
    import control

    found = linear.to_control()
    return control.ss(found.A, found.B, -found.C, -found.D, found.dt or 0)


def _delayed(loop: Any, delay: float) -> Any:
    """The loop with a further delay (s)."""
    import control

    if not delay:
        return loop
    if not (math.isfinite(delay) and delay > 0):
        raise FlexarmError(f"a delay of {delay:g} s cannot be", remedy="give a time, not below zero")
    if loop.dt:
        periods = round(delay / loop.dt)
        if abs(periods * loop.dt - delay) > 1e-9 * loop.dt:
            raise FlexarmError(f"the loop is sampled every {loop.dt:g} s", remedy="give a delay of whole periods")
        A = np.diag(np.ones(periods - 1), -1)
        B, C = np.eye(periods, 1), np.eye(periods)[-1:]
        return control.series(control.ss(A, B, C, 0, loop.dt), loop)
    unit = control.tf2ss(*control.pade(1.0, 5))  # of a second, whose numbers are of one size
    return control.series(control.ss(unit.A / delay, unit.B / delay, unit.C, unit.D), loop)
