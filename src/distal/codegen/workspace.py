"""What the writers of one function of matrices share, and what they return.

The definition of a function around its lines: signature, arrays, loop variables, and arguments
that are not used.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca

from distal.codegen.memory import Memory, Value
from distal.codegen.number_types import Dialect
from distal.codegen.placement import Dataflow, Placement
from distal.expressions import MatrixNode

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


@dataclass
class Cost:
    """The arithmetic operations of a function, those of the functions that it calls included, and
    its calls of the mathematics library by name.
    """

    operations: int = 0
    library: Counter[str] = field(default_factory=Counter)

    def add(self, cost: Cost) -> None:
        """Add the cost of a called function to this one."""
        self.operations += cost.operations
        self.library.update(cost.library)


@dataclass(frozen=True)
class Written:
    """A function as C.

    Args:
        name: in C.
        text: its definition.
        cost: of one call.
        scratch: how many numbers its array for intermediates has.
    """

    name: str
    text: str
    cost: Cost
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
    cost: Cost = field(default_factory=Cost)

    def step(self, k: int) -> Step:
        """Return instruction `k`."""
        flow = self.flow
        inputs = [self.placement[number] for number in flow.reads[k]]
        return Step(k, flow.operations[k], flow.function.instruction_MX(k), inputs, flow.makes[k])


Writer = Callable[[Workspace, Step], list[str]]
"""Turns one instruction into lines of C; there are none if its result is only a view of another
value.
"""
