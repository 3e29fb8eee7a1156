"""Design of controllers: LQR, Kalman filter, observer, and blocks from python-control systems.

    from flexarm import design

    plant = flexarm.linearise("arm.yaml", inputs=["motor.voltage"], outputs=["encoder.out"])
    feedback = design.lqr(plant, Q=[100, 1, 0, 0], R=[0.1], period=2e-3)

Its modules have operating points, families, describing functions, margins, reductions and uncertainty.

A linear model is what `flexarm.linearise` returns, a python-control state-space system, or a `Plant`.
"""

from blocks.controllers.control_systems import Plant, from_control, plant
from blocks.controllers.design import Feedback, kalman, lqr, observer
from blocks.controllers.design_file import save

__all__ = ["Feedback", "Plant", "from_control", "kalman", "lqr", "observer", "plant", "save"]
