"""The friction in a drive's force, by how the drive moves: against its motion, or anything up to
its limit while it sticks.

Equations (18) to (21). A drive that moves has friction against its motion. A drive that sticks may
have any friction up to its limit. Where the rig declares friction, the mean residual of a sticking
drive is compared with the limits, and only the part beyond them counts (a clipped residual). Where
it declares none, friction keeps the sign that it had, and a sample counts little.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.drive_tracking import Drive
from distal.estimators.adaptive.filter_context import FilterContext
from distal.expressions import Scalar
from distal.kernels.layout import is_read

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


@dataclass(frozen=True)
class Comparison:
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


@dataclass(frozen=True)
class Residual:
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


@dataclass(frozen=True)
class DriveMotion:
    """The motion of a drive, as far as friction depends on it.

    Args:
        stuck: 0 where the drive clearly moves to 1 where it does not, (18).
        direction: −1 to 1, (19).
        clear: 1 where the drive clearly moves in one direction.
    """

    stuck: Scalar
    direction: Scalar
    clear: Scalar


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
    stuck = still / (moving + still)
    direction = (
        drive.speed / ca.sqrt(moving + still) / (1 + drive.bend**2 / (SHARP_BEND**2 * noise))
    )
    return DriveMotion(
        stuck, direction, ca.logic_and(stuck < CLEAR_STICK, ca.fabs(direction) > CLEAR_DIRECTION)
    )


def compared(
    context: FilterContext, index: int, drive: Drive, residual: Residual, dt: Scalar
) -> Comparison:
    """Return the comparison of the force of the drive with that `index`, after an interval `dt`
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
