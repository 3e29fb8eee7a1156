"""Odd values, and mutations of scenario documents and of tables."""

from __future__ import annotations

import json
import math
from typing import Any

from hypothesis import strategies as st

from engine.quantity import Parameter

HUGE = [1e308, -1e308, 1e300, 1e-300, 5e-324, 1e20, -1e20, 1e-20, 10**40, -(10**400), 0, -0.0, 1, -1, 2, 1000000]

TEXTS = [
    "",
    " ",
    "null",
    "nan",
    "inf",
    "-inf",
    "1e999",
    "0x" + "f" * 5000,
    "1_000",
    "1__0",
    "yes",
    "2 degC",
    "3 dB",
    "1 N.m",
    "1 parsec/fortnight",
    "1 10^10^10",
    "1 " + "(" * 3000,
    "9" * 3000 + "\n x",
    "$",
    "$x",
    "$supply",
    "../../../etc/passwd",
    "./" + "a" * 400 + ".yaml",
    "./a\0b.yaml",
    "data",
    ".",
    "..",
    "a.b.c.d",
    "'",
    "%s %d {0}",
    "µΩ°²",
    "\u202eabc",
    "\U0001f980",
    "\x07",
    "\ud800",
    "١٢٣",
    "-" * 300,
    "x" * 5000,
]


def deep(levels: int) -> Any:
    """A list in a list, so many levels deep."""
    made: Any = 1
    for _ in range(levels):
        made = [made]
    return made


def odd() -> st.SearchStrategy[Any]:
    """A value of any kind."""
    scalars = st.one_of(
        st.sampled_from([None, True, False, *HUGE, *TEXTS]),
        st.floats(),
        st.integers(),
        st.text(max_size=20),
        st.builds("{} {}".format, st.floats(), st.sampled_from(["s", "ms", "V", "N.m/rad", "kg", "deg", "Hz", "%"])),
    )
    trees = st.recursive(
        scalars,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
        max_leaves=8,
    )
    return st.one_of(
        scalars, scalars, trees, st.sampled_from([[], {}, deep(30), deep(100), [[1, 2], [3]], [1e308] * 50])
    )


Path = tuple[Any, ...]


def paths(tree: Any, prefix: Path = ()) -> list[Path]:
    """Every path in a tree of mappings and lists, the root left out."""
    found: list[Path] = []
    entries = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, inner in entries:
        found.append((*prefix, key))
        found += paths(inner, (*prefix, key))
    return found


def at(tree: Any, path: Path) -> Any:
    """What a path leads to."""
    for key in path:
        tree = tree[key]
    return tree


ACTIONS = ["number"] * 6 + ["replace"] * 3 + ["delete", "rename", "copy", "exchange", "add"]

FACTORS = [-1.0, 0.0, 1e-200, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 0.9, 1.1, 2.0, 10.0, 1e3, 1e6, 1e12, 1e200]


def quantity(value: object) -> bool:
    """Whether a value is a number, or a text that begins with one."""
    return (isinstance(value, int | float) and not isinstance(value, bool)) or (
        isinstance(value, str) and value[:1].isdigit() and " " in value
    )


@st.composite
def scaled(draw: st.DrawFn, value: int | float | str) -> Any:
    """A quantity times a factor; a whole number may stay whole."""
    factor = draw(st.sampled_from(FACTORS))
    if isinstance(value, str):
        number, _, unit = value.partition(" ")
        return f"{float(number) * factor!r} {unit}"
    if isinstance(value, int) and draw(st.booleans()):
        return value + draw(st.integers(-3, 30))
    return value * factor


@st.composite
def mutated(draw: st.DrawFn, tree: dict[str, Any]) -> dict[str, Any]:
    """A document with one to four changes: deleted, renamed, copied, exchanged and replaced entries."""
    tree = json.loads(json.dumps(tree))
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 4]))):
        places = paths(tree)
        if not places:
            break
        path = draw(st.sampled_from(places))
        holder, key = at(tree, path[:-1]), path[-1]
        action = draw(st.sampled_from(ACTIONS))
        if action == "number":
            numbers = [path for path in places if quantity(at(tree, path))]
            path = draw(st.sampled_from(numbers)) if numbers else path
            holder, key = at(tree, path[:-1]), path[-1]
        value = holder[key]
        if action == "number" and quantity(value):
            holder[key] = draw(scaled(value))
        elif action in ("replace", "number"):
            holder[key] = draw(odd())
        elif action == "delete":
            del holder[key]
        elif action == "exchange":
            holder[key] = json.loads(json.dumps(at(tree, draw(st.sampled_from(places)))))
        elif isinstance(holder, list):
            holder.insert(key, json.loads(json.dumps(value)))
        elif action == "rename":
            holder[draw(st.text(max_size=8) | st.sampled_from([k + "x" for k in holder] or [""]))] = holder.pop(key)
        elif action == "copy":
            holder[key + "2"] = json.loads(json.dumps(value))
        else:
            holder[draw(st.text(max_size=8))] = draw(odd())
    return tree


