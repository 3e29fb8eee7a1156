"""The problems in compiled simulators: Drake, MuJoCo, diffrax and Exudyn. Each is given the form that suits it best.

Nothing of a run is written in Python where a tool has another way: Drake and Exudyn are given their own blocks, MuJoCo
a model and its `rollout`, diffrax functions that JAX compiles.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import problems as p
from benchmarks.peers.tool import SMOOTH, Tool, installed

Array = NDArray[np.float64]
INSTANTS = p.STEP * np.arange(p.ROWS + 1)

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")


def made(name: str, how: str, make: Callable[[], Callable[[], Array]], *, slow: bool = False, runs: int = 1) -> Tool:
    """A tool, whose set-up is what making it and its first runs take beyond later ones.

    Args:
        name, how, slow: of the tool.
        make: prepares what runs share.
        runs: how many are part of the set-up, until everything is compiled.
    """
    begun = os.times()
    run = make()
    for _ in range(runs):
        run()
    first = os.times()
    run()
    again = os.times()
    spent, one = (sum(b[:4]) - sum(a[:4]) for a, b in ((begun, first), (first, again)))
    return Tool(name, how, run, slow=slow, setup=max(0.0, spent - runs * one))


def linear() -> list[Tool]:
    """Every simulator that takes a linear model."""
    s = p.state_space()
    found = []
    if installed("pydrake"):
        found.append(made("Drake", "LinearSystem, RungeKutta5, accuracy 1e-7, dense output", lambda: _drake_linear(s)))
    if installed("diffrax"):
        found.append(made("diffrax", "Tsit5, rtol 1e-7, stops at both steps", lambda: _diffrax_linear(s)))
    if installed("exudyn"):
        found.append(made("Exudyn", "ObjectGenericODE1, RK44, 1 ms", lambda: _exudyn_linear(s)))
    return found


def sliding() -> list[Tool]:
    """Every simulator that takes a joint with friction."""
    found = []
    smoothed = f"friction smoothed over {SMOOTH:g} rad/s"
    if installed("pydrake"):
        found.append(made("Drake", f"SymbolicVectorSystem, Radau3, accuracy 1e-5, {smoothed}", _drake_sliding))
    if installed("mujoco"):
        for step in (p.STEP, p.STEP / 10):
            how = f"hinge with frictionloss as hard as it may be, implicitfast, {step * 1e3:g} ms, rollout"
            found.append(made("MuJoCo", how, partial(_mujoco_sliding, step)))
    if installed("diffrax"):
        found.append(made("diffrax", f"Kvaerno5, rtol 1e-5, {smoothed}", _diffrax_sliding))
    if installed("exudyn"):
        how = f"CoordinateSpringDamperExt, generalised alpha, 1 ms, {smoothed}"
        found.append(made("Exudyn", how, _exudyn_sliding, slow=True))
    return found


def two_links() -> list[Tool]:
    """Every simulator for the two links."""
    found = []
    if installed("pydrake"):
        found.append(
            made("Drake", "MultibodyPlant, RungeKutta5, accuracy 1e-7, steps of up to 4 ms, dense output", _drake_links)
        )
    if installed("mujoco"):
        found.append(made("MuJoCo", "two hinges, RK4, 1 ms, rollout", _mujoco_links))
    if installed("diffrax"):
        for rtol in (1e-5, 1e-7):
            how = f"closed equations, Tsit5, rtol {rtol:g}"
            found.append(made("diffrax", how, partial(_diffrax_links, rtol)))
    if installed("exudyn"):
        found.append(made("Exudyn", "ObjectKinematicTree, RK44, 1 ms", _exudyn_links))
    return found


# -- Drake ------------------------------------------------------------------------------------------------------------


def _drake_run(
    system: Any, begin: Callable[[Any], None], accuracy: float, longest: float, edges: Sequence[tuple[float, Any]] = ()
) -> Array:
    """States at all rows, shape (states, rows), from its dense output: stops at every row would shorten its steps.

    Args:
        system: is simulated.
        begin: puts the start into a context.
        accuracy: asked of the integrator.
        longest: step (s), since dense output is cubic between steps.
        edges: instants (s) at which something is done to the context, and what.
    """
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

    simulator = Simulator(system)
    ResetIntegratorFromFlags(simulator, "runge_kutta5", longest)
    integrator = simulator.get_mutable_integrator()
    integrator.set_target_accuracy(accuracy)
    context = simulator.get_mutable_context()
    begin(context)
    simulator.Initialize()
    parts, row = [], 0
    for instant, change in (*edges, (p.STOP, None)):
        integrator.StartDenseIntegration()
        simulator.AdvanceTo(instant)
        states, last = integrator.StopDenseIntegration(), round(instant / p.STEP)
        parts.append(states.vector_values(list(INSTANTS[row : last + (change is None)])))
        row = last
        if change is not None:
            change(context)
    return np.concatenate(parts, axis=1)


def _drake_linear(s: p.StateSpace) -> Callable[[], Array]:
    from pydrake.systems.primitives import LinearSystem

    plant = LinearSystem(s.A, s.b[:, None], s.c[None], np.zeros((1, 1)))

    def put(value: float) -> Callable[[Any], None]:
        return lambda context: plant.get_input_port().FixValue(context, [value])

    edges = [(p.ON * p.STEP, put(1.0)), (p.OFF * p.STEP, put(0.0))]
    return lambda: np.asarray(s.c @ _drake_run(plant, put(0.0), 1e-7, 0.02, edges))


def _drake_sliding() -> Callable[[], Array]:
    from pydrake.symbolic import Variable, sin, tanh
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
    from pydrake.systems.framework import DiagramBuilder
    from pydrake.systems.primitives import LogVectorOutput, SymbolicVectorSystem

    t, q, v = Variable("t"), Variable("q"), Variable("v")
    push = p.TORQUE * sin(2 * np.pi * p.FREQUENCY * t) - p.SPRING * q - p.DAMPER * v
    rates = [v, (push - p.FRICTION * tanh(v / SMOOTH)) / p.INERTIA]
    builder = DiagramBuilder()
    plant = builder.AddSystem(SymbolicVectorSystem(time=t, state=[q, v], dynamics=rates, output=[q]))
    log = LogVectorOutput(plant.get_output_port(), builder, p.STEP)  # dense output of so many steps fails
    diagram = builder.Build()

    def run() -> Array:
        simulator = Simulator(diagram)
        ResetIntegratorFromFlags(simulator, "radau3", 0.02)
        simulator.get_mutable_integrator().set_target_accuracy(1e-5)
        simulator.AdvanceTo(p.STOP)
        return np.asarray(log.FindLog(simulator.get_context()).data()[0])

    return run


def _drake_links() -> Callable[[], Array]:
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, RevoluteSpring, SpatialInertia, UnitInertia

    plant = MultibodyPlant(time_step=0.0)
    plant.mutable_gravity_field().set_gravity_vector([p.GRAVITY, 0, 0])
    before, at, joints = plant.world_body(), 0.0, []
    for k, (length, mass) in enumerate(zip(p.LENGTHS, p.MASSES, strict=True)):
        about_root = UnitInertia(0.0, length**2 / 3, length**2 / 3)
        body = plant.AddRigidBody(f"link{k}", SpatialInertia(mass, np.array([length / 2, 0, 0]), about_root, True))
        root = plant.AddFrame(FixedOffsetFrame(f"root{k}", before.body_frame(), RigidTransform([at, 0, 0])))
        axis = [0, 0, 1]
        joints.append(
            plant.AddJoint(RevoluteJoint(f"joint{k}", root, body.body_frame(), axis, damping=p.JOINT_DAMPING))
        )
        before, at = body, length
    plant.AddForceElement(RevoluteSpring(joints[1], 0.0, p.JOINT_SPRING))
    plant.Finalize()
    return lambda: _drake_run(plant, lambda context: plant.SetPositions(context, list(p.RAISED)), 1e-7, 0.004)[0]


# -- MuJoCo -----------------------------------------------------------------------------------------------------------


def _mujoco_run(text: str, step: float, start: Array, torque: Array | None) -> Callable[[], Array]:
    import mujoco
    from mujoco import rollout

    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_resetData(model, data)
    data.qpos[:] = start
    first = np.zeros(size)
    mujoco.mj_getState(model, data, first, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    parts = round(p.STEP / step)
    steps = p.ROWS * parts

    def run() -> Array:
        states, _ = rollout.rollout(model, [data], first[None], None if torque is None else torque[None], nstep=steps)
        return np.concatenate([[start[0]], states[0, parts - 1 :: parts, 1]])

    return run


def _mujoco_sliding(step: float) -> Callable[[], Array]:
    turning = f"{p.INERTIA} {p.INERTIA} {p.INERTIA}"
    joint = f'stiffness="{p.SPRING}" damping="{p.DAMPER}" frictionloss="{p.FRICTION}"'
    hard = f'solimpfriction="0.9999 0.9999 0.001 0.5 2" solreffriction="{2 * step} 1"'
    text = f"""<mujoco><option timestep="{step}" integrator="implicitfast" gravity="0 0 0"/>
    <worldbody><body><inertial pos="0 0 0" mass="1" diaginertia="{turning}"/>
    <joint name="j" type="hinge" axis="0 0 1" {joint} {hard}/></body></worldbody>
    <actuator><motor joint="j"/></actuator></mujoco>"""
    middles = step * (np.arange(round(p.STOP / step)) + 0.5)
    torque = p.TORQUE * np.sin(2 * np.pi * p.FREQUENCY * middles)[:, None]
    return _mujoco_run(text, step, np.zeros(1), torque)


def _mujoco_links() -> Callable[[], Array]:
    inner = ""
    for k in (1, 0):
        length, mass = p.LENGTHS[k], p.MASSES[k]
        turning = mass * length**2 / 12
        inner = f"""<body pos="{p.LENGTHS[0] * k} 0 0">
        <inertial pos="{length / 2} 0 0" mass="{mass}" diaginertia="{turning / 1e3} {turning} {turning}"/>
        <joint type="hinge" axis="0 0 1" damping="{p.JOINT_DAMPING}" stiffness="{p.JOINT_SPRING * k}"/>{inner}</body>"""
    text = f"""<mujoco><compiler angle="radian" balanceinertia="true"/>
    <option timestep="{p.STEP}" integrator="RK4" gravity="{p.GRAVITY} 0 0"/><worldbody>{inner}</worldbody></mujoco>"""
    return _mujoco_run(text, p.STEP, np.array(p.RAISED), None)


# -- diffrax ----------------------------------------------------------------------------------------------------------


def _diffrax_run(rates: Callable[..., Any], solver: Any, rtol: float, start: Any, output: Any, jumps: Any) -> Any:
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    control = diffrax.PIDController(rtol=rtol, atol=rtol * 1e-3)
    if jumps is not None:
        control = diffrax.ClipStepSizeController(control, jump_ts=jnp.asarray(jumps))
    terms, saved = diffrax.ODETerm(rates), diffrax.SaveAt(ts=jnp.asarray(INSTANTS), fn=output)
    settings = {"saveat": saved, "stepsize_controller": control, "max_steps": 10_000_000}

    @jax.jit  # type: ignore[untyped-decorator, unused-ignore]
    def solved(start: Any) -> Any:
        return diffrax.diffeqsolve(terms, solver, 0.0, p.STOP, None, start, **settings).ys

    def run() -> Array:
        return np.asarray(solved(jnp.asarray(start, dtype=float)).block_until_ready())

    return run


def _diffrax_linear(s: p.StateSpace) -> Callable[[], Array]:
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    A, b, c = jnp.asarray(s.A), jnp.asarray(s.b), jnp.asarray(s.c)
    on, off = p.ON * p.STEP, p.OFF * p.STEP

    def rates(t: Any, x: Any, _: Any) -> Any:
        return A @ x + b * jnp.where((t >= on) & (t < off), 1.0, 0.0)

    made = _diffrax_run(rates, diffrax.Tsit5(), 1e-7, np.zeros(len(s.A)), lambda t, x, _: c @ x, [on, off])
    return made  # type: ignore[no-any-return]


def _diffrax_sliding() -> Callable[[], Array]:
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    def rates(t: Any, x: Any, _: Any) -> Any:
        push = p.TORQUE * jnp.sin(2 * jnp.pi * p.FREQUENCY * t) - p.SPRING * x[0] - p.DAMPER * x[1]
        return jnp.stack([x[1], (push - p.FRICTION * jnp.tanh(x[1] / SMOOTH)) / p.INERTIA])

    return _diffrax_run(rates, diffrax.Kvaerno5(), 1e-5, np.zeros(2), lambda t, x, _: x[0], None)  # type: ignore[no-any-return]


def _diffrax_links(rtol: float) -> Callable[[], Array]:
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    def rates(t: Any, x: Any, _: Any) -> Any:
        return jnp.stack(p.links_rates(x, jnp.sin, jnp.cos))

    start = np.array([*p.RAISED, 0.0, 0.0])
    return _diffrax_run(rates, diffrax.Tsit5(), rtol, start, lambda t, x, _: x[0], None)  # type: ignore[no-any-return]


# -- Exudyn -----------------------------------------------------------------------------------------------------------


def _coordinates(model: Any, exu: Any, node: Any) -> Any:
    """A sensor of a node's coordinates, which keeps what it sees."""
    return model.AddSensor(
        {
            "sensorType": "Node",
            "nodeNumber": node,
            "outputVariableType": exu.OutputVariableType.Coordinates,
            "storeInternal": True,
            "writeToFile": False,
        }
    )


