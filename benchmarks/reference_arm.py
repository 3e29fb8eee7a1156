"""The 8-state reference arm: the model that is exported, and the hand-written C beside it."""

from __future__ import annotations

import ctypes
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blocks.actuators.dc_motor import DCMotor
from blocks.actuators.friction import BearingFriction
from blocks.actuators.gear import Gear
from blocks.links.assumed_modes import AssumedModesLink
from engine.assemble import build
from engine.block import Block
from engine.model import Model
from engine.system import Connection, System
from fmu.build import library

FOLDER = Path(__file__).parent / "reference"
OUTPUTS = ("link.hub.angle", "link.tip.deflection", "link.tip.acceleration", "motor.current")

Array = NDArray[np.float64]


def model(payload: float = 0.0) -> Model:
    """Motor, gear, bearing and nonlinear flexible link of three modes: eight states, voltage in."""
    blocks: dict[str, Block] = {
        "motor": DCMotor(
            resistance=2.6,
            torque_constant=7.68e-3,
            back_emf_constant=7.68e-3,
            efficiency=0.69,
            rotor_inertia=4.606e-7,
        ),
        "gear": Gear(ratio=70, efficiency=0.9, inertia=4.8754e-5),
        "bearing": BearingFriction(viscous_friction=0.004),
        "link": AssumedModesLink(
            length=0.419,
            mass=0.065,
            flexural_rigidity=0.137422,
            payload=payload,
            modes=3,
            nonlinear=True,
            damping_ratio=[0.01] * 3,
        ),
    }
    wires = [("motor.shaft", "gear.input"), ("gear.output", "link.hub", "bearing.shaft")]
    system = System(blocks, [Connection(ends) for ends in wires], name="reference arm")
    return build(system, inputs=["motor.voltage"], outputs=list(OUTPUTS))


class ByHand:
    """The hand-written loop, compiled with the flags of an FMU.

    Attributes:
        x: its state, shape (8,).
    """

    def __init__(self, payload: float = 0.0) -> None:
        text = (FOLDER / "arm8.c").read_text(encoding="utf-8")
        exported = '__attribute__((visibility("default"))) void arm8_'
        made = library({"arm8.c": text.replace("\nvoid arm8_", "\n" + exported)}, "linux64")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "arm8.so"
            path.write_bytes(made)
            self._library = ctypes.CDLL(str(path))
        self._library.arm8_run.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_long]
        self._library.arm8_outputs.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
        values = (
            2.6,
            7.68e-3,
            7.68e-3,
            0.69,
            4.606e-7,
            70,
            0.9,
            4.8754e-5,
            0.004,
            0.419,
            0.065,
            0.137422,
            0.01,
            payload,
        )
        self._library.arm8_prepare((ctypes.c_double * len(values))(*values))
        self.x: Array = np.zeros(8)

    def run(self, voltage: float, step: float, steps: int) -> None:
        """Take steps of ``step`` (s)."""
        self._library.arm8_run(self.x.ctypes.data, voltage, step, steps)

    def outputs(self, voltage: float) -> Array:
        """`OUTPUTS` now, shape (4,)."""
        y = np.zeros(4)
        self._library.arm8_outputs(self.x.ctypes.data, voltage, y.ctypes.data)
        return y
