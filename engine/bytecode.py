"""Models as byte code for one compiled runtime that serves them all: ready at once, slower than C of their own.

What is computed, and in which order, is what `engine.codegen` writes as C, so both give the same numbers to the bit. On
an x86-64 the runtime translates it to machine code (`machine_code.c`), which takes half the time.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Sequence
from ctypes import c_int64
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from engine.codegen import (
    CALLED,
    INCLUDES,
    Emitter,
    rings_of,
    run_emitter,
    runtime,
    tangent_emitter,
)
from engine.forms import LANES, SCALAR, Term
from engine.model import FRICTION, SWITCH, TIME, Model
from engine.operations import BINARY, UNARY
from engine.sharing import Jacobian

MOST, MOST_LINE, MOST_PLACES = 128, 2048, 1 << 16
"""Values of a kind, values in delay lines, and places in the file of a model that byte code can serve."""

ROOMS = tuple(range(4, 33, 4))
"""Directions for which a runtime with tangents has room: one compiled library for each."""

STAGES = 4
"""Stages of a step, at which the Jacobian of the derivative is worked out together."""

_OPERATIONS = {operation: k for k, operation in enumerate([*UNARY, *BINARY])}
_WRITTEN = {
    "ADD": ca.OP_ADD,
    "SUB": ca.OP_SUB,
    "MUL": ca.OP_MUL,
    "DIV": ca.OP_DIV,
    "LT": ca.OP_LT,
    "LE": ca.OP_LE,
    "EQ": ca.OP_EQ,
    "NE": ca.OP_NE,
    "AND": ca.OP_AND,
    "OR": ca.OP_OR,
    "IF_ELSE_ZERO": ca.OP_IF_ELSE_ZERO,
    "FMIN": ca.OP_FMIN,
    "FMAX": ca.OP_FMAX,
    "ASSIGN": ca.OP_ASSIGN,
    "NEG": ca.OP_NEG,
    "SQ": ca.OP_SQ,
    "TWICE": ca.OP_TWICE,
    "INV": ca.OP_INV,
    "NOT": ca.OP_NOT,
    "FABS": ca.OP_FABS,
    "SIGN": ca.OP_SIGN,
    "SQRT": ca.OP_SQRT,
}
"""Operations that ``machine_code.c`` writes out; the others it calls."""
_END, _SKIP = len(_OPERATIONS), len(_OPERATIONS) + 1
_PROGRAMS = (
    "parameters",
    "modes",
    "derivative",
    "guards",
    "full",
    "outputs",
    "update",
    "following",
    "entering",
    "line_start",
    "derivative_values",
    "guards_values",
    "update_values",
    "outputs_values",
    "following_values",
    "entering_values",
)
_EVERY_RUN = ("derivative", "guards", "full", "outputs", "update")
"""What the runtime without tangents works out for four runs together."""
_PATTERNS = ("derivative", "guards", "update", "outputs", "following", "entering")
_STATE, _MEMORY, _SHARED, _TIME, _INPUT, _PARAMETER = range(6)


class _Program(ctypes.Structure):
    _fields_ = (
        ("instructions", ctypes.c_void_p),
        ("results", ctypes.c_void_p),
        ("count", c_int64),
        ("machine", ctypes.c_void_p),
        ("lanes", ctypes.c_void_p),
    )


class _Pattern(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("first", "row", "kind", "at", "value")),
        ("rows", c_int64),
        ("machine", ctypes.c_void_p),
    )


_SIZES = ("nq", "nx", "nu", "nw", "nd", "np", "ny", "nf", "ns", "nt", "nc", "nl", "nlr", "dirs")
_TABLES = ("stick_coordinate", "table_length", "table_linear")
_LINES = ("line_clock", "line_first", "line_size", "read_line", "read_memory")


class _Code(ctypes.Structure):
    _fields_ = (
        *((name, c_int64) for name in (*_SIZES, "registers", "constants")),
        ("constant", ctypes.c_void_p),
        *((name, ctypes.c_void_p) for name in _TABLES),
        ("table_t", ctypes.c_void_p),
        ("table_v", ctypes.c_void_p),
        *((name, ctypes.c_void_p) for name in _LINES),
        ("program", _Program * len(_PROGRAMS)),
        *((name, _Pattern) for name in _PATTERNS),
        *((name, ctypes.c_void_p) for name in ("guards_row", "guards_col", "following_row", "following_col")),
    )


@dataclass
class Code:
    """A model in the form that ``bytecode.c`` reads.

    Attributes:
        struct: ``fa_code``.
        step: instructions of an RK4 step without events.
        slower: by how much an instruction takes longer than in C of the model's own (s), measured.
        in_lanes: whether four runs of it can be worked on together.
        keep: arrays that it points to.
    """

    struct: _Code = field(default_factory=_Code)
    step: int = 0
    slower: float = 0.8e-9
    in_lanes: bool = False
    keep: list[Any] = field(default_factory=list)

    @property
    def address(self) -> int:
        """Of the struct."""
        return ctypes.addressof(self.struct)

    def array(self, values: Any, dtype: Any) -> int:
        """The address of values, which are kept."""
        made = np.ascontiguousarray(values, dtype=dtype)
        self.keep.append(made)
        return int(made.ctypes.data)

    def translate(self, runtime: Any) -> None:
        """Add machine code, if this processor is an x86-64 and the system lets memory be executed.

        Args:
            runtime: the library of `source` that runs it.
        """
        translate, release = runtime.fa_translate, runtime.fa_release
        translate.argtypes, translate.restype = [ctypes.c_void_p, ctypes.POINTER(c_int64)], ctypes.c_void_p
        release.argtypes, release.restype = [ctypes.c_void_p, c_int64], None
        size = c_int64()
        room = translate(self.address, ctypes.byref(size))
        if room:
            self.slower = 0.25e-9
            self.in_lanes = all(self.struct.program[_PROGRAMS.index(name)].lanes for name in _EVERY_RUN)
            weakref.finalize(self, release, room, size.value).atexit = False


def source(directions: int | None = None) -> str:
    """C of the runtime.

    Args:
        directions: for which it has room, one of `ROOMS`; without tangents if None.
    """
    forms = [*UNARY.values(), *BINARY.values()]
    bodies = [
        f"do_{k}: v[c->to] = {form.format('v[c->a]', 'v[c->b]')}; c++; goto *label[c->operation];"
        for k, form in enumerate(forms)
    ]
    head = [
        "#define _DEFAULT_SOURCE",  # else C11 hides the memory that may be executed
        INCLUDES,
        CALLED,
        "#define FA_BYTECODE",
        f"#define FA_MOST {MOST}",
        f"#define FA_MOST_LINE {MOST_LINE}",
        f"enum {{ FA_AT_END = {_END}, FA_AT_SKIP = {_SKIP} }};",
        f"#define FA_OPERATIONS(X) {' '.join(f'X({k})' for k in range(len(forms)))}",
        "#define FA_EVERY_OPERATION " + " ".join(bodies),
        runtime("functions.c"),
        runtime("bytecode.c"),
    ]
    names = [f"FA_DO_{name}" for name in _WRITTEN]
    numbers = ", ".join(f"{name} = {_OPERATIONS[o]}" for name, o in zip(names, _WRITTEN.values(), strict=True))
    machine = [f"enum {{ {numbers} }};", f"#define FA_WRITTEN {', '.join(names)}"]
    for form, name in ((SCALAR, "fa_called"), (LANES, "fa_called_in_lanes")):
        value, terms = form.number, (Term("a"), Term("b"))
        machine += [
            *(
                f"static {value} {name}_{k}({value} a, {value} b) {{ (void)b; return "
                f"{form.value(operation, terms[:1] if operation in UNARY else terms)}; }}"
                for operation, k in _OPERATIONS.items()
            ),
            f"static {value} (*const {name}[])({value}, {value}) = {{",
            *(f"  {name}_{k}," for k in _OPERATIONS.values()),
            "};",
        ]
    machine.append(runtime("machine_code.c"))
    if directions is None:
        names = ["vectors.c", "core.c", "simulate.c", "lanes.c"]
        return "\n".join([*head, *(runtime(name) for name in names), *machine])
    parts = ["tangent.c", "vectors.c", "core.c", "simulate.c", "bytecode_tangent.c", "tangent_rules.c"]
    return "\n".join([*head, f"#define FA_MOST_DIRS {directions}", *(runtime(name) for name in parts), *machine])


def room_for(directions: int) -> int | None:
    """The runtime with tangents that has room for so many directions; None if none has."""
    return next((room for room in ROOMS if directions <= room), None)


def simulation_code(model: Model) -> Code | None:
    """A model's byte code; None if it calls Python functions or is too large."""
    return _code(model, run_emitter(model), {}, 0) if _fits(model) else None


