"""The state in which a recording begins: what its first samples say of it, and what the model's statics add.

A measured position begins at its sample, and its noise is the standard deviation of the prior. Positions that nothing
measures begin where the model's stored energy is least while the measured ones are held: the others hang, twist or lie
still. Measurements of all kinds of positions count, through the derivative of the outputs by the coordinates: an angle,
the twist between two angles, the deflection of a tip.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array, FreeParameter
from diagnosis.recordings.columns import RecordingError
from diagnosis.thresholds import FITTING
from engine.errors import FlexarmError, nearest
from engine.model import Model
from engine.ports import MOTION
from engine.start import start_values, starting_names

if TYPE_CHECKING:
    from engine.model import Equations

_POSITIONS = tuple(kind[0][1] for kind in MOTION.values())
_SPEEDS = tuple(kind[1][1] for kind in MOTION.values())
_ORDERS = {name: order for kind in MOTION.values() for order, (name, _) in enumerate(kind[:2])}
_INDEPENDENT = 1e-9
"""Share of a row that must be left after the rows before it are taken out, for it to say something new."""
_ROUNDS = 8
"""Newton steps towards the equilibrium: statics of springs are nearly linear."""


@dataclass(frozen=True)
class FirstSamples:
    """What the statics need of a recording.

    Attributes:
        name: of the recording, for messages.
        time: of the samples (s), shape (samples,).
        measured: shape (samples, signals), in the units of the model's outputs, NaN where nothing was recorded.
        sigma: standard deviation of each signal's noise, shape (signals,).
        stated: for each signal, whether the user stated that noise.
        from_first: for each signal, whether it counts from its first sample, and says nothing of a position.
        inputs: the recorded inputs at the first instant, in the model's order.
    """

    name: str
    time: Array
    measured: Array
    sigma: Array
    stated: tuple[bool, ...]
    from_first: tuple[bool, ...]
    inputs: Array


@dataclass(frozen=True)
class Start:
    """Starting values of a recording.

    Attributes:
        free: names that a fit may choose.
        values: of all names that begin elsewhere than in the model's own start (SI): free, given, and following ones.
        deviations: standard deviation of the prior of each free one (SI).
        measured: free names that first samples of stated noise tell.
        follows: coordinates that move with free ones so that the rest stays in equilibrium: name -> free name ->
            derivative.
        let_go: whether it begins out of equilibrium: all positions are free, and nothing measures some of them.
    """

    free: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    deviations: Mapping[str, float] = field(default_factory=dict)
    measured: frozenset[str] = frozenset()
    follows: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    let_go: bool = False

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """Starting values in which the following coordinates are where the free ones among ``values`` put them."""
        made = dict(values)
        for name, slopes in self.follows.items():
            made[name] = self.values[name] + sum(
                slope * (made[free] - self.values[free]) for free, slope in slopes.items()
            )
        return made


class Statics:
    """The outputs and the stored energy of a model as functions of its coordinates, for the starts of its recordings.

    Args:
        model: whose inputs and outputs are those of the recordings.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.names = starting_names(model)
        self.n = model.coordinates
        self.p = model.parameter_values
        self.own = start_values(model, self.p)

    def at(self, settings: dict[str, float]) -> Statics:
        """The same at other values of parameters."""
        if not settings:
            return self
        made = Statics.__new__(Statics)
        made.model, made.names, made.n = self.model, self.names, self.n
        made.p = self.model.parameter_vector(settings)
        made.own = start_values(self.model, made.p)
        return made

    def start(
        self,
        samples: FirstSamples,
        free: Sequence[str],
        given: Mapping[str, float],
        *,
        as_measured: bool = False,
        before: Start | None = None,
    ) -> Start:
        """Where a recording begins.

        Args:
            samples: its first samples.
            free: names that a fit may choose.
            given: starting values that the user states (SI).
            as_measured: every coordinate that a measurement speaks of is free, and its speed too.
            before: where it begins on the model of which this is a variant, for what no output of this one tells: a
                sensor's lag or bias may stand between. If it is let go of there, so is what the variant adds.

        Raises:
            RecordingError: a name that has no starting value, or that is given a value that the others contradict.
        """
        for name in (*free, *given):
            if name not in self.names:
                key = "free" if name in free else "values"
                raise RecordingError(
                    f"'{name}' in 'initial: {key}' of recording '{samples.name}' has no starting value",
                    remedy=nearest(name, self.names),
                )
        if not (free or given or as_measured):
            return Start()
        if before is not None and before.let_go:
            free = (*free, *self._others([*given, *free]))
        positions, speeds = self._rows(samples, 0), self._rows(samples, 1)
        if as_measured:
            free = self._measured_names(positions[0], speeds[0], free, given)
        values: dict[str, float] = {}
        deviations: dict[str, float] = {}
        follows: dict[str, dict[str, float]] = {}
        said: set[str] = set()
        q = self.own[: self.n]
        for order, measured in ((0, positions), (1, speeds)):
            mine = [name for name in dict.fromkeys([*given, *free]) if self._row(name, order) is not None]
            if mine:
                found = self._motion(
                    order, q, measured, mine, free, given, before or Start(), values, deviations, said, follows
                )
                q = found if order == 0 else q
        for name in dict.fromkeys([*given, *free]):  # first-order states
            if name not in values:
                at, deviation = self._first_order(name, samples)
                values[name] = given.get(name, at)
                deviations[name] = deviation
        made = Start(
            tuple(free),
            values,
            {name: deviations[name] for name in free},
            frozenset(said & set(free)),
            follows,
            not self._others([*given, *free]) and self._unmeasured(free, positions[0]),
        )
        try:
            start_values(self.model, self.p, dict(made.values))
        except FlexarmError as error:
            raise RecordingError(
                f"recording '{samples.name}' cannot begin as stated: {error.message}", error.where, error.remedy
            ) from error
        return made

    def _motion(
        self,
        order: int,
        at: Array,
        measured: tuple[Array, Array, Array, Array],
        mine: Sequence[str],
        free: Sequence[str],
        given: Mapping[str, float],
        before: Start,
        values: dict[str, float],
        deviations: dict[str, float],
        told: set[str],
        follows: dict[str, dict[str, float]],
    ) -> Array:
        """Starting values of positions (order 0) or speeds (order 1), and of the coordinates that go with them.

        The positions are ``at``, shape (coordinates,), where speeds are asked for. Returns what was found, same shape.
        """
        rows, wanted, sigma, stated = measured
        n = self.n
        own = [(name, v) for name, v in self.model.initial.items() if self._row(name, order) is not None]
        stages = [self._wanted([(name, given[name]) for name in mine if name in given], order)]
        stages.append((rows, wanted, sigma))
        earlier = [(name, before.values[name]) for name in mine if name in before.free and name not in given]
        stages.append(self._wanted(earlier, order))
        stages.append(self._wanted([(name, v) for name, v in own if name not in given], order))
        q, left = _in_turn(stages, self.own[order * n : (order + 1) * n])
        if order == 0:
            at = q = self._relaxed(q, left)
        stiffness = self._stiffness(at)
        if order == 1 and left.shape[1]:
            q = q - left @ (_flexible(left.T @ stiffness @ left) @ (left.T @ (stiffness @ q)))
        said, sure = _row_space(rows), _row_space(rows[stated])
        spread = np.linalg.pinv(rows / sigma[:, None])
        leads: set[str] = set()
        for name in mine:
            row, shift = self._placed(name, order)
            values[name] = given.get(name, float(np.dot(row, q)) + shift)
            unsaid = float(np.linalg.norm(row - said @ (said.T @ row)) / np.linalg.norm(row))
            # A free one that nothing measures is freed because the machine is out of equilibrium: it moves alone.
            leads.update([name] if unsaid < 1 - _INDEPENDENT else [])
            usual = max(0.1 * abs(values[name]), FITTING.usual_start)
            known = 0.0 if name in given else float(np.linalg.norm(row @ spread))
            deviations[name] = usual if name in given else float(np.hypot(known, unsaid * usual)) or usual
            unsure = float(np.linalg.norm(row - sure @ (sure.T @ row)) / np.linalg.norm(row))
            told.update([name] if name not in given and unsure < _INDEPENDENT else [])
        held = np.array([self._placed(name, order)[0] for name in mine])
        fixed = np.vstack([held, _new_rows(held, rows)]) if len(rows) else held
        extra = _completing(held, n)
        if not extra:
            return q
        # How all coordinates move with each free one: least energy, the measured ones held.
        back, rest = np.linalg.pinv(fixed)[:, : len(mine)], _null(fixed)
        moved = back - rest @ (_flexible(rest.T @ stiffness @ rest) @ (rest.T @ (stiffness @ back)))
        for j in extra:
            name = self.model.states[order * n + j].name
            values[name] = float(q[j])
            follows[name] = {
                one: float(moved[j, i])
                for i, one in enumerate(mine)
                if one in free and one in leads and moved[j, i] != 0
            }
        return q

    def _wanted(self, stated: Sequence[tuple[str, float]], order: int) -> tuple[Array, Array, Array]:
        """Stated values as rows of coordinates."""
        placed = [self._placed(name, order) for name, _ in stated]
        rows = np.array([row for row, _ in placed]).reshape(-1, self.n)
        return (
            rows,
            np.array([v - shift for (_, v), (_, shift) in zip(stated, placed, strict=True)]),
            np.ones(len(rows)),
        )

    def _row(self, name: str, order: int) -> Array | None:
        """The combination of coordinates that a name stands for; None if it is none of this order."""
        flange, _, quantity = name.rpartition(".")
        if flange in self.model.motions and quantity in _ORDERS:
            if _ORDERS[quantity] != order:
                return None
            return np.asarray(self._transform[self.model.motions[flange]])
        states = [state.name for state in self.model.states[order * self.n : (order + 1) * self.n]]
        return np.asarray(np.eye(self.n)[states.index(name)]) if name in states else None

    def _placed(self, name: str, order: int) -> tuple[Array, float]:
        """Row of a motion or state, and what an imposed motion adds to it."""
        row = self._row(name, order)
        assert row is not None
        flange, _, quantity = name.rpartition(".")
        if flange in self.model.motions and quantity in _ORDERS:
            return row, float(self._imposed[order][self.model.motions[flange]])
        return row, 0.0

    @functools.cached_property
    def _transform(self) -> Array:
        return self.model.at("transform")(self.p)

    @functools.cached_property
    def _memory(self) -> Array:
        return self.model.at("memory_start")(self.p).ravel()

    @functools.cached_property
    def _imposed(self) -> Array:
        """What imposed motions add to all angles, and to all speeds, at the model's own start."""
        e = self.model.equations
        u, m = np.zeros(e.u.numel()), np.zeros(e.m.numel())
        return self.model.at("imposed")(0.0, self.own, u, self._memory, m, self.p).reshape(2, -1)

    def _rows(self, samples: FirstSamples, order: int) -> tuple[Array, Array, Array, Array]:
        """Measured positions or speeds at the first instant: rows of coordinates, values, deviations, if stated."""
        values, by_state, by_input = self._outputs(samples)
        n, rows = self.n, []
        for k, variable in enumerate(self.model.outputs):
            position, speed = by_state[k, :n], by_state[k, n : 2 * n]
            if by_input[k].any() or by_state[k, 2 * n :].any():
                continue
            y, sigma = samples.measured[:, k], float(samples.sigma[k])
            there = np.flatnonzero(np.isfinite(y))[: FITTING.first_samples]
            if not there.size:
                continue
            if variable.unit in _POSITIONS and position.any() and not speed.any():
                if order == 0 and not samples.from_first[k]:
                    rows.append((position, y[there[0]] - values[k] + position @ self.own[:n], sigma, samples.stated[k]))
                elif order == 1 and there.size > 3:
                    slope, deviation = _slope(samples.time[there], y[there], sigma)
                    rows.append((position, slope, deviation, samples.stated[k]))
            elif variable.unit in _SPEEDS and speed.any() and order == 1 and not samples.from_first[k]:
                rows.append((speed, y[there[0]] - values[k] + speed @ self.own[n : 2 * n], sigma, samples.stated[k]))
        return (
            np.array([row for row, _, _, _ in rows]).reshape(-1, n),
            np.array([v for _, v, _, _ in rows]),
            np.array([s for _, _, s, _ in rows]),
            np.array([known for _, _, _, known in rows], dtype=bool),
        )

    def _outputs(self, samples: FirstSamples) -> tuple[Array, Array, Array]:
        """Outputs at the model's own start, and their derivatives by states and inputs."""
        made = self.model.derived(
            "outputs_by_state_and_input",
            lambda e: [e.outputs, ca.jacobian(e.outputs, e.x), ca.jacobian(e.outputs, e.u)],
        )
        e, p = self.model.equations, self.p
        u = np.zeros(e.u.numel())
        u[: len(samples.inputs)] = samples.inputs
        given = np.zeros(int(made.numel_in(3)))
        given[: len(self._memory)] = self._memory
        found = made(0, self.own, u, given, np.zeros(e.m.numel()), p)
        y, by_state, by_input = (np.nan_to_num(np.array(part.full())) for part in found)
        return y.ravel(), by_state, by_input

    def _energy(self, q: Array) -> tuple[Array, Array]:
        """Gradient and Hessian of the stored energy at rest, by the coordinates."""
        n = self.n

        def derivatives(e: Equations) -> Sequence[ca.SX]:
            hessian, gradient = ca.hessian(ca.SX(e.stored), e.x)
            return [gradient[:n], hessian[:n, :n]]

        made = self.model.derived("stored_energy_by_coordinates", derivatives)
        e = self.model.equations
        x = np.array(self.own)
        x[:n], x[n : 2 * n] = q, 0.0
        given = np.zeros(int(made.numel_in(3)))
        given[: len(self._memory)] = self._memory
        gradient, hessian = made(0, x, np.zeros(e.u.numel()), given, np.zeros(e.m.numel()), self.p)
        return np.nan_to_num(np.array(gradient.full()).ravel()), np.nan_to_num(np.array(hessian.full()))

    def _stiffness(self, q: Array) -> Array:
        """Hessian of the stored energy; zero for a model whose energy calls Python functions."""
        return np.zeros((self.n, self.n)) if self.model.externals else self._energy(q)[1]

    def _relaxed(self, q: Array, left: Array) -> Array:
        """Coordinates of least stored energy, reached from ``q`` along the directions ``left``."""
        if not left.shape[1] or self.model.externals:
            return q
        for _ in range(_ROUNDS):
            gradient, hessian = self._energy(q)
            step = left @ (_flexible(left.T @ hessian @ left) @ (left.T @ gradient))
            q = q - step
            if np.abs(step).max(initial=0.0) < 1e-12:
                break
        return q

    def _measured_names(
        self, positions: Array, speeds: Array, free: Sequence[str], given: Mapping[str, float]
    ) -> list[str]:
        """Free names for every coordinate that is measured: the measured motion where it has a name."""
        made = [name for name in free if name not in given]
        for order, rows in ((0, positions), (1, speeds)):
            said = _row_space(rows)
            stated = [self._row(name, order) for name in (*made, *given)]
            taken = np.array([row for row in stated if row is not None]).reshape(-1, self.n)
            motions = [v.name for v in self.model.outputs]
            # A speed that only follows from the slope of a position has the name of that position's flange.
            motions += [_rate(name) for name in motions if _rate(name)]
            for name in [*motions, *(s.name for s in self.model.states[order * self.n : (order + 1) * self.n])]:
                row = self._row(name, order) if name in self.names else None
                if row is None or np.linalg.norm(said.T @ row) < 1e-3 * np.linalg.norm(row):
                    continue
                if len(_new_rows(taken, row[None, :])):
                    taken, made = np.vstack([taken, row]), [*made, name]
                if len(taken) >= said.shape[1]:
                    break
        return made

    def _positions(self, names: Iterable[str]) -> Array:
        """The positions among some names as rows of coordinates."""
        rows = [row for name in names if (row := self._row(name, 0)) is not None]
        return np.array(rows).reshape(-1, self.n)

    def _others(self, names: Iterable[str]) -> list[str]:
        """Coordinates that, together with the positions among some names, fix all."""
        return [self.model.states[j].name for j in _completing(self._positions(names), self.n)]

    def _unmeasured(self, names: Iterable[str], measured: Array) -> bool:
        """Whether a position among some names is told by none of the measured ones, given as rows."""
        return len(_new_rows(measured, self._positions(names))) > 0

    def _first_order(self, name: str, samples: FirstSamples) -> tuple[float, float]:
        """A first-order state: its sample where it is measured, else the model's own start."""
        at = float(self.own[[s.name for s in self.model.states].index(name)])
        for k, variable in enumerate(self.model.outputs):
            there = np.flatnonzero(np.isfinite(samples.measured[:, k]))
            if variable.name == name and there.size and not samples.from_first[k]:
                return float(samples.measured[there[0], k]), float(samples.sigma[k])
        return at, max(0.1 * abs(at), FITTING.usual_start)


