"""Short ways to build and run small systems in these tests."""

from __future__ import annotations

from typing import Any

from engine.assemble import build
from engine.block import Block
from engine.linearise import LinearModel, linearise
from engine.model import Model
from engine.simulate import Result, simulate
from engine.system import Connection, System


def system(blocks: dict[str, Block], *connections: str, initial: dict[str, float] | None = None) -> System:
    """A system from blocks by name and connections written as ``a.out b.in``."""
    return System(blocks, [Connection(tuple(ends.split())) for ends in connections], initial=initial or {})


def model(blocks: dict[str, Block], *connections: str, inputs: list[str] | None = None, **rest: Any) -> Model:
    """Its model, with the energy books kept unless told otherwise."""
    energy = rest.pop("energy", True)
    outputs = rest.pop("outputs", None)
    return build(system(blocks, *connections, **rest), inputs, outputs, energy=energy)


def run(blocks: dict[str, Block], *connections: str, stop: float, step: float = 1e-3, **rest: Any) -> Result:
    """A simulation of it."""
    names = ("internal_step", "record_states", "drive", "parameters", "backend")
    keys = {key: rest.pop(key) for key in names if key in rest}
    return simulate(model(blocks, *connections, **rest), stop, step, **keys)


def linear(blocks: dict[str, Block], *connections: str, **rest: Any) -> LinearModel:
    """Its linear model."""
    keys = {key: rest.pop(key) for key in ("at", "modes") if key in rest}
    return linearise(model(blocks, *connections, energy=False, **rest), **keys)


def switches(result: Result, mode: str) -> list[float]:
    """The values a mode took, in order."""
    return [value for _, name, value in result.events if name == mode]


def instants(result: Result, mode: str) -> list[float]:
    """The instants at which a mode changed."""
    return [time for time, name, _ in result.events if name == mode]
