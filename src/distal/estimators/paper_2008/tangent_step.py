"""One interval between samples with its derivatives, which are propagated from sub-step to
sub-step.
"""

from __future__ import annotations

import casadi as ca

from distal.expressions import Matrix, MatrixNode, Vector
from distal.model import Kick, Mechanism, kick_and_drift, responses
from distal.model.stepping import last_kick


def tangent_step(mechanism: Mechanism, count: int) -> ca.Function:
    """Return the function (q, v, effort, effort_end, dt, p) → (q⁺, v⁺, S) of an interval of `count`
    sub-steps, with S = ∂(q⁺, v⁺)/∂(q, v, pulls of the drives).

    S, (2 n_bodies, 2 n_bodies + n_drives), is propagated from sub-step to sub-step: S_v⁺ = ∂v⁺/∂q
    S_q + ∂v⁺/∂v S_v + ∂v⁺/∂effort and S_q⁺ = S_q + h S_v⁺. The derivative of friction is 0 in stick
    and 1 in slip; bodies do not bounce off stops.

    The effort on the bodies changes in a straight line from `effort` to `effort_end`. If it were
    held, its jump at every sample would shake light sliders on stiff tendons. A column of S for a
    pull is the derivative with respect to a shift of both ends.
    """
    n = mechanism.n_bodies
    columns = 2 * mechanism.n_bodies + mechanism.n_drives
    p = mechanism.parameters.symbols
    q, v, effort = (ca.SX.sym(name, n) for name in ("q", "v", "effort"))
    length = ca.SX.sym("length")
    drift = ca.SX.sym("drift")
    symbols = q, v, effort, ca.SX.sym("response", n, 4), length, drift
    kick = Kick(*symbols)
    q_moved, v_moved = kick_and_drift(mechanism, kick, rebounds=False)
    inputs = [*symbols, p]
    moving = _step(
        "substep", mechanism, _linearised("kick", mechanism, inputs, v_moved, q_moved), True
    )
    closing = _step(
        "last_kick",
        mechanism,
        _linearised("half_kick", mechanism, inputs, last_kick(mechanism, kick)),
        False,
    )
    prepared = ca.Function(
        "responses", [length, drift, p], [responses(mechanism, length, drift, rebounds=False)]
    )

    q, v, effort, effort_end = (ca.MX.sym(name, n) for name in ("q", "v", "effort", "effort_end"))
    dt = ca.MX.sym("dt")
    p = ca.MX.sym("p", p.numel())
    h = dt / count
    half = prepared(h / 2, h, p)
    full = prepared(h, h, p)
    # transposed: the slopes of one body lie side by side, so that a processor takes several at once
    identity = ca.DM.eye(columns)
    s_q = ca.MX(ca.densify(identity[:, :n]))
    s_v = ca.MX(ca.densify(identity[:, n : 2 * n]))
    q_next = q
    v_next = v
    for i in range(count):
        pull = effort + (i / count) * (effort_end - effort)
        step = (half, h / 2) if i == 0 else (full, h)
        q_next, v_next, s_q, s_v = moving(q_next, v_next, s_q, s_v, pull, *step, h, p)
    v_last, s_v = closing(q_next, v_next, s_q, s_v, effort_end, half, h / 2, h, p)
    return ca.Function(
        "tangent_interval",
        [q, v, effort, effort_end, dt, p],
        [q_next, v_last, ca.horzcat(s_q, s_v).T],
        ["q", "v", "effort", "effort_end", "dt", "p"],
        ["q_next", "v_next", "S"],
    )


def _linearised(
    name: str, mechanism: Mechanism, symbols: list[Matrix], velocity: Vector, *more: Vector
) -> ca.Function:
    """Return the function of a kick with the transposed slopes of its velocity, sparse, with
    respect to q, v and the drives' pulls.
    """
    q, v, effort = symbols[:3]
    slopes = [ca.jacobian(velocity, by) for by in (q, v)] + [
        ca.jacobian(velocity, effort)[:, mechanism.n_joints :]
    ]
    dense = [ca.densify(vector) for vector in (velocity, *more)]
    return ca.Function(name, symbols, ca.cse([*(ca.sparsify(slope).T for slope in slopes), *dense]))


def _step(name: str, mechanism: Mechanism, kick: ca.Function, drifts: bool) -> ca.Function:
    """Return the function of a kick and, where `drifts`, the drift that follows, which also
    propagates the slopes.

    (q, v, S_qᵀ, S_vᵀ, effort, response, length, drift, p) → (q⁺, v⁺, S_qᵀ⁺, S_vᵀ⁺), or (v⁺, S_vᵀ⁺).
    """
    n = mechanism.n_bodies
    columns = 2 * mechanism.n_bodies + mechanism.n_drives
    q, v, effort, response = (
        ca.MX.sym(x, n, k) for x, k in (("q", 1), ("v", 1), ("effort", 1), ("response", 4))
    )
    s_q, s_v = (ca.MX.sym(x, columns, n) for x in ("s_q", "s_v"))
    length = ca.MX.sym("length")
    drift = ca.MX.sym("drift")
    p = ca.MX.sym("p", kick.size1_in(6))
    by_q, by_v, by_effort, v_next, *moved = kick(q, v, effort, response, length, drift, p)
    following = _chained((by_q, by_v, by_effort), s_q, s_v)
    outputs = (
        [*moved, v_next, s_q + drift * following, following] if drifts else [v_next, following]
    )
    return ca.Function(name, [q, v, s_q, s_v, effort, response, length, drift, p], outputs)


def _chained(slopes: tuple[MatrixNode, ...], s_q: MatrixNode, s_v: MatrixNode) -> MatrixNode:
    """Return the transposed S_v⁺ = ∂v⁺/∂q S_q + ∂v⁺/∂v S_v + ∂v⁺/∂effort."""
    columns, n = s_q.shape
    by_q, by_v, by_effort = slopes
    following = ca.mac(s_v, by_v, ca.mac(s_q, by_q, ca.MX.zeros(columns, n)))
    rows, bodies = by_effort.sparsity().get_triplet()
    at = [2 * n + row + columns * body for row, body in zip(rows, bodies)]
    flat = ca.vec(following)
    flat[at] = flat[at] + ca.vertcat(*(by_effort.nz[k] for k in range(len(at))))
    return ca.reshape(flat, columns, n)
