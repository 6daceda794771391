"""C of the instructions of a function of matrices, by one writer each: slices, joins and shapes of
values, most of which are views; and products: dense, with one sparse factor, of rank one, and of
two vectors.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import casadi as ca
import numpy as np

from distal.codegen.number_types import CodeError
from distal.codegen.workspace import Step, Value, Workspace, for_each, shifted


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
    sign = "+=" if step.operation == ca.OP_ADDNONZEROS else "="
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


COLUMNS_TOGETHER = 4
"""Number of columns of a dense product that are summed together, so that each number of the left
factor is read once for all of them. Source: judgement.
"""

LARGEST_INLINE = 200
"""Largest number of multiplications of a product that is written where it stands; a larger one is a
function of its own. Source: judgement.
"""

PRODUCT = "product"
"""Name of the functions of large products."""

UNROLLED_TERMS = 12
"""Largest number of terms of a sum, and of nonzeros of a sparse right factor, that are written one
by one instead of as a loop. Source: judgement.
"""


def product(work: Workspace, step: Step) -> list[str]:
    """Write z + x y, with both factors dense or one of them sparse."""
    z, x, y = (step.node.dep(i) for i in range(3))
    if not z.is_dense():
        raise CodeError("a sparse product has no C here")
    if not x.is_dense() and not y.is_dense():
        raise CodeError("the product of two sparse matrices has no C here")
    rows = x.size1()
    inner = x.size2()
    columns = y.size2()
    multiplications = min(int(x.nnz()) * columns, rows * int(y.nnz()))
    if multiplications > LARGEST_INLINE and work.flow.function.name() != PRODUCT:
        return _called(
            work, step, _product(*(tuple(factor.sparsity().compress()) for factor in (x, y)))
        )
    if x.is_dense() and y.is_dense():
        return _dense(work, step, rows, inner, columns)
    if y.is_dense():
        at = x.sparsity().get_triplet()
        return _sparse_left(work, step, (rows, inner, columns), *at)
    at = y.sparsity().get_triplet()
    if len(at[0]) <= UNROLLED_TERMS:
        return _sparse_right_unrolled(work, step, rows, columns, list(zip(*at)))
    return _sparse_right(work, step, rows, columns, *at)


@lru_cache(maxsize=1024)
def _product(left: tuple[int, ...], right: tuple[int, ...]) -> ca.Function:
    """Return (z, x, y) → z + x y, once for each pair of sparsities, which are given as CasADi
    compresses them.
    """
    x, y = (
        ca.MX.sym(name, ca.Sparsity.compressed(sparsity))
        for name, sparsity in (("x", left), ("y", right))
    )
    z = ca.MX.sym("z", x.size1(), y.size2())
    return ca.Function(PRODUCT, [z, x, y], [ca.mac(x, y, z)])


def _called(work: Workspace, step: Step, function: ca.Function) -> list[str]:
    """Write z + x y as a call of a function of its own. C knows that arguments do not overlap,
    which it does not know of parts of scratch.
    """
    written = work.written(function, True)
    to, lines = work.placement.over_the_first(step.k)
    addresses = ", ".join(work.memory.address(value) for value in (to, *step.inputs[1:]))
    return [*lines, f"  {written.name}({addresses});"]


def rank_one(work: Workspace, step: Step) -> list[str]:
    """Write A + α x yᵀ."""
    _, alpha, x, y = step.inputs
    rows = step.node.size1()
    columns = step.node.size2()
    at = work.memory.at
    to, lines = work.placement.over_the_first(step.k)
    sign = "-=" if alpha.home is None and alpha.ids[0] == -1.0 else f"+= {at(alpha, 0)} *"
    loops = f"for (j = 0; j < {columns}; ++j) for (i = 0; i < {rows}; ++i)"
    return [*lines, f"  {loops} {at(to, f'i + {rows} * j')} {sign} {at(x, 'i')} * {at(y, 'j')};"]


def dot(work: Workspace, step: Step) -> list[str]:
    """Write the dot product of two values."""
    x, y = step.inputs
    at = work.memory.at
    dialect = work.memory.dialect
    to = work.placement.new(step.k, step.makes[0], 1)
    total = f"s += {at(x, 'i')} * {at(y, 'i')};"
    start = f"{dialect.type} s = {dialect.constant(0.0)};"
    return [f"  {{ {start} for (i = 0; i < {x.size}; ++i) {total} {at(to, 0)} = s; }}"]


def _dense(work: Workspace, step: Step, rows: int, inner: int, columns: int) -> list[str]:
    """Write z + x y, both dense. Each number of the result is one sum; a few columns are summed
    together.
    """
    _, x, y = step.inputs
    memory = work.memory
    to, lines, zero = _begun(work, step)
    kind = memory.dialect.type
    at = memory.at
    for first, end in _ranges(columns):
        together = range(min(COLUMNS_TOGETHER, end - first))
        positions = [at(to, shifted("i", rows * (first + c)) + f" + {rows} * j") for c in together]
        starts = [memory.dialect.constant(0.0) if zero else position for position in positions]
        sums = ", ".join(f"s{c} = {start}" for c, start in enumerate(starts))
        short = inner <= UNROLLED_TERMS
        terms = []
        for k in map(str, range(inner)) if short else ["k"]:
            left = at(x, shifted("i", rows * int(k)) if short else f"i + {rows} * k")
            right = [at(y, shifted(k, inner * (first + c)) + f" + {inner} * j") for c in together]
            added = " ".join(f"s{c} += e * {factor};" for c, factor in enumerate(right))
            terms.append(f"{{ const {kind} e = {left}; {added} }}")
        total = " ".join(terms) if short else f"for (k = 0; k < {inner}; ++k) {terms[0]}"
        ends = " ".join(f"{position} = s{c};" for c, position in enumerate(positions))
        lines.append(
            f"  for (j = 0; j < {end - first}; j += {len(together)}) for (i = 0; i < {rows}; ++i) "
            f"{{ {kind} {sums}; "
            f"{total} {ends} }}"
        )
    return lines


def _ranges(columns: int) -> list[tuple[int, int]]:
    """Return the columns that are summed a few together, and those that are left."""
    together = columns - columns % min(COLUMNS_TOGETHER, columns)
    return [(0, together)] + ([(together, columns)] if together < columns else [])


def _sparse_left(
    work: Workspace, step: Step, sizes: tuple[int, int, int], row: list[int], column: list[int]
) -> list[str]:
    """Write z + x y with a sparse x, (rows, inner) times (inner, columns): each nonzero of x is
    multiplied by a row of y.
    """
    rows, inner, columns = sizes
    _, x, y = step.inputs
    at = work.memory.at
    tables = work.memory.tables
    to, lines = work.placement.over_the_first(step.k)
    where = at(y, f"{tables.indices(column)}[k]" + (f" + {inner} * j" if columns > 1 else ""))
    below = f" + {rows} * j" if columns > 1 else ""
    target = at(to, f"{tables.indices(row)}[k]{below}" if rows > 1 else ("j" if columns > 1 else 0))
    loop = f"for (j = 0; j < {columns}; ++j) " if columns > 1 else ""
    return [*lines, f"  {loop}for (k = 0; k < {len(row)}; ++k) {target} += {at(x, 'k')} * {where};"]


def _sparse_right(
    work: Workspace, step: Step, rows: int, columns: int, row: list[int], column: list[int]
) -> list[str]:
    """Write z + x y with a sparse y: each nonzero of y is multiplied by a column of x."""
    _, x, y = step.inputs
    at = work.memory.at
    tables = work.memory.tables
    to, lines = work.placement.over_the_first(step.k)
    target = at(to, f"i + {rows} * {tables.indices(column)}[k]" if columns > 1 else "i")
    where = at(x, f"i + {rows} * {tables.indices(row)}[k]")
    loop = f"for (k = 0; k < {len(row)}; ++k) for (i = 0; i < {rows}; ++i)"
    return [*lines, f"  {loop} {target} += {where} * {at(y, 'k')};"]


def _sparse_right_unrolled(
    work: Workspace, step: Step, rows: int, columns: int, entries: list[tuple[int, int]]
) -> list[str]:
    """Write z + x y with few nonzeros in y: each column of the result is one sum of columns of
    x.
    """
    _, x, y = step.inputs
    at = work.memory.at
    to, lines, zero = _begun(work, step)
    for column in range(columns):
        target = at(to, shifted("i", rows * column))
        terms = [
            f"{at(x, shifted('i', rows * row))} * {at(y, number)}"
            for number, (row, position) in enumerate(entries)
            if position == column
        ]
        if terms or zero:
            total = " + ".join(
                [*([] if zero else [target]), *terms]
            ) or work.memory.dialect.constant(0.0)
            lines.append(f"  for (i = 0; i < {rows}; ++i) {target} = {total};")
    return lines


def _begun(work: Workspace, step: Step) -> tuple[Value, list[str], bool]:
    """Return the position of a sum, the lines of C that let it begin as z, and whether z is zero,
    so that there are no such lines.
    """
    base = step.inputs[0]
    if base.is_zero:
        return work.placement.new(step.k, step.makes[0], base.size), [], True
    return *work.placement.over_the_first(step.k), False
