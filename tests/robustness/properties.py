"""The properties: for each a strategy and a check that gives ``result`` or ``refused``, and fails on anything else."""

from __future__ import annotations

import functools
import json
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from engine.errors import FlexarmError
from engine.model import Model
from engine.quantity import coherent, convert
from engine.simulate import Drive, simulate
from scenarios.load import SHIPPED, Scenario, load, shipped_names
from tests.robustness.archives import archives, check_archive
from tests.robustness.every_block import check_block, odd_blocks
from tests.robustness.foreign import (
    check_foreign_file,
    check_page,
    check_shared,
    foreign_files,
    pages,
    shared_documents,
)
from tests.robustness.foreign_fmus import check_foreign, foreign
from tests.robustness.guard import REFUSED, RESULT, bounded, explained
from tests.robustness.keepings import check_entry, check_kept, check_state, entries, kept, states
from tests.robustness.strategies import TEXTS, inside, mangled, mutated, odd, quantity, scaled, table


@dataclass(frozen=True)
class Property:
    """A property of the library's behaviour on odd input."""

    title: str
    strategy: Callable[[], st.SearchStrategy[Any]]
    check: Callable[[Any], str]


@functools.cache
def shipped(name: str) -> dict[str, Any]:
    """A shipped scenario as plain values."""
    plain: dict[str, Any] = load(name).document.plain()
    return plain


@functools.cache
def model_of(name: str) -> Model:
    """The model of a shipped scenario."""
    return load(name).build()


def run(scenario: Scenario) -> None:
    """Build a scenario, run a few rows of it in the interpreter, and do its analyses."""
    from flexarm.api import linearise
    from flexarm.cut import cut

    model = scenario.build()
    planned = scenario.simulation
    step = planned.step if planned else 1e-3
    result = simulate(
        model,
        min(planned.stop, 3 * step) if planned else 3 * step,
        step,
        internal_step=planned.internal_step if planned else None,
        record_states=True,
        backend="interpreter",
    )
    assert np.isfinite(result.values).all()
    assert result.states is not None
    assert np.isfinite(result.states).all()
    assert np.isfinite(result.final_memory).all()
    for name, analysis in scenario.analyses.items():
        made = cut(scenario, analysis.kind, name)
        if analysis.kind == "linearise":
            linear = linearise(made)
            for matrix in (linear.A, linear.B, linear.C, linear.D):
                assert np.isfinite(matrix).all()


def loaded(path: Path, overrides: tuple[str, ...] = (), text: str | None = None) -> str:
    """Load and run; an error in the file must name the file."""
    with bounded(steps=400):
        try:
            scenario = load(path, overrides, text=text)
        except FlexarmError as error:
            return explained(error, file=True)
        try:
            run(scenario)
        except FlexarmError as error:
            return explained(error)
        return RESULT


def check_document(given: tuple[str, dict[str, Any]]) -> str:
    """A changed document in place of a shipped scenario."""
    name, tree = given
    return loaded(SHIPPED / f"{name}.yaml", text=json.dumps(tree, ensure_ascii=len(name) % 2 == 0))


