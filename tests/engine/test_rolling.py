"""What repeats is written as loops, which compute the same as straight lines to the bit; byte code knows no loops."""

from __future__ import annotations

import ctypes
import math
import re
from typing import Any

import casadi as ca
import numpy as np
import pytest

from engine import bytecode, codegen, native
from engine.codegen import INCLUDES, Emitter, runtime, simulation_source
from engine.compile import library
from engine.rolling import Line, Section, sections
from engine.simulate import simulate
from engine.statements import even
from scenarios.load import load
from tests.engine.test_bytecode import _INTERPRETED, _WRAPPED


def _row(count: int, period: int, lag: int) -> list[Line]:
    """Turns of some lines, of which the first reads the last of the turn before, and the others the line before."""
    lines = []
    for k in range(count * period):
        slot = k % period
        read = k - 1 if slot else k - lag * period + period - 1
        lines.append(Line(slot, (read if read >= 0 else None,)))
    return lines


def test_a_row_of_turns_is_one_section() -> None:
    before = [Line(("before", k), ()) for k in range(7)]
    lines = [
        *before,
        *(Line(line.shape, tuple(r if r is None else r + 7 for r in line.reads)) for line in _row(9, 30, 1)),
    ]
    assert sections(lines) == [Section(7, 30, 9)]
    assert sections(lines[: 7 + 60]) == []


def test_a_turn_unlike_the_others_parts_a_section() -> None:
    lines = _row(10, 30, 1)
    lines[150 + 3] = Line(3, (0,))
    assert [(s.first, s.turns) for s in sections(lines)] == [(0, 5), (180, 4)]


def test_what_reads_the_turn_before_last_is_left_as_it_is() -> None:
    assert sections(_row(10, 30, 2)) == []


def test_places_are_even_or_not() -> None:
    assert even([3, 5, 7]) == (3, 2)
    assert even([7, 6, 5]) == (7, -1)
    assert even([1, 2, 4]) is even([2, 2, 2]) is even([-1, 0, 1]) is None


def _chain(random: np.random.Generator, links: int, odd: int | None) -> tuple[Any, list[Any]]:
    """Results and arguments of a chain with two passes, there and back; link ``odd`` differs from the others."""
    t, x, m, p = ca.SX.sym("t"), ca.SX.sym("x", 2 * links), ca.SX.sym("m", links), ca.SX.sym("p", 3 * links)
    weights = random.uniform(0.5, 1.5, 40)
    choices = random.integers(0, 4, 40)
    there: list[Any] = []
    speed, turned = t * 0.1, ca.sin(t)
    for i in range(links):
        q, v, a, b, c = x[i], x[2 * links - 1 - i], p[3 * i], p[3 * i + 1], p[3 * links - 1 - 3 * i]
        s = ca.if_else(m[i] != 0, ca.exp(-v * v) * a, 0.0)
        value = q
        for k in range(30):
            others = (v * a, speed / b, turned * c, s)
            value = weights[k] * value + others[choices[k]] if k % 3 else ca.cos(value) * others[choices[k]]
        if i == odd:
            value = value * value + 1.0
        speed, turned = 0.5 * speed + value, 0.25 * turned - ca.sin(value) * v
        there.append((speed, turned, value))
    back, results = ca.SX(0.3), []
    for i in reversed(range(links)):
        speed, turned, value = there[i]
        before = there[i - 1][0] if i else t
        for k in range(25):
            back = ca.sin(back) * (speed, turned, value, before)[choices[k]] - weights[k] * back / p[3 * i]
        results.append(back)
    results = [*results, *(there[i][2] for i in range(links)), *(there[i][0] for i in random.permutation(links))]
    empty = ca.SX(0, 1)
    return ca.vertcat(*results), [t, x, empty, empty, m, p, empty]


@pytest.mark.parametrize("seed", range(6))
def test_loops_compute_the_same_to_the_bit(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codegen, "_INLINED", 0)
    random, links = np.random.default_rng(seed), 11
    expression, arguments = _chain(random, links, odd=[None, 0, 5, 10, 1, 7][seed])
    emitter = Emitter()
    emitter.add("derivative", arguments, expression)
    code = bytecode.Code()
    code.struct.nx, code.struct.np, code.struct.nf = 2 * links, 3 * links, links
    assert bytecode._programs(code, emitter)
    text = emitter.text()
    assert len(re.findall(r"for \(int k = 0; k < \d+; k\+\+\)", text)) >= 2
    own = library(INCLUDES + runtime("functions.c") + text + _WRAPPED)
    source = bytecode.source()
    general = library(source[: source.index(runtime("core.c"))] + _INTERPRETED)
    for _ in range(20):
        given = [random.normal(0, 1, 2 * links), random.integers(-1, 2, links) * 1.0, random.uniform(0.5, 2, 3 * links)]
        found = np.zeros((2, expression.numel()))
        arrays = [array.ctypes.data_as(ctypes.c_void_p) for array in given]
        own.both(*arrays, ctypes.c_void_p(found[0].ctypes.data))
        general.both(*arrays, ctypes.c_void_p(found[1].ctypes.data), ctypes.c_void_p(code.address))
        assert found[0].tobytes() == found[1].tobytes()
        assert np.isfinite(found).mean() > 0.9


_ARM = """
schema: 1
name: arm
blocks:
  torque: {{type: Sine, amplitude: 1 mN.m, frequency: 3 Hz}}
  drive: {{type: Torque}}
  arm: {{type: SerialArm, links: {links}, modes: 2, length: 0.2 m, mass: 20 g, flexural_rigidity: 0.05 N.m2,
         hub_inertia: 5e-5 kg.m2, viscous_friction: 1e-3 N.m.s/rad, damping_ratio: 0.01}}
{frictions}
connect:
  - [torque.out, drive.torque]
  - [drive.shaft, arm.joint1]
{wires}
simulate: {{stop: 0.2 s, record: [arm.joint1.angle, arm.joint2.angle]}}
"""


def _arm(links: int) -> Any:
    joints = range(2, links + 1)
    frictions = "\n".join(
        f"  f{i}: {{type: BearingFriction, coulomb_friction: 2 uN.m, static_friction: 3 uN.m,"
        " stribeck_velocity: 0.01 rad/s}"
        for i in joints
    )
    wires = "\n".join(f"  - [f{i}.shaft, arm.joint{i}]" for i in joints)
    return load("reference-c", text=_ARM.format(links=links, frictions=frictions, wires=wires)).build()


def test_an_arm_whose_joints_stick_runs_the_same_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    model, made = _arm(7), []
    assert "for (int k = 0; k < " in simulation_source(model).split("fa_prepare_modes")[1].split("fa_rk4")[0]
    for enough in (math.inf, -math.inf):
        native.forget()
        monkeypatch.setattr(native, "ENOUGH", enough)
        monkeypatch.setattr(native, "LOOK", math.inf)
        made.append(simulate(model, 0.2, 1e-3, record_states=True))
    native.forget()
    one, other = made
    assert one.events == other.events
    assert len(one.events) > 10
    assert one.values.tobytes() == other.values.tobytes()
    assert one.final_state.tobytes() == other.final_state.tobytes()


def test_twice_the_links_take_hardly_more_code() -> None:
    small, large = (len(simulation_source(_arm(links))) for links in (8, 16))
    assert large < 1.25 * small
