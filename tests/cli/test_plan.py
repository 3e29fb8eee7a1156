"""``flexarm plan`` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from flexarm.cli import main

MOTOR = """\
schema: 1
name: bench
blocks:
  source: {type: Step, height: 1 V}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68e-3 N.m/A, rotor_inertia: 4.6e-7 kg.m2}
  encoder: {type: Encoder, counts_per_revolution: 1000}
connect:
  - [source.out, motor.voltage]
  - [motor.shaft, encoder.shaft]
simulate: {stop: 0.5 s, step: 2 ms}
"""


def run(*arguments: str) -> int:
    try:
        main(list(arguments))
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


def test_a_plan_is_printed_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "bench.yaml", tmp_path / "plan"
    path.write_text(MOTOR, encoding="utf-8")
    effects = ["--only", "coulomb_friction", "--only", "offset"]
    assert run("plan", str(path), *effects, "--at", "5", "-o", str(out)) == 0
    told = capsys.readouterr().out
    # The encoder is measured, its count taken for noise: 2 pi / 1000 / sqrt(12).
    assert "encoder.out" in told
    assert "0.0018138" in told
    assert "told apart at 5 times the smallest size" in told
    assert "nor at" not in told
    numbers = json.loads((out / "plan.json").read_text(encoding="utf-8"))
    assert numbers["experiment"]["sensors"][0]["sigma"] == pytest.approx(1.8138e-3, rel=1e-4)
    assert (out / "plan.png").stat().st_size > 10_000
    page = (out / "report.html").read_text(encoding="utf-8")
    for row in numbers["effects"]:
        assert row["place"].replace(">", "&gt;") in page
    assert sorted(p.name for p in out.iterdir()) == ["plan.json", "plan.png", "report.html"]


def test_what_is_wrong_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.yaml"
    path.write_text(MOTOR, encoding="utf-8")
    assert run("plan", str(path), "-m", "encoder.ot=0.1deg") == 1
    told = capsys.readouterr().err
    assert "encoder.ot" in told
    assert "encoder.out" in told
    assert run("plan", str(path), "-m", "encoder.out=3 kg") == 1
    assert "--measure encoder.out" in capsys.readouterr().err
    path.write_text(MOTOR.replace("simulate: {stop: 0.5 s, step: 2 ms}", ""), encoding="utf-8")
    assert run("plan", str(path)) == 1
    assert "simulate:" in capsys.readouterr().err