def check_bytes(content: bytes) -> str:
    """A file of changed bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "odd.yaml"
        path.write_bytes(content)
        return loaded(path)


def check_override(given: tuple[str, str]) -> str:
    """A ``--set`` on a shipped scenario."""
    return loaded(SHIPPED / f"{given[0]}.yaml", (given[1],))


@st.composite
def overrides(draw: st.DrawFn) -> tuple[str, str]:
    """A scenario and a text for ``--set``."""
    name = draw(st.sampled_from(shipped_names()))
    blocks = shipped(name)["blocks"]
    block = draw(st.sampled_from(sorted(blocks)))
    keys = [f"{block}.{key}" for key in blocks[block]] + ["simulate.stop", "simulate.step", "initial.x", "parameters.x"]
    if draw(st.booleans()):
        numbers = [(key, given) for key, given in blocks[block].items() if quantity(given)]
        if numbers:
            key, given = draw(st.sampled_from(numbers))
            return name, f"{block}.{key}={draw(scaled(given))}"
    key = draw(st.sampled_from(keys) | st.text(max_size=10))
    value = draw(st.sampled_from(TEXTS) | st.text(max_size=10) | st.floats().map(repr) | odd().map(json.dumps))
    return name, f"{key}={value}" if draw(st.integers(0, 9)) else value


def check_parameters(given: tuple[str, dict[str, float]]) -> str:
    """Parameters of a shipped model, simulated for 20 rows with the compiled runtime, then linearised."""
    from engine.linearise import linearise

    name, values = given
    with bounded():
        model = model_of(name)
        try:
            result = simulate(model, 0.02, 1e-3, parameters=values, record_states=True)
            assert np.isfinite(result.values).all()
            assert result.states is not None
            assert np.isfinite(result.states).all()
            assert np.isfinite(result.final_memory).all()
            linear = linearise(model, parameters=values)
            for matrix in (linear.A, linear.B, linear.C, linear.D):
                assert np.isfinite(matrix).all()
        except FlexarmError as error:
            return explained(error)
        return RESULT


@st.composite
def parameter_sets(draw: st.DrawFn) -> tuple[str, dict[str, float]]:
    """A shipped scenario and one to four values for its parameters."""
    name = draw(st.sampled_from(shipped_names()))
    chosen = draw(
        st.lists(st.sampled_from(model_of(name).parameters), min_size=1, max_size=4, unique_by=lambda p: p.name)
    )
    return name, {variable.name: draw(inside(variable.declared)) for variable in chosen}


RECORDED = """\
schema: 1
name: recorded
blocks:
  source: {type: Step, height: 1 V}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7,
          viscous_friction: 1e-6}
connect:
  - [source.out, motor.voltage]
simulate: {stop: 0.1 s, record: [motor.shaft.angle, motor.shaft.speed]}
recordings:
  one:
    file: one.csv
    GAPS
    time: {column: t, unit: ms}
    drive: {motor.voltage: {column: u, unit: mV, hold: linear}}
    measurements:
      motor.shaft.angle: {column: enc, unit: count, counts_per_rev: 4096, sign: -1, zero: first, wrap: true}
      motor.shaft.speed: {column: tach, unit: V, scale: 0.1 rad/s/V}
  two:
    kind: frequency_response
    file: two.csv
    drive: motor.voltage
    frequency: {column: f, unit: Hz}
    amplitude: {column: u, unit: V}
    response: {motor.shaft.speed: {column: w, unit: rad/s}}
