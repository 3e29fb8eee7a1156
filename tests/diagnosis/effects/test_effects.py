"""Where effects act: by what block classes say of themselves, with a preload kept, and those of other packages."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from blocks.actuators.dc_motor import DCMotor
from blocks.links.assumed_modes import AssumedModesLink
from blocks.links.inertia import Inertia
from blocks.registry import registry
from diagnosis.api import diagnose, gather, possible_effects
from diagnosis.effects import registered as registering
from diagnosis.effects.catalogue import EFFECTS, candidates, check_names
from diagnosis.effects.effect import Candidate, EffectParameter
from diagnosis.effects.insertion import at_flange, in_joint, in_signal
from diagnosis.effects.places import INPUT, SHAFT
from diagnosis.effects.scales import operating_scales
from diagnosis.problems import problem
from diagnosis.thresholds import SEARCH
from engine.block import Block, flange, parameter, signal_in
from engine.errors import FlexarmError, ParameterError
from engine.ports import TRANSLATIONAL
from engine.simulate import simulate
from scenarios.amend import AtFlange, Between, Replace, Set, amended, without
from scenarios.load import load
from tests.diagnosis.plants import case


class Servo(Block):
    """A motor of another package, with names of its own: tau = c i, u = R i + L i' + c w."""

    cut_after = ("hub",)
    winding_parameters = ("winding_resistance", "winding_inductance")

    winding_resistance = parameter("ohm", ..., "R", gt=0, tolerance=0.1)
    winding_inductance = parameter("H", 0.0, "L", ge=0)
    constant = parameter("N.m/A", ..., "c", gt=0, tolerance=0.1)
    rotor = parameter("kg.m2", ..., "inertia", gt=0, tolerance=0.1)
    voltage = signal_in("V", "u")
    hub = flange("the rotor")

    def stamp(self, net: Any) -> None:
        if self.values["winding_inductance"]:
            i = net.state("current", "A")
            net.derivative(
                i,
                (self.voltage - self.winding_resistance * i - self.constant * self.hub.speed) / self.winding_inductance,
            )
        else:
            i = (self.voltage - self.constant * self.hub.speed) / self.winding_resistance
        net.inertia(self.hub, self.rotor)
        net.force(self.hub, self.constant * i)


class Coupling(Block):
    """A torsion spring of another package, with names of its own."""

    spring_parameters = ("rate", "loss", "wound_by")
    spring_when = (("ratio", 1.0),)

    rate = parameter("N.m/rad", ..., "torque per twist", gt=0, tolerance=0.2)
    loss = parameter("N.m.s/rad", 0.0, "torque per rate of twist", ge=0, tolerance=0.2)
    wound_by = parameter("rad", 0.0, "twist at which it is slack")
    ratio = parameter("1", 1.0, "turns of a per turn of b", gt=0)
    a = flange("one end")
    b = flange("other end")

    def stamp(self, net: Any) -> None:
        twist, rate = self.a.angle - self.ratio * self.b.angle - self.wound_by, self.a.speed - self.ratio * self.b.speed
        torque = self.rate * twist + self.loss * rate
        net.force(self.a, -torque)
        net.force(self.b, self.ratio * torque)


class Boom(AssumedModesLink):
    """A link of another package: it inherits what an `AssumedModesLink` says of itself."""


@pytest.fixture
def own_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    for made in (Servo, Coupling, Boom):
        monkeypatch.setitem(registry(), made.__name__, made)


HEAD = """\
schema: 1
name: rig
blocks:
"""
RUN = "simulate: {stop: 1 s, step: 2 ms}\nrecordings:\n"
RECORDED = """\
  {name}:
    file: {name}.csv
    time: {{column: t, unit: s}}
    drive: {{{drive}: {{column: u, unit: {unit}}}}}
    measurements: {{{signal}: {{column: y, unit: {signal_unit}, noise: 0.01}}}}
    role: {role}
"""


def rig(folder: Any, blocks: str, connect: str, drive: tuple[str, str], signal: tuple[str, str]) -> Any:
    """A scenario of some blocks with two recordings; what was recorded only says how large things are."""
    text = HEAD + blocks + "connect:\n" + connect + RUN
    t = np.arange(0.0, 1.0, 2e-3)
    for name, role in (("one", "train"), ("other", "hold_out")):
        u, y = np.sin(2 * np.pi * 3 * t), 0.2 * np.sin(2 * np.pi * 3 * t + 0.4)
        np.savetxt(folder / f"{name}.csv", np.column_stack([t, u, y]), delimiter=",", header="t,u,y", comments="")
        text += RECORDED.format(
            name=name, role=role, drive=drive[0], unit=drive[1], signal=signal[0], signal_unit=signal[1]
        )
    path = folder / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    return path