PIECES = [
    b"\xff",
    b"\x00",
    b"\t",
    b"&a ",
    b"*a",
    b"!!python/object ",
    b"<<: ",
    b"- ",
    b": ",
    b"{",
    b"}",
    b"[",
    b"]",
    b"'",
]
PIECES += [b'"', b"#", b"|\n", b">\n", b"\n", b"\r", b"\xe2\x80\xa8", b"\xed\xa0\x80", b"%YAML 1.1\n---\n", b"...\n"]
PIECES += [b"? ", b"1e400", b"0x", b"@", b"`", b"~", b".nan", b"\xef\xbb\xbf", b"\x1b[2J", b"9" * 400, b"[" * 300]


@st.composite
def mangled(draw: st.DrawFn, content: bytes) -> bytes:
    """Bytes with one to five cuts, copies and insertions, some of whole lines."""
    for _ in range(draw(st.integers(1, 5))):
        lines = content.splitlines(keepends=True)
        action = draw(st.sampled_from(["insert", "insert", "cut", "drop", "twice", "move", "random"]))
        if action == "insert" or action == "random":
            i = draw(st.integers(0, len(content)))
            piece = draw(st.binary(max_size=6)) if action == "random" else draw(st.sampled_from(PIECES))
            content = content[:i] + piece + content[i:]
        elif action == "cut":
            i = draw(st.integers(0, len(content)))
            content = content[:i] + content[i + draw(st.integers(0, 40)) :]
        elif lines:
            i = draw(st.integers(0, len(lines) - 1))
            line = lines[i] if action == "twice" else lines.pop(i)
            if action != "drop":
                lines.insert(draw(st.integers(0, len(lines))), line)
            content = b"".join(lines)
    return content


CELLS = [
    "",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e999",
    "1e-320",
    "x",
    "1,5",
    "0x10",
    "1_0",
    " 3 ",
    "-",
    "١",
]
CELLS += [
    '"',
    '"a',
    "'",
    "null",
    "\ud800",
    "\x00",
    "9" * 5000,
    "1e",
    "--1",
    "#",
    "True",
    "\u2028",
    "\r",
    '"a\nb"',
    '"1',
    "9" * 140_000,
    "1;2",
]


@st.composite
def table(draw: st.DrawFn, rows: list[list[str]]) -> bytes:
    """A CSV table, its header first, with changed cells, rows and columns, then perhaps mangled bytes."""
    rows = [list(row) for row in rows]
    for _ in range(draw(st.integers(0, 3))):
        i, k = draw(st.integers(0, len(rows) - 1)), draw(st.integers(0, 3))
        action = draw(st.sampled_from(["cell", "cell", "drop", "swap", "column", "constant", "scale", "short", "wide"]))
        if action == "cell":
            rows[i][min(k, len(rows[i]) - 1) :][:1] = []
            rows[i].insert(min(k, len(rows[i])), draw(st.sampled_from(CELLS) | st.floats().map(repr)))
        elif action == "drop":
            del rows[i : i + draw(st.integers(1, len(rows)))]
        elif action == "swap":
            j = draw(st.integers(0, len(rows) - 1))
            rows[i], rows[j] = rows[j], rows[i]
        elif action == "column":
            rows = [row[:k] + row[k + 1 :] for row in rows]
        elif action in ("constant", "scale"):
            factor = draw(st.sampled_from([0.0, -1.0, 1e-300, 1e-12, 1e12, 1e300]))
            rows = [
                rows[0],
                *[[_scaled(cell, factor) if c == k else cell for c, cell in enumerate(row)] for row in rows[1:]],
            ]
        elif action == "short":
            rows = rows[: draw(st.integers(1, 3))]
        else:
            rows[i] = [*rows[i], *["1"] * draw(st.integers(1, 20000))]
        if not rows or any(not row for row in rows):
            rows = [row for row in rows if row] or [["t"]]
    comma = draw(st.sampled_from([",", ",", ",", ";", "\t"]))
    content = "\n".join(comma.join(row) for row in rows).encode("utf-8", "surrogatepass")
    return draw(mangled(content)) if draw(st.integers(0, 4)) == 0 else content


def _scaled(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * factor)
    except ValueError:
        return cell


def inside(declared: Parameter) -> st.SearchStrategy[float]:
    """Values of a parameter: across its bounds, on their edges, over 600 decades, and some beyond or not finite."""
    low, high = declared.bounds
    edges = [
        low,
        high,
        math.nextafter(low, high),
        math.nextafter(high, low),
        0.0,
        5e-324,
        1e-300,
        1e-30,
        1e30,
        1e300,
        1e308,
    ]
    edges = [value for value in [*edges, *(-value for value in edges)] if low <= value <= high and math.isfinite(value)]
    decades = st.builds(lambda e, s: s * 10.0**e, st.floats(-300, 300), st.sampled_from([1.0, 1.0, 1.0, -1.0]))
    usual = st.builds(lambda e, s: s * 10.0**e, st.floats(-6, 6), st.sampled_from([1.0, 1.0, 1.0, -1.0]))
    across = st.floats(
        None if math.isinf(low) else low, None if math.isinf(high) else high, allow_nan=False, allow_infinity=False
    )
    return st.one_of(usual, decades, across, st.sampled_from(edges or [0.0]), st.floats())
