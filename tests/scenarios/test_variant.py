"""A scenario edited in memory is the one whose text was edited: the same equations, names and values."""

from pathlib import Path
from typing import Any

import pytest

from engine.errors import FlexarmError
from scenarios.amend import AtFlange, Between, Edit, Feed, InSignal, OnSensor, ReadAt, Replace, Set, amended
from scenarios.load import Scenario, load
from scenarios.variant import edited, renamed

ARM = """\
schema: 1
name: link
parameters: {length: 0.4 m}
blocks:
  link: {type: RigidLink, length: $length, mass: 65 g}
  joint: {type: SpringDamper, stiffness: 2 N.m/rad, damping: 1 mN.m.s/rad}
connect:
  - [joint.b, link.hub]
expose: {hub: joint.a}
"""
TEXT = """\
schema: 1
name: arm
parameters: {inertia: 1e-5 kg.m2}
blocks:
  source: {type: Sine, amplitude: 1 V, frequency: 2 Hz}
  gain: {type: Gain, gain: 2}
  other: {type: Gain, gain: 3}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: $inertia}
  wheel: {type: Inertia, inertia: $inertia}
  gear: {type: Gear, ratio: 14}
  spring: {type: SpringDamper, stiffness: 5 N.m/rad, damping: 2 mN.m.s/rad, rest_angle: 1 deg}
  load: {type: Inertia, inertia: 1e-3 kg.m2}
  arm: {type: link.yaml}
connect:
  - [source.out, gain.in, other.in]
  - [gain.out, motor.voltage]
  - [motor.shaft, gear.input]
  - [gear.output, wheel.shaft, spring.a]
  - [spring.b, load.shaft, arm.hub]
simulate: {stop: 1 s}
"""
BODY = AtFlange("found_body", "Inertia", "spring.b", "shaft", {"inertia": "1e-4 kg.m2"})
EDITS: dict[str, list[Edit]] = {
    "in a signal": [InSignal("found", "DeadZone", "motor.voltage", {"lower": "-0.1 V", "upper": "0.2 V"})],
    "in a signal of several": [InSignal("found", "Offset", "gain.in", {"offset": "0.1 V"})],
    "at a flange": [AtFlange("found", "BearingFriction", "gear.input", "shaft", {"coulomb_friction": "1 mN.m"})],
    "at an exposed flange": [AtFlange("found", "Inertia", "arm.joint.a", "shaft", {"inertia": "1e-4 kg.m2"})],
    "between two": [Between("found", "SpringDamper", "motor.shaft", "a", "b", {"stiffness": "7 N.m/rad"})],
    "between several": [Between("found", "SpringDamper", "wheel.shaft", "a", "b", {"stiffness": "7 N.m/rad"})],
    "between, others beside the target": [
        Between("found", "SpringDamper", "gear.output", "a", "b", {"stiffness": "7 N.m/rad"}, ("spring.a",))
    ],
    "between, an exposed flange beside the target": [
        BODY,
        Between("found", "SpringDamper", "load.shaft", "a", "b", {"stiffness": "7 N.m/rad"}, ("arm.joint.a",)),
    ],
    "read elsewhere": [ReadAt("load.shaft.angle", "spring.b.angle")],
    "read on the other side of a cut": [
        BODY,
        Between("found", "SpringDamper", "spring.b", "a", "b", {"stiffness": "7 N.m/rad"}, ("found_body.shaft",)),
        ReadAt("load.shaft.angle", "spring.b.angle"),
    ],
    "behind a sensor that is read elsewhere": [
        OnSensor("found_scale", "Gain", "load.shaft.angle", {"gain": "1.1"}),
        BODY,
        Between("found", "SpringDamper", "spring.b", "a", "b", {"stiffness": "7 N.m/rad"}, ("found_body.shaft",)),
        ReadAt("load.shaft.angle", "spring.b.angle"),
    ],
    "behind a sensor": [OnSensor("found", "Gain", "load.shaft.angle", {"gain": "1.1"})],
    "two behind one sensor": [
        OnSensor("found_scale", "Gain", "load.shaft.angle", {"gain": "1.1"}),
        OnSensor("found_lag", "LowPass", "load.shaft.angle", {"corner_frequency": "30 rad/s"}),
    ],
    "a source": [Feed("found", "Constant", "motor.voltage", {"value": "1 V"})],
    "a source of several": [Feed("found", "Constant", "gain.in", {"value": "1 V"})],
    "a value": [Set("motor", "inductance", "1 mH")],
    "a shared value": [Set("motor", "rotor_inertia", "2e-5 kg.m2")],
    "another law": [Replace("spring", "Backlash", {"half_gap": "0.01 rad", "law": "push_only"}, ("rest_angle",))],
    "two": [
        Set("gear", "ratio", "15"),
        Between("found", "Backlash", "gear.output", "a", "b", {"half_gap": "0.01 rad", "stiffness": "7 N.m/rad"}),
    ],
}


