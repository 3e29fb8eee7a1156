"""The linear model at an operating point, with the mode it belongs to.

A stuck joint holds its coordinate still, so its position and speed are not states of the linear model. A contact, a
dead zone or a saturation is linearised in the mode found at the point, or in the one asked for. Roundings count as a
gain of 1 (`engine.roundings`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from engine.casadi_lock import one_at_a_time
from engine.display import counts, roots
from engine.display import table as html_table
from engine.errors import ParameterError, nearest
from engine.model import FRICTION, TIME, Mode, Model, Vector
from engine.roundings import has_rounding, jacobian
from engine.start import start_values

if TYPE_CHECKING:
    import control

Matrix = NDArray[np.float64]

_EDGE = 1e-14
"""A guard this close to zero is on the edge between two modes."""


@dataclass(frozen=True, repr=False)
class LinearModel:
    """``x' = A x + B u, y = C x + D u`` for deviations from a point.

    Attributes:
        A, B, C, D: shapes (n, n), (n, r), (m, n), (m, r).
        states, inputs, outputs: names.
        units: name -> unit.
        modes: mode name -> label of the mode that was linearised.
        point: state or input name -> value at the operating point.
        rate: the largest |dx/dt| at the point over the states kept: zero at an equilibrium.
        moving: state name -> dx/dt at the point, of the states kept that keep the point from being an equilibrium. A
            state on whose value nothing depends may move: a shaft that turns steadily is an equilibrium of its speed.
        ambiguous: mode name -> labels of the modes that meet at the point, where it lies exactly on the edge between
            them and none was asked for.
        assumed: what was chosen and not asked for, in words: such as a mode other than that of the point, in which some
            input would move no output; see `engine.linear_modes.audible`.
        rounded: whether the model rounds, as an encoder does; roundings count as a gain of 1.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str]
    modes: dict[str, str]
    point: dict[str, float]
    rate: float
    moving: dict[str, float] = field(default_factory=dict)
    ambiguous: dict[str, tuple[str, ...]] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    rounded: bool = False

    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A (1/s; of a `DiscreteModel` in the z-plane), by magnitude."""
        return _by_magnitude(np.linalg.eigvals(self.A))

    def stable(self) -> bool:
        """Whether every pole lies left of the imaginary axis; of a `DiscreteModel`, inside the unit circle."""
        return bool((self.poles().real < 0).all())

    def save(self, path: str | Path) -> Path:
        """Write it as .json, .npz, .mat or .m (a MATLAB or Octave script); returns the path.

        Raises:
            FlexarmError: an unknown kind of file, or it cannot be written.
        """
        from engine import linear_files

        linear_files.write(Path(path), self)
        return Path(path)

    def to_pandas(self) -> dict[str, Any]:
        """The matrices A, B, C and D as data frames with names of states, inputs and outputs."""
        import pandas

        names = {"A": ("states", "states"), "B": ("states", "inputs"), "C": ("outputs", "states")}
        names["D"] = ("outputs", "inputs")
        made = {}
        for key, (rows, columns) in names.items():
            index, heads = list(getattr(self, rows)), list(getattr(self, columns))
            made[key] = pandas.DataFrame(getattr(self, key), index=index, columns=heads)
        return made

    def to_xarray(self) -> Any:
        """The matrices as an `xarray.Dataset`; a dimension cannot stand twice, so columns of A are ``state_from``."""
        import xarray

        dims = {"A": ("state", "state_from"), "B": ("state", "input"), "C": ("output", "state_from")}
        dims["D"] = ("output", "input")
        names = {"state": self.states, "state_from": self.states, "input": self.inputs, "output": self.outputs}
        attributes = {"rate": self.rate, **{f"mode {name}": label for name, label in self.modes.items()}}
        return xarray.Dataset(
            {key: (axes, getattr(self, key)) for key, axes in dims.items()},
            coords={name: list(values) for name, values in names.items()},
            attrs=attributes,
        )

    @property
    def _kind(self) -> str:
        return "linear model"

    def __repr__(self) -> str:
        sizes = counts(states=len(self.states), inputs=len(self.inputs), outputs=len(self.outputs))
        return f"<{self._kind}: {sizes}, {'stable' if self.stable() else 'not stable'}; poles {roots(self.poles(), 6)}>"

    def _repr_html_(self) -> str:
        rows = [["states", escape(", ".join(self.states))], ["inputs", escape(", ".join(self.inputs))]]
        rows += [["outputs", escape(", ".join(self.outputs))], ["poles", escape(roots(self.poles()))]]
        rows += [[f"mode {escape(name)}", escape(label)] for name, label in self.modes.items()]
        return html_table(["", ""], rows, self._kind)

    def zeros(self, output: str | None = None, input: str | None = None) -> NDArray[np.complex128]:
        """Invariant zeros (1/s) of one input-output pair (the first by default).

        Raises:
            ParameterError: unknown name.
        """
        i = _index(output, self.outputs, "output")
        j = _index(input, self.inputs, "input")
        return transmission_zeros(self.A, self.B[:, [j]], self.C[[i]], self.D[[i]][:, [j]])

    def gain(self, frequency: float) -> NDArray[np.complex128]:
        """Frequency response at ``frequency`` (rad/s), shape (outputs, inputs)."""
        n = len(self.A)
        response = self.C @ np.linalg.solve(1j * frequency * np.eye(n) - self.A, self.B.astype(complex)) + self.D
        return np.asarray(response, dtype=complex)

    def to_control(self) -> control.StateSpace:
        """The same as a python-control system; dots in names become underscores, which python-control asks for."""
        import control

        named = {kind: [n.replace(".", "_") for n in getattr(self, kind)] for kind in ("states", "inputs", "outputs")}
        return control.ss(self.A, self.B, self.C, self.D, **named)


def _index(name: str | None, names: tuple[str, ...], kind: str) -> int:
    if name is None:
        return 0
    if name not in names:
        raise ParameterError(f"no {kind} '{name}'", remedy=nearest(name, names))
    return names.index(name)


SAME = 1e-9
"""Magnitudes that differ by no more, relative or in 1/s, are equal: what is left is the linear algebra's rounding."""