SOFT = "{type: SpringDamper, stiffness: 50 N.m/rad, damping: 0.01 N.m.s/rad}"
TRAIN = """\
  torque: {type: Torque}
  rotor: {type: Inertia, inertia: 0.01 kg.m2}
  joint: JOINT
  arm: {type: Inertia, inertia: 0.03 kg.m2}
"""
WIRES = "  - [torque.shaft, rotor.shaft, joint.a]\n  - [joint.b, arm.shaft]\n"


def spring(folder: Any, joint: str) -> Any:
    """Two inertias with a spring between them."""
    blocks = TRAIN.replace("JOINT", joint)
    return rig(folder, blocks, WIRES, ("torque.torque", "N.m"), ("arm.shaft.angle", "rad"))


def mount(folder: Any, joint: str) -> Any:
    """Two masses with a spring between them."""
    blocks = TRAIN.replace("JOINT", joint).replace("Torque", "Force").replace("Inertia, inertia", "Mass, mass")
    wires = WIRES.replace("torque.shaft", "torque.flange").replace(".shaft", ".flange")
    blocks = blocks.replace("kg.m2", "kg")
    return rig(folder, blocks, wires, ("torque.force", "N"), ("arm.flange.position", "m"))


def effects_at(found: list[Candidate], place: str) -> set[str]:
    return {c.effect for c in found if c.place == place}


# -- what other packages' blocks say of themselves ---------------------------------------------------------------------


def test_another_packages_motor_spring_and_link_get_their_effects(tmp_path: Any, own_blocks: None) -> None:
    path = rig(
        tmp_path,
        "  motor: {type: Servo, winding_resistance: 2 ohm, constant: 0.05 N.m/A, rotor: 1e-3 kg.m2}\n"
        "  joint: {type: Coupling, rate: 20 N.m/rad, loss: 0.01 N.m.s/rad}\n"
        "  arm: {type: Boom, length: 1 m, mass: 1 kg, flexural_rigidity: 20 N.m2, hub_inertia: 0.1 kg.m2}\n",
        "  - [motor.hub, joint.a]\n  - [joint.b, arm.hub]\n",
        ("motor.voltage", "V"),
        ("arm.tip.position", "m"),
    )
    found = possible_effects(path)
    assert effects_at(found, "motor") == {"inductance"}
    coil = next(c for c in found if c.effect == "inductance")
    assert coil.edits({"winding_inductance": 2e-3}) == [Set("motor", "winding_inductance", "0.002 H")]
    joint = {"joint_flexibility", "backlash", "hardening_spring", "hysteresis"}
    assert effects_at(found, "motor.hub -> joint.a") == joint
    laws = {"hardening_spring", "backlash", "one_sided_contact", "hysteresis", "structural_damping"}
    assert effects_at(found, "joint") == laws
    assert effects_at(found, "arm") == {"extra_mode", "centrifugal_stiffening", "payload"}
    more = next(c for c in found if (c.effect, c.place) == ("extra_mode", "arm"))
    assert more.edits({}) == [Set("arm", "modes", 2)]
    loads = [
        next(iter(sizes.values())) for c in found if (c.effect, c.place) == ("payload", "arm") for sizes in c.starts
    ]
    for mass in (0.01, 0.1, 0.9, 2.5, 8.0):  # kg, of an arm of 1 kg
        assert any(1 / SEARCH.factor < mass / load < SEARCH.factor for load in loads), mass


