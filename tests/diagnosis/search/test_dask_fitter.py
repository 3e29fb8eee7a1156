"""A diagnosis whose fits are done by a cluster: the same verdict, and errors that say what is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from diagnosis.api import diagnose, gather
from diagnosis.search.dask_fitter import Order, Task, perform
from diagnosis.search.fitter import CandidateFitter
from engine.errors import FlexarmError
from scenarios.files import packed
from scenarios.load import load
from tests.diagnosis.plants import case
from tests.diagnosis.search.test_resume import LEFT_OUT


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return case(tmp_path_factory.mktemp("bench"), coulomb=4.0e-4, seed=3)


@pytest.mark.slow
def test_a_cluster_comes_to_the_same_verdict(path: Any, cluster: Any, tmp_path: Path) -> None:
    """Number for number; and what it keeps is taken up by a study on this machine."""
    alone = json.dumps(diagnose(path, workers=1, without=LEFT_OUT).numbers())
    told = []
    found = diagnose(
        path, scheduler=cluster, without=LEFT_OUT, keep=tmp_path / "kept", progress=lambda *now: told.append(now)
    )
    assert json.dumps(found.numbers()) == alone
    assert {what for what, _, _ in told} >= {"trying effects", "fitting the promising ones"}
    assert json.dumps(diagnose(path, workers=1, without=LEFT_OUT, keep=tmp_path / "kept").numbers()) == alone


def test_on_this_machine_no_pool_is_opened(path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("diagnosis.api.Spread", None)
    nothing = SimpleNamespace(effects=())

    def made(fitter: CandidateFitter, **_: Any) -> Any:
        return SimpleNamespace(chosen=nothing, recordings=fitter.recordings, by=fitter.workers)

    monkeypatch.setattr("diagnosis.api.study", made)
    monkeypatch.setattr("diagnosis.api.as_reported", lambda _, found: found)
    monkeypatch.setattr("diagnosis.api.judge", lambda found: found.by)
    workers: Any = diagnose(path, workers=3)
    assert workers == 3
    with pytest.raises(FlexarmError, match="0 workers"):
        diagnose(path, workers=0)


def test_an_address_where_nobody_answers(path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.spread.CONNECT", "0.5s")
    with pytest.raises(FlexarmError, match="no dask scheduler answers"):
        diagnose(path, scheduler="tcp://127.0.0.1:9")


def test_a_worker_that_builds_another_model_says_so(path: Any) -> None:
    scenario = load(path)
    fitter = CandidateFitter(scenario, gather(scenario, [], []))
    order = Order(packed(scenario), tuple(scenario.overrides), fitter.recordings, 0, fitter.digest)
    with pytest.raises(FlexarmError, match="another model"):
        perform((replace(order, digest="0" * 64), Task((), ())))
