"""The lumped arm: joint rule, matrices from energy, tuned joints, reconstruction, locked poles and collocated zeros."""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy import linalg

from blocks.actuators.effort import Torque
from blocks.links.assumed_modes import AssumedModesLink
from blocks.links.fictitious_joints import element_lengths, mass_matrix, natural_stiffness
from blocks.links.fixed import Fixed
from blocks.links.joint_tuning import tune_joint_stiffness
from blocks.links.lumped_mass import LumpedMassLink
from blocks.links.rigid_link import RigidLink
from blocks.sensors.encoder import Encoder
from blocks.sensors.strain_reconstruction import StrainReconstruction
from blocks.sources.pulse import Pulse
from blocks.sources.sine import Sine
from engine.block import Block
from engine.errors import ConnectionProblem, ParameterError
from engine.linearise import LinearModel
from tests.blocks.assembly import linear, model, run
from tests.blocks.test_drive_train import balance

ZEROS = [12.1, 76.19, 247.89]
STIFFNESS = [38.153, 29.026, 4.004]
DAMPING = [1.246e-4, 1.258e-2, 1.002e-5]
UNIT = {"length": 1.0, "mass": 1.0, "joint_stiffness": STIFFNESS}
"""[One-link n.d., Table 2], fitted independently, in units of m L^2."""


def lengths_by_the_rule(joints: int) -> list[Fraction]:
    """[One-link n.d., sec. 3.2]: a joint in the middle of every rigid element of the arm with one joint less."""
    places: list[Fraction] = []
    for _ in range(joints):
        edges = [Fraction(0), *places, Fraction(1)]
        places = [(a + b) / 2 for a, b in itertools.pairwise(edges)]
    edges = [Fraction(0), *places, Fraction(1)]
    return [b - a for a, b in itertools.pairwise(edges)]


def matrices(values: dict[str, Any]) -> tuple[Any, Any, Any]:
    """M, C, K by the sums of [One-link n.d., eq. 3], one element and one joint at a time."""
    n = len(values["joint_stiffness"])
    lengths = np.array([float(part) for part in lengths_by_the_rule(n)]) * values["length"]
    M, C, K = (np.zeros((n + 1, n + 1)) for _ in range(3))
    for i, own in enumerate(lengths):
        phi = np.array([lengths[j] if j < i else own / 2 if j == i else 0.0 for j in range(n + 1)])
        M += values["mass"] * own / values["length"] * np.outer(phi, phi)
    M += values.get("payload", 0.0) * np.outer(lengths, lengths)
    M[0, 0] += values.get("hub_inertia", 0.0)
    for i in range(1, n + 1):
        g = np.zeros(n + 1)
        g[i], g[i - 1] = 1, -1
        K += values["joint_stiffness"][i - 1] * np.outer(g, g)
        C += values.get("joint_damping", [0.0] * n)[i - 1] * np.outer(g, g)
    C[0, 0] += values.get("hub_damping", 0.0)
    return M, C, K


def first_order(M: Any, C: Any, K: Any) -> Any:
    n = len(M)
    return np.vstack([np.eye(n, 2 * n, n), -np.linalg.solve(M, np.hstack([K, C]))])


def hinged(link: Block, **rest: Any) -> LinearModel:
    parts: dict[str, Block] = {"torque": Torque(), "link": link}
    return linear(parts, "torque.shaft link.hub", inputs=["torque.torque"], outputs=["link.hub.angle"], **rest)


@pytest.mark.parametrize(
    ("joints", "printed"),
    [(1, [1 / 2] * 2), (2, [1 / 4, 1 / 2, 1 / 4]), (3, [1 / 8, 3 / 8, 3 / 8, 1 / 8])],
)
def test_element_lengths_as_printed(joints: int, printed: list[float]) -> None:
    assert list(element_lengths(joints)) == printed


@pytest.mark.parametrize("joints", range(1, 17))
def test_element_lengths_by_the_rule(joints: int) -> None:
    found = element_lengths(joints)
    assert list(found) == [float(part) for part in lengths_by_the_rule(joints)]
    assert sum(found) == 1


def test_mass_matrix_as_printed() -> None:
    """Computed independently, Ih = 0.09928 m L^2 included; 0.42350 m L^2 when all turn together."""
    printed = [
        [0.11344, 0.032227, 0.014648, 0.000977],
        [0.032227, 0.083496, 0.043945, 0.00293],
        [0.014648, 0.043945, 0.030762, 0.00293],
        [0.000977, 0.00293, 0.00293, 0.000488],
    ]
    found = mass_matrix(3) + 0.09928 * np.eye(4, 4)[:, :1] @ np.eye(1, 4)
    np.testing.assert_allclose(found, printed, rtol=0, atol=1e-5)
    assert found.sum() == pytest.approx(0.42350, abs=1e-5)


