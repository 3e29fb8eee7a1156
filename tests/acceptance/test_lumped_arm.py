"""[One-link n.d.]: Table 2, the harmonic drive's rigid limit, and the stick-slip pulses, against independent values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate, optimize

from blocks.actuators.elasto_plastic import ElastoPlasticFriction
from blocks.actuators.lugre import LuGreFriction
from blocks.actuators.regularised_friction import RegularisedFriction
from engine.block import Block
from engine.simulate import Result
from engine.simulate import simulate as run
from flexarm.api import linearise, simulate
from scenarios.load import load
from tests.blocks.test_lumped_mass import matrices
from tools.fit_lumped_arm import fit

POLES = [-2.55 + 23.6j, -0.87 + 78.724j, -4.352 + 249.99j]
ZEROS = [-0.0057 + 12.1j, -0.658 + 76.19j, -4.169 + 247.89j]


def upper(values: NDArray[np.complex128]) -> list[complex]:
    return sorted((complex(e) for e in values if e.imag > 1e-6), key=lambda e: e.imag)


# -- Table 2 -----------------------------------------------------------------------------------------------------------


def test_table_2() -> None:
    """[One-link n.d., Table 2]: imaginary parts 0.02 %, real parts 1 %, of -0.87 and -2.55 0.7 %; interlacing."""
    found = linearise(load("lumped-arm"))
    poles, zeros = found.poles(), found.zeros("link.hub.angle")
    real = np.sort(poles[np.abs(poles.imag) < 1e-6].real)
    assert real[0] == pytest.approx(-1.78, rel=1e-2)
    assert real[1] == pytest.approx(0, abs=1e-6)
    for values, table in ((poles, POLES), (zeros, ZEROS)):
        for ours, theirs in zip(upper(values), table, strict=True):
            assert ours.imag == pytest.approx(theirs.imag, rel=2e-4)
            assert ours.real == pytest.approx(theirs.real, rel=7e-3 if theirs.real in (-2.55, -0.87) else 1e-2)
    heights = np.array([[zero.imag, pole.imag] for zero, pole in zip(upper(zeros), upper(poles), strict=True)])
    assert (np.diff(heights.ravel()) > 0).all(), "zeros and poles alternate, a zero first"


def test_table_2_by_eight_independent_numbers() -> None:
    """His numbers in the scenario's place: the columns he prints, to print precision."""
    scale = 0.15
    stiffness = [scale * k for k in (38.153, 29.026, 4.004)]
    damping = [scale * c for c in (1.246e-4, 1.258e-2, 1.002e-5)]
    changes = [
        f"link.joint_stiffness={stiffness}",
        f"link.joint_damping={damping}",
        f"link.hub_inertia={scale * 0.09928}",
        f"link.hub_damping={scale * 0.74192}",
    ]
    found = linearise(load("lumped-arm", changes))
    poles = [-2.5457 + 23.6001j, -0.8755 + 78.7191j, -4.3502 + 249.9827j]
    zeros = [-0.0057 + 12.1j, -0.6552 + 76.1928j, -4.1681 + 247.8911j]
    np.testing.assert_allclose(upper(found.poles()), poles, rtol=0, atol=1e-4)
    np.testing.assert_allclose(upper(found.zeros("link.hub.angle")), zeros, rtol=0, atol=1e-4)


def test_the_scenarios_hold_the_fit() -> None:
    """Eight numbers from thirteen, for mass * length^2 = 0.15 kg.m2, near the independent fit's."""
    arm = fit()
    np.testing.assert_allclose(arm.stiffness, [38.153, 29.026, 4.004], rtol=1e-4)
    np.testing.assert_allclose([arm.hub_inertia, arm.hub_damping], [0.09928, 0.74192], rtol=1e-4)
    np.testing.assert_allclose(arm.damping, [1.246e-4, 1.258e-2, 1.002e-5], rtol=0.02)
    for name in ("lumped-arm", "lumped-arm-pulse", "harmonic-drive-arm"):
        link: Any = load(name).system.blocks["link"]
        assert link.mass * link.length**2 == pytest.approx(0.15, rel=1e-12)
        np.testing.assert_allclose(link.joint_stiffness, 0.15 * arm.stiffness, rtol=1e-5)
        np.testing.assert_allclose(link.joint_damping, 0.15 * arm.damping, rtol=1e-4)
    link = load("lumped-arm").system.blocks["link"]
    assert link.hub_inertia == pytest.approx(0.15 * arm.hub_inertia, rel=1e-5)
    assert link.hub_damping == pytest.approx(0.15 * arm.hub_damping, rel=1e-5)


