"""Nodes cut in every way, and what is measured there read from either side."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.places import sides, splits
from diagnosis.effects.scales import operating_scales
from diagnosis.search.fitter import CandidateFitter, end_of
from diagnosis.search.partial_fit import ended, standing
from engine.errors import FlexarmError
from engine.system import System
from scenarios.load import load

ROTOR, ARM, STIFFNESS, LOSS = 2e-3, 6e-3, 12.0, 0.01
"""kg.m2, kg.m2, N.m/rad and N.m.s/rad of the plant, whose model takes rotor and arm for one body."""

TEXT = """\
schema: 1
name: arm
blocks:
  drive: {{type: Torque}}
  rotor: {{type: Inertia, inertia: {rotor} kg.m2}}
  {more}
  arm: {{type: Inertia, inertia: {arm} kg.m2}}
connect:
  - [{ends}]
simulate: {{stop: 1 s, step: 2 ms}}
recordings:
"""
RECORDED = """\
  {name}:
    file: {name}.csv
    time: {{column: t, unit: s}}
    drive: {{drive.torque: {{column: u, unit: N.m}}}}
    measurements: {{{signal}: {{column: y, unit: rad, noise: 2e-5}}}}
    role: {role}
"""


def rig(
    folder: Path,
    sits: str,
    signal: str,
    ends: str = "arm.shaft, rotor.shaft, drive.shaft",
    more: str = "",
    *,
    drag: float = 0.0,
) -> Any:
    """Two bodies on a spring, by scipy; the encoder sits on one of them, and the scenario reads it at a flange.

    The arm is slowed down by a ``drag`` (N.m.s/rad).
    """
    m = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    pull = np.array([-STIFFNESS, STIFFNESS, -LOSS, LOSS])
    a = np.vstack([m, pull / ROTOR, -pull / ARM])
    a[3, 3] -= drag / ARM
    b = np.array([[0.0], [0.0], [1 / ROTOR], [0.0]])
    c = np.array([[1.0, 0.0, 0.0, 0.0]] if sits == "rotor" else [[0.0, 1.0, 0.0, 0.0]])
    text = TEXT.format(rotor=ROTOR, arm=ARM, ends=ends, more=more or "# one shaft")
    random = np.random.default_rng(1)
    t = np.arange(0.0, 1.0 + 1e-9, 2e-3)
    inputs = {
        "steps": ("train", np.where(t % 0.5 < 0.25, 0.2, -0.2)),
        "sweep": ("train", 0.2 * np.sin(2 * np.pi * (1 + 6 * t) * t)),
        "other": ("hold_out", 0.2 * np.sign(np.sin(2 * np.pi * 3.3 * t + 0.2))),
    }
    for name, (role, u) in inputs.items():
        fine = np.linspace(0.0, t[-1], 10 * (len(t) - 1) + 1)
        held = np.append(np.repeat(u[:-1], 10), u[-1])
        y = lsim(StateSpace(a, b, c, np.zeros((1, 1))), held, fine, interp=False)[1][::10]
        rows = np.column_stack([t, u, y + random.normal(0.0, 2e-5, len(t))])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="t,u,y", comments="")
        text += RECORDED.format(name=name, role=role, signal=signal)
    path = folder / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    scenario = load(path)
    return CandidateFitter(scenario, gather(scenario, [], []), 1)


def joints(fitter: CandidateFitter) -> list[Any]:
    return [c for c in candidates(operating_scales(fitter.base)) if c.effect == "joint_flexibility"]


@pytest.fixture
def four(tmp_path: Path) -> System:
    """A node of four flanges, the drive neither first nor last."""
    ends = "arm.shaft, drive.shaft, bearing.shaft, rotor.shaft"
    bearing = "bearing: {type: BearingFriction, viscous_friction: 1e-3 N.m.s/rad}"
    made: System = rig(tmp_path, "rotor", "rotor.shaft.angle", ends, bearing).scenario.system
    return made


def test_a_node_is_cut_in_every_way_once_the_drive_s_side_first(four: System) -> None:
    """2^(n - 1) - 1 ways to part n flanges in two."""
    (ends,) = [c.ends for c in four.connections]
    assert len(ends) == 4
    for count in (2, 3, 4):
        flanges = ends[:count]
        found = list(splits(four, flanges))
        assert len(found) == 2 ** (count - 1) - 1
        assert {frozenset((frozenset(a), frozenset(b))) for a, b in found} == {
            frozenset((frozenset(part), frozenset(flanges) - frozenset(part)))
            for size in range(1, count)
            for part in itertools.combinations(flanges, size)
        }
        assert {inner[0] for inner, _ in found} == {"drive.shaft"}
    without = ["arm.shaft", "bearing.shaft"]
    assert list(splits(four, without)) == [(["arm.shaft"], ["bearing.shaft"])]


def test_what_is_measured_is_read_from_either_side_as_it_is_mapped_first() -> None:
    inner, outer = ["drive.shaft", "rotor.shaft"], ["arm.shaft"]
    assert list(sides([], inner, outer)) == [()]
    assert list(sides(["link.tip.position"], inner, outer)) == [()]
    measured = ["rotor.shaft.angle", "arm.shaft.speed"]
    first, second = ("rotor.shaft.angle", "arm.shaft.angle"), ("arm.shaft.speed", "drive.shaft.speed")
    assert list(sides(measured, inner, outer)) == [(), (second,), (first,), (first, second)]


def test_of_two_angles_mapped_to_one_node_each_may_sit_on_either_side(four: System) -> None:
    found = list(sides(["rotor.shaft.angle", "bearing.shaft.angle"], ["rotor.shaft", "bearing.shaft"], ["arm.shaft"]))
    assert len(found) == len(set(found)) == 4


@pytest.mark.parametrize("sits", ["rotor", "arm"])
@pytest.mark.parametrize("mapped", ["rotor", "arm"])
def test_the_side_on_which_the_encoder_sits_fits_best(tmp_path: Path, sits: str, mapped: str) -> None:
    """Wherever the scenario reads it; both are one rigid shaft in the user's model."""
    fitter = rig(tmp_path, sits, f"{mapped}.shaft.angle")
    refit = fitter.refit
    listed = [c for c in joints(fitter) if c.place.endswith("-> arm.shaft")]
    assert {c.place for c in listed} == {"drive.shaft -> arm.shaft"}
    parted = [c for c in listed if "with rotor.shaft on the side of drive.shaft" in c.option]
    assert parted
    found = {}
    for c in parted:
        amended = [e.target for e in c.edits(c.starts[0]) if type(e).__name__ == "ReadAt"]
        side = amended[0].partition(".")[0] if amended else mapped
        found["arm" if side == "arm" else "rotor"] = fitter.finish(fitter.partial_fit((c,), [standing(refit.fit)]))
    assert set(found) == {"rotor", "arm"}
    right, wrong = found[sits], found["arm" if sits == "rotor" else "rotor"]
    assert right.hold_out < 1.5 < wrong.hold_out
    values = right.fit.parameters()
    ours = values["found_joint_flexibility.stiffness"] * (1 / values["rotor.inertia"] + 1 / values["arm.inertia"])
    assert ours == pytest.approx(STIFFNESS * (1 / ROTOR + 1 / ARM), rel=0.01)


