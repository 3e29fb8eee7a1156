"""What may be missing in signals: between a drive and the block it drives, and behind a sensor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from diagnosis.candidate import NAME, Candidate, Knob, with_unit
from diagnosis.surroundings import Surroundings
from scenarios.amend import Edit, InSignal, OnSensor, Set


def _in(name: str, kind: str, target: str, unit: str, keys: dict[str, str], fixed: dict[str, Any] | None = None) -> Any:
    """Edits that put a block into a signal; ``keys`` gives the unit of each parameter."""

    def edits(values: dict[str, float]) -> list[Edit]:
        made = {key: with_unit(values[key], keys[key] or unit) for key in keys if key in values}
        return [InSignal(name, kind, target, {**(fixed or {}), **made})]

    return edits


def at_input(around: Surroundings, target: str, size: float) -> Iterator[Candidate]:
    """What may lie between a driven signal and the block it drives; ``size`` is the largest value it takes."""
    unit = next(v.unit for v in around.problem.model.inputs if v.name == target)
    block = around.problem.scenario.system.split(target)[0]
    place = f"signal -> {target}"

    def made(effect: str, kind: str, keys: dict[str, str], *knobs: Knob, **fixed: Any) -> Candidate:
        name = f"{NAME}_{effect}"
        return Candidate(effect, place, block, name, _in(name, kind, target, unit, keys, fixed), knobs)

    few, band = (0.03, 0.1, 0.3), (0.02, 0.08, 0.2)
    yield made(
        "dead_zone", "DeadZone", {"lower": "", "upper": ""}, Knob("lower", -size, band, True), Knob("upper", size, band)
    )
    yield made(
        "saturation",
        "Saturation",
        {"lower": "", "upper": ""},
        Knob("lower", -size, (0.9, 0.7), True),
        Knob("upper", size, (0.9, 0.7)),
    )
    yield made("offset", "Offset", {"offset": ""}, Knob("offset", size, (0.02, -0.02), True))
    yield made(
        "uneven_gain", "UnevenGain", {"forward": "1", "backward": "1"}, Knob("backward", 1.0, (0.95, 1.05)), forward=1.0
    )
    yield made("lag", "LowPass", {"corner_frequency": "rad/s"}, Knob("corner_frequency", 100.0, (*few, 1.0, 3.0)))
    sample = min(e.step * e.every for e in around.problem.experiments)
    waits = tuple(float(n) for n in (1, 2, 3, 5, 8, 12, 20))
    wait = Knob("delay", sample, waits, fixed=True)
    yield made("delay", "Delay", {"delay": "s"}, wait, period=with_unit(sample, "s"))
    system = around.problem.scenario.system
    if type(system.blocks[block]).__name__ == "DCMotor" and system.blocks[block].values["inductance"] == 0:
        reference = system.blocks[block].values["resistance"] * 1e-3

        def edits(values: dict[str, float]) -> list[Edit]:
            return [Set(block, "inductance", with_unit(values["inductance"], "H"))]

        yield Candidate("inductance", block, block, block, edits, (Knob("inductance", reference, (1.0, 5.0)),))


def at_sensor(around: Surroundings, signal: str) -> Iterator[Candidate]:
    """What may lie between a signal and what was recorded of it."""
    unit = next(v.unit for v in around.problem.model.outputs if v.name == signal)
    k = [v.name for v in around.problem.model.outputs].index(signal)
    measured = [e.measured[:, k] for e in around.problem.chosen("train", "repeat")]
    size = max(float(np.nanmax(np.abs(m))) for m in measured) or 1.0
    for effect, kind, key, key_unit, knob in (
        ("sensor_bias", "Offset", "offset", unit, Knob("offset", size, (0.02, -0.02), True)),
        ("sensor_scale", "Gain", "gain", "1", Knob("gain", 1.0, (1.05, 0.95))),
        ("rectified_sensor", "RectifiedSensor", "sensitivity", "1", Knob("sensitivity", 1.0, (1.0,))),
        ("sensor_lag", "LowPass", "corner_frequency", "rad/s", Knob("corner_frequency", 100.0, (0.3, 1.0, 3.0))),
    ):
        name = f"{NAME}_{effect}"

        def edits(
            values: dict[str, float], name: str = name, kind: str = kind, key: str = key, u: str = key_unit
        ) -> list[Edit]:
            return [OnSensor(name, kind, signal, {key: with_unit(values[key], u)})]

        yield Candidate(effect, signal, signal, name, edits, (knob,))
