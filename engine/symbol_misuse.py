"""Python on symbols: an ``if`` or `math.sin` in a law, found where it stands, with what to write instead."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import casadi as ca

from engine.errors import StructureError

_BRANCH = (
    "write flexarm.symbolic.choose(condition, then, otherwise), greatest or least in place of 'if', 'and', 'max' and "
    "'min'; where the law switches, net.switch"
)
_FUNCTION = (
    "write flexarm.symbolic.sin and the like in place of functions of 'math', which take numbers; options and "
    "structural parameters are numbers, every other parameter a symbol"
)
_NO_NUMBER = "a symbol has no number"
_SIGNS = (
    ("truth value", "decides by the value of a symbol, which is not known while a law is written", _BRANCH),
    (_NO_NUMBER, "takes the number of a symbol, which is not known while a law is written", _FUNCTION),
    ("to_int not defined", "takes the number of a symbol, which is not known while a law is written", _FUNCTION),
    ("indices must be integers", "picks by the value of a symbol", "write flexarm.symbolic.select(index, values)"),
)
_ENGINE = Path(__file__).parent
_writing: ContextVar[bool] = ContextVar("whether a law is being written, in this thread", default=False)
_own = ca.SX.__float__


def _number(symbol: Any) -> float:
    if _writing.get() and not symbol.is_constant():
        raise TypeError(_NO_NUMBER)
    return float(_own(symbol))


# Once and for all threads: models are built in several at a time.
setattr(ca.SX, "__float__", _number)  # noqa: B010


@contextmanager
def explained(name: str, kind: str) -> Iterator[None]:
    """Turns an error that comes of a symbol taken for a number into one that names line and remedy.

    Within it ``float`` of a symbol raises, where CasADi would give NaN.

    Args:
        name: of the block whose law is written.
        kind: its type.

    Raises:
        StructureError: the law used a symbol as a number.
    """
    within = _writing.set(True)
    try:
        yield
    except (TypeError, RuntimeError) as error:
        found = next(((what, remedy) for sign, what, remedy in _SIGNS if sign in str(error)), None)
        if found is None or isinstance(error, NotImplementedError):
            raise
        frames = [f for f in traceback.extract_tb(error.__traceback__) if _is_law(f.filename)]
        place = f"{frames[-1].filename}:{frames[-1].lineno}: {frames[-1].line}" if frames else "its stamp"
        raise StructureError(f"the law of '{name}' ({kind}) {found[0]}: {place}", remedy=found[1]) from error
    finally:
        _writing.reset(within)


def _is_law(file: str) -> bool:
    """Whether a file may hold a law: not the engine, nor a library that it calls."""
    path = Path(file)
    return path.is_file() and path.parent != _ENGINE and "casadi" not in path.parts and "numpy" not in path.parts
