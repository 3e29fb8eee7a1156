"""``flexarm check SCENARIO``: read, assemble and say what does not fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from flexarm.console.options import ScenarioArgument, SetOption, load, say_bypassed

if TYPE_CHECKING:
    from engine.system import System


def check(scenario: ScenarioArgument, overrides: SetOption = None) -> None:
    """Read and assemble a scenario with its analyses and recordings, and report problems."""
    from diagnosis.binding import verify
    from diagnosis.recordings.mapping import from_scenario
    from diagnosis.recordings.paths import VARIABLE, is_available
    from diagnosis.recordings.types import FrequencyTable
    from flexarm.api import linearise as linear_model
    from flexarm.console.text import columns, plural
    from flexarm.cut import cut

    loaded = load(scenario, overrides)
    model = loaded.build()
    typer.echo(f"{loaded.name}: {loaded.description}" if loaded.description else loaded.name)
    typer.echo(
        ", ".join(
            plural(count, word)
            for count, word in (
                (len(loaded.system.blocks), "block"),
                (len(loaded.system.connections), "connection"),
                (len(model.states), "state"),
                (len(model.memories), "memory"),
                (len(model.modes), "mode"),
                (len(model.parameters), "parameter"),
            )
        )
    )
    typer.echo(columns(["state", "unit"], [[state.name, state.unit] for state in model.states]))
    if loose := _loose(loaded.system):
        typer.echo(f"connected to nothing: {', '.join(loose)}")
    for name, analysis in loaded.analyses.items():
        made = cut(loaded, analysis.kind, name)
        if analysis.kind == "linearise":
            linear_model(made)
        say_bypassed(made.bypassed, f"analysis {name}")
    for name in loaded.recordings:
        if not is_available(loaded, name):
            typer.echo(f"recording {name}: not read, since the environment variable {VARIABLE} is not set")
            continue
        recording = from_scenario(loaded, name)
        verify(loaded, recording)
        rows = len(recording.frequency) if isinstance(recording, FrequencyTable) else len(recording.time)
        typer.echo(f"recording {name}: {plural(rows, 'row')} of {recording.file}")
        for note in recording.notes:
            typer.echo(f"  {note}")
        if not isinstance(recording, FrequencyTable) and not recording.drive:
            typer.echo("  no input was recorded; the scenario's own sources drive the simulation")
    typer.echo("no problems found")


def _loose(system: System) -> list[str]:
    """Flanges that nothing is connected to: free ends, or a connection that was forgotten."""
    wired = {end for connection in system.connections for end in connection.ends}
    ends = (
        (f"{name}.{port}", made.role) for name, block in system.blocks.items() for port, made in block.ports.items()
    )
    return [end for end, role in ends if role == "flange" and end not in wired]
