"""An effect as one size that can be made small: how its parameters go together, and what the size is called.

A catalogue entry may have several parameters: a joint that gives way has a stiffness and a damping, play has faces that
give, a dead zone two ends. Made small they shrink together: what decides how much shows is one number, and the others
stay in proportion to it. Orders and frequencies do not shrink; some of them stand for all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.effects.effect import Candidate, Sizes

SHAPES = frozenset(
    {
        "phase",
        "hanging_angle",
        "rest_angle",
        "rest_position",
        "frequency",
        "damping_ratio",
        "order",
        "wavelength",
        "stribeck_velocity",
        "residual_share",
        "loading_share",
    }
)
"""Parameters that say what an effect is like, and not how large it is."""

TURNS = frozenset({"phase", "hanging_angle"})
"""Those of them that any value may have, whatever the machine does."""

SEVERAL = frozenset({"order", "frequency"})
"""Those of them that decide what the effect can be taken for: some of them are looked at one by one."""

MEMBERS = 3
"""How many of them."""

IN_JOINT = {
    "stiffness": -1.0,
    "damping": -0.5,
    "cubic_stiffness": -3.0,
    "half_gap": 1.0,
    "yield_twist": 1.0,
    "yield_deflection": 1.0,
}
"""Powers of a joint that gives way: half as stiff, it twists twice as far; its damping ratio stays."""

IN_SPRING = {"yield_twist": -1.0, "yield_deflection": -1.0}
"""Powers of a law in the place of a spring: one that never yields is the spring."""

OF_DRIVES = {
    "rate_limit": {"rising": -1.0},
    "supply_sag": {"resistance": 1.0},
    "dead_time": {"lost_voltage": 1.0},
    "belt_slack": {"pretension": -1.0},
    "warm_up": {"winding_heat_capacity": -1.0, "winding_thermal_resistance": 1.0},
    "friction_warm_up": {"heat_capacity": -1.0, "thermal_resistance": 1.0},
}
"""Powers of what drives leave out: a limit, a pretension and a heat capacity are hardly there where they are large."""

NEAR_ONE = {"uneven_gain": "backward", "sensor_scale": "gain"}
"""Effects that are none where a gain is one: its parameter. Their size is how far the gain is from one."""

LIMITS = frozenset({"saturation", "current_limit"})
"""Effects that are none where a limit is not reached: their size is how far it lies below the largest start."""

FIXED_LAWS = frozenset({"structural_damping", "rectified_sensor", "one_sided_contact", "end_stop"})
"""Laws that no size makes small: they are another law, or not."""

JOINT_LAWS = frozenset({"joint_flexibility", "backlash", "hardening_spring", "hysteresis"})

LARGEST = 3.0
"""Multiple of a size that matters, or of the largest start, beyond which an effect is no longer looked for."""

FIRST = 0.02
"""The share of a size that matters from which the search for the smallest size begins."""

WIDEST = 3.0
"""Logarithm of the factor by which a parameter may be wrong at most."""

SOFTEST = 1e3
"""Multiple of a joint's middle size that is looked at."""

UNTOUCHED = 0.999
"""Share of the largest input at which the catalogue's first limit lies: see `diagnosis.effects.signal`."""


@dataclass(frozen=True)
class Family:
    """An effect at a place, of one shape and any size.

    Attributes:
        candidate: of the catalogue.
        base: sizes of its parameters at size 1.
        powers: by which each parameter goes with the size.
        lead: the parameter that is told; empty where the effect has no size.
        shape: what else it is told with, such as ``order 4``.
        first, largest: sizes to begin from and not to exceed.
        matters: a size that matters.
    """

    candidate: Candidate
    base: Sizes
    powers: dict[str, float]
    lead: str = ""
    shape: str = ""
    first: float = 1.0
    largest: float = math.inf
    matters: float = 1.0

    @property
    def sized(self) -> bool:
        """Whether it can be made small."""
        return bool(self.lead)

    @property
    def label(self) -> str:
        """Effect, shape and place."""
        shape = f" ({self.shape})" if self.shape else ""
        return f"{self.candidate.effect}{shape} at {self.candidate.place}"

    def sizes(self, size: float) -> Sizes:
        """The parameters at a size."""
        effect = self.candidate.effect
        if effect in NEAR_ONE:
            return {**self.base, NEAR_ONE[effect]: 1 + size}
        if effect in LIMITS:
            return {key: value * (1 - size) for key, value in self.base.items()}
        return {key: value * size ** self.powers.get(key, 0.0) for key, value in self.base.items()}

    def turned(self, phase: float) -> Family:
        """The same with its wave shifted in phase."""
        return replace(self, base={k: v + phase if k in TURNS else v for k, v in self.base.items()})

    def told(self, size: float) -> float:
        """The number that is told of a size (SI): of the leading parameter, or how far a gain is from one."""
        effect = self.candidate.effect
        if effect in NEAR_ONE:
            return size
        if self.candidate.freed is not None:
            return self.candidate.freed.value(size) / self.candidate.freed.start - 1
        value = self.sizes(size)[self.lead]
        return 1 / value if self.lead == "corner_frequency" else abs(value)


