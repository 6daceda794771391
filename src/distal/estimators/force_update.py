"""The update of the displacement-driven filter: measured forces against the tensions that follow from the state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from distal.estimators.augmented import AugmentedState
from distal.estimators.channels import sensor_for
from distal.estimators.kalman import symmetric
from distal.estimators.motion import MEMORY, MOTION_TIME
from distal.sensors import variance

WILD_FORCE = 9.0
"""A squared innovation beyond this times its variance counts less: its variance grows in proportion."""

STOP_MARGIN = 1.0
"""A slider nearer to a stop than this times its sensor's linearity may touch it: its force tells nothing."""

STICK_WEIGHT = 50.0
"""Samples over which friction of a drive that sticks is the same: how little one of them tells."""

TURN_WEIGHT = 10.0
"""The same while a drive turns back."""

MEAN_TIME = 0.1
"""Time constant of the mean residual of a force whose drive sticks [s]."""

TIE = 0.3
"""How closely the transmitted effort fits the tendons' pull, in standard deviations of the effort's sensor."""

STICK_STD = 0.42
"""Standard deviation of a tension within its friction's limits, as a share of the limit."""

FOLLOWS = 0.05
"""Time in which the joint follows a drive whose place is not known [s]."""

ALONG = 20.0
"""How many times the variance of a place that is lost is added where the joint went along."""

NOMINAL_TIME = 1.0
"""Time over which an unmeasured pull's departure from its nominal value lasts [s]."""


@dataclass(frozen=True)
class ForceRow:
    """One force or tension to compare, as expressions of a symbolic state.

    Args:
        name: of its sensor, or of the drive where the pull is only nominal.
        residual: measured minus expected without friction.
        limit: friction limit of the drive, the mean of both directions, 0 for a tension.
        lean: by how much the limit is larger against motion to +, and smaller against motion to −.
        variance: of the sensor.
        mask: 1 where it counts.
        drive: index of the drive, or None for a tension.
        measured: whether a sensor measures it; else the pull is nominal.
        trusted: a reference, which is never taken as wild.
    """

    name: str
    residual: Any
    limit: Any
    lean: Any
    variance: Any
    mask: Any
    drive: int | None
    measured: bool = True
    trusted: bool = False


