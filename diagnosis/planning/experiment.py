"""The planned experiment: recordings that are described, or the scenario's own run, as a problem without data.

What would be measured is what the model as given does; its noise is that of the sensors. So a residual is what an
effect adds, in standard deviations of the noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diagnosis.effects.effect import Candidate
from diagnosis.effects.places import node, slides
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.problems import problem
from diagnosis.recordings.types import Channel, FrequencyTable, Recorded, Recording
from engine.assemble import build
from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.ports import MOTION, ROTATIONAL, TRANSLATIONAL
from engine.quantity import convert
from engine.simulate import Result, simulate
from engine.system import System
from scenarios.amend import Set
from scenarios.load import Scenario
from scenarios.variant import edited, renamed

COUNTS = 4096
"""Counts per revolution of an encoder that nothing is known of."""

LENGTH = 1e-5
"""Length (m) of a count of a linear scale that nothing is known of."""

SHARE = 0.01
"""Noise of any other sensor that nothing is known of, as a share of its signal's range."""

PLANNED = "planned"
"""Name of the scenario's own run as a recording."""


@dataclass(frozen=True)
class Sensor:
    """A sensor that is planned, or that could be added.

    Attributes:
        signal: that it reads.
        kind: what it is, in words.
        unit: of the signal.
        sigma: standard deviation of its noise, in ``unit``.
        noise: where that comes from, in words.
    """

    signal: str
    kind: str
    unit: str
    sigma: float
    noise: str

    @property
    def label(self) -> str:
        """In words."""
        flange, _, quantity = self.signal.rpartition(".")
        return f"{self.kind} at {flange if quantity in _MOTIONS else self.signal}"


@dataclass(frozen=True)
class Planned:
    """An experiment before it is done.

    Attributes:
        problem: on the model as given; its recordings hold what that does.
        wide: the same with every further sensor behind the planned ones.
        sensors: that are planned, in the order of the outputs.
        further: sensors that could be added, in the order of the outputs behind them.
        assumed: what was assumed, in sentences.
    """

    problem: Problem
    wide: Problem
    sensors: tuple[Sensor, ...]
    further: tuple[Sensor, ...]
    assumed: tuple[str, ...]


def recorded(scenario: Scenario, recordings: Sequence[Recorded]) -> Planned:
    """The experiment that recordings describe: their inputs, sensors and noise; what was measured does not matter.

    Raises:
        FlexarmError: recordings that do not fit the scenario, or frequency-response tables.
    """
    for r in recordings:
        if isinstance(r, FrequencyTable):
            raise FlexarmError(
                f"'{r.name}' is a frequency-response table, and only an experiment over time can be planned",
                remedy="name recordings over time, or --measure signals of the scenario's own run",
            )
    base = problem(scenario, recordings)
    first = over_time(base.experiments)[0]
    sensors = []
    for k, variable in enumerate(base.model.outputs):
        stated = bool(first.noise_stated) and first.noise_stated[k]
        told = "as stated" if stated else "estimated from the recordings"
        sensors.append(Sensor(variable.name, _kind(variable.name), variable.unit, float(first.sigma[k]), told))
    return _planned(base, sensors, [])


