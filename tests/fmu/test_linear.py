"""The linear model that travels with an FMU."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

import fmu
from engine.errors import FlexarmError
from engine.model import Model
from engine.simulate import Drive
from flexarm.api import export, linearise
from fmu.verify import references, slave


def test_resources_equal_the_directional_derivatives(smooth_model: Model, exported: Any) -> None:
    path = exported(smooth_model)
    with zipfile.ZipFile(path) as archive:
        linear = json.loads(archive.read("resources/linear.json"))
        mat = loadmat(archive.open("resources/linear.mat"))
    with slave(path) as (instance, description, _):
        instance.setupExperiment()
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        rates = [v for v in description.modelVariables if v.derivative is not None]
        states = [v.derivative.valueReference for v in rates]
        assert linear["states"] == [v.derivative.name for v in rates]
        u, y = references(description, "input"), references(description, "output")
        for name, unknowns, knowns in (
            ("A", [v.valueReference for v in rates], states),
            ("B", [v.valueReference for v in rates], u),
            ("C", y, states),
            ("D", y, u),
        ):
            columns = [instance.getDirectionalDerivative(unknowns, [known], [1.0]) for known in knowns]
            assert np.allclose(np.array(columns).T, linear[name], rtol=1e-12, atol=1e-12)
            assert np.array_equal(mat[name], np.array(linear[name]))
    assert [str(cell[0]) for cell in mat["outputs"].ravel()] == [output.name for output in smooth_model.outputs]


def test_files_beside_the_fmu(smooth_model: Model, tmp_path: Path) -> None:
    fmu.export(smooth_model, tmp_path / "arm.fmu", platforms=["linux64"], beside=True)
    assert {p.name for p in tmp_path.iterdir()} == {"arm.fmu", "arm_linear.mat", "arm_linear.m"}
    text = (tmp_path / "arm_linear.m").read_text()
    assert "arm_linear = ss(" in text
    assert "{'motor.voltage'}" in text
    first = (tmp_path / "arm_linear.mat").read_bytes()
    fmu.export(smooth_model, tmp_path / "arm.fmu", platforms=["linux64"], beside=True)
    assert (tmp_path / "arm_linear.mat").read_bytes() == first


def test_the_twin_meets_the_model_for_small_inputs(smooth_model: Model, tmp_path: Path) -> None:
    path = fmu.export(smooth_model, tmp_path / "twin.fmu", platforms=["linux64"], linear_twin=True)
    assert fmu.validate(path) == []
    ratios = []
    for level in (0.02, 0.2, 2.0):
        trace = fmu.cosim(path, 0.5, 1e-2, drive=Drive([0.0], [[level]]))
        deflection, twin = trace["link.tip.deflection"], trace["link.tip.deflection_lin"]
        assert np.abs(twin).max() > 0
        ratios.append(np.abs(deflection - twin).max() / np.abs(twin).max())
    # The terms left out are of third order, so a tenth of the input makes a hundredth of the relative difference.
    assert ratios[0] < 1e-5
    assert ratios[1] / ratios[0] == pytest.approx(100, rel=0.3)
    assert ratios[2] / ratios[1] == pytest.approx(100, rel=0.5)


def test_a_model_without_inputs_has_no_linear_model(timed_model: Model, tmp_path: Path) -> None:
    with pytest.raises(FlexarmError, match="no linear model"):
        fmu.export(timed_model, tmp_path / "x.fmu", platforms=["linux64"], beside=True)
    assert list(tmp_path.iterdir()) == []


def test_a_zero_system_is_said_and_comes_with_its_family(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Inside its dead zone the Quanser's input moves nothing; the family holds what it does outside."""
    with caplog.at_level("WARNING", logger="flexarm.export"):
        path = export("quanser-single-link", tmp_path / "q.fmu", platforms=["linux64"])
    said = " ".join(record.message for record in caplog.records)
    assert "zero system for zone.in" in said
    assert "inside" in said
    assert "--mode" in said
    with zipfile.ZipFile(path) as archive:
        inside = json.loads(archive.read("resources/linear_family.json"))
    assert (tmp_path / "q_linear_family.json").read_bytes() == (json.dumps(inside, indent=1) + "\n").encode()
    first, *others = inside
    assert not np.any(first["B"])
    made = linearise("quanser-single-link", inputs=["zone.in"], modes=others[0]["modes"])
    assert np.array_equal(made.B, others[0]["B"])
    assert np.any(made.B)
    assert all(np.any(other["B"]) for other in others)


def test_no_family_where_every_input_moves_an_output(smooth_model: Model, exported: Any) -> None:
    with zipfile.ZipFile(exported(smooth_model)) as archive:
        assert "resources/linear_family.json" not in archive.namelist()
