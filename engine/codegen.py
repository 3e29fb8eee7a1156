"""Generate C from expressions: straight-line code in three levels.

Derivatives, guards of frictions and the values of a derivative's Jacobian are written anew first (`engine.algebra`).
Then every operation becomes one named double. Level 0 depends on parameters only and is computed once per parameter
set. Level 1 depends on parameters and modes and is computed once per switch. Level 2 is computed at every evaluation
of the right-hand side. Equal subexpressions are shared between the functions, and a division by a lower-level value
becomes a product with its stored reciprocal.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from engine.algebra import CONSTANT, MODE, PARAMETER, STATE, Algebra, copied
from engine.casadi_lock import one_at_a_time
from engine.forms import LANES, STAGES, Lanes
from engine.model import FRICTION, SWITCH, TIME, Model
from engine.operations import BINARY, COSTLY, UNARY, literal
from engine.ports import Expression
from engine.roundings import has_rounding
from engine.roundings import jacobian as relaxed_jacobian
from engine.sharing import Jacobian, expressions, shared_nodes
from engine.statements import Shelf, Statements

_RUNTIME = Path(__file__).parent / "runtime"

_INLINED = 600
"""Statements up to which the derivative is compiled into every stage of a step, so that stages share what they can."""
_READ = 3 * _INLINED
"""Instructions, those of parameters too, up to which it is looked at whether a function is to be written anew."""
_PASSED_OVER = 3
"""Operations from which on it pays to ask whether a mode needs them, however little each of them takes."""
_ARGUMENTS = ("t", "x", "u", "d", "m", "p", "fire")


@dataclass(frozen=True)
class Plan:
    """What is computed when: nodes in an order in which each follows those that it needs.

    Attributes:
        constant: nodes of constants alone that others use.
        parameter: nodes that depend on parameters and are used at every evaluation, or at a switch.
        mode: nodes that depend on modes and are used at every evaluation.
        parameters: all that is computed for a set of parameters, `constant` and `parameter` among it.
        modes: all that is computed at a switch, `mode` among it.
        state: all that is computed at every evaluation, by function.
    """

    constant: list[int]
    parameter: list[int]
    mode: list[int]
    parameters: list[int]
    modes: list[int]
    state: dict[str, list[int]]


class Emitter:
    """A shared graph of scalar operations, and the C text of functions on it."""

    def __init__(self) -> None:
        self.nodes: list[tuple[Any, ...]] = []
        self.levels: list[int] = []
        self._index: dict[tuple[Any, ...], int] = {}
        self.functions: dict[str, list[int]] = {}

    def node(self, *key: Any) -> int:
        """The node of an operation and its operands, of ``"const"`` and a number, or of ``"input"`` and its place."""
        known = self._index.get(key)
        if known is not None:
            return known
        if key[0] == "const":
            level = CONSTANT
        elif key[0] == "input":
            level = {"p": PARAMETER, "m": MODE}.get(key[1], STATE)
        else:
            level = self.levels[key[1]]
            if len(key) > 2 and self.levels[key[2]] > level:
                level = self.levels[key[2]]
        if key[0] == ca.OP_DIV and level == STATE and self.levels[key[2]] < STATE:
            return self.node(ca.OP_MUL, key[1], self.node(ca.OP_INV, key[2]))
        self._index[key] = len(self.nodes)
        self.nodes.append(key)
        self.levels.append(level)
        return len(self.nodes) - 1

    def add(
        self,
        name: str,
        arguments: list[Expression],
        expression: Expression,
        *,
        anew: int = 0,
        rates: bool = False,
    ) -> None:
        """Add a function of the model's arguments, in the order ``t, x, u, d, m, p, fire``.

        Args:
            name: of the function.
            arguments: its symbols.
            expression: its result.
            anew: how many of its first results are written anew, unless it is large (`engine.algebra`).
            rates: whether these are dx/dt.
        """
        function = ca.Function(name, arguments, [ca.densify(expression)])
        if anew and function.n_instructions() <= _READ:
            given = Emitter()
            results = given._read(function)
            if len(given._reach(results, STATE)) <= _INLINED:
                first = Algebra(given, results[:anew], self, rates=rates).results()
                self.functions[name] = first + copied(given, results[anew:], self)
                return
        self.functions[name] = self._read(function)

    def _read(self, function: ca.Function) -> list[int]:
        """Nodes of a function's result."""
        work: dict[int, int] = {}
        results = [self.node("const", 0.0)] * function.numel_out(0)
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            inputs, outputs = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_CONST:
                work[outputs[0]] = self.node("const", float(function.instruction_constant(k)))
            elif operation == ca.OP_INPUT:
                work[outputs[0]] = self.node("input", _ARGUMENTS[inputs[0]], inputs[1])
            elif operation == ca.OP_OUTPUT:
                results[outputs[1]] = work[inputs[0]]
            else:
                operands = [work[i] for i in inputs]
                if operation in UNARY:
                    operands = operands[:1]
                elif operation not in BINARY:
                    raise NotImplementedError(f"CasADi operation {operation} has no C form")
                work[outputs[0]] = self.node(operation, *operands)
        return results

    def _reach(self, roots: list[int], level: int) -> list[int]:
        """Nodes of exactly ``level`` that the roots need, in order, looking through that level only."""
        seen: set[int] = set()
        queue = [r for r in roots if self.levels[r] == level]
        while queue:
            node = queue.pop()
            if node in seen:
                continue
            seen.add(node)
            key = self.nodes[node]
            if key[0] not in ("const", "input"):
                queue += [operand for operand in key[1:] if self.levels[operand] == level]
        return sorted(seen)

    def _needs(self, nodes: list[int], level: int) -> list[int]:
        """Computed nodes of ``level`` that the given nodes use directly."""
        used: set[int] = set()
        for node in nodes:
            key = self.nodes[node]
            operands = () if key[0] in ("const", "input") else key[1:]
            used |= {o for o in operands if self.levels[o] == level and self.nodes[o][0] != "input"}
        return sorted(used)

    def is_computed(self, node: int) -> bool:
        """Whether a node is the result of an operation."""
        return self.nodes[node][0] not in ("const", "input")

    def groups(
        self, nodes: list[int], results: Sequence[int] | None = None
    ) -> Iterator[tuple[frozenset[int], list[int]]]:
        """The computed ones of some nodes in order, each group with the conditions without which nothing uses it.

        Args:
            nodes: what is computed.
            results: of the function; without them there are no conditions. Few and cheap operations have none.
        """
        wanted = self._wanted(nodes, results) if results is not None else {}
        computed = [node for node in nodes if self.is_computed(node)]
        if any(wanted.values()) and len(computed) <= _INLINED:
            computed = self._together(computed, wanted)
        for conditions, run in itertools.groupby(computed, lambda node: wanted.get(node, frozenset())):
            group = list(run)
            pays = len(group) >= _PASSED_OVER or any(self.nodes[node][0] in COSTLY for node in group)
            yield (conditions if pays else frozenset()), group

    def _together(self, nodes: list[int], wanted: Mapping[int, frozenset[int]]) -> list[int]:
        """Nodes in an order in which those of the same conditions follow one another, as far as that goes."""
        left, order = list(nodes), list[int]()
        waiting = set(nodes)
        while left:
            ready = [node for node in left if waiting.isdisjoint(self.nodes[node][1:])]
            conditions = {wanted.get(node, frozenset()): None for node in reversed(ready)}
            chosen = frozenset[int]() if frozenset() in conditions else list(conditions)[-1]
            rest = []
            for node in left:
                if wanted.get(node, frozenset()) == chosen and waiting.isdisjoint(self.nodes[node][1:]):
                    order.append(node)
                    waiting.remove(node)
                else:
                    rest.append(node)
            left = rest
        return order

    def _wanted(self, nodes: list[int], results: Sequence[int]) -> dict[int, frozenset[int]]:
        """For each node the conditions, known at the last switch, without which nothing uses it."""
        inside = set(nodes)
        found = {node: frozenset[int]() for node in results if node in inside}
        for node in reversed(nodes):
            key = self.nodes[node]
            if key[0] in ("const", "input"):
                continue
            own = found.get(node, frozenset())
            for place, operand in enumerate(key[1:]):
                needed = own
                if key[0] == ca.OP_IF_ELSE_ZERO and place and self.levels[key[1]] < STATE:
                    needed = own | {key[1]}
                found[operand] = found[operand] & needed if operand in found else needed
        return found

    def plan(self) -> Plan:
        """What every function added needs, by the occasion on which it changes."""
        everything = [node for results in self.functions.values() for node in results]
        state = {name: self._reach(results, STATE) for name, results in self.functions.items()}
        high = sorted({node for nodes in state.values() for node in nodes})
        direct = [r for r in everything if self.is_computed(r)]
        mode = sorted({*self._needs(high, MODE), *[r for r in direct if self.levels[r] == MODE]})
        modes = self._reach(mode, MODE)
        parameter = sorted(
            {
                *self._needs(high, PARAMETER),
                *self._needs(modes, PARAMETER),
                *[r for r in direct if self.levels[r] == PARAMETER],
            }
        )
        wanted = self._needs(high, CONSTANT) + self._needs(modes, CONSTANT)
        wanted += self._needs(self._reach(parameter, PARAMETER), CONSTANT)
        wanted += [r for r in direct if self.levels[r] == CONSTANT]
        constant = sorted({n for n in wanted if self.nodes[n][0] != "const"})
        low = [*self._reach(constant, CONSTANT), *self._reach([*constant, *parameter], PARAMETER)]
        return Plan(constant, parameter, mode, low, modes, state)

    def text(self, lanes: Sequence[str] = (), form: Lanes = LANES) -> str:
        """C source of the preparations and of every function added.

        Args:
            lanes: functions that are written once more, as ``fa_NAME_lanes``, for several runs (`engine.forms`).
            form: how values are written in these.
        """
        plan = self.plan()
        cp, cm = Shelf("cp"), Shelf("cm")

        def shelf(node: int) -> Shelf:
            return cm if self.levels[node] == MODE else cp

        bodies = {
            name: Statements(self, plan.state[name], shelf, results, rolled=len(plan.state[name]) > _INLINED)
            for name, results in self.functions.items()
        }
        modes = Statements(self, plan.modes, shelf, rolled=len(plan.modes) > _INLINED)
        parameters = Statements(self, plan.parameters, rolled=len(plan.parameters) > _INLINED)
        for statements in (*bodies.values(), modes):
            statements.reserve()
        cp.put([*plan.constant, *plan.parameter])
        cm.put(plan.mode)
        parts = [f"#define FA_NCP {len(cp.order)}\n#define FA_NCM {len(cm.order)}\n"]
        body = parameters.text([("cp", node) for node in cp.order])
        parts.append(_function("fa_prepare_parameters", "const double *p, double *cp", body))
        body = modes.text([("cm", node) for node in cm.order])
        arguments = "const double *m, const double *p, const double *cp, double *cm"
        parts.append(_function("fa_prepare_modes", arguments, body))
        arguments = (
            "double t, const double *restrict x, const double *restrict u, const double *restrict d, "
            "const double *restrict m, const double *restrict p, const double *restrict cp, "
            "const double *restrict cm, const double *restrict fire, double *restrict r"
        )
        targets = {name: [("r", node) for node in results] for name, results in self.functions.items()}
        large = False
        for name, results in self.functions.items():
            if name == "full" and large:
                # What both share is worked out twice; compiling it twice costs more.
                parts.append(_function("fa_full", arguments, _both(len(self.functions["derivative"]))))
                continue
            body = bodies[name].text(targets[name])
            inlined = name == "derivative" and len(bodies[name]) + len(results) <= _INLINED
            large = large or (name == "derivative" and not inlined)
            parts.append(_function(f"fa_{name}", arguments, body, inlined))
        for name in lanes:
            if name == "full" and large:
                body = _both(len(self.functions["derivative"]), "_lanes")
            else:
                body = bodies[name].text(targets[name], form)
            parts.append(
                _function(f"fa_{name}_lanes", form.arguments(arguments), body, name == "derivative" and not large)
            )
        return "\n".join(parts)