def own_run(scenario: Scenario, measure: Mapping[str, str] | None = None) -> Planned:
    """The scenario's own run: its sources drive the inputs, sampled as it records, and sensors read the signals.

    Args:
        scenario: with a ``simulate`` section.
        measure: signals with the standard deviation of their noise as text, empty for the usual one; all sensors of the
            scenario, or what it records, if None.

    Raises:
        FlexarmError: nothing to simulate or to measure, or an unknown signal.
    """
    run = scenario.simulation
    if run is None:
        raise FlexarmError(
            "the scenario does not say how to simulate",
            Where(scenario.document.file),
            "add 'simulate: {stop: 5 s, step: 1 ms}', or describe recordings",
        )
    assumed: list[str] = []
    known = {v.name: v.unit for v in build(scenario.system).outputs}
    asked = _asked(scenario, measure, known, assumed)
    scenario = _unrounded(scenario, asked)
    sources = _sources(scenario.system)
    ends = [end for targets in sources.values() for end in targets]
    names = list(dict.fromkeys([*asked, *sources]))
    result = simulate(scenario.build([], names), run.stop, run.step, internal_step=run.internal_step, log_capacity=0)
    moving = [s for s in sources if float(np.ptp(result[s])) > 0] or list(sources)
    drives = []
    for source in moving:
        unit = known.get(source, "")
        drives += [Channel(end, unit, np.asarray(result[source]), source) for end in sources[source]]
    if not drives and ends:
        raise FlexarmError("no source drives an input")
    sensors = _sensors(scenario, asked, known, result, assumed)
    channels = tuple(Channel(s.signal, s.unit, np.asarray(result[s.signal]), s.signal, noise=s.sigma) for s in sensors)
    period = float(result.time[1] - result.time[0])
    assumed.append(f"the run of the scenario, {run.stop:g} s, sampled every {1e3 * period:g} ms")
    if drives:
        driven = ", ".join(c.name for c in drives)
        assumed.append(f"the input is held from one sample to the next, and logged ({driven})")
    made = Recording(PLANNED, "", np.asarray(result.time), tuple(drives), channels, as_measured=True)
    return _planned(problem(scenario, [made]), sensors, assumed)


def _asked(
    scenario: Scenario, measure: Mapping[str, str] | None, known: Mapping[str, str], assumed: list[str]
) -> dict[str, str]:
    """Signals to measure, with their noise as text."""
    if measure:
        found = {}
        for name, noise in measure.items():
            signal = scenario.resolve(name)
            if signal not in known:
                raise FlexarmError(f"the model has no signal '{name}'", Where("--measure"), nearest(name, list(known)))
            found[signal] = noise
        return found
    system = scenario.system
    sensors = [
        f"{name}.{port.name}"
        for name, block in system.blocks.items()
        if _is_sensor(block)
        for port in block.ports.values()
        if port.role == "output" and port.name == "out"
    ]
    if sensors:
        assumed.append("measured is what the scenario's sensors give out")
        return dict.fromkeys(sensors, "")
    own = set(_sources(system))
    run = scenario.simulation
    listed = [scenario.resolve(name) for name in (run.record if run else None) or ()]
    listed = [name for name in listed if name in known and name not in own and not _before_plant(system, name)]
    if not listed:
        raise FlexarmError(
            "nothing is measured: the scenario has no sensor, and records no signal",
            Where(scenario.document.file),
            "name signals and their noise: --measure motor.shaft.angle=0.1deg",
        )
    assumed.append("the scenario has no sensors: measured is what it records")
    return dict.fromkeys(listed, "")


def _is_sensor(block: Any) -> bool:
    """Whether a block is of the library's sensors."""
    return any(kind.__module__.startswith("blocks.sensors.") for kind in type(block).__mro__)


def _before_plant(system: System, signal: str) -> bool:
    """Whether a signal is computed by blocks without flanges, from signals alone: nothing that a sensor reads."""
    block = system.blocks[system.split(signal)[0]]
    return all(port.role != "flange" for port in block.ports.values())


def _unrounded(scenario: Scenario, asked: Mapping[str, str]) -> Scenario:
    """The scenario with ideal encoders where they are measured: their counts are noise, and have no derivative."""
    edits = []
    for signal in asked:
        name = scenario.system.split(signal)[0]
        block = scenario.system.blocks[name]
        if block.values.get("rounding", "none") != "none":
            edits.append(Set(name, "rounding", "none"))
    return edited(scenario, edits) if edits else scenario


def _sources(system: System) -> dict[str, list[str]]:
    """The outputs of blocks that have nothing but outputs, each with the inputs that it feeds."""
    found: dict[str, list[str]] = {}
    for connection in system.connections:
        fed = [end for end in connection.ends if system.is_input(end)]
        for end in connection.ends:
            if end in fed or system.observable(end) is not None:
                continue
            block, port = system.split(end)
            ports = system.blocks[block].ports
            if port in ports and all(one.role == "output" for one in ports.values()):
                found.setdefault(end, []).extend(fed)
    return found


