"""C of the instructions of a function of matrices, by one writer each: slices, joins and shapes;
products (dense, with one sparse factor, of rank one, of two vectors); and calls.

A `Value` is a run of neighbouring numbers: in an argument, in the state, in scratch, or a
constant. A result is a view of another value, or lies over an input that is no longer needed, or
in new scratch; one that is nothing but an output of the caller is written straight into that
output. `Scratch` is one array that all intermediates share. Its size and what lies where are known
only after the last instruction, so that positions in it are written as marks («…») at first, which
`Scratch.settled` replaces. CasADi's instructions use the slots of a work vector again and again.
Here each result has a number of its own that is never used again (static single assignment).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np

from distal.codegen.operations_and_number_types import CodeError, Dialect
from distal.expressions import MatrixNode

UNROLLED = 3
"""Largest number of elements for which a copy or an element-wise operation is written element by
element instead of as a loop. Source: judgement.
"""

INDEX = "unsigned short"
"""Type of the numbers in tables of indices."""

LARGEST_INDEX = 65_535
"""Largest index that `INDEX` holds. Source: definition (an unsigned short of 16 bits)."""

_MARK = re.compile(r"«(\d+):(\d+):([^»]*)»")
"""A position in scratch before it is laid out: block, offset, and the index of a number, without
which it is an address.
"""


@dataclass(frozen=True)
class Value:
    """A run of neighbouring numbers.

    Args:
        home: the array that holds them: ``a0``, ``r1`` … for arguments, ``state``, ``w`` for
            scratch; None for constants.
        offset: of the first number in its home; for scratch, within its own block. Of constants it
            says nothing.
        size: how many numbers.
        block: index of the block of scratch that holds them, -1 outside scratch.
        ids: the numbers themselves, if they are constants.
    """

    home: str | None
    offset: int
    size: int
    block: int = -1
    ids: tuple[float, ...] = ()

    def part(self, offset: int, size: int) -> Value:
        """Return `size` of the numbers from `offset` on, as a view."""
        ids = self.ids[offset : offset + size]
        return Value(self.home, self.offset + offset, size, self.block, ids)

    @property
    def is_zero(self) -> bool:
        """Whether all numbers are constants that are zero."""
        return self.home is None and not any(self.ids)

    @cached_property
    def is_uniform(self) -> bool:
        """Whether all numbers are constants that are the same; 0.0 and -0.0 differ."""
        return self.home is None and len({str(number) for number in self.ids}) == 1


@dataclass
class Block:
    """A piece of scratch: its size, the first and the last instruction that use it, and its
    position, which is -1 until it is known.
    """

    size: int
    first: int
    last: int
    at: int = -1


class Scratch:
    """One array for all intermediates. Blocks that are not in use at the same time may share a
    position.
    """

    def __init__(self) -> None:
        self.blocks: list[Block] = []
        self.size = 0

    def new(self, size: int, k: int) -> Value:
        """Return a new piece of scratch, in use at instruction `k`."""
        self.blocks.append(Block(size, k, k))
        return Value("w", 0, size, len(self.blocks) - 1)

    def keep(self, value: Value, until: int) -> None:
        """Let a value's block be in use at least until an instruction. Values outside scratch need
        nothing.
        """
        if value.block >= 0:
            block = self.blocks[value.block]
            block.last = max(block.last, until)

    def settled(self, lines: list[str]) -> list[str]:
        """Lay out the blocks, and return lines with their marks replaced; nothing can be added to
        scratch afterwards.
        """
        self._lay_out()
        return [_MARK.sub(self._settled, line) for line in lines]

    def _lay_out(self) -> None:
        """Place the blocks: first fit, the largest first."""
        placed: list[Block] = []
        for block in sorted(self.blocks, key=lambda b: (-b.size, b.first)):
            busy = sorted(
                (neighbour.at, neighbour.at + neighbour.size)
                for neighbour in placed
                if neighbour.first <= block.last and block.first <= neighbour.last
            )
            at = 0
            for low, high in busy:
                if at + block.size <= low:
                    break
                at = max(at, high)
            block.at = at
            placed.append(block)
        self.size = max((block.at + block.size for block in self.blocks), default=0)

    def _settled(self, mark: re.Match[str]) -> str:
        """Return a mark as C, now that the blocks are laid out."""
        block, offset, index = mark.groups()
        at = self.blocks[int(block)].at + int(offset)
        return _element("w", at, index) if index else shifted("w", at)


def shifted(base: str, offset: int) -> str:
    """Return C plus an offset."""
    return f"{base} + {offset}" if offset else base


def loop(variable: str, count: int) -> str:
    """Return the head of a loop in C whose variable counts from zero."""
    return f"for ({variable} = 0; {variable} < {count}; ++{variable})"


def _element(home: str, offset: int, index: str) -> str:
    """Return the C of a number that lies at an index, an integer or C, behind an offset."""
    if index.isdigit():
        return f"{home}[{offset + int(index)}]"
    return f"{home}[{offset} + {index}]" if offset else f"{home}[{index}]"


class Memory:
    """The lines of C of one function, and the C that reaches a value wherever it lies."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.lines = list[str]()
        self.scratch = Scratch()
        self._tables = dict[tuple[str, str], str]()

    @property
    def tables(self) -> list[str]:
        """The tables of constants and indices; equal tables are written once."""
        return [
            f"  static const {kind} {name}{body}" for (kind, body), name in self._tables.items()
        ]

    def _table(self, letter: str, kind: str, entries: list[str]) -> str:
        body = f"[{len(entries)}] = {{{', '.join(entries)}}};"
        return self._tables.setdefault((kind, body), f"{letter}{len(self._tables)}")

    def constants(self, ids: tuple[float, ...]) -> str:
        """Return the name of a table of constants."""
        return self._table("c", self.dialect.type, [self.dialect.entry(number) for number in ids])

    def indices(self, ids: list[int]) -> str:
        """Return the name of a table of indices.

        Raises:
            CodeError: an index is larger than `LARGEST_INDEX`.
        """
        if ids and max(ids) > LARGEST_INDEX:
            raise CodeError(
                f"an index of {max(ids)} does not fit into '{INDEX}'; matrices that large have no C"
            )
        return self._table("t", INDEX, [str(number) for number in ids])

    def address(self, value: Value) -> str:
        """Return the C of a value's address."""
        if value.size == 0:
            return "0"
        if value.home is None:
            return self.constants(value.ids)
        if value.home == "w":
            return f"«{value.block}:{value.offset}:»"
        return shifted(value.home, value.offset)

    def at(self, value: Value, index: str | int) -> str:
        """Return the C of one number of a value; its index is an integer or C."""
        if value.home is None:
            k = 0 if value.is_uniform else index
            if isinstance(k, int):
                return self.dialect.constant(value.ids[k])
            return f"{self.constants(value.ids)}[{k}]"
        if value.home == "w":
            return f"«{value.block}:{value.offset}:{index}»"
        return _element(value.home, value.offset, str(index))

    def write(self, line: str) -> None:
        """Write a line."""
        self.lines.append(f"  {line}")

    def for_each(self, size: int, line: Callable[[str | int], str]) -> None:
        """Write a line for each index below `size`: as a loop, or line by line if there are at most
        `UNROLLED`.
        """
        if size > UNROLLED:
            self.write(f"{loop('i', size)} {line('i')}")
        else:
            self.lines += [f"  {line(i)}" for i in range(size)]

    def copy(self, to: Value, value: Value) -> None:
        """Copy a value to another position."""
        self.for_each(value.size, lambda i: f"{self.at(to, i)} = {self.at(value, i)};")

    def call(self, name: str, arguments: list[Value]) -> None:
        """Call a function of C."""
        self.write(f"{name}({', '.join(map(self.address, arguments))});")