def force_rows(augmented: AugmentedState, state: Any, motions: Any, speeds: Any, noise: Any, x: Any) -> list[ForceRow]:
    """Return what is compared: U = Σ T ∂ℓ/∂s + b ṡ + friction of each drive, and measured tensions.

    Args:
        augmented: the layout of the state.
        state: symbolic, (n,).
        motions: of the drives; see `prepare_function`.
        speeds: of the drives, (n_drives,).
        noise: variance of each place, (n_drives,).
        x: the sample.
    """
    mechanism, channels = augmented.mechanism, augmented.channels
    p, nb, nj, width = mechanism.parameters.symbols, mechanism.n_bodies, mechanism.n_joints, len(channels.names)
    places = []
    for i in range(mechanism.n_drives):
        if i in augmented.places_at:
            places.append(state[augmented.places_at[i]])
        else:
            reading = motions[MEMORY * i]
            places.append(reading - augmented.systematic_error(i, reading, state))
    q, v = ca.vertcat(state[0], *places), ca.vertcat(state[1], speeds)
    symbols = [ca.SX.sym("q", nb), ca.SX.sym("v", nb), p]
    tensions = mechanism.tensions(*symbols[:2])
    pulls = ca.mtimes(mechanism.length_jacobian(symbols[0]).T, tensions) + mechanism.dampings() * symbols[1]
    friction = mechanism.friction_limits(symbols[0], symbols[1], tensions)
    outputs = [
        tensions,
        pulls,
        *(ca.vertcat(*(getattr(limit, part) for limit in friction)) for part in ("mean", "lean")),
    ]
    outputs += [ca.jacobian(tensions, symbols[0]), ca.jacobian(pulls, symbols[0])]
    values = ca.Function("pulls", symbols, outputs)(q, v, augmented.model_parameters(state))
    tensions, pulls, limits, leans, tension_slopes, pull_slopes = values
    rows = []
    for i, drive in enumerate(mechanism.rig.drives):
        sensor, body = sensor_for(channels.forces, drive.name), nj + i
        spread = (noise[i] + _went_along(motions, i)) * pull_slopes[body, body] ** 2
        limit, lean = limits[body], leans[body]
        if i in augmented.friction_at:
            limit += state[augmented.friction_at[i]]
        free = _away_from_stops(augmented, i, motions[MEMORY * i])
        if sensor is None:
            dt = ca.fmax(x[0], 1e-6)
            unsure = drive.nominal_force.std**2 * 2 * NOMINAL_TIME / dt
            known = float(drive.nominal_force.std > 0.0)
            residual = drive.nominal_force.value - pulls[body]
            rows.append(ForceRow(drive.name, residual, limit, lean, spread + unsure, known * free, i, measured=False))
            continue
        k = channels.names.index(sensor.name)
        if i in augmented.transmitted_at:
            damped = mechanism.dampings()[body] * speeds[i]
            residual = state[augmented.transmitted_at[i]] - (pulls[body] - damped)
            if i in augmented.considered:
                residual += state[augmented.considered[i]]
            own = TIE**2 * augmented.noise(sensor) + spread
            rows.append(ForceRow(sensor.name, residual, ca.SX(0), ca.SX(0), own, x[1 + width + k] * free, None))
            continue
        residual = x[1 + k] - augmented.offset(sensor) - pulls[body] - augmented.bias(sensor.name, state)
        own = augmented.noise(sensor)
        rows.append(ForceRow(sensor.name, residual, limit, lean, own + spread, x[1 + width + k] * free, i))
    tendons = [tendon.name for tendon in mechanism.rig.tendons]
    for sensor in channels.tensions:
        k, t = channels.names.index(sensor.name), tendons.index(sensor.of)
        body = mechanism.drive_of[t]
        own = augmented.noise(sensor) + tension_slopes[t, body] ** 2 * noise[body - nj]
        residual = x[1 + k] - augmented.offset(sensor) - tensions[t] - augmented.bias(sensor.name, state)
        rows.append(ForceRow(sensor.name, residual, ca.SX(0), ca.SX(0), own, x[1 + width + k], None))
    for sensor in channels.angles:
        k = channels.names.index(sensor.name)
        residual = x[1 + k] - augmented.offset(sensor) - state[0] - augmented.bias(sensor.name, state)
        rows.append(
            ForceRow(
                sensor.name, residual, ca.SX(0), ca.SX(0), augmented.noise(sensor), x[1 + width + k], None, trusted=True
            )
        )
    # as the filter names its innovations: by the rig's order of sensors; nominal pulls come last
    names = [sensor.name for sensor in channels.compared]
    return sorted(rows, key=lambda row: names.index(row.name) if row.measured else len(names))


def _went_along(motions: Any, drive: int) -> Any:
    """Return the variance to add to a place that has long been missing, so that its force does not speak of the joint.

    The joint went where the drive went: its error and the place's are one, and cancel in the tension. The filter, to
    which they are independent, would otherwise share the residual between them.
    """
    unknown, lost = motions[MEMORY * drive + 4], motions[MEMORY * drive + 5]
    return ALONG * (lost / (lost + FOLLOWS)) ** 3 * unknown


def _away_from_stops(augmented: AugmentedState, drive: int, place: Any) -> Any:
    """Return 1 where a drive is certainly not at a stop: there the contact force is unknown."""
    part = augmented.mechanism.rig.drives[drive]
    sensor = sensor_for(augmented.channels.positions, part.name)
    if part.stops is None or sensor is None:
        return ca.SX(1)
    low, high = part.stops
    margin = STOP_MARGIN * sensor.linearity + 10 * np.sqrt(variance(sensor)) + 0.002 * (high - low)
    return ca.if_else(ca.logic_and(place > low + margin, place < high - margin), 1, 0)


