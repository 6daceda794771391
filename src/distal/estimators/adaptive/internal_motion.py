"""Move the internal states of the rig over an interval: plays follow their bounds, tendons creep.
(15b)

docs/reference/adaptive-equations.md, section 5, "Plays inside the rig".
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from distal.estimators.adaptive.drive_tracking import Tracks
from distal.estimators.adaptive.interval import Interval, Prediction
from distal.estimators.adaptive.prediction import set_row
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.states.internal import BacklashOrSheathState, Strained
from distal.estimators.adaptive.transmission_play import CREST
from distal.estimators.state_kinds import StateKind
from distal.expressions import Matrix, Scalar
from distal.model import clip_moments

TINY_STD = 1e-12
"""Added to the standard deviation of a position, so that its moments stay finite where it is
certain [m, rad]. Source: rounding (division by zero).
"""


def follow(states: StateVector, prediction: Prediction, interval: Interval) -> None:
    """Move all internal states to the end of an interval, in place."""
    state = prediction.state
    covariance = prediction.covariance
    transition = prediction.transition
    tracks = interval.tracks
    x = interval.x
    p = interval.p
    for block in _ordered(states):
        at = states.indices(block)[0]
        mean, row, added = following_function(states, block)(
            state, covariance[at, at], tracks, x, p
        )
        across = ca.mtimes(covariance, row)
        variance = ca.mtimes(row.T, across) + added
        state[at] = mean
        set_row(covariance, at, across, variance)
        transition[at, :] = ca.mtimes(row.T, transition)


def _ordered(states: StateVector) -> list[BacklashOrSheathState | Strained]:
    """Return the internal states in the order in which they move: points of a sheath from end to
    end and back.
    """
    mechanism = states.context.mechanism
    order = list[BacklashOrSheathState | Strained]()
    blocks = [
        block for block in states.blocks if isinstance(block, (BacklashOrSheathState, Strained))
    ]
    points = {
        (block.index, block.point): block for block in blocks if block.kind is StateKind.SHEATH
    }
    still = ca.SX.zeros(mechanism.n_bodies)
    for block in blocks:
        if block.kind is not StateKind.SHEATH:
            order.append(block)
        elif block.point == 0:
            sheath = mechanism.sheath(block.index, still)
            assert sheath is not None  # it has points
            order += [points[block.index, k] for k in sheath.order()]
    return order


def following_function(states: StateVector, block: BacklashOrSheathState | Strained) -> ca.Function:
    """Return the function (state, variance, tracks, x, p) → (mean, slopes, added variance) of one
    internal state after an interval.

    For a play they are the moments of clip(x_i, x_min, x_max) of a normal x_i (`clip_moments`); for
    a strain of creep, the model's value with its slopes.
    """
    context = states.context
    n = len(states)
    nd = states.context.n_drives
    mechanism = context.mechanism
    nj = context.n_joints
    p = context.mechanism.parameters.symbols
    state = ca.SX.sym("state", n)
    variance = ca.SX.sym("P_z")
    x = ca.SX.sym("x", context.width)
    vector = ca.SX.sym("tracks", Tracks.size(nd))
    tracks = Tracks(vector, nd)
    q = ca.SX.sym("q", mechanism.n_bodies)
    dt = ca.SX.sym("dt")
    positions = [states.position(i, tracks[i].position, state) for i in range(nd)]
    arguments = [ca.vertcat(state[:nj], *positions), states.parameters(state), x[0]]
    at = states.indices(block)[0]
    if isinstance(block, Strained):
        crept = ca.Function("crept", [q, p, dt], [mechanism.crept(q, dt)[block.which]])(*arguments)
        outputs = [crept, ca.jacobian(crept, state).T, ca.SX(0)]
    else:
        bounds = mechanism.bounds(block.which, q)
        reached = [bounds.low, bounds.high]
        by_drives = [ca.jacobian(bound, q)[0, nj:] for bound in reached]
        low, high, *slopes = ca.Function("bounds", [q, p, dt], [*reached, *by_drives])(*arguments)
        noises = [_noise(states, i) for i in range(nd)]
        by_low = ca.jacobian(low, state)
        by_high = ca.jacobian(high, state)
        low -= CREST * _std(slopes[0], noises)
        high += CREST * _std(slopes[1], noises)
        moments = clip_moments(low, high, state[at], ca.sqrt(ca.fmax(variance, 0)) + TINY_STD)
        row = moments.by_low * by_low + moments.by_high * by_high
        row[0, at] += moments.by_mean
        pushed = moments.by_low * slopes[0] + moments.by_high * slopes[1]
        noise = sum((pushed[0, i] ** 2 * tracks[i].variance for i in range(nd)), ca.SX(0))
        outputs = [moments.mean, row.T, moments.rest + noise]
    symbols = [state, variance, vector, x, p]
    return ca.Function("follow", symbols, ca.cse([ca.densify(output) for output in outputs]))


def _noise(states: StateVector, drive: int) -> Scalar:
    sensor = states.context.position_sensor(drive)
    return 0 if sensor is None else states.context.noise(sensor)


def _std(slopes: Matrix, noises: Sequence[Scalar]) -> Scalar:
    return ca.sqrt(sum((slopes[0, i] ** 2 * noise for i, noise in enumerate(noises)), ca.SX(0)))
