"""Families from evidence: a rig whose truth is known, and the parts of the bound in closed form."""

from __future__ import annotations

from pathlib import Path

import control
import numpy as np
import pytest

from engine.errors import FlexarmError
from flexarm.api import uncertain
from flexarm.design.margins import margins_of
from flexarm.design.uncertainty.calibration import calibrated
from flexarm.design.uncertainty.files import write
from flexarm.design.uncertainty.results import Weight
from flexarm.design.uncertainty.spectra import Piece

RIG = """\
schema: 1
name: rig
blocks:
  source: {type: Step, height: 1 N.m}
  motor: {type: Torque}
  hub: {type: Inertia, inertia: 0.012 kg.m2}
  joint: {type: SpringDamper, stiffness: 9 N.m/rad, damping: 0.012 N.m.s/rad}
  arm: {type: Inertia, inertia: 0.02 kg.m2}
  bearing: {type: BearingFriction, viscous_friction: 0.05 N.m.s/rad}
connect:
  - [source.out, motor.torque]
  - [motor.shaft, hub.shaft, joint.a, bearing.shaft]
  - [joint.b, arm.shaft]
tolerances:
  {hub.inertia: 0.3, joint.stiffness: 0.3, joint.damping: 0.5, arm.inertia: 0.3, bearing.viscous_friction: 0.3}
simulate: {stop: 4 s, step: 5 ms, record: [hub.shaft.speed]}
analyses:
  plant: {kind: linearise, inputs: [motor.torque], outputs: [hub.shaft.speed]}
recordings:
  one: &one
    file: one.csv
    time: {column: t}
    drive: {motor.torque: {column: u, unit: N.m}}
    measurements: {hub.shaft.speed: {column: y, unit: rad/s}}
  two: {<<: *one, file: two.csv, role: hold_out}
"""
TRUTH = ["hub.inertia=0.01", "joint.stiffness=10", "joint.damping=0.01", "bearing.viscous_friction=0.06"]


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from engine.simulate import Drive, simulate
    from scenarios.load import load

    folder = tmp_path_factory.mktemp("rig")
    path = folder / "rig.yaml"
    path.write_text(RIG)
    model = load(path, TRUTH).build(["motor.torque"], ["hub.shaft.speed"])
    random = np.random.default_rng(5)
    time = np.arange(0, 6.0, 5e-3)
    for name in ("one", "two"):
        u = np.repeat(random.choice([-0.2, 0.2], len(time) // 20 + 1), 20)[: len(time)]
        run = simulate(model, time[-1], 5e-3, drive=Drive(time, u))
        y = run.values[: len(time), 0] + random.normal(0, 0.02, len(time))
        rows = np.column_stack([time, u, y])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="t,u,y", comments="", fmt="%.9g")
    return path


def test_a_rig_whose_truth_is_known(rig: Path) -> None:
    """The truth is among the draws, the held-out response within its bound, and a controller for all is one for it."""
    found = uncertain(rig, samples=30, workers=1)
    assert len(found.family) == 31
    assert found.family.axes[0].name == "sample"
    assert 0.9 <= found.coverage <= 0.99
    assert np.all([band.coverage_excited > 0.85 for band in found.bands])
    # Over the resonances the gains of the draws enclose that of the truth.
    from flexarm.api import linearise
    from scenarios.load import load

    truth = linearise(load(rig, TRUTH))
    gains = np.array([[abs(m.gain(w)[0, 0]) for w in (2.0, 10.0, 60.0)] for m in found.family])
    real = np.array([abs(truth.gain(w)[0, 0]) for w in (2.0, 10.0, 60.0)])
    spread = np.maximum(gains.std(axis=0), 0.002 * real)
    assert (np.abs(gains.mean(axis=0) - real) < 4 * spread).all()
    _, systems, _ = found.to_control()
    lag = control.tf2ss(control.tf([1], [1 / 200, 1]))
    size = 3.0
    while not all(margins_of(size * lag * system).disk > 0.4 for system in [*systems]):
        size *= 0.7
    loop = size * lag * control.ss(truth.A, truth.B, truth.C, truth.D)
    assert margins_of(loop).stable
    names = set(found.names)
    assert names == {"hub.inertia", "joint.stiffness", "joint.damping", "arm.inertia", "bearing.viscous_friction"}
    folder = rig.parent
    assert [p.name for p in write(found, folder / "rig.m", "rig")] == ["rig.mat", "rig.m"]
    from scipy.io import loadmat

    held = loadmat(folder / "rig.mat")
    assert held["A"].shape == (4, 4, 31)
    assert held["parameter_samples"].shape == (31, 5)
    assert "ultidyn" in (folder / "rig.m").read_text()


def test_the_same_seed_gives_the_same_family(rig: Path) -> None:
    one, other = (uncertain(rig, samples=3, seed=4, workers=1).samples for _ in range(2))
    assert one == other


def test_a_weight_is_its_zeros_and_poles() -> None:
    weight = Weight("y", (3.0, 20.0), (50.0, 400.0), 0.1)
    system = weight.to_control()
    for w in (0.1, 3.0, 70.0, 1e3):
        by_hand = 0.1 * np.hypot(1, w / 3) * np.hypot(1, w / 20) / np.hypot(1, w / 50) / np.hypot(1, w / 400)
        assert weight(w) == pytest.approx(by_hand, rel=1e-12)
        assert abs(complex(system(1j * w))) == pytest.approx(by_hand, rel=1e-6)


def test_complex_normal_residuals_are_held_in_95_of_100_bins() -> None:
    """Residuals drawn as a known weight times the response, and a floor: another draw lies within the bound."""
    omega = np.linspace(0.5, 300, 1500)
    predicted = 1 / np.hypot(1 - (omega / 30) ** 2, 0.1 * omega / 30)
    random = np.random.default_rng(0)

    def piece(name: str) -> Piece:
        deviation = np.hypot(0.2 * np.hypot(1, omega / 20) / np.hypot(1, omega / 100) * predicted, 1e-3)
        left = deviation * np.sqrt(random.exponential(1.0, len(omega)))
        return Piece(name, "y", "rad", (0, 1), omega, predicted, predicted, left, np.zeros(len(omega)))

    fitted = calibrated([piece("a"), piece("b")])
    other = piece("c")
    share = float(np.mean(other.left <= fitted.bound(other)))
    assert 0.93 <= share <= 0.985


def test_bad_input(rig: Path) -> None:
    with pytest.raises(FlexarmError, match="0 samples are no family"):
        uncertain(rig, samples=0, workers=1)
    with pytest.raises(FlexarmError, match="no recording"):
        uncertain("lumped-arm")


def test_what_does_not_go_with_the_response_is_covered_where_it_dies_out() -> None:
    """A disturbance of its own spectrum: calibrated on a large response, the bound holds at a thousandth of it."""
    omega = np.linspace(0.5, 300, 1500)
    predicted = 1 / np.hypot(1 - (omega / 30) ** 2, 0.1 * omega / 30)
    random = np.random.default_rng(3)

    def piece(name: str, size: float) -> Piece:
        left = np.hypot(0.05 / np.hypot(1, omega / 40) ** 2, 1e-4) * np.sqrt(random.exponential(1.0, len(omega)))
        return Piece(name, "y", "rad", (0, 1), omega, size * predicted, size * predicted, left, np.zeros(len(omega)))

    other = piece("c", 1e-3)
    share = float(np.mean(other.left <= calibrated([piece("a", 1.0), piece("b", 1.0)]).bound(other)))
    assert 0.92 <= share <= 0.985
