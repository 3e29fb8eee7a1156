"""The serial arm against direct integration along its links, Lagrange's equations, and published arms."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.linalg
import sympy
from scipy import integrate

from blocks.actuators.dc_motor import DCMotor
from blocks.actuators.friction import BearingFriction
from blocks.actuators.gear import Gear
from blocks.links.assumed_modes import AssumedModesLink
from blocks.links.fixed import Fixed
from blocks.links.serial_arm import SerialArm
from blocks.links.shape_sets import shape_set
from blocks.sources.pulse import Pulse
from engine.block import Block
from engine.errors import ConnectionProblem, ParameterError
from engine.model import Model
from tests.blocks.assembly import linear, model, run
from tests.blocks.test_drive_train import balance
from tests.blocks.test_mode_shapes import shape

MODES = (2, 0, 3)
THREE = {
    "links": 3,
    "modes": list(MODES),
    "length": [0.5, 0.3, 0.4],
    "mass": [0.3, 0.2, 0.25],
    "flexural_rigidity": [0.8, 0, 0.5],
    "payload": [0.15, 0.05, 0.1],
    "hub_inertia": [0.01, 0.002, 0.001],
    "gravity": True,
    "gravity_direction": 0.4,
}
SHORT = {"length": 0.2, "mass": 0.05, "flexural_rigidity": 0.1}
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
X, W = (NODES + 1) / 2, WEIGHTS / 2


@cache
def table(mode: int, order: int) -> Any:
    """A mode at the quadrature nodes and at the tip."""
    return np.array([shape(mode, float(p), order) for p in [*X, 1.0]])


def layout(made: Model) -> list[str]:
    return [state.name for state in made.states[: made.coordinates]]


def point(made: Model, seed: int, amplitude: float = 0.02) -> tuple[Any, Any]:
    """Random coordinates and speeds, in the model's order."""
    rng = np.random.default_rng(seed)
    size = np.array([amplitude if "mode" in name else 1.0 for name in layout(made)])
    return rng.normal(size=made.coordinates) * size, rng.normal(size=made.coordinates) * size * 5


def evaluate(made: Model, name: str, q: Any, v: Any) -> Any:
    x = np.concatenate([q, v, np.zeros(len(made.states) - 2 * made.coordinates)])
    e = made.equations
    empty = [np.zeros(s.numel()) for s in (e.u, e.d, e.m)]
    return np.array(made.functions[name](0, x, *empty, made.parameter_values).full()).ravel()


def stored(made: Model, q: Any, v: Any) -> float:
    names = [variable.name for variable in made.outputs]
    return float(evaluate(made, "outputs", q, v)[names.index("energy.stored")])


def accelerations(made: Model, q: Any, v: Any) -> Any:
    n = made.coordinates
    return evaluate(made, "derivative", q, v)[n : 2 * n]


def directly(values: dict[str, Any], q: dict[str, Any], v: dict[str, Any], shortened: bool = False) -> float:
    """Kinetic energy plus potential, every particle's path differentiated by complex steps."""
    step = 1e-30
    turn, root = 0.0j, np.zeros(2, dtype=complex)
    pull = 9.81 * np.array([np.cos(values["gravity_direction"]), np.sin(values["gravity_direction"])])
    energy = 0.0
    for i, modes in enumerate(values["modes"]):
        length, mass, payload = (values[key][i] for key in ("length", "mass", "payload"))

        def moved(name: str) -> complex:
            return complex(q[name], step * v[name])

        turn = turn + moved(f"arm.joint{i + 1}.angle")
        d = [moved(f"arm.link{i + 1}.mode{j + 1}.position") for j in range(modes)]
        bent, slope, curved = (
            sum((a * table(j, order) for j, a in enumerate(d, 1)), np.zeros(len(X) + 1, dtype=complex)) / length**order
            for order in range(3)
        )
        along = length * np.append(X, 1.0) + 0j
        if shortened:
            fine = [
                p
                * np.sum(
                    W * (sum(a * np.array([shape(j, float(p * x), 1) for x in X]) for j, a in enumerate(d, 1)) ** 2)
                )
                for p in [*X, 1.0]
            ]
            along = along - np.array(fine) / (2 * length)
        path = root[:, None] + np.array(
            [np.cos(turn) * along - np.sin(turn) * bent, np.sin(turn) * along + np.cos(turn) * bent]
        )
        weights = np.append(mass * W, payload)
        energy += float(np.sum(weights * np.sum((path.imag / step) ** 2, axis=0)) / 2)
        energy += values["hub_inertia"][i] * (turn.imag / step) ** 2 / 2
        energy -= float(np.sum(weights * (pull @ path.real)))
        energy += values["flexural_rigidity"][i] * length * float(np.sum(W * curved.real[:-1] ** 2)) / 2
        root, turn = path[:, -1], turn + slope[-1]
    return energy