def _rate(name: str) -> str:
    """The speed that belongs to a position; empty for anything else."""
    flange, _, quantity = name.rpartition(".")
    return next((f"{flange}.{kind[1][0]}" for kind in MOTION.values() if kind[0][0] == quantity), "")


def _slope(time: Array, y: Array, sigma: float) -> tuple[float, float]:
    """Slope at the first sample by a parabola, and its deviation: the noise's, and what a cubic says else.

    A signal that swings within these samples is no parabola over them: half of them count then. Where even those show
    none, it may change within one sample by as much as it does in all of them.
    """

    def polynomial(degree: int, count: int) -> tuple[float, float, float]:
        matrix = np.vander(time[:count] - time[0], degree + 1)
        scale = np.linalg.norm(matrix, axis=0)
        inverse = np.linalg.pinv(matrix / scale)
        left = float(np.linalg.norm(y[:count] - matrix / scale @ (inverse @ y[:count])))
        noise = max(sigma, left / math.sqrt(max(count - degree - 1, 1)))
        per_noise = float(np.linalg.norm(inverse[-2]) / scale[-2])
        return float(inverse[-2] @ y[:count] / scale[-2]), per_noise, noise

    count = len(y)
    slope, per_noise, noise = polynomial(2, count)
    if noise > 2 * sigma and count >= 16:
        count //= 2
        slope, per_noise, noise = polynomial(2, count)
    if noise > 2 * sigma:
        return slope, float(np.ptp(y[:count]) / (time[1] - time[0]))
    other, wider, _ = polynomial(3, count)
    return slope, float(np.hypot(noise * per_noise, max(abs(other - slope) - sigma * wider, 0.0)))


