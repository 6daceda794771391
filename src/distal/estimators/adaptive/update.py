"""Compare measured forces, tensions and angles with those that follow from the state, (17), and
update the state by one comparison after the other, unless a stop may hold a joint, (22) to (26).

The friction in a drive's force depends on how the drive moves, (18) to (21). A drive that moves
has friction against its motion. A drive that sticks may have any friction up to its limit. Where
the rig declares friction, the mean residual of a sticking drive is compared with the limits, and
only the part beyond them counts (a clipped residual). Where it declares none, friction keeps the
sign that it had, and a sample counts little.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from distal.estimators.adaptive.drive_tracking import (
    TRACKED,
    Drive,
    drive_of,
    positions_of,
)
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_inputs import Interval, Prediction, mechanics_function
from distal.estimators.adaptive.guard_settings import Robustness
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.touch import (
    FORCE,
    Remembered,
    evidence_function,
    open_torques,
)
from distal.estimators.kinematic import Downdate, along
from distal.expressions import (
    Matrix,
    MatrixNode,
    Scalar,
    ScalarNode,
    Vector,
    VectorNode,
    dense_function,
    symbols,
)
from distal.kernels.layout import Layout, is_read, is_there, share_used
from distal.model import Moment
from distal.rig import Sensor

SLOW_DECLARED = 60.0
"""Speed, in stds of the position sensor, at which a drive with declared friction counts as half
stuck [1/s]: 0.6 stds in a sample at 100 Hz. Source: benchmark (benchmarks.ablation).
"""

SLOW_UNKNOWN = 80.0
"""The same for a drive without declared friction [1/s]. Source: judgement."""

CLEAR_STICK = 0.15
"""A drive whose `stuck` is below this clearly moves [1]. Source: benchmark (benchmarks/guards)."""

TURNING = 0.5
"""Size of the direction, 0 to 1, beyond which its sign is remembered [1]. Source: benchmark
(benchmarks/guards).
"""

CLEAR_DIRECTION = 0.9
"""Size of the direction, 0 to 1, beyond which it is clear [1]. Source: judgement."""

SHARP_BEND = 10.0
"""Bend between two samples, in stds of the position sensor, that halves the direction [1]. Source:
benchmark (benchmarks/guards).
"""

TURNING_DECLARED = 3.0
"""Factor on `Robustness.turning_time`, for which friction is unsure while a drive turns back, where
friction is declared [1]. Source: benchmark (benchmarks/guards).
"""

MEAN_TIME = 0.1
"""Time constant of the mean residual of a force whose drive sticks [s]. Source: benchmark
(benchmarks/guards).
"""

STICK_STD = 0.42
"""Standard deviation of a tension within its friction's limits, as a share of the limit [1]; 0.58
if it were uniform. Source: benchmark (benchmarks/guards).
"""


class Comparison(NamedTuple):
    """The comparison of a force with its prediction, friction included.

    With slopes r_x of the residual, l_x of the limit and a_x of its asymmetry, the slope of what is
    expected is −r_x + c_l l_x + c_a a_x.

    Args:
        innovation: measured minus expected.
        variance: of the innovation, without the part from the state's covariance.
        memory: what is remembered of the drive: its mean residual where the rig declares friction,
            else its last clear direction times the time since then [s].
        by_limit: c_l.
        by_asymmetry: c_a.
        counts: 1 where the innovation belongs to a likelihood. It does not in a fit while the drive
            hardly moves, since its friction is then a guess and so is the variance.
    """

    innovation: Scalar
    variance: Scalar
    memory: Scalar
    by_limit: Scalar = 0
    by_asymmetry: Scalar = 0
    counts: Scalar = 1


class Residual(NamedTuple):
    """A force before friction is taken into account, all scalars.

    Args:
        value: measured minus expected, without friction.
        limit: friction limit, the mean of both directions.
        asymmetry: by how much the limit is larger against motion to +, and smaller against motion
            to −.
        variance: of the sensor and of the drive's position.
        limit_variance: of the limit, from the state's covariance, l_x P l_xᵀ.
        value_variance: of the residual, from the state's covariance, r_x P r_xᵀ.
        memory: what is remembered of the drive's force.
        mask: of the force, see `distal.kernels.layout`.
    """

    value: Scalar
    limit: Scalar
    asymmetry: Scalar
    variance: Scalar
    limit_variance: Scalar
    value_variance: Scalar
    memory: Scalar
    mask: Scalar


class DriveMotion(NamedTuple):
    """The motion of a drive, as far as friction depends on it.

    Args:
        stuck: 0 where the drive clearly moves to 1 where it does not, (18).
        direction: −1 to 1, (19).
    """

    stuck: Scalar
    direction: Scalar


def motion_of(drive: Drive, noise: Scalar, dt: Scalar, slow: float) -> DriveMotion:
    """Return the motion of a drive: its mean speed compared with what its sensor's noise alone
    would show.

    Args:
        drive: what is known of it after a reading.
        noise: variance of its position sensor.
        dt: length of the interval [s].
        slow: `SLOW_DECLARED` or `SLOW_UNKNOWN`.
    """
    still = slow**2 * noise
    alone = 2 * noise / ca.fmax(dt, 1e-6) ** 2
    moving = ca.fmax(ca.fmax(drive.square - alone, 0), drive.speed**2)
    direction = (
        drive.speed / ca.sqrt(moving + still) / (1 + drive.bend**2 / (SHARP_BEND**2 * noise))
    )
    return DriveMotion(still / (moving + still), direction)


def compared(
    context: FilterContext, index: int, drive: Drive, residual: Residual, dt: Scalar
) -> Comparison:
    """Return the comparison of the force of the `drive` with that `index`, after an interval `dt`
    [s].
    """
    sensor = context.position_sensor(index)
    if sensor is None:
        # its motion is not measured: any friction up to its limit
        return Comparison(residual.value, residual.variance + residual.limit**2, residual.memory)
    noise = context.noise(sensor)
    force = context.force_sensor(index)
    interval = context.number("interval")
    if force is not None:
        interval = 1.0 / context.number(f"{context.path(force)}.rate")
    slow, compare = SLOW_UNKNOWN, _unknown
    if context.declares_friction(index):
        slow, compare = SLOW_DECLARED, _declared
    motion = motion_of(drive, noise, dt, slow)
    return compare(context, motion, residual, interval, dt)


def _slipping(residual: Residual, direction: Scalar, doubt: Scalar) -> tuple[Scalar, Scalar]:
    """Return innovation and variance with friction against a motion, its limit in doubt: (20)."""
    value = residual.value - direction * residual.limit - ca.fabs(direction) * residual.asymmetry
    return value, residual.variance + doubt * (residual.limit**2 + residual.limit_variance)


def _unknown(
    context: FilterContext, motion: DriveMotion, residual: Residual, interval: Scalar, dt: Scalar
) -> Comparison:
    """Return how a force is compared whose friction the rig does not declare."""
    robustness = context.robustness
    # the last clear direction, times the time since: friction of a drive that stops stays as it was
    turned = ca.logic_and(motion.stuck < CLEAR_STICK, ca.fabs(motion.direction) > TURNING)
    since = residual.memory + ca.sign(residual.memory) * dt
    memory = ca.if_else(
        ca.logic_and(is_read(residual.mask), turned), ca.sign(motion.direction) * interval, since
    )
    direction = ca.if_else(motion.stuck < CLEAR_STICK, motion.direction, ca.sign(memory))
    # all samples of the time for which friction is the same tell as much as one, those of a long
    # stick little more
    sticking: Scalar = 0
    if robustness.sticking_time > 0.0:
        sticking = (
            ca.fmax(robustness.sticking_time, memory * memory / robustness.sticking_time) / interval
        )
    turning = (1 - motion.stuck) * (1 - direction**2) * (robustness.turning_time / interval)
    innovation, variance = _slipping(residual, direction, motion.stuck * sticking + turning)
    return Comparison(innovation, variance, memory, direction, ca.fabs(direction))


def _declared(
    context: FilterContext, motion: DriveMotion, residual: Residual, interval: Scalar, dt: Scalar
) -> Comparison:
    """Return how a force is compared whose friction the rig declares: a clipped residual while its
    drive sticks, (21).
    """
    robustness = context.robustness
    stuck, direction = motion
    turning = (
        (1 - stuck) * (1 - direction**2) * TURNING_DECLARED * (robustness.turning_time / interval)
    )
    doubt = stuck * (robustness.sticking_time / interval) + turning
    counts = ca.SX(1)
    if robustness.moving_only:
        # a fit goes by the drives that clearly move: there friction is what it is
        counts = ca.logic_and(stuck < CLEAR_STICK, ca.fabs(direction) > CLEAR_DIRECTION)
        doubt = ca.if_else(counts, 0, doubt)
    fade = ca.exp(-dt / MEAN_TIME)
    mean = ca.if_else(
        is_read(residual.mask),
        fade * residual.memory + (1 - fade) * residual.value,
        residual.memory,
    )
    sign = ca.sign(mean)
    allowed = residual.limit + sign * residual.asymmetry
    # inside the limits nothing moves the mean, but the tension is no less certain than the limits
    # themselves
    bound = (STICK_STD * residual.limit) ** 2 + residual.variance + residual.limit_variance
    inside = 1 / ca.fmax(1 / bound - 1 / ca.fmax(residual.value_variance, 1e-12), 1e-9)
    standing = ca.fmax(1, robustness.beyond_time / interval)
    beyond = ca.vertcat(mean - sign * allowed, standing * residual.variance, sign, 1)
    within = ca.vertcat(0, inside, 0, 0)
    slips = ca.vertcat(*_slipping(residual, direction, doubt), direction, ca.fabs(direction))
    sticks = ca.if_else(ca.fabs(mean) > allowed, beyond, within)
    shown = ca.vertsplit(ca.if_else(stuck > 0.5, sticks, slips))
    innovation, variance, by_limit, by_asymmetry = shown
    return Comparison(innovation, variance, mean, by_limit, by_asymmetry, counts)


TIE = 0.3
"""Standard deviation of the transmitted effort around the tendons' pull, in those of the effort's
sensor [1]. Source: benchmark (benchmarks/guards).
"""

NOMINAL_TIME = 1.0
"""Time for which an unmeasured pull keeps its departure from its nominal value [s]. Source:
judgement.
"""

ROW = Layout(value=1, limit=1, asymmetry=1, variance=1, mask=1)
"""Layout of the values of a row, as in `MeasurementRow`. Source: definition (layout of a
vector).
"""

SLOPED = ("value", "limit", "asymmetry")
"""Names of the values of a row that change with the state."""


@dataclass(frozen=True)
class MeasurementRow:
    """One force, tension, angle or other reading to compare, as expressions of a symbolic state.

    Args:
        name: of its sensor, or of the drive where the pull is only nominal.
        value: measured minus expected, without friction.
        variance: of the sensor and of the drive's position.
        mask: 0 where the row does not count, else see `distal.kernels.layout`.
        limit: friction limit of the drive, the mean of both directions.
        asymmetry: by how much the limit is larger against motion to +, and smaller against motion
            to −.
        drive: index of the drive whose friction is in it, or None.
        measured: whether a sensor measures it; else the pull is nominal.
        trusted: whether it is a reference, which is never taken as wild.
    """

    name: str
    value: Scalar
    variance: Scalar
    mask: Scalar
    limit: Scalar = 0
    asymmetry: Scalar = 0
    drive: int | None = None
    measured: bool = True
    trusted: bool = False


def measurement_rows_of(
    states: StateVector, state: Vector, tracks: Matrix, rates: Vector, x: Vector
) -> list[MeasurementRow]:
    """Return the rows to compare: U = Σ T ∂ℓ/∂s + B_d ṡ + friction of each drive, measured
    tensions, a reference's angle, other sensors.

    Args:
        state: symbolic, (n,).
        tracks: of the drives, a column for each.
        rates: mean speed of each drive over the interval, (n_drives,).
        x: the sample.
    """
    context = states.context
    mechanism = context.mechanism
    nj = context.n_joints
    q = states.coordinates(state, positions_of(tracks))
    v = ca.vertcat(state[nj : 2 * nj], rates)
    mechanics = mechanics_function(context)(q, v, states.parameters(state))
    tensions, pulls, dampings, limits, asymmetries, tension_slopes, pull_slopes = mechanics

    def read(sensor: Sensor) -> Scalar:
        value = context.value(x, sensor)
        return value - states.added(("reading", sensor.name), state, value)

    rows = []
    for i, drive in enumerate(mechanism.rig.drives):
        sensor = context.force_sensor(i)
        body = nj + i
        track = drive_of(tracks, i)
        transmitted = states.transmitted(i)
        expected = pulls[body] - states.added(("lacking force", i), state)
        limit = limits[body] + states.added(("friction", i), state)
        friction: tuple[Scalar, Scalar, int | None] = (limit, asymmetries[body], i)
        if sensor is None:
            path = f"drives.{i}.nominal_force"
            nominal_std = context.number(f"{path}.std")
            name = drive.name
            value = context.number(path)
            noise = nominal_std**2 * 2 * NOMINAL_TIME / ca.fmax(x[0], 1e-6)
            mask = nominal_std > 0.0
        else:
            name = sensor.name
            value = read(sensor)
            noise = context.noise(sensor)
            mask = context.mask(x, sensor)
        if transmitted is not None:
            value = state[transmitted]
            noise = TIE**2 * noise
            expected = expected - dampings[body] * rates[i]
            friction = (0, 0, None)
        variance = noise + track.variance * pull_slopes[body, body] ** 2
        mask = mask * away_from_stops(context, i, track.position)
        measured = sensor is not None
        rows.append(MeasurementRow(name, value - expected, variance, mask, *friction, measured))
    tendons = mechanism.rig.tendon_names
    for sensor in context.channels.tensions:
        t = tendons.index(sensor.of)
        body = mechanism.drive_of[t]
        spread = tension_slopes[t, body] ** 2 * drive_of(tracks, body - nj).variance
        value = read(sensor) - tensions[t]
        variance = context.noise(sensor) + spread
        rows.append(MeasurementRow(sensor.name, value, variance, context.mask(x, sensor)))
    moment = Moment(mechanism, q, v, tensions, pulls)
    for sensor in context.channels.angles:
        row = sensor.name, read(sensor) - moment.read(sensor), context.noise(sensor)
        rows.append(MeasurementRow(*row, context.mask(x, sensor), trusted=True))
    # as the filter names its innovations: by the rig's order of sensors; nominal pulls come last
    names = [sensor.name for sensor in context.channels.compared]
    return sorted(rows, key=lambda row: names.index(row.name) if row.measured else len(names))


def away_from_stops(context: FilterContext, drive: int, position: Scalar) -> Scalar:
    """Return 1 where the `position` of a drive is certainly not at a stop, since the contact force
    there is unknown, else 0: (17).
    """
    part = context.rig.drives[drive]
    sensor = context.position_sensor(drive)
    if part.stops is None or sensor is None:
        return ca.SX(1)
    p = context.mechanism.parameters
    path = context.path(sensor)
    low, high = (p[f"drives.{drive}.stops.{end}"] for end in ("low", "high"))
    # one that is held by its stop may read a position before it
    unknown = context.noise(sensor) + context.number(f"{path}.unknown_bias") ** 2
    wrong = context.number(f"{path}.linearity") + 2 * ca.sqrt(unknown)
    return ca.if_else(ca.logic_and(position > low + wrong, position < high - wrong), 1, 0)


def rows_function(states: StateVector) -> tuple[list[MeasurementRow], ca.Function]:
    """Return the rows to compare, and the function (state, tracks, rates, x, p) → the values
    (`ROW`) of each row, then the slopes of its `SLOPED` values by the state, (n, 3), of each.
    """
    context = states.context
    n = context.n_drives
    tracked = len(TRACKED), n
    inputs = symbols(ca.SX, state=len(states), tracks=tracked, rates=n, x=context.width)
    state = inputs[0]
    rows = measurement_rows_of(states, *inputs)
    values = [ca.densify(ca.vertcat(*(vars(row)[part] for part in ROW.names))) for row in rows]
    slopes = [ca.sparsify(ca.jacobian(value[: len(SLOPED)], state)).T for value in values]
    arguments = [*inputs, context.mechanism.parameters.symbols]
    return rows, ca.Function("rows", arguments, ca.cse([*values, *slopes]))


def depths_in_stops(states: StateVector, mean: VectorNode, p: VectorNode) -> dict[int, ScalarNode]:
    """Return joint → depth of its angle in its stop, negative before it [rad]; joints without stops
    are left out.

    It is at a `mean`, (n,), with the kernel's parameters p.
    """
    mechanism = states.context.mechanism
    names = mechanism.parameters.names
    depths = dict[int, ScalarNode]()
    for j, joint in enumerate(mechanism.rig.joints):
        if joint.stops is not None:
            low, high = (p[names.index(f"joints.{j}.stops.{end}")] for end in ("low", "high"))
            depths[j] = ca.fmax(mean[j] - high, low - mean[j])
    return depths


SMALLEST_VARIANCE = 1e-30
"""Smallest variance of a row's innovation [SI²], so that 0/0 is 0, also in float, for a row that
tells nothing (a drive without a force sensor, its tendons slack). Source: rounding (division by
zero).
"""


def updated(
    states: StateVector,
    prediction: Prediction,
    rates: VectorNode,
    kept: Remembered,
    interval: Interval,
) -> tuple[VectorNode, MatrixNode, VectorNode]:
    """Return mean, covariance, and (innovations, variances) after a sample; `kept` changes in
    place.

    For each row with slope A of the expected value: ν, S = A P Aᵀ + R', S' of `weights`, m⁺
    = m + P Aᵀ ν/S', P⁺ = P − P Aᵀ A P/S'. States that take only a share of the gain change by
    equations (24) and (25).

    Args:
        prediction: for the sample; it is not changed.
        rates: mean speed of each drive over the interval.
        kept: what is remembered of forces and of torques on the joints.
        interval: with its sample.
    """
    prior = prediction.state
    covariance = Downdate(prediction.covariance)
    tracks = interval.tracks
    p = interval.p
    dt = interval.x[0]
    rows, function = rows_function(states)
    compared_rows = function(prior, tracks, rates, interval.x, p)
    mean = prior
    innovations = list[ScalarNode]()
    spreads = list[ScalarNode]()
    nominal = states.context.parameters(p, ["interval"])
    evidence = dict[str, dict[str, ScalarNode]]()
    watch = evidence_function()
    touched = kept.touched
    fixed = np.flatnonzero(states.lasting).tolist()
    for row, values, jacobian in zip(rows, compared_rows, compared_rows[len(rows) :]):
        at = ROW.parts(values)
        slopes = dict(zip(SLOPED, ca.horzsplit(jacobian)))
        by = {part: covariance.times(slope) for part, slope in slopes.items()}
        now = (at[part] + along(slope, mean - prior) for part, slope in slopes.items())
        of_limit, of_value = (along(slopes[part], by[part]) for part in ("limit", "value"))
        if row.drive is None:
            comparison = Comparison(next(now), at["variance"], 0)
        else:
            memory = kept.friction[row.drive]
            residual = ca.vertcat(*now, at["variance"], of_limit, of_value, memory, at["mask"])
            compare = comparison_function(states, row.drive)
            comparison = Comparison(*compare(residual, tracks[:, row.drive], dt, p))
        factors = (-1, comparison.by_limit, comparison.by_asymmetry)
        across = ca.MX(len(states), 1)
        for part, factor in zip(SLOPED, factors):
            if slopes[part].nnz():
                across += factor * by[part]
        spread = sum(along(slopes[part], across) * by for part, by in zip(SLOPED, factors))
        variance = comparison.variance
        weigh = weights(states.context.robustness, row.trusted)
        weight, shown = weigh(
            spread + variance, comparison.innovation, at["mask"], comparison.counts
        )
        change = (weight * comparison.innovation) * across
        shares = states.gain_shares(row.drive, row.trusted, nominal)
        if kept.torques and not row.trusted:
            # parameters learn nothing from forces while something may touch the joints
            shares = {at: (1 - touched) * share for at, share in shares.items()}
        taken = ca.vertcat(*shares.values())
        if shares:
            change[list(shares)] *= taken
        if row.drive is not None:
            # a mean residual (friction declared) changes with the state; a remembered time does not
            declared = states.context.declares_friction(row.drive)
            kept.friction[row.drive] = comparison.memory + (
                along(slopes["value"], change) if declared else 0
            )
        if row.measured and row.name in kept.forces:
            # a force whose drive's position is lost tells nothing of torques
            position_is_read = 1 if row.drive is None else drive_of(tracks, row.drive).lost == 0
            used = share_used(at["mask"]) * position_is_read
            force = FORCE.joined(**kept.forces[row.name])
            outputs = watch(force, comparison.innovation, spread + variance, used, dt)
            evidence[row.name] = dict(zip(watch.name_out(), outputs))
            kept.forces[row.name] = dict(zip(FORCE.names, outputs))
        mean = mean + change
        covariance.take(ca.sqrt(weight) * across, list(shares), taken)
        if row.measured:
            innovations.append(shown)
            spreads.append(spread + variance)
    if kept.torques:
        # nor do other constants (biases, zeros) change while something touches a joint
        mean[fixed] += touched * (prior[fixed] - mean[fixed])
    open_torques(states, evidence, kept, mean, interval)
    return mean, covariance.matrix(), ca.vertcat(*innovations, *spreads)


def comparison_function(states: StateVector, drive: int) -> ca.Function:
    """Return the function (`Residual`, `TRACKED` values of its drive, dt, p) → the parts of
    `Comparison` of a row with the friction of a `drive`. Drives with the same sensors have the same
    function, whose C is there once.
    """
    context = states.context
    inputs = symbols(ca.SX, residual=len(Residual._fields), track=len(TRACKED), dt=1)
    vector, track, dt = inputs
    residual = Residual(*ca.vertsplit(vector))
    residual = residual._replace(limit=ca.fmax(residual.limit, 0))
    comparison = compared(context, drive, drive_of(track, 0), residual, dt)
    parts = [ca.SX(part) for part in comparison]
    return dense_function("compare", [*inputs, context.mechanism.parameters.symbols], parts)


def weights(robustness: Robustness, trusted: bool) -> ca.Function:
    """Return the function (S, ν, mask, counts) → 1/S' where a row is used, and the innovation to
    report, NaN for a row that does not count (its drive is at a stop).

    S' = max(S, ν²/c), with c = `Robustness.wild_force`, by which a wild innovation ν counts less
    (23). The function stays one of its own: its C is there once for all rows.
    """
    inputs = symbols(ca.SX, S=1, nu=1, mask=1, counts=1)
    spread, innovation, mask, counts = inputs
    robust = ca.fmax(spread, SMALLEST_VARIANCE)
    if not trusted:
        robust = ca.fmax(robust, innovation**2 / robustness.wild_force)
    shown = ca.if_else(ca.logic_and(is_there(mask), counts), innovation, np.nan)
    return dense_function("weights", inputs, [share_used(mask) / robust, shown])
