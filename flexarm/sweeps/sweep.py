"""Sweeps: a scenario over grids of values and draws within tolerances, one row of numbers for each run."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from engine.errors import FlexarmError, ParameterError, nearest
from engine.files import folder_made
from engine.spread import MOST_WORKERS, Spread
from flexarm._version import version
from flexarm.output import provenance
from flexarm.sweeps.metrics import read_metrics
from flexarm.sweeps.plan import MOST_RUNS, SweepPlan, check_draws, inside, make_axes
from flexarm.sweeps.samples import from_fit
from flexarm.sweeps.store import SweepStore
from flexarm.sweeps.work import SUMMARIES, Span, build, compute, digest
from scenarios.files import packed
from scenarios.load import Scenario, load

if TYPE_CHECKING:
    from engine.model import Model

TABLE = "runs.parquet"
"""The table's name in a folder."""


@dataclass(frozen=True)
class Sweep:
    """A finished sweep.

    Attributes:
        table: the Parquet file; read it with `flexarm.read`.
        trajectories: the file of outputs over time, if they were kept.
        plan: what was run.
        computed: runs that were computed now; the others were there from an earlier, interrupted call.
    """

    table: Path
    trajectories: Path | None
    plan: SweepPlan
    computed: int


class SweepKeywords(TypedDict, total=False):
    """The fields of `SweepOptions` as keyword arguments; why there are both: `engine.simulate.SimulationKeywords`."""

    runs: int | None
    seed: int
    outputs: Iterable[str] | None
    stop: float | None
    step: float | None
    keep: float | None
    workers: int | None
    scheduler: str | None
    restart: bool
    progress: Callable[[int, int], None] | None
    warn: Callable[[str], None] | None
    metrics: Iterable[str]
    from_fit: str | Path | None


@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """What each run of a sweep is, and where the runs are done.

    Attributes:
        runs: draws at each point of the grid; needed if something is drawn.
        seed: of the draws.
        outputs: signals to sum up; those the scenario records if None.
        stop: end of every run (s); that of the scenario if None.
        step: time between rows (s); that of the scenario if None.
        keep: also keep the outputs over time, at this interval (s), in ``trajectories.parquet`` of the folder.
        workers: processes; as many as cores if None.
        scheduler: address of a dask scheduler whose workers are used instead.
        restart: throw away what an earlier sweep left in the output.
        progress: called with runs done and runs in all.
        warn: called with the reason of the first run that fails, as soon as it has.
        metrics: further numbers of each run: ``NAME=overshoot(SIGNAL)``, ``NAME=FILE.py:FUNCTION``; see
            `flexarm.sweeps.metrics`.
        from_fit: a file of ``flexarm fit --json``: its parameters are drawn as uncertain and as correlated as it says.
    """

    runs: int | None = None
    seed: int = 0
    outputs: Iterable[str] | None = None
    stop: float | None = None
    step: float | None = None
    keep: float | None = None
    workers: int | None = None
    scheduler: str | None = None
    restart: bool = False
    progress: Callable[[int, int], None] | None = None
    warn: Callable[[str], None] | None = None
    metrics: Iterable[str] = ()
    from_fit: str | Path | None = None


def sweep(
    source: Scenario | str | Path,
    vary: Sequence[str],
    output: str | Path,
    options: SweepOptions | None = None,
    **given: Unpack[SweepKeywords],
) -> Sweep:
    """Run a scenario over grids and draws, and write a row of numbers for each run.

    The rows are the same for any number of workers, in this process, in others or on a cluster. After an interruption,
    the same call goes on where it was. A run that fails (it diverges, or its values do not fit together) has its reason
    in the column ``failure`` and no numbers.

    Args:
        source: a scenario, its file or shipped name.
        vary: texts ``KEY=START:STOP:N[:log]`` and ``KEY=A,B,C`` (axes of a grid, the first slowest, after those that
            need models of their own), ``KEY~tolerance``, ``KEY~10%`` and ``KEY~LOW:HIGH`` (drawn uniformly; the key may
            hold ``*``), and the laws of `flexarm.sweeps.samples`, such as ``KEY~normal(10%)``.
        output: a .parquet file, or a folder, made if need be, in which it is called ``runs.parquet``.
        options: what each run is, and where the runs are done.
        **given: fields of `SweepOptions` as keywords, over those of ``options``, such as ``runs=1000``.

    Raises:
        FlexarmError: a key, value or file that does not fit, or ``output`` holds another sweep.
    """
    scenario = source if isinstance(source, Scenario) else load(source)
    o = replace(options or SweepOptions(), **given)
    plan = make_plan(scenario, vary, o)
    table = _table(Path(output), o.keep)  # what is refused leaves no folder
    warn = o.warn
    store = SweepStore(table, plan, provenance(scenario), o.restart)
    if store.done():
        return Sweep(table, store.trajectories, plan, 0)
    try:
        missing = store.begin()
        runs_missing = sum(last - first for first, last in missing)
        done = plan.total - runs_missing
        if o.progress:
            o.progress(done, plan.total)
        # A pool costs a second or two; a few short runs are done before it has started.
        count = 1 if len(missing) <= 1 else o.workers
        if count is not None and count <= MOST_WORKERS:
            count = min(count, max(1, len(missing)))
        with Spread(count, o.scheduler) as workforce:
            shipped = replace(plan, files=packed(scenario)) if o.scheduler else plan
            answers = workforce.map(functools.partial(compute, shipped), missing)
            for span, found in zip(missing, answers, strict=True):
                store.write(span, found)
                if warn is not None and (text := _first_failure(found)):
                    warn(text)
                    warn = None
                done += span[1] - span[0]
                if o.progress:
                    o.progress(done, plan.total)
        store.finish()
    finally:
        store.close()
    return Sweep(table, store.trajectories, plan, runs_missing)


