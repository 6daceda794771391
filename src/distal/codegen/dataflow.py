"""For each instruction of a function the values that it reads and makes, and for each value the
last instruction that needs it.

CasADi's instructions use the slots of a work vector again and again. Here each result has a number
of its own that is never used again (static single assignment), so that what is done with a result
does not depend on its slot.
"""

from __future__ import annotations

import casadi as ca


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
