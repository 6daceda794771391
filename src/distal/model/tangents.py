"""The interval together with its derivatives, propagated through every sub-step."""

from __future__ import annotations

from typing import Any

import casadi as ca

from distal.model.mechanism import Mechanism
from distal.model.stepping import Kick, kick_and_drift, last_kick, responses


def tangent_step(mechanism: Mechanism, count: int) -> ca.Function:
    """Return the function (q, v, effort, effort_end, dt, p) → (q⁺, v⁺, S) with S = ∂(q⁺, v⁺)/∂(q, v, effort).

    The effort goes from `effort` to `effort_end` in a straight line: held values would shake light sliders on stiff
    tendons with every sample. Its column of S is for a shift of both ends.

    S, (2 n_bodies, 3 n_bodies), is carried through the sub-steps: S_v⁺ = ∂v⁺/∂q S_q + ∂v⁺/∂v S_v + ∂v⁺/∂effort and
    S_q⁺ = S_q + h S_v⁺. The derivative of friction is 0 in stick and 1 in slip; stops do not rebound here.

    Args:
        mechanism: the rig's equations.
        count: number of sub-steps.
    """
    n, p = mechanism.n_bodies, mechanism.parameters.symbols
    q, v, effort = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("effort", n)
    response = ca.SX.sym("response", n, 4)
    length, drift = ca.SX.sym("length"), ca.SX.sym("drift")
    s_q, s_v = ca.SX.sym("s_q", n, 3 * n), ca.SX.sym("s_v", n, 3 * n)
    kick = Kick(q, v, effort, response, length, drift)
    q_moved, v_moved = kick_and_drift(mechanism, kick, rebounds=False)
    v_last = last_kick(mechanism, kick)

    def slopes(velocity: Any) -> Any:
        along = ca.mtimes(ca.jacobian(velocity, q), s_q) + ca.mtimes(ca.jacobian(velocity, v), s_v)
        return along + ca.horzcat(ca.SX(n, 2 * n), ca.jacobian(velocity, effort))

    moved = slopes(v_moved)
    arguments = [q, v, s_q, s_v, effort, response, length, drift, p]
    moving = ca.Function("substep", arguments, ca.cse([q_moved, v_moved, s_q + drift * moved, moved]))
    closing = ca.Function("last_kick", arguments, ca.cse([v_last, slopes(v_last)]))
    prepared = ca.Function("responses", [length, drift, p], [responses(mechanism, length, drift)])

    q, v, effort, effort_end = (ca.MX.sym(name, n) for name in ("q", "v", "effort", "effort_end"))
    dt, p = ca.MX.sym("dt"), ca.MX.sym("p", p.numel())
    h = dt / count
    half, full = prepared(h / 2, h, p), prepared(h, h, p)
    identity = ca.DM.eye(2 * n)
    state = (
        q,
        v,
        ca.MX(ca.densify(ca.horzcat(identity[:n, :], ca.DM(n, n)))),
        ca.MX(ca.densify(ca.horzcat(identity[n:, :], ca.DM(n, n)))),
    )
    for i in range(count):
        now = effort + (i / count) * (effort_end - effort)
        state = moving(*state, now, half if i == 0 else full, h / 2 if i == 0 else h, h, p)
    v_next, s_v_next = closing(*state, effort_end, half, h / 2, h, p)
    return ca.Function(
        "tangent_interval",
        [q, v, effort, effort_end, dt, p],
        [state[0], v_next, ca.vertcat(state[2], s_v_next)],
        ["q", "v", "effort", "effort_end", "dt", "p"],
        ["q_next", "v_next", "S"],
    )
