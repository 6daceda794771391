"""The displacement-driven prediction: measured displacements move the tendons, the tendons move the joint.

The precise sensor is the input: tensions follow from the joint's angle and the measured displacements, so sliders,
their ringing and their stops leave the state.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from distal.estimators.augmented import AugmentedState
from distal.estimators.channels import sensor_for
from distal.estimators.force_update import FOLLOWS, force_update
from distal.estimators.hysteresis import revert, set_row, transmit
from distal.estimators.kalman import symmetric
from distal.estimators.motion import MEMORY, Motion, follow
from distal.model import Kick, Mechanism, impulses, kick_and_drift, responses, soft_moments

BEND = 0.12
"""Share of the bend between samples that a straight line may miss."""

FORCE_MEMORY = 1
"""Numbers remembered per drive by the update: the mean residual of its force, or for how long it has stuck."""


def adaptive_function(
    augmented: AugmentedState,
    count: int,
    updates: int = 1,
    ideal: bool = False,
    trace: bool = False,
    loops: bool = False,
) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of the displacement-driven filter.

    Args:
        augmented: the layout of its state.
        count: sub-steps per interval.
        updates: how often the update is linearised again (iterated filter); 1 = extended.
        ideal: leave out all that guards against a wrong model; for bounds.
        trace: append the predicted mean and covariance and the slopes of (θ, ω) to y; for smoothing.
        loops: keep matrices as matrices, for small memories; else the update is one function of scalars, which is faster.
    """
    mechanism, channels = augmented.mechanism, augmented.channels
    n, nd, width = len(augmented), mechanism.n_drives, len(channels.names)
    memory = nd * (MEMORY + FORCE_MEMORY)
    carry, x = ca.MX.sym("carry", n + n * n + memory), ca.MX.sym("x", 1 + 2 * width)
    p = ca.MX.sym("p", len(mechanism.parameters))
    prepare, substep = prepare_function(augmented, count, ideal), substep_function(augmented)
    mean, covariance = carry[:n], ca.reshape(carry[n : n + n * n], n, n)
    held = carry[n + n * n :]
    places, speeds, parameters, drive_seeds, motions, response, noise, torque_std = prepare(
        mean, covariance, held, x, p
    )
    h = x[0] / count
    q, v = ca.vertcat(mean[0], places), ca.vertcat(mean[1], speeds)
    columns = n + nd
    slopes_q, slopes_v = (ca.MX(ca.densify(ca.DM.eye(columns)[i, :])) for i in (0, 1))
    effort = mean[augmented.torque_at] if augmented.torque is not None else ca.MX(0)
    rest = ca.MX(0)
    for _ in range(count):
        q, v, slopes_q, slopes_v, added = substep(
            q, v, effort, torque_std, response, h, parameters, slopes_q, slopes_v, drive_seeds
        )
        rest = rest + added
    told = [mean, covariance, q[0], v[0], slopes_q, slopes_v, rest, motions, speeds, noise, held, x, p]
    if loops:
        after, spread, kept, y, predicted, uncertain = updated(augmented, told, updates, ideal, loops=True)
    else:
        after, spread, kept, y, predicted, uncertain = update_function(augmented, updates, ideal)(*told)
    following = ca.vertcat(after, ca.reshape(spread, n * n, 1), motions[: nd * MEMORY], kept)
    if trace:
        moved = ca.reshape(ca.vertcat(slopes_q[:, :n], slopes_v[:, :n]).T, 2 * n, 1)
        y = ca.vertcat(y, predicted, ca.reshape(uncertain, n * n, 1), moved)
    return ca.Function("adaptive", [carry, x, p], [following, y], ["carry", "x", "p"], ["next", "y"])


def motions_of(augmented: AugmentedState, held: Any, x: Any) -> list[Motion | None]:
    """Return each drive's motion over the interval, None where nothing measures it.

    Args:
        augmented: the layout of the state.
        held: what is remembered of the drives.
        x: the sample.
    """
    channels, width = augmented.channels, len(augmented.channels.names)
    motions: list[Motion | None] = []
    for i, drive in enumerate(augmented.mechanism.rig.drives):
        sensor = sensor_for(channels.positions, drive.name)
        if sensor is None:
            motions.append(None)
            continue
        k = channels.names.index(sensor.name)
        reading, there = x[1 + k] - augmented.offset(sensor), x[1 + width + k]
        remembered = held[MEMORY * i : MEMORY * (i + 1)]
        motions.append(follow(remembered, reading, there, augmented.noise(sensor), 1.0 / sensor.rate, x[0]))
    return motions


