"""Families of linear models: one for each point of a grid, each instant of a run, or each combination of modes.

All members have the states of the model in one order. The position and speed of a stuck joint stay among them, and do
not change: their rows of A and B are zero.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import linprog

from engine.errors import ParameterError, nearest
from engine.linearise import LinearModel, Point, matrices, moving_states, operating_point
from engine.model import FRICTION, TIME, Model, Vector

if TYPE_CHECKING:
    import xarray

MOST_MEMBERS = 100_000
"""Members of one family."""

MOST_COMBINATIONS = 729
"""Combinations of modes that are looked at: six modes of three."""


@dataclass(frozen=True)
class Axis:
    """What members of a family differ by: a scheduling variable, time, a sample's number, or the modes.

    Attributes:
        name: of a parameter, state, motion or input; or ``time``, ``sample``, ``modes``.
        unit: of the values.
        values: shape (k,), rising for a scheduling variable.
        labels: what the values are called, where they are no quantity.
        by_state, by_input: the variable is by_state @ x + by_input @ u + constant; None where it follows from neither.
        constant: see there.
    """

    name: str
    unit: str
    values: Vector
    labels: tuple[str, ...] = ()
    by_state: Vector | None = None
    by_input: Vector | None = None
    constant: float = 0.0


@dataclass(frozen=True)
class LinearFamily:
    """An array of linear models ``dx/dt = dx0 + A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0)``.

    Attributes:
        axes: g of them; the shape of the array is the number of values of each.
        A, B, C, D: shapes (..., n, n), (..., n, r), (..., m, n), (..., m, r); ... is the shape of the array.
        x0, u0, y0, dx0: offsets, shapes (..., n), (..., r), (..., m), (..., n).
        states, inputs, outputs: names.
        units: name -> unit.
        modes: for each member, in the order of the flattened array, mode name -> label.
        held: for each member likewise, the states that a stuck joint holds.
        parameters: for each member likewise, what differs from the model's own parameters.
        assumed: what was chosen and not asked for, in words.
    """

    axes: tuple[Axis, ...]
    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]
    x0: NDArray[np.float64]
    u0: NDArray[np.float64]
    y0: NDArray[np.float64]
    dx0: NDArray[np.float64]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str]
    modes: tuple[dict[str, str], ...]
    held: tuple[frozenset[str], ...]
    parameters: tuple[dict[str, float], ...] = ()
    assumed: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def __len__(self) -> int:
        return math.prod(self.shape)

    def __iter__(self) -> Iterator[LinearModel]:
        return (self[index] for index in np.ndindex(self.shape))

    def __getitem__(self, index: SupportsIndex | Sequence[SupportsIndex]) -> LinearModel:
        """One member, with all states; an int counts along the flattened array, from its end if negative.

        Raises:
            IndexError: there is no such member.
        """
        flat = self._number(index)
        place = np.unravel_index(flat, self.shape)
        return self._model(tuple(getattr(self, k)[place] for k in _ARRAYS), self.modes[flat], self.held[flat])

    def _number(self, index: SupportsIndex | Sequence[SupportsIndex]) -> int:
        """The place of a member in the flattened array."""
        if not isinstance(index, Sequence):
            return range(len(self))[index]
        if len(index) != len(self.shape):
            raise IndexError(f"a family over {len(self.shape)} axes has no member {tuple(index)}")
        places = [range(length)[k] for length, k in zip(self.shape, index, strict=True)]
        return int(np.ravel_multi_index(places, self.shape))

    def _model(self, arrays: tuple[Any, ...], modes: dict[str, str], held: frozenset[str] = frozenset()) -> LinearModel:
        A, B, C, D, x0, u0, _, dx0 = arrays
        point = dict(zip((*self.states, *self.inputs), [*x0.tolist(), *u0.tolist()], strict=True))
        keep = [i for i, name in enumerate(self.states) if name not in held]
        moving = moving_states(tuple(self.states[i] for i in keep), dx0[keep], A[np.ix_(keep, keep)], x0[keep])
        rate = float(np.abs(dx0).max(initial=0.0))
        return LinearModel(A, B, C, D, self.states, self.inputs, self.outputs, self.units, modes, point, rate, moving)

    def kept(self, index: SupportsIndex | Sequence[SupportsIndex]) -> LinearModel:
        """One member without the states that stuck joints hold, as `engine.linearise.linearise` gives it."""
        flat = self._number(index)
        whole = self[flat]
        keep = [i for i, name in enumerate(self.states) if name not in self.held[flat]]
        return LinearModel(
            whole.A[np.ix_(keep, keep)],
            whole.B[keep],
            whole.C[:, keep],
            whole.D,
            tuple(self.states[i] for i in keep),
            self.inputs,
            self.outputs,
            self.units,
            whole.modes,
            whole.point,
            whole.rate,
            whole.moving,
        )

    def at(self, **values: float) -> LinearModel:
        """The model between the members, each entry interpolated linearly along every axis; dots in names as ``_``.

        Raises:
            ParameterError: an axis that does not exist or has no value here, a value outside of its axis.
        """
        names = {axis.name.replace(".", "_"): axis for axis in self.axes}
        for name in values:
            if name not in names:
                raise ParameterError(f"'{name}' is no axis of this family", remedy=nearest(name, names))
        missing = [name for name in names if name not in values]
        if missing:
            raise ParameterError(f"no value is given for '{missing[0]}'", remedy="give one for each axis")
        rho = [values[name] for name in names]
        for value, axis in zip(rho, self.axes, strict=True):
            if not axis.values.min() <= value <= axis.values.max():
                ends = f"{axis.values.min():g} to {axis.values.max():g} {axis.unit}"
                raise ParameterError(f"{value:g} is outside of the axis '{axis.name}'", remedy=f"it spans {ends}")
        modes = {k: v for k, v in self.modes[0].items() if all(m[k] == v for m in self.modes)}
        return self._model(self._blend(rho), modes)

    def _blend(self, rho: Sequence[float]) -> tuple[Any, ...]:
        """Matrices and offsets at values of the axes, held beyond the ends."""
        arrays = [getattr(self, key) for key in _ARRAYS]
        for value, axis in zip(rho, self.axes, strict=True):
            k = int(np.clip(np.searchsorted(axis.values, value) - 1, 0, max(len(axis.values) - 2, 0)))
            if len(axis.values) == 1:
                arrays = [array[0] for array in arrays]
                continue
            share = float(np.clip((value - axis.values[k]) / (axis.values[k + 1] - axis.values[k]), 0.0, 1.0))
            arrays = [(1 - share) * array[k] + share * array[k + 1] for array in arrays]
        return tuple(arrays)

    def simulate(
        self,
        time: Vector,
        inputs: NDArray[np.float64],
        start: Vector,
        schedule: Callable[[float, Vector, Vector], Sequence[float]] | None = None,
    ) -> NDArray[np.float64]:
        """Outputs of the interpolated model over time, as a gain-scheduled simulation does it.

        Each step takes the model at its middle as constant and is exact for that (exponential midpoint rule, of second
        order in the step), so that stiff modes are no matter.

        Args:
            time: instants (s), rising, shape (k,); steps are those between them.
            inputs: u, linear between the instants, shape (k, r).
            start: x at the first instant, shape (n,).
            schedule: values of the axes from time, x and u; those that the axes say themselves if None.

        Returns:
            Shape (k, m).

        Raises:
            ParameterError: an axis that neither state nor input gives, and no ``schedule``.
        """
        follow = self._schedule if schedule is None else schedule
        if schedule is None:
            for axis in self.axes:
                if axis.by_state is None and axis.by_input is None:
                    raise ParameterError(
                        f"'{axis.name}' is no scheduling variable: neither states nor inputs say what it is",
                        remedy="give schedule=..., or a family over states, motions or inputs",
                    )
        n, x, rows = len(self.states), np.asarray(start, dtype=float), []
        before = x
        for k, t in enumerate(time):
            u = inputs[k]
            A, B, C, D, x0, u0, y0, dx0 = self._blend(follow(float(t), x, u))
            rows.append(y0 + C @ (x - x0) + D @ (u - u0))
            if k + 1 == len(time):
                break
            step, middle = float(time[k + 1] - t), (u + inputs[k + 1]) / 2
            ahead = x + (x - before) / 2
            A, B, C, D, x0, u0, y0, dx0 = self._blend(follow(float(t) + step / 2, ahead, middle))
            flow = np.zeros((n + 1, n + 1))
            flow[:n, :n], flow[:n, n] = A * step, (dx0 + A @ (x - x0) + B @ (middle - u0)) * step
            before, x = x, x + scipy.linalg.expm(flow)[:n, n]
        return np.array(rows)

    def _schedule(self, t: float, x: Vector, u: Vector) -> list[float]:
        rho = []
        for axis in self.axes:
            value = axis.constant
            value += float(axis.by_state @ x) if axis.by_state is not None else 0.0
            value += float(axis.by_input @ u) if axis.by_input is not None else 0.0
            rho.append(value)
        return rho

    def to_control(self) -> Any:
        """The members as python-control systems, in an object array of the family's shape."""
        made = np.empty(self.shape, dtype=object)
        for index in np.ndindex(self.shape):
            made[index] = self[index].to_control()
        return made

    def to_xarray(self) -> xarray.Dataset:
        """Matrices and offsets as an xarray Dataset.

        Dimensions are the axes, ``state``, ``to_state`` (rows of A and B), ``input`` and ``output``.
        """
        import xarray as xr

        grid = tuple(axis.name for axis in self.axes)
        rows = {
            "A": ("to_state", "state"),
            "B": ("to_state", "input"),
            "C": ("output", "state"),
            "D": ("output", "input"),
            "x0": ("state",),
            "u0": ("input",),
            "y0": ("output",),
            "dx0": ("to_state",),
        }
        labels = np.array([", ".join(f"{k} {v}" for k, v in m.items()) for m in self.modes], dtype=object)
        data = {key: ((*grid, *dims), getattr(self, key)) for key, dims in rows.items()}
        coordinates: dict[str, Any] = {
            "state": list(self.states),
            "to_state": list(self.states),
            "input": list(self.inputs),
            "output": list(self.outputs),
        }
        for axis in self.axes:
            values = list(axis.labels) if axis.labels else axis.values
            coordinates[axis.name] = (axis.name, values, {"units": axis.unit})
        data["modes_linearised"] = (grid, labels.reshape(self.shape))
        return xr.Dataset(data, coordinates, {"units": str(self.units)})


