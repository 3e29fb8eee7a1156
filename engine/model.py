"""The frozen model: named states, inputs, outputs, parameters and modes, and its equations as CasADi expressions."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from engine.casadi_lock import one_at_a_time, symbolic_property
from engine.display import counts
from engine.errors import ParameterError, Where, nearest
from engine.evaluation import Evaluation
from engine.operations import CALL, CALLED
from engine.ports import Expression
from engine.quantity import Parameter
from engine.relations import Relation
from engine.stamps import ModelParameter
from engine.system import resolved

REBUILD = "set it where the model is built: --set KEY=VALUE, or overrides of load"
"""What to do where a built model cannot follow."""
MOST_VECTORS = 8
"""Parameter vectors that a model keeps: those of the runs under way."""

Vector = NDArray[np.float64]

FRICTION, SWITCH, TIME = "friction", "switch", "time"


@dataclass(frozen=True)
class Variable:
    """A named scalar of the model.

    Attributes:
        name: path such as ``link.hub.angle``.
        unit: coherent SI unit.
        doc: one sentence, may be empty.
        start: starting value at the default parameters.
    """

    name: str
    unit: str
    doc: str = ""
    start: float = 0.0


@dataclass(frozen=True)
class ParameterVariable:
    """A parameter of the model: its value and the declaration that bounds it."""

    name: str
    value: float
    declared: Parameter
    users: tuple[str, ...]
    fixed: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """Coherent SI unit."""
        return self.declared.unit

    def check_free(self, by: str, remedy: str) -> None:
        """Refuse to change it if something else that it gives would stay as it is.

        Args:
            by: what would change it, such as ``a draw``.
            remedy: what to do instead.

        Raises:
            ParameterError: something would stay.
        """
        if self.fixed:
            raise ParameterError(
                f"'{self.name}' gives {' and '.join(self.fixed)} too, which {by} does not change", None, remedy
            )


def parameter_variables(entries: Iterable[ModelParameter]) -> tuple[ParameterVariable, ...]:
    """Parameters as a model has them."""
    return tuple(
        ParameterVariable(entry.name, entry.value, entry.declared, tuple(entry.users), entry.fixed) for entry in entries
    )


@dataclass(frozen=True)
class Mode:
    """A discrete mode: a friction or switch in {-1, 0, +1}, or a counter of time events.

    Attributes:
        name: path of the block that owns it.
        kind: ``friction``, ``switch`` or ``time``.
        labels: what -1, 0 and +1 are called.
        coordinate: for friction, the index of the coordinate that sticks.
    """

    name: str
    kind: str
    labels: tuple[str, str, str] = ("-1", "0", "+1")
    coordinate: int = -1


@dataclass(frozen=True)
class SampleClock:
    """Sample instants ``offset + k period`` in seconds."""

    period: float
    offset: float


@dataclass(frozen=True)
class External:
    """A Python function called at the instants of a clock.

    Attributes:
        name: path of the block that has it.
        clock: index of its clock.
        inputs, outputs: how many values it is given and returns.
        first_input: where its values begin among those of all such functions, in ``equations.external``.
        first_output: where its answers begin among those of all, which follow the clocks' flags in ``equations.fire``.
        make: returns the function for one run; see `engine.net.Net.external`.
        identity: a text that changes when the function changes.
    """

    name: str
    clock: int
    inputs: int
    outputs: int
    first_input: int
    first_output: int
    make: Callable[[], Any]
    identity: str


@dataclass(frozen=True)
class DelayLine:
    """The last values of a signal at the instants of a clock.

    Attributes:
        name: path of the block that has it.
        clock: index of its clock.
        first: where its values begin among those of all lines.
        size: how many values are kept.
        stages: which of them are read, 1 the last; at an instant, what is read is from before it.
        memories: index of the memory that takes the value of each stage.
    """

    name: str
    clock: int
    first: int
    size: int
    stages: tuple[int, ...]
    memories: tuple[int, ...]


@dataclass(frozen=True)
class TableData:
    """A recorded signal inside the model."""

    name: str
    unit: str
    times: tuple[float, ...]
    values: tuple[float, ...]
    hold: str


@dataclass(frozen=True)
class Equations:
    """The model's right-hand sides as SX expressions of ``t, x, u, d, m, p`` (and ``fire`` for the update).

    Attributes:
        t, x, u, d, m, p, fire: symbols: time, states, inputs (external, then tables), memories, modes, parameters, and
            one flag per clock, followed by what external functions returned at the instant and what is read from each
            stage of each delay line.
        derivative: dx/dt.
        guards: two per switching mode, positive when violated: above_0, below_0, above_1, ...
        outputs: y.
        update: memories after the instant at which the clocks with ``fire = 1`` tick.
        following: instant of the next time event of each counter.
        start: states at the start, from parameters.
        memory_start: memories at the start, from parameters.
        transform: motions = transform @ coordinates + imposed, from parameters.
        twists: combinations of coordinates by which motions act on one another, such as the twist of a spring between
            two shafts, shape (twists, coordinates), from parameters; see `Net.twist`.
        imposed: what imposed motions add to all angles, then to all speeds.
        external: what the external functions are given at an instant, in the order of their calls.
        entering: what enters each delay line at an instant of its clock.
        line_start: what each holds at the start, from parameters.
        stored: kinetic and potential energy (J).
    """

    t: Expression
    x: Expression
    u: Expression
    d: Expression
    m: Expression
    p: Expression
    fire: Expression
    derivative: Expression
    guards: Expression
    outputs: Expression
    update: Expression
    following: Expression
    start: Expression
    memory_start: Expression
    transform: Expression
    twists: Expression
    imposed: Expression
    external: Expression
    entering: Expression
    line_start: Expression
    stored: Expression

    @property
    def arguments(self) -> list[Expression]:
        """The symbols every function takes, in order."""
        return [self.t, self.x, self.u, self.d, self.m, self.p]


_OF_EQUATIONS = (
    "functions",
    "law",
    "shaping",
    "shapes",
    "_derived",
    "_evaluations",
    "_parameter_positions",
    "begun",
    "directions",
    "seeds",
)
"""What models of the same equations, names and initial values share."""


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """Equations with names. The model is frozen; a simulation may replace parameter values and initial values.

    Attributes:
        name, description: of the scenario.
        states: coordinates, then their speeds, then first-order states.
        coordinates: how many coordinates there are; ``states[:n]`` are positions and ``states[n:2n]`` speeds.
        inputs: external inputs.
        tables: recorded signals inside the model.
        outputs, parameters, memories, clocks: as named.
        modes: friction modes, then switches, then counters of time events.
        externals: Python functions called at sample instants, in the order of the calls; a model that has some has no
            tangents and cannot be exported as C.
        lines: delay lines.
        readings: blocks, such as encoders, whose steps are left out for the line through them: see `Net.rounded`.
        equations: the SX expressions.
        exposed: further names of inner ports, which results and starting values are found by too.
        motions: flange name -> row of the transform.
        initial: starting values by name, SI units; see `engine.start.start_values`.
        relations: what must not be said of two parameters: index of the first, the relation, index of the second.
    """

    name: str
    description: str
    states: tuple[Variable, ...]
    coordinates: int
    inputs: tuple[Variable, ...]
    tables: tuple[TableData, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[ParameterVariable, ...]
    memories: tuple[Variable, ...]
    clocks: tuple[SampleClock, ...]
    memory_clock: tuple[int, ...]
    modes: tuple[Mode, ...]
    equations: Equations
    motions: Mapping[str, int]
    initial: Mapping[str, float]
    relations: tuple[tuple[int, Relation, int], ...] = ()
    externals: tuple[External, ...] = ()
    lines: tuple[DelayLine, ...] = ()
    readings: tuple[str, ...] = ()
    exposed: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    def count(self, kind: str) -> int:
        """How many modes there are of a kind."""
        return sum(mode.kind == kind for mode in self.modes)

    def resolve(self, name: str) -> str:
        """A name with exposed names replaced by what they stand for."""
        return resolved(name, self.exposed)

    def __repr__(self) -> str:
        sizes = counts(states=len(self.states), inputs=len(self.inputs), outputs=len(self.outputs))
        return f"<model '{self.name}': {sizes}, {counts(parameters=len(self.parameters), modes=len(self.modes))}>"

    def with_parameters(self, entries: Iterable[ModelParameter]) -> Model:
        """The model with other values of its parameters; what follows from the equations alone is worked out once."""
        made = replace(self, parameters=parameter_variables(entries))
        made.__dict__.update({name: getattr(self, name) for name in _OF_EQUATIONS})
        if "stiffens" in self.__dict__:
            made.__dict__["stiffens"] = self.stiffens
        return made

    @property
    def parameter_values(self) -> Vector:
        """Default parameter vector."""
        return self._defaults.copy()

    @functools.cached_property
    def _defaults(self) -> Vector:
        return np.array([parameter.value for parameter in self.parameters])

    def parameter_vector(self, changes: dict[str, float] | None = None) -> Vector:
        """The parameter vector with some values replaced (SI units).

        Raises:
            ParameterError: unknown name, or a value out of bounds.
        """
        changes = changes or {}
        same = tuple(changes.items()) if all(type(value) is float for value in changes.values()) else None
        before = self._vectors.get(same)
        if before is not None:
            return before.copy()
        values = self.parameter_values
        for name, value in changes.items():
            index = self.parameter_index(name)
            try:
                before, values[index] = values[index], self.parameters[index].declared.check(value)
                if not math.isclose(values[index], before, rel_tol=1e-12):
                    self.parameters[index].check_free("a change of a built model", REBUILD)
            except ParameterError as error:
                raise error.at(Where(path=name)) from None
        if same is not None:
            if len(self._vectors) >= MOST_VECTORS:
                self._vectors.clear()
            self._vectors[same] = values.copy()
        return values

    @functools.cached_property
    def _vectors(self) -> dict[Hashable, Vector]:
        """Parameter vectors that were made last: runs that differ in their drive alone share one."""
        return {}

    def parameter_conflict(self, values: Vector) -> str:
        """What a block refuses of a parameter vector, such as ``f.static_friction = 1 is less than ...``; or ""."""
        for first, relation, second in self.relations:
            if relation.broken(values[first], values[second]):
                a, b = (f"{self.parameters[k].name} = {values[k]:.9g}" for k in (first, second))
                return f"{a} {relation.words} {b}"
        return ""

    def parameter_index(self, name: str) -> int:
        """Position of a parameter.

        Raises:
            ParameterError: unknown name.
        """
        try:
            return self._parameter_positions[name]
        except KeyError:
            raise ParameterError(
                f"the model has no parameter '{name}'", remedy=nearest(name, self._parameter_positions)
            ) from None

    @functools.cached_property
    def _parameter_positions(self) -> dict[str, int]:
        return {parameter.name: i for i, parameter in enumerate(self.parameters)}

    @symbolic_property
    def shaping(self) -> frozenset[int]:
        """Indices of the parameters that the starting values of states and memories depend on at all."""
        columns: set[int] = set()
        for name, entry in (("start", 0), ("transform", 0), ("memory_start", 0), ("imposed", 5)):
            function = self.functions[name]
            if function.nnz_out():
                columns.update(int(k) for k in function.jac_sparsity(0, entry).get_col())
        return frozenset(columns)

    @symbolic_property
    def functions(self) -> Mapping[str, Any]:
        """CasADi functions of ``t, x, u, d, m, p``: derivative, guards, outputs, update, following, starts.

        Read-only, so that `signature` is the same whatever was done with the model; others are made by `derived`.
        """
        e = self.equations
        made = {
            name: ca.Function(name, e.arguments, [getattr(e, name)])
            for name in ("derivative", "guards", "outputs", "imposed")
        }
        made["update"] = ca.Function("update", [*e.arguments, e.fire], [e.update])
        if self.externals:
            made["external"] = ca.Function("external", [*e.arguments, e.fire], [e.external])
        if self.lines:
            made["entering"] = ca.Function("entering", [*e.arguments, e.fire], [e.entering])
            made["line_start"] = ca.Function("line_start", [e.p], [e.line_start])
        made["following"] = ca.Function("following", [e.m, e.p], [e.following])
        made["start"] = ca.Function("start", [e.p], [e.start])
        made["transform"] = ca.Function("transform", [e.p], [e.transform])
        made["memory_start"] = ca.Function("memory_start", [e.p], [e.memory_start])
        return MappingProxyType(made)

    @functools.cached_property
    def _derived(self) -> dict[str, Any]:
        return {}

    @one_at_a_time
    def derived(
        self, name: str, expressions: Callable[[Equations], Sequence[Expression]], *, fire: bool = False
    ) -> Any:
        """A function of expressions derived from the equations, made once and kept under its name.

        Args:
            name: of the function; each stands for the same expressions wherever it is used.
            expressions: gives the results from the equations; called the first time only.
            fire: the function also takes the clocks' flags, after ``t, x, u, d, m, p``.
        """
        found = self._derived.get(name)
        if found is None:
            e = self.equations
            arguments = [*e.arguments, e.fire] if fire else e.arguments
            found = self._derived[name] = ca.Function(name, arguments, list(expressions(e)))
        return found

    @property
    def jacobian(self) -> Any:
        """Function of ``t, x, u, d, m, p``: the derivative by the states, shape (states, states), 1/s and the like."""
        return self.derived("jacobian", lambda e: [ca.jacobian(e.derivative, e.x)])

    @symbolic_property
    def stiffens(self) -> bool:
        """Whether the rates of its modes depend on where its states are, as with a spring that hardens."""
        e = self.equations
        return any(ca.which_depends(ca.jacobian(e.derivative, e.x).nz[:], e.x, 1, False)) if self.states else False

    @functools.cached_property
    def _evaluations(self) -> dict[str, Evaluation]:
        return {}

    def at(self, name: str) -> Evaluation:
        """A function for arrays: `jacobian`, or one of `functions` by its name."""
        found = self._evaluations.get(name)
        if found is None:
            made = Evaluation(self.jacobian if name == "jacobian" else self.functions[name])
            found = self._evaluations.setdefault(name, made)
        return found

    @symbolic_property
    def shapes(self) -> NDArray[np.intp]:
        """`shaping` in order, as an array."""
        return np.array(sorted(self.shaping), dtype=np.intp)

    @functools.cached_property
    def begun(self) -> dict[Hashable, tuple[Vector, Vector]]:
        """States and memories at the start of runs that were prepared: see `engine.simulate`."""
        return {}

    @functools.cached_property
    def steps(self) -> dict[Hashable, float]:
        """Internal steps of runs that were prepared, likewise."""
        return {}

    @functools.cached_property
    def directions(self) -> dict[tuple[str, ...], tuple[list[str], tuple[int, ...]]]:
        """Directions of tangents that were asked for, likewise: see `engine.tangent`."""
        return {}

    @functools.cached_property
    def seeds(self) -> dict[Hashable, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Derivatives of starts by directions, likewise; nobody writes to them."""
        return {}

    @symbolic_property
    def operations(self) -> int:
        """Operations of the right-hand side, each call of a function as many as take as long."""
        derivative = self.functions["derivative"]
        taken = [derivative.instruction_id(k) for k in range(derivative.n_instructions())]
        return sum(CALL if operation in CALLED else 1 for operation in taken)

    @symbolic_property
    def law(self) -> str:
        """Hash of all that code is made of: equal for models that differ in the values of parameters alone."""
        digest = hashlib.sha256()
        for name, function in self.functions.items():
            digest.update(name.encode())
            digest.update(str(function.serialize()).encode())
        sizes = (self.coordinates, len(self.states), len(self.inputs), len(self.outputs), len(self.parameters))
        digest.update(repr((sizes, self.modes, self.tables, self.clocks, self.memories, self.memory_clock)).encode())
        digest.update(repr((self.lines, [(e.name, e.clock, e.identity) for e in self.externals])).encode())
        return digest.hexdigest()

    @symbolic_property
    def signature(self) -> str:
        """Hash of the equations and names: equal for equal models."""
        digest = hashlib.sha256()
        for name, function in self.functions.items():
            digest.update(name.encode())
            digest.update(str(function.serialize()).encode())
        digest.update(repr((self.states, self.inputs, self.outputs, self.parameters, self.modes, self.tables)).encode())
        digest.update(repr((self.clocks, self.memory_clock, self.memories)).encode())
        if self.lines:
            digest.update(repr(self.lines).encode())
        digest.update(repr([(e.name, e.clock, e.first_output, e.identity) for e in self.externals]).encode())
        return digest.hexdigest()[:16]
