"""Columns held against the nominal model: which drives, which is what signal, in what unit, with what sign."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.binding import names_of, row_interval
from diagnosis.drafting.log_file import LogFile, Signal
from diagnosis.recordings.columns import Vector
from engine.errors import FlexarmError, ParameterError
from engine.quantity import compatible, factor
from engine.simulate import Drive, simulate
from engine.system import bypass

if TYPE_CHECKING:
    from scenarios.load import Scenario

UNITS = {
    "rad": ("rad", "deg", "mrad", "rev", "count"),
    "rad/s": ("rad/s", "deg/s", "rpm"),
    "m": ("m", "mm", "um", "cm", "inch", "count"),
    "m/s": ("m/s", "mm/s"),
    "N": ("N", "kN", "lbf"),
    "N.m": ("N.m", "mN.m"),
    "V": ("V", "mV"),
    "A": ("A", "mA"),
}
"""Units in which a signal is usually logged."""
COUNTS = sorted(
    {2**k for k in range(8, 25)}
    | {
        4 * n
        for n in (100, 200, 250, 256, 360, 400, 500, 512, 600, 720, 1000, 1024, 1250, 2000, 2048, 2500, 3600, 5000)
    }
)
"""Counts that encoders have in a revolution."""
TRANSDUCERS = ("V", "mV", "mA", "1")
"""Units that any quantity may be logged in."""
ROWS = 20_000
"""Samples on which the model is compared."""
MOST_RUNS = 24
"""Pairs of a column and an input that are tried."""
LEVELS = ("sure", "likely", "a guess")
LATEST = 30
"""Samples by which a signal may be late."""
ELSEWHERE = 0.02
"""Correlations that differ by less do not tell two places of one quantity apart."""
RIGID = 1 - 1e-9
"""Likeness of two curves from which they belong to one place."""


@dataclass(frozen=True)
class Match:
    """A column that is taken for a signal or an input of the model.

    Attributes:
        column: of the file.
        end: signal or input of the model.
        unit: in which the column is logged; ``1`` where only ``scale`` tells.
        sign: 1 or -1.
        scale: what a number is worth, as text with a unit; empty where the unit says it.
        counts_per_rev: for an encoder's counter, else 0.
        correlation: with the model as given, without constant, trend and its square; NaN where nothing was compared.
        gain: size of the column over that of the model's signal, both in SI units, after all of the above.
        rival: the highest correlation of another quantity of the model.
        lag: samples by which the column is late.
        sure: ``sure``, ``likely`` or ``a guess``.
        elsewhere: signals of the same quantity at other places that the column follows as closely.
    """

    column: str
    end: str
    unit: str
    sign: int
    scale: str
    counts_per_rev: float
    correlation: float
    gain: float
    rival: float
    lag: int
    sure: str
    elsewhere: tuple[str, ...] = ()

    @property
    def evidence(self) -> str:
        """What speaks for it, in words."""
        if not math.isfinite(self.correlation):
            return self.sure if self.sure == "as given" else f"{self.sure}: by its name and unit alone"
        parts = [f"{self.sure}: correlation {abs(self.correlation):.2f}"]
        if self.elsewhere:
            parts.append(f"follows {' and '.join(self.elsewhere)} as closely")
        if self.rival > 0.3:
            parts.append(f"another quantity {self.rival:.2f}")
        if math.isfinite(self.gain) and not self.scale:
            parts.append(f"{self.gain:.3g} times as large as the model's")
        if self.scale:
            parts.append(
                "of its scale and the sensors' only the product is known"
                if self.unit == "1"
                else "scale as the model has it: put in the calibration"
            )
        if self.lag:
            parts.append(f"{self.lag} samples late")
        return ", ".join(parts)


@dataclass(frozen=True)
class Matches:
    """What drives a model, and what was measured of it.

    Attributes:
        drive, measurements: by column.
        unused: columns that are neither.
        notes: sentences.
    """

    drive: tuple[Match, ...]
    measurements: tuple[Match, ...]
    unused: tuple[str, ...]
    notes: tuple[str, ...] = ()


def match(scenario: Scenario, log: LogFile, progress: Callable[[float], None] | None = None) -> Matches:
    """Match the columns of a file with a model.

    Each column that may drive an input does so in turn, and every other column is held against every signal of the
    model. The pair whose model is most like the other columns is taken. Correlation forgives a wrong unit, the size
    tells it, and the drift of a free axis is taken out of both.

    Args:
        scenario: the model.
        log: the file.
        progress: told the share done, from 0 to 1.
    """
    signals, _ = names_of(scenario)
    tried: list[tuple[float, Signal, str, dict[str, Vector]]] = []
    pairs = _pairs(scenario, log)
    part = _part(log)
    for number, (column, end, unit) in enumerate(pairs):
        responses = _responses(scenario, log, part, {end: _si(column, unit)})
        # What is imposed is no answer.
        given = _si(column, unit)[part]
        responses = {name: curve for name, curve in responses.items() if not _same(curve, given, 0.999)}
        if responses:
            others = [s for s in log.signals if s is not column and _may_be_measured(s, signals)]
            best = [max((abs(_likeness(s, responses[n], part)[0]) for n in responses), default=0.0) for s in others]
            strength = float(np.mean(sorted(best)[-3:])) if best else 0.0
            # Commands hold still between steps, and measurements hardly ever do.
            steps = 0.1 * (column.steps < 0.3 * len(column.values) and not column.counts)
            tried.append((strength + 0.1 * _alike(column.name, end) + steps, column, end, responses))
        if progress:
            progress((number + 1) / len(pairs))
    notes = []
    if tried:
        strength, column, end, responses = max(tried, key=lambda one: one[0])
        rest = [one[0] for one in tried if one[1] is not column]
        rival = max(rest, default=0.0)
    if not tried or strength < 0.4:
        notes.append("no column drives the model like the others move: columns are matched by name and unit alone")
        return _by_name(scenario, log, signals, notes)
    measurements = _measured(scenario, log, column, responses, part)
    drive, measurements = _drive(scenario, log, column, end, measurements, strength, rival)
    used = {column.name, *(m.column for m in measurements)}
    return Matches((drive,), measurements, tuple(s.name for s in log.signals if s.name not in used), tuple(notes))


def _pairs(scenario: Scenario, log: LogFile) -> list[tuple[Signal, str, str]]:
    """Columns and inputs that may belong together, the likeliest first: column, input, its unit."""
    system = scenario.system
    fed = {end for connection in system.connections for end in connection.ends if system.is_input(end)}
    _, named = names_of(scenario)
    sources = {end for name, end in named.items() if name != end}
    analysed = {
        scenario.resolve(end) for analysis in scenario.file.analyses.values() for end in getattr(analysis, "inputs", ())
    }
    found = []
    for end in system.inputs():
        unit = _input_unit(scenario, end)
        rank = 2.0 * (end in sources) + 1.5 * (end not in fed) + 1.0 * (end in analysed)
        for signal in log.signals:
            if signal.unit and signal.unit != "count" and unit and unit != "*" and not compatible(signal.unit, unit):
                continue
            found.append((rank + 2 * _alike(signal.name, end) + 0.5 * bool(signal.unit), signal, end, unit))
    found.sort(key=lambda one: -one[0])
    return [(signal, end, unit) for _, signal, end, unit in found[:MOST_RUNS]]


def _input_unit(scenario: Scenario, end: str) -> str:
    """Unit of an input; of what it is passed on to where it takes any; empty if none is known."""
    system, seen, waiting = scenario.system, set[str](), [end]
    while waiting:
        block, port = system.split(waiting.pop())
        unit = system.blocks[block].ports[port].unit
        if unit and unit != "*":
            return unit
        if block in seen:
            continue
        seen.add(block)
        outputs = {f"{block}.{name}" for name, made in system.blocks[block].ports.items() if made.role == "output"}
        for connection in system.connections:
            if outputs & set(connection.ends):
                waiting += [other for other in connection.ends if system.is_input(other)]
    return ""


def _part(log: LogFile) -> slice:
    """The rows that are compared: from shortly before the first motion."""
    begin = max(0, log.still - 20)
    return slice(begin, min(len(log.time.seconds), begin + ROWS))


def _si(signal: Signal, unit: str) -> Vector:
    """A column that drives, less its level at rest, in SI units where its own is known."""
    values = np.nan_to_num(signal.values - (signal.rest or 0.0))
    if signal.unit and signal.unit != "count" and unit not in ("", "*"):
        return np.asarray(values * factor(signal.unit, unit), dtype=float)
    return values


def _responses(scenario: Scenario, log: LogFile, part: slice, inputs: dict[str, Vector]) -> dict[str, Vector]:
    """Every signal of the model as given, driven by columns from rest; none where it cannot be simulated."""
    time = log.time.seconds[part] - log.time.seconds[part.start]
    step, exact = row_interval(time, scenario.simulation.step if scenario.simulation else 1e-3)
    stop = step * exact * (len(time) - 1) if exact else float(time[-1])
    driven = np.column_stack([values[part] for values in inputs.values()])
    replaced = set(bypass(scenario.system, list(inputs))[1])
    outputs = [name for name in names_of(scenario)[0] if scenario.system.split(name)[0] not in replaced]
    try:
        model = scenario.build(list(inputs), outputs)
        drive = Drive(time, driven, ("zero_order",) * len(inputs))
        internal = scenario.simulation.internal_step if scenario.simulation else None
        result = simulate(model, stop, step, drive=drive, internal_step=internal, rows=None if exact else time)
    except (FlexarmError, ArithmeticError):
        return {}
    made = {}
    for variable in model.outputs:
        curve = result[variable.name]
        values = curve[:: exact or 1][: len(time)]
        if np.isfinite(values).all() and np.ptp(values) > 1e-12 * max(1e-9, float(np.abs(values).max())):
            made[variable.name] = np.asarray(values, dtype=float)
    return made


def _plain(values: Vector) -> Vector:
    """Without constant, trend and its square, which an offset makes of a free axis."""
    t = np.linspace(-1, 1, len(values))
    basis = np.column_stack([np.ones(len(t)), t, t * t])
    there = np.isfinite(values)
    filled = np.interp(t, t[there], values[there])
    return np.asarray(filled - basis @ np.linalg.lstsq(basis, filled, rcond=None)[0], dtype=float)


def _likeness(signal: Signal, simulated: Vector, part: slice) -> tuple[float, float, int]:
    """Correlation, size of the column over that of the model's signal, and samples by which it is late."""
    y, s = _plain(signal.values[part]), _plain(simulated)
    size_y, size_s = float(np.linalg.norm(y)), float(np.linalg.norm(s))
    if not (size_y > 0 and size_s > 0):
        return 0.0, math.nan, 0
    reach = min(LATEST, len(y) // 20)
    found: list[float] = []
    for k in range(reach + 1):
        late, early = y[k:], s[: len(s) - k]
        found.append(float(late @ early) / (float(np.linalg.norm(late) * np.linalg.norm(early)) or 1.0))
    lag = int(np.argmax(np.abs(found)))
    # A sample of lag is worth something only where it shows.
    lag = lag if abs(found[lag]) > abs(found[0]) + 0.01 else 0
    return found[lag], size_y / size_s, lag


def _may_be_measured(signal: Signal, signals: dict[str, str]) -> bool:
    if not signal.unit or signal.unit == "count":
        return True
    return any(unit and unit != "*" and compatible(signal.unit, unit) for unit in signals.values())


def _measured(
    scenario: Scenario, log: LogFile, driving: Signal, responses: dict[str, Vector], part: slice
) -> tuple[Match, ...]:
    """The best signal for every column that has one."""
    signals, _ = names_of(scenario)
    wanted = _wanted(scenario)
    rows: list[tuple[float, Match]] = []
    for signal in log.signals:
        if signal is driving:
            continue
        found: list[tuple[float, Match, Vector]] = []
        for name, simulated in responses.items():
            unit = signals.get(name, "")
            if not _fits(signal, unit):
                continue
            correlation, ratio, lag = _likeness(signal, simulated, part)
            reading = _reading(signal, unit, ratio)
            if reading is None:
                continue
            column_unit, scale, counts, gain, off = reading
            # A word of the name says more than that the scenario records the signal.
            score = abs(correlation) - 0.12 * min(off, 4.0) + 0.3 * _alike(signal.name, name) + 0.05 * (name in wanted)
            score -= 0.003 * name.count(".") + (0.02 if name.endswith(".out") else 0.0)
            made = Match(
                signal.name,
                name,
                column_unit,
                1 if correlation >= 0 else -1,
                scale,
                counts,
                correlation,
                gain,
                0.0,
                lag,
                "",
            )
            found.append((score, made, simulated))
        if not found:
            continue
        found.sort(key=lambda one: -one[0])
        score, best, curve = found[0]
        rivals = [abs(m.correlation) for _, m, s in found[1:] if not _same(curve, s)]
        rival = max(rivals, default=0.0)
        if abs(best.correlation) < 0.3 and not _alike(signal.name, best.end) > 0.6:
            continue
        alike = [
            (m.end, s)
            for _, m, s in found[1:]
            if signals.get(m.end) == signals.get(best.end)
            and abs(m.correlation) > abs(best.correlation) - ELSEWHERE
            and _alike(signal.name, m.end) >= _alike(signal.name, best.end)  # else the column's name says which
            and _same(curve, s)
        ]
        rows.append((score, _rated(best, rival, bool(signal.unit), _elsewhere(curve, alike))))
    # One signal belongs to one column.
    rows.sort(key=lambda one: -one[0])
    taken: dict[str, Match] = {}
    for _, row in rows:
        taken.setdefault(row.end, row)
    order = {s.name: k for k, s in enumerate(log.signals)}
    return tuple(sorted(_counted_alike(log, list(taken.values())), key=lambda m: order[m.column]))


def _counted_alike(log: LogFile, rows: Sequence[Match]) -> list[Match]:
    """Encoders with the counts per revolution by which they move as far as sensors of a stated unit say.

    The model as given may be a tenth off, and 4000 and 4096 counts are nearer to each other than that.
    """
    stated = [m for m in rows if log.signal(m.column).unit not in ("", "count") and not m.scale]
    told = [m.gain for m in stated if abs(m.correlation) > 0.6 and 0.7 < m.gain < 1.45]
    if not told:
        return list(rows)
    middle = float(np.median(told))

    def counted(m: Match) -> Match:
        in_turn = m.gain * m.counts_per_rev
        counts = float(min(COUNTS, key=lambda n: abs(math.log(n * middle / in_turn))))
        return replace(m, counts_per_rev=counts, gain=in_turn / counts)

    return [counted(m) if m.counts_per_rev else m for m in rows]


def _elsewhere(curve: Vector, alike: Sequence[tuple[str, Vector]]) -> tuple[str, ...]:
    """One signal of each other place; what turns with another, or behind a rigid gear, is at the same one."""
    places = [curve]
    found = []
    for end, other in alike:
        if not any(_same(other, place, RIGID) for place in places):
            places.append(other)
            found.append(end)
    return tuple(found)


def _same(a: Vector, b: Vector, alike: float = 0.98) -> bool:
    """Whether two curves are the same but for their size."""
    a, b = _plain(a), _plain(b)
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return size > 0 and abs(float(a @ b)) / size > alike


def _fits(signal: Signal, unit: str) -> bool:
    """Whether a column may be a signal of that unit; volts may be any transducer's."""
    if not unit or unit == "*":
        return False
    if signal.unit in TRANSDUCERS:
        return True
    if signal.unit == "count":
        return unit in ("rad", "m")
    return not signal.unit or compatible(signal.unit, unit)


def _reading(signal: Signal, unit: str, ratio: float) -> tuple[str, str, float, float, float] | None:
    """Unit, scale, counts per revolution, size over the model's, and how far that is from 1 (logarithm)."""
    if not ratio > 0 or not math.isfinite(ratio):
        return None
    options: list[tuple[str, str, float, float]] = []
    if signal.unit in TRANSDUCERS and not compatible(signal.unit, unit):
        return signal.unit, f"{1 / ratio:.4g} {unit}/{signal.unit}", 0.0, math.nan, 0.8
    if signal.unit and signal.unit != "count":
        return signal.unit, "", 0.0, ratio * factor(signal.unit, unit), abs(math.log(ratio * factor(signal.unit, unit)))
    for name in UNITS.get(unit, (unit,)):
        if name in ("count", "inch", "cm", "um", "rev", "mrad", "lbf"):  # nobody logs these without saying so
            continue
        if signal.unit != "count":
            try:
                options.append((name, "", 0.0, ratio * factor(name, unit)))
            except ParameterError:
                continue
    if unit == "rad" and signal.counts:
        per_rev = ratio * 2 * math.pi
        nearest = float(min(COUNTS, key=lambda n: abs(math.log(n / per_rev))))
        options.append(("count", "", nearest, per_rev / nearest))
    if not options:
        return "count", f"{1 / ratio:.4g} {unit}", 0.0, math.nan, 0.5
    best = min(options, key=lambda one: abs(math.log(one[3])))
    off = abs(math.log(best[3]))
    if off > math.log(2.5):
        # No unit explains it: the number itself is given, and has to be checked.
        return "1", f"{1 / ratio:.4g} {unit}", 0.0, math.nan, 1.0
    return (*best, off)


def _rated(best: Match, rival: float, stated: bool, elsewhere: tuple[str, ...]) -> Match:
    size = abs(best.correlation)
    clear = size - rival > 0.1 or stated
    sure = "a guess"
    if size > 0.6 and (clear or size > 0.9):
        sure = "likely"
    if size > 0.9 and clear and not best.scale and 0.7 < best.gain < 1.45 and not elsewhere:
        sure = "sure"
    return replace(best, rival=rival, sure=sure, elsewhere=elsewhere)


def _drive(
    scenario: Scenario,
    log: LogFile,
    column: Signal,
    end: str,
    measurements: Sequence[Match],
    strength: float,
    rival: float,
) -> tuple[Match, tuple[Match, ...]]:
    """The drive's unit and sign: what all measurements say in common is its own."""
    unit = _input_unit(scenario, end) or "1"
    sign, scale, stated = 1, "", column.unit or unit
    kept = list(measurements)
    if not column.unit:
        scale, kept = _product(kept, unit)
        stated = "1" if scale else stated
    clear = [m for m in kept if abs(m.correlation) > 0.6]
    if len(clear) > 1 and all(m.sign < 0 for m in clear):
        sign = -1
        kept = [Match(**{**m.__dict__, "sign": -m.sign}) for m in kept]
    if not column.unit and not scale:
        gains = [m.gain for m in clear if math.isfinite(m.gain)]
        middle = float(np.median(gains)) if gains else 1.0
        names = UNITS.get(unit, (unit,))
        sizes = [(name, factor(name, unit)) for name in names if name not in ("count", "1", "*")]
        if sizes and gains:
            stated = min(sizes, key=lambda one: abs(math.log(middle / one[1])))[0]
    sure = "sure" if strength - rival > 0.15 and strength > 0.85 else "likely" if strength - rival > 0.05 else "a guess"
    # A unit that nobody states is told by the sensors', if theirs are stated.
    stands = column.unit or any(log.signal(m.column).unit for m in clear)
    sure = "likely" if sure == "sure" and not stands else sure
    # Nothing is surer than what it was held against.
    most = LEVELS.index(sure)
    kept = [Match(**{**m.__dict__, "sure": LEVELS[max(most, LEVELS.index(m.sure))]}) for m in kept]
    made = Match(column.name, end, stated, sign, scale, 0.0, min(strength, 1.0), math.nan, rival, 0, sure)
    return made, tuple(kept)


def _product(rows: Sequence[Match], unit: str) -> tuple[str, list[Match]]:
    """Where neither drive nor sensors state units, only the product of their scales is known: it is the drive's.

    Returns:
        The drive's scale, empty if there is no need of one, and the rows with units of their own.
    """
    strange = [m for m in rows if m.unit == "1" and m.scale and abs(m.correlation) > 0.6]
    if not strange or any(m.unit != "1" for m in rows if abs(m.correlation) > 0.6):
        return "", list(rows)
    worth = [float(m.scale.split()[0]) for m in strange]
    middle = float(np.median(np.log(worth)))
    kept = []
    for m in rows:
        if m not in strange:
            kept.append(m)
            continue
        number, _, own = m.scale.partition(" ")
        gain = math.exp(middle) / float(number)
        kept.append(Match(**{**m.__dict__, "unit": own, "scale": "", "gain": gain}))
    return f"{math.exp(-middle):.4g} {unit}", kept


QUANTITIES = {
    "acceleration": ("acc", "accel", "acceleration", "ddot", "ddtheta"),
    "speed": ("omega", "speed", "vel", "velocity", "w", "dot", "dq", "tacho", "gyro", "rate"),
    "voltage": ("u", "v", "volt", "voltage", "vir"),
    "current": ("i", "cur", "current", "iq"),
    "torque": ("tau", "torque", "trq"),
    "force": ("f", "force", "load"),
    "angle": ("theta", "phi", "alpha", "angle", "pos", "position", "q", "qm", "enc", "encoder", "th"),
    "position": ("x", "y", "z", "pos", "position", "q", "qm", "enc", "encoder", "displacement", "disp"),
}
"""Words in names of columns, by the last word of the model's name; the first that is met counts."""


def _quantity(column: str, end: str) -> float:
    """1 if a column's name is one that the quantity of a signal often has."""
    words = set(re.findall(r"[a-z]+", column.lower()))
    last = end.rpartition(".")[2]
    first = next((q for q, known in QUANTITIES.items() if words & set(known)), "")
    if first in ("angle", "position"):
        return float(last in QUANTITIES and bool(words & set(QUANTITIES[last])))
    return float(bool(first) and first == last)


def _wanted(scenario: Scenario) -> set[str]:
    """Signals that the scenario itself records, or whose analyses give them out."""
    analyses = scenario.file.analyses.values()
    found = {scenario.resolve(name) for analysis in analyses for name in getattr(analysis, "outputs", ())}
    if scenario.simulation and scenario.simulation.record:
        found |= {scenario.resolve(name) for name in scenario.simulation.record}
    return found


def _by_name(scenario: Scenario, log: LogFile, signals: dict[str, str], notes: list[str]) -> Matches:
    """Columns by name and unit where the model does not help: a free decay, or a controller that is not in it."""
    wanted, taken = _wanted(scenario), set[str]()
    drive: list[Match] = []
    measurements: list[Match] = []
    for signal in log.signals:
        inputs = [
            (2 * _alike(signal.name, end) + 0.5 * _quantity(signal.name, end), end) for end in scenario.system.inputs()
        ]
        outputs = [
            (
                2 * _alike(signal.name, n)
                + 0.5 * _quantity(signal.name, n)
                + 0.2 * (n in wanted)
                + 0.1 * bool(signal.unit),
                n,
            )
            for n, unit in signals.items()
            if _fits(signal, unit)
        ]
        (a, end), (b, name) = max(inputs, default=(0.0, "")), max(outputs, default=(0.0, ""))
        chosen = end if a > b else name
        if max(a, b) < 0.5 or chosen in taken:
            continue
        taken.add(chosen)
        unit = signal.unit or (_input_unit(scenario, end) if a > b else signals[name]) or "1"
        row = Match(signal.name, chosen, unit, 1, "", 0.0, math.nan, math.nan, 0.0, 0, "a guess")
        (drive if a > b else measurements).append(row)
    used = {m.column for m in (*drive, *measurements)}
    unused = tuple(s.name for s in log.signals if s.name not in used)
    return Matches(tuple(drive), tuple(measurements), unused, tuple(notes))


def _alike(column: str, end: str) -> float:
    """How much of a model's name a column's name holds, from 0 to 1."""
    words = {w for w in re.split(r"[^a-z0-9]+", column.lower()) if w}
    joined = re.sub(r"[^a-z0-9]", "", column.lower())
    parts = [p for p in re.split(r"[^a-z0-9]+", end.lower()) if p]
    if joined == "".join(parts):
        return 1.0
    return 0.6 * sum(part in words for part in parts) / len(parts)