def tangent_code(model: Model, parameters: tuple[int, ...], directions: int) -> Code | None:
    """The same with tangents; see `engine.codegen.tangent_source`."""
    if not _fits(model) or room_for(directions) is None:
        return None
    return _code(model, *tangent_emitter(model, parameters), directions)


def _fits(model: Model) -> bool:
    states = len(model.states)
    switching = model.count(FRICTION) + model.count(SWITCH)
    sizes = [states, 2 * switching, len(model.inputs) + len(model.tables), len(model.memories), len(model.modes)]
    sizes += [len(model.parameters), len(model.outputs), len(model.clocks), len(model.lines)]
    return not model.externals and max(sizes) <= MOST and sum(rings_of(model)) <= MOST_LINE


def _code(model: Model, emitter: Emitter, jacobians: dict[str, Jacobian], directions: int) -> Code | None:
    code = Code()
    s = code.struct
    reads = [(k, memory) for k, line in enumerate(model.lines) for memory in line.memories]
    frictions = [mode for mode in model.modes if mode.kind == FRICTION]
    sizes = (
        model.coordinates,
        len(model.states),
        len(model.inputs),
        len(model.tables),
        len(model.memories),
        len(model.parameters),
        len(model.outputs),
        len(frictions),
        model.count(SWITCH),
        model.count(TIME),
        len(model.clocks),
        len(model.lines),
        len(reads),
        directions,
    )
    for name, size in zip(_SIZES, sizes, strict=True):
        setattr(s, name, size)
    if not _programs(code, emitter):
        return None
    rings = rings_of(model)
    columns = {
        "stick_coordinate": [mode.coordinate for mode in frictions],
        "table_length": [len(table.times) for table in model.tables],
        "table_linear": [table.hold == "linear" for table in model.tables],
        "line_clock": [line.clock for line in model.lines],
        "line_first": [sum(rings[:k]) for k in range(len(rings))],
        "line_size": rings,
        "read_line": [line for line, _ in reads],
        "read_memory": [memory for _, memory in reads],
    }
    for name, values in columns.items():
        setattr(s, name, code.array(values, np.int32))
    s.table_t = code.array([code.array(table.times, np.float64) for table in model.tables], np.uint64)
    s.table_v = code.array([code.array(table.values, np.float64) for table in model.tables], np.uint64)
    for name, jacobian in jacobians.items():
        if name in ("guards", "following"):
            setattr(s, f"{name}_row", code.array(jacobian.rows, np.int32))
            setattr(s, f"{name}_col", code.array(jacobian.columns, np.int32))
        _pattern(code, getattr(s, name), jacobian, s, STAGES if name == "derivative" else 1)
    return code