@pytest.fixture
def scenario(tmp_path: Path) -> Scenario:
    (tmp_path / "link.yaml").write_text(ARM, encoding="utf-8")
    (tmp_path / "arm.yaml").write_text(TEXT, encoding="utf-8")
    return load(tmp_path / "arm.yaml")


@pytest.mark.parametrize("edits", EDITS.values(), ids=EDITS.keys())
def test_memory_and_text_give_one_model(scenario: Scenario, edits: list[Edit]) -> None:
    outputs = renamed(["load.shaft.angle", "arm.link.hub.speed"], edits)
    text = amended(TEXT, edits, resolve=scenario.resolve)
    written = load(scenario.path, text=text).build((), outputs)
    made = edited(scenario, edits).build((), outputs)
    assert made.signature == written.signature
    assert made.signature != scenario.build((), ["load.shaft.angle", "arm.link.hub.speed"]).signature


def test_a_recording_is_read_where_the_edits_say(scenario: Scenario, tmp_path: Path) -> None:
    """On either side of a cut, and behind a sensor on the signal that moved, whatever the order of the edits."""
    (tmp_path / "run.csv").write_text("t,u,y\n0,0,0\n0.1,1,0.1\n0.2,1,0.3\n", encoding="utf-8")
    recorded = (
        TEXT
        + """\
recordings:
  run:
    file: run.csv
    time: {column: t, unit: s}
    drive: {motor.voltage: {column: u, unit: V}}
    measurements: {load.shaft.angle: {column: y, unit: rad}}
"""
    )
    path = tmp_path / "recorded.yaml"
    path.write_text(recorded, encoding="utf-8")
    given = load(path)
    for name, signal in (
        ("read elsewhere", "spring.b.angle"),
        ("read on the other side of a cut", "spring.b.angle"),
        ("behind a sensor that is read elsewhere", "found_scale.out"),
    ):
        text = amended(recorded, EDITS[name], resolve=given.resolve)
        made = load(path, text=text)
        run: Any = made.recordings["run"]
        assert list(run.measurements) == [signal] == renamed(["load.shaft.angle"], EDITS[name])
        behind = [c.ends for c in made.system.connections if "found_scale.in" in c.ends]
        assert behind == ([("spring.b.angle", "found_scale.in")] if signal == "found_scale.out" else [])


def test_those_beside_the_target_stay_with_it(scenario: Scenario) -> None:
    made = edited(scenario, EDITS["between, others beside the target"]).system
    nodes = {frozenset(c.ends) for c in made.connections}
    assert {"gear.output", "spring.a", "found.a"} in nodes
    assert {"found.b", "wheel.shaft"} in nodes


def test_the_scenario_itself_stays(scenario: Scenario) -> None:
    before = scenario.build().signature
    for edits in EDITS.values():
        edited(scenario, edits)
    assert scenario.build().signature == before


def test_inputs_and_signals_are_renamed() -> None:
    names = ["motor.voltage", "load.shaft.angle"]
    assert renamed(names, EDITS["in a signal"]) == ["found.in", "load.shaft.angle"]
    assert renamed(names, EDITS["behind a sensor"]) == ["motor.voltage", "found.out"]
    assert renamed(names, EDITS["two behind one sensor"]) == ["motor.voltage", "found_lag.out"]


def test_the_second_of_two_behind_a_sensor_follows_the_first(scenario: Scenario) -> None:
    made = edited(scenario, EDITS["two behind one sensor"]).system
    behind = [c.ends for c in made.connections if "found_lag.in" in c.ends]
    assert behind == [("found_scale.out", "found_lag.in")]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (Set("nothing", "gain", 1), "no block 'nothing' of its own"),
        (Set("arm.link", "mass", "1 kg"), "no block 'arm.link' of its own"),
        (AtFlange("motor", "Inertia", "load.shaft", "shaft", {"inertia": 1}), "has a block 'motor' already"),
        (Between("found", "SpringDamper", "arm.link.tip", "a", "b", {"stiffness": 1}), "nothing is connected"),
    ],
)
def test_what_cannot_be_edited_is_told_alike(scenario: Scenario, edit: Edit, message: str) -> None:
    for attempt in (lambda: edited(scenario, [edit]), lambda: amended(TEXT, [edit], resolve=scenario.resolve)):
        with pytest.raises(FlexarmError, match=message):
            attempt()
