"""Where each result goes: it is a view of another value, or lies over an input that is no longer
needed, or in new scratch.
"""

from __future__ import annotations

from distal.codegen.dataflow import Dataflow
from distal.codegen.memory import Memory, Value


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