def named(made: Model, q: Any) -> dict[str, Any]:
    return dict(zip(layout(made), q, strict=True))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_energy_is_that_of_the_moving_beams(seed: int) -> None:
    """Kinetic energy against direct integration, 1e-10; gravity and strain besides."""
    made = model({"arm": SerialArm(**THREE)})
    q, v = point(made, seed)
    expected = directly(THREE, named(made, q), named(made, v))
    assert stored(made, q, v) == pytest.approx(expected, rel=1e-10)
    moving = expected - directly(THREE, named(made, q), named(made, 0 * v))
    assert stored(made, q, v) - stored(made, q, 0 * v) == pytest.approx(moving, rel=1e-10)


def mass_matrix(made: Model, q: Any) -> Any:
    """By polarisation of the kinetic energy."""
    n = made.coordinates
    unit, rest = np.eye(n), stored(made, q, np.zeros(n))
    alone = [stored(made, q, e) - rest for e in unit]
    pairs = [
        [stored(made, q, a + b) - rest - alone[i] - alone[j] for j, b in enumerate(unit)] for i, a in enumerate(unit)
    ]
    return np.array(pairs)


def test_mass_matrix_is_symmetric_positive_and_moves_the_arm() -> None:
    """From rest, M q'' is minus the gradient of the potential; M from direct integration."""
    made = model({"arm": SerialArm(**THREE)})
    n = made.coordinates
    q, _ = point(made, 5)
    rest = directly(THREE, named(made, q), named(made, np.zeros(n)))

    def moving(v: Any) -> float:
        return directly(THREE, named(made, q), named(made, v)) - rest

    unit = np.eye(n)
    M = np.array([[moving(a + b) - moving(a) - moving(b) for b in unit] for a in unit])
    np.testing.assert_allclose(mass_matrix(made, q), M, rtol=1e-10, atol=1e-10 * np.abs(M).max())
    np.testing.assert_allclose(M, M.T, rtol=1e-12, atol=1e-13)
    assert np.linalg.eigvalsh(M)[0] > 0
    gradient = []
    for e in unit:
        h = 1e-3 * (1.0 if np.abs(e @ q) > 0.1 else 0.05)
        values = [directly(THREE, named(made, q + k * h * e), named(made, 0 * q)) for k in (-2, -1, 1, 2)]
        gradient.append((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h))
    pushed = M @ accelerations(made, q, np.zeros(n))
    np.testing.assert_allclose(pushed, -np.array(gradient), rtol=0, atol=1e-8 * np.abs(gradient).max())


VARIANTS: list[dict[str, Any]] = [
    {"nonlinear": False},
    {"nonlinear": True},
    {"nonlinear": True, "foreshortening": True},
    {"nonlinear": True, "foreshortening": True, "modes": [4, 0, 2], "shapes": "craig_bampton"},
]


