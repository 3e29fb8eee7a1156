"""What a name or a description may hold, so that every file made of it can: XML, JSON, MATLAB, a file's name."""

from __future__ import annotations

import re

from engine.errors import FlexarmError

CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")
"""Characters that no text holds: controls, those that turn or end lines, and halves; but for tab and newline."""


def check_text(what: str, text: str) -> None:
    """Refuse a text that XML cannot hold or a terminal would obey.

    Args:
        what: what it is, for the message.
        text: the text.

    Raises:
        FlexarmError: it holds a control character.
    """
    found = CONTROL.search(text)
    if found:
        raise FlexarmError(f"{what} holds the control character U+{ord(found[0]):04X}", remedy="leave it out")


def identifier(name: str) -> str:
    """A variable name for MATLAB."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[:50]
    return plain if plain[:1].isalpha() else f"x{plain}"
