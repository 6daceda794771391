"""C of a function of matrices (MX): its instructions, each by its writer, then its outputs. Scratch
is laid out at the end.

C of operations that are done element by element; an operand of one number is used for all
elements.

C of calls: a result that is nothing but an output of the caller is written straight into that
output, every other one into scratch.
"""

from __future__ import annotations

import casadi as ca

from distal.codegen.memory import Memory, Value, for_each
from distal.codegen.number_types import Dialect
from distal.codegen.operations import BINARY
from distal.codegen.placement import Dataflow, Placement
from distal.codegen.products import dot, product, rank_one
from distal.codegen.slices import argument, constant, get, join, put, shape, split, transpose
from distal.codegen.workspace import Step, Workspace, WriteFunction, Writer, Written, framed


def elementwise(work: Workspace, step: Step) -> list[str]:
    """Write an operation of scalars for each element of its operands."""
    n = int(step.node.nnz())
    work.cost.operations += n
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
    work.cost.add(written.cost)
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
    return Written(name, text, work.cost, size)


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
