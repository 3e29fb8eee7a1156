"""A system: named blocks and the connections between them, before any equation exists."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

from engine.block import Block
from engine.errors import ConnectionProblem, Where, nearest
from engine.ports import MOTION, Expression


@dataclass(frozen=True)
class Connection:
    """An n-way node: endpoint names such as ``motor.shaft``, and where the user wrote it."""

    ends: tuple[str, ...]
    where: Where = field(default_factory=Where)


@dataclass(frozen=True)
class Formula:
    """A parameter that follows from common parameters.

    Attributes:
        text: as the user wrote it.
        arguments: name of each common parameter -> its coherent SI unit and its value in it.
        law: the parameter, SI, from symbols or numbers by name.
    """

    text: str
    arguments: Mapping[str, tuple[str, float]]
    law: Callable[[Mapping[str, Expression]], Expression] = field(compare=False)


def resolved(name: str, exposed: Mapping[str, str]) -> str:
    """An endpoint or signal name with exposed names replaced by what they stand for."""
    for _ in range(20):
        parts = name.split(".")
        for cut in range(len(parts), 0, -1):
            inner = exposed.get(".".join(parts[:cut]))
            if inner is not None:
                name = ".".join([inner, *parts[cut:]])
                break
        else:
            return name
    return name


@dataclass
class System:
    """Blocks, wiring and initial values.

    Attributes:
        blocks: name to block; a name may hold dots (sub-assemblies).
        connections: the nodes.
        shared: block name -> parameter name, or that of a value of a list such as ``heights[2]`` -> name of the common
            parameter that feeds it, or a formula of several.
        initial: motion or state name -> starting value in SI units.
        places: block name -> where it stands in the user's file.
        name, description: of the whole.
        fixed: common parameter -> what it gives besides and a model is built with: structural parameters and options,
            such as ``table.points``, and starting values.
        exposed: further names of inner ports.
    """

    blocks: dict[str, Block]
    connections: list[Connection]
    shared: dict[str, dict[str, str | Formula]] = field(default_factory=dict)
    initial: dict[str, float] = field(default_factory=dict)
    places: dict[str, Where] = field(default_factory=dict)
    name: str = "model"
    description: str = ""
    fixed: dict[str, tuple[str, ...]] = field(default_factory=dict)
    exposed: dict[str, str] = field(default_factory=dict)

    def loose(self) -> list[str]:
        """Flanges that nothing is connected to: free ends, or a connection that was forgotten."""
        wired = {end for connection in self.connections for end in connection.ends}
        ends = ((f"{name}.{port}", made) for name, block in self.blocks.items() for port, made in block.ports.items())
        return [end for end, made in ends if made.role == "flange" and end not in wired]

    def followed(self, parameter: str) -> list[str]:
        """The common parameters that a block's parameter, such as ``gear.ratio``, follows; none if it is one itself.

        A list follows what any of its values follows.
        """
        block, _, name = parameter.rpartition(".")
        laws = [law for key, law in self.shared.get(block, {}).items() if key == name or key.startswith(f"{name}[")]
        found = [other for law in laws for other in ([law] if isinstance(law, str) else law.arguments)]
        return list(dict.fromkeys(found))

    def fixed_by(self, common: str) -> tuple[str, ...]:
        """What a common parameter gives that a model is built with, in words, of what this system has."""
        starts = [f"the start of '{name}'" for name in self.fixed.get(common, ()) if name in self.initial]
        values = [name for name in self.fixed.get(common, ()) if name not in self.initial]
        return (*(f"'{name}'" for name in values if name.rpartition(".")[0] in self.blocks), *starts)

    def place(self, block: str) -> Where | None:
        """Where a block stands in the user's file."""
        return self.places.get(block)

    def split(self, endpoint: str, where: Where | None = None) -> tuple[str, str]:
        """Block name and port name of an endpoint.

        Raises:
            ConnectionProblem: no block of that name.
        """
        parts = endpoint.split(".")
        for cut in range(len(parts) - 1, 0, -1):
            block = ".".join(parts[:cut])
            if block in self.blocks:
                return block, ".".join(parts[cut:])
        raise ConnectionProblem(f"'{endpoint}' names no block", where, nearest(parts[0], self.blocks), signal=endpoint)

    def observable(self, endpoint: str) -> tuple[str, str, int] | None:
        """Block, flange and derivative order when the endpoint is the motion of a flange, else None."""
        block, rest = self.split(endpoint)
        port_name, _, quantity = rest.rpartition(".")
        port = self.blocks[block].ports.get(port_name)
        if port is None or port.role != "flange":
            return None
        names = [name for name, _ in MOTION[port.kind][:3]]
        return (block, port_name, names.index(quantity)) if quantity in names else None

    def is_input(self, endpoint: str) -> bool:
        """Whether the endpoint is a signal input."""
        block, rest = self.split(endpoint)
        port = self.blocks[block].ports.get(rest)
        return port is not None and port.role == "input"

    def is_flange(self, endpoint: str) -> bool:
        """Whether the endpoint is a flange."""
        block, rest = self.split(endpoint)
        port = self.blocks[block].ports.get(rest)
        return port is not None and port.role == "flange"

    def source_of(self, endpoint: str) -> tuple[str, Connection] | None:
        """The signal that feeds an input, and the connection that says so."""
        return self.sources().get(endpoint)

    def sources(self) -> dict[str, tuple[str, Connection]]:
        """For every end of a connection of signals, the signal that feeds it and the connection that says so."""
        made: dict[str, tuple[str, Connection]] = {}
        for connection in self.connections:
            source = next((end for end in connection.ends if not self.is_input(end)), None)
            if source is not None:
                for end in connection.ends:
                    made.setdefault(end, (source, connection))
        return made

    def inputs(self) -> list[str]:
        """Names of every signal input of every block."""
        return [
            f"{name}.{port.name}"
            for name, block in self.blocks.items()
            for port in block.ports.values()
            if port.role == "input"
        ]


