"""Loading: values and units, named parameters, starting values, overrides, sub-assemblies."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from engine.errors import FlexarmError
from engine.simulate import simulate
from scenarios.document import parse
from scenarios.load import load, shipped_names

ARM = """\
schema: 1
name: arm
parameters: {span: 0.4 m, tip: 0 kg}
blocks:
  gear: {type: Gear, ratio: 70}
  link: {type: RigidLink, length: $span, mass: 65 g, payload: $tip}
connect:
  - [gear.output, link.hub]
expose: {drive: gear.input, axis: link.hub}
initial: {link.hub.angle: 10 deg}
"""

WHOLE = """\
schema: 1
name: whole
parameters: {reach: 0.5 m, push: 1 mN.m}
blocks:
  source: {type: Step, height: $push}
  rotor: {type: Inertia, inertia: 1e-5}
  torque: {type: Torque}
  left: {type: ./parts/arm.yaml, parameters: {span: $reach}, gear.ratio: 50}
  right: {type: ./parts/arm.yaml, link.mass: 100 g}
connect:
  - [source.out, torque.torque]
  - [torque.shaft, rotor.shaft, left.drive, right.gear.input]
initial: {right.axis.angle: 0.7 rad}
simulate: {stop: 1 s, record: [left.axis.angle, right.link.hub.angle]}
"""


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.yaml").write_text(ARM)
    (tmp_path / "whole.yaml").write_text(WHOLE.replace("initial: {right.axis.angle: 0.7 rad}\n", ""))
    return tmp_path / "whole.yaml"


def small(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(f"schema: 1\nname: small\n{text}")
    return path


def test_yaml_is_1_2() -> None:
    """on and no are texts, 0777 is decimal, 1e3 a number, quoted numbers are texts, no date is made."""
    document = parse("a: on\nb: no\nc: 0777\nd: 1e3\ne: '1'\nf: 2001-01-01\ng: 0o17\nh: 12:30\ni: true\nj: ~\nk: .5\n")
    assert document.plain() == {
        "a": "on",
        "b": "no",
        "c": 777,
        "d": 1000.0,
        "e": "1",
        "f": "2001-01-01",
        "g": 15,
        "h": "12:30",
        "i": True,
        "j": None,
        "k": 0.5,
    }
    assert document.where("k").line == 11


def test_anchors_can_be_used(tmp_path: Path) -> None:
    text = "blocks:\n  a: &j {type: Inertia, inertia: 2 g.cm2}\n  b: *j\n"
    assert load(small(tmp_path, text), ["b.inertia=3"]).system.blocks["a"].values["inertia"] == pytest.approx(2e-7)


def test_sub_assemblies(whole: Path) -> None:
    system = load(whole).system
    assert list(system.blocks) == ["source", "rotor", "torque", "left.gear", "left.link", "right.gear", "right.link"]
    assert system.blocks["left.link"].values["length"] == 0.5
    assert system.blocks["right.link"].values["length"] == 0.4
    assert system.blocks["left.gear"].values["ratio"] == 50
    assert system.blocks["right.link"].values["mass"] == pytest.approx(0.1)
    assert system.shared["left.link"] == {"length": "reach", "payload": "left.tip"}
    assert system.shared["right.link"] == {"length": "right.span", "payload": "right.tip"}
    assert system.initial["left.link.hub.angle"] == pytest.approx(np.deg2rad(10))
    simulation = load(whole).simulation
    assert simulation is not None
    assert simulation.record == ("left.link.hub.angle", "right.link.hub.angle")


@pytest.mark.parametrize(
    ("given", "path"),
    [
        ("simulate: {stop: 1 s, record: [rotor.shaft.speed, left.axis.force]}", "simulate.record[1]"),
        (
            "analyses: {a: {kind: linearise, inputs: [left.axis.pull], outputs: [rotor.shaft.speed]}}",
            "analyses.a.inputs[0]",
        ),
        ("analyses: {a: {kind: export, inputs: [torque.torque], outputs: [left.axis.force]}}", "analyses.a.outputs[0]"),
        (
            "analyses: {a: {kind: export, inputs: [torque.torque, torque.torque], outputs: [rotor.shaft.speed]}}",
            "analyses.a.inputs[0]",
        ),
    ],
)
def test_a_signal_that_is_wrong_is_named_with_its_place(whole: Path, given: str, path: str) -> None:
    """By the name that the file uses, though the engine speaks of what an exposed name stands for."""
    text = whole.read_text()
    start = text.index("simulate:")
    whole.write_text(text[:start] + given + "\n")
    scenario = load(whole)
    analysis = scenario.analyses.get("a")
    with pytest.raises(FlexarmError) as caught:
        scenario.build(*((analysis.inputs, analysis.outputs) if analysis else ()))
    where = caught.value.where
    assert where is not None
    assert (where.path, where.line) == (path, text[:start].count("\n") + 1)


def test_sub_assemblies_equal_the_flat_system(whole: Path) -> None:
    """J = rotor + sum (m L^2 / 3) / n^2, angle = torque t^2 / (2 J n)."""
    scenario = load(whole, ["initial.left.link.hub.angle=0", "initial.right.link.hub.angle=0"])
    result = simulate(scenario.build(), 1.0)
    inertia = 1e-5 + 0.065 * 0.5**2 / 3 / 50**2 + 0.1 * 0.4**2 / 3 / 70**2
    assert result["left.link.hub.angle"][-1] == pytest.approx(1e-3 / (2 * inertia * 50), rel=1e-9)


def test_set_reaches_into_a_sub_assembly(whole: Path) -> None:
    changes = ["left.link.mass=1 kg", "reach=0.6", "right.parameters.tip=20 g", "left.gear.ratio=9"]
    blocks = load(whole, changes).system.blocks
    assert blocks["left.link"].values["mass"] == 1
    assert blocks["left.link"].values["length"] == 0.6
    assert blocks["left.gear"].values["ratio"] == 9
    assert blocks["right.link"].values["payload"] == pytest.approx(0.02)
    assert blocks["right.link"].values["mass"] == pytest.approx(0.1)


def test_set_replaces_a_whole_block() -> None:
    """Its wires stay; a block of an unknown type is refused, and so is a mapping without a type."""
    blocks = load("srv02-bare", ["motor={type: DCMotor, resistance: 3 ohm, torque_constant: 0.01}"]).system.blocks
    assert blocks["motor"].values["resistance"] == 3
    assert blocks["motor"].values["efficiency"] == 1
    with pytest.raises(FlexarmError, match="there is no block type 'DCMotro'"):
        load("srv02-bare", ["motor={type: DCMotro}"])
    with pytest.raises(FlexarmError, match=r"(?s)'motor' is a block, not a value.*the whole block: motor={type"):
        load("srv02-bare", ["motor={resistance: 3 ohm}"])


@pytest.mark.parametrize(
    ("old", "new", "pieces"),
    [
        ("gear.ratio: 50", "gaer.ratio: 50", ["whole.yaml:8", "did you mean 'gear'?"]),
        ("gear.ratio: 50", "gear.ratoi: 50", ["whole.yaml:8", "did you mean 'ratio'?"]),
        ("span: $reach", "spun: $reach", ["whole.yaml:8", "did you mean 'span'?"]),
        ("span: $reach", "span: $raech", ["whole.yaml:8", "did you mean 'reach'?"]),
        ("./parts/arm.yaml, p", "./parts/amr.yaml, p", ["whole.yaml:8", "amr.yaml"]),
        ("left.drive", "left.dirve", ["whole.yaml:12", "'left.dirve'"]),
    ],
)
def test_errors_in_sub_assemblies(old: str, new: str, pieces: list[str], whole: Path) -> None:
    text = whole.read_text()
    assert old in text
    whole.write_text(text.replace(old, new, 1))
    with pytest.raises(FlexarmError) as found:
        load(whole).build()
    for piece in pieces:
        assert piece in str(found.value)


def test_errors_inside_a_sub_assembly_name_its_file(whole: Path) -> None:
    inner = whole.parent / "parts" / "arm.yaml"
    inner.write_text(ARM.replace("mass: 65 g", "mass: 65 s"))
    with pytest.raises(FlexarmError, match=r"arm\.yaml:6: blocks\.link\.mass"):
        load(whole)


def test_sub_assemblies_that_contain_each_other(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("schema: 1\nname: a\nblocks:\n  b: {type: ./b.yaml}\n")
    (tmp_path / "b.yaml").write_text("schema: 1\nname: b\nblocks:\n  a: {type: a.yaml}\n")
    with pytest.raises(FlexarmError, match=r"b\.yaml:4.*a\.yaml -> b\.yaml -> a\.yaml"):
        load(tmp_path / "a.yaml")


def test_multiplying_sub_assemblies(tmp_path: Path) -> None:
    """Each level takes in the next one ten times: refused, not built."""
    for level in range(8):
        inner = "\n".join(f"  b{k}: {{type: ./l{level + 1}.yaml}}" for k in range(10))
        (tmp_path / f"l{level}.yaml").write_text(f"schema: 1\nname: l\nblocks:\n{inner}\n")
    (tmp_path / "l8.yaml").write_text("schema: 1\nname: l\nblocks:\n  j: {type: Inertia, inertia: 1}\n")
    with pytest.raises(FlexarmError, match="more than 10000 blocks"):
        load(tmp_path / "l0.yaml")


def test_starting_values_have_units(tmp_path: Path) -> None:
    text = "blocks:\n  j: {type: Inertia, inertia: 1}\ninitial: {j.shaft.angle: 90 deg, j.shaft.speed: 60 rpm}\n"
    result = simulate(load(small(tmp_path, text)).build(), 1.0)
    assert result["j.shaft.angle"][0] == pytest.approx(np.pi / 2)
    assert result["j.shaft.angle"][-1] == pytest.approx(2.5 * np.pi)


@pytest.mark.parametrize(
    ("entry", "piece"),
    [
        ("j.shaft.angle: 1 m", "'rad' is expected"),
        ("j.shaft.angel: 1", "did you mean 'j.shaft.angle'?"),
        ("j.shaft.acceleration: 1", "acceleration"),
        ("j.shaft.angle: $x", "'$x' names no parameter"),
    ],
)
def test_bad_starting_values(entry: str, piece: str, tmp_path: Path) -> None:
    path = small(tmp_path, f"blocks:\n  j: {{type: Inertia, inertia: 1}}\ninitial: {{{entry}}}\n")
    with pytest.raises(FlexarmError) as found:
        load(path).build()
    assert piece in str(found.value)
    assert "small.yaml:5" in str(found.value)


def test_named_parameters_are_one_parameter_of_the_model(tmp_path: Path) -> None:
    text = (
        "parameters: {size: 2 g.cm2, end: 3 s}\n"
        "blocks:\n  a: {type: Inertia, inertia: $size}\n  b: {type: Inertia, inertia: $size}\n"
        "  s: {type: SpringDamper, stiffness: 1}\nconnect:\n  - [a.shaft, s.a]\n  - [s.b, b.shaft]\n"
        "simulate: {stop: $end}\n"
    )
    scenario = load(small(tmp_path, text), ["size=5 g.cm2"])
    model = scenario.build()
    size = model.parameters[model.parameter_index("size")]
    assert size.users == ("a.inertia", "b.inertia")
    assert size.value == pytest.approx(5e-7)
    assert scenario.simulation is not None
    assert scenario.simulation.stop == 3


def test_one_name_for_two_quantities_is_refused(tmp_path: Path) -> None:
    text = "parameters: {x: 1}\nblocks:\n  a: {type: Inertia, inertia: $x}\n  g: {type: Gear, ratio: $x}\n"
    with pytest.raises(FlexarmError, match=r"small\.yaml:6.*kg\.m2"):
        load(small(tmp_path, text))


def test_tables_lie_beside_the_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "u.csv").write_text("time,u\n0,0\n1,2\n")
    path = tmp_path / "deep" / "s.yaml"
    path.write_text(
        "schema: 1\nname: s\nblocks:\n  t: {type: Table, file: u.csv, column: u, hold: linear, scale: 1 N.m}\n"
        "  q: {type: Torque}\n  j: {type: Inertia, inertia: 1}\n"
        "connect:\n  - [t.out, q.torque]\n  - [q.shaft, j.shaft]\n"
    )
    monkeypatch.chdir(tmp_path)
    result = simulate(load("deep/s.yaml").build(), 1.0)
    assert result["j.shaft.speed"][-1] == pytest.approx(1.0)


def test_digest_follows_content(whole: Path) -> None:
    first = load(whole).digest
    assert load(whole).digest == first
    assert load(whole, ["reach=0.6"]).digest != first
    inner = whole.parent / "parts" / "arm.yaml"
    inner.write_text(ARM + "\n# note\n")
    assert load(whole).digest != first


def test_digest_is_that_of_the_text_that_is_read_in_place_of_the_file(whole: Path) -> None:
    first, text = load(whole).digest, whole.read_text(encoding="utf-8")
    assert load(whole, text=text).digest == first
    assert load(whole, text=f"{text}\n# changed\n").digest != first


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("-5 %", "a tolerance of -5 %\n  give a share such as 0.1"),
        ("abc", "'abc' is not a number"),
        ("5", "a tolerance of 5 is 500 %\n  write '5 %', or '500 %' if it is"),
        ("5 V", "'5 V': unit 'V' does not fit"),
    ],
)
def test_a_tolerance_that_is_no_share_is_named_with_its_place(tmp_path: Path, given: str, told: str) -> None:
    path = small(tmp_path, f"blocks: {{m: {{type: Inertia, inertia: 1.0}}}}\ntolerances:\n  m.inertia: {given}\n")
    with pytest.raises(FlexarmError, match=rf"small.yaml:5: tolerances.m.inertia: {re.escape(told)}"):
        load(path)


def test_a_tolerance_of_what_is_no_parameter_is_named_with_its_place(tmp_path: Path) -> None:
    blocks = "blocks: {s: {type: Step, height: 1}, t: {type: Torque}, m: {type: Inertia, inertia: 1.0}}"
    wires = "connect: [[s.out, t.torque], [t.shaft, m.shaft]]"
    made = load(small(tmp_path, f"{blocks}\n{wires}\ntolerances: {{m.inertja: 5 %}}\n"))
    with pytest.raises(FlexarmError, match=r"small.yaml:5: tolerances.m.inertja: the model has no .*\n.*'m.inertia'"):
        made.tolerances_of(made.build())


@pytest.mark.parametrize(
    ("inertia", "told"),
    [
        ("$own", "'m.inertia' follows 'own'\n  state the tolerance of 'own'"),
        ("$own * $n^2 / 2", "'m.inertia' follows 'own' and 'n'\n  state the tolerance of 'own' and 'n'"),
    ],
)
def test_a_tolerance_of_what_follows_common_parameters_names_these(tmp_path: Path, inertia: str, told: str) -> None:
    blocks = f"blocks: {{s: {{type: Step, height: 1}}, t: {{type: Torque}}, m: {{type: Inertia, inertia: {inertia}}}}}"
    wires = "connect: [[s.out, t.torque], [t.shaft, m.shaft]]"
    common = "parameters: {own: 1 kg.m2, n: 2}"
    made = load(small(tmp_path, f"{common}\n{blocks}\n{wires}\ntolerances: {{m.inertia: 5 %}}\n"))
    with pytest.raises(FlexarmError) as caught:
        made.tolerances_of(made.build())
    assert str(caught.value).endswith(f"small.yaml:6: tolerances.m.inertia: {told}")


@pytest.mark.parametrize(("given", "share"), [("5 %", 0.05), ("0.2", 0.2), ("1", 1.0), ("300 %", 3.0), ("0", 0.0)])
def test_tolerances_are_shares(tmp_path: Path, given: str, share: float) -> None:
    path = small(tmp_path, f"blocks: {{m: {{type: Inertia, inertia: 1.0}}}}\ntolerances: {{m.inertia: {given}}}\n")
    assert load(path).tolerances == {"m.inertia": pytest.approx(share)}


def test_starting_values_that_contradict_are_named_with_their_place(tmp_path: Path) -> None:
    blocks = "blocks: {a: {type: Inertia, inertia: 1}, g: {type: Gear, ratio: 4}, b: {type: Inertia, inertia: 1}}"
    wires = "connect: [[a.shaft, g.input], [g.output, b.shaft]]"
    path = small(tmp_path, f"{blocks}\n{wires}\ninitial:\n  a.shaft.speed: 1\n  b.shaft.speed: 2\n")
    with pytest.raises(FlexarmError) as caught:
        load(path).build()
    assert re.search(r"small.yaml:[67]: initial.[ab].shaft.speed: initial value of '[ab]", str(caught.value))
    assert "a.shaft.speed" in str(caught.value)
    assert "b.shaft.speed" in str(caught.value)


def test_a_flange_that_nothing_is_connected_to_is_named(tmp_path: Path) -> None:
    path = small(tmp_path, "blocks: {m: {type: Inertia, inertia: 1}, e: {type: Encoder, counts_per_revolution: 64}}\n")
    with pytest.raises(
        FlexarmError, match=r"has no inertia, and nothing is connected to e.shaft\n  connect it, or give"
    ):
        load(path).build()


def test_shipped_names() -> None:
    assert {
        "quanser-single-link",
        "quanser-single-link-no-dead-zone",
        "srv02-bare",
        "srv02-2mass-b1",
        "srv02-2mass-b3",
    } <= set(shipped_names())


@pytest.mark.parametrize(
    ("files", "told"),
    [
        (["rig.yaml", "notes.txt"], "give a scenario in it: {0}/rig.yaml"),
        ([".rig.yaml", "pipeline.yml", "rig.yaml"], "give a scenario in it: {0}/.rig.yaml, {0}/rig.yaml$"),
        ([f"{k}.yml" for k in range(7)], "give a scenario in it: {0}/0.yml, .*{0}/4.yml, ..."),
        ([], "allowed: "),
    ],
)
def test_of_a_folder_the_scenarios_in_it_are_named(tmp_path: Path, files: list[str], told: str) -> None:
    for name in files:
        (tmp_path / name).write_text("steps: {}\n" if "pipeline" in name else "blocks: {}\n", encoding="utf-8")
    with pytest.raises(FlexarmError, match="is a folder") as caught:
        load(str(tmp_path))
    assert re.search(told.format(re.escape(str(tmp_path))), caught.value.remedy)


def test_the_tolerance_of_a_vector_is_that_of_each_value_without_one_of_its_own(tmp_path: Path) -> None:
    arm = "{type: SerialArm, links: 3, modes: 0, length: 0.2 m, mass: [20 g, 15 g, 10 g]}"
    stated = "tolerances: {arm.mass: 5 %, 'arm.mass[2]': 20 %, arm.payload: 0}"
    blocks = f"blocks: {{s: {{type: Step, height: 1}}, t: {{type: Torque}}, arm: {arm}}}"
    wires = "connect: [[s.out, t.torque], [t.shaft, arm.joint1]]"
    made = load(small(tmp_path, f"{blocks}\n{wires}\n{stated}\n"))
    payload = {f"arm.payload[{k}]": 0.0 for k in (1, 2, 3)}
    expected = {"arm.mass[1]": 0.05, "arm.mass[2]": 0.2, "arm.mass[3]": 0.05, **payload}
    assert made.tolerances_of(made.build()) == pytest.approx(expected)
