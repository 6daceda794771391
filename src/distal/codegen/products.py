"""C of products: dense, with one sparse factor, of rank one, and of two vectors."""

from __future__ import annotations

import casadi as ca

from distal.codegen.memory import Value
from distal.codegen.operations import CodeError
from distal.codegen.workspace import Step, Workspace

UNROLLED_PRODUCT = 8
"""A sparse factor of at most so many numbers is written number by number."""


def product(work: Workspace, step: Step) -> list[str]:
    """Write z + x y, dense or with one sparse factor.

    Args:
        work: the function.
        step: the instruction.

    Raises:
        CodeError: z is sparse, or both x and y are.
    """
    z, x, y = (step.node.dep(i) for i in range(3))
    if not z.is_dense():
        raise CodeError("a sparse product has no C here")
    if not x.is_dense() and not y.is_dense():
        raise CodeError("the product of two sparse matrices has no C here")
    rows, inner, columns = x.size1(), x.size2(), y.size2()
    if x.is_dense() and y.is_dense():
        work.cost.operations += 2 * rows * inner * columns
        return _dense(work, step, rows, inner, columns)
    if y.is_dense():
        at = _triplets(x.sparsity())
        work.cost.operations += 2 * len(at[0]) * columns
        return _sparse_left(work, step, (rows, inner, columns), *at)
    at = _triplets(y.sparsity())
    work.cost.operations += 2 * len(at[0]) * rows
    if len(at[0]) <= UNROLLED_PRODUCT:
        return _sparse_right_unrolled(work, step, rows, columns, list(zip(*at)))
    return _sparse_right(work, step, rows, columns, *at)


def rank_one(work: Workspace, step: Step) -> list[str]:
    """Write A + α x yᵀ.

    Args:
        work: the function.
        step: the instruction.
    """
    _, alpha, x, y = step.inputs
    rows, columns, at = step.node.size1(), step.node.size2(), work.memory.at
    work.cost.operations += 2 * rows * columns
    to, lines = work.placement.over_the_first(step.k)
    if alpha.home is None and alpha.numbers[0] == -1.0:
        change = f"-= {at(x, 'i')} * {at(y, 'j')}"
    else:
        change = f"+= {at(alpha, 0)} * {at(x, 'i')} * {at(y, 'j')}"
    return [
        *lines,
        f"  for (j = 0; j < {columns}; ++j) for (i = 0; i < {rows}; ++i) {at(to, f'i + {rows} * j')} {change};",
    ]


def dot(work: Workspace, step: Step) -> list[str]:
    """Write the sum of products of two values' numbers.

    Args:
        work: the function.
        step: the instruction.
    """
    x, y = step.inputs
    at, dialect = work.memory.at, work.memory.dialect
    work.cost.operations += 2 * x.size
    to = work.placement.new(step.k, step.makes[0], 1)
    total = f"s += {at(x, 'i')} * {at(y, 'i')};"
    start = f"{dialect.type} s = {dialect.constant(0.0)};"
    return [f"  {{ {start} for (i = 0; i < {x.size}; ++i) {total} {at(to, 0)} = s; }}"]


def _dense(work: Workspace, step: Step, rows: int, inner: int, columns: int) -> list[str]:
    """z + x y, both dense: each number of the result is one sum."""
    _, x, y = step.inputs
    at, dialect = work.memory.at, work.memory.dialect
    to, lines, zero = _begun(work, step)
    start = dialect.constant(0.0) if zero else at(to, f"i + {rows} * j")
    total = (
        f"{dialect.type} s = {start}; for (k = 0; k < {inner}; ++k) "
        f"s += {at(x, f'i + {rows} * k')} * {at(y, f'k + {inner} * j')}; "
        f"{at(to, f'i + {rows} * j')} = s;"
    )
    return [*lines, f"  for (j = 0; j < {columns}; ++j) for (i = 0; i < {rows}; ++i) {{ {total} }}"]


def _sparse_left(
    work: Workspace, step: Step, sizes: tuple[int, int, int], row: list[int], column: list[int]
) -> list[str]:
    """z + x y with a sparse x, (rows, inner) times (inner, columns): each of its numbers goes with a row of y."""
    (rows, inner, columns), (_, x, y) = sizes, step.inputs
    at, tables = work.memory.at, work.memory.tables
    to, lines = work.placement.over_the_first(step.k)
    where = at(y, f"{tables.indices(column)}[k]" + (f" + {inner} * j" if columns > 1 else ""))
    below = f" + {rows} * j" if columns > 1 else ""
    target = at(to, f"{tables.indices(row)}[k]{below}" if rows > 1 else ("j" if columns > 1 else 0))
    loop = f"for (j = 0; j < {columns}; ++j) " if columns > 1 else ""
    return [*lines, f"  {loop}for (k = 0; k < {len(row)}; ++k) {target} += {at(x, 'k')} * {where};"]


def _sparse_right(work: Workspace, step: Step, rows: int, columns: int, row: list[int], column: list[int]) -> list[str]:
    """z + x y with a sparse y: each of its numbers goes with a column of x."""
    _, x, y = step.inputs
    at, tables = work.memory.at, work.memory.tables
    to, lines = work.placement.over_the_first(step.k)
    target = at(to, f"i + {rows} * {tables.indices(column)}[k]" if columns > 1 else "i")
    where = at(x, f"i + {rows} * {tables.indices(row)}[k]")
    loop = f"for (k = 0; k < {len(row)}; ++k) for (i = 0; i < {rows}; ++i)"
    return [*lines, f"  {loop} {target} += {where} * {at(y, 'k')};"]


def _sparse_right_unrolled(
    work: Workspace, step: Step, rows: int, columns: int, entries: list[tuple[int, int]]
) -> list[str]:
    """z + x y with few numbers in y: each column of the result as one sum of columns of x."""
    _, x, y = step.inputs
    at = work.memory.at
    to, lines, zero = _begun(work, step)
    for column in range(columns):
        target = at(to, _sum("i", rows * column))
        terms = [
            f"{at(x, _sum('i', rows * row))} * {at(y, number)}"
            for number, (row, there) in enumerate(entries)
            if there == column
        ]
        start = [] if zero else [target]
        if terms or zero:
            total = " + ".join([*start, *terms]) or work.memory.dialect.constant(0.0)
            lines.append(f"  for (i = 0; i < {rows}; ++i) {target} = {total};")
    return lines


def _begun(work: Workspace, step: Step) -> tuple[Value, list[str], bool]:
    """Return where a sum goes, the lines that let it begin as z, and whether z is zero and needs none."""
    base = step.inputs[0]
    if base.is_zero:
        return work.placement.new(step.k, step.makes[0], base.size), [], True
    return *work.placement.over_the_first(step.k), False


def _sum(index: str, offset: int) -> str:
    return f"{index} + {offset}" if offset else index


def _triplets(sparsity: ca.Sparsity) -> tuple[list[int], list[int]]:
    """Return rows and columns of a sparse matrix's numbers, in their order."""
    rows, columns = sparsity.get_triplet()
    return [int(i) for i in rows], [int(i) for i in columns]
