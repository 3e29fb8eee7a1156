"""FMU export, and checks of the FMU with FMPy. Part of flexarm.

    import fmu

    fmu.export(model, "arm.fmu")
    problems = fmu.validate("arm.fmu")

Names are imported on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fmu.package import export
    from fmu.verify import compare_with_runner, cosim, validate

_PLACES = {
    "compare_with_runner": "fmu.verify",
    "cosim": "fmu.verify",
    "export": "fmu.package",
    "validate": "fmu.verify",
}

__all__ = ["compare_with_runner", "cosim", "export", "validate"]


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(importlib.import_module(_PLACES[name]), name)
    raise AttributeError(f"module 'fmu' has no attribute '{name}'")