def force_update(
    augmented: AugmentedState,
    prior: Any,
    covariance: Any,
    motions: Any,
    speeds: Any,
    noise: Any,
    residuals: Any,
    x: Any,
    updates: int,
    ideal: bool = False,
) -> tuple[Any, Any, Any, Any]:
    """Return mean, covariance, remembered mean residuals, and (innovations, variances) after the forces of a sample.

    A drive that moves has friction against its motion. One that sticks has any friction up to its limit: where the rig
    declares friction, its mean residual is compared with the limits and only what is beyond them counts (a clipped
    residual); where friction is unknown, a sample counts little. A wild force counts little too.

    Args:
        augmented: the layout of the state.
        prior: state before, (n,).
        covariance: before, (n, n).
        motions: of the drives.
        speeds: of the drives.
        noise: variance of each place.
        residuals: what is remembered of each drive's force, (n_drives,); see `TakenRow`.
        x: the sample.
        updates: how often each row is linearised again.
        ideal: leave out all that guards against a wrong model.
    """
    n, nd = len(augmented), augmented.mechanism.n_drives
    symbol = ca.SX.sym("state", n)
    rows = force_rows(augmented, symbol, motions, speeds, noise, x)
    arguments = [symbol, motions, speeds, noise, x, augmented.mechanism.parameters.symbols]
    values = ca.vertcat(*(ca.vertcat(row.residual, row.limit, row.lean, row.variance, row.mask) for row in rows))
    first = [ca.vertcat(*(getattr(row, part) for row in rows)) for part in ("residual", "limit", "lean")]
    tables = ca.Function("rows", arguments, [values, *(ca.jacobian(part, symbol) for part in first)])

    mean, kept = prior, [residuals[i] for i in range(nd)]
    innovations, spreads = [], []
    for k, row in enumerate(rows):
        point = prior
        for _ in range(updates):
            table, *slopes = tables(point, *arguments[1:])
            residual, limit, lean, own, mask = (table[5 * k + j] for j in range(5))
            slope, limit_slope, lean_slope = (part[k, :] for part in slopes)
            now = residual + ca.mtimes(slope, mean - point)
            allowed = ca.fmax(limit + ca.mtimes(limit_slope, mean - point), 0)
            taken = friction_row(
                augmented,
                row.drive,
                motions,
                now,
                allowed,
                lean + ca.mtimes(lean_slope, mean - point),
                own,
                slope,
                limit_slope,
                lean_slope,
                covariance,
                kept,
                mask,
                x[0],
                ideal,
            )
            across = ca.mtimes(covariance, taken.slope.T)
            spread = ca.mtimes(taken.slope, across) + taken.variance
            robust = spread * (1 if ideal or row.trusted else ca.fmax(1, taken.innovation**2 / (WILD_FORCE * spread)))
            point = mean + ca.fmax(mask, 0) * across / robust * taken.innovation
        # a mask of −1: compared, but not used
        gain = ca.fmax(mask, 0) * across / robust
        for at in augmented.considered.values():
            gain[at] = 0  # considered, not estimated (Schmidt, 1966): what the model leaves out is no state to be found
        change = gain * taken.innovation
        if row.drive is not None:
            # a mean residual moves with the state; a count of samples does not
            moved = 0 if augmented.is_clean(row.drive) else ca.mtimes(slope, change)
            kept[row.drive] = taken.memory + moved
        mean = mean + change
        # with the optimal gain K = a/S, P − K aᵀ − a Kᵀ + K S Kᵀ is P − K aᵀ; with another one it is P − K dᵀ − d Kᵀ
        half = across - gain * (robust / 2)
        lost = ca.mtimes(gain, across.T)
        if augmented.considered:
            lost = ca.mtimes(gain, half.T) + ca.mtimes(half, gain.T)
        covariance = symmetric(covariance - lost)
        # what is not compared (its slider at a stop) has no innovation
        innovations.append(ca.if_else(ca.logic_and(mask != 0, taken.counts), taken.innovation, np.nan))
        spreads.append(spread)
    measured = [k for k, row in enumerate(rows) if row.measured]
    y = ca.vertcat(*(innovations[k] for k in measured), *(spreads[k] for k in measured))
    return mean, covariance, ca.vertcat(*kept), y


@dataclass(frozen=True)
class TakenRow:
    """How a force is taken.

    Args:
        innovation: measured minus expected.
        slope: of the expected value with respect to the state, (1, n).
        variance: of the innovation without the state's.
        memory: what is remembered of the drive: its mean residual where the rig declares friction, else its last clear
            direction times the samples since then.
        counts: 1 where its innovation belongs to a likelihood: a guess at the friction of a drive that hardly moves does
            not, since its variance is part of the guess.
    """

    innovation: Any
    slope: Any
    variance: Any
    memory: Any
    counts: Any = 1


