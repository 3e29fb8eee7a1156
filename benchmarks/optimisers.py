"""How optimisers do on fits of random rigs: how often they end at the bottom, and at what cost.

    python -m benchmarks.optimisers -o optimiser-rigs --rigs 17

Rigs of `benchmarks.concealed.rigs` are drawn from seed 0 on and kept in the folder, and so is every fit: what was
stopped goes on. Each rig gives up to six fits to its training recordings: of the nominal model, and of the model with
the effects put in that the rig conceals; each begins from the values given, from a random point within the tolerances,
and from a bent point, every torque, inertia, stiffness and damping 0.6 times as large as given, together: from voltage
to angle that is nearly a ridge. Recordings are fitted whole, without the growing horizons of `fit`. Writes
``benchmarks/results/optimisers.json`` and ``docs/benchmarks/optimisers.md``.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from benchmarks.concealed.drawing import Unseen
from benchmarks.concealed.rigs.hidden import drawn
from benchmarks.concealed.scenario import write
from benchmarks.proof.page import table
from benchmarks.proof.summary import rate
from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.least_squares import descend
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.search.fitter import CandidateFitter
from engine.errors import FlexarmError, SimulationError
from engine.files import writing
from engine.spread import JsonStore, Spread
from engine.threads import Threads
from scenarios.load import load

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "benchmarks" / "results" / "optimisers.json"
PAGE = ROOT / "docs" / "benchmarks" / "optimisers.md"

STEPS = 100
"""Steps of an optimiser at most; evaluations of the residual at most for those that count these."""

BENT = 0.6
"""Factor of a bent start."""

SHARE, LEAST = 1e-3, 0.5
"""A fit has reached the bottom whose cost exceeds the lowest by no more than this share, or by this much."""

MODELS = ("nominal", "amended")
STARTS = ("nominal", "random", "bent")


@dataclass(frozen=True)
class Watched(Problem):
    """A problem that counts how often an experiment is simulated, and how often differentiated."""

    calls: Counter[str] = field(default_factory=Counter)

    def residuals(self, x: Array, experiments: Sequence[Experiment], *how: Any) -> list[Array]:
        """As of the problem."""
        self.calls["residual"] += len(experiments)
        return super().residuals(x, experiments, *how)

    def linearised(self, x: Array, experiment: Experiment, only: Sequence[int] | None = None) -> tuple[Array, Array]:
        """As of the problem."""
        self.calls["jacobian"] += 1
        return super().linearised(x, experiment, only)


def watched(made: Problem) -> Watched:
    """A problem with its counts at zero."""
    return Watched(**{f.name: getattr(made, f.name) for f in fields(Problem)})


class Stacked:
    """Residual of all training recordings with the prior as further rows, as functions of the search vector.

    Args:
        problem: to fit.
        x: where the fit starts.
    """

    def __init__(self, problem: Problem, x: Array) -> None:
        self.problem = problem
        self.best: tuple[float, Array] = (math.inf, x)
        """Lowest cost that was computed, and where."""

    def residual(self, x: Array) -> Array:
        """Shape (rows,)."""
        parts = [self.problem.residual(x, e).ravel() for e in self.problem.training]
        r = np.concatenate([*parts, self.problem.prior(x)[0]])
        if float(r @ r) < self.best[0]:
            self.best = (float(r @ r), np.array(x))
        return r

    def linearised(self, x: Array) -> tuple[Array, Array]:
        """Residual and Jacobian, shapes (rows,) and (rows, n).

        Raises:
            SimulationError: the run cannot be differentiated.
        """
        parts = [*(self.problem.linearised(x, e) for e in self.problem.training), self.problem.prior(x)]
        return np.concatenate([r for r, _ in parts]), np.vstack([J for _, J in parts])

    def jacobian(self, x: Array) -> Array:
        """Shape (rows, n)."""
        return self.linearised(x)[1]


Optimiser = Callable[[Problem, Array], tuple[Array, bool]]
"""From a problem and a start to where it ended, and whether it says that it converged."""


def trust_region(problem: Problem, x: Array) -> tuple[Array, bool]:
    """Today's: a trust region in units of the tolerances, steps that gain little bent by geodesic acceleration."""
    return _descended(problem, x, accelerated=True)


def unaccelerated(problem: Problem, x: Array) -> tuple[Array, bool]:
    """The same with plain steps."""
    return _descended(problem, x, accelerated=False)


def _descended(problem: Problem, x: Array, *, accelerated: bool) -> tuple[Array, bool]:
    with Threads(1) as pool:
        x, _, converged = descend(
            problem, x, problem.training, pool, iterations=STEPS, accelerated=accelerated, noise="stated"
        )
    return x, converged


