"""Move the joints: measured displacements move the tendons, the tendons move the joints. Equations (7) to (10).

The precise sensor is the input: tensions follow from the joints' angles and the measured displacements, so that sliders,
their ringing and their stops leave the state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from distal.estimators.adaptive.drive_tracking import MEMORY, Tracks
from distal.estimators.adaptive.states import StateVector
from distal.model import Kick, impulses, kick_and_drift, responses, soft_moments

TINY_SPREAD = 1e-9
"""Added to the spread of a joint's speed so that its moments stay finite where no time passes [rad/s]."""


@dataclass(frozen=True)
class Moved:
    """The joints after an interval, symbolic.

    Args:
        angles: θ, (n_joints,).
        speeds: ω, (n_joints,).
        angle_slopes: ∂θ/∂(state, places), (n_joints, n + n_drives).
        speed_slopes: ∂ω/∂(state, places), (n_joints, n + n_drives).
        rest: variance that an uncertain torque adds to ω beyond its slope, (n_joints,).
        rates: mean speed of each drive over the interval, (n_drives,).
    """

    angles: Any
    speeds: Any
    angle_slopes: Any
    speed_slopes: Any
    rest: Any
    rates: Any


def moved(
    states: StateVector, count: int, mean: Any, covariance: Any, memory: Any, tracks: Any, x: Any, p: Any
) -> Moved:
    """Return the joints after an interval, moved by sub-steps with their slopes.

    Args:
        states: the state vector.
        count: sub-steps per interval.
        mean: before, (n,).
        covariance: before, (n, n).
        memory: of the drives.
        tracks: of the drives, now.
        x: the sample.
        p: the model's parameters.
    """
    setup, n = states.setup, len(states)
    nj, columns = setup.n_joints, n + setup.n_drives
    starts, rates, torques, *constant = _interval(states, count)(mean, covariance, memory, tracks, x, p)
    step, h = _substep(states), x[0] / count
    q, v = ca.vertcat(mean[:nj], starts), ca.vertcat(mean[nj : 2 * nj], rates)
    identity = ca.DM.eye(columns)
    angle_slopes, speed_slopes = (ca.MX(ca.densify(identity[i * nj : (i + 1) * nj, :])) for i in (0, 1))
    rest = ca.MX(ca.DM.zeros(nj))
    for _ in range(count):
        q, v, angle_slopes, speed_slopes, added = step(q, v, torques, h, angle_slopes, speed_slopes, *constant)
        rest = rest + added
    return Moved(q[:nj], v[:nj], angle_slopes, speed_slopes, rest, rates)


def _interval(states: StateVector, count: int) -> ca.Function:
    """Return what an interval needs before its sub-steps.

    (mean, P, memory, tracks, x, p) → places of the drives at its start, their speeds, external torques; then, the same for
    all sub-steps, the torques' stds, the model's parameters, the slopes of the places with respect to states and their own
    errors, the responses of the bodies, and, where a state changes them, the slopes of the joints' responses.
    """
    setup, n, nd = states.setup, len(states), states.setup.n_drives
    mechanism, p = setup.mechanism, setup.mechanism.parameters.symbols
    mean, covariance = ca.SX.sym("mean", n), ca.SX.sym("P", n, n)
    memory, vector = ca.SX.sym("memory", MEMORY * nd), ca.SX.sym("tracks", Tracks.size(nd))
    x, tracks = ca.SX.sym("x", setup.width), Tracks(vector, nd)
    dt, starts, rates, slopes = x[0], list[Any](), list[Any](), ca.SX(nd, n + nd)
    for i in range(nd):
        first = states.place(i, memory[MEMORY * i], mean)
        last = states.place(i, tracks[i].place, mean)
        starts.append(first)
        measured = setup.position_sensor(i) is not None
        rates.append(ca.if_else(dt > 0, (last - first) / ca.if_else(dt > 0, dt, 1), 0) if measured else ca.SX(0))
        slopes[i, :n] = ca.jacobian(last, mean)
        if measured:
            slopes[i, n + i] = 1
    parameters, h = states.parameters(mean), ca.SX.sym("h")
    respond = ca.Function("responses", [h, p], [responses(mechanism, h, h, rebounds=False)])
    torques, spreads = states.torques(mean), []
    for slope in ca.vertsplit(ca.jacobian(torques, mean)):
        # torques are sums of states of their own: their variances add up
        _, at = slope.sparsity().get_triplet()
        spreads.append(ca.sqrt(ca.fmax(sum((covariance[i, i] for i in at), ca.SX(0)), 0)) if at else ca.SX(0))
    response, responding = respond(dt / count, parameters), _responding(states)
    outputs = [ca.vertcat(*starts), ca.vertcat(*rates), torques, ca.vertcat(*spreads), parameters, slopes, response]
    if responding:
        outputs.append(ca.jacobian(ca.vec(response[: setup.n_joints, :2]), mean)[:, responding])
    return ca.Function(
        "interval", [mean, covariance, memory, vector, x, p], ca.cse([ca.densify(entry) for entry in outputs])
    )


