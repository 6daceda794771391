"""One interval between samples: repeated calls of one function for a sub-step, whose code is there
once.
"""

from __future__ import annotations

import casadi as ca

from distal.model.mechanism import Mechanism
from distal.model.stepping import Kick, kick_and_drift, last_kick, responses


def interval_step(
    mechanism: Mechanism, count: int, rebounds: bool = True, with_servo: bool = False
) -> ca.Function:
    """Return the function (q, v, effort, added_inertia, servo, dt, p) → (q⁺, v⁺) over an interval
    of `count` sub-steps.

    The scheme is kick–drift–kick leapfrog: half a kick and a drift, then `count` − 1 times a kick
    and a drift, then half a kick. What acts is constant over the interval and given for each body:
    `effort` is a force or torque, (n_bodies,); `added_inertia` is that of hung weights, which move
    with the bodies, (n_bodies,); `servo` is (stiffness, target, damping) of a spring and damper to
    a target, such as a hand or a position loop, (n_bodies, 3), and is taken implicitly.

    Args:
        rebounds: whether bodies bounce off stops (simulation) or are pressed against them
            (filters).
        with_servo: whether a spring and damper to a target may act on the bodies.
    """
    n = mechanism.n_bodies
    p = mechanism.parameters.symbols
    q, v, effort = (ca.SX.sym(name, n) for name in ("q", "v", "effort"))
    length, drift = ca.SX.sym("length"), ca.SX.sym("drift")
    symbols = q, v, effort, ca.SX.sym("response", n, 4), length, drift
    servo = ca.SX.sym("servo", n, 3)
    implicit = None
    if with_servo:
        stiffness = servo[:, 0]
        target = servo[:, 1]
        damping = servo[:, 2]
        implicit = ca.horzcat(stiffness * (target - q), stiffness * drift + damping)
    kick = Kick(*symbols, implicit=implicit)
    arguments = [*symbols, servo, p]
    moving = ca.Function(
        "substep", arguments, ca.cse(list(kick_and_drift(mechanism, kick, rebounds)))
    )
    closing = ca.Function("last_kick", arguments, ca.cse([last_kick(mechanism, kick)]))
    added = ca.SX.sym("added_inertia", n)
    prepared = ca.Function(
        "responses", [length, drift, added, p], [responses(mechanism, length, drift, added)]
    )

    q, v, effort, added = (ca.MX.sym(name, n) for name in ("q", "v", "effort", "added_inertia"))
    servo = ca.MX.sym("servo", n, 3)
    dt = ca.MX.sym("dt")
    p = ca.MX.sym("p", p.numel())
    h = dt / count
    half = prepared(h / 2, h, added, p)
    full = prepared(h, h, added, p)
    q_next = q
    v_next = v
    for i in range(count):
        first = i == 0
        q_next, v_next = moving(
            q_next, v_next, effort, half if first else full, h / 2 if first else h, h, servo, p
        )
    v_next = closing(q_next, v_next, effort, half, h / 2, h, servo, p)
    return ca.Function(
        "interval",
        [q, v, effort, added, servo, dt, p],
        [q_next, v_next],
        ["q", "v", "effort", "added_inertia", "servo", "dt", "p"],
        ["q_next", "v_next"],
    )
