"""What blocks stamp: motions, inertia, forces, ties, friction, switches, signals, memories and energy.

Sign rule: a positive force or torque on a motion accelerates it in the positive sense.

A `Net` only collects. `engine.assemble` eliminates the ties, solves for the accelerations and freezes a `Model`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from engine.errors import StructureError
from engine.ports import ROTATIONAL, Expression, Port
from engine.relations import Relation
from engine.stamps import (
    Clock,
    External,
    Friction,
    Input,
    Line,
    Memory,
    ModelParameter,
    Motion,
    Output,
    Prescription,
    State,
    Switch,
    Table,
    Tie,
    TimeEvent,
    Velocity,
)


class Net:
    """Collects what blocks stamp. Blocks see only this class."""

    def __init__(self, smooth_readings: bool = False) -> None:
        self.smooth_readings = smooth_readings
        self.readings: list[str] = []
        self.motions: list[Motion] = []
        self.velocities: list[Velocity] = []
        self.masses: dict[tuple[int, int], Expression] = {}
        self.forces: dict[int, Expression] = {}
        self.ties: list[Tie] = []
        self.frictions: list[Friction] = []
        self.prescriptions: list[Prescription] = []
        self.twists: list[dict[int, Expression]] = []
        self.switches: list[Switch] = []
        self.time_events: list[TimeEvent] = []
        self.states: list[State] = []
        self.clocks: list[Clock] = []
        self.memories: list[Memory] = []
        self.externals: list[External] = []
        self.lines: list[Line] = []
        self.tables: list[Table] = []
        self.outputs: dict[str, Output] = {}
        self.inputs: dict[str, Input] = {}
        self.parameters: dict[str, ModelParameter] = {}
        self.relations: list[Relation] = []
        self.stored: Expression = ca.SX(0)
        self.dissipated: Expression = ca.SX(0)
        self.supplied: Expression = ca.SX(0)
        self.time: Expression = ca.SX.sym("time")
        self._owner = ""
        self._physical = False

    # -- used by the assembly ---------------------------------------------------------------------------------------

    def new_motion(self, name: str, kind: str, *, inner: bool = False) -> Motion:
        """A fresh mechanical variable."""
        angle, speed, acceleration = (ca.SX.sym(f"{name}.{order}") for order in ("angle", "speed", "acceleration"))
        motion = Motion(len(self.motions), name, kind, angle, speed, acceleration, inner)
        self.motions.append(motion)
        return motion

    def begin(self, name: str, *, physical: bool) -> None:
        """What is stamped from here on belongs to the block ``name``; ``physical`` if that is part of the plant."""
        self._owner, self._physical = name, physical

    def _name(self, local: str) -> str:
        return f"{self._owner}.{local}"

    # -- mechanics --------------------------------------------------------------------------------------------------

    def coordinate(self, name: str, *, kind: str = ROTATIONAL) -> Motion:
        """An inner degree of freedom, such as a modal coordinate. Its inertia comes from `mass` or `kinetic`."""
        return self.new_motion(self._name(name), kind, inner=True)

    def velocity(self, name: str, terms: Mapping[Motion | Velocity, Expression]) -> Velocity:
        """A speed ``sum coefficient * speed``, such as a component of a body's velocity, open to mass and force.

        Its acceleration is found by recursion and not substituted: in a chain in which each body's velocities are built
        on those of the body before, the work grows in proportion to the number of bodies.

        Args:
            name: local name.
            terms: coefficient of each motion or earlier velocity; coefficients may depend on parameters and on angles.
        """
        made = Velocity(
            -1 - len(self.velocities),
            self._name(name),
            ca.SX.sym(f"{self._name(name)}.speed"),
            {m.index: ca.SX(c) for m, c in terms.items()},
        )
        self.velocities.append(made)
        return made

    def inertia(self, motion: Motion | Velocity, value: Expression) -> None:
        """Add a constant inertia (kg.m2) or mass (kg) to a motion."""
        self.mass([motion], [[value]])

    def mass(self, motions: Sequence[Motion | Velocity], matrix: Any) -> None:
        """Add a symmetric constant mass matrix over the motions (a nested list or an SX matrix)."""
        matrix = ca.SX(matrix) if isinstance(matrix, ca.SX) else ca.vertcat(*[ca.horzcat(*row) for row in matrix])
        for i, a in enumerate(motions):
            for j, b in enumerate(motions):
                entry = matrix[i, j]
                if entry.is_zero():
                    continue
                key = (a.index, b.index)
                self.masses[key] = self.masses.get(key, 0) + entry

    def kinetic(self, motions: Sequence[Motion | Velocity], energy: Expression) -> Expression:
        """Add a kinetic energy, quadratic in the speeds; its velocity forces follow by Lagrange's equation.

        Args:
            motions: every motion and velocity the energy depends on.
            energy: expression in the motions' angles and in all the speeds, joule.

        Returns:
            The momenta, one per entry of ``motions``. Where velocities are components along turning axes, the terms by
            which Lagrange's equation for them differs from that for coordinates are left to the block.
        """
        v = ca.vertcat(*[m.speed for m in motions])
        momentum = ca.gradient(energy, v)
        self.mass(motions, ca.jacobian(momentum, v))
        places = [i for i, motion in enumerate(motions) if isinstance(motion, Motion)]
        q = ca.vertcat(*[motion.angle for motion in motions if isinstance(motion, Motion)])
        slope, change = ca.gradient(energy, q), ca.jtimes(momentum, q, v[places])
        for i, motion in enumerate(motions):
            self.force(motion, (slope[places.index(i)] if i in places else 0) - change[i])
        return momentum

    def potential(self, motions: Sequence[Motion], energy: Expression) -> None:
        """Add a potential energy (joule); its gradient pulls on the motions and it counts as stored."""
        for motion in motions:
            self.force(motion, -ca.gradient(energy, motion.angle))
        self.stored += energy

    def force(self, motion: Motion | Velocity, value: Expression) -> None:
        """Add a force (N) or torque (N.m) acting on a motion or along a velocity."""
        self.forces[motion.index] = self.forces.get(motion.index, 0) + value

    def pair(self, a: Motion, b: Motion | None, value: Expression) -> None:
        """Add ``value`` to ``a`` and its reaction to ``b`` (None is the ground)."""
        self.force(a, value)
        if b is not None:
            self.force(b, -value)
            self.twist({a: ca.SX(1), b: ca.SX(-1)})

    def twist(self, terms: Mapping[Motion, Expression]) -> None:
        """Say that motions act on one another by ``sum coefficient * angle``, such as the twist of a spring.

        `pair` says so itself. Integrators that hold every state to a share of itself are given such differences
        in place of angles, which may grow without bound while the difference stays small.
        """
        self.twists.append({m.index: ca.SX(c) for m, c in terms.items()})

    def tie(
        self, terms: Mapping[Motion, Expression], efficiency: tuple[Motion, Motion, Expression] | None = None
    ) -> None:
        """Tie motions by ``sum coefficient * angle = 0``, eliminated exactly.

        Args:
            terms: coefficient of each motion.
            efficiency: (input, output, eta): of the power that enters at ``input`` the share ``eta`` arrives at
                ``output``.
        """
        lossy = None if efficiency is None else (efficiency[0].index, efficiency[1].index, efficiency[2])
        self.ties.append(Tie(self._owner, {m.index: ca.SX(c) for m, c in terms.items()}, lossy))

    def friction(
        self,
        terms: Mapping[Motion, Expression],
        *,
        forward: Any,
        backward: Any,
        static_forward: Expression,
        static_backward: Expression,
    ) -> None:
        """Dry friction with exact stick on the relative velocity ``sum coefficient * speed``.

        Args:
            terms: coefficient of each motion, for example ``{a: 1, b: -1}``.
            forward: function of the relative velocity giving the friction's magnitude (N or N.m) while it is positive.
            backward: the same while it is negative.
            static_forward: what a stuck joint withstands before it slips forward (N or N.m).
            static_backward: the same before it slips backward.
        """
        velocity = sum(c * m.speed for m, c in terms.items())
        entry = Friction(
            self._owner,
            {m.index: ca.SX(c) for m, c in terms.items()},
            forward(velocity),
            backward(velocity),
            static_forward,
            static_backward,
            velocity,
        )
        self.frictions.append(entry)

    def prescribe(
        self, motion: Motion, angle: Expression, speed: Expression | None = None, acceleration: Expression | None = None
    ) -> Expression:
        """Impose a motion.

        Args:
            motion: what is moved.
            angle: its angle or position over time.
            speed: time derivative of ``angle``; with ``acceleration`` left out too, both are derived, which needs an
                ``angle`` that depends on time, parameters and time events only.
            acceleration: time derivative of ``speed``.

        Returns:
            The effort that imposes it (N.m or N), positive where it accelerates the motion in the positive sense.
        """
        reaction = ca.SX.sym(self._name("reaction"))
        self.prescriptions.append(Prescription(self._owner, motion.index, angle, speed, acceleration, reaction))
        return reaction

    # -- switching --------------------------------------------------------------------------------------------------

    def switch(self, name: str, labels: tuple[str, str, str], guards: Any) -> Expression:
        """A mode in {-1, 0, +1}, changed at located instants.

        Args:
            name: local name.
            labels: what -1, 0 and +1 are called.
            guards: function of the mode symbol giving (above, below). In mode 0, ``above > 0`` leads to +1 and
                ``below > 0`` to -1; in modes +1 and -1, ``above > 0`` leads back to 0.

        Returns:
            The mode's symbol.
        """
        mode = ca.SX.sym(self._name(name))
        above, below = guards(mode)
        self.switches.append(Switch(self._name(name), mode, ca.SX(above), ca.SX(below), labels))
        return mode

    def time_event(self, name: str, following: Any) -> Expression:
        """A counter 0, 1, 2, ... that rises at given instants, which the integration hits exactly.

        Args:
            name: local name.
            following: function of the counter giving the instant (s) at which it rises next; ``inf`` for never.
        """
        count = ca.SX.sym(self._name(name))
        self.time_events.append(TimeEvent(self._name(name), count, ca.SX(following(count))))
        return count

    # -- signals ----------------------------------------------------------------------------------------------------

    def output(self, port: Port | str, value: Expression, unit: str = "", doc: str = "") -> None:
        """Give an output port its value, or publish a further signal under a local name with a unit."""
        local = port if isinstance(port, str) else port.name
        if isinstance(port, Port):
            unit, doc = port.unit, port.doc
        name = self._name(local)
        if name in self.outputs:
            raise StructureError(f"'{name}' is given a value twice")
        self.outputs[name] = Output(name, unit, ca.SX(value), self._physical, doc)

    def rounded(self, value: Expression) -> Expression:
        """The whole number below a reading, such as an encoder's count.

        Beside recordings (``smooth_readings``) it is the straight line through these steps, half a step below the
        value. The steps count as noise there. In a loop they make runs that begin a hair apart differ at random, which
        no recording repeats, and no fit would end.
        """
        if not self.smooth_readings:
            return ca.floor(value)
        self.readings.append(self._owner)
        return value - 0.5

    def state(self, name: str, unit: str, *, start: Expression = 0.0, doc: str = "") -> Expression:
        """A continuous state; give its derivative with `derivative`."""
        symbol = ca.SX.sym(self._name(name))
        self.states.append(State(self._name(name), unit, symbol, ca.SX(start), doc=doc))
        return symbol

    def derivative(self, state: Expression, value: Expression) -> None:
        """Give the time derivative of a state made by `state`."""
        for entry in self.states:
            if entry.symbol is state:
                entry.derivative = ca.SX(value)
                return
        raise StructureError(f"{self._owner}: derivative of something that is not a state")

    def clock(self, period: float, offset: float = 0.0) -> Clock:
        """Sample instants; blocks with equal period and offset share one clock."""
        for clock in self.clocks:
            if clock.period == period and clock.offset == offset:
                return clock
        self.clocks.append(Clock(float(period), float(offset), len(self.clocks)))
        return self.clocks[-1]

    def memory(self, name: str, unit: str, clock: Clock, *, start: Expression = 0.0, held: bool = False) -> Expression:
        """A value held between instants of ``clock``; give its new value with `update`."""
        symbol = ca.SX.sym(self._name(name))
        self.memories.append(Memory(self._name(name), unit, symbol, ca.SX(start), clock, held))
        return symbol

    def update(self, memory: Expression, value: Expression) -> None:
        """Give the value a memory takes at its clock's instants."""
        for entry in self.memories:
            if entry.symbol is memory:
                entry.update = ca.SX(value)
                return
        raise StructureError(f"{self._owner}: update of something that is not a memory")

    def line(
        self, unit: str, clock: Clock, value: Expression, stages: Sequence[int], *, start: Expression = 0.0
    ) -> dict[int, Expression]:
        """A delay line: at each instant of ``clock`` every value moves on by a stage, and the signal enters stage 1.

        Only the stages that are read are memories of the model; the rest are numbers in a ring of the runtime, so the
        length of a line costs neither symbols nor time.

        Args:
            unit: of the signal.
            clock: when it moves on.
            value: the signal.
            stages: which stages are read, from 1.
            start: what all stages hold before the beginning.

        Returns:
            The symbol of each stage that is read: what the signal was at the last instant but ``stage - 1``.
        """
        made: dict[int, Expression] = {}
        for stage in stages:
            made[stage] = self.memory(f"line{stage}", unit, clock, start=start)
        if 1 in made:
            self.update(made[1], value)
        ringed = tuple(stage for stage in stages if stage > 1)
        if ringed:
            returned = [ca.SX.sym(self._name(f"line{stage}.returned")) for stage in ringed]
            for stage, symbol in zip(ringed, returned, strict=True):
                self.update(made[stage], symbol)
            memories = [memory for memory in self.memories if any(memory.symbol is made[stage] for stage in ringed)]
            size = max(ringed) - 1
            entry = Line(
                self._name("line"),
                clock,
                ca.SX(value),
                ca.SX(start),
                size,
                tuple(s - 1 for s in ringed),
                memories,
                returned,
            )
            self.lines.append(entry)
        return made

    def external(
        self,
        name: str,
        clock: Clock,
        inputs: Sequence[Expression],
        outputs: Sequence[tuple[str, str]],
        make: Callable[[], Any],
        identity: str = "",
    ) -> list[Expression]:
        """A Python function called at the instants of ``clock``; its answers are held until the next instant.

        It has no derivative and no C form, so tangents and exports refuse a model that has one.

        Args:
            name: local name, for messages.
            clock: when it is called.
            inputs: the values it is called with, SI units.
            outputs: local name and unit of each value it returns; zero before the first instant.
            make: called at the start of each run; returns the function of that run, ``f(time, inputs)``, which is given
                the instant (s) and an array, and returns one number or as many as there are outputs.
            identity: a text that changes when the function changes, for stored results.

        Returns:
            The held values, one symbol per output.
        """
        held, returned = [], []
        for local, unit in outputs:
            held.append(self.memory(local, unit, clock, held=True))
            returned.append(ca.SX.sym(self._name(f"{local}.returned")))
            self.update(held[-1], returned[-1])
        column = ca.vertcat(*[ca.SX(value) for value in inputs])
        self.externals.append(External(self._name(name), clock, column, returned, make, identity))
        return held

    def table(self, name: str, unit: str, times: Sequence[float], values: Sequence[float], hold: str) -> Expression:
        """A recorded signal as an expression; ``hold`` is ``zero_order`` or ``linear``; ends are held."""
        symbol = ca.SX.sym(self._name(name))
        self.tables.append(Table(self._name(name), unit, symbol, times, values, hold))
        return symbol

    # -- energy -----------------------------------------------------------------------------------------------------

    def store(self, energy: Expression) -> None:
        """Count an energy (J) as stored, besides the kinetic energy, which the net counts itself."""
        self.stored += energy

    def dissipate(self, power: Expression) -> None:
        """Count a power (W) as lost."""
        self.dissipated += power

    def supply(self, power: Expression) -> None:
        """Count a power (W) as entering from outside."""
        self.supplied += power