@dataclass(frozen=True)
class Body:
    """What a function in C does.

    Args:
        lines: of its body.
        arrays: declarations of the arrays that they need.
        scratch: how many numbers the array for intermediates has.
    """

    lines: list[str]
    arrays: list[str]
    scratch: int = 0


class Dataflow:
    """The values of one function of matrices (MX), by number.

    With `in_place` the first output is written where the first input stands, so that values that
    belong to an output must last until the end.
    """

    def __init__(self, function: ca.Function, in_place: bool) -> None:
        self.function = function
        self.in_place = in_place
        self.end = int(function.n_instructions())
        self.operations = [int(function.instruction_id(k)) for k in range(self.end)]
        self.reads: list[list[int]] = []
        self.makes: list[list[int]] = []
        self.readers: dict[int, list[int]] = {}
        self.parts: dict[int, tuple[int, int]] = {}
        """The begin and end of the part of its input that a slice reads; any other instruction
        reads all of it.
        """
        slots: dict[int, int] = {}
        first = 0
        for k, operation in enumerate(self.operations):
            inputs = function.instruction_input(k) if operation != ca.OP_INPUT else []
            outputs = function.instruction_output(k) if operation != ca.OP_OUTPUT else []
            self.reads.append([slots[slot] for slot in inputs if slot >= 0])
            self.makes.append([*range(first, first + len(outputs))])
            first += len(outputs)
            slots.update(zip(outputs, self.makes[k]))
            used_at = [k, self.end] if in_place and operation == ca.OP_OUTPUT else [k]
            for number in self.reads[k]:
                self.readers.setdefault(number, []).extend(used_at)
            if operation == ca.OP_GETNONZEROS:
                at = [int(i) for i in function.instruction_MX(k).mapping().nonzeros()]
                self.parts[k] = (min(at), max(at) + 1) if at else (0, 0)

    def last(self, number: int) -> int:
        """Return the last instruction that reads a value, or -1 if none does."""
        return max(self.readers.get(number, [-1]))

    def direct(self, number: int) -> tuple[str, int] | None:
        """Return the output that a value is, perhaps in another shape, and nothing else, and the
        offset in it.
        """
        readers = self.readers.get(number, [])
        if self.in_place or len(readers) != 1:
            return None
        (k,) = readers
        if self.operations[k] == ca.OP_RESHAPE:
            return self.direct(self.makes[k][0])
        if self.operations[k] != ca.OP_OUTPUT:
            return None
        output = self.function.instruction_MX(k).info()
        return f"r{output['ind']}", int(output["offset"])