"""


def rows() -> list[list[str]]:
    """A sound recording of the motor: time in ms, mV, counts, V."""
    data = [["t", "u", "enc", "tach"]]
    for k in range(20):
        data.append([str(k), "1000", f"{17 - k * k}", f"{10 * k + math.sin(k):.6g}"])
    return data


SWEPT = [["f", "u", "w"], ["1", "2", "250"], ["3", "2", "180"], ["10", "1", "40"]]


def check_recording(given: tuple[bytes, str]) -> str:
    """A table beside a scenario that describes it, or one whose columns are to be matched by name."""
    from diagnosis.compare import compare

    content, way = given
    with tempfile.TemporaryDirectory() as folder, bounded(steps=2_000_000):
        path = Path(folder) / "recorded.yaml"
        path.write_text(RECORDED.replace("GAPS", "gaps: skip" if way == "skip" else "gaps: refuse"))
        recording = Path(folder) / {"mat": "one.mat", "parquet": "one.parquet", "table": "two.csv"}.get(way, "one.csv")
        if way == "matched":
            recording = Path(folder) / "other.csv"
            content = content.replace(b"enc", b"motor.shaft.angle").replace(b"tach", b"motor.shaft.speed [rad/s]")
        elif way in ("mat", "parquet"):
            path.write_text(path.read_text().replace("one.csv", recording.name))
        recording.write_bytes(content)
        scenario = load(path)
        try:
            found = compare(scenario, recording)
        except FlexarmError as error:
            return explained(error)
        for signal in found.signals.values():
            for values in (signal.axis, signal.measured, signal.simulated, signal.rmse):
                assert np.isfinite(values).all()
            assert not np.isnan(signal.nrmse)
        json.dumps(found.numbers(), allow_nan=False)
        return RESULT


def recordings() -> st.SearchStrategy[Any]:
    """Content of a recording and how it is read."""
    ways = st.sampled_from(["refuse", "skip", "matched"])
    binary = st.tuples(
        st.binary(max_size=200) | mangled(b"PAR1" + b"\0" * 40 + b"PAR1"), st.sampled_from(["mat", "parquet"])
    )
    swept = st.tuples(table(SWEPT), st.just("table"))
    return st.one_of(st.tuples(table(rows()), ways), st.tuples(table(rows()), ways), swept, binary)


def check_run(given: dict[str, Any]) -> str:
    """Arguments of `engine.simulate.simulate`: times, starting values, a drive."""
    given = dict(given)
    driven = given.pop("drive")
    with bounded():
        model = driven_model()
        try:
            drive = None if driven is None else Drive(driven[0], np.array(driven[1])[:, None], driven[2])
            result = simulate(model, drive=drive, **given)
        except FlexarmError as error:
            return explained(error)
        assert np.isfinite(result.values).all()
        assert np.isfinite(result.time).all()
        return RESULT


@functools.cache
def driven_model() -> Model:
    """A motor with dry friction and a gap, its voltage driven from outside."""
    return load("srv02-2mass-b3").build(["motor.voltage"], ["motor.shaft.speed", "load.shaft.angle", "contact.torque"])


@st.composite
def arguments(draw: st.DrawFn) -> dict[str, Any]:
    """Times, starting values and a drive, sound or odd."""
    odd_time = st.floats() | st.sampled_from([0.0, 1e-300, 1e-12, 1e-10, 1e-9, 1.5e-9, 1e12, 1e300])
    drive = None
    if draw(st.booleans()):
        count = draw(st.integers(1, 5))
        often = [st.floats(0, 0.02)] * 9
        time = draw(st.lists(st.one_of(*often, st.floats()), min_size=count, max_size=count))
        values = draw(st.lists(st.one_of(*often, st.floats()), min_size=count, max_size=count))
        drive = (
            sorted(time) if draw(st.integers(0, 4)) else time,
            values,
            draw(st.sampled_from(["zero_order", "linear"])),
        )
    states = st.sampled_from(["motor.shaft.angle", "motor.shaft.speed", "load.shaft.speed", "load.shaft.angel"])
    return {
        "stop": draw(st.one_of(*[st.floats(1e-2, 0.03)] * 4, odd_time)),
        "step": draw(st.one_of(st.floats(1e-4, 1e-2), *[st.sampled_from([1e-4, 1e-3, 1e-2])] * 3, odd_time)),
        "internal_step": draw(st.one_of(*[st.none()] * 4, odd_time)),
        "initial": draw(st.dictionaries(states, st.one_of(*[st.floats(-10, 10)] * 4, st.floats()), max_size=2)),
        "drive": drive,
    }


UNITS = [
    "m",
    "mm",
    "N",
    "rad",
    "deg",
    "s",
    "Hz",
    "kg",
    "V",
    "A",
    "ohm",
    "degC",
    "dB",
    "%",
    "1",
    "count",
    "rpm",
    "g",
    "W",
]
SIGNS = [
    ".",
    "/",
    "*",
    "**",
    "^",
    "(",
    ")",
    " ",
    "-",
    "+",
    "2",
    "-2",
    "0.5",
    "99",
    "1e9",
    "e",
    "µ",
    "$",
    "_",
    "__",
    "\n",
]


def check_quantity(given: tuple[object, str]) -> str:
    """A number with a unit."""
    with bounded(10):
        try:
            value = convert(*given)
            if isinstance(given[0], str):
                assert math.isfinite(coherent(given[1] if given[1] != "*" else "m")[0])
        except FlexarmError as error:
            return _reason(error)
        assert math.isfinite(value)
        return RESULT


def _reason(error: FlexarmError) -> str:
    """A value without a place; whoever holds one adds it."""
    if not error.message:
        raise ValueError("an empty message") from error
    return REFUSED


def quantities() -> st.SearchStrategy[Any]:
    """A value and the unit that is expected."""
    unit = st.lists(st.sampled_from([*UNITS, *SIGNS]), max_size=8).map("".join)
    text = st.builds("{} {}".format, st.floats() | st.integers(), unit)
    return st.tuples(
        text | st.sampled_from(TEXTS) | odd(), st.sampled_from(["m", "rad/s", "1", "*", "N.m/rad", "K", "Hz"])
    )


def documents() -> st.SearchStrategy[Any]:
    """A shipped scenario's name and a changed document."""
    return st.sampled_from(shipped_names()).flatmap(lambda name: st.tuples(st.just(name), mutated(shipped(name))))


