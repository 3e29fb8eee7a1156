"""The instants of a run in Python, as ``heads/common.c`` has them in C: for models with Python functions.

At a communication point inputs set there, tuned parameters and clocks that are due wait until a value is asked for or
the next step begins; a value set after one was read takes the instant back and it is evaluated afresh.
"""

from __future__ import annotations

import copy
import hashlib
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from engine.errors import FlexarmError, ParameterError, SimulationError
from engine.interpret import Simulation, Stop
from engine.model import TIME, Vector
from engine.simulate import explain, prepare
from fmu.plan import Plan
from fmu.python_state import FIELDS, STEP, Standing, check, fill
from fmu.variables import DERIVATIVE, INDICATOR, INPUT, MEMORY, MODE, OUTPUT, PARAMETER, STATE, TIME_KIND

RECIPE = "recipe.json"
"""The file in the resources of an FMU that tells what model it is."""


def names_of(made: Plan) -> str:
    """A hash of the variables' names by reference, which binary, description and model must share."""
    return hashlib.sha256("\n".join(variable.name for variable in made.variables).encode()).hexdigest()[:32]


class Core:
    """One instance of an exported model.

    Attributes:
        plan: the export.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        model = plan.model
        self._standing = Standing(model.parameter_values, np.zeros(len(model.inputs)))
        self._sim: Simulation | None = None
        self._before: Standing | None = None
        self._failed = False

    @property
    def phase(self) -> str:
        """Where the instance stands in its life, of `fmu.python_state.PHASES`."""
        return self._standing.phase

    @phase.setter
    def phase(self, phase: str) -> None:
        self._standing.phase = phase
        if self._before is not None:
            self._before.phase = phase

    @property
    def failed(self) -> bool:
        """Whether the run has failed, so that only a restored state goes on."""
        return self._failed

    # -- the standing, kept and restored ------------------------------------------------------------------------------

    def snapshot(self) -> Standing:
        """Everything that changes during a run, copied.

        Raises:
            FlexarmError: a Python function holds what cannot be copied.
        """
        kept = replace(self._standing, p=self._standing.p.copy(), u=self._standing.u.copy())
        kept.pending = set(self._standing.pending)
        if self._sim is not None:
            kept.simulation = copy.deepcopy({name: getattr(self._sim, name) for name in FIELDS})
            kept.functions = []
            for function, external in zip(self._sim.calls.functions, self.plan.model.externals, strict=True):
                try:
                    kept.functions.append(copy.deepcopy(_attributes(function)))
                except Exception as error:
                    raise FlexarmError(f"the state of '{external.name}' cannot be copied: {error}") from error
        return kept

    def restore(self, kept: Standing) -> None:
        """Go back to what `snapshot` gave, or to what `fmu.python_state.from_bytes` read; all of it or nothing.

        Raises:
            FlexarmError: it is no standing of this model.
        """
        check(kept, self.plan.model)
        before, failed = self.snapshot(), self._failed
        try:
            self._put(copy.deepcopy(kept))
        except FlexarmError:
            self._put(before)
            self._failed = failed
            raise

    def _put(self, kept: Standing) -> None:
        self._standing, self._before, self._failed = kept, None, False
        if not kept.simulation:
            self._sim = None
            return
        if self._sim is None:
            self._sim = self._made()
        for name, value in kept.simulation.items():
            setattr(self._sim, name, value)
        for function, attributes in zip(self._sim.calls.functions, kept.functions, strict=True):
            if hasattr(function, "__dict__") and attributes:
                fill(function, attributes)

    # -- instants -----------------------------------------------------------------------------------------------------

    def _made(self) -> Simulation:
        plan, s = self.plan, self._standing
        model = plan.model
        changes = {q.name: float(v) for q, v in zip(model.parameters, s.p, strict=True)}
        job = prepare(model, plan.step, plan.step, parameters=changes, internal_step=plan.hmax)
        sim = Simulation(model, replace(job, log_capacity=0))
        sim.t = s.start
        return sim

    def begin(self, start: float, stop: float = math.inf) -> None:
        """Say when the run starts and where it ends at the latest (s)."""
        self._standing.start, self._standing.stop = start, stop

    @property
    def time(self) -> float:
        """Where the run stands (s)."""
        return self._standing.start if self._sim is None else float(self._sim.t)

    def _arrive(self) -> None:
        s = self._standing
        conflict = self.plan.model.parameter_conflict(s.p) if s.pending & {"starting", "tuned"} else ""
        if conflict:
            raise ParameterError(conflict)
        what, s.pending = s.pending, set()
        if not what:
            return
        if "starting" in what:
            self._sim = self._made()
            self._sim.base[: len(s.u)] = s.u
            self._sim.start()
            self._tick()
            return
        sim = self._sim
        assert sim is not None
        if "tuned" in what:
            sim.p = s.p.copy()
            sim.modes_changed()
            sim.time_events()
        if "driven" in what:
            sim.base[: len(s.u)], sim.slope[: len(s.u)], sim.origin[: len(s.u)] = s.u, 0.0, sim.t
        if what & {"tuned", "driven"}:
            sim.settle()
        if "clocked" in what:
            self._tick()

    def _tick(self) -> None:
        assert self._sim is not None
        self._sim.tick(self._standing.tick)

    def _guarded(self, action: Any) -> None:
        if self._failed:
            raise SimulationError("the run has failed; reset the instance or restore a state")
        try:
            action()
        except Stop as stop:
            self._failed = True
            sim = self._sim
            assert sim is not None
            cause = sim.calls.failure
            outcome = _Outcome(stop.status, stop.culprit, sim.t, cause)
            raise SimulationError(explain(self.plan.model, outcome)) from cause

    def evaluate(self) -> None:
        """See that the present instant has values.

        Raises:
            ParameterError: parameters contradict one another.
            SimulationError: the run fails.
        """
        self._evaluated()

    def _evaluated(self) -> Simulation:
        if self._standing.pending:
            self._before = self.snapshot()
            self._guarded(self._arrive)
        assert self._sim is not None
        return self._sim

    def _recall(self) -> None:
        if self._before is not None:
            self._put(copy.deepcopy(self._before))

    # -- values -------------------------------------------------------------------------------------------------------

    def get(self, references: list[int]) -> list[float]:
        """Values by reference."""
        variables, outputs = self.plan.variables, np.zeros(0)
        if any(variables[reference].kind == OUTPUT for reference in references):
            sim = self._evaluated()
            outputs = sim.call("outputs", sim.t, sim.x)
        return [float(self._value(reference, outputs)) for reference in references]

    def _value(self, reference: int, outputs: Vector) -> float:
        variable = self.plan.variables[reference]
        k, s = reference - self.plan.first(variable.kind), self._standing
        if variable.kind == TIME_KIND:
            return self.time
        if variable.kind == PARAMETER:
            return float(s.p[k])
        if variable.kind == INPUT:
            return float(s.u[k])
        if variable.kind == OUTPUT:
            return float(outputs[k])
        sim = self._evaluated()
        found: dict[str, Vector] = {STATE: sim.x, DERIVATIVE: sim.dx, MEMORY: sim.d, INDICATOR: -sim.g}
        if variable.kind == MODE:
            held = [value for value, mode in zip(sim.m, self.plan.model.modes, strict=True) if mode.kind != TIME]
            return float(held[k])
        return float(found[variable.kind][k])

    def set(self, references: list[int], values: list[float]) -> None:
        """Set inputs and parameters; nothing is changed if one does not fit.

        Raises:
            ParameterError: a value is not finite or out of bounds.
            FlexarmError: the variable is neither or can no longer be set.
        """
        for reference, value in zip(references, values, strict=True):
            variable = self.plan.variables[reference]
            if variable.kind not in (INPUT, PARAMETER):
                raise FlexarmError(f"'{variable.name}' is calculated and cannot be set")
            if variable.kind == PARAMETER and not variable.tunable and self.phase == STEP:
                raise FlexarmError(f"'{variable.name}' acts on the start alone and cannot be set any more")
            if not math.isfinite(value):
                raise ParameterError(f"'{variable.name}' cannot be {value}: it is not finite")
            if variable.kind == PARAMETER:
                try:
                    self.plan.model.parameters[reference - self.plan.first(PARAMETER)].declared.check(value)
                except ParameterError as error:
                    raise ParameterError(f"'{variable.name}': {error.message}") from error
        self._recall()
        for reference, value in zip(references, values, strict=True):
            kind = self.plan.variables[reference].kind
            given, what = (self._standing.p, "tuned") if kind == PARAMETER else (self._standing.u, "driven")
            given[reference - self.plan.first(kind)] = value
            self._standing.pending.add(what)

    # -- steps --------------------------------------------------------------------------------------------------------

    def step(self, begin: float, length: float) -> None:
        """Integrate over ``length`` from ``begin`` (s).

        Raises:
            SimulationError: the step cannot be done, or the run fails.
        """
        if not (length > 0 and begin + length > begin and np.isfinite(begin + length)):
            raise SimulationError(f"a step of {length:g} s from {begin:g} s cannot be done")
        tolerance = min(1e-8 * max(1.0, abs(self.time)), 0.01 * self.plan.step)
        if abs(begin - self.time) > tolerance:
            raise SimulationError(f"the step starts at {begin!r} s but this instance stands at {self.time!r} s")
        if begin + length > self._standing.stop + tolerance:
            raise SimulationError(f"the step to {begin + length:.9g} s passes stopTime {self._standing.stop:.9g} s")
        self._before = None
        self._guarded(lambda: self._advance(begin + length, length))

    def _advance(self, given: float, length: float) -> None:
        self._arrive()
        sim, s, plan = self._sim, self._standing, self.plan
        assert sim is not None
        own = float(sim.t) + length
        low, high = min(own, given), max(own, given)
        snap = 1e-6 * plan.step + 4 * np.finfo(float).eps * abs(high)
        grid = plan.ticks(plan.step)
        while True:
            following = s.tick - s.tick % grid + grid
            for period, offset in zip(
                sim.job.timetable.period.tolist(), sim.job.timetable.offset.tolist(), strict=True
            ):
                since = s.tick - offset
                following = min(following, offset if since < 0 else s.tick - since % period + period)
            at = s.start + following * float(plan.tick)
            if at > high + snap:
                if given > sim.t:
                    sim.integrate(given)
                return
            sim.integrate(at)
            s.tick = following
            if at >= low - snap:
                s.pending.add("clocked")
                return
            self._tick()


@dataclass(frozen=True)
class _Outcome:
    status: int
    culprit: int
    t1: float
    cause: BaseException | None


def _attributes(function: Any) -> dict[str, Any]:
    """What an object remembers; nothing for a plain function."""
    return {} if callable(function) and hasattr(function, "__code__") else dict(getattr(function, "__dict__", {}))
