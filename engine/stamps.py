"""What a net collects: motions, ties, friction, switches, states, memories and signals, as plain records."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from engine.errors import StructureError
from engine.ports import Expression, Port
from engine.quantity import Parameter


@dataclass(frozen=True, eq=False)
class Motion:
    """One mechanical variable: what a set of connected flanges share, or a block's inner coordinate.

    Attributes:
        index: position in the net's list.
        name: the block and port (or coordinate) that made it.
        kind: ``rotational`` or ``translational``.
        angle, speed, acceleration: CasADi symbols. For translation ``position`` is the same as ``angle``.
        inner: True for a coordinate that no flange shows.
    """

    index: int
    name: str
    kind: str
    angle: Expression
    speed: Expression
    acceleration: Expression
    inner: bool = False

    @property
    def position(self) -> Expression:
        """The position of a translational flange."""
        return self.angle


@dataclass(frozen=True, eq=False)
class Velocity:
    """A speed built on the speeds of motions and of earlier velocities; see `Net.velocity`.

    Attributes:
        index: -1, -2, ... in the order they are made.
        name: the block and the local name.
        speed: CasADi symbol.
        terms: index of a motion or of an earlier velocity -> coefficient.
    """

    index: int
    name: str
    speed: Expression
    terms: dict[int, Expression]


@dataclass
class Tie:
    """A linear relation ``sum coefficient * motion = 0``; see `Net.tie`."""

    owner: str
    terms: dict[int, Expression]
    efficiency: tuple[int, int, Expression] | None = None


@dataclass
class Friction:
    """Dry friction on a relative motion; see `Net.friction`."""

    owner: str
    terms: dict[int, Expression]
    forward: Expression
    backward: Expression
    static_forward: Expression
    static_backward: Expression
    velocity: Expression


@dataclass
class Prescription:
    """A motion imposed from outside; see `Net.prescribe`."""

    owner: str
    motion: int
    angle: Expression
    speed: Expression | None
    acceleration: Expression | None
    reaction: Expression


@dataclass
class Switch:
    """A three-valued mode with two guards; see `Net.switch`."""

    name: str
    mode: Expression
    above: Expression
    below: Expression
    labels: tuple[str, str, str]


@dataclass
class TimeEvent:
    """A counter that rises by one at computed instants; see `Net.time_event`."""

    name: str
    count: Expression
    following: Expression


@dataclass
class State:
    """A first-order continuous state."""

    name: str
    unit: str
    symbol: Expression
    start: Expression
    derivative: Expression | None = None
    doc: str = ""


@dataclass
class Clock:
    """Sample instants ``offset + k * period``; numbers in seconds."""

    period: float
    offset: float
    index: int


@dataclass
class Memory:
    """A value held between the instants of a clock.

    ``held`` memories are outputs: they are computed first, in the order of the data flow, and others see the new value.
    The rest are updated afterwards from the values before the instant.
    """

    name: str
    unit: str
    symbol: Expression
    start: Expression
    clock: Clock
    held: bool
    update: Expression | None = None

    @property
    def law(self) -> Expression:
        """The value it takes at an instant.

        Raises:
            StructureError: the block never gave it one.
        """
        if self.update is None:
            raise StructureError(f"memory '{self.name}' is never given a value")
        return ca.SX(self.update)


@dataclass
class Line:
    """What a signal was at the last instants of a clock; see `Net.line`.

    Attributes:
        name: path.
        clock: when a value is taken.
        value: the signal.
        start: what it was before the beginning.
        size: how many values are kept.
        stages: which of the past values are read, the last one counting as 0 at an instant; the least is 1.
        memories: of each stage.
        returned: symbol of each stage's value at an instant.
    """

    name: str
    clock: Clock
    value: Expression
    start: Expression
    size: int
    stages: tuple[int, ...]
    memories: list[Memory]
    returned: list[Expression]


@dataclass
class External:
    """A Python function called at the instants of a clock; see `Net.external`."""

    name: str
    clock: Clock
    inputs: Expression
    returned: list[Expression]
    make: Callable[[], Any]
    identity: str


@dataclass
class Table:
    """A recorded signal: ``values`` at ``times``, held or interpolated between."""

    name: str
    unit: str
    symbol: Expression
    times: Sequence[float]
    values: Sequence[float]
    hold: str


@dataclass
class Output:
    """A named signal, with the blocks' inputs still unresolved in ``expression``."""

    name: str
    unit: str
    expression: Expression
    physical: bool
    doc: str = ""


@dataclass
class Input:
    """A block's signal input: a symbol that the wiring resolves."""

    name: str
    port: Port
    symbol: Expression


@dataclass
class ModelParameter:
    """A parameter of the model, every declaration it serves, and what it gives that cannot follow it."""

    name: str
    symbol: Expression
    value: float
    declared: Parameter
    users: list[str] = field(default_factory=list)
    fixed: tuple[str, ...] = ()
