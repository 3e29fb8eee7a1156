"""Explicit cases: large and hostile files, impossible masses, stiff and unstable modes, divergence with its state."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.batch import Case, Failure, batch
from engine.errors import FlexarmError, ParameterError, SimulationError, StructureError
from engine.linearise import linearise
from engine.quantity import convert
from engine.simulate import Drive, simulate
from scenarios.document import DocumentError, parse, read
from scenarios.load import load
from tests.robustness.guard import bounded, explained

LARGE = {
    "lines of one text": ("word\n" * 1_000_000, None),
    "entries of a list": ("x:\n" + "- 1\n" * 1_000_000, "more than 200000 values"),
    "comments": ("#\n" * 1_000_000, None),
    "empty lines": ("\n" * 1_000_000, None),
    "digits": ("a: " + "1" * 1_000_000, None),
    "aliases of aliases": (
        "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 30)),
        "once its aliases are written out",
    ),
    "brackets": ("a: " + "[" * 1_000_000, "levels deep"),
    "dashes": ("- " * 1_000_000, "levels deep"),
    "indents": ("".join(" " * i + "a:\n" for i in range(3000)), "levels deep"),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_file_is_read_or_refused(name: str) -> None:
    text, message = LARGE[name]
    with bounded(60):
        if message is None:
            parse(text, "large.yaml")
            return
        with pytest.raises(DocumentError, match=message) as caught:
            parse(text, "large.yaml")
    assert str(caught.value).startswith("large.yaml:")


def test_too_large_a_file_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.yaml"
    path.write_text("k: 1\n" * 1_000_001)
    for name in ("open", "read_bytes", "read_text"):
        monkeypatch.setattr(Path, name, lambda *_, **__: pytest.fail("the file is opened"))
    with pytest.raises(DocumentError, match=r"5\.0 MB; at most 5 MB"):
        read(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"schema: 1\nname: M\xf6bel\n", "odd.yaml:2: byte 0xf6 is not UTF-8"),
        (b"PAR1\x15\x04\x15\x90", "odd.yaml: this is a Parquet file, not a scenario"),
        (b"PK\x03\x04\x14\x00\x00\xff", "odd.yaml: this is a zip archive"),
        (b"\x7fELF\x02\x01\x00\xff", "odd.yaml: this is a binary file, not a scenario"),
        (b"schema: 1\nschema: 1\n", "odd.yaml:2: the key 'schema' was given before, in line 1"),
        (b'schema: 1\nname: "\\ud800"\n', "odd.yaml:2: the text holds half of a character"),
        (b"schema: 1\nname: a\x00b\n", "odd.yaml:2"),
        (b"schema: 0x" + b"f" * 100_000, "odd.yaml:1: schema"),
    ],
)
def test_odd_text(content: bytes, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("odd.yaml").write_bytes(content)
    with pytest.raises(FlexarmError) as caught:
        load("odd.yaml")
    assert message in str(caught.value)
    assert len(str(caught.value)) < 2000


def test_two_halves_of_a_character_are_joined() -> None:
    assert parse('a: "\\ud83e\\udd80"').plain() == {"a": "\U0001f980"}


@pytest.mark.parametrize("unit", ["10^10^10", "9**9**9", "((((2)^99)^99)^99)^99", "m^99999999", "(" * 5000, "m^9^9^9"])
def test_a_unit_is_never_a_computation(unit: str) -> None:
    with bounded(10), pytest.raises(ParameterError, match="unknown unit"):
        convert(f"1 {unit}", "*")


@pytest.mark.parametrize(("value", "unit"), [("20 degC", "K"), ("20 degC", "*"), ("3 dB", "1"), ("3 dBm", "W")])
def test_offset_and_logarithmic_scales_are_refused(value: str, unit: str) -> None:
    """20 degC is 293.15 K, not 20 times 274.15 K; a factor cannot say so."""
    with pytest.raises(ParameterError, match="not a multiple"):
        convert(value, unit)


@pytest.mark.parametrize("value", [10**400, float("nan"), float("inf"), "1e999", "-1e999 m", "nan m"])
def test_numbers_that_are_not_finite(value: object) -> None:
    with pytest.raises(ParameterError, match=r"finite|too large"):
        convert(value, "m")


TWO_BODIES = """\
schema: 1
name: two
blocks:
  torque: {type: Torque}
  source: {type: Step, height: 1}
  a: {type: Inertia, inertia: 1}
  spring: {type: SpringDamper, stiffness: 1, damping: 0}
  b: {type: Inertia, inertia: 1}
