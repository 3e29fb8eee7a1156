"""The brake against closed forms, and the spline against its definition written out."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import integrate

from blocks.actuators.brake import Brake
from blocks.actuators.effort import Torque
from blocks.actuators.spring_damper import SpringDamper
from blocks.links.inertia import Inertia
from blocks.sources.spline import Spline
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import ParameterError
from engine.linearise import linearise
from tests.blocks.assembly import instants, model, run, switches
from tests.blocks.test_drive_train import balance


@pytest.mark.parametrize("side", [1, -1])
def test_a_braked_body_stops_where_its_energy_is_spent(side: int) -> None:
    J, w, T, reference = 0.02, 3.0, 0.5, 0.4
    parts: dict[str, Block] = {
        "body": Inertia(inertia=J),
        "brake": Brake(torque=T, reference=side * reference, approach="rising" if side > 0 else "falling"),
    }
    result = run(parts, "body.shaft brake.shaft", stop=1.0, initial={"body.shaft.speed": side * w})
    assert instants(result, "brake.grip") == pytest.approx([reference / w], abs=1e-12)
    assert instants(result, "brake")[-1] == pytest.approx(reference / w + J * w / T, abs=1e-12)
    assert side * result["body.shaft.angle"][-1] == pytest.approx(reference + J * w**2 / (2 * T), rel=1e-12)
    assert result["body.shaft.speed"][-1] == 0
    assert result["energy.dissipated"][-1] == pytest.approx(J * w**2 / 2, rel=1e-12)
    before = result.time < reference / w - 1e-9
    assert (result["brake.grip"] == ~before).all()
    assert np.ptp(result["body.shaft.speed"][before]) == 0


def test_it_grips_at_once_beyond_the_reference_and_holds_up_to_its_torque() -> None:
    for torque, moves in ((0.49, False), (0.51, True)):
        parts: dict[str, Block] = {
            "source": Step(height=torque, start=0.1),
            "torque": Torque(),
            "body": Inertia(inertia=0.02),
            "brake": Brake(torque=0.5),
        }
        wires = ("source.out torque.torque", "torque.shaft body.shaft brake.shaft")
        result = run(parts, *wires, stop=0.5, initial={"body.shaft.angle": 0.1})
        assert instants(result, "brake.grip") == [0]
        expected = 0.1 + (torque - 0.5) * 0.4**2 / 2 / 0.02 if moves else 0.1
        assert result["body.shaft.angle"][-1] == pytest.approx(expected, rel=1e-12)


def test_an_open_brake_takes_nothing_however_often_the_shaft_turns_back() -> None:
    parts: dict[str, Block] = {
        "body": Inertia(inertia=0.02),
        "spring": SpringDamper(stiffness=2.0),
        "wall": Inertia(inertia=1e9),
        "brake": Brake(torque=0.5, reference=1.0),
    }
    wires = ("body.shaft brake.shaft spring.a", "spring.b wall.shaft")
    result = run(parts, *wires, stop=2.0, initial={"body.shaft.angle": 0.9})
    np.testing.assert_allclose(result["body.shaft.angle"], 0.9 * np.cos(10 * result.time), atol=2e-6)
    assert len(switches(result, "brake")) > 10
    assert result["energy.dissipated"][-1] == 0
    assert balance(result) < 1e-6


def write(folder: Path, rows: Any) -> str:
    file = folder / "torque.csv"
    file.write_text("time,torque\n" + "\n".join(f"{t!r},{y!r}" for t, y in rows) + "\n", encoding="utf-8")
    return str(file)


def shape_preserving(t: Any, y: Any, at: float) -> float:
    """Fritsch and Butland's slopes with the three-point end rule, in Hermite's form."""
    if at <= t[0] or at >= t[-1]:
        return float(y[0] if at <= t[0] else y[-1])
    h, rise = np.diff(t), np.diff(y) / np.diff(t)

    def end(h0: float, h1: float, r0: float, r1: float) -> float:
        d = ((2 * h0 + h1) * r0 - h0 * r1) / (h0 + h1)
        if d * r0 <= 0:
            return 0.0
        return 3 * r0 if r0 * r1 <= 0 and abs(d) > 3 * abs(r0) else d

    slopes = [end(h[0], h[1], rise[0], rise[1])]
    for k in range(1, len(h)):
        a, b = rise[k - 1], rise[k]
        w1, w2 = 2 * h[k] + h[k - 1], h[k] + 2 * h[k - 1]
        slopes.append(0.0 if a * b <= 0 else (w1 + w2) / (w1 / a + w2 / b))
    slopes.append(end(h[-1], h[-2], rise[-1], rise[-2]))
    k = int(np.searchsorted(t, at, "right")) - 1
    x = (at - t[k]) / h[k]
    value = (1 + 2 * x) * (1 - x) ** 2 * y[k] + x**2 * (3 - 2 * x) * y[k + 1]
    return float(value + h[k] * (x * (1 - x) ** 2 * slopes[k] - x**2 * (1 - x) * slopes[k + 1]))


def test_spline_keeps_the_shape_of_its_rows(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.02, 0.2, 14))
    y = np.array([0, 0, 0.3, 1.1, 1.1, 1.0, 0.2, -0.4, -0.4, 0.5, 0.6, 2.0, 2.1, 0.0])
    parts: dict[str, Block] = {
        "source": Spline(
            file=write(tmp_path, zip(t.tolist(), y.tolist(), strict=True)), column="torque", scale="1 mN.m"
        ),
        "torque": Torque(),
        "body": Inertia(inertia=0.5),
    }
    wires = ("source.out torque.torque", "torque.shaft body.shaft")
    result = run(parts, *wires, stop=float(t[-1]) + 0.2, step=0.01, internal_step=0.05)
    assert result.units["source.out"] == "N.m"
    expected = [1e-3 * shape_preserving(t, y, x) for x in result.time]
    np.testing.assert_allclose(result["source.out"], expected, rtol=0, atol=1e-17)
    edges = [*t, float(result.time[-1])]
    area = sum(integrate.quad(lambda x: shape_preserving(t, y, x), a, b, epsabs=1e-13)[0] for a, b in pairwise(edges))
    assert result["body.shaft.speed"][-1] == pytest.approx(1e-3 * area / 0.5, abs=1e-14)
    for k, (a, b) in enumerate(pairwise(t)):
        inside = result["source.out"][(result.time > a) & (result.time < b)] * 1e3
        assert (inside >= min(y[k : k + 2]) - 1e-12).all()
        assert (inside <= max(y[k : k + 2]) + 1e-12).all()


@pytest.mark.parametrize(("rows", "expected"), [([(0.5, 3.0)], [3.0] * 3), ([(0.0, 1.0), (1.0, 3.0)], [1.0, 2.0, 3.0])])
def test_short_recordings(tmp_path: Path, rows: Any, expected: list[float]) -> None:
    parts: dict[str, Block] = {
        "source": Spline(file=write(tmp_path, rows), column="torque"),
        "body": Inertia(inertia=1),
    }
    result = run(parts, stop=1.0, step=0.5)
    np.testing.assert_allclose(result["source.out"], expected, rtol=1e-15)


def test_a_bad_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"line 4: time 0\.2 does not come after 0\.5"):
        Spline(file=write(tmp_path, [(0.0, 1.0), (0.5, 2.0), (0.2, 1.0)]), column="torque")


def test_the_linear_model_takes_the_splines_value_at_its_instant(tmp_path: Path) -> None:
    t, y = np.array([0.0, 0.3, 0.5, 0.9]), np.array([0.0, 1.0, 0.4, 0.2])
    file = write(tmp_path, zip(t.tolist(), y.tolist(), strict=True))
    parts: dict[str, Block] = {"source": Spline(file=file, column="torque", scale="1 N.m"), "torque": Torque()}
    made = model(
        {**parts, "body": Inertia(inertia=0.5)}, "source.out torque.torque", "torque.shaft body.shaft", energy=False
    )
    for at in (0.0, 0.1, 0.3, 0.62):
        assert linearise(made, time=at).rate == pytest.approx(shape_preserving(t, y, at) / 0.5, abs=1e-15)
