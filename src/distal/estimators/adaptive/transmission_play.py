"""The effort that a drive's transmission passes on follows the measured effort by a play operator
(hysteresis). Equations (14) and (15).
"""

from __future__ import annotations

import casadi as ca

from distal.estimators.adaptive.drive_tracking import Tracks
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.interval import Interval, Prediction
from distal.estimators.adaptive.prediction import set_row
from distal.estimators.adaptive.states import StateVector, Transmitted
from distal.expressions import Scalar, ScalarNode, Vector, VectorNode
from distal.kernels.mask import is_read
from distal.model import clip_moments

CREST = 2.0
"""Number of stds of the effort's noise by which the limits of a play are widened [1], since crests
of the noise would move it. Source: benchmark (benchmarks/guards).
"""

TINY_STD = 1e-9
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
    state = prediction.state
    covariance = prediction.covariance
    transition = prediction.transition
    transmitted = states.transmitted(drive)
    assert transmitted is not None  # `play` is called for drives with hysteresis
    at, _ = transmitted
    mean, row, added, read, effort = play_function(states, drive)(
        state, covariance[at, at], interval.tracks, rates, remembered, interval.x, interval.p
    )
    across = ca.mtimes(covariance, row)
    variance_of_z = ca.mtimes(row.T, across) + added
    state[at] = mean
    across = ca.if_else(read, across, covariance[:, at])
    set_row(covariance, at, across, ca.if_else(read, variance_of_z, covariance[at, at]))
    transition[at, :] = ca.if_else(read, ca.mtimes(row.T, transition), transition[at, :])
    return effort


def smoothed_effort(
    context: FilterContext, block: Transmitted, remembered: Scalar, x: Vector
) -> Scalar:
    """Return a drive's effort in a sample x, smoothed with the `remembered` one, which is 0 before
    the first.
    """
    effort = context.value(x, block.sensor)
    following = remembered + context.number(block.weight_name) * (effort - remembered)
    return ca.if_else(
        is_read(context.mask(x, block.sensor)),
        ca.if_else(remembered == 0, effort, following),
        remembered,
    )


def play_function(states: StateVector, drive: int) -> ca.Function:
    """Return the function (state, variance of z, tracks, rates, effort, x, p) → (z⁺, slopes, added
    variance, whether the effort is read, effort⁺).
    """
    context = states.context
    n = len(states)
    nd = states.context.n_drives
    mechanism = context.mechanism
    p = context.mechanism.parameters.symbols
    nj = context.n_joints
    transmitted = states.transmitted(drive)
    assert transmitted is not None  # as above
    at, block = transmitted
    state = ca.SX.sym("state", n)
    variance_of_z = ca.SX.sym("P_z")
    vector = ca.SX.sym("tracks", Tracks.size(nd))
    rates = ca.SX.sym("rates", nd)
    remembered = ca.SX.sym("effort")
    x = ca.SX.sym("x", context.width)
    tracks = Tracks(vector, nd)
    positions = [states.position(i, tracks[i].position, state) for i in range(nd)]
    q = ca.SX.sym("q", mechanism.n_bodies)
    still = ca.SX.zeros(mechanism.n_bodies)
    limit = mechanism.hysteresis_limit(drive, q, mechanism.tensions(q, still))
    limits = ca.Function("limit", [q, p], [limit, mechanism.dampings()])
    held, dampings = limits(ca.vertcat(state[:nj], *positions), states.parameters(state))
    slope = ca.densify(ca.jacobian(held, state))
    smoothed = smoothed_effort(context, block, remembered, x)
    # what the effort has beyond the transmission's own: the sensor's error, and the drive's damping
    error = states.sensor_error(block.sensor, smoothed, state) + dampings[nj + drive] * rates[drive]
    effort = smoothed - error
    share = context.number(block.weight_name)
    left = share / (2 - share) * context.noise(block.sensor)
    held += CREST * ca.sqrt(left)
    moments = clip_moments(
        effort - held, effort + held, state[at], ca.sqrt(ca.fmax(variance_of_z, 0)) + TINY_STD
    )
    row = (moments.by_high - moments.by_low) * slope
    row[0, at] += moments.by_mean
    ends = moments.by_low + moments.by_high
    row -= ends * ca.jacobian(error, state)
    read = is_read(context.mask(x, block.sensor))
    outputs = [
        ca.if_else(read, moments.mean, state[at]),
        row.T,
        moments.rest + ends**2 * left,
        read,
        smoothed,
    ]
    arguments = [state, variance_of_z, vector, rates, remembered, x, p]
    return ca.Function("play", arguments, ca.cse([ca.densify(output) for output in outputs]))