WriteFunction = Callable[[ca.Function, bool], str]
"""Writes a function that has not been written yet and returns its name in C; the second argument
says whether its first input is changed in place.
"""


class Workspace(Memory):
    """One function of matrices while it is written as C, at one of its instructions.

    Args:
        written: writes the functions that it calls.

    Attributes:
        k: number of the instruction.
        operation: CasADi's number of its operation.
        node: CasADi's expression of it.
        inputs: the values that it reads.
        makes: the numbers of its results.
    """

    def __init__(self, flow: Dataflow, dialect: Dialect, written: WriteFunction) -> None:
        super().__init__(dialect)
        self.flow = flow
        self.written = written
        self._values: dict[int, Value] = {}
        self._beside: dict[tuple[str | None, int], list[int]] = {}

    def go_to(self, k: int) -> None:
        """Go to instruction `k`, the next one."""
        flow = self.flow
        self.k = k
        self.operation = flow.operations[k]
        self.node: MatrixNode = flow.function.instruction_MX(k)
        self.inputs = [self._values[number] for number in flow.reads[k]]
        self.makes = flow.makes[k]

    def outside(self, letter: str, size: int) -> Value:
        """Return where the caller has what the instruction reads or writes: in ``state``, or in an
        argument that begins with a letter.
        """
        part = self.node.info()
        home = "state" if self.flow.in_place and part["ind"] == 0 else f"{letter}{part['ind']}"
        return Value(home, int(part["offset"]), size)

    def view(self, value: Value, which: int = 0) -> Value:
        """Let a result be a view of another value, whose position is then in use as long as the
        view is; return that value.
        """
        number = self.makes[which]
        self._values[number] = value
        self._beside.setdefault((value.home, value.block), []).append(number)
        self.scratch.keep(value, self.flow.last(number))
        return value

    def new(self, size: int, which: int = 0) -> Value:
        """Return new scratch for a result."""
        return self.view(self.scratch.new(size, self.k), which)

    def over_an_input(self, size: int) -> Value:
        """Return the position of an element-wise result: over the first input of the same size that
        may be overwritten, else in new scratch.

        This is allowed because the instruction reads each element before it writes the same one.
        """
        for number, value in zip(self.flow.reads[self.k], self.inputs):
            if value.size == size and self._is_free(number):
                return self.view(value)
        return self.new(size)

    def over_the_first(self) -> Value:
        """Return the position of a result that changes the first input, and copy this input there
        first.

        If the first input may be overwritten, the result lies over it and there is no copy. The
        instruction may read any other input while it writes.
        """
        (over, *factors) = self.flow.reads[self.k]
        base = self.inputs[0]
        if over not in factors and self._is_free(over):
            return self.view(base)
        to = self.new(base.size)
        self.copy(to, base)
        return to

    def _is_free(self, number: int) -> bool:
        """Return whether the instruction may write over a value: no later one reads it, and neither
        this nor a later one reads another value that overlaps it.
        """
        value = self._values[number]
        flow = self.flow
        if value.home not in ("w", "state") or flow.last(number) > self.k:
            return False
        low = value.offset
        high = value.offset + value.size
        for neighbour in self._beside[value.home, value.block]:
            beside = self._values[neighbour]
            for reader in flow.readers.get(neighbour, []) if neighbour != number else []:
                if reader >= self.k:
                    begin, end = flow.parts.get(reader, (0, beside.size))
                    if beside.offset + begin < high and low < beside.offset + end:
                        return False
        return True