def _by_magnitude(values: Any) -> NDArray[np.complex128]:
    """Rising magnitudes; among equal ones, such as those of a conjugate pair, rising imaginary parts."""
    values = np.asarray(values, dtype=complex)
    values = values[np.argsort(np.abs(values), kind="stable")]
    sizes = np.abs(values)
    group = np.cumsum(np.diff(sizes, prepend=0.0) > SAME * np.maximum(sizes, 1.0))
    ordered: NDArray[np.complex128] = values[np.lexsort((values.imag, group))]
    return ordered


def transmission_zeros(A: Matrix, B: Matrix, C: Matrix, D: Matrix) -> NDArray[np.complex128]:
    """Finite zeros of a square system, by the generalised eigenvalues of the Rosenbrock pencil.

    There are none where nothing passes from input to output at any frequency: the pencil is singular then.
    """
    n = len(A)
    scale, out = (float(np.abs(m).max(initial=0.0)) or 1.0 for m in (B, C))
    pencil = np.block([[A, B / scale], [C / out, D / (scale * out)]])
    mass = np.zeros_like(pencil)
    mass[:n, :n] = np.eye(n)
    alpha, beta = scipy.linalg.eig(pencil, mass, right=False, homogeneous_eigvals=True)
    size = np.abs(alpha) + np.abs(beta)
    rate = max(np.abs(A).max(initial=0.0), 1.0)
    if (size < 1e-13 * rate).any():
        return np.zeros(0, dtype=complex)
    finite = np.abs(beta) > 1e-11 * size / rate
    return _by_magnitude(alpha[finite] / beta[finite])


def linearise(
    model: Model,
    *,
    at: dict[str, float] | None = None,
    inputs: dict[str, float] | None = None,
    modes: dict[str, str] | None = None,
    parameters: dict[str, float] | None = None,
    time: float = 0.0,
) -> LinearModel:
    """Linearise at a point.

    Args:
        model: built with the inputs and outputs wanted.
        at: motions, states and memories at the point by name, SI units; the rest as at the model's start.
        inputs: input values at the point, SI units; zero by default.
        modes: mode name -> label (``stuck``, ``sliding forward``, ``inside``...) to linearise in, in place of the one
            found at the point.
        parameters: values that replace the model's, SI units.
        time: instant (s), for sources.

    Raises:
        ParameterError: a name or label that does not exist, or something has no derivative at the point.
    """
    point = operating_point(model, at=at, inputs=inputs, modes=modes, parameters=parameters, time=time)
    return linearise_at(model, point, dict(modes or {}))