def _both(states: int, suffix: str = "") -> list[str]:
    """The body of ``full`` for a large model; the suffix is that of the functions' names."""
    given = "(t, x, u, d, m, p, cp, cm, fire, "
    return [f"  fa_derivative{suffix}{given}r);", f"  fa_guards{suffix}{given}r + {states});"]


def _function(name: str, arguments: str, body: list[str], inlined: bool = False) -> str:
    inline = "inline __attribute__((always_inline)) " if inlined else ""
    return f"static {inline}void {name}({arguments}) {{\n" + "\n".join(body) + "\n}\n"


def _array(ctype: str, name: str, values: list[str]) -> str:
    return f"static const {ctype} {name}[] = {{{', '.join(values) or '0'}}};"


def model_code(model: Model, extra: Sequence[tuple[str, list[Expression], Expression]] = ()) -> str:
    """C source of a model's sizes, tables and functions, without the runtime.

    Args:
        model: the model.
        extra: further functions: name, arguments (as those of `Emitter.add`; the last may be any symbol) and result.

    Raises:
        NotImplementedError: the model calls Python functions.
    """
    if model.externals:
        raise NotImplementedError(f"'{model.externals[0].name}' is a Python function, which only a simulation can call")
    return _sizes(model) + "\n\n" + run_emitter(model, extra).text()