Writer = Callable[[Workspace], None]
"""Writes the instruction of a workspace; there are no lines if its result is only a view of another
value.
"""


def argument(work: Workspace) -> None:
    """Let an argument, or a part of it, be a view of where the caller has it."""
    work.view(work.outside("a", int(work.node.nnz())))


def constant(work: Workspace) -> None:
    """Keep constants until they are used: they are then written as literals, or in a table."""
    ids = tuple(float(x) for x in work.node.to_DM().nonzeros())
    work.view(Value(None, 0, len(ids), ids=ids))


def shape(work: Workspace) -> None:
    """Let a value in another shape be a view of the same numbers."""
    work.view(work.inputs[0])


def transpose(work: Workspace) -> None:
    """Write the transpose of a dense matrix; that of a row or a column is a view."""
    (value,) = work.inputs
    rows, columns = work.node.shape
    if rows == 1 or columns == 1:
        work.view(value)
    elif work.node.is_dense():
        to = work.at(work.new(value.size), f"i + {rows} * j")
        work.write(
            f"{loop('i', rows)} {loop('j', columns)} {to} = {work.at(value, f'j + {columns} * i')};"
        )
    else:
        raise CodeError("a transposed sparse matrix has no C here")


def get(work: Workspace) -> None:
    """Write a slice: neighbouring numbers are a view, scattered ones are gathered."""
    value = work.inputs[0]
    at = _mapping(work)
    if _even(at) == 1:
        work.view(value.part(at[0] if at else 0, len(at)))
    else:
        to = work.new(len(at))
        source = _index(work, at)
        work.for_each(len(at), lambda i: f"{work.at(to, i)} = {work.at(value, source(i))};")


def put(work: Workspace) -> None:
    """Write the numbers of one value into a slice of another, or add them to it."""
    values = work.inputs[1]
    at = _mapping(work)
    sign = "+=" if work.operation == ca.OP_ADDNONZEROS else "="
    to = work.over_the_first()
    target = _index(work, at)
    work.for_each(len(at), lambda i: f"{work.at(to, target(i))} {sign} {work.at(values, i)};")


def join(work: Workspace) -> None:
    """Write values one after the other: matrices side by side, or columns on top of each other."""
    if work.node.size2() > 1 and work.operation == ca.OP_VERTCAT:
        raise CodeError("matrices on top of each other have no C here")
    to = work.new(int(work.node.nnz()))
    offset = 0
    for value in work.inputs:
        work.copy(to.part(offset, value.size), value)
        offset += value.size


def split(work: Workspace) -> None:
    """Let pieces of a value, one after the other, be views of it."""
    if work.operation == ca.OP_VERTSPLIT and work.node.dep(0).size2() > 1:
        raise CodeError("matrices on top of each other have no C here")
    offset = 0
    for i in range(len(work.makes)):
        size = int(work.node.get_output(i).nnz())
        work.view(work.inputs[0].part(offset, size), i)
        offset += size


def _mapping(work: Workspace) -> list[int]:
    """Return the indices of a slice."""
    at = [int(i) for i in work.node.mapping().nonzeros()]
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
        return f"{work.indices(at)}[{i}]" if step is None else f"{at[0]} + {step} * {i}"

    return index


def _even(at: list[int]) -> int | None:
    """Return the step between indices, 1 where there are less than two, None where it changes."""
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