def _programs(code: Code, emitter: Emitter) -> bool:
    """Fill in the programs and constants; whether there are places enough."""
    s, plan = code.struct, emitter.plan()
    first = {"t": 0, "x": 1}
    for name, after, size in (
        ("u", "x", s.nx),
        ("d", "u", s.nu + s.nw),
        ("m", "d", s.nd),
        ("p", "m", s.nf + s.ns + s.nt),
        ("fire", "p", s.np),
    ):
        first[name] = first[after] + size
    unread = first["fire"] + s.nc + s.nlr
    count = unread + 1
    places: list[int] = []
    constants: list[float] = []
    for key in emitter.nodes:
        if key[0] == "input":
            places.append(first[key[1]] + (0 if key[1] == "t" else key[2]))
        else:
            places.append(-1)
    for node in range(len(places)):
        if emitter.is_computed(node):
            places[node] = count
            count += 1
    for node, key in enumerate(emitter.nodes):
        if key[0] == "const":
            places[node] = count + len(constants)
            constants.append(key[1])
    s.registers, s.constants = count + len(constants), len(constants)
    s.constant = code.array(constants, np.float64)
    if s.registers > MOST_PLACES:
        return False

    def instructions(nodes: list[int], results: Sequence[int] | None = None) -> list[tuple[int, int, int, int]]:
        made = []
        for conditions, group in emitter.groups(nodes, results):
            tests = sorted(conditions)
            for k, condition in enumerate(tests):
                # A test that fails passes over those after it too, whose place nobody reads.
                made.append((_SKIP, unread, places[condition], len(group) + len(tests) - 1 - k))
            for node in group:
                operation, *operands = emitter.nodes[node]
                made.append((_OPERATIONS[operation], places[node], places[operands[0]], places[operands[-1]]))
        made.append((_END, 0, 0, 0))
        return made

    def fill(name: str, made: list[tuple[int, int, int, int]], results: Sequence[int]) -> None:
        program = s.program[_PROGRAMS.index(name)]
        program.instructions = code.array(made, np.uint16)
        program.results = code.array([places[node] for node in results], np.uint16)
        program.count = len(results)

    fill("parameters", instructions(plan.parameters), [])
    fill("modes", instructions(plan.modes), [])
    for name in _PROGRAMS[2:]:
        results = emitter.functions.get(name, [])
        fill(name, instructions(plan.state.get(name, []), results), results)
    stage = "derivative_values" if "derivative_values" in plan.state else "derivative"
    often = {stage: 4, "guards": 1, "outputs": 1}
    code.step = sum(times * (len(plan.state.get(name, [])) + s.nx + 20) for name, times in often.items())
    return True


