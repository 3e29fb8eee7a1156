"""The verbs of the public API on scenarios: simulate, linearise, export, compare."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.model import Model
from engine.rows import check_rows
from engine.simulate import Result, SimulationKeywords, SimulationOptions
from engine.simulate import simulate as run_model
from flexarm.cut import Cut, Source, as_scenario, cut
from flexarm.design.point import point
from scenarios.load import si
from scenarios.validate import ScenarioError

if TYPE_CHECKING:
    from diagnosis.compare import Comparison
    from diagnosis.recordings.types import FrequencyTable, Recording
    from engine.discretise import DiscreteModel
    from engine.family import LinearFamily
    from engine.linearise import LinearModel
    from engine.trim import Equilibrium
    from flexarm.design.describing import Description
    from flexarm.design.uncertainty.results import UncertainModel


def simulate(
    source: Source | Model,
    stop: float | str | None = None,
    step: float | str | None = None,
    options: SimulationOptions | None = None,
    **given: Unpack[SimulationKeywords],
) -> Result:
    """Simulate a scenario as its file says, or a model.

    Args:
        source: a scenario, its file or shipped name, or a model built from one.
        stop: end, s or a text with a unit; that of the scenario if None.
        step: time between rows, likewise; that of the scenario, or 1 ms, if None.
        options: how to simulate; the internal step and its tolerance are those of the scenario where None.
        **given: fields of `SimulationOptions` as keywords, over those of ``options``, such as ``parameters={...}``,
            ``drive=...`` or ``record_states=True``.

    Raises:
        FlexarmError: the scenario or a value does not fit, or the simulation diverges.
    """
    chosen = replace(options or SimulationOptions(), **given)
    stop, step = _seconds(stop, "stop"), _seconds(step, "step")
    if isinstance(source, Model):
        model = source
    else:
        scenario = as_scenario(source)
        model = scenario.build()
        planned = scenario.simulation
        if planned is not None:
            stop = planned.stop if stop is None else stop
            step = planned.step if step is None else step
            if chosen.internal_step is None:
                chosen = replace(chosen, internal_step=planned.internal_step)
            if chosen.step_tolerance is None:
                chosen = replace(chosen, step_tolerance=planned.step_tolerance)
        elif stop is None:
            raise ScenarioError(
                "the scenario does not say how long to simulate",
                Where(scenario.document.file),
                "add 'simulate: {stop: 4 s}', or give a stop time",
            )
    if stop is None:
        raise ParameterError("no stop time is given", remedy="give one in seconds")
    step = 1e-3 if step is None else step
    check_rows(stop, step)
    return run_model(model, stop, step, chosen)


def _seconds(value: float | str | None, name: str) -> float | None:
    """A time in seconds, given as a number or as a text with a unit."""
    return si(value, {name: "s"}, name, Where(path=name)) if isinstance(value, str) else value


def trim(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    fix: Mapping[str, Any] | None = None,
    free: Iterable[str] | None = None,
    bounds: Mapping[str, tuple[Any, Any]] | None = None,
) -> Equilibrium:
    """An equilibrium of a scenario; see `engine.trim.trim`.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        analysis: name of an analysis in the file; the first of kind ``trim`` if None.
        inputs: signal inputs in place of those of the analysis.
        outputs: signals in place of those of the analysis.
        modes: mode name -> label, over those of the analysis: held whatever follows; the others are found.
        at: where the search begins, and the values of inputs that are not free: SI numbers or texts with a unit.
        fix: values that motions, states, inputs or outputs must have, over those of the analysis.
        free: inputs that are searched for, in place of those of the analysis; one may be a plain text.
        bounds: state or free input -> least and greatest value, over those of the analysis.

    Raises:
        FlexarmError: a name, label or unit that does not fit; there is no equilibrium, or a continuum of them.
    """
    from flexarm.design.point import equilibrium

    made = source if isinstance(source, Cut) else cut(source, "trim", analysis, inputs=inputs, outputs=outputs)
    chosen = None if free is None else (free,) if isinstance(free, str) else tuple(free)
    return equilibrium(made, modes=modes, at=at, fix=fix, free=chosen, bounds=bounds)


def linearise(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    trim: str | None = None,
    discrete: bool | None = None,
) -> LinearModel:
    """The linear model of a scenario: in discrete time where sampled blocks act, so that loops through them are closed.

    Where some input would move no output, since a joint is stuck there or a zone swallows the input, the model is that
    of the sliding joint or the open zone, unless ``modes`` says otherwise. A scenario that describes no analysis gives
    the inputs that its sources feed, the outputs that its run records, and the equilibrium nearest to its start. Both
    stand in `LinearModel.assumed`.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        analysis: name of an analysis in the file; the first of kind ``linearise`` if None.
        inputs: signal inputs in place of those of the analysis.
        outputs: signals in place of those of the analysis.
        modes: mode name -> label (``stuck``, ``inside``, ...), or -1, 0 or 1, over those of the analysis.
        at: states, motions and inputs at the point, over those of the analysis: SI numbers or texts with a unit.
        trim: an analysis of kind ``trim``, at whose equilibrium to linearise, over that of the analysis; ``auto`` for
            the equilibrium nearest to the point.
        discrete: True for a `DiscreteModel`; False for the continuous states alone, with what sampled blocks hold kept
            as it is, and their loops open; None for a `DiscreteModel` if the model has sampled blocks.

    Raises:
        FlexarmError: a name, label or unit that does not fit, or the point lies between two modes and none is chosen.
    """
    from engine.discretise import DiscreteModel
    from engine.discretise import discretise as sampled
    from engine.linear_modes import audible
    from engine.linearise import linearise as continuous
    from flexarm.design.point import start_of, trimmed

    made = source if isinstance(source, Cut) else cut(source, "linearise", analysis, inputs=inputs, outputs=outputs)
    linear = sampled if (bool(made.model.clocks) if discrete is None else discrete) else continuous
    asked = point(made, modes, at)
    there = start_of(made, asked, trim, at)
    found = linear(made.model, **there)
    assumed: tuple[str, ...] = ()
    if not made.settings.name and trim is None and not at and found.moving:
        try:
            near = trimmed(made).arguments()
            near["modes"] |= asked["modes"]  # what is given counts over where the equilibrium is
            found, there = linear(made.model, **near), near
            assumed = ("the equilibrium nearest to the start",)
        except FlexarmError:
            pass
    if found.ambiguous:
        (mode, labels), *_ = found.ambiguous.items()
        choices = " or ".join(f"--mode '{mode}={label}'" for label in labels)
        raise ParameterError(
            f"the point lies exactly on the edge between the modes {' and '.join(labels)} of '{mode}', "
            "and the linear model of each is another",
            remedy=f"choose: {choices}; in a file, under 'modes:' of the analysis; or another point, by --at",
        )
    sounds = isinstance(found, DiscreteModel)  # whose modes are those of the point
    heard = found if sounds else audible(made.model, found, **{**there, "modes": asked["modes"]})
    return replace(heard, assumed=(*heard.assumed, *made.chosen, *assumed))


def linear_family(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    grid: Mapping[str, str | Sequence[float]] | None = None,
    snapshots: float | str | None = None,
    every_mode: bool = False,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    trim: str | None = None,
) -> LinearFamily:
    """A family of linear models: over a grid, along the scenario's run, or in every combination of modes.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        analysis: name of an analysis in the file; the first of kind ``linearise`` if None. What follows stands over it.
        grid: parameter, state, motion or input -> ``START:STOP:N`` or ``A,B,C`` with units, or SI numbers.
        snapshots: interval, s or a text with a unit, at which the scenario's own run is linearised; changes of modes
            are added.
        every_mode: all combinations of modes that can occur.
        inputs: as of `linearise`, and the next three.
        outputs: signals.
        modes: that are held.
        at: the point otherwise.
        trim: an analysis of kind ``trim``: each member is at the equilibrium that has the values of the grid.

    Raises:
        FlexarmError: nothing or more than one of ``grid``, ``snapshots`` and ``every_mode`` is asked for, or as of
            `flexarm.design.families`.
    """
    from flexarm.design import families

    made = source if isinstance(source, Cut) else cut(source, "linearise", analysis, inputs=inputs, outputs=outputs)
    options = made.settings.options
    snapshots = _seconds(snapshots, "snapshots")
    if not (grid or snapshots or every_mode):
        grid, every_mode = options.get("grid"), bool(options.get("every_mode"))
        snapshots = (
            None if options.get("snapshots") is None else si(options["snapshots"], {"snapshots": "s"}, "snapshots")
        )
    asked = [name for name, given in (("grid", grid), ("snapshots", snapshots), ("modes", every_mode)) if given]
    if len(asked) != 1:
        what = f"{' and '.join(asked)} are asked for at once" if asked else "no family is asked for"
        raise FlexarmError(what, remedy="give one of --grid, --snapshots and --modes")
    if grid:
        return families.grid(made, grid, modes=modes, at=at, trim=trim)
    if snapshots:
        own = [name for name, given in (("modes", modes), ("at", at), ("trim", trim)) if given]
        if own:
            raise ParameterError(
                f"snapshots are at the points of the run, and '{own[0]}' asks for another",
                remedy="leave it out, or take a grid",
            )
        return families.snapshots(made, snapshots)
    return families.every_mode(made, modes=modes, at=at, trim=trim)


def describe(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    amplitudes: Sequence[float | str] | None = None,
    frequencies: Sequence[float | str] | str | None = None,
    harmonics: int | None = None,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Description:
    """What the nonlinear model answers to sines of several amplitudes: describing functions with their harmonics.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        analysis: name of an analysis in the file; the first of kind ``describe`` if None.
        amplitudes: of the sines, SI numbers or texts with a unit, in place of those of the analysis.
        frequencies: rad/s or texts with a unit, or one text such as ``START:STOP:N:log``, in place of those of the
            analysis.
        harmonics: highest that is given; that of the analysis, or 5, if None.
        inputs: the one input, in place of that of the analysis.
        outputs: signals in place of those of the analysis.
        progress: told the fraction done.

    Raises:
        FlexarmError: as of `flexarm.design.describing.describe`; neither the file nor the call says which sines.
    """
    from flexarm.design.describing import describe as run
    from flexarm.design.describing import frequencies_of

    made = source if isinstance(source, Cut) else cut(source, "describe", analysis, inputs=inputs, outputs=outputs)
    options = made.settings.options
    sizes = amplitudes if amplitudes is not None else options.get("amplitudes")
    over = frequencies if frequencies is not None else options.get("frequencies")
    if not sizes or over is None or len(over) == 0:
        raise FlexarmError(
            "nothing says which sines", remedy="give --amplitudes '0.5 V,2 V' and --frequencies '0.1 Hz:10 Hz:20:log'"
        )
    units = {v.name: v.unit for v in made.model.inputs}
    first = next(iter(units), "")
    return run(
        made,
        [si(size, units, first) for size in sizes],
        frequencies_of(over),
        harmonics=int(options.get("harmonics", 5)) if harmonics is None else harmonics,
        progress=progress,
    )


def uncertain(
    source: Source,
    analysis: str | None = None,
    *,
    recordings: Sequence[str | Path] = (),
    hold_out: Sequence[str | Path] = (),
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    trim: str | None = None,
    samples: int | None = None,
    seed: int | None = None,
    workers: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> UncertainModel:
    """A family of linear models from what recordings say of the parameters, and a bound on held-out responses.

    Args:
        source: a scenario with recordings, its file or shipped name.
        analysis: name of an analysis in the file; the first of kind ``uncertain`` if None.
        recordings: to fit to, in place of those of the analysis; all but those held out by default.
        hold_out: to judge on, beside those of that role.
        inputs: of the linear models, in place of those of the analysis.
        outputs: signals in place of those of the analysis.
        modes: as of `linearise`, and the next two.
        at: the point otherwise.
        trim: an analysis of kind ``trim``.
        samples: members of the family beside the fitted model; those of the analysis, or 50, if None.
        seed: of the fit and the draws; that of the analysis, or 0, if None.
        workers: threads; as many as cores if None.
        progress: told the fraction of the held-out simulations done.

    Raises:
        FlexarmError: no recordings, or as of `diagnosis.api.fit` and `flexarm.design.uncertainty.uncertain.uncertain`.
    """
    from diagnosis.api import fit
    from flexarm.design.uncertainty.uncertain import uncertain as run

    made = cut(source, "uncertain", analysis, inputs=inputs, outputs=outputs)
    options = made.settings.options
    chosen = options.get("seed", 0) if seed is None else seed
    found, _ = fit(
        made.scenario,
        recordings or options.get("recordings", ()),
        hold_out=hold_out or options.get("hold_out", ()),
        workers=workers,
        seed=chosen,
    )
    count = options.get("samples", 50) if samples is None else samples
    return run(made, found, samples=count, seed=chosen, modes=modes, at=at, trim=trim, progress=progress)


def discretise(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    trim: str | None = None,
) -> DiscreteModel:
    """The discrete-time linear model of a scenario with sampled blocks; arguments and errors as of `linearise`."""
    from engine.discretise import DiscreteModel

    given: dict[str, Any] = {"inputs": inputs, "outputs": outputs, "modes": modes, "at": at, "trim": trim}
    found = linearise(source, analysis, **given, discrete=True)
    assert isinstance(found, DiscreteModel)
    return found


class ExportKeywords(TypedDict, total=False):
    """The fields of `ExportOptions` as keyword arguments; why there are both: `engine.simulate.SimulationKeywords`."""

    inputs: Iterable[str] | None
    outputs: Iterable[str] | None
    platforms: Iterable[str] | None
    version: int
    linear_twin: bool
    beside: bool
    backend: str
    modes: Mapping[str, int | str] | None
    at: Mapping[str, Any] | None
    variable_step: float | None
    results: Iterable[str]
    arrays: bool


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """What an FMU holds.

    Attributes:
        inputs: signal inputs in place of those of the analysis.
        outputs: signals in place of those of the analysis.
        platforms: what to compile for, such as ``linux64`` and ``win64``; those of `fmu.export` if None.
        version: of FMI: 2 or 3.
        linear_twin: also run the linear model on the same inputs, as outputs ``NAME_lin``.
        beside: also write ``NAME_linear.mat`` and ``NAME_linear.m`` beside the FMU, if there is a linear model.
        backend: ``c``, or ``python`` for a model with Python functions: the FMU then needs Python where it runs.
        modes: modes of the linear model, over those of the analysis; see `linearise`.
        at: operating point of the linear model, over that of the analysis.
        variable_step: relative tolerance of a variable internal step in Co-Simulation; a fixed step if None.
        results: further signals that importers may record, as local variables: names, or patterns such as ``link.*``.
        arrays: numbered states and parameters of a block are one array variable each; FMI 3 alone.
    """

    inputs: Iterable[str] | None = None
    outputs: Iterable[str] | None = None
    platforms: Iterable[str] | None = None
    version: int = 2
    linear_twin: bool = False
    beside: bool = True
    backend: str = "c"
    modes: Mapping[str, int | str] | None = None
    at: Mapping[str, Any] | None = None
    variable_step: float | None = None
    results: Iterable[str] = ()
    arrays: bool = False


def export(
    source: Source | Cut,
    path: str | Path,
    analysis: str | None = None,
    options: ExportOptions | None = None,
    **given: Unpack[ExportKeywords],
) -> Path:
    """Write a scenario's model as an FMU, whose default experiment is that of the scenario.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        path: the file to write.
        analysis: name of an analysis in the file; the first of kind ``export`` if None.
        options: what the FMU holds.
        **given: fields of `ExportOptions` as keywords, over those of ``options``, such as ``version=3``.

    Returns:
        The path written.

    Raises:
        FlexarmError: a name that does not fit, or no compiler. Nothing is written then.
    """
    from fmu import export as write_fmu

    o = replace(options or ExportOptions(), **given)
    made = source if isinstance(source, Cut) else cut(source, "export", analysis, inputs=o.inputs, outputs=o.outputs)
    if o.backend not in ("c", "python"):
        raise ParameterError(f"there is no backend '{o.backend}'", remedy="allowed: c, python")
    if o.arrays and o.version != 3:
        raise ParameterError("FMI 2 has no arrays", Where("--arrays"), "add --fmi 3, or leave it out")
    settings: dict[str, Any] = {}
    if made.simulation is not None:
        settings |= {"step": made.simulation.step, "stop": made.simulation.stop}
    if o.platforms is not None:
        settings["platforms"] = tuple(o.platforms)
    if o.backend == "python":
        further = o.variable_step is not None or tuple(o.results) or o.arrays
        if o.version != 2 or o.linear_twin or further:
            raise ParameterError(
                "the python backend writes FMI 2 with outputs alone, a fixed step and no linear twin",
                remedy="leave out --fmi, --linear-twin, --variable-step, --results and --arrays",
            )
        from flexarm.recipe import LOADER, recipe
        from fmu.python_backend import export_python

        return export_python(made.model, path, LOADER, *recipe(made), **settings)
    settings["magnitudes"] = magnitudes(made)
    model = made.model
    if o.beside or o.linear_twin:
        settings |= _linear_settings(made, o.modes, o.at)
    beside = o.beside and "linear" in settings
    if o.variable_step is not None:
        settings["variable_step"] = o.variable_step
    if o.arrays:
        settings["arrays"] = True
    if found := results(made, tuple(o.results)):
        settings["results"] = found
        model = made.scenario.build(made.settings.inputs, [*(output.name for output in model.outputs), *found])
    return write_fmu(model, path, version=o.version, linear_twin=o.linear_twin, beside=beside, **settings)


def results(made: Cut, wanted: Iterable[str]) -> tuple[str, ...]:
    """The signals that are meant by names and patterns, without those that an FMU has anyway.

    Raises:
        ParameterError: a name or pattern that fits no signal.
    """
    from engine.assemble import build

    asked = [made.scenario.resolve(name) for name in wanted]
    if not asked:
        return ()
    known = [output.name for output in build(made.scenario.system, list(made.settings.inputs)).outputs]
    there = {entry.name for entry in (*made.model.outputs, *made.model.states, *made.model.memories)}
    found: dict[str, None] = {}
    for name in asked:
        fitting = [signal for signal in known if fnmatch.fnmatchcase(signal, name)]
        if not fitting:
            raise ParameterError(f"no signal is called '{name}'", Where("--results"), nearest(name, known))
        found |= dict.fromkeys(signal for signal in fitting if signal not in there)
    return tuple(found)


def magnitudes(made: Cut) -> dict[str, float]:
    """How large the states get in the scenario's own run, by its own sources; SI units."""
    from fmu.nominal import magnitudes as largest
    from fmu.twists import twists

    found = made.simulation
    stop, step = (found.stop, found.step) if found is not None else (10.0, 1e-3)
    try:
        own = largest(made.scenario.build(), stop, step)
    except FlexarmError:  # inputs that are free in the scenario itself
        own = {}
    names = [state.name for state in made.model.states] + [twist.name for twist in twists(made.model)]
    return own if all(own.get(name) for name in names) else largest(made.model, stop, step) | own


def _linear_settings(made: Cut, modes: Mapping[str, int | str] | None, at: Mapping[str, Any] | None) -> dict[str, Any]:
    """The linear models that travel with an FMU: those of the modes and point of its analysis, if there are any."""
    from engine.discretise import discretise as discrete
    from engine.linear_modes import hearing
    from engine.linearise import linearise as linear

    model = made.model
    if not (model.states and model.inputs and model.outputs) or model.externals:
        return {}
    where = point(made, modes, at)
    at_point = linear(model, **where)
    found: dict[str, Any] = {"linear": at_point, "others": hearing(model, at_point, **where)}
    return found | ({"discrete": discrete(model, **where)} if model.clocks else {})


def compare(
    source: Source,
    recording: Recording | FrequencyTable | str | Path,
    *,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Hold a scenario against a recording; see `diagnosis.compare.compare`."""
    from diagnosis.compare import compare as run

    return run(as_scenario(source), recording, progress=progress)


__all__ = ["compare", "describe", "discretise", "export", "linear_family", "linearise", "simulate", "trim", "uncertain"]