_ARRAYS = ("A", "B", "C", "D", "x0", "u0", "y0", "dx0")


def scheduling_axis(model: Model, name: str, values: Sequence[float] | Vector) -> Axis:
    """An axis over a parameter, state, motion or input of a model; values in SI units.

    Raises:
        ParameterError: no such variable, values that do not rise, or that a parameter does not take.
    """
    numbers = np.asarray(values, dtype=float)
    if not np.isfinite(numbers).all() or (np.diff(numbers) <= 0).any():
        raise ParameterError(f"the values of '{name}' do not rise", remedy="give each once, the smallest first")
    n = len(model.states)
    inputs, states = [v.name for v in model.inputs], [v.name for v in model.states]
    if name in inputs:
        return Axis(
            name, model.inputs[inputs.index(name)].unit, numbers, by_input=np.eye(len(inputs))[inputs.index(name)]
        )
    if name in states:
        return Axis(name, model.states[states.index(name)].unit, numbers, by_state=np.eye(n)[states.index(name)])
    flange, _, quantity = name.rpartition(".")
    orders = {"angle": 0, "position": 0, "speed": 1}
    if flange in model.motions and quantity in orders:
        order, n_q = orders[quantity], model.coordinates
        row = np.zeros(n)
        transform = np.array(model.functions["transform"](model.parameter_values).full())
        row[order * n_q : (order + 1) * n_q] = transform[model.motions[flange]]
        unit = {"angle": "rad", "position": "m"}.get(quantity) or model.states[n_q].unit
        return Axis(name, unit, numbers, by_state=row)
    if name in {p.name for p in model.parameters}:
        for value in numbers:
            model.parameter_vector({name: float(value)})
        return Axis(name, model.parameters[model.parameter_index(name)].unit, numbers)
    known = [*inputs, *states, *(p.name for p in model.parameters)]
    raise ParameterError(
        f"'{name}' is no scheduling variable: no parameter, state, motion or input of the model has that name",
        remedy=nearest(name, known),
    )


