"""A plan in words."""

from __future__ import annotations

import math

from diagnosis.planning.plan import Plan, Row

PREFIXES = {-12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M"}
"""Powers of a thousand."""

PREFIXED = ("V", "A", "N", "s", "H", "rad", "m", "W")
"""Units that are told with a prefix, alone or as the first factor."""


def engineering(value: float, unit: str) -> str:
    """A size in two digits, with a prefix where its unit takes one: ``1.3 mN.m``."""
    if unit in ("1", "*", ""):
        return f"{value:.2g}"
    first = unit.partition(".")[0].partition("/")[0]
    if value == 0 or first not in PREFIXED:
        return f"{value:.2g} {unit}"
    power = 3 * math.floor(math.log10(abs(float(f"{value:.2g}"))) / 3)
    if power not in PREFIXES:
        return f"{value:.2g} {unit}"
    return f"{float(f'{value:.2g}') / 10**power:.3g} {PREFIXES[power]}{unit}"


def size_in_words(row: Row) -> str:
    """The smallest size that shows, in words."""
    if row.size is None:
        return "any"
    what = row.parameter.replace("_", " ")
    if row.effect == "wrong_parameter" or row.parameter == "gain":
        told = f"{100 * row.size:.2g} % off"
    elif row.effect == "saturation" and row.share is not None:
        told = f"{engineering(row.size, row.unit)}, {100 * (1 - row.share):.2g} % below {row.share_of}"
    else:
        told = engineering(row.size, row.unit)
        if row.share is not None:
            told += f", {float(f'{100 * row.share:.2g}'):g} % of {row.share_of}"
    if row.effect in ("joint_flexibility", "hardening_spring", "hysteresis") and row.parameter == "stiffness":
        told += " or softer"
    if row.finest:
        told += " (smaller: not tried)"
    return f"{what} {told}"


def cannot_tell(row: Row, found: Plan) -> str:
    """The numbers of the effects that it cannot be told from; those with a star at any of the sizes."""
    first, last = found.multiples[0], found.multiples[-1]
    later = row.ties.get(last, ()) if last != first else ()
    singles = [f"{k}{'*' if k in later else ''}" for k in row.ties.get(first, ())]
    doubles = [f"{a} with {b}" for a, b in row.pairs.get(first, ())]
    return ", ".join([*singles, *doubles])


def apart_sentences(found: Plan) -> list[str]:
    """How many pairs of effects are told apart, at each of the sizes."""
    return [
        f"told apart at {multiple:g} times the smallest size: {found.apart(multiple)} of {found.pairs[multiple]} pairs"
        for multiple in found.multiples
    ]


def input_sentence(found: Plan) -> str:
    """Which input of the menu to run besides."""
    first = found.multiples[0]
    now, pairs = found.apart(first), found.pairs[first]
    if not found.one_input:
        return "no other input was tried: the menu is for one driven input"
    if not found.tied[first]:
        return f"every pair is told apart at {first:g} times the smallest size: no other input is needed"
    best = found.best_input
    if best is None:
        return "no input of the menu, run besides, tells more apart"
    return (
        f"the input of the menu that tells most apart, run besides: {best.sentence} ({best.kind}): "
        f"{now + len(best.settles)} of {pairs} pairs, {now} without it"
    )


def sensor_sentence(found: Plan) -> str:
    """Which sensor to add."""
    first = found.multiples[0]
    now, pairs = found.apart(first), found.pairs[first]
    if not found.tied[first]:
        return f"every pair is told apart at {first:g} times the smallest size: no further sensor is needed"
    best = found.best_sensor
    if best is None:
        return "no further sensor settles a tie"
    sensor = best.sensor
    some = best.settles[:3]
    words = "; ".join(f"{found.rows[i - 1].label} from {found.rows[j - 1].label}" for i, j in some)
    more = f" and {len(best.settles) - len(some)} more" if len(best.settles) > len(some) else ""
    return (
        f"the further sensor that settles most ties: {sensor.label} (noise {sensor.sigma:.2g} {sensor.unit}, "
        f"{sensor.noise}): {now + len(best.settles)} of {pairs} pairs, {now} without it; it tells {words}{more}"
    )
