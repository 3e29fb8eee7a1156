"""Equilibria: states, memories and inputs at which nothing changes, in modes that hold there.

Newton's method (scipy's trust region, within bounds) solves the equations of one set of modes at a time, so that stuck
and sliding are solved apart. Modes whose guards are violated at the solution change, and it is solved again. A machine
that turns steadily is an equilibrium too, a relative one: its rates lie along states on whose common change nothing
depends.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg
from scipy.optimize import least_squares

from engine.casadi_lock import one_at_a_time
from engine.errors import FlexarmError, ParameterError, nearest
from engine.linearise import Point, modes_at, operating_point
from engine.model import FRICTION, TIME, Equations, Model, Vector
from engine.ports import MOTION

Array = Any

_ORDERS = {name: order for kind in MOTION.values() for order, (name, _) in enumerate(kind[:2])}

RESIDUAL = 1e-8
"""An equation is met when what is left is below this share of its terms."""

GUARD = 1e-7
"""A guard that is violated by less than this share of its change over the span of its arguments holds."""

RANK = 1e-9
"""Singular values below this share of the largest are zero, rows and columns scaled."""

FAR = 1e4
"""A solution that lies this many times farther from the start than its own start did is none of the machine's."""

STEADY = "steady motion"
"""Of shafts that turn without end."""
TRIES = 12
"""Starts about the first one from which further equilibria are sought."""


class TrimError(FlexarmError):
    """There is no equilibrium, or more than one and nothing says which."""


@dataclass(frozen=True)
class Equilibrium:
    """Where nothing changes.

    Attributes:
        states: state and memory name -> value, SI units.
        inputs: input name -> value.
        outputs: output name -> value.
        modes: mode name -> label that holds there.
        turning: state name -> its steady rate, of states on which nothing depends.
        kept: state name -> why it stays where the search began: ``stuck``, or ``indifferent``: nothing depends on it.
        others: values of the states at further equilibria that the same search found, by name.
        units: name -> unit.
        point: the same as the engine's functions take it.
    """

    states: dict[str, float]
    inputs: dict[str, float]
    outputs: dict[str, float]
    modes: dict[str, str]
    turning: dict[str, float]
    kept: dict[str, str]
    others: tuple[dict[str, float], ...]
    units: dict[str, str]
    point: Point = field(repr=False)

    def arguments(self) -> dict[str, Any]:
        """As `engine.linearise.linearise` and `discretise` take it: ``at``, ``inputs``, ``modes``."""
        return {"at": dict(self.states), "inputs": dict(self.inputs), "modes": dict(self.modes)}


def trim(
    model: Model,
    *,
    at: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    fix: Mapping[str, float] | None = None,
    free: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    modes: Mapping[str, str] | None = None,
    parameters: dict[str, float] | None = None,
    tries: int = TRIES,
    seed: int = 0,
) -> Equilibrium:
    """Find an equilibrium; of several the one that Newton's method reaches from the start.

    Args:
        model: built with its inputs and outputs.
        at: where to begin: motions, states and memories by name, SI units; the rest as at the model's start.
        inputs: values of inputs, zero by default; those of ``free`` begin there.
        fix: values that motions, states, inputs or outputs must have.
        free: inputs that are searched for.
        bounds: state or free input -> least and greatest value.
        modes: mode name -> label, held whatever the guards say.
        parameters: values that replace the model's.
        tries: further starts, for other equilibria.
        seed: of these.

    Raises:
        ParameterError: a name or label that does not exist, bounds that hold nothing.
        TrimError: no equilibrium, one that no combination of modes has, or a continuum of them.
    """
    search = _Search(
        model, dict(at or {}), dict(inputs or {}), dict(fix or {}), free, dict(bounds or {}), modes, parameters
    )
    random = np.random.default_rng(seed)
    further = list(search.further(random, tries)) if search.nonlinear else []
    try:
        found, there, jacobian = search.solve(search.start)
    except TrimError:
        if not further:
            raise
        # A start may be where Newton's method has no direction, as half way between hanging and standing.
        found, there, jacobian = min(further, key=lambda row: search.distance(row[0]))
    kept = search.kept(found, there, jacobian)
    others: list[Vector] = []
    for other, _, _ in further:
        if not any(search.same(other, known, there) for known in (found, *others)):
            others.append(other)
    return search.result(found, there, kept, others)


