"""What the writers of one function of matrices share, and what they leave behind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca

from distal.codegen.dataflow import Dataflow
from distal.codegen.memory import Memory, Value
from distal.codegen.placement import Placement
from distal.expressions import MatrixNode


@dataclass
class Cost:
    """Arithmetic operations of a function, those of called ones included, and calls of the
    mathematics library by name.
    """

    operations: int = 0
    library: Counter[str] = field(default_factory=Counter)

    def add(self, cost: Cost) -> None:
        """Add the cost of a called function."""
        self.operations += cost.operations
        self.library.update(cost.library)


@dataclass(frozen=True)
class Written:
    """A function as C: its definition as text, and what a call takes, with `scratch` numbers for
    intermediates.
    """

    name: str
    text: str
    cost: Cost
    scratch: int = 0


WriteFunction = Callable[[ca.Function, bool], Written]
"""Writes a function, in place if its first input is changed, unless it is there already."""


@dataclass(frozen=True)
class Step:
    """One instruction: what a writer turns into lines.

    Args:
        k: its number.
        operation: CasADi's number of what it does.
        node: CasADi's expression of it.
        makes: numbers of its results.
    """

    k: int
    operation: int
    node: MatrixNode
    inputs: list[Value]
    makes: list[int]


@dataclass(frozen=True)
class Workspace:
    """One function of matrices on its way to C; `written` writes those that it calls, `in_place` is
    as for `Dataflow`.
    """

    flow: Dataflow
    memory: Memory
    placement: Placement
    written: WriteFunction
    in_place: bool
    cost: Cost = field(default_factory=Cost)

    def step(self, k: int) -> Step:
        """Return one instruction."""
        flow = self.flow
        inputs = [self.placement[number] for number in flow.reads[k]]
        return Step(k, flow.operations[k], flow.function.instruction_MX(k), inputs, flow.makes[k])


Writer = Callable[[Workspace, Step], list[str]]
"""Turns one instruction into lines of C; none where its result is only a view of what is there."""