def _sensors(
    scenario: Scenario, asked: Mapping[str, str], known: Mapping[str, str], result: Result, assumed: list[str]
) -> list[Sensor]:
    made = []
    for signal, text in asked.items():
        unit = known[signal]
        if text:
            try:
                sigma = float(convert(text, unit if unit != "*" else "1"))
            except ParameterError as error:
                raise error.at(Where(f"--measure {signal}")) from None
            if not 0 < sigma < math.inf:
                raise ParameterError(
                    f"a noise of {text}", Where(f"--measure {signal}"), "give the standard deviation, above zero"
                )
            made.append(Sensor(signal, _kind(signal), unit, sigma, "as given"))
            continue
        sigma, told = _usual(signal, unit, np.asarray(result[signal]), scenario)
        assumed.append(f"noise of {signal}: {sigma:.3g} {unit}, {told}")
        made.append(Sensor(signal, _kind(signal), unit, sigma, told))
    return made


def _usual(signal: str, unit: str, values: Array, scenario: Scenario | None = None) -> tuple[float, str]:
    """Noise of a sensor that nothing else is known of: its standard deviation, and why."""
    block = scenario.system.blocks[scenario.system.split(signal)[0]] if scenario is not None else None
    given = block.values if block is not None and _is_sensor(block) else {}
    if "counts_per_revolution" in given:
        counts = float(given["counts_per_revolution"])
        return 2 * math.pi / counts / math.sqrt(12), f"a count of {counts:g} per revolution over the root of 12"
    if "resolution" in given:
        return float(given["resolution"]) / math.sqrt(12), "its resolution over the root of 12"
    if signal.endswith(".angle") and unit == "rad":
        return 2 * math.pi / COUNTS / math.sqrt(12), f"an encoder of {COUNTS} counts per revolution"
    if signal.endswith(".position") and unit == "m":
        return LENGTH / math.sqrt(12), f"a scale of {1e6 * LENGTH:g} um"
    spanned = float(np.ptp(values)) or float(np.abs(values).max()) or 1.0
    return SHARE * spanned, f"{100 * SHARE:g} % of its range"


_MOTIONS = {
    name: kind
    for names, kinds in (
        (MOTION[ROTATIONAL], ("encoder", "tachometer", "accelerometer")),
        (MOTION[TRANSLATIONAL], ("linear scale", "speed sensor", "accelerometer")),
    )
    for (name, _), kind in zip(names[:3], kinds, strict=True)
}
"""Motion of a flange: what measures it."""

_FURTHER = {
    "current": "current sensor",
    "deflection": "deflection sensor",
    "curvature": "strain gauge",
    "twist": "torsion sensor",
}
"""Last part of a signal's name: what measures it, besides motions."""


def _kind(signal: str) -> str:
    """What measures a signal."""
    quantity = signal.rpartition(".")[2]
    return {**_FURTHER, **_MOTIONS}.get(quantity, "sensor")


def _could_be_added(scenario: Scenario, problem: Problem) -> Iterator[str]:
    """Signals that a further sensor could read: motions on both sides of each connection, currents and strains."""
    system = scenario.system
    taken = {v.name for v in problem.model.outputs}
    known = [v.name for v in build(system).outputs]
    flanges = list(problem.model.motions)
    seen: set[str] = set()
    for flange in flanges:
        if flange in seen:
            continue
        ends = [end for end in node(system, flange) if end in flanges]
        seen.update(ends)
        names = [name for name, _ in MOTION[TRANSLATIONAL if slides(system, flange) else ROTATIONAL][:3]]
        for k, end in enumerate(dict.fromkeys((ends[0], ends[-1]))):
            for name in names[:2] if k == 0 else names:
                # Both ends of a connection move alike, and differ only where it is cut.
                if f"{end}.{name}" in known and f"{end}.{name}" not in taken:
                    yield f"{end}.{name}"
    for name in known:
        block, _, rest = name.partition(".")
        if rest.rpartition(".")[2] in _FURTHER and not _is_sensor(system.blocks[block]) and name not in taken:
            yield name


