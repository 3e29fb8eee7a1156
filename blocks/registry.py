"""Every block by its type name: the house's own, and those other packages register.

A package adds blocks by the entry point group ``flexarm.blocks``; the name is the type name in scenario files::

    [project.entry-points."flexarm.blocks"]
    HarmonicDrive = "my_package.drives:HarmonicDrive"
"""

from __future__ import annotations

import functools
import importlib
import warnings
from importlib.metadata import EntryPoint, entry_points

from engine.block import Block
from engine.errors import ParameterError, nearest

GROUP = "flexarm.blocks"

_SHIPPED = {
    "sources.constant": ("Constant",),
    "sources.step": ("Step",),
    "sources.pulse": ("Pulse",),
    "sources.sine": ("Sine",),
    "sources.table": ("Table",),
    "controllers.gain": ("Gain",),
    "controllers.sum": ("Sum",),
    "controllers.dead_zone": ("DeadZone",),
    "controllers.saturation": ("Saturation",),
    "controllers.low_pass": ("LowPass",),
    "controllers.pi": ("PI",),
    "actuators.dc_motor": ("DCMotor",),
    "actuators.gear": ("Gear",),
    "actuators.friction": (
        "BearingFriction",
        "JointFriction",
        "TranslationalBearingFriction",
        "TranslationalJointFriction",
    ),
    "actuators.spring_damper": ("SpringDamper", "TranslationalSpringDamper"),
    "actuators.backlash": ("Backlash", "TranslationalBacklash"),
    "actuators.effort": ("Torque", "Force"),
    "links.inertia": ("Inertia", "Mass"),
    "links.fixed": ("Fixed", "TranslationalFixed"),
    "links.rigid_link": ("RigidLink",),
    "links.assumed_modes": ("AssumedModesLink",),
    "sensors.encoder": ("Encoder",),
    "sensors.tachometer": ("Tachometer",),
    "sensors.strain_gauge": ("StrainGauge",),
    "sensors.accelerometer": ("Accelerometer", "TranslationalAccelerometer"),
}


@functools.cache
def registry() -> dict[str, type[Block]]:
    """Type name -> class of every block, shipped ones first; modules are imported at the first call.

    A registered block that cannot be imported, is not a `Block`, or takes a name in use is left out with a warning.
    """
    found: dict[str, type[Block]] = {}
    for module, names in _SHIPPED.items():
        loaded = importlib.import_module(f"blocks.{module}")
        found.update({name: getattr(loaded, name) for name in names})
    for entry in entry_points(group=GROUP):
        problem = _add(found, entry)
        if problem:
            warnings.warn(f"block '{entry.name}' ({entry.value}) is not available: {problem}", stacklevel=2)
    return found


def _add(found: dict[str, type[Block]], entry: EntryPoint) -> str:
    """Add a registered block; the reason why not, if it cannot be."""
    if entry.name in found:
        return "the name is in use"
    try:
        loaded = entry.load()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if not (isinstance(loaded, type) and issubclass(loaded, Block)):
        return "it is not a subclass of engine.block.Block"
    found[entry.name] = loaded
    return ""


def find(name: str) -> type[Block]:
    """The block of a type name.

    Raises:
        ParameterError: there is none; the message names the nearest.
    """
    try:
        return registry()[name]
    except KeyError:
        raise ParameterError(f"there is no block type '{name}'", remedy=nearest(name, registry())) from None
