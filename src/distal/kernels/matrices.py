"""C of a CasADi function of matrices: views instead of copies, loops instead of long lines, in place where it can be."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from distal.kernels.dialects import BINARY, CodeError
from distal.kernels.layout import UNROLLED, Layout, Value

if TYPE_CHECKING:
    from distal.kernels.emitter import Emitter

UNROLLED_PRODUCT = 8
"""A sparse factor of at most so many numbers is written number by number."""


class MatrixWriter(Layout):
    """One function of matrices on its way to C.

    Args:
        emitter: writes the functions that are called.
        function: the function.
        in_place: the first input and the first output are one array.
    """

    def __init__(self, emitter: Emitter, function: ca.Function, in_place: bool) -> None:
        super().__init__(emitter.dialect, emitter.index)
        self.emitter, self.function, self.in_place = emitter, function, in_place
        self.count, self.library = 0, Counter[str]()
        self.values: dict[int, Value] = {}
        # what each instruction reads and makes, in single assignment: numbers that are never given twice
        slots: dict[int, int] = {}
        self.reads: list[list[int]] = []
        self.makes: list[list[int]] = []
        number = 0
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            inputs, outputs = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_INPUT:
                inputs = []
            if operation == ca.OP_OUTPUT:
                outputs = []
            self.reads.append([slots[i] for i in inputs if i >= 0])
            made = []
            for slot in outputs:
                made.append(number)
                if slot >= 0:
                    slots[slot] = number
                number += 1
            self.makes.append(made)
        self.readers: dict[int, list[int]] = {}
        for k, read in enumerate(self.reads):
            for v in read:
                self.readers.setdefault(v, []).append(k)
        self.last = {v: ks[-1] for v, ks in self.readers.items()}
        end = function.n_instructions()
        self.straight = {} if in_place else self._straight()
        if in_place:  # what is put out at the end must last until then
            for k in range(end):
                if function.instruction_id(k) == ca.OP_OUTPUT:
                    self.last[self.reads[k][0]] = end
                    self.readers[self.reads[k][0]].append(end)

    def _straight(self) -> dict[int, Value]:
        """Return where results of calls go that are nothing but outputs: straight to their place."""
        function, readers = self.function, self.readers
        places = {}
        for k, made in enumerate(self.makes):
            for number in made if function.instruction_id(k) == ca.OP_CALL else []:
                through = number
                while len(readers.get(through, [])) == 1:
                    reader = readers[through][0]
                    if function.instruction_id(reader) == ca.OP_RESHAPE:
                        through = self.makes[reader][0]
                        continue
                    if function.instruction_id(reader) == ca.OP_OUTPUT:
                        info = function.instruction_MX(reader).info()
                        places[number] = Value(f"r{info['ind']}", int(info["offset"]), 0)
                    break
        return places

    def lines(self) -> list[str]:
        """Return the lines of C, with scratch laid out."""
        lines: list[str] = []
        put: list[tuple[int, int]] = []
        for k in range(self.function.n_instructions()):
            operation = self.function.instruction_id(k)
            if operation == ca.OP_OUTPUT:
                info = self.function.instruction_MX(k).info()
                if self.in_place and info["ind"] == 0:
                    put.append((self.reads[k][0], info["offset"]))
                else:
                    value = self.values[self.reads[k][0]]
                    if value.home == f"r{info['ind']}":
                        continue
                    lines += self.copy(Value(f"r{info['ind']}", info["offset"], value.size), value)
            else:
                lines += self._instruction(k, operation)
        lines += self._put(put)
        return self.settled(lines)

    def _put(self, put: list[tuple[int, int]]) -> list[str]:
        """Write the new state: what is in its place stays, what lies elsewhere in the state goes by way of scratch."""
        lines, moved = [], []
        end = self.function.n_instructions()
        for number, offset in put:
            value = self.values[number]
            if value.home == "state":
                if value.offset == offset:
                    continue
                through = self.new(value.size, end, end + 1)
                lines += self.copy(through, value)
                value = through
            moved.append((value, offset))
        for value, offset in moved:
            if value.block >= 0:
                self.blocks[value.block].last = end + 1
            lines += self.copy(Value("state", offset, value.size), value)
        return lines

    # scratch

    def _made(self, k: int, size: int, over: int | None = None) -> Value:
        """Return where the result of an instruction goes: over one of its inputs where nothing needs that any more.

        Args:
            k: the instruction.
            size: of its result.
            over: number of the value that it may replace.
        """
        number = self.makes[k][0]
        last = self.last.get(number, k)
        if over is not None:
            value = self.values[over]
            if value.size == size and self._free(over, k):
                if value.block >= 0:
                    self.blocks[value.block].last = max(self.blocks[value.block].last, last)
                self.values[number] = value
                return value
        self.values[number] = self.new(size, k, last)
        return self.values[number]

    def _free(self, number: int, k: int) -> bool:
        """Return whether a value's place may be written by instruction k: nothing reads it afterwards, or beside it."""
        value = self.values[number]
        if value.home not in ("w", "state") or self.last.get(number, -1) > k:
            return False
        for other, there in self.values.items():
            if other == number or there.home != value.home or there.block != value.block:
                continue
            for reader in self.readers.get(other, []):
                low, high = self._range(other, reader)
                if reader >= k and low < value.offset + value.size and value.offset < high:
                    return False
        return True

    def _range(self, number: int, reader: int) -> tuple[int, int]:
        """Return which part of its home an instruction reads of a value."""
        value = self.values[number]
        low, high = value.offset, value.offset + value.size
        if reader < len(self.reads) and self.function.instruction_id(reader) == ca.OP_GETNONZEROS:
            at = [int(i) for i in self.function.instruction_MX(reader).mapping().nonzeros()]
            return low + min(at), low + max(at) + 1
        return low, high

    def _view(self, k: int, number: int, value: Value) -> list[str]:
        """Let a result be a view of another value."""
        self.values[number] = value
        if value.block >= 0:
            block = self.blocks[value.block]
            block.last = max(block.last, self.last.get(number, k))
        return []

    # instructions

    def _instruction(self, k: int, operation: int) -> list[str]:
        function, inputs = self.function, [self.values[v] for v in self.reads[k]]
        if operation == ca.OP_CALL:
            return self._call(k, inputs)
        node = function.instruction_MX(k)
        made = self.makes[k][0] if self.makes[k] else -1
        if operation == ca.OP_INPUT:
            home = "state" if self.in_place and node.info()["ind"] == 0 else f"a{node.info()['ind']}"
            return self._view(k, made, Value(home, int(node.info()["offset"]), int(node.nnz())))
        if operation == ca.OP_CONST:
            self.values[made] = Value(None, 0, int(node.nnz()), numbers=[float(x) for x in node.to_DM().nonzeros()])
            return []
        if operation == ca.OP_RESHAPE:
            return self._view(k, made, inputs[0])
        if operation == ca.OP_TRANSPOSE:
            return self._transpose(k, node, inputs[0])
        if operation == ca.OP_GETNONZEROS:
            return self._get(k, node, inputs[0])
        if operation == ca.OP_SETNONZEROS:
            return self._set(k, node, inputs, False)
        if operation == ca.OP_ADDNONZEROS:
            return self._set(k, node, inputs, True)
        if operation in (ca.OP_VERTCAT, ca.OP_HORZCAT):
            return self._join(k, node, inputs)
        if operation in (ca.OP_VERTSPLIT, ca.OP_HORZSPLIT):
            offset, lines = 0, list[str]()
            for number, size in zip(self.makes[k], [int(node.get_output(i).nnz()) for i in range(node.n_out())]):
                one = Value(inputs[0].home, inputs[0].offset + offset, size, inputs[0].block)
                offset += size
                lines += self._view(k, number, one)
            return lines
        if operation == ca.OP_MTIMES:
            return self._product(k, node, inputs)
        if operation == ca.OP_RANK1:
            return self._rank_one(k, node, inputs)
        if operation == ca.OP_DOT:
            return self._dot(k, inputs)
        return self._each(k, node, operation, inputs)

    def _call(self, k: int, inputs: list[Value]) -> list[str]:
        function = self.function.instruction_MX(k).which_function()
        name = self.emitter.add(function)
        self.count += self.emitter.operations.get(name, 0)
        self.library += self.emitter.library.get(name, Counter())
        results = []
        for i, number in enumerate(self.makes[k]):
            size = int(function.nnz_out(i))
            there = self.straight.get(number)
            if there is not None:
                value = Value(there.home, there.offset, size)
            else:
                value = self.new(size, k, self.last.get(number, k))
            self.values[number] = value
            results.append(value)
        # arguments are read while results are written: blocks that end here must not be shared
        for value in inputs:
            if value.block >= 0:
                self.blocks[value.block].last = max(self.blocks[value.block].last, k)
        places = [self.place(value) for value in (*inputs, *results)]
        return [f"  {name}({', '.join(places)});"]

    def _transpose(self, k: int, node: Any, value: Value) -> list[str]:
        rows, columns = node.size1(), node.size2()
        if rows == 1 or columns == 1 or not node.is_dense():
            if rows > 1 and columns > 1:
                raise CodeError("a transposed sparse matrix has no C here")
            return self._view(k, self.makes[k][0], value)
        to = self._made(k, value.size)
        return [
            f"  for (i = 0; i < {rows}; ++i) for (j = 0; j < {columns}; ++j) "
            f"{self.at(to, f'i + {rows} * j')} = {self.at(value, f'j + {columns} * i')};"
        ]

    def _get(self, k: int, node: Any, value: Value) -> list[str]:
        at = [int(i) for i in node.mapping().nonzeros()]
        step = _even(at)
        if step == 1 or len(at) == 1:
            if value.home is None:
                self.values[self.makes[k][0]] = Value(None, 0, len(at), numbers=[value.numbers[i] for i in at])
                return []
            return self._view(k, self.makes[k][0], Value(value.home, value.offset + at[0], len(at), value.block))
        to = self._made(k, len(at))
        if len(at) <= UNROLLED:
            return [f"  {self.at(to, i)} = {self.at(value, j)};" for i, j in enumerate(at)]
        source = f"{at[0]} + {step} * i" if step is not None else f"{self.indices(at)}[i]"
        return [f"  for (i = 0; i < {len(at)}; ++i) {self.at(to, 'i')} = {self.at(value, source)};"]

    def _set(self, k: int, node: Any, inputs: list[Value], adds: bool) -> list[str]:
        base, values = inputs
        at = [int(i) for i in node.mapping().nonzeros()]
        to = self._made(k, base.size, self.reads[k][0])
        lines = [] if to is base else self.copy(to, base)
        sign = "+=" if adds else "="
        step = _even(at)
        self.count += len(at) if adds else 0
        if len(at) <= UNROLLED:
            return lines + [f"  {self.at(to, i)} {sign} {self.at(values, j)};" for j, i in enumerate(at) if i >= 0]
        target = f"{at[0]} + {step} * i" if step is not None else f"{self.indices(at)}[i]"
        return [*lines, f"  for (i = 0; i < {len(at)}; ++i) {self.at(to, target)} {sign} {self.at(values, 'i')};"]

    def _join(self, k: int, node: Any, inputs: list[Value]) -> list[str]:
        if node.size2() > 1 and self.function.instruction_id(k) == ca.OP_VERTCAT:
            raise CodeError("matrices on top of each other have no C here")
        to = self._made(k, int(node.nnz()))
        lines, offset = [], 0
        for value in inputs:
            lines += self.copy(Value(to.home, to.offset + offset, value.size, to.block), value)
            offset += value.size
        return lines

    def _each(self, k: int, node: Any, operation: int, inputs: list[Value]) -> list[str]:
        """Element by element; a single number goes with each of many."""
        n = int(node.nnz())
        self.count += n
        over = next(
            (number for number, value in zip(self.reads[k], inputs) if value.size == n and self._free(number, k)), None
        )
        to = self._made(k, n, over)
        used = inputs if operation in BINARY else inputs[:1]

        def line(index: str | int) -> str:
            operands = [self.at(value, 0 if value.size == 1 else index) for value in used]
            return f"{self.at(to, index)} = {self.dialect.operation(operation, *operands)};"

        if n <= UNROLLED:
            return [f"  {line(i)}" for i in range(n)]
        return [f"  for (i = 0; i < {n}; ++i) {line('i')}"]

    def _started(self, k: int, base: Value) -> tuple[Value, list[str]]:
        """Return where a sum goes, and the lines that let it begin with another value."""
        to = self._made(k, base.size, self.reads[k][0])
        return to, [] if to is base else self.copy(to, base)

    def _product(self, k: int, node: Any, inputs: list[Value]) -> list[str]:
        """z + x y, dense or with one sparse factor."""
        z, x, y = (node.dep(i) for i in range(3))
        rows, inner, columns = x.size1(), x.size2(), y.size2()
        if not z.is_dense():
            raise CodeError("a sparse product has no C here")
        if x.is_dense() and y.is_dense():
            self.count += 2 * rows * inner * columns
            return self._dense_product(k, inputs, rows, inner, columns)
        if not x.is_dense() and not y.is_dense():
            raise CodeError("the product of two sparse matrices has no C here")
        row, column = _triplets((x if y.is_dense() else y).sparsity())
        if not y.is_dense() and len(row) <= UNROLLED_PRODUCT:
            self.count += 2 * len(row) * rows
            return self._columns(k, inputs, rows, columns, list(zip(row, column)))
        to, lines = self._started(k, inputs[0])
        if y.is_dense():
            self.count += 2 * len(row) * columns
            factor, among = inputs[1], f" + {inner} * j" if columns > 1 else ""
            where = self.at(inputs[2], f"{self.indices(column)}[k]{among}")
            below = f" + {rows} * j" if columns > 1 else ""
            target = self.at(to, f"{self.indices(row)}[k]{below}" if rows > 1 else ("j" if columns > 1 else 0))
            loop = f"for (j = 0; j < {columns}; ++j) " if columns > 1 else ""
            return [*lines, f"  {loop}for (k = 0; k < {len(row)}; ++k) {target} += {self.at(factor, 'k')} * {where};"]
        self.count += 2 * len(row) * rows
        target = self.at(to, f"i + {rows} * {self.indices(column)}[k]" if columns > 1 else "i")
        where = self.at(inputs[1], f"i + {rows} * {self.indices(row)}[k]")
        return [
            *lines,
            f"  for (k = 0; k < {len(row)}; ++k) for (i = 0; i < {rows}; ++i) "
            f"{target} += {where} * {self.at(inputs[2], 'k')};",
        ]

    def _columns(
        self, k: int, inputs: list[Value], rows: int, columns: int, entries: list[tuple[int, int]]
    ) -> list[str]:
        """z + x y with few numbers in y: each column of the result as one sum of columns of x."""
        base, x, y = inputs
        zero = base.home is None and not any(base.numbers)
        if zero:
            to, lines = self._made(k, base.size), list[str]()
        else:
            to, lines = self._started(k, base)
        for column in range(columns):
            target = self.at(to, _sum("i", rows * column))
            terms = [
                f"{self.at(x, _sum('i', rows * row))} * {self.at(y, number)}"
                for number, (row, at) in enumerate(entries)
                if at == column
            ]
            start = [] if zero else [target]
            if terms or zero:
                total = " + ".join([*start, *terms]) or self.dialect.constant(0.0)
                lines.append(f"  for (i = 0; i < {rows}; ++i) {target} = {total};")
        return lines

    def _dense_product(self, k: int, inputs: list[Value], rows: int, inner: int, columns: int) -> list[str]:
        base, x, y = inputs
        zero = base.home is None and not any(base.numbers)
        if zero:
            to, lines = self._made(k, base.size), list[str]()
            start = self.dialect.constant(0.0)
        else:
            to, lines = self._started(k, base)
            start = self.at(to, f"i + {rows} * j")
        total = (
            f"{self.dialect.type} s = {start}; for (k = 0; k < {inner}; ++k) "
            f"s += {self.at(x, f'i + {rows} * k')} * {self.at(y, f'k + {inner} * j')}; "
            f"{self.at(to, f'i + {rows} * j')} = s;"
        )
        return [*lines, f"  for (j = 0; j < {columns}; ++j) for (i = 0; i < {rows}; ++i) {{ {total} }}"]

    def _rank_one(self, k: int, node: Any, inputs: list[Value]) -> list[str]:
        base, alpha, x, y = inputs
        rows, columns = node.size1(), node.size2()
        self.count += 2 * rows * columns
        to, lines = self._started(k, base)
        if alpha.home is None and alpha.numbers[0] == -1.0:
            change = f"-= {self.at(x, 'i')} * {self.at(y, 'j')}"
        else:
            change = f"+= {self.at(alpha, 0)} * {self.at(x, 'i')} * {self.at(y, 'j')}"
        return [
            *lines,
            f"  for (j = 0; j < {columns}; ++j) for (i = 0; i < {rows}; ++i) {self.at(to, f'i + {rows} * j')} {change};",
        ]

    def _dot(self, k: int, inputs: list[Value]) -> list[str]:
        n = inputs[0].size
        self.count += 2 * n
        to = self._made(k, 1)
        total = f"s += {self.at(inputs[0], 'i')} * {self.at(inputs[1], 'i')};"
        start = f"{self.dialect.type} s = {self.dialect.constant(0.0)};"
        return [f"  {{ {start} for (i = 0; i < {n}; ++i) {total} {self.at(to, 0)} = s; }}"]


def _sum(index: str, offset: int) -> str:
    return f"{index} + {offset}" if offset else index


def _even(at: list[int]) -> int | None:
    """Return the step between indices, or None where it changes."""
    steps = set(np.diff(at))
    return int(steps.pop()) if len(steps) == 1 else (1 if not steps else None)


def _triplets(sparsity: Any) -> tuple[list[int], list[int]]:
    rows, columns = sparsity.get_triplet()
    return [int(i) for i in rows], [int(i) for i in columns]
