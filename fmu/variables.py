"""The variables of an FMU: names that importers accept, value references, units, bounds and start values.

Inputs and outputs have flat names (``link.hub.angle`` is ``link_hub_angle``), because importers turn dots into buses.
Parameters, states, memories and modes keep their path. References count in the order of the C enumeration in
``heads/common.c``: time, parameters, inputs, outputs, states, derivatives, memories, modes, event indicators,
coordinates in whose place states are twists, and clocks, which FMI 2 does not have.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from engine.errors import FlexarmError
from engine.model import TIME, Model
from engine.quantity import Parameter
from fmu.twists import Twist

TIME_KIND, PARAMETER, INPUT, OUTPUT, STATE, DERIVATIVE, MEMORY, MODE, INDICATOR, COORDINATE, CLOCK, RESULT = (
    "time",
    "parameter",
    "input",
    "output",
    "state",
    "derivative",
    "memory",
    "mode",
    "indicator",
    "coordinate",
    "clock",
    "result",
)
_PART = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\[\d+(,\d+)*\])?")


@dataclass(frozen=True)
class FmuVariable:
    """One variable of the FMU.

    Attributes:
        name: unique in the FMU.
        source: the model's name for it.
        kind: ``time``, ``parameter``, ``input``, ``output``, ``state``, ``derivative``, ``memory``, ``mode``,
            ``indicator``, ``coordinate``, which is one of the model that a twist stands for, ``clock``,
            or ``result``, an output that is shown as a local variable.
        reference: value reference; also the position in the list.
        unit: coherent SI unit, empty if unknown.
        doc: one sentence.
        start: starting value, for parameters, inputs, and states and coordinates whose start an importer may set.
        nominal: typical magnitude, for parameters and states.
        minimum, maximum: closed bounds, infinite where none is declared; a bound that is itself excluded is moved
            inwards by one number.
        tunable: whether a parameter may change during a run.
    """

    name: str
    source: str
    kind: str
    reference: int
    unit: str = ""
    doc: str = ""
    start: float | None = None
    nominal: float | None = None
    minimum: float = -math.inf
    maximum: float = math.inf
    tunable: bool = True

    @property
    def is_real(self) -> bool:
        """Modes are whole numbers and clocks tick, everything else is real."""
        return self.kind not in (MODE, CLOCK)


def flat(name: str) -> str:
    """A name without dots and brackets: ``link.hub.angle`` gives ``link_hub_angle``."""
    return re.sub(r"\W+", "_", name).strip("_") or "_"


def structured(name: str) -> str:
    """A name by the structured convention of FMI: parts that are not identifiers are quoted."""
    parts = (part if _PART.fullmatch(part) else _quoted(part) for part in name.split("."))
    return ".".join(parts)


def _quoted(part: str) -> str:
    plain = "".join(c if 32 <= ord(c) < 127 else "_" for c in part)
    return "'" + plain.replace("\\", "\\\\").replace("'", "\\'").replace('"', '\\"') + "'"


def _used_parameters(model: Model) -> set[int]:
    """Parameters that act during a run, not only on its start."""
    e = model.equations
    running = ca.vertcat(e.derivative, e.guards, e.outputs, e.update, e.following)
    if not running.numel() or not e.p.numel():
        return set()
    pattern = ca.jacobian_sparsity(running, e.p)
    return set(pattern.get_triplet()[1])


def closed(declared: Parameter) -> tuple[float, float]:
    """The least and the greatest value that a parameter may have."""
    low, high = declared.bounds
    if declared.gt is not None:
        low = sys.float_info.min if low == 0 else math.nextafter(low, math.inf)
    if declared.lt is not None:
        high = -sys.float_info.min if high == 0 else math.nextafter(high, -math.inf)
    return low, high


def variables(
    model: Model,
    starts: Mapping[str, float],
    nominals: Mapping[str, float],
    inputs: Mapping[str, float],
    twists: Sequence[Twist] = (),
    results: Collection[str] = (),
) -> list[FmuVariable]:
    """All variables of the FMU in the order of their references.

    Args:
        model: the model.
        starts: state name -> value at the start, of the states whose start an importer may set.
        nominals: state name -> typical magnitude; of twists by their name.
        inputs: input name -> start value, of inputs that do not start at zero.
        twists: shown in place of states.
        results: names of outputs that are local variables.

    Raises:
        FlexarmError: two of them would have one name.
    """
    made = [
        FmuVariable(reference=reference, **fields)  # type: ignore[arg-type]
        for reference, fields in enumerate(_fields(model, starts, nominals, inputs, twists, results))
    ]
    taken: dict[str, FmuVariable] = {}
    for variable in made:
        other = taken.setdefault(variable.name, variable)
        if other is not variable:
            raise FlexarmError(
                f"{other.kind} '{other.source}' and {variable.kind} '{variable.source}' "
                f"would both be called '{variable.name}' in the FMU",
                remedy="rename a block, or leave one of them out of the inputs and outputs",
            )
    return made


def _fields(
    model: Model,
    starts: Mapping[str, float],
    nominals: Mapping[str, float],
    inputs: Mapping[str, float],
    twists: Sequence[Twist],
    results: Collection[str],
) -> Iterator[dict[str, object]]:
    yield {"name": "time", "source": "time", "kind": TIME_KIND, "unit": "s", "doc": "simulation time"}
    used = _used_parameters(model)
    for i, parameter in enumerate(model.parameters):
        low, high = closed(parameter.declared)
        usual = abs(parameter.value)
        yield {
            "name": structured(parameter.name),
            "source": parameter.name,
            "kind": PARAMETER,
            "unit": parameter.unit,
            "doc": parameter.declared.doc,
            "start": parameter.value,
            "nominal": usual if usual and math.isfinite(usual) else None,
            "minimum": low,
            "maximum": high,
            "tunable": i in used,
        }
    for entry in model.inputs:
        yield {"name": flat(entry.name), "source": entry.name, "kind": INPUT, "unit": entry.unit, "doc": entry.doc} | {
            "start": inputs.get(entry.name, 0.0)
        }
    for entry in model.outputs:
        kind, name = (RESULT, structured(entry.name)) if entry.name in results else (OUTPUT, flat(entry.name))
        yield {"name": name, "source": entry.name, "kind": kind, "unit": entry.unit, "doc": entry.doc}
    shown = list(model.states)
    for twist in twists:
        shown[twist.coordinate] = replace(shown[twist.coordinate], name=twist.name, doc=twist.doc)
    for entry in shown:
        name = structured(entry.name)
        yield {"name": name, "source": entry.name, "kind": STATE, "unit": entry.unit, "doc": entry.doc} | {
            "start": starts.get(entry.name),
            "nominal": nominals.get(entry.name),
        }
    for entry in shown:
        name = f"der({structured(entry.name)})"
        yield {"name": name, "source": entry.name, "kind": DERIVATIVE, "unit": per_second(entry.unit)}
    for entry in model.memories:
        name = structured(entry.name)
        yield {"name": name, "source": entry.name, "kind": MEMORY, "unit": entry.unit, "doc": entry.doc}
    for mode in model.modes:
        if mode.kind != TIME:
            labels = ", ".join(f"{value:+d} {label}" for value, label in zip((-1, 0, 1), mode.labels, strict=True))
            name = structured(f"{mode.name}.mode")
            yield {"name": name, "source": mode.name, "kind": MODE, "doc": f"discrete mode: {labels}"}
    for mode in model.modes:
        if mode.kind != TIME:
            for side in ("above", "below"):
                name = structured(f"{mode.name}.indicator_{side}")
                doc = "event indicator: positive while the mode holds"
                yield {"name": name, "source": mode.name, "kind": INDICATOR, "doc": doc}
    for twist in twists:
        entry = model.states[twist.coordinate]
        name, doc = structured(entry.name), entry.doc or f"follows from the state {twist.name}"
        yield {"name": name, "source": entry.name, "kind": COORDINATE, "unit": entry.unit, "doc": doc} | {
            "start": starts.get(entry.name)
        }
    for k, clock in enumerate(model.clocks, 1):
        doc = f"sample instants, every {clock.period:.12g} s from {clock.offset:.12g} s on"
        yield {"name": f"sample_clock_{k}", "source": f"clock {k}", "kind": CLOCK, "doc": doc}


def per_second(unit: str) -> str:
    """The unit of a time derivative: ``rad/s`` gives ``rad/s2``."""
    if unit in ("", "*"):
        return ""
    numerator, _, below = unit.partition("/")
    parts = below.strip("()").split(".") if below else []
    seconds = [part for part in parts if re.fullmatch(r"s\d*", part)]
    rest = [part for part in parts if part not in seconds]
    power = sum(int(part[1:] or 1) for part in seconds) + 1
    rest.append("s" if power == 1 else f"s{power}")
    return f"{numerator}/{rest[0]}" if len(rest) == 1 else f"{numerator}/({'.'.join(rest)})"
