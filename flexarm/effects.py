"""What the author of an effect needs; the how-to page "Register an effect" goes through one.

An effect is a function of `OperatingScales` and a `Place` that gives `Candidate` objects, registered under the entry
point group ``flexarm.effects``. `at_flange`, `in_joint`, `in_signal` and `behind_sensor` make candidates that put one
block in; any other change of the scenario is a `Candidate` with its own edits.
"""

from __future__ import annotations

from diagnosis.api import possible_effects
from diagnosis.effects.effect import NAME, Candidate, EffectParameter, Sizes, Wave, combinations, shares, with_unit
from diagnosis.effects.insertion import at_flange, behind_sensor, in_joint, in_signal
from diagnosis.effects.places import BLOCK, INPUT, JOINT, SENSOR, SHAFT, Place
from diagnosis.effects.scales import OperatingScales
from scenarios.amend import AtFlange, Between, Edit, InSignal, OnSensor, Replace, Set

__all__ = [
    "BLOCK",
    "INPUT",
    "JOINT",
    "NAME",
    "SENSOR",
    "SHAFT",
    "AtFlange",
    "Between",
    "Candidate",
    "Edit",
    "EffectParameter",
    "InSignal",
    "OnSensor",
    "OperatingScales",
    "Place",
    "Replace",
    "Set",
    "Sizes",
    "Wave",
    "at_flange",
    "behind_sensor",
    "combinations",
    "in_joint",
    "in_signal",
    "possible_effects",
    "shares",
    "with_unit",
]