def test_harmonic_drive_arm_tends_to_the_lumped_arm() -> None:
    """[One-link n.d., eqs. 1, 2]: as K grows, poles and zeros approach Table 2, the error falling as 1 / K."""
    rigid = linearise(load("lumped-arm"))
    wanted = np.array([*upper(rigid.poles()), *upper(rigid.zeros("link.hub.angle"))])
    errors = []
    for k in (1e3, 1e4, 1e5):
        found = linearise(load("harmonic-drive-arm", [f"drive.stiffness={k}"]))
        ours = np.array([*upper(found.poles())[:3], *upper(found.zeros("rotor.shaft.angle"))[:3]])
        errors.append(np.abs(ours / wanted - 1))
    np.testing.assert_allclose(np.log10(np.array(errors[:-1]) / errors[1:]), 1, atol=0.02)
    assert max(errors[-1]) < 1e-4


def test_harmonic_drive_arm_moves_as_the_lumped_arm() -> None:
    """Its friction on the rotor is that of the hub over n: sticking times approach each other as K grows."""
    direct = simulate(load("lumped-arm-pulse", ["width=0.5"]), stop=1.5)
    apart = []
    for k in (1e3, 1e4):
        geared = simulate(load("harmonic-drive-arm", [f"drive.stiffness={k}", "drive.damping=0"]), stop=1.5)
        apart.append(stuck_at(geared) - stuck_at(direct))
        assert geared["rotor.shaft.angle"][-1] / 100 == pytest.approx(direct["link.hub.angle"][-1], rel=3 / k)
    assert abs(apart[0]) < 3e-3
    assert abs(apart[1]) < 0.3 * abs(apart[0])


# -- pulses ------------------------------------------------------------------------------------------------------------


def stuck_at(result: Result) -> float:
    """Instant of the last change to sticking."""
    time, _, value = [event for event in result.events if event[1] == "friction"][-1]
    assert value == 0.0, "it ends stuck"
    return time


def pulse(width: float, *changes: str) -> Result:
    return simulate(load("lumped-arm-pulse", [f"width={width}", *changes]))


def peak(result: Result, signal: str, begin: float, around: float) -> float:
    """Frequency (rad/s) of the highest line within 15 % of ``around``: 5 s from ``begin``, Hann, zero padded."""
    rows = (result.time > begin) & (result.time <= begin + 5)
    values = result[signal][rows]
    values = (values - values.mean()) * np.hanning(len(values))
    size = 32 * len(values)
    lines = np.abs(np.fft.rfft(values, size))
    rates = 2 * np.pi * np.fft.rfftfreq(size, result.time[1] - result.time[0])
    near = np.abs(rates / around - 1) < 0.15
    return float(rates[near][np.argmax(lines[near])])


@dataclass(frozen=True)
class Arm:
    """The pulsed arm integrated by scipy with events of its own: eighth-order steps, every switch a restart."""

    M: Any
    C: Any
    K: Any
    coulomb: float
    static: float
    viscous: float
    stribeck: float = 0.05

    def friction(self, v: float) -> float:
        return self.coulomb + (self.static - self.coulomb) * float(np.exp(-((v / self.stribeck) ** 2)))

    def rate(self, y: Any, push: float, mode: int) -> Any:
        q, v = y[:4], y[4:]
        force = -self.K @ q - self.C @ v
        force[0] += push - self.viscous * v[0] - mode * self.friction(v[0])
        if mode:
            return np.concatenate([v, np.linalg.solve(self.M, force)])
        return np.concatenate([v, [0.0], np.linalg.solve(self.M[1:, 1:], force[1:])])

    def reaction(self, y: Any, push: float) -> float:
        """What would set the stuck hub in motion."""
        held = self.rate(y, push, 0)
        return float(push - self.K[0] @ y[:4] - self.C[0] @ y[4:] - self.M[0] @ held[4:])

    def run(self, height: float, width: float, stop: float) -> tuple[list[tuple[float, int]], Any]:
        """Changes of mode, and the state at the end."""
        y, t, push = np.zeros(8), 0.0, height
        mode = int(np.sign(height)) if abs(height) > self.static else 0
        log = [(t, mode)]
        for edge, following in ((width, 0.0), (stop, 0.0)):
            while t < edge:
                if mode:
                    events: list[Any] = [lambda _, y, *__: y[4]]
                    events[0].direction = -mode
                else:
                    events = [
                        lambda _, y, push, __: self.reaction(y, push) - self.static,
                        lambda _, y, push, __: self.reaction(y, push) + self.static,
                    ]
                    events[0].direction, events[1].direction = 1, -1
                for event in events:
                    event.terminal = True
                found = integrate.solve_ivp(
                    lambda _, y, push, mode: self.rate(y, push, mode),
                    (t, edge),
                    y,
                    method="DOP853",
                    events=events,
                    rtol=1e-11,
                    atol=1e-13,
                    max_step=2e-3,
                    args=(push, mode),
                )
                t, y = float(found.t[-1]), found.y[:, -1]
                if found.status == 1:
                    if mode:
                        y[4] = 0.0
                    left = self.reaction(y, push)
                    mode = int(np.sign(left)) if (abs(left) > self.static) or not mode else 0
                    log.append((t, mode))
            push = following
            if mode == 0 and abs(self.reaction(y, push)) > self.static:
                mode = int(np.sign(self.reaction(y, push)))
                log.append((t, mode))
        return log, y