@pytest.mark.parametrize("trait", ["cut_after", "winding_parameters"])
def test_a_block_that_says_nothing_of_its_winding_gets_none(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch, trait: str
) -> None:
    """The class's name decides nothing: a DCMotor that takes back what DCMotor says is left alone.

    Which block drives a node only orders its sides: a node is cut whoever drives it.
    """
    silent = type("DCMotor", (DCMotor,), {trait: ()})
    monkeypatch.setattr("blocks.actuators.dc_motor.DCMotor", silent)
    path = rig(
        tmp_path,
        "  motor: {type: DCMotor, resistance: 2 ohm, torque_constant: 0.05 N.m/A, rotor_inertia: 1e-3 kg.m2}\n"
        "  arm: {type: Inertia, inertia: 0.1 kg.m2}\n",
        "  - [arm.shaft, motor.shaft]\n",
        ("motor.voltage", "V"),
        ("arm.shaft.angle", "rad"),
    )
    found = possible_effects(path)
    assert ("inductance" in {c.effect for c in found}) == (trait != "winding_parameters")
    first = "arm.shaft -> motor.shaft" if trait == "cut_after" else "motor.shaft -> arm.shaft"
    assert {c.place for c in found if c.effect == "backlash"} == {first}


def test_a_spring_with_names_of_its_own_hands_on_its_values(tmp_path: Any, own_blocks: None) -> None:
    path = spring(tmp_path, "{type: Coupling, rate: 20 N.m/rad, loss: 10 mN.m.s/rad, wound_by: 0.1 rad}")
    harder = next(c for c in possible_effects(path) if (c.effect, c.place) == ("hardening_spring", "joint"))
    (edit,) = harder.edits({"cubic_stiffness": 5.0})
    assert isinstance(edit, Replace)
    assert edit.parameters == {
        "stiffness": "20 N.m/rad",
        "damping": "0.01 N.m.s/rad",
        "rest_angle": "0.1 rad",
        "cubic_stiffness": "5 N.m/rad3",
    }
    assert set(edit.drop) == {"rate", "loss", "wound_by", "ratio"}
    made = load(path, text=amended(without(path.read_text(), "recordings"), [edit]))
    assert made.system.blocks["joint"].values["rest_angle"] == 0.1


def test_it_is_no_linear_spring_at_other_values(tmp_path: Any, own_blocks: None) -> None:
    path = spring(tmp_path, "{type: Coupling, rate: 20 N.m/rad, ratio: 2}")
    assert not effects_at(possible_effects(path), "joint")


def test_twins_along_a_slide_have_the_same_parameters() -> None:
    """Every twin exists, is translational, and has each parameter of the rotational block by the name that is told."""
    twins = {name: made for name, made in registry().items() if made.slide_twin}
    assert set(twins) >= {"Inertia", "BearingFriction", "SpringDamper", "Backlash", "GroundSpring", "QuadraticDrag"}
    for name, made in twins.items():
        twin, names = registry()[made.slide_twin], dict(made.slide_names)
        assert [names.get(p, p) for p in made.parameters] == list(twin.parameters), name
        assert list(made.options) == list(twin.options), name
        flanges = [p for p in twin.ports.values() if p.role == "flange"]
        assert {p.kind for p in flanges} == {TRANSLATIONAL}, name
        assert len(flanges) == sum(p.role == "flange" for p in made.ports.values()), name


# -- preloads ----------------------------------------------------------------------------------------------------------

K, REST = 10.0, 0.2
WOUND = f"{{type: SpringDamper, stiffness: {K} N.m/rad, damping: 0.05 N.m.s/rad, rest_angle: {REST} rad}}"
PLAYLESS = WOUND.replace("SpringDamper", "Backlash").replace("}", ", half_gap: 0 rad, law: two_sided}")


@pytest.mark.parametrize("joint", [WOUND, PLAYLESS])
@pytest.mark.parametrize(
    ("effect", "least"),
    [
        ("hardening_spring", {"cubic_stiffness": 1e-9}),
        ("backlash", {"half_gap": 1e-9}),
        ("hysteresis", {"yield_twist": 1e6, "residual_share": 0.5}),
        ("structural_damping", {"loss_factor": 0.0}),
    ],
)
def test_a_spring_that_another_law_replaces_stays_wound(
    tmp_path: Any, joint: str, effect: str, least: dict[str, float]
) -> None:
    """Two bodies, let go at no twist, swing about the spring's rest: rest (1 - cos(w t)), w^2 = k (1 / J1 + 1 / J2)."""
    path = spring(tmp_path, joint.replace("damping: 0.05 N.m.s/rad", "damping: 0 N.m.s/rad"))
    found = next(c for c in possible_effects(path) if (c.effect, c.place) == (effect, "joint"))
    text = amended(without(path.read_text(), "recordings"), found.edits(least))
    made = load(path, text=text)
    assert made.system.blocks["joint"].values["rest_angle"] == REST
    model = made.build(inputs=["torque.torque"], outputs=["rotor.shaft.angle", "arm.shaft.angle"])
    run = simulate(model, 0.3, 1e-3, internal_step=1e-4)
    twist = run["rotor.shaft.angle"] - run["arm.shaft.angle"]
    w = math.sqrt(K * (1 / 0.01 + 1 / 0.03))
    # A contact that only pushes parts when the spring is slack; up to there it swings like the others.
    until = math.pi / 2 / w if effect == "backlash" else math.inf
    swung = run.time < until
    np.testing.assert_allclose(twist[swung], REST * (1 - np.cos(w * run.time[swung])), rtol=0, atol=2e-5)


