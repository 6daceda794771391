"""C from CasADi's functions: the numbers of CasADi's own evaluation, in each dialect, in place and
not.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest

from distal.codegen import CodeError, Emitter, Lanes, Plain
from distal.codegen.emitter import WRITERS
from distal.codegen.instructions import Value
from distal.kernels import find_compiler
from distal.kernels.compiler import OPTIMISED, OPTIMISED_LANES, compiled_source
from distal.model import Limit, soft_moments
from tests.codegen.graphs import drawn_numbers, matrix_graph

pytestmark = [
    pytest.mark.usefixtures("as_users_compile"),
    pytest.mark.skipif(isinstance(find_compiler(), str), reason="no C compiler"),
]
DIALECTS = pytest.mark.parametrize(
    "dialect", [Plain(), Lanes(4), Plain(single=True)], ids=["double", "lanes", "float"]
)
UNARY = [
    *(ca.exp, ca.sin, ca.cos, ca.tan, ca.atan, ca.sinh, ca.cosh, ca.tanh, ca.expm1, ca.erf),
    *(ca.fabs, ca.sign, ca.floor, ca.ceil, ca.logic_not),
    lambda v: ca.sqrt(ca.fabs(v)),
    lambda v: ca.log(1 + v * v),
    lambda v: ca.log1p(v * v),
    lambda v: ca.asin(v / 9),
    lambda v: ca.acos(v / 9),
    lambda v: 2 * v,
    lambda v: -v,
    lambda v: 1 / (v + 9),
    lambda v: ca.fabs(v) ** 3.5,
]
BINARY = [
    *(ca.fmin, ca.fmax, ca.atan2, ca.hypot, ca.copysign, ca.logic_and, ca.logic_or),
    lambda u, v: ca.fabs(u) ** v,
    lambda u, v: u / (v + 9),
    lambda u, v: u < v,
    lambda u, v: u <= v,
    lambda u, v: u == v,
    lambda u, v: u != v,
    lambda u, v: ca.if_else(u > 0, v, u),
    lambda u, v: u - v * 1.25e-3,
]


def scalars(kind: Any) -> ca.Function:
    """Return a function of every operation that models use; its state is turned around."""
    a, b, c = kind.sym("a", 4), kind.sym("b", 4), kind.sym("c")
    odd = ca.DM([np.nan, np.inf, -np.inf, 1.0])
    more = [c * a, ca.if_else(c > 5, np.nan, a), ca.fmax(a, odd)]
    y = ca.vertcat(*(f(a) for f in UNARY), *(f(a, b) for f in BINARY), *more)
    following = ca.vertcat(a[2], a[0] + c, a[0], a[3])
    return ca.Function(f"scalars_{kind.__name__}", [a, b, c], [following, y])


def compiled(functions: Sequence[ca.Function], dialect: Plain | Lanes) -> Callable[..., list[Any]]:
    """Return what calls one of the functions in C, by its number, apart or in place, with arguments
    and results of (numbers, lanes).
    """
    emitter, calls = Emitter(dialect), []
    for k, function in enumerate(functions):
        for in_place in (False, True):
            names = [f"v{i}" for i in range(function.n_in() + function.n_out() - in_place)]
            head = ", ".join(f"{dialect.type}* {name}" for name in names)
            called = f"{emitter.add(function, in_place)}({', '.join(names)})"
            calls.append(f"void call{k}_{int(in_place)}({head}) {{ {called}; }}")
    text = ["#include <math.h>", dialect.prelude(emitter.text), emitter.text, *calls]
    level = OPTIMISED if isinstance(dialect, Plain) else OPTIMISED_LANES
    library = ctypes.CDLL(str(compiled_source("\n".join(text) + "\n", level)))

    def aligned(values: np.ndarray) -> np.ndarray:
        raw = np.zeros(values.size + 8, "f4" if dialect == Plain(True) else "f8")
        raw = raw[-raw.ctypes.data % 32 // raw.itemsize :][: values.size].reshape(values.shape)
        raw[:] = values
        return raw

    def call(k: int, arguments: list[np.ndarray], in_place: bool) -> list[np.ndarray]:
        given, lanes = list(map(aligned, arguments)), arguments[0].shape[1]
        sizes = [functions[k].nnz_out(i) for i in range(in_place, functions[k].n_out())]
        made = [aligned(np.full((size, lanes), np.nan)) for size in sizes]
        address = (ctypes.c_void_p(array.ctypes.data) for array in (*given, *made))
        getattr(library, f"call{k}_{int(in_place)}")(*address)
        return [given[0], *made] if in_place else made

    return call


def check(
    functions: Sequence[ca.Function],
    dialect: Plain | Lanes,
    draw: Callable[[np.random.Generator, int, int], np.ndarray],
    **tolerances: float,
) -> None:
    """Compare functions in C with CasADi's evaluation; `draw` makes arguments."""
    call, rng = compiled(functions, dialect), np.random.default_rng(0)
    lanes = 1 if isinstance(dialect, Plain) else dialect.count
    for k, function in enumerate(functions):
        for in_place in (False, True):
            given = [draw(rng, function.nnz_in(i), lanes) for i in range(function.n_in())]
            made = call(k, given, in_place)
            for lane in range(lanes):
                for found, known in zip(made, function.call([ca.DM(a[:, lane]) for a in given])):
                    np.testing.assert_allclose(
                        found[:, lane], known.nonzeros(), **tolerances, err_msg=function.name()
                    )