def levenberg_marquardt(problem: Problem, x: Array) -> tuple[Array, bool]:
    """The one of before: damping scaled by the normal equations' diagonal, geodesic acceleration [Transtrum 2012].

    The prior is a row of the normal equations like any other, so that where the noise is small what it says of a ridge
    is lost in the damping of what the data say.
    """
    stack, damping = Stacked(problem, x), 1e-3
    try:
        r, J = stack.linearised(x)
    except SimulationError:
        return x, False
    cost = float(r @ r)
    for _ in range(STEPS):
        H, g = J.T @ J, J.T @ r
        scale = np.diag(np.maximum(np.diag(H), 1e-9))
        promised = float(g @ np.linalg.solve(H + 1e-9 * scale, g))
        if promised < 1e-3:
            return x, True
        for _ in range(12):
            A = H + damping * scale
            step = np.clip(-np.linalg.solve(A, g), -3.0, 3.0)
            second = 20 * ((stack.residual(x + 0.1 * step) - r) / 0.1 - J @ step)
            bend = -np.linalg.solve(A, J.T @ second)
            if np.linalg.norm(bend) < 0.75 * np.linalg.norm(step):
                step = step + bend / 2
            there = stack.residual(x + step)
            if float(there @ there) < cost:
                break
            damping *= 3
        else:
            return x, promised < max(1.0, 1e-4 * cost)
        x, damping = x + step, max(damping / 5, 1e-9)
        try:
            r, J = stack.linearised(x)
        except SimulationError:
            return x, False
        gain, cost = cost - float(r @ r), float(r @ r)
        if gain < 1e-7 * cost:
            return x, promised < max(1.0, 1e-4 * cost)
    return x, False


def reflective(problem: Problem, x: Array) -> tuple[Array, bool]:
    """`scipy.optimize.least_squares`, trust region reflective, within the parameters' bounds."""
    return _by_scipy(problem, x, "trf")


def minpack(problem: Problem, x: Array) -> tuple[Array, bool]:
    """`scipy.optimize.least_squares`, MINPACK's Levenberg-Marquardt, which knows no bounds."""
    return _by_scipy(problem, x, "lm")


def _by_scipy(problem: Problem, x: Array, method: str) -> tuple[Array, bool]:
    stack = Stacked(problem, x)
    low, high = np.array([f.ends for f in problem.free]).T
    bounds = (low, high) if method == "trf" else (-np.inf, np.inf)
    begin = np.clip(x, low, high) if method == "trf" else x
    try:
        found = least_squares(stack.residual, begin, stack.jacobian, bounds, method, max_nfev=STEPS)
    except (SimulationError, ValueError, np.linalg.LinAlgError):
        return stack.best[1], False
    return found.x, bool(found.status > 0)


OPTIMISERS: dict[str, Optimiser] = {
    "trust region, accelerated": trust_region,
    "trust region": unaccelerated,
    "Levenberg-Marquardt, accelerated": levenberg_marquardt,
    "scipy, trf": reflective,
    "scipy, lm": minpack,
}
"""The first is the one that flexarm uses."""


def rig(seed: int, folder: Path) -> tuple[Path, dict[str, Any]] | None:
    """A drawn rig's scenario file and its answer, drawn once; None if the seed gives none.

    Args:
        seed: of the rig.
        folder: where rigs are kept.
    """
    made, answers = folder / "cases" / f"rig-{seed}", folder / "answers"
    sealed = answers / f"rig-{seed}.json"
    if not sealed.exists():
        try:
            asked, case = drawn(seed)
        except Unseen:
            return None
        write(case, made, answers, asked.withheld)
    return made / "scenario.yaml", json.loads(sealed.read_text(encoding="utf-8"))


def truth(answer: Mapping[str, Any], listed: Sequence[Candidate]) -> list[list[Candidate]] | None:
    """For each effect that a rig conceals the candidates that are it; None if it conceals none, or one that none is.

    Args:
        answer: of the rig.
        listed: every effect at every place.
    """
    targets = [(c["effect"], {c["place"], *c["same_place"]}) for c in answer["concealed"]]
    targets += [("wrong_parameter", {name}) for name, _ in answer["options"]["wrong"]]
    chosen = []
    for name, allowed in targets:
        able = [c for c in listed if c.effect == name and {c.place, *c.place.split(" -> ")} & allowed]
        if not able:
            return None
        chosen.append(able)
    return chosen or None


