"""From a system to a model: join flanges, stamp, resolve signals, name everything, freeze."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from engine.alike import Assembled, Looked, form, keep, known
from engine.block import Block
from engine.casadi_lock import one_at_a_time
from engine.errors import ConnectionProblem, FlexarmError, StructureError, nearest
from engine.mechanics import Mechanics
from engine.model import (
    FRICTION,
    SWITCH,
    TIME,
    DelayLine,
    Equations,
    External,
    Mode,
    Model,
    SampleClock,
    TableData,
    Variable,
    parameter_variables,
)
from engine.names import check_text
from engine.net import Net
from engine.parameters import Parameters
from engine.ports import MOTION, Expression
from engine.relations import Relation
from engine.stamps import Input, ModelParameter, Motion
from engine.symbol_misuse import explained
from engine.system import System, bypass
from engine.wiring import Wiring, hash_symbol, symbolic


@one_at_a_time
def build(
    system: System,
    inputs: list[str] | None = None,
    outputs: list[str] | None = None,
    *,
    energy: bool = False,
    variant: bool = False,
    smooth_readings: bool = False,
) -> Model:
    """The model of a system.

    Args:
        system: blocks and connections.
        inputs: signal inputs to drive from outside; each replaces the connection that fed it.
        outputs: signals to output; all of them if None.
        energy: add states and outputs of the energy balance: ``energy.stored``, ``energy.supplied``,
            ``energy.dissipated`` and ``energy.residual`` (J). The residual is zero except for the integration error.
        variant: one of many systems that are alike: what is worked out from equations is shared by those that differ in
            the values of parameters alone. For as long as laws stay what they are: see `engine.alike`.
        smooth_readings: encoders tell a motion by the straight line through their steps: see `Net.rounded`.

    Raises:
        FlexarmError: a wrong connection, an algebraic loop, a massless motion, a closed loop of ties or frictions.
    """
    for what, text in (
        ("name", system.name),
        ("description", system.description),
        *(("block", b) for b in system.blocks),
    ):
        check_text(f"the system's {what}" if what != "block" else f"the block name {text!r}", text)
    driven = list(inputs or [])
    key = form(system, driven, outputs, energy, smooth_readings) if variant else None
    if key is not None and (found := known(key, system)) is not None:
        return found
    made = _Assembly(system, driven, outputs, energy, smooth_readings)
    model = made.model()
    if key is not None and not model.externals:  # what Python does may depend on any value
        decisive = {name: made.net.parameters[name].value for name in made.looked.parameters}
        keep(key, Assembled(model, tuple(made.system.blocks), made.looked, decisive, made.mechanics.sound))
    return model


class _Assembly:
    def __init__(
        self, system: System, inputs: list[str], outputs: list[str] | None, energy: bool, smooth_readings: bool
    ) -> None:
        self.system = bypass(system, inputs, outputs or ())[0] if inputs else system
        self.free_names, self.wanted, self.energy = inputs, outputs, energy
        self.net = Net(smooth_readings)
        self.parameters = Parameters(self.system)
        self.net.parameters = self.parameters.entries
        self.looked = Looked()
        self.flanges = self._join()
        self._stamp()
        self.p = self._stack([p.symbol for p in self.net.parameters.values()])
        self.values = np.array([p.value for p in self.net.parameters.values()])
        self.free = {name: self.net.inputs[name].symbol for name in inputs}
        self.wiring = Wiring(self.system, self.net, self.flanges, self.free)
        self.mechanics = Mechanics(
            self.system, self.net, self.wiring, self.flanges, self.p, self.values, self.looked.note
        )

    @staticmethod
    def _stack(symbols: list[Expression]) -> Expression:
        return ca.densify(ca.vertcat(*symbols)) if symbols else ca.SX(0, 1)

    # -- stamping ---------------------------------------------------------------------------------------------------

    def _join(self) -> dict[tuple[str, str], Motion]:
        """Merge connected flanges into motions, checking every connection."""
        system = self.system
        parent: dict[tuple[str, str], tuple[str, str]] = {
            (name, port.name): (name, port.name)
            for name, block in system.blocks.items()
            for port in block.ports.values()
            if port.role == "flange"
        }

        def root(key: tuple[str, str]) -> tuple[str, str]:
            while parent[key] != key:
                key = parent[key]
            return key

        fed: dict[str, str] = {}
        for connection in system.connections:
            try:
                ends = [(end, *system.split(end)) for end in connection.ends]
                flanges = [(b, p) for end, b, p in ends if system.is_flange(end)]
                if flanges and len(flanges) < len(ends):
                    signal = next(end for end, _, _ in ends if not system.is_flange(end))
                    raise ConnectionProblem(
                        f"flange '{'.'.join(flanges[0])}' is connected to signal '{signal}'",
                        remedy="connect flanges with flanges; a sensor or a flange's .angle or .speed gives a signal",
                    )
                if len(ends) < 2:
                    raise ConnectionProblem("a connection needs at least two ends")
                for b, p in flanges[1:]:
                    kind, first = system.blocks[b].ports[p].kind, flanges[0]
                    if kind != system.blocks[first[0]].ports[first[1]].kind:
                        raise ConnectionProblem(
                            f"'{b}.{p}' is {kind} but '{'.'.join(first)}' is not",
                            remedy="put a Pulley, RackAndPinion or Screw between, which turn rotation into translation",
                        )
                    parent[root((b, p))] = root(first)
                if not flanges:
                    self._check_signal(connection.ends, fed)
            except FlexarmError as error:
                raise error.at(connection.where) from None
        members: dict[tuple[str, str], list[tuple[str, str]]] = {}
        for key in parent:
            members.setdefault(root(key), []).append(key)
        motions: dict[tuple[str, str], Motion] = {}
        for keys in members.values():
            block, port = keys[0]
            motion = self.net.new_motion(f"{block}.{port}", system.blocks[block].ports[port].kind)
            motions.update(dict.fromkeys(keys, motion))
        return motions

    def _check_signal(self, ends: tuple[str, ...], fed: dict[str, str]) -> None:
        system = self.system
        sources = [end for end in ends if not system.is_input(end)]
        if len(sources) > 1:
            raise ConnectionProblem(
                f"two sources on one signal: '{sources[0]}' and '{sources[1]}'", remedy="add them with a Sum block"
            )
        if not sources:
            block, port = system.split(ends[-1])
            outputs = [p.name for p in system.blocks[block].ports.values() if p.role == "output"]
            raise ConnectionProblem(f"nothing feeds {' and '.join(ends)}", remedy=f"{block}: {nearest(port, outputs)}")
        for end in ends:
            if system.is_input(end):
                if end in fed:
                    raise ConnectionProblem(
                        f"two sources on one signal: '{end}' is fed by '{fed[end]}' and by '{sources[0]}'",
                        remedy="add them with a Sum block, or remove one connection",
                    )
                fed[end] = sources[0]

    def _stamp(self) -> None:
        for name, block in self.system.blocks.items():
            bound: dict[str, Any] = dict(block.options and {o: block.values[o] for o in block.options})
            for declared in block.parameters.values():
                bound[declared.name] = self.parameters.of(name, declared.name)
            for attribute, port_name in block._port_attributes.items():
                port = block.ports[port_name]
                if port.role == "flange":
                    bound[attribute] = self.flanges[name, port_name]
                elif port.role == "input":
                    endpoint = f"{name}.{port_name}"
                    self.net.inputs[endpoint] = Input(endpoint, port, ca.SX.sym(endpoint))
                    bound[attribute] = self.net.inputs[endpoint].symbol
            try:
                self.net.begin(name, physical=block.is_physical())
                asked = self.looked.at(name, block)
                with explained(name, type(block).__name__):
                    asked.bind(bound).stamp(self.net)
                self._relate(asked, bound)
            except FlexarmError as error:
                place = self.system.place(name)
                raise (error.at(place) if place else error) from None
            except ArithmeticError as error:
                said = f"the values of '{name}' are too large or too small to compute with: {error.args[-1]}"
                raise StructureError(said, self.system.place(name), "check their units") from error

    def _relate(self, block: Block, bound: Mapping[str, Any]) -> None:
        """Note the block's relations between parameters of the model."""
        for relation in block.relations():
            first, second = bound[relation.first], bound[relation.second]
            both = isinstance(first, ca.SX) and isinstance(second, ca.SX) and first is not second
            # What is calculated from other parameters has no name of its own that an importer could set.
            if both and first.is_symbolic() and second.is_symbolic():
                self.net.relations.append(replace(relation, first=first.name(), second=second.name()))

    # -- the model --------------------------------------------------------------------------------------------------

    def _final(self, expression: Expression) -> Expression:
        return self.mechanics.in_coordinates(self.wiring.resolve(expression))

    def model(self) -> Model:
        """The frozen model."""
        net, mechanics = self.net, self.mechanics
        acceleration = mechanics.solved()
        derivatives = []
        for state in net.states:
            if state.derivative is None:
                raise StructureError(f"state '{state.name}' has no derivative")
            derivatives.append(self._final(state.derivative))
        stored = self._final(net.stored) + mechanics.kinetic_energy
        books: list[tuple[Variable, Expression]] = []
        accounts: list[Expression] = []
        if self.energy:
            accounts = [ca.SX.sym("energy.supplied"), ca.SX.sym("energy.dissipated")]
            derivatives += [self._final(net.supplied), self._final(net.dissipated) + mechanics.lost]
            books = self._books(stored, accounts)
        n = mechanics.count
        fire = ca.SX.sym("fire", len(net.clocks))
        updates, calls, entering = self.wiring.updates(fire)
        guards = [mechanics.guards[c] for c in mechanics.friction_modes]
        guards += [self._final(ca.vertcat(entry.above, entry.below)) for entry in net.switches]
        outputs = [*self._outputs(), *books]
        equations = Equations(
            t=net.time,
            x=self._stack([mechanics.q, mechanics.v, *[s.symbol for s in net.states], *accounts]),
            u=self._stack([*self.free.values(), *[t.symbol for t in net.tables]]),
            d=self._stack([entry.symbol for entry in net.memories]),
            m=self._stack(
                [
                    *mechanics.friction_modes.values(),
                    *[entry.mode for entry in net.switches],
                    *[entry.count for entry in net.time_events],
                ]
            ),
            p=self.p,
            fire=self._stack(
                [
                    fire,
                    *[s for entry in net.externals for s in entry.returned],
                    *[s for line in net.lines for s in line.returned],
                ]
            ),
            derivative=self._stack([mechanics.v, acceleration, *derivatives]),
            guards=self._stack(guards),
            outputs=self._stack([expression for _, expression in outputs]),
            update=self._stack([mechanics.in_coordinates(e) for e in updates]),
            following=self._stack([entry.following for entry in net.time_events]),
            start=self._stack([ca.SX.zeros(2 * n, 1), *[s.start for s in net.states], *[ca.SX(0) for _ in accounts]]),
            memory_start=self._stack([entry.start for entry in net.memories]),
            transform=ca.densify(mechanics.T[:, mechanics.free]),
            twists=mechanics.twists(),
            imposed=mechanics.imposed_motion(),
            external=self._stack([mechanics.in_coordinates(given) for _, given in calls]),
            entering=self._stack([mechanics.in_coordinates(value) for value in entering]),
            line_start=self._stack([line.start for line in net.lines]),
            stored=stored,
        )
        equations, parameters = self._used(equations)
        inputs = tuple(Variable(name, self.wiring.unit(name), net.inputs[name].port.doc) for name in self.free_names)
        return Model(
            name=self.system.name,
            description=self.system.description,
            states=self._state_names(),
            coordinates=n,
            inputs=inputs,
            tables=tuple(TableData(t.name, t.unit, tuple(t.times), tuple(t.values), t.hold) for t in net.tables),
            outputs=tuple(variable for variable, _ in outputs),
            parameters=parameter_variables(parameters),
            memories=tuple(Variable(entry.name, entry.unit) for entry in net.memories),
            clocks=tuple(SampleClock(clock.period, clock.offset) for clock in net.clocks),
            memory_clock=tuple(entry.clock.index for entry in net.memories),
            modes=self._modes(),
            equations=equations,
            motions=MappingProxyType({f"{b}.{port}": motion.index for (b, port), motion in self.flanges.items()}),
            initial=MappingProxyType(dict(self.system.initial)),
            relations=self._relations(parameters),
            externals=self._externals([(entry.name, given.numel()) for entry, given in calls]),
            lines=self._lines(),
            readings=tuple(net.readings),
            exposed=MappingProxyType(dict(self.system.exposed)),
        )

    def _relations(self, parameters: list[ModelParameter]) -> tuple[tuple[int, Relation, int], ...]:
        place = {entry.name: k for k, entry in enumerate(parameters)}
        return tuple(
            (place[entry.first], entry, place[entry.second])
            for entry in self.net.relations
            if entry.first in place and entry.second in place
        )

    def _lines(self) -> tuple[DelayLine, ...]:
        """The delay lines, one after the other in the ring's storage."""
        made, first = [], 0
        for line in self.net.lines:
            places = [next(i for i, entry in enumerate(self.net.memories) if entry is m) for m in line.memories]
            made.append(DelayLine(line.name, line.clock.index, first, line.size, line.stages, tuple(places)))
            first += line.size
        return tuple(made)

    def _externals(self, calls: list[tuple[str, int]]) -> tuple[External, ...]:
        """The external functions in the order of their calls, given each one's name and count of inputs."""
        entries = {entry.name: entry for entry in self.net.externals}
        counts = [len(entry.returned) for entry in self.net.externals]
        outputs = {name: sum(counts[:i]) for i, name in enumerate(entries)}
        made: list[External] = []
        for name, inputs in calls:
            entry, first = entries[name], sum(external.inputs for external in made)
            count, clock = len(entry.returned), entry.clock.index
            made.append(External(name, clock, inputs, count, first, outputs[name], entry.make, entry.identity))
        return tuple(made)

    def _used(self, equations: Equations) -> tuple[Equations, list[ModelParameter]]:
        """The equations without the parameters that no equation uses: tuning those would have no effect.

        The stored energy keeps their values: it may count what moves nothing, such as the weight of what stands still.
        """
        skip = ("t", "x", "u", "d", "m", "p", "fire", "stored")
        rows = [getattr(equations, f.name) for f in fields(equations) if f.name not in skip]
        read = {hash_symbol(symbol) for row in rows for symbol in ca.symvar(symbolic(row))}
        kept = [entry for entry in self.net.parameters.values() if hash_symbol(entry.symbol) in read]
        others = [entry for entry in self.net.parameters.values() if hash_symbol(entry.symbol) not in read]
        self.looked.parameters.update(entry.name for entry in others)
        symbols, values = self._stack([entry.symbol for entry in others]), ca.DM([entry.value for entry in others])
        stored = ca.substitute(equations.stored, symbols, values) if others else equations.stored
        return replace(equations, p=self._stack([entry.symbol for entry in kept]), stored=stored), kept

    def _books(self, stored: Expression, accounts: list[Expression]) -> list[tuple[Variable, Expression]]:
        """Outputs of the energy balance."""
        supplied, dissipated = accounts
        rows = (
            ("stored", stored, "kinetic and potential energy"),
            ("supplied", supplied, "energy that entered from outside"),
            ("dissipated", dissipated, "energy lost"),
            (
                "residual",
                stored + dissipated - supplied,
                "what the energy balance leaves over, plus the stored energy at start",
            ),
        )
        return [(Variable(f"energy.{name}", "J", doc), expression) for name, expression, doc in rows]

    def _outputs(self) -> list[tuple[Variable, Expression]]:
        if self.wanted is None:
            names = [name for name in self.wiring.names() if name not in self.net.inputs]
        else:
            names = list(dict.fromkeys(self.wanted))
        rows = []
        for name in names:
            source = self.wiring.signal(name)
            rows.append((Variable(name, source.unit, source.doc), self._final(source.expression)))
        return rows

    def _state_names(self) -> tuple[Variable, ...]:
        mechanics = self.mechanics
        names = [(mechanics.coordinates.names[c], mechanics.coordinates.kinds[c]) for c in mechanics.free]
        rows = [Variable(f"{name}.{MOTION[kind][0][0]}", MOTION[kind][0][1]) for name, kind in names]
        rows += [Variable(f"{name}.{MOTION[kind][1][0]}", MOTION[kind][1][1]) for name, kind in names]
        rows += [Variable(state.name, state.unit, state.doc) for state in self.net.states]
        if self.energy:
            rows += [Variable("energy.supplied", "J"), Variable("energy.dissipated", "J")]
        return tuple(rows)

    def _modes(self) -> tuple[Mode, ...]:
        rows = []
        for coordinate in self.mechanics.friction_modes:
            owners = [entry.owner for entry, _ in self.mechanics.coordinates.frictions[coordinate]]
            labels = ("sliding backward", "stuck", "sliding forward")
            rows.append(Mode(" + ".join(owners), FRICTION, labels, self.mechanics.free.index(coordinate)))
        rows += [Mode(entry.name, SWITCH, entry.labels) for entry in self.net.switches]
        rows += [Mode(entry.name, TIME) for entry in self.net.time_events]
        return tuple(rows)