@pytest.mark.parametrize("joints", [1, 2, 3, 5])
def test_matrices_of_the_block(joints: int) -> None:
    """Kinetic and strain energy of random states, and the linear model, against the sums written out."""
    random = np.random.default_rng(joints)
    values: dict[str, Any] = {
        "length": 0.7,
        "mass": 0.4,
        "joint_stiffness": random.uniform(1, 9, joints).tolist(),
        "joint_damping": random.uniform(0, 0.02, joints).tolist(),
        "payload": 0.15,
        "hub_inertia": 0.02,
        "hub_damping": 0.03,
    }
    M, C, K = matrices(values)
    link = LumpedMassLink(joints=joints, **values)
    q, v = random.normal(size=(2, joints + 1))
    names = ["link.hub", *(f"link.element{i}" for i in range(1, joints + 1))]
    start = {f"{name}.angle": float(x) for name, x in zip(names, q, strict=True)}
    start |= {f"{name}.speed": float(x) for name, x in zip(names, v, strict=True)}
    result = run({"link": link}, stop=0.001, initial=start)
    assert result["energy.stored"][0] == pytest.approx(v @ M @ v / 2 + q @ K @ q / 2, rel=1e-12)
    lengths = 0.7 * np.array(element_lengths(joints))
    assert result["link.tip.position"][0] == pytest.approx(lengths @ q, rel=1e-12)
    assert result["link.tip.deflection"][0] == pytest.approx(lengths @ (q - q[0]), rel=1e-12)
    bending = np.linalg.solve(M, -K @ q - C @ v)
    assert result["link.tip.acceleration"][0] == pytest.approx(lengths @ bending, rel=1e-9)
    for i in range(1, joints + 1):
        assert result[f"link.strain{i}"][0] == pytest.approx(q[i] - q[i - 1], rel=1e-12)
        assert result[f"link.element{i}.direction"][0] == pytest.approx(q[i], rel=1e-12)
    found = hinged(link)
    np.testing.assert_allclose(found.A, first_order(M, C, K), rtol=0, atol=1e-9 * np.abs(found.A).max())
    np.testing.assert_allclose(found.B[joints + 1 :, 0], np.linalg.inv(M)[:, 0], rtol=1e-9)


def test_stiff_joints_make_a_rigid_arm_of_point_masses() -> None:
    """Two masses at L / 4 and 3 L / 4: 5/16 m L^2 against the uniform arm's 1/3, and its payload."""
    stiff = hinged(LumpedMassLink(joints=1, length=0.5, mass=0.3, joint_stiffness=1e5, payload=0.1, hub_inertia=0.01))
    inertia = 0.01 + 5 / 16 * 0.3 * 0.25 + 0.1 * 0.25
    assert 1 / -complex(stiff.gain(1.0)[0, 0]).real == pytest.approx(inertia, rel=1e-5)
    uniform = hinged(RigidLink(length=0.5, mass=0.3, payload=0.1, hub_inertia=0.01))
    assert 1 / -complex(uniform.gain(1.0)[0, 0]).real == pytest.approx(inertia + 0.3 * 0.25 / 48, rel=1e-5)


# -- locked poles and collocated zeros --------------------------------------------------------------------------------

LINKS: list[Block] = [
    LumpedMassLink(**UNIT, joint_damping=DAMPING, hub_inertia=0.09928, hub_damping=0.74192),
    LumpedMassLink(
        joints=2, length=0.6, mass=0.2, joint_stiffness=[5, 2], joint_damping=0.01, payload=0.1, hub_inertia=1e-3
    ),
    AssumedModesLink(
        length=0.33,
        mass=0.06,
        flexural_rigidity=0.4,
        hub_inertia=2e-5,
        modes=3,
        damping_ratio=[0.03, 0.01, 0.2],
        payload=0.02,
    ),
]


@pytest.mark.parametrize("link", LINKS, ids=["lumped 3", "lumped 2", "assumed modes"])
def test_collocated_zeros_are_the_locked_poles(link: Block) -> None:
    """With damping, to 1e-9."""
    locked = linear({"link": link, "wall": Fixed()}, "link.hub wall.shaft").poles()
    zeros = hinged(link).zeros()
    assert (np.abs(zeros.real) > 0).all()
    for pole in locked:
        assert np.abs(zeros - pole).min() <= 1e-9 * abs(pole)
    assert len(zeros) == len(locked)


