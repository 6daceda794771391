"""C of a CasADi function of matrices: views instead of copies, loops instead of long lines, in place where it can be."""

from __future__ import annotations

from collections import Counter
from typing import Any

import casadi as ca
import numpy as np

from distal.kernels.dialects import BINARY, CodeError
from distal.kernels.layout import UNROLLED, Value
from distal.kernels.products import Products


class MatrixWriter(Products):
    """One function of matrices on its way to C.

    Args:
        emitter: writes the functions that are called.
        function: the function.
        in_place: the first input and the first output are one array.
    """

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


def _even(at: list[int]) -> int | None:
    """Return the step between indices, or None where it changes."""
    steps = set(np.diff(at))
    return int(steps.pop()) if len(steps) == 1 else (1 if not steps else None)
