"""C of instructions that move numbers without changing them: inputs, constants, changes of shape,
slices, and joined pieces.

A run of neighbouring numbers is a view and needs no C at all; only scattered numbers are copied.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from distal.codegen.memory import Value, for_each
from distal.codegen.number_types import CodeError
from distal.codegen.workspace import Step, Workspace


def argument(work: Workspace, step: Step) -> list[str]:
    """Let an argument, or a part of it, be a view of where the caller has it."""
    part = step.node.info()
    home = "state" if work.in_place and part["ind"] == 0 else f"a{part['ind']}"
    return _seen(work, step, Value(home, int(part["offset"]), int(step.node.nnz())))


def constant(work: Workspace, step: Step) -> list[str]:
    """Keep constants until they are used: they are then written as literals, or in a table."""
    ids = tuple(float(x) for x in step.node.to_DM().nonzeros())
    return _seen(work, step, Value(None, 0, len(ids), ids=ids))


def shape(work: Workspace, step: Step) -> list[str]:
    """Let a value in another shape be a view of the same numbers."""
    return _seen(work, step, step.inputs[0])


def transpose(work: Workspace, step: Step) -> list[str]:
    """Write the transpose of a dense matrix; that of a row or a column is a view."""
    (value,) = step.inputs
    node = step.node
    rows = node.size1()
    columns = node.size2()
    if rows == 1 or columns == 1:
        return _seen(work, step, value)
    if not node.is_dense():
        raise CodeError("a transposed sparse matrix has no C here")
    to = work.placement.new(step.k, step.makes[0], value.size)
    at = work.memory.at
    return [
        f"  for (i = 0; i < {rows}; ++i) for (j = 0; j < {columns}; ++j) "
        f"{at(to, f'i + {rows} * j')} = {at(value, f'j + {columns} * i')};"
    ]


def get(work: Workspace, step: Step) -> list[str]:
    """Write a slice: neighbouring numbers are a view, scattered ones are gathered."""
    value = step.inputs[0]
    at = _mapping(step)
    memory = work.memory
    if len(at) <= 1 or _even(at) == 1:
        return _seen(work, step, value.part(at[0] if at else 0, len(at)))
    to = work.placement.new(step.k, step.makes[0], len(at))
    source = _index(work, at)
    return for_each(len(at), lambda i: f"{memory.at(to, i)} = {memory.at(value, source(i))};")


def put(work: Workspace, step: Step) -> list[str]:
    """Write the numbers of one value into a slice of another, or add them to it."""
    values = step.inputs[1]
    at = _mapping(step)
    memory = work.memory
    adds = step.operation == ca.OP_ADDNONZEROS
    sign = "+=" if adds else "="
    work.cost.operations += len(at) if adds else 0
    to, lines = work.placement.over_the_first(step.k)
    target = _index(work, at)
    return lines + for_each(
        len(at), lambda i: f"{memory.at(to, target(i))} {sign} {memory.at(values, i)};"
    )


def join(work: Workspace, step: Step) -> list[str]:
    """Write values one after the other: matrices side by side, or columns on top of each other."""
    if step.node.size2() > 1 and step.operation == ca.OP_VERTCAT:
        raise CodeError("matrices on top of each other have no C here")
    to = work.placement.new(step.k, step.makes[0], int(step.node.nnz()))
    lines = list[str]()
    offset = 0
    for value in step.inputs:
        lines += work.memory.copy(to.part(offset, value.size), value)
        offset += value.size
    return lines


def split(work: Workspace, step: Step) -> list[str]:
    """Let pieces of a value, one after the other, be views of it."""
    if step.operation == ca.OP_VERTSPLIT and step.node.dep(0).size2() > 1:
        raise CodeError("matrices on top of each other have no C here")
    offset = 0
    node = step.node
    for i, number in enumerate(step.makes):
        size = int(node.get_output(i).nnz())
        work.placement.view(step.k, number, step.inputs[0].part(offset, size))
        offset += size
    return []


def _seen(work: Workspace, step: Step, value: Value) -> list[str]:
    """Let the result be a view, which takes no lines of C."""
    work.placement.view(step.k, step.makes[0], value)
    return []


def _mapping(step: Step) -> list[int]:
    """Return the indices of a slice."""
    at = [int(i) for i in step.node.mapping().nonzeros()]
    if at and min(at) < 0:
        raise CodeError("a slice with structural zeros has no C here")
    return at


def _index(work: Workspace, at: list[int]) -> Callable[[str | int], str | int]:
    """Return the function from a number's position in a slice to its index in the sliced value, an
    integer or C.
    """
    step = _even(at)

    def index(i: str | int) -> str | int:
        if isinstance(i, int):
            return at[i]
        return (
            f"{at[0]} + {step} * {i}"
            if step is not None
            else f"{work.memory.tables.indices(at)}[{i}]"
        )

    return index


def _even(at: list[int]) -> int | None:
    """Return the step between indices, or None where it changes."""
    steps = set(np.diff(at))
    return int(steps.pop()) if len(steps) == 1 else (1 if not steps else None)
