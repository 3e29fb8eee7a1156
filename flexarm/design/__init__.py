"""Design of controllers: LQR, Kalman filter, observer, and blocks from python-control systems.

    from flexarm import design

    plant = flexarm.linearise("arm.yaml", inputs=["motor.voltage"], outputs=["encoder.out"])
    feedback = design.lqr(plant, Q=[100, 1, 0, 0], R=[0.1], period=2e-3)

Its modules have operating points, families, describing functions, margins, reductions and uncertainty.

A linear model is what `flexarm.linearise` returns, a python-control state-space system, or a `Plant`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from blocks.controllers.control_systems import Plant, from_control, plant
    from blocks.controllers.design import Feedback, kalman, lqr, observer
    from blocks.controllers.design_file import save

_PLACES = {
    "Feedback": "blocks.controllers.design",
    "Plant": "blocks.controllers.control_systems",
    "from_control": "blocks.controllers.control_systems",
    "kalman": "blocks.controllers.design",
    "lqr": "blocks.controllers.design",
    "observer": "blocks.controllers.design",
    "plant": "blocks.controllers.control_systems",
    "save": "blocks.controllers.design_file",
}

__all__ = ["Feedback", "Plant", "from_control", "kalman", "lqr", "observer", "plant", "save"]


def __getattr__(name: str) -> Any:
    """Import what is asked for: a simulation, which needs none of it, imports this package's modules too."""
    if name not in _PLACES:
        raise AttributeError(f"module 'flexarm.design' has no attribute '{name}'")
    return getattr(importlib.import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