@one_at_a_time
def run_emitter(model: Model, extra: Sequence[tuple[str, list[Expression], Expression]] = ()) -> Emitter:
    """The functions that every run needs."""
    e = model.equations
    emitter = Emitter()
    arguments = [*e.arguments, e.fire]
    emitter.add("derivative", arguments, e.derivative, anew=e.derivative.numel(), rates=True)
    # Guards of a switch stay as they are: what opens it and what closes it again may not differ by their rounding.
    emitter.add("guards", arguments, e.guards, anew=2 * model.count(FRICTION))
    emitter.functions["full"] = emitter.functions["derivative"] + emitter.functions["guards"]
    emitter.add("outputs", arguments, e.outputs)
    emitter.add("update", arguments, e.update)
    emitter.add("following", arguments, e.following)
    if model.externals:
        emitter.add("external", arguments, e.external)
    if model.lines:
        emitter.add("entering", arguments, e.entering)
        emitter.add("line_start", arguments, e.line_start)
    for name, symbols, result in extra:
        emitter.add(name, symbols, result)
    return emitter


def rings_of(model: Model) -> list[int]:
    """Room of each delay line: a power of two, so that delays that differ in length alone share one library."""
    return [max(_RING, 1 << (line.size - 1).bit_length()) for line in model.lines]


