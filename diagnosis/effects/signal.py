"""What may be missing in signals: between a drive and the block it drives, and behind a sensor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from diagnosis.effects.effect import NAME, Candidate, EffectParameter, Sizes, grid, shares, with_unit
from diagnosis.effects.scales import OperatingScales
from scenarios.amend import Edit, InSignal, OnSensor, Set

FEW = (1e-3, 5e-3, 0.02, 0.08, 0.2)
"""Starting sizes as shares of the largest value."""

CORNERS = (1.0, 3.0, 10.0, 30.0)
"""Lags are tried with time constants of so many samples."""


def at_input(scales: OperatingScales, target: str, size: float) -> Iterator[Candidate]:
    """What may lie between a driven signal and the block it drives; ``size`` is the largest value it takes."""
    unit = scales.units[target]
    system = scales.problem.scenario.system
    block = system.split(target)[0]
    node = next((c for c in system.connections if target in c.ends), None)
    source = next((end for end in node.ends if end != target), "signal") if node is not None else "signal"
    place = f"{source} -> {target}"
    sample = scales.sample

    def made(
        effect: str,
        kind: str,
        units: dict[str, str],
        parameters: tuple[EffectParameter, ...],
        starts: tuple[Sizes, ...],
        **more: Any,
    ) -> Candidate:
        name = f"{NAME}_{effect}"

        def edits(values: Sizes) -> list[Edit]:
            given = {key: with_unit(values[key], units[key]) for key in units if key in values}
            return [InSignal(name, kind, target, {**more, **given})]

        return Candidate(effect, place, block, name, edits, parameters, starts)

    ends = {"lower": unit, "upper": unit}
    both = (EffectParameter("lower", size), EffectParameter("upper", size, like="lower"))
    yield made("dead_zone", "DeadZone", ends, both, tuple({"lower": -s, "upper": s} for s in shares(size, *FEW)))
    limits = tuple({"lower": -s, "upper": s} for s in shares(size, 0.999, 0.99, 0.975, 0.95, 0.9, 0.8, 0.7, 0.55, 0.4))
    yield made("saturation", "Saturation", ends, both, limits)
    offsets = grid(offset=shares(size, 1e-3, -1e-3, 0.02, -0.02))
    yield made("offset", "Offset", {"offset": unit}, (EffectParameter("offset", size, signed=True),), offsets)
    uneven = grid(backward=(0.99, 1.01, 0.95, 1.05))
    yield made(
        "uneven_gain",
        "UnevenGain",
        {"forward": "1", "backward": "1"},
        (EffectParameter("backward", 1.0),),
        uneven,
        forward=1.0,
    )
    corners = grid(corner_frequency=[1 / (c * sample) for c in CORNERS])
    yield made(
        "lag", "LowPass", {"corner_frequency": "rad/s"}, (EffectParameter("corner_frequency", 1 / sample),), corners
    )
    yield _delay(place, block, target, sample)
    motor = system.blocks[block]
    if type(motor).__name__ == "DCMotor" and motor.values["inductance"] == 0:
        reference = motor.values["resistance"] * sample

        def coil(values: Sizes) -> list[Edit]:
            return [Set(block, "inductance", with_unit(values["inductance"], "H"))]

        sizes = grid(inductance=shares(reference, 0.3, 1.0, 5.0))
        yield Candidate("inductance", block, block, block, coil, (EffectParameter("inductance", reference),), sizes)


def _delay(place: str, block: str, target: str, sample: float) -> Candidate:
    """A delay by any time, on the instants of the samples: what is recorded holds between them."""
    name = f"{NAME}_delay"

    def edits(values: Sizes) -> list[Edit]:
        wait = with_unit(round(values["delay"], 9), "s")
        return [InSignal(name, "Delay", target, {"delay": wait, "period": with_unit(sample, "s")})]

    def finer(best: Sizes, share: float) -> list[Sizes]:
        step = share * sample
        return [{"delay": w} for w in (best["delay"] - step, best["delay"] + step) if w > sample / 50]

    waits = grid(delay=shares(sample, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 14, 20))
    return Candidate(
        "delay",
        place,
        block,
        name,
        edits,
        (EffectParameter("delay", sample, fixed=True, unit="s"),),
        waits,
        finer=finer,
    )


def at_sensor(scales: OperatingScales, signal: str) -> Iterator[Candidate]:
    """What may lie between a signal and what was recorded of it."""
    unit = next(v.unit for v in scales.problem.model.outputs if v.name == signal)
    k = [v.name for v in scales.problem.model.outputs].index(signal)
    training = scales.problem.chosen("train", "repeat")
    measured = [e.measured[:, k] for e in training]
    size = max(float(np.nanmax(np.abs(m))) for m in measured) or 1.0
    sample = scales.sample
    biases, gains = grid(offset=shares(size, 1e-3, -1e-3, 0.02, -0.02)), grid(gain=(1.01, 0.99, 1.05, 0.95))
    lags = grid(corner_frequency=[1 / (c * sample) for c in CORNERS])
    rows = [
        ("sensor_bias", "Offset", "offset", unit, EffectParameter("offset", size, signed=True), biases),
        ("sensor_scale", "Gain", "gain", "1", EffectParameter("gain", 1.0), gains),
        ("sensor_lag", "LowPass", "corner_frequency", "rad/s", EffectParameter("corner_frequency", 1 / sample), lags),
    ]
    if all(np.nanmin(m) > -0.05 * size for m in measured):
        scale = EffectParameter("sensitivity", 1.0)
        rows.append(("rectified_sensor", "RectifiedSensor", "sensitivity", "1", scale, grid(sensitivity=(1.0,))))
    for effect, kind, key, key_unit, parameter, starts in rows:
        name = f"{NAME}_{effect}"

        def edits(
            values: Sizes, name: str = name, kind: str = kind, key: str = key, unit: str = key_unit
        ) -> list[Edit]:
            return [OnSensor(name, kind, signal, {key: with_unit(values[key], unit)})]

        yield Candidate(effect, signal, signal, name, edits, (parameter,), starts)