def test_a_joint_parts_a_shaft_and_what_slows_it_down_is_found_on_its_side(tmp_path: Path) -> None:
    """Both sides are places, as large as the shaft was; the order in which effects are put in does not matter."""
    fitter = rig(tmp_path, "rotor", "rotor.shaft.angle", drag=0.02)
    scales = operating_scales(fitter.base)
    joint = next(c for c in joints(fitter) if c.option == "with rotor.shaft on the side of drive.shaft")
    alone = fitter.finish(fitter.partial_fit((joint,), [standing(fitter.refit.fit)]))
    parted = scales.parted(alone.fit.problem)
    assert {first: set(members) for first, members in scales.groups.items()} == {
        "drive.shaft": {"drive.shaft", "rotor.shaft", "arm.shaft"}
    }
    assert {first: set(members) for first, members in parted.groups.items()} == {
        "drive.shaft": {"drive.shaft", "rotor.shaft"},
        "arm.shaft": {"arm.shaft"},
    }
    for sizes in (parted.torque, parted.speed, parted.angle, parted.inertia):
        assert sizes["arm.shaft"] == pytest.approx(sizes["drive.shaft"])

    drags = {c.place: c for c in candidates(parted) if c.effect == "viscous_friction"}
    assert set(drags) == {"drive.shaft", "arm.shaft"}
    kept, values = ended(alone, joint), [standing(alone.fit)]
    found = {place: fitter.finish(fitter.partial_fit((kept, c), values)) for place, c in drags.items()}
    right, wrong = found["arm.shaft"], found["drive.shaft"]
    assert right.added()["viscous_friction.viscous_friction"] == pytest.approx(0.02, rel=0.1)
    assert right.log_evidence > wrong.log_evidence + 10

    point = end_of(right)
    turned = fitter.build(right.effects[::-1], point.built[::-1], whole=True)
    x = np.array([point.x[[f.name for f in point.problem.free].index(f.name)] for f in turned.free])
    for e, same in zip(point.problem.experiments, turned.experiments, strict=True):
        np.testing.assert_allclose(point.problem.residual(point.x, e), turned.residual(x, same), atol=1e-6)


def test_two_sensors_are_never_read_as_one(tmp_path: Path) -> None:
    signals = "rotor.shaft.angle: {column: y, unit: rad, noise: 2e-5}, arm.shaft.angle"
    fitter = rig(tmp_path, "rotor", signals)
    refused, built = [], []
    for c in joints(fitter):
        try:
            built.append(len(fitter.build((c,), c.starts[:1]).model.outputs))
        except FlexarmError as error:
            refused.append(error.message)
    assert set(built) == {2}
    assert "two sensors would both read 'arm.shaft.angle'" in refused
