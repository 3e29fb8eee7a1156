"""A belt whose slack strand hangs: what its pretension holds is not in the model."""

from __future__ import annotations

from collections.abc import Iterator

from diagnosis.effects.effect import ANY, Candidate, EffectParameter, Sizes, combinations, with_unit
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales
from scenarios.amend import Edit, Set

TENSIONS = (1.5, 1.0, 0.6, 0.3, 0.1)
"""Starting sizes of the pretension, as shares of the typical force: one strand hangs from twice the pretension on."""

UNKNOWN = 2.0 * ANY
"""Standard deviation of the logarithm of a pretension: a belt loses what it was tensioned with."""


def at_belt(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """A pretension that a strand can lose, only of a spring that is one because none is given: a belt."""
    name, block = place.target, scales.system.blocks[place.target]
    never = dict(block.spring_when).get("pretension")
    if never is None or block.values["pretension"] != never:
        return
    # The belt carries what accelerates the side that is driven.
    driven = scales.at(f"{name}.b")
    force = driven.torque if driven else 1.0

    def edits(values: Sizes) -> list[Edit]:
        return [Set(name, "pretension", with_unit(values["pretension"], "N"))]

    plain = EffectParameter("pretension", force, usual=1.0, spread=UNKNOWN)
    starts = combinations(pretension=[force * share for share in TENSIONS])
    yield Candidate("belt_slack", name, name, name, edits, (plain,), starts)
