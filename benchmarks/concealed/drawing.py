"""What is drawn at random in a case: parameters, recordings, and how large the concealed effects are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from benchmarks.concealed import excitation
from benchmarks.concealed.bench import Bench
from benchmarks.concealed.effects import Concealed, Features, Scales
from benchmarks.concealed.nuisance import slow_course
from benchmarks.concealed.plants.base import Plant, Sensor
from benchmarks.concealed.recording import controlled
from benchmarks.concealed.refit import GaussNewton, excess, solve
from benchmarks.concealed.sites import Site, scales
from benchmarks.concealed.truth import Truth, simulator

Array = NDArray[np.float64]

SESSION = 12.0
"""Time (s) from the start of one recording to the start of the next."""

WHOLE, BLINDING = 0.9, 1e6
"""Share of its size that an effect on a random rig must reach, and floors that it must not leave."""

ACCESSORY = 0.3
"""Share of its size that a backlash on a random rig may leave without a gap: its faces give, as a joint that bends; and
that one of `LATE` may leave without a size."""

LATE = ("delay", "lag", "inductance", "rate_limit")
"""Effects by which what drives comes later. However little that is, where a command jumps an acceleration is read
before it, and without them after it: a nanosecond shows as much as a millisecond."""

TIMES = ("delay", "lag")
"""Those of them whose size is a time. By a thousandth of a sample nothing is seen to be late."""

LOUDEST, SOFTEST = 4.0, 0.15
"""How far the commands are scaled for an effect that has no size of its own."""


class Unseen(ValueError):
    """An effect on a random rig that cannot be made as large as was asked for: another is drawn in its place."""


@dataclass(frozen=True)
class Options:
    """How a case departs from the usual one.

    Attributes:
        seconds, rate: length (s) and sample rate (Hz) of the recordings.
        sensors: columns or signals to record; empty for the plant's usual ones.
        loop: ``open``, or ``closed``: a controller outside the scenario, its output logged.
        sigma_error: the scenario states the noise wrong by this factor.
        nuisance: size of the small disturbances; 0 for none.
        kinds: kinds of recordings, training first; half of them are held out. Empty: drawn.
        one_way: the magnitudes of the commands.
        amplitude: factor on the commands.
        exact: the scenario holds the true parameters.
        wrong: (parameter, factor): true values that lie far outside their tolerance.
    """

    seconds: float = 4.0
    rate: float = 1000.0
    sensors: tuple[str, ...] = ()
    loop: str = "open"
    sigma_error: float = 1.0
    nuisance: float = 1.0
    kinds: tuple[str, ...] = ()
    one_way: bool = False
    amplitude: float = 1.0
    exact: bool = False
    wrong: tuple[tuple[str, float], ...] = ()


def true_parameters(plant: Plant, rng: Generator, options: Options) -> dict[str, float]:
    """The data sheet is off by up to 10 % (damping 30 %), or what the plant declares, save where more is asked for.

    Raises:
        ValueError: a parameter the plant does not have.
    """
    true = {}
    for q in plant.parameters:
        share = q.spread * rng.uniform(-1, 1)
        true[q.name] = min(q.value * (1 + share), q.ceiling)
    for name, factor in options.wrong:
        if name not in true:
            raise ValueError(f"{plant.name} has no parameter '{name}'; it has {', '.join(true)}")
        true[name] *= factor
    return true


def choose_sensors(plant: Plant, options: Options, chosen: Sequence[Site]) -> tuple[Sensor, ...]:
    """The sensors asked for, else the usual ones.

    Raises:
        ValueError: the plant does not have one, or an effect sits on one that is not recorded.
    """
    try:
        asked = tuple(plant.sensor(name) for name in options.sensors)
    except KeyError as error:
        raise ValueError(error.args[0]) from None
    recorded = asked or tuple(s for s in plant.sensors if not s.extra)
    for site in chosen:
        if site.effect.kind == "sensor" and site.place not in [s.signal for s in recorded]:
            column = plant.sensor(site.place).column
            raise ValueError(f"{site} sits on a sensor that is not recorded; add '{column}' to the sensors")
    return recorded


def make_bench(
    base: Truth, nominal: dict[str, float], sensors: tuple[Sensor, ...], rng: Generator, options: Options
) -> tuple[Bench, list[str]]:
    """Commands of all recordings, and their kinds.

    Raises:
        ValueError: a kind that does not exist.
    """
    plant, kinds = base.plant, list(options.kinds)
    if not kinds:
        train, hold_out = excitation.kinds(rng)
        kinds = train + hold_out
    unknown = [k for k in kinds if k not in excitation.KINDS]
    if unknown:
        raise ValueError(f"no kind of recording is called '{unknown[0]}'; there are {', '.join(excitation.KINDS)}")
    samples, interval = round(options.seconds * options.rate), 1 / options.rate
    if "decay" in kinds and not plant.swings:
        raise ValueError(f"{plant.name} has nothing that swings back: a decay is only for a pendulum")
    commands, slow, released = [], [], []
    for kind in kinds:
        stream = default_rng(rng.integers(2**63))
        commands.append(_within_reach(base, kind, stream, samples, interval, options))
        slow.append(slow_course(stream, samples + 1, interval))
        angle = float(stream.uniform(0.35, 0.9) * stream.choice([-1.0, 1.0]))
        twisted = bool(plant.habits.preload) and stream.random() < 0.5
        released.append(angle if kind == "decay" else plant.habits.preload * angle if twisted else 0.0)
    training = plant.habits.training or math.ceil(len(kinds) / 2)
    bench = Bench(
        signals=tuple(s.signal for s in sensors),
        sigma=np.array([s.sigma for s in sensors]),
        commands=tuple(commands),
        held_out=tuple(k >= training for k in range(len(kinds))),
        interval=interval,
        tolerance={q.name: q.tolerance for q in plant.parameters},
        centre=nominal,
        slow=tuple(slow),
        start=tuple(SESSION * k for k in range(len(kinds))),
        released=tuple(released),
    )
    if options.loop == "closed":
        size = plant.control.reference / plant.excitation.amplitude
        followed = tuple(smooth(size * c, interval) for c in commands)
        bench = replace(bench, references=followed)
        bench = replace(bench, commands=tuple(r.command for r in controlled(bench, base)))
    return bench, kinds


def _within_reach(base: Truth, kind: str, rng: Generator, samples: int, interval: float, options: Options) -> Array:
    """A command, made smaller until the bare plant stays where its first sensor may go."""
    e, size = base.plant.excitation, options.amplitude
    drawn = int(rng.integers(2**63))
    made = simulator(base, [base.plant.sensors[0].signal], interval, 2.5e-4)
    while True:
        command = excitation.make(kind, default_rng(drawn), samples, interval, e, size, options.one_way)
        if not np.isfinite(e.reach) or np.abs(made.run(command).clean).max() <= e.reach:
            return command
        size *= 0.85


def smooth(values: Array, interval: float) -> Array:
    """Two first-order lags of 40 ms."""
    keep, out = math.exp(-interval / 0.04), np.array(values)
    for _ in range(2):
        state = 0.0
        for k, value in enumerate(out):
            state = keep * state + (1 - keep) * value
            out[k] = state
    return out


def conceal(site: Site, size: float, features: Features, here: Scales) -> Concealed:
    """An effect of a given size."""
    return Concealed(site.effect.name, site.place, site.effect.make(size, features, here))


def _in_training(bench: Bench, base: Truth, met: Concealed, quick: GaussNewton) -> float:
    """What a refit leaves of something on the recordings to train on, in floors."""
    target = bench.outputs(replace(base, concealed=(met,)))
    return bench.distance(bench.outputs(quick.refit(target)), target, held_out=False)


def _beyond_softness(bench: Bench, base: Truth, slack: Concealed) -> float:
    """What a refit about a belt of half the stiffness and damping, of one strand, leaves of a slack one, in floors."""
    keys = (f"{slack.place}.stiffness", f"{slack.place}.damping")
    centre = bench.centre | {key: bench.centre[key] / 2 for key in keys}
    single = replace(base, parameters={**base.parameters, **{key: base.parameters[key] / 2 for key in keys}})
    there = replace(bench, centre=centre)
    return excess(there, replace(base, concealed=(slack,)), quick=GaussNewton(there, single))


def hide(
    bench: Bench, base: Truth, chosen: Sequence[Site], asked: Sequence[float], rng: Generator
) -> tuple[float, tuple[Concealed, ...], list[tuple[float, float, float]]]:
    """Effects at their sizes: multiples of the detection threshold.

    The threshold is the size at which what a refit of the nominal parameters leaves of the effect on held-out
    recordings is as large as the noise floor, each effect taken alone. An effect without a size of its own, taken
    alone, has the commands scaled until it is as visible as asked.

    Returns:
        Factor on all commands, the effects, and for each (size, threshold, excess in floors).

    Raises:
        Unseen: on a random rig, an effect cannot be made as large as asked for.
    """
    concealed, found = [], []
    quick = GaussNewton(bench, base) if base.plant.habits.hidden and chosen else None
    for site, multiple in zip(chosen, asked, strict=True):
        effect, here = site.effect, scales(bench, base, site)
        drawn = effect.draw(default_rng(rng.integers(2**63)), here)

        def alone(size: float, site: Site = site, drawn: Features = drawn, here: Scales = here) -> float:
            return excess(bench, replace(base, concealed=(conceal(site, size, drawn, here),)), quick=quick)

        if effect.natural:
            concealed.append(conceal(site, 1.0, drawn, here))
            if effect.loud and len(chosen) == 1:
                there = replace(base, concealed=tuple(concealed))

                def louder(a: float, there: Truth = there) -> float:
                    driven = bench.scaled(a)
                    return excess(driven, there, quick=GaussNewton(driven, base) if quick else None)

                factor = max(solve(louder, 1.0, LOUDEST, multiple)[0], SOFTEST)
                visible = louder(factor)
                if quick and not visible > 1:
                    raise Unseen(f"{site} cannot be seen")
                return factor, tuple(concealed), [(visible, 1.0, visible)]
            visible = alone(1.0)
            if quick and not visible > 1:
                raise Unseen(f"{site} cannot be seen")
            found.append((visible, 1.0, visible))
            continue
        first = effect.first(here)
        threshold, value = solve(alone, first, effect.most * first)
        threshold /= value if value < 0.9 else 1.0
        size = min(multiple * threshold, effect.most * first)
        found.append((size, threshold, alone(size)))
        concealed.append(conceal(site, size, drawn, here))
        if quick and not (size >= WHOLE * multiple * threshold and WHOLE < found[-1][2] < BLINDING):
            raise Unseen(f"{site} cannot be made {multiple:g} times as large as can be seen")
        if quick and effect.name == "backlash" and alone(1e-3 * size) > ACCESSORY * found[-1][2]:
            raise Unseen(f"{site} shows by its faces, which give, and not by its gap")
        hardly = 1e-3 * (bench.interval if effect.name in TIMES else size)
        if quick and effect.name in LATE and alone(hardly) > ACCESSORY * found[-1][2]:
            raise Unseen(f"{site} shows by the side of a jump that is read, and not by how late it comes")
        if quick and effect.name == "end_stop" and not _in_training(bench, base, concealed[-1], quick) > 1:
            raise Unseen(f"{site} is met by no recording to train on")
        if quick and effect.name == "belt_slack" and not _beyond_softness(bench, base, concealed[-1]) > 1:
            raise Unseen(f"{site} shows as a belt of half its stiffness, of which one strand hangs all the time")
    return 1.0, tuple(concealed), found
