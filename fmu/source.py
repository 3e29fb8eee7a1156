"""The C of an FMU: one translation unit of generated model, integrator, common core and FMI head, with the headers."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterable
from pathlib import Path

import casadi as ca

from engine.codegen import model_code, runtime
from engine.errors import FlexarmError
from engine.model import Model
from engine.step import STEP_PER_RATE
from fmu.plan import Plan
from fmu.start import start_expression
from fmu.variables import INPUT, PARAMETER, STATE

_HEADS = Path(__file__).parent / "heads"
_PARTS = {
    2: ("common.c", "calls.c", "fmi2.c", "fmi2_cosimulation.c", "fmi2_exchange.c"),
    3: ("common.c", "calls.c", "fmi3.c", "fmi3_refused.c"),
}
_HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_GUID = "{00000000-0000-0000-0000-000000000000}"
_HASH = "0x0000000000000000"


def headers(version: int) -> dict[str, str]:
    """The official FMI headers by name, from the installed fmpy.

    Raises:
        FlexarmError: fmpy has none.
    """
    import fmpy

    folder = Path(fmpy.__file__).parent / "c-code"
    try:
        return {name: (folder / name).read_text(encoding="utf-8") for name in _HEADERS[version]}
    except OSError as error:
        raise FlexarmError(
            f"the FMI headers are not in {folder}", remedy="install fmpy again: pip install --force-reinstall fmpy"
        ) from error


def _literal(value: float) -> str:
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return repr(float(value))


def _string(value: str) -> str:
    plain = "".join(c if 32 <= ord(c) < 127 else "?" for c in value)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _array(ctype: str, name: str, values: Iterable[str]) -> str:
    return f"static const {ctype} {name}[] = {{{', '.join(values) or '0'}}};"


def _tables(plan: Plan) -> str:
    """Constants of the export for `heads/common.c`."""
    model = plan.model
    declared = [parameter.declared for parameter in model.parameters]
    tunable = [variable.tunable for variable in plan.variables if variable.kind == PARAMETER]
    kinds = [
        int(d.gt is not None) + 2 * int(d.lt is not None) + 4 * int(t) for d, t in zip(declared, tunable, strict=True)
    ]
    states = [variable for variable in plan.variables if variable.kind == STATE]
    lines = [
        f"#define FA_GUID {_string(_GUID)}",
        f"#define FA_MODEL_HASH UINT64_C({_HASH})",
        f"#define FA_RESOLUTION {_literal(float(plan.tick))}",
        f"#define FA_STEP {_literal(plan.step)}",
        f"#define FA_STEP_TICKS INT64_C({plan.ticks(plan.step)})",
        f"#define FA_HMAX {_literal(plan.hmax)}",
        f"#define FA_RATE {_literal(plan.rate)}",
        f"#define FA_FOLLOWING {_literal(min(plan.following, 1e300))}",
        f"#define FA_STEP_PER_RATE {_literal(STEP_PER_RATE)}",
        _array("int64_t", "fa_clock_period", [str(plan.ticks(clock.period)) for clock in model.clocks]),
        _array("int64_t", "fa_clock_offset", [str(plan.ticks(clock.offset)) for clock in model.clocks]),
        _array("unsigned char", "fa_u_coupled", [str(int(v.name in plan.coupling.inputs)) for v in model.inputs]),
        _array("double", "fa_u_start", [_literal(v.start or 0.0) for v in plan.variables if v.kind == INPUT]),
        _array("double", "fa_u_typical", [_literal(v) for v in plan.typical[: len(model.inputs)]]),
        _array("double", "fa_p_default", [_literal(v) for v in model.parameter_values]),
        _array("double", "fa_p_min", [_literal(d.bounds[0]) for d in declared]),
        _array("double", "fa_p_max", [_literal(d.bounds[1]) for d in declared]),
        _array("unsigned char", "fa_p_kind", [str(kind) for kind in kinds]),
        _array("double", "fa_x_default", [_literal(v) for v in plan.start]),
        _array("double", "fa_d_default", [_literal(v) for v in plan.memory]),
        _array("unsigned char", "fa_x_exact", [str(int(exact)) for exact in plan.structure.exact]),
        *_twist_tables(plan),
        f"#define FA_RELATIONS {len(model.relations)}",
        _array("int", "fa_relation_first", [str(first) for first, _, _ in model.relations]),
        _array("int", "fa_relation_second", [str(second) for _, _, second in model.relations]),
        _array("int", "fa_relation_meaning", [str(relation.meaning) for _, relation, _ in model.relations]),
        _array("char *const", "fa_relation_words", [_string(relation.words) for _, relation, _ in model.relations]),
        _array("double", "fa_x_nominal", [_literal(v.nominal or 1.0) for v in states]),
        *_array_tables(plan),
        _array("char *const", "fa_name", [_string(variable.name) for variable in plan.variables]),
        _array("char *const", "fa_mode_name", [_string(mode.name) for mode in model.modes]),
        _array("char *const", "fa_mode_label", [_string(label) for mode in model.modes for label in mode.labels]),
    ]
    return "\n".join(lines) + "\n\n"


def _features(plan: Plan) -> str:
    """What the integrator of an FMU can that the runner's does not."""
    if plan.variable_step is None:
        return "#define FA_PAUSABLE\n"
    return f"#define FA_PAUSABLE\n#define FA_ADAPTIVE\n#define FA_TOLERANCE {_literal(plan.variable_step)}\n"


