"""Trajectories of [Gao J. n.d., sec. 3.2]: limits, end states, shortest times, and the block's exact instants."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import linprog

from blocks.controllers.state_space import StateSpace
from blocks.sources.motion_profile import Limits, Profile, State
from blocks.sources.trajectory import Trajectory
from blocks.sources.trajectory_planner import plan
from engine.errors import ParameterError
from tests.blocks.assembly import instants, run

PAPER = Limits(2.4, 4.8, 19.2, 76.8)
SIGNS = [1, -1, -1, 1, -1, 1, 1, -1]


@pytest.mark.parametrize("triangular", [True, False])
def test_the_papers_trajectory(triangular: bool) -> None:
    """D = 2.4 in T = 2.000 s, where all four limits are met together."""
    made = plan(State(), State(2.4), PAPER, triangular=triangular)
    assert made.duration == pytest.approx(2.0, abs=1e-9)
    np.testing.assert_allclose(made.instants, np.arange(9) / 4, atol=1e-9)
    np.testing.assert_allclose(made.snap, 76.8 * np.array(SIGNS, dtype=float), rtol=1e-12)
    np.testing.assert_allclose(made.peaks(), [2.4, 4.8, 19.2, 76.8], rtol=1e-9)
    np.testing.assert_allclose(made.at(2.0 - 1e-12), [2.4, 0, 0, 0, -76.8], atol=1e-9)
    np.testing.assert_allclose(made.at(1.0)[:4], [1.2, 2.4, 0, 0], atol=1e-9)
    np.testing.assert_allclose(made.at([-1.0, 3.0]), np.array([[0, 0, 0, 0, 0], [2.4, 0, 0, 0, 0]]), atol=1e-15)


def test_each_limit_alone_gives_the_same_time() -> None:
    """v = 2 D / T, a = 8 D / T^2, j = 64 D / T^3, s = 512 D / T^4: whichever is exceeded makes the motion longer."""
    for k in range(4):
        for scale, longer in ((0.9, True), (1.5, False)):
            values = [2.4, 4.8, 19.2, 76.8]
            values[k] *= scale
            duration = plan(State(), State(2.4), Limits(*values), triangular=True).duration
            assert (duration > 2.0 + 1e-3) == longer
            assert duration > 2.0 - 1e-9


@pytest.mark.parametrize("distance", [0.37, -5.1])
def test_closed_forms_where_one_limit_binds(distance: float) -> None:
    free, d = 1e12, abs(distance)
    cases = {
        (512 * d / 3.0) ** 0.25: (Limits(free, free, free, 3.0), False),
        (32 * d / 3.0) ** (1 / 3): (Limits(free, free, 3.0, 1e16), False),
        (64 * d / 3.0) ** (1 / 3): (Limits(free, free, 3.0, 1e16), True),
        2 * (d / 3.0) ** 0.5: (Limits(free, 3.0, 1e12, 1e24), False),
        d / 3.0: (Limits(3.0, 1e8, 1e17, 1e27), False),
    }
    for expected, (limits, triangular) in cases.items():
        made = plan(State(), State(distance), limits, triangular=triangular)
        assert made.duration == pytest.approx(expected, rel=1e-4)


def moved(state: np.ndarray, snap: float, duration: float) -> np.ndarray:
    """Position, velocity, acceleration and jerk after a time of constant snap, by polynomials of numpy."""
    rows = [np.array([snap])]
    for value in state[::-1]:
        rows.append(np.polyint(rows[-1], k=value))
    return np.array([np.polyval(row, duration) for row in rows[:0:-1]])


def tolerance(limits: Limits, made: Profile, *states: State) -> np.ndarray:
    """1e-9 of what position, velocity, acceleration and jerk can be, and what the rounding of an instant moves them."""
    bounds = np.array([limits.velocity, limits.acceleration, limits.jerk, limits.snap])
    reach = limits.velocity * made.duration + max(abs(s.position) for s in states)
    return 1e-9 * np.array([reach, *bounds[:3]]) + 1e-15 * made.duration * bounds


def check_motion(start: State, end: State, limits: Limits, triangular: bool) -> Profile:
    made = plan(start, end, limits, triangular=triangular)
    allowed = tolerance(limits, made, start, end)
    target = np.array([end.position, end.velocity, end.acceleration, end.jerk])
    state = np.array([start.position, start.velocity, start.acceleration, start.jerk])
    assert (np.abs(made.states[0] - state) <= 1e-5 * allowed).all()
    for k, (t0, t1) in enumerate(pairwise(made.instants)):
        state = moved(made.states[k], made.snap[k], t1 - t0)
        assert (np.abs(state - made.states[k + 1]) <= allowed).all()
    assert (np.abs(state - target) <= allowed).all()
    bounds = np.array([limits.velocity, limits.acceleration, limits.jerk, limits.snap])
    t = np.unique(np.concatenate([np.linspace(0, made.duration, 2001), made.instants]))
    assert (np.abs(made.at(t)[:, 1:]).max(axis=0) <= bounds * (1 + 1e-9)).all()
    assert (made.peaks() >= np.abs(made.at(t)[:, 1:]).max(axis=0) * (1 - 1e-12)).all()
    assert (np.diff(made.instants) > 0).all()
    return made


positive = st.floats(-2, 2).map(lambda x: 10.0**x)
share = st.floats(-1, 1)
LIMITS = st.builds(Limits, positive, positive, positive, positive)


@given(LIMITS, st.floats(-100, 100), share, share, st.booleans())
def test_any_distance_limits_and_velocities(
    limits: Limits, distance: float, first: float, last: float, triangular: bool
) -> None:
    start, end = State(0.3, first * limits.velocity), State(0.3 + distance, last * limits.velocity)
    check_motion(start, end, limits, triangular)


@given(LIMITS, st.floats(-100, 100), st.lists(share, min_size=6, max_size=6), st.booleans())
def test_any_start_and_end_state(limits: Limits, distance: float, parts: list[float], triangular: bool) -> None:
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    start = State(-1.0, *(0.9 * part * bound for part, bound in zip(parts[:3], bounds, strict=True)))
    end = State(-1.0 + distance, *(0.9 * part * bound for part, bound in zip(parts[3:], bounds, strict=True)))
    try:
        plan(start, end, limits)
    except ParameterError as error:
        assume("cannot be met" not in error.message)
    check_motion(start, end, limits, triangular)


@given(st.builds(Limits, *[st.floats(0.5, 2.0)] * 4), st.floats(-3, 3), share, share, st.booleans())
def test_snap_alone_leads_to_the_end(
    limits: Limits, distance: float, first: float, last: float, triangular: bool
) -> None:
    """From the start's state, with nothing but the snap and the instants."""
    start, end = State(0.3, first * limits.velocity), State(0.3 + distance, last * limits.velocity)
    made = plan(start, end, limits, triangular=triangular)
    state = np.array([start.position, start.velocity, 0.0, 0.0])
    for (t0, t1), snap in zip(pairwise(made.instants), made.snap, strict=True):
        state = moved(state, snap, t1 - t0)
    np.testing.assert_allclose(state, [end.position, end.velocity, 0, 0], atol=1e-9)