def _in_turn(stages: Sequence[tuple[Array, Array, Array]], begin: Array) -> tuple[Array, Array]:
    """Coordinates that meet rows of equations, those of earlier stages first; and the directions that none fixes.

    In those they stay where they ``begin``.
    """
    q, left = begin, np.eye(len(begin))
    for rows, wanted, sigma in stages:
        if not len(rows) or not left.shape[1]:
            continue
        matrix = (rows / sigma[:, None]) @ left
        scale = np.abs(matrix).max(initial=0.0)
        if scale == 0:
            continue
        q = q + left @ np.linalg.lstsq(matrix, (wanted - rows @ q) / sigma, rcond=_INDEPENDENT)[0]
        left = left @ _null(matrix)
    return q, left


def _null(rows: Array) -> Array:
    """Orthonormal directions, as columns, that rows say nothing of."""
    if not len(rows):
        return np.eye(rows.shape[1])
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    _, values, right = np.linalg.svd(rows / np.where(lengths > 0, lengths, 1.0))
    return np.asarray(right[int((values > _INDEPENDENT).sum()) :].T)


def _row_space(rows: Array) -> Array:
    """Orthonormal directions, as columns, that rows span."""
    n = rows.shape[1]
    if not len(rows):
        return np.zeros((n, 0))
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    _, values, right = np.linalg.svd(rows / np.where(lengths > 0, lengths, 1.0))
    return np.asarray(right[: int((values > _INDEPENDENT).sum())].T)