def matrices(model: Model, point: Point) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """A, B, C and D of all states, those of stuck joints included.

    Raises:
        ParameterError: something has no finite derivative at the point.
    """
    linear = model.derived(
        "linear",
        lambda e: [
            ca.densify(jacobian(f, s)) for f in (e.derivative, e.outputs) for s in (e.x, e.u[: len(model.inputs)])
        ],
    )
    A, B, C, D = (np.array(b.full()) for b in linear(*point.arguments))
    _check_finite(model, A, B, C, D)
    return A, B, C, D


@one_at_a_time
def linearise_at(model: Model, point: Point, asked: dict[str, str] | None = None) -> LinearModel:
    """Linearise at a point that `operating_point` or `engine.trim.trim` gave; ``asked``: modes that were chosen.

    Raises:
        ParameterError: something has no derivative at the point.
    """
    A, B, C, D = matrices(model, point)
    keep = point.kept(model)
    unbounded = ~np.isfinite(np.vstack([np.hstack([A, B]), np.hstack([C, D])])).all(axis=1)
    if unbounded.any():
        rows = [variable.name for variable in (*model.states, *model.outputs)]
        raise ParameterError(
            f"'{rows[int(np.argmax(unbounded))]}' has no finite derivative at the operating point",
            remedy="linearise at another point or in another mode",
        )
    rates = np.array(model.functions["derivative"](*point.arguments).full()).ravel()[keep]
    names = tuple(model.states[i].name for i in keep)
    if not np.isfinite(rates).all():
        raise ParameterError(
            f"the rate of state '{names[int(np.argmin(np.isfinite(rates)))]}' is not finite at this point",
            remedy="a value of the point may be out of all proportion; linearise at another",
        )
    variables = (*model.states, *model.inputs, *model.outputs)
    kept = A[np.ix_(keep, keep)]
    return LinearModel(
        kept,
        B[keep],
        C[:, keep],
        D,
        names,
        tuple(v.name for v in model.inputs),
        tuple(v.name for v in model.outputs),
        {v.name: v.unit for v in variables},
        {mode.name: _label(mode, v) for mode, v in zip(model.modes, point.m, strict=True) if mode.kind != TIME},
        dict(
            zip((v.name for v in (*model.states, *model.inputs)), [*point.x.tolist(), *point.u.tolist()], strict=False)
        ),
        float(np.abs(rates).max(initial=0.0)),
        moving_states(names, rates, kept, point.x[keep]),
        _ambiguous(model, point, dict(asked or {})),
        rounded=has_rounding(ca.vertcat(model.equations.derivative, model.equations.outputs, model.equations.update)),
    )


def _check_finite(model: Model, A: Matrix, B: Matrix, C: Matrix, D: Matrix) -> None:
    """Refuse matrices that hold no finite numbers, by the name of the state or output."""
    for kind, names, left, right in (("rate of state", model.states, A, B), ("output", model.outputs, C, D)):
        bad = np.flatnonzero(~(np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)))
        if len(bad):
            raise ParameterError(
                f"the derivatives of the {kind} '{names[int(bad[0])].name}' are not finite at this point",
                remedy="an inertia may be zero, or a value too large or too small",
            )


@dataclass(frozen=True)
class Point:
    """Where a model is linearised: time, states, inputs with tables, memories, modes and parameters, SI units."""

    t: float
    x: Vector
    u: Vector
    d: Vector
    m: Vector
    p: Vector

    @property
    def arguments(self) -> tuple[float, Vector, Vector, Vector, Vector, Vector]:
        """In the order of the model's functions."""
        return self.t, self.x, self.u, self.d, self.m, self.p

    def kept(self, model: Model) -> list[int]:
        """Positions of the states that are not held by stuck joints."""
        modes = zip(model.modes, self.m, strict=True)
        stuck = [mode.coordinate for mode, value in modes if mode.kind == FRICTION and value == 0]
        gone = {*stuck, *(model.coordinates + c for c in stuck)}
        return [i for i in range(len(model.states)) if i not in gone]