def _planned(base: Problem, sensors: Sequence[Sensor], assumed: Sequence[str]) -> Planned:
    """The experiment, its samples replaced by what the model as given does."""
    x = np.zeros(len(base.free))
    given = over_time(base.experiments)
    own = tuple(_silent(e, base.simulate(x, e)) for e in given)
    base = replace(base, experiments=own)
    return _widened_by(base, list(_could_be_added(base.scenario, base)), sensors, assumed)


def with_signals_left(planned: Planned, effects: Sequence[Candidate]) -> Planned:
    """The experiment without further sensors that effects leave nothing to read, as the twist of a spring with play."""
    scenario, names = planned.problem.scenario, [s.signal for s in planned.further]
    lost: set[str] = set()
    for effect in effects:
        inside = [name for name in names if name.startswith(f"{effect.place}.")]
        if inside:
            edits = effect.edits(effect.starts[0])
            try:
                known = {v.name for v in build(edited(scenario, edits).system).outputs}
            except FlexarmError:
                continue  # an effect that cannot be put in is told as such
            lost |= {name for name, there in zip(inside, renamed(inside, edits), strict=True) if there not in known}
    if not lost:
        return planned
    kept = [name for name in names if name not in lost]
    assumed = [
        *planned.assumed,
        *(f"no sensor of {name} is looked at: an effect takes its place" for name in sorted(lost)),
    ]
    return _widened_by(planned.problem, kept, planned.sensors, assumed)


def _widened_by(base: Problem, extra: Sequence[str], sensors: Sequence[Sensor], assumed: Sequence[str]) -> Planned:
    """The experiment with further signals."""
    x = np.zeros(len(base.free))
    own, names = over_time(base.experiments), [v.name for v in base.model.outputs]
    model = base.scenario.build([v.name for v in base.model.inputs], [*names, *extra])
    wide = replace(base, model=model)
    runs = [wide.simulate(x, e) for e in own]
    further = []
    for k, variable in enumerate(model.outputs[len(names) :], len(names)):
        values = np.concatenate([run[:, k] for run in runs])
        if float(np.ptp(values)) == 0:
            sigma, told = 1.0, "nothing moves there"
        else:
            sigma, told = _usual(variable.name, variable.unit, values)
        further.append(Sensor(variable.name, _kind(variable.name), variable.unit, sigma, told))
    widened = tuple(_widened(e, run, further) for e, run in zip(own, runs, strict=True))
    return Planned(base, replace(wide, experiments=widened), tuple(sensors), tuple(further), tuple(assumed))


def _silent(e: TimeExperiment, rows: Array) -> TimeExperiment:
    """The experiment with what the model does in place of what was measured; where nothing was, nothing is."""
    made = e.sampled(rows)
    made = made - np.where(e.from_first, made[0], 0.0)
    return replace(e, measured=np.where(np.isfinite(e.measured), made, np.nan), role="train")


def _widened(e: TimeExperiment, rows: Array, further: Sequence[Sensor]) -> TimeExperiment:
    """The experiment with further signals, which tell nothing of where it begins."""
    count = len(further)
    made = e.sampled(rows)[:, -count:] if count else np.zeros((len(e.time), 0))
    first = e.first
    sigma = np.array([s.sigma for s in further])
    if first is not None:
        first = replace(
            first,
            measured=np.column_stack([first.measured, np.full((len(first.measured), count), np.nan)]),
            sigma=np.concatenate([first.sigma, sigma]),
            stated=(*first.stated, *[True] * count),
            from_first=(*first.from_first, *[False] * count),
        )
    return replace(
        e,
        measured=np.column_stack([e.measured, made]),
        sigma=np.concatenate([e.sigma, sigma]),
        from_first=(*e.from_first, *[False] * count),
        noise_stated=(*(e.noise_stated or [True] * len(e.sigma)), *[True] * count),
        logged=(*(e.logged or [1.0] * len(e.sigma)), *[1.0] * count),
        first=first,
    )
