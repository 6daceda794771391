"""How numbers and operations are written in C: CasADi's operations, sorted by how C writes them,
and the dialects: double, float, or several runs side by side in vector lanes.

A dialect knows nothing of functions, memory or loops. A new one (fixed-point numbers, say) is one
more class here, with the same methods.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, isinf, isnan

import casadi as ca

from distal.errors import ExportError

_LIBRARY = (
    "sqrt exp log sin cos tan asin acos atan atan2 sinh cosh tanh floor ceil "
    "fabs fmin fmax pow copysign expm1 log1p hypot erf"
)
CALLED: dict[int, str] = {getattr(ca, f"OP_{name.upper()}"): name for name in _LIBRARY.split()}
CALLED[ca.OP_CONSTPOW] = "pow"
"""Operations that are functions of C's library."""

_OF_TWO = {"atan2", "fmin", "fmax", "pow", "copysign", "hypot"}
"""Those of C's functions that have two arguments."""

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
} | {
    operation: f"{{v}}{name}{{f}}({'{a}, {b}' if name in _OF_TWO else '{a}'})"
    for operation, name in CALLED.items()
}
"""Operations that C writes alike for numbers and for vectors, with templates: {truth} turns a
condition into a number, {f} ends a literal or a function's name, which {v} begins.
"""


class CodeError(ExportError):
    """A function cannot be written as C."""


_PLAIN = FORMS | {
    ca.OP_FMAX: "larger({a}, {b})",
    ca.OP_FMIN: "smaller({a}, {b})",
    ca.OP_AND: "{truth}({a} != 0.0{f} && {b} != 0.0{f})",
    ca.OP_OR: "{truth}({a} != 0.0{f} || {b} != 0.0{f})",
    ca.OP_SIGN: "{truth}(({a} > 0.0{f}) - ({a} < 0.0{f}))",
    ca.OP_IF_ELSE_ZERO: "({a} != 0.0{f} ? {b} : 0.0{f})",
}
_LANES = FORMS | {
    ca.OP_AND: "ones(({a} != 0.0) & ({b} != 0.0))",
    ca.OP_OR: "ones(({a} != 0.0) | ({b} != 0.0))",
    ca.OP_SIGN: "v_sign({a})",
    ca.OP_IF_ELSE_ZERO: "(V)(({a} != 0.0) & (M){b})",
}


def _formed(forms: dict[int, str], operation: int, **blanks: str) -> str:
    """Return the C of an operation by its template, or raise a `CodeError`."""
    if operation not in forms:
        raise CodeError(
            f"CasADi's operation {operation} has no C here; a rig that needs it cannot be exported "
            "yet"
        )
    return forms[operation].format(**blanks)


LARGEST_FLOAT = 3.40282346e38
"""Largest finite number of C's float. Source: definition (IEEE 754 single precision)."""

SMALLEST_FLOAT = 1.17549435e-38
"""Smallest positive normal number of C's float. Source: definition (IEEE 754 single precision)."""


@dataclass(frozen=True)
class Plain:
    """C of numbers one by one: float with float functions if `single`, else double."""

    single: bool = False

    @property
    def type(self) -> str:
        """Name of the type of a number in C."""
        return "float" if self.single else "double"

    @property
    def size(self) -> int:
        """Size of a number [bytes]."""
        return 4 if self.single else 8

    def prelude(self, text: str) -> str:
        """Return the functions for the larger and the smaller of two numbers, each if `text` calls
        it: compilers warn of unused ones.
        """
        kind = self.type
        return "".join(
            f"static inline {kind} {name}({kind} a, {kind} b) {{ return a {sign} b || b != b ? a "
            f": b; }}\n"
            for name, sign in (("larger", ">"), ("smaller", "<"))
            if f"{name}(" in text
        )

    def constant(self, value: float) -> str:
        """Return a number as C."""
        if isnan(value):
            return "NAN" if self.single else "(double)NAN"
        if isinf(value):
            return "INFINITY" if value > 0 else "(-INFINITY)"
        text = f"{value:.17g}"
        if self.single:  # what a float cannot hold is its largest number, or zero
            near = min(max(value, -LARGEST_FLOAT), LARGEST_FLOAT)
            text = f"{near if abs(value) > SMALLEST_FLOAT else 0.0:.9g}"
        text += ".0" * text.lstrip("-").isdigit() + "f" * self.single
        return f"({text})" if text.startswith("-") else text

    entry = constant

    def operation(self, operation: int, a: str, b: str = "") -> str:
        """Return the C of one operation, or raise a `CodeError`."""
        truth = f"({self.type})"
        return _formed(_PLAIN, operation, a=a, b=b, truth=truth, v="", f="f" * self.single)