@pytest.mark.parametrize("variant", VARIANTS)
def test_recursion_gives_lagranges_equations(variant: dict[str, Any]) -> None:
    """d/dt dT/dv - d(T - V)/dq = 0 with dense derivatives of the whole arm's energy."""
    made = model({"arm": SerialArm(**{**THREE, **variant})})
    n, e = made.coordinates, made.equations
    names = [variable.name for variable in made.outputs]
    energy = e.outputs[names.index("energy.stored")]
    q, v = e.x[:n], e.x[n : 2 * n]
    momentum = ca.gradient(energy, v)
    M = ca.jacobian(momentum, v)
    potential = ca.substitute(energy, v, ca.SX.zeros(n))
    force = ca.gradient(energy - 2 * potential, q) - ca.jtimes(momentum, q, v)
    lagrange = ca.Function("l", e.arguments, [ca.densify(M), force])
    for seed in range(3):
        at, speed = point(made, seed, amplitude=0.004)
        x = np.concatenate([at, speed, np.zeros(len(made.states) - 2 * n)])
        empty = [np.zeros(s.numel()) for s in (e.u, e.d, e.m)]
        expected = np.linalg.solve(*(m.full() for m in lagrange(0, x, *empty, made.parameter_values))).ravel()
        found = accelerations(made, at, speed)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())


def test_two_links_by_sympy() -> None:
    """An independent Lagrange derivation, two links with one mode each, payload, hubs, gravity."""
    length, mass, payload, hub, rigidity = (0.24, 0.19), (0.02, 0.017), (0.21, 0.03), (5e-5, 4e-5), (0.05, 0.04)
    t = sympy.Symbol("t")
    q = [sympy.Function(name)(t) for name in ("a", "d", "b", "e")]
    slope = shape(1, 1.0, 1)
    directions = [q[0], q[0] + slope / length[0] * q[1] + q[2]]
    root = sympy.zeros(2, 1)
    energy = 0
    for i, turn in enumerate(directions):
        area, first = (integrate.quad(lambda x, p=p: x**p * shape(1, x, 0), 0, 1, epsabs=1e-13)[0] for p in (0, 1))
        squared, bending = (integrate.quad(lambda x, o=o: shape(1, x, o) ** 2, 0, 1, epsabs=1e-12)[0] for o in (0, 2))
        axis = sympy.Matrix([sympy.cos(turn), sympy.sin(turn)])
        lift = sympy.Matrix([-sympy.sin(turn), sympy.cos(turn)]) * q[2 * i + 1]
        da, db, dc = (part.diff(t) for part in (root, length[i] * axis, lift))
        energy += mass[i] / 2 * (da.dot(da) + db.dot(db) / 3 + squared * dc.dot(dc) + da.dot(db))
        energy += mass[i] * (area * da.dot(dc) + first * db.dot(dc))
        end = root + length[i] * axis + shape(1, 1.0, 0) * lift
        energy += payload[i] / 2 * end.diff(t).dot(end.diff(t)) + hub[i] / 2 * turn.diff(t) ** 2
        centre = mass[i] * (root + length[i] * axis / 2 + area * lift) + payload[i] * end
        energy += 9.81 * centre[0] - rigidity[i] * bending / length[i] ** 3 / 2 * q[2 * i + 1] ** 2
        root = end
    rates = [x.diff(t) for x in q]
    symbols, speeds = sympy.symbols("q0:4"), sympy.symbols("v0:4")
    plain = sympy.sympify(energy).subs(dict(zip(rates, speeds, strict=True))).subs(dict(zip(q, symbols, strict=True)))
    momentum = [sympy.diff(plain, s) for s in speeds]
    M = sympy.Matrix([[sympy.diff(p, s) for s in speeds] for p in momentum])
    f = sympy.Matrix(
        [
            sympy.diff(plain, s) - sum(sympy.diff(p, o) * w for o, w in zip(symbols, speeds, strict=True))
            for s, p in zip(symbols, momentum, strict=True)
        ]
    )
    exact = sympy.lambdify([symbols, speeds], [M, f], "numpy")
    arm = SerialArm(
        links=2, modes=1, length=list(length), mass=list(mass), payload=list(payload), hub_inertia=list(hub),
        flexural_rigidity=list(rigidity), gravity=True,
    )  # fmt: skip
    made = model({"arm": arm})
    order = [
        layout(made).index(f"arm.{name}")
        for name in ("joint1.angle", "link1.mode1.position", "joint2.angle", "link2.mode1.position")
    ]
    for seed in range(4):
        at, speed = point(made, seed, amplitude=0.01)
        M_at, f_at = exact(at[order], speed[order])
        expected = np.linalg.solve(np.array(M_at, dtype=float), np.array(f_at, dtype=float).ravel())
        np.testing.assert_allclose(
            accelerations(made, at, speed)[order], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
        )
    M_at = np.array(exact(at[order], speed[order])[0], dtype=float)
    np.testing.assert_allclose(mass_matrix(made, at)[np.ix_(order, order)], M_at, rtol=1e-10, atol=1e-10 * M_at.max())


