"""The transmission error of a gear: what its output turns beyond input / ratio, wave by wave."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blocks.symbolic import cos, sin
from engine.block import option, parameter
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.stamps import Motion


def waves() -> Any:
    """The declaration of how many waves there are."""
    return option(int, 0, "number of waves of the transmission error; 0 is none", ge=0, le=20)


def amplitude() -> Any:
    """The declaration of the waves' amplitudes."""
    return parameter("rad", 0.0, "amplitude a of each wave, at the output", size="error_waves", tolerance=0.5)


def order() -> Any:
    """The declaration of the waves' orders."""
    return parameter("1", 1.0, "waves k per revolution of the input, of each wave", size="error_waves", gt=0)


def phase() -> Any:
    """The declaration of the waves' phases."""
    return parameter("rad", 0.0, "phase phi at input angle zero, where the error is zero", size="error_waves")


def meshed(block: Any, input: Motion) -> tuple[Expression, Expression]:
    """Angle that the mesh gives the output, and its derivative by the angle of the input.

    theta / n + sum a_k (sin(k theta + phi_k) - sin(phi_k)), theta = angle of the input, n = ratio; and
    1 / n + sum a_k k cos(...). By the second, speed goes forward and torque comes back: a wave takes no power. Both
    angles are counted from where the gear is without twist: the error is zero at input angle zero, and a gear at rest
    stays there.

    Args:
        block: declares ``ratio``, ``error_waves``, ``error_amplitude``, ``error_order`` and ``error_phase``.
        input: the fast shaft.
    """
    angle, share = input.angle / block.ratio, 1 / block.ratio
    for k in range(block.error_waves):
        wave = block.error_order[k] * input.angle + block.error_phase[k]
        angle = angle + block.error_amplitude[k] * (sin(wave) - sin(block.error_phase[k]))
        share = share + block.error_amplitude[k] * block.error_order[k] * cos(wave)
    return angle, share
