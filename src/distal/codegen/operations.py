"""CasADi's operations, sorted by how C writes them, and the error for those that have no C here."""

from __future__ import annotations

import casadi as ca

from distal.errors import ExportError

FORMS = {
    ca.OP_ADD: "{a} + {b}",
    ca.OP_SUB: "{a} - {b}",
    ca.OP_MUL: "{a} * {b}",
    ca.OP_DIV: "{a} / {b}",
    ca.OP_NEG: "-{a}",
    ca.OP_SQ: "{a} * {a}",
    ca.OP_LT: "{truth}({a} < {b})",
    ca.OP_LE: "{truth}({a} <= {b})",
    ca.OP_EQ: "{truth}({a} == {b})",
    ca.OP_NE: "{truth}({a} != {b})",
    ca.OP_NOT: "{truth}({a} == 0.0{f})",
    ca.OP_TWICE: "2.0{f} * {a}",
    ca.OP_INV: "1.0{f} / {a}",
    ca.OP_ASSIGN: "{a}",
}
"""Operations that C writes alike for numbers and for vectors, with templates: {truth} turns a
condition into a number, {f} ends a literal.
"""

_LIBRARY = (
    "sqrt exp log sin cos tan asin acos atan atan2 sinh cosh tanh floor ceil "
    "fabs fmin fmax pow copysign expm1 log1p hypot erf"
)
CALLED: dict[int, str] = {getattr(ca, f"OP_{name.upper()}"): name for name in _LIBRARY.split()}
CALLED[ca.OP_CONSTPOW] = "pow"
"""Operations that are functions of C's library."""

INLINE = frozenset([ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX, ca.OP_SQRT, ca.OP_COPYSIGN])
"""Those operations of `CALLED` that processors with a floating-point unit have as one instruction,
or do in a few.
"""

_FUNCTIONS = (
    ca.OP_ATAN2,
    ca.OP_FMIN,
    ca.OP_FMAX,
    ca.OP_POW,
    ca.OP_CONSTPOW,
    ca.OP_COPYSIGN,
    ca.OP_HYPOT,
)
_LOGIC = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO)
_SIGNS = (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, *_LOGIC)
BINARY = frozenset((*_FUNCTIONS, *_SIGNS))
"""Operations with two operands."""


class CodeError(ExportError):
    """A function cannot be written as C."""


def no_such_operation(operation: int) -> CodeError:
    """Return the error for an operation that has no C here."""
    return CodeError(
        f"CasADi's operation {operation} has no C here; a rig that needs it cannot be exported yet"
    )
