"""Where the numbers of a generated function lie: arguments, tables of constants, and scratch shared by lifetimes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from distal.kernels.dialects import Lanes, Plain

UNROLLED = 3
"""Copies and element-wise operations of at most so many numbers are written one by one."""

_SCRATCH = re.compile(r"«([AEI])(\d+):(\d+):([^»]*)»")
"""A place in scratch before it is laid out: an address, a number, a number by an index; block, offset, index."""


@dataclass
class Value:
    """Numbers that lie side by side.

    Args:
        home: ``a0``, ``r1`` … for arguments, ``state``, ``w`` for scratch; None for constants.
        offset: of the first number in its home; for scratch, within its own block.
        size: how many.
        block: which block of scratch it is in.
        numbers: of a constant.
    """

    home: str | None
    offset: int
    size: int
    block: int = -1
    numbers: list[float] = field(default_factory=list)


@dataclass
class Block:
    """A piece of scratch: its size, and the instructions between which it is in use."""

    size: int
    first: int
    last: int
    at: int = -1


class Layout:
    """The memory of one generated function.

    Args:
        dialect: how numbers are written.
        index: type of tables of indices.
    """

    def __init__(self, dialect: Plain | Lanes, index: str) -> None:
        self.dialect, self.index = dialect, index
        self.tables: list[str] = []
        self.blocks: list[Block] = []
        self.scratch = 0

    def settled(self, lines: list[str]) -> list[str]:
        """Return the lines with scratch laid out."""
        self._lay_out()
        return [_SCRATCH.sub(self._settled, line) for line in lines]

    def _settled(self, match: re.Match[str]) -> str:
        """Return a place in scratch as C, now that the blocks are laid out."""
        kind, block, offset, index = match.groups()
        at = self.blocks[int(block)].at + int(offset)
        if kind == "A":
            return f"w + {at}" if at else "w"
        if kind == "E":
            return f"w[{at}]"
        return f"w[{at} + {index}]" if at else f"w[{index}]"

    def new(self, size: int, first: int, last: int) -> Value:
        """Return a new piece of scratch.

        Args:
            size: how many numbers.
            first: instruction that writes it.
            last: last one that reads it.
        """
        self.blocks.append(Block(size, first, last))
        return Value("w", 0, size, len(self.blocks) - 1)

    def _lay_out(self) -> None:
        """Place the blocks: first fit, the largest first."""
        placed: list[Block] = []
        for block in sorted(self.blocks, key=lambda b: (-b.size, b.first)):
            busy = sorted(
                (other.at, other.at + other.size)
                for other in placed
                if other.first <= block.last and block.first <= other.last
            )
            at = 0
            for low, high in busy:
                if at + block.size <= low:
                    break
                at = max(at, high)
            block.at = at
            placed.append(block)
        self.scratch = max((block.at + block.size for block in self.blocks), default=0)

    def place(self, value: Value) -> str:
        """Return the C of a value's address; scratch is filled in once it is laid out."""
        if value.size == 0:
            return "0"
        if value.home is None:
            return self._table(value.numbers)
        if value.home == "w":
            return f"«A{value.block}:{value.offset}:»"
        return f"{value.home} + {value.offset}" if value.offset else value.home

    def at(self, value: Value, index: str | int) -> str:
        """Return the C of one of a value's numbers.

        Args:
            value: the numbers.
            index: which one; text is C.
        """
        if value.home is None:
            if value.size == 1 or len(set(value.numbers)) == 1:
                return self.dialect.constant(value.numbers[0])
            if isinstance(index, int):
                return self.dialect.constant(value.numbers[index])
            return f"{self._table(value.numbers)}[{index}]"
        if isinstance(index, int):
            if value.home == "w":
                return f"«E{value.block}:{value.offset + index}:»"
            return f"{value.home}[{value.offset + index}]"
        if value.home == "w":
            return f"«I{value.block}:{value.offset}:{index}»"
        return f"{value.home}[{value.offset} + {index}]" if value.offset else f"{value.home}[{index}]"

    def _table(self, numbers: list[float]) -> str:
        """Return the name of a table of constants."""
        if isinstance(self.dialect, Lanes):
            values = ", ".join("{" + ", ".join([f"{n:.17g}"] * self.dialect.count) + "}" for n in numbers)
        else:
            values = ", ".join(self.dialect.constant(n) for n in numbers)
        body = f"[{len(numbers)}] = {{{values}}};"
        for i, line in enumerate(self.tables):
            if line.endswith(body) and " c" in line:
                return f"c{i}"
        self.tables.append(f"  static const {self.dialect.type} c{len(self.tables)}{body}")
        return f"c{len(self.tables) - 1}"

    def indices(self, numbers: list[int]) -> str:
        """Return the name of a table of indices."""
        body = f"[{len(numbers)}] = {{{', '.join(map(str, numbers))}}};"
        for i, line in enumerate(self.tables):
            if line.endswith(body) and f"{self.index} t" in line:
                return f"t{i}"
        self.tables.append(f"  static const {self.index} t{len(self.tables)}{body}")
        return f"t{len(self.tables) - 1}"

    def copy(self, to: Value, value: Value) -> list[str]:
        """Return the C that copies a value.

        Args:
            to: where to.
            value: what.
        """
        n = value.size
        if n <= UNROLLED:
            return [f"  {self.at(to, i)} = {self.at(value, i)};" for i in range(n)]
        return [f"  for (i = 0; i < {n}; ++i) {self.at(to, 'i')} = {self.at(value, 'i')};"]
