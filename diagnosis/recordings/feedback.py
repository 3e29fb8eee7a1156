"""Recordings under control: what the recorded drive is, and where the controller acts on the plant."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnosis.recordings.columns import RecordingError
from engine.errors import Where
from engine.system import System

if TYPE_CHECKING:
    from diagnosis.recordings.mapping import Recording
    from scenarios.load import Scenario


def check_loop(scenario: Scenario, recording: Recording, where: Where | None = None) -> None:
    """Check that a recording's ``loop`` fits its drive and the scenario.

    ``closed``: the plant's input was logged under control and drives the model, without that controller.
    ``reference``: the drive is what the controller is to follow, and the controller is part of the scenario.

    Raises:
        RecordingError: no drive, no controller, or a controller that the drive puts out of action.
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
            f"recording '{recording.name}' has 'loop: reference', but nothing in the scenario that {', '.join(driven)} "
            "drives is fed back",
            where,
            "put the controller into the scenario, or write 'loop: closed' if the drive is the plant's input",
        )


def fed_back(system: System, driven: list[str]) -> list[str]:
    """Signal inputs of the system that depend on themselves, once some inputs are driven from outside."""
    after: dict[str, set[str]] = {name: set() for name in system.blocks}
    signals: list[tuple[str, str, str]] = []
    for connection in system.connections:
        fed = [end for end in connection.ends if system.is_input(end)]
        owners = {end: system.split(end)[0] for end in connection.ends}
        if fed:
            for source in connection.ends:
                for end in fed:
                    if source not in fed and end not in driven:
                        after[owners[source]].add(owners[end])
                        signals.append((end, owners[source], owners[end]))
        else:
            for one in owners.values():
                after[one].update(other for other in owners.values() if other != one)
    downstream = _reached(after, {system.split(end)[0] for end in driven})
    return [end for end, source, block in signals if block in downstream and source in _reached(after, {block})]


def plant_inputs(system: System, driven: list[str]) -> list[str]:
    """Signal inputs inside the loop that act on the mechanics: where a controller meets the plant."""
    return [
        end
        for end in fed_back(system, driven)
        if any(port.role == "flange" for port in system.blocks[system.split(end)[0]].ports.values())
    ]


def _reached(after: dict[str, set[str]], begin: set[str]) -> set[str]:
    found, frontier = set(begin), list(begin)
    while frontier:
        for following in after[frontier.pop()] - found:
            found.add(following)
            frontier.append(following)
    return found
