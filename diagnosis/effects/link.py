"""What a flexible link leaves out of itself: a further bending mode, stiffening by rotation, a load at its tip."""

from __future__ import annotations

from collections.abc import Iterator

from diagnosis.effects.effect import Candidate, EffectParameter, Sizes, combinations, shares, with_unit
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales
from scenarios.amend import Edit, Set


def at_link(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """The effects of a block that keeps bending modes, may stiffen as it rotates, or may carry a load."""
    name, block = place.target, scales.system.blocks[place.target]
    if block.modes_option:
        key, modes = block.modes_option, int(block.values[block.modes_option])

        def more(values: Sizes) -> list[Edit]:
            return [Set(name, key, modes + 1)]

        yield Candidate("extra_mode", name, name, name, more)
    if not all(block.values[key] for key in block.spin_options):
        switches = block.spin_options

        def spun(values: Sizes) -> list[Edit]:
            return [Set(name, key, True) for key in switches]

        yield Candidate("centrifugal_stiffening", name, name, name, spun)
    if block.payload_parameters and not block.values[block.payload_parameters[0]]:
        load, own = block.payload_parameters
        mass = float(block.values[own])

        def loaded(values: Sizes) -> list[Edit]:
            return [Set(name, load, with_unit(values[load], block.unit_of(load)))]

        # A light link carries several times its own mass, and a course grows in proportion within a factor of three.
        sizes = combinations(**{load: shares(mass, 0.005, 0.05, 0.3, 1.0, 3.0)})
        yield Candidate("payload", name, name, name, loaded, (EffectParameter(load, mass),), sizes)
