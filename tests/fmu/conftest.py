"""Models and exported FMUs that the tests share; every archive is built once per test run."""

from __future__ import annotations

import functools
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

import fmu
from blocks.actuators.backlash import Backlash
from blocks.actuators.dc_motor import DCMotor
from blocks.actuators.friction import BearingFriction
from blocks.actuators.gear import Gear
from blocks.controllers.dead_zone import DeadZone
from blocks.controllers.delay import Delay
from blocks.controllers.low_pass import LowPass
from blocks.controllers.pi import PI
from blocks.links.assumed_modes import AssumedModesLink
from blocks.links.inertia import Inertia
from blocks.sensors.tachometer import Tachometer
from blocks.sources.sine import Sine
from engine.assemble import build
from engine.block import Block
from engine.compile import compiler
from engine.model import Model
from engine.system import Connection, System
from fmu.source import headers

MOTOR = {
    "resistance": 2.6,
    "torque_constant": 7.68e-3,
    "back_emf_constant": 7.68e-3,
    "efficiency": 0.69,
    "rotor_inertia": 4.606e-7,
}


def _arm(modes: int) -> AssumedModesLink:
    return AssumedModesLink(
        length=0.419, mass=0.065, flexural_rigidity=0.137422, modes=modes, nonlinear=True, damping_ratio=[0.01] * modes
    )


@functools.cache
def smooth() -> Model:
    """Reference model A with three link modes, eight states: motor, gear and nonlinear flexible link; voltage in."""
    blocks: dict[str, Block] = {
        "motor": DCMotor(**MOTOR),
        "gear": Gear(ratio=70, efficiency=0.9, inertia=4.8754e-5),
        "bearing": BearingFriction(viscous_friction=0.004),
        "link": _arm(3),
    }
    wires = [("motor.shaft", "gear.input"), ("gear.output", "link.hub", "bearing.shaft")]
    system = System(blocks, [Connection(ends) for ends in wires], name="smooth arm", description="motor, gear & link")
    outputs = ["link.hub.angle", "link.tip.deflection", "link.tip.acceleration", "motor.current"]
    return build(system, inputs=["motor.voltage"], outputs=outputs)


@functools.cache
def switching() -> Model:
    """Reference model B: dead zone, stick at the rotor, backlash, and a sampled PI on the filtered tachometer."""
    blocks: dict[str, Block] = {
        "controller": PI(proportional_gain="0.3 V.s/rad", integral_gain="1 V/rad", period=1e-3),
        "zone": DeadZone(lower="-0.09 V", upper="0.18 V"),
        "motor": DCMotor(**MOTOR),
        "friction": BearingFriction(coulomb_friction=2.2e-4, static_friction=3e-4, viscous_friction=1e-7),
        "tacho": Tachometer(sensitivity=0.0143),
        "filter": LowPass(corner_frequency=62.8, period=1e-3),
        "gear": Gear(ratio=70, efficiency=0.9, inertia=4.8754e-5),
        "play": Backlash(stiffness=60, damping=0.02, half_gap=0.004),
        "link": _arm(2),
        "hub": Inertia(inertia=3e-4),
    }
    wires = [
        ("controller.out", "zone.in"),
        ("zone.out", "motor.voltage"),
        ("motor.shaft", "gear.input", "friction.shaft", "tacho.shaft"),
        ("tacho.out", "filter.in"),
        ("filter.out", "controller.measurement"),
        ("gear.output", "play.a"),
        ("play.b", "link.hub", "hub.shaft"),
    ]
    system = System(
        blocks, [Connection(ends) for ends in wires], name="switching-arm", initial={"link.hub.angle": 0.002}
    )
    outputs = ["link.hub.angle", "link.tip.deflection", "motor.shaft.speed", "controller.out", "play.torque"]
    return build(system, inputs=["controller.reference"], outputs=outputs)


@functools.cache
def timed() -> Model:
    """A spring-less rotor driven by a sine that is a function of time, with friction; started with an angle given."""
    blocks: dict[str, Block] = {
        "source": Sine(amplitude="3 V", frequency="1.1 Hz"),
        "motor": DCMotor(**MOTOR),
        "friction": BearingFriction(coulomb_friction=2e-3),
        "gear": Gear(ratio=10),
        "load": Inertia(inertia=1e-4),
    }
    wires = [
        ("source.out", "motor.voltage"),
        ("motor.shaft", "gear.input", "friction.shaft"),
        ("gear.output", "load.shaft"),
    ]
    system = System(blocks, [Connection(ends) for ends in wires], name="timed", initial={"load.shaft.angle": 0.3})
    return build(system, outputs=["load.shaft.angle", "motor.shaft.angle", "motor.shaft.speed"])


@functools.cache
def delayed() -> Model:
    """A motor with friction behind a delay line of seven samples."""
    blocks: dict[str, Block] = {
        "delay": Delay(delay="7 ms", period="1 ms"),
        "motor": DCMotor(**MOTOR),
        "friction": BearingFriction(coulomb_friction=2e-4),
    }
    wires = [("delay.out", "motor.voltage"), ("motor.shaft", "friction.shaft")]
    system = System(blocks, [Connection(ends) for ends in wires], name="delayed")
    return build(system, inputs=["delay.in"], outputs=["delay.out", "motor.shaft.speed"])


Exported = Callable[..., Path]


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    """A function that gives the path of a model's FMU, exported for linux64 unless told otherwise."""
    folder = tmp_path_factory.mktemp("fmus")

    @functools.cache
    def make(model: Model, platforms: tuple[str, ...] = ("linux64",), step: float = 1e-3) -> Path:
        name = f"{model.name.replace(' ', '_')}-{'-'.join(platforms)}-{step:g}.fmu"
        return fmu.export(model, folder / name, platforms=platforms, step=step)

    return make


@pytest.fixture(scope="session")
def smooth_model() -> Model:
    return smooth()


@pytest.fixture(scope="session")
def switching_model() -> Model:
    return switching()


@pytest.fixture(scope="session")
def timed_model() -> Model:
    return timed()


@pytest.fixture(scope="session")
def delayed_model() -> Model:
    return delayed()


@pytest.fixture(scope="session")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program of host.c, which has no Python in it."""
    folder = tmp_path_factory.mktemp("host")
    for name, text in headers(2).items():
        (folder / name).write_text(text)
    shutil.copy(Path(__file__).parent / "host.c", folder)
    subprocess.run([*compiler(), "-O2", "-o", "host", "host.c", "-lm", "-ldl", "-lpthread"], cwd=folder, check=True)
    return folder / "host"
