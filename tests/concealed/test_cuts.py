"""Rigs that are cut otherwise than drawn: against formulas, against the drawn cut, and against flexarm."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.concealed.case import draw
from benchmarks.concealed.drawing import choose_sensors, make_bench
from benchmarks.concealed.effects import Concealed
from benchmarks.concealed.mechanism import Mechanism, Port
from benchmarks.concealed.plants.base import LinkOptions, Sensor
from benchmarks.concealed.rigs.drawn import made
from benchmarks.concealed.rigs.rig import Rig
from benchmarks.concealed.rigs.topology import Probe, Topology, Transmission
from benchmarks.concealed.rigs.ways import WAYS, ways
from benchmarks.concealed.scenario import text
from benchmarks.concealed.truth import Truth
from diagnosis.effects.places import splits
from scenarios.load import load
from tests.concealed.flexarm_side import clean, difference
from tests.concealed.rig_side import simulated
from tests.concealed.test_rigs import QUIET, steady

INERTIA = {"rotor.inertia": 1.0, "hub.inertia": 2.0, "load.inertia": 3.0}
NODE = ["drive.shaft", "rotor.shaft", "hub.shaft", "load.shaft"]
HUB, LOAD, BOTH = frozenset({"hub.shaft"}), frozenset({"load.shaft"}), frozenset({"hub.shaft", "load.shaft"})


def rig(nodes: Any = (NODE,), between: Any = (), drawn_after: int = 2) -> Rig:
    """Three bodies, 1, 2 and 3 kg.m2; an encoder on the last."""
    t = Topology(False, "N.m", [list(node) for node in nodes], list(between))
    t.bodies = {f"{name}.shaft": name for name in ("rotor", "hub", "load")}
    t.cuts = [drawn_after] + [0] * (len(nodes) - 1)
    t.probes = [Probe("angle", "load.shaft", "load.shaft")]
    made_ = Rig("three", t, INERTIA, dict.fromkeys(INERTIA, "kg.m2"), {}, {})
    made_.sensors = (Sensor("load.shaft.angle", "enc", "count", counts=4096),)
    made_.sites = made_.find_sites()
    return made_


def stiff(k: float) -> Any:
    """The law of a spring without damper."""

    def law(m: Mechanism, port: Port, stiffness: float, damping: float) -> None:
        m.spring(port, k)

    return law


def frequencies(plant: Rig, laws: Any) -> Any:
    """Eigenfrequencies above zero (rad/s), the lowest first."""
    A, _ = plant.assemble(INERTIA, laws, LinkOptions(), 0.0).mechanism.state_space()
    w = np.abs(np.linalg.eigvals(A).imag)
    return np.sort(w[w > 1e-3])[::2]


GEAR = (["drive.shaft", "rotor.shaft", "hub.shaft", "gear1.input"], ["gear1.output", "load.shaft"])


@pytest.mark.parametrize(
    ("nodes", "far", "near_inertia", "far_inertia"),
    [
        ((NODE,), HUB, 4.0, 2.0),
        ((NODE,), LOAD, 3.0, 3.0),
        ((NODE,), BOTH, 1.0, 5.0),
        (GEAR, HUB, 1.0 + 3.0 / 5**2, 2.0),
        (GEAR, frozenset({"hub.shaft", "gear1.input"}), 1.0, 2.0 + 3.0 / 5**2),
        (GEAR, frozenset({"gear1.input"}), 3.0, 3.0 / 5**2),
    ],
    ids=["dangles", "last", "goes on", "dangles before a gear", "goes on to a gear", "the gear alone"],
)
def test_a_cut_node_rings_as_two_bodies_on_a_spring(
    nodes: Any, far: Any, near_inertia: float, far_inertia: float
) -> None:
    """w^2 = k (1/J1 + 1/J2), whichever flanges are on the far side."""
    between = [Transmission("gear", "gear1", 5.0)] if len(nodes) > 1 else []
    cut = rig(nodes, between).also_cut({"x": (0, far)})
    (w,) = frequencies(cut, {"x": stiff(70.0)})
    assert w == pytest.approx(math.sqrt(70.0 * (1 / near_inertia + 1 / far_inertia)), rel=1e-9)
    assert len(frequencies(cut, {})) == 0


@pytest.mark.parametrize(
    ("one", "other", "K"),
    [
        (BOTH, LOAD, [[70, -70, 0], [-70, 100, -30], [0, -30, 30]]),
        (HUB, LOAD, [[100, -70, -30], [-70, 70, 0], [-30, 0, 30]]),
        (BOTH, HUB, [[70, 0, -70], [0, 30, -30], [-70, -30, 100]]),
    ],
    ids=["in a row", "both at the rotor", "the hub last"],
)
def test_two_cuts_of_a_node_make_three_bodies_on_two_springs(one: Any, other: Any, K: Any) -> None:
    """Against M and K that were written by hand: one spring has 70, the other 30 N.m/rad."""
    cut = rig().also_cut({"one": (0, one), "other": (0, other)})
    w2 = np.linalg.eigvals(np.diag([1.0, 1 / 2, 1 / 3]) @ np.array(K, dtype=float))
    found = frequencies(cut, {"one": stiff(70.0), "other": stiff(30.0)})
    assert found == pytest.approx(np.sqrt(np.sort(w2.real)[1:]), rel=1e-9)


@pytest.mark.parametrize("far", [HUB, LOAD, BOTH])
def test_a_law_sees_the_drives_side_against_the_loads(far: Any) -> None:
    held = []
    cut = rig().also_cut({"x": (0, far)})
    body = cut.assemble(INERTIA, {"x": lambda m, port, k, d: held.append(port)}, LinkOptions(), 0.0)
    (port,) = held
    near = body.ports["drive.shaft"].against(body.ports[min(far)])
    assert (port.sense, port.act) == (near.sense, near.act)


@pytest.mark.parametrize(
    ("one", "other"),
    [(BOTH, frozenset({"rotor.shaft", "hub.shaft"})), (HUB, HUB), (HUB, frozenset({*NODE} - HUB)), (HUB, frozenset())],
    ids=["cross", "the same", "the same from the other side", "nothing"],
)
def test_cuts_that_no_rig_has_are_refused(one: Any, other: Any) -> None:
    cut = rig().also_cut({"one": (0, one), "other": (0, other)})
    with pytest.raises(ValueError, match=r"one and other do not part drive\.shaft"):
        cut.assemble(INERTIA, {"one": stiff(1.0), "other": stiff(1.0)}, LinkOptions(), 0.0)
    assert not cut.can_give(["one", "other"])
    assert cut.can_give(["one"])


def test_three_cuts_that_leave_a_piece_out_of_reach_are_refused() -> None:
    flanges = [f"b{k}.shaft" for k in range(5)]
    cuts = {flange: frozenset({flange, flanges[0]}) for flange in flanges[1:4]}
    with pytest.raises(ValueError, match="do not part"):
        Topology(False, "N.m", [flanges]).pieces(0, cuts)


def test_a_drawn_name_may_be_another_cut() -> None:
    place = "rotor.shaft -> hub.shaft"
    plant = rig()
    assert plant.sites.joints == (place,)
    for cut, inertias in ((plant, (1.0, 5.0)), (plant.also_cut({place: (0, HUB)}), (4.0, 2.0))):
        (w,) = frequencies(cut, {place: stiff(70.0)})
        assert w == pytest.approx(math.sqrt(70.0 * sum(1 / J for J in inertias)), rel=1e-9)
    assert plant.also_cut({place: (0, HUB)}).sites.joints == (place,)


def test_a_way_leaves_inertia_on_both_sides() -> None:
    place = "drive.shaft -> rotor.shaft"
    sides = {cut.cuts[place][1] for cut in ways(rig(), [place])}
    assert sides == {frozenset({"rotor.shaft", *more}) for more in ((), HUB, LOAD)}  # the drive alone has none


@pytest.mark.parametrize("seed", [0, 2, 28])
def test_the_drawn_cut_under_another_name_is_the_drawn_cut(seed: int) -> None:
    plant, options = made(seed)
    place = plant.sites.joints[-1]
    again = plant.also_cut({"x -> y": plant.cuts[place]})
    law = {"stiffness": 20.0, "damping": 0.02, "cubic_stiffness": 3e3}
    base = Truth(plant, plant.nominal())
    rng = np.random.default_rng(1)
    bench, _ = make_bench(base, plant.nominal(), choose_sensors(plant, options, ()), rng, replace(options, seconds=2.0))
    one = bench.outputs(replace(base, concealed=(Concealed("hardening_spring", place, law),)))
    other = bench.outputs(Truth(again, plant.nominal(), (Concealed("hardening_spring", "x -> y", law),)))
    rigid = bench.outputs(base)
    for a, b, c in zip(one, other, rigid, strict=True):
        assert np.array_equal(a, b)
        assert not np.array_equal(a, c)


def test_a_sensor_sits_on_the_other_side_under_the_same_name() -> None:
    cut = rig().also_cut({"x": (0, LOAD)})
    for plant, flange in ((cut, "load.shaft"), (cut.seated({"load.shaft.angle": "hub.shaft"}), "hub.shaft")):
        body = plant.assemble(INERTIA, {"x": stiff(1.0)}, LinkOptions(), 0.0)
        assert body.signals["load.shaft.angle"].sense == body.ports[flange].sense
    assert cut.topology.probes[0].at == "load.shaft"


def test_names_allow_what_the_tool_means_by_them(tmp_path: Path) -> None:
    """Every split of every node of some rigs, as the tool makes it, is a far side of its name, and nothing else is."""
    tried = 0
    for seed in range(12):
        plant, options = made(seed)
        t = plant.topology
        file = tmp_path / "scenario.yaml"
        file.write_text(text(draw(plant, [], [], seed, replace(options, nuisance=0.0))).split("recordings:")[0])
        system = load(str(file)).system
        for index, node in enumerate(t.nodes):
            named: dict[str, list[frozenset[str]]] = {}
            for inner, outer in splits(system, node):
                named.setdefault(f"{inner[0]} -> {outer[0]}", []).append(frozenset(outer))
            for place, sides in named.items():
                assert t.joined(place) == index
                found = t.far_sides(index, place)
                assert sorted(map(sorted, found)) == sorted(map(sorted, sides))
                tried += len(found) > 1
    assert tried >= 10


def test_ways_begin_with_the_drawn_cut_and_end_in_time() -> None:
    """Of load.shaft only, the rotor's node is cut at hub -> load as drawn; then the sensor moves; then the hub."""
    found = list(ways(rig(drawn_after=3), ["rotor.shaft -> load.shaft"]))
    place = "rotor.shaft -> load.shaft"
    assert [(w.cuts[place][1], w.topology.probes[0].at) for w in found] == [(LOAD, "load.shaft"), (LOAD, "drive.shaft")]
    many = Topology(False, "N.m", [["drive.shaft", *(f"b{k}.shaft" for k in range(8))]])
    many.bodies, many.cuts = {f"b{k}.shaft": f"b{k}" for k in range(8)}, [1]
    values = {f"b{k}.inertia": 1.0 for k in range(8)}
    large = Rig("many", many, values, dict.fromkeys(values, "kg.m2"), {}, {})
    large.sites = large.find_sites()
    assert len(list(ways(large, ["drive.shaft -> b1.shaft"]))) == WAYS
    assert WAYS < 2**6


@pytest.mark.parametrize(
    ("seed", "place", "far", "seats"),
    [
        (803653, "drive.flange -> table.flange", {"table.flange", "stage.flange"}, {}),
        (
            803653,
            "drive.flange -> table.flange",
            {"table.flange", "stage.flange"},
            {"carriage.flange.position": "stage.flange"},
        ),
        (557229, "drive.flange -> table.flange", {"table.flange"}, {}),
    ],
    ids=["dangles", "dangles, read there", "dangles from the last piece"],
)
def test_another_cut_means_the_same_on_both_sides(seed: int, place: str, far: Any, seats: Any, tmp_path: Path) -> None:
    """flexarm, with the node parted the same way by a block of its own, gives the same outputs."""
    plant, options = made(seed)
    cut = steady(plant).also_cut({place: (0, frozenset(far))}).seated(seats)
    options = replace(options, **QUIET, rate=max(options.rate, 500.0))
    case = draw(cut, [f"joint_flexibility@{place}"], [5.0], seed, options)
    truth = clean(case)
    without = difference(simulated(case, tmp_path / "without"), truth)
    assert without > 0.9
    assert difference(simulated(case, tmp_path / "with", case.truth.concealed), truth) < max(0.05, 1e-3 * without)
