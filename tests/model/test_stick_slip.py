"""Coupled stick–slip against a reference that tries every combination of joints that stick and
slip.
"""

from __future__ import annotations

from itertools import product

import casadi as ca
import numpy as np
import pytest

from distal.kernels import Kernel
from distal.model import slipping, solver
from distal.model.friction import EVENTS, SWEEPS, _swept


def velocities(matrix: ca.SX, load: ca.SX, up: ca.SX, down: ca.SX) -> ca.SX:
    """Return the velocities of joints with the inertia A under a load r."""
    slip = slipping(matrix, load, up, down)
    return solver(matrix, slip.moving)(load - slip.friction(up, down))


def random_case(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    """Return (A, r, up, down): dense, a planar chain, or nearly singular, of any scale; loads near
    the friction limits.
    """
    kind = rng.integers(3)
    if kind == 0:
        root = rng.normal(size=(n, n + 1))
        matrix = root @ root.T + 1e-3 * np.eye(n)
    elif kind == 1:
        angles, lengths, masses = (
            rng.uniform(-1.5, 1.5, n).cumsum(),
            rng.uniform(0.01, 0.05, n),
            rng.uniform(1, 30, n),
        )
        ends = np.cumsum(
            lengths[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]), axis=0
        )
        starts = np.vstack([np.zeros(2), ends[:-1]])
        matrix = np.diag(rng.uniform(1e-7, 1e-5, n))
        for i in range(n):
            levers = (starts[i] + ends[i]) / 2 - starts[: i + 1]
            turn = np.zeros((3, n))
            turn[:2, : i + 1], turn[2, : i + 1] = levers[:, ::-1].T, lengths[i] / np.sqrt(12)
            turn[0] *= -1
            matrix += 1e-3 * masses[i] * turn.T @ turn
    else:
        direction = rng.uniform(0.5, 1.5, n)
        matrix = np.outer(direction, direction) + np.diag(10 ** rng.uniform(-3, 0, n))
    scale = np.sqrt(np.diag(matrix)) * 10 ** rng.uniform(-3, 3)
    up = np.abs(rng.normal(size=n)) * scale * 10 ** rng.uniform(-2, 0.5)
    return matrix, rng.normal(size=n) * scale, up, up * rng.uniform(0.3, 1.0, n)


def reference(matrix: np.ndarray, load: np.ndarray, up: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Return v of the one combination of signs that breaks no condition, or breaks them least."""
    n, best, least = len(load), np.zeros(len(load)), np.inf
    for signs in product((-1, 0, 1), repeat=n):
        state = np.array(signs)
        moving = np.flatnonzero(state)
        v, friction = np.zeros(n), np.where(state > 0, up, np.where(state < 0, -down, 0.0))
        if len(moving):
            v[moving] = np.linalg.solve(matrix[np.ix_(moving, moving)], (load - friction)[moving])
        held = load - matrix @ v
        wrong = np.where(
            state == 0, np.maximum(held - up, -down - held), -state * v * np.diag(matrix)
        )
        worst = float(np.max(wrong / (np.abs(load) + up)))
        if worst < least:
            best, least = v, worst
    return best


def function_of(n: int) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) with x = (A, r, up, down), y = v."""
    x = ca.SX.sym("x", n * n + 3 * n)
    matrix, load = ca.reshape(x[: n * n], n, n), x[n * n : n * n + n]
    v = velocities(matrix, load, x[n * n + n : n * n + 2 * n], x[n * n + 2 * n :])
    kernel_state, p = ca.SX.sym("kernel_state"), ca.SX.sym("p", 0)
    return ca.Function(
        "velocities",
        [kernel_state, x, p],
        [kernel_state, ca.cse(v)],
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )


def errors(n: int, count: int, seed: int, compiled: bool) -> np.ndarray:
    rng, kernel = np.random.default_rng(seed), Kernel(function_of(n), compiled)
    found = []
    for _ in range(count):
        matrix, load, up, down = random_case(rng, n)
        _, (v,) = kernel.scan(
            np.zeros(1), np.concatenate([matrix.ravel(), load, up, down]), np.zeros(0)
        )
        expected = reference(matrix, load, up, down)
        found.append(
            np.max(np.abs(v - expected))
            / (np.max(np.abs(expected)) + np.max(np.abs(load)) / matrix.max())
        )
    return np.array(found)


@pytest.mark.parametrize(("n", "count"), [(1, 100), (2, 300), (3, 200), (4, 60)])
def test_it_is_the_reference(n: int, count: int) -> None:
    assert errors(n, count, 100 + n, compiled=False).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "count"), [(2, 5000), pytest.param(3, 4000, marks=pytest.mark.more), (4, 1000)]
)
def test_it_is_the_reference_in_c_on_ten_thousand_cases(n: int, count: int) -> None:
    assert errors(n, count, n, compiled=True).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("n", [5, 6])
def test_longer_chains_break_no_condition(n: int) -> None:
    """2000 cases each: forces that slip are at their limits, those that stick within, to 1e-9 of
    the load.
    """
    rng, kernel = np.random.default_rng(n), Kernel(function_of(n))
    for _ in range(2000):
        matrix, load, up, down = random_case(rng, n)
        _, (v,) = kernel.scan(
            np.zeros(1), np.concatenate([matrix.ravel(), load, up, down]), np.zeros(0)
        )
        held = load - matrix @ v
        wrong = np.where(v > 0, np.abs(held - up), np.where(v < 0, np.abs(held + down), 0.0))
        wrong = np.maximum(wrong, np.where(v == 0, np.maximum(held - up, -down - held), 0.0))
        assert np.max(wrong / (np.abs(load) + up + np.abs(matrix) @ np.abs(v))) < 1e-9


def test_the_number_of_operations_is_bounded() -> None:
    """Nothing repeats until it is done: a function of scalars, growing with n⁴ at most (n events of
    n³).
    """
    sizes = {n: function_of(n).n_instructions() for n in (2, 3, 4, 6)}
    assert EVENTS * 6 == 12
    assert sizes[6] / sizes[3] < 2**3


def test_a_share_of_slipping_lies_between_stick_and_slip() -> None:
    matrix, load = ca.SX([[2.0, 0.5], [0.5, 1.0]]), ca.SX([1.0, 1.0])
    ends = [
        np.array(ca.evalf(solver(matrix, ca.SX(w))(load))).ravel()
        for w in ([1, 0], [1, 0.5**0.5], [1, 1])
    ]
    assert ends[0][1] == 0.0
    assert ends[0][1] < ends[1][1] < ends[2][1]
    np.testing.assert_allclose(
        ends[2], np.linalg.solve([[2.0, 0.5], [0.5, 1.0]], [1.0, 1.0]), rtol=1e-12
    )


def test_a_search_begins_at_two_sweeps_of_gauss_seidel() -> None:
    """Typed out: each joint in turn by soft thresholding of what the others leave, twice from
    rest.
    """
    rng = np.random.default_rng(6)
    for n in (2, 3, 4):
        matrix, load, up, down = random_case(rng, n)
        v = np.zeros(n)
        for _ in range(SWEEPS):
            for j in range(n):
                left = load[j] - matrix[j] @ v + matrix[j, j] * v[j]
                v[j] = (max(left - up[j], 0.0) + min(left + down[j], 0.0)) / matrix[j, j]
        swept = _swept(*(ca.SX(ca.DM(each)) for each in (matrix, load, up, down)))
        found = ca.Function("v", [], [swept])()["o0"].full().ravel()
        np.testing.assert_allclose(found, v, rtol=1e-9, atol=1e-12 * np.abs(v).max())