def change_time(change: float, limits: Limits, triangular: bool) -> float:
    """Shortest symmetric change of velocity, by search over its peak acceleration."""
    if change == 0:
        return 0.0
    a = np.concatenate([np.linspace(0, limits.acceleration, 4001)[1:], [limits.acceleration]])
    if triangular:
        pulse = 2 * np.maximum(np.sqrt(a / limits.snap), a / limits.jerk)
    else:
        t1 = np.minimum(np.sqrt(a / limits.snap), limits.jerk / limits.snap)
        pulse = 2 * t1 + np.maximum(a / limits.jerk - t1, 0)
    allowed = a * pulse <= change * (1 + 1e-12)
    return float((change / a + pulse)[allowed].min()) if allowed.any() else math.nan


@given(st.builds(Limits, *[st.floats(0.5, 2.0)] * 4), st.floats(-4, 4), share, share, st.booleans())
def test_no_other_cruising_velocity_is_faster(
    limits: Limits, distance: float, first: float, last: float, triangular: bool
) -> None:
    """Against a scan of cruising velocities with ramps found by search, and cruises wherever they help."""
    v, w = first * limits.velocity, last * limits.velocity
    best = math.inf
    for u in np.linspace(-limits.velocity, limits.velocity, 41):
        up, down = change_time(abs(u - v), limits, triangular), change_time(abs(u - w), limits, triangular)
        left = distance - (v + u) / 2 * up - (w + u) / 2 * down
        if u and left / u >= 0:
            best = min(best, up + down + left / u)
    duration = plan(State(0, v), State(distance, w), limits, triangular=triangular).duration
    assert duration <= best * (1 + 1e-4) + 1e-3


@pytest.mark.parametrize(
    ("limits", "distance"), [(Limits(1.0, 2.0, 8.0, 60.0), 2.0), (Limits(0.5, 3.0, 6.0, 40.0), 0.9)]
)
def test_shortest_of_all_motions_where_there_is_a_cruise(limits: Limits, distance: float) -> None:
    """A linear program over every motion of piecewise constant snap: none is feasible in 97 % of the time."""
    duration = plan(State(), State(distance), limits).duration
    assert feasible(limits, distance, 1.01 * duration)
    assert not feasible(limits, distance, 0.97 * duration)