def _first_failure(found: Span) -> str:
    """The first run of a span that failed, and why; empty if none did."""
    for number, reason in zip(found.columns["run"], found.columns["failure"], strict=True):
        if reason is not None:
            return f"run {number} failed: {reason}"
    return ""


def _table(output: Path, keep: float | None) -> Path:
    if output.suffix.lower() == ".parquet" and not output.is_dir():
        if keep is not None:
            raise FlexarmError(
                f"'{output}' has room for one table, and trajectories are another",
                remedy="give a folder: -o DIR",
            )
        return output
    if output.suffix and not output.exists():
        raise FlexarmError(
            f"'{output}' is of no kind that a sweep can write", remedy="give a .parquet file, or a folder"
        )
    return folder_made(output) / TABLE


def make_plan(
    scenario: Scenario,
    vary: Sequence[str],
    options: SweepOptions | None = None,
    **given: Unpack[SweepKeywords],
) -> SweepPlan:
    """The plan of a sweep; arguments and errors as of `sweep`."""
    o = replace(options or SweepOptions(), **given)
    if not vary and o.from_fit is None:
        raise FlexarmError("nothing is varied", remedy="give --vary, for example --vary gear.ratio=14:70:5")
    if o.runs is not None and o.runs < 1:
        raise ParameterError(f"{o.runs} runs are none", remedy="give --runs 1 or more")
    if o.seed < 0:
        raise ParameterError(f"the seed {o.seed} is below zero", remedy="give --seed 0 or more")
    for name, value in (("stop", o.stop), ("step", o.step), ("keep", o.keep)):
        if value is not None and not value > 0:
            raise ParameterError(f"{name} is {value}", remedy="give a time above zero, in seconds")
    wanted = None if o.outputs is None else [scenario.resolve(name) for name in o.outputs]
    model = scenario.build(outputs=wanted)
    chosen = tuple((variable.name, variable.unit) for variable in model.outputs)
    if wanted is not None and not chosen:
        raise ParameterError("no outputs are chosen", remedy=nearest("", [v.name for v in scenario.build().outputs]))

    def rebuild(override: str, load_only: bool = False) -> Model | None:
        made = load(scenario.path, [*scenario.overrides, override])
        return None if load_only else made.build(outputs=wanted)

    axes, samples = make_axes(scenario, model, vary, rebuild)
    correlation: tuple[tuple[float, ...], ...] = ()
    if o.from_fit is not None:
        known = {p.name: (p.declared, inside(p.declared)) for p in model.parameters}
        fitted, correlation = from_fit(Path(o.from_fit), known)
        taken = {sample.name for sample in samples} | {name for axis in axes for name in axis.names}
        twice = next((sample.name for sample in fitted if sample.name in taken), None)
        if twice:
            raise ParameterError(f"'{twice}' is drawn from the fit and varied as well", remedy="leave out that --vary")
        samples = (*fitted, *samples)
    check_draws(model, samples)
    taken = {"run", "failure", *(axis.key for axis in axes), *(sample.name for sample in samples)}
    taken |= {f"{name}.{kind}" for name, _ in chosen for kind in SUMMARIES}
    metrics = read_metrics(tuple(o.metrics), dict(chosen), taken)
    if o.scheduler and any(metric.digest for metric in metrics):
        raise ParameterError("a Python function is not sent to a cluster", remedy="use --workers, or a named metric")
    if samples and o.runs is None:
        raise ParameterError(
            f"'{samples[0].name}' is drawn at random, and how often is not said", remedy="add for example --runs 1000"
        )
    if o.runs is not None and not samples:
        raise ParameterError(f"--runs {o.runs} without anything that is drawn", remedy="add for example KEY~tolerance")
    plan = SweepPlan(
        scenario=str(scenario.path),
        digest=digest(scenario),
        overrides=scenario.overrides,
        axes=axes,
        samples=samples,
        draws=o.runs or 1,
        seed=o.seed,
        outputs=chosen,
        stop=o.stop,
        step=o.step,
        keep=o.keep,
        version=version(),
        metrics=metrics,
        correlation=correlation,
    )
    if plan.total > MOST_RUNS:
        raise ParameterError(f"{plan.total:.3g} runs are too many", remedy=f"at most {MOST_RUNS:.0e} are done")
    build(plan, ())
    return plan


__all__: list[Any] = ["Sweep", "make_plan", "sweep"]
