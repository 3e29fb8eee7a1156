"""Smallest possible blocks, so that the engine is tested without the library."""

from __future__ import annotations

from typing import Any

import casadi as ca

from engine.block import Block, flange, option, parameter, signal_in, signal_out
from engine.errors import Where
from engine.net import Net
from engine.system import Connection, System


class Body(Block):
    """Inertia."""

    inertia = parameter("kg.m2", ..., "moment of inertia", gt=0)
    shaft = flange("the body")

    def stamp(self, net: Net) -> None:
        net.inertia(self.shaft, self.inertia)


class Gearing(Block):
    """Ideal or lossy gear."""

    ratio = parameter("1", ..., "input speed over output speed", gt=0)
    efficiency = parameter("1", 1.0, "share of power that arrives", gt=0, le=1)
    input = flange("fast side")
    output = flange("slow side")

    def stamp(self, net: Net) -> None:
        net.tie({self.input: 1, self.output: -self.ratio}, (self.input, self.output, self.efficiency))


class Spring(Block):
    """Torsion spring with a damper."""

    stiffness = parameter("N.m/rad", ..., "stiffness", ge=0)
    damping = parameter("N.m.s/rad", 0.0, "damping", ge=0)
    a = flange("one end")
    b = flange("other end")

    def stamp(self, net: Net) -> None:
        twist, rate = self.a.angle - self.b.angle, self.a.speed - self.b.speed
        net.potential([self.a, self.b], self.stiffness * twist**2 / 2)
        net.pair(self.a, self.b, -self.damping * rate)
        net.dissipate(self.damping * rate**2)


class Anchor(Block):
    """Holds a flange."""

    shaft = flange("held")

    def stamp(self, net: Net) -> None:
        net.tie({self.shaft: 1})


class Dry(Block):
    """Coulomb friction to ground."""

    level = parameter("N.m", ..., "kinetic level", ge=0)
    static = parameter("N.m", 0.0, "static level; at least the kinetic one", ge=0)
    shaft = flange("braked")

    def stamp(self, net: Net) -> None:
        static = ca.fmax(self.static, self.level)
        net.friction(
            {self.shaft: 1},
            forward=lambda v: self.level,
            backward=lambda v: self.level,
            static_forward=static,
            static_backward=static,
        )


class Clutch(Block):
    """Coulomb friction between two flanges."""

    level = parameter("N.m", ..., "level", ge=0)
    a = flange("one side")
    b = flange("other side")

    def stamp(self, net: Net) -> None:
        net.friction(
            {self.a: 1, self.b: -1},
            forward=lambda v: self.level,
            backward=lambda v: self.level,
            static_forward=self.level,
            static_backward=self.level,
        )


class Push(Block):
    """Torque from a signal."""

    value = signal_in("N.m", "torque", name="in")
    shaft = flange("pushed")

    def stamp(self, net: Net) -> None:
        net.force(self.shaft, self.value)
        net.supply(self.value * self.shaft.speed)


class Wave(Block):
    """Sine."""

    amplitude = parameter("N.m", 1.0, "amplitude")
    frequency = parameter("rad/s", 1.0, "angular frequency")
    phase = parameter("rad", 0.0, "phase")
    out = signal_out("N.m", "sine")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.amplitude * ca.sin(self.frequency * net.time + self.phase))


class Jump(Block):
    """Step at a located instant."""

    height = parameter("N.m", 1.0, "height")
    start = parameter("s", 0.5, "instant")
    out = signal_out("N.m", "step")

    def stamp(self, net: Net) -> None:
        count = net.time_event("count", lambda k: ca.if_else(k == 0, self.start, ca.inf))
        net.output(self.out, self.height * (count > 0))


class Scale(Block):
    """Gain on any signal, or its square."""

    gain = parameter("1", 1.0, "gain")
    square = option(bool, False, "square instead")
    value = signal_in("*", "value", name="in")
    out = signal_out("*", "scaled")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.gain * (self.value**2 if self.square else self.value))


