"""Whatever is wrong with the input: exit code 1; file, line, key and remedy on stderr; nothing is written."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

BAD = {
    "misspelled key": ("ratio: 70", "ratoi: 70", ["base.yaml:8", "blocks.gear.ratoi", "did you mean 'ratio'?"]),
    "misspelled section": ("\nsimulate:", "\nsimulte:", ["base.yaml:15", "'simulte'", "did you mean 'simulate'?"]),
    "misspelled setting": ("stop: 0.1 s", "stpo: 0.1 s", ["base.yaml:15", "simulate.stpo", "did you mean 'stop'?"]),
    "wrong unit": ("7.68 mN.m/A", "7.68 V", ["base.yaml:7", "blocks.motor.torque_constant", "'7.68 V'", "'N.m/A'"]),
    "unknown unit": ("7.68 mN.m/A", "7.68 xyz", ["base.yaml:7", "unknown unit 'xyz'", "N.m/rad"]),
    "wrong time": ("stop: 0.1 s", "stop: 0.1 V", ["base.yaml:15", "simulate.stop", "'s' is expected"]),
    "missing connection": (
        "  - [zone.out, motor.voltage]\n",
        "",
        ["base.yaml:7", "motor.voltage", "not connected", "V"],
    ),
    "two sources": (
        "motor.voltage]\n",
        "motor.voltage]\n  - [source.out, motor.voltage]\n",
        ["base.yaml:13", "connect[2]", "two sources", "'zone.out'", "'source.out'", "Sum"],
    ),
    "two sources in one node": ("[zone.out, ", "[zone.out, source.out, ", ["base.yaml:12", "connect[1]", "Sum"]),
    "massless node": (
        "connect:",
        "  spring: {type: SpringDamper, stiffness: 1}\nconnect:\n  - [load.shaft, spring.a]",
        ["base.yaml:10", "spring.b", "no inertia", "Inertia"],
    ),
    "wrong kinds": ("load.shaft]", "source.out]", ["base.yaml:14", "connect[3]", "flange 'gear.output'", "sensor"]),
    "misspelled connector": ("zone.out, motor", "zone.otu, motor", ["base.yaml:12", "did you mean 'zone.out'?"]),
    "misspelled block": ("load.shaft]", "laod.shaft]", ["base.yaml:14", "'laod.shaft'", "did you mean 'load'?"]),
    "misspelled type": ("DCMotor", "DCMotro", ["base.yaml:7", "blocks.motor.type", "did you mean 'DCMotor'?"]),
    "misspelled parameter": ("$supply", "$suply", ["base.yaml:5", "'$suply'", "did you mean 'supply'?"]),
    "misspelled record": ("load.shaft.angle]}\nan", "load.shaft.angel]}\nan", ["base.yaml:15", "record[2]", "did you"]),
    "missing parameter": ("ratio: 70", "inertia: 0", ["base.yaml:8", "needs 'ratio'", "give ratio"]),
    "missing setting": ("stop: 0.1 s, ", "", ["base.yaml:15", "simulate.stop", "missing", "give stop"]),
    "step beyond the end": ("stop: 0.1 s", "stop: 0.1 s, step: 3 s", ["base.yaml:15", "simulate.step", "is longer"]),
    "out of range": ("ratio: 70", "ratio: 0", ["base.yaml:8", "blocks.gear.ratio", "must be other than 0"]),
    "NaN": ("ratio: 70", "ratio: .nan", ["base.yaml:8", "blocks.gear.ratio", "not a finite number"]),
    "no number": ("ratio: 70", "ratio: yes", ["base.yaml:8", "'yes' is not a number", "write"]),
    "empty value": ("ratio: 70", "ratio: null", ["base.yaml:8", "blocks.gear.ratio", "no value"]),
    "twice the same key": ("  load:", "  gear:", ["base.yaml:9", "'gear'", "line 8"]),
    "decimal comma": ("ratio: 70", "ratio: 0,7", ["base.yaml:8", "Gear has no parameter '7'", "decimal point"]),
    "missing colon": ("  gear: {", "  gear {", ["base.yaml:8", "not YAML", "a colon and a space"]),
    "tab": ("  gear: {", "\tgear: {", ["base.yaml:8", "not YAML", "spaces, not with tabs"]),
    "indented too far": ("  gear: {", "   gear: {", ["base.yaml:8", "not YAML", "begin in the same column"]),
    "open bracket": ("load.shaft]\n", "load.shaft\n", ["not YAML", "close every [ and {"]),
    "brackets without quotes": ("name: base", "name: base\ndescription: {a: b [c]}", ["not YAML", "quote texts"]),
    "not YAML": ("schema: 1", "schema: [1", ["base.yaml:2", "not YAML"]),
    "another version": ("schema: 1", "schema: 2", ["base.yaml:1", "schema 2", "schema: 1"]),
    "no version": ("schema: 1\n", "", ["'schema' is missing"]),
    "wrong kind of analysis": ("linearise", "linearize", ["base.yaml:17", "analyses.plant.kind", "'linearise'"]),
    "not an input": (
        "inputs: [motor.voltage]",
        "inputs: [motor.volt]",
        ["base.yaml:17", "'motor.volt'", "did you mean"],
    ),
    "an output as an input": (
        "inputs: [motor.voltage]",
        "inputs: [load.shaft.angle]",
        ["base.yaml:17", "analyses.plant.inputs[0]", "'load.shaft.angle' is not an input"],
    ),
    "not a hold": (
        "simulate:",
        "recordings:\n  log:\n    file: log.csv\n    time: {column: t}\n"
        "    drive: {motor.voltage: {column: u, unit: V, hold: zoh}}\n    measurements: {}\nsimulate:",
        ["base.yaml:19", "drive.motor.voltage.hold", "'zoh' is not allowed", "zero_order, linear, band_limited"],
    ),
}


def refused(answer: Any, pieces: list[str], folder: Path, before: set[str]) -> None:
    assert answer.code == 1, answer.err
    assert answer.err.startswith("error: ")
    assert "Traceback" not in answer.err
    for piece in pieces:
        assert piece in answer.err
    assert {path.name for path in folder.iterdir()} == before


@pytest.mark.parametrize("name", BAD)
def test_bad_scenario(name: str, base: Path, command: Callable[..., Any]) -> None:
    old, new, pieces = BAD[name]
    text = base.read_text()
    assert old in text
    base.write_text(text.replace(old, new))
    before = {path.name for path in base.parent.iterdir()}
    verb = "linearise" if name in ("wrong kind of analysis", "not an input", "an output as an input") else "run"
    output = "out.json" if verb == "linearise" else "out.csv"
    refused(command(verb, base.name, "-o", output), pieces, base.parent, before)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["diagnose", "base.yaml"], "no recording to fit to"),
        (["damping", "log.csv", "-c", "ripe"], "did you mean 'rope'?"),
        (["sweep", "base.yaml", "--vary", "gear.ratoi=10:20:3"], "did you mean 'ratio'?"),
    ],
)
def test_what_is_refused_leaves_no_folder(words: list[str], said: str, base: Path, command: Callable[..., Any]) -> None:
    (base.parent / "log.csv").write_text("t,rope\n" + "".join(f"{0.01 * k},{0.9**k}\n" for k in range(40)))
    before = {path.name for path in base.parent.iterdir()}
    refused(command(*words, "-o", "found"), [said], base.parent, before)


def test_algebraic_loop(base: Path, command: Callable[..., Any]) -> None:
    base.write_text(
        """\
