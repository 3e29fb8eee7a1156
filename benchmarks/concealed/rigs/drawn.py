"""A rig from its seed."""

from __future__ import annotations

import functools
from dataclasses import replace
from zlib import crc32

from numpy.random import SeedSequence, default_rng

from benchmarks.concealed.drawing import Options
from benchmarks.concealed.rigs import equip, numbers, topology, wording
from benchmarks.concealed.rigs.rig import TOLERANCES, Rig, key_of

PREFIX = "rig-"

SIZES = {"V": (3.0, 24.0), "A": (0.3, 5.0)}
"""Size of the commands, by the drive's unit; a torque or force is what it takes."""

CLOSED = 0.36
"""Share of the rigs for which a controller is looked for; nearly all find one that is stable and gentle."""


@functools.lru_cache(maxsize=64)
def rig(seed: int, part: str = "") -> Rig:
    """The plant of a seed; one of its own with each of `topology.PARTS`."""
    return made(seed, part)[0]


@functools.lru_cache(maxsize=64)
def made(seed: int, part: str = "") -> tuple[Rig, Options]:
    """The plant of a seed, and how it is recorded.

    Args:
        seed: all follows from it.
        part: what the rig is asked to have: one of `topology.PARTS`, or nothing. Each has streams of its own, so that
            the rigs of a seed stay what they are.
    """
    key, name = [seed, crc32(b"rig")], f"{PREFIX}{seed}"
    if part:
        key, name = [*key, crc32(part.encode())], f"{name}-{part}"
    shape, size, doing, seeing = (default_rng(s) for s in SeedSequence(key).spawn(4))
    t = topology.draw(shape, part)
    n = numbers.draw(t, size)
    spread = numbers.far_off(n, size, {name: TOLERANCES[key_of(name)] for name in n.values})
    plant = Rig(name, t, n.values, n.units, n.fixed, spread)
    options = equip.protocol(plant, doing)
    amplitude = equip.drive(plant, options, doing)
    if t.drive in SIZES:
        wanted = numbers.log_uniform(doing, *SIZES[t.drive])
        numbers.electrical(t, n, wanted / amplitude)
        amplitude = wanted
    habits, excitation = plant.habits, plant.excitation
    plant = Rig(name, t, n.values, n.units, n.fixed, spread)
    plant.habits = habits
    plant.excitation = replace(excitation, amplitude=amplitude, resolution=equip.resolution(amplitude))
    plant.inductance = 0.0 if t.drive != "V" or t.winding else 7e-5 * n.values["motor.resistance"]
    plant.sensors = tuple(equip.bare(plant))
    if doing.random() < CLOSED and (control := equip.control(plant, options, doing)):
        plant.control = control
        options = replace(options, loop="closed")
    if not equip.watch(plant, options, seeing):
        options = replace(options, loop="open")
        equip.watch(plant, options, seeing)
    plant.habits = equip.habits(plant, options, seeing)
    plant.blocks = wording.blocks(plant)
    plant.sites = plant.find_sites()
    return plant, options
