"""Suggest the unit that was probably meant by one that is unknown or does not fit. A suggestion is never applied."""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Callable, Iterator
from typing import Any

_WORDS = {
    "V": "v volt volts",
    "mV": "mv",
    "A": "a amp amps ampere amperes",
    "mA": "ma",
    "ohm": "ohm ohms",
    "kohm": "kohm",
    "mohm": "mohm milliohm",
    "H": "henry",
    "mH": "mh millihenry",
    "W": "watt watts",
    "N": "n newton newtons",
    "N.m": "nm newtonmeter newtonmetre",
    "mN.m": "mnm",
    "kg": "kg kilogram kilograms",
    "g": "gram grams",
    "m": "m meter meters metre metres",
    "mm": "mm millimeter millimetre",
    "cm": "cm centimeter centimetre",
    "s": "s sec secs second seconds",
    "ms": "msec msecs",
    "Hz": "hz hertz",
    "kHz": "khz",
    "rad": "rad radian radians",
    "rad/s": "rads",
    "turn/s": "rps",
    "deg": "deg degree degrees",
    "deg/s": "dps degps degs",
    "rpm": "rpm",
    "krpm": "krpm",
    "turn": "rev revs revolution",
    "count": "count counts tick ticks pulse pulses",
}
_MEANT = {word: unit for unit, words in _WORDS.items() for word in words.split()}
"""Words in small letters as units are often written."""

_WHOLE = {
    "rev/min": "rpm",
    "kgcm": "kgf.cm",
    "kg.cm": "kgf.cm",
    "gcm": "gf.cm",
    "ozin": "ozf.in",
    "oz.in": "ozf.in",
    "lbin": "lbf.in",
    "lb.in": "lbf.in",
    "lbft": "lbf.ft",
    "lb.ft": "lbf.ft",
}
"""The same for whole units: with a power behind them they would be others."""

_HOMONYMS = {"Nm", "mNm", "kNm", "Nms", "amps", "rads", "MM"}
"""Words that pint takes for units of yarn, radiation and others, which nobody means here."""

_WORD = re.compile(r"([^\W\d_]+)(\d*)")

_SYMBOL = r"kg|[mkuµ]?[NVAW]|[cm]m|rad|deg|ohm|[mgs]"
_GLUED = re.compile(f"(?:{_SYMBOL}){{2,4}}")
"""Symbols without the dot between them."""

_LONGEST = 40
"""Characters of a unit for which anything is suggested."""


def likely(text: str, target: str, parse: Callable[[str], Any]) -> str:
    """The unit that was probably meant; empty if none is near.

    Args:
        text: as it was written.
        target: a unit that measures the same thing; empty where none is known.
        parse: gives pint's unit, or raises.
    """
    if len(text) > _LONGEST:
        return ""
    for candidate in _candidates(text.strip(), parse):
        try:
            found = parse(candidate)
            if candidate != text and (not target or found.dimensionality == parse(target).dimensionality):
                return candidate
        except Exception:  # pint's errors are many
            continue
    return ""


def _candidates(text: str, parse: Callable[[str], Any]) -> Iterator[str]:
    dotted = re.sub(r"(?<=[^\W\d_])[-·⋅* ](?=[^\W\d_])", ".", text)
    if dotted.lower() in _WHOLE:
        yield _WHOLE[dotted.lower()]
    for keep in (True, False):
        text, end = "", 0
        for word in _WORD.finditer(dotted):
            text += dotted[end : word.start()]
            spelled = _spelled(word[1], parse, keep) + word[2]
            text += f"({spelled})" if text.endswith("/") and re.search("[./]", spelled) else spelled
            end = word.end()
        yield text + dotted[end:]


def _spelled(word: str, parse: Callable[[str], Any], keep: bool) -> str:
    """One word as it should be written; ``keep`` leaves those that are units alone."""
    if keep and word not in _HOMONYMS:
        with contextlib.suppress(Exception):  # it is not a unit
            parse(word)
            return word
    if word.lower() in _MEANT:
        return _MEANT[word.lower()]
    if _GLUED.fullmatch(word):
        return ".".join(re.findall(_SYMBOL, word))
    near = difflib.get_close_matches(word.lower(), _MEANT, n=1, cutoff=0.7) if len(word) > 2 else []
    return _MEANT[near[0]] if near else word
