"""Margins and reductions against closed forms and python-control."""

from __future__ import annotations

import math
from pathlib import Path

import control
import numpy as np
import pytest

from engine.errors import FlexarmError, ParameterError
from engine.linearise import LinearModel
from flexarm.design.margins import margins, margins_of, without_drift
from flexarm.design.reduction import reduce


def linear(system: control.StateSpace) -> LinearModel:
    n, r, m = system.nstates, system.ninputs, system.noutputs
    x, u, y = (tuple(f"{k}{i}" for i in range(size)) for k, size in (("x", n), ("u", r), ("y", m)))
    return LinearModel(system.A, system.B, system.C, system.D, x, u, y, {}, {}, {}, 0.0)


def test_an_integrator() -> None:
    """1/s: 90 degrees, a delay of pi/2, S = s/(s + 1), and the largest disk margin there is."""
    found = margins_of(control.tf2ss([1], [1, 0]))
    assert found.stable
    assert found.gain == (0.0, math.inf)
    assert found.phase == pytest.approx(90.0, abs=1e-3)
    assert found.delay == pytest.approx(math.pi / 2, rel=1e-4)
    assert found.crossover == pytest.approx(1.0, rel=1e-4)
    assert found.disk == pytest.approx(2.0, rel=1e-3)
    assert found.sensitivity == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("k", [0.5, 1.0, 3.0])
def test_a_third_order_loop(k: float) -> None:
    """k / (s (s + 1)^2) meets -1 at w = 1 with the gain 2 / k."""
    found = margins_of(control.tf2ss([k], [1, 2, 1, 0]))
    assert found.stable == (k < 2)
    assert found.gain[0 if k > 2 else 1] == pytest.approx(2 / k, rel=1e-4)
    w = max(np.roots([1, 0, 2, 0, 1, 0, -(k**2)]).real)
    assert found.crossover == pytest.approx(w, rel=1e-4)
    phase = abs(90 - 2 * math.degrees(math.atan(w)))
    assert found.phase == pytest.approx(phase, abs=0.01)
    gm, pm, *_ = control.stability_margins(control.tf([k], [1, 2, 1, 0]))
    assert found.gain[0 if k > 2 else 1] == pytest.approx(gm, rel=1e-4)
    assert found.phase == pytest.approx(abs(pm), abs=0.01)


@pytest.mark.parametrize(
    ("loop", "gain"),
    [
        (control.tf([1, 3], [1, 0, -1]), (1 / 3, math.inf)),  # upright: -3 at rest
        (control.tf([0.5], [1, -0.9], 0.01), (0.0, 3.8)),  # 0.9 - 0.5 k is -1
        (control.tf([1.5], [1, -1.2], 0.01), (0.2 / 1.5, 2.2 / 1.5)),
        (control.tf([0.1], [1, -1], 0.01), (0.0, 20.0)),
        (control.tf([1, -0.4], [2, 1]), (0.0, 2.5)),  # 1 - 0.4 k, and 2 + k stays above 0
        (control.tf([1, 0], [1, 3, 2]), (0.0, math.inf)),
        (control.tf([1], [1, 2, 0]), (0.0, math.inf)),
    ],
)
def test_loops_that_meet_minus_one_at_an_end(loop: control.TransferFunction, gain: tuple[float, float]) -> None:
    """At rest, at half the rate of samples: the Nyquist curve ends on the axis there and crosses nothing."""
    found = margins_of(control.ss(loop))
    assert found.stable
    assert found.gain == pytest.approx(gain, rel=1e-6)
    for k, there in zip(gain, (0.999, 1.001), strict=True):
        if 0 < k < math.inf:  # beyond the margin it is unstable
            assert not margins_of(control.ss(there * k * loop)).stable


UPRIGHT = """\
schema: 1
name: upright
blocks:
  up: {type: Constant, value: 180 deg}
  pid: {type: PID, proportional_gain: 20 V/rad, derivative_gain: 2 V.s/rad, derivative_corner: 1000 rad/s, unit: V}
  motor: {type: DCMotor, resistance: 1 ohm, torque_constant: 0.1 N.m/A, rotor_inertia: 1e-3 kg.m2}
  weight: {type: GravityTorque, mass: 0.5 kg, radius: 0.2 m, gravity: 9.81 m/s2}
connect:
  - [up.out, pid.reference]
  - [motor.shaft.angle, pid.measurement]
  - [pid.out, motor.voltage]
  - [motor.shaft, weight.shaft]
initial: {motor.shaft.angle: 180 deg}
simulate: {stop: 1 s}
"""