def bypass(system: System, inputs: list[str], wanted: Iterable[str] = ()) -> tuple[System, list[str]]:
    """Free some inputs from the connections that fed them, dropping blocks that fed nothing else.

    Args:
        system: the system.
        inputs: endpoints of signal inputs.
        wanted: endpoints that are asked for as outputs; their blocks are kept.

    Returns:
        The system without those connections, and the names of the blocks dropped.

    Raises:
        ConnectionProblem: an endpoint is not a signal input.
    """
    known = system.inputs()
    for endpoint in inputs:
        if inputs.count(endpoint) > 1:
            raise ConnectionProblem(
                f"input '{endpoint}' is named twice: {', '.join(inputs)}", remedy="name each once", signal=endpoint
            )
    for endpoint in inputs:
        if endpoint not in known:
            raise ConnectionProblem(f"'{endpoint}' is not an input", remedy=nearest(endpoint, known), signal=endpoint)
    connections = []
    for connection in system.connections:
        ends = tuple(end for end in connection.ends if end not in inputs)
        if len(ends) == len(connection.ends) or any(system.is_input(end) for end in ends):
            connections.append(replace(connection, ends=ends))
    blocks = dict(system.blocks)
    kept = {name for name in blocks if any(endpoint.startswith(f"{name}.") for endpoint in wanted)}
    dropped: list[str] = []
    before = _feeders(system, system.connections)
    while True:
        trial = replace(system, blocks=blocks, connections=connections)
        feeding = _feeders(trial, connections)
        idle = [name for name in blocks if name in before and name not in feeding and name not in kept]
        gone = [name for name in idle if not blocks[name].is_physical()]
        if not gone:
            return trial, dropped
        for endpoint in inputs:
            if _owner(system, endpoint) in gone:
                raise ConnectionProblem(
                    f"input '{endpoint}' would drive nothing: what it feeds is driven from outside too",
                    remedy=f"leave '{endpoint}' out",
                    signal=endpoint,
                )
        dropped += gone
        blocks = {name: block for name, block in blocks.items() if name not in gone}
        # A signal that a dropped block read may go on to others.
        left = [tuple(end for end in c.ends if _owner(system, end) not in gone) for c in connections]
        connections = [replace(c, ends=ends) for c, ends in zip(connections, left, strict=True) if len(ends) > 1]


def _owner(system: System, endpoint: str) -> str:
    return system.split(endpoint)[0]


def _feeders(system: System, connections: list[Connection]) -> set[str]:
    """Blocks whose outputs feed some input."""
    return {
        _owner(system, end)
        for connection in connections
        for end in connection.ends
        if not system.is_input(end) and not system.is_flange(end)
    }