def _sizes(model: Model, *, called: bool = False) -> str:
    """Sizes, patterns and tables as C constants.

    Args:
        model: the model.
        called: by Python, which tells how long delays are.
    """
    rings = rings_of(model) if called else [line.size for line in model.lines]
    frictions = [mode for mode in model.modes if mode.kind == FRICTION]
    sizes = {
        "FA_NQ": model.coordinates,
        "FA_NX": len(model.states),
        "FA_NU": len(model.inputs),
        "FA_NW": len(model.tables),
        "FA_ND": len(model.memories),
        "FA_NP": len(model.parameters),
        "FA_NY": len(model.outputs),
        "FA_NF": len(frictions),
        "FA_NS": model.count(SWITCH),
        "FA_NT": model.count(TIME),
        "FA_NC": len(model.clocks),
        "FA_NE": len(model.externals),
        "FA_NEI": sum(external.inputs for external in model.externals),
        "FA_NEO": sum(external.outputs for external in model.externals),
        "FA_NL": len(model.lines),
        "FA_NLS": sum(rings),
        "FA_NLR": sum(len(line.stages) for line in model.lines),
    }
    lines = [runtime("functions.c"), *(f"#define {name} {value}" for name, value in sizes.items())]
    if model.lines:
        lines.append("#define FA_LINES")
    lines.append(_array("int", "fa_stick_coordinate", [str(mode.coordinate) for mode in frictions]))
    lines.append(_array("int", "fa_table_length", [str(len(t.times)) for t in model.tables]))
    lines.append(_array("int", "fa_table_linear", [str(int(t.hold == "linear")) for t in model.tables]))
    for i, table in enumerate(model.tables):
        lines.append(_array("double", f"fa_table_t{i}", [literal(float(t)) for t in table.times]))
        lines.append(_array("double", f"fa_table_v{i}", [literal(float(v)) for v in table.values]))
    for field in ("clock", "first_input", "first_output") if model.externals else ():
        values = [str(getattr(external, field)) for external in model.externals]
        lines.append(_array("int", f"fa_external_{field}", values))
    if model.lines:
        firsts = [sum(rings[:k]) for k in range(len(rings))]
        columns = {"clock": [line.clock for line in model.lines], "first": firsts, "size": rings}
        lines += [_array("int", f"fa_line_{field}", [str(v) for v in values]) for field, values in columns.items()]
        reads = [
            (l, s, m) for l, line in enumerate(model.lines) for s, m in zip(line.stages, line.memories, strict=True)
        ]
        for field, column in zip(("line", "stage", "memory"), zip(*reads, strict=True), strict=True):
            if called and field == "stage":
                continue
            lines.append(_array("int", f"fa_read_{field}", [str(value) for value in column]))
    for kind in "tv":
        names = [f"fa_table_{kind}{i}" for i in range(len(model.tables))]
        lines.append(_array("double *const", f"fa_table_{kind}", names))
    return "\n".join(lines)


