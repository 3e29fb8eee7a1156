"""Ties, friction coordinates, stuck joints, losses: against closed forms and energy balances."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.assemble import build
from engine.errors import ConnectionProblem, StructureError
from engine.linearise import linearise
from engine.simulate import Drive, simulate
from tests.engine.parts import (
    Anchor,
    Body,
    Clutch,
    Count,
    Dry,
    Feed,
    Gearing,
    Held,
    Jump,
    Lag,
    Push,
    Rest,
    Scale,
    Spring,
    Wave,
    system,
)


def test_a_gear_reflects_inertia_with_its_ratio_squared() -> None:
    plant = system(
        {"t": Push(), "m": Body(inertia=1e-3), "g": Gearing(ratio=10), "l": Body(inertia=0.2)},
        ("t.shaft", "m.shaft", "g.input"),
        ("g.output", "l.shaft"),
    )
    model = build(plant, inputs=["t.in"], outputs=["l.shaft.angle"])
    result = simulate(model, 1.0, 0.1, drive=Drive([0], [[0.3]]))
    assert result["l.shaft.angle"][-1] == pytest.approx(0.5 * 10 * 0.3 / (0.2 + 100 * 1e-3), rel=1e-12)
    assert model.coordinates == 1


def test_a_lossy_gear_passes_on_its_share_of_the_motor_torque_and_books_the_rest() -> None:
    plant = system(
        {"t": Push(), "m": Body(inertia=1e-3), "g": Gearing(ratio=10, efficiency=0.8), "l": Body(inertia=0.2)},
        ("t.shaft", "m.shaft", "g.input"),
        ("g.output", "l.shaft"),
    )
    model = build(plant, inputs=["t.in"], outputs=["l.shaft.speed", "m.shaft.speed"], energy=True)
    result = simulate(model, 1.0, 0.1, drive=Drive([0], [[0.3]]))
    speed = 0.8 * 10 * 0.3 / (0.2 + 0.8 * 100 * 1e-3)
    assert result["l.shaft.speed"][-1] == pytest.approx(speed, rel=1e-12)
    through = 0.3 - 1e-3 * 10 * speed
    lost = 0.2 * through * result["m.shaft.speed"][-1] / 2
    assert result["energy.dissipated"][-1] == pytest.approx(lost, rel=1e-9)
    assert np.abs(result["energy.residual"]).max() < 1e-9 * result["energy.stored"].max()


def test_efficiency_may_be_reached_from_either_side_of_the_gear() -> None:
    """A spring on the output and friction at the rotor: the equations must not depend on the coordinate kept."""
    blocks = {
        "t": Push(),
        "m": Body(inertia=1e-3),
        "f": Dry(level=1e-9),
        "g": Gearing(ratio=10, efficiency=0.7),
        "s": Spring(stiffness=40),
        "l": Body(inertia=0.2),
    }
    model = build(
        system(blocks, ("t.shaft", "m.shaft", "g.input", "f.shaft"), ("g.output", "s.a"), ("s.b", "l.shaft")),
        inputs=["t.in"],
        outputs=["l.shaft.angle"],
    )
    linear = linearise(model, modes={"f": "sliding forward"})
    J = 0.7 * 100 * 1e-3
    expected = np.sqrt(40 / 0.2 + 40 / J)
    assert np.abs(linear.poles()).max() == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_coulomb_friction_stops_a_sliding_body_when_and_where_it_must(backend: str) -> None:
    plant = system({"m": Body(inertia=2.0), "f": Dry(level=3.0)}, ("m.shaft", "f.shaft"))
    model = build(plant, energy=True)
    result = simulate(model, 1.0, 1e-2, initial={"m.shaft.speed": 0.7}, backend=backend)
    stop = 2.0 * 0.7 / 3.0
    assert result.events[0][0] == pytest.approx(stop, abs=1e-12)
    assert result["m.shaft.angle"][-1] == pytest.approx(0.5 * 0.7 * stop, rel=1e-12)
    assert result["m.shaft.speed"][-1] == 0.0
    assert result["energy.dissipated"][-1] == pytest.approx(0.5 * 2.0 * 0.7**2, rel=1e-12)


def test_a_stuck_joint_does_not_move_at_all_and_breaks_away_at_its_static_level() -> None:
    plant = system(
        {"w": Wave(amplitude=1.0, frequency=2.0), "t": Push(), "m": Body(inertia=0.1), "f": Dry(level=0.5, static=0.8)},
        ("w.out", "t.in"),
        ("t.shaft", "m.shaft", "f.shaft"),
    )
    result = simulate(build(plant), 0.6, 1e-3)
    away = np.arcsin(0.8) / 2.0
    assert result.events[0][0] == pytest.approx(away, abs=1e-12)
    assert result.events[0][1] == "f"
    before = result.time < away
    assert (result["m.shaft.angle"][before] == 0.0).all()


def test_a_clutch_between_two_moving_bodies_has_its_slip_as_coordinate_and_conserves_momentum() -> None:
    plant = system(
        {"a": Body(inertia=0.3), "b": Body(inertia=0.5), "c": Clutch(level=0.2)},
        ("a.shaft", "c.a"),
        ("b.shaft", "c.b"),
    )
    model = build(plant)
    result = simulate(model, 5.0, 1e-2, initial={"a.shaft.speed": 2.0, "b.shaft.speed": -1.0})
    lock = 3.0 / (0.2 / 0.3 + 0.2 / 0.5)
    assert result.events[0][0] == pytest.approx(lock, abs=1e-11)
    common = (0.3 * 2.0 - 0.5 * 1.0) / 0.8
    assert result["a.shaft.speed"][-1] == pytest.approx(common, rel=1e-12)
    slip = result["a.shaft.angle"] - result["b.shaft.angle"]
    after = result.time > lock
    assert np.ptp(slip[after]) < 1e-14 * np.abs(result["a.shaft.angle"]).max() * 10


def test_two_frictions_on_one_shaft_add_their_levels() -> None:
    plant = system(
        {"t": Push(), "m": Body(inertia=0.1), "f": Dry(level=0.3), "h": Dry(level=0.2)},
        ("t.shaft", "m.shaft", "f.shaft", "h.shaft"),
    )
    model = build(plant, inputs=["t.in"])
    assert [mode.name for mode in model.modes] == ["f + h"]
    held = simulate(model, 1.0, 0.1, drive=Drive([0], [[0.499]]))
    assert (held["m.shaft.angle"] == 0).all()
    moved = simulate(model, 1.0, 0.1, drive=Drive([0], [[0.6]]))
    assert moved["m.shaft.angle"][-1] == pytest.approx(0.5 * (0.6 - 0.5) / 0.1, rel=1e-12)


def test_friction_behind_a_gear_acts_with_the_ratio() -> None:
    plant = system(
        {"t": Push(), "m": Body(inertia=1e-3), "g": Gearing(ratio=7), "f": Dry(level=0.7), "l": Body(inertia=1e-2)},
        ("t.shaft", "m.shaft", "g.input"),
        ("g.output", "l.shaft", "f.shaft"),
    )
    model = build(plant, inputs=["t.in"])
    held = simulate(model, 1.0, 0.1, drive=Drive([0], [[0.0999]]))
    assert (held["m.shaft.angle"] == 0).all()
    moved = simulate(model, 1.0, 0.1, drive=Drive([0], [[0.2]]))
    assert moved["m.shaft.angle"][-1] == pytest.approx(0.5 * (0.2 - 0.1) / (1e-3 + 1e-2 / 49), rel=1e-12)


def test_stick_slip_agrees_with_an_event_driven_scipy_solution() -> None:
    """Mass on a spring dragged by a wave, static above kinetic friction; DOP853 restarted at every switch."""
    k, J, level, static = 30.0, 0.2, 0.6, 0.9
    plant = system(
        {
            "w": Wave(amplitude=2.0, frequency=1.3),
            "t": Push(),
            "m": Body(inertia=J),
            "f": Dry(level=level, static=static),
            "s": Spring(stiffness=k, damping=0.05),
            "ground": Anchor(),
        },
        ("w.out", "t.in"),
        ("t.shaft", "m.shaft", "f.shaft", "s.a"),
        ("s.b", "ground.shaft"),
    )
    result = simulate(build(plant), 10.0, 1e-2, internal_step=1e-3)

    def force(t: Any, y: Any) -> Any:
        return 2.0 * np.sin(1.3 * t) - k * y[0] - 0.05 * y[1]

    t, y, mode, rows = 0.0, np.array([0.0, 0.0]), 0, {}
    grid = result.time
    while t < 10.0 - 1e-12:
        if mode == 0:
            events: list[Any] = [lambda t, y: abs(force(t, y)) - static]
            events[0].direction = 1
            f: Any = lambda t, y: [0.0, 0.0]  # noqa: E731
        else:
            events = [lambda t, y, m=mode: m * y[1]]
            events[0].direction = -1
            f = lambda t, y, m=mode: [y[1], (force(t, y) - m * level) / J]  # noqa: E731
        events[0].terminal = True
        rest = grid[grid >= t - 1e-12]
        solution = solve_ivp(
            f,
            (t, 10.0),
            y,
            "DOP853",
            t_eval=np.clip(rest, t, 10.0),
            events=events,
            rtol=1e-11,
            atol=1e-13,
            max_step=0.01,
        )
        for time, angle in zip(solution.t, solution.y[0], strict=True):
            rows[round(time / 1e-2)] = angle
        if not solution.t_events[0].size:
            break
        t, y = float(solution.t_events[0][0]), solution.y_events[0][0].copy()
        if mode == 0:
            mode = int(np.sign(force(t, y)))
        else:
            y[1] = 0.0
            mode = 0 if abs(force(t, y)) <= static else int(np.sign(force(t, y)))
    oracle = np.array([rows[i] for i in range(len(grid))])
    assert len(result.events) > 6
    assert np.abs(result["m.shaft.angle"] - oracle).max() < 1e-8


def test_a_stop_bounces_without_chatter_and_keeps_energy() -> None:
    plant = system({"m": Body(inertia=0.01), "r": Rest(stiffness=100.0, gap=0.1)}, ("m.shaft", "r.shaft"))
    result = simulate(build(plant), 10.0, 1e-3, initial={"m.shaft.speed": 1.0})
    contact = np.pi * np.sqrt(0.01 / 100.0)
    flight = 0.2 / 1.0
    times = [t for t, _, _ in result.events]
    assert times[0] == pytest.approx(0.1, abs=1e-12)
    assert times[1] - times[0] == pytest.approx(contact, rel=1e-6)
    assert times[2] - times[1] == pytest.approx(flight, rel=1e-6)
    period = contact + flight
    expected = 2 * (10.0 - 0.1) / period
    assert abs(len(times) - expected) < 2
    assert np.abs(np.abs(result["m.shaft.speed"][-1]) - 1.0) < 1e-4 or result.final_modes[0] != 0


def test_a_step_at_any_instant_is_hit_exactly() -> None:
    start = 0.123456789
    plant = system(
        {"j": Jump(height=2.0, start=start), "t": Push(), "m": Body(inertia=0.5)},
        ("j.out", "t.in"),
        ("t.shaft", "m.shaft"),
    )
    result = simulate(build(plant), 1.0, 0.1)
    moving = np.clip(result.time - start, 0, None)
    assert np.abs(result["m.shaft.angle"] - 0.5 * 4.0 * moving**2).max() < 1e-15


def test_sampled_blocks_hold_and_pass_new_values_on_within_an_instant() -> None:
    plant = system(
        {"w": Wave(frequency=3.0), "h": Held(gain=2.0, period=0.05), "n": Count(period=0.1)},
        ("w.out", "h.in"),
        ("h.out", "n.in"),
    )
    result = simulate(build(plant), 1.0, 0.01)
    k = np.floor(result.time / 0.05 + 1e-9)
    held = 2 * np.sin(3.0 * 0.05 * k)
    assert np.abs(result["h.out"] - held).max() < 1e-14
    sums = np.cumsum(2 * np.sin(3.0 * 0.1 * np.arange(11)))
    assert np.abs(result["n.out"] - sums[np.floor(result.time / 0.1 + 1e-9).astype(int)]).max() < 1e-13


def test_a_sampled_jump_past_a_guard_is_noticed_at_the_sample() -> None:
    """The jump crosses break-away without passing through it; the joint must slip at once."""
    plant = system(
        {
            "j": Jump(height=2.0, start=0.017),
            "h": Held(period=0.01),
            "t": Push(),
            "m": Body(inertia=1.0),
            "f": Dry(level=1.0),
        },
        ("j.out", "h.in"),
        ("h.out", "t.in"),
        ("t.shaft", "m.shaft", "f.shaft"),
    )
    result = simulate(build(plant), 0.1, 0.01)
    slipped = [t for t, name, value in result.events if name == "f" and value == 1]
    assert slipped == [pytest.approx(0.02, abs=1e-15)]
    assert result["m.shaft.angle"][-1] == pytest.approx(0.5 * 1.0 * 0.08**2, rel=1e-12)


def test_rk4_shows_order_four_on_a_smooth_model() -> None:
    plant = system(
        {"m": Body(inertia=0.3), "s": Spring(stiffness=12.0, damping=0.2), "g": Anchor()},
        ("m.shaft", "s.a"),
        ("s.b", "g.shaft"),
    )
    model = build(plant, outputs=["m.shaft.angle"])
    w, z = np.sqrt(12 / 0.3), 0.2 / (2 * np.sqrt(12 * 0.3))
    wd = w * np.sqrt(1 - z**2)
    errors = []
    for h in (0.02, 0.01, 0.005):
        run = simulate(model, 2.0, 0.02, initial={"m.shaft.angle": 1.0}, internal_step=h)
        exact = np.exp(-z * w * run.time) * (np.cos(wd * run.time) + z * w / wd * np.sin(wd * run.time))
        errors.append(np.abs(run["m.shaft.angle"] - exact).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.1)


def test_the_interpreter_and_the_compiled_runtime_agree() -> None:
    plant = system(
        {
            "w": Wave(amplitude=2.0, frequency=9.0),
            "h": Held(period=0.004),
            "t": Push(),
            "m": Body(inertia=0.02),
            "f": Dry(level=0.4, static=0.6),
            "s": Spring(stiffness=20.0, damping=0.01),
            "l": Body(inertia=0.05),
            "r": Rest(stiffness=300.0, damping=0.2, gap=0.05),
            "lag": Lag(corner=30.0),
        },
        ("w.out", "h.in"),
        ("h.out", "t.in"),
        ("t.shaft", "m.shaft", "f.shaft", "s.a"),
        ("s.b", "l.shaft", "r.shaft"),
        ("l.shaft.speed", "lag.in"),
    )
    model = build(plant)
    one, other = (simulate(model, 1.0, 2e-3, backend=backend) for backend in ("c", "interpreter"))
    assert one.event_count == other.event_count > 5
    scale = np.abs(one.values).max(axis=0) + 1e-12
    assert (np.abs(one.values - other.values) / scale).max() < 1e-8


def test_linear_input_is_integrated_as_the_ramp_it_is() -> None:
    plant = system({"t": Push(), "m": Body(inertia=2.0)}, ("t.shaft", "m.shaft"))
    model = build(plant, inputs=["t.in"])
    run = simulate(model, 1.0, 0.25, drive=Drive([0.0, 1.0], [[0.0], [3.0]], hold="linear"))
    assert np.abs(run["m.shaft.angle"] - 3.0 * run.time**3 / 12).max() < 1e-15
    held = simulate(model, 1.0, 0.25, drive=Drive([0.0, 0.5], [[0.0], [3.0]]))
    assert held["m.shaft.speed"][-1] == pytest.approx(0.75, rel=1e-14)


def _error(plant: Any, **arguments: Any) -> str:
    with pytest.raises((StructureError, ConnectionProblem)) as caught:
        build(plant, **arguments)
    return str(caught.value)


def test_structural_mistakes_are_refused_by_name() -> None:
    massless = system(
        {"t": Push(), "s": Spring(stiffness=1.0), "m": Body(inertia=1.0)}, ("s.a", "m.shaft"), ("t.shaft", "s.b")
    )
    text = _error(massless, inputs=["t.in"])
    assert "s.b" in text
    assert "no inertia" in text
    assert "Inertia" in text

    looped = system(
        {"a": Scale(), "b": Scale(gain=0.5)},
        ("a.out", "b.in"),
        ("b.out", "a.in"),
    )
    text = _error(looped)
    assert "algebraic loop" in text
    assert "a.in" in text
    assert "b.in" in text

    through_plant = system(
        {"a": Feed(), "t": Push(), "m": Body(inertia=1.0)},
        ("m.shaft.acceleration", "a.in"),
        ("a.out", "t.in"),
        ("t.shaft", "m.shaft"),
    )
    text = _error(through_plant)
    assert "algebraic loop" in text
    assert "accelerations" in text

    loop_of_gears = system(
        {"m": Body(inertia=1.0), "g": Gearing(ratio=2.0), "h": Gearing(ratio=2.0)},
        ("m.shaft", "g.input", "h.input"),
        ("g.output", "h.output"),
    )
    assert "tied already" in _error(loop_of_gears)

    frictions = system(
        {"a": Body(inertia=1.0), "b": Body(inertia=1.0), "f": Dry(level=1), "h": Dry(level=1), "c": Clutch(level=1)},
        ("a.shaft", "f.shaft", "c.a"),
        ("b.shaft", "h.shaft", "c.b"),
    )
    text = _error(frictions)
    assert "'c' closes a loop" in text
    assert "f" in text
    assert "h" in text


def test_wrong_connections_name_both_ends_and_the_line() -> None:
    two = system(
        {"w": Wave(), "v": Wave(), "t": Push(), "m": Body(inertia=1)},
        ("w.out", "t.in"),
        ("v.out", "t.in"),
        ("t.shaft", "m.shaft"),
    )
    text = _error(two)
    assert "two sources" in text
    assert "w.out" in text
    assert "v.out" in text
    assert "test.yaml:11" in text

    kinds = system({"w": Wave(), "m": Body(inertia=1)}, ("w.out", "m.shaft"))
    assert "m.shaft" in _error(kinds)
    assert "w.out" in _error(kinds)

    units = system({"t": Push(), "m": Body(inertia=1)}, ("m.shaft.speed", "t.in"), ("t.shaft", "m.shaft"))
    text = _error(units)
    assert "rad/s" in text
    assert "N.m" in text
    assert "test.yaml:10" in text

    missing = system({"t": Push(), "m": Body(inertia=1)}, ("t.shaft", "m.shaft"))
    assert "'t.in' is not connected" in _error(missing)

    nearest = system({"wave": Wave(), "t": Push(), "m": Body(inertia=1)}, ("wve.out", "t.in"), ("t.shaft", "m.shaft"))
    assert "did you mean 'wave'" in _error(nearest)