def files() -> st.SearchStrategy[Any]:
    """The changed bytes of a shipped scenario's file."""
    return st.sampled_from(shipped_names()).flatmap(lambda name: mangled((SHIPPED / f"{name}.yaml").read_bytes()))


def check_point(given: tuple[str, dict[str, float]]) -> str:
    """A linear model at an odd operating point, as JSON that every reader takes."""
    from engine.linear_files import as_json
    from engine.linearise import linearise

    name, point = given
    with bounded():
        model = model_of(name)
        try:
            linear = linearise(
                model,
                at={key: value for key, value in point.items() if key != "input"},
                inputs={model.inputs[0].name: point["input"]} if model.inputs and "input" in point else None,
            )
        except FlexarmError as error:
            return explained(error)
        json.loads(as_json(linear), parse_constant=_refuse)
        return RESULT


def _refuse(constant: str) -> None:
    raise AssertionError(f"{constant} in JSON")


@st.composite
def points(draw: st.DrawFn) -> tuple[str, dict[str, float]]:
    """A shipped scenario and values of some of its states and an input."""
    name = draw(st.sampled_from(shipped_names()))
    states = [variable.name for variable in model_of(name).states]
    values = st.floats(-10, 10) | st.sampled_from([1e100, -1e160, 1e290, 1e300, -1e308, 5e-324, math.inf, math.nan])
    return name, draw(st.dictionaries(st.sampled_from([*states, "input"]), values, min_size=1, max_size=3))


PROPERTIES = {
    "documents": Property("Shipped scenarios with keys and values changed", documents, check_document),
    "files": Property("Scenario files with bytes changed", files, check_bytes),
    "overrides": Property("`--set` texts", overrides, check_override),
    "parameters": Property("Parameter values of shipped models", parameter_sets, check_parameters),
    "recordings": Property("Recordings with cells, rows, columns and bytes changed", recordings, check_recording),
    "blocks": Property("Every block with odd parameters and options", odd_blocks, check_block),
    "runs": Property("Times, starting values and drives of a run", arguments, check_run),
    "quantities": Property("Numbers with units", quantities, check_quantity),
    "points": Property("Operating points of `linearise`, written as JSON", points, check_point),
    "foreign": Property(
        "CSV, MATLAB, JSON, Parquet and .dat files of blocks and recordings", foreign_files, check_foreign_file
    ),
    "anchors": Property("Edits to scenarios that share by anchors and merge keys", shared_documents, check_shared),
    "pages": Property("Names and texts in reports and FMU descriptions", pages, check_page),
    "archives": Property("FMU and SSP files: XML, names, links, entries and bytes changed", archives, check_archive),
    "states": Property("Saved states of FMUs in Python, changed and sealed again", states, check_state),
    "caches": Property("Compiled libraries in the cache, cut and changed", entries, check_entry),
    "sweeps": Property("Files of an interrupted sweep, cut, changed and removed", kept, check_kept),
    "foreign_fmus": Property("FMUs of other makers: names, cut binaries, crashes, odd answers", foreign, check_foreign),
}
