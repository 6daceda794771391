"""C from CasADi's functions, written for few bytes: views instead of copies, loops instead of unrolled matrices.

CasADi's own generator copies each slice of a vector and keeps a slot per intermediate; on a microcontroller that is most of
the memory. Here a function of scalars becomes straight lines, a function of matrices becomes loops over arrays that share
one scratch area by their lifetimes, and what can be done in place is.
"""

from __future__ import annotations

from collections import Counter

import casadi as ca

from distal.kernels.dialects import BINARY, CALLED, INLINE, Lanes, Plain
from distal.kernels.matrices import MatrixWriter


class Emitter:
    """Writes CasADi functions as static C functions, each once.

    Args:
        dialect: how numbers are written.
        index: type of tables of indices.
    """

    def __init__(self, dialect: Plain | Lanes, index: str = "unsigned short") -> None:
        self.dialect, self.index = dialect, index
        self.texts: list[str] = []
        self.operations: dict[str, int] = {}
        self.library: dict[str, Counter[str]] = {}
        self.scratch: dict[str, int] = {}
        self._names: dict[int, str] = {}
        self._kept: list[ca.Function] = []

    @property
    def text(self) -> str:
        """All functions so far, each after those that it calls."""
        return "\n".join(self.texts)

    def add(self, function: ca.Function, in_place: bool = False) -> str:
        """Write a function and those that it calls; return its name in C.

        Args:
            function: of scalars (SX) or of matrices (MX).
            in_place: the first input and the first output are one array, ``state``, that is changed.

        Raises:
            CodeError: it has an operation that has no C here.
        """
        known = self._names.get(function.__hash__())
        if known is not None:
            return known
        name = str(function.name())
        taken = set(self._names.values())
        name = next(n for n in (name, *(f"{name}_{i}" for i in range(2, 10_000))) if n not in taken)
        self._names[function.__hash__()] = name
        self._kept.append(function)
        text = (
            self._scalars(function, name) if function.is_a("SXFunction") else self._matrices(function, name, in_place)
        )
        self.texts.append(text)
        return name

    def _signature(self, function: ca.Function, name: str, in_place: bool) -> str:
        kind = self.dialect.type
        skip = 1 if in_place else 0
        parts = [f"{kind}* restrict state"] if in_place else []
        parts += [f"const {kind}* restrict a{i}" for i in range(skip, function.n_in())]
        parts += [f"{kind}* restrict r{i}" for i in range(skip, function.n_out())]
        return f"static void {name}({', '.join(parts)})"

    def _scalars(self, function: ca.Function, name: str) -> str:
        """Return the C of a function of scalars: straight lines."""
        dialect, lines, names = self.dialect, [], dict[int, str]()
        count, library = 0, Counter[str]()
        pairs = _sines_and_cosines(function) if isinstance(dialect, Lanes) else {}
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            inputs, outputs = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_INPUT:
                names[outputs[0]] = f"a{inputs[0]}[{inputs[1]}]"
            elif operation == ca.OP_OUTPUT:
                lines.append(f"  r{outputs[0]}[{outputs[1]}] = {names[inputs[0]]};")
            elif operation == ca.OP_CONST:
                names[outputs[0]] = dialect.constant(function.instruction_constant(k))
            else:
                count += 1
                if operation in CALLED and operation not in INLINE:
                    library[CALLED[operation]] += 1
                operands = [names[i] for i in inputs] if operation in BINARY else [names[inputs[0]]]
                if k in pairs:
                    sine, cosine = pairs[k]
                    if k == min(sine, cosine):
                        lines.append(f"  V v{sine}, v{cosine}; v_sincos({operands[0]}, &v{sine}, &v{cosine});")
                    names[outputs[0]] = f"v{k}"
                    continue
                lines.append(f"  const {dialect.type} v{k} = {dialect.operation(operation, *operands)};")
                names[outputs[0]] = f"v{k}"
        self.operations[name], self.library[name] = count, library
        unused = [f"  (void)a{i};" for i in range(function.n_in()) if not any(f"a{i}[" in line for line in lines)]
        unused += [f"  (void)r{i};" for i in range(function.n_out()) if not any(f"r{i}[" in line for line in lines)]
        return "\n".join([f"{self._signature(function, name, False)} {{", *unused, *lines, "}", ""])

    def _matrices(self, function: ca.Function, name: str, in_place: bool) -> str:
        writer = MatrixWriter(self, function, in_place)
        lines = writer.lines()
        self.operations[name], self.scratch[name] = writer.count, writer.scratch
        self.library[name] = writer.library
        unused = [
            f"  (void){letter}{i};"
            for letter, n in (("a", function.n_in()), ("r", function.n_out()))
            for i in range(1 if in_place else 0, n)
            if not any(f"{letter}{i}" in line for line in lines)
        ]
        arrays = [f"  {self.dialect.type} w[{writer.scratch}];"] if writer.scratch else []
        loops = [f"  int {v};" for v in "ijk" if any(f"for ({v} = 0" in line for line in lines)]
        head = [f"{self._signature(function, name, in_place)} {{", *writer.tables, *arrays, *loops, *unused]
        return "\n".join([*head, *lines, "}", ""])


def _sines_and_cosines(function: ca.Function) -> dict[int, tuple[int, int]]:
    """Return for each sine and cosine of the same angle the instructions of both: C has one function for the pair."""
    slots: dict[int, int] = {}
    found: dict[int, dict[int, int]] = {}
    for k in range(function.n_instructions()):
        operation, outputs = function.instruction_id(k), function.instruction_output(k)
        if operation in (ca.OP_SIN, ca.OP_COS):
            found.setdefault(slots[function.instruction_input(k)[0]], {})[operation] = k
        if operation != ca.OP_OUTPUT:
            slots[outputs[0]] = k
    both = [(each[ca.OP_SIN], each[ca.OP_COS]) for each in found.values() if len(each) == 2]
    return {k: pair for pair in both for k in pair}
