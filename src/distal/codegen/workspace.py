"""What the writers of one function of matrices share: the values that each instruction reads and
makes, where each result goes, and the definition of a function around its lines.

A result is a view of another value, or lies over an input that is no longer needed, or in new
scratch. CasADi's instructions use the slots of a work vector again and again. Here each result has
a number of its own that is never used again (static single assignment), so that what is done with
a result does not depend on its slot.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from distal.codegen.memory import Memory, Value
from distal.codegen.number_types import Dialect
from distal.expressions import MatrixNode


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
