"""One case of the benchmark: a truth with something concealed, its recordings, and what the tool may see of it."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from numpy.random import SeedSequence, default_rng

from benchmarks.concealed.bench import Bench
from benchmarks.concealed.drawing import Options, choose_sensors, hide, make_bench, true_parameters
from benchmarks.concealed.named import plant as named
from benchmarks.concealed.nuisance import MOST, nuisance, smaller
from benchmarks.concealed.plants.base import Plant, Sensor
from benchmarks.concealed.recording import Recorded, record
from benchmarks.concealed.sites import Site, find
from benchmarks.concealed.truth import Truth


@dataclass(frozen=True)
class Case:
    """What was drawn, and what came of it.

    Attributes:
        plant, seed, options: what was asked for.
        truth: what the recordings are made of.
        nominal: the scenario's parameters (SI).
        sensors: what is recorded.
        recordings: training first.
        bench: the same recordings without noise, for thresholds and ties.
        asked: the sizes asked for, in thresholds.
        sizes, thresholds, visible: per effect, its size, that at which it is as large as the floor, and how large it
            is in units of the floor (held out, after a refit, without noise).
        sites: per effect.
    """

    plant: Plant
    seed: int
    options: Options
    truth: Truth
    nominal: dict[str, float]
    sensors: tuple[Sensor, ...]
    recordings: tuple[Recorded, ...]
    bench: Bench
    asked: tuple[float, ...]
    sizes: tuple[float, ...]
    thresholds: tuple[float, ...]
    visible: tuple[float, ...]
    sites: tuple[Site, ...]

    def answers(self) -> dict[str, Any]:
        """What is sealed."""
        concealed = [
            {
                "effect": c.effect,
                "place": c.place,
                "same_place": list(site.same),
                "parameters": dict(c.parameters),
                "size_asked": asked,
                "size": size,
                "size_means": site.effect.size,
                "threshold": threshold,
                "size_in_thresholds": size / threshold if threshold > 0 else None,
                "excess_in_floors": visible,
            }
            for c, site, asked, size, threshold, visible in zip(
                self.truth.concealed,
                self.sites,
                self.asked,
                self.sizes,
                self.thresholds,
                self.visible,
                strict=True,
            )
        ]
        return {
            "plant": self.plant.name,
            "seed": self.seed,
            "options": asdict(self.options),
            "effects": [c.effect for c in self.truth.concealed] or ["none"],
            "concealed": concealed,
            "true_parameters": dict(self.truth.parameters),
            "nominal_parameters": self.nominal,
            "nuisance": asdict(self.truth.nuisance),
            "recordings": [
                {"name": r.name, "kind": r.kind, "role": r.role, "released_from": angle}
                for r, angle in zip(self.recordings, self.bench.released, strict=True)
            ],
            "sigma": {s.signal: s.sigma for s in self.sensors},
        }


def _share(plant: Plant, visible: Sequence[float]) -> float:
    """Factor on the usual background, where a plant's goes by the effect: that it leaves no more than a share of it."""
    if not plant.habits.hidden or not visible:
        return 1.0
    return plant.habits.hidden * min(visible) / MOST


def draw(
    plant: Plant | str,
    effects: Sequence[str] = (),
    sizes: Sequence[float] = (),
    seed: int = 0,
    options: Options | None = None,
) -> Case:
    """Draw a case.

    Args:
        plant: one of the plants, or a name, such as ``pendulum`` or ``rig-17``.
        effects: ``effect`` or ``effect@place``; none for a case that conceals nothing.
        sizes: one for each effect, in detection thresholds; one for all is enough.
        seed: everything random follows from it, the plant and the effects.
        options: departures from the usual.

    Raises:
        ValueError: no such plant, an effect or place that it does not have, or effects that exclude each other.
    """
    options = options or Options()
    plant = named(plant) if isinstance(plant, str) else plant
    effects = [e for e in effects if e != "none"]
    chosen = tuple(find(plant, e) for e in effects)
    asked = tuple(float(s) for s in (sizes or [3.0]))
    asked = asked * len(chosen) if len(asked) == 1 else asked
    if len(asked) != len(chosen):
        raise ValueError(f"{len(chosen)} effects but {len(asked)} sizes")
    key = zlib.crc32(" ".join([plant.name, *map(str, chosen)]).encode())
    streams = [default_rng(s) for s in SeedSequence([seed, key]).spawn(6)]
    parameters, commands, features, disturbances, noise, others = streams

    base = Truth(plant, true_parameters(plant, parameters, options))
    nominal = dict(base.parameters) if options.exact else plant.nominal()
    sensors = choose_sensors(plant, options, chosen)
    bench, kinds = make_bench(base, nominal, sensors, commands, options)
    amplitude, concealed, found = hide(bench, base, chosen, asked, features)
    bench = bench.scaled(amplitude)
    background = nuisance(bench, base, disturbances, options.nuisance * _share(plant, [f[2] for f in found]))
    if options.kinds and not plant.habits.hidden:
        # The background is the plant's, and small on its usual recordings too, to which an experiment may lead.
        usual = make_bench(base, nominal, sensors, others, replace(options, kinds=()))[0]
        background = smaller(background, nuisance(usual, base, others, options.nuisance))
    truth = replace(base, concealed=concealed, nuisance=background)
    recordings = record(bench, truth, sensors, kinds, noise)
    bench = replace(bench, commands=tuple(r.command for r in recordings))
    return Case(
        plant,
        seed,
        options,
        truth,
        nominal,
        sensors,
        recordings,
        bench,
        asked,
        tuple(f[0] for f in found),
        tuple(f[1] for f in found),
        tuple(f[2] for f in found),
        chosen,
    )