def test_a_mount_that_has_play_stays_pressed(tmp_path: Any) -> None:
    path = mount(
        tmp_path, "{type: TranslationalSpringDamper, stiffness: 100 N/m, damping: 1 N.s/m, rest_distance: -0.02 m}"
    )
    loose = next(c for c in possible_effects(path) if (c.effect, c.place) == ("backlash", "joint"))
    made = load(path, text=amended(without(path.read_text(), "recordings"), loose.edits(loose.starts[0])))
    block = made.system.blocks["joint"]
    assert type(block).__name__ == "TranslationalBacklash"
    assert block.values["rest_distance"] == -0.02
    assert block.values["law"] == "push_only"


def test_a_playless_contact_in_a_mount_is_a_spring_too(tmp_path: Any) -> None:
    path = mount(
        tmp_path, "{type: TranslationalBacklash, stiffness: 100 N/m, damping: 1 N.s/m, half_gap: 0 m, law: two_sided}"
    )
    laws = {"hardening_spring", "one_sided_contact", "hysteresis", "structural_damping"}
    assert effects_at(possible_effects(path), "joint") == {"joint_flexibility", "backlash", *laws}


@pytest.mark.parametrize(
    ("effect", "least"),
    [
        ("hardening_spring", {"cubic_stiffness": 1e-9}),
        ("hysteresis", {"yield_compression": 1e6, "residual_share": 0.5}),
        ("structural_damping", {"loss_factor": 0.0}),
    ],
)
def test_a_sliding_spring_that_another_law_replaces_stays_pressed(
    tmp_path: Any, effect: str, least: dict[str, float]
) -> None:
    """As the shafts above: two masses swing about the spring's rest, rest (1 - cos(w t)), w^2 = k (1 / m1 + 1 / m2)."""
    path = mount(tmp_path, f"{{type: TranslationalSpringDamper, stiffness: {K} N/m, rest_distance: {REST} m}}")
    found = next(c for c in possible_effects(path) if (c.effect, c.place) == (effect, "joint"))
    assert set(found.starts[0]) >= {p.name for p in found.parameters} == set(least)
    made = load(path, text=amended(without(path.read_text(), "recordings"), found.edits(least)))
    assert type(made.system.blocks["joint"]).__name__.startswith("Translational")
    model = made.build(inputs=["torque.force"], outputs=["rotor.flange.position", "arm.flange.position"])
    run = simulate(model, 0.3, 1e-3, internal_step=1e-4)
    apart = run["rotor.flange.position"] - run["arm.flange.position"]
    w = math.sqrt(K * (1 / 0.01 + 1 / 0.03))
    np.testing.assert_allclose(apart, REST * (1 - np.cos(w * run.time)), rtol=0, atol=2e-5)


# -- effects of other packages -----------------------------------------------------------------------------------------


class Entry:
    """An entry point of a distribution that is not there."""

    def __init__(self, name: str, made: object, distribution: str = "rig-effects") -> None:
        self.name, self.value, self.dist, self._made = (
            name,
            f"rig_effects:{name}",
            SimpleNamespace(name=distribution),
            made,
        )

    def load(self) -> object:
        if isinstance(self._made, Exception):
            raise self._made
        return self._made


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Any:
    def registered(*entries: Entry) -> None:
        monkeypatch.setattr(registering, "entry_points", lambda group: entries if group == "flexarm.effects" else ())

    return registered


def sticky(scales: Any, place: Any) -> Iterator[Candidate]:
    """Friction of its own at every shaft or slide."""
    if place.kind == SHAFT:
        level = EffectParameter("coulomb_friction", place.torque)
        yield from at_flange(place, "sticky", "BearingFriction", [{"coulomb_friction": 0.01 * place.torque}], level)


