"""Joints that carry one another: their dynamics on the frames of their links, and their stick and
slip, exactly, each held by its own friction; as CasADi expressions.

Dynamics are recursive Newton–Euler. A joint's frame has its origin at `offset` in the frame of its
parent and is turned about `axis` by θ; at θ = 0 both are parallel. The centre of mass and the
inertia of a link are given in the frame of its joint. The method is that of Featherstone, Rigid
Body Dynamics Algorithms, 2008, chapter 5, written in three dimensions instead of six.

With friction, the velocity v⁺ solves A v⁺ + f = r with f_j = u_j where v_j⁺ > 0, −d_j where v_j⁺ <
0, and −d_j ≤ f_j ≤ u_j where v_j⁺ = 0. For a symmetric positive definite A there is one solution,
the minimum of ½ vᵀA v − rᵀv + Σ friction. To find which joints slip, the load is changed in a
straight line from one, r₀, for which the solution is known, to r (parametric pivoting; Cottle,
Pang, Stone, The Linear Complementarity Problem, 1992, section 4.5). On this line are events: at
each of them one joint stops or breaks loose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from distal.expressions import Matrix, Scalar, Vector, rotation, symbols
from distal.model.parameters import Parameters
from distal.rig import Rig


class Chain:
    """The links of a rig as a tree of rigid bodies. Joint angles q [rad] and their speeds v [rad/s]
    are (n_joints,).
    """

    def __init__(self, rig: Rig, parameters: Parameters) -> None:
        self.rig = rig
        self._p = parameters
        self.parents = [rig.parent_of(i) for i in range(len(rig.joints))]

    def vector(self, path: str) -> Vector:
        """Return the vector at a path of the description, (3,)."""
        return ca.vertcat(*(self._p[f"{path}.{k}"] for k in range(3)))

    def gravity(self) -> Vector:
        """Return the acceleration of free fall in the base's frame, (3,) [m/s²]."""
        turned = ca.SX.eye(3)
        for k, axis in enumerate(np.eye(3).tolist()):
            # each turn is about an axis of the world, after those before it
            turned = ca.mtimes(rotation(axis, self._p[f"base.orientation.{k}"]), turned)
        return ca.mtimes(turned.T, self.vector("base.gravity"))

    def _axis(self, joint: int) -> Vector:
        return ca.DM(self.rig.joints[joint].axis)

    def mass_matrix(self, q: Vector) -> Matrix:
        """Return the links' inertia matrix at q, (n_joints, n_joints) [kg m²]: the derivative of
        `torques` by the acceleration, in which these are linear.
        """
        n = len(self.parents)
        a = ca.SX.sym("a", n)
        slopes = ca.jacobian(self.torques(q, ca.SX(n, 1), a), a)
        return ca.tril2symm(ca.tril(slopes))

    def torques(self, q: Vector, v: Vector, acceleration: Vector) -> Vector:
        """Return the joint torques M(q) q̈ + c(q, v) + g(q) that a motion of the links needs,
        (n_joints,) [N m], by recursive Newton–Euler. The `acceleration` is q̈, (n_joints,)
        [rad/s²].
        """
        n = len(self.parents)
        # of each joint's frame in the frame of its parent
        turned = [rotation(joint.axis, q[i]) for i, joint in enumerate(self.rig.joints)]
        resting = (ca.SX(3, 1), ca.SX(3, 1), -self.gravity())
        moving = list[tuple[Vector, Vector, Vector]]()
        loads = list[tuple[Vector, Vector]]()
        for i in range(n):
            parent = self.parents[i]
            axis = self._axis(i)
            spin, twist, linear = resting if parent is None else moving[parent]
            offset = self.vector(f"joints.{i}.offset")
            back = turned[i].T
            linear = ca.mtimes(
                back, linear + ca.cross(twist, offset) + ca.cross(spin, ca.cross(spin, offset))
            )
            spin = ca.mtimes(back, spin)
            twist = ca.mtimes(back, twist) + axis * acceleration[i] + ca.cross(spin, axis * v[i])
            spin = spin + axis * v[i]
            moving.append((spin, twist, linear))
            if self.rig.joints[i].link is None:
                loads.append((ca.SX(3, 1), ca.SX(3, 1)))
                continue
            mass = self._p[f"joints.{i}.link.mass"]
            centre, inertia = (self.vector(f"joints.{i}.link.{x}") for x in ("centre", "inertia"))
            force = mass * (
                linear + ca.cross(twist, centre) + ca.cross(spin, ca.cross(spin, centre))
            )
            loads.append(
                (force, inertia * twist + ca.cross(spin, inertia * spin) + ca.cross(centre, force))
            )
        needed = [ca.SX(0)] * n
        for i in reversed(range(n)):
            force, torque = loads[i]
            needed[i] = ca.dot(self._axis(i), torque)
            parent = self.parents[i]
            if parent is not None:
                force = ca.mtimes(turned[i], force)
                torque = ca.mtimes(turned[i], torque) + ca.cross(
                    self.vector(f"joints.{i}.offset"), force
                )
                loads[parent] = (loads[parent][0] + force, loads[parent][1] + torque)
        return ca.vertcat(*needed)