@DIALECTS
def test_numbers_are_casadis(dialect: Plain | Lanes) -> None:
    """With corners: zeros, equal numbers, both signs."""

    def draw(rng: np.random.Generator, size: int, lanes: int) -> np.ndarray:
        values = rng.normal(size=(size, lanes))
        if size > 1:
            values[:2] = [[0.0], [0.7]]
        return values

    exact = 1e-13 if dialect != Plain(single=True) else 1e-5
    check([scalars(kind) for kind in (ca.SX, ca.MX)], dialect, draw, rtol=2 * exact, atol=exact)


@DIALECTS
@pytest.mark.parametrize("count", [30, pytest.param(400, marks=pytest.mark.more)])
def test_random_graphs_are_exact(dialect: Plain | Lanes, count: int) -> None:
    check([matrix_graph(seed) for seed in range(count)], dialect, drawn_numbers, rtol=0, atol=0)


def test_random_graphs_have_every_operation_on_matrices() -> None:
    graphs = [matrix_graph(seed) for seed in range(30)]
    seen = {graph.instruction_id(k) for graph in graphs for k in range(graph.n_instructions())}
    assert set(WRITERS) <= seen


def test_zeros_of_both_signs_are_not_all_the_same() -> None:
    """1/x, copysign and atan2 tell them apart."""
    assert not Value(None, 0, 2, ids=(0.0, -0.0)).is_uniform
    assert Value(None, 0, 2, ids=(0.0, 0.0)).is_uniform


def test_in_place_needs_little_scratch() -> None:
    """The covariance is changed where it lies: no loop copies its 25 numbers."""
    p, x = ca.MX.sym("p", 5, 5), ca.MX.sym("x", 5)
    across = ca.mtimes(p, x)
    update = ca.Function("update", [p, x], [ca.rank1(p, -1, across, across) * 2])
    sizes = []
    for in_place in (True, False):
        emitter = Emitter(Plain())
        emitter.add(update, in_place)
        sizes.append(emitter.functions["update"].scratch)
        assert ("i < 25; ++i) w" in emitter.text) is not in_place
    assert sizes[0] < sizes[1]


X = ca.MX.sym("x", 2, 2)
LONG = ca.MX.sym("x", 65_537)


@pytest.mark.parametrize(
    ("inputs", "output", "in_place", "said"),
    [
        ([X], ca.inv(X), False, "has no C here"),
        ([X], ca.vertcat(X, X), True, "'f' has no C in place: its first input and output differ"),
        (
            [LONG],
            LONG[[65_536, 3, 7, 100]],
            False,
            "an index of 65536 does not fit into 'unsigned short'",
        ),
    ],
)
def test_what_has_no_c_is_said(
    inputs: list[ca.MX], output: ca.MX, in_place: bool, said: str
) -> None:
    with pytest.raises(CodeError, match=said):
        Emitter(Plain()).add(ca.Function("f", inputs, [output]), in_place)


def test_moments_in_float_are_those_in_double() -> None:
    """What a small std leaves over stays a part of its square: a float has 7 digits, and none may
    be lost.
    """
    arguments = [ca.SX.sym(name) for name in ("z", "limit", "std")]
    z, limit, std = arguments
    moments = soft_moments(z, Limit(limit, limit), std)
    function = ca.Function("moments", arguments, [moments.mean, moments.slope, moments.rest])
    call = compiled([function], Plain(single=True))
    for z in (-2.0, -0.501, -0.5, 0.0, 0.3, 0.5, 0.5001, 1.7):
        for std in (1e-9, 1e-6, 1e-3, 0.1, 1.0):
            given = np.array([z, 0.5, std], dtype=np.float32).reshape(3, 1, 1)
            made = np.ravel(call(0, list(given), False))
            known = np.ravel(function(*given.ravel().astype(float)))
            assert made[:2] == pytest.approx(known[:2], abs=1e-5)
            assert made[2] == pytest.approx(known[2], abs=1e-4 * std**2)
