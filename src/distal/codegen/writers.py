"""Where the numbers of a generated function lie, and the C that reaches them.

A `Value` is a run of neighbouring numbers: in an argument, in the state, in scratch, or a constant.
`Scratch` is one array that all intermediates share. Its size and what lies where are known only
after the last instruction. Positions in it are therefore written as marks («…») at first, which
`Scratch.settled` replaces.

What the writers of one function of matrices share: the values that each instruction reads and
makes, where each result goes, and the definition of a function around its lines.

A result is a view of another value, or lies over an input that is no longer needed, or in new
scratch. CasADi's instructions use the slots of a work vector again and again. Here each result has
a number of its own that is never used again (static single assignment), so that what is done with
a result does not depend on its slot.

C of the instructions of a function of matrices, by one writer each: slices, joins and shapes of
values, most of which are views; and products: dense, with one sparse factor, of rank one, and of
two vectors.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from distal.codegen.number_types import CodeError, Dialect
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
        offset: of the first number in its home; for scratch, within its own block.
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
        if self.home is None:
            return replace(self, size=size, ids=self.ids[offset : offset + size])
        return Value(self.home, self.offset + offset, size, self.block)

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

    def new(self, size: int, first: int, last: int) -> Value:
        """Return a new piece of scratch, in use from instruction `first` to `last`."""
        self.blocks.append(Block(size, first, last))
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


def _element(home: str, offset: int, index: str) -> str:
    """Return the C of a number that lies at an index, an integer or C, behind an offset."""
    if index.isdigit():
        return f"{home}[{offset + int(index)}]"
    return f"{home}[{offset} + {index}]" if offset else f"{home}[{index}]"


class Tables:
    """Tables of the constants and indices of one function; equal tables are written once."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._names: dict[tuple[str, str], str] = {}
        self.lines: list[str] = []

    def constants(self, ids: tuple[float, ...]) -> str:
        """Return the name of a table of constants."""
        return self._table("c", self._dialect.type, [self._dialect.entry(number) for number in ids])

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

    def _table(self, letter: str, kind: str, entries: list[str]) -> str:
        body = f"[{len(entries)}] = {{{', '.join(entries)}}};"
        name = self._names.get((letter, body))
        if name is None:
            name = self._names[letter, body] = f"{letter}{len(self.lines)}"
            self.lines.append(f"  static const {kind} {name}{body}")
        return name


class Memory:
    """The C that reaches a value wherever it lies."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.tables = Tables(dialect)
        self.scratch = Scratch()

    def address(self, value: Value) -> str:
        """Return the C of a value's address."""
        if value.size == 0:
            return "0"
        if value.home is None:
            return self.tables.constants(value.ids)
        if value.home == "w":
            return f"«{value.block}:{value.offset}:»"
        return shifted(value.home, value.offset)

    def at(self, value: Value, index: str | int) -> str:
        """Return the C of one number of a value; its index is an integer or C."""
        if value.home is None:
            if value.is_uniform:
                return self.dialect.constant(value.ids[0])
            if isinstance(index, int):
                return self.dialect.constant(value.ids[index])
            return f"{self.tables.constants(value.ids)}[{index}]"
        if value.home == "w":
            return f"«{value.block}:{value.offset}:{index}»"
        return _element(value.home, value.offset, str(index))

    def copy(self, to: Value, value: Value) -> list[str]:
        """Return the C that copies a value to another position."""
        return for_each(value.size, lambda i: f"{self.at(to, i)} = {self.at(value, i)};")


def for_each(size: int, line: Callable[[str | int], str]) -> list[str]:
    """Return the C that does a line for each index below `size`: as a loop, or line by line if
    there are at most `UNROLLED`.
    """
    if size <= UNROLLED:
        return [f"  {line(i)}" for i in range(size)]
    return [f"  for (i = 0; i < {size}; ++i) {line('i')}"]


class Dataflow:
    """The values of one function of matrices (MX), by number.

    With `in_place` the first output is written where the first input stands, so that values that
    belong to this output must last until the end.
    """

    def __init__(self, function: ca.Function, in_place: bool) -> None:
        self.function = function
        self.end = int(function.n_instructions())
        self.operations = [int(function.instruction_id(k)) for k in range(self.end)]
        self.reads: list[list[int]] = []
        self.makes: list[list[int]] = []
        self._number()
        self.readers: dict[int, list[int]] = {}
        for k, read in enumerate(self.reads):
            for number in read:
                self.readers.setdefault(number, []).append(k)
        self._last = {number: readers[-1] for number, readers in self.readers.items()}
        self.direct = {} if in_place else self._direct()
        """Results of calls that are nothing but outputs: number → which output, and the offset in
        it.
        """
        if in_place:
            for k, operation in enumerate(self.operations):
                for number in self.reads[k] if operation == ca.OP_OUTPUT else []:
                    self._last[number] = self.end
                    self.readers[number].append(self.end)
        self._parts: dict[int, tuple[int, int] | None] = {}

    def _number(self) -> None:
        """Number the values, and note the numbers that each instruction reads and makes."""
        slots: dict[int, int] = {}
        number = 0
        for k, operation in enumerate(self.operations):
            inputs = self.function.instruction_input(k) if operation != ca.OP_INPUT else []
            outputs = self.function.instruction_output(k) if operation != ca.OP_OUTPUT else []
            self.reads.append([slots[slot] for slot in inputs if slot >= 0])
            self.makes.append(list(range(number, number + len(outputs))))
            for slot in outputs:
                if slot >= 0:
                    slots[slot] = number
                number += 1

    def last(self, number: int, otherwise: int) -> int:
        """Return the last instruction that reads a value, or `otherwise` if none does."""
        return self._last.get(number, otherwise)

    def part_read(self, reader: int) -> tuple[int, int] | None:
        """Return the begin and end of the part of its input that a slice reads, and None for an
        instruction (or `end`) that reads all of it.
        """
        if reader not in self._parts:
            part = None
            if reader < self.end and self.operations[reader] == ca.OP_GETNONZEROS:
                at = [int(i) for i in self.function.instruction_MX(reader).mapping().nonzeros()]
                part = (min(at), max(at) + 1) if at else (0, 0)
            self._parts[reader] = part
        return self._parts[reader]

    def _direct(self) -> dict[int, tuple[int, int]]:
        """Return the results of calls that are used as one output, perhaps in another shape, and
        nowhere else.
        """
        positions = {}
        for k, results in enumerate(self.makes):
            for number in results if self.operations[k] == ca.OP_CALL else []:
                through = number
                while len(self.readers.get(through, [])) == 1:
                    reader = self.readers[through][0]
                    if self.operations[reader] == ca.OP_RESHAPE:
                        through = self.makes[reader][0]
                        continue
                    if self.operations[reader] == ca.OP_OUTPUT:
                        output = self.function.instruction_MX(reader).info()
                        positions[number] = (int(output["ind"]), int(output["offset"]))
                    break
        return positions


