"""Resolve signals: the expression that feeds each input, algebraic loops, and the order within a sample instant."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from engine import trampoline
from engine.errors import ConnectionProblem, FlexarmError, StructureError, nearest
from engine.net import Net
from engine.ports import MOTION, Expression
from engine.quantity import compatible
from engine.stamps import External, Memory, Motion
from engine.system import System
from engine.trampoline import Step


@dataclass
class Source:
    """What feeds an input."""

    name: str
    expression: Expression
    unit: str
    physical: bool
    doc: str = ""


class Wiring:
    """Signals of a stamped net.

    Args:
        system: blocks and connections.
        net: what they stamped.
        flanges: (block, port) -> motion.
        free: inputs driven from outside -> their symbol.
    """

    def __init__(
        self, system: System, net: Net, flanges: dict[tuple[str, str], Motion], free: dict[str, Expression]
    ) -> None:
        self.system, self.net, self.flanges, self.free = system, net, flanges, free
        self._fed = system.sources()
        self._inputs_of: dict[str, list[str]] = {}
        for name in net.inputs:
            self._inputs_of.setdefault(system.split(name)[0], []).append(name)
        self._units: dict[str, str] = {}
        self.sources: dict[str, Source | None] = {name: self._source(name) for name in net.inputs}
        self._resolved: dict[str, Expression] = {}
        self._active: list[str] = []
        self._acceleration: dict[int, Expression] = {}
        self._solve: Callable[[], list[Expression]] | None = None
        self._input_of = {hash_symbol(entry.symbol): name for name, entry in net.inputs.items()}
        self._reaction_of = {hash_symbol(e.reaction): i for i, e in enumerate(net.prescriptions)}
        self._reactions: Callable[[], list[Expression]] | None = None
        self._motion_of = {hash_symbol(m.acceleration): m for m in net.motions}
        self._memory_of = {hash_symbol(entry.symbol): entry for entry in net.memories}
        self._check_units()
        self._check_carried()

    # -- naming -----------------------------------------------------------------------------------------------------

    def signal(self, name: str) -> Source:
        """The signal of a given name: a block's output, the motion of a flange, or an input's own value.

        Raises:
            ConnectionProblem: no such signal.
        """
        if name in self.net.outputs:
            output = self.net.outputs[name]
            return Source(name, output.expression, self.unit(name), output.physical, output.doc)
        seen = self.system.observable(name)
        if seen is not None:
            block, port, order = seen
            motion = self.flanges[block, port]
            symbol = (motion.angle, motion.speed, motion.acceleration)[order]
            return Source(name, symbol, MOTION[motion.kind][order][1], True)
        if name in self.net.inputs:
            return Source(name, self.net.inputs[name].symbol, self.unit(name), False)
        raise ConnectionProblem(f"'{name}' names no signal", remedy=nearest(name, self.names()), signal=name)

    def names(self) -> list[str]:
        """Every signal that can be recorded."""
        motions = [
            f"{block}.{port}.{quantity}"
            for (block, port), motion in self.flanges.items()
            for quantity, _ in MOTION[motion.kind][:3]
        ]
        return [*self.net.outputs, *motions, *self.net.inputs]

    def _source(self, name: str) -> Source | None:
        if name in self.free:
            return None
        found = self._fed.get(name)
        if found is None:
            port = self.net.inputs[name].port
            if port.default is None:
                block = self.system.split(name)[0]
                kind = "" if port.unit in ("1", "*") else f" in {port.unit}"
                raise ConnectionProblem(
                    f"'{name}' is not connected ({port.doc})",
                    self.system.place(block),
                    f"connect a signal{kind} to it, or declare it as an input of the analysis",
                    signal=name,
                )
            return None
        end, connection = found
        try:
            return self.signal(end)
        except FlexarmError as error:
            raise error.at(connection.where) from None

    def unit(self, name: str) -> str:
        """Unit of a signal; one that fits any takes the unit of what feeds the same block."""
        path: list[str] = []
        at, unit = name, ""
        while not unit:
            if at in self._units or at in path:
                unit = self._units.get(at, "*")
                break
            path.append(at)
            unit, at = self._unit_or_next(at)
        self._units.update(dict.fromkeys(path, unit))
        return unit

    def _unit_or_next(self, name: str) -> tuple[str, str]:
        """The unit of a signal, or else the name of the signal that has the same."""
        if name in self.net.outputs:
            unit = self.net.outputs[name].unit
            block, port = self.system.split(name)
            inputs = self._inputs_of.get(block, []) if unit == "*" else []
            own = self.system.blocks[block].ports.get(port)
            if own is not None and own.like == "*":
                return unit, ""
            if inputs and own is not None and own.like:
                return "", f"{block}.{own.like}"
            like = [other for other in inputs if self.net.inputs[other].port.unit == "*"]
            return ("", like[0]) if like else (unit or "*", "")
        if name not in self.net.inputs:
            return self.signal(name).unit, ""
        unit = self.net.inputs[name].port.unit
        if unit != "*":
            return unit, ""
        if name in self.free:
            return self._unit_downstream(name), ""
        found = self._fed.get(name)
        return ("", found[0]) if found else ("*", "")

    def _unit_downstream(self, name: str) -> str:
        """Unit of a freed input that fits any: that of the inputs its block feeds with a signal that fits any."""
        waiting, seen = [name], {name}
        while waiting:
            block = self.system.split(waiting.pop())[0]
            further = []
            for target in self._targets.get(block, []):
                if target in seen:
                    continue
                seen.add(target)
                unit = self.net.inputs[target].port.unit
                if unit != "*":
                    return unit
                further.append(target)
            waiting += reversed(further)
        return "*"

    @functools.cached_property
    def _targets(self) -> dict[str, list[str]]:
        """Inputs that a block feeds with a signal that fits any unit."""
        made: dict[str, list[str]] = {}
        for target in self.net.inputs:
            found = self._fed.get(target) if target not in self.free else None
            own = self.net.outputs.get(found[0]) if found is not None else None
            if found is not None and own is not None and own.unit == "*":
                made.setdefault(self.system.split(found[0])[0], []).append(target)
        return made

    def _check_units(self) -> None:
        for name, source in self.sources.items():
            wanted = self.net.inputs[name].port.unit
            if source is not None and not compatible(source.unit, wanted):
                found = self._fed.get(name)
                raise ConnectionProblem(
                    f"'{source.name}' is in {source.unit} but '{name}' takes {wanted}",
                    found[1].where if found else None,
                    "connect a signal of the right unit, or put a Gain or a sensor between",
                    signal=name,
                )
        for name, entry in self.net.inputs.items():
            if not entry.port.like or name in self.free:
                continue
            other = f"{self.system.split(name)[0]}.{entry.port.like}"
            mine, wanted = self.unit(name), self.unit(other)
            if other not in self.free and not compatible(mine, wanted):
                found = self._fed.get(name)
                raise ConnectionProblem(
                    f"'{name}' is fed in {mine or '1'}, but '{other}', which it is compared with, in {wanted or '1'}",
                    found[1].where if found else None,
                    "connect a signal of the same kind, or put a Gain with `unit:` between",
                    signal=name,
                )

    def _check_carried(self) -> None:
        """Inputs of which a design says what they carry must not be fed by what it says of another one."""
        for name, source in self.sources.items():
            wanted = self.net.inputs[name].port.carries
            if source is None or not wanted:
                continue
            block = self.system.split(name)[0]
            role = self.net.inputs[name].port.role
            ports = [port for port in self.system.blocks[block].ports.values() if port.role == role and port.carries]
            seen = self._called(source.name)
            other = next((port for port in ports if port.carries in seen), None)
            if wanted not in seen and other is not None:
                fed = f"{source.name}, which is {other.carries}" if source.name != other.carries else source.name
                raise ConnectionProblem(
                    f"by the design '{name}' takes {wanted}, but it is fed by {fed}",
                    self._fed[name][1].where,
                    f"{other.carries} belongs to '{block}.{other.name}': are the wires swapped?",
                    signal=name,
                )

    def _called(self, name: str) -> set[str]:
        """Every name of what a signal tells: that of each flange which shares a motion, through sensors and filters."""
        found: set[str] = set()
        while name not in found:
            found.add(name)
            seen = self.system.observable(name)
            if seen is not None:
                return found | self._shared(self.flanges[seen[:2]], seen[2])
            block, port = self.system.split(name)
            ports = self.system.blocks[block].ports
            if port in ports and ports[port].carries:
                return found | {ports[port].carries}
            flanges = [p.name for p in ports.values() if p.role == "flange"]
            inputs = self._inputs_of.get(block, [])
            if len(flanges) == 1 and not inputs:
                motion, unit = self.flanges[block, flanges[0]], self.unit(name)
                orders = [k for k, (_, own) in enumerate(MOTION[motion.kind][:3]) if own == unit]
                return found.union(*(self._shared(motion, order) for order in orders))
            fed = self._fed.get(inputs[0]) if len(inputs) == 1 and not flanges else None
            if fed is None or self.unit(fed[0]) != self.unit(name):
                return found
            name = fed[0]
        return found

    def _shared(self, motion: Motion, order: int) -> set[str]:
        quantity = MOTION[motion.kind][order][0]
        return {f"{block}.{port}.{quantity}" for (block, port), other in self.flanges.items() if other is motion}

    # -- continuous resolution --------------------------------------------------------------------------------------

    def solve_accelerations(
        self, solve: Callable[[], list[Expression]], reactions: Callable[[], list[Expression]]
    ) -> None:
        """Say how accelerations are found, one expression per motion, and then the reactions of imposed motions."""
        self._solve, self._reactions = solve, reactions

    def resolve(self, expression: Expression) -> Expression:
        """The expression without inputs or accelerations: only states, memories, modes, parameters, time, motions.

        Raises:
            StructureError: an algebraic loop, with every signal in order.
        """
        return trampoline.run(self._resolution(expression))

    def _resolution(self, expression: Expression) -> Step[Expression]:
        old, new = [], []
        expression = symbolic(expression)
        for symbol in ca.symvar(expression):
            key = hash_symbol(symbol)
            if key in self._input_of:
                old.append(symbol)
                new.append((yield self._input(self._input_of[key])))
            elif key in self._motion_of:
                old.append(symbol)
                new.append(self.accelerations()[self._motion_of[key].index])
            elif key in self._reaction_of and self._reactions is not None:
                self.accelerations()
                old.append(symbol)
                new.append(self._reactions()[self._reaction_of[key]])
        return _replace(expression, old, new)

    def _input(self, name: str) -> Step[Expression]:
        if name in self.free:
            return self.free[name]
        source = self.sources[name]
        if source is None:
            return ca.SX(self.net.inputs[name].port.default or 0.0)
        if name not in self._resolved:
            with _Step(self, name):
                self._resolved[name] = yield self._resolution(source.expression)
        return self._resolved[name]

    def accelerations(self) -> list[Expression]:
        """Acceleration of each motion, in coordinates."""
        if not self._acceleration:
            if self._solve is None:
                raise StructureError("accelerations are not available here")
            with _Step(self, "the accelerations of the mechanism"):
                self._acceleration = dict(enumerate(self._solve()))
        return [self._acceleration[i] for i in range(len(self._acceleration))]

    # -- sample instants --------------------------------------------------------------------------------------------

    def updates(self, fire: Expression) -> tuple[list[Expression], list[tuple[External, Expression]], list[Expression]]:
        """What happens at an instant at which the clocks flagged in ``fire`` tick.

        Plant signals are sampled with the memories as they were before the instant; signals between controllers carry
        the new held values, in the order of the data flow.

        Returns:
            Each memory after the instant, the external functions in the order of their calls with what each is given,
            and what enters each delay line. They may depend on what the functions called before return.
        """
        held: dict[str, Expression] = {}
        signals: dict[str, Expression] = {}
        calls: dict[str, tuple[External, Expression]] = {}
        external_of = {hash_symbol(symbol): entry for entry in self.net.externals for symbol in entry.returned}

        def new(memory: Memory) -> Step[Expression]:
            if memory.name not in held:
                update = memory.law
                external = external_of.get(hash_symbol(update)) if update.is_symbolic() else None
                with _Step(self, memory.name):
                    if external is not None and external.name not in calls:
                        given = yield at_instant(external.inputs)
                        calls[external.name] = external, given
                    value = yield at_instant(update)
                held[memory.name] = ca.if_else(fire[memory.clock.index], value, memory.symbol)
            return held[memory.name]

        def at_instant(expression: Expression) -> Step[Expression]:
            old, values = [], []
            for symbol in ca.symvar(ca.SX(expression)):
                name = self._input_of.get(hash_symbol(symbol))
                if name is not None:
                    old.append(symbol)
                    values.append((yield signal(name)))
            return _replace(ca.SX(expression), old, values)

        def sampled(expression: Expression) -> Step[Expression]:
            """What a sampled sensor has just taken in."""
            old, values = [], []
            for symbol in ca.symvar(ca.SX(expression)):
                memory = self._memory_of.get(hash_symbol(symbol))
                if memory is not None and memory.held:
                    old.append(memory.symbol)
                    values.append((yield new(memory)))
            return _replace(ca.SX(expression), old, values)

        def signal(name: str) -> Step[Expression]:
            if name not in signals:
                signals[name] = yield found(name)
            return signals[name]

        def found(name: str) -> Step[Expression]:
            source = self.sources[name]
            if name in self.free or source is None:
                return (yield self._input(name))
            if source.physical:
                return (yield self._resolution((yield sampled(source.expression))))
            old, values = [], []
            with _Step(self, name):
                for symbol in ca.symvar(ca.SX(source.expression)):
                    key = hash_symbol(symbol)
                    memory = self._memory_of.get(key)
                    if key in self._input_of:
                        old.append(symbol)
                        values.append((yield signal(self._input_of[key])))
                    elif memory is not None and memory.held:
                        old.append(symbol)
                        values.append((yield new(memory)))
            return _replace(ca.SX(source.expression), old, values)

        for memory in self.net.memories:
            if memory.update is None:
                raise StructureError(f"memory '{memory.name}' is never given a value")
        results = []
        for memory in self.net.memories:
            after = trampoline.run(new(memory) if memory.held else at_instant(memory.law))
            results.append(after if memory.held else ca.if_else(fire[memory.clock.index], after, memory.symbol))
        entering = [trampoline.run(at_instant(line.value)) for line in self.net.lines]
        return results, list(calls.values()), entering


class _Step:
    """One step along the signal graph; meeting the same step again is an algebraic loop."""

    def __init__(self, wiring: Wiring, name: str) -> None:
        self.wiring, self.name = wiring, name

    def __enter__(self) -> None:
        active = self.wiring._active
        if self.name in active:
            loop = [*active[active.index(self.name) :], self.name]
            block = next((self.wiring.system.place(n.rsplit(".", 1)[0]) for n in loop if "." in n), None)
            raise StructureError(
                f"algebraic loop: {' <- '.join(loop)}",
                block,
                "break it with a block that has a state or a memory: a LowPass, an inductance, a sampled controller",
            )
        active.append(self.name)

    def __exit__(self, *_: object) -> None:
        self.wiring._active.pop()


def _replace(expression: Expression, old: list[Expression], new: list[Expression]) -> Expression:
    """Substitute all at once."""
    return ca.substitute(expression, ca.vertcat(*old), ca.densify(ca.vertcat(*new))) if old else expression


def symbolic(expression: Expression | float) -> Expression:
    """An expression as it is, a number as one: to make an expression of an expression copies all of it."""
    return expression if isinstance(expression, ca.SX) else ca.SX(expression)


def hash_symbol(symbol: Expression) -> int:
    """Identity of a scalar CasADi symbol."""
    return int(symbol.element_hash())
