"""The loss of a mesh that depends on which side drives, shared by gears, belts and screws."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import choose
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion


def directed_loss(
    net: Net, shaft: Motion, load: Expression, efficiency: Expression, backdriving_efficiency: Expression
) -> None:
    """Stamp the loss of an elastic mesh at its driving shaft, as a dry friction whose level follows the load.

    A lossless mesh takes the torque T = ``load`` from the shaft. One with losses takes T / eta while the shaft drives,
    and leaves it eta_b T while the load does. The difference, |T| (1 / eta - 1) or |T| (1 - eta_b), opposes the motion
    and holds the shaft, exactly, below it. With eta_b <= 0 no load turns the shaft: the mesh is self-locking.

    Args:
        net: where to stamp.
        shaft: what drives.
        load: torque with which the far side holds the shaft back in its forward sense; it must not depend on the
            acceleration of the shaft.
        efficiency: eta.
        backdriving_efficiency: eta_b.
    """
    driving, driven = 1 / efficiency - 1, 1 - backdriving_efficiency
    forward = choose(load > 0, load * driving, -load * driven)
    backward = choose(load > 0, load * driven, -load * driving)
    net.friction(
        {shaft: 1},
        forward=lambda velocity: forward,
        backward=lambda velocity: backward,
        static_forward=forward,
        static_backward=backward,
    )