def test_zeros_against_matrices_and_closed_forms() -> None:
    """The same without the engine: deleted row and column; and -xi w +- i w sqrt(1 - xi^2) of the clamped beam."""
    M, C, K = matrices({**UNIT, "joint_damping": DAMPING, "hub_inertia": 0.09928, "hub_damping": 0.74192})
    clamped = np.linalg.eigvals(first_order(M[1:, 1:], C[1:, 1:], K[1:, 1:]))
    zeros = hinged(LINKS[0]).zeros()
    for zero in zeros:
        assert np.abs(clamped - zero).min() <= 1e-9 * abs(zero)
    ratios = np.array([0.03, 0.01, 0.2])
    beam = AssumedModesLink(
        length=0.33, mass=0.06, flexural_rigidity=0.4, hub_inertia=2e-5, modes=3, damping_ratio=ratios.tolist()
    )
    w = np.square([1.8751040687119611, 4.694091132974175, 7.854757438237613]) * np.sqrt(0.4 / (0.06 * 0.33**3))
    expected = w * (-ratios + 1j * np.sqrt(1 - ratios**2))
    found = hinged(beam).zeros()
    np.testing.assert_allclose(np.sort_complex(found[found.imag > 0]), np.sort_complex(expected), rtol=1e-9)


# -- tuning ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("joints", "expected", "alpha"),
    [(1, [4.5753], [0.3863]), (2, [20.716, 5.0084], [1.7492, 0.42289]), (3, [38.153, 29.026, 4.004], None)],
)
def test_tuned_joints_as_printed(joints: int, expected: list[float], alpha: list[float] | None) -> None:
    """Fitted independently, 0.1 %; for n = 3 the printed set is that of the fit to all of Table 2, 0.12 % away."""
    found = tune_joint_stiffness(ZEROS[:joints], length=1.0, mass=1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-3 if joints < 3 else 1.2e-3)
    if alpha is not None:
        rigidity = (12.1 / 3.51602) ** 2
        np.testing.assert_allclose(np.array(found) / rigidity, alpha, rtol=1e-3)


def test_tuning_returns_the_set_a_model_was_made_of() -> None:
    """The frequencies of the printed joints give the printed joints back."""
    M, _, K = matrices(UNIT)
    frequencies = np.sqrt(linalg.eigvalsh(K[1:, 1:], M[1:, 1:]))
    found = tune_joint_stiffness(frequencies.tolist(), length=1.0, mass=1.0)
    np.testing.assert_allclose(found, STIFFNESS, rtol=1e-9)


@pytest.mark.parametrize(("joints", "poles"), [(1, [21.36]), (2, [22.60, 81.57])])
def test_poles_with_fewer_joints(joints: int, poles: list[float]) -> None:
    """Fitted independently: Ih = 0.1016 m L^2."""
    stiffness = tune_joint_stiffness(ZEROS[:joints], length=1.0, mass=1.0)
    link = LumpedMassLink(joints=joints, length=1, mass=1, joint_stiffness=list(stiffness), hub_inertia=0.1016)
    found = hinged(link).poles()
    np.testing.assert_allclose(np.sort(found.imag[found.imag > 1]), poles, rtol=1e-3)
    zeros = hinged(link).zeros()
    np.testing.assert_allclose(np.sort(zeros.imag[zeros.imag > 0]), ZEROS[:joints], rtol=1e-9)


def test_three_joints_and_only_the_hub_fitted() -> None:
    """Fitted independently: springs from the zeros, Ih = 0.1016 m L^2, and the pole moduli are there to 0.07 %."""
    undamped = [abs(0.0057 + 12.1j), abs(0.658 + 76.19j), abs(4.169 + 247.89j)]
    stiffness = tune_joint_stiffness(undamped, length=1.0, mass=1.0)
    found = hinged(LumpedMassLink(length=1, mass=1, joint_stiffness=list(stiffness), hub_inertia=0.1016)).poles()
    table = [abs(2.55 + 23.6j), abs(0.87 + 78.724j), abs(4.352 + 249.99j)]
    np.testing.assert_allclose(np.sort(found.imag[found.imag > 1]), table, rtol=7e-4)


def test_the_plain_compliance_rule() -> None:
    """Computed independently: alpha 3.2, 2.667, 3.2 and zeros 12.19, 92.4, 648.5 with EI / (m L^3) = 11.844."""
    alpha = natural_stiffness(3)
    np.testing.assert_allclose(alpha, [3.2, 8 / 3, 3.2], rtol=1e-12)
    link = LumpedMassLink(length=1, mass=1, joint_stiffness=(11.844 * alpha).tolist())
    locked = linear({"link": link, "wall": Fixed()}, "link.hub wall.shaft").poles()
    np.testing.assert_allclose(np.sort(locked.imag[locked.imag > 0]), [12.19, 92.4, 648.5], rtol=1e-3)