@pytest.mark.parametrize("variant", VARIANTS[:3])
def test_one_link_is_the_assumed_modes_link(variant: dict[str, bool]) -> None:
    values = {"length": 0.5, "mass": 0.3, "flexural_rigidity": 0.8, "payload": 0.15, "hub_inertia": 0.02}
    more = {"modes": 3, "damping_ratio": 0.01, **variant}
    arm = model({"arm": SerialArm(links=1, **values, **more)})
    other = model({"arm": AssumedModesLink(**values, **more)})
    for seed in range(3):
        q, v = point(arm, seed)
        np.testing.assert_allclose(accelerations(arm, q, v), accelerations(other, q, v), rtol=1e-9)
        assert stored(arm, q, v) == pytest.approx(stored(other, q, v), rel=1e-12)


def test_foreshortening_is_right_to_second_order() -> None:
    """What is left out of the energy falls with the third power of the deflection."""
    made, straight = (model({"arm": SerialArm(**THREE, foreshortening=short)}) for short in (True, False))
    bending = np.array(["mode" in name for name in layout(made)])
    errors = []
    for scale in (1.0, 0.5):
        q, v = (np.where(bending, scale * a, a) for a in point(made, 3, amplitude=0.005))
        errors.append(stored(made, q, v) - directly(THREE, named(made, q), named(made, v), shortened=True))
        if scale == 1:
            effect = stored(made, q, v) - stored(straight, q, v)
    assert abs(errors[0]) < 0.1 * abs(effect)
    assert abs(errors[1]) < abs(errors[0]) / 7


@pytest.mark.parametrize("variant", VARIANTS)
def test_energy_is_conserved(variant: dict[str, Any]) -> None:
    start = {
        "arm.joint1.angle": 1.0,
        "arm.joint2.angle": -0.5,
        "arm.joint3.speed": 3.0,
        "arm.link1.mode1.position": 0.01,
    }
    arm = SerialArm(**{**THREE, **variant})
    result = run({"arm": arm}, stop=2.0, initial=start, internal_step=2e-5)
    energy = result["energy.stored"]
    weight, reach = 1.05 * 9.81, 1.2
    assert np.ptp(energy) < 1e-9 * weight * reach
    assert result["arm.tip.x"][0] != result["arm.tip.x"][-1]


def test_a_driven_arm_with_gears_friction_and_damping_balances() -> None:
    parts: dict[str, Block] = {
        "source": Pulse(height="6 V", width=0.1, period=0.3, count=3),
        "motor": DCMotor(resistance=2.6, torque_constant=0.02, rotor_inertia=1e-6),
        "gear": Gear(ratio=50, efficiency=0.8),
        "grip": BearingFriction(coulomb_friction=0.3),
        "arm": SerialArm(**{**THREE, "gravity": False}, viscous_friction=0.002, damping_ratio=0.01),
    }
    wires = ("source.out motor.voltage", "motor.shaft gear.input", "gear.output arm.joint2", "grip.shaft arm.joint1")
    result = run(parts, *wires, stop=1.0, internal_step=5e-5)
    assert balance(result) < 1e-7
    assert result["energy.dissipated"][-1] > 0.1 * result["energy.supplied"][-1]
    assert "grip" in {name for _, name, _ in result.events}


