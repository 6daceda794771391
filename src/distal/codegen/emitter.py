"""Functions as C, each written once and after those that it calls: of matrices (MX), whose
instructions are written one by one, each by its writer, or of scalars (SX), whose operations are
lines.

Scratch of a function of matrices is laid out at the end. Of a call, a result that is nothing but an
output of the caller is written straight into that output, every other one into scratch.
"""

from __future__ import annotations

from collections.abc import Container
from itertools import chain, count

import casadi as ca

from distal.codegen.number_types import BINARY, CodeError, Dialect
from distal.codegen.writers import (
    Dataflow,
    Memory,
    Placement,
    Step,
    Value,
    Workspace,
    WriteFunction,
    Writer,
    Written,
    argument,
    constant,
    dot,
    for_each,
    framed,
    get,
    join,
    product,
    put,
    rank_one,
    shape,
    split,
    transpose,
)


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
        return self._written(function, in_place).name

    def _written(self, function: ca.Function, in_place: bool = False) -> Written:
        key = (function.__hash__(), in_place)
        if key in self._names:
            return self.functions[self._names[key]]
        if in_place and function.sparsity_in(0) != function.sparsity_out(0):
            raise CodeError(
                f"'{function.name()}' has no C in place: its first input and output differ in shape"
            )
        name = unused(str(function.name()), self._taken)
        self._taken.add(name)
        if function.is_a("SXFunction"):
            written = write_scalars(function, name, in_place, self.dialect, self._written)
        else:
            written = write_matrices(function, name, in_place, self.dialect, self._written)
        self._alive.append(function)
        # components of a rig that are built alike share one function, called with the parameters
        # of each
        alike = self._alike.setdefault(written.text.replace(f" {name}(", " (", 1), name)
        self._names[key] = alike
        if alike != name:
            self._taken.remove(name)
            return self.functions[alike]
        self.functions[name] = written
        return written


def unused(name: str, taken: Container[str]) -> str:
    """Return a name with a number behind it where it is taken, from 2 on."""
    candidates = chain([name], (f"{name}_{number}" for number in count(2)))
    return next(candidate for candidate in candidates if candidate not in taken)


def elementwise(work: Workspace, step: Step) -> list[str]:
    """Write an operation of scalars for each element of its operands."""
    n = int(step.node.nnz())
    to = work.placement.over_an_input(step.k, n)
    used = step.inputs if step.operation in BINARY else step.inputs[:1]
    memory = work.memory

    def line(index: str | int) -> str:
        operands = [memory.at(value, 0 if value.size == 1 else index) for value in used]
        return f"{memory.at(to, index)} = {memory.dialect.operation(step.operation, *operands)};"

    return for_each(n, line)


def call(work: Workspace, step: Step) -> list[str]:
    """Write the call of another function."""
    called = step.node.which_function()
    written = work.written(called, False)
    results = []
    for i, number in enumerate(step.makes):
        size = int(called.nnz_out(i))
        if number in work.flow.direct:
            output, offset = work.flow.direct[number]
            results.append(work.placement.put(number, Value(f"r{output}", offset, size)))
        else:
            results.append(work.placement.new(step.k, number, size))
    addresses = [work.memory.address(value) for value in (*step.inputs, *results)]
    return [f"  {written.name}({', '.join(addresses)});"]


WRITERS: dict[int, Writer] = {
    ca.OP_INPUT: argument,
    ca.OP_CONST: constant,
    ca.OP_CALL: call,
    ca.OP_RESHAPE: shape,
    ca.OP_TRANSPOSE: transpose,
    ca.OP_GETNONZEROS: get,
    ca.OP_SETNONZEROS: put,
    ca.OP_ADDNONZEROS: put,
    ca.OP_VERTCAT: join,
    ca.OP_HORZCAT: join,
    ca.OP_VERTSPLIT: split,
    ca.OP_HORZSPLIT: split,
    ca.OP_MTIMES: product,
    ca.OP_RANK1: rank_one,
    ca.OP_DOT: dot,
}
"""Writers of CasADi's operations on matrices. Every other operation is done element by element, or
has no C.
"""


def write_matrices(
    function: ca.Function, name: str, in_place: bool, dialect: Dialect, written: WriteFunction
) -> Written:
    """Return a function of matrices (MX) as C. The functions that it calls are written by
    `written`.
    """
    flow = Dataflow(function, in_place)
    memory = Memory(dialect)
    work = Workspace(flow, memory, Placement(flow, memory), written, in_place)
    lines = list[str]()
    state: list[tuple[Value, int]] = []
    for k, operation in enumerate(flow.operations):
        step = work.step(k)
        if operation != ca.OP_OUTPUT:
            lines += WRITERS.get(operation, elementwise)(work, step)
        elif step.inputs:
            output = step.node.info()
            (value,) = step.inputs
            home = f"r{output['ind']}"
            offset = int(output["offset"])
            if in_place and output["ind"] == 0:
                state.append((value, offset))
            elif value.home != home:  # a call has not put it there
                lines += memory.copy(Value(home, offset, value.size), value)
    lines = memory.scratch.settled(lines + _new_state(work, state))
    size = memory.scratch.size
    arrays = [f"  {dialect.type} w[{size}];"] if size else []
    text = framed(function, name, in_place, dialect, [*memory.tables.lines, *arrays], lines)
    return Written(name, text, size)


def _new_state(work: Workspace, state: list[tuple[Value, int]]) -> list[str]:
    """Write the new state: values that are in their position stay, values that lie elsewhere in the
    state go by way of scratch.
    """
    memory = work.memory
    end = work.flow.end
    lines = list[str]()
    moved = list[tuple[Value, int]]()
    for value, offset in state:
        if value.home == "state":
            if value.offset == offset:
                continue
            through = memory.scratch.new(value.size, end, end + 1)
            lines += memory.copy(through, value)
            value = through
        moved.append((value, offset))
    for value, offset in moved:
        lines += memory.copy(Value("state", offset, value.size), value)
    return lines


def write_scalars(
    function: ca.Function,
    name: str,
    in_place: bool,
    dialect: Dialect,
    written: WriteFunction,
) -> Written:
    """Return a function of scalars (SX) as C. The functions that it calls are written by `written`.

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
            callee = written(called, False)
            lines += _call(k, callee.name, called, [names[i] for i in inputs], arrays, dialect.type)
            results = [
                f"v{k}_{i}[{j}]" for i in range(called.n_out()) for j in range(called.nnz_out(i))
            ]
            names.update(zip(outputs, results))
        elif operation == ca.OP_CONST:
            names[outputs[0]] = dialect.constant(function.instruction_constant(k))
        else:
            operands = [names[i] for i in inputs] if operation in BINARY else [names[inputs[0]]]
            value = dialect.operation(operation, *operands)
            lines.append(f"  const {dialect.type} v{k} = {value};")
            names[outputs[0]] = f"v{k}"
    return Written(name, framed(function, name, in_place, dialect, [], [*lines, *new_state]))


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
