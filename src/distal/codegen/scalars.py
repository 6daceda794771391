"""C of a function of scalars (SX): straight lines, one constant of C for each result; the compiler does the rest."""

from __future__ import annotations

import casadi as ca

from distal.codegen.dialects import Dialect
from distal.codegen.frame import framed
from distal.codegen.operations import BINARY, CALLED, INLINE
from distal.codegen.workspace import Cost, Written


def write_scalars(function: ca.Function, name: str, in_place: bool, dialect: Dialect) -> Written:
    """Return a function of scalars as C.

    Args:
        function: the function (SX).
        name: in C.
        in_place: the first input and the first output are one array: it is read at once and written last.
        dialect: how numbers are written.

    Raises:
        CodeError: it has an operation that has no C here.
    """
    lines, new_state, names, cost = list[str](), list[str](), dict[int, str](), Cost()
    pairs = _sines_and_cosines(function) if dialect.pairs_sines else {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT and in_place and inputs[0] == 0:
            lines.append(f"  const {dialect.type} v{k} = state[{inputs[1]}];")
            names[outputs[0]] = f"v{k}"
        elif operation == ca.OP_INPUT:
            names[outputs[0]] = f"a{inputs[0]}[{inputs[1]}]"
        elif operation == ca.OP_OUTPUT and in_place and outputs[0] == 0:
            new_state.append(f"  state[{outputs[1]}] = {names[inputs[0]]};")
        elif operation == ca.OP_OUTPUT:
            lines.append(f"  r{outputs[0]}[{outputs[1]}] = {names[inputs[0]]};")
        elif operation == ca.OP_CONST:
            names[outputs[0]] = dialect.constant(function.instruction_constant(k))
        else:
            cost.operations += 1
            if operation in CALLED and operation not in INLINE:
                cost.library[CALLED[operation]] += 1
            operands = [names[i] for i in inputs] if operation in BINARY else [names[inputs[0]]]
            if k not in pairs:
                lines.append(f"  const {dialect.type} v{k} = {dialect.operation(operation, *operands)};")
            elif k == min(pairs[k]):
                sine, cosine = pairs[k]
                lines.append(f"  {dialect.type} v{sine}, v{cosine}; v_sincos({operands[0]}, &v{sine}, &v{cosine});")
            names[outputs[0]] = f"v{k}"
    return Written(name, framed(function, name, in_place, dialect, [], [*lines, *new_state]), cost)


def _sines_and_cosines(function: ca.Function) -> dict[int, tuple[int, int]]:
    """Return for each sine and cosine of the same angle the instructions of both: C has one function for the pair."""
    slots: dict[int, int] = {}
    found: dict[int, dict[int, int]] = {}
    for k in range(function.n_instructions()):
        operation, outputs = function.instruction_id(k), function.instruction_output(k)
        if operation in (ca.OP_SIN, ca.OP_COS):
            found.setdefault(slots[function.instruction_input(k)[0]], {})[operation] = k
        if operation != ca.OP_OUTPUT:
            slots[outputs[0]] = k
    both = [(each[ca.OP_SIN], each[ca.OP_COS]) for each in found.values() if len(each) == 2]
    return {k: pair for pair in both for k in pair}
