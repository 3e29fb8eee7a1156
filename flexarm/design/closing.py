"""A controller put back into a scenario as a block, continuous or sampled, with the delay of its computation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import FlexarmError, ParameterError, Where, nearest
from flexarm.cut import Source, as_scenario
from scenarios.amend import Edit, Feed, Wire, amended, relocated, with_overrides
from scenarios.load import Scenario, load

Matrix = NDArray[np.float64]

METHODS = ("tustin", "zoh", "foh", "impulse", "matched", "euler")


def matrices(controller: Any, period: float = 0.0) -> tuple[Matrix, Matrix, Matrix, Matrix, float]:
    """A, B, C, D and the sample period (0: continuous) of a python-control system, a linear model or a file.

    Args:
        controller: one of these.
        period: that of a sampled controller that does not say its own (dt is True, or -1 as in MATLAB).

    Raises:
        FlexarmError: a file that holds no such matrices, or a sampled controller that says no period.
    """
    if isinstance(controller, str | Path):
        from blocks.controllers.matrices import collect, system

        found = collect({}, str(controller), ("A", "B", "C", "D", "dt"))
        if "D" not in found and not {"A", "B", "C"} <= found.keys():
            raise ParameterError(f"'{controller}' holds no controller", remedy="write A, B, C and D, or D alone")
        try:
            A, B, C, D = system(found)
        except ParameterError as error:
            raise error.at(Where(str(controller))) from None
        return A, B, C, D, _own(float(found["dt"].ravel()[0]) if "dt" in found else 0.0, period, str(controller))
    import control

    plain = controller if hasattr(controller, "A") else control.ss(controller)
    A, B, C, D = (np.atleast_2d(np.asarray(getattr(plain, key), dtype=float)) for key in "ABCD")
    own = getattr(plain, "dt", None)
    n = A.shape[0] if A.size else 0
    B, C = B.reshape(n, D.shape[1]), C.reshape(D.shape[0], n)
    return A.reshape(n, n), B, C, D, _own(-1.0 if own is True else float(own or 0.0), period)


def _own(dt: float, period: float, file: str = "") -> float:
    """The sample period that a controller states, 0 if it is continuous; ``period`` where it says only that it is not.

    Raises:
        ParameterError: it says no period, and none is given; or one that cannot be.
    """
    place = Where(file) if file else None
    if dt == -1.0 and not period:
        remedy = "give the period, such as --period '1 ms', or dt in seconds"
        raise ParameterError("the controller is sampled, and does not say how often", place, remedy)
    if dt != -1.0 and not (math.isfinite(dt) and dt >= 0):
        raise ParameterError(f"a sample period of {dt:g} s cannot be", place, "dt is in seconds, 0 if continuous")
    return period if dt == -1.0 else dt


def sampled(controller: Any, period: float, method: str = "tustin", delay: int = 0) -> Any:
    """A controller in discrete time, with a computation of so many whole periods.

    Args:
        controller: see `matrices`.
        period: sample period (s).
        method: of python-control's ``sample_system``.
        delay: periods between a sample and the output that follows from it.

    Raises:
        ParameterError: a period or delay that cannot be, an unknown method, or a controller of another period.
    """
    import control

    if not (math.isfinite(period) and period > 0):
        raise ParameterError(f"a sample period of {period:g} s cannot be", remedy="give a time above zero")
    if method not in METHODS:
        raise ParameterError(f"there is no method '{method}'", remedy=nearest(method, METHODS))
    if delay < 0:
        raise ParameterError(f"a delay of {delay} periods cannot be", remedy="give 0 or more")
    A, B, C, D, own = matrices(controller, period)
    if own and not math.isclose(own, period, rel_tol=1e-9):
        raise ParameterError(f"the controller is sampled every {own:g} s, not {period:g} s")
    made = control.ss(A, B, C, D, period) if own else _discrete(control.ss(A, B, C, D), period, method)
    for _ in range(delay):
        n, (p, m) = made.nstates, made.D.shape
        A = np.block([[made.A, np.zeros((n, p))], [made.C, np.zeros((p, p))]])
        made = control.ss(
            A, np.vstack([made.B, made.D]), np.hstack([np.zeros((p, n)), np.eye(p)]), np.zeros((p, m)), period
        )
    return made


def _discrete(system: Any, period: float, method: str) -> Any:
    """A continuous system sampled by a method.

    Raises:
        ParameterError: the method cannot sample this system.
    """
    import control

    remedy = "take --method tustin, or zoh"
    if method == "matched":
        if not system.issiso():
            raise ParameterError("'matched' samples a controller of one measured signal alone", remedy=remedy)
        system = control.ss2tf(system)
    try:
        with np.errstate(all="ignore"):
            made = control.ss(control.sample_system(system, period, method))
    except (ValueError, ZeroDivisionError, np.linalg.LinAlgError) as error:
        raise ParameterError(f"'{method}' cannot sample this controller: {error}", remedy=remedy) from None
    if not all(np.isfinite(m).all() for m in (made.A, made.B, made.C, made.D)):
        what = "it matches the gain at rest, and this one integrates" if method == "matched" else "it gives no numbers"
        raise ParameterError(f"'{method}' cannot sample this controller: {what}", remedy=remedy)
    return made


def closed(
    source: Source,
    controller: Any,
    *,
    feed: str,
    measure: Sequence[str],
    reference: str | None = None,
    period: float = 0.0,
    method: str = "tustin",
    delay: int = 0,
    name: str = "controller",
) -> str:
    """The scenario's text with a controller u = K (r - y) in place of what fed an input.

    Args:
        source: a scenario, its file or shipped name.
        controller: a python-control system, a linear model, or a .json or .mat file with A, B, C and D; as many inputs
            as measured signals, one output.
        feed: the input that it drives.
        measure: the signals y.
        reference: the signal r, compared with the first of y; zero if None.
        period: sample period (s); that of the controller if 0, which is then continuous if it states none.
        method: how it is sampled; see `sampled`.
        delay: of the computation, in whole periods.
        name: of the new block.

    Raises:
        FlexarmError: a name that does not fit, a controller of other size.
    """
    scenario = as_scenario(source)
    known = scenario.system.inputs()
    end = scenario.resolve(feed)
    if end not in known:
        raise FlexarmError(f"'{feed}' is not an input", remedy=nearest(feed, known))
    period = period or matrices(controller)[4]
    if delay and not period:
        raise ParameterError(
            "a delay of whole periods needs a sample period", remedy="give one, such as --period '1 ms'"
        )
    A, B, C, D, own = matrices(sampled(controller, period, method, delay) if period else controller)
    if D.shape != (1, len(measure)):
        raise FlexarmError(
            f"the controller has {D.shape[1]} inputs and {D.shape[0]} outputs, for {len(measure)} measured signals and "
            f"'{feed}' alone",
            remedy="name as many signals as it has inputs, in their order (--measure)",
        )
    first = np.eye(len(measure))[:, :1] if reference else np.zeros((len(measure), 0))
    B, D = (np.hstack([-M, M @ first]) for M in (B, D))
    settings: dict[str, Any] = {key: M.tolist() for key, M in zip("ABCD", (A, B, C, D), strict=True) if M.size}
    if own:
        settings["period"] = f"{own!r} s"
    block, port = scenario.system.split(end)
    unit = scenario.system.blocks[block].ports[port].unit
    if unit not in ("*", ""):
        settings["unit"] = unit
    ends = [*measure, *([reference] if reference else [])]
    ports = [f"{name}.in"] if len(ends) == 1 else [f"{name}.in{k + 1}" for k in range(len(ends))]
    edits: list[Edit] = [
        Feed(name, "DiscreteStateSpace" if own else "StateSpace", end, settings),
        *(Wire(name, (signal, port)) for signal, port in zip(ends, ports, strict=True)),
    ]
    text = with_overrides(scenario.path.read_text(encoding="utf-8"), scenario.overrides)
    return amended(text, edits, {}, scenario.resolve)


def close(source: Source, controller: Any, path: str | Path, **settings: Any) -> Scenario:
    """Write the scenario with a controller; see `closed`. It is read and assembled before it is written.

    Returns:
        The new scenario.

    Raises:
        FlexarmError: as of `closed`, or the scenario with the controller cannot be assembled.
    """
    from engine.files import writing

    scenario, path = as_scenario(source), Path(path)
    made = closed(scenario, controller, **settings)
    load(scenario.path, text=made).build()
    with writing(path, (".yaml", ".yml")) as temporary:
        temporary.write_text(relocated(made, scenario.path.parent, path.parent), encoding="utf-8")
    return load(path)