def follow_all(
    augmented: AugmentedState, held: Any, x: Any, ideal: bool = False
) -> tuple[list[Any], list[Any], list[Any]]:
    """Return what is remembered of the drives' motions, their bends, and the variances of their places.

    Args:
        augmented: the layout of the state.
        held: what is remembered of the drives.
        x: the sample.
        ideal: take the places as exact between samples.
    """
    kept, bends, noise = [], [], []
    for i, motion in enumerate(motions_of(augmented, held, x)):
        sensor = sensor_for(augmented.channels.positions, augmented.mechanism.rig.drives[i].name)
        if motion is None or sensor is None:
            kept += [ca.SX(0)] * MEMORY
            bends.append(ca.SX(0))
            noise.append(ca.SX(0))
            continue
        kept += motion.memory()
        bends.append(motion.bend)
        missed = 0 if ideal else (BEND * motion.bend) ** 2
        noise.append(augmented.noise(sensor) + motion.unknown + missed)
    return kept, bends, noise


def prepare_function(augmented: AugmentedState, count: int, ideal: bool = False) -> ca.Function:
    """Return what an interval needs before its sub-steps.

    (mean, P, memory, x, p) → places of the drives at its start, their speeds, the model's parameters, the slopes of the
    drives' places with respect to states and position noise, the motions (memory, then bends), the response of the joint,
    the variance of each place, the standard deviation of the external torque.

    Args:
        augmented: the layout of the state.
        count: sub-steps per interval.
        ideal: take the places as exact between samples.
    """
    mechanism, channels = augmented.mechanism, augmented.channels
    n, nd, width = len(augmented), mechanism.n_drives, len(channels.names)
    mean, covariance = ca.SX.sym("mean", n), ca.SX.sym("P", n, n)
    held, x = ca.SX.sym("memory", nd * (MEMORY + 1)), ca.SX.sym("x", 1 + 2 * width)
    p, dt = mechanism.parameters.symbols, x[0]
    kept, bends, noise = follow_all(augmented, held, x, ideal)
    starts, speeds = [], []
    seeds = ca.SX(nd, n + nd)
    for i in range(nd):
        if i in augmented.places_at:
            starts.append(mean[augmented.places_at[i]])
            seeds[i, augmented.places_at[i]] = 1
            speeds.append(ca.SX(0))
            continue
        before, now = held[MEMORY * i], kept[MEMORY * i]
        first = before - augmented.systematic_error(i, before, mean)
        last = now - augmented.systematic_error(i, now, mean)
        starts.append(first)
        speeds.append(ca.if_else(dt > 0, (last - first) / ca.if_else(dt > 0, dt, 1), 0))
        at, spread = augmented.weights_at[i]
        if len(spread):
            seeds[i, at : at + len(spread)] = -augmented.basis(i, now).T
        seeds[i, n + i] = 1
    parameters = augmented.model_parameters(mean)
    h = ca.SX.sym("h")
    response = ca.Function("responses", [h, p], [responses(mechanism, h, h, rebounds=False)])(dt / count, parameters)
    torque_std = ca.SX(0)
    if augmented.torque is not None:
        torque_std = ca.sqrt(ca.fmax(covariance[augmented.torque_at, augmented.torque_at], 0))
    outputs = [ca.vertcat(*starts), ca.vertcat(*speeds), parameters, seeds, ca.vertcat(*kept, *bends)]
    outputs += [response, ca.vertcat(*noise), torque_std]
    return ca.Function("prepare", [mean, covariance, held, x, p], ca.cse([ca.densify(entry) for entry in outputs]))


