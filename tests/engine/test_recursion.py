"""Velocities built on one another: the same arm as one energy in its joint angles and as a recursion of bodies."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from engine import recursion
from engine.assemble import build
from engine.block import Block, flange, option, signal_out
from engine.errors import StructureError
from engine.linearise import linearise
from engine.net import Net
from engine.simulate import simulate
from tests.engine.parts import Anchor, Body, Dry, Gearing, Imposed, Push, Spring, Swing, Wave, system

LENGTHS, MASSES, HUBS, PULL = (0.5, 0.4, 0.3), (0.7, 0.5, 0.9), (0.0, 0.02, 0.01), 9.81


class Arm(Block):
    """Three point masses on massless rods in a vertical plane, one hinged to the next."""

    recursive = option(bool, True, "by recursion over the bodies")
    weightless = option(bool, False, "without the last body's inertia")
    j1 = flange("first joint")
    j2 = flange("second joint")
    j3 = flange("third joint")
    height = signal_out("m", "height of the end")

    def stamp(self, net: Net) -> None:
        joints = (self.j1, self.j2, self.j3)
        masses = (*MASSES[:2], 0.0 if self.weightless else MASSES[2])
        hubs = (*HUBS[:2], 0.0 if self.weightless else HUBS[2])
        angle, x, y, above = 0, 0, 0, []
        for joint, length in zip(joints, LENGTHS, strict=True):
            angle = angle + joint.angle
            x, y = x + length * ca.sin(angle), y - length * ca.cos(angle)
            above.append((x, y, angle))
        net.output(self.height, y)
        potential = PULL * sum(m * y for m, (_, y, _) in zip(masses, above, strict=True))
        net.potential(joints, potential)
        if not self.recursive:
            q, v = ca.vertcat(*[j.angle for j in joints]), ca.vertcat(*[j.speed for j in joints])
            energy = 0
            for m, hub, (x, y, angle) in zip(masses, hubs, above, strict=True):
                rate = ca.jtimes(ca.vertcat(x, y, angle), q, v)
                energy += m * (rate[0] ** 2 + rate[1] ** 2) / 2 + hub * rate[2] ** 2 / 2
            net.kinetic(joints, energy)
            return
        turn: Any = self.j1
        along: Any = None
        across: Any = None
        for i, (joint, length) in enumerate(zip(joints, LENGTHS, strict=True)):
            if i:
                c, s = ca.cos(joint.angle), ca.sin(joint.angle)
                turned = net.velocity(f"turn{i}", {turn: 1.0, joint: 1.0})
                base, terms = across, {across: s}
                if along is not None:
                    terms[along] = c
                along, across = net.velocity(f"along{i}", terms), net.velocity(f"across{i}", {base: c})
                if len(terms) > 1:
                    old = next(m for m in terms if m is not base)
                    across = net.velocity(f"sideways{i}", {across: 1.0, old: -s})
                turn = turned
            end = net.velocity(f"end{i}", {turn: length} if across is None else {turn: length, across: 1.0})
            net.inertia(turn, hubs[i])
            self._point(net, masses[i], turn, along, end)
            across = end

    def _point(self, net: Net, mass: Any, turn: Any, along: Any, across: Any) -> None:
        net.inertia(across, mass)
        if along is not None:
            net.inertia(along, mass)
            net.force(along, mass * turn.speed * across.speed)
            net.force(across, -mass * turn.speed * along.speed)


def both(blocks: Any, *wires: Any, stop: float = 1.0, initial: Any = None, **keys: Any) -> Any:
    """Two runs: recursive, and by one energy."""
    runs = []
    for recursive in (True, False):
        parts = {**blocks, "arm": Arm(recursive=recursive)}
        model = build(system(parts, *wires), energy=True)
        runs.append(simulate(model, stop, 1e-2, internal_step=5e-4, initial=initial or {}, **keys))
    return runs


def same(runs: Any, tolerance: Any) -> None:
    a, b = runs
    for name in a.names:
        if name.startswith("energy.residual"):
            continue
        scale = max(1.0, np.abs(b[name]).max())
        assert np.abs(a[name] - b[name]).max() < tolerance * scale, name
    assert [event[1:] for event in a.events] == [event[1:] for event in b.events]


START = {"arm.j1.angle": 1.0, "arm.j2.angle": -0.7, "arm.j3.angle": 0.4, "arm.j2.speed": 2.0}


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_a_free_arm_moves_alike_either_way_and_conserves_its_energy(backend: str) -> None:
    runs = both({}, stop=1.0 if backend == "c" else 0.05, initial=START, backend=backend)
    same(runs, 1e-9)
    assert np.ptp(runs[0]["energy.stored"]) < 1e-8


def test_rotors_behind_gears_with_losses_count_at_their_joints() -> None:
    blocks = {
        "w": Wave(amplitude=0.5, frequency=3.0),
        "t": Push(),
        "m": Body(inertia=1e-4),
        "g": Gearing(ratio=30, efficiency=0.7),
        "n": Body(inertia=2e-4),
        "h": Gearing(ratio=20, efficiency=0.9),
    }
    wires = (
        ("w.out", "t.in"),
        ("t.shaft", "m.shaft", "g.input"),
        ("g.output", "arm.j2"),
        ("n.shaft", "h.input"),
        ("h.output", "arm.j3"),
    )
    runs = both(blocks, *wires, initial={"arm.j1.angle": 0.5})
    same(runs, 1e-9)
    residual = runs[0]["energy.residual"]
    assert np.ptp(residual) < 1e-7 * np.ptp(runs[0]["energy.supplied"])


def test_stuck_and_slipping_joints_have_the_same_instants() -> None:
    blocks = {"f": Dry(level=1.5, static=2.0), "k": Dry(level=0.5), "s": Spring(stiffness=3.0), "a": Anchor()}
    wires = (("f.shaft", "arm.j2"), ("k.shaft", "arm.j3", "s.a"), ("s.b", "a.shaft"))
    runs = both(blocks, *wires, stop=2.0, initial={"arm.j1.angle": 1.2, "arm.j2.angle": 0.5, "arm.j3.angle": -0.8})
    same(runs, 1e-8)
    assert {event[1] for event in runs[0].events} == {"f", "k"}
    assert len(runs[0].events) >= 4
    assert np.abs([a[0] - b[0] for a, b in zip(runs[0].events, runs[1].events, strict=True)]).max() < 1e-9


def test_an_imposed_joint_has_the_same_reaction() -> None:
    blocks = {"a": Swing(amplitude=0.4, frequency=5.0), "i": Imposed()}
    wires = (("a.out", "i.in"), ("i.shaft", "arm.j2"))
    runs = both(blocks, *wires, initial={"arm.j3.angle": 0.3})
    same(runs, 1e-9)
    assert np.ptp(runs[0]["i.reaction"]) > 1


def test_a_joint_tied_to_the_ground_stays() -> None:
    runs = both({"a": Anchor()}, ("a.shaft", "arm.j2"), initial={"arm.j1.angle": 1.0, "arm.j3.angle": 0.5})
    same(runs, 1e-9)
    assert (runs[0]["arm.j2.angle"] == 0).all()


def test_a_stuck_joint_leaves_the_linear_model() -> None:
    wires = (("f.shaft", "arm.j2"),)
    found = [
        linearise(build(system({"f": Dry(level=1.0), "arm": Arm(recursive=r)}, *wires)), modes={"f": "stuck"}).poles()
        for r in (True, False)
    ]
    assert len(found[0]) == 4
    assert np.abs(found[0] - found[1]).max() < 1e-9


def test_a_weightless_end_is_refused_by_name() -> None:
    with pytest.raises(StructureError, match=r"the motion of arm.j3 has no inertia"):
        build(system({"arm": Arm(weightless=True)}))


def test_a_gear_with_losses_in_a_loop_with_the_arm_is_refused() -> None:
    blocks = {"arm": Arm(), "g": Gearing(ratio=2, efficiency=0.5)}
    with pytest.raises(StructureError, match="closes a loop around a gear with losses"):
        build(system(blocks, ("g.input", "arm.j1"), ("g.output", "arm.j2")))


def test_the_recursion_solves_a_constrained_minimum() -> None:
    """Against the equations with multipliers, solved densely."""
    rng = np.random.default_rng(7)
    n, k = 5, 4
    root = rng.normal(size=(n + k, n + k))
    M, f, b = root @ root.T, rng.normal(size=n + k), rng.normal(size=k)
    C = np.zeros((k, n + k))
    for i in range(k):
        C[i, rng.choice(n + i, 3, replace=False)] = rng.normal(size=3)
    constraint = np.hstack([-C[:, :n], np.eye(k) - C[:, n:]])
    kkt = np.block([[M, constraint.T], [constraint, np.zeros((k, k))]])
    exact = np.linalg.solve(kkt, np.concatenate([f, b]))
    found = recursion.solve(ca.SX(M), ca.SX(f), ca.SX(C), ca.SX(b))
    z = np.array(ca.DM(ca.Function("z", [], [found])()["o0"])).ravel()
    np.testing.assert_allclose(z, exact[: n + k], rtol=1e-9, atol=1e-11)
    left = recursion.gather(ca.SX(M @ z - f), ca.SX(C))
    assert np.abs(np.array(ca.Function("r", [], [left])()["o0"])).max() < 1e-9
    basis = np.vstack([np.eye(n), np.zeros((k, n))])
    for i in range(k):
        basis[n + i] = C[i] @ basis
    np.testing.assert_allclose(recursion.condense(M, C), basis.T @ M @ basis, rtol=1e-12)
