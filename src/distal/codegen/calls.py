"""C of calls: a result that is nothing but an output of the caller is written straight into that
output, every other one into scratch.
"""

from __future__ import annotations

from distal.codegen.memory import Value
from distal.codegen.workspace import Step, Workspace


def call(work: Workspace, step: Step) -> list[str]:
    """Write the call of another function."""
    called = step.node.which_function()
    written = work.written(called, False)
    work.cost.add(written.cost)
    results = []
    for i, number in enumerate(step.makes):
        size = int(called.nnz_out(i))
        if number in work.flow.direct:
            output, offset = work.flow.direct[number]
            results.append(work.placement.put(number, Value(f"r{output}", offset, size)))
        else:
            results.append(work.placement.new(step.k, number, size))
    addresses = [work.memory.address(value) for value in (*step.inputs, *results)]
    return [f"  {written.name}({', '.join(addresses)});"]