def runtime(name: str) -> str:
    """Source of a hand-written part of the runtime."""
    return (_RUNTIME / name).read_text(encoding="utf-8")


INCLUDES = "#include <math.h>\n#include <string.h>\n#include <stdint.h>\n"
CALLED = "#define FA_CANCELLABLE\n#define FA_STAGED\n"
"""What a run that Python calls can do: be ended, and have delays that its caller tells."""

_RING = 128
"""Least room of a delay line in a run that Python calls."""


def simulation_source(model: Model) -> str:
    """One translation unit: the model, the integrator and the entry point that Python calls."""
    parts = [
        INCLUDES,
        CALLED,
        _sizes(model, called=True),
        "\n\n",
        run_emitter(model).text(),
        runtime("core.c"),
        runtime("simulate.c"),
    ]
    return "".join(parts)


_IN_LANES = ("derivative", "guards", "full", "outputs", "update")


def lanes_source(model: Model) -> str:
    """The same for several runs, which are worked on together in the lanes of vectors.

    Raises:
        NotImplementedError: the model calls Python functions.
    """
    if model.externals:
        raise NotImplementedError(
            f"'{model.externals[0].name}' is a Python function, which is called for one run alone"
        )
    parts = [
        INCLUDES,
        CALLED,
        _sizes(model, called=True),
        runtime("vectors.c"),
        "\n\n",
        run_emitter(model).text(_IN_LANES),
        runtime("core.c"),
        runtime("simulate.c"),
        runtime("lanes.c"),
    ]
    return "".join(parts)


def tangent_source(model: Model, parameters: tuple[int, ...], directions: int) -> str:
    """The same with tangents.

    Args:
        model: the model.
        parameters: indices of the parameters that are directions; they come first.
        directions: how many directions there are, starting values included.
    """
    emitter, jacobians = tangent_emitter(model, parameters)
    lines, rules = [f"#define FA_DIRS {directions}"], [_PLACES]
    lines.append(f"#define FA_SHARED {len(jacobians['derivative'].order) - len(model.states)}")
    for name, jacobian in jacobians.items():
        lines.append(f"#define FA_{name.upper()}_NNZ {len(jacobian.rows)}")
        if name in ("guards", "following"):
            lines.append(_array("int", f"fa_{name}_row", [str(i) for i in jacobian.rows]))
            lines.append(_array("int", f"fa_{name}_col", [str(i) for i in jacobian.columns]))
        if name != "following":
            rules.append(_tangent_rule(name, model, jacobian))
    head = [INCLUDES, CALLED, _sizes(model, called=True), *lines, runtime("tangent.c"), runtime("vectors.c")]
    head.append(emitter.text(["derivative_values"], STAGES))
    return "\n".join([*head, runtime("core.c") + runtime("simulate.c"), *rules, runtime("tangent_rules.c")])


@one_at_a_time
def tangent_emitter(model: Model, parameters: tuple[int, ...]) -> tuple[Emitter, dict[str, Jacobian]]:
    """The functions that a run with tangents needs, and the patterns of the Jacobians among them.

    The values of the Jacobian of NAME are the function ``NAME_values``.

    Args:
        model: the model.
        parameters: indices of the parameters that are directions.
    """
    e = model.equations
    emitter = run_emitter(model)
    arguments = [*e.arguments, e.fire]
    directions, moved = [e.p[i] for i in parameters], ca.vertcat(e.x, e.d)
    found = {}
    for name in ("derivative", "guards", "update", "outputs", "following", *(["entering"] if model.lines else [])):
        results, seeds = getattr(e, name), ca.vertcat(e.x, e.t, e.u, e.d, *directions)
        width, shared, plain = seeds.numel(), ca.SX(0, 1), ca.SX(0, 1)
        # Steps of a source or of a recorded input are as they are; those of a motion stand for the line through them.
        if name == "derivative" and not has_rounding(results, moved):
            results, shared, plain = _by_way_of_shared(arguments, results, parameters)
        slopes = relaxed_jacobian(results, ca.vertcat(seeds, shared), moved)
        values = ca.substitute(slopes.nz[:], shared, plain)
        row, column = (list(part) for part in slopes.sparsity().get_triplet())
        emitter.add(f"{name}_values", arguments, values, anew=values.numel() if name == "derivative" else 0)
        found[name] = Jacobian(getattr(e, name).numel(), row, column, width)
    return emitter, found


