"""Where the numbers of a generated function lie, and the C that reaches them.

A `Value` is a run of neighbouring numbers: in an argument, in the state, in scratch, or a constant.
`Scratch` is one array that all intermediates share. Its size and what lies where are known only
after the last instruction. Positions in it are therefore written as marks («…») at first, which
`Scratch.settled` replaces.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from distal.codegen.number_types import CodeError, Dialect

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