def product(work: Workspace) -> None:
    """Write z + x y, with both factors dense or one of them sparse."""
    z, x, y = (work.node.dep(i) for i in range(3))
    if not z.is_dense():
        raise CodeError("a sparse product has no C here")
    if not x.is_dense() and not y.is_dense():
        raise CodeError("the product of two sparse matrices has no C here")
    rows, inner = x.shape
    columns = y.size2()
    multiplications = min(int(x.nnz()) * columns, rows * int(y.nnz()))
    if multiplications > LARGEST_INLINE and work.flow.function.name() != PRODUCT:
        # C knows that arguments do not overlap, which it does not know of parts of scratch
        name = work.written(_product(*(tuple(part.sparsity().compress()) for part in (x, y))), True)
        work.call(name, [work.over_the_first(), *work.inputs[1:]])
    elif x.is_dense() and y.is_dense():
        _dense(work, rows, inner, columns)
    elif y.is_dense():
        _sparse_left(work, rows, inner, columns, *x.sparsity().get_triplet())
    else:
        is_short = y.nnz() <= UNROLLED_TERMS
        write = _sparse_right_unrolled if is_short else _sparse_right
        write(work, rows, columns, *y.sparsity().get_triplet())


@lru_cache(maxsize=1024)
def _product(left: tuple[int, ...], right: tuple[int, ...]) -> ca.Function:
    """Return (z, x, y) → z + x y, once for each pair of sparsities, which are given as CasADi
    compresses them.
    """
    x = ca.MX.sym("x", ca.Sparsity.compressed(left))
    y = ca.MX.sym("y", ca.Sparsity.compressed(right))
    z = ca.MX.sym("z", x.size1(), y.size2())
    return ca.Function(PRODUCT, [z, x, y], [ca.mac(x, y, z)])


def rank_one(work: Workspace) -> None:
    """Write A + α x yᵀ."""
    _, alpha, x, y = work.inputs
    rows, columns = work.node.shape
    to = work.at(work.over_the_first(), f"i + {rows} * j")
    sign = "-=" if alpha.home is None and alpha.ids[0] == -1.0 else f"+= {work.at(alpha, 0)} *"
    loops = f"{loop('j', columns)} {loop('i', rows)}"
    work.write(f"{loops} {to} {sign} {work.at(x, 'i')} * {work.at(y, 'j')};")


def dot(work: Workspace) -> None:
    """Write the dot product of two values."""
    x, y = work.inputs
    total = f"s += {work.at(x, 'i')} * {work.at(y, 'i')};"
    start = f"{work.dialect.type} s = {work.dialect.constant(0.0)};"
    to = work.at(work.new(1), 0)
    work.write(f"{{ {start} {loop('i', x.size)} {total} {to} = s; }}")


def _dense(work: Workspace, rows: int, inner: int, columns: int) -> None:
    """Write z + x y, both dense. Each number of the result is one sum; a few columns are summed
    together.
    """
    _, x, y = work.inputs
    to, zero = _begun(work)
    at = work.at
    grouped = columns - columns % min(COLUMNS_TOGETHER, columns)
    for first, end in pairwise(sorted({0, grouped, columns})):  # the last few columns are left over
        together = range(min(COLUMNS_TOGETHER, end - first))
        positions = [at(to, shifted("i", rows * (first + c)) + f" + {rows} * j") for c in together]
        sums = ", ".join(f"s{c} = {zero or position}" for c, position in enumerate(positions))
        short = inner <= UNROLLED_TERMS
        terms = []
        for k in map(str, range(inner)) if short else ["k"]:
            left = at(x, shifted("i", rows * int(k)) if short else f"i + {rows} * k")
            right = [at(y, shifted(k, inner * (first + c)) + f" + {inner} * j") for c in together]
            added = " ".join(f"s{c} += e * {factor};" for c, factor in enumerate(right))
            terms.append(f"{{ const {work.dialect.type} e = {left}; {added} }}")
        total = " ".join(terms) if short else f"{loop('k', inner)} {terms[0]}"
        ends = " ".join(f"{position} = s{c};" for c, position in enumerate(positions))
        work.write(
            f"for (j = 0; j < {end - first}; j += {len(together)}) {loop('i', rows)} "
            f"{{ {work.dialect.type} {sums}; {total} {ends} }}"
        )