def _exudyn_run(build: Callable[[Any, Any], Any], kind: str, parts: Any, read: Callable[[Any, Any], Any]) -> Any:
    """A system is put together anew for each run, since a run starts from where the last one ended."""
    import exudyn as exu

    def run() -> Array:
        system = exu.SystemContainer()
        model = system.AddSystem()
        made = build(model, exu)
        model.Assemble()
        settings = exu.SimulationSettings()
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = p.STEP
        settings.solutionSettings.sensorsStoreAndWriteFiles = True
        settings.timeIntegration.verboseMode = 0
        rows: list[Any] = []
        for (begin, end), change in parts:
            change(model, made)
            settings.timeIntegration.startTime = begin * p.STEP
            settings.timeIntegration.endTime = end * p.STEP
            settings.timeIntegration.numberOfSteps = end - begin
            exu.SolveDynamic(model, settings, solverType=getattr(exu.DynamicSolverType, kind), updateInitialValues=True)
            values = np.asarray(read(model, made))
            rows.append(values[-(end - begin) :] if rows else values[-(end - begin + 1) :])
        return np.concatenate(rows)

    return run


def _nothing(model: Any, made: Any) -> None:
    """Change nothing before a part of a run."""


def _exudyn_linear(s: p.StateSpace) -> Callable[[], Array]:
    n = len(s.A)

    def build(model: Any, exu: Any) -> Any:
        node = model.AddNode(
            {
                "nodeType": "GenericODE1",
                "numberOfODE1Coordinates": n,
                "referenceCoordinates": [0.0] * n,
                "initialCoordinates": [0.0] * n,
            }
        )
        plant = model.AddObject(
            {
                "objectType": "GenericODE1",
                "nodeNumbers": [node],
                "systemMatrix": s.A,
                "rhsVector": np.zeros(n),
            }
        )
        sensor = model.AddSensor(
            {
                "sensorType": "Node",
                "nodeNumber": node,
                "outputVariableType": exu.OutputVariableType.Coordinates,
                "storeInternal": True,
                "writeToFile": False,
            }
        )
        return plant, sensor

    def put(value: float) -> Callable[[Any, Any], None]:
        return lambda model, made: model.SetObjectParameter(made[0], "rhsVector", s.b * value)

    edges = (0, p.ON, p.OFF, p.ROWS)
    parts = list(zip(pairwise(edges), (put(0.0), put(1.0), put(0.0)), strict=True))
    return _exudyn_run(  # type: ignore[no-any-return]
        build, "RK44", parts, lambda model, made: model.GetSensorStoredData(made[1])[:, 1:] @ s.c
    )


