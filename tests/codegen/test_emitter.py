"""C from CasADi's functions: the numbers of CasADi's own evaluation, in each dialect, in place or
not.
"""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np
import pytest

from distal.codegen import CodeError, Emitter, Lanes, Plain
from distal.codegen.writers import Value
from distal.kernels import find_compiler
from distal.kernels.compiler import compiled_source
from distal.model import soft_moments

pytestmark = [
    pytest.mark.usefixtures("as_users_compile"),
    pytest.mark.skipif(isinstance(find_compiler(), str), reason="no C compiler"),
]


def scalars() -> ca.Function:
    """Return a function of every operation that models use, with corners: zeros, equal numbers,
    both signs.
    """
    a, b, c = ca.SX.sym("a", 4), ca.SX.sym("b", 4), ca.SX.sym("c")
    unary = [
        ca.exp,
        ca.sin,
        ca.cos,
        ca.tan,
        ca.atan,
        ca.sinh,
        ca.cosh,
        ca.tanh,
        ca.fabs,
        ca.sign,
        ca.floor,
        ca.ceil,
    ]
    unary += [
        ca.expm1,
        ca.erf,
        lambda v: ca.sqrt(ca.fabs(v)),
        lambda v: ca.log(1 + v * v),
        lambda v: ca.log1p(v * v),
    ]
    unary += [
        lambda v: ca.asin(v / 9),
        lambda v: ca.acos(v / 9),
        lambda v: 2 * v,
        lambda v: v * v,
        lambda v: -v,
    ]
    unary += [lambda v: 1 / (v + 9), ca.logic_not]
    binary = [
        ca.fmin,
        ca.fmax,
        ca.atan2,
        ca.hypot,
        ca.copysign,
        lambda u, v: ca.fabs(u) ** v,
        lambda u, v: u / (v + 9),
    ]
    binary += [
        lambda u, v: u < v,
        lambda u, v: u <= v,
        lambda u, v: u == v,
        lambda u, v: u != v,
        ca.logic_and,
        ca.logic_or,
    ]
    binary += [
        lambda u, v: ca.if_else(u > 0, v, u),
        lambda u, v: u - v * 1.25e-3,
        lambda u, v: u + v,
    ]
    parts = (
        [f(a) for f in unary]
        + [f(a, b) for f in binary]
        + [c * a, ca.fabs(a) ** 3.5, ca.if_else(c > 5, np.nan, a)]
    )
    y = ca.vertcat(*parts)
    return ca.Function("scalars", [a, b, c], [a + b, y])


def matrices() -> ca.Function:
    """Return a function of every operation on matrices, with a carry that can be changed in
    place.
    """
    n = 5
    kernel_state, x, p = (
        ca.MX.sym("kernel_state", n + n * n + 2),
        ca.MX.sym("x", 4),
        ca.MX.sym("p", 2),
    )
    mean, rest = kernel_state[:n], kernel_state[n + n * n :]
    covariance = ca.reshape(kernel_state[n : n + n * n], n, n)
    s, t = ca.SX.sym("s", n), ca.SX.sym("t", 4)
    row = ca.SX(ca.Sparsity.triplet(1, n, [0, 0, 0], [0, 2, 3]))
    row[0, 0], row[0, 2], row[0, 3] = t[0], ca.sin(s[1]), t[3] * s[4]
    piece = ca.Function("piece", [s, t], [row, ca.densify(row.T), s * t[1]])
    slope, dense, scaled = piece(mean, x)
    across = ca.mtimes(covariance, slope.T)
    spread = ca.mtimes(slope, across) + p[0]
    gain = across / spread
    changed = ca.rank1(covariance, -1, across, gain)
    changed = ca.rank1(changed, p[1], dense, scaled)
    two = ca.mtimes(ca.horzcat(dense, scaled).T, changed)
    changed[0:2, 2:] = two[:, 2:]
    changed[2:, 0:2] = two[:, 2:].T
    diagonal = list(range(0, n * n, n + 1))
    flat = ca.vec(changed)
    flat[diagonal] += p[0] * x[2]
    odd = flat[[3, 1, 7, 20]]
    pieces = ca.vertsplit(mean, [0, 2, n])
    mean_next = ca.vertcat(pieces[1], pieces[0]) + gain * ca.dot(mean, dense)
    y = ca.vertcat(
        spread,
        odd,
        ca.fmax(rest, x[:2]),
        ca.mtimes(two, mean),
        ca.DM([1.0, -2.5, 3.0, 4.0]) * x,
        two[0, :].T,
    )
    following = ca.vertcat(mean_next, flat, ca.vertcat(rest[1], rest[0]) * x[3])
    return ca.Function("matrices", [kernel_state, x, p], [following, y])


