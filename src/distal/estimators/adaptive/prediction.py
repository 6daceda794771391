"""Predict mean and covariance: angles and speeds move, all other states stay, fade or walk.
Equations (11) to (13).
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from distal.estimators.adaptive.drive_tracking import MEMORY, Tracks, remembered_position
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_inputs import Interval, Prediction
from distal.estimators.adaptive.guards import followed_share
from distal.estimators.adaptive.joint_motion import Moved
from distal.estimators.adaptive.states import StateVector
from distal.estimators.kalman import symmetric
from distal.expressions import MatrixNode, Scalar, ScalarNode, Vector, VectorNode


def predicted(
    states: StateVector, mean: VectorNode, covariance: MatrixNode, moved: Moved, interval: Interval
) -> tuple[VectorNode, MatrixNode]:
    """Return mean and covariance after the joints have moved and the walks of an interval:
    equations (10) to (12).

    Only angles and speeds move; the rest of the covariance stays, but for walks.
    """
    context = states.context
    n = len(states)
    x = interval.x
    nj = context.n_joints
    ahead = ca.mtimes(moved.across(covariance), moved.slopes)
    products = ca.mtimes(moved.across(ahead.T), moved.slopes)
    positions = moved.slopes[len(moved.chosen) :, :]
    arguments = (
        products,
        positions,
        moved.speed_variances,
        interval.tracks,
        interval.memory,
        x,
        interval.p,
    )
    corner = _corner(context)(*arguments)
    after = ca.MX(covariance)
    for k in range(2 * nj):
        set_row(after, k, ahead[:, k], ahead[k, k])
    after[: 2 * nj, : 2 * nj] = corner
    state = ca.MX(mean)
    for j in range(nj):
        state[j] = moved.angles[j]
        state[nj + j] = moved.speeds[j]
    walking = [i for i in range(n) if states.walks[i] > 0.0]
    if walking:
        flat = ca.vec(after)
        diagonal = [i * (n + 1) for i in walking]
        walks = context.parameters(interval.p, [f"state.{i}.walk" for i in walking])
        flat[diagonal] = flat[diagonal] + x[0] * walks**2
        after = ca.reshape(flat, n, n)
    return state, after


def _corner(context: FilterContext) -> ca.Function:
    """Return (M P Mᵀ, S_drives, added to ω, tracks, memory, x, p) → the covariance of angles and
    speeds.

    Added are the variances of the drives' positions, of uncertain and unmodelled torques, and of
    the motion that joints may have made with drives whose positions are lost.
    """
    nj = context.n_joints
    nd = context.n_drives
    products = ca.SX.sym("products", 2 * nj, 2 * nj)
    of_positions = ca.SX.sym("S_drives", nd, 2 * nj)
    speed_variances = ca.SX.sym("speed_variances", nj)
    vector = ca.SX.sym("tracks", Tracks.size(nd))
    memory = ca.SX.sym("memory", MEMORY * nd)
    x = ca.SX.sym("x", context.width)
    variances = Tracks(vector).variances
    read = [k for k in range(nd) if context.position_sensor(k) is not None]
    by_read = of_positions[read, :]
    corner = products + ca.mtimes([by_read.T, ca.diag(variances[read]), by_read])
    # to the angles and to the speeds of the joints that are free; coupled ones err as these
    free = context.mechanism.free
    spread = context.mechanism.spread
    angles = [
        followed_variance(context, j, vector, memory) + context.robustness.angle_walk**2 * x[0]
        for j in free
    ]
    speeds = [speed_variances[j] + context.unmodelled(j) ** 2 * x[0] for j in free]
    added = (
        ca.mtimes([spread, ca.diag(ca.vertcat(*noise)), spread.T]) for noise in (angles, speeds)
    )
    corner = symmetric(ca.densify(corner + ca.diagcat(*added)))
    arguments = [
        products,
        of_positions,
        speed_variances,
        vector,
        memory,
        x,
        context.mechanism.parameters.symbols,
    ]
    return ca.Function("corner", arguments, ca.cse([corner]))


def followed_variance(context: FilterContext, joint: int, tracks: Vector, memory: Vector) -> Scalar:
    """Return the variance of θ of a joint because it may have followed drives whose positions are
    not known. Equation (12).

    The effect of an unknown position within one interval is small, but it lasts until the position
    is measured again: the longer it is missing, the more the joint has followed. One missing sample
    does no harm.

    Args:
        context: the rig as the filter reads it.
        joint: index of the joint.
        tracks: of the drives, after the interval.
        memory: what was remembered of the drives before it.
    """
    total = ca.SX(0)
    drives = Tracks(tracks)
    for i, names in context.moved_by(joint).items():
        grown = ca.fmax(drives[i].unknown - memory[remembered_position(i, "unknown")], 0)
        ratio, share = map(context.number, names)
        total += followed_share(context.robustness, drives[i].lost) * grown * (ratio * share) ** 2
    return total


def shifted_variance(
    context: FilterContext, joint: int, tracks: VectorNode, p: VectorNode
) -> ScalarNode:
    """Return the variance of θ from drives of which it is not known whether they or the zeros of
    their sensors jumped: (31).
    """
    total = ca.MX(0)
    drives = Tracks(tracks)
    for i, (ratio, _) in context.moved_by(joint).items():
        total += (context.parameters(p, [ratio]) * drives[i].shift_std) ** 2
    return total


def revert(
    states: StateVector,
    prediction: Prediction,
    opened: Mapping[int, ScalarNode],
    interval: Interval,
) -> None:
    """Let the states that fade do so over an interval, in place: x⁺ = f x, variance σ² (1 − f²)
    added. Equation (13).

    For the external torque on a joint, the variance that is `opened` is added to σ² (13b).
    """
    dt = ca.SX.sym("dt")
    fadings = states.fadings()
    if not fadings:
        return
    factors = [ca.exp(-dt / time) for _, time, _ in fadings]
    values = ca.vertcat(*factors, *(std**2 * (1 - f**2) for (*_, std), f in zip(fadings, factors)))
    symbols = [dt, states.context.mechanism.parameters.symbols]
    fades = ca.Function("fading", symbols, [values])(interval.x[0], interval.p)
    state = prediction.state
    covariance = prediction.covariance
    transition = prediction.transition
    for k, (at, *_) in enumerate(fadings):
        fade = fades[k]
        added = fades[len(fadings) + k]
        joint = states.torque_states.get(at)
        if joint is not None and joint in opened:
            added += (1 - fade**2) * opened[joint]
        state[at] = fade * state[at]
        transition[at, :] = fade * transition[at, :]
        row = (
            fade * covariance[:, at]
        )  # read once, so that the covariance is changed where it stands
        set_row(covariance, at, row, fade * row[at] + added)
    _open_together(states, prediction, opened, interval)


def _open_together(
    states: StateVector,
    prediction: Prediction,
    opened: Mapping[int, ScalarNode],
    interval: Interval,
) -> None:
    """Add the covariance of two joints' torques that the same contact makes, in place. Equation
    (13b).
    """
    context = states.context
    covariance = prediction.covariance
    torques = [(at, joint) for at, joint in states.torque_states.items() if joint in opened]
    for k, (at, joint) in enumerate(torques):
        for other_at, other in torques[:k]:
            if context.contact_shape[joint, other] == 0.0:
                continue
            pairs = ((joint, other), (joint, joint), (other, other))
            shape = context.parameters(interval.p, [context.loaded_with(*pair) for pair in pairs])
            times = [f"joints.{j}.external_torque.correlation_time" for j in (joint, other)]
            rates = 1 / context.parameters(interval.p, times)
            fade = ca.exp(-interval.x[0] * (rates[0] + rates[1]))
            size = ca.sqrt(opened[joint] * opened[other] / (shape[1] * shape[2]))
            added = covariance[at, other_at] + (1 - fade) * shape[0] * size
            covariance[at, other_at] = added
            covariance[other_at, at] = added


def set_row(covariance: MatrixNode, at: int, row: VectorNode, variance: ScalarNode) -> None:
    """Replace row and column `at` of a covariance by `row`, (n, 1), with `variance` on the
    diagonal, in place.
    """
    covariance[:, at] = row
    covariance[at, :] = row.T
    covariance[at, at] = variance
