"""Functions called with arrays give what CasADi's own matrices give, from several threads too."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from engine.evaluation import Evaluation
from scenarios.load import load


@pytest.mark.parametrize("name", ["reference-a", "reference-b", "two-link-flexible"])
def test_a_jacobian_is_the_same_to_the_bit(name: str) -> None:
    model, random = load(name).build(), np.random.default_rng(0)
    p, e = model.parameter_values, model.equations
    cases = [random.normal(0, 1, len(model.states)) for _ in range(200)]
    rest = [np.zeros(part.numel()) for part in (e.u, e.d, e.m)]
    expected = [np.array(model.jacobian(0.0, x, *rest, p).full()) for x in cases]
    assert expected[0].any()
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda x: model.at("jacobian")(0.0, x, *rest, p), cases))
    for one, other in zip(expected, found, strict=True):
        assert one.shape == other.shape
        assert np.ascontiguousarray(one).tobytes() == other.tobytes()


def test_a_result_is_the_callers_own() -> None:
    x = ca.SX.sym("x", 2)
    twice = Evaluation(ca.Function("twice", [x], [2 * x]))
    first = twice([1.0, 2.0])
    assert twice([3.0, 4.0]).tolist() == [[6.0], [8.0]]
    assert first.tolist() == [[2.0], [4.0]]
    assert pickle.loads(pickle.dumps(twice))([1.0, 2.0]).tolist() == [[2.0], [4.0]]


def test_a_function_without_results() -> None:
    assert Evaluation(ca.Function("none", [ca.SX.sym("x")], [ca.SX(0, 1)]))(1.0).shape == (0, 1)


def test_along_one_argument_it_is_what_calls_give() -> None:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    matrix = ca.vertcat(ca.horzcat(x[0] * p, 0), ca.horzcat(ca.sin(x[1]), x[0] / x[1]))
    found = Evaluation(ca.Function("matrix", [x, p], [ca.sparsify(matrix)]))
    rows = np.array([[1.0, 2.0], [-0.3, 0.0], [4.0, 1e-3]])
    along = found.along(rows, 0, rows[0], 3.0)
    assert along.shape == (3, 3)
    for row, values in zip(rows, along, strict=True):
        assert np.array_equal(np.sort(values), np.sort(found(row, 3.0)[[0, 1, 1], [0, 0, 1]]))
