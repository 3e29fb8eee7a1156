"""How-to pages as a reader follows them: their files are written, their commands run, and print what the pages show."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexarm
from tools import console

HOW_TO = console.ROOT / "docs" / "how-to"
PAGES = {
    "belt-axis.md": (),
    "ball-screw.md": (),
    "harmonic-joint.md": (),
    "data-sheet.md": (),
    "lqr.md": (),
    "controller-fmu.md": (),
    "monte-carlo.md": ("belt-axis.md",),
    "plan.md": (),
}
"""Pages, and those whose files they go on with."""


@pytest.fixture(scope="module", params=PAGES)
def followed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path, list[str]]:
    """A page, the folder in which a reader followed it, and where it shows something else than was printed."""
    page = str(request.param)
    folder = tmp_path_factory.mktemp(Path(page).stem)
    for name in (*PAGES[page], page):
        for step in console.steps((HOW_TO / name).read_text(encoding="utf-8")):
            if isinstance(step, console.File):
                (folder / step.name).write_text(step.text, encoding="utf-8")
    commands = [s for s in console.steps((HOW_TO / page).read_text(encoding="utf-8")) if isinstance(s, console.Command)]
    assert commands
    wrong = [line for c in commands for line in console.differences(c, console.run(c, folder))]
    return page, folder, wrong


def test_the_page_prints_what_it_shows(followed: tuple[str, Path, list[str]]) -> None:
    page, _, wrong = followed
    assert not wrong, "\n".join([f"{page}; `python -m tools.console docs/how-to/{page}` writes it anew", *wrong])


def test_what_the_page_says_is_so(followed: tuple[str, Path, list[str]]) -> None:
    page, folder, _ = followed
    {
        "belt-axis.md": belt_swings_as_two_masses_do,
        "ball-screw.md": motion_is_lost_by_the_play,
        "harmonic-joint.md": holding_costs_what_statics_says,
        "data-sheet.md": the_motor_gives_what_its_sheet_says,
        "lqr.md": loops_are_those_of_the_design,
        "controller-fmu.md": the_controller_is_its_recursion,
        "monte-carlo.md": draws_are_as_wide_as_asked,
        "plan.md": one_direction_hides_friction,
    }[page](folder)


def belt_swings_as_two_masses_do(folder: Path) -> None:
    """Against the two masses' own matrices, with damping, back-emf and the guide's viscous friction."""
    k, d, m, J, r, B = 8e4, 30.0, 2.9, 3e-5, 0.1 / (2 * np.pi), 5.0
    emf = 0.06**2 / 0.6
    A: list[list[float]] = [
        [0, 0, 1, 0],
        [0, 0, 0, 1],
        [-k * r * r / J, k * r / J, -(d * r * r + emf) / J, d * r / J],
        [k * r / m, -k / m, d * r / m, -(d + B) / m],
    ]
    found = flexarm.linearise(folder / "belt.yaml", "belt")
    np.testing.assert_allclose(np.sort(found.poles()), np.sort(np.linalg.eigvals(A)), rtol=1e-9, atol=1e-8)
    assert np.sqrt(k / m) == pytest.approx(166.1, abs=0.05)
    assert np.sqrt(k * (1 / m + r * r / J)) == pytest.approx(838.5, abs=0.05)


def motion_is_lost_by_the_play(folder: Path) -> None:
    table = flexarm.read(folder / "gaps.parquet")
    gap, lost = np.asarray(table["play.half_gap"]), np.asarray(table["lost"])
    # The half gap, and what the contact gives way when it closes: m v^2 = k x^2 with v^2 = 2 g a, for the acceleration
    # a that nut and table have towards each other (up to 2 m/s2 here) and the nut's share of mass.
    give = np.sqrt(30 * 2 * (2 * gap) * 2.0 / 5e7)
    assert (lost >= gap).all()
    assert (lost - lost[0] <= gap + give).all()
    run = flexarm.read(folder / "run.csv")
    assert set(np.ravel(run["play.contact"])) == {-1.0, 0.0, 1.0}


def holding_costs_what_statics_says(folder: Path) -> None:
    held = flexarm.trim(folder / "joint.yaml", "level")
    torque = 3 * 9.81 * 0.2
    current = torque / (100 * 0.75 * 0.04)
    assert held.outputs["drive.twist"] == pytest.approx(torque / 8e3, rel=1e-9)
    assert held.outputs["motor.current"] == pytest.approx(current, rel=1e-9)
    assert held.inputs["motor.voltage"] == pytest.approx(0.5 * current, rel=1e-9)


def the_motor_gives_what_its_sheet_says(folder: Path) -> None:
    """The torque of 9 A, where the voltage ends it, and the arm against a held rotor, from the sheet's numbers."""
    run = flexarm.simulate(folder / "drive.yaml")
    flux = np.hypot(16e-3, 0.75e-3 * 9)
    weak = int(np.argmax(run["motor.d_current"] < -0.05))
    constant = (run.time > 0.025) & (run.time < run.time[weak])
    np.testing.assert_allclose(run["motor.torque"][constant], 101.8e-3 * 9 / np.sqrt(2), rtol=1e-3)
    bus = run["bus.voltage"][weak]
    corner = (0.95 * bus / np.sqrt(3) - 0.25 * 9.9 * np.sqrt(2)) / (3 * flux)
    assert run["motor.shaft.speed"][weak] == pytest.approx(corner, rel=0.02)
    assert corner == pytest.approx(438, rel=0.04)
    assert 1.5 < run["motor.shaft.speed"].max() / corner < 2.5
    found = flexarm.linearise(folder / "drive.yaml", "loop")
    assert np.sort(np.abs(found.poles() + 4000))[:2] == pytest.approx([0, 0], abs=0.1)
    held = found.zeros("motor.shaft.speed")
    assert np.abs(held[np.abs(held.imag) > 1]) == pytest.approx(np.sqrt(16e3 / 0.9), rel=1e-3)


