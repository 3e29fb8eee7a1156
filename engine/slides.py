"""The sliding twin of a turning law: the same law along a straight line, made from the turning one.

A class that names ``slide`` is such a twin; it states nothing twice::

    class TranslationalSpringDamper(SpringDamper, slide={}):
        '''Spring and damper: F = k e + d e', e = position of a - position of b - rest_distance.'''

Units lose their angle and their lever: rad is m, N.m is N, kg.m2 is kg, N.m.s/rad is N.s/m. Names follow `NAMES`, and
sentences `WORDS`. What the twin declares itself counts; ``slide`` gives further names, and None for a declaration that
it has none of; ``keeps`` names what stays as it is, such as an angular frequency, whose radians are of time. Inside
``stamp`` both names of a declaration read the twin's.
"""

from __future__ import annotations

import re

from engine.ports import ROTATIONAL, TRANSLATIONAL

NAMES = {
    "torque": "force",
    "shaft": "slide",
    "twist": "compression",
    "angle": "position",
    "rest_angle": "rest_distance",
    "start_angle": "start_position",
    "yield_twist": "yield_compression",
    "inertia": "mass",
}
"""What a turning law and its twin call the same thing."""

WORDS = {
    "torque": "force",
    "torques": "forces",
    "shaft": "slide",
    "shafts": "slides",
    "twist": "compression",
    "angle": "position",
    "turns": "moves",
    "rotating": "sliding",
    "bearing": "guide",
    "moment of inertia": "mass",
    "tau": "F",
}
"""The same in the sentences of declarations."""

KINDS = {ROTATIONAL: TRANSLATIONAL}

_PART = re.compile(r"([A-Za-z]+)(-?\d*)")


def along_slide(unit: str) -> str:
    """The unit in which a sliding law has what a turning one has in ``unit``: N.m.s/rad gives N.s/m.

    Every newton stands on a lever of a metre, every kilogram on two; the rest of the metres were there before.
    """
    if unit in ("", "*", "1"):
        return unit
    above, _, below = unit.partition("/")
    powers: dict[str, int] = {}
    for text, sign in ((above, 1), (below.strip("()"), -1)):
        for symbol, power in _PART.findall(text):
            powers[symbol] = powers.get(symbol, 0) + sign * int(power or 1)
    levers = -powers.get("N", 0) - 2 * powers.get("kg", 0)
    powers["m"] = powers.get("m", 0) + levers + powers.pop("rad", 0)

    def spelled(sign: int) -> list[str]:
        found = [(symbol, sign * power) for symbol, power in powers.items() if sign * power > 0]
        return [symbol + (str(power) if power != 1 else "") for symbol, power in found]

    numerator, denominator = spelled(1), spelled(-1)
    under = ".".join(denominator) if len(denominator) < 2 else f"({'.'.join(denominator)})"
    return (".".join(numerator) or "1") + (f"/{under}" if under else "")


def in_words(sentence: str) -> str:
    """The sentence of a turning law, said of its twin."""
    pattern = r"\b(" + "|".join(sorted(map(re.escape, WORDS), key=len, reverse=True)) + r")\b"
    return re.sub(pattern, lambda found: WORDS[found[0]], sentence)