def _exudyn_sliding() -> Callable[[], Array]:
    def build(model: Any, exu: Any) -> Any:
        ground = model.AddNode({"nodeType": "PointGround", "referenceCoordinates": [0, 0, 0]})
        node = model.AddNode({"nodeType": "1D", "referenceCoordinates": [0.0]})
        model.AddObject({"objectType": "Mass1D", "nodeNumber": node, "physicsMass": p.INERTIA})
        fixed = model.AddMarker({"markerType": "NodeCoordinate", "nodeNumber": ground, "coordinate": 0})
        moving = model.AddMarker({"markerType": "NodeCoordinate", "nodeNumber": node, "coordinate": 0})
        model.AddObject(
            {
                "objectType": "ConnectorCoordinateSpringDamperExt",
                "markerNumbers": [fixed, moving],
                "stiffness": p.SPRING,
                "damping": p.DAMPER,
                "fDynamicFriction": p.FRICTION,
                "frictionProportionalZone": SMOOTH,
            }
        )
        turn = 2 * np.pi * p.FREQUENCY
        model.AddLoad(
            {
                "loadType": "Coordinate",
                "markerNumber": moving,
                "load": 0.0,
                "loadUserFunction": lambda model, t, load: p.TORQUE * np.sin(turn * t),
            }
        )
        return _coordinates(model, exu, node)

    parts = [((0, p.ROWS), _nothing)]
    return _exudyn_run(  # type: ignore[no-any-return]
        build, "GeneralizedAlpha", parts, lambda model, made: model.GetSensorStoredData(made)[:, 1]
    )


