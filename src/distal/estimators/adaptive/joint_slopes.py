"""One sub-step of the joints and the slopes of their speeds, all joints at once, where friction
may be known to a factor only.

At the mean of its limit a joint that sticks has zero slopes: readings that wrong friction causes
would then be explained by wrong stiffnesses. So the slopes are those of the expectation over the
limit, as with an uncertain torque, (10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states import StateVector
from distal.expressions import Matrix, Scalar, Vector
from distal.model import (
    Contacts,
    Kick,
    Limit,
    Slip,
    damped_inertias,
    kicked_chain,
    loads_of,
    residual,
    soft_moments,
    solver,
)


def doubted_frictions(states: StateVector) -> dict[int, list[int]]:
    """Return joint → indices of the states of its friction, for joints whose friction is known to a
    factor only.
    """
    p = states.context.mechanism.parameters
    doubted = dict[int, list[int]]()
    for i, state in enumerate(states.states):
        if state.doubted:
            _, joint, *_ = p.names[state.indices[0]].split(".")
            doubted.setdefault(int(joint), []).append(i)
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


TINY_STD = 1e-9
"""Added to the standard deviation of a joint's speed so that its moments stay finite where no time
passes [rad/s]. Source: rounding (division by zero).
"""


@dataclass(frozen=True)
class Moving:
    """The bodies after a sub-step, and the slopes of the joints' speeds.

    Mean and motion are exact. Where an external torque can occur, or the friction is known to a
    factor only, the slopes and the remaining variance are those of the expectation over torque and
    friction (`soft_moments`): a hand may move a joint that sticks, or the joint may not stick,
    although the linearisation says that it cannot move.

    Args:
        q: coordinates, (n_bodies,).
        v: velocities, (n_bodies,).
        by_position: ∂ω⁺/∂q, (n_joints, n_bodies).
        by_speed: ∂ω⁺/∂ω, (n_joints, n_joints).
        by_parameter: ∂ω⁺/∂p, (n_joints, n_p).
        by_torque: ∂ω⁺/∂τ, (n_joints, n_joints).
        rest: variance that uncertain torques add to ω beyond its slope, (n_joints,).
    """

    q: Vector
    v: Vector
    by_position: Matrix
    by_speed: Matrix
    by_parameter: Matrix
    by_torque: Matrix
    rest: Vector


def moving(
    context: FilterContext,
    kick: Kick,
    torques: Vector,
    stds: Vector,
    pushed: Sequence[int],
    doubted: Sequence[int],
) -> Moving:
    """Return the bodies after a sub-step; the drives move as measured.

    Slopes are those of an implicit equation, for the joints that slip: A dω⁺ = −∂(A ω⁺ + h f − r),
    see `residual`.

    Args:
        context: the rig as the filter reads it.
        kick: symbols of the sub-step; the joints' efforts are `torques`.
        torques: external torques on the joints, symbols, (n_joints,).
        stds: standard deviations of external torque and friction limit together, symbols,
            (n_joints,).
        pushed: indices of the joints on which an external torque can act.
        doubted: indices of the joints whose friction is known to a factor only.
    """
    mechanism = context.mechanism
    nj = context.n_joints
    kicked = kicked_chain(mechanism, kick, rebounds=False, settles=context.joints_settle)
    count = len(mechanism.free)
    length = kick.length
    free = mechanism.free
    weight, forward, back = (
        ca.vertsplit(getattr(kicked.slip, part)) for part in ("moving", "forward", "back")
    )
    after = kicked.v[free]
    rest = [ca.SX(0)] * nj
    matrix = ca.SX(kicked.matrix)
    load = kicked.load
    stiffness = ca.SX(kicked.contacts.stiffness)
    damping = ca.SX(kicked.contacts.damping)
    for k in (k for k, j in enumerate(free) if j in pushed or j in doubted):
        pressing = ca.SX(0)
        if free[k] in pushed:
            # a hand may take the joint off its stop: the expectation does without it
            pressing = stiffness[k] * (kick.q[free[k]] - kicked.contacts.position[k])
            matrix[k, k] -= damping[k]
            stiffness[k] = 0
            damping[k] = 0
        # what a joint feels beside its own inertia: the others move as they do
        mass = matrix[k, k]
        felt = (
            load[k]
            + pressing
            - sum((matrix[k, i] * after[i] for i in range(count) if i != k), ca.SX(0))
        )
        limit = Limit(kicked.up[k] / mass, kicked.down[k] / mass)
        moments = soft_moments(felt / mass, limit, length * stds[free[k]] / mass + TINY_STD)
        share = ca.fmax(moments.slope, 1e-12)
        weight[k] = ca.sqrt(share)
        forward[k] = moments.forward / share
        back[k] = moments.back / share
        rest[free[k]] = moments.rest
    speed, forward_by, back_by, *contact = (
        ca.SX.sym(name, count) for name in ("after", "u", "d", "kappa", "delta", "position")
    )
    damped = ca.SX.sym("damped", nj)
    q = kick.q[:nj]
    v = ca.SX.zeros(nj) if context.joints_settle else kick.v[:nj]
    equation = residual(
        mechanism,
        q,
        v,
        speed,
        loads_of(mechanism, kick, context.joints_settle),
        slip=Slip(forward_by, back_by),
        contacts=Contacts(*contact),
        damped=damped,
        h=length,
    )
    # what the equation takes as given
    inertias = damped_inertias(mechanism, ca.diag(mechanism.mass_matrix(q)), length)
    pushes = [stiffness, damping, kicked.contacts.position]
    by = (kick.q, kick.v[:nj], mechanism.parameters.symbols, torques)
    slopes = [
        ca.jacobian(equation, argument)
        + ca.mtimes(ca.jacobian(equation, damped), ca.jacobian(inertias, argument))
        for argument in by
    ]
    # whether a joint touches a stop has no slope: contacts change with the stops' own numbers alone
    p = mechanism.parameters
    stops = [i for i, name in enumerate(p.names) if ".stop" in name]
    by_contact = ca.jacobian(equation, ca.vertcat(*contact))
    by_stops = ca.jacobian(ca.vertcat(*pushes), p.symbols[stops])
    slopes[2][:, stops] += ca.mtimes(by_contact, by_stops)
    unknown = [speed, forward_by, back_by, *contact, damped]
    solution = [after, ca.vertcat(*forward), ca.vertcat(*back), *pushes, kicked.damped]
    slopes = ca.substitute(slopes, unknown, [ca.densify(part) for part in solution])
    solve = solver(matrix, ca.vertcat(*weight))
    inverse = ca.horzcat(*(solve(column) for column in ca.horzsplit(ca.SX.eye(count))))
    slopes = [ca.mtimes([mechanism.spread, -inverse, ca.sparsify(slope)]) for slope in slopes]
    by_position, by_speed, by_parameter, by_torque = slopes
    q = ca.vertcat(kicked.q, kick.q[nj:] + kick.drift * kick.v[nj:])
    v = ca.vertcat(kicked.v, kick.v[nj:])
    return Moving(q, v, by_position, by_speed, by_parameter, by_torque, ca.vertcat(*rest))
