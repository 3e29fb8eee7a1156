"""Signal blocks: controllers, filters and characteristics."""

from __future__ import annotations

import importlib
from typing import Any


def __getattr__(name: str) -> Any:
    """Designs and conversions, imported when they are asked for."""
    modules = {"from_control": "control_systems", "kalman": "design", "lqr": "design"}
    if name in modules:
        return getattr(importlib.import_module(f"{__name__}.{modules[name]}"), name)
    raise AttributeError(f"module 'blocks.controllers' has no attribute '{name}'")