def grid(
    model: Model,
    axes: Sequence[Axis],
    *,
    at: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    modes: Mapping[str, str] | None = None,
    parameters: Mapping[str, float] | None = None,
    find: Callable[[dict[str, float], dict[str, float], dict[str, float]], Point] | None = None,
) -> LinearFamily:
    """A family over all combinations of the values of scheduling variables.

    Args:
        model: the model.
        axes: see `scheduling_axis`.
        at: the point otherwise; see `engine.linearise.linearise` for this and the next three.
        inputs: values of inputs.
        modes: that are held.
        parameters: values that replace the model's.
        find: gives the point from states and motions, inputs and parameters, such as an equilibrium; the point itself
            if None.

    Raises:
        ParameterError: a value that does not fit, two axes of one name, more members than can be kept.
    """
    names = [axis.name for axis in axes]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ParameterError(f"'{twice}' is an axis twice", remedy="give all its values in one")
    shape = tuple(len(axis.values) for axis in axes)
    if math.prod(shape) > MOST_MEMBERS:
        raise ParameterError(f"{math.prod(shape)} members are too many", remedy=f"at most {MOST_MEMBERS}")
    own, known = {p.name for p in model.parameters}, {v.name for v in model.inputs}
    points, changed = [], []
    for index in np.ndindex(shape):
        values = {axis.name: float(axis.values[k]) for axis, k in zip(axes, index, strict=True)}
        p = {**(parameters or {}), **{k: v for k, v in values.items() if k in own}}
        u = {**(inputs or {}), **{k: v for k, v in values.items() if k in known}}
        x = {**(at or {}), **{k: v for k, v in values.items() if k not in own and k not in known}}
        changed.append(p)
        if find is not None:
            points.append(find(x, u, p))
        else:
            points.append(operating_point(model, at=x, inputs=u, modes=dict(modes or {}), parameters=p))
    return collect(model, axes, points, changed)