def _exudyn_links() -> Callable[[], Array]:
    def build(model: Any, exu: Any) -> Any:
        start = [*p.RAISED]
        node = model.AddNode(
            {
                "nodeType": "GenericODE2",
                "referenceCoordinates": [0.0, 0.0],
                "initialCoordinates": start,
                "initialCoordinates_t": [0.0, 0.0],
                "numberOfODE2Coordinates": 2,
            }
        )
        along = exu.Vector3DList()
        inertias, turns, offsets = exu.Matrix3DList(), exu.Matrix3DList(), exu.Vector3DList()
        for k, (length, mass) in enumerate(zip(p.LENGTHS, p.MASSES, strict=True)):
            along.Append([length / 2, 0, 0])
            turning = mass * length**2 / 12
            inertias.Append(np.diag([0.0, turning, turning]))
            turns.Append(np.eye(3))
            offsets.Append([p.LENGTHS[0] * k, 0, 0])
        model.AddObject(
            {
                "objectType": "KinematicTree",
                "nodeNumber": node,
                "jointTypes": [exu.JointType.RevoluteZ] * 2,
                "linkParents": [-1, 0],
                "jointTransformations": turns,
                "jointOffsets": offsets,
                "linkInertiasCOM": inertias,
                "linkCOMs": along,
                "linkMasses": list(p.MASSES),
                "baseOffset": [0.0, 0.0, 0.0],
                "gravity": [p.GRAVITY, 0, 0],
                "jointPControlVector": [0.0, p.JOINT_SPRING],
                "jointDControlVector": [p.JOINT_DAMPING] * 2,
                "jointPositionOffsetVector": [0.0, 0.0],
                "jointVelocityOffsetVector": [0.0, 0.0],
            }
        )
        return _coordinates(model, exu, node)

    parts = [((0, p.ROWS), _nothing)]
    return _exudyn_run(  # type: ignore[no-any-return]
        build, "RK44", parts, lambda model, made: model.GetSensorStoredData(made)[:, 1]
    )
