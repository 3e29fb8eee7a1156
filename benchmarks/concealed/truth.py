"""A plant with its true parameters, what is concealed in it, and the small disturbances nobody names."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from benchmarks.concealed import native
from benchmarks.concealed.effects import Concealed
from benchmarks.concealed.mechanism import Mechanism, Port
from benchmarks.concealed.plants.base import Body, JointLaw, LinkOptions, Plant
from benchmarks.concealed.simulator import Heat, InputChain, SensorChain, Simulator

FINE, CONTACT_STEP = 2e-5, 5e-6
"""Steps (s) for recordings, and with a contact."""

MAXWELL_PER_DECADE, MAXWELL_BAND = 4, (0.2, 2e3)
"""Elements of structural damping and their corner frequencies (rad/s)."""


@dataclass(frozen=True)
class Nuisance:
    """Small disturbances that no entry of the catalogue names. All zero is none.

    Attributes:
        gain: of the amplifier, differs from 1 by this.
        inductance: of the winding (H).
        ripple: amplitude (N.m), waves per radian and phase of two torque ripples on the main shaft.
        warm_up: viscous friction of the main shaft when cold (N.m.s/rad), and time constant (s) with which it goes.
        drift: size of a slow torque on the main shaft (N.m); its course comes from the recording.
        sensor_drift: slow change of each sensor's zero over a recording (SI).
        coloured: share of the noise's variance that is coloured, and its correlation time (s).
    """

    gain: float = 0.0
    inductance: float = 0.0
    ripple: tuple[tuple[float, float, float], ...] = ()
    warm_up: tuple[float, float] = (0.0, 20.0)
    drift: float = 0.0
    sensor_drift: tuple[float, ...] = ()
    coloured: tuple[float, float] = (0.0, 0.02)


@dataclass(frozen=True)
class Truth:
    """What the recordings are made of.

    Attributes:
        plant: which.
        parameters: true values of the scenario's parameters (SI).
        concealed: what the scenario leaves out.
        nuisance: what nobody names.
    """

    plant: Plant
    parameters: Mapping[str, float]
    concealed: tuple[Concealed, ...] = ()
    nuisance: Nuisance = Nuisance()

    def bare(self) -> Truth:
        """The same without anything concealed or disturbing."""
        return replace(self, concealed=(), nuisance=Nuisance())


_SWITCHING = frozenset(
    {
        "coulomb_friction",
        "stribeck_friction",
        "direction_dependent_friction",
        "load_dependent_friction",
        "quadratic_load_friction",
        "backlash",
        "hysteresis",
        "belt_slack",
        "end_stop",
        "transmission_error",
    }
)
"""Effects that change fast: by a switch, or with each tooth of a fast shaft."""

TOUCHING = frozenset({"backlash", "end_stop"})
"""Effects with a contact."""


def fine(truth: Truth) -> float:
    """The step (s) for recordings."""
    return CONTACT_STEP if any(c.effect in TOUCHING for c in truth.concealed) else FINE


def simulator(truth: Truth, signals: Sequence[str], interval: float, step: float = FINE) -> Simulator:
    """The truth, ready to run.

    Args:
        truth: what is simulated.
        signals: measured signals, by their name in the scenario.
        interval: sample interval (s).
        step: longest step of the integration (s). Where all is linear and held between samples, one step per sample
            is exact, and is taken.

    Raises:
        ValueError: effects that exclude each other, or a place the plant does not have.
    """
    input_chain, sensors = InputChain(), {name: SensorChain() for name in signals}
    laws: dict[str, JointLaw] = {}
    link, inductance = LinkOptions(), truth.nuisance.inductance
    shafts: list[Concealed] = []
    gears: list[Concealed] = []
    for c in truth.concealed:
        p = c.parameters
        if c.effect in _INPUT:
            _INPUT[c.effect](input_chain, p)
        elif c.effect == "inductance":
            inductance = p["inductance"]
        elif c.effect in JOINT_LAWS:
            if c.place in laws:
                raise ValueError(f"two effects change the joint '{c.place}'")
            laws[c.place] = _joint_law(c)
        elif c.effect == "transmission_error":
            gears.append(c)
        elif c.effect in ("payload", "centrifugal_stiffening") or (c.effect == "extra_mode" and "modes" in p):
            link = _link(link, c)
        elif c.effect in _SENSOR:
            if c.place not in sensors:
                raise ValueError(f"'{c.place}' is not measured")
            _SENSOR[c.effect](sensors[c.place], p)
        else:
            shafts.append(c)
    input_chain.forward *= 1 + truth.nuisance.gain
    input_chain.backward *= 1 + truth.nuisance.gain
    # The limits are those of the command: a gain error behind them does not hide what goes beyond.
    input_chain.low *= 1 + truth.nuisance.gain
    input_chain.high *= 1 + truth.nuisance.gain
    body = truth.plant.assemble(truth.parameters, laws, link, inductance)
    if input_chain.winding:
        resistance, back_emf = winding(truth)
        input_chain.room, input_chain.emf = input_chain.room * resistance, back_emf
        input_chain.sag /= resistance
        if input_chain.heat:
            input_chain.heat = replace(input_chain.heat, resistance=resistance)
        input_chain.carried = body.mechanism.carries_current
        input_chain.knee *= 1.0 if input_chain.carried else resistance
    for c in shafts:
        if c.place not in body.ports:
            raise ValueError(f"{truth.plant.name} has no shaft '{c.place}'; it has {', '.join(body.ports)}")
        _SHAFT[c.effect](body.mechanism, body.ports[c.place], c.parameters)
    for c in gears:
        _err(body, c, truth.parameters)
    _disturb(body, truth)
    held = input_chain.held and all(c.lag == 0 for c in sensors.values())
    exact = held and not body.mechanism.elements and body.mechanism.whirl is None
    return Simulator(
        body.mechanism,
        [body.signals[name] for name in signals],
        interval,
        1 if exact else max(1, math.ceil(interval / step - 1e-9)),
        input_chain,
        [sensors[name] for name in signals],
    )


def winding(truth: Truth) -> tuple[float, float]:
    """Resistance (ohm) and back-emf constant (V.s/rad) of the motor; the latter is the torque constant if not told."""
    p = truth.parameters
    return p["motor.resistance"], p.get("motor.back_emf_constant", p["motor.torque_constant"])


def coarse(truth: Truth) -> float:
    """A step (s) that is good to a fraction of a noise floor, for searches."""
    effects = {c.effect for c in truth.concealed}
    if effects & TOUCHING:
        return 2.5e-5
    return 1e-4 if effects & _SWITCHING else 2.5e-4


def _disturb(body: Body, truth: Truth) -> None:
    n, port = truth.nuisance, body.ports[truth.plant.main]
    for amplitude, order, phase in n.ripple:
        body.mechanism.add(native.RIPPLE, port, amplitude, order, phase)
    if n.warm_up[0]:
        body.mechanism.add(native.WARM_UP, port, *n.warm_up)
    if n.drift:
        body.mechanism.add(native.SERIES, port, n.drift)


def _limits(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.low, chain.high = p["lower"], p["upper"]


def _current(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.room = p["current_limit"]  # until the winding's resistance is known: it is then a voltage


def _slew(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.slew = p["rate"]


def _steps(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.quantum = p["step"]


def _sag(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.sag = p["resistance"] / p["voltage"] ** 2  # until that of the winding is known


def _heat(chain: InputChain, p: Mapping[str, float]) -> None:
    thermal = ("capacity", "insulation", "housing", "cooling")
    chain.heat = Heat(p["coefficient"], 1.0, *(p[key] for key in thermal))


def _switched(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.lost, chain.knee = p["lost_voltage"], p["ripple_current"]  # until the winding is known


def _dead(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.dead_low, chain.dead_high = p["lower"], p["upper"]


def _uneven(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.forward, chain.backward = p["forward"], p["backward"]


def _offset(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.offset = p["offset"]


def _delay(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.delay = p["delay"]


def _lag(chain: InputChain, p: Mapping[str, float]) -> None:
    chain.lag = 1 / p["corner_frequency"]


_INPUT: dict[str, Callable[[InputChain, Mapping[str, float]], None]] = {
    "dead_zone": _dead,
    "saturation": _limits,
    "uneven_gain": _uneven,
    "offset": _offset,
    "delay": _delay,
    "lag": _lag,
    "current_limit": _current,
    "rate_limit": _slew,
    "command_quantisation": _steps,
    "supply_sag": _sag,
    "warm_up": _heat,
    "dead_time": _switched,
}


def _bias(chain: SensorChain, p: Mapping[str, float]) -> None:
    chain.bias = p["bias"]


def _scale(chain: SensorChain, p: Mapping[str, float]) -> None:
    chain.scale = p["scale"]


def _slow(chain: SensorChain, p: Mapping[str, float]) -> None:
    chain.lag = 1 / p["corner_frequency"]


def _rectify(chain: SensorChain, p: Mapping[str, float]) -> None:
    chain.rectified = True


_SENSOR: dict[str, Callable[[SensorChain, Mapping[str, float]], None]] = {
    "sensor_bias": _bias,
    "sensor_scale": _scale,
    "sensor_lag": _slow,
    "rectified_sensor": _rectify,
}


def _link(link: LinkOptions, c: Concealed) -> LinkOptions:
    if c.effect == "payload":
        return replace(link, payload=c.parameters["payload"])
    if c.effect == "extra_mode":
        return replace(link, modes=round(c.parameters["modes"]))
    return replace(link, centrifugal=True)


def _structural(mechanism: Mechanism, port: Port, stiffness: float, loss_factor: float) -> None:
    """Constant loss factor within a band: Maxwell elements spread evenly in the logarithm of frequency.

    One element g at corner r has the loss modulus g w r / (w^2 + r^2). Elements ln s apart add up to g pi / (2 ln s) at
    every w inside the band, so g = 2 eta k ln s / pi; below its corner an element is slack and above it is stiff.
    """
    low, high = MAXWELL_BAND
    count = round(MAXWELL_PER_DECADE * math.log10(high / low)) + 1
    apart = math.log(high / low) / (count - 1)
    part = 2 * loss_factor * stiffness * apart / math.pi
    mechanism.spring(port, stiffness - part * count / 2)
    for j in range(count):
        mechanism.maxwell(port, part, low * math.exp(j * apart))


JOINT_LAWS = frozenset(
    {"belt_slack", "backlash", "joint_flexibility", "hardening_spring", "hysteresis", "structural_damping"}
)
"""Laws of a joint; each joint obeys one of them."""


def _joint_law(c: Concealed) -> JointLaw:
    p = c.parameters

    def stamp(mechanism: Mechanism, port: Port, stiffness: float, damping: float) -> None:
        if c.effect == "structural_damping":
            _structural(mechanism, port, stiffness, p["loss_factor"])
        elif c.effect == "belt_slack":
            mechanism.add(native.STRANDS, port, stiffness, damping, p["pretension"])
        elif c.effect == "backlash":
            mechanism.add(native.CONTACT, port, stiffness or p["stiffness"], damping or p["damping"], p["half_gap"])
        elif c.effect == "hysteresis":
            k, share = stiffness or p["stiffness"], p["residual_share"]
            mechanism.spring(port, share * k, damping or p["damping"])
            law = (p["yield_twist"], p["sharpness"], p["unloading_share"])
            mechanism.add(native.BOUC_WEN, port, (1 - share) * k, *law)
        else:
            mechanism.spring(port, stiffness or p["stiffness"], damping or p["damping"])
            if c.effect == "hardening_spring":
                mechanism.add(native.CUBIC, port, p["cubic_stiffness"])

    return stamp


def _err(body: Body, c: Concealed, true: Mapping[str, float]) -> None:
    """The transmission error of an elastic gear: angle out = angle in / n + a (sin(k angle in + phi) - sin(phi))."""
    input, twist = body.meshes[c.place]
    law = [true[f"{c.place}.stiffness"], true[f"{c.place}.damping"]]
    law += [c.parameters[key] for key in ("amplitude", "order", "phase")]
    body.mechanism.add(native.MESH, twist, *law)
    body.mechanism.add(native.MESH_INPUT, input, *law)


def _friction(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    forward = p["coulomb_friction"]
    backward = p.get("coulomb_friction_backward", forward)
    static = p.get("static_friction", forward)
    static_backward = static if "static_friction" in p else backward
    mechanism.add(
        native.FRICTION, port, forward, backward, static, static_backward, p.get("stribeck_velocity", 1.0), 0.0, 1.0
    )


def _loaded(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    level, shares = p["coulomb_friction"], (p["coefficient"], p.get("quadratic_coefficient", 0.0))
    mechanism.add(native.FRICTION, port, level, level, level, level, 1.0, 0.0, 1.0, *shares, loaded=True)


def _viscous(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    mechanism.spring(port, 0.0, p["viscous_friction"])


def _drag(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    mechanism.add(native.DRAG, port, p["drag"])


def _gravity(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    mechanism.add(native.GRAVITY, port, p["moment"], p["hanging_angle"])


def _stray(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    mechanism.spring(port, p["stiffness"])
    if p.get("rest_angle"):  # a ripple of order zero is constant
        mechanism.add(native.RIPPLE, port, p["stiffness"] * p["rest_angle"], 0.0, math.pi / 2)


def _ripple(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    mechanism.add(native.RIPPLE, port, p["amplitude"], p["order"], p["phase"])


def _stops(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    mechanism.add(native.END_STOP, port, p["stiffness"], p["damping"], p["lower"], p["upper"])


def _oil(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    law = (p["viscous_friction"], p["coefficient"], p["capacity"], p["resistance"])
    mechanism.add(native.OILED, port, *law)


def _vibration(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    mechanism.add(native.VIBRATION, port, p["amplitude"], 2 * math.pi * p["frequency"], p["phase"])


def _resonator(mechanism: Mechanism, port: Port, p: Mapping[str, float]) -> None:
    body = mechanism.coordinate("resonator")
    if mechanism.released is not None:  # it begins where the body is that carries it
        turned = sum(c * mechanism.released.get(i, 0.0) for i, c in port.sense.items())
        mechanism.released[next(iter(body.sense))] = turned
    mechanism.inertia(body, p["inertia"])
    mechanism.spring(port.against(body), p["stiffness"], p["damping"])


_SHAFT: dict[str, Callable[[Mechanism, Port, Mapping[str, float]], None]] = {
    "coulomb_friction": _friction,
    "stribeck_friction": _friction,
    "direction_dependent_friction": _friction,
    "load_dependent_friction": _loaded,
    "quadratic_load_friction": _loaded,
    "viscous_friction": _viscous,
    "quadratic_drag": _drag,
    "gravity": _gravity,
    "stray_spring": _stray,
    "torque_ripple": _ripple,
    "cogging": _ripple,
    "outside_vibration": _vibration,
    "end_stop": _stops,
    "friction_warm_up": _oil,
    "extra_mode": _resonator,
}