connect:
  - [source.out, torque.torque]
  - [torque.shaft, a.shaft, spring.a]
  - [spring.b, b.shaft]
simulate: {stop: 1 s, record: [a.shaft.angle, b.shaft.angle]}
"""


@pytest.fixture
def two(tmp_path: Path) -> Path:
    path = tmp_path / "two.yaml"
    path.write_text(TWO_BODIES)
    return path


def test_a_mass_matrix_beyond_floats_is_refused(two: Path) -> None:
    """An inertia of 5e-324 beside springs divides by zero; one of 1e308 with another overflows."""
    model = load(two).build()
    with pytest.raises(SimulationError, match=r"t = 0 s: the rate of state '.*' is not finite"):
        simulate(model, 1.0, parameters={"b.inertia": 5e-324, "a.inertia": 5e-324}, internal_step=1e-3)
    with pytest.raises(StructureError, match=r"the motion of .* has no finite inertia"):
        load("lumped-arm-pulse", ["link.length=8e+199 m"]).build()


def test_a_stiff_mode_is_named(two: Path) -> None:
    """w = sqrt(2 k / J) = 2e12 1/s: a step of 2.5e-13 s, 4e12 of them in a second."""
    model = load(two).build()
    with pytest.raises(SimulationError) as caught:
        simulate(model, 1.0, parameters={"spring.stiffness": 2e24})
    found = re.search(r"exceed 1e\+09 steps; the fastest mode moves '(\S+)' at 2e\+12 1/s", caught.value.message)
    assert found
    # Both bodies take the same part, as angles and as speeds: the first of the states leads, whatever the rounding.
    assert found[1] == model.states[0].name


def test_a_batch_goes_on_after_a_stiff_case(two: Path) -> None:
    model = load(two).build()
    cases = [Case(parameters={"spring.stiffness": stiffness}) for stiffness in (1.0, 2e24, 2.0)]
    found = list(batch(model, cases, 0.1))
    assert isinstance(found[1], Failure)
    assert "fastest mode" in found[1].reason
    assert not isinstance(found[0], Failure)
    assert not isinstance(found[2], Failure)


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_divergence_says_when_and_which_state(two: Path, backend: str) -> None:
    """RK4 leaves its stability region at h w = 2.83, so a step of 0.1 s at w = 100 1/s grows without bound."""
    model = load(two).build()
    with pytest.raises(SimulationError) as caught:
        simulate(model, 1000.0, 0.1, parameters={"spring.stiffness": 5e3}, internal_step=0.1, backend=backend)
    found = re.fullmatch(r"the simulation diverged at t = (\S+) s: state '(\S+)' is not finite", caught.value.message)
    assert found
    assert 1 < float(found[1]) < 1000
    assert found[2] in [state.name for state in model.states]


def test_an_unstable_mode_diverges_with_a_message(two: Path) -> None:
    """Two states with x' = 1000 x reach 1e308 at t = 0.71 s."""
    text = TWO_BODIES.replace(
        "  torque:", "  plant: {type: StateSpace, A: [[1000]], B: [[1]], C: [[1]]}\n  torque:"
    ).replace("[source.out, torque.torque]", "[source.out, torque.torque, plant.in]")
    two.write_text(text)
    with pytest.raises(SimulationError, match=r"diverged at t = 0\.7\d* s: state 'plant\.\S+' is not finite"):
        simulate(load(two).build(), 1.0)


def test_outputs_that_overflow_are_no_result(two: Path) -> None:
    """A finite state, but an output beyond floats."""
    text = TWO_BODIES.replace("  torque:", "  big: {type: Gain, gain: 1e308}\n  torque:")
    text = text.replace("[source.out, torque.torque]", "[source.out, torque.torque, big.in]")
    two.write_text(text.replace("height: 1}", "height: 100}").replace("record: [", "record: [big.out, "))
    with pytest.raises(SimulationError, match=r"diverged at t = 0 s: output 'big\.out' is not finite"):
        simulate(load(two).build(), 1.0)