def combinations(
    model: Model,
    *,
    at: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    modes: Mapping[str, str] | None = None,
    parameters: Mapping[str, float] | None = None,
) -> LinearFamily:
    """A family over all combinations of stick, slip and contact that can occur, those asked for held.

    A combination can occur if some deviation of states and inputs meets all its guards, which a linear program decides.

    Raises:
        ParameterError: the model switches nothing, or in too many ways.
    """
    asked = dict(modes or {})
    choices = []
    for mode in model.modes:
        if mode.kind == TIME:
            continue
        labels = [asked[mode.name]] if mode.name in asked else list(dict.fromkeys(mode.labels))
        choices.append([(mode.name, label) for label in labels])
    count = math.prod(len(c) for c in choices)
    if not choices:
        raise ParameterError("the model switches nothing: it has one combination of modes", remedy="leave out --modes")
    if count > MOST_COMBINATIONS:
        raise ParameterError(
            f"{len(choices)} modes have {count} combinations; at most {MOST_COMBINATIONS} are looked at",
            remedy="hold some of them: --mode NAME=LABEL",
        )
    points, labels = [], []
    for chosen in itertools.product(*choices):
        point = operating_point(
            model, at=dict(at or {}), inputs=dict(inputs or {}), modes=dict(chosen), parameters=dict(parameters or {})
        )
        if _feasible(model, point):
            points.append(point)
            labels.append(", ".join(f"{name} {label}" for name, label in chosen))
    axis = Axis("modes", "", np.arange(len(points), dtype=float), tuple(labels))
    return collect(model, [axis], points)


def _feasible(model: Model, point: Point) -> bool:
    """Whether the guards of the point's modes hold somewhere."""
    import casadi as ca

    slopes = model.derived(
        "guard_slopes", lambda e: [ca.densify(ca.jacobian(e.guards, ca.vertcat(e.x, e.u[: len(model.inputs)])))]
    )
    G = np.array(slopes(*point.arguments).full())
    g = np.array(model.functions["guards"](*point.arguments).full()).ravel()
    usable = np.isfinite(g) & np.isfinite(G).all(axis=1) if len(g) else np.zeros(0, dtype=bool)
    if not usable.any():
        return True
    scale = np.maximum(np.abs(G[usable]).max(axis=1), 1e-300)
    n, stuck = len(model.states), point.kept(model)
    free = [(None, None) if i >= n or i in stuck else (0.0, 0.0) for i in range(G.shape[1])]
    found = linprog(np.zeros(G.shape[1]), G[usable] / scale[:, None], -g[usable] / scale + 1e-9, bounds=free)
    return bool(found.status != 2)


def collect(
    model: Model,
    axes: Sequence[Axis],
    points: Sequence[Point],
    parameters: Sequence[Mapping[str, float]] = (),
    assumed: tuple[str, ...] = (),
) -> LinearFamily:
    """The family of the linear models at points, one for each member of the flattened array."""
    rows: list[tuple[Any, ...]] = []
    modes, held = [], []
    n_q, names = model.coordinates, [v.name for v in model.states]
    for point in points:
        A, B, C, D = matrices(model, point)
        dx = np.array(model.functions["derivative"](*point.arguments).full()).ravel()
        y = np.array(model.functions["outputs"](*point.arguments).full()).ravel()
        stuck = [m.coordinate for m, v in zip(model.modes, point.m, strict=True) if m.kind == FRICTION and v == 0]
        gone = [*stuck, *(n_q + c for c in stuck)]
        A[gone], B[gone], dx[gone] = 0.0, 0.0, 0.0
        rows.append((A, B, C, D, point.x, point.u[: len(model.inputs)], y, dx))
        modes.append(
            {m.name: m.labels[int(v) + 1] for m, v in zip(model.modes, point.m, strict=True) if m.kind != TIME}
        )
        held.append(frozenset(names[i] for i in gone))
    shape = tuple(len(axis.values) for axis in axes)
    arrays = [np.array([row[k] for row in rows]) for k in range(len(_ARRAYS))]
    arrays = [array.reshape(*shape, *array.shape[1:]) for array in arrays]
    return LinearFamily(
        axes=tuple(axes),
        **dict(zip(_ARRAYS, arrays, strict=True)),
        states=tuple(names),
        inputs=tuple(v.name for v in model.inputs),
        outputs=tuple(v.name for v in model.outputs),
        units={v.name: v.unit for v in (*model.states, *model.inputs, *model.outputs)},
        modes=tuple(modes),
        held=tuple(held),
        parameters=tuple(dict(p) for p in parameters),
        assumed=assumed,
    )