def substep_function(augmented: AugmentedState) -> ca.Function:
    """Return one sub-step of the joint with its slopes, the drives moving as they were measured to.

    (q, v, τ, σ_τ, response, h, p, S_q, S_v, S_drives) → (q⁺, v⁺, S_q⁺, S_v⁺, variance added to ω). Where an external
    torque can occur, mean and motion are exact, but slopes and the variance left over are those of the expectation over
    the torque (`soft_moments`): a stuck joint may be moved by a hand, though its linearisation says that it cannot.

    Args:
        augmented: the layout of the state.
    """
    mechanism: Mechanism = augmented.mechanism
    n, nd, nb, p = len(augmented), mechanism.n_drives, mechanism.n_bodies, mechanism.parameters.symbols
    columns = n + nd
    q, v, torque, torque_std = ca.SX.sym("q", nb), ca.SX.sym("v", nb), ca.SX.sym("tau"), ca.SX.sym("s_tau")
    response, h = ca.SX.sym("response", nb, 4), ca.SX.sym("h")
    slopes_q, slopes_v = ca.SX.sym("S_q", 1, columns), ca.SX.sym("S_v", 1, columns)
    seeds = ca.SX.sym("S_drives", nd, columns)
    kick = Kick(q, v, ca.vertcat(torque, ca.SX(nd, 1)), response, h, h)
    q_next, v_next = kick_and_drift(mechanism, kick, rebounds=False, bodies=[0])
    speed, rest = v_next[0], ca.SX(0)
    if augmented.torque is not None:
        z, limits, damping = impulses(mechanism, kick)
        held = 1 + response[0, 1] * damping[0]
        # a tiny spread keeps the moments finite where no time passes
        moments = soft_moments(z[0], limits[0], response[0, 1] * torque_std + 1e-9)
        speed, rest = moments.mean / held, moments.rest / held**2
    parameter_seeds = ca.SX(len(mechanism.parameters), columns)
    for k, part in enumerate(augmented.parameters):
        for i in part.indices:
            scale = float(mechanism.parameters.values[i]) if part.factor else 1.0
            parameter_seeds[i, augmented.parameters_at + k] = scale
    along = ca.jacobian(speed, q[0]) * slopes_q + ca.jacobian(speed, v[0]) * slopes_v
    along += ca.mtimes(ca.jacobian(speed, q[1:]), seeds)
    used = sorted({i for part in augmented.parameters for i in part.indices})
    if used:
        along += ca.mtimes(ca.jacobian(speed, p)[:, used], parameter_seeds[used, :])
    if augmented.torque is not None:
        row = ca.SX(1, columns)
        row[0, augmented.torque_at] = 1
        along += ca.jacobian(speed, torque) * row
    outputs = [q_next, v_next, slopes_q + h * along, along, rest]
    arguments = [q, v, torque, torque_std, response, h, p, slopes_q, slopes_v, seeds]
    return ca.Function("substep", arguments, ca.cse([ca.densify(entry) for entry in outputs]))


def _lost_places(augmented: AugmentedState, motions: Any, held: Any) -> Any:
    """Return the variance of θ that comes from drives whose place is not known: the joint follows them at its arm.

    What an unknown place does within one interval is small, but it stays wrong until it is measured again: the longer
    it is missing, the more the joint has followed it. One missing sample does no harm.
    """
    total = ca.SX(0)
    for i, drive in enumerate(augmented.mechanism.rig.drives):
        tendon = next(t for t in augmented.mechanism.rig.tendons if t.drive == drive.name)
        lever = drive.radius.value if drive.kind == "capstan" else 1.0
        unknown, before, lost = motions[MEMORY * i + 4], held[MEMORY * i + 4], motions[MEMORY * i + 5]
        grown = ca.fmax(unknown - before, 0)
        followed = (lost / (lost + FOLLOWS)) ** 3
        total += followed * grown * (lever / tendon.insertion.radius.value) ** 2
    return total


def update_function(augmented: AugmentedState, updates: int, ideal: bool) -> ca.Function:
    """Return `updated` as one function of scalars: what is zero or twice the same is then left out.

    Args:
        augmented: the layout of the state.
        updates: how often the update is linearised again.
        ideal: leave out all that guards against a wrong model.
    """
    n, nd, width = len(augmented), augmented.mechanism.n_drives, len(augmented.channels.names)
    shapes = [(n, 1), (n, n), (1, 1), (1, 1), (1, n + nd), (1, n + nd), (1, 1), (nd * (MEMORY + 1), 1)]
    shapes += [(nd, 1), (nd, 1), (nd * (MEMORY + 1), 1), (1 + 2 * width, 1), (len(augmented.mechanism.parameters), 1)]
    symbols = [ca.MX.sym(f"i{k}", *shape) for k, shape in enumerate(shapes)]
    whole = ca.Function("update", symbols, list(updated(augmented, symbols, updates, ideal, loops=False)))
    scalars = [ca.SX.sym(f"i{k}", *shape) for k, shape in enumerate(shapes)]
    return ca.Function("update", scalars, ca.cse([ca.densify(entry) for entry in whole.call(scalars, True)]))