schema: 1
name: loop
blocks:
  c: {type: Constant, value: 1}
  s: {type: Sum}
  g: {type: Gain, gain: 2}
connect:
  - [c.out, s.a]
  - [s.out, g.in]
  - [g.out, s.b]
simulate: {stop: 1 s}
"""
    )
    refused(
        command("run", base.name, "-o", "out.csv"),
        ["base.yaml:", "algebraic loop", "s.b", "g.in", "LowPass"],
        base.parent,
        {base.name},
    )


HOSTILE = {
    "aliases": (
        "a0: &a0 [1,1,1,1,1,1,1,1,1,1]\n"
        + "".join(f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)),
        "aliases",
    ),
    "recursion": ("schema: 1\nname: r\nblocks: &b\n  a: *b\n", "bad.yaml:4"),
    "depth": ("schema: 1\na: " + "[" * 3000, "levels deep"),
    "tag": ("schema: 1\nname: !!python/object/apply:os.system ['ls']\n", "bad.yaml:2"),
    "size": ("#" * 5_100_000, "MB"),
    "control character": ("schema: 1\nname: a\x07b\n", "bad.yaml:2"),
    "two documents": ("schema: 1\n---\nschema: 1\n", "bad.yaml:2"),
    "empty": ("", "'schema' is missing"),
    "a word": ("hello\n", "mapping"),
    "itself": ("schema: 1\nname: s\nblocks:\n  a: {type: ./bad.yaml}\n", "includes itself"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_file(name: str, base: Path, command: Callable[..., Any]) -> None:
    text, piece = HOSTILE[name]
    (base.parent / "bad.yaml").write_text(text)
    before = {path.name for path in base.parent.iterdir()}
    refused(command("check", "bad.yaml"), ["bad.yaml", piece], base.parent, before)


def test_not_utf8(base: Path, command: Callable[..., Any]) -> None:
    (base.parent / "bad.yaml").write_bytes("schema: 1\nname: Möbel\n".encode("latin-1"))
    refused(command("check", "bad.yaml"), ["bad.yaml:2", "UTF-8"], base.parent, {"base.yaml", "bad.yaml"})


@pytest.mark.parametrize(
    ("arguments", "pieces"),
    [
        (["--set", "gear.ratoi=3"], ["--set gear.ratoi=3", "did you mean 'ratio'?"]),
        (["--set", "gaer.ratio=3"], ["--set gaer.ratio=3", "did you mean 'gear'?"]),
        (["--set", "gear=3"], ["is a block", "gear.parameter=value"]),
        (["--set", "gear.ratio"], ["does not set anything"]),
        (["--set", "gear.ratio="], ["no value"]),
        (["--set", "gear.ratio=3 V"], ["--set gear.ratio=3 V", "'V'"]),
        (["--set", "supply=3 m"], ["base.yaml:12", "in m but 'motor.voltage' takes V"]),
        (["--set", "parameters.suply=3"], ["did you mean 'supply'?"]),
        (["--set", "simulate.stpo=3"], ["did you mean 'stop'?"]),
        (["--set", "connect=[]"], ["cannot be changed"]),
        (["--stop", "3 V"], ["--stop", "'s' is expected"]),
        (["--stop", "-3"], ["--stop", "positive"]),
        (["-o", "out.txt"], [".csv, .parquet, .mat"]),
        (["-o", "nowhere/out.csv"], ["'nowhere'"]),
        (["--plot", "nowhere/out.png"], ["'nowhere'"]),
    ],
)
def test_bad_option(arguments: list[str], pieces: list[str], base: Path, command: Callable[..., Any]) -> None:
    refused(command("run", base.name, *arguments), pieces, base.parent, {base.name})


def test_no_such_scenario(base: Path, command: Callable[..., Any]) -> None:
    refused(command("run", "quanser-singel-link"), ["did you mean 'quanser-single-link'?"], base.parent, {base.name})


def test_diverging_simulation_writes_nothing(base: Path, command: Callable[..., Any]) -> None:
    text = base.read_text().replace("simulate: {", "simulate: {internal_step: 0.2, ").replace("0.1 s", "90 s")
    base.write_text(text.replace("record", "step: 200 ms, record"))
    refused(command("run", base.name, "-o", "out.csv"), ["diverged", "t ="], base.parent, {base.name})


@pytest.mark.parametrize("arguments", [[], ["run"], ["rum"], ["run", "a.yaml", "--nonsense"], ["compare"]])
def test_wrong_usage(arguments: list[str], command: Callable[..., Any]) -> None:
    assert command(*arguments).code == 2


def test_as_a_process(base: Path) -> None:
    base.write_text(base.read_text().replace("ratio", "ratoi"))
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-m", "flexarm", "run", "base.yaml", "-o", "out.csv"],
        capture_output=True,
        text=True,
        cwd=base.parent,
        env={"PYTHONPATH": str(root), "PATH": "/usr/bin:/bin"},
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.splitlines() == [
        "error: base.yaml:8: blocks.gear.ratoi: Gear has no parameter 'ratoi'",
        "  did you mean 'ratio'?",
    ]