def _by_way_of_shared(
    arguments: list[Expression], results: Expression, parameters: Sequence[int]
) -> tuple[Expression, Expression, Expression]:
    """The results of a function and after them what they share; the symbols of that, and what these stand for."""
    graph = Emitter()
    graph.add("all", arguments, results)
    nodes = graph.functions["all"]
    sizes = {name: symbols.numel() for name, symbols in zip(_ARGUMENTS, arguments, strict=True)}
    seeds = [("input", name, i) for name in "xtud" for i in range(sizes[name])]
    seeds += [("input", "p", i) for i in parameters]
    shared = shared_nodes(graph, nodes, {seed: k for k, seed in enumerate(seeds)})
    inputs = dict(zip(_ARGUMENTS, arguments, strict=True))
    symbols = {node: ca.SX.sym(f"shared{node}") for node in shared}
    rows, defined = expressions(graph, nodes, inputs, symbols)
    return (
        ca.vertcat(*rows, *defined),
        ca.vertcat(ca.SX(0, 1), *symbols.values()),
        ca.vertcat(ca.SX(0, 1), *expressions(graph, shared, inputs, {})[0]),
    )


_PLACES = """
/* Columns of a Jacobian: [x | t | u | d | q]. */
enum { FA_AT_T = FA_NX, FA_AT_U = FA_NX + 1, FA_AT_D = FA_NX + 1 + FA_NI, FA_AT_Q = FA_NX + 1 + FA_NI + FA_ND };
/* Inlined everywhere, so that a rule whose dt is NULL loses its branch. */
#define FA_INLINE static inline __attribute__((always_inline))
"""


def _tangent_rule(name: str, model: Model, jacobian: Jacobian) -> str:
    """C of ``fa_NAME_tangent``: a sparse Jacobian, nonzeros ``j``, times the seeds.

    Every nonzero has a line of its own, so that a row's sums stay in registers. A parameter's own column enters as a
    constant vector: written as one element, it would wait for the memory that the next vector load reads.
    """
    at_t = len(model.states)
    at_u, at_d = at_t + 1, at_t + 1 + len(model.inputs) + len(model.tables)
    at_q = at_d + len(model.memories)
    lines = [
        f"FA_INLINE void fa_{name}_tangent(const fa_sim *s, const double *j, const fa_columns *S, const fa_columns *D,",
        "    const fa_lane *dt, const int lanes, fa_columns *out) {",
    ]
    of = "j[{k} * FA_WIDTH]" if name == "derivative" else "j[{k}]"
    for i in jacobian.order:
        sums, rates, own = [], [], {}
        for k, (row, c) in enumerate(zip(jacobian.rows, jacobian.columns, strict=True)):
            if row != i:
                continue
            value = of.format(k=k)
            if c < at_t:
                sums.append(f"{value} * S[{c}][l]")
            elif c < at_u:
                rates.append(value)
            elif c < at_d:
                rates.append(f"{value} * s->slope[{c - at_u}]")
            elif c < at_q:
                sums.append(f"{value} * D[{c - at_d}][l]")
            elif c >= jacobian.shared:
                sums.append(f"{value} * out[{jacobian.height + c - jacobian.shared}][l]")
            else:
                own[c - at_q] = value
        lines.append(f"  FA_EACH_OF(lanes, l) out[{i}][l] = {' + '.join(sums) or '(fa_lane){0}'};")
        if rates:
            lines.append(f"  if (dt) FA_EACH_OF(lanes, l) out[{i}][l] += ({' + '.join(rates)}) * dt[l];")
        if own:
            lines += _own_columns(i, own)
    return "\n".join([*lines, "}"])


_WIDTH = 4
"""Directions in a vector, and stages of a step; see ``tangent.c``."""


def _own_columns(row: int, own: Mapping[int, str]) -> list[str]:
    """Lines that add values at columns to a row, a vector at a time."""
    lanes = sorted({c // _WIDTH for c in own})
    vectors = {lane: ", ".join(own.get(lane * _WIDTH + c, "0") for c in range(_WIDTH)) for lane in lanes}
    return [f"  out[{row}][{lane}] += (fa_lane){{{vector}}};" for lane, vector in vectors.items()]