def _new_rows(before: Array, rows: Array) -> Array:
    """Those of ``rows`` that do not follow from rows before them."""
    taken: Array = before
    kept: list[Array] = []
    for row in rows:
        said = _row_space(taken)
        if np.linalg.norm(row - said @ (said.T @ row)) > 1e-6 * np.linalg.norm(row):
            kept.append(row)
            taken = np.vstack([taken, row])
    return np.array(kept).reshape(-1, before.shape[1])


def _completing(rows: Array, n: int) -> list[int]:
    """Coordinates that, together with rows, fix all."""
    found, taken = [], rows
    for j in range(n):
        if len(_new_rows(taken, np.eye(n)[[j]])):
            found.append(j)
            taken = np.vstack([taken, np.eye(n)[j]])
    return found


def _flexible(stiffness: Array) -> Array:
    """Inverse of a stiffness in the directions in which it has one; an unstable one counts by its size."""
    values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
    size = np.abs(values)
    some = size > _INDEPENDENT * size.max(initial=0.0)
    inverse = np.where(some, 1 / np.where(some, size, 1.0), 0.0)
    return np.asarray((vectors * inverse) @ vectors.T)


def free_starts(experiment: Experiment) -> list[FreeParameter]:
    """The free starting values of an experiment, with what the first samples and the statics say of them as prior.

    One that is measured with a noise that the user states goes no farther than `FITTING.start_reach` deviations from
    its sample or slope: it is known, and a model that lacks something must not make up for it there, however many
    samples would then be met better. A noise that is estimated says how a signal jitters, not how true it is. All
    belong to the recording: how far they go says nothing against the model (`FreeParameter.prior`).
    """
    made = []
    for name in experiment.free:
        value, deviation = experiment.initial[name], experiment.deviations[name]
        if name in experiment.measured_starts:
            scale, reach = deviation, FITTING.start_reach * deviation
        else:
            scale, reach = max(0.1 * abs(value), FITTING.usual_start), math.inf
        made.append(
            FreeParameter(
                name,
                value,
                scale,
                False,
                prior=False,
                recording=experiment.name,
                spread=deviation / scale,
                reach=reach,
            )
        )
    return made