def test_a_registered_effect_is_tried_where_it_can_act_and_can_be_left_out(tmp_path: Any, register: Any) -> None:
    path = spring(tmp_path, WOUND)
    before = [c.key for c in possible_effects(path)]
    register(Entry("sticky", sticky), Entry("broken", ImportError("no module named x")))
    with pytest.raises(FlexarmError, match="broken"):
        possible_effects(path)
    found = [c.key for c in possible_effects(path, without=["broken"])]
    assert found == [*before, "sticky at torque.shaft", "sticky at joint.b"]
    assert [c.key for c in possible_effects(path, without=["broken", "sticky"])] == before


def test_two_candidates_of_one_key_are_refused(tmp_path: Any, register: Any) -> None:
    """A search that tells them apart by their keys would try one of them and show the other."""

    def twice(scales: Any, place: Any) -> Iterator[Candidate]:
        yield from sticky(scales, place)
        yield from sticky(scales, place)

    register(Entry("sticky", twice))
    with pytest.raises(FlexarmError, match=r"2 of its candidates have the key 'sticky at torque.shaft'"):
        possible_effects(spring(tmp_path, WOUND))


def test_along_a_slide_the_twin_is_put_in(tmp_path: Any, register: Any) -> None:
    path = mount(tmp_path, "{type: TranslationalSpringDamper, stiffness: 100 N/m}")
    register(Entry("sticky", sticky))
    made = [c for c in possible_effects(path) if c.effect == "sticky"]
    (edit,) = made[0].edits({"coulomb_friction": 0.5})
    assert isinstance(edit, AtFlange)
    assert (edit.type, edit.port, edit.parameters) == (
        "TranslationalBearingFriction",
        "slide",
        {"coulomb_friction": "0.5 N"},
    )


def wrong(**changes: Any) -> Any:
    """An effect whose candidate is wrong in some way."""

    def effect(scales: Any, place: Any) -> list[Any]:
        given: dict[str, Any] = {
            "effect": "odd",
            "edits": lambda sizes: [Set("rotor", "inertia", 1.0)],
            "starts": ({},),
            "parameters": (),
        }
        given |= changes
        rest = {key: given[key] for key in ("edits", "parameters", "starts")}
        return [Candidate(given["effect"], place.name, place.block, "odd", **rest)] if place.kind == SHAFT else []

    return effect


def raises(scales: Any, place: Any) -> list[Candidate]:
    raise KeyError("size")


def unknown_parameter(scales: Any, place: Any) -> Iterator[Candidate]:
    if place.kind == SHAFT:
        yield from at_flange(place, "odd", "BearingFriction", [{"coulombfriction": 1.0}])


def one_flange(scales: Any, place: Any) -> Iterator[Candidate]:
    if place.kind == SHAFT:
        yield from in_joint(place, "odd", "Inertia", [{"inertia": 1.0}])


def unknown_block(scales: Any, place: Any) -> Iterator[Candidate]:
    if place.kind == INPUT:
        yield from in_signal(place, "odd", "DedZone", [{"lower": -1.0, "upper": 1.0}])


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (ImportError("no module named x"), "cannot be imported: ImportError: no module named x"),
        (3, "it is not a function of operating scales and a place"),
        (raises, r"at the input '.*' it raises KeyError: 'size'"),
        (lambda scales, place: None, "it raises TypeError"),
        (lambda scales, place: ["friction"], "it returns 'friction', which is no Candidate"),
        (wrong(effect="odder"), "at the shaft 'torque.shaft' its candidate is called 'odder', not 'odd'"),
        (wrong(starts=()), "has no sizes to start from"),
        (wrong(parameters=(EffectParameter("level", 1.0),)), "a start of its candidate has no 'level'"),
        (wrong(edits=lambda sizes: [sizes["level"]]), "its edits raise KeyError: 'level'"),
        (wrong(edits=lambda sizes: [Between("x", "Spring", "rotor.shaft", "a", "b")]), "no block type 'Spring'"),
        (unknown_parameter, "'BearingFriction' has no parameter 'coulombfriction'.*did you mean 'coulomb_friction'"),
        (one_flange, "it has 1 flange"),
        (unknown_block, "no block type 'DedZone'.*did you mean 'DeadZone'"),
    ],
)
def test_a_bad_effect_names_its_distribution(tmp_path: Any, register: Any, made: Any, message: str) -> None:
    path = spring(tmp_path, WOUND)
    register(Entry("odd", made))
    with pytest.raises(
        FlexarmError, match=rf"(?s)effect 'odd' of distribution 'rig-effects' \(rig_effects:odd\).*{message}"
    ) as caught:
        possible_effects(path)
    assert caught.value.remedy.endswith("--without odd")
    assert possible_effects(path, without=["odd"])