def test_linear_models_without_finite_entries_are_refused() -> None:
    model = load("srv02-3mass-b2").build()
    with pytest.raises(ParameterError, match=r"the derivatives of the rate of state '.*' are not finite"):
        linearise(model, parameters={"motor.back_emf_constant": 1e308, "motor.resistance": 1e-300})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"step": 1e-10}, "step is 1e-10 s"),
        ({"step": 1e-300}, "step is 1e-300 s"),
        ({"stop": 1e306}, "rows of 2 numbers are too many"),
        ({"stop": 1e300, "step": 1e299}, r"exceed 1e\+09 steps"),
        ({"internal_step": 1e-12}, r"exceed 1e\+09 steps"),
        ({"internal_step": 0.0}, "internal_step is 0"),
        ({"drive": Drive([0, 1e300], np.zeros((2, 1)))}, r"times up to 1e\+300 s"),
        ({"drive": Drive([0, np.inf], np.zeros((2, 1)))}, "not finite"),
        ({"drive": Drive([0, 0], np.zeros((2, 1)))}, "runs backwards"),
        ({"drive": Drive([], [])}, r"instants have shape \(0,\)"),
        (
            {"drive": Drive([0, 1], [1.0, 2.0, 3.0])},
            r"values have shape \(3,\); it has 2 instants and the model 1 input",
        ),
        ({"drive": Drive([0, 1], [[1.0, 2.0]])}, r"shape \(1, 2\); .*\n  give shape \(2, 1\)"),
        ({"drive": Drive([0, 1], np.zeros((2, 2)))}, r"shape \(2, 2\); it has 2 instants and the model 1 input"),
        ({"drive": Drive([0, 1], np.zeros((2, 1)), "lienar")}, r"no hold 'lienar'\n  did you mean 'linear'\?"),
        ({"drive": Drive([0, 1], np.zeros((2, 1)), ())}, "0 holds for 1 input"),
    ],
)
def test_times_out_of_proportion(arguments: dict[str, Any], message: str, two: Path) -> None:
    model = load(two).build(["torque.torque"])
    with pytest.raises(FlexarmError, match=message) as caught:
        simulate(model, **{"stop": 1.0, **arguments})
    explained(caught.value)


def test_a_sampled_block_that_ticks_too_often(two: Path) -> None:
    text = TWO_BODIES.replace("  torque:", "  filter: {type: SampleHold, period: 1e-12}\n  torque:")
    two.write_text(text.replace("[source.out, torque.torque]", "[source.out, torque.torque, filter.in]"))
    with pytest.raises(FlexarmError, match=r"'filter\S*', every 1e-12 s"):
        simulate(load(two).build(), 1.0)


def test_a_pulse_train_that_switches_too_often(two: Path) -> None:
    two.write_text(
        TWO_BODIES.replace("type: Step, height: 1", "type: Pulse, height: 1, width: 1e-11, period: 3e-11, count: 0")
    )
    with bounded(20, steps=1_000_000_000), pytest.raises(SimulationError, match=r"'source\S*' changes more than"):
        simulate(load(two).build(), 1.0)


@pytest.mark.parametrize(
    ("unit", "rows", "message"),
    [
        ("1e-300", ["1", "2", "3"], "samples are 1e-303 s apart"),
        ("1", ["1e200", "2e200", "3e200"], r"holds more than 1e\+100"),
        ("1", ["1e-200", "2e-200", "3e-200"], "is constant"),
    ],
)
def test_recordings_out_of_proportion(unit: str, rows: list[str], message: str, two: Path) -> None:
    from diagnosis.compare import compare

    table = [f"{k * float(unit) * 1e-3!r},{row}" for k, row in enumerate(rows)]
    (two.parent / "data.csv").write_text("\n".join(["time,a.shaft.angle", *table]))
    with pytest.raises(FlexarmError, match=message):
        compare(load(two), two.parent / "data.csv")


def test_a_block_whose_values_overflow_is_named() -> None:
    with pytest.raises(ParameterError, match=r"blocks\.trajectory: .* a limit is out of all proportion"):
        load("srv02-tracking", ["trajectory.jerk_limit=1e201 rad/s3"])