def indifferent(model: Model, p: Vector) -> Array:
    """Directions of the states on which neither rates nor guards depend, orthonormal columns, shape (states, k).

    Found at six random points, so that a slope that is zero at one point alone does not count.
    """
    n, e = len(model.states), model.equations
    slope = model.derived("rate_slopes", lambda e: [ca.densify(ca.jacobian(ca.vertcat(e.derivative, e.guards), e.x))])
    random, rows = np.random.default_rng(1), [np.zeros((1, n))]
    for _ in range(6):
        x, m = random.normal(0, 1, n), random.choice([-1.0, 0.0, 1.0], len(model.modes))
        J = slope(0.1, x, np.zeros(e.u.numel()), np.zeros(e.d.numel()), m, p).full()
        size = np.linalg.norm(J, axis=1)
        usable = np.isfinite(size) & (size > 0)
        rows.append(J[usable] / size[usable, None])
    return scipy.linalg.null_space(np.vstack(rows), rcond=1e-9) if n else np.zeros((0, 0))


class _Search:
    """The equations of one trim problem; unknowns z: states, memories, stages of delay lines, free inputs, slides."""

    def __init__(
        self,
        model: Model,
        at: dict[str, float],
        inputs: dict[str, float],
        fix: dict[str, float],
        free: Sequence[str],
        bounds: dict[str, tuple[float, float]],
        modes: Mapping[str, str] | None,
        parameters: dict[str, float] | None,
    ) -> None:
        if model.externals:
            raise ParameterError(
                f"'{model.externals[0].name}' is a Python function, whose memory has no equation",
                remedy="trim the plant without it: name its outputs as inputs",
            )
        self.model, names = model, [v.name for v in model.inputs]
        for name in free:
            if name not in names:
                raise ParameterError(f"'{name}' is not an input that can be free", remedy=nearest(name, names))
            if name in fix:
                raise ParameterError(f"'{name}' is both fixed and free", remedy="give one of the two")
        inputs |= {name: fix[name] for name in fix if name in names}
        self.asked = dict(modes or {})
        self.fix = {name: value for name, value in fix.items() if name not in names}
        states = [v.name for v in (*model.states, *model.memories)]
        begin = at | {k: v for k, v in self.fix.items() if k in states or k.rpartition(".")[0] in model.motions}
        begin = {k: v for k, v in begin.items() if k not in [o.name for o in model.outputs] or k in states or k in at}
        try:
            self.point = operating_point(model, at=begin, inputs=inputs, modes=self.asked, parameters=parameters)
        except ParameterError:
            if begin == at:
                raise
            self.point = operating_point(model, at=at, inputs=inputs, modes=self.asked, parameters=parameters)
        self.p, self.n, self.n_d = self.point.p, len(model.states), len(model.memories)
        self.free = [names.index(name) for name in free]
        self.lines = [line for line in model.lines for _ in line.stages]
        self.slides = indifferent(model, self.p)
        self._rows = [self._target(name, value) for name, value in self.fix.items()]
        reads = [float(self.point.d[line.memories[k]]) for line in model.lines for k in range(len(line.stages))]
        self.start = np.concatenate(
            [self.point.x, self.point.d, reads, self.point.u[self.free], np.zeros(self.slides.shape[1])]
        )
        self.low, self.high = np.full(len(self.start), -np.inf), np.full(len(self.start), np.inf)
        self._bound(bounds, names)
        self.function = model.derived("trim", _trim_equations, fire=True)

    def _bound(self, bounds: dict[str, tuple[float, float]], names: list[str]) -> None:
        places = {v.name: i for i, v in enumerate((*self.model.states, *self.model.memories))}
        first = self.n + self.n_d + len(self.lines)
        places |= {names[j]: first + k for k, j in enumerate(self.free)}
        for name, (low, high) in bounds.items():
            if name not in places:
                hint = "it is given, not searched: name it as free" if name in names else nearest(name, places)
                raise ParameterError(f"'{name}' cannot be bounded", remedy=hint)
            if not low < high:
                raise ParameterError(f"the bounds of '{name}' hold nothing: {low:g} is not below {high:g}")
            i = places[name]
            self.low[i], self.high[i] = low, high
            if not low <= self.start[i] <= high:
                self.start[i] = (low + high) / 2 if math.isfinite(low + high) else min(max(self.start[i], low), high)

    def _target(self, name: str, value: float) -> tuple[str, Any, float]:
        """A fixed value as an equation: of an output, a motion, or a state."""
        model = self.model
        states = [v.name for v in (*model.states, *model.memories)]
        flange, _, quantity = name.rpartition(".")
        outputs = [v.name for v in model.outputs]
        if name in states:
            return "state", states.index(name), value
        if name in outputs:
            return "output", outputs.index(name), value
        if flange in model.motions and quantity in _ORDERS:
            return "motion", (model.motions[flange], _ORDERS[quantity]), value
        known = [*states, *outputs, *(v.name for v in model.inputs)]
        raise ParameterError(f"'{name}' is no state, motion, input or output of the model", remedy=nearest(name, known))

    @property
    @one_at_a_time
    def nonlinear(self) -> bool:
        """Whether the rates are other than linear, or modes may change."""
        e = self.model.equations
        both = ca.vertcat(e.x, e.u, e.d)
        return bool(self.model.modes) or bool(ca.depends_on(ca.jacobian(e.derivative, both), both))

    def spread(self, random: np.random.Generator) -> Vector:
        """Another start: angles within half a turn, slides and modes within a centimetre, the rest about theirs."""
        z, n_q = self.start.copy(), self.model.coordinates
        reach = [math.pi if v.unit == "rad" else 0.01 for v in self.model.states[:n_q]]
        size = np.concatenate([reach, np.zeros(n_q), np.full(len(z) - 2 * n_q, 0.5)])
        size[2 * n_q :] *= 1 + np.abs(z[2 * n_q :])
        z = z + size * random.uniform(-1, 1, len(z))
        inside = np.isfinite(self.low) & np.isfinite(self.high)
        z[inside] = random.uniform(self.low[inside], self.high[inside])
        z = np.clip(z, self.low, self.high)
        return np.asarray(np.where([m == "held" for m in self._held()], self.start, z))

    def further(self, random: np.random.Generator, tries: int) -> Iterator[tuple[Vector, Vector, Array]]:
        """Solutions from other starts; those far beyond the starts are artefacts of the laws, not of the machine."""
        for _ in range(tries):
            begin = self.spread(random)
            try:
                z, m, J = self.solve(begin, thorough=False)
            except (TrimError, ParameterError):
                continue
            far = np.abs(z - self.start)[: self.n] > FAR * np.maximum(1.0, np.abs(begin - self.start)[: self.n])
            if not far.any():
                yield self._near(z, m, J)

    def _near(self, z: Vector, m: Vector, J: Array) -> tuple[Vector, Vector, Array]:
        """The same equilibrium within half a turn of the start, where whole turns make no difference."""
        n_q = self.model.coordinates
        turns = np.round((z - self.start)[:n_q] / (2 * math.pi))
        turns *= [v.unit == "rad" for v in self.model.states[:n_q]]
        there = z.copy()
        there[:n_q] -= 2 * math.pi * turns
        if not turns.any():
            return z, m, J
        r, J_there, _ = self.equations(there, m, True)
        allowed = 1e-10 + RESIDUAL * (np.abs(J_there) @ np.maximum(np.abs(there), 1e-3))
        return (there, m, J_there) if (np.abs(r) <= allowed).all() else (z, m, J)

    def distance(self, z: Vector) -> float:
        """How far a solution lies from the start."""
        return float(np.linalg.norm((z - self.start)[: self.n + self.n_d]))

    def _held(self) -> list[str]:
        fixed = {index for kind, index, _ in self._rows if kind == "state"}
        return ["held" if i in fixed else "" for i in range(len(self.start))]

    def unpack(self, z: Vector) -> tuple[Vector, Vector, Vector, Vector, Vector]:
        """States, memories, what delay lines give, inputs, slides."""
        a, b = self.n, self.n + self.n_d
        c = b + len(self.lines)
        d = c + len(self.free)
        u = self.point.u.copy()
        u[self.free] = z[c:d]
        return z[:a], z[a:b], z[b:c], u, z[d:]

    def equations(
        self, z: Vector, m: Vector, stuck_free: bool, stuck_at: Vector | None = None
    ) -> tuple[Vector, Array, list[str]]:
        """What is left of each equation, its Jacobian by z, and the names of the equations."""
        model = self.model
        x, d, reads, u, slide = self.unpack(z)
        fire = np.concatenate([np.ones(len(model.clocks)), reads])
        values = self.function(self.point.t, x, u, d, m, self.p, fire)
        f, y, after, entering, *slopes = (np.array(v.full()) for v in values)
        by = [np.hstack(slopes[4 * k : 4 * k + 4]) for k in range(4)]  # of f, y, after, entering by x, d, fire, u
        columns = self._columns(by)
        f, y, after, entering = f.ravel(), y.ravel(), after.ravel(), entering.ravel()
        rest = [np.zeros((len(block), self.slides.shape[1])) for block in columns]
        N = self.slides
        rows = [f - N @ slide]
        J = [np.hstack([columns[0], -N])]
        names = [v.name for v in model.states]
        if self.n_d:
            identity = np.eye(len(z))[self.n : self.n + self.n_d]
            rows.append(after - d)
            J.append(np.hstack([columns[2], rest[2]]) - identity)
            names += [v.name for v in model.memories]
        if len(self.lines):
            index = [i for i, line in enumerate(model.lines) for _ in line.stages]
            identity = np.eye(len(z))[self.n + self.n_d : self.n + self.n_d + len(self.lines)]
            rows.append(entering[index] - reads)
            J.append(np.hstack([columns[3], rest[3]])[index] - identity)
            names += [f"{line.name} (delay)" for line in self.lines]
        n_q = model.coordinates
        for (kind, index, value), name in zip(self._rows, self.fix, strict=True):
            row = np.zeros(len(z))
            if kind == "state":
                row[index] = 1.0
                left = z[index] - value
            elif kind == "output":
                row[:] = np.hstack([columns[1], rest[1]])[index]
                left = y[index] - value
            else:
                motion, order = index
                row[order * n_q : (order + 1) * n_q] = np.array(model.functions["transform"](self.p).full())[motion]
                offset = np.array(model.functions["imposed"](self.point.t, x, u, d, m, self.p).full()).reshape(2, -1)
                left = row @ z + offset[order, motion] - value
            rows.append(np.array([left]))
            J.append(row[None])
            names.append(f"{name} = {value:g}")
        held = self._stuck(m)
        n_q = model.coordinates
        for c in held:  # a stuck joint: its speed is zero, its rates are no equations
            row = np.zeros(len(z))
            row[n_q + c] = 1.0
            for k, left in ((c, 0.0), (n_q + c, z[n_q + c])):
                J[0][k], rows[0][k] = (row, left) if k != c else (0.0, 0.0)
            if not stuck_free:
                J[0][c, c], rows[0][c] = 1.0, z[c] - (self.start if stuck_at is None else stuck_at)[c]
            rows.append(self.slides[[c]] @ slide)
            J.append(np.concatenate([np.zeros(len(z) - len(slide)), self.slides[c]])[None])
            names.append(f"{model.states[c].name} stands still")
        return np.concatenate(rows), np.vstack(J), names

    def _columns(self, by: list[Array]) -> list[Array]:
        """Slopes by (x, d, fire, u) as slopes by z without the slides."""
        ends = [self.n, self.n + self.n_d]
        first = ends[1] + len(self.model.clocks)
        inputs = first + len(self.lines)
        keep = [*range(ends[1]), *range(first, inputs), *(inputs + k for k in self.free)]
        return [block[:, keep] for block in by]

    def _stuck(self, m: Vector) -> list[int]:
        return [
            mode.coordinate for mode, v in zip(self.model.modes, m, strict=True) if mode.kind == FRICTION and v == 0
        ]

    def solve(self, begin: Vector, thorough: bool = True) -> tuple[Vector, Vector, Array]:
        """Unknowns, modes and Jacobian at the equilibrium that is reached from ``begin``."""
        x, d, _, u, _ = self.unpack(begin)
        m = modes_at(self.model, self.point.t, x, u, d, self.p, self.asked)
        tried: list[tuple[float, ...]] = []
        worst = ""
        z = begin
        while tuple(m) not in tried and len(tried) < 4 * len(m) + 20:
            tried.append(tuple(m))
            z, J, worst = self._newton(begin, m, thorough)
            if worst:
                break
            wrong = self._violated(z, m)
            if wrong is None:
                return self._settled(z, m, J)
            k, side = wrong
            m = m.copy()
            m[k] = 0 if m[k] != 0 else side
        for trial in self._combinations(tried) if thorough else []:
            z, J, failed = self._newton(begin, trial, thorough)
            if not failed and self._violated(z, trial) is None:
                return z, trial, J
        raise self._none(worst, m)

    def _settled(self, z: Vector, m: Vector, J: Array) -> tuple[Vector, Vector, Array]:
        """The same with joints stuck that are said to slide and stand still: at their level of friction they hold."""
        still = m.copy()
        for k, mode in enumerate(self.model.modes):
            if mode.kind == FRICTION and m[k] and mode.name not in self.asked:
                still[k] = 0.0 if abs(z[self.model.coordinates + mode.coordinate]) < 1e-9 else m[k]
        if (still == m).all() or self._violated(z, still) is not None:
            return z, m, J
        there, J_there, worst = self._newton(z, still, False, z)
        return (z, m, J) if worst or self._violated(there, still) is not None else (there, still, J_there)

    def _combinations(self, tried: list[tuple[float, ...]]) -> list[Vector]:
        """Other sets of modes to try, where following the guards led nowhere; none where there are too many."""
        asked, choices = self.asked, []
        for k, mode in enumerate(self.model.modes):
            fixed = mode.name in asked or mode.kind == TIME
            choices.append((tried[0][k],) if fixed else (0.0, 1.0, -1.0))
        if math.prod(len(c) for c in choices) > 243:
            return []
        return [np.array(c) for c in itertools.product(*choices) if c not in tried]

    def _none(self, worst: str, m: Vector) -> TrimError:
        labels = ", ".join(f"'{mode.name}' {label}" for mode, label in self._labels(m).items())
        if worst:
            return TrimError(
                f"there is no equilibrium: {worst}" + (f" (with {labels})" if labels else ""),
                remedy=self._remedy(),
            )
        return TrimError(
            f"no combination of modes has an equilibrium in which it holds (the last: {labels})",
            remedy="give a mode (--mode), another start (--at), or a free input (--free)",
        )

    def _remedy(self) -> str:
        names = [v.name for j, v in enumerate(self.model.inputs) if j not in self.free]
        say = f"let an input be searched for (--free {names[0]}), " if names else ""
        return f"{say}fix less, widen the bounds, or begin elsewhere (--at)"

    def _labels(self, m: Vector) -> dict[Any, str]:
        return {mode: mode.labels[int(v) + 1] for mode, v in zip(self.model.modes, m, strict=True) if mode.kind != TIME}

    def _newton(
        self, begin: Vector, m: Vector, thorough: bool, stuck_at: Vector | None = None
    ) -> tuple[Vector, Array, str]:
        """Unknowns and Jacobian in given modes, and the equation that is not met, in words; empty if all are."""
        worst, z, J = "", begin, np.zeros((0, 0))
        for stuck_free in (False, True) if self._stuck(m) and self.fix else (False,):
            r0, J0, _ = self.equations(begin, m, stuck_free, stuck_at)
            if not (np.isfinite(r0).all() and np.isfinite(J0).all()):
                return begin, J0, "the rates at the start are not finite"
            scale = 1 / np.maximum(np.linalg.norm(J0, axis=1), np.maximum(np.abs(r0), 1e-12))

            def residual(z: Vector, free: bool = stuck_free, scale: Vector = scale) -> Vector:
                return np.nan_to_num(
                    self.equations(z, m, free, stuck_at)[0] * scale, nan=1e30, posinf=1e30, neginf=-1e30
                )

            def slope(z: Vector, free: bool = stuck_free, scale: Vector = scale) -> Array:
                return np.nan_to_num(self.equations(z, m, free, stuck_at)[1] * scale[:, None])

            z = self._minimise(residual, slope, begin, thorough)
            r, J, names = self.equations(z, m, stuck_free, stuck_at)
            allowed = 1e-10 + RESIDUAL * (np.abs(J) @ np.maximum(np.abs(z), 1e-3))
            over = np.abs(r) / allowed
            if np.isfinite(r).all() and over.max(initial=0.0) <= 1:
                return z, J, ""
            k = int(np.argmax(np.where(np.isfinite(over), over, np.inf)))
            worst = (
                f"'{names[k]}' cannot be met, {r[k]:.3g} is left"
                if k >= self.n
                else f"the rate of '{names[k]}' cannot be brought below {abs(r[k]):.3g} per second"
            )
        return z, J, worst

    def _minimise(self, residual: Any, slope: Any, begin: Vector, thorough: bool) -> Vector:
        """Gauss-Newton with steps of least length, so that what nothing determines stays; then scipy's trust region."""
        z = begin.copy()
        for _ in range(30):
            r, J = residual(z), slope(z)
            move = -np.linalg.lstsq(J, r, rcond=RANK)[0]
            cost, share = float(r @ r), 1.0
            while share > 1e-4:
                there = np.clip(z + share * move, self.low, self.high)
                found = residual(there)
                if float(found @ found) <= cost * (1 - 1e-4 * share) or float(found @ found) < 1e-28:
                    break
                share /= 2
            else:
                break
            done = np.abs(there - z).max(initial=0.0) <= 1e-13 * (1 + np.abs(z).max(initial=0.0))
            z = there
            if done or float(found @ found) == 0.0:
                return np.asarray(z)
        if float(residual(z) @ residual(z)) < 1e-24 or not len(z) or not thorough:
            return np.asarray(z)
        inside = np.clip(z, np.nextafter(self.low, np.inf), np.nextafter(self.high, -np.inf))
        found = least_squares(
            residual, inside, slope, (self.low, self.high), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        return np.asarray(found.x)

    def _violated(self, z: Vector, m: Vector) -> tuple[int, float] | None:
        """The mode whose guard is most violated, and the side to which it leaves; None if all hold."""
        x, d, _, u, _ = self.unpack(z)
        g = np.array(self.model.functions["guards"](self.point.t, x, u, d, m, self.p).full()).ravel()
        names = [mode.name for mode in self.model.modes]
        rows = [k for k in range(len(g) // 2) if names[k] not in self.asked]
        worst = max(rows, key=lambda k: max(g[2 * k], g[2 * k + 1]), default=None)
        if worst is None or max(g[2 * worst], g[2 * worst + 1]) <= GUARD:
            return None
        return worst, 1.0 if g[2 * worst] >= g[2 * worst + 1] else -1.0

    def kept(self, z: Vector, m: Vector, J: Array) -> dict[str, str]:
        """States that stay where the search began, and why.

        Raises:
            TrimError: more is left open than stuck joints and what nothing depends on.
        """
        names = [v.name for v in (*self.model.states, *self.model.memories)]
        names += [f"{line.name} (delay)" for line in self.lines] + [self.model.inputs[j].name for j in self.free]
        names += [STEADY] * self.slides.shape[1]
        kept = {names[c]: "stuck" for c in self._stuck(m)}
        J = np.nan_to_num(J)
        rows = np.linalg.norm(J, axis=1)
        scaled = J[rows > 0] / rows[rows > 0, None]
        columns = np.linalg.norm(scaled, axis=0) if len(scaled) else np.ones(len(z))
        columns = np.where(columns > 0, columns, 1.0)
        open_ = scipy.linalg.null_space(np.vstack([scaled / columns, np.zeros((1, len(z)))]), rcond=RANK)
        open_ = open_ / columns[:, None]
        basis = self._indifferent(m, len(z))
        left = open_ - basis @ (basis.T @ open_)
        size = np.linalg.norm(left, axis=0) / np.maximum(np.linalg.norm(open_, axis=0), 1e-300)
        if (size > 1e-6).any():
            vector = left[:, int(np.argmax(size))]
            order = np.argsort(-np.abs(vector))
            several = [names[i] for i in order if abs(vector[i]) > 0.05 * np.abs(vector).max()][:4]
            told = [name if name == STEADY else f"'{name}'" for name in several]
            states = [v.name for v in self.model.states]
            known = sorted((name for name in several if name != STEADY), key=lambda name: name not in states)
            such = f" --fix '{known[0]}={z[names.index(known[0])]:g}'" if known else " a state of them with --fix"
            raise TrimError(
                f"the equilibrium is not unique: {' and '.join(told)} "
                f"can {'change together' if len(several) > 1 else 'take any value'}",
                remedy=f"fix one of them: by flexarm trim{such}, or under fix: in an analysis of kind trim",
            )
        for i in np.flatnonzero(np.abs(open_[: self.n]).max(axis=1, initial=0.0) > 1e-9):
            kept.setdefault(names[i], "indifferent")
        return kept

    def _indifferent(self, m: Vector, size: int) -> Array:
        """Orthonormal directions of the unknowns along which a solution may lie anywhere, shape (size, k)."""
        known = np.zeros((size, self.slides.shape[1] + len(self._stuck(m))))
        known[: self.n, : self.slides.shape[1]] = self.slides
        for k, c in enumerate(self._stuck(m)):
            known[c, self.slides.shape[1] + k] = 1.0
        return scipy.linalg.orth(known) if known.size else np.zeros((size, 0))

    def same(self, one: Vector, other: Vector, m: Vector) -> bool:
        """Whether two solutions differ in nothing but what is kept, whole turns apart."""
        count = self.n + self.n_d + len(self.lines) + len(self.free)
        change = (one - other)[:count]
        basis = self._indifferent(m, count)
        change = change - basis @ (basis.T @ change)
        n_q = self.model.coordinates
        turn = [v.unit == "rad" for v in self.model.states[:n_q]]
        change[:n_q] = np.where(turn, (change[:n_q] + math.pi) % (2 * math.pi) - math.pi, change[:n_q])
        return bool(np.abs(change).max(initial=0.0) < 1e-5 * (1 + np.abs(other[:count]).max(initial=0.0)))

    def result(self, z: Vector, m: Vector, kept: dict[str, str], others: list[Vector]) -> Equilibrium:
        """What was found, with names."""
        model = self.model
        x, d, _, u, slide = self.unpack(z)
        names = [v.name for v in (*model.states, *model.memories)]
        y = np.array(model.functions["outputs"](self.point.t, x, u, d, m, self.p).full()).ravel()
        turning = self.slides @ slide
        variables = (*model.states, *model.memories, *model.inputs, *model.outputs)
        point = Point(self.point.t, x, u, d, m, self.p)
        return Equilibrium(
            dict(zip(names, [*x.tolist(), *d.tolist()], strict=True)),
            dict(zip((v.name for v in model.inputs), u.tolist(), strict=False)),
            dict(zip((v.name for v in model.outputs), y.tolist(), strict=True)),
            {mode.name: label for mode, label in self._labels(m).items()},
            {n: float(r) for n, r in zip(names, turning, strict=False) if abs(r) > 1e-9},
            kept,
            tuple(dict(zip(names, other.tolist(), strict=False)) for other in others),
            {v.name: v.unit for v in variables},
            point,
        )


def _trim_equations(e: Equations) -> list[Any]:
    parts = [e.derivative, e.outputs, e.update, e.entering]
    slopes = [ca.densify(ca.jacobian(f, s)) for f in parts for s in (e.x, e.d, e.fire, e.u)]
    return [*(ca.densify(f) for f in parts), *slopes]
