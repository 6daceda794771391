"""What is unknown of the joints' motion and of the drives: angles and speeds, which prediction
moves by the model, and torques that no sensor measures; a drive's position where no sensor measures
it, friction that the rig does not declare, and the effort that its transmission passes on.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import casadi as ca
import numpy as np

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar
from distal.rig import Sensor, angle_names, drive_travel, speed_names, torque_names
from distal.sensor_errors import variance

START_SPEED = 0.3
"""Standard deviation of a joint's speed at the first sample [rad/s]: a log may begin within a
motion. Source: benchmark (benchmarks.ablation).
"""


def motions(context: FilterContext) -> Iterator[State]:
    """Yield the angles of all joints, then the speeds of all."""
    rig = context.mechanism.rig
    joints = list(enumerate(rig.joints))
    for name, (j, joint) in zip(angle_names(rig.joint_names), joints):
        initial = joint.initial
        mean_by = partial(context.number, f"joints.{j}.initial")
        yield State(name, StateKind.ANGLE, joint.name, initial.value, initial.std, mean_by=mean_by)
    for name, (_, joint) in zip(speed_names(rig.joint_names), joints):
        yield State(name, StateKind.SPEED, joint.name, 0.0, START_SPEED)


def external_torques(context: FilterContext) -> Iterator[State]:
    """Yield the external torque τ_ext of each joint on which one can act: where the rig declares
    one, or where forces may show one. It is a first-order Gauss–Markov process.

    Where the rig declares none it is zero until a touch opens its variance, (13b).
    """
    rig = context.mechanism.rig
    for j, (joint, name) in enumerate(zip(rig.joints, torque_names(rig.joint_names))):
        std = joint.external_torque.std
        if std > 0.0 or j in context.touchable:
            path = f"joints.{j}.external_torque"
            yield State(
                name,
                StateKind.EXTERNAL_TORQUE,
                joint.name,
                0.0,
                std,
                to=("torque", j),
                std_by=partial(context.number, f"{path}.std"),
                fades_in=partial(context.number, f"{path}.correlation_time"),
            )


POSITION_WALK = 1.0
"""Random walk of a drive's position that nothing measures, in its travel [1/√s]: the drive may
cross it within a second. Source: judgement.
"""


def unmeasured_positions(context: FilterContext) -> Iterator[State]:
    """Yield the position s of each drive without a position sensor: anywhere on its travel at
    first; then it walks.
    """
    for i, drive in enumerate(context.mechanism.rig.drives):
        if context.position_sensor(i) is None:
            low, high = drive_travel(context.mechanism.rig, i)
            yield State(
                f"position_{drive.name}",
                StateKind.POSITION,
                drive.name,
                (low + high) / 2,
                (high - low) / np.sqrt(12.0),
                to=("position", i),
                walk=(high - low) * POSITION_WALK,
            )


def unknown_frictions(context: FilterContext) -> Iterator[State]:
    """Yield an addition to the friction limit of each drive with a force sensor whose friction the
    rig does not declare.

    Its size follows the noise σ of the drive's force sensor. It is not smoothed: friction at one
    time tells little of another time (docs/explanation/adaptive-guards.md).
    """
    guards = context.robustness
    if guards.unknown_friction == 0.0:
        return
    for i, drive in enumerate(context.mechanism.rig.drives):
        sensor = context.force_sensor(i)
        if sensor is None or drive.hysteresis is not None or context.declares_friction(i):
            continue
        noise = float(np.sqrt(variance(sensor)))
        yield State(
            f"friction_{drive.name}",
            StateKind.FRICTION,
            drive.name,
            0.0,
            guards.unknown_friction * noise,
            to=("friction", i),
            walk=guards.unknown_friction_walk * noise,
        )


def transmissions(context: FilterContext) -> Iterator[State]:
    """Yield for each drive with hysteresis and a force sensor the effort z that a play operator
    passes on, which `internal_motion.play` moves, and what one play operator leaves out: that is
    *considered*, since the model has no state for it.

    At first z is anywhere within the limits h of the play, h/√3, and the sensor's noise.
    """
    for i, drive in enumerate(context.mechanism.rig.drives):
        sensor = context.force_sensor(i)
        hysteresis = drive.hysteresis
        if sensor is None or hysteresis is None:
            continue
        path = f"drives.{i}"
        limit = play_limit(context, i)
        noise = variance(sensor)
        yield State(
            f"transmitted_{drive.name}",
            StateKind.TRANSMITTED,
            drive.name,
            drive.nominal_force.value,  # the first reading replaces it
            float(np.hypot(limit / np.sqrt(3.0), np.sqrt(noise))),
            std_by=partial(_transmitted_std, context, i, sensor),
            inputs={
                f"{path}.play_limit": limit,
                f"{path}.reading_weight": reading_weight(limit, noise),
            },
        )
        if hysteresis.error > 0.0:
            error = f"{path}.hysteresis.error"
            yield State(
                f"transmission_error_{drive.name}",
                StateKind.TRANSMISSION_ERROR,
                drive.name,
                0.0,
                hysteresis.error,
                to=("lacking force", i),
                std_by=partial(context.number, error),
                fades_in=partial(context.number, f"{error}_time"),
                inputs={error: hysteresis.error, f"{error}_time": hysteresis.error_time},
            )


def _transmitted_std(context: FilterContext, drive: int, sensor: Sensor) -> Scalar:
    limit = context.number(f"drives.{drive}.play_limit")
    return ca.sqrt(limit**2 / 3.0 + context.noise(sensor))


def play_limit(context: FilterContext, drive: int) -> float:
    """Return the limit h of a drive's play [N, N m] at pre-tension, with the joints at their
    `initial` angles.
    """
    mechanism = context.mechanism
    tensions = ca.DM([tendon.home_tension for tendon in mechanism.rig.tendons])
    angles = [joint.initial.value for joint in mechanism.rig.joints]
    q = ca.vertcat(*angles, ca.DM.zeros(mechanism.n_drives))
    limit = mechanism.hysteresis_limit(drive, q, tensions)
    p = mechanism.parameters
    return float(ca.Function("limit", [p.symbols], [limit])(p.values))


CALM = 8.0
"""Limit of a play over the noise of its smoothed effort, at least, (14) [1]. Source: judgement."""


def reading_weight(limit: float, noise: float) -> float:
    """Return the weight of a new reading of a drive's effort in its smoothed value: (14).

    It is 1 where the reading's variance `noise` is small against the square of the play's `limit`.
    """
    ratio = min((limit / CALM) ** 2 / noise, 1.0)
    return 2.0 * ratio / (1.0 + ratio)
