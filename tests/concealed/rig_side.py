"""Random rigs on the other side: what is concealed, in flexarm's blocks, and the sensors where they truly sit."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from benchmarks.concealed.scenario import text, write
from diagnosis.binding import bind, row_interval
from diagnosis.recordings.mapping import from_scenario
from diagnosis.recordings.types import Recording
from engine.simulate import simulate
from scenarios.amend import AtFlange, Between, InSignal, amended
from scenarios.load import load
from tests.concealed.flexarm_side import _driven, edits_for, slid


def _yaml(change: Any, source: Any) -> Any:
    yaml = YAML(typ="rt")
    document = yaml.load(source)
    change(document)
    out = io.StringIO()
    yaml.dump(document, out)
    return out.getvalue()


def concealed_in(source: Any, c: Any, rig: Any, true: Any = None) -> Any:
    """The scenario with an effect in it."""
    if c.place in [s.signal for s in rig.sensors]:
        c, rig = replace(c, place=_seat(c.place, rig)), _Seated(rig)
    for edit in edits_for(c, rig, true):
        slides = _slides(c.place, rig.topology)
        if isinstance(edit, InSignal) and edit.name == "y":
            source = _driven(source, edit)
        elif isinstance(edit, Between):
            source = _cut(source, edit, c.place, rig)
        elif slides and isinstance(edit, AtFlange):
            kind, parameters, port = slid(edit.type, edit.parameters, edit.port)
            source = amended(source, [replace(edit, type=kind, parameters=parameters, port=port)])
        elif slides and hasattr(edit, "drop"):
            kind, parameters, _ = slid(edit.type, edit.parameters, "a")
            source = amended(source, [replace(edit, type=kind, parameters=parameters)])
        else:
            source = amended(source, [edit])
    return source


def _slides(place: Any, t: Any) -> bool:
    """Whether a place slides."""
    flange = place.split(" -> ")[0]
    return bool(t.slides and not (any(flange in node for node in t.nodes) and t.turns(flange)))


def _cut(source: Any, edit: Any, place: Any, rig: Any) -> Any:
    """A node parted in two, whatever hangs on either side, and the joint between."""
    t = rig.topology
    index, far = rig.cuts[place]
    node = t.nodes[index]
    kind, parameters = edit.type, edit.parameters
    if _slides(place, t):
        kind, parameters, _ = slid(kind, parameters, "a")

    def change(document: Any) -> None:
        document["blocks"]["x"] = {"type": kind, **parameters}
        kept = [c for c in document["connect"] if list(c) != node]
        assert len(kept) == len(document["connect"]) - 1
        document["connect"] = [
            *kept,
            [*(f for f in node if f not in far), "x.a"],
            ["x.b", *(f for f in node if f in far)],
        ]

    return _yaml(change, source)


def _seat(signal: Any, rig: Any) -> Any:
    """A signal, read where its sensor truly sits."""
    probe = rig.probe(signal)
    return signal.replace(probe.read, probe.at) if signal.startswith(probe.read) else signal


class _Seated:
    """A rig whose sensors are called as they sit; what `edits_for` needs of it."""

    def __init__(self, rig: Any) -> None:
        self.drive, self.drive_unit, self.topology = rig.drive, rig.drive_unit, rig.topology
        self.sensors = [replace(s, signal=_seat(s.signal, rig)) for s in rig.sensors]


def _seated(source: Any, rig: Any) -> Any:
    """The measurements read where the sensors truly sit."""

    def change(document: Any) -> None:
        for recording in document["recordings"].values():
            made = {}
            for signal, row in recording["measurements"].items():
                made[_seat(signal, rig)] = row
            recording["measurements"] = made
            recording.pop("initial", None)

    return _yaml(change, source)


def _begun(source: Any, angle: Any, concealed: Any, rig: Any) -> Any:
    """The scenario that begins twisted."""
    t = rig.topology
    motion = "position" if t.slides else "angle"
    group = t.groups()[-1]

    def change(document: Any) -> None:
        document["initial"] = {f"{rig.main}.{motion}": angle}
        for c in concealed:
            index = next((i for i in range(len(t.nodes)) if t.cuts[i] and t.cut(i) == c.place), None)
            if index in group:
                sides = t.nodes[index][t.cuts[index] - 1], t.nodes[index][t.cuts[index]]
                document["initial"] = {f"{f}.{motion}": angle * t.ratio(f) for f in sides}
            if c.effect == "extra_mode" and "modes" not in c.parameters and t.node_of(c.place) in group:
                document["initial"][f"y.shaft.{motion}"] = angle * t.ratio(c.place)

    return _yaml(change, source)


def simulated(case: Any, folder: Any, concealed: Any = (), internal_step: Any = None) -> Any:
    """flexarm's outputs for a rig's recordings, in units of the floor, one array per recording."""
    exact = replace(case, nominal=dict(case.truth.parameters))
    write(exact, folder / "case", folder / "answers")
    source = _seated(text(exact), case.plant)
    for c in concealed:
        source = concealed_in(source, c, case.plant, case.truth.parameters)
    file, out = folder / "case" / "scenario.yaml", []
    for recorded, angle in zip(case.recordings, case.bench.released, strict=True):
        file.write_text(_begun(source, angle, concealed, case.plant) if angle else source)
        scenario = load(str(file))
        read = from_scenario(scenario, recorded.name)
        assert isinstance(read, Recording)
        made = bind(scenario, read)
        step, every = row_interval(recorded.time, 1e-3)
        stop = step * every * (len(recorded.time) - 1)
        run = simulate(made.model, stop, step, drive=made.drive, internal_step=internal_step)
        out.append(np.asarray(run.values)[::every] / case.bench.sigma)
    return out
