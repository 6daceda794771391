"""Move the joints over an interval: measured displacements move the tendons, the tendons move the
joints, sub-step by sub-step with the slopes of their speeds. Equations (7) to (10).

The precise sensor is the input: tensions follow from the joints' angles and the measured
displacements, so that sliders, their ringing and their stops are no part of the state. A joint
that sticks has zero slopes. Where an external torque is uncertain, the slopes are those of the
expectation over it, (10).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from distal.estimators.adaptive.drive_tracking import MEMORY, TRACKED, drive_of, remembered
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_inputs import Interval
from distal.estimators.adaptive.states import StateVector
from distal.expressions import (
    Matrix,
    MatrixNode,
    Scalar,
    Vector,
    VectorNode,
    dense_function,
    symbols,
)
from distal.model import (
    Contacts,
    Kick,
    Kicked,
    Limit,
    Slip,
    damped_inertias,
    kicked,
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

    Mean and motion are exact. Where an external torque can occur, the slopes and the remaining
    variance are those of the expectation over it (`soft_moments`): a hand may move a joint that
    sticks, although the linearisation says that it cannot move.

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


class Softened(NamedTuple):
    """A sub-step's equation with the expectation over what pushes joints and rubs on them.

    Args:
        matrix: of the joints' speeds.
        stiffness: of contacts with stops.
        damping: of these.
        weight: square root of the share with which each joint slips.
        forward: friction limit against motion forward.
        back: the same backward.
        rest: chance that each joint rests.
    """

    matrix: Matrix
    stiffness: Vector
    damping: Vector
    weight: Vector
    forward: Vector
    back: Vector
    rest: Vector


def _softened(
    context: FilterContext,
    kick: Kick,
    moved: Kicked,
    stds: Vector,
    turned: Collection[int],
    declared: Collection[int],
) -> Softened:
    """Return the equation of a sub-step, see `moving`."""
    free = context.mechanism.free
    count = len(free)
    weight, forward, back = (
        ca.vertsplit(getattr(moved.slip, part)) for part in ("moving", "forward", "back")
    )
    after = moved.v[free]
    rest = [ca.SX(0)] * context.n_joints
    matrix = ca.SX(moved.matrix)
    load = moved.load
    stiffness = ca.SX(moved.contacts.stiffness)
    damping = ca.SX(moved.contacts.damping)
    for k, j in enumerate(free):
        if j not in turned:
            continue
        pressing = ca.SX(0)
        if j in declared:
            # a hand may take the joint off its stop: the expectation does without it
            pressing = stiffness[k] * (kick.q[j] - moved.contacts.position[k])
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
        limit = Limit(moved.up[k] / mass, moved.down[k] / mass)
        moments = soft_moments(felt / mass, limit, kick.length * stds[j] / mass + TINY_STD)
        share = ca.fmax(moments.slope, 1e-12)
        weight[k] = ca.sqrt(share)
        forward[k] = moments.forward / share
        back[k] = moments.back / share
        rest[j] = moments.rest
    joined = (ca.vertcat(*parts) for parts in (weight, forward, back, rest))
    return Softened(matrix, stiffness, damping, *joined)


def moving(
    context: FilterContext,
    kick: Kick,
    torques: Vector,
    stds: Vector,
    turned: Collection[int],
    declared: Collection[int],
) -> Moving:
    """Return the bodies after a sub-step; the drives move as measured.

    Slopes are those of an implicit equation, for the joints that slip: A dω⁺ = −∂(A ω⁺ + h f − r),
    see `residual`.

    Args:
        context: the rig as the filter reads it.
        kick: symbols of the sub-step; the joints' efforts are `torques`.
        torques: external torques on the joints, symbols, (n_joints,).
        stds: standard deviations of external torque, symbols, (n_joints,).
        turned: indices of the joints on which an external torque can act.
        declared: of those for which the rig says so.
    """
    mechanism = context.mechanism
    nj = context.n_joints
    settles = context.joints_settle
    loads = loads_of(mechanism, kick, settles)
    moved = kicked(mechanism, kick, loads, settles=settles)
    count = len(mechanism.free)
    length = kick.length
    after = moved.v[mechanism.free]
    soft = _softened(context, kick, moved, stds, turned, declared)
    unknown = symbols(
        ca.SX,
        after=count,
        u=count,
        d=count,
        kappa=count,
        delta=count,
        position=count,
        damped=nj,
    )
    speed, forward_by, back_by, *contact, damped = unknown
    q = kick.q[:nj]
    v = ca.SX.zeros(nj) if settles else kick.v[:nj]
    equation = residual(
        mechanism,
        q,
        v,
        speed,
        loads,
        friction=Slip(forward_by, back_by).friction(moved.up, moved.down),
        contacts=Contacts(*contact),
        damped=damped,
        h=length,
    )
    # what the equation takes as given
    dampings = mechanism.dampings()[:nj]
    inertias = damped_inertias(dampings, ca.diag(mechanism.mass_matrix(q)), length)
    pushes = [soft.stiffness, soft.damping, moved.contacts.position]
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
    solution = [after, soft.forward, soft.back, *pushes, moved.damped]
    slopes = ca.substitute(slopes, unknown, [ca.densify(part) for part in solution])
    solve = solver(soft.matrix, soft.weight)
    inverse = ca.horzcat(*(solve(column) for column in ca.horzsplit(ca.SX.eye(count))))
    slopes = [ca.mtimes([mechanism.spread, -inverse, ca.sparsify(slope)]) for slope in slopes]
    by_position, by_speed, by_parameter, by_torque = slopes
    q = ca.vertcat(moved.q, kick.q[nj:] + kick.drift * kick.v[nj:])
    v = ca.vertcat(moved.v, kick.v[nj:])
    return Moving(q, v, by_position, by_speed, by_parameter, by_torque, soft.rest)


@dataclass(frozen=True)
class Moved:
    """The joints after an interval, symbolic, with slopes.

    The slopes are by fewer values than there are states: by the joints' own motion, the states that
    enter the model, and the positions of the drives. A state that changes only a drive's position,
    such as the curve of its sensor, moves the joints as that position does.

    Args:
        angles: θ, (n_joints,).
        speeds: ω, (n_joints,).
        slopes: of θ and ω by these values, transposed, (values, 2 n_joints).
        chosen: indices of the states among these values; the drives' positions come after them.
        positions: for each drive, the indices of the states that change its position, and its
            slopes by these.
        speed_variances: added to the variances of ω by uncertain torques, beyond their slopes,
            (n_joints,).
        rates: mean speed of each drive over the interval, (n_drives,).
    """

    angles: VectorNode
    speeds: VectorNode
    slopes: MatrixNode
    chosen: list[int]
    positions: list[tuple[list[int], VectorNode]]
    speed_variances: VectorNode
    rates: VectorNode

    def across(self, matrix: MatrixNode) -> MatrixNode:
        """Return a matrix, (k, n), times the transposed slopes of the values that move the joints
        by the states, (k, values).
        """
        by_position = [
            ca.mtimes(matrix[:, at], slopes) if at else ca.MX(matrix.size1(), 1)
            for at, slopes in self.positions
        ]
        return ca.horzcat(matrix[:, self.chosen], *map(ca.densify, by_position))


def moved(
    states: StateVector, count: int, mean: VectorNode, covariance: MatrixNode, interval: Interval
) -> Moved:
    """Return the joints after an interval of `count` sub-steps, with their slopes."""
    context = states.context
    x = interval.x
    p = interval.p
    nj = context.n_joints
    acting = _acting(states)
    starts, rates, torques, values, *constant = _interval(states, count)(
        mean, covariance, interval.memory, interval.tracks, x, p
    )
    step = _substep(states)
    h = x[0] / count
    mechanism = context.mechanism
    parameters = 2 * nj + len(acting) + context.n_drives
    angles = mean[:nj]
    speeds = mean[nj : 2 * nj]
    coupling = ca.DM.eye(nj)
    if len(mechanism.free) < nj:
        # coupled joints are where the others say, from the start
        coupling = ca.DM(nj, nj)
        coupling[:, mechanism.free] = mechanism.spread
        angles = ca.mtimes(coupling, angles) + mechanism.offsets
        speeds = ca.mtimes(coupling, speeds)
    q = ca.vertcat(angles, starts)
    v = ca.vertcat(speeds, rates)
    by_angle, by_speed = (ca.DM(parameters, nj) for _ in range(2))
    by_angle[:nj, :] = by_speed[nj : 2 * nj, :] = coupling.T
    of_angles = ca.MX(ca.densify(by_angle))
    of_speeds = ca.MX(ca.densify(by_speed))
    speed_variances = ca.MX(ca.DM.zeros(nj))
    for _ in range(count):
        q, v, by_angle, by_speed, added_slopes, added = step(q, v, torques, h, *constant, p)
        of_speeds = ca.mac(of_angles, by_angle, ca.mac(of_speeds, by_speed, added_slopes))
        of_angles = of_angles + h * of_speeds
        if len(mechanism.free) < nj:
            of_angles = ca.mtimes(of_angles[:, mechanism.free], mechanism.spread.T)
        speed_variances = speed_variances + added
    positions = list[tuple[list[int], VectorNode]]()
    first = 0
    for i in range(context.n_drives):
        at = states.placing(i)
        positions.append((at, values[first : first + len(at)]))
        first += len(at)
    slopes = ca.horzcat(of_angles, of_speeds)
    chosen = [*range(2 * nj), *acting]
    return Moved(q[:nj], v[:nj], slopes, chosen, positions, speed_variances, rates)


def _acting(states: StateVector) -> list[int]:
    """Return the indices of the states that enter the model: as parameters or torques."""
    states_by_index = enumerate(states.states)
    return [
        i
        for i, state in states_by_index
        if state.indices or (state.to is not None and state.to[0] == "torque")
    ]


def _interval(states: StateVector, count: int) -> ca.Function:
    """Return the values that are the same for all sub-steps of an interval.

    The function is (mean, P, memory, tracks, x, p) → positions of the drives at its start, their
    speeds, external torques, slopes of the positions by states (`StateVector.placing`); stds of
    torques, the model's parameters, and the joints' `damped_inertias`, which in
    a chain are those of the joints' own inertias alone and stay unused.
    """
    context = states.context
    n = len(states)
    nd = context.n_drives
    mechanism = context.mechanism
    p = mechanism.parameters.symbols
    of_drives = {"memory": (MEMORY, nd), "tracks": (len(TRACKED), nd)}
    inputs = symbols(ca.SX, mean=n, P=(n, n), **of_drives, x=context.width)
    mean, covariance, memory, tracks, x = inputs
    dt = x[0]
    starts = list[Scalar]()
    rates = list[Scalar]()
    slopes = list[Scalar]()
    for i in range(nd):
        first = states.position(i, remembered(memory, i, "position"), mean)
        last = states.position(i, drive_of(tracks, i).position, mean)
        starts.append(first)
        rates.append(ca.if_else(dt > 0, (last - first) / ca.if_else(dt > 0, dt, 1), 0))
        slope = ca.jacobian(last, mean)
        slopes += [slope[at] for at in states.placing(i)]
    parameters = states.parameters(mean)
    nj = context.n_joints
    damped = damped_inertias(mechanism.dampings()[:nj], mechanism.inertias()[:nj], dt / count)
    # torques are sums of states of their own: their variances add up
    of_joints = (states.adding(("torque", j)) for j in range(nj))
    spreads = [
        ca.sqrt(ca.fmax(sum((covariance[i, i] for i in at), ca.SX(0)), 0)) for at in of_joints
    ]
    outputs = [
        ca.vertcat(*starts),
        ca.vertcat(*rates),
        states.torques(mean),
        ca.vertcat(*slopes, ca.SX(0, 1)),
        ca.vertcat(*spreads),
        parameters,
        ca.substitute(damped, p, parameters),
    ]
    return dense_function("interval", [*inputs, p], outputs)


def _substep(states: StateVector) -> ca.Function:
    """Return one sub-step of the joints with its slopes; the drives move as measured.

    The function is (q, v, τ, h, σ_τ, p, damped, the rig's own p) → (q⁺, v⁺, ∂ω⁺/∂θ, ∂ω⁺/∂ω,
    slopes of ω⁺ by all other values that move the joints, variance added to ω); slopes are
    transposed.
    """
    context = states.context
    nd = context.n_drives
    nj = context.n_joints
    mechanism = context.mechanism
    p = mechanism.parameters.symbols
    acting = _acting(states)
    nb = mechanism.n_bodies
    count = 2 * nj + len(acting)
    inputs = symbols(ca.SX, q=nb, v=nb, tau=nj, h=1, s_tau=nj)
    q, v, torques, h, spreads = inputs
    damped, state, rig_p = symbols(ca.SX, damped=nj, state=len(states), rig_p=p.numel())
    kick = Kick(q, v, ca.vertcat(torques, ca.SX(nd, 1)), h, h, damped=damped)
    torque_slopes = ca.jacobian(states.torques(state), state)
    # states enter the parameters linearly: slopes at the rig's own
    parameter_slopes = ca.substitute(ca.jacobian(states.parameters(state), state), p, rig_p)
    # what the rig declares may take a joint off its stop; a torque that forces tell of later moves
    # what sticks alone
    joints = enumerate(mechanism.rig.joints)
    declared = [j for j, joint in joints if joint.external_torque.std > 0.0]
    step = moving(context, kick, torques, spreads, states.torque_states.values(), declared)
    along = ca.SX(nj, count + nd)
    along[:, count:] = step.by_position[:, nj:]
    if acting:
        along[:, 2 * nj : count] += ca.mtimes(step.by_parameter, parameter_slopes[:, acting])
        along[:, 2 * nj : count] += ca.mtimes(step.by_torque, torque_slopes[:, acting])
    arguments = [*inputs, p, damped, rig_p]
    outputs = [step.q, step.v, step.by_position[:, :nj].T, step.by_speed.T, along.T, step.rest]
    return dense_function("substep", arguments, outputs)
