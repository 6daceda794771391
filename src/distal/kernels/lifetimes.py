"""Which numbers of a function of matrices are needed until when, and where each result can go."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import casadi as ca

from distal.kernels.layout import Layout, Value

if TYPE_CHECKING:
    from distal.kernels.emitter import Emitter


class Lifetimes(Layout):
    """The values of one function in single assignment, with the instructions that make and read them.

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

    def _started(self, k: int, base: Value) -> tuple[Value, list[str]]:
        """Return where a sum goes, and the lines that let it begin with another value."""
        to = self._made(k, base.size, self.reads[k][0])
        return to, [] if to is base else self.copy(to, base)