SWEEPS = 2
"""Number of sweeps of projected Gauss–Seidel that make the first guess; a good guess saves events.
Source: benchmark (python -m benchmarks.chains stick-slip).
"""

NO_EVENT = 2.0
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
    signs = (v > 0) - (v < 0)
    residual = load - ca.mtimes(matrix, v)
    high = ca.if_else(v < 0, -down, up)
    low = ca.if_else(v > 0, up, -down)
    g = ca.fmin(ca.fmax(residual, low), high)
    change = residual - g
    state = (signs, v, g, ca.SX(1))
    follow = _event(n)
    for _ in range(EVENTS * n if events is None else events):
        state = follow(matrix, change, up, down, *state)
    return Slip(state[0] > 0, state[0] < 0)


def _swept(matrix: Matrix, load: Vector, up: Vector, down: Vector) -> Vector:
    """Return velocities near the solution, (n,), by `SWEEPS` of projected Gauss–Seidel from
    rest.
    """
    n = matrix.size1()
    v = [ca.SX(0)] * n
    for _ in range(SWEEPS):
        for j in range(n):
            left = load[j] - sum(matrix[j, i] * v[i] for i in range(n) if i != j)
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
    inputs = symbols(ca.SX, A=(n, n), change=n, u=n, d=n, signs=n, v=n, g=n, left=1)
    matrix, change, up, down, signs, v, g, left = inputs
    moving = signs * signs
    held = 1 - moving
    span = up + down
    dv = solver(matrix, moving)(change)
    dg = held * (change - ca.mtimes(matrix, dv))
    # for a joint that slips dg is zero, for one that sticks v and dv are zero
    distance = held * ((dg > 0) * span - down - g) - v
    rate = dv + dg
    happens = ca.logic_or(signs * dv < 0, dg != 0)
    time = ca.fmax(distance / (rate + (rate == 0)), 0)
    times = NO_EVENT + happens * (time - NO_EVENT)
    soonest = left
    for j in range(n):
        soonest = ca.fmin(soonest, times[j])
    after = list[Scalar]()
    assigned = ca.SX(soonest >= left)
    for j in range(n):
        mine = ca.logic_and(times[j] <= soonest, 1 - assigned)
        assigned = assigned + mine
        after.append(signs[j] + mine * (ca.sign(dg[j]) - signs[j]))
    # the velocity of a joint that has just stopped is zero
    stands = ca.vertcat(*after) ** 2
    state = [ca.vertcat(*after), stands * (v + soonest * dv), g + soonest * dg, left - soonest]
    return ca.Function(
        "event", inputs, [ca.densify(part) for part in state], {"cse": True, "never_inline": True}
    )