def test_names_in_use_are_refused(register: Any) -> None:
    register(Entry("backlash", sticky))
    with pytest.raises(FlexarmError, match=r"distribution 'rig-effects'.* 'backlash', which flexarm has itself"):
        check_names([])
    other = Entry("sticky", sticky, "other-effects")
    other.value = "other_effects:sticky"
    register(Entry("sticky", sticky), other)
    with pytest.raises(
        FlexarmError, match=r"'other-effects'.* and distribution 'rig-effects'.* both register .*'sticky'"
    ):
        check_names([])


def test_effects_that_are_left_out_must_exist(tmp_path: Any, register: Any) -> None:
    register(Entry("sticky", sticky))
    check_names([*EFFECTS, "sticky"])
    for call in (possible_effects, diagnose):
        with pytest.raises(FlexarmError, match=r"there is no effect 'backlush'\n  did you mean 'backlash'"):
            call(tmp_path / "none.yaml", without=["backlush"])


def test_the_catalogue_lists_the_names_of_its_effects(tmp_path: Any) -> None:
    """Nothing is tried that EFFECTS does not list."""
    for k, joint in enumerate((WOUND, PLAYLESS)):
        folder = tmp_path / str(k)
        folder.mkdir()
        assert {c.effect for c in possible_effects(spring(folder, joint))} <= {*EFFECTS}


# -- what a class may say ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("traits", "message"),
    [
        ({"cut_after": ("shft",)}, "Own.cut_after names 'shft', which is no flange of it\n  did you mean 'shaft'"),
        ({"winding_parameters": ("resistance", "inductanc")}, "no parameter of it\n  did you mean 'inductance'"),
        ({"winding_parameters": ("resistance",)}, "Own.winding_parameters has 1 names\n  give 2"),
        ({"modes_option": "modes"}, "'modes', which is no option of it"),
        ({"spring_when": (("law", "linear"),)}, "'law', which is no parameter or option of it"),
        ({"spring_parameters": ("resistance", "", "")}, "between flanges 'a' and 'b'\n  it has shaft"),
        ({"cut_after": parameter("1", 0.0, "a parameter")}, "declares 'cut_after', which every block has"),
    ],
)
def test_what_a_class_says_must_be_so(traits: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        type("Own", (DCMotor,), traits)
    assert message in str(caught.value)


def test_a_motion_that_is_imposed_needs_its_effort() -> None:
    with pytest.raises(ParameterError, match=r"no output 'torque' tells the effort\n  declare torque = signal_out"):
        type("Own", (Inertia,), {"imposes_motion": ("shaft",)})


def test_the_choices_of_an_effect_are_all_its_starts_apart_by_what_is_only_chosen(tmp_path: Path) -> None:
    listed = possible_effects(case(tmp_path))
    ripple = next(c for c in listed if c.effect == "torque_ripple")
    assert ripple.wave is not None
    choices = ripple.choices()
    orders = [{start["order"] for start in c.starts} for c in choices]
    assert len(choices) > 4
    assert all(len(order) == 1 for order in orders)
    assert len(set.union(*orders)) == len(choices)
    assert [s for c in choices for s in c.starts] == list(ripple.starts)
    for choice, order in zip(choices, orders, strict=True):
        assert choice.key == ripple.key
        assert choice.wave is not None
        assert [start["order"] for start in choice.wave.starts] == [*order]
    # What is only chosen, but looked for finer, stays together, as does what is fitted.
    for whole in ("delay", "coulomb_friction"):
        effect = next(c for c in listed if c.effect == whole)
        assert effect.choices() == [effect]


@pytest.mark.parametrize(("lowest", "tried"), [(-0.04, True), (-0.12, False)])
def test_a_sensor_without_sign_may_be_below_zero_by_its_noise(tmp_path: Path, lowest: float, tried: bool) -> None:
    """The noise is 0.01, the largest value 0.2: five times the noise and a twentieth of it are 0.06."""
    path = spring(tmp_path, "{type: SpringDamper, stiffness: 50 N.m/rad}")
    for file in tmp_path.glob("*.csv"):
        t, u, y = np.loadtxt(file, delimiter=",", skiprows=1).T
        y[:] = np.maximum(np.sin(2 * np.pi * 3 * t) * 0.2, lowest)
        np.savetxt(file, np.column_stack([t, u, y]), delimiter=",", header="t,u,y", comments="")
    assert ("rectified_sensor" in effects_at(possible_effects(path), "arm.shaft.angle")) == tried


@pytest.mark.parametrize(
    ("effect", "size"),
    [("hardening_spring", "cubic_stiffness"), ("backlash", "half_gap"), ("hysteresis", "yield_twist")],
)
def test_a_spring_behind_a_gear_has_the_sizes_of_its_own_side(tmp_path: Path, effect: str, size: str) -> None:
    """What stands for all that turns with the gear is its input, which carries a twentieth of the torque."""
    torque, rotor, joint, arm = TRAIN.replace("JOINT", SOFT).replace("0.03 kg.m2", "3e-4 kg.m2").splitlines(True)
    light = torque + rotor + arm + joint
    ends = ("arm.shaft.angle", "rad")
    geared = light.replace("0.01 kg.m2", "2.5e-5 kg.m2") + "  gear: {type: Gear, ratio: 20}\n"
    wires = "  - [torque.shaft, rotor.shaft, gear.input]\n  - [gear.output, joint.a]\n  - [arm.shaft, joint.b]\n"
    geared += "  scaled: {type: Gain, gain: 0.05, unit: N.m}\n"
    wires += "  - [scaled.out, torque.torque]\n"
    sizes = []
    for name, drive, blocks, connect in (("a", "torque.torque", light, WIRES), ("b", "scaled.in", geared, wires)):
        (tmp_path / name).mkdir()
        found = possible_effects(rig(tmp_path / name, blocks, connect, (drive, "N.m"), ends))
        sizes.append(next(c for c in found if (c.effect, c.place) == (effect, "joint")).starts[0][size])
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-3)


