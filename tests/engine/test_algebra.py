"""A derivative written anew is the same function: sums and products in another order, nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest

from engine.algebra import STATE
from engine.codegen import Emitter, run_emitter
from engine.model import Model
from engine.operations import BINARY, UNARY
from scenarios.load import load, shipped_names

Number = np.longdouble
_WRITTEN = {
    "fa_min": lambda a, b: min(a, b),
    "fa_max": lambda a, b: max(a, b),
    "fa_sign": np.sign,
    "fa_exp": np.exp,
    "pow": lambda a, b: np.power(a, b),
}
_FUNCTIONS: dict[str, Any] = {name: getattr(np, name) for name in ("exp", "log", "sin", "cos", "tan", "tanh", "sqrt")}
_FUNCTIONS |= {"fabs": np.abs, "atan": np.arctan, "floor": np.floor, "hypot": np.hypot} | _WRITTEN


def _carried_out(operation: int, values: Sequence[Any]) -> Any:
    """An operation in numbers of more digits than those of C, from its text in C."""
    if operation == ca.OP_IF_ELSE_ZERO:
        return values[1] if values[0] != 0 else Number(0)
    if operation in (ca.OP_AND, ca.OP_OR):
        return Number((all if operation == ca.OP_AND else any)(value != 0 for value in values))
    form = (UNARY.get(operation) or BINARY[operation]).replace("(double)", "number")
    names = {"a": values[0], "b": values[-1], "number": Number}
    return Number(eval(form.format("a", "b"), _FUNCTIONS | names))


def _values(emitter: Emitter, roots: list[int], given: Callable[[str, int], float]) -> list[Any]:
    needed, queue = set(roots), list(roots)
    while queue:
        key = emitter.nodes[queue.pop()]
        queue += [operand for operand in key[1:] if key[0] not in ("const", "input") and operand not in needed]
        needed.update(queue)
    found: dict[int, Any] = {}
    for node in sorted(needed):
        key = emitter.nodes[node]
        if key[0] == "const":
            found[node] = Number(key[1])
        elif key[0] == "input":
            found[node] = Number(given(key[1], key[2]))
        else:
            found[node] = _carried_out(key[0], [found[operand] for operand in key[1:]])
    return [found[node] for node in roots]


def _both(arguments: list[Any], expression: Any) -> tuple[Emitter, Emitter]:
    one, other = Emitter(), Emitter()
    one.add("derivative", arguments, expression)
    other.add("derivative", arguments, expression, anew=expression.numel(), rates=True)
    return one, other


def _operations(emitter: Emitter) -> int:
    return sum(map(emitter.is_computed, emitter.plan().state["derivative"]))


def _assert_alike(one: Emitter, other: Emitter, given: Callable[[str, int], float]) -> None:
    expected = np.array(_values(one, one.functions["derivative"], given))
    found = np.array(_values(other, other.functions["derivative"], given))
    assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()


def _given(model: Model, random: np.random.Generator) -> Callable[[str, int], float]:
    """States, modes and inputs at random, and the model's parameters."""
    drawn: dict[tuple[str, int], float] = {}

    def given(name: str, place: int) -> float:
        if name == "p":
            return model.parameters[place].value
        if (name, place) not in drawn:
            drawn[name, place] = float(random.integers(-1, 2)) if name == "m" else random.normal(0, 0.3)
        return drawn[name, place]

    return given


@pytest.mark.parametrize("name", shipped_names())
def test_every_shipped_model_keeps_its_derivative_in_fewer_operations(name: str) -> None:
    model, random = load(name).build(), np.random.default_rng(3)
    e = model.equations
    one, other = _both([*e.arguments, e.fire], e.derivative)
    assert _operations(other) <= _operations(one)
    for _ in range(5):
        _assert_alike(one, other, _given(model, random))


