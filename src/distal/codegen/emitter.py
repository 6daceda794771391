"""Functions as C, each written once and after those that it calls: of matrices (MX), see
``instructions``, or of scalars (SX), whose operations are lines; and the definition of a function
around its lines.
"""

from __future__ import annotations

import re
from collections.abc import Container
from dataclasses import dataclass
from itertools import chain, count, islice

import casadi as ca

from distal.codegen.instructions import WRITERS as WRITERS
from distal.codegen.instructions import Body, WriteFunction, write_matrices
from distal.codegen.operations_and_number_types import CodeError, Dialect


@dataclass(frozen=True)
class Written:
    """A function as C.

    Args:
        text: its definition.
        scratch: how many numbers its array for intermediates has.
    """

    text: str
    scratch: int


class Emitter:
    """Writes CasADi functions as static C functions. Each function is written once, and functions
    with the same text share one.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.functions: dict[str, Written] = {}
        self._names: dict[tuple[int, bool], str] = {}
        self._taken: set[str] = set()
        self._alike: dict[str, str] = {}
        self._alive: list[
            ca.Function
        ] = []  # a function's hash is its address: no other function may get it

    @property
    def text(self) -> str:
        """All functions written so far, each after those that it calls."""
        return "\n".join(written.text for written in self.functions.values())

    def add(self, function: ca.Function, in_place: bool = False) -> str:
        """Write a function, of scalars (SX) or of matrices (MX), and those that it calls; return
        its name in C.

        With `in_place` the first input and the first output are one array, ``state``, which the
        function changes.

        Raises:
            CodeError: the function has an operation that has no C here, or its state cannot be
                changed in place.
        """
        key = (function.__hash__(), in_place)
        if key in self._names:
            return self._names[key]
        if in_place and function.sparsity_in(0) != function.sparsity_out(0):
            raise CodeError(
                f"'{function.name()}' has no C in place: its first input and output differ in shape"
            )
        name = unused(str(function.name()), self._taken)
        self._taken.add(name)
        write = write_scalars if function.is_a("SXFunction") else write_matrices
        body = write(function, in_place, self.dialect, self.add)
        text = framed(function, in_place, self.dialect, body)
        self._alive.append(function)
        # components of a rig that are built alike share one function, called with the parameters
        # of each
        alike = self._names[key] = self._alike.setdefault(text, name)
        if alike == name:
            self.functions[name] = Written(f"static void {name}{text}", body.scratch)
        else:
            self._taken.remove(name)
        return alike


def framed(function: ca.Function, in_place: bool, dialect: Dialect, body: Body) -> str:
    """Return the definition of a function in C, from behind its name on: arguments, arrays, loop
    variables and lines.

    Inputs become ``a0`` …, outputs ``r0`` …. With `in_place` the first input and the first output
    are one array, ``state``.
    """
    kind = f"{dialect.type}* restrict"
    skip = int(in_place)
    inputs = [f"a{i}" for i in range(skip, function.n_in())]
    outputs = [f"r{i}" for i in range(skip, function.n_out())]
    arguments = [f"{kind} state"] * in_place
    arguments += [f"const {kind} {argument}" for argument in inputs]
    arguments += [f"{kind} {argument}" for argument in outputs]
    text = "\n".join(body.lines)
    loops = [f"  int {variable};" for variable in "ijk" if f"for ({variable} = 0" in text]
    idle = [
        f"  (void){argument};"
        for argument in (*inputs, *outputs)
        if not re.search(rf"\b{argument}\b", text)
    ]
    return "\n".join(
        [f"({', '.join(arguments)}) {{", *body.arrays, *loops, *idle, *body.lines, "}\n"]
    )


def unused(name: str, taken: Container[str]) -> str:
    """Return a name with a number behind it where it is taken, from 2 on."""
    candidates = chain([name], (f"{name}_{number}" for number in count(2)))
    return next(candidate for candidate in candidates if candidate not in taken)


def write_scalars(
    function: ca.Function, in_place: bool, dialect: Dialect, written: WriteFunction
) -> Body:
    """Return what a function of scalars (SX) does. The functions that it calls are written by
    `written`.

    With `in_place` the first input and the first output are one array, ``state``: it is read into
    constants first and written at the end.
    """
    arrays: dict[tuple[str, ...], str] = {}
    lines = list[str]()
    new_state = list[str]()
    names = dict[int, str]()
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
            operands = [names[i] for i in inputs]
            call, results = _call(k, called, written(called, False), operands, arrays, dialect.type)
            lines += call
            names.update(zip(outputs, results))
        elif operation == ca.OP_CONST:
            names[outputs[0]] = dialect.constant(function.instruction_constant(k))
        else:
            value = dialect.operation(operation, *(names[i] for i in inputs))
            lines.append(f"  const {dialect.type} v{k} = {value};")
            names[outputs[0]] = f"v{k}"
    return Body([*lines, *new_state], [])


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
    called: ca.Function,
    name: str,
    operands: list[str],
    arrays: dict[tuple[str, ...], str],
    kind: str,
) -> tuple[list[str], list[str]]:
    """Return the C of a call, and that of its results. Its operands are gathered in arrays, which
    later calls with the same operands use again.
    """
    lines = list[str]()
    addresses = list[str]()
    results = list[str]()
    coming = iter(operands)
    for i in range(called.n_in()):
        gathered = tuple(islice(coming, called.nnz_in(i)))
        if gathered not in arrays:
            arrays[gathered] = f"c{k}_{i}"
            lines.append(f"  const {kind} c{k}_{i}[] = {{{', '.join(gathered)}}};")
        addresses.append(arrays[gathered])
    for i in range(called.n_out()):
        outputs = tuple(f"v{k}_{i}[{j}]" for j in range(called.nnz_out(i)))
        lines.append(f"  {kind} v{k}_{i}[{len(outputs)}];")
        arrays[outputs] = f"v{k}_{i}"
        addresses.append(arrays[outputs])
        results += outputs
    return [*lines, f"  {name}({', '.join(addresses)});"], results
