"""What a rig is made to do and how it is watched: commands, controller, sensors, habits; from its nominal motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from benchmarks.concealed import excitation
from benchmarks.concealed.drawing import Options, smooth
from benchmarks.concealed.mechanism import Readout, discretise
from benchmarks.concealed.plants.base import Control, Excitation, Habits, LinkOptions, Sensor
from benchmarks.concealed.rigs.numbers import log_uniform, significant
from benchmarks.concealed.rigs.rig import Rig
from benchmarks.concealed.rigs.topology import Probe
from benchmarks.concealed.simulator import Diverged, Loop, Simulator
from benchmarks.concealed.truth import Truth

Array = NDArray[np.float64]

RATES = (100, 125, 200, 250, 400, 500, 800, 1000, 1250, 2000, 2500, 4000, 5000)
"""Samples per second; their intervals are whole microseconds, as the files are written."""

ROWS = (400, 10_000)
"""Fewest and most rows of a recording: 5 kHz for 30 s would only measure patience."""

KINDS = ("multi_step", "prbs", "chirp", "reversal", "ramp", "coast")

FINEST = 2e5
"""Largest range of a signal in units of its quantum or noise."""

FILTER = 0.01
"""Time constant (s) of the controller's derivative, as `Loop` has it."""


def protocol(rig: Rig, rng: Generator) -> Options:
    """Rate, length and kinds of the recordings; sets how many of them are to train on."""
    fastest = _fastest(rig)
    able = [rate for rate in RATES if rate >= 5 * fastest] or [RATES[-1]]
    while True:
        seconds = round(log_uniform(rng, 2.0, 30.0), 1)
        rate = int(rng.choice(able))
        if ROWS[0] <= seconds * rate <= ROWS[1]:
            break
    drawn = [str(kind) for kind in rng.permutation(KINDS)]
    apart = int(rng.integers(2, 5))
    train, hold = int(rng.integers(2, 6)), int(rng.integers(1, 5))
    kinds = [drawn[k % apart] for k in range(train)]
    kinds += [drawn[apart + k % (len(drawn) - apart)] for k in range(hold)]
    rig.habits = replace(rig.habits, training=train)
    return Options(seconds=seconds, rate=float(rate), kinds=tuple(kinds))


def _fastest(rig: Rig) -> float:
    """The highest frequency (Hz) at which the nominal rig rings."""
    body = rig.assemble(rig.nominal(), {}, LinkOptions(), 0.0)
    A, _ = body.mechanism.state_space()
    poles = np.linalg.eigvals(A)
    ringing = [abs(p) for p in poles if abs(p.imag) > 0.2 * abs(p)]
    return float(max(ringing, default=0.0)) / (2 * math.pi)


def drive(rig: Rig, options: Options, rng: Generator) -> float:
    """Set the excitation, its size still 1, and return the size at which the load moves as far as it should."""
    seconds, fastest = options.seconds, _fastest(rig)
    shortest = max(0.06, 4 / options.rate, 0.02 * seconds)
    high = min(options.rate / 8, 1.5 * max(fastest, 6.0), 40.0)
    rig.excitation = Excitation(
        amplitude=1.0,
        dwell=(shortest, 4 * shortest),
        low=max(0.2, 1.5 / seconds),
        high=high,
        clock=max(3 / options.rate, float(rng.uniform(0.03, 0.09))),
        resolution=1e-9,
    )
    slow = log_uniform(rng, 0.02, 0.8) if rig.topology.slides else log_uniform(rng, 0.3, 8.0)
    return slow / _reach(rig, options, rng)


def _reach(rig: Rig, options: Options, rng: Generator) -> float:
    """How far the load moves under commands of size 1."""
    body = rig.assemble(rig.nominal(), {}, LinkOptions(), 0.0)
    made = Simulator(body.mechanism, [Readout(body.ports[rig.main].sense)], 1 / options.rate, 1)
    little = 1e-6  # of what may be a great torque on a small thing
    return max(float(np.abs(made.run(little * u).clean).max()) / little for u in _commands(rig, options, rng))


def _commands(rig: Rig, options: Options, rng: Generator) -> list[Array]:
    """One command of each kind that the rig is recorded with."""
    samples, interval = round(options.seconds * options.rate), 1 / options.rate
    seed = int(rng.integers(2**63))
    return [
        excitation.make(kind, default_rng([seed, k]), samples, interval, rig.excitation, 1.0)
        for k, kind in enumerate(dict.fromkeys(options.kinds))
    ]