def operating_point(
    model: Model,
    *,
    at: dict[str, float] | None = None,
    inputs: dict[str, float] | None = None,
    modes: dict[str, str] | None = None,
    parameters: dict[str, float] | None = None,
    time: float = 0.0,
) -> Point:
    """The point at which `linearise` linearises, with the modes that agree with it."""
    p = model.parameter_vector(parameters)
    held = {variable.name: i for i, variable in enumerate(model.memories)}
    given = dict(at or {})
    d = np.array(model.functions["memory_start"](p).full()).ravel()
    for name in [name for name in given if name in held]:
        d[held[name]] = given.pop(name)
    x = start_values(model, p, given)
    u = np.zeros(model.equations.u.numel())
    for name, value in (inputs or {}).items():
        u[_index(name, tuple(v.name for v in model.inputs), "input")] = value
    for i, table in enumerate(model.tables):
        knot = max(int(np.searchsorted(table.times, time, "right")) - 1, 0)
        linear = table.hold == "linear"
        u[len(model.inputs) + i] = np.interp(time, table.times, table.values) if linear else table.values[knot]
    return Point(time, x, u, d, modes_at(model, time, x, u, d, p, dict(modes or {})), p)


def moving_states(names: tuple[str, ...], rates: Vector, A: Matrix, x: Vector) -> dict[str, float]:
    """States that change at the point beyond rounding, but for changes on which nothing depends, as of a shaft."""
    if not len(x):
        return {}
    allowed = 1e-9 + 1e-6 * (np.abs(A) @ np.abs(x) + np.abs(rates).max(initial=0.0) * 1e-6)
    free = scipy.linalg.null_space(A, rcond=1e-12)
    left = rates - free @ (free.T @ rates)
    changes = np.abs(left) > allowed
    return {n: float(r) for n, r, c in zip(names, rates, changes, strict=True) if c}


def _ambiguous(model: Model, point: Point, wanted: dict[str, str]) -> dict[str, tuple[str, ...]]:
    """Modes with a guard that is exactly zero, and the labels on both of its sides."""
    found: dict[str, tuple[str, ...]] = {}
    g = np.array(model.functions["guards"](*point.arguments).full()).ravel()
    for k, mode in enumerate(model.modes):
        if mode.kind == TIME or mode.name in wanted or 2 * k >= len(g):
            continue
        value = int(point.m[k])
        others = [0 if value else side for side, guard in ((1, g[2 * k]), (-1, g[2 * k + 1])) if abs(guard) <= _EDGE]
        if others:
            found[mode.name] = tuple(mode.labels[v + 1] for v in sorted({value, *others}))
    return found


def _label(mode: Mode, value: float) -> str:
    return mode.labels[int(value) + 1]


def modes_at(model: Model, t: float, x: Vector, u: Vector, d: Vector, p: Vector, wanted: dict[str, str]) -> Vector:
    """Modes that agree with the point, those asked for held fixed."""
    m = np.zeros(len(model.modes))
    fixed = set()
    names = [mode.name for mode in model.modes if mode.kind != TIME]
    for name, label in wanted.items():
        if name not in names:
            raise ParameterError(f"no mode '{name}'", remedy=nearest(name, names))
        k = names.index(name)
        if label not in model.modes[k].labels:
            raise ParameterError(f"mode '{name}' is never '{label}'", remedy=nearest(label, model.modes[k].labels))
        m[k] = model.modes[k].labels.index(label) - 1
        fixed.add(k)
    following = model.functions["following"]
    counters = [k for k, mode in enumerate(model.modes) if mode.kind == TIME]
    for _ in range(1000):
        due = [k for k, at in zip(counters, np.array(following(m, p).full()).ravel(), strict=True) if at <= t]
        if not due:
            break
        m[due] += 1
    for k, mode in enumerate(model.modes):
        if mode.kind == FRICTION and k not in fixed:
            m[k] = np.sign(x[model.coordinates + mode.coordinate])
    for _ in range(4 * len(m) + 20):
        g = np.array(model.functions["guards"](t, x, u, d, m, p).full()).ravel()
        wrong = [k for k in range(len(g) // 2) if k not in fixed and max(g[2 * k], g[2 * k + 1]) > 0]
        if not wrong:
            break
        k = max(wrong, key=lambda i: max(g[2 * i], g[2 * i + 1]))
        m[k] = 0 if m[k] != 0 else (1 if g[2 * k] > 0 else -1)
    return m
