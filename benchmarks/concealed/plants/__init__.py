"""The plants of the benchmark."""

from __future__ import annotations

from benchmarks.concealed.plants.base import Plant
from benchmarks.concealed.plants.belt_axis import BeltAxis
from benchmarks.concealed.plants.harmonic_arm import HarmonicArm
from benchmarks.concealed.plants.pendulum import Pendulum
from benchmarks.concealed.plants.srv02 import Srv02Flexible
from benchmarks.concealed.plants.two_mass import GearedTwoMass

PLANTS: dict[str, Plant] = {p.name: p for p in (Srv02Flexible(), GearedTwoMass(), HarmonicArm(), Pendulum())}

DRIVEN: dict[str, Plant] = {p.name: p for p in (BeltAxis(),)}
"""Further plants, of the suite of drives alone: the draws of the others follow from the order of those above."""
