"""Random functions of matrices, of all operations that the emitter knows, made so that tests can be
strict: inputs and constants are small whole numbers, operations keep them whole, and no number
grows above 2²⁴. Sums and products are then exact in any order, in float too, so results must be
equal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Any

import casadi as ca
import numpy as np

LARGEST = 2.0**24
DRAWN = 2
"""Largest of the whole numbers that are drawn."""
N = 4


@dataclass(frozen=True)
class Term:
    """An expression, and a bound of its numbers."""

    value: Any
    bound: float = DRAWN

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (int(self.value.size1()), int(self.value.size2()))

    @property
    def numel(self) -> int:
        """How many numbers."""
        return self.shape[0] * self.shape[1]


def drawn_numbers(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Return random whole numbers."""
    return rng.integers(-DRAWN, DRAWN + 1, size=shape).astype(float)


class Graph:
    """A growing set of terms, from which operands are drawn, the newer ones more often."""

    def __init__(self, seed: int, terms: list[Any]) -> None:
        self.rng = np.random.default_rng(seed)
        self.terms = [Term(value) for value in terms]

    def add(self, value: Any, bound: float) -> None:
        """Take a term in if its numbers are small enough, and not zeros that CasADi leaves out."""
        if bound <= LARGEST and value.numel() <= 40 and value.is_dense():
            self.terms.append(Term(value, bound))

    def drawn(self, fits: Callable[[Term], bool] = lambda term: True) -> Term:
        """Return a term that fits."""
        known = [term for term in self.terms if fits(term)]
        return known[int(len(known) * sqrt(self.rng.uniform()))]

    def some(self, items: list[Any]) -> Any:
        """Return one of them."""
        return items[int(self.rng.integers(len(items)))]

    def indices(self, size: int) -> list[int]:
        """Return some of so many indices, in any order."""
        return self.rng.permutation(size)[: int(self.rng.integers(1, size + 1))].tolist()  # type: ignore[no-any-return]

    def elementwise(self) -> None:
        """Add a function of one term, or of two of one shape, or of one and a single number."""
        a = self.drawn()
        b = self.drawn(lambda v: v.shape == a.shape or v.numel == 1 or a.numel == 1)
        u, v = a.value, b.value
        self.add(self.some([-u, ca.fabs(u), ca.sign(u)]), a.bound)
        self.add(self.some([u + v, u - v, ca.fmin(u, v)]), a.bound + b.bound)
        self.add(u * v, a.bound * b.bound)

    def slice(self) -> None:
        """Add rows and columns, scattered numbers, every second one, or neighbours."""
        a = self.drawn(lambda v: v.numel > 3)
        n, m = a.shape
        flat, draw = ca.vec(a.value), self.rng.integers
        options = [
            a.value[int(draw(n)), :],
            a.value[:, int(draw(m))],
            flat[int(draw(n * m)) :],
            flat[draw(n * m, size=int(draw(1, 8))).tolist()],
            flat[:: int(draw(2, 4))],
            flat[::-1],
            a.value[n // 3 :, m // 3 :],
            ca.diag(a.value) if n == m else flat[0],
        ]
        self.add(self.some(options), a.bound)

    def change(self) -> None:
        """Add a term with a slice that is set: to its own numbers in another order, to another's,
        to one number, or added to.
        """
        a = self.drawn(lambda v: v.numel > 3)
        at, way = self.indices(a.numel), self.rng.integers(4)
        b = self.drawn(lambda v: v.numel == 1 if way == 3 else v.numel >= len(at))
        value, new = ca.MX(a.value), b.value
        if way == 0:
            new, b = ca.vec(a.value)[self.rng.permutation(a.numel).tolist()], a
        if way < 3:
            new = ca.reshape(ca.vec(new)[: len(at)], *value[at].shape)
        value[at] = value[at] + new if way == 1 else new
        self.add(value, a.bound + b.bound)

    def gradient(self) -> None:
        """Add what reverse differentiation makes: an addition into a slice."""
        a, at = self.drawn(lambda v: v.shape == (N, 1)), self.indices(N)
        b = self.drawn(lambda v: v.numel >= N)
        point = ca.MX.sym("point", N)
        inner = ca.dot(point[at], ca.vec(b.value)[: len(at)]) + ca.dot(point, point)
        value = ca.graph_substitute(ca.gradient(inner, point), [point], [a.value])
        self.add(value, 2 * a.bound + b.bound)

    def shape(self) -> None:
        """Add a transpose, another shape, or a column."""
        a = self.drawn(lambda v: v.numel > 1)
        n, m = a.shape
        shapes = [a.value.T, ca.reshape(a.value, m, n), ca.vec(a.value)]
        self.add(self.some([*shapes, ca.reshape(a.value, 1, n * m)]), a.bound)

    def pieces(self) -> None:
        """Add terms put together, or one of the pieces that a term or a constant is cut into."""
        a = self.drawn(lambda v: v.shape[0] > 1)
        n, m = a.shape
        b = self.drawn(lambda v: v.shape[1] == m)
        c = self.drawn(lambda v: v.shape[0] == n)
        middle, right = int(self.rng.integers(1, n)), int(self.rng.integers(0, m + 1))
        constant = ca.MX(ca.DM(drawn_numbers(self.rng, n, m)))
        options = [
            ca.vertcat(a.value, b.value),
            ca.vertcat(ca.vec(b.value), ca.vec(a.value)),
            ca.horzcat(a.value, c.value),
            self.some(ca.vertsplit(a.value, [0, middle, n])),
            self.some([v for v in ca.horzsplit(a.value, sorted({0, right, m})) if v.numel()]),
            self.some(ca.vertsplit(constant, [0, middle, n])),
        ]
        self.add(self.some(options), max(a.bound, b.bound, c.bound))

    def sum_of_products(self, x: Term, y: Term) -> None:
        """Add x y, alone or on top of a term, which may be one of its factors."""
        inner, shape = x.shape[1], (x.shape[0], y.shape[1])
        same = [term for term in self.terms if term.shape == shape]
        z = self.some([*same, Term(ca.MX.zeros(*shape), 0.0)])
        self.add(ca.mac(x.value, y.value, z.value), z.bound + inner * x.bound * y.bound)

    def product(self) -> None:
        """Add a dense product."""
        x = self.drawn(lambda v: min(v.shape) > 1)
        y = self.drawn(lambda v: x.shape[1] in (v.shape[0], v.shape[1]))
        turned = Term(y.value.T, y.bound)
        self.sum_of_products(x, y if y.shape[0] == x.shape[1] else turned)

    def sparse_product(self) -> None:
        """Add a product with one sparse factor, of few or of many numbers, constant or from a
        call.
        """
        a, is_left = self.drawn(lambda v: min(v.shape) > 1), self.rng.uniform() < 0.5
        n, m = a.shape
        size = int(self.rng.integers(1, 5))
        factor = ca.DM(drawn_numbers(self.rng, *((size, n) if is_left else (m, size))))
        there = self.rng.uniform(size=factor.shape) < self.rng.uniform(0.2, 0.8)
        if not there.any() or there.all():
            return
        value = ca.DM(ca.sparsify(ca.DM(there.astype(float))).sparsity(), 1) * factor
        b = Term(ca.MX(value))
        if self.rng.uniform() < 0.5:
            scale, one = self.drawn(lambda v: v.numel == 1), ca.SX.sym("one")
            made = ca.Function(f"sparse{len(self.terms)}", [one], [ca.SX(value) * one])
            b = Term(made(scale.value), DRAWN * scale.bound)
        self.sum_of_products(*((b, a) if is_left else (a, b)))

    def rank_one(self) -> None:
        """Add A + α x yᵀ; α is −1, a constant or a term; x and y may lie in A."""
        a, scale = self.drawn(lambda v: min(v.shape) > 1), self.drawn(lambda v: v.numel == 1)
        n, m = a.shape
        x, y = (self.drawn(lambda v, k=k: v.numel >= k) for k in (n, m))
        alpha = self.some([Term(ca.MX(-1)), Term(ca.MX(2)), scale])
        value = ca.rank1(a.value, alpha.value, ca.vec(x.value)[:n], ca.vec(y.value)[-m:])
        self.add(value, a.bound + alpha.bound * x.bound * y.bound)

    def dot(self) -> None:
        """Add a sum of products, or of squares."""
        x = self.drawn(lambda v: v.numel > 1)
        y = self.drawn(lambda v: v.numel == x.numel)
        self.add(ca.dot(ca.vec(x.value), ca.vec(y.value)), x.numel * x.bound * y.bound)

    def call(self) -> None:
        """Add what a function of scalars, or of matrices, makes of two terms; some of its results
        may be unused.
        """
        a, b = self.drawn(), self.drawn()
        kind = self.some([ca.SX, ca.MX])
        u, v = kind.sym("u", *a.shape), kind.sym("v", *b.shape)
        first, last = ca.vec(u)[0], ca.vec(v)[-1]
        outputs = [u + last, ca.horzcat(first, last), ca.vec(v) * first]
        made = ca.Function(f"called{len(self.terms)}", [u, v], outputs)(a.value, b.value)
        for i in self.indices(3):
            self.add(made[i], a.bound * b.bound if i == 2 else a.bound + b.bound)

    def constant(self) -> None:
        """Add a constant matrix."""
        self.add(ca.MX(ca.DM(drawn_numbers(self.rng, N, int(self.rng.integers(1, N + 1))))), DRAWN)


def matrix_graph(seed: int) -> ca.Function:
    """Return a function (state, x) → (state, y, z); the new state is made of terms and of its own
    pieces.
    """
    state, x = ca.MX.sym("state", N + N * N + 2), ca.MX.sym("x", 6)
    matrix = ca.reshape(state[N : N + N * N], N, N)
    graph = Graph(seed, [state[:N], matrix, state[N + N * N :], x, x[:N], x[-1]])
    moving = [graph.slice, graph.change, graph.gradient, graph.shape, graph.pieces, graph.constant]
    summing = [graph.product, graph.sparse_product, graph.rank_one, graph.dot, graph.call]
    for _ in range(graph.rng.integers(8, 30)):
        graph.some([*moving, *summing, *3 * [graph.elementwise]])()
    following = [
        ca.vec(graph.drawn(lambda v, size=size: v.numel == size).value) for size in (N, N * N, 2)
    ]
    if graph.rng.uniform() < 0.3:
        graph.rng.shuffle(following)
    y = ca.vertcat(*(ca.vec(graph.drawn().value) for _ in range(3)))
    return ca.Function(
        f"matrices{seed}", [state, x], [ca.vertcat(*following), y, graph.terms[-1].value]
    )