def test_the_gain_that_holds_a_pendulum_upright(tmp_path: Path) -> None:
    """20 V/rad make 2 N.m/rad, against the 0.981 N.m/rad of the weight: with half of it the pendulum falls."""
    path = tmp_path / "upright.yaml"
    path.write_text(UPRIGHT)
    found = margins(path, loop="motor.voltage").members[0]
    assert found.stable
    assert found.gain == pytest.approx((0.5 * 9.81 * 0.2 / 2, math.inf), rel=1e-3)


@pytest.mark.parametrize("period", [0.0, 0.01])
def test_what_drifts_unseen_is_no_part_of_the_loop(period: float) -> None:
    """Two wheels on a spring, torque to speed: the common angle drifts; margins are those of the transfer function."""
    J1, J2, k, d, b = 0.01, 0.02, 10.0, 0.02, 0.05
    A = [[0, 0, 1, 0], [0, 0, 0, 1], [-k / J1, k / J1, -(d + b) / J1, d / J1], [k / J2, -k / J2, d / J2, -d / J2]]
    wheels = control.ss(A, [[0], [0], [1 / J1], [0]], [[0, 0, 1, 0]], 0)
    spring = np.array([J2, d, k])
    plain = control.tf2ss(spring, np.polyadd(np.polymul([J1, d + b, k], spring), -np.polymul([d, k], [d, k]))[:-1])
    assert plain.nstates == 3
    if period:
        wheels, plain = control.sample_system(wheels, period), control.sample_system(plain, period)
    found, expected = margins_of(0.2 * wheels), margins_of(0.2 * plain)
    assert found.stable
    assert found.phase == pytest.approx(expected.phase, rel=1e-6)
    assert found.disk == pytest.approx(expected.disk, rel=1e-3)
    assert without_drift(wheels).nstates == 3


def test_a_hidden_mode_that_grows_is_not_stable() -> None:
    """exp(t) on a state that the output does not show, and one that the input does not reach."""
    for B, C in (([[1], [1]], [[1, 0]]), ([[1], [0]], [[1, 1]])):
        assert not margins_of(control.ss([[-1, 0], [0, 1]], B, C, 0)).stable
        assert margins_of(control.ss([[-1, 0], [0, 0]], B, C, 0)).stable


def test_the_loop_of_a_scenario() -> None:
    """EMPS: force 35.15 (243.45 (160.18 (r - x) - v)) on a mass with viscous friction, opened at the force."""
    found = margins("emps", loop="motor.force")
    assert found.returns == "controller.out"
    (only,) = found.members
    M, B, kp, kv = 95.1089, 203.5034, 1370728.455, 8557.42574
    expected = margins_of(control.tf2ss([kv, kp], [M, B, 0]))
    assert only.phase == pytest.approx(expected.phase, rel=1e-3)
    assert only.disk == pytest.approx(expected.disk, rel=1e-3)
    assert only.stable
    late = margins("emps", loop="motor.force", delay=only.delay * 1.01).members[0]
    early = margins("emps", loop="motor.force", delay=only.delay * 0.99).members[0]
    assert (late.stable, early.stable) == (False, True)
    over = margins("emps", loop="motor.force", grid={"carriage.mass": "50 kg:150 kg:3"})
    assert len(over.members) == 3
    assert over.members[over.worst].disk == min(m.disk for m in over.members)