def friction_row(
    augmented: AugmentedState,
    drive: int | None,
    motions: Any,
    residual: Any,
    limit: Any,
    lean: Any,
    own: Any,
    slope: Any,
    limit_slope: Any,
    lean_slope: Any,
    covariance: Any,
    kept: list[Any],
    mask: Any,
    dt: Any,
    ideal: bool = False,
) -> TakenRow:
    """Return how a force is taken, by how its drive moves.

    Args:
        augmented: the layout of the state.
        drive: its index, None for a tension.
        motions: of all drives.
        residual: measured minus expected, without friction.
        limit: friction limit, the mean of both directions.
        lean: by how much it is larger against motion to +.
        own: variance of the sensor.
        slope: of the residual with respect to the state, (1, n).
        limit_slope: of the limit, (1, n).
        lean_slope: of the lean, (1, n).
        covariance: of the state, (n, n).
        kept: what is remembered of all drives' forces.
        mask: 1 where the force counts.
        dt: length of the interval [s].
        ideal: leave out all that guards against a wrong model.
    """
    if drive is None or drive in augmented.places_at:
        held = ca.SX(0) if drive is None else kept[drive]
        return TakenRow(residual, -slope, own + limit**2, held)
    sensor = sensor_for(augmented.channels.positions, augmented.mechanism.rig.drives[drive].name)
    assert sensor is not None  # else its place would be a state
    read = augmented.noise(sensor)
    # motion over as long as the mean speed takes, against what noise alone would show
    span = MOTION_TIME / 2.5
    mean, square = span * motions[MEMORY * drive + 2], span**2 * motions[MEMORY * drive + 3]
    bend = motions[MEMORY * augmented.mechanism.n_drives + drive]
    declared = not augmented.is_clean(drive)
    slow = read * (0.36 if declared else 0.64)
    alone = 2 * read * (span / ca.fmax(dt, 1e-6)) ** 2
    moving = ca.fmax(ca.fmax(square - alone, 0), mean**2)
    stuck = slow / (moving + slow)
    direction = mean / ca.sqrt(moving + slow) / (1 + bend**2 / (100 * read))
    held = ca.SX(0)
    if not declared:
        # the last clear direction, times the samples since: friction of a drive that stops stays as it was
        clear = ca.logic_and(stuck < 0.15, ca.fabs(direction) > 0.5)
        since = kept[drive] + ca.sign(kept[drive])
        held = ca.if_else(mask > 0, ca.if_else(clear, ca.sign(direction), since), kept[drive])
        direction = ca.if_else(stuck < 0.15, direction, ca.sign(held))
    unsure = ca.mtimes(ca.mtimes(limit_slope, covariance), limit_slope.T)
    weight = 3 * TURN_WEIGHT if declared else TURN_WEIGHT
    # while it sticks its friction stays the same: a long stick tells little more than a short one
    sticking = STICK_WEIGHT if declared else ca.fmax(STICK_WEIGHT, held * held / STICK_WEIGHT)
    clear = ca.logic_and(stuck < 0.15, ca.fabs(direction) > 0.9)
    doubt = 0 if ideal else stuck * sticking + (1 - stuck) * (1 - direction**2) * weight
    counts: Any = 1
    if declared and not augmented.suspicious:
        # a fit goes by the drives that clearly move: there friction is what it is
        doubt, counts = ca.if_else(clear, 0, doubt), clear
    sliding = TakenRow(
        residual - direction * limit - ca.fabs(direction) * lean,
        -(slope - direction * limit_slope - ca.fabs(direction) * lean_slope),
        own + doubt * (limit**2 + unsure),
        ca.SX(0),
    )
    fade = ca.exp(-dt / MEAN_TIME)
    average = ca.if_else(mask > 0, fade * kept[drive] + (1 - fade) * residual, kept[drive])
    if not declared:
        return TakenRow(sliding.innovation, sliding.slope, sliding.variance, held)
    sign = ca.sign(average)
    allowed = limit + sign * lean
    beyond = ca.fabs(average) > allowed
    known = ca.mtimes(ca.mtimes(slope, covariance), slope.T)
    # inside the limits nothing moves the mean, but the tension is no less certain than the limits themselves
    bound = (STICK_STD * limit) ** 2 + own + unsure
    within = 1 / ca.fmax(1 / bound - 1 / ca.fmax(known, 1e-12), 1e-9)
    sticks = stuck > 0.5
    clipped_slope = ca.if_else(beyond, -(slope - sign * limit_slope - lean_slope), -slope)
    return TakenRow(
        ca.if_else(sticks, ca.if_else(beyond, average - sign * allowed, 0), sliding.innovation),
        ca.if_else(sticks, clipped_slope, sliding.slope),
        ca.if_else(sticks, ca.if_else(beyond, own, within), sliding.variance),
        average,
        counts,
    )