def feasible(limits: Limits, distance: float, duration: float, n: int = 96) -> bool:
    h = duration / n
    step = np.array([[1, h, h**2 / 2, h**3 / 6], [0, 1, h, h**2 / 2], [0, 0, 1, h], [0, 0, 0, 1]])
    push = np.array([h**4 / 24, h**3 / 6, h**2 / 2, h])
    after, rows = np.zeros((4, n)), []
    for k in range(n):
        after = step @ after
        after[:, k] = push
        rows.append(after[1:].copy())
    bounds = [limits.velocity, limits.acceleration, limits.jerk]
    inside = np.vstack([row / np.array(bounds)[:, None] for row in rows])
    found = linprog(
        np.zeros(n),
        A_ub=np.vstack([inside, -inside]),
        b_ub=np.ones(2 * len(inside)),
        A_eq=after,
        b_eq=[distance, 0, 0, 0],
        bounds=[(-limits.snap, limits.snap)] * n,
    )
    return bool(found.status == 0)


@pytest.mark.parametrize(
    ("start", "end", "limits", "message"),
    [
        (State(velocity=3.0), State(1.0), PAPER, r"the start's velocity of 3 exceeds the limit of 2.4"),
        (State(), State(1.0, jerk=-20.0), PAPER, r"the end's jerk of 20 exceeds the limit of 19.2"),
        (State(velocity=2.3, acceleration=4.0), State(9.0), PAPER, r"the start cannot be met: .* the velocity to 3\."),
        (State(), State(1.0), Limits(1, 0, 1, 1), "the limit of acceleration is 0"),
        (State(), State(1.0), Limits(1, 1, math.inf, 1), "the limit of jerk is inf"),
    ],
)
def test_limits_that_cannot_be_met(start: State, end: State, limits: Limits, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        plan(start, end, limits)


def test_nothing_to_do_takes_no_time() -> None:
    made = plan(State(1.0, 0.5), State(1.0, 0.5), PAPER)
    assert made.duration == 0
    np.testing.assert_allclose(made.at([-1.0, 0.0, 2.0])[:, 0], [0.5, 1.0, 2.0])


LIMIT_VALUES = {"velocity_limit": 2.4, "acceleration_limit": 4.8, "jerk_limit": 19.2, "snap_limit": 76.8}


@pytest.mark.parametrize("start", [0.0, 0.123456])
@pytest.mark.parametrize("first", [0.0, -0.7])
def test_the_block_is_the_plan(start: float, first: float) -> None:
    """Snap integrated four times is the position, to rounding, at steps that have nothing to do with the segments."""
    integrators = np.diag([1.0, 1.0, 1.0], 1)
    chain = StateSpace(A=integrators, B=[[0], [0], [0], [1]], C=np.eye(4), start=[0.2 - first * start, first, 0, 0])
    parts = {
        "move": Trajectory(
            start_position=0.2, end_position=-1.9, start_velocity=first, end_velocity=0.3, start=start, **LIMIT_VALUES
        ),
        "chain": chain,
    }
    result = run(parts, "move.snap chain.in", stop=3.3, step=0.033, energy=False)
    made = plan(State(0.2, first), State(-1.9, 0.3), PAPER)
    expected = made.at(result.time - start)
    orders = ("position", "velocity", "acceleration", "jerk")
    for k, name in enumerate(orders):
        np.testing.assert_allclose(result[f"move.{name}"], expected[:, k], atol=1e-12)
        np.testing.assert_allclose(result[f"chain.out{k + 1}"], expected[:, k], atol=1e-11)
    met = np.array(instants(result, "move.phase"))
    np.testing.assert_allclose(met, start + made.instants, atol=1e-15)


def test_units_follow_the_position() -> None:
    move = Trajectory(
        end_position="137.5 deg",
        velocity_limit="2.4 rad/s",
        acceleration_limit="275 deg/s2",
        jerk_limit="19.2 rad/s3",
        snap_limit=76.8,
    )
    result = run({"move": move}, stop=0.01, energy=False)
    assert [result.units[f"move.{n}"] for n in ("position", "velocity", "snap")] == ["rad", "rad/s", "rad/s4"]
    assert move.motion.duration == pytest.approx(2.0, rel=1e-4)
    slide = Trajectory(end_position="24 mm", **{**LIMIT_VALUES, "velocity_limit": "0.1 m/s"})
    assert run({"s": slide}, stop=0.01, energy=False).units["s.jerk"] == "m/s3"
    with pytest.raises(ParameterError, match=r"velocity_limit is in rad, which does not fit end_position\n.*rad/s"):
        Trajectory(end_position="1 rad", **{**LIMIT_VALUES, "velocity_limit": "2 rad"})
    with pytest.raises(ParameterError, match=r"the start's velocity of 3 exceeds"):
        Trajectory(end_position=1, start_velocity=3, **LIMIT_VALUES)
