"""Random functions of scalars and of matrices, of all operations that the emitter knows, made so
that tests can be strict.

Half of them are *whole*: inputs and constants are small whole numbers, operations keep them whole,
and no number grows above 2⁵⁰. Sums and products are then exact in any order, so results must be
equal. These have the operations that jump.

The others are *smooth*: each term carries a bound of its numbers and a bound of their rounding
errors (running error analysis, Higham 2002, §3.3), and a term whose error could exceed `ALLOWED` is
thrown away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import exp, sqrt
from typing import Any

import casadi as ca
import numpy as np

LARGEST = {True: 2.0**50, False: 50.0}
"""Bound of whole and of smooth numbers."""
ALLOWED = 4e-13
"""Bound of a smooth term's rounding errors; two results, each with its own order of sums, differ by
twice that at most.
"""
UNIT = 2.0**-52
N = 4

Grow = Callable[[float], float]


@dataclass(frozen=True)
class Term:
    """An expression, a bound of its numbers, and one of their errors."""

    value: Any
    bound: float
    error: float = 0.0

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (int(self.value.size1()), int(self.value.size2()))

    @property
    def numel(self) -> int:
        """How many numbers."""
        return self.shape[0] * self.shape[1]


@dataclass(frozen=True)
class Rule:
    """A function of one number: up to which bound of its argument it may be used, its own bound,
    its largest slope.
    """

    function: Callable[[Any], Any]
    bound: Grow
    slope: Grow
    up_to: float = 2.0**50


SMOOTH = [
    Rule(ca.sin, lambda b: 1, lambda b: 1),
    Rule(ca.cos, lambda b: 1, lambda b: 1),
    Rule(ca.tanh, lambda b: 1, lambda b: 1),
    Rule(ca.atan, lambda b: 2, lambda b: 1),
    Rule(ca.erf, lambda b: 1, lambda b: 1.2),
    Rule(ca.exp, exp, exp, 2),
    Rule(ca.expm1, exp, exp, 2),
    Rule(ca.sinh, exp, exp, 2),
    Rule(ca.cosh, exp, exp, 2),
    Rule(lambda v: ca.tan(v / 2), lambda b: 2, lambda b: 2, 2),
    Rule(lambda v: ca.asin(v / 2), lambda b: 1, lambda b: 1, 1),
    Rule(lambda v: ca.acos(v / 4), lambda b: 3, lambda b: 1, 2),
    Rule(lambda v: ca.sqrt(v * v + 1), lambda b: b + 1, lambda b: b + 1),
    Rule(lambda v: ca.log(v * v + 1), lambda b: b + 1, lambda b: 2 * b + 1),
    Rule(lambda v: ca.log1p(v * v), lambda b: b + 1, lambda b: 2 * b + 1),
    Rule(lambda v: 1 / (v * v + 1), lambda b: 1, lambda b: 2 * b + 1),
    Rule(lambda v: (v * v + 1) ** 1.5, lambda b: (b + 1) ** 3, lambda b: 3 * (b + 1) ** 2, 3),
]
BOTH = [
    Rule(ca.fabs, lambda b: b, lambda b: 1),
    Rule(lambda v: -v, lambda b: b, lambda b: 1),
    Rule(lambda v: 2 * v, lambda b: 2 * b, lambda b: 2),
    Rule(lambda v: v * v, lambda b: b * b, lambda b: 2 * b),
]
WHOLE = [
    Rule(ca.sign, lambda b: 1, lambda b: 0),
    Rule(ca.logic_not, lambda b: 1, lambda b: 0),
    Rule(lambda v: ca.floor(v * 0.5), lambda b: b, lambda b: 0),
    Rule(lambda v: ca.ceil(v * 0.25), lambda b: b, lambda b: 0),
]
COMPARED = [
    lambda u, v: u < v,
    lambda u, v: u <= v,
    lambda u, v: u == v,
    lambda u, v: u != v,
    ca.logic_and,
    ca.logic_or,
]
CHOSEN = [
    lambda u, v: ca.if_else(u > 0, v, u),
    lambda u, v: ca.copysign(u, v + 0.5),
    lambda u, v: ca.if_else(v, u, 0),
]


class Terms:
    """A growing set of terms, from which operands are drawn, the newer ones more often.

    Args:
        seed: of all that is drawn; odd ones are whole.
        kind: ca.SX or ca.MX.
    """

    def __init__(self, seed: int, kind: Any) -> None:
        self.rng, self.kind, self.whole = np.random.default_rng(seed), kind, seed % 2 == 1
        self.terms: list[Term] = []

    def add(self, term: Term) -> bool:
        """Take a term in if its numbers and their errors are small enough."""
        fits = term.bound <= LARGEST[self.whole] and (self.whole or term.error <= ALLOWED)
        if fits:
            self.terms.append(term)
        return fits

    def drawn(self, fits: Callable[[Term], bool] = lambda term: True) -> Term:
        """Return a term that fits."""
        known = [term for term in self.terms if fits(term)]
        return known[int(len(known) * sqrt(self.rng.uniform()))]

    def ids(self, *shape: int) -> np.ndarray:
        """Return random numbers: whole ones of up to 3, smooth ones of up to 1."""
        if self.whole:
            return self.rng.integers(-3, 4, size=shape).astype(float)
        return self.rng.uniform(-1.0, 1.0, size=shape)

    @property
    def size(self) -> float:
        """Bound of drawn numbers."""
        return 3.0 if self.whole else 1.0

    def some(self, items: list[Any]) -> Any:
        """Return one of them."""
        return items[int(self.rng.integers(len(items)))]

    def unary(self) -> bool:
        """Add a function of one term."""
        a = self.drawn()
        rule = self.some([*BOTH, *(WHOLE if self.whole else SMOOTH)])
        if a.bound > rule.up_to:
            return False
        bound = float(rule.bound(a.bound))
        return self.add(
            Term(
                rule.function(a.value),
                bound,
                rule.slope(a.bound) * a.error + 8 * UNIT * (bound + a.bound),
            )
        )

    def binary(self) -> bool:
        """Add an operation of two terms of one shape, or of one and a single number."""
        a = self.drawn()
        b = self.drawn(lambda v: v.shape == a.shape or v.numel == 1 or a.numel == 1)
        u, v, added, largest = a.value, b.value, a.bound + b.bound, max(a.bound, b.bound)
        error = a.error + b.error + 2 * UNIT * added
        product = a.bound * b.error + b.bound * a.error + UNIT * a.bound * b.bound
        options = [
            (lambda: u + v, added, error),
            (lambda: u - v, added, error),
            (lambda: u * v, a.bound * b.bound, product),
            (lambda: ca.fmin(u, v), largest, error),
            (lambda: ca.fmax(u, v), largest, error),
        ]
        if self.whole:
            options += [(lambda f=f: f(u, v), 1.0, 0.0) for f in COMPARED]
            options += [(lambda f=f: f(u, v), added, 0.0) for f in CHOSEN]
        else:
            options += [
                (
                    lambda: u / (v * v + 1),
                    a.bound,
                    a.error + a.bound * (2 * b.bound + 1) * (b.error + 4 * UNIT),
                ),
                (
                    lambda: ca.hypot(u, v + 2 * b.bound + 1),
                    2 * added + 2,
                    2 * error + 8 * UNIT * (added + 1),
                ),
                (lambda: ca.atan2(u, v * v + 1), 2.0, error * (2 * b.bound + 1) + 8 * UNIT),
                (lambda: ca.copysign(u, v + b.bound + 1), a.bound, error),
                (
                    lambda: (u * u + 1) ** ca.tanh(v),
                    a.bound**2 + 1,
                    8 * (a.bound + 1) ** 3 * (error + 4 * UNIT),
                ),
            ]
        value, bound, error = self.some(options)
        return self.add(Term(value(), float(bound), float(error)))


def scalar_graph(seed: int) -> ca.Function:
    """Return a function (carry, x) → (carry, y) of scalars.

    Args:
        seed: of what is drawn; odd ones are whole.
    """
    graph = Terms(seed, ca.SX)
    kernel_state, x = ca.SX.sym("kernel_state", 5), ca.SX.sym("x", 4)
    graph.terms = [
        Term(v, graph.size)
        for v in (*ca.vertsplit(kernel_state), *ca.vertsplit(x), ca.SX(float(graph.ids(1)[0])))
    ]
    for _ in range(graph.rng.integers(8, 40)):
        graph.some([graph.unary, graph.binary])()
    following = [graph.drawn().value for _ in range(5)]
    outputs = [ca.vertcat(*following), ca.vertcat(*(graph.drawn().value for _ in range(6)))]
    return ca.Function(
        f"scalars{seed}", [kernel_state, x], [ca.densify(output) for output in outputs]
    )


class Matrices(Terms):
    """Terms of matrices."""

    def matrix(self) -> Term:
        """Return a matrix with several rows and columns."""
        return self.drawn(lambda v: min(v.shape) > 1)

    def vector(self, n: int) -> Term:
        """Return a column."""
        return self.drawn(lambda v: v.shape == (n, 1))

    def slice(self) -> bool:
        """Add rows and columns, scattered numbers, every second one, or neighbours."""
        a = self.drawn(lambda v: v.numel > 3)
        n, m = a.shape
        flat, draw = ca.vec(a.value), self.rng.integers
        value = self.some(
            [
                lambda: a.value[int(draw(n)), :],
                lambda: a.value[:, int(draw(m))],
                lambda: flat[sorted(draw(0, n * m, size=2).tolist())[0] :],
                lambda: flat[draw(n * m, size=int(draw(1, 8))).tolist()],
                lambda: flat[:: int(draw(2, 4))],
                lambda: flat[::-1],
                lambda: a.value[n // 3 :, m // 3 :],
                lambda: ca.diag(a.value) if n == m else flat[0],
            ]
        )()
        return self.add(Term(value, a.bound, a.error))

    def change(self) -> bool:
        """Add a term with a slice that is set: to another's numbers, to its own ones, to one
        number, or added to.
        """
        a = self.drawn(lambda v: v.numel > 3)
        value, size = ca.MX(a.value), a.numel
        at = self.rng.permutation(size)[: int(self.rng.integers(1, size + 1))].tolist()
        way = self.rng.integers(4)
        if way == 0:  # its own numbers, in another order
            value[at] = ca.reshape(
                ca.vec(a.value)[self.rng.permutation(size)[: len(at)].tolist()], *value[at].shape
            )
            return self.add(Term(value, a.bound, a.error))
        b = (
            self.drawn(lambda v: v.numel >= len(at))
            if way < 3
            else self.drawn(lambda v: v.numel == 1)
        )
        new = ca.reshape(ca.vec(b.value)[: len(at)], *value[at].shape) if way < 3 else b.value
        if way == 1:
            value[at] += new
            return self.add(
                Term(value, a.bound + b.bound, a.error + b.error + UNIT * (a.bound + b.bound))
            )
        value[at] = new
        return self.add(Term(value, max(a.bound, b.bound), a.error + b.error))

    def gradient(self) -> bool:
        """Add what reverse differentiation makes: an addition into a slice."""
        a, size = self.vector(N), int(self.rng.integers(1, N + 1))
        at, b = self.rng.permutation(N)[:size].tolist(), self.drawn(lambda v: v.numel >= N)
        point = ca.MX.sym("point", N)
        inner = ca.dot(point[at], ca.vec(b.value)[:size]) + ca.dot(point, point)
        value = ca.graph_substitute(ca.gradient(inner, point), [point], [a.value])
        bound = 2 * a.bound + b.bound
        return self.add(Term(value, bound, 2 * a.error + b.error + 4 * UNIT * bound))

    def shape(self) -> bool:
        """Add a transpose, another shape, or a column."""
        a = self.drawn(lambda v: v.numel > 1)
        n, m = a.shape
        value = self.some(
            [a.value.T, ca.reshape(a.value, m, n), ca.vec(a.value), ca.reshape(a.value, 1, n * m)]
        )
        return self.add(Term(value, a.bound, a.error))

    def pieces(self) -> bool:
        """Add terms put together, or one of the pieces that a term is cut into."""
        a = self.drawn(lambda v: v.shape[0] > 1)
        n, m = a.shape
        b = self.drawn(lambda v: v.shape[1] == m)
        c = self.drawn(lambda v: v.shape[0] == n)
        middle, right = int(self.rng.integers(1, n)), int(self.rng.integers(0, m + 1))
        constant = Term(ca.MX(ca.DM(self.ids(n, m))), self.size)
        options = [
            (ca.vertcat(a.value, b.value), a, b),
            (ca.vertcat(ca.vec(b.value), ca.vec(a.value)), a, b),
            (ca.horzcat(a.value, c.value), a, c),
            (self.some(ca.vertsplit(a.value, [0, middle, n])), a, a),
            (
                self.some([v for v in ca.horzsplit(a.value, sorted({0, right, m})) if v.numel()]),
                a,
                a,
            ),
            (self.some(ca.vertsplit(constant.value, [0, middle, n])), constant, constant),
        ]
        value, one, other = self.some(options)
        return value.numel() <= 40 and self.add(
            Term(value, max(one.bound, other.bound), max(one.error, other.error))
        )

    def _product(self, value: Any, z: Term, x: Term, y: Term, inner: int) -> bool:
        """Add z + x y with `inner` products in each sum."""
        bound = z.bound + inner * x.bound * y.bound
        error = (
            z.error + inner * (x.bound * y.error + y.bound * x.error) + (inner + 2) * UNIT * bound
        )
        return self.add(Term(value, bound, error))

    def product(self) -> bool:
        """Add a dense product, alone or on top of a term, which may be one of its factors."""
        x = self.matrix()
        n, inner = x.shape
        y = self.drawn(lambda v: v.shape[0] == inner or v.shape == (n, inner))
        if y.shape[0] != inner:
            y = Term(y.value.T, y.bound, y.error)
        nothing = Term(ca.MX.zeros(n, y.shape[1]), 0.0)
        same = [term for term in self.terms if term.shape == (n, y.shape[1])]
        z = self.some([*same, nothing])
        if z is nothing:
            return self._product(ca.mtimes(x.value, y.value), z, x, y, inner)
        return self._product(ca.mac(x.value, y.value, z.value), z, x, y, inner)

    def sparse_product(self) -> bool:
        """Add a product with one sparse factor, of few or of many numbers, constant or from a
        call.
        """
        a = self.matrix()
        n, m = a.shape
        left = self.rng.uniform() < 0.5
        rows, columns = (
            (int(self.rng.integers(1, 5)), n) if left else (m, int(self.rng.integers(1, 5)))
        )
        there = self.rng.uniform(size=(rows, columns)) < self.rng.uniform(0.2, 0.8)
        if not there.any() or there.all():
            return False
        pattern = ca.sparsify(ca.DM(there.astype(float))).sparsity()
        ids = self.ids(pattern.nnz())
        factor: Any = ca.DM(pattern, ids)
        b = Term(factor, self.size)
        if self.rng.uniform() < 0.5:
            scale = self.drawn(lambda v: v.numel == 1)
            one = ca.SX.sym("one")
            made = ca.Function(f"sparse{len(self.terms)}", [one], [ca.SX(factor) * one])
            b = Term(
                made(scale.value),
                b.bound * scale.bound,
                b.bound * (scale.error + UNIT * scale.bound),
            )
        shape = (rows, m) if left else (n, columns)
        same = [term for term in self.terms if term.shape == shape]
        z = self.some([*same, Term(ca.MX.zeros(*shape), 0.0)])
        x, y = (b, a) if left else (a, b)
        return self._product(ca.mac(x.value, y.value, z.value), z, x, y, n if left else m)

    def rank_one(self) -> bool:
        """Add A + α x yᵀ; α is −1, a constant or a term; x and y may lie in A."""
        a, scale = self.matrix(), self.drawn(lambda v: v.numel == 1)
        n, m = a.shape
        x, y = (self.drawn(lambda v, k=k: v.numel >= k) for k in (n, m))
        alpha = self.some([Term(ca.MX(-1), 1.0), Term(ca.MX(2), 2.0), scale])
        value = ca.rank1(a.value, alpha.value, ca.vec(x.value)[:n], ca.vec(y.value)[-m:])
        scaled = Term(
            None,
            alpha.bound * x.bound,
            alpha.bound * x.error + x.bound * (alpha.error + alpha.bound * UNIT),
        )
        return self._product(value, a, scaled, y, 1)

    def dot(self) -> bool:
        """Add a sum of products, or of squares."""
        x = self.drawn(lambda v: v.numel > 1)
        y = self.drawn(lambda v: v.numel == x.numel)
        nothing = Term(None, 0.0)
        return self._product(ca.dot(ca.vec(x.value), ca.vec(y.value)), nothing, x, y, x.numel)

    def call(self) -> bool:
        """Add what a function of scalars, or of matrices, makes of two terms; one of its results
        may be unused.
        """
        a, b = self.drawn(), self.drawn()
        kind = self.some([ca.SX, ca.MX])
        u, v = kind.sym("u", *a.shape), kind.sym("v", *b.shape)
        first, last = ca.vec(u)[0], ca.vec(v)[-1]
        outputs = [u + last, ca.horzcat(first, last), ca.vec(v) * first]
        called = ca.Function(f"called{len(self.terms)}", [u, v], outputs)
        made = called(a.value, b.value)
        both, error = a.bound + b.bound, a.error + b.error
        product = Term(
            made[2],
            a.bound * b.bound,
            a.bound * b.error + b.bound * a.error + UNIT * a.bound * b.bound,
        )
        terms = [Term(made[0], both, error + 2 * UNIT * both), Term(made[1], both, error), product]
        for i in self.rng.permutation(3)[: int(self.rng.integers(1, 4))]:
            self.add(terms[i])
        return True

    def constant(self) -> bool:
        """Add a constant matrix."""
        return self.add(
            Term(ca.MX(ca.DM(self.ids(N, int(self.rng.integers(1, N + 1))))), self.size)
        )


def matrix_graph(seed: int) -> ca.Function:
    """Return a function (carry, x) → (carry, y, z) of matrices; the new carry is made of terms and
    of its own pieces.

    Args:
        seed: of what is drawn; odd ones are whole.
    """
    graph = Matrices(seed, ca.MX)
    kernel_state, x = ca.MX.sym("kernel_state", N + N * N + 2), ca.MX.sym("x", 6)
    parts = [
        kernel_state[:N],
        ca.reshape(kernel_state[N : N + N * N], N, N),
        kernel_state[N + N * N :],
    ]
    graph.terms = [Term(value, graph.size) for value in (*parts, x, x[:N], x[-1])]
    ways = [
        graph.slice,
        graph.change,
        graph.gradient,
        graph.shape,
        graph.pieces,
        graph.product,
        graph.sparse_product,
    ]
    ways += [
        graph.rank_one,
        graph.dot,
        graph.call,
        graph.constant,
        *2 * [graph.unary],
        *4 * [graph.binary],
    ]
    for _ in range(graph.rng.integers(8, 30)):
        graph.some(ways)()
    following = []
    for size in (N, N * N, 2):
        known = [term for term in graph.terms if term.numel == size]
        following.append(ca.vec(known[int(len(known) * sqrt(graph.rng.uniform()))].value))
    shuffled = (
        [following[i] for i in graph.rng.permutation(3)] if graph.rng.uniform() < 0.3 else following
    )
    outputs = [
        ca.vertcat(*shuffled),
        ca.vertcat(*(ca.vec(graph.drawn().value) for _ in range(3))),
        graph.terms[-1].value,
    ]
    return ca.Function(f"matrices{seed}", [kernel_state, x], outputs)


def given(function: ca.Function, seed: int) -> list[np.ndarray]:
    """Return inputs of a graph: whole or smooth as its seed says.

    Args:
        function: the graph.
        seed: the one that it was made with.
    """
    drawn = Terms(seed, None)
    return [drawn.ids(function.numel_in(i)) for i in range(function.n_in())]