def _sparse_left(
    work: Workspace, rows: int, inner: int, columns: int, row: list[int], column: list[int]
) -> None:
    """Write z + x y with a sparse x, (rows, inner) times (inner, columns): each nonzero of x is
    multiplied by a row of y.
    """
    _, x, y = work.inputs
    to = work.over_the_first()
    where = work.at(y, f"{work.indices(column)}[k]" + (f" + {inner} * j" if columns > 1 else ""))
    below = f" + {rows} * j" if columns > 1 else ""
    single = "j" if columns > 1 else 0
    target = work.at(to, f"{work.indices(row)}[k]{below}" if rows > 1 else single)
    loops = f"{loop('j', columns)} " if columns > 1 else ""
    loops += loop("k", len(row))
    work.write(f"{loops} {target} += {work.at(x, 'k')} * {where};")


def _sparse_right(
    work: Workspace, rows: int, columns: int, row: list[int], column: list[int]
) -> None:
    """Write z + x y with a sparse y: each nonzero of y is multiplied by a column of x."""
    _, x, y = work.inputs
    to = work.over_the_first()
    target = work.at(to, f"i + {rows} * {work.indices(column)}[k]" if columns > 1 else "i")
    where = work.at(x, f"i + {rows} * {work.indices(row)}[k]")
    loops = f"{loop('k', len(row))} {loop('i', rows)}"
    work.write(f"{loops} {target} += {where} * {work.at(y, 'k')};")


def _sparse_right_unrolled(
    work: Workspace, rows: int, columns: int, row: list[int], column: list[int]
) -> None:
    """Write z + x y with few nonzeros in y: each column of the result is one sum of columns of
    x.
    """
    _, x, y = work.inputs
    at = work.at
    to, zero = _begun(work)
    for c in range(columns):
        target = at(to, shifted("i", rows * c))
        terms = [
            f"{at(x, shifted('i', rows * r))} * {at(y, number)}"
            for number, r in enumerate(row)
            if column[number] == c
        ]
        if terms or zero:
            total = " + ".join([*([] if zero else [target]), *terms]) or zero
            work.write(f"{loop('i', rows)} {target} = {total};")


def _begun(work: Workspace) -> tuple[Value, str]:
    """Return the position of a sum that begins as z, and the C of zero where z is zero, so that
    nothing is there yet.
    """
    base = work.inputs[0]
    if base.is_zero:
        return work.new(base.size), work.dialect.constant(0.0)
    return work.over_the_first(), ""


def elementwise(work: Workspace) -> None:
    """Write an operation of scalars for each element of its operands."""
    size = int(work.node.nnz())
    to = work.over_an_input(size)

    def line(index: str | int) -> str:
        operands = [work.at(value, 0 if value.size == 1 else index) for value in work.inputs[:2]]
        return f"{work.at(to, index)} = {work.dialect.operation(work.operation, *operands)};"

    work.for_each(size, line)


def call(work: Workspace) -> None:
    """Write the call of another function."""
    called = work.node.which_function()
    name = work.written(called, False)
    results = []
    for i, number in enumerate(work.makes):
        size = int(called.nnz_out(i))
        direct = work.flow.direct(number)
        to = work.new(size, i) if direct is None else work.view(Value(*direct, size), i)
        results.append(to)
    work.call(name, [*work.inputs, *results])


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
    function: ca.Function, in_place: bool, dialect: Dialect, written: WriteFunction
) -> Body:
    """Return what a function of matrices (MX) does. The functions that it calls are written by
    `written`.
    """
    flow = Dataflow(function, in_place)
    work = Workspace(flow, dialect, written)
    state: list[tuple[Value, Value]] = []
    for k, operation in enumerate(flow.operations):
        work.go_to(k)
        if operation != ca.OP_OUTPUT:
            WRITERS.get(operation, elementwise)(work)
        elif work.inputs:
            (value,) = work.inputs
            to = work.outside("r", value.size)
            if to.home == "state":
                state.append((to, value))
            elif value.home != to.home:  # a call has not put it there
                work.copy(to, value)
    _write_state(work, state)
    lines = work.scratch.settled(work.lines)
    size = work.scratch.size
    arrays = [f"  {dialect.type} w[{size}];"] if size else []
    return Body(lines, [*work.tables, *arrays], size)


def _write_state(work: Workspace, state: list[tuple[Value, Value]]) -> None:
    """Write the new state: values that are in their position stay, values that lie elsewhere in the
    state go by way of scratch.
    """
    moved = list[tuple[Value, Value]]()
    for to, value in state:
        if value.home != "state":
            moved.append((to, value))
        elif value.offset != to.offset:
            through = work.scratch.new(value.size, work.flow.end)
            work.copy(through, value)
            moved.append((to, through))
    for to, value in moved:
        work.copy(to, value)
