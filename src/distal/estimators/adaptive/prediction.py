"""Predict mean and covariance: angles and speeds move, all other states stay, fade or walk, (11) to
(13); the effort that a drive's transmission passes on follows the measured effort, plays inside
the rig follow their bounds, (14) to (15b).

Between two slack tendons no force tells where a joint is, but the joint lies within the play that
they leave, (26b). Plays: docs/reference/adaptive-equations.md, section 5, "Plays inside the rig".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import casadi as ca

from distal.estimators.adaptive.drive_tracking import (
    MEMORY,
    TRACKED,
    drive_of,
    positions_of,
    remembered,
)
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_inputs import Interval, Prediction, mechanics_function
from distal.estimators.adaptive.guard_settings import followed_share
from distal.estimators.adaptive.joint_motion import Moved
from distal.estimators.adaptive.states import StateVector
from distal.estimators.estimator_protocol import StateKind
from distal.estimators.kinematic import Downdate, along, symmetric
from distal.expressions import (
    MatrixNode,
    Scalar,
    ScalarNode,
    Vector,
    VectorNode,
    dense_function,
    symbols,
)
from distal.kernels.layout import is_read, is_there
from distal.model import clip_moments
from distal.model.friction import ClipMoments

SURE = 3.0
"""Number of stds of its sensor that is added to a force to have its largest possible value [1].
Source: judgement.
"""


def within_play(
    states: StateVector, mean: VectorNode, covariance: MatrixNode, interval: Interval
) -> tuple[VectorNode, MatrixNode]:
    """Return mean and covariance after joints between slack tendons are held within their plays:
    (26b).

    A drive that pulls with no more than U_most stretches each tendon of a pair by no more than
    U_most/(r k), so that the joint lies within a width w. A variance above w²/12, that of a uniform
    distribution over w, is reduced to it. The same rule holds at every sample, so that repeating it
    reduces the variance no further. It changes angles, speeds and external torques only.
    """
    updates = Downdate(covariance)
    others = range(2 * states.context.n_joints, len(states))
    kept = [at for at in others if at not in states.torque_states]
    for drive, *pair in slack_pairs(states.context):
        residual, width, is_read, slope = slack_pair_function(states, drive, pair)(
            mean, interval.tracks, interval.x, interval.p
        )
        across = updates.times(slope)
        spread = ca.fmax(along(slope, across), 1e-30)
        most = width**2 / 12
        weight = ca.if_else(
            ca.logic_and(is_read, width > 0), ca.fmax(spread - most, 0) / spread**2, 0
        )
        change = -(weight * residual) * across
        change[kept] = 0
        mean = mean + change
        updates.take(ca.sqrt(weight) * across, kept, ca.DM.zeros(len(kept)))
    return mean, updates.matrix()


def slack_pairs(context: FilterContext) -> Iterator[tuple[int, int, int]]:
    """Yield drive and both tendons, by index, of each pair that may be slack on both sides, for
    drives whose position and force are read.
    """
    rig = context.rig
    p = context.mechanism.parameters
    for i in range(context.n_drives):
        tendons = context.mechanism.pulled_by(context.n_joints + i)
        plain = all(
            p.has(f"tendons.{k}.slack") and not p.has(f"tendons.{k}.stiffening") for k in tendons
        )
        if (
            len(tendons) != 2
            or not plain
            or context.position_sensor(i) is None
            or context.force_sensor(i) is None
        ):
            continue
        one, other = (rig.tendons[k].arms() for k in tendons)
        if one.keys() == other.keys() and all(one[name] * other[name] < 0 for name in one):
            yield i, tendons[0], tendons[1]


def slack_pair_function(states: StateVector, drive: int, pair: list[int]) -> ca.Function:
    """Return the function (state, tracks, x, p) → the joint's distance from the middle of its play,
    the play's width, whether both are known, and the distance's slope by the state.

    Distance and width are measured along a tendon [m]; the slope is (n, 1), sparse.
    """
    context = states.context
    mechanism = context.mechanism
    body = context.n_joints + drive
    sensor = context.force_sensor(drive)
    assert sensor is not None  # `slack_pairs`
    inputs = symbols(
        ca.SX, state=len(states), tracks=(len(TRACKED), context.n_drives), x=context.width
    )
    state, tracks, x = inputs
    p = mechanism.parameters
    q = states.coordinates(state, positions_of(tracks))
    (bodies,) = symbols(ca.SX, q=mechanism.n_bodies)
    parameters = states.parameters(state)
    levers = ca.fabs(mechanism.length_jacobian(bodies)[pair, body])
    stiffness = ca.vertcat(*(p[f"tendons.{k}.stiffness"] for k in pair))
    stretch = mechanism.elastic_forces(bodies)[pair] / stiffness
    stretch, yields = ca.Function("stretch", [bodies, p.symbols], [stretch, levers * stiffness])(
        q, parameters
    )
    limits = mechanics_function(context)(q, ca.SX.zeros(mechanism.n_bodies), parameters)[3]
    read = context.value(x, sensor)
    error = states.added(("reading", sensor.name), state, read)
    most = ca.fabs(read - error) + limits[body] + states.added(("friction", drive), state)
    beyond = stretch - (most + SURE * ca.sqrt(context.noise(sensor))) / yields
    residual = (beyond[0] - beyond[1]) / 2
    known = is_there(context.mask(x, sensor)) * (drive_of(tracks, drive).lost <= 0)
    slope = ca.sparsify(ca.jacobian((stretch[0] - stretch[1]) / 2, state)).T
    outputs = [residual, -(beyond[0] + beyond[1]), known, slope]
    return ca.Function("play", [*inputs, p.symbols], ca.cse(outputs))


def predicted(
    states: StateVector, mean: VectorNode, covariance: MatrixNode, moved: Moved, interval: Interval
) -> tuple[VectorNode, MatrixNode]:
    """Return mean and covariance after the joints have moved and the walks of an interval:
    equations (10) to (12).

    Only angles and speeds move; the rest of the covariance stays, but for walks.
    """
    context = states.context
    n = len(states)
    nj = context.n_joints
    ahead = ca.mtimes(moved.across(covariance), moved.slopes)
    products = ca.mtimes(moved.across(ahead.T), moved.slopes)
    positions = moved.slopes[len(moved.chosen) :, :]
    drives = interval.tracks, interval.memory, interval.x, interval.p
    corner = _corner(context)(products, positions, moved.speed_variances, *drives)
    after = ca.MX(covariance)
    for k in range(2 * nj):
        set_row(after, k, ahead[:, k], ahead[k, k])
    after[: 2 * nj, : 2 * nj] = corner
    state = ca.MX(mean)
    state[: 2 * nj] = ca.vertcat(moved.angles, moved.speeds)
    walking = [i for i in range(n) if states.walks[i] > 0.0]
    if walking:
        flat = ca.vec(after)
        diagonal = [i * (n + 1) for i in walking]
        walks = context.parameters(interval.p, [f"state.{i}.walk" for i in walking])
        flat[diagonal] = flat[diagonal] + interval.x[0] * walks**2
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
    inputs = symbols(
        ca.SX,
        products=(2 * nj, 2 * nj),
        S_drives=(nd, 2 * nj),
        speed_variances=nj,
        tracks=(len(TRACKED), nd),
        memory=(MEMORY, nd),
        x=context.width,
    )
    products, of_positions, speed_variances, tracks, memory, x = inputs
    read = [k for k in range(nd) if context.position_sensor(k) is not None]
    by_read = of_positions[read, :]
    variances = ca.vertcat(*(drive_of(tracks, k).variance for k in read))
    corner = products + ca.mtimes([by_read.T, ca.diag(variances), by_read])
    # to the angles and to the speeds of the joints that are free; coupled ones err as these
    free = context.mechanism.free
    spread = context.mechanism.spread
    angles = [
        followed_variance(context, j, tracks, memory) + context.robustness.angle_walk**2 * x[0]
        for j in free
    ]
    speeds = [speed_variances[j] + context.unmodelled(j) ** 2 * x[0] for j in free]
    added = (
        ca.mtimes([spread, ca.diag(ca.vertcat(*noise)), spread.T]) for noise in (angles, speeds)
    )
    corner = symmetric(ca.densify(corner + ca.diagcat(*added)))
    arguments = [*inputs, context.mechanism.parameters.symbols]
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
    for i, names in context.moved_by(joint).items():
        drive = drive_of(tracks, i)
        grown = ca.fmax(drive.unknown - remembered(memory, i, "unknown"), 0)
        ratio, share = map(context.number, names)
        total += followed_share(context.robustness, drive.lost) * grown * (ratio * share) ** 2
    return total


def revert(
    states: StateVector,
    prediction: Prediction,
    opened: Mapping[int, ScalarNode],
    interval: Interval,
) -> None:
    """Let the states that fade do so over an interval, in place: x⁺ = f x, variance σ² (1 − f²)
    added. Equation (13).

    For the external torque on a joint, the variance that is `opened` is added to σ², and to the
    covariance of two such torques what the same contact makes (13b).
    """
    dt = ca.SX.sym("dt")
    fadings = states.fadings()
    if not fadings:
        return
    factors = [ca.exp(-dt / time) for _, time, _ in fadings]
    values = ca.vertcat(*factors, *(std**2 * (1 - f**2) for (*_, std), f in zip(fadings, factors)))
    inputs = [dt, states.context.mechanism.parameters.symbols]
    fades = ca.Function("fading", inputs, [values])(interval.x[0], interval.p)
    state = prediction.state
    covariance = prediction.covariance
    transition = prediction.transition
    fade_of = {at: fades[k] for k, (at, *_) in enumerate(fadings)}
    for k, (at, fade) in enumerate(fade_of.items()):
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
    # the covariance of two joints' torques that the same contact makes
    context = states.context
    torques = [(at, joint) for at, joint in states.torque_states.items() if joint in opened]
    for (at, joint), (other_at, other) in combinations(torques, 2):
        if context.contact_shape[joint, other] != 0.0:
            together = context.parameters(interval.p, [context.loaded_with(joint, other)])
            size = together * ca.sqrt(opened[joint] * opened[other])
            added = covariance[at, other_at] + (1 - fade_of[at] * fade_of[other_at]) * size
            covariance[at, other_at] = added
            covariance[other_at, at] = added


def set_row(covariance: MatrixNode, at: int, row: VectorNode, variance: ScalarNode) -> None:
    """Replace row and column `at` of a covariance by `row`, (n, 1), with `variance` on the
    diagonal, in place.
    """
    covariance[:, at] = row
    covariance[at, :] = row.T
    covariance[at, at] = variance


CREST = 2.0
"""Number of stds of the effort's noise by which the limits of a play are widened [1], since crests
of the noise would move it. Source: benchmark (benchmarks/guards).
"""

TINY_EFFORT = 1e-9
"""Added to the standard deviation of x_z, so that its moments stay finite where it is certain [N, N
m]. Source: rounding (division by zero).
"""


def play(
    states: StateVector,
    drive: int,
    prediction: Prediction,
    rates: VectorNode,
    remembered: ScalarNode,
    interval: Interval,
) -> ScalarNode:
    """Let the effort that a drive transmits follow its measured effort by the play, in place;
    return the effort to remember.

    x_z⁺ = mean of clip(x_z, U − B_d ṡ − H, U − B_d ṡ + H) of a normal x_z (`clip_moments`): where
    x_z is between the limits, it and its uncertainty stay; at a limit it is as certain as the
    limit. U is smoothed, so that its noise does not move the play.

    Args:
        drive: index of the drive.
        prediction: is changed.
        rates: mean speed of each drive over the interval, (n_drives,).
        remembered: the drive's smoothed effort.
        interval: with its sample.
    """
    at = states.transmitted(drive)
    assert at is not None  # `play` is called for drives with hysteresis
    variance = prediction.covariance[at, at]
    *after, effort = play_function(states, drive, at)(
        prediction.state, variance, interval.tracks, rates, remembered, interval.x, interval.p
    )
    _move(prediction, at, *after)
    return effort


def _move(
    prediction: Prediction, at: int, mean: ScalarNode, row: VectorNode, added: ScalarNode
) -> None:
    """Give a state, in place, a new mean, its slopes `row` by all states before, and the variance
    that is `added`.
    """
    across = ca.mtimes(prediction.covariance, row)
    prediction.state[at] = mean
    set_row(prediction.covariance, at, across, ca.mtimes(row.T, across) + added)
    prediction.transition[at, :] = ca.mtimes(row.T, prediction.transition)


def _clipped(
    low: Scalar, high: Scalar, state: Vector, at: int, std: Scalar
) -> tuple[ClipMoments, Vector]:
    """Return the moments of clip(x_i, low, high) of a state x_i with a std, and the slopes of their
    mean by all states, (1, n).
    """
    moments = clip_moments(low, high, state[at], std)
    row = moments.by_low * ca.jacobian(low, state) + moments.by_high * ca.jacobian(high, state)
    row[0, at] += moments.by_mean
    return moments, row


def play_function(states: StateVector, drive: int, at: int) -> ca.Function:
    """Return the function (state, variance of z, tracks, rates, effort, x, p) → (z⁺, slopes, added
    variance, effort⁺); without a reading z stays.
    """
    context = states.context
    n = len(states)
    nd = context.n_drives
    mechanism = context.mechanism
    p = mechanism.parameters.symbols
    sensor = context.force_sensor(drive)
    assert sensor is not None  # as above
    inputs = symbols(
        ca.SX, state=n, P_z=1, tracks=(len(TRACKED), nd), rates=nd, effort=1, x=context.width
    )
    state, variance_of_z, tracks, rates, held_effort, x = inputs
    (q,) = symbols(ca.SX, q=mechanism.n_bodies)
    still = ca.SX.zeros(mechanism.n_bodies)
    limit = mechanism.hysteresis_limit(drive, q, mechanism.tensions(q, still))
    limits = ca.Function("limit", [q, p], [limit, mechanism.dampings()])
    at_end = states.coordinates(state, positions_of(tracks))
    held, dampings = limits(at_end, states.parameters(state))
    came = context.value(x, sensor)
    read = is_read(context.mask(x, sensor))
    share = context.number(f"drives.{drive}.reading_weight")
    following = ca.if_else(held_effort == 0, came, held_effort + share * (came - held_effort))
    smoothed = ca.if_else(read, following, held_effort)
    # what the effort has beyond the transmission's own: the sensor's error, and the drive's damping
    error = states.added(("reading", sensor.name), state, smoothed)
    error += dampings[context.n_joints + drive] * rates[drive]
    effort = smoothed - error
    left = share / (2 - share) * context.noise(sensor)
    held += CREST * ca.sqrt(left)
    std = ca.sqrt(ca.fmax(variance_of_z, 0)) + TINY_EFFORT
    moments, row = _clipped(effort - held, effort + held, state, at, std)
    ends = moments.by_low + moments.by_high
    outputs = [
        ca.if_else(read, moments.mean, state[at]),
        ca.if_else(read, row, ca.SX(ca.DM.eye(n)[at, :])).T,
        ca.if_else(read, moments.rest + ends**2 * left, 0),
        smoothed,
    ]
    return dense_function("play", [*inputs, p], outputs)


TINY_POSITION = 1e-12
"""Added to the standard deviation of a position, so that its moments stay finite where it is
certain [m, rad]. Source: rounding (division by zero).
"""


def follow(states: StateVector, prediction: Prediction, interval: Interval) -> None:
    """Move all internal states to the end of an interval, in place."""
    for at in _ordered(states):
        variance = prediction.covariance[at, at]
        after = following_function(states, at)(
            prediction.state, variance, interval.tracks, interval.x, interval.p
        )
        _move(prediction, at, *after)


def _ordered(states: StateVector) -> list[int]:
    """Return the indices of the internal states in the order in which they move: points of a sheath
    from end to end and back.
    """
    mechanism = states.context.mechanism
    points = states.of_kind(StateKind.SHEATH)
    order = list(states.of_kind(StateKind.BACKLASH))
    for tendon, name in enumerate(mechanism.rig.tendon_names):
        sheath = mechanism.sheath(tendon)
        if sheath is not None:
            along = [at for at in points if states.state_parts[at] == name]
            order += [along[k] for k in sheath.order()]
    return [*order, *states.of_kind(StateKind.CREEP)]


def following_function(states: StateVector, at: int) -> ca.Function:
    """Return the function (state, variance, tracks, x, p) → (mean, slopes, added variance) of one
    internal state after an interval.

    For a play they are the moments of clip(x_i, x_min, x_max) of a normal x_i (`clip_moments`); for
    a strain of creep, the model's value with its slopes.
    """
    context = states.context
    nd = context.n_drives
    mechanism = context.mechanism
    p = mechanism.parameters.symbols
    inputs = symbols(ca.SX, state=len(states), P_z=1, tracks=(len(TRACKED), nd), x=context.width)
    state, variance, tracks, x = inputs
    q, dt = symbols(ca.SX, q=mechanism.n_bodies, dt=1)
    at_end = states.coordinates(state, positions_of(tracks))
    arguments = [at_end, states.parameters(state), x[0]]
    name = mechanism.parameters.names[states.states[at].indices[0]]
    if name in mechanism.strains:
        strain = mechanism.crept(q, dt)[mechanism.strains.index(name)]
        crept = ca.Function("crept", [q, p, dt], [strain])(*arguments)
        outputs = [crept, ca.jacobian(crept, state).T, ca.SX(0)]
    else:
        bounds = mechanism.bounds(mechanism.plays.index(name), q)
        reached = [bounds.low, bounds.high]
        by_drives = [ca.jacobian(bound, q)[0, context.n_joints :] for bound in reached]
        low, high, *slopes = ca.Function("bounds", [q, p, dt], [*reached, *by_drives])(*arguments)
        std = ca.sqrt(ca.fmax(variance, 0)) + TINY_POSITION
        moments, row = _clipped(low, high, state, at, std)
        pushed = moments.by_low * slopes[0] + moments.by_high * slopes[1]
        noise = sum((pushed[0, i] ** 2 * drive_of(tracks, i).variance for i in range(nd)), ca.SX(0))
        outputs = [moments.mean, row.T, moments.rest + noise]
    return dense_function("follow", [*inputs, p], outputs)
