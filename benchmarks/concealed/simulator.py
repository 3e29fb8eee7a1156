"""One mechanism, discretised, with its input and sensor chains: runs recordings through the C simulator."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.concealed import native
from benchmarks.concealed.mechanism import Mechanism, Readout, discretise

Array = NDArray[np.float64]


class Diverged(Exception):
    """The truth ran away."""


@dataclass(frozen=True)
class Heat:
    """A winding that warms up in a housing, both at the temperature around at first.

    Attributes:
        coefficient: rise of the resistance per kelvin (1/K).
        resistance: when cold (ohm).
        capacity, insulation: of the winding, and from it to the housing (J/K, K/W).
        housing, cooling: of the housing, and from it to the surroundings (J/K, K/W).
    """

    coefficient: float
    resistance: float
    capacity: float
    insulation: float
    housing: float
    cooling: float


@dataclass
class InputChain:
    """What happens to the command on its way to the actuator, in this order.

    Steps of ``quantum``, delay, fastest change ``slew`` (1/s), first-order lag, gain (one per direction), offset,
    limits, dead zone. Then what the winding of a motor makes of it: a supply of which ``sag`` is the resistance over
    that of the winding and the square of its voltage (1/V2); a dead time that takes ``lost`` (V) against the current,
    all of it above ``knee`` (A where the current is ``carried`` by an inductance, else V in the winding); a winding
    that warms up; the limit of its current, with which the voltage stays within ``room`` of ``emf`` times the speed.
    """

    forward: float = 1.0
    backward: float = 1.0
    offset: float = 0.0
    low: float = -1e12
    high: float = 1e12
    dead_low: float = 0.0
    dead_high: float = 0.0
    lag: float = 0.0
    delay: float = 0.0
    room: float = 0.0
    emf: float = 0.0
    slew: float = 0.0
    quantum: float = 0.0
    sag: float = 0.0
    lost: float = 0.0
    knee: float = 0.0
    carried: bool = False
    heat: Heat | None = None

    def row(self) -> Array:
        """As the C code wants it."""
        law = [self.forward, self.backward, self.offset, self.low, self.high, self.dead_low, self.dead_high]
        chain = [self.lag, self.delay, self.room, self.emf, self.slew, self.quantum, self.sag]
        dead = [self.lost, self.knee, float(self.carried)]
        return np.array([*law, *chain, *dead, *(astuple(self.heat) if self.heat else [0.0] * len(fields(Heat)))])

    @property
    def winding(self) -> bool:
        """Whether the current in a motor's winding matters."""
        return self.room > 0 or self.sag > 0 or self.lost > 0 or self.heat is not None

    @property
    def held(self) -> bool:
        """Whether the actuator gets what is held from one sample to the next."""
        return self.lag == self.delay == self.slew == 0 and not self.winding


@dataclass
class SensorChain:
    """What happens to a measured quantity, in this order: first-order lag, scale, bias, loss of sign."""

    lag: float = 0.0
    scale: float = 1.0
    bias: float = 0.0
    rectified: bool = False


@dataclass
class Loop:
    """A sampled controller on one sensor: u = kp e + ki int e - kd dy/dt, limited and rounded."""

    sensor: int
    kp: float
    ki: float
    kd: float
    limit: float
    resolution: float
    filter: float = 0.01


@dataclass
class Run:
    """What came out: shape (samples, sensors) each; ``states`` (samples, states) if asked for."""

    command: Array
    clean: Array
    measured: Array
    states: Array | None = None


