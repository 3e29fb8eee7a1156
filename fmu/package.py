"""Write the FMU archive: description, binaries, sources and documentation. The same model gives the same bytes."""

from __future__ import annotations

import logging
import os
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, TypedDict, Unpack

import casadi as ca

from engine.discretise import DiscreteModel, discretise
from engine.errors import FlexarmError
from engine.linear_files import as_mat, script
from engine.linear_modes import hearing
from engine.linearise import LinearModel, linearise
from engine.model import Model
from engine.names import identifier
from fmu.build import DEFAULT, PLATFORMS, check, library
from fmu.coupling import Coupling
from fmu.describe import build_description, fmi2, fmi3
from fmu.documentation import page
from fmu.icon import files as icon_files
from fmu.linear import family_file, linear_files, warning, with_twin
from fmu.nominal import magnitudes as largest
from fmu.plan import Plan
from fmu.plan import plan as make_plan
from fmu.source import placeholder, source

log = logging.getLogger("flexarm.export")


class PackageKeywords(TypedDict, total=False):
    """The fields of `PackageOptions` as keywords; why there are both: `engine.simulate.SimulationKeywords`."""

    platforms: Sequence[str]
    step: float
    stop: float
    version: int
    linear: LinearModel | None
    discrete: DiscreteModel | None
    others: Sequence[LinearModel] | None
    linear_twin: bool
    beside: bool
    magnitudes: Mapping[str, float] | None
    coupling: Coupling | None
    variable_step: float | None
    results: Sequence[str]
    arrays: bool


@dataclass(frozen=True, kw_only=True)
class PackageOptions:
    """What an FMU holds.

    Attributes:
        platforms: of ``linux64``, ``win64``, ``darwin64``, ``darwin-aarch64`` (Apple Silicon) and ``aarch64`` (Linux).
        step: cell of the internal grid (s), and the communication step that is suggested.
        stop: end of the default experiment (s).
        version: of FMI: 2 or 3.
        linear: the linear model to send along as ``resources/linear.json`` and ``.mat``; that at the start if None.
        discrete: its discrete-time model; that at the start if neither is given and the model has clocks.
        others: linear models of further modes, where inputs move no output in ``linear``; see `fmu.linear.family`.
        linear_twin: also run the linear model on the same inputs, as outputs ``NAME_lin``.
        beside: also write ``NAME_linear.mat`` and ``NAME_linear.m`` beside the FMU; see `linear_beside`.
        magnitudes: state name -> its largest magnitude in use, from which its nominal value comes; from a run of the
            model if None.
        coupling: what is known of inputs at cuts, of an FMU that is a part of a whole.
        variable_step: integrate with a variable step inside Co-Simulation, to this relative tolerance or the
            importer's; the result then no longer equals that of `engine.simulate` to the last bit. Fixed if None.
        results: names of the model's last outputs that are local variables of the FMU, under their own names, for
            importers that record them.
        arrays: numbered states and parameters of a block are one array variable each; see `fmu.arrays`. FMI 3 alone.
    """

    platforms: Sequence[str] = DEFAULT
    step: float = 1e-3
    stop: float = 10.0
    version: int = 2
    linear: LinearModel | None = None
    discrete: DiscreteModel | None = None
    others: Sequence[LinearModel] | None = None
    linear_twin: bool = False
    beside: bool = False
    magnitudes: Mapping[str, float] | None = None
    coupling: Coupling | None = None
    variable_step: float | None = None
    results: Sequence[str] = ()
    arrays: bool = False


def export(
    model: Model, path: str | Path, options: PackageOptions | None = None, **given: Unpack[PackageKeywords]
) -> Path:
    """Write a model as an FMI Co-Simulation FMU of compiled C.

    The FMU integrates on an internal grid of ``step``, aligned at the start time, with the same C as `engine.simulate`
    and the same internal step, chosen for the parameters at the start of a run and kept when parameters are tuned.

    Args:
        model: the model; its inputs and outputs become those of the FMU, its parameters can be tuned.
        path: the file to write.
        options: what the FMU holds.
        **given: fields of `PackageOptions` as keywords, over those of ``options``, such as ``version=3``.

    Returns:
        The path written.

    Raises:
        FlexarmError: a name, platform or step that does not fit, a model without C, or a file that cannot be written.
        CompilerUnavailable: no compiler runs, or it fails. Nothing is written then.
    """
    o = replace(options or PackageOptions(), **given)
    linear, discrete, others = o.linear, o.discrete, o.others
    if o.version not in (2, 3):
        raise FlexarmError(f"FMI {o.version} is not supported", remedy="allowed: 2, 3")
    if o.arrays and o.version != 3:
        raise FlexarmError("FMI 2 has no arrays", remedy="export FMI 3, or leave out the arrays")
    chosen = check(o.platforms)
    target = Path(path)
    check_target(target)
    plain = without_results(model, o.results)
    if linear is None:
        linear, discrete = _linear(plain)
        if linear is not None and others is None and o.coupling is None:
            others = hearing(plain, linear)
    if o.coupling is None and linear is not None and (said := warning(linear, others or ())):
        log.warning("%s", said)
    if linear is None and (o.linear_twin or o.beside):
        raise FlexarmError("the model has no linear model at its start", remedy="give one, made by engine.linearise")
    travelling = with_twin(plain, linear) if linear is not None and o.linear_twin else plain
    travelling = with_results(travelling, model, o.results)
    files: dict[Path, Callable[[IO[bytes]], object]] = {}
    sizes = largest(model, o.stop, o.step) if o.magnitudes is None else o.magnitudes
    made = make_plan(
        travelling,
        o.step,
        o.stop,
        sizes,
        o.coupling,
        variable_step=o.variable_step,
        results=o.results,
        arrays=o.arrays,
    )
    inside = contents(made, chosen, linear, o.version, discrete, others or ())
    files[target] = lambda handle: _zip(handle, inside)
    if linear is not None and o.beside:
        mat, text = as_mat(linear, discrete), script(linear, target.stem, discrete).encode()
        matrices, script_name = linear_beside(target.stem)
        files[target.with_name(matrices)] = lambda handle: handle.write(mat)
        files[target.with_name(script_name)] = lambda handle: handle.write(text)
        if others:
            rest = family_file(linear, others)
            files[target.with_name(f"{target.stem}_linear_family.json")] = lambda handle: handle.write(rest)
    write_files(files)
    log.info("wrote %s for %s", target, ", ".join(chosen))
    return target


