"""Playing the commands to the truth and writing down what its sensors say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from benchmarks.concealed.bench import Bench
from benchmarks.concealed.nuisance import sensor_noise, slow_course
from benchmarks.concealed.plants.base import Sensor
from benchmarks.concealed.simulator import Loop, Run
from benchmarks.concealed.truth import Truth, fine, simulator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recorded:
    """A recording as it was made: SI units, an encoder's angle in whole counts times its quantum.

    Attributes:
        name: ``rec1``, ``rec2``, ...
        kind: of the command.
        role: train or hold_out.
        time: shape (samples,).
        command: what was logged as the plant's input, shape (samples,).
        measured: shape (samples, sensors).
    """

    name: str
    kind: str
    role: str
    time: Array
    command: Array
    measured: Array


def loop_of(bench: Bench, truth: Truth) -> tuple[list[str], Loop]:
    """The controller, and the signals to simulate: those recorded, and the one it reads if that is another."""
    c = truth.plant.control
    signals = [*bench.signals, *([] if c.sensor in bench.signals else [c.sensor])]
    return signals, Loop(signals.index(c.sensor), c.kp, c.ki, c.kd, c.limit, truth.plant.excitation.resolution)


def controlled(bench: Bench, truth: Truth, step: float = 1e-4) -> list[Run]:
    """Noise-free closed-loop runs of a bench."""
    signals, loop = loop_of(bench, truth)
    made = simulator(truth, signals, bench.interval, step)
    runs = zip(bench.references, bench.slow, bench.start, bench.released, strict=True)
    return [made.run(r, series=slow, start=start, loop=loop, initial=made.at(angle)) for r, slow, start, angle in runs]


def record(
    bench: Bench, truth: Truth, sensors: tuple[Sensor, ...], kinds: list[str], rng: Generator
) -> tuple[Recorded, ...]:
    """Record everything, with noise and counting."""
    loop = None
    signals = list(bench.signals)
    if bench.references:
        signals, loop = loop_of(bench, truth)
    read = [truth.plant.sensor(s) for s in signals]
    made = simulator(truth, signals, bench.interval, fine(truth))
    out = []
    for k, kind in enumerate(kinds):
        stream = default_rng(rng.integers(2**63))
        samples = len(bench.commands[k])
        noise = np.zeros((samples, len(read)))
        drift = np.zeros_like(noise)
        for j, sensor in enumerate(read):
            if not sensor.quantum:
                noise[:, j] = sensor_noise(stream, samples, bench.interval, sensor.noise, truth.nuisance.coloured)
            if j < len(truth.nuisance.sensor_drift):
                drift[:, j] = truth.nuisance.sensor_drift[j] * slow_course(stream, samples, bench.interval)
        run = made.run(
            bench.references[k] if loop else bench.commands[k],
            start=bench.start[k],
            noise=noise,
            quantum=[s.quantum for s in read],
            drift=drift,
            series=bench.slow[k],
            loop=loop,
            initial=made.at(bench.released[k]),
        )
        role = "hold_out" if bench.held_out[k] else "train"
        time = bench.interval * np.arange(samples, dtype=float)
        if truth.plant.habits.jitter:
            time[1:] += truth.plant.habits.jitter * bench.interval * stream.uniform(-1, 1, samples - 1)
        out.append(Recorded(f"rec{k + 1}", kind, role, time, run.command, run.measured[:, : len(sensors)]))
    return tuple(out)


def as_columns(recorded: Recorded, sensors: tuple[Sensor, ...]) -> dict[str, Array]:
    """Columns of the CSV file by name; an encoder's in counts."""
    columns = {"t": recorded.time, "u": recorded.command}
    for j, sensor in enumerate(sensors):
        values = recorded.measured[:, j]
        columns[sensor.column] = np.rint(values / sensor.quantum) if sensor.counts else values
    return columns
