"""The runtime's algorithm in Python on CasADi's virtual machine, for machines without a C compiler.

It follows ``runtime/core.c`` and ``runtime/simulate.c`` line by line, a few hundred times slower.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from engine.external import Calls
from engine.model import FRICTION, SWITCH, Model, Vector
from engine.native import CANCELLED, CHATTER, EVENTS_PER_STEP, EXTERNAL, NO_MODE, NOT_FINITE, OK, Job, Outcome

_SNAP = 1e-12


class Stop(Exception):
    """A run that ends early: the status, and the index of the state or mode that caused it, as in `engine.native`."""

    def __init__(self, status: int, culprit: int) -> None:
        super().__init__(status)
        self.status, self.culprit = status, culprit


class Simulation:
    """State and stepping of one run; names as in ``core.c``."""

    def __init__(self, model: Model, job: Job) -> None:
        self.model, self.job, self.f = model, job, model.functions
        self.t, self.x, self.d, self.m = job.t0, job.x0.copy(), job.d0.copy(), job.m0.copy()
        self.p = job.p
        self.frictions = [mode.coordinate for mode in model.modes if mode.kind == FRICTION]
        self.switching = len(self.frictions) + model.count(SWITCH)
        inputs = len(model.inputs) + len(model.tables)
        self.base, self.slope, self.origin = (np.zeros(inputs) for _ in range(3))
        self.cursor = [-1] * len(model.tables)
        self.steps = self.events = 0
        self.calls = Calls(model)
        self.returned = [0.0] * sum(external.outputs for external in model.externals)
        self.line = np.zeros(sum(line.size for line in model.lines))
        self.log: list[tuple[float, int, float]] = []
        self.dx: Vector = np.zeros(0)
        self.g: Vector = np.zeros(0)
        self.next: Vector = np.zeros(0)

    def call(self, name: str, t: float, x: Vector, *extra: Any) -> Vector:
        """An equation of the model at ``t`` and ``x``, with inputs, memories and modes as they are."""
        u = self.base + self.slope * (t - self.origin)
        return np.array(self.f[name](t, x, u, self.d, self.m, self.p, *extra).full()).ravel()

    def evaluate(self) -> None:
        """Derivative and guards at the present state."""
        self.dx, self.g = self.call("derivative", self.t, self.x), self.call("guards", self.t, self.x)

    def modes_changed(self) -> None:
        """Renew what depends on the modes."""
        self.next = np.array(self.f["following"](self.m, self.p).full()).ravel()

    def set_mode(self, k: int, value: float) -> None:
        """Change a mode and log it."""
        self.m[k] = value
        if len(self.log) < self.job.log_capacity:
            self.log.append((self.t, k, value))

    def switch(self) -> bool:
        """Change every mode whose guard is violated; whether anything changed."""
        changed, breakaway, worst = False, -1, 0.0
        for k in range(self.switching):
            above, below = self.g[2 * k], self.g[2 * k + 1]
            if not above > 0 and not below > 0:
                continue
            if self.m[k] != 0:
                if k < len(self.frictions):
                    self.x[self.model.coordinates + self.frictions[k]] = 0.0
                self.set_mode(k, 0.0)
                changed = True
            elif k < len(self.frictions):
                if max(above, below) > worst:
                    worst, breakaway = max(above, below), k
            else:
                self.set_mode(k, 1.0 if above > 0 else -1.0)
                changed = True
        if not changed and breakaway >= 0:
            self.set_mode(breakaway, 1.0 if self.g[2 * breakaway] > 0 else -1.0)
            changed = True
        if changed:
            self.modes_changed()
        return changed

    def settle(self) -> None:
        """Bring the modes into agreement with the state."""
        for _ in range(4 * len(self.m) + 20):
            self.evaluate()
            if not self.switch():
                return
            self.events += 1
        raise Stop(NO_MODE, int(np.argmax(self.g)) // 2)

    def time_events(self) -> bool:
        """Count the time events that are due; whether any was."""
        happened = False
        for k in range(len(self.next)):
            count = 0
            while self.next[k] <= self.t + _SNAP * max(1.0, abs(self.t)):
                count += 1
                if count > EVENTS_PER_STEP + 1:
                    raise Stop(CHATTER, self.switching + k)
                self.set_mode(self.switching + k, self.m[self.switching + k] + 1)
                self.modes_changed()
                self.events += 1
                happened = True
        return happened

    def table_knots(self) -> bool:
        """Move each table to the knot that holds now; whether any moved."""
        moved, now, first = False, self.t + _SNAP * max(1.0, abs(self.t)), len(self.model.inputs)
        for i, table in enumerate(self.model.tables):
            c = int(np.searchsorted(table.times, now, side="right")) - 1
            if c == self.cursor[i]:
                continue
            moved, self.cursor[i] = True, c
            inside = c + 1 < len(table.times) and table.hold == "linear"
            rise = (table.values[c + 1] - table.values[c]) / (table.times[c + 1] - table.times[c]) if inside else 0.0
            self.base[first + i], self.slope[first + i], self.origin[first + i] = table.values[c], rise, table.times[c]
        return moved

    def next_knot(self) -> float:
        """The next instant that must be hit (s)."""
        tables = zip(self.model.tables, self.cursor, strict=True)
        knots = [table.times[c + 1] for table, c in tables if c + 1 < len(table.times)]
        return float(min([math.inf, *knots, *self.next]))

    def trial(self, h: float) -> tuple[float, Vector, Vector, Vector]:
        """One RK4 step of length ``h`` with the modes frozen: length, state, derivative, guards."""
        t, x, k1 = self.t, self.x, self.dx
        k2 = self.call("derivative", t + h / 2, x + h / 2 * k1)
        k3 = self.call("derivative", t + h / 2, x + h / 2 * k2)
        k4 = self.call("derivative", t + h, x + h * k3)
        end = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        return h, end, self.call("derivative", t + h, end), self.call("guards", t + h, end)

    def locate(self, whole: float, b: tuple[float, Vector, Vector, Vector]) -> tuple[float, Vector, Vector, Vector]:
        """Shorten a trial that violates a guard to the instant of the first violation; see ``fa_locate``."""
        a, tolerance = 0.0, 1e-13 * whole
        which = int(np.argmax(b[3]))
        fa, fb, wa, wb, side = self.g[which], b[3][which], 1.0, 1.0, 0
        for turn in range(120):
            width = b[0] - a
            if width <= tolerance:
                break
            denominator = wb * fb - wa * fa
            secant = denominator > 0 and turn % 4 != 3 and fa < 0
            h = a - wa * fa * width / denominator if secant else a + width / 2
            h = min(max(h, a + tolerance / 2), b[0] - tolerance / 2)
            c = self.trial(h)
            guard = int(np.argmax(c[3]))
            if c[3][guard] > 0:
                b = c
                if guard != which:
                    which, fa, wa, side = guard, self.g[guard], 1.0, 0
                fb, wb = c[3][guard], 1.0
                wa = wa / 2 if side > 0 else 1.0
                side = 1
            else:
                a, fa, wa = h, c[3][which], 1.0
                wb = wb / 2 if side < 0 else 1.0
                side = -1
        if a == 0 and which < 2 * len(self.frictions) and fa < 0 and b[0] <= tolerance:
            return b[0], self.x + (b[1] - self.x) * (fa / (fa - fb)), b[2], b[3]
        return b

    def check(self) -> None:
        """Stop if the state, its rate or the memories are not finite."""
        bad = ~np.isfinite(self.x)
        if not bad.any():
            bad = ~np.isfinite(self.dx)
        if bad.any():
            raise Stop(NOT_FINITE, int(np.argmax(bad)))

    def step(self, h: float) -> None:
        """One step, split at the switches inside it."""
        end, which = self.t + h, 0
        for _ in range(EVENTS_PER_STEP + 1):
            b = self.trial(end - self.t)
            if not (self.g.size and b[3].max() > 0):
                _, self.x, self.dx, self.g = b
                self.t, self.steps = end, self.steps + 1
                return self.check()
            which = int(np.argmax(b[3]))
            b = self.locate(h, b)
            _, self.x, self.dx, self.g = b
            self.t = self.t + b[0] if end - self.t - b[0] > 1e-13 * h else end
            self.check()
            self.switch()
            self.events += 1
            self.settle()
            if self.t == end:
                self.steps += 1
                return None
        raise Stop(CHATTER, which // 2)

    def start(self) -> None:
        """Settle modes, tables and time events at the start."""
        for k in range(len(self.m)):
            if not math.isfinite(self.m[k]):
                stuck = k >= len(self.frictions)
                self.m[k] = 0.0 if stuck else np.sign(self.x[self.model.coordinates + self.frictions[k]])
        for i, table in enumerate(self.model.tables):
            self.base[len(self.model.inputs) + i] = table.values[0]
        self.modes_changed()
        for line, value in zip(self.model.lines, self._line_start(), strict=True):
            self.line[line.first : line.first + line.size] = value
        self.table_knots()
        self.time_events()
        self.settle()
        self.check()

    def integrate(self, t_end: float) -> None:
        """Go on to ``t_end``, hitting every knot and time event on the way."""
        while self.t < t_end:
            target = self.next_knot()
            if target > t_end - _SNAP * max(1.0, abs(t_end)):
                target = t_end
            begin, span = self.t, target - self.t
            n = math.ceil(span / self.job.hmax * (1 - 1e-9)) if span > self.job.hmax else 1
            for i in range(1, n + 1):
                to = begin + span * (i / n) if i < n else target
                self.step(to - self.t)
                self.t = to
            knots, events = self.table_knots(), self.time_events()
            if knots or events:
                self.settle()

    def tick(self, tick: int) -> None:
        """Let the clocks that are due tick."""
        pairs = zip(self.job.timetable.period, self.job.timetable.offset, strict=True)
        fire = [float(tick >= offset and (tick - offset) % period == 0) for period, offset in pairs]
        if any(fire):
            fire += self.returned
            for line in self.model.lines:
                fire += [float(self.line[line.first + stage - 1]) for stage in line.stages]
            for k, external in enumerate(self.model.externals):
                if fire[external.clock]:
                    first, last = external.first_input, external.first_input + external.inputs
                    answer = self.calls.call(k, self.t, self.call("external", self.t, self.x, fire)[first:last])
                    if answer is None:
                        raise Stop(EXTERNAL, k)
                    begin = len(self.job.timetable.period) + external.first_output
                    fire[begin : begin + external.outputs] = answer.tolist()
            after = self.call("update", self.t, self.x, fire)
            entering = self.call("entering", self.t, self.x, fire) if self.model.lines else ()
            for line, value in zip(self.model.lines, entering, strict=True):
                if fire[line.clock]:
                    values = self.line[line.first : line.first + line.size]
                    values[1:] = values[:-1].copy()
                    values[0] = value
            self.d = after
            self.settle()

    def _line_start(self) -> Vector:
        return np.array(self.f["line_start"](self.p).full()).ravel() if self.model.lines else np.zeros(0)

    def drive(self, k: int) -> None:
        """Let the inputs follow knot ``k`` of the drive."""
        times = self.job.timetable
        for i, linear in enumerate(times.linear):
            rise = 0.0
            if linear and k + 1 < len(times.knot):
                span = float(times.knot[k + 1] - times.knot[k]) * times.resolution
                rise = (times.value[k + 1, i] - times.value[k, i]) / span
            self.base[i], self.slope[i], self.origin[i] = times.value[k, i], rise, self.t

    def next_tick(self, tick: int, row: int, knot: int) -> int:
        """The next tick at which something happens, row ``row`` being the next."""
        times = self.job.timetable
        hits = [int(times.rows[row])]
        for period, offset in zip(times.period.tolist(), times.offset.tolist(), strict=True):
            since = tick - offset
            hits.append(offset if since < 0 else tick - since % period + period)
        if knot < len(times.knot):
            hits.append(int(times.knot[knot]))
        return min(hits)


def run(model: Model, job: Job) -> Outcome:
    """Carry out one run; same meaning as `engine.native.run`.

    Raises:
        SimulationError: an external function cannot be made.
    """
    s = Simulation(model, job)
    rows = job.outputs + 1
    y = np.zeros((rows, len(model.outputs)))
    states = np.zeros((rows, len(model.states))) if job.record_states else None
    modes = np.zeros((rows, len(model.modes))) if job.record_states else None
    tick, knot, row, status, culprit = 0, 0, 0, OK, 0
    driven, knots = len(model.inputs) > 0, job.timetable.knot

    def record(row: int) -> None:
        y[row] = s.call("outputs", s.t, s.x)
        if states is not None and modes is not None:
            states[row], modes[row] = s.x, s.m

    def feed(tick: int, knot: int) -> int:
        while driven and knot < len(knots) and knots[knot] <= tick:
            s.drive(knot)
            knot += 1
        return knot

    try:
        knot = feed(0, knot)
        s.start()
        s.tick(0)
        record(0)
        row = 1
        while row < rows:
            tick = s.next_tick(tick, row, knot if driven else len(knots))
            s.integrate(job.t0 + tick * job.resolution)
            before, knot = knot, feed(tick, knot)
            if knot != before:
                s.settle()
            s.tick(tick)
            if tick == job.timetable.rows[row]:
                record(row)
                row += 1
                if job.cancel is not None and job.cancel.value:
                    raise Stop(CANCELLED, 0)
    except Stop as stop:
        status, culprit = stop.status, stop.culprit
    s.calls.finish()
    log = np.array(s.log, dtype=float).reshape(-1, 3)
    cause = s.calls.failure
    return Outcome(y, states, modes, s.x, s.d, s.m, log, s.steps, s.events, row, status, culprit, s.t, cause)