def run(
    function: ca.Function, arguments: list[np.ndarray], dialect: Plain, in_place: bool
) -> list[np.ndarray]:
    emitter = Emitter(dialect)
    name = emitter.add(function, in_place)
    kind = np.float32 if dialect.single else np.float64
    skip = 1 if in_place else 0
    names = [f"{dialect.type}* v{i}" for i in range(function.n_in() + function.n_out() - skip)]
    call = (
        f"void call({', '.join(names)}) {{ "
        f"{name}({', '.join(f'v{i}' for i in range(len(names)))}); }}"
    )
    library = ctypes.CDLL(
        str(
            compiled_source(
                f"#include <math.h>\n{dialect.prelude(emitter.text)}\n{emitter.text}\n{call}\n"
            )
        )
    )
    given = [np.array(a, dtype=kind) for a in arguments]
    made = [
        np.full(function.numel_out(i), np.nan, dtype=kind) for i in range(skip, function.n_out())
    ]
    library.call(*(ctypes.c_void_p(a.ctypes.data) for a in (*given, *made)))
    return [given[0], *made] if in_place else made


def arguments_of(function: ca.Function, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    given = [rng.normal(size=function.numel_in(i)) for i in range(function.n_in())]
    given[0][:2], given[1][:2] = (0.0, 0.7), (0.0, 0.7)
    return given


@pytest.mark.parametrize("function", [scalars(), matrices()], ids=["scalars", "matrices"])
@pytest.mark.parametrize("single", [False, True], ids=["double", "float"])
def test_numbers_are_casadis(function: ca.Function, single: bool) -> None:
    for seed in range(3):
        given = arguments_of(function, seed)
        expected = [np.array(out).ravel() for out in function(*given)]
        for made, known in zip(run(function, given, Plain(single), False), expected):
            # sums of products are taken in another order than CasADi's
            np.testing.assert_allclose(
                made, known, rtol=2e-5 if single else 1e-13, atol=1e-5 if single else 1e-13
            )


def test_in_place_needs_little_scratch() -> None:
    """The covariance is changed where it lies: no loop copies its 25 numbers."""
    sizes = []
    for in_place in (True, False):
        emitter = Emitter(Plain())
        emitter.add(matrices(), in_place)
        sizes.append(emitter.functions["matrices"].scratch)
        copies = [line for line in emitter.text.splitlines() if "i < 25" in line]
        assert bool(copies) is not in_place
    assert sizes[0] < sizes[1]


def test_the_source_says_the_same_each_time() -> None:
    texts = set()
    for _ in range(2):
        emitter = Emitter(Plain(True))
        emitter.add(matrices(), True)
        texts.add(emitter.text)
    assert len(texts) == 1


def overlapping() -> ca.Function:
    """Return a function in which values change that are read while they change."""
    kernel_state = ca.MX.sym("kernel_state", 9)
    square = ca.reshape(kernel_state, 3, 3)
    above = ca.mac(square, square, square)
    turned = ca.MX(ca.vec(above))
    turned[list(range(8, -1, -1))] = ca.vec(above)
    return ca.Function("overlapping", [kernel_state, ca.MX.sym("x", 2)], [turned, ca.sum1(turned)])


@pytest.mark.parametrize("in_place", [False, True])
def test_a_value_that_is_read_twice_is_not_overwritten_by_the_first_reading(in_place: bool) -> None:
    """A + A A, and a vector turned around in itself: exact in whole numbers."""
    given = [np.arange(1.0, 10.0), np.zeros(2)]
    expected = overlapping()(*given)
    for made, known in zip(run(overlapping(), given, Plain(), in_place), expected):
        np.testing.assert_array_equal(made, np.array(known).ravel())


def test_a_constant_in_pieces() -> None:
    x = ca.MX.sym("x", 2)
    first, second = ca.vertsplit(ca.MX(ca.DM([1.0, 2.0, 3.0, 4.0])), 2)
    function = ca.Function("pieces", [x, ca.MX.sym("y")], [first * x, second + x])
    made = run(function, [np.array([5.0, 6.0]), np.zeros(1)], Plain(), False)
    assert [list(each) for each in made] == [[5.0, 12.0], [8.0, 10.0]]


def test_zeros_keep_their_sign() -> None:
    """Zero equals −0, but 1/x, copysign and atan2 tell them apart."""
    assert [Plain().constant(zero) for zero in (0.0, -0.0, 0.0)] == ["0.0", "(-0.0)", "0.0"]
    assert Value(None, 0, 2, ids=(0.0, 0.0)).is_uniform
    assert not Value(None, 0, 2, ids=(0.0, -0.0)).is_uniform


def test_lanes_have_constants_that_are_no_numbers() -> None:
    """A table of constants is an initializer: neither ``nan`` nor ``inf`` is C."""
    emitter = Emitter(Lanes(2))
    x = ca.MX.sym("x", 4)
    emitter.add(ca.Function("masked", [x], [ca.fmax(x, ca.DM([np.nan, np.inf, -np.inf, 1.0]))]))
    assert (
        "{(double)NAN, (double)NAN}, {INFINITY, INFINITY}, {(-INFINITY), (-INFINITY)}, {1, 1}"
        in emitter.text
    )
    compiled_source(f"#include <math.h>\n{emitter.dialect.prelude(emitter.text)}\n{emitter.text}")


def test_one_emitter_writes_a_function_in_place_and_apart() -> None:
    emitter, function = Emitter(Plain()), matrices()
    assert [emitter.add(function, True), emitter.add(function), emitter.add(function, True)] == [
        "matrices",
        "matrices_2",
        "matrices",
    ]
    assert "void matrices(double* restrict state, const double* restrict a1" in emitter.text
    assert "void matrices_2(const double* restrict a0, const double* restrict a1" in emitter.text


def test_scalars_are_read_before_they_change_in_place() -> None:
    kernel_state, x = ca.SX.sym("kernel_state", 3), ca.SX.sym("x")
    function = ca.Function(
        "turned",
        [kernel_state, x],
        [ca.vertcat(kernel_state[1], kernel_state[0] * x, kernel_state[0]), kernel_state[2] + x],
    )
    made = run(function, [np.array([2.0, 3.0, 4.0]), np.array([5.0])], Plain(), True)
    assert [list(each) for each in made] == [[3.0, 10.0, 2.0], [9.0]]


def test_what_cannot_be_changed_in_place_is_said() -> None:
    x = ca.MX.sym("x", 3)
    with pytest.raises(
        CodeError, match="'longer' has no C in place: its first input and output differ in shape"
    ):
        Emitter(Plain()).add(ca.Function("longer", [x], [ca.vertcat(x, x)]), in_place=True)


def test_an_index_that_does_not_fit_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    x = ca.MX.sym("x", 300)
    function = ca.Function("scattered", [x], [x[[299, 3, 7, 100]]])
    emitter = Emitter(Plain())
    emitter.add(function)
    assert "unsigned short t0[4] = {299, 3, 7, 100}" in emitter.text
    monkeypatch.setattr("distal.codegen.writers.LARGEST_INDEX", 255)
    with pytest.raises(CodeError, match="an index of 299 does not fit into 'unsigned short'"):
        Emitter(Plain()).add(function)


def test_what_has_no_c_is_said() -> None:
    x = ca.MX.sym("x", 2, 2)
    inverse = ca.Function("inverse", [x, ca.MX.sym("y")], [ca.inv(x), ca.det(x)])
    with pytest.raises(CodeError, match="has no C here"):
        Emitter(Plain()).add(inverse)


def test_moments_in_float_are_those_in_double() -> None:
    """What a small std leaves over stays a part of its square: a float has 7 digits, and none may
    be lost.
    """
    arguments = [ca.SX.sym(name) for name in ("z", "limit", "std")]
    moments = soft_moments(*arguments)
    function = ca.Function("moments", arguments, [moments.mean, moments.slope, moments.rest])
    for z in (-2.0, -0.501, -0.5, 0.0, 0.3, 0.5, 0.5001, 1.7):
        for std in (1e-9, 1e-6, 1e-3, 0.1, 1.0):
            given = [np.array([value]) for value in (z, 0.5, std)]
            mean, slope, rest = (
                float(value[0]) for value in run(function, given, Plain(True), False)
            )
            known = [
                float(value) for value in function(*np.array(given, dtype=np.float32).astype(float))
            ]
            assert [mean, slope] == pytest.approx(known[:2], abs=1e-5)
            assert rest == pytest.approx(known[2], abs=1e-4 * std**2)