def loops_are_those_of_the_design(folder: Path) -> None:
    """Poles by the separation principle, and margins of the same loops in python-control."""
    for name, settings in (
        ("sampled", []),
        ("continuous", [f"{b}.{k}={v}" for b in ("observer", "feedback") for k, v in _CONTINUOUS]),
    ):
        made = {key: np.array(value) for key, value in json.loads((folder / f"{name}.json").read_text()).items()}
        A, B, C, L, K = (made[key] for key in "ABCLK")
        period = 0.002 if name == "sampled" else 0
        loop = flexarm.load(folder / "closed.yaml", settings)
        found = flexarm.linearise(loop, inputs=["feedback.reference"], outputs=["load.shaft.angle"])
        for pole in (*np.linalg.eigvals(A - B @ K), *np.linalg.eigvals(A - L @ C)):
            # The pair of the observer lies so close that it is known to the root of the rounding.
            assert np.abs(found.poles() - pole).min() < 1e-6 * max(1.0, abs(pole))
        w = np.geomspace(1, 1500, 40_001)
        s = np.exp(1j * w * period) if period else 1j * w
        eye = np.eye(4)
        plant = C @ np.linalg.solve(s[:, None, None] * eye - A, np.broadcast_to(B, (len(s), 4, 1)))
        inside = s[:, None, None] * eye - (A - B @ K - L @ C)
        opened = (K @ np.linalg.solve(inside, L @ plant))[:, 0, 0]
        turned = np.angle(opened, deg=True) % 360  # 180 where it is -1 times a positive number
        phase = np.abs(turned - 180)[:-1][np.diff(np.sign(np.abs(opened) - 1)) != 0].min()
        crossing = (np.diff(np.sign(opened.imag)) != 0) & (opened.real[:-1] < 0) & (np.abs(opened[:-1]) < 1)
        member = flexarm.margins(loop, loop="motor.voltage").members[0]
        assert member.phase == pytest.approx(phase, rel=2e-3)
        assert member.gain[1] == pytest.approx(1 / np.abs(opened[:-1][crossing]).max(), rel=2e-3)


_CONTINUOUS = (("file", "continuous.json"), ("period", "0"))


def the_controller_is_its_recursion(folder: Path) -> None:
    """Motor and controller again, stepped exactly in plain Python: the same speed at the end of the run."""
    with pytest.warns(RuntimeWarning, match="is run"):
        result = flexarm.simulate(folder / "drive.yaml")
    w, total, voltage, asked_before = 0.0, 0.0, 0.0, 0.0
    J, R, kt, T = 1e-4, 1.0, 0.05, 2e-3
    rate = kt * kt / (R * J)
    fade = np.exp(-rate * T)
    speeds, seen = [], (0.0, 0.0)
    for k in range(500):
        wanted = 100.0 if k * T >= 0.1 - 1e-9 else 0.0
        if k:
            error = seen[0] - seen[1]
            asked_before = 0.05 * error + total
            voltage = max(-10.0, min(10.0, asked_before))
            if voltage == asked_before:
                total += 0.8 * T * error
        speeds.append(w)
        seen = (wanted, w)
        drive = kt * voltage / R - 0.01
        # Coulomb friction of 0.01 N.m holds the motor until the first command, and it turns one way alone.
        w = fade * w + (1 - fade) * drive / (J * rate) if w > 0 or drive > 0 else 0.0
    np.testing.assert_allclose(result["motor.shaft.speed"][:500], speeds, atol=1e-3)


def draws_are_as_wide_as_asked(folder: Path) -> None:
    table: Any = flexarm.read(folder / "mc/runs.parquet").to_pandas()
    assert len(table) == 500
    assert not table["failure"].notna().any() or (table["failure"] == "").all()
    stiffness = table["pulley.stiffness"]
    assert stiffness.mean() == pytest.approx(8e4, rel=4 * 0.1 / np.sqrt(500))
    assert stiffness.std() == pytest.approx(8e3, rel=4 / np.sqrt(2 * 500))
    assert 0 <= table["payload"].min() < 0.05
    assert 1.95 < table["payload"].max() <= 2
    # The metric is the largest of what was recorded, so that it lies in the table as well.
    greatest = table[["pulley.force.max", "pulley.force.min"]].abs().max(axis=1)
    np.testing.assert_allclose(table["worst"], greatest, rtol=1e-12)
    assert {p.name for p in (folder / "mc").glob("*.png")} == {"tornado.png", "scatter.png"}


def test_every_page_with_commands_is_followed() -> None:
    """No page shows commands that nothing runs; those on effects are run by `test_own_block`."""
    shown = {p.name for p in HOW_TO.glob("*.md") if "```console\n" in p.read_text(encoding="utf-8")}
    assert shown == {*PAGES, "register-an-effect.md"}


def one_direction_hides_friction(folder: Path) -> None:
    """Coulomb friction and an offset are one constant torque while nothing turns back."""
    told = json.loads((folder / "plan" / "plan.json").read_text(encoding="utf-8"))
    number = {row["effect"]: row["number"] for row in told["effects"]}
    pair = sorted([number["coulomb_friction"], number["offset"]])
    assert pair in told["told_apart"]["3"]["tied"]
    assert pair in told["told_apart"]["10"]["tied"]
    assert pair in next(one["settles"] for one in told["inputs"] if one["kind"] == "reversal")
