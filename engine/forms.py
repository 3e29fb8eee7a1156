"""How values are written in C: those of one run as doubles, or those of several runs in the lanes of vectors.

In lanes, an operation that vectors have is one operation; whatever else is asked of a processor or of the library is
done lane by lane with the text of one run. Both therefore give the same numbers to the bit.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import casadi as ca

from engine.operations import BINARY, COSTLY, UNARY, literal


@dataclass(frozen=True)
class Term:
    """What an operation reads.

    Attributes:
        text: C of one run's value, or of the vector of several.
        constant: whether it is one double, the same in every lane, such as a number that stands in the text.
    """

    text: str
    constant: bool = False


class Scalar:
    """Doubles.

    Attributes:
        number: type of a value.
        zero: C of a value that is zero.
    """

    number, zero = "double", "0"

    def read(self, array: str, text: str) -> Term:
        """An element of an argument or a shelf."""
        return Term(text)

    def value(self, operation: int, terms: Sequence[Term]) -> str:
        """C of an operation's result."""
        return (UNARY.get(operation) or BINARY[operation]).format(*(term.text for term in terms))

    def whole(self, term: Term) -> str:
        """C of a value by itself."""
        return term.text

    def test(self, terms: Sequence[Term]) -> str:
        """C of a condition: whether none of some values is zero."""
        return " && ".join(f"{term.text} != 0" for term in terms)


_IN_LANES = {
    ca.OP_ADD: BINARY[ca.OP_ADD],
    ca.OP_SUB: BINARY[ca.OP_SUB],
    ca.OP_MUL: BINARY[ca.OP_MUL],
    ca.OP_DIV: BINARY[ca.OP_DIV],
    ca.OP_LT: "fa_flag({0} < {1})",
    ca.OP_LE: "fa_flag({0} <= {1})",
    ca.OP_EQ: "fa_flag({0} == {1})",
    ca.OP_NE: "fa_flag({0} != {1})",
    ca.OP_AND: "fa_flag(fa_true({0}) & fa_true({1}))",
    ca.OP_OR: "fa_flag(fa_true({0}) | fa_true({1}))",
    ca.OP_IF_ELSE_ZERO: "fa_where(fa_true({0}), {1})",
    ca.OP_FMIN: "fa_chosen({0} < {1}, {0}, {1})",
    ca.OP_FMAX: "fa_chosen({0} > {1}, {0}, {1})",
    ca.OP_ASSIGN: UNARY[ca.OP_ASSIGN],
    ca.OP_NEG: UNARY[ca.OP_NEG],
    ca.OP_SQ: UNARY[ca.OP_SQ],
    ca.OP_TWICE: UNARY[ca.OP_TWICE],
    ca.OP_INV: UNARY[ca.OP_INV],
    ca.OP_NOT: "fa_flag({0} == 0)",
    ca.OP_FABS: "fa_chosen(fa_sign_bits({0}), -{0}, {0})",
    ca.OP_SIGN: "(fa_flag({0} > 0) - fa_flag({0} < 0))",
    ca.OP_EXP: "fa_exp_lanes({0})",
}
"""Operations that vectors have; see ``vectors.c``."""


class Lanes:
    """Vectors of one double for each run; attributes and methods as those of `Scalar`.

    Args:
        shared: arrays of doubles, which all lanes have in common.
    """

    number, zero = "fa_lane", "{0}"

    def __init__(self, shared: Collection[str] = ()) -> None:
        self._shared = frozenset(shared)

    def read(self, array: str, text: str) -> Term:
        """An element of an argument or a shelf."""
        return Term(text, constant=array in self._shared)

    def arguments(self, arguments: str) -> str:
        """C of a function's arguments, from that for doubles."""
        each = re.split(r",\s*", arguments)
        return ", ".join(
            a if a.split("restrict ")[-1] in self._shared else a.replace("double", self.number) for a in each
        )

    def value(self, operation: int, terms: Sequence[Term]) -> str:
        """C of an operation's result in every lane."""
        if operation in _IN_LANES:
            return _IN_LANES[operation].format(*(self.whole(term) for term in terms))
        # A number stays a number here: the compiler knows more of `pow(x, 2.0)` than of `pow(x, y)`.
        each = [Term(term.text if term.constant else f"{term.text}[l]") for term in terms]
        same = " && ".join(f"fa_same({term.text})" for term in terms if not term.constant) or "1"
        return f"FA_LANE_BY_LANE({same if operation in COSTLY else 0}, {SCALAR.value(operation, each)})"

    def whole(self, term: Term) -> str:
        """C of a value in every lane."""
        return f"FA_ALL({term.text})" if term.constant else term.text

    def test(self, terms: Sequence[Term]) -> str:
        """C of a condition: whether there is a lane in which none of some values is zero."""
        if all(term.constant for term in terms):
            return SCALAR.test(terms)
        return f"fa_any({' & '.join(f'fa_true({self.whole(term)})' for term in terms)})"


SCALAR, LANES = Scalar(), Lanes()
STAGES = Lanes(("d", "m", "p", "cp", "cm", "fire"))
"""The four stages of one run's step: all but time, states and inputs is the same in them."""
Form = Scalar | Lanes


def constant(value: float) -> Term:
    """A number that stands in the text."""
    return Term(literal(value), constant=True)
