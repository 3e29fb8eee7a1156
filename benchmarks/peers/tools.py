"""How each tool solves the problems. A tool is a function without arguments that returns the output at every row."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.peers import problems as p
from benchmarks.peers import simulators
from benchmarks.peers.tool import SMOOTH, Tool, installed
from engine.compile import library
from engine.simulate import simulate

Array = NDArray[np.float64]


def _loops() -> Any:
    return library((Path(__file__).parent / "loops.c").read_text(encoding="utf-8"))


def _pointer(values: Array) -> Any:
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def _flexarm(how: str, text: str, output: str, initial: dict[str, float] | None = None, step: float = p.STEP) -> Tool:
    def make() -> Callable[[], Array]:
        model = p.model(text)
        return lambda: np.asarray(simulate(model, p.STOP, p.STEP, internal_step=step, initial=initial)[output])

    return simulators.made("flexarm", how, make, runs=_COMPILED)


_COMPILED = 150
"""Runs after which flexarm has compiled a model, rather than carry on with byte code."""


def linear() -> list[Tool]:
    """Every tool for the linear problem."""
    s = p.state_space()
    A, b, c = (np.ascontiguousarray(v) for v in (s.A, s.b, s.c))
    loop, y = _loops().linear, np.zeros(p.ROWS + 1)

    def by_hand() -> Array:
        rows = [ctypes.c_int64(v) for v in (p.ROWS, p.ON, p.OFF)]
        loop(ctypes.c_int64(len(A)), _pointer(A), _pointer(b), _pointer(c), *rows, ctypes.c_double(p.STEP), _pointer(y))
        return y

    def by_scipy() -> Array:
        out, x, edges = np.zeros(p.ROWS + 1), np.zeros(len(A)), (0, p.ON, p.OFF, p.ROWS)
        for begin, end in pairwise(edges):
            u = p.voltage(begin * p.STEP)
            instants = p.STEP * np.arange(begin, end + 1)
            part = solve_ivp(
                lambda t, x, u=u: A @ x + b * u, (instants[0], instants[-1]), x, "RK45", instants, rtol=1e-6, atol=1e-9
            )
            out[begin : end + 1], x = c @ part.y, part.y[:, -1]
        return out

    tools = [
        Tool("hand-written C", "RK4, 1 ms", by_hand),
        _flexarm("RK4, 1 ms", p.LINEAR, "link.hub.speed"),
        Tool("scipy solve_ivp", "RK45, rtol 1e-6, restarted at both steps", by_scipy),
        *_control_linear(s),
        *simulators.linear(),
    ]
    if installed("pathsim"):
        tools.append(_pathsim_linear(s))
    if installed("bdsim"):
        tools.append(_bdsim_linear(s))
    return tools


def _control_linear(s: p.StateSpace) -> list[Tool]:
    import control

    plant = control.ss(s.A, s.b[:, None], s.c[None], 0)
    sampled = control.sample_system(plant, p.STEP, "zoh")
    instants = p.STEP * np.arange(p.ROWS + 1)
    u = np.array([float(p.ON <= k < p.OFF) for k in range(p.ROWS + 1)])
    first = "forced_response, input linear between rows, so that a step becomes a ramp of 1 ms"
    second = "sample_system with the input held, then forced_response: exact for this input"
    return [
        Tool("python-control", how, partial(_response, x, instants, u))
        for how, x in ((first, plant), (second, sampled))
    ]


def _response(plant: Any, instants: Any, u: Any) -> Any:
    import control

    return np.asarray(control.forced_response(plant, instants, u).outputs)


def _pathsim_linear(s: p.StateSpace) -> Tool:
    from pathsim import Connection, Simulation
    from pathsim.blocks import Scope, StateSpace, StepSource
    from pathsim.solvers import RK4

    def run() -> Array:
        plant = StateSpace(s.A, s.b[:, None], s.c[None], np.zeros((1, 1)))
        source = StepSource([1.0, 0.0], [p.ON * p.STEP, p.OFF * p.STEP])
        scope = Scope(sampling_period=p.STEP)
        lines = [Connection(source, plant), Connection(plant, scope)]
        Simulation([plant, source, scope], lines, dt=p.STEP, Solver=RK4, log=False).run(p.STOP, adaptive=False)
        time, y = scope.read()
        return np.asarray(np.interp(p.STEP * np.arange(p.ROWS + 1), time, y[0]))

    return Tool("pathsim", "RK4, 1 ms, steps as scheduled events", run, slow=True)


def _bdsim() -> Any:
    import bdsim

    return bdsim.BDSim(banner=False, animation=False, graphics=False, toolboxes=False, progress=False, verbose=False)


def _bdsim_run(diagram: Any, sim: Any, watch: Any) -> Array:
    settings = {"rtol": 1e-6, "atol": 1e-9}
    out = sim.run(diagram, T=p.STOP, dt=p.STEP, watch=[watch], solver_args=settings)
    return np.asarray(np.interp(p.STEP * np.arange(p.ROWS + 1), out.t, np.asarray(out.y)[:, 0]))


def _bdsim_linear(s: p.StateSpace) -> Tool:
    def run() -> Array:
        sim = _bdsim()
        diagram = sim.blockdiagram()
        clock, source, sink = diagram.TIME(), diagram.FUNCTION(p.voltage), diagram.NULL()
        plant = diagram.LTI_SS(s.A, s.b[:, None], s.c[None])
        for ends in ((clock, source), (source, plant), (plant, sink)):
            diagram.connect(*ends)
        diagram.compile(report=False)
        return _bdsim_run(diagram, sim, plant)

    return Tool("bdsim", "RK45, rtol 1e-6, rows of 1 ms", run, slow=True)


def sliding() -> list[Tool]:
    """Every tool for the sliding problem."""
    loop, y = _loops().sliding, np.zeros(p.ROWS + 1)

    def by_hand() -> Array:
        law = (p.INERTIA, p.SPRING, p.DAMPER, p.TORQUE, p.FREQUENCY, p.FRICTION)
        loop(*map(ctypes.c_double, law), ctypes.c_int64(p.ROWS), ctypes.c_double(p.STEP), _pointer(y))
        return y

    tools = [
        Tool("hand-written C", "RK4, 1 ms, switches located", by_hand),
        _flexarm("RK4, 1 ms, switches located", p.SLIDING, "load.shaft.angle"),
        Tool("scipy solve_ivp", "RK45, rtol 1e-6, events", lambda: p.by_events("RK45", 1e-6)),
        Tool("scipy solve_ivp", f"LSODA, rtol 1e-6, friction smoothed over {SMOOTH:g} rad/s", _smoothed),
        _control_sliding(),
        *simulators.sliding(),
    ]
    if installed("pathsim"):
        tools.append(_pathsim_sliding())
    if installed("bdsim"):
        tools.append(_bdsim_sliding())
    return tools


def _acceleration(t: float, q: float, v: float) -> float:
    return float((p.force(t, q, v) - p.FRICTION * np.tanh(v / SMOOTH)) / p.INERTIA)


def _smoothed() -> Array:
    instants = p.STEP * np.arange(p.ROWS + 1)
    made = solve_ivp(
        lambda t, x: [x[1], _acceleration(t, x[0], x[1])], (0, p.STOP), [0, 0], "LSODA", instants, rtol=1e-6, atol=1e-9
    )
    return np.asarray(made.y[0])


def _control_sliding() -> Tool:
    import control

    def rates(t: float, x: Array, u: Array, parameters: Any) -> list[float]:
        return [x[1], _acceleration(t, x[0], x[1])]

    plant = control.nlsys(rates, lambda t, x, u, parameters: [x[0]], inputs=1, outputs=1, states=2)
    instants = p.STEP * np.arange(p.ROWS + 1)

    def run() -> Array:
        settings = {"rtol": 1e-6, "atol": 1e-9}
        return np.asarray(
            control.input_output_response(
                plant, instants, np.zeros(len(instants)), solve_ivp_method="LSODA", solve_ivp_kwargs=settings
            ).outputs
        )

    how = f"input_output_response, LSODA, rtol 1e-6, friction smoothed over {SMOOTH:g} rad/s"
    return Tool("python-control", how, run, slow=True)


def _pathsim_sliding() -> Tool:
    from pathsim import Connection, Simulation
    from pathsim.blocks import ODE, Scope
    from pathsim.events import ZeroCrossingUp
    from pathsim.solvers import RK4

    def run() -> Array:
        slip = [0]

        def rates(x: Array, u: Array, t: float) -> Array:
            a = (p.force(t, x[0], x[1]) - slip[0] * p.FRICTION) / p.INERTIA if slip[0] else 0.0
            return np.array([x[1], a])

        plant, scope = ODE(rates, np.zeros(2)), Scope(sampling_period=p.STEP)

        def over(t: float) -> float:
            q, v = plant.engine.state
            return float(-slip[0] * v if slip[0] else abs(p.force(t, q, 0.0)) - p.FRICTION)

        def switch(t: float) -> None:
            q = plant.engine.state[0]
            pushed = p.force(t, q, 0.0)
            plant.engine.set(np.array([q, 0.0]))
            slip[0] = int(np.sign(pushed)) if slip[0] == 0 or abs(pushed) > p.FRICTION else 0

        events = [ZeroCrossingUp(over, switch, tolerance=1e-9)]
        lines = [Connection(plant, scope)]
        Simulation([plant, scope], lines, events, dt=p.STEP, Solver=RK4, log=False).run(p.STOP, adaptive=True)
        time, y = scope.read()
        return np.asarray(np.interp(p.STEP * np.arange(p.ROWS + 1), time, np.atleast_2d(y)[0]))

    return Tool("pathsim", "RK4, 1 ms, zero crossings located to 1e-9", run, slow=True)


def _bdsim_sliding() -> Tool:
    def run() -> Array:
        sim = _bdsim()
        d = sim.blockdiagram()
        clock, speed, angle, sink = d.TIME(), d.INTEGRATOR(x0=0.0), d.INTEGRATOR(x0=0.0), d.NULL()
        law = d.FUNCTION(lambda t, q, v: _acceleration(t, q, v), nin=3)
        for ends in ((clock, law[0]), (angle, law[1]), (speed, law[2]), (law, speed), (speed, angle), (angle, sink)):
            d.connect(*ends)
        d.compile(report=False)
        settings = {"rtol": 1e-6, "atol": 1e-9}
        out = sim.run(d, T=p.STOP, dt=p.STEP, solver="LSODA", watch=[angle], solver_args=settings)
        return np.asarray(np.interp(p.STEP * np.arange(p.ROWS + 1), out.t, np.asarray(out.y)[:, 0]))

    return Tool("bdsim", f"LSODA, rtol 1e-6, rows of 1 ms, friction smoothed over {SMOOTH:g} rad/s", run, slow=True)


def two_links() -> list[Tool]:
    """Every tool for the two links."""
    start = dict(zip(("arm.joint1.angle", "arm.joint2.angle"), p.RAISED, strict=True))
    loop, y = _loops().two_links, np.zeros(p.ROWS + 1)
    law = (*p.LENGTHS, *p.MASSES, p.GRAVITY, p.JOINT_SPRING, p.JOINT_DAMPING, *p.RAISED)

    def by_hand() -> Array:
        loop(*map(ctypes.c_double, law), ctypes.c_int64(p.ROWS), ctypes.c_double(p.STEP), _pointer(y))
        return y

    tools = [
        Tool("hand-written C", "RK4, 1 ms", by_hand),
        _flexarm("RK4, 1 ms", p.TWO_LINKS, "arm.joint1.angle", start),
        Tool("scipy solve_ivp", "RK45, rtol 1e-8", lambda: p.links_by("RK45", 1e-8)),
        Tool("scipy solve_ivp", "DOP853, rtol 1e-8", lambda: p.links_by("DOP853", 1e-8)),
        _control_links(),
        *simulators.two_links(),
    ]
    if installed("pathsim"):
        tools.append(_pathsim_links())
    if installed("bdsim"):
        tools.append(_bdsim_links())
    return tools


def _control_links() -> Tool:
    import control

    def rates(t: float, x: Array, u: Array, parameters: Any) -> list[float]:
        return p.links_rates(x, math.sin, math.cos)

    plant = control.nlsys(rates, lambda t, x, u, parameters: [x[0]], inputs=1, outputs=1, states=4)
    instants, start = p.STEP * np.arange(p.ROWS + 1), [*p.RAISED, 0, 0]

    def run() -> Array:
        settings = {"rtol": 1e-8, "atol": 1e-11}
        return np.asarray(
            control.input_output_response(
                plant, instants, np.zeros(len(instants)), start, solve_ivp_method="RK45", solve_ivp_kwargs=settings
            ).outputs
        )

    return Tool("python-control", "input_output_response, RK45, rtol 1e-8", run, slow=True)


def _pathsim_links() -> Tool:
    from pathsim import Connection, Simulation
    from pathsim.blocks import ODE, Scope
    from pathsim.solvers import RK4

    def run() -> Array:
        plant = ODE(lambda x, u, t: np.array(p.links_rates(x, math.sin, math.cos)), np.array([*p.RAISED, 0.0, 0.0]))
        scope = Scope(sampling_period=p.STEP)
        lines = [Connection(plant, scope)]
        Simulation([plant, scope], lines, dt=p.STEP, Solver=RK4, log=False).run(p.STOP, adaptive=False)
        time, y = scope.read()
        return np.asarray(np.interp(p.STEP * np.arange(p.ROWS + 1), time, np.atleast_2d(y)[0]))

    return Tool("pathsim", "RK4, 1 ms", run, slow=True)


def _bdsim_links() -> Tool:
    def run() -> Array:
        sim = _bdsim()
        d = sim.blockdiagram()
        state, law = (
            d.INTEGRATOR(x0=[*p.RAISED, 0.0, 0.0]),
            d.FUNCTION(lambda x: np.array(p.links_rates(x, math.sin, math.cos))),
        )
        sink = d.NULL()
        for ends in ((law, state), (state, law), (state, sink)):
            d.connect(*ends)
        d.compile(report=False)
        settings = {"rtol": 1e-8, "atol": 1e-11}
        out = sim.run(d, T=p.STOP, dt=p.STEP, watch=[state], solver_args=settings)
        return np.asarray(np.interp(p.STEP * np.arange(p.ROWS + 1), out.t, np.asarray(out.x)[:, 0]))

    return Tool("bdsim", "RK45, rtol 1e-8, rows of 1 ms", run, slow=True)