def oracle(width: float, stop: float) -> tuple[list[tuple[float, int]], Any]:
    link = load("lumped-arm-pulse").system.blocks["link"]
    M, C, K = matrices({name: getattr(link, name) for name in type(link).parameters})
    return Arm(M, C, K, 0.2766, 1.2 * 0.2766, 0.11129).run(0.95, width, stop)


@pytest.mark.parametrize("width", [0.05, 0.5])
def test_pulse_against_an_independent_event_driven_integration(width: float) -> None:
    log, y = oracle(width, 2.0)
    scenario = load("lumped-arm-pulse", [f"width={width}"])
    result = simulate(scenario, stop=2.0, internal_step=2.5e-4)
    events = [(time, int(value)) for time, name, value in result.events if name == "friction"]
    assert [mode for _, mode in events] == [mode for _, mode in log]
    np.testing.assert_allclose([time for time, _ in events], [time for time, _ in log], rtol=0, atol=1e-7)
    found = [result["link.hub.angle"][-1], *(result[f"link.strain{i}"][-1] for i in (1, 2, 3))]
    np.testing.assert_allclose(found, [y[0], *np.diff(y[:4])], rtol=0, atol=1e-7)
    coarse = simulate(scenario, stop=2.0)
    times = [time for time, name, _ in coarse.events if name == "friction"]
    np.testing.assert_allclose(times, [time for time, _ in log], rtol=0, atol=2e-5)


def test_short_pulse() -> None:
    """[One-link n.d., fig. 8]: sticks at 0.082 s, slips 0.109 to 0.143 and 0.232 to 0.373 s, 1.43 rad/s, 5.5 deg."""
    result = pulse(0.05)
    changes = [(time, value) for time, name, value in result.events if name == "friction"]
    times, modes = zip(*changes, strict=True)
    assert list(modes) == [1, 0, -1, 0, 1, 0]
    np.testing.assert_allclose(times[1:], [0.082, 0.109, 0.143, 0.232, 0.373], rtol=0, atol=0.05)
    assert result["link.hub.speed"][50] == pytest.approx(1.43, rel=0.02)
    assert np.degrees(result["link.hub.angle"][-1]) == pytest.approx(5.5, rel=0.02)


def test_long_pulse() -> None:
    """[One-link n.d., fig. 9]: 3.29 rad/s at its end, stuck at 1.017 s, "almost 0.5 s" after it, at 101.9 deg."""
    result = pulse(0.5)
    assert result["link.hub.speed"][500] == pytest.approx(3.29, rel=0.02)
    assert stuck_at(result) == pytest.approx(1.017, abs=0.02)
    assert np.degrees(result["link.hub.angle"][-1]) == pytest.approx(101.9, rel=0.02)


@pytest.mark.parametrize("width", [0.05, 0.5])
def test_stuck_arm_rings_at_the_zeros(width: float) -> None:
    """Zeros: 12.1 +- 0.15 and 76.2 +- 0.3 rad/s; the rotor does not creep; both modes are visible."""
    result = pulse(width)
    begin = stuck_at(result)
    for signal in ("link.strain1", "link.tip.deflection"):
        assert peak(result, signal, begin, 12.1) == pytest.approx(12.1, abs=0.12)
        assert peak(result, signal, begin, 76.2) == pytest.approx(76.2, abs=0.3)
    still = result["link.hub.angle"][result.time > begin + 1e-3]
    assert np.ptp(still) == 0.0


def test_slipping_arm_rings_at_the_first_pole() -> None:
    """Pole: near 23.6 rad/s while it slips; a damped wave is fitted to the strain of the long pulse."""
    result = pulse(0.5)
    rows = (result.time > 0.1) & (result.time < 0.5)
    t, strain = result.time[rows] - 0.1, result["link.strain1"][rows]

    def wave(t: Any, a: float, b: float, decay: float, w: float, c: float, fall: float) -> Any:
        return np.exp(-decay * t) * (a * np.cos(w * t) + b * np.sin(w * t)) + c * np.exp(-fall * t)

    found = optimize.curve_fit(wave, t, strain, p0=[-0.05, 0.0, 2.5, 22.0, -0.05, 1.8])[0]
    assert found[3] == pytest.approx(23.6, rel=0.01)


