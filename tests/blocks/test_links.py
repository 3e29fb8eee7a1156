"""The flexible link: published numbers, energy by quadrature, equations written out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import integrate, optimize

from blocks.actuators.effort import Torque
from blocks.links.assumed_modes import AssumedModesLink
from blocks.links.fixed import Fixed
from blocks.links.inertia import Inertia
from blocks.links.rigid_link import RigidLink
from blocks.sources.pulse import Pulse
from blocks.sources.step import Step
from engine.block import Block
from engine.linearise import LinearModel
from tests.blocks.assembly import linear, model, run
from tests.blocks.test_drive_train import balance
from tests.blocks.test_mode_shapes import shape

SET_A = {"length": 0.419, "mass": 0.065, "flexural_rigidity": 0.13742, "hub_inertia": 2.08e-3}
SET_B = {**SET_A, "length": 0.381, "flexural_rigidity": 0.10332}


def hinged(link: Block, **rest: Any) -> LinearModel:
    parts: dict[str, Block] = {"torque": Torque(), "link": link}
    return linear(parts, "torque.shaft link.hub", inputs=["torque.torque"], outputs=["link.hub.angle"], **rest)


def clamped(link: Block) -> LinearModel:
    return linear({"link": link, "wall": Fixed()}, "link.hub wall.shaft")


def hertz(found: LinearModel) -> Any:
    """Frequencies of the oscillating poles, rising."""
    poles = found.poles()
    return np.abs(poles[poles.imag > 1e-3]) / (2 * np.pi)


@pytest.mark.parametrize(
    ("values", "m1", "m2", "frequency"),
    [(SET_A, 5.8838e-3, 1.54920e-2, 4.9156), (SET_B, 5.2252e-3, 1.40870e-2, 4.6529)],
)
def test_paper_000_one_mode(values: dict[str, float], m1: float, m2: float, frequency: float) -> None:
    """Computed independently: M1, M2, M4, K4, clamped zeros, hinged frequency; the clamped mode is 3 Hz."""
    rigidity = 0.065 * values["length"] ** 3 * (6 * np.pi) ** 2 / 1.8751040687**4
    assert rigidity == pytest.approx(values["flexural_rigidity"], rel=2e-5)
    found = hinged(AssumedModesLink(**{**values, "flexural_rigidity": rigidity}))
    m4, k4 = 0.065, 23.0949
    determinant = m1 * m4 - m2**2
    speeds = slice(2, 4)
    inverse = np.array([[m4, -m2], [-m2, m1]]) / determinant
    np.testing.assert_allclose(found.B[speeds, 0], inverse[:, 0], rtol=2e-4)
    np.testing.assert_allclose(found.A[speeds, 1], -inverse[:, 1] * k4, rtol=2e-4)
    zeros = found.zeros()
    np.testing.assert_allclose(np.sort(zeros.imag), [-6 * np.pi, 6 * np.pi], rtol=1e-6)
    assert hertz(found) == pytest.approx([frequency], rel=1e-4)


@pytest.mark.parametrize("modes", [1, 4, 16, 32])
def test_clamped_frequencies_and_the_zeros(modes: int) -> None:
    """Zeros of angle / torque are the clamped poles, 7.6221, 47.767, 133.75 Hz."""
    link = AssumedModesLink(length=0.33, mass=0.06, flexural_rigidity=0.4, hub_inertia=2e-5, modes=modes)
    locked = hertz(clamped(link))
    np.testing.assert_allclose(locked[:3], [7.6221, 47.767, 133.75][:modes], rtol=1e-4)
    zeros = hinged(link).zeros()
    np.testing.assert_allclose(np.sort(zeros.imag[zeros.imag > 0]) / (2 * np.pi), locked, rtol=1e-6)


@pytest.mark.parametrize(("hub", "expected"), [(2e-5, [31.96, 97.48]), (7e-5, [28.45, 67.82])])
def test_hinged_frequencies_with_two_modes(hub: float, expected: list[float]) -> None:
    """Values computed independently."""
    link = AssumedModesLink(length=0.33, mass=0.06, flexural_rigidity=0.4, hub_inertia=hub, modes=2)
    np.testing.assert_allclose(hertz(hinged(link)), expected, rtol=2e-3)


@pytest.mark.parametrize(
    ("length", "mass", "rigidity", "payload", "hub", "fixed", "expected"),
    [
        (0.19, 0.020, 0.05, 0.0, 5e-5, True, 10.68),
        (0.19, 0.017, 0.05, 0.0, 5e-5, True, 11.59),
        (0.24, None, 0.05, 0.0, 5e-5, True, 7.53),
        (0.24, None, 0.05, 0.210, 5e-5, True, 1.131),
        (0.24, None, 0.05, 0.210, 5e-5, False, 14.51),
    ],
)
def test_links_of_paper_003(
    length: float, mass: float | None, rigidity: float, payload: float, hub: float, fixed: bool, expected: float
) -> None:
    """[Mohan 2010, Table 5], single links, 0.5 %; the mass of link 1 is that of its bare clamped 7.53 Hz."""
    if mass is None:
        mass = rigidity * (1.8751040687 / length) ** 4 * length / (2 * np.pi * 7.53) ** 2
    link = AssumedModesLink(
        length=length, mass=mass, flexural_rigidity=rigidity, payload=payload, hub_inertia=hub, modes=12
    )
    assert hertz(clamped(link) if fixed else hinged(link))[0] == pytest.approx(expected, rel=5e-3)


def test_payload_against_the_exact_beam() -> None:
    """Clamped beam with a tip mass: 1 + cos b cosh b + r b (cos b sinh b - sin b cosh b) = 0, r = mp / m."""
    ratio, modes = 0.7, 24

    def characteristic(b: float) -> float:
        c, s, ch, sh = np.cos(b), np.sin(b), np.cosh(b), np.sinh(b)
        return float(1 + c * ch + ratio * b * (c * sh - s * ch))

    roots = [optimize.brentq(characteristic, low, high, xtol=1e-14) for low, high in [(0.5, 2.5), (3, 5), (6, 7.8)]]
    link = AssumedModesLink(length=1, mass=1, flexural_rigidity=1, payload=ratio, modes=modes)
    found = 2 * np.pi * hertz(clamped(link))[:3] / np.square(roots) - 1
    assert (found > -1e-9).all(), "assumed modes are never too soft"
    assert (found < [1e-5, 1e-3, 2e-3]).all()


def test_damping_ratio_of_clamped_modes() -> None:
    ratios = [0.0315, 0.0068, 0.1]
    link = AssumedModesLink(length=0.33, mass=0.06, flexural_rigidity=0.4, modes=3, damping_ratio=ratios, hub_inertia=1)
    poles = clamped(link).poles()
    poles = poles[poles.imag > 0]
    np.testing.assert_allclose(-poles.real / np.abs(poles), ratios, rtol=1e-9)
    zeta = [2 * r * np.sqrt(0.4 * b**4 / 0.33**3 * 0.06) for r, b in zip(ratios, (1.8751, 4.6941, 7.8548), strict=True)]
    assert zeta[0] == pytest.approx(0.0315 * 5.7464, rel=1e-4)
    found = clamped(link)
    np.testing.assert_allclose(-np.diag(found.A)[-3:] * 0.06, zeta, rtol=2e-5)


SHAPE = {"length": 0.5, "mass": 0.3, "flexural_rigidity": 0.8, "payload": 0.15, "hub_inertia": 0.02}
POINT = {"link.hub.angle": 0.3, "link.hub.speed": 4.0}
AMPLITUDES, RATES = (0.01, -0.004, 0.002), (0.3, 0.2, -0.5)
for number, (amplitude, rate) in enumerate(zip(AMPLITUDES, RATES, strict=True), 1):
    POINT |= {f"link.mode{number}.position": amplitude, f"link.mode{number}.speed": rate}


def energy_by_quadrature(nonlinear: bool, foreshortening: bool) -> float:
    """Kinetic and strain energy of the moving beam, integrated over its length."""
    length, speed = 0.5, POINT["link.hub.speed"]
    nodes, weights = np.polynomial.legendre.leggauss(40)
    x, w = (nodes + 1) / 2, weights / 2

    def field(values: tuple[float, ...], order: int, at: Any = x) -> Any:
        terms = [a * np.array([shape(i, float(p), order) for p in at]) for i, a in enumerate(values, 1)]
        return sum(terms) / length**order

    def kinetic(s: Any, at: Any, drawn_in: Any) -> Any:
        across = s * speed + field(RATES, 0, at)
        along = field(AMPLITUDES, 0, at) * speed
        squared = across**2 + (along**2 if nonlinear else 0.0)
        return squared / 2 + (drawn_in * s * speed**2 if foreshortening else 0.0)

    def drawn(p: float) -> float:
        """u(s) = -1/2 int_0^s w_x^2 dx, to second order the way a bent arm is shorter."""
        inner = p * x
        return -0.5 * p * length * float(np.sum(w * field(AMPLITUDES, 1, inner) ** 2))

    beam = 0.3 * np.sum(w * kinetic(length * x, x, np.array([drawn(float(p)) for p in x])))
    tip = 0.15 * kinetic(np.array([length]), np.array([1.0]), np.array([drawn(1.0)]))[0]
    strain = 0.8 / 2 * length * np.sum(w * field(AMPLITUDES, 2) ** 2)
    return float(0.02 * speed**2 / 2 + beam + tip + strain)


@pytest.mark.parametrize(("nonlinear", "foreshortening"), [(False, False), (True, False), (True, True)])
def test_energy_is_that_of_the_beam(nonlinear: bool, foreshortening: bool) -> None:
    link = AssumedModesLink(**SHAPE, modes=3, nonlinear=nonlinear, foreshortening=foreshortening)
    result = run({"link": link}, stop=0.01, initial=POINT)
    assert result["energy.stored"][0] == pytest.approx(energy_by_quadrature(nonlinear, foreshortening), rel=1e-10)


@pytest.mark.parametrize("foreshortening", [False, True])
def test_one_mode_equations_written_out(foreshortening: bool) -> None:
    """[Gao X. n.d., eq. 11] in corrected form, integrated by scipy."""
    length, mass, rigidity, hub, push = 0.419, 0.065, 0.13742, 2.08e-3, 0.05
    j0, c, a = hub + mass * length**2 / 3, mass * length * 0.568825748, mass
    k = rigidity * 12.3623634 / length**3
    g = mass * 1.193336 if foreshortening else 0.0

    def rhs(t: float, y: Any) -> list[float]:
        _, w, alpha, rate = y
        torque = push if t < 0.5 else 0.0
        matrix = [[j0 + (a - g) * alpha**2, c], [c, a]]
        force = [torque - 2 * w * (a - g) * alpha * rate, (a - g) * alpha * w**2 - k * alpha]
        speed, bend = np.linalg.solve(matrix, force)
        return [w, speed, rate, bend]

    first = integrate.solve_ivp(rhs, (0, 0.5), [0] * 4, rtol=1e-11, atol=1e-13)
    second = integrate.solve_ivp(rhs, (0.5 + 1e-15, 1.0), first.y[:, -1], rtol=1e-11, atol=1e-13)
    parts: dict[str, Block] = {
        "source": Step(height=push, stop=0.5),
        "torque": Torque(),
        "link": AssumedModesLink(**SET_A, nonlinear=True, foreshortening=foreshortening),
    }
    result = run(parts, "source.out torque.torque", "torque.shaft link.hub", stop=1.0, internal_step=2e-4)
    found = [result[f"link.{n}"][-1] for n in ("hub.angle", "hub.speed", "mode1.amplitude")]
    np.testing.assert_allclose(found, second.y[:3, -1], rtol=2e-6)
    assert result["link.tip.deflection"][-1] == pytest.approx(2 * found[2], rel=1e-14)


@pytest.mark.parametrize(("foreshortening", "expected"), [(False, 2.54), (True, 3.08)])
def test_frequency_of_the_spinning_arm(foreshortening: bool, expected: float) -> None:
    """3 Hz clamped at 10 rad/s; a heavy hub keeps the speed."""
    values = {**SET_A, "hub_inertia": 1e6}
    link = AssumedModesLink(**values, nonlinear=True, foreshortening=foreshortening)
    found = linear({"link": link}, at={"link.hub.speed": 10.0})
    assert hertz(found) == pytest.approx([expected], abs=0.006)


@pytest.mark.parametrize(("modes", "foreshortening"), [(1, False), (1, True), (4, True)])
def test_energy_is_conserved(modes: int, foreshortening: bool) -> None:
    """With both rows the energy closes to 1e-9 (2 s at 5 rad/s)."""
    link = AssumedModesLink(**SET_A, modes=modes, nonlinear=True, foreshortening=foreshortening)
    start = {"link.hub.speed": 5.0, "link.mode1.position": 0.01}
    result = run({"link": link}, stop=2.0, initial=start, internal_step=5e-5)
    stored = result["energy.stored"]
    assert np.abs(stored - stored[0]).max() < 1e-9 * stored[0]


def test_locked_undamped_arm_rings_on() -> None:
    """Energy drift below 1e-6."""
    parts: dict[str, Block] = {"link": AssumedModesLink(**SET_A, nonlinear=True), "wall": Fixed()}
    result = run(parts, "link.hub wall.shaft", stop=5.0, initial={"link.mode1.position": 0.01})
    stored = result["energy.stored"]
    assert np.abs(stored - stored[0]).max() < 1e-6 * stored[0]


def test_driven_damped_arm_balances() -> None:
    parts: dict[str, Block] = {
        "source": Pulse(height="0.1 N.m", width=0.1, period=0.3, count=3),
        "torque": Torque(),
        "link": AssumedModesLink(**SHAPE, modes=4, damping_ratio=0.02, nonlinear=True, foreshortening=True),
    }
    result = run(parts, "source.out torque.torque", "torque.shaft link.hub", stop=2.0, internal_step=5e-5)
    assert balance(result) < 1e-8
    assert result["energy.dissipated"][-1] > 1e-3 * result["energy.supplied"][-1]


def test_stiff_link_is_the_rigid_one() -> None:
    stiff = hinged(AssumedModesLink(length=0.4, mass=0.2, flexural_rigidity=1e3, payload=0.1, hub_inertia=1e-3))
    rigid = hinged(RigidLink(length=0.4, mass=0.2, payload=0.1, hub_inertia=1e-3))
    gain, expected = (complex(found.gain(1.0)[0, 0]) for found in (stiff, rigid))
    assert gain == pytest.approx(expected, rel=1e-4)
    assert 1 / -expected.real == pytest.approx(1e-3 + 0.2 * 0.16 / 3 + 0.1 * 0.16, rel=1e-12)


def test_static_bend_under_constant_acceleration() -> None:
    """A heavy hub speeding up at g: root moment m L^2 g / 3 = EI curvature, tip -11 m L^4 g / (120 EI)."""
    length, mass, rigidity, hub, rate = 0.4, 0.1, 0.5, 1e3, 2.0
    parts: dict[str, Block] = {
        "source": Step(height=hub * rate),
        "torque": Torque(),
        "link": AssumedModesLink(
            length=length, mass=mass, flexural_rigidity=rigidity, modes=8, damping_ratio=0.7, hub_inertia=hub
        ),
    }
    result = run(parts, "source.out torque.torque", "torque.shaft link.hub", stop=2.0)
    tip = -11 * mass * length**3 * rate * length / (120 * rigidity)
    assert result["link.tip.deflection"][-1] == pytest.approx(tip, rel=1e-4)
    slope = -mass * length**3 * rate / (8 * rigidity)
    assert result["link.tip.angle"][-1] - result["link.hub.angle"][-1] == pytest.approx(slope, rel=2e-3)
    curvature = -mass * length**2 * rate / (3 * rigidity)
    assert result["link.root.curvature"][-1] == pytest.approx(curvature, rel=0.1)
    assert result["link.tip.acceleration"][-1] == pytest.approx(rate * length, rel=1e-4)
    path = result["link.hub.angle"][-1] * length + result["link.tip.deflection"][-1]
    assert result["link.tip.position"][-1] == pytest.approx(path, rel=1e-12)


def test_every_mode_can_be_seen() -> None:
    made = model({"link": AssumedModesLink(**SET_A, modes=3), "load": Inertia(inertia=1)}, "link.hub load.shaft")
    names = [variable.name for variable in made.outputs]
    assert [name for name in names if name.endswith("amplitude")] == [f"link.mode{i}.amplitude" for i in (1, 2, 3)]
    assert [state.name for state in made.states if "mode" in state.name][:3] == [
        f"link.mode{i}.position" for i in (1, 2, 3)
    ]
