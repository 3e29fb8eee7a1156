"""A candidate fitter whose fits are done by the workers of a dask cluster.

What travels is the scenario's files, the recordings, and for each fit the effects and the numbers to start from;
numbers come back. The models are built on both sides, so that the verdict is that of a study on one machine.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from threadpoolctl import threadpool_limits

from diagnosis.effects.effect import Candidate
from diagnosis.recordings.types import Recorded
from diagnosis.search.allowance import Spent
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.partial_fit import PartialFit
from engine.errors import FlexarmError
from engine.spread import Spread, Store
from engine.work import counted, counting
from scenarios.files import Shipment, packed, unpacked
from scenarios.load import Scenario, load

STUDIES = 2
"""Studies whose models a worker keeps."""

_building = threading.Lock()
_shops: dict[str, CandidateFitter] = {}


@dataclass(frozen=True)
class Order:
    """What a worker needs to build a study's models."""

    files: Shipment
    overrides: tuple[str, ...]
    recordings: tuple[Recorded, ...]
    seed: int
    digest: str


@dataclass(frozen=True)
class Task:
    """A fit: effects at their starting sizes from some parents' parameters, or one begun elsewhere, and its reach.

    The recordings are made coarse around the user's model, or around effects and what was fitted of them.
    """

    effects: tuple[Candidate, ...]
    parents: tuple[dict[str, float], ...]
    begun: dict[str, Any] | None = None
    reach: float = math.inf
    around: tuple[tuple[Candidate, ...], dict[str, Any]] | None = None


class DaskFitter(CandidateFitter):
    """A candidate fitter that leaves its fits to a cluster; arguments as of `CandidateFitter`.

    Args:
        spread: the cluster.
    """

    def __init__(
        self,
        scenario: Scenario,
        recordings: Sequence[Recorded],
        spread: Spread,
        seed: int,
        store: Store | None,
        spent: Spent | None = None,
    ) -> None:
        super().__init__(scenario, recordings, spread.workers, seed, store, spent)
        self.spread = spread
        order = Order(packed(scenario), tuple(scenario.overrides), self.recordings, seed, self.digest)
        self.order = spread.shared(order)

    def again(self, recordings: Sequence[Recorded]) -> DaskFitter:
        """The same with other recordings."""
        return DaskFitter(self.scenario, recordings, self.spread, self.seed, self.store, self.spent)

    def compute_partial_fit(self, effects: tuple[Candidate, ...], parents: Sequence[dict[str, float]]) -> PartialFit:
        """As of `CandidateFitter`, on a worker."""
        return self._done(Task(effects, tuple(parents)))

    def compute_finish(self, partial: PartialFit, reach: float = math.inf) -> PartialFit:
        """As of `CandidateFitter`, on a worker."""
        return self._done(Task(partial.effects, (), partial.row(), reach))

    def _done(self, task: Task) -> PartialFit:
        if self.centre is not None:
            task = replace(task, around=(self.centre.effects, self.centre.row()))
        row = self.spread.call(perform, (self.order, task))
        work = counting()
        if work is not None:
            work.add(row["work"])
        return self.restored(task.effects, row)


def perform(given: tuple[Order, Task]) -> dict[str, Any]:
    """Do a fit, on a worker.

    Raises:
        FlexarmError: the model has no meaning, or this worker builds another one.
    """
    order, task = given
    with threadpool_limits(1):
        fitter = _shop(order)
        if task.around is not None:
            fitter = fitter.around(fitter.restored(*task.around))
        with counted() as work:
            if task.begun is None:
                made = fitter.compute_partial_fit(task.effects, task.parents)
            else:
                made = fitter.compute_finish(fitter.restored(task.effects, task.begun), task.reach)
    return replace(made, work=work.done).row()


def _shop(order: Order) -> CandidateFitter:
    with _building:  # a worker may have several threads
        if order.digest not in _shops:
            made = CandidateFitter(load(unpacked(order.files), order.overrides), order.recordings, 1, order.seed)
            if made.digest != order.digest:
                raise FlexarmError(
                    "a worker builds another model from the same scenario",
                    remedy="install the same version of flexarm and its packages everywhere",
                )
            while len(_shops) >= STUDIES:
                del _shops[next(iter(_shops))]
            _shops[order.digest] = made
        return _shops[order.digest]