class Feed(Block):
    """Torque proportional to an acceleration."""

    gain = parameter("kg.m2", 1.0, "gain")
    value = signal_in("rad/s2", "acceleration", name="in")
    out = signal_out("N.m", "torque")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.gain * self.value)


class Held(Block):
    """Sampled gain."""

    gain = parameter("1", 1.0, "gain")
    period = parameter("s", 0.01, "period", gt=0, structural=True)
    offset = parameter("s", 0.0, "offset", ge=0, structural=True)
    value = signal_in("*", "value", name="in")
    out = signal_out("*", "held")

    def stamp(self, net: Net) -> None:
        clock = net.clock(self.period, self.offset)
        held = net.memory("held", "1", clock, held=True)
        net.update(held, self.gain * self.value)
        net.output(self.out, held)


class Count(Block):
    """Sampled sum of its input; the output is the sum after the present sample."""

    period = parameter("s", 0.01, "period", gt=0, structural=True)
    value = signal_in("*", "value", name="in")
    out = signal_out("*", "sum")

    def stamp(self, net: Net) -> None:
        clock = net.clock(self.period)
        total = net.memory("total", "1", clock)
        out = net.memory("out_held", "1", clock, held=True)
        net.update(out, total + self.value)
        net.update(total, total + self.value)
        net.output(self.out, out)


class Lag(Block):
    """First-order low-pass."""

    corner = parameter("rad/s", 10.0, "corner", gt=0)
    value = signal_in("*", "value", name="in")
    out = signal_out("*", "lagged")

    def stamp(self, net: Net) -> None:
        y = net.state("y", "1")
        net.derivative(y, self.corner * (self.value - y))
        net.output(self.out, y)


class Rest(Block):
    """Elastic stop: pushes back beyond a gap on either side."""

    stiffness = parameter("N.m/rad", ..., "stiffness", gt=0)
    damping = parameter("N.m.s/rad", 0.0, "damping", ge=0)
    gap = parameter("rad", ..., "half gap", ge=0)
    shaft = flange("stopped")

    def stamp(self, net: Net) -> None:
        angle, speed = self.shaft.angle, self.shaft.speed

        def face(side: float) -> tuple[Any, Any]:
            depth = side * angle - self.gap
            return depth, self.stiffness * depth + self.damping * side * speed

        def guards(mode: Any) -> tuple[Any, Any]:
            (up, push), (down, pull) = face(1.0), face(-1.0)
            leave = ca.if_else(mode > 0, -push, -pull)
            return ca.if_else(mode == 0, ca.fmin(up, push), leave), ca.if_else(mode == 0, ca.fmin(down, pull), -1)

        mode = net.switch("contact", ("below", "open", "above"), guards)
        net.force(self.shaft, -(mode > 0) * face(1.0)[1] + (mode < 0) * face(-1.0)[1])


class Imposed(Block):
    """Imposes an angle that is a formula of time."""

    value = signal_in("rad", "angle", name="in")
    reaction = signal_out("N.m", "torque that imposes it")
    shaft = flange("moved")

    def stamp(self, net: Net) -> None:
        torque = net.prescribe(self.shaft, self.value)
        net.output(self.reaction, torque)
        net.supply(torque * self.shaft.speed)


class Swing(Block):
    """Sine angle."""

    amplitude = parameter("rad", 1.0, "amplitude")
    frequency = parameter("rad/s", 1.0, "angular frequency")
    out = signal_out("rad", "sine")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.amplitude * ca.sin(self.frequency * net.time))


def system(blocks: dict[str, Block], *wires: tuple[str, ...], **more: object) -> System:
    """A system whose connections know a line each."""
    connections = [Connection(ends, Where("test.yaml", 10 + i, f"connect[{i}]")) for i, ends in enumerate(wires)]
    return System(blocks, connections, **more)  # type: ignore[arg-type]
