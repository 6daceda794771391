"""CasADi's operations, sorted by how C writes them, and the error for those that have no C here."""

from __future__ import annotations

import casadi as ca

from distal.errors import DistalError

INFIX = {
    ca.OP_ADD: "{a} + {b}",
    ca.OP_SUB: "{a} - {b}",
    ca.OP_MUL: "{a} * {b}",
    ca.OP_DIV: "{a} / {b}",
    ca.OP_NEG: "-{a}",
    ca.OP_SQ: "{a} * {a}",
}
"""Operations that C writes alike for numbers and for vectors of them."""

COMPARED = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}

CALLED = {
    ca.OP_SQRT: "sqrt",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_ATAN2: "atan2",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_FABS: "fabs",
    ca.OP_FMIN: "fmin",
    ca.OP_FMAX: "fmax",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_COPYSIGN: "copysign",
    ca.OP_EXPM1: "expm1",
    ca.OP_LOG1P: "log1p",
    ca.OP_HYPOT: "hypot",
    ca.OP_ERF: "erf",
}
"""Operations that are functions of C's library."""

INLINE = frozenset([ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX, ca.OP_SQRT, ca.OP_COPYSIGN])
"""Those of them that processors with a floating-point unit have as instructions, or that take a few."""

_FUNCTIONS = (ca.OP_ATAN2, ca.OP_FMIN, ca.OP_FMAX, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_COPYSIGN, ca.OP_HYPOT)
_SIGNS = (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO, *COMPARED)
BINARY = frozenset((*_FUNCTIONS, *_SIGNS))
"""Operations with two operands."""


class CodeError(DistalError):
    """A function cannot be written as C."""


def no_such_operation(operation: int) -> CodeError:
    """Return the error for an operation that has no C here."""
    return CodeError(f"CasADi's operation {operation} has no C here; a rig that needs it cannot be exported yet")