def _twist_tables(plan: Plan) -> list[str]:
    twists = plan.twists
    place = {twist.coordinate: r for r, twist in enumerate(twists)}
    firsts = itertools.accumulate((len(twist.terms) for twist in twists), initial=0)
    return [
        f"#define FA_NR {len(twists)}",
        _array("int", "fa_state_twist", [str(place.get(k, -1)) for k in range(len(plan.model.states))]),
        _array("int", "fa_twist_coordinate", [str(twist.coordinate) for twist in twists]),
        _array("int", "fa_twist_first", [str(first) for first in firsts]),
        _array("int", "fa_twist_other", [str(k) for twist in twists for k in twist.terms]),
        _array("double", "fa_twist_share", [_literal(c) for twist in twists for c in twist.terms.values()]),
    ]


def _array_tables(plan: Plan) -> list[str]:
    """How many elements each reference stands for: 0 of elements that are not the first of their array."""
    if not plan.arrays:
        return []
    sizes = [1] * len(plan.variables)
    for array in plan.arrays:
        sizes[array.first : array.first + array.size] = [array.size] + [0] * (array.size - 1)
    return ["#define FA_ARRAYS", _array("int", "fa_elements", [str(size) for size in sizes])]


def model_source(model: Model) -> str:
    """The model's C: its equations, tangents and start.

    Raises:
        FlexarmError: an operation has no C form.
    """
    e = model.equations
    dt = ca.SX.sym("dt")
    dx, du = ca.SX.sym("dx", e.x.numel()), ca.SX.sym("du", e.u.numel())
    seed = ca.densify(ca.vertcat(dt, dx, du))
    along = ca.jtimes(ca.vertcat(e.derivative, e.outputs, e.guards), ca.vertcat(e.t, e.x, e.u), seed)
    extra = [
        ("tangent", [*e.arguments, seed], along),
        ("initial_state", [*e.arguments, e.fire], start_expression(model)),
        ("initial_memory", [*e.arguments, e.fire], e.memory_start),
    ]
    try:
        return model_code(model, extra)
    except NotImplementedError as error:
        raise FlexarmError(
            f"the model cannot be written in C: {error}",
            remedy="replace the block that has no C form, or export with the python backend: --backend python",
        ) from error


def source(plan: Plan, description: str, version: int = 2) -> tuple[dict[str, str], str]:
    """The source files of an FMU.

    Args:
        plan: what is exported.
        description: the FMU's XML with ``guid`` left as `placeholder`, which counts for the identity.
        version: of FMI.

    Returns:
        (files by name, ``all.c`` first; the GUID, derived from the content).
    """
    head = "/* Generated by flexarm: model, integrator and FMI functions in one translation unit. */\n"
    head += "".join(f"#include <{name}.h>\n" for name in ("math", "stddef", "stdint", "stdio", "stdlib", "string"))
    parts = [head, model_source(plan.model), _tables(plan), _features(plan), runtime("core.c")]
    parts += [(_HEADS / name).read_text(encoding="utf-8") for name in _PARTS[version]]
    text = "\n".join(parts)
    digest = hashlib.sha256((text + "\0" + description).encode()).hexdigest()
    guid = "{" + "-".join(digest[a:b] for a, b in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32))) + "}"
    text = text.replace(_GUID, guid).replace(_HASH, "0x" + digest[:16])
    return {"all.c": text, **headers(version)}, guid


placeholder = _GUID
"""The GUID of a description before its content is known."""
