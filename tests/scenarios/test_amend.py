"""Edits to a scenario's text: what feeds an input afterwards, what is kept, and that the result loads and runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

import flexarm
from engine.errors import FlexarmError
from scenarios.amend import (
    AtFlange,
    Between,
    Feed,
    InSignal,
    OnSensor,
    Replace,
    Set,
    amended,
    relocated,
    with_overrides,
    without,
)
from scenarios.document import parse as read_scenario
from scenarios.load import load
from scenarios.patch import override as put

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


SHARED = """\
schema: 1
name: shared
blocks:
  a: &gain {type: Gain, gain: &much 3}  # as on its dial
  b: *gain
  c: {type: Gain, gain: *much}
recordings:
  # taken on Monday
  one: &one
    file: a.csv
    time: {column: t, unit: s}
    drive: {motor.voltage: {column: u, unit: V}}
  two:
    <<: *one
    file: b.csv
  three: {<<: [{file: c.csv}, *one], role: hold_out}
"""


def document(text: str) -> Any:
    return read_scenario(text).plain()


def test_an_edit_changes_one_place_and_no_alias_of_it() -> None:
    for name, others in (("a", ("b", "c")), ("b", ("a", "c")), ("c", ("a", "b"))):
        text = amended(SHARED, [Set(name, "gain", 4)])
        before, after = document(SHARED), document(text)
        assert after["blocks"][name]["gain"] == 4
        assert all(after["blocks"][other] == before["blocks"][other] for other in others)
        assert after["recordings"] == before["recordings"]
        assert "<<: *one" in text
        assert {"as on its dial", "taken on Monday"} <= set(comments(text))
    text = amended(SHARED, [Replace("a", "Constant", {"value": 1}, drop=("gain",))])
    assert document(text)["blocks"]["b"] == {"type": "Gain", "gain": 3}


def test_recordings_that_share_are_written_out_where_they_change() -> None:
    text = amended(
        SHARED + "connect: []\n", [InSignal("zone", "DeadZone", "motor.voltage", {"lower": "-1 V", "upper": "1 V"})]
    )
    for recording in document(text)["recordings"].values():
        assert recording["drive"] == {"zone.in": {"column": "u", "unit": "V"}}
    moved = relocated(SHARED, Path("/here"), Path("/there"))
    assert [entry["file"] for entry in document(moved)["recordings"].values()] == [
        "../here/a.csv",
        "../here/b.csv",
        "../here/c.csv",
    ]
    assert "b: *gain" in moved
    alone = without(SHARED, "blocks")
    assert document(alone)["recordings"] == document(SHARED)["recordings"]
    sharing = SHARED.replace("blocks:", "extra: &extra {type: Gain, gain: 1}\nblocks:\n  d: *extra")
    assert document(without(sharing, "extra"))["blocks"]["d"] == {"type": "Gain", "gain": 1}


@pytest.mark.parametrize(
    "override",
    ["gain.gain=2", "supply=3 V", "simulate.stop=0.2 s", "initial.motor.shaft.speed=1", "blocks.motor.resistance=3 ohm",
     "source={type: Sine, amplitude: 1 V, frequency: 2 Hz}", "tolerances.gain.gain=5 %", "simulate.record=[meter.out]"],
)  # fmt: skip
def test_an_override_is_written_as_it_is_read(override: str) -> None:
    written = with_overrides(BENCH, [override])
    assert read_scenario(written).plain() == put(read_scenario(BENCH), override).plain()
    assert comments(written) == comments(BENCH)
    with pytest.raises(FlexarmError, match=r"'gian\.gain' leads nowhere"):
        with_overrides(BENCH, ["gian.gain=2"])


def test_overrides_are_written_in_their_order() -> None:
    """The second one changes the block of the first; an anchor changed in one place stays in the other."""
    written = with_overrides(BENCH, ["gain={type: Saturation, lower: -1, upper: 1}", "gain.upper=2", "gain.upper=3"])
    assert read_scenario(written).plain()["blocks"]["gain"] == {"type": "Saturation", "lower": -1, "upper": 3}
    shared = BENCH.replace("{type: Gain, gain: 0.5}", "&g {type: Gain, gain: 0.5}").replace(
        "{type: Gain, gain: 10}", "*g"
    )
    blocks = read_scenario(with_overrides(shared, ["gain.gain=2"])).plain()["blocks"]
    assert (blocks["gain"]["gain"], blocks["meter"]["gain"]) == (2, 0.5)


@pytest.mark.parametrize(
    "text",
    [
        "a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\n",
        "a: &a {x: 1, y: 2}\nb: {y: 3, <<: *a}\n",
        "a: &a {x: 1}\nb: &b {x: 2, z: [1]}\nc: {<<: [*b, *a], w: 1}\nd: {<<: [*a, *b]}\n",
        "a: &a {x: 1}\nb: &b\n  <<: *a\n  y: 2\nc:\n  <<: *b\n  x: 3\n",
        "b: {<<: {x: 1}, y: 2}\n",
        "b: {<<: [], y: 2}\n",
    ],
)
def test_merge_keys_mean_what_they_mean_in_yaml(text: str) -> None:
    assert read_scenario(text).plain() == parse(text)


@pytest.mark.parametrize(
    ("text", "said", "line"),
    [
        ("a: 1\nb:\n  <<: 3\n", "takes in mappings alone", 3),
        ("a: &a [1]\nb: {<<: *a}\n", "takes in mappings alone", 2),
        ("a: &a {x: 1}\nb:\n  <<: *a\n  <<: *a\n", "given before", 4),
        ("a: {x: 1}\nb: {<<: *a}\n", "names no finished value", 2),
        ("a: &a\n  <<: *a\n", "names no finished value", 2),
    ],
)
def test_merge_keys_that_are_refused(text: str, said: str, line: int) -> None:
    with pytest.raises(FlexarmError, match=said) as caught:
        read_scenario(text)
    assert caught.value.where is not None
    assert caught.value.where.line == line


def test_what_is_merged_keeps_its_line() -> None:
    found = read_scenario("a: &a\n  x: 1\nb:\n  <<: *a\n  y: 2\n", "s.yaml")
    assert str(found.where("b", "x")) == "s.yaml:2: b.x"
    assert str(found.where("b", "y")) == "s.yaml:5: b.y"
    quoted = read_scenario('a: {"<<": 1}\n')
    assert quoted.plain() == {"a": {"<<": 1}}