@pytest.mark.parametrize(("coulomb", "long", "short"), [(0.15, 0.80, 0.32), (0.2766, 0.52, 0.32), (0.40, 0.28, 0.02)])
def test_time_to_stick_against_coulomb_friction(coulomb: float, long: float, short: float) -> None:
    """Independent values, sensitivity: seconds from the end of the pulse; tolerances 0.02 and 0.05 s."""
    changes = [f"friction.coulomb_friction={coulomb}", f"friction.static_friction={1.2 * coulomb}"]
    assert stuck_at(pulse(0.5, *changes)) - 0.5 == pytest.approx(long, abs=0.02)
    assert stuck_at(pulse(0.05, *changes)) - 0.05 == pytest.approx(short, abs=0.05)


# -- other friction laws -----------------------------------------------------------------------------------------------

LEVELS = {
    "coulomb_friction": 0.2766,
    "static_friction": 0.33192,
    "stribeck_velocity": 0.05,
    "viscous_friction": 0.11129,
}
BRISTLE = {**LEVELS, "bristle_stiffness": 1e3, "bristle_damping": 2.0}


def with_friction(friction: Block, width: float) -> Result:
    scenario = load("lumped-arm-pulse", [f"width={width}"])
    scenario.system.blocks["friction"] = friction
    model = scenario.build(outputs=["link.hub.angle", "link.hub.speed", "link.strain1"])
    return run(model, 7.0, 1e-3, internal_step=5e-5)


@pytest.mark.parametrize("width", [0.05, 0.5])
def test_elasto_plastic_friction_rings_at_the_zeros_without_drift(width: float) -> None:
    """Frequencies of the zeros within 1 %, drift below 0.01 deg/s; the long pulse ends as with stick."""
    result = with_friction(ElastoPlasticFriction(**BRISTLE), width)
    exact = pulse(width)
    begin = stuck_at(exact) + 0.1
    assert peak(result, "link.strain1", begin, 12.1) == pytest.approx(12.1, rel=0.01)
    assert peak(result, "link.strain1", begin, 76.2) == pytest.approx(76.2, rel=0.01)
    assert drift(result, begin) < 0.01
    if width == 0.5:
        assert result["link.hub.angle"][-1] == pytest.approx(exact["link.hub.angle"][-1], rel=0.02)


def drift(result: Result, begin: float) -> float:
    """Mean creep (deg/s) of the hub over whole periods of the first mode, from ``begin``."""
    period = 2 * np.pi / 12.1
    windows = [(result.time > t) & (result.time <= t + period) for t in (begin, begin + 10 * period)]
    first, last = (result["link.hub.angle"][rows].mean() for rows in windows)
    return float(abs(np.degrees(last - first)) / (10 * period))


def swing(result: Result, begin: float) -> float:
    """Amplitude of the first strain within a second from ``begin``."""
    rows = (result.time > begin) & (result.time <= begin + 1)
    return float(np.ptp(result["link.strain1"][rows]) / 2)


@pytest.mark.parametrize("creep_velocity", [0.01, 0.05])
def test_smoothed_friction_damps_the_ringing(creep_velocity: float) -> None:
    """Why it is no default: near rest it is a damper Fs / v0 at the hub, and the arm dies down at that arm's rate."""
    result = with_friction(RegularisedFriction(**LEVELS, creep_velocity=creep_velocity), 0.5)
    link = load("lumped-arm-pulse").system.blocks["link"]
    values = {name: getattr(link, name) for name in type(link).parameters}
    M, C, K = matrices(values | {"hub_damping": 0.33192 / creep_velocity + 0.11129})
    lower = -np.linalg.solve(M, np.hstack([K, C]))
    first = upper(np.linalg.eigvals(np.vstack([np.eye(4, 8, 4), lower])))[0]
    sizes = []
    for begin in (3.0, 5.0):
        rows = (result.time > begin) & (result.time <= begin + 2)
        turned = result["link.strain1"][rows] * np.exp(-1j * first.imag * result.time[rows])
        sizes.append(abs(np.sum(turned * np.hanning(len(turned)))))
    decay = np.log(sizes[0] / sizes[1]) / 2
    assert decay == pytest.approx(-first.real, rel=0.01)
    assert decay > 10 * 0.0057


def test_lugre_damps_the_ringing_and_elasto_plastic_friction_does_not() -> None:
    """Against the 0.0057 1/s of the locked arm."""
    exact = pulse(0.5)
    stiff, soft, plastic = (
        with_friction(friction, 0.5)
        for friction in (
            LuGreFriction(**BRISTLE),
            LuGreFriction(**{**BRISTLE, "bristle_stiffness": 100.0}),
            ElastoPlasticFriction(**BRISTLE),
        )
    )
    assert swing(plastic, 6.0) == pytest.approx(swing(exact, 6.0), rel=0.01)
    assert swing(stiff, 6.0) < 0.97 * swing(exact, 6.0)
    assert swing(soft, 6.0) < 0.7 * swing(exact, 6.0)
