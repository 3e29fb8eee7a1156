"""Edits to a scenario's text: what feeds an input afterwards, what is kept, and that the result loads and runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

import flexarm
from engine.errors import FlexarmError
from scenarios.amend import AtFlange, Between, Feed, InSignal, OnSensor, Replace, Set, amended, without
from scenarios.load import load

BENCH = """\
schema: 1
name: bench  # in the cellar
parameters: {supply: 2 V}

blocks:
  # the amplifier's own generator
  source: {type: Step, height: $supply}
  gain: {type: Gain, gain: 0.5}  # as on its dial
  motor:
    type: DCMotor
    resistance: 2.6 ohm  # measured cold
    torque_constant: 7.68 mN.m/A
    rotor_inertia: 4.6e-7 kg.m2
  meter: {type: Gain, gain: 10}

connect:
  - [source.out, gain.in, meter.in]  # both see it
  - [gain.out, motor.voltage]

simulate: {stop: 0.1 s, step: 1 ms, record: [motor.voltage, motor.shaft.speed, meter.out]}

recordings:
  one:
    file: one.csv
    time: {column: t, unit: s}
    drive: {motor.voltage: {column: u, unit: V}}
    measurements: {motor.shaft.speed: {column: w, unit: rad/s}}
"""
RAMP = Feed("ramp", "Sine", "motor.voltage", {"amplitude": "3 V", "frequency": "5 Hz"})


def parse(text: str) -> dict[str, Any]:
    found: dict[str, Any] = YAML(typ="safe").load(text)
    return found


def comments(text: str) -> list[str]:
    return [line.partition("#")[2].strip() for line in text.splitlines() if "#" in line]


def run(text: str, folder: Path) -> flexarm.Result:
    path = folder / "amended.yaml"
    path.write_text(text)
    return flexarm.simulate(load(path))


def connections(text: str) -> list[list[str]]:
    return [list(node) for node in parse(text)["connect"]]


def test_a_feed_takes_the_place_of_what_drove_the_input(tmp_path: Path) -> None:
    text = amended(BENCH, [RAMP])
    assert connections(text) == [["source.out", "gain.in", "meter.in"], ["ramp.out", "motor.voltage"]]
    result = run(text, tmp_path)
    np.testing.assert_allclose(result["motor.voltage"], 3 * np.sin(10 * np.pi * result.time), atol=1e-12)
    np.testing.assert_allclose(result["meter.out"], 20.0)


def test_a_feed_leaves_the_others_of_a_node_alone(tmp_path: Path) -> None:
    text = amended(BENCH, [Feed("pulse", "Step", "meter.in", {"height": "7 V"})])
    assert connections(text)[0] == ["source.out", "gain.in"]
    assert connections(text)[-1] == ["pulse.out", "meter.in"]
    result = run(text, tmp_path)
    np.testing.assert_allclose(result["meter.out"], 70.0)
    np.testing.assert_allclose(result["motor.voltage"], 1.0)


def test_a_feed_drives_an_input_that_nothing_drove(tmp_path: Path) -> None:
    text = amended(BENCH.replace("  - [gain.out, motor.voltage]\n", ""), [RAMP])
    assert connections(text) == [["source.out", "gain.in", "meter.in"], ["ramp.out", "motor.voltage"]]
    result = run(text, tmp_path)
    np.testing.assert_allclose(result["motor.voltage"], 3 * np.sin(10 * np.pi * result.time), atol=1e-12)


def test_a_feed_connects_where_nothing_is_connected(tmp_path: Path) -> None:
    alone = without(BENCH, "connect").replace(", meter.out", "")
    kept = [line for line in alone.splitlines() if not line.startswith(("  source", "  gain", "  meter"))]
    text = amended("\n".join(kept) + "\n", [RAMP])
    assert connections(text) == [["ramp.out", "motor.voltage"]]
    result = run(text, tmp_path)
    np.testing.assert_allclose(result["motor.voltage"], 3 * np.sin(10 * np.pi * result.time), atol=1e-12)


def test_a_feed_keeps_comments_and_says_why_it_is_there() -> None:
    text = amended(BENCH, [RAMP], {"ramp": "To tell two laws apart.\nTurn it up slowly."})
    kept = comments(text)
    for said in comments(BENCH):
        assert said in kept
    lines = text.splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("  ramp:"))
    assert lines[at - 2 : at] == ["  # To tell two laws apart.", "  # Turn it up slowly."]
    assert "$supply" in text


def test_a_feed_does_not_touch_the_recordings() -> None:
    """They were driven as they say; an `InSignal` comes before the input and takes its place in them."""
    assert parse(amended(BENCH, [RAMP]))["recordings"] == parse(BENCH)["recordings"]
    put_in = parse(amended(BENCH, [InSignal("zone", "DeadZone", "motor.voltage", {"lower": "-1 V", "upper": "1 V"})]))
    assert list(put_in["recordings"]["one"]["drive"]) == ["zone.in"]


def test_a_name_that_is_taken_is_refused() -> None:
    for edit in (Feed("gain", "Step", "motor.voltage"), AtFlange("meter", "Inertia", "motor.shaft", "shaft")):
        with pytest.raises(FlexarmError, match=f"has a block '{edit.name}' already"):
            amended(BENCH, [edit])
    for other in (Set("gian", "gain", 2), Replace("gian", "Gain")):
        with pytest.raises(FlexarmError, match="no block 'gian' of its own"):
            amended(BENCH, [other])
    with pytest.raises(FlexarmError, match=r"nothing is connected to 'motor\.shaft'"):
        amended(BENCH, [Between("spring", "SpringDamper", "motor.shaft", "a", "b")])


def test_a_sensor_behind_a_signal_is_what_recordings_measure(tmp_path: Path) -> None:
    text = amended(BENCH, [OnSensor("scale", "Gain", "motor.shaft.speed", {"gain": 2})])
    assert list(parse(text)["recordings"]["one"]["measurements"]) == ["scale.out"]
    result = run(text.replace("record: [", "record: [scale.out, "), tmp_path)
    np.testing.assert_allclose(result["scale.out"], 2 * result["motor.shaft.speed"], rtol=1e-12)


def test_sections_are_left_out_whole() -> None:
    text = without(BENCH, "recordings", "simulate", "analyses")
    assert list(parse(text)) == ["schema", "name", "parameters", "blocks", "connect"]
    assert comments(text) == comments(BENCH)
