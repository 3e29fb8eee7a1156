"""Recordings under feedback control: whether the drive is the plant's input or the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnosis.recordings.columns import RecordingError
from engine.errors import Where
from engine.system import System

if TYPE_CHECKING:
    from diagnosis.recordings.types import Recording
    from scenarios.load import Scenario


def check_loop(scenario: Scenario, recording: Recording, where: Where | None = None) -> None:
    """Check that a recording's ``loop`` fits its drive and the scenario.

    ``closed``: the plant's input was logged under control; it drives the model, in place of the controller.
    ``reference``: the drive is the controller's reference, and the controller is part of the scenario.

    Raises:
        RecordingError: no drive, no controller, or a controller that the drive bypasses.
    """
    driven = [channel.name for channel in recording.drive]
    if recording.loop == "open":
        return
    if not driven:
        what = "the plant's input" if recording.loop == "closed" else "the reference"
        raise RecordingError(
            f"recording '{recording.name}' has 'loop: {recording.loop}' but no drive",
            where,
            f"map the column of {what}",
        )
    if recording.loop == "reference" and not fed_back(scenario.system, driven):
        raise RecordingError(
            f"recording '{recording.name}' has 'loop: reference', but {', '.join(driven)} drives no feedback loop",
            where,
            "put the controller into the scenario, or write 'loop: closed' if the drive is the plant's input",
        )


def fed_back(system: System, driven: list[str]) -> list[str]:
    """Signal inputs downstream of ``driven`` that lie on a loop, the connections to ``driven`` being cut."""
    downstream_of: dict[str, set[str]] = {name: set() for name in system.blocks}
    signals: list[tuple[str, str, str]] = []
    for connection in system.connections:
        inputs = [end for end in connection.ends if system.is_input(end)]
        owners = {end: system.split(end)[0] for end in connection.ends}
        if inputs:
            for source in connection.ends:
                for end in inputs:
                    if source not in inputs and end not in driven:
                        downstream_of[owners[source]].add(owners[end])
                        signals.append((end, owners[source], owners[end]))
        else:  # connected flanges act on one another
            for one in owners.values():
                downstream_of[one].update(other for other in owners.values() if other != one)
    affected = _reachable(downstream_of, {system.split(end)[0] for end in driven})
    return [end for end, source, block in signals if block in affected and source in _reachable(downstream_of, {block})]


def plant_inputs(system: System, driven: list[str]) -> list[str]:
    """Signal inputs on the loop whose block has a flange: where the controller acts on the plant."""
    return [
        end
        for end in fed_back(system, driven)
        if any(port.role == "flange" for port in system.blocks[system.split(end)[0]].ports.values())
    ]


def _reachable(downstream_of: dict[str, set[str]], begin: set[str]) -> set[str]:
    found, frontier = set(begin), list(begin)
    while frontier:
        for following in downstream_of[frontier.pop()] - found:
            found.add(following)
            frontier.append(following)
    return found
