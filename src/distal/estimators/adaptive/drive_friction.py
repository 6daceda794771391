"""What friction makes of a force, by how its drive moves: against its motion, or anything up to its
limit while it sticks.

Equations (18) to (21). A drive that moves has friction against its motion. One that sticks has any
friction up to its limit: where the rig declares friction, its mean residual is compared with the
limits and only what is beyond them counts (a clipped residual); where friction is unknown, it keeps
the sign that it had, and a sample counts little.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.drive_tracking import MOTION_TIME, Drive
from distal.estimators.adaptive.filter_context import FilterContext
from distal.expressions import Scalar
from distal.kernels.mask import is_read

MOTION_SPAN = MOTION_TIME / 2.5
"""Time over which a drive's motion is compared with its sensor's noise [s]: one sample at 100 Hz.
"""

SLOW_DECLARED = 0.6
SLOW_UNKNOWN = 0.8
"""A drive that moves by so many stds of its sensor in `MOTION_SPAN` sticks half: with friction
declared, and not [1].
"""

CLEAR_STICK = 0.15
"""A drive that sticks by less than this clearly moves."""

TURNING = 0.5
CLEAR_DIRECTION = 0.9
"""Its direction, −1 to 1, is remembered beyond the first of these, and is clear beyond the second.
"""

SHARP_BEND = 10.0
"""A bend of this many standard deviations of its sensor between two samples halves the direction.
"""

TURNING_DECLARED = 3.0
"""Where friction is declared, it is unsure for so many times as long while its drive turns back
[1].
"""

MEAN_TIME = 0.1
"""Time constant of the mean residual of a force whose drive sticks [s]."""

STICK_STD = 0.42
"""Standard deviation of a tension within its friction's limits, as a share of the limit; 0.58 if it
were uniform [1].
"""


@dataclass(frozen=True)
class Comparison:
    """How a force is compared. With slopes r_x of the residual, l_x of the limit and a_x of its
    asymmetry, the slope of what is expected is −r_x + c_l l_x + c_a a_x.

    Args:
        innovation: measured minus expected.
        variance: of the innovation without the state's.
        memory: what is remembered of the drive: its mean residual where the rig declares friction,
            else its last clear direction times the time since then [s].
        by_limit: c_l.
        by_asymmetry: c_a.
        counts: 1 where its innovation belongs to a likelihood: a guess at the friction of a drive
            that hardly moves does not, since its variance is part of the guess.
    """

    innovation: Scalar
    variance: Scalar
    memory: Scalar
    by_limit: Scalar = 0
    by_asymmetry: Scalar = 0
    counts: Scalar = 1


@dataclass(frozen=True)
class Residual:
    """A force before friction is taken into account, all scalars.

    Args:
        value: measured minus expected, without friction.
        limit: friction limit, the mean of both directions.
        asymmetry: by how much it is larger against motion to +, and smaller against motion to −.
        variance: of the sensor and of the drive's position.
        limit_variance: of the limit by the state's, l_x P l_xᵀ.
        value_variance: of the residual by the state's, r_x P r_xᵀ.
        memory: what is remembered of the drive's force.
        mask: of the force, see `distal.kernels.mask`.
    """

    value: Scalar
    limit: Scalar
    asymmetry: Scalar
    variance: Scalar
    limit_variance: Scalar
    value_variance: Scalar
    memory: Scalar
    mask: Scalar


@dataclass(frozen=True)
class DriveMotion:
    """How a drive moves.

    Args:
        stuck: 0 where it clearly moves to 1 where it does not, (18).
        direction: −1 to 1, (19).
        clear: 1 where it clearly moves in one direction.
    """

    stuck: Scalar
    direction: Scalar
    clear: Scalar


def motion_of(drive: Drive, noise: Scalar, dt: Scalar, slow: float) -> DriveMotion:
    """Return how a drive moves: mean motion over `MOTION_SPAN` against what its sensor's noise
    alone would show.

    The `noise` is the variance of its position sensor, `dt` the interval [s], `slow` is
    `SLOW_DECLARED` or `SLOW_UNKNOWN`.
    """
    mean = MOTION_SPAN * drive.speed
    square = MOTION_SPAN**2 * drive.square
    still = slow**2 * noise
    alone = 2 * noise * (MOTION_SPAN / ca.fmax(dt, 1e-6)) ** 2
    moving = ca.fmax(ca.fmax(square - alone, 0), mean**2)
    stuck = still / (moving + still)
    direction = mean / ca.sqrt(moving + still) / (1 + drive.bend**2 / (SHARP_BEND**2 * noise))
    return DriveMotion(
        stuck, direction, ca.logic_and(stuck < CLEAR_STICK, ca.fabs(direction) > CLEAR_DIRECTION)
    )


def compared(
    context: FilterContext, index: int, drive: Drive, residual: Residual, dt: Scalar
) -> Comparison:
    """Return how a drive's force is compared after an interval `dt` [s]."""
    sensor = context.position_sensor(index)
    if sensor is None:
        # nobody knows how it moves: any friction up to its limit
        return Comparison(residual.value, residual.variance + residual.limit**2, residual.memory)
    noise = context.noise(sensor)
    force = context.force_sensor(index)
    interval = context.number("interval")
    if force is not None:
        interval = 1.0 / context.number(f"{context.path(force)}.rate")
    if context.declares_friction(index):
        return _declared(
            context, motion_of(drive, noise, dt, SLOW_DECLARED), residual, interval, dt
        )
    return _unknown(context, motion_of(drive, noise, dt, SLOW_UNKNOWN), residual, interval, dt)


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
    stuck = motion.stuck
    direction = motion.direction
    turning = (
        (1 - stuck) * (1 - direction**2) * TURNING_DECLARED * (robustness.turning_time / interval)
    )
    doubt = stuck * (robustness.sticking_time / interval) + turning
    counts = ca.SX(1)
    if robustness.moving_only:
        # a fit goes by the drives that clearly move: there friction is what it is
        doubt = ca.if_else(motion.clear, 0, doubt)
        counts = motion.clear
    innovation, variance = _slipping(residual, direction, doubt)
    fade = ca.exp(-dt / MEAN_TIME)
    mean = ca.if_else(
        is_read(residual.mask),
        fade * residual.memory + (1 - fade) * residual.value,
        residual.memory,
    )
    sign = ca.sign(mean)
    allowed = residual.limit + sign * residual.asymmetry
    beyond = ca.fabs(mean) > allowed
    # inside the limits nothing moves the mean, but the tension is no less certain than the limits
    # themselves
    bound = (STICK_STD * residual.limit) ** 2 + residual.variance + residual.limit_variance
    within = 1 / ca.fmax(1 / bound - 1 / ca.fmax(residual.value_variance, 1e-12), 1e-9)
    sticks = stuck > 0.5
    standing = ca.fmax(1, robustness.beyond_time / interval)
    return Comparison(
        ca.if_else(sticks, ca.if_else(beyond, mean - sign * allowed, 0), innovation),
        ca.if_else(sticks, ca.if_else(beyond, standing * residual.variance, within), variance),
        mean,
        ca.if_else(sticks, ca.if_else(beyond, sign, 0), direction),
        ca.if_else(sticks, ca.if_else(beyond, 1, 0), ca.fabs(direction)),
        counts,
    )