def updated(augmented: AugmentedState, told: list[Any], updates: int, ideal: bool, loops: bool) -> tuple[Any, ...]:
    """Return mean, covariance, memory of the forces, y, and predicted mean and covariance.

    Args:
        augmented: the layout of the state.
        told: mean and covariance before, θ and ω after, their slopes, variance added to ω, motions, speeds and variances of
            the places, what is remembered of the drives, the sample, the parameters.
        updates: how often the update is linearised again.
        ideal: leave out all that guards against a wrong model.
        loops: whether this stays a function of matrices.
    """
    mean, covariance, theta, omega, slopes_q, slopes_v, rest, motions, speeds, noise, held, x, p = told
    n, nd, dt = len(augmented), augmented.mechanism.n_drives, x[0]
    # only θ and ω move: the rest of the covariance stays, but for drift
    ahead_q, ahead_v = (ca.mtimes(covariance, slopes[:, :n].T) for slopes in (slopes_q, slopes_v))
    products = [
        ca.mtimes(one[:, :n], ahead) for one, ahead in ((slopes_q, ahead_q), (slopes_q, ahead_v), (slopes_v, ahead_v))
    ]
    added = added_function(augmented, ideal)
    corner = added(ca.vertcat(*products), slopes_q[:, n:], slopes_v[:, n:], noise, rest, motions, held, x, p)
    predicted = ca.MX(covariance)
    set_row(predicted, 0, ahead_q, corner[0])
    set_row(predicted, 1, ahead_v, corner[2])
    predicted[0, 1] = predicted[1, 0] = corner[1]
    state = ca.MX(mean)
    state[0], state[1] = theta, omega
    drifts = {i: d for i, d in augmented.drifts.items() if not ideal or i in augmented.places_at.values()}
    if drifts:
        diagonal = [i * (n + 1) for i in drifts]
        flat = ca.vec(predicted)
        flat[diagonal] = flat[diagonal] + dt * ca.DM([d**2 for d in drifts.values()])
        predicted = ca.reshape(flat, n, n)
    places, fading = fading_function(augmented)
    if places:
        fades = fading(x, p)
        for k, at in enumerate(places):
            revert(state, predicted, at, fades[2 * k], fades[2 * k + 1])
    if not loops:
        predicted = symmetric(predicted)
    remembered = [held[nd * MEMORY + i] for i in range(nd)]
    for i in augmented.transmitted_at:
        remembered[i] = transmit(augmented, i, state, predicted, motions, speeds, remembered[i], x, p)
    after, spread, kept, y = force_update(
        augmented, ca.MX(state), ca.MX(predicted), motions, speeds, noise, remembered, x, p, updates, ideal, loops
    )
    for k, part in enumerate(augmented.parameters):
        at = augmented.parameters_at + k
        if np.isfinite(part.lowest):
            after[at] = ca.fmax(after[at], part.lowest)
    return after, spread, ca.vertcat(*kept), y, state, predicted


def added_function(augmented: AugmentedState, ideal: bool) -> ca.Function:
    """Return the covariance of (θ, ω), as (qq, qv, vv), with what the drives' places and unknown torques add.

    Args:
        augmented: the layout of the state.
        ideal: leave out all that guards against a wrong model.
    """
    nd, width = augmented.mechanism.n_drives, len(augmented.channels.names)
    products, of_q, of_v = ca.SX.sym("products", 3), ca.SX.sym("S_q", 1, nd), ca.SX.sym("S_v", 1, nd)
    noise, rest, motions = ca.SX.sym("noise", nd), ca.SX.sym("rest"), ca.SX.sym("motions", nd * (MEMORY + 1))
    held, x = ca.SX.sym("memory", nd * (MEMORY + 1)), ca.SX.sym("x", 1 + 2 * width)
    qq, qv, vv = (products[i] for i in range(3))
    qq += ca.sum2(of_q**2 * noise.T) + _lost_places(augmented, motions, held)
    qv += ca.sum2(of_q * of_v * noise.T)
    vv += ca.sum2(of_v**2 * noise.T) + rest + (0 if ideal else augmented.unmodelled**2 * x[0])
    arguments = [products, of_q, of_v, noise, rest, motions, held, x, augmented.mechanism.parameters.symbols]
    return ca.Function("added", arguments, [ca.vertcat(qq, qv, vv)])


def fading_function(augmented: AugmentedState) -> tuple[list[int], ca.Function]:
    """Return which states fade towards zero, and (x, p) → what is left of each, and the variance that is added.

    Args:
        augmented: the layout of the state.
    """
    x, p = ca.SX.sym("x", 1 + 2 * len(augmented.channels.names)), augmented.mechanism.parameters.symbols
    dt, places, values = x[0], list[int](), list[Any]()

    def fades(at: int, fade: Any, std: Any) -> None:
        places.append(at)
        values.extend([fade, std**2 * (1 - fade**2)])

    if augmented.torque is not None:
        fades(augmented.torque_at, ca.exp(-dt / augmented.torque.correlation_time), augmented.torque_std)
    for at, sensor in augmented.wandering.items():
        std, drift = augmented.wander(sensor)
        fades(at, ca.exp(-dt * drift**2 / (2 * std**2)), std)
    for drive, at in augmented.considered.items():
        std, time = augmented.hysteresis_error(drive)
        fades(at, ca.exp(-dt / time), std)
    return places, ca.Function("fading", [x, p], [ca.vertcat(*values) if values else ca.SX(0, 1)])
