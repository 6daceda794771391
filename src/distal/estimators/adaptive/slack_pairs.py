"""Between two slack tendons no force tells where a joint is, but the joint lies within the play
that they leave: (26b).
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from distal.estimators.adaptive.drive_tracking import Tracks
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_inputs import Interval, mechanics_function
from distal.estimators.adaptive.states import StateVector
from distal.estimators.kalman import Downdate, along
from distal.expressions import MatrixNode, VectorNode
from distal.kernels.layout import is_there

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
    rig = context.mechanism.rig
    p = context.mechanism.parameters
    for i, drive in enumerate(rig.drives):
        tendons = [k for k, tendon in enumerate(rig.tendons) if tendon.drive == drive.name]
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
    mechanism = states.context.mechanism
    body = context.n_joints + drive
    sensor = context.force_sensor(drive)
    assert sensor is not None  # `slack_pairs`
    state = ca.SX.sym("state", len(states))
    x = ca.SX.sym("x", context.width)
    vector = ca.SX.sym("tracks", Tracks.size(context.n_drives))
    p = mechanism.parameters
    tracks = Tracks(vector)
    q = states.coordinates(state, tracks.positions)
    bodies = ca.SX.sym("q", mechanism.n_bodies)
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
    known = is_there(context.mask(x, sensor)) * (tracks[drive].lost <= 0)
    slope = ca.sparsify(ca.jacobian((stretch[0] - stretch[1]) / 2, state)).T
    outputs = [residual, -(beyond[0] + beyond[1]), known, slope]
    return ca.Function("play", [state, vector, x, p.symbols], ca.cse(outputs))