def resolution(amplitude: float) -> float:
    """Step of the logged command: a power of ten, some thousandths of its size."""
    return float(10.0 ** math.floor(math.log10(3e-4 * amplitude)))


def bare(rig: Rig) -> list[Sensor]:
    """The sensors before their noise is known."""
    return [
        Sensor(rig.signal(q), f"{q.kind}{k}", _unit(q, rig.topology.turns(q.at)), at=q.at)
        for k, q in enumerate(rig.topology.probes, 1)
    ]


def _unit(probe: Probe, turns: bool) -> str:
    units = {"angle": "count", "speed": "rad/s", "tacho": "V", "strain": "V", "tip": "m"}
    units |= {} if turns else {"angle": "m", "speed": "m/s"}
    return units.get(probe.kind, "m/s2")


def control(rig: Rig, options: Options, rng: Generator) -> Control | None:
    """A loop on the first sensor: PD on an angle, PI on a speed; None if none was found that is stable and gentle."""
    sensor = rig.sensors[0]
    speed = rig.probe(sensor.signal).kind != "angle"
    body = rig.assemble(rig.nominal(), {}, LinkOptions(), rig.inductance)
    A, B = body.mechanism.state_space()
    C, _ = body.mechanism.readout(body.signals[sensor.signal], A, B)
    cross = 2 * math.pi * min(float(rng.uniform(0.8, 2.5)), options.rate / 50)
    for _ in range(6):
        gain = abs(C @ np.linalg.solve(1j * cross * np.eye(len(A)) - A, B[:, 0]))
        kp = float(0.8 / gain)
        ki, kd = (0.5 * cross * kp, 0.0) if speed else (0.0, 0.8 * kp / cross)
        loop = Loop(0, kp, ki, kd, 1e9, 0.0, FILTER)
        if _stable(A, B[:, 0], C, loop, options.rate):
            found = _gentle(rig, options, body.signals[sensor.signal], loop, rng)
            if found:
                return Control(sensor.signal, kp, ki, kd, found, 3 * rig.excitation.amplitude)
        cross *= 0.6
    return None


def _stable(A: Array, b: Array, c: Array, loop: Loop, rate: float) -> bool:
    """Whether the sampled loop is stable, by its matrix over one sample."""
    n, h = len(A), 1 / rate
    P, G = discretise(A, b[:, None], h)
    g, keep = G[:, 0], 1 - math.exp(-h / loop.filter)
    # States: x, last reading, filtered slope, integral. The reading at a sample sets the command until the next.
    M = np.zeros((n + 3, n + 3))
    slope = np.concatenate([keep * c / h, [-keep / h, 1 - keep, 0.0]])
    integral = np.concatenate([-h * c, [0.0, 0.0, 1.0]])
    command = -loop.kp * np.concatenate([c, np.zeros(3)]) + loop.ki * integral - loop.kd * slope
    M[:n, :n] = P
    M[:n] += np.outer(g, command)
    M[n, :n] = c
    M[n + 1], M[n + 2] = slope, integral
    poles = np.abs(np.linalg.eigvals(M))
    # One may stay where it is: the angle under a loop on the speed, the integral of a loop that has no use for it.
    return bool(poles.max() <= 1 + 1e-7 and np.sum(poles > 1 - 1e-9) <= 1)


def _gentle(rig: Rig, options: Options, readout: Readout, loop: Loop, rng: Generator) -> float | None:
    """The size of the reference at which the command is as large as in an open loop; None if it runs away."""
    body = rig.assemble(rig.nominal(), {}, LinkOptions(), rig.inductance)
    made = Simulator(body.mechanism, [readout], 1 / options.rate, 1)
    peak = 0.0
    for reference in _commands(rig, options, rng):
        try:
            run = made.run(smooth(reference / rig.excitation.amplitude, 1 / options.rate), loop=loop)
        except Diverged:
            return None
        peak = max(peak, float(np.abs(run.command).max()))
    return 0.7 * rig.excitation.amplitude / peak if 0 < peak < 1e6 else None