@pytest.mark.parametrize("delay", [1e-9, 1e-6, 1e-3])
def test_a_short_delay_in_a_slow_loop(delay: float) -> None:
    """The poles that stand for a delay of 1 ns hid those of the loop: it had no crossover and all the phase margin."""
    loop = control.tf2ss([0.01], [1, 1, 0])
    bare, found = margins_of(loop), margins_of(loop, delay)
    assert found.stable
    assert found.crossover == pytest.approx(bare.crossover, rel=1e-4)
    assert found.phase == pytest.approx(bare.phase, abs=0.01)
    assert found.delay == pytest.approx(bare.delay, rel=1e-4)
    assert found.disk == pytest.approx(bare.disk, rel=1e-2)
    assert found.gain[1] == pytest.approx(100 / delay, rel=1e-2)
    slow = margins("emps", loop="motor.force", delay=delay).members[0]
    assert slow.crossover == pytest.approx(margins("emps", loop="motor.force").members[0].crossover, rel=1e-3)


def test_no_loop() -> None:
    with pytest.raises(FlexarmError, match="nothing says where to open the loop"):
        margins("srv02-bare")
    with pytest.raises(FlexarmError, match=r"'motor.volts' is not an input"):
        margins("srv02-bare", loop="motor.volts")
    with pytest.raises(FlexarmError, match="no loop is closed there"):
        margins("srv02-bare", loop="motor.voltage")
    with pytest.raises(FlexarmError, match="one input and one output"):
        margins_of(control.ss(-np.eye(2), np.eye(2), np.eye(2), 0))


def modes_in_series() -> control.StateSpace:
    """An integrator with five lightly damped modes beside it."""
    made = control.tf2ss([1], [1, 0])
    for k, w in enumerate((3.0, 11.0, 40.0, 130.0, 400.0)):
        made = control.parallel(made, control.tf2ss([1.0 / (k + 1)], [1, 0.04 * w, w**2]))
    return made


@pytest.mark.parametrize("order", [3, 5, 7, 11])
@pytest.mark.parametrize("method", ["balanced", "modal"])
def test_the_error_keeps_its_bound(order: int, method: str) -> None:
    whole = linear(modes_in_series())
    found = reduce(whole, order, method=method)
    assert found.kept == 1
    assert len(found.model.states) == order
    omega = np.unique(np.concatenate([np.geomspace(0.01, 4000, 800), [3.0, 11.0, 40.0, 130.0, 400.0]]))
    error = max(abs(whole.gain(w) - found.model.gain(w)).max() for w in omega)
    assert error <= found.bound * (1 + 1e-6) + 1e-12
    if order == 11:
        assert found.bound < 1e-12


def test_a_bound_gives_the_order() -> None:
    whole = linear(modes_in_series())
    tight = reduce(whole, bound=1e-3)
    assert tight.bound <= 1e-3
    assert reduce(whole, len(tight.model.states) - 1).bound > 1e-3


def test_a_first_order_pair_in_closed_form() -> None:
    """1/(s+1) + 1/(s+1): one Hankel singular value of 1, the other 0."""
    found = reduce(linear(control.ss(-np.eye(2), np.ones((2, 1)), np.ones((1, 2)), 0)), 1)
    np.testing.assert_allclose(found.hankel, [1.0, 0.0], atol=1e-7)
    assert found.bound == pytest.approx(0.0, abs=1e-7)
    assert found.model.gain(0.0)[0, 0] == pytest.approx(2.0)


def test_slicot_agrees() -> None:
    """Balanced truncation by SLICOT's ab09ad."""
    pytest.importorskip("slycot")
    stable = control.ss(modes_in_series())
    stable = control.series(control.tf2ss([1, 0], [1, 5]), stable)
    ours = reduce(linear(control.minreal(stable, tol=1e-9, verbose=False)), 6)
    theirs = control.balanced_reduction(control.minreal(stable, tol=1e-9, verbose=False), 6, method="truncate")
    for w in (0.1, 3.0, 20.0, 100.0):
        assert ours.model.gain(w)[0, 0] == pytest.approx(complex(theirs(1j * w)), rel=1e-4, abs=1e-7)


def test_orders_that_cannot_be() -> None:
    whole = linear(modes_in_series())
    with pytest.raises(ParameterError, match="the model has 11, of which 1 do not decay"):
        reduce(whole, 0)
    with pytest.raises(ParameterError, match="no method 'krylov'"):
        reduce(whole, 3, method="krylov")
    with pytest.raises(ParameterError, match="either an order or a bound"):
        reduce(whole)