@pytest.mark.parametrize("joints", [1, 2, 3, 4, 6])
def test_tuned_joints_give_the_frequencies(joints: int) -> None:
    """With a payload, for arms near the natural one; up to three joints the very springs they were made of."""
    random = np.random.default_rng(joints)
    values = {"length": 0.6, "mass": 0.25, "payload": 0.08}
    natural = 30.0 * natural_stiffness(joints)
    changed = (natural * random.uniform(0.85, 1.18, joints)).tolist()
    M, _, K = matrices({**values, "joint_stiffness": changed})
    frequencies = np.sqrt(linalg.eigvalsh(K[1:, 1:], M[1:, 1:]))
    stiffness = tune_joint_stiffness(frequencies.tolist(), **values)
    if joints <= 3:
        np.testing.assert_allclose(stiffness, changed, rtol=1e-8)
    link = LumpedMassLink(joints=joints, **values, joint_stiffness=list(stiffness))
    locked = linear({"link": link, "wall": Fixed()}, "link.hub wall.shaft").poles()
    np.testing.assert_allclose(np.sort(locked.imag[locked.imag > 0]), frequencies, rtol=1e-9)


BEAM = np.square([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407]) * 12.1 / 1.8751040687**2


def test_a_uniform_beams_third_mode_needs_another_set_of_springs() -> None:
    """Three joints reach a uniform cantilever's three frequencies only with springs far from the natural ones."""
    found = tune_joint_stiffness(BEAM[:3].tolist(), length=1.0, mass=1.0)
    M, _, K = matrices({"length": 1.0, "mass": 1.0, "joint_stiffness": found})
    np.testing.assert_allclose(np.sqrt(linalg.eigvalsh(K[1:, 1:], M[1:, 1:])), BEAM[:3], rtol=1e-9)
    np.testing.assert_allclose(found, [140.96, 6.927, 3.299], rtol=2e-4)


def test_what_cannot_be_tuned_is_refused() -> None:
    with pytest.raises(ParameterError, match="no joint stiffnesses above zero give a lumped arm the frequencies"):
        tune_joint_stiffness(BEAM.tolist(), length=1.0, mass=1.0)
    with pytest.raises(ParameterError, match=r"frequencies \[3.0, 2.0\] do not rise from above zero"):
        tune_joint_stiffness([3.0, 2.0], length=1.0, mass=1.0)
    with pytest.raises(ParameterError, match="mass = 0 must be above zero"):
        tune_joint_stiffness([3.0], length=1.0, mass=0.0)
    with pytest.raises(ParameterError, match="out of range: joint_stiffness must be > 0"):
        LumpedMassLink(length=1, mass=1, joint_stiffness=0)
    with pytest.raises(ParameterError, match=r"joint_stiffness has 2 values\n  give 3, one per joints"):
        LumpedMassLink(length=1, mass=1, joint_stiffness=[1, 2])


# -- sensors and energy ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rounding", "resolution"), [("none", 1e-14), ("round", np.pi / 50_000)])
def test_the_state_is_reconstructed_from_encoder_and_gauges(rounding: str, resolution: float) -> None:
    parts: dict[str, Block] = {
        "push": Sine(amplitude="0.3 N.m", frequency=2),
        "torque": Torque(),
        "link": LumpedMassLink(**UNIT, joint_damping=DAMPING, hub_inertia=0.09928),
        "encoder": Encoder(counts_per_revolution=50_000, rounding=rounding),
        "state": StrainReconstruction(joints=3),
    }
    wires = ["push.out torque.torque", "torque.shaft link.hub encoder.shaft", "encoder.out state.angle"]
    wires += [f"link.strain{i} state.strain{i}" for i in (1, 2, 3)]
    result = run(parts, *wires, stop=1.0)
    for i in (1, 2, 3):
        np.testing.assert_allclose(
            result[f"state.element{i}"], result[f"link.element{i}.direction"], rtol=0, atol=1.001 * resolution
        )
    np.testing.assert_array_equal(result["state.tip"], result["state.element3"])
    with pytest.raises(ConnectionProblem, match=r"'state.strain3' is not connected \(bend of joint 3, e_3\)"):
        model(parts, *wires[:-1])


def test_driven_damped_arm_balances_and_an_undamped_one_keeps_its_energy() -> None:
    parts: dict[str, Block] = {
        "push": Pulse(height="0.5 N.m", width=0.05, period=0.4, count=3),
        "torque": Torque(),
        "link": LumpedMassLink(**UNIT, joint_damping=DAMPING, hub_inertia=0.09928, hub_damping=0.74),
    }
    result = run(parts, "push.out torque.torque", "torque.shaft link.hub", stop=2.0, internal_step=2e-4)
    assert balance(result) < 1e-8
    assert result["energy.dissipated"][-1] > 0.1 * result["energy.supplied"][-1]
    alone: dict[str, Block] = {"link": LumpedMassLink(**UNIT, hub_inertia=0.1)}
    stored = run(alone, stop=5.0, internal_step=5e-5, initial={"link.element1.angle": 0.1})["energy.stored"]
    assert np.abs(stored - stored[0]).max() < 1e-7 * stored[0]