@pytest.mark.parametrize("seed", range(30))
def test_a_random_expression_is_the_same_function(seed: int) -> None:
    random = np.random.default_rng(seed)
    x, m, p = ca.SX.sym("x", 4), ca.SX.sym("m", 2), ca.SX.sym("p", 4)
    pool = [*ca.vertsplit(x), *ca.vertsplit(p), ca.SX(2), ca.SX(0.3), ca.if_else(m[0] != 0, p[1], p[2])]
    for _ in range(60):
        a, b = (pool[random.integers(len(pool))] for _ in range(2))
        rules: list[Callable[[Any, Any], Any]] = [
            lambda a, b: a + b,
            lambda a, b: a - b,
            lambda a, b: a * b,
            lambda a, _: a * a / p[0],
            lambda a, b: a / (2 + b * b),
            lambda a, _: -2 * a,
            lambda a, b: ca.if_else(m[1] > 0, a - p[3], b),
            lambda a, _: ca.if_else(m[0] == 0, 0, p[2] * a),
            lambda a, b: m[1] * ca.exp(-b * b) + a,
            lambda a, b: ca.fmin(a, b) * p[1],
        ]
        pool.append(rules[random.integers(len(rules))](a, b))
    expression, empty = ca.vertcat(*pool[-4:]), ca.SX(0, 1)
    one, other = _both([ca.SX.sym("t"), x, empty, empty, m, p, empty], expression)
    for _ in range(5):
        drawn = {"x": random.normal(0, 1, 4), "m": random.integers(-1, 2, 2), "p": random.uniform(0.5, 2, 4)}

        def given(name: str, place: int, drawn: dict[str, Any] = drawn) -> float:
            return float(drawn[name][place])

        _assert_alike(one, other, given)


def test_a_stuck_rotor_is_not_accelerated_at_all_and_asks_for_no_friction() -> None:
    model = load("reference-b").build()
    emitter = run_emitter(model)
    random = np.random.default_rng(1)
    stuck = model.modes[0].coordinate + model.coordinates
    for _ in range(20):
        free = _given(model, random)

        def given(name: str, place: int, free: Callable[[str, int], float] = free) -> float:
            return 0.0 if (name, place) == ("m", 0) else free(name, place)

        assert _values(emitter, emitter.functions["derivative"], given)[stuck] == 0
        nodes, results = emitter.plan().state["derivative"], emitter.functions["derivative"]
        groups = emitter.groups(nodes, results)
        called = [list(c) for c, group in groups if any(emitter.nodes[node][0] == ca.OP_EXP for node in group)]
        assert called
        assert all(0 in _values(emitter, conditions, given) for conditions in called)


def test_what_a_mode_switches_off_may_be_infinite() -> None:
    x, m, p = ca.SX.sym("x", 1), ca.SX.sym("m", 1), ca.SX.sym("p", 1)
    empty = ca.SX(0, 1)
    for inside in (x / p, 2 / x, ca.log(x), x / (p * x)):
        expression = ca.if_else(m != 0, inside, 0) + p
        one, other = _both([ca.SX.sym("t"), x, empty, empty, m, p, empty], expression)
        with np.errstate(all="ignore"):
            assert _values(one, one.functions["derivative"], lambda *_: 0.0) == [0]
            assert _values(other, other.functions["derivative"], lambda *_: 0.0) == [0]


def test_what_depends_on_parameters_is_worked_out_beforehand() -> None:
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 4)
    empty = ca.SX(0, 1)
    rate = (p[0] * (p[1] * x[2] - p[2] * x[2]) + (p[3] * (2 * x[0])) / p[1] + p[2] * (x[0] - x[1] - p[3])) / p[0]
    _, other = _both([ca.SX.sym("t"), x, empty, empty, ca.SX(0, 1), p, empty], ca.vertcat(x[2], x[2], rate))
    assert _operations(other) == 7  # (a x2 + b x0) + (c (x0 - x1) + d)
    assert other.levels[other.functions["derivative"][2]] == STATE


def test_what_is_deep_is_no_trouble() -> None:
    x, p, empty = ca.SX.sym("x", 1), ca.SX.sym("p", 1), ca.SX(0, 1)
    factor, value = p, x
    for k in range(500):
        factor = factor * (p if k % 7 else 1 / p)
        value = ca.sin(value + k)
    one, other = _both([ca.SX.sym("t"), x, empty, empty, empty, p, empty], factor * value * ca.exp(x))
    _assert_alike(one, other, lambda name, _: 1.01 if name == "p" else 0.3)
