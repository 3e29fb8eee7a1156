"""Whether the tool's intervals hold the true values, where it reports the quantity that the truth has."""

from __future__ import annotations

import math
from typing import Any

from benchmarks.concealed.effects import TURNED
from benchmarks.concealed.named import plant as plant_of

ANGLES = frozenset({"phase", "hanging_angle"})
COMMANDED = frozenset({"dead_zone", "offset"})
"""Effects with levels behind the amplifier, whose gain is off by a few per cent that no scenario knows of: at the
command, where the tool puts them, they are smaller by that gain. The limits of a saturation are the command's own."""

GRAVITY = 9.81


def covered(found: dict[str, Any], answer: dict[str, Any]) -> list[tuple[str, bool]]:
    """(effect.parameter, whether its interval holds the true value), where both are the same quantity.

    A parameter counts if its finding names the true effect, or a wrong parameter. A friction on the other side of a
    gear without losses is compared through the ratio; behind a gear that loses power it is another quantity.
    """
    rows = []
    true = answer["true_parameters"]
    for f in found["findings"]:
        if f["status"] == "wrong_parameter" or f["effect"] == "wrong_parameter":
            for key, row in f["parameters"].items():
                name = f["place"] if f["place"] in true else f"{f['block']}.{key}"
                if name in true and name.endswith(f".{key}"):
                    rows.append((f"wrong_parameter.{key}", _inside(key, row, true[name])))
        if f["status"] not in ("named", "tie"):
            continue
        for c in answer["concealed"]:
            if c["effect"] != f["effect"]:
                continue
            for key, row in f["parameters"].items():
                if row["low"] == row["high"]:  # a number that was chosen, such as an order
                    continue
                value = _true_value(c, key, f, answer)
                if value is not None:
                    rows.append((f"{c['effect']}.{key}", _inside(key, row, value)))
    return rows


def _true_value(concealed: dict[str, Any], key: str, finding: dict[str, Any], answer: dict[str, Any]) -> float | None:
    parameters, place = concealed["parameters"], finding["place"]
    if (concealed["effect"], key) == ("supply_sag", "resistance"):  # only resistance over voltage squared shows
        told = finding["parameters"]["source_voltage"]["value"]
        value = parameters["resistance"] * (told / parameters["voltage"]) ** 2
    elif (concealed["effect"], key) == ("gravity", "mass"):  # the tool's radius is 1 m
        value = parameters["moment"] / GRAVITY
    elif (concealed["effect"], key) == ("outside_vibration", "frequency"):  # the tool's is in rad/s, the truth's in Hz
        value = 2 * math.pi * parameters["frequency"]
    elif isinstance(parameters.get(key), int | float):
        value = float(parameters[key])
    else:
        return None
    if concealed["effect"] in COMMANDED and concealed["place"].startswith("source.out"):
        value /= 1 + answer["nuisance"]["gain"]
    if place == concealed["place"] or place in concealed["place"].split(" -> "):
        return float(value)
    if place not in concealed["same_place"]:
        return None
    plant = plant_of(answer["plant"])
    there, here = plant.ratio(place), plant.ratio(concealed["place"])
    if there == here:
        return float(value)
    if key not in TURNED or plant.lossy(place, concealed["place"]):
        return None
    return float(value * (here / there) ** TURNED[key])


def _inside(key: str, row: dict[str, Any], value: float) -> bool:
    low = -math.inf if row["low"] is None else row["low"]
    high = math.inf if row["high"] is None else row["high"]
    if key in ANGLES and math.isfinite(low + high):
        middle = (low + high) / 2
        value = middle + math.remainder(value - middle, 2 * math.pi)
    return bool(low <= value <= high)
