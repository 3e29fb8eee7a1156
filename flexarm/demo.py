"""The main job on real input, end to end; what ``make demo`` runs.

Simulates the Quanser arm with and without its dead zone, linearises it, exports it as an FMU and runs that in FMPy, and
holds the SRV02 against the measured tables of [Gao J. n.d.]. Everything lands in ``demo-results``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from rich.console import Console

import flexarm
import fmu
from engine.errors import FlexarmError
from flexarm.console.text import columns, linear_page
from flexarm.cut import cut
from flexarm.output import write_linear, write_result

AGREEMENT = 1e-12
"""What the FMU may differ from the runner, relative to the outputs' size."""

ROUNDED = 6e-3
"""What an RMS error (dB) may differ from the expected one; 0.002 is the most that was seen."""

# Variant of a shipped scenario, recording, and its RMS error in dB by a computation that shares no code with flexarm.
LADDER = (
    ("bare motor, no friction", "srv02-bare", "table_2_2", ("friction.coulomb_friction=0",), 0.337),
    ("bare motor, Coulomb friction", "srv02-bare", "table_2_2", ("friction.coulomb_friction=2.25e-4",), 0.397),
    ("flexible link, linear", "srv02-2mass-b3", "table_a2", (), 5.94),
    ("... Coulomb friction", "srv02-2mass-b3", "table_a2", ("friction.coulomb_friction=2.25e-4",), 6.06),
    (
        "... and backlash",
        "srv02-2mass-b3",
        "table_a2",
        ("friction.coulomb_friction=2.25e-4", "contact.law=push_only", "contact.half_gap=0.03"),
        1.30,
    ),
)


def main() -> int:
    """Run the demonstration; returns the exit code."""
    console = Console(highlight=False)
    folder = Path("demo-results")
    try:
        folder.mkdir(exist_ok=True)
        _step_response(console, folder)
        _linear(console, folder)
        same = _travel(console, folder)
        same = _tables(console) and same
    except FlexarmError as error:
        print(error, file=sys.stderr)
        return 1
    console.print(f"\nResults: {folder.resolve()}")
    files = [[path.name, f"{path.stat().st_size / 1024:.1f}"] for path in sorted(folder.iterdir())]
    console.print(columns(["file", "kB"], files), markup=False)
    return 0 if same else 1


def _step_response(console: Console, folder: Path) -> None:
    console.print("[bold]1. The Quanser arm, 1 V for 1 s, with and without its dead zone[/bold]")
    runs = []
    for label, name in (("dead zone", "quanser-single-link"), ("no dead zone", "quanser-single-link-no-dead-zone")):
        scenario = flexarm.load(name)
        model = scenario.build(outputs=["link.hub.angle", "link.tip.deflection"])
        run = flexarm.simulate(model, 4.0, 1e-3)
        write_result(folder / f"{name}.csv", run, scenario)
        runs.append((label, run))
        console.print(
            f"   {label:13} {np.degrees(run['link.hub.angle'][-1]):8.3f} deg at rest, "
            f"tip bends {1000 * np.abs(run['link.tip.deflection']).max():.1f} mm"
        )
    flexarm.plot(runs, folder / "quanser-step.png", "Quanser single-link arm: 1 V for 1 s")


def _linear(console: Console, folder: Path) -> None:
    console.print("\n[bold]2. Its linear model[/bold]")
    linear = flexarm.linearise("quanser-single-link-no-dead-zone")
    write_linear(folder / "quanser-linear.json", linear, "quanser_linear")
    console.print(linear_page(linear), markup=False)


def _travel(console: Console, folder: Path) -> bool:
    console.print("\n[bold]3. The same model as an FMU, run in FMPy[/bold]")
    model = cut("quanser-single-link", "export").model
    path = fmu.export(model, folder / "quanser.fmu", platforms=("linux64",))
    steps = np.arange(0.0, 4.0, 0.05)
    drive = flexarm.Drive(steps, np.where(steps < 1.0, 1.0, 0.3 * np.sin(8.0 * steps))[:, None])
    difference = fmu.compare_with_runner(model, path, 4.0, 1e-3, drive=drive)
    same = difference < AGREEMENT
    verdict = "agrees" if same else f"DIFFERS by more than {AGREEMENT:g}"
    console.print(f"   {path.name}: largest difference from the runner {difference:.2g}: {verdict}")
    return same


def _tables(console: Console) -> bool:
    console.print("\n[bold]4. The SRV02 against measured tables (half peak-to-peak speed at 2 V, raw)[/bold]")
    rows, same = [], True
    for label, name, table, overrides, expected in LADDER:
        found = flexarm.compare(flexarm.load(name, overrides), table)
        error = next(iter(found.signals.values()))
        near = error.rms_db is not None and abs(error.rms_db - expected) < ROUNDED
        same = same and near
        rows.append([label, table, f"{error.rms_db:.3f}", f"{expected:g}", "" if near else "DIFFERS"])
    console.print(columns(["model", "table", "rms [dB]", "expected [dB]", ""], rows), markup=False)
    return same


if __name__ == "__main__":
    sys.exit(main())
