"""Exact stick and slip of joints that carry one another, each held by its own friction.

The velocity v⁺ solves A v⁺ + f = r with the friction f_j = u_j where v_j⁺ > 0, −d_j where v_j⁺ < 0,
and −d_j ≤ f_j ≤ u_j where v_j⁺ = 0. For a symmetric positive definite A there is one solution, the
minimum of ½ vᵀA v − rᵀv + Σ friction. To find which joints slip, the load is changed in a straight
line from one, r₀, for which the solution is known, to r (parametric pivoting; Cottle, Pang, Stone,
The Linear Complementarity Problem, 1992, section 4.5). On this line are events: at each of them one
joint stops or breaks loose.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from distal.expressions import Matrix, Scalar, Vector

SWEEPS = 2
"""Number of sweeps of projected Gauss–Seidel that make the first guess; a good guess saves events.
Source: judgement.
"""

NEVER = 2.0
"""Share of the load's change that stands for an event that does not come: any number above 1.
Source: definition (the change ends at a share of 1).
"""

EVENTS = 2
"""Number of events that are followed for each joint: a hundred thousand random loads needed no
more. Source: benchmark (docs/results/numerics.md).
"""


@dataclass(frozen=True)
class Slip:
    """Which joints slip, and in which direction, (n,) each: `forward` is 1 for a joint that slips
    to +, `back` is 1 for one that slips to −; otherwise they are 0.
    """

    forward: Vector
    back: Vector

    @property
    def moving(self) -> Vector:
        """1 for each joint that slips, in either direction, 0 for one that sticks, (n,)."""
        return self.forward + self.back

    def friction(self, up: Vector, down: Vector) -> Vector:
        """Return the friction of each joint that slips, 0 for one that sticks, (n,). The friction
        limits are `up` against + motion and `down` against − motion, (n,).
        """
        return self.forward * up - self.back * down


def solver(matrix: Matrix, weight: Vector) -> Callable[[Vector], Vector]:
    """Return the function b → x that solves A_SS x_S = b_S by L D Lᵀ for the joints S whose
    `weight` is 1; x = 0 for those whose weight is 0.

    A weight w between 0 and 1 blends both: x = w (w A w with the diagonal of A)⁻¹ w b. The `matrix`
    A, (n, n), is symmetric positive definite; the weights are (n,).
    """
    scaled = ca.mtimes([ca.diag(weight), matrix, ca.diag(weight)])
    for i in range(matrix.size1()):
        scaled[i, i] = matrix[i, i]
    factors = ca.ldl(scaled, False)
    return lambda b: weight * ca.ldl_solve(weight * b, *factors)


def slipping(
    matrix: Matrix,
    load: Vector,
    up: Vector,
    down: Vector,
    start: Vector | None = None,
    events: int | None = None,
) -> Slip:
    """Return which joints slip under a load, and in which direction.

    Args:
        matrix: A, symmetric positive definite, (n, n).
        load: r, (n,).
        up: friction limits against + motion, (n,).
        down: friction limits against − motion, (n,).
        start: velocities near the solution, (n,); default those of `SWEEPS` of Gauss–Seidel.
        events: number of events that are followed; default `EVENTS` for each joint.
    """
    n = matrix.size1()
    if matrix.sparsity().is_diag():
        # no joint moves another; where the limit is 0 (no friction, or no time passes) a load of 0
        # counts as slip: nothing holds the joint
        return Slip(load >= up, load < -down)
    v = _swept(matrix, load, up, down) if start is None else start
    # direction of each joint that slips, 0 for one that sticks
    signs: Sequence[Scalar] = [(v[j] > 0) - (v[j] < 0) for j in range(n)]
    residual = load - ca.mtimes(matrix, v)
    held = list[Scalar]()
    for j in range(n):
        high = ca.if_else(v[j] < 0, -down[j], up[j])
        low = ca.if_else(v[j] > 0, up[j], -down[j])
        held.append(ca.fmin(ca.fmax(residual[j], low), high))
    g = ca.vertcat(*held)
    left = ca.SX(1)
    change = residual - g
    state = (ca.vertcat(*signs), v, g, left)
    follow = _event(n)
    for _ in range(EVENTS * n if events is None else events):
        state = follow(matrix, change, up, down, *state)
    return Slip(state[0] > 0, state[0] < 0)


def _swept(matrix: Matrix, load: Vector, up: Vector, down: Vector) -> Vector:
    """Return velocities near the solution, (n,), by `SWEEPS` of projected Gauss–Seidel from
    rest.
    """
    n = matrix.size1()
    v = [ca.SX(0)] * matrix.size1()
    for _ in range(SWEEPS):
        for j in range(n):
            left = load[j] - sum((matrix[j, i] * v[i] for i in range(n) if i != j), ca.SX(0))
            v[j] = (ca.fmax(left - up[j], 0) + ca.fmin(left + down[j], 0)) / matrix[j, j]
    return ca.vertcat(*v)


@lru_cache(maxsize=64)
def _event(n: int) -> ca.Function:
    """Return the function (A, the load's change, up, down, signs, velocity, friction, share left) →
    the last four of these after the next event.

    While the load changes in a straight line, the velocities of the joints that slip and the
    friction of those that stick change in straight lines, too. A joint stops where its velocity
    comes to zero; it breaks loose where its friction comes to a limit.

    The function stays one of its own in C: a chain follows many events, and their code is there
    once.
    """
    matrix = ca.SX.sym("A", n, n)
    change, up, down, signs, v, g = symbols = [
        ca.SX.sym(name, n) for name in ("change", "u", "d", "signs", "v", "g")
    ]
    left = ca.SX.sym("left")
    moving = signs * signs
    held = 1 - moving
    span = up + down
    dv = solver(matrix, moving)(change)
    dg = held * (change - ca.mtimes(matrix, dv))
    soonest = left
    times = []
    for j in range(n):
        # for a joint that slips dg is zero, for one that sticks v and dv are zero
        distance = held[j] * ((dg[j] > 0) * span[j] - down[j] - g[j]) - v[j]
        rate = dv[j] + dg[j]
        happens = ca.logic_or(signs[j] * dv[j] < 0, dg[j] != 0)
        time = ca.fmax(distance / (rate + (rate == 0)), 0)
        times.append(NEVER + happens * (time - NEVER))
        soonest = ca.fmin(soonest, times[-1])
    after = list[Scalar]()
    assigned = ca.SX(soonest >= left)
    for j in range(n):
        mine = ca.logic_and(times[j] <= soonest, 1 - assigned)
        assigned = assigned + mine
        after.append(signs[j] + mine * (ca.sign(dg[j]) - signs[j]))
    # the velocity of a joint that has just stopped is zero
    stands = ca.vertcat(*(sign * sign for sign in after))
    state = [ca.vertcat(*after), stands * (v + soonest * dv), g + soonest * dg, left - soonest]
    inputs = [matrix, *symbols, left]
    return ca.Function(
        "event", inputs, [ca.densify(part) for part in state], {"cse": True, "never_inline": True}
    )