def linear_beside(stem: str) -> tuple[str, str]:
    """Names of the files that hold the linear model beside an FMU; MATLAB runs no script of any other name."""
    return f"{stem}_linear.mat", f"{identifier(stem)}_linear.m"


def without_results(model: Model, results: Sequence[str]) -> Model:
    """A model without the outputs that an FMU shows as local variables.

    Raises:
        FlexarmError: they are not the model's last outputs.
    """
    n = len(model.outputs) - len(results)
    if n < 0 or [output.name for output in model.outputs[n:]] != list(results):
        raise FlexarmError("the results are not the last outputs of the model", remedy="build it with them at the end")
    if not results:
        return model
    equations = replace(model.equations, outputs=model.equations.outputs[:n])
    return replace(model, outputs=model.outputs[:n], equations=equations)


def with_results(model: Model, source: Model, results: Sequence[str]) -> Model:
    """A model with the outputs of its source that an FMU shows as local variables behind its own."""
    if not results:
        return model
    n = len(source.outputs) - len(results)
    outputs = ca.densify(ca.vertcat(model.equations.outputs, source.equations.outputs[n:]))
    equations = replace(model.equations, outputs=outputs)
    return replace(model, outputs=(*model.outputs, *source.outputs[n:]), equations=equations)


def _linear(model: Model) -> tuple[LinearModel | None, DiscreteModel | None]:
    """The linear models at the start, or None with a message where there is none."""
    if not (model.states and model.inputs and model.outputs) or model.externals:
        return None, None
    try:
        linear = linearise(model)
    except FlexarmError as error:
        log.warning("the FMU goes without its linear model: %s", error.message)
        return None, None
    for mode, labels in linear.ambiguous.items():
        log.warning("the start lies between the modes %s of '%s'; linearised: %s", labels, mode, linear.modes[mode])
    try:
        return linear, discretise(model) if model.clocks else None
    except FlexarmError as error:
        log.warning("the FMU goes without its discrete-time linear model: %s", error.message)
        return linear, None


def contents(
    plan: Plan,
    platforms: Sequence[str],
    linear: LinearModel | None = None,
    version: int = 2,
    discrete: DiscreteModel | None = None,
    others: Sequence[LinearModel] = (),
) -> dict[str, bytes]:
    """Every file of the archive by name."""
    described = fmi2 if version == 2 else fmi3
    files, guid = source(plan, described(plan, placeholder), version)
    made = {"modelDescription.xml": described(plan, guid).encode()}
    for name in platforms:
        entry = PLATFORMS[name]
        folder = entry.folder if version == 2 else entry.folder3
        made[f"binaries/{folder}/{plan.identifier}{entry.suffix}"] = library(files, name)
    made |= {f"sources/{name}": text.encode() for name, text in files.items()}
    if version == 3:
        made["sources/buildDescription.xml"] = build_description(plan).encode()
    if linear is not None:
        made |= linear_files(linear, discrete, others)
    made |= icon_files(plan, version)
    made["documentation/index.html"] = page(plan, platforms, version).encode()
    return made


def check_target(path: Path) -> None:
    """Refuse a target that cannot be written, before any computation."""
    if path.is_dir():
        raise FlexarmError(f"'{path}' is a folder", remedy="give a file name")
    if not path.parent.is_dir():
        raise FlexarmError(f"there is no folder '{path.parent}'", remedy="make it first, or write somewhere else")
    if not os.access(path.parent, os.W_OK):
        raise FlexarmError(f"the folder '{path.parent}' cannot be written to", remedy="write somewhere else")


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a zip archive with fixed time stamps.

    Raises:
        FlexarmError: it cannot be written; an older file is left as it was.
    """
    write_files({path: lambda handle: _zip(handle, files)})


def _zip(handle: IO[bytes], files: Mapping[str, bytes]) -> None:
    with zipfile.ZipFile(handle, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = 0o100644 << 16
            archive.writestr(entry, content)


def write_files(writers: Mapping[Path, Callable[[IO[bytes]], object]]) -> None:
    """Write several files together: write each under a temporary name, then rename all.

    Raises:
        FlexarmError: one cannot be written; older files are left as they were.
    """
    made: dict[Path, Path] = {}
    path = Path()
    try:
        for path, write in writers.items():
            if path.is_dir():
                raise FlexarmError(f"'{path}' is a folder", remedy="remove it, or write somewhere else")
            with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.stem}-", delete=False) as handle:
                made[path] = Path(handle.name)
                write(handle)
        mask = os.umask(0)
        os.umask(mask)
        for path, temporary in made.items():
            temporary.chmod(0o666 & ~mask)
            temporary.replace(path)
    except OSError as error:
        raise FlexarmError(f"cannot write '{path}': {error.strerror}", remedy="write somewhere else") from error
    finally:
        for temporary in made.values():
            temporary.unlink(missing_ok=True)