class Placement:
    """The values of a function that have been made so far, by number, with their positions."""

    def __init__(self, flow: Dataflow, memory: Memory) -> None:
        self._flow = flow
        self._memory = memory
        self._values: dict[int, Value] = {}
        self._beside: dict[tuple[str | None, int], list[int]] = {}

    def __getitem__(self, number: int) -> Value:
        return self._values[number]

    def put(self, number: int, value: Value) -> Value:
        """Note the position of a value under its number, and return the value."""
        self._values[number] = value
        self._beside.setdefault((value.home, value.block), []).append(number)
        return value

    def view(self, k: int, number: int, value: Value) -> None:
        """Let a result of instruction `k` be a view of another value, whose position is then in use
        as long as the view is.
        """
        self.put(number, value)
        self._memory.scratch.keep(value, self._flow.last(number, k))

    def new(self, k: int, number: int, size: int) -> Value:
        """Return new scratch for a result of instruction `k`."""
        return self.put(number, self._memory.scratch.new(size, k, self._flow.last(number, k)))

    def over_an_input(self, k: int, size: int) -> Value:
        """Return the position of an element-wise result of instruction `k`: over its first input of
        the same size that may be overwritten, else in new scratch.

        This is allowed because the instruction reads each element before it writes the same one.
        """
        number = self._flow.makes[k][0]
        for over in self._flow.reads[k]:
            if self._values[over].size == size and self._is_free(over, k):
                return self._replaced(k, number, over)
        return self.new(k, number, size)

    def over_the_first(self, k: int) -> tuple[Value, list[str]]:
        """Return the position of a result that changes the first input of instruction `k`, and the
        lines of C that copy this input there first.

        If the first input may be overwritten, the result lies over it and there is no copy. The
        instruction may read any other input while it writes.
        """
        number = self._flow.makes[k][0]
        (over, *factors) = self._flow.reads[k]
        base = self._values[over]
        if over not in factors and self._is_free(over, k):
            return self._replaced(k, number, over), []
        to = self.new(k, number, base.size)
        return to, self._memory.copy(to, base)

    def _replaced(self, k: int, number: int, over: int) -> Value:
        value = self._values[over]
        self._memory.scratch.keep(value, self._flow.last(number, k))
        return self.put(number, value)

    def _is_free(self, number: int, k: int) -> bool:
        """Return whether instruction `k` may write over a value: no later instruction reads it, and
        neither `k` nor a later one reads another value that overlaps it.
        """
        value = self._values[number]
        flow = self._flow
        if value.home not in ("w", "state") or flow.last(number, -1) > k:
            return False
        low = value.offset
        high = value.offset + value.size
        for neighbour in self._beside[value.home, value.block]:
            beside = self._values[neighbour]
            for reader in flow.readers.get(neighbour, []) if neighbour != number else []:
                if reader >= k:
                    begin, end = flow.part_read(reader) or (0, beside.size)
                    if beside.offset + begin < high and low < beside.offset + end:
                        return False
        return True


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


@dataclass(frozen=True)
class Written:
    """A function as C.

    Args:
        name: in C.
        text: its definition.
        scratch: how many numbers its array for intermediates has.
    """

    name: str
    text: str
    scratch: int = 0


WriteFunction = Callable[[ca.Function, bool], Written]
"""Writes a function that has not been written yet and returns it as C; the second argument says
whether its first input is changed in place.
"""


@dataclass(frozen=True)
class Step:
    """One instruction, which a writer turns into lines of C.

    Args:
        k: its number.
        operation: CasADi's number of its operation.
        node: CasADi's expression of it.
        inputs: the values that it reads.
        makes: the numbers of its results.
    """

    k: int
    operation: int
    node: MatrixNode
    inputs: list[Value]
    makes: list[int]


@dataclass(frozen=True)
class Workspace:
    """One function of matrices while it is written as C. The functions that it calls are written by
    `written`; `in_place` is as for `Dataflow`.
    """

    flow: Dataflow
    memory: Memory
    placement: Placement
    written: WriteFunction
    in_place: bool

    def step(self, k: int) -> Step:
        """Return instruction `k`."""
        flow = self.flow
        inputs = [self.placement[number] for number in flow.reads[k]]
        return Step(k, flow.operations[k], flow.function.instruction_MX(k), inputs, flow.makes[k])


Writer = Callable[[Workspace, Step], list[str]]
"""Turns one instruction into lines of C; there are none if its result is only a view of another
value.
"""


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
