"""The definition of a function around its lines: signature, arrays, loop variables, and arguments
that are not used.
"""

from __future__ import annotations

import re

import casadi as ca

from distal.codegen.number_types import Dialect

_ARGUMENT = re.compile(r"\b[ar]\d+\b")


def framed(
    function: ca.Function,
    name: str,
    in_place: bool,
    dialect: Dialect,
    arrays: list[str],
    lines: list[str],
) -> str:
    """Return the definition of a function in C: signature, arrays, loop variables and its `lines`.

    The `arrays` are the declarations of those that the lines need. Inputs become ``a0`` …, outputs
    ``r0`` …. With `in_place` the first input and the first output are one array, ``state``.
    """
    kind = dialect.type
    skip = 1 if in_place else 0
    inputs = [f"a{i}" for i in range(skip, function.n_in())]
    outputs = [f"r{i}" for i in range(skip, function.n_out())]
    arguments = [f"{kind}* restrict state"] if in_place else []
    arguments += [f"const {kind}* restrict {argument}" for argument in inputs]
    arguments += [f"{kind}* restrict {argument}" for argument in outputs]
    body = "\n".join(lines)
    used = set(_ARGUMENT.findall(body))
    loops = [f"  int {variable};" for variable in "ijk" if f"for ({variable} = 0" in body]
    unused = [f"  (void){argument};" for argument in (*inputs, *outputs) if argument not in used]
    return "\n".join(
        [
            f"static void {name}({', '.join(arguments)}) {{",
            *arrays,
            *loops,
            *unused,
            *lines,
            "}",
            "",
        ]
    )
