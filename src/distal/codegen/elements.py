"""C of operations that are done element by element; an operand of one number is used for all
elements.
"""

from __future__ import annotations

from distal.codegen.memory import for_each
from distal.codegen.operations import BINARY
from distal.codegen.workspace import Step, Workspace


def elementwise(work: Workspace, step: Step) -> list[str]:
    """Write an operation of scalars for each element of its operands."""
    n = int(step.node.nnz())
    work.cost.operations += n
    to = work.placement.over_an_input(step.k, n)
    used = step.inputs if step.operation in BINARY else step.inputs[:1]
    memory = work.memory

    def line(index: str | int) -> str:
        operands = [memory.at(value, 0 if value.size == 1 else index) for value in used]
        return f"{memory.at(to, index)} = {memory.dialect.operation(step.operation, *operands)};"

    return for_each(n, line)
