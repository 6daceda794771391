"""One sub-step of the joints and the slopes of their speeds: joint by joint, or all at once in a
chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.filter_context import FilterContext
from distal.expressions import Matrix, Vector
from distal.model import (
    Kick,
    Limit,
    Slip,
    impulses,
    kick_and_drift,
    kicked_chain,
    loads_of,
    residual,
    soft_moments,
    solver,
)

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
        by_response: slopes by a, then by b, of all joints, (n_joints, 2 n_joints); see `responses`.
        rest: variance that uncertain torques add to ω beyond its slope, (n_joints,).
    """

    q: Vector
    v: Vector
    by_position: Matrix
    by_speed: Matrix
    by_parameter: Matrix
    by_torque: Matrix
    by_response: Matrix
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

    Args:
        context: the rig as the filter reads it.
        kick: symbols of the sub-step; the joints' efforts are `torques`.
        torques: external torques on the joints, symbols, (n_joints,).
        stds: standard deviations of external torque and friction limit together, symbols,
            (n_joints,).
        pushed: indices of the joints on which an external torque can act.
        doubted: indices of the joints whose friction is known to a factor only.
    """
    alone = context.mechanism.chain is None and not context.joints_settle
    if alone:
        return _joint_by_joint(context, kick, torques, stds, sorted({*pushed, *doubted}))
    return _all_at_once(context, kick, torques, stds, pushed, doubted)


def _joint_by_joint(
    context: FilterContext, kick: Kick, torques: Vector, stds: Vector, uncertain: Sequence[int]
) -> Moving:
    mechanism = context.mechanism
    nj = context.n_joints
    q, v = kick_and_drift(mechanism, kick, rebounds=False, bodies=range(nj))
    speeds = [v[j] for j in range(nj)]
    rest = [ca.SX(0)] * nj
    if uncertain:
        z, limits, damping = impulses(mechanism, kick)
        for j in uncertain:
            held = 1 + kick.response[j, 1] * damping[j]
            moments = soft_moments(z[j], limits[j], kick.response[j, 1] * stds[j] + TINY_STD)
            speeds[j] = moments.mean / held
            rest[j] = moments.rest / held**2
    speed = ca.vertcat(*speeds)
    by_response = ca.horzcat(*(ca.jacobian(speed, kick.response[:nj, k]) for k in range(2)))
    by = (kick.q, kick.v[:nj], mechanism.parameters.symbols, torques)
    by_position, by_speed, by_parameter, by_torque = (
        ca.jacobian(speed, argument) for argument in by
    )
    return Moving(
        q, v, by_position, by_speed, by_parameter, by_torque, by_response, ca.vertcat(*rest)
    )


def _all_at_once(
    context: FilterContext,
    kick: Kick,
    torques: Vector,
    stds: Vector,
    pushed: Sequence[int],
    doubted: Sequence[int],
) -> Moving:
    """Return the bodies of a chain after a sub-step: slopes of an implicit equation, for the joints
    that slip.

    Z dω⁺ = −∂(Z ω⁺ + h τ_f − b_z).
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
    symbols = {
        name: ca.SX.sym(name, count)
        for name in ("after", "forward", "back", "kappa", "delta", "position")
    }
    contacts = type(kicked.contacts)(symbols["kappa"], symbols["delta"], symbols["position"])
    loads = loads_of(mechanism, kick, context.joints_settle)
    slip = Slip(symbols["forward"], symbols["back"])
    q = kick.q[:nj]
    v = ca.SX.zeros(nj) if context.joints_settle else kick.v[:nj]
    equation = residual(
        mechanism, q, v, symbols["after"], loads, slip=slip, contacts=contacts, h=length
    )
    by = (kick.q, kick.v[:nj], mechanism.parameters.symbols, torques)
    solution = [
        after,
        ca.vertcat(*forward),
        ca.vertcat(*back),
        stiffness,
        damping,
        kicked.contacts.position,
    ]
    slopes = [ca.jacobian(equation, argument) for argument in by]
    slopes = ca.substitute(slopes, list(symbols.values()), [ca.densify(part) for part in solution])
    solve = solver(matrix, ca.vertcat(*weight))
    inverse = ca.horzcat(*(solve(column) for column in ca.horzsplit(ca.SX.eye(count))))
    slopes = [ca.mtimes([mechanism.spread, -inverse, ca.sparsify(slope)]) for slope in slopes]
    by_position, by_speed, by_parameter, by_torque = slopes
    q = ca.vertcat(kicked.q, kick.q[nj:] + kick.drift * kick.v[nj:])
    v = ca.vertcat(kicked.v, kick.v[nj:])
    return Moving(
        q, v, by_position, by_speed, by_parameter, by_torque, ca.SX(nj, 2 * nj), ca.vertcat(*rest)
    )