@dataclass
class Simulator:
    """A mechanism at one step size. ``start`` of a run is the session's clock, for what warms up.

    Attributes:
        mechanism: the physics.
        readouts: quantities that sensors measure.
        interval: sample interval (s).
        substeps: steps in one interval.
        input, sensors: signal chains.
    """

    mechanism: Mechanism
    readouts: Sequence[Readout]
    interval: float
    substeps: int
    input: InputChain = field(default_factory=InputChain)
    sensors: Sequence[SensorChain] = ()

    def __post_init__(self) -> None:
        """Discretise once; runs share it."""
        m = self.mechanism
        A, B = m.state_space()
        h = self.interval / self.substeps
        self.A, self.B = A, B
        self.sensors = list(self.sensors) or [SensorChain() for _ in self.readouts]
        pairs = [m.readout(sensor, A, B) for sensor in self.readouts]
        sense, rate, self._kind, parameters = m.rows(A, B)
        self._arrays = {
            "C": np.array([c for c, _ in pairs]),
            "D": np.array([d for _, d in pairs]),
            "sense": sense,
            "rate": rate,
            "parameter": parameters,
            "input": self.input.row(),
            "sensor": np.array([[c.lag, c.scale, c.bias, float(c.rectified)] for c in self.sensors]),
            "x0": np.zeros(len(A)),
        }
        if any(element.loaded for element in m.elements):
            self._arrays["load"], self._arrays["load_feed"] = m.loads(A)
        if self.input.winding:
            self._arrays["turning"] = m.turning(A, B)
        self._arrays["phi"], self._arrays["gamma"] = discretise(A, B, h)
        self._arrays["phi_half"], self._arrays["gamma_half"] = discretise(A, B, h / 2)
        self._modes = 0
        if m.whirl:
            hub = m.readout(Readout(m.whirl.hub.sense, 1), A, B)[0]
            row, feed = m.readout(Readout(m.whirl.hub.sense, 2), A, B)
            amplitudes = [Readout(p.sense) for p in m.whirl.amplitudes]
            self._modes = len(amplitudes)
            self._arrays |= {
                "whirl_speed": hub,
                "whirl_a": row,
                "whirl_b": feed,
                "whirl_amplitude": np.array([m.readout(a, A, B)[0] for a in amplitudes]),
                "whirl_rate": np.array([m.readout(Readout(a.sense, 1), A, B)[0] for a in amplitudes]),
                "whirl_H": np.asarray(m.whirl.H, dtype=float),
            }

    def at(self, angle: float) -> Array:
        """The state at rest, turned by an angle: all coordinates, or those that the mechanism says are let go."""
        x, released = np.zeros(len(self.A)), self.mechanism.released
        x[: len(self.mechanism.names)] = angle
        if released is not None:
            x[: len(self.mechanism.names)] = [angle * released.get(i, 0.0) for i in range(len(self.mechanism.names))]
        return x

    def run(
        self,
        command: Array,
        *,
        start: float = 0.0,
        noise: Array | None = None,
        quantum: Sequence[float] | None = None,
        drift: Array | None = None,
        series: Array | None = None,
        loop: Loop | None = None,
        states: bool = False,
        initial: Array | None = None,
    ) -> Run:
        """Simulate one recording.

        Args:
            command: value held from each sample to the next, shape (samples,); in a loop the reference.
            start: clock of the session at the first sample (s).
            noise: added to the sensors before they count, shape (samples, sensors).
            quantum: step of sensors that count, 0 for the others.
            drift: added to the sensors, shape (samples, sensors).
            series: disturbance torque of a SERIES element, shape (samples + 1,).
            loop: controller; the command is then computed.
            states: also return the states.
            initial: state at the first sample; rest at zero if absent.

        Raises:
            Diverged: the state grew beyond all bounds.
        """
        samples, ny = len(command), len(self.readouts)
        nothing = np.zeros((samples, ny))
        out = Run(
            np.zeros(samples) if loop else np.array(command, dtype=float),
            np.zeros((samples, ny)),
            np.zeros((samples, ny)),
            np.zeros((samples, len(self.A))) if states else None,
        )
        arrays: dict[str, Any] = self._arrays | {
            "series": np.zeros(samples + 1) if series is None else series,
            "drift": nothing if drift is None else drift,
            "noise": nothing if noise is None else noise,
            "quantum": np.zeros(ny) if quantum is None else np.asarray(quantum, dtype=float),
            "command": out.command,
            "clean": out.clean,
            "measured": out.measured,
            "trace": out.states,
        }
        if initial is not None:
            arrays["x0"] = np.asarray(initial, dtype=float)
        if loop:
            gains = [loop.sensor, loop.kp, loop.ki, loop.kd, loop.filter, loop.limit, loop.resolution]
            arrays |= {"loop": np.array(gains, dtype=float), "reference": np.asarray(command, dtype=float)}
        plan = native.Plan(
            states=len(self.A),
            forces=self.B.shape[1],
            elements=len(self.mechanism.elements),
            outputs=ny,
            modes=self._modes,
            substeps=self.substeps,
            samples=samples,
            closed=int(loop is not None),
            step=self.interval / self.substeps,
            start=start,
        )
        held = []
        for name, value in arrays.items():
            if value is not None:
                array = np.ascontiguousarray(value, dtype=float)
                held.append(array)
                setattr(plan, name, array.ctypes.data_as(ctypes.POINTER(ctypes.c_double)))
        plan.kind = self._kind.ctypes.data_as(ctypes.POINTER(ctypes.c_int))
        problem = native.library().concealed_simulate(ctypes.byref(plan))
        if problem == 1:
            raise ValueError(f"{len(self.A)} states and {self.B.shape[1]} forces are more than simulator.c takes")
        if problem:
            raise Diverged("the truth left all bounds")
        return out