def amended(fitter: CandidateFitter, effects: Sequence[Sequence[Candidate]]) -> tuple[Problem, Array] | None:
    """The model with effects put in one after the other, each in the way and at the starting size that costs least.

    Args:
        fitter: builds models.
        effects: to put in, each with the ways to do so.
    """
    found: tuple[Problem, Array] | None = None
    before: tuple[Candidate, ...] = ()
    built: tuple[Sizes, ...] = ()
    for ways in effects:
        tried: list[tuple[float, int, Problem, Array, Candidate, Sizes]] = []
        for effect, group in [(one, group) for one in ways for group in one.structures()]:
            try:
                for made, x, sizes in fitter.placed((*before, effect), [(*built, s) for s in group], {}):
                    cost = made.cost(x, made.training[:1], noise="stated")
                    tried.append((cost, len(tried), made, x, effect, sizes[-1]))
            except FlexarmError:
                continue
        if not tried:
            return None
        _, _, made, x, effect, own = min(tried, key=lambda one: one[:2])
        found = (made, x)
        before, built = (*before, effect), (*built, own)
    return found


def begun(made: Problem, x: Array, start: str, seed: int) -> Array:
    """The search vector of a start; the effects' own sizes and starting values stay at ``x``.

    Args:
        made: the problem.
        x: values given, shape (n,).
        start: one of `STARTS`.
        seed: of a random one.
    """
    units = {p.name: p.unit for p in made.model.parameters}
    random = np.random.default_rng([seed, 1])
    moved = x.copy()
    for i, f in enumerate(made.free):
        draw = random.uniform(-1.0, 1.0)
        if f.recording or not f.prior:
            continue
        if start == "random":
            moved[i] += draw
        elif start == "bent" and units[f.name].startswith(("kg", "N")):
            moved[i] = f.position(BENT * f.value(x[i]))
        moved[i] = min(max(moved[i], f.ends[0]), f.ends[1])
    return moved


def fits(task: tuple[int, str, Path]) -> list[dict[str, Any]]:
    """Every optimiser from every start on one model of one rig.

    Args:
        task: seed, one of `MODELS`, folder.
    """
    seed, model, folder = task
    found = rig(seed, folder)
    if found is None:
        return []
    scenario = load(found[0])
    with threadpool_limits(1):
        fitter = CandidateFitter(scenario, gather(scenario, (), ()), workers=1)
        made, x = fitter.base, np.zeros(len(fitter.base.free))
        if model == "amended":
            effects = truth(found[1], candidates(operating_scales(made), ()))
            put_in = amended(fitter, effects) if effects else None
            if put_in is None:
                return []
            made, x = put_in
        return [
            {"seed": seed, "model": model, "start": start, "n": len(x), **row}
            for start in STARTS
            for row in compared(made, begun(made, x, start, seed))
        ]


def compared(made: Problem, x: Array) -> list[dict[str, Any]]:
    """What each optimiser makes of a problem from one start."""
    rows = []
    for name, optimiser in OPTIMISERS.items():
        counted = watched(made)
        began = time.process_time()
        there, converged = optimiser(counted, x)
        seconds = time.process_time() - began
        calls = {what: counted.calls[what] / len(made.training) for what in ("residual", "jacobian")}
        cost = made.cost(there, made.training, noise="stated")
        rows.append({"optimiser": name, "cost": cost, "converged": converged, "seconds": seconds, **calls})
    return rows