def test_tip_follows_the_links() -> None:
    start = {
        "arm.joint1.angle": 0.3,
        "arm.joint2.angle": 0.5,
        "arm.joint3.angle": -1.0,
        "arm.link1.mode1.position": 0.01,
    }
    result = run({"arm": SerialArm(**THREE)}, stop=0.01, initial=start)
    bent, lean = 0.02, 0.01 * shape(1, 1.0, 1) / 0.5
    turns = np.cumsum([0.3, 0.5 + lean, -1.0])
    ends = [length * np.exp(1j * turn) for length, turn in zip(THREE["length"], turns, strict=True)]  # type: ignore[call-overload]
    end = sum(ends) + 1j * bent * np.exp(0.3j)
    assert result["arm.tip.x"][0] + 1j * result["arm.tip.y"][0] == pytest.approx(end, rel=1e-12)
    assert result["arm.tip.angle"][0] == pytest.approx(turns[-1], rel=1e-12)
    assert result["arm.link1.deflection"][0] == pytest.approx(bent, rel=1e-12)
    assert result["arm.link1.curvature"][0] == pytest.approx(0.01 * shape(1, 0.0, 2) / 0.5**2, rel=1e-9)


def test_weight_bends_a_clamped_link() -> None:
    """Held level, its tip hangs down by m g L^3 / (8 EI) + mp g L^3 / (3 EI)."""
    length, mass, payload, rigidity = 0.4, 0.01, 0.004, 0.5
    arm = SerialArm(
        links=1, modes=4, shapes="craig_bampton", length=length, mass=mass, payload=payload,
        flexural_rigidity=rigidity, damping_ratio=0.7, gravity=True, gravity_direction="-90 deg",
    )  # fmt: skip
    result = run({"arm": arm, "wall": Fixed()}, "arm.joint1 wall.shaft", stop=2.0)
    expected = -9.81 * length**3 / rigidity * (mass / 8 + payload / 3)
    assert result["arm.link1.deflection"][-1] == pytest.approx(expected, rel=1e-4)


def test_weight_stiffens_a_hanging_link() -> None:
    """Clamped and hanging, against finite elements with the tension rho g (L - s) + mp g; only with foreshortening."""
    length, mass, rigidity, payload, n = 0.8, 0.05, 0.02, 0.03, 60
    h = length / n
    M, K = np.zeros((2 * n + 2, 2 * n + 2)), np.zeros((2 * n + 2, 2 * n + 2))
    inertia = np.array(
        [[156, 22 * h, 54, -13 * h], [0, 4 * h * h, 13 * h, -3 * h * h], [0, 0, 156, -22 * h], [0, 0, 0, 4 * h * h]]
    )
    bend = np.array(
        [[12, 6 * h, -12, 6 * h], [0, 4 * h * h, -6 * h, 2 * h * h], [0, 0, 12, -6 * h], [0, 0, 0, 4 * h * h]]
    )
    pull = np.array([[36, 3 * h, -36, 3 * h], [0, 4 * h * h, -3 * h, -h * h], [0, 0, 36, -3 * h], [0, 0, 0, 4 * h * h]])
    whole = [np.triu(m) + np.triu(m, 1).T for m in (inertia, bend, pull)]
    for k in range(n):
        at = slice(2 * k, 2 * k + 4)
        M[at, at] += mass / length * h / 420 * whole[0]
        tension = 9.81 * (mass * (1 - (k + 0.5) / n) + payload)
        K[at, at] += rigidity / h**3 * whole[1] + tension / (30 * h) * whole[2]
    M[-2, -2] += payload
    expected = np.sqrt(scipy.linalg.eigh(K[2:, 2:], M[2:, 2:], eigvals_only=True))[:2]
    values = {"length": length, "mass": mass, "flexural_rigidity": rigidity, "payload": payload, "modes": 6}
    parts: dict[str, Block] = {
        "arm": SerialArm(links=1, shapes="craig_bampton", gravity=True, foreshortening=True, **values),
        "wall": Fixed(),
    }
    found = np.abs(linear(parts, "arm.joint1 wall.shaft").poles())
    np.testing.assert_allclose(found[[0, 2]], expected, rtol=2e-4)


