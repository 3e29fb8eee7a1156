"""flexarm: flexible-link robot arms and servo drives as composable blocks.

    import flexarm

    scenario = flexarm.load("quanser-single-link", ["gear.ratio=14"])
    result = flexarm.simulate(scenario)
    result["link.hub.angle"]

A block of your own is a subclass of `Block`; the functions for its law are in `flexarm.symbolic`. `flexarm.design` has
those for designing controllers. Names are imported on first use, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from flexarm import _packages

_packages.claim()

if TYPE_CHECKING:
    from diagnosis.api import DiagnosisOptions, diagnose, fit, plan
    from diagnosis.compare import Comparison
    from diagnosis.recordings.types import FrequencyTable, Recording
    from engine.assemble import build
    from engine.batch import Case, batch
    from engine.block import Block, flange, option, parameter, signal_in, signal_out
    from engine.discretise import DiscreteModel
    from engine.errors import FlexarmError, ParameterError
    from engine.family import LinearFamily
    from engine.linearise import LinearModel
    from engine.model import Model
    from engine.net import Net
    from engine.ports import ROTATIONAL, TRANSLATIONAL, Port
    from engine.quantity import SameAs
    from engine.relations import Relation
    from engine.simulate import Drive, Result, SimulationOptions
    from engine.stamps import Clock, Motion, Velocity
    from engine.system import Connection, System
    from engine.tangent import tangents
    from engine.trim import Equilibrium
    from flexarm._version import version
    from flexarm.api import (
        ExportOptions,
        compare,
        describe,
        discretise,
        export,
        linear_family,
        linearise,
        simulate,
        trim,
        uncertain,
    )
    from flexarm.design.closing import close
    from flexarm.design.margins import LoopMargins, margins
    from flexarm.design.reduction import Reduction, reduce
    from flexarm.plotting.results import plot
    from flexarm.sweeps.sweep import SweepOptions, sweep
    from flexarm.table import read
    from scenarios.jsonschema import json_schema
    from scenarios.load import Scenario, load

_PLACES = {
    "Block": "engine.block",
    "Case": "engine.batch",
    "Clock": "engine.stamps",
    "Comparison": "diagnosis.compare",
    "Connection": "engine.system",
    "DiagnosisOptions": "diagnosis.api",
    "DiscreteModel": "engine.discretise",
    "Drive": "engine.simulate",
    "Equilibrium": "engine.trim",
    "ExportOptions": "flexarm.api",
    "FlexarmError": "engine.errors",
    "FrequencyTable": "diagnosis.recordings.types",
    "LinearFamily": "engine.family",
    "LinearModel": "engine.linearise",
    "LoopMargins": "flexarm.design.margins",
    "Model": "engine.model",
    "Motion": "engine.stamps",
    "Net": "engine.net",
    "ParameterError": "engine.errors",
    "Port": "engine.ports",
    "ROTATIONAL": "engine.ports",
    "Recording": "diagnosis.recordings.types",
    "Relation": "engine.relations",
    "Reduction": "flexarm.design.reduction",
    "Result": "engine.simulate",
    "SameAs": "engine.quantity",
    "Scenario": "scenarios.load",
    "SimulationOptions": "engine.simulate",
    "SweepOptions": "flexarm.sweeps.sweep",
    "System": "engine.system",
    "TRANSLATIONAL": "engine.ports",
    "Velocity": "engine.stamps",
    "batch": "engine.batch",
    "build": "engine.assemble",
    "close": "flexarm.design.closing",
    "compare": "flexarm.api",
    "describe": "flexarm.api",
    "diagnose": "diagnosis.api",
    "discretise": "flexarm.api",
    "export": "flexarm.api",
    "fit": "diagnosis.api",
    "flange": "engine.block",
    "json_schema": "scenarios.jsonschema",
    "linear_family": "flexarm.api",
    "linearise": "flexarm.api",
    "load": "scenarios.load",
    "margins": "flexarm.design.margins",
    "option": "engine.block",
    "parameter": "engine.block",
    "plan": "diagnosis.api",
    "plot": "flexarm.plotting.results",
    "read": "flexarm.table",
    "reduce": "flexarm.design.reduction",
    "signal_in": "engine.block",
    "signal_out": "engine.block",
    "simulate": "flexarm.api",
    "sweep": "flexarm.sweeps.sweep",
    "tangents": "engine.tangent",
    "trim": "flexarm.api",
    "uncertain": "flexarm.api",
    "version": "flexarm._version",
}

_MODULES = ("design", "symbolic")

__all__ = [
    "ROTATIONAL",
    "TRANSLATIONAL",
    "Block",
    "Case",
    "Clock",
    "Comparison",
    "Connection",
    "DiagnosisOptions",
    "DiscreteModel",
    "Drive",
    "Equilibrium",
    "ExportOptions",
    "FlexarmError",
    "FrequencyTable",
    "LinearFamily",
    "LinearModel",
    "LoopMargins",
    "Model",
    "Motion",
    "Net",
    "ParameterError",
    "Port",
    "Recording",
    "Reduction",
    "Relation",
    "Result",
    "SameAs",
    "Scenario",
    "SimulationOptions",
    "SweepOptions",
    "System",
    "Velocity",
    "batch",
    "build",
    "close",
    "compare",
    "describe",
    "diagnose",
    "discretise",
    "export",
    "fit",
    "flange",
    "json_schema",
    "linear_family",
    "linearise",
    "load",
    "margins",
    "option",
    "parameter",
    "plan",
    "plot",
    "read",
    "reduce",
    "signal_in",
    "signal_out",
    "simulate",
    "sweep",
    "tangents",
    "trim",
    "uncertain",
    "version",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from flexarm._version import version

        return version()
    if name in _MODULES:
        return importlib.import_module(f"flexarm.{name}")
    if name not in _PLACES:
        raise AttributeError(f"module 'flexarm' has no attribute '{name}'")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__", *_MODULES]
