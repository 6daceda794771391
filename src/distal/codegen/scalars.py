"""C of a function of scalars (SX): straight lines with one constant of C for each result, which the
compiler optimises.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from distal.codegen.number_types import Dialect
from distal.codegen.operations import BINARY, CALLED, INLINE, CodeError
from distal.codegen.workspace import Cost, Written, framed


def write_scalars(
    function: ca.Function,
    name: str,
    in_place: bool,
    dialect: Dialect,
    written: Callable[[ca.Function], Written],
) -> Written:
    """Return a function of scalars (SX) as C. The functions that it calls are written by `written`.

    With `in_place` the first input and the first output are one array, ``state``: it is read into
    constants first and written at the end.
    """
    arrays: dict[tuple[str, ...], str] = {}
    lines = list[str]()
    new_state = list[str]()
    names = dict[int, str]()
    cost = Cost()
    pairs = _sines_and_cosines(function) if dialect.pairs_sines else {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs = function.instruction_input(k)
        outputs = function.instruction_output(k)
        if operation == ca.OP_INPUT and in_place and inputs[0] == 0:
            lines.append(f"  const {dialect.type} v{k} = state[{inputs[1]}];")
            names[outputs[0]] = f"v{k}"
        elif operation == ca.OP_INPUT:
            names[outputs[0]] = f"a{inputs[0]}[{inputs[1]}]"
        elif operation == ca.OP_OUTPUT and in_place and outputs[0] == 0:
            new_state.append(f"  state[{outputs[1]}] = {names[inputs[0]]};")
        elif operation == ca.OP_OUTPUT:
            lines.append(f"  r{outputs[0]}[{outputs[1]}] = {names[inputs[0]]};")
        elif operation == ca.OP_CALL:
            called = _called(function, len(inputs), len(outputs))
            callee = written(called)
            lines += _call(k, callee.name, called, [names[i] for i in inputs], arrays, dialect.type)
            results = [
                f"v{k}_{i}[{j}]" for i in range(called.n_out()) for j in range(called.nnz_out(i))
            ]
            names.update(zip(outputs, results))
            cost.add(callee.cost)
        elif operation == ca.OP_CONST:
            names[outputs[0]] = dialect.constant(function.instruction_constant(k))
        else:
            cost.operations += 1
            if operation in CALLED and operation not in INLINE:
                cost.library[CALLED[operation]] += 1
            operands = [names[i] for i in inputs] if operation in BINARY else [names[inputs[0]]]
            if k not in pairs:
                lines.append(
                    f"  const {dialect.type} v{k} = {dialect.operation(operation, *operands)};"
                )
            elif k == min(pairs[k]):
                sine, cosine = pairs[k]
                lines.append(
                    f"  {dialect.type} v{sine}, v{cosine}; v_sincos({operands[0]}, &v{sine}, "
                    f"&v{cosine});"
                )
            names[outputs[0]] = f"v{k}"
    return Written(name, framed(function, name, in_place, dialect, [], [*lines, *new_state]), cost)


def _called(function: ca.Function, n_in: int, n_out: int) -> ca.Function:
    """Return the function that an instruction calls. CasADi does not say which one it is, so it is
    found by its numbers of inputs and outputs.
    """
    fitting = [
        called
        for called in function.find_functions()
        if (called.nnz_in(), called.nnz_out()) == (n_in, n_out)
    ]
    if len(fitting) != 1:
        raise CodeError(
            f"'{function.name()}' calls functions of one shape, which cannot be told apart"
        )
    return fitting[0]


def _call(
    k: int,
    name: str,
    called: ca.Function,
    operands: list[str],
    arrays: dict[tuple[str, ...], str],
    kind: str,
) -> list[str]:
    """Write a call. Its operands are gathered in arrays, which later calls with the same operands
    use again.
    """
    lines = list[str]()
    addresses = list[str]()
    first = 0
    for i in range(called.n_in()):
        gathered = tuple(operands[first : first + called.nnz_in(i)])
        first += len(gathered)
        if gathered not in arrays:
            arrays[gathered] = f"c{k}_{i}"
            lines.append(f"  const {kind} c{k}_{i}[] = {{{', '.join(gathered)}}};")
        addresses.append(arrays[gathered])
    for i in range(called.n_out()):
        size = called.nnz_out(i)
        lines.append(f"  {kind} v{k}_{i}[{size}];")
        arrays[tuple(f"v{k}_{i}[{j}]" for j in range(size))] = f"v{k}_{i}"
        addresses.append(f"v{k}_{i}")
    return [*lines, f"  {name}({', '.join(addresses)});"]


def _sines_and_cosines(function: ca.Function) -> dict[int, tuple[int, int]]:
    """Return instruction → (sine, cosine) for each angle of which both are needed: C has one
    function for the pair.
    """
    slots: dict[int, tuple[int, int]] = {}
    by_angle: dict[tuple[int, int], dict[int, int]] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        outputs = function.instruction_output(k)
        if operation in (ca.OP_SIN, ca.OP_COS):
            by_angle.setdefault(slots[function.instruction_input(k)[0]], {})[operation] = k
        if operation != ca.OP_OUTPUT:
            slots.update((slot, (k, i)) for i, slot in enumerate(outputs))
    pairs = [(calls[ca.OP_SIN], calls[ca.OP_COS]) for calls in by_angle.values() if len(calls) == 2]
    return {k: pair for pair in pairs for k in pair}