def test_a_dead_zone_is_begun_with_sides_that_differ_too(tmp_path: Path) -> None:
    """Where one side is wider an offset goes with it, and promises more than any zone that is alike on both."""
    scenario = load(case(tmp_path))
    scales = operating_scales(problem(scenario, gather(scenario, (), ())))
    (zone,) = [c for c in candidates(scales) if c.effect == "dead_zone"]
    assert {round(-start["lower"] / start["upper"], 6) for start in zone.starts} == {0.5, 1.0, 2.0}


@pytest.mark.parametrize("samples", [None, 40])
def test_a_lag_is_no_slower_than_the_recordings_are_long(tmp_path: Path, samples: int | None) -> None:
    """One that is passes nothing on: a sensor that is dead, or a drive, and no lag."""
    scenario = load(case(tmp_path))
    for path in tmp_path.glob("*.csv"):
        rows = path.read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text("".join(rows[: samples and samples + 1]), encoding="utf-8")
    asked = problem(scenario, gather(scenario, (), ()))
    longest = max(float(e.time[-1]) for e in asked.experiments)
    lags = [c for c in candidates(operating_scales(asked)) if c.effect in ("lag", "sensor_lag")]
    assert len(lags) > 1
    for lag in lags:
        (corner,) = lag.free(lag.starts[0])
        assert corner.value(-1e9) == pytest.approx(1 / longest)
        assert all(corner.low < start["corner_frequency"] < corner.high for start in lag.starts)


def test_a_stray_spring_may_be_tight_to_either_side_where_a_part_begins(tmp_path: Path) -> None:
    """A spring that rests far from there pulls like an offset, of which one that rests near it shows nothing."""
    scenario = load(case(tmp_path))
    springs = [
        c
        for c in candidates(operating_scales(problem(scenario, gather(scenario, [], []))))
        if c.effect == "stray_spring"
    ]
    assert springs
    for spring in springs:
        angle = spring.parameters[1].reference
        rests = {round(start["rest_angle"] / angle, 3) for start in spring.starts}
        assert {-1.0, 1.0} < rests
