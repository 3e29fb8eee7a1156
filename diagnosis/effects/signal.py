"""What may be missing in signals: between a drive and the block it drives, and behind a sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from diagnosis.effects.effect import NAME, Candidate, EffectParameter, Sizes, combinations, shares, with_unit
from diagnosis.effects.insertion import behind_sensor, in_signal
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales
from scenarios.amend import Edit, InSignal, Set

FEW = (1e-3, 5e-3, 0.02, 0.08, 0.2)
"""Starting sizes as shares of the largest value."""

SIDES = ((1.0, 1.0), (1.0, 0.5), (0.5, 1.0))
"""Shares of a starting size to either side."""

CORNERS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Time constants of the lags that are tried, in samples."""

SPACING = 0.4
"""Distance between the delays that are tried, as a share of the delay."""

GAIN = 0.2
"""Standard deviation of the logarithm of a gain that is wrong, of a sensor or of an amplifier in one direction.

Encoders too: they are wrong more seldom, but then by a factor, such as that of a gear nobody thought of.
"""

OFFSET = 0.05
"""Standard deviation of an amplifier's offset, as a share of its largest output: data sheets give hundredths."""


def at_input(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """What may lie between a driven signal and the block it drives."""
    size, sample = place.size, scales.sample
    both = (EffectParameter("lower", size), EffectParameter("upper", size, like=("lower",)))
    # An offset imitates two sides that differ, and would promise more than two that are alike.
    few = tuple({"lower": -s * a, "upper": s * b} for s in shares(size, *FEW) for a, b in SIDES)
    yield from in_signal(place, "dead_zone", "DeadZone", few, *both)
    limits = tuple({"lower": -s, "upper": s} for s in shares(size, 0.999, 0.99, 0.975, 0.95, 0.9, 0.8, 0.7, 0.55, 0.4))
    # Of an input that only switches between two values, a limit shows where it is not the same at both ends.
    limits += tuple(
        e for s in shares(size, 0.99, 0.9) for e in ({"lower": -s, "upper": size}, {"lower": -size, "upper": s})
    )
    # How far an amplifier goes is not known before; that both ends are alike is.
    ends = [replace(end, usual=1.0, spread=10 * end.spread) for end in both]
    yield from in_signal(place, "saturation", "Saturation", limits, *ends)
    offsets = combinations(offset=shares(size, 1e-3, -1e-3, 0.02, -0.02))
    plain = EffectParameter("offset", size, signed=True, spread=OFFSET)
    yield from in_signal(place, "offset", "Offset", offsets, plain)
    uneven = combinations(backward=(0.99, 1.01, 0.95, 1.05))
    backward = EffectParameter("backward", 1.0, usual=1.0, spread=GAIN)
    yield from in_signal(place, "uneven_gain", "UnevenGain", uneven, backward, held=False, forward=1.0)
    yield from in_signal(place, "lag", "LowPass", *_corners(scales))
    yield _delay(place, sample)
    yield from _inductance(scales, place)


def _corners(scales: OperatingScales) -> tuple[tuple[Sizes, ...], EffectParameter]:
    """Corners that a lag begins from, and its size: one slower than the recordings are long passes nothing on."""
    sample, longest = scales.sample, scales.longest
    able = [1 / (c * sample) for c in CORNERS if c * sample < longest]
    return combinations(corner_frequency=able), EffectParameter("corner_frequency", 1 / sample, least=sample / longest)


def _delay(place: Place, sample: float) -> Candidate:
    """A delay by any time, on the instants of the samples: what is recorded holds between them."""
    name = f"{NAME}_delay"

    def edits(values: Sizes) -> list[Edit]:
        wait = with_unit(round(values["delay"], 9), "s")
        return [InSignal(name, "Delay", place.target, {"delay": wait, "period": with_unit(sample, "s")})]

    def finer(best: Sizes, share: float) -> Sizes | None:
        wait = best["delay"] + share * max(sample, SPACING * best["delay"])
        return {"delay": wait} if wait > 0 else None

    waits = combinations(delay=shares(sample, 0.05, 0.2, 0.5, 1, 1.5, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64))
    return Candidate(
        "delay",
        place.name,
        place.block,
        name,
        edits,
        (EffectParameter("delay", sample, fixed=True, unit="s"),),
        waits,
        finer=finer,
    )


def _inductance(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """The inductance of a winding that has none."""
    name, block = place.block, scales.system.blocks[place.block]
    if not block.winding_parameters or block.values[block.winding_parameters[1]] != 0:
        return
    resistance, key = block.winding_parameters
    reference = block.values[resistance] * scales.sample

    def edits(values: Sizes) -> list[Edit]:
        return [Set(name, key, with_unit(values[key], block.unit_of(key)))]

    sizes = combinations(**{key: shares(reference, 0.3, 1.0, 5.0)})
    yield Candidate("inductance", name, name, name, edits, (EffectParameter(key, reference),), sizes)


def at_sensor(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """What may lie between a signal and what was recorded of it."""
    size = place.size
    offset = EffectParameter("offset", size, signed=True)
    yield from behind_sensor(
        place, "sensor_bias", "Offset", combinations(offset=shares(size, 1e-3, -1e-3, 0.02, -0.02)), offset
    )
    gains = combinations(gain=(1.01, 0.99, 1.05, 0.95))
    gain = EffectParameter("gain", 1.0, usual=1.0, spread=GAIN)
    yield from behind_sensor(place, "sensor_scale", "Gain", gains, gain, unit="1")
    yield from behind_sensor(place, "sensor_lag", "LowPass", *_corners(scales))
    if scales.has_no_sign(place):
        scale = EffectParameter("sensitivity", 1.0, usual=1.0, spread=GAIN)
        same = combinations(sensitivity=(1.0,))
        yield from behind_sensor(place, "rectified_sensor", "RectifiedSensor", same, scale, unit="1")
