"""Work that runs take: steps times operations and so much for each, whoever does it, counted by the innermost."""

from __future__ import annotations

import pytest

from engine.assemble import build
from engine.model import Model
from engine.operations import CALL
from engine.simulate import carried_out_together, note_work, prepare, simulate
from engine.tangent import tangents
from engine.threads import Threads
from engine.work import DIRECTION, EACH, EACH_NUMBER, counted, counting
from tests.engine.parts import Body, Push, Spring, Wave, system


@pytest.fixture(scope="module")
def model() -> Model:
    plant = system(
        {"m": Body(inertia=0.02), "s": Spring(stiffness=20.0, damping=0.01), "l": Body(inertia=0.05)},
        ("m.shaft", "s.a"),
        ("s.b", "l.shaft"),
    )
    return build(plant, outputs=["l.shaft.angle"])


def test_steps_are_counted_times_the_operations_of_the_right_hand_side(model: Model) -> None:
    with counted() as work:
        run = simulate(model, 0.5, 1e-2, internal_step=2e-3)
    assert run.steps == 250
    assert work.done == 250 * model.operations + EACH + 51 * EACH_NUMBER
    assert counting() is None


def test_tangents_and_runs_together_are_counted_too(model: Model) -> None:
    jobs = [prepare(model, 0.5, 1e-2, internal_step=2e-3, parameters={"m.inertia": 0.02 + k / 100}) for k in range(3)]
    with counted() as work:
        tangents(model, 0.5, 1e-2, wrt=["m.inertia"], internal_step=2e-3)
        carried_out_together(model, jobs)
    runs = 4 * (250 * model.operations + EACH) + round(DIRECTION * 250 * model.operations)
    assert work.done == runs + 5 * 51 * EACH_NUMBER


def test_no_runs_take_no_work(model: Model) -> None:
    with counted() as work:
        note_work(model, [])
    assert work.done == 0


def test_tangents_count_for_every_direction(model: Model) -> None:
    with counted() as work:
        tangents(model, 0.5, 1e-2, wrt=["m.inertia", "s.stiffness"], internal_step=2e-3)
    assert work.done == round(250 * model.operations * (1 + 2 * DIRECTION)) + EACH + 3 * 51 * EACH_NUMBER


def test_what_is_counted_within_is_not_counted_without(model: Model) -> None:
    with counted() as outer:
        with counted() as inner:
            simulate(model, 0.5, 1e-2, internal_step=2e-3)
        assert (outer.done, inner.done) == (0, 250 * model.operations + EACH + 51 * EACH_NUMBER)
        simulate(model, 0.1, 1e-2, internal_step=2e-3)
    assert outer.done == 50 * model.operations + EACH + 11 * EACH_NUMBER


@pytest.mark.parametrize("workers", [1, 3])
def test_threads_count_for_whoever_made_them(model: Model, workers: int) -> None:
    with counted() as work, Threads(workers) as pool:
        runs = list(pool.map(lambda k: simulate(model, 0.1 * k, 1e-2, internal_step=2e-3).steps, range(1, 9)))
    assert sum(runs) == 36 * 50
    assert work.done == 36 * 50 * model.operations + 8 * EACH + (8 + 36 * 10) * EACH_NUMBER


def test_a_sine_counts_as_the_operations_that_take_as_long() -> None:
    model = build(system({"w": Wave(), "p": Push(), "m": Body(inertia=0.1)}, ("w.out", "p.in"), ("p.shaft", "m.shaft")))
    assert model.operations == int(model.functions["derivative"].n_instructions()) + CALL - 1