@pytest.mark.parametrize("count", [2, 4, 9, 20])
@pytest.mark.parametrize("name", ["cantilever", "craig_bampton"])
def test_shape_sets_bend_as_a_beam_does(name: str, count: int) -> None:
    """Frequencies from above; a tip force and a tip moment bend craig_bampton exactly, cantilever modes nearly."""
    made = shape_set(name, count)
    roots = np.sqrt(np.sqrt(made.stiffness[:2]))
    assert (roots >= np.array([1.8751040687, 4.6940911330]) * (1 - 1e-9)).all()
    np.testing.assert_allclose(roots[:1], [1.8751040687], rtol=3e-3)
    flexibility = {
        "tip": (made.tip @ (made.tip / made.stiffness), 1 / 3),
        "slope": (made.tip_slope**2 / made.stiffness, 1),
    }
    deflection, exact = flexibility["tip"]
    turn = float(np.sum(flexibility["slope"][0]))
    if name == "craig_bampton":
        assert deflection == pytest.approx(exact, rel=1e-10)
        assert turn == pytest.approx(1, rel=1e-10)
    else:
        assert exact * (1 - 0.03) < deflection < exact
        assert turn < 1 - 0.3 / count


def test_work_grows_in_proportion_to_the_links() -> None:
    def instructions(links: int, **rest: Any) -> int:
        values = {"length": 0.2, "mass": 0.05, "flexural_rigidity": 0.1, "payload": 0.02, "hub_inertia": 1e-5}
        made = model({"arm": SerialArm(links=links, modes=2, **values, **rest)}, outputs=["arm.tip.x"], energy=False)
        return int(made.functions["derivative"].n_instructions())

    for rest in ({}, {"gravity": True}, {"shapes": "craig_bampton"}):
        four, eight, sixteen, most = (instructions(n, **rest) for n in (4, 8, 16, 32))
        assert sixteen - eight == 2 * (eight - four)
        assert most - sixteen == 2 * (sixteen - eight)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"flexural_rigidity": [0.8, 0, 0]}, "link 3 has 3 modes but no flexural_rigidity"),
        ({"length": [0.5, -0.3, 0.4]}, "-0.3 is out of range: length must be > 0 m"),
        ({"length": [0.5, 0.3]}, "length has 2 values\n  give 3, one per links"),
        ({"modes": [2, 2]}, "modes has 2 values\n  give 3, one per links"),
        ({"modes": [2, -1, 2]}, "-1 is out of range: modes"),
        ({"links": 0}, "0 is out of range: links"),
        ({"damping_ratio": [0.1, 0.1, 0.1]}, "damping_ratio has 3 values\n  give 5, one per modes"),
        ({"nonlinear": False, "foreshortening": True}, "foreshortening needs nonlinear: true"),
        ({"shapes": "craig_bampton", "modes": 1, "flexural_rigidity": 1}, "link 1 has 1 mode, but craig_bampton"),
        ({"shapes": "craigbampton"}, "did you mean 'craig_bampton'"),
    ],
)
def test_refusals(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        SerialArm(**{**THREE, **change})


def test_a_flange_that_is_not_there_is_named() -> None:
    parts: dict[str, Block] = {"arm": SerialArm(**THREE), "wall": Fixed()}
    with pytest.raises(ConnectionProblem, match=r"flange 'wall.shaft' is connected to signal 'arm.joint4'"):
        model(parts, "arm.joint4 wall.shaft")
    assert list(SerialArm(**THREE).ports)[-2:] == ["joint2", "joint3"]
    assert next(iter(SerialArm(**SHORT, links=1).ports)) == "joint1"
    assert "joint2" not in SerialArm.ports


def test_a_link_may_have_no_mode_at_all_in_either_set() -> None:
    for shapes in ("cantilever", "craig_bampton"):
        made = model({"arm": SerialArm(links=2, modes=0, shapes=shapes, **SHORT)})
        assert layout(made) == ["arm.joint1.angle", "arm.joint2.angle"]