def _responding(states: StateVector) -> list[int]:
    """Return which states change the responses a and b of a joint: its inertia and damping act through them alone."""
    mechanism, state, h = states.setup.mechanism, ca.SX.sym("state", len(states)), ca.SX.sym("h")
    p = mechanism.parameters.symbols
    respond = ca.Function("responses", [h, p], [responses(mechanism, h, h, rebounds=False)])
    own = respond(h, states.parameters(state))[: mechanism.n_joints, :2]
    _, columns = ca.jacobian(ca.vec(own), state).sparsity().get_triplet()
    return sorted({int(i) for i in columns})


def _substep(states: StateVector) -> ca.Function:
    """Return one sub-step of the joints with its slopes, the drives moving as they were measured to.

    (q, v, τ, h, S_θ, S_ω, σ_τ, p, S_drives, response, …) → (q⁺, v⁺, S_θ⁺, S_ω⁺, variance added to ω). Where an external
    torque can occur, mean and motion are exact, but slopes and the variance left over are those of the expectation over
    the torque (`soft_moments`): a stuck joint may be moved by a hand, though its linearisation says that it cannot.
    """
    setup, n, nd, nj = states.setup, len(states), states.setup.n_drives, states.setup.n_joints
    mechanism, p = setup.mechanism, setup.mechanism.parameters.symbols
    nb, columns = mechanism.n_bodies, n + nd
    q, v, torques, spreads = (ca.SX.sym(name, k) for name, k in (("q", nb), ("v", nb), ("tau", nj), ("s_tau", nj)))
    response, h = ca.SX.sym("response", nb, 4), ca.SX.sym("h")
    angle_slopes, speed_slopes = ca.SX.sym("S_theta", nj, columns), ca.SX.sym("S_omega", nj, columns)
    drive_slopes, state = ca.SX.sym("S_drives", nd, columns), ca.SX.sym("state", n)
    kick = Kick(q, v, ca.vertcat(torques, ca.SX(nd, 1)), response, h, h)
    q_next, v_next = kick_and_drift(mechanism, kick, rebounds=False, bodies=range(nj))
    torque_slopes = ca.jacobian(states.torques(state), state)
    speeds, rest = [v_next[j] for j in range(nj)], [ca.SX(0)] * nj
    pushed = sorted({int(j) for j in torque_slopes.sparsity().row()})
    if pushed:
        z, limits, damping = impulses(mechanism, kick)
        for j in pushed:
            held = 1 + response[j, 1] * damping[j]
            moments = soft_moments(z[j], limits[j], response[j, 1] * spreads[j] + TINY_SPREAD)
            speeds[j], rest[j] = moments.mean / held, moments.rest / held**2
    speed = ca.vertcat(*speeds)
    along = ca.mtimes(ca.jacobian(speed, q[:nj]), angle_slopes) + ca.mtimes(ca.jacobian(speed, v[:nj]), speed_slopes)
    along += ca.mtimes(ca.jacobian(speed, q[nj:]), drive_slopes)
    along[:, :n] += ca.mtimes(ca.jacobian(speed, p), _parameter_slopes(states))
    along[:, :n] += ca.mtimes(ca.jacobian(speed, torques), torque_slopes)
    arguments = [q, v, torques, h, angle_slopes, speed_slopes, spreads, p, drive_slopes, response]
    responding = _responding(states)
    if responding:
        arguments.append(ca.SX.sym("S_response", 2 * nj, len(responding)))
        by_response = ca.horzcat(ca.jacobian(speed, response[:nj, 0]), ca.jacobian(speed, response[:nj, 1]))
        along[:, responding] += ca.mtimes(by_response, arguments[-1])
    outputs = [q_next, v_next, angle_slopes + h * along, along, ca.vertcat(*rest)]
    return ca.Function("substep", arguments, ca.cse([ca.densify(entry) for entry in outputs]))


def _parameter_slopes(states: StateVector) -> Any:
    """Return ∂p/∂state, (n_p, n), numbers: states enter the parameters linearly."""
    p, state = states.setup.mechanism.parameters, ca.SX.sym("state", len(states))
    slopes = ca.jacobian(states.parameters(state), state)
    return ca.Function("slopes", [p.symbols], [slopes])(p.values)