def _pattern(code: Code, pattern: _Pattern, jacobian: Jacobian, s: _Code, apart: int) -> None:
    """Fill in the nonzeros of a Jacobian by rows, in the order in which generated code adds them up.

    Args:
        code: keeps them.
        pattern: is filled.
        jacobian: which.
        s: the model's sizes.
        apart: values from one to the next where its values lie.
    """
    at_t = s.nx
    at_d = at_t + 1 + s.nu + s.nw
    at_q = at_d + s.nd
    rows: list[list[tuple[int, int, int]]] = [[] for _ in jacobian.order]
    for k, (row, c) in enumerate(zip(jacobian.rows, jacobian.columns, strict=True)):
        if c < at_t:
            rows[row].append((_STATE, c, k))
        elif c == at_t:
            rows[row].append((_TIME, 0, k))
        elif c < at_d:
            rows[row].append((_INPUT, c - at_t - 1, k))
        elif c < at_q:
            rows[row].append((_MEMORY, c - at_d, k))
        elif c >= jacobian.shared:
            rows[row].append((_SHARED, jacobian.height + c - jacobian.shared, k))
        else:
            rows[row].append((_PARAMETER, c - at_q, k))
    order = {_STATE: 0, _MEMORY: 0, _SHARED: 0, _TIME: 1, _INPUT: 1, _PARAMETER: 2}
    entries = [entry for row in jacobian.order for entry in sorted(rows[row], key=lambda e: order[e[0]])]
    pattern.first = code.array(np.cumsum([0, *(len(rows[row]) for row in jacobian.order)]), np.int32)
    pattern.row = code.array(jacobian.order, np.int32)
    for k, name in enumerate(("kind", "at", "value")):
        scale = apart if name == "value" else 1
        setattr(pattern, name, code.array([entry[k] * scale for entry in entries], np.int32))
    pattern.rows = len(rows)