def families(candidate: Candidate) -> Iterator[Family]:
    """The shapes of an effect that are looked at."""
    effect = candidate.effect
    if candidate.freed is not None:
        f = candidate.freed
        largest = WIDEST / f.scale if f.logarithmic else WIDEST * abs(f.start) / f.scale
        yield Family(candidate, {}, {}, f.name, first=1.0, largest=largest, matters=1 / f.scale)
        return
    known = {p.name: p for p in candidate.parameters}
    if not known or effect in FIXED_LAWS or (candidate.name == candidate.place and "stiffness" in known):
        yield Family(candidate, candidate.starts[0], {})
        return
    powers = _powers(candidate)
    lead = next(name for name, power in powers.items() if power)
    starts = candidate.starts
    shapes = sorted({tuple((k, s[k]) for k in sorted(SEVERAL & {*s})) for s in starts})
    chosen = sorted({round(i) for i in np.linspace(0, len(shapes) - 1, MEMBERS)}) if len(shapes) > 1 else [0]
    for shape in (shapes[i] for i in chosen):
        able = [s for s in starts if all(s[k] == v for k, v in shape)]
        base = able[len(able) // 2]
        words = [f"order {v:g}" if k == "order" else f"{v:.3g} rad/s" for k, v in shape]
        if len(shapes) == 1 and "order" not in dict(shape):
            words = []
        first, largest, matters = 1.0, 1.0, 1.0
        if effect in NEAR_ONE:
            first = 0.01
        elif effect in LIMITS:
            top = max(abs(v) for s in starts for v in s.values()) / UNTOUCHED
            base, first, largest = {key: math.copysign(top, value) for key, value in base.items()}, 0.02, 0.9
        elif effect in JOINT_LAWS and "stiffness" in known:
            # Play between faces that hardly give, rather than a soft joint with a little play.
            stiffest = max(s["stiffness"] for s in able)
            base = [s for s in able if s["stiffness"] == stiffest or effect != "backlash"][-len(able) // 4]
            largest = SOFTEST
            matters = abs(known[lead].reference / base[lead]) ** (1 / powers[lead])
        else:
            matters = abs(known[lead].reference / base[lead]) ** (1 / powers[lead])
            first = FIRST * matters
            largest = LARGEST * max(matters, *((s[lead] / base[lead]) ** (1 / powers[lead]) for s in able))
        yield Family(candidate, dict(base), powers, lead, ", ".join(words), first, largest, matters)


def _powers(candidate: Candidate) -> dict[str, float]:
    """The power of each parameter: that of a joint or a spring, of a corner frequency, or one."""
    names = [p.name for p in candidate.parameters]
    if candidate.effect in ("lag", "sensor_lag"):
        return {"corner_frequency": -1.0}
    if candidate.effect in OF_DRIVES:
        return OF_DRIVES[candidate.effect]
    if candidate.effect in JOINT_LAWS:
        table = IN_JOINT if "stiffness" in names else IN_SPRING
        found = {name: table.get(name, 0.0 if name in SHAPES else 1.0) for name in names}
        return dict(sorted(found.items(), key=lambda item: item[0] != "half_gap"))
    return {name: 0.0 if name in SHAPES else 1.0 for name in names}