def lowest(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The rows, each with whether it reached the lowest cost that any optimiser found from any start of its model."""
    least: dict[tuple[int, str], float] = {}
    for row in rows:
        key = (row["seed"], row["model"])
        least[key] = min(least.get(key, math.inf), row["cost"])
    told = []
    for row in rows:
        best = least[row["seed"], row["model"]]
        told.append(dict(row) | {"bottom": bool(row["cost"] <= best + max(SHARE * best, LEAST))})
    return told


HEAD = """# Optimisers on fits of random rigs

Written by `python -m benchmarks.optimisers` from `benchmarks/results/optimisers.json`. {fits} fits of {rigs} random
rigs (seeds {seeds}) to their training recordings: {counts}. Each model begins from the values given, from a random
point within the tolerances, and from a bent point, where all torques, inertias, stiffnesses and dampings are 0.6 times
as large as given, together. The recordings are fitted whole; every optimiser has the same residual, with the prior as
further rows, the same exact Jacobian, and {steps} steps (those of scipy {steps} evaluations of the residual).

*At the bottom* is a fit whose cost exceeds the lowest that any optimiser found from any start of that model by no more
than 0.1 %, or 0.5. *Wrongly content* says that it converged and is not there, though another optimiser got there. Time
is processor time on one thread, as a ratio to that of flexarm's own optimiser in the same fit, the median. Bounds are
those of Wilson, 95 %.

{machine}, shared with other work.

"""


def page(rows: Sequence[Mapping[str, Any]], about: Mapping[str, Any]) -> str:
    """The page of results.

    Args:
        rows: of `fits`.
        about: ``machine``.
    """
    told = lowest(rows)
    tasks = sorted({(r["seed"], r["model"], r["start"]) for r in told})
    seeds = sorted({seed for seed, *_ in tasks})
    counts = Counter(model for _, model, _ in tasks)
    named = {"nominal": "of the nominal model", "amended": "with the concealed effects put in"}
    head = HEAD.format(
        fits=len(tasks),
        rigs=len(seeds),
        seeds=", ".join(map(str, seeds)),
        counts=", ".join(f"{counts[model]} {named[model]}" for model in MODELS),
        steps=STEPS,
        machine=about["machine"],
    )
    columns = ["optimiser", "at the bottom", *(f"from {s}" for s in STARTS)]
    columns += ["says it converged", "wrongly content", "residuals", "Jacobians", "time"]
    base = {(r["seed"], r["model"], r["start"]): r["seconds"] for r in told if r["optimiser"] == next(iter(OPTIMISERS))}
    listed = []
    for name in OPTIMISERS:
        own = [r for r in told if r["optimiser"] == name]
        ratios = [r["seconds"] / base[r["seed"], r["model"], r["start"]] for r in own]
        cells = [name, rate(sum(r["bottom"] for r in own), len(own))]
        cells += [_share([r for r in own if r["start"] == s], lambda r: r["bottom"]) for s in STARTS]
        cells += [_share(own, lambda r: r["converged"]), _share(own, lambda r: r["converged"] and not r["bottom"])]
        cells += [f"{statistics.median(r[what] for r in own):.0f}" for what in ("residual", "jacobian")]
        listed.append([*cells, f"{statistics.median(ratios):.2f}"])
    missed = [r for r in told if r["optimiser"] == next(iter(OPTIMISERS)) and not r["bottom"]]
    worst = []
    for r in missed:
        costs = [f"{cost:.6g}" for cost in (r["cost"], _least(told, r))]
        worst.append([f"`rig-{r['seed']}`", r["model"], r["start"], *costs, "yes" if r["converged"] else "no"])
    text = head + table(columns, listed)
    text += f"\nMedian number of free parameters: {statistics.median(r['n'] for r in told):.0f}.\n"
    if worst:
        text += "\n## Where flexarm's own does not reach the bottom\n\n"
        text += table(["rig", "model", "start", "cost", "lowest", "says it converged"], worst)
    return text


def _least(rows: Sequence[Mapping[str, Any]], one: Mapping[str, Any]) -> float:
    return float(min(r["cost"] for r in rows if (r["seed"], r["model"]) == (one["seed"], one["model"])))


def _share(rows: Sequence[Mapping[str, Any]], hit: Callable[[Mapping[str, Any]], bool]) -> str:
    return f"{100 * sum(map(hit, rows)) / len(rows):.0f} %" if rows else "-"


def main(arguments: list[str] | None = None) -> int:
    """Fit what has not been fitted, and write the results."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.optimisers", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="rigs and fits are kept here")
    parser.add_argument("--rigs", type=int, default=17, help="how many; each gives three or six fits")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--page", action="store_true", help="fit nothing: write the page of what has been fitted")
    given = parser.parse_args(arguments)
    store = JsonStore(given.output / "fits")
    tasks = [
        (f"{seed} {model}", (seed, model, given.output)) for seed in range(given.rigs) for model in reversed(MODELS)
    ]
    rows: list[dict[str, Any]] = []
    if given.page:
        rows = [row for key, _ in tasks if key in store for row in store[key]]
    else:
        with Spread(given.workers) as spread:
            for done, (key, found) in enumerate(spread.kept(fits, tasks, store), 1):
                print(f"{done} of {len(tasks)}: rig {key}, {len(found) // len(OPTIMISERS)} fits", flush=True)
                rows += found
    if not rows:
        print("error: nothing has been fitted yet", file=sys.stderr)
        return 1
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    data = {"machine": machine, "rows": rows}
    with writing(DATA, (".json",)) as temporary:
        lines = ",\n".join(json.dumps(row) for row in rows)
        temporary.write_text(f'{{"machine": {json.dumps(machine)}, "rows": [\n{lines}\n]}}\n', encoding="utf-8")
    with writing(PAGE, (".md",)) as temporary:
        temporary.write_text(page(rows, data), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
