"""Options objects and the keyword arguments that stand for them are the same, field by field."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest

import flexarm
from diagnosis.api import DiagnosisKeywords
from engine.simulate import SimulationKeywords
from flexarm.api import ExportKeywords
from flexarm.sweeps.sweep import SweepKeywords
from fmu.package import PackageKeywords, PackageOptions


@pytest.mark.parametrize(
    ("options", "keywords"),
    [
        (flexarm.SimulationOptions, SimulationKeywords),
        (flexarm.SweepOptions, SweepKeywords),
        (flexarm.ExportOptions, ExportKeywords),
        (flexarm.DiagnosisOptions, DiagnosisKeywords),
        (PackageOptions, PackageKeywords),
    ],
)
def test_keywords_are_the_fields(options: type[Any], keywords: type[Any]) -> None:
    assert get_type_hints(options) == get_type_hints(keywords)
    documented = (options.__doc__ or "").partition("Attributes:")[2]
    assert [f.name for f in fields(options) if f"\n        {f.name}: " not in documented] == []


def test_keywords_go_over_the_options() -> None:
    scenario = flexarm.load("srv02-bare")
    options = flexarm.SimulationOptions(internal_step=1e-4, record_states=True)
    plain = flexarm.simulate(scenario, 0.01, 1e-3, internal_step=1e-4)
    made = flexarm.simulate(scenario, 0.01, 1e-3, options)
    over = flexarm.simulate(scenario, 0.01, 1e-3, options, record_states=False)
    assert plain.states is None
    assert made.states is not None
    assert over.states is None
    assert made.internal_step == over.internal_step == plain.internal_step == 1e-4
    assert np.array_equal(made.values, plain.values)


def test_an_unknown_keyword_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="'interal_step'"):
        flexarm.simulate("srv02-bare", 0.01, interal_step=1e-4)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="'fmi'"):
        flexarm.export("srv02-bare", tmp_path / "x.fmu", fmi=3)  # type: ignore[call-arg]
    assert not list(tmp_path.iterdir())
