"""Cases made up for the scorer: an answer, and a diagnosis that says what a test wants it to say."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from benchmarks.concealed.drawing import Options
from benchmarks.proof.suites import Spec

TRUTH = {
    "dead_zone": ("source.out -> motor.voltage", [], {"lower": -0.1, "upper": 0.2}),
    "coulomb_friction": ("motor.shaft", ["gear.input", "gear.output"], {"coulomb_friction": 2e-4}),
    "outside_vibration": ("motor.shaft", [], {"frequency": 2.5}),  # Hz
}
INPUT = TRUTH["dead_zone"][0]


def finding(effect: Any, place: Any, status: str = "named", others: Any = (), **parameters: Any) -> dict[str, Any]:
    """One finding; parameters are (low, high)."""
    intervals = {k: {"value": sum(v) / 2, "low": v[0], "high": v[1], "unit": "1"} for k, v in parameters.items()}
    return {
        "status": status,
        "effect": effect,
        "place": place,
        "block": place.partition(".")[0],
        "indistinguishable_from": list(others),
        "sentence": f"{effect} at {place}",
        "parameters": intervals,
    }


def put(
    folder: Any,
    effects: Any = ("dead_zone",),
    findings: Any = (),
    failure: str = "",
    errors: Any = (100.0, 10.0, 1.0),
    suite: str = "core",
    seed: int = 1,
    ties: Any = None,
    answered: bool = True,
    plant: str = "geared-two-mass",
    truth: Any = None,
    **more: Any,
) -> Any:
    """Write a finished case into a folder; returns its name. ``truth`` is that of another plant, as `TRUTH` is."""
    options, known = Options(**more), truth or TRUTH
    spec = Spec(suite, plant, tuple(effects), (3.0,) * len(effects), seed, options)
    result = folder / "results" / spec.name
    result.mkdir(parents=True)
    (folder / "answers").mkdir(exist_ok=True)
    run = {"spec": asdict(spec), "verdict": "x", "seconds": 12.0, "cpu": 11.0, "failure": failure, "code": "abc"}
    (result / "run.json").write_text(json.dumps(run))
    concealed = [
        {
            "effect": effect,
            "place": known[effect][0],
            "same_place": known[effect][1],
            "parameters": known[effect][2],
            "excess_in_floors": 3.0,
            "size_asked": 3.0,
        }
        for effect in effects
    ]
    answer = {
        "plant": plant,
        "seed": seed,
        "options": asdict(options),
        "concealed": concealed,
        "nuisance": {"gain": 0.0},
        "true_parameters": {"load.inertia": 0.02},
    }
    if answered:
        (folder / "answers" / f"{spec.name}.json").write_text(json.dumps(answer))
    held = {name: {"y": {"chi2": e}} for name, e in zip(("nominal", "refit", "amended"), errors, strict=True)}
    diagnosis = {"verdict": "x", "findings": list(findings), "fit": {"hold_out": held}, "next_experiment": None}
    if not failure:
        (result / "diagnosis.json").write_text(json.dumps(diagnosis))
    if ties is not None:
        (folder / "ties").mkdir(exist_ok=True)
        (folder / "ties" / f"{spec.name}.json").write_text(json.dumps(ties))
    return spec.name
