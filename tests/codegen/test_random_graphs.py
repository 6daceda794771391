"""Random functions in the emitter's C and in CasADi's interpreter, with the same numbers: in place
or not, and in lanes.
"""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from distal.codegen import Emitter, Lanes, Plain
from distal.codegen.emitter import WRITERS
from distal.kernels import find_compiler
from tests.codegen.graphs import given, matrix_graph, scalar_graph

pytestmark = [
    pytest.mark.skipif(isinstance(find_compiler(), str), reason="no C compiler"),
]
LANES = 4
TOLERANCE = 1e-12
"""Of smooth graphs, relative to the largest number of an output, or to 1 if that is less: sums are
taken in another order than CasADi's, and the generator lets no term in whose rounding errors, in
any order, could exceed `ALLOWED`, 4e-13. Whole graphs have no rounding errors, and no tolerance.
"""
FLAGS = ["-O1", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared", "-w"]


def graph(seed: int) -> ca.Function:
    """Return a graph: every fourth pair of seeds is of scalars, the others are of matrices."""
    return scalar_graph(seed) if seed % 8 >= 6 else matrix_graph(seed)


def caller(name: str, called: str, function: ca.Function, way: str) -> str:
    """Return a C function whose inputs lie one after the other in one array, and its outputs in
    another one.
    """
    inputs = np.cumsum([0, *(function.nnz_in(i) for i in range(function.n_in()))])
    outputs = np.cumsum([0, *(function.nnz_out(i) for i in range(function.n_out()))])
    head = f"void {name}(const double* in, double* out)"
    if way == "in place":
        positions = [
            "out",
            *(f"in + {i}" for i in inputs[1:-1]),
            *(f"out + {i}" for i in outputs[1:-1]),
        ]
        state = f"for (int i = 0; i < {inputs[1]}; ++i) out[i] = in[i];"
        return f"{head} {{ {state} {called}({', '.join(positions)}); }}"
    if way == "apart":
        positions = [*(f"in + {i}" for i in inputs[:-1]), *(f"out + {i}" for i in outputs[:-1])]
        return f"{head} {{ {called}({', '.join(positions)}); }}"
    n, m = inputs[-1], outputs[-1]
    positions = [*(f"x + {i}" for i in inputs[:-1]), *(f"y + {i}" for i in outputs[:-1])]
    return (
        f"{head} {{ V x[{n}], y[{m}]; int i, l; for (i = 0; i < {n}; ++i) for (l = 0; l < "
        f"{LANES}; ++l) "
        f"x[i][l] = in[l * {n} + i]; {called}({', '.join(positions)}); for (i = 0; i < {m}; ++i) "
        f"for (l = 0; l < {LANES}; ++l) out[l * {m} + i] = y[i][l]; }}"
    )


def built(
    functions: dict[int, ca.Function], way: str, folder: Path
) -> Callable[[int, np.ndarray], np.ndarray]:
    """Compile graphs in one file; return what runs one of them, by its seed, over inputs (runs,
    n).
    """
    compiler = find_compiler()
    assert not isinstance(compiler, str)
    emitter = Emitter(Lanes(LANES) if way == "lanes" else Plain())
    callers = [
        caller(f"run{seed}", emitter.add(function, way == "in place"), function, way)
        for seed, function in functions.items()
    ]
    source, library = folder / f"{way.replace(' ', '_')}.c", folder / f"{way.replace(' ', '_')}.so"
    source.write_text(
        "\n".join(
            ["#include <math.h>", emitter.dialect.prelude(emitter.text), emitter.text, *callers]
        )
    )
    subprocess.run(
        [*compiler.command, *FLAGS, str(source), "-o", str(library), "-lm"], check=True, timeout=300
    )
    loaded = ctypes.CDLL(str(library))

    def run(seed: int, inputs: np.ndarray) -> np.ndarray:
        size = sum(functions[seed].nnz_out(i) for i in range(functions[seed].n_out()))
        out = np.full((len(inputs), size), np.nan)
        call = getattr(loaded, f"run{seed}")
        together = [(inputs, out)] if way == "lanes" else list(zip(inputs, out))
        for one, made in together:
            call(ctypes.c_void_p(one.ctypes.data), ctypes.c_void_p(made.ctypes.data))
        return out

    return run


def disagreements(seeds: range, way: str, folder: Path) -> list[str]:
    """Return what differs between graphs in C and CasADi's interpreter."""
    functions = {seed: graph(seed) for seed in seeds}
    run = built(functions, way, folder)
    found = []
    for seed, function in functions.items():
        runs = [given(function, seed + 1000 * i) for i in range(LANES if way == "lanes" else 2)]
        made = run(seed, np.array([np.concatenate(one) for one in runs]))
        for inputs, row in zip(runs, made):
            begin = 0
            for i in range(function.n_out()):
                known = np.array(function.call([ca.DM(one) for one in inputs])[i].nonzeros())
                part = row[begin : begin + len(known)]
                begin += len(known)
                allowed = 0.0 if seed % 2 else TOLERANCE * max(1.0, np.abs(known).max(initial=0.0))
                assert np.isfinite(known).all(), f"graph {seed} is not what it should be"
                if not (np.abs(part - known) <= allowed).all():
                    found.append(
                        f"graph {seed}, {way}, output {i}: {np.abs(part - known).max():.1e}"
                    )
    return found


@pytest.mark.parametrize("way", ["apart", "in place", "lanes"])
@pytest.mark.slow
def test_some_random_graphs(way: str, tmp_path: Path) -> None:
    assert not disagreements(range(12) if way == "lanes" else range(30), way, tmp_path)


@pytest.mark.slow
@pytest.mark.more
@pytest.mark.parametrize("way", ["apart", "in place", "lanes"])
def test_400_random_graphs(way: str, tmp_path: Path) -> None:
    assert not disagreements(range(100) if way == "lanes" else range(400), way, tmp_path)


def test_graphs_have_every_operation_on_matrices() -> None:
    seen: set[int] = set()
    for seed in range(60):
        function = graph(seed)
        seen |= (
            {function.instruction_id(k) for k in range(function.n_instructions())}
            if seed % 8 < 6
            else set()
        )
    assert set(WRITERS) <= seen