def watch(rig: Rig, options: Options, rng: Generator) -> bool:
    """Give each sensor its noise, from the range of its signal; whether the controller, if any, can live with it."""
    ranges = _ranges(rig, options, rng)
    rig.sensors = tuple(_noisy(rig.probe(s.signal), s, size, rng) for s, size in zip(rig.sensors, ranges, strict=True))
    if options.loop == "open":
        return True
    loop, first = rig.control, rig.sensors[0]
    jump = loop.kp + loop.kd / FILTER
    return jump * max(first.quantum, first.sigma) < 0.1 * rig.excitation.amplitude


def _ranges(rig: Rig, options: Options, rng: Generator) -> list[float]:
    truth = Truth(rig, rig.nominal())
    body = truth.plant.assemble(truth.parameters, {}, LinkOptions(), rig.inductance)
    made = Simulator(body.mechanism, [body.signals[s.signal] for s in rig.sensors], 1 / options.rate, 1)
    c = rig.control
    loop = Loop(0, c.kp, c.ki, c.kd, c.limit, 0.0, FILTER) if options.loop == "closed" else None
    seen = []
    for u in _commands(rig, options, rng):
        command = smooth(c.reference / rig.excitation.amplitude * u, 1 / options.rate) if loop else u
        seen.append(made.run(command, loop=loop).clean)
    return [float(size) for size in np.ptp(np.concatenate(seen), axis=0)]


def _noisy(probe: Probe, sensor: Sensor, size: float, rng: Generator) -> Sensor:
    """Counts from 200 to 20 bit, a scale's step, or noise up to 2 % of the range."""
    if probe.kind == "angle" and sensor.unit == "count":
        fewest = max(200.0, 30 * 2 * math.pi / size)
        most = max(min(2.0**20, FINEST * 2 * math.pi / size), 1.01 * fewest)
        counts = 4 * round(log_uniform(rng, fewest, most) / 4)
        if rng.random() < 0.5:
            power = 2 ** round(math.log2(counts))
            counts = power if fewest <= power <= most else counts
        return replace(sensor, counts=counts)
    if probe.kind == "angle":
        return replace(sensor, step=significant(rng, size / 2e4, size / 200))
    return replace(sensor, noise=significant(rng, 2e-4 * size, 0.02 * size))


def habits(rig: Rig, options: Options, rng: Generator) -> Habits:
    """Preloaded starts where there is a spring; jitter no worse than the floor; a background below the effect."""
    made = replace(rig.habits, hidden=0.03)
    springs = [part for part in rig.topology.between if part.gives]
    if springs and options.loop == "open" and rng.random() < 0.5:
        motion = "position" if rig.topology.slides else "angle"
        made = replace(made, preload=_twist(rig, options, rng), free=(f"{rig.main}.{motion}",))
    if rng.random() < 0.25:
        made = replace(made, jitter=min(float(rng.uniform(0.02, 0.2)), _tolerable(rig, options, rng)))
    return made


def _twist(rig: Rig, options: Options, rng: Generator) -> float:
    """How far the last spring is twisted by the motion, the largest."""
    body = rig.assemble(rig.nominal(), {}, LinkOptions(), 0.0)
    last = [part for part in rig.topology.between if part.gives][-1]
    port = body.ports[last.ends[0]].geared(1 / last.ratio).against(body.ports[last.ends[1]])
    made = Simulator(body.mechanism, [Readout(port.sense)], 1 / options.rate, 1)
    twist = max(float(np.abs(made.run(u).clean).max()) for u in _commands(rig, options, rng))
    # The last spring's own end may turn faster than the load, of which the habit speaks.
    return twist / rig.topology.ratio(last.ends[1])


def _tolerable(rig: Rig, options: Options, rng: Generator) -> float:
    """The share of an interval by which a stamp may be wrong for half a floor in the liveliest signal."""
    body = rig.assemble(rig.nominal(), {}, LinkOptions(), rig.inductance)
    made = Simulator(body.mechanism, [body.signals[s.signal] for s in rig.sensors], 1 / options.rate, 1)
    moved = np.concatenate([np.diff(made.run(u).clean, axis=0) for u in _commands(rig, options, rng)])
    step = np.sqrt(np.mean(moved**2, axis=0)) / np.array([s.sigma for s in rig.sensors])
    return float(0.5 * math.sqrt(3) / step.max())
