"""The law of two faces that touch through a spring and damper, shared by play and stops."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import by_mode, choose, greatest, least
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net

LAWS = ("push_only", "two_sided")
LAW = "whether a contact only pushes, or its damper may pull until the faces part"


def contact(
    net: Net,
    offset: Expression,
    rate: Expression,
    stiffness: Expression,
    damping: Expression,
    half_gap: Expression,
    law: str,
) -> tuple[Expression, Expression]:
    """Stamp a switch and the energy of faces at offset = +-half_gap; the caller applies the effort.

    With the penetration p of a face and its force F = k p + d p':

    push_only: an open gap closes when p > 0 and F > 0, and a contact opens when F < 0 (it never pulls). The faces part
    while still compressed; what the spring then holds is counted as lost while they withdraw.
    two_sided: a contact is closed exactly while p > 0, and its damper may pull. With half_gap 0 it never opens.

    Args:
        net: where to stamp.
        offset: distance from the middle between the faces.
        rate: its time derivative.
        stiffness: k.
        damping: d.
        half_gap: distance from the middle to either face.
        law: one of `LAWS`.

    Returns:
        The effort against the offset, and the mode: 1 at the positive face, -1 at the negative, 0 between.
    """
    k, d, g = stiffness, damping, half_gap
    plus, minus = offset - g, offset + g
    load_plus, load_minus = k * plus + d * rate, k * minus + d * rate

    def push_only(mode: Expression) -> tuple[Expression, Expression]:
        closes = least(plus, load_plus), least(-minus, -load_minus)
        return by_mode(mode, load_minus, closes[0], -load_plus), by_mode(mode, -1, closes[1], -1)

    def two_sided(mode: Expression) -> tuple[Expression, Expression]:
        above, below = by_mode(mode, minus, plus, -plus), by_mode(mode, -1, -minus, -1)
        return choose(g <= 0, by_mode(mode, 1, 1, -1), above), choose(g <= 0, -1, below)

    guards = push_only if law == "push_only" else two_sided
    mode = net.switch("contact", ("negative face", "gap open", "positive face"), guards)
    touching = mode if law == "push_only" else choose(g <= 0, 1, mode)

    effort = by_mode(touching, load_minus, 0, load_plus)
    withdrawing = greatest(plus, 0) + least(minus, 0)
    pressed = by_mode(touching, minus, withdrawing, plus)
    net.store(k * pressed**2 / 2)
    net.dissipate(by_mode(touching, d * rate**2, -k * withdrawing * rate, d * rate**2))
    return effort, touching
