"""The uncertainty of friction limits of joints whose friction is known to a factor only.

At the mean of its limit a joint that sticks has zero slopes: readings that wrong friction causes
would then be explained by wrong stiffnesses. So the slopes are those of the expectation over the
limit, as with an uncertain torque, (10).
"""

from __future__ import annotations

import casadi as ca

from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.states.parameter import UncertainParameter
from distal.expressions import Matrix, Scalar, Vector


def doubted_frictions(states: StateVector) -> dict[int, list[int]]:
    """Return joint → indices of the states of its friction, for joints whose friction is known to a
    factor only.
    """
    p = states.context.mechanism.parameters
    doubted = dict[int, list[int]]()
    for block in states.blocks:
        if not isinstance(block, UncertainParameter) or block.acts != "value":
            continue
        at = block.indices[0]
        head, index, part = p.names[at].split(".")[:3]
        if (head, part) == ("joints", "friction") and block.doubted:
            doubted.setdefault(int(index), []).extend(states.indices(block))
    return doubted


def friction_stds(
    states: StateVector, q: Vector, v: Vector, mean: Vector, covariance: Matrix
) -> dict[int, Scalar]:
    """Return joint → std of its friction limit [N m], at q and v, from the uncertainty of its
    friction.

    It is at a symbolic `mean`, (n,), with a `covariance`, (n, n).
    """
    mechanism = states.context.mechanism
    doubted = doubted_frictions(states)
    if not doubted:
        return {}
    pulls = mechanism.pulls(q, v)
    limits = mechanism.friction_limits(q, v, pulls.joint, pulls.drive)
    stds = dict[int, Scalar]()
    for joint, at in doubted.items():
        frictions = ca.SX.sym("frictions", len(at))
        state = ca.SX(mean)
        state[at] = frictions
        limit = ca.substitute(
            limits[joint].mean, mechanism.parameters.symbols, states.parameters(state)
        )
        slope = ca.substitute(ca.jacobian(limit, frictions), frictions, mean[at])
        stds[joint] = ca.sqrt(ca.fmax(ca.mtimes([slope, covariance[at, at], slope.T]), 0))
    return stds