_VECTORS = """
typedef double V __attribute__((vector_size({bytes})));
typedef long long M __attribute__((vector_size({bytes})));
static inline V all(double x) {{ V v; int l; for (l = 0; l < {lanes}; ++l) v[l] = x; return v; }}
static inline V where(M m, V a, V b) {{ return (V)((m & (M)a) | (~m & (M)b)); }}
static inline V ones(M m) {{ return (V)(m & (M)all(1.0)); }}
static inline V v_fabs(V a) {{ return (V)((M)a & 0x7fffffffffffffffLL); }}
static inline V v_fmin(V a, V b) {{ return where((a < b) | (b != b), a, b); }}
static inline V v_fmax(V a, V b) {{ return where((a > b) | (b != b), a, b); }}
static inline V v_sign(V a) {{ return ones(a > 0.0) - ones(a < 0.0); }}
"""

_LANEWISE = {
    # runs with the same stamps have the same decays: computed once
    1: """static inline V v_{f}(V a) {{
  V r; int l, alike = 1;
  for (l = 1; l < {lanes}; ++l) alike &= a[l] == a[0];
  if (alike) return all({f}(a[0]));
  for (l = 0; l < {lanes}; ++l) r[l] = {f}(a[l]);
  return r;
}}""",
    2: "static inline V v_{f}(V a, V b) {{ V r; int l; for (l = 0; l < {lanes}; ++l) r[l] = "
    "{f}(a[l], b[l]); return r; }}",
}

VECTORED = {"fabs", "fmin", "fmax"}
"""Functions with a vector form. Any other function is called for one lane after the other, so that
its results are those of one run.
"""


@dataclass(frozen=True)
class Lanes:
    """C of `count` runs side by side, a power of two, with GCC's and Clang's vector types.

    Each operation is the same as for one number, so that results are the same to the last bit.
    """

    count: int
    type = "V"

    def prelude(self, text: str) -> str:
        """Return the vector types and the functions that the operations need."""
        lanewise = [
            _LANEWISE[2 if name in _OF_TWO else 1].format(f=name, lanes=self.count)
            for operation, name in CALLED.items()
            if name not in VECTORED and operation != ca.OP_CONSTPOW
        ]
        return (
            "\n".join([_VECTORS.format(bytes=8 * self.count, lanes=self.count), *lanewise]) + "\n"
        )

    def constant(self, value: float) -> str:
        """Return a number as C, the same in all lanes."""
        return f"all({Plain().constant(value)})"

    def entry(self, value: float) -> str:
        """Return a number of a table of constants as C, the same in all lanes: an initializer,
        which may not be a call.
        """
        text = f"{value:.17g}" if isfinite(value) else Plain().constant(value)
        return "{" + ", ".join([text] * self.count) + "}"

    def operation(self, operation: int, a: str, b: str = "") -> str:
        """Return the C of one operation, or raise a `CodeError`."""
        return _formed(_LANES, operation, a=a, b=b, truth="ones", v="v_", f="")


Dialect = Plain | Lanes
"""What the writers ask for the C of numbers and operations, and for what stands before the first
function.
"""
