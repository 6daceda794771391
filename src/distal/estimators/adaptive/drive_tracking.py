"""Track the drives: the position and motion of each, from readings that may be missing or wild.
Equations (1) to (6).

`Drive` says what is remembered of each.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Generic

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_inputs import mechanics_function, usual_square
from distal.estimators.adaptive.guards import (
    SETTLED_TIME,
    Robustness,
    chance_of_jump,
    is_far,
    jump_evidence,
    kept_shift,
    zero_jumped,
)
from distal.estimators.adaptive.states import StateVector
from distal.estimators.read_channels import DEAD_INTERVALS, UNKNOWN_POSITION, dead_after
from distal.expressions import Expression, Scalar, ScalarNode, VectorNode
from distal.kernels.layout import Layout, is_bridge, is_read, is_there, rows_left
from distal.rig import Rig, Sensor
from distal.sensor_errors import variance

MOTION_TIME = 0.025
"""Time constant of the mean motion of a drive [s]: two to five samples at 100 to 200 Hz. Source:
judgement.
"""

PULL_STD = 0.1
"""Share of a drive's pull that is not known when a jump is judged by it, because of stiffness and
angle [1]. Source: benchmark (benchmarks.ablation).
"""

OLD = 3.0
"""Number of exact repetitions in a row from which on a reading may be an old one [1]. Source:
judgement.
"""

SAME = 1e-12
"""Square of a difference, in variances of the noise, below which readings are the same [1]. Source:
rounding.
"""

WANDERING = 1.0
"""Time in which the std of a drive's position grows by `UNKNOWN_POSITION` where no reading comes
back [s]. Source: benchmark (benchmarks.ablation).
"""


@dataclass(frozen=True)
class Drive:
    """What is known of a drive after a reading, all scalars.

    Args:
        position: that its sensor reads or should read, at the end of the interval [m, rad].
        doubt: for how long readings have been far from the expected position [s].
        speed: mean speed, over `MOTION_TIME`.
        square: mean square speed.
        unknown: variance of the position beyond the sensor's noise; it grows while readings are
            missing.
        lost: time since the last good reading [s].
        shift: by which the zero of the position sensor has jumped [m, rad].
        shift_std: std of `shift`, where nothing says whether the drive or the zero jumped [m, rad].
        effort: last reading of the drive's force sensor [N, N m].
        repeats: number of samples in a row in which one of its sensors read exactly the same [1].
        bend: change of displacement from one interval to the next, of which a straight line between
            samples misses a share.
        variance: of the position, for the filter: noise, what is unknown, what a straight line
            misses.
    """

    position: Scalar
    doubt: Scalar
    speed: Scalar
    square: Scalar
    unknown: Scalar
    lost: Scalar
    shift: Scalar
    shift_std: Scalar
    effort: Scalar
    repeats: Scalar
    bend: Scalar
    variance: Scalar


TRACKED = tuple(part.name for part in fields(Drive))
"""Names of the values that are known of each drive after a reading."""

REMEMBERED = TRACKED[: TRACKED.index("bend")]
"""Names of those that are remembered."""

MEMORY = len(REMEMBERED)
"""Number of values that are remembered of each drive."""


class Tracks(Generic[Expression]):
    """All drives' `TRACKED` values as one vector: those that are remembered, drive by drive, then
    all bends, then all variances.
    """

    def __init__(self, vector: Expression) -> None:
        self.vector = vector
        self._n = vector.numel() // len(TRACKED)

    @staticmethod
    def size(n_drives: int) -> int:
        """Return the length of the vector for `n_drives` drives."""
        return len(TRACKED) * n_drives

    def __getitem__(self, drive: int) -> Drive:
        """Return what is known of one drive."""
        return Drive(*(self.vector[i] for i in self._indices(drive)))

    def of(self, drive: int) -> Expression:
        """Return what is known of one drive as a vector, in the order of `TRACKED`."""
        return self.vector[self._indices(drive)]

    def _indices(self, drive: int) -> list[int]:
        behind = MEMORY * self._n + drive
        return [*range(MEMORY * drive, MEMORY * (drive + 1)), behind, behind + self._n]

    @property
    def positions(self) -> list[Expression]:
        """The position of each drive."""
        return [self.vector[MEMORY * i] for i in range(self._n)]

    @property
    def memory(self) -> Expression:
        """The values that are remembered for the next interval, (MEMORY n_drives,)."""
        return self.vector[: MEMORY * self._n]

    @property
    def variances(self) -> Expression:
        """Variances of the drives' positions, (n_drives,)."""
        return self.vector[(MEMORY + 1) * self._n :]


def remembered_position(drive: int, name: str) -> int:
    """Return the index of a drive's value, named as in `REMEMBERED`, in the vector of all that is
    remembered.
    """
    return MEMORY * drive + REMEMBERED.index(name)


def tracking(states: StateVector) -> ca.Function:
    """Return the function (mean, memory, x, p) → tracks of all drives; see `Tracks`. A drive that
    nothing measures has zeros.
    """
    context = states.context
    n = context.n_drives
    p = ca.MX.sym("p", context.mechanism.parameters.symbols.numel())
    mean = ca.MX.sym("mean", len(states))
    memory = ca.MX.sym("memory", MEMORY * n)
    x = ca.MX.sym("x", context.width)
    readings = ca.horzsplit(_readings(states)(mean, memory, x, p))
    drives = [ca.MX.zeros(len(TRACKED))] * n
    for i in range(n):
        if context.position_sensor(i) is not None:
            judged = _judged(context, i)
            track = track_function(context.robustness, judged)
            drives[i] = track(memory[MEMORY * i : MEMORY * (i + 1)], readings[i], x[0])
    bends, variances = ([drive[k] for drive in drives] for k in (MEMORY, MEMORY + 1))
    vector = ca.vertcat(*(drive[:MEMORY] for drive in drives), *bends, *variances)
    return ca.Function("track", [mean, memory, x, p], [vector])


READING = Layout(
    reading=1,
    mask=1,
    noise=1,
    dead=1,
    wandering=1,
    usual=1,
    missing=1,
    force_mask=1,
    stiffness=1,
    shown=1,
    taut=1,
    variance=1,
    effort=1,
)
"""Layout of what is read of each drive: its position [m, rad], the mask of that, the variance of
the sensor's random error; the time without a reading after which the sensor may not come back [s],
the growth of the std of the position after that time [m/s, rad/s], and its mean square speed in the
logs that taught the rig, 0 where none did. Of its force: measured minus
expected at the position that the mean speed leads to, U − F, its mask, the stiffness ∂F/∂s with the
joints held, the share of it that a jump shows (`FilterContext.jumps`), the pull F of a drive with
one tendon, which can go slack, else 0; the variance of U − F where there was no jump (noise,
friction, uncertainty of the pull), and U. Source:
definition (layout of a vector).
"""


def _judged(context: FilterContext, drive: int) -> bool:
    """Return whether a drive's force can tell a real jump of its position from a wild reading."""
    return context.force_sensor(drive) is not None and context.robustness.guards_displacements


def _readings(states: StateVector) -> ca.Function:
    """Return the function (mean, memory, x, p) → the readings of each drive and of its force, one
    column per drive; see `READING`.
    """
    context = states.context
    n = context.n_drives
    p = context.mechanism.parameters.symbols
    nj = context.n_joints
    mean = ca.SX.sym("mean", len(states))
    memory = ca.SX.sym("memory", MEMORY * n)
    x = ca.SX.sym("x", context.width)
    led = [
        memory[remembered_position(i, "position")] + memory[remembered_position(i, "speed")] * x[0]
        for i in range(n)
    ]
    q = states.coordinates(mean, led)
    v = ca.SX.zeros(context.mechanism.n_bodies)
    _, pulls, _, limits, *_ = mechanics_function(context)(q, v, states.parameters(mean))
    table = ca.SX(READING.size, n)
    for i in range(n):
        sensor = context.position_sensor(i)
        force = context.force_sensor(i)
        if sensor is None:
            continue
        reading = context.value(x, sensor)
        if (
            sensor.lag > 0.0
        ):  # a command, held over the interval, that a servo of first order follows
            position = memory[remembered_position(i, "position")]
            lag = context.number(f"{context.path(sensor)}.lag")
            reading = position + (reading - position) * (1 - ca.exp(-x[0] / lag))
        rate = context.number(f"{context.path(sensor)}.rate")
        dead = ca.fmax(context.robustness.dead_time, DEAD_INTERVALS / rate)
        wandering = UNKNOWN_POSITION[context.mechanism.rig.drives[i].kind] / WANDERING
        usual = context.number(f"{context.path(sensor)}.usual_square")
        table[:6, i] = ca.vertcat(
            reading, context.mask(x, sensor), context.noise(sensor), dead, wandering, usual
        )
        if force is not None and _judged(context, i):
            friction = limits[nj + i] + states.added(("friction", i), mean)
            effort = context.value(x, force)
            error = states.added(("reading", force.name), mean, effort)
            pull = pulls[nj + i] - states.added(("lacking force", i), mean) + error
            spread = context.noise(force) + friction**2 + (PULL_STD * pull) ** 2
            if states.transmitted(i) is not None:  # the play takes up as much as its limit
                spread += context.number(f"drives.{i}.play_limit") ** 2
            stiffness, shown = (
                context.number(f"drives.{i}.{name}") for name in ("held_stiffness", "shown_share")
            )
            alone = len(context.mechanism.rig.tendons_of(context.mechanism.rig.drive_names[i])) == 1
            table[6:, i] = ca.vertcat(
                effort - pull,
                context.mask(x, force),
                stiffness,
                shown,
                pull if alone else 0,
                spread,
                effort,
            )
    return ca.Function("readings", [mean, memory, x, p], [ca.cse(ca.densify(table))])


def track_function(robustness: Robustness, judged: bool) -> ca.Function:
    """Return the function (memory, `READING`, dt) → what is known of a drive after a reading,
    `TRACKED`; a missing reading is bridged by the mean speed, which fades.

    A reading that is far from the position expected by the mean speed is a real jump with a chance
    Π, else wild. The drive's force gives the chance where it is read, and the longer readings stay
    far away, the likelier the jump is real. The position is the mean of both possibilities, with
    their variance.

    Args:
        robustness: the guards.
        judged: whether the drive's force can tell a real jump from a wild reading.
    """
    memory = ca.SX.sym("memory", MEMORY)
    readings = ca.SX.sym("readings", READING.size)
    dt = ca.SX.sym("dt")
    position, doubt, speed, square, unknown, lost, shift, shift_std, effort, repeats = ca.vertsplit(
        memory
    )
    reading, mask, noise, dead, wandering, usual, *force = ca.vertsplit(readings)
    recent = ca.fmax(square, usual)
    missing, force_mask, stiffness, shown, taut, variance, force_now = force
    expected = position + speed * dt
    time = lost + dt
    bridged = is_bridge(mask)
    read = is_read(mask)
    shift = kept_shift(robustness, shift, reading - expected, doubt > 0, read)
    shift_std = ca.if_else(shift == 0, 0, shift_std * ca.exp(-dt / SETTLED_TIME))
    reading -= shift
    jump = reading - expected
    # (1) far: more than the recent motion can have led to
    lost_before = ca.if_else(doubt > 0, 0, unknown)
    far = ca.logic_and(is_far(robustness, jump, recent * time * time + lost_before, noise), read)
    judges: Scalar = ca.SX(0)
    evidence: Scalar = ca.SX(0)
    # a tendon alone does not push
    pull = ca.if_else(taut > 0, ca.fmax(stiffness * jump, -taut), stiffness * jump)
    pull = ca.if_else(taut < 0, ca.fmin(pull, -taut), pull)
    if judged:
        judges = is_read(force_mask)
        evidence = jump_evidence(missing, pull, variance, shown)
    # (2) the chance that a jump is real: between slow samples it may have been there since the mean
    # speed faded
    stayed = doubt + ca.fmax(dt - MOTION_TIME, 0)
    real = ca.if_else(far, chance_of_jump(robustness, stayed, evidence, judges), 1)
    # (2b) or the zero of its sensor has jumped, and the drive goes on as it did
    if robustness.zeros_jump and judged:
        # not after a gap, or old readings, while the drives may have gone anywhere together
        seen_last = ca.logic_and(lost <= 0, repeats < OLD)
        first = ca.logic_and(ca.logic_and(far, judges), ca.logic_and(seen_last, real < 0.5))
        jumped = ca.logic_and(first, zero_jumped(force_now - effort, pull, variance))
        shift += ca.if_else(jumped, jump, 0)
        shift_std = ca.if_else(jumped, (1 - shown) * ca.fabs(jump) / 2, shift_std)
        real = ca.if_else(jumped, 0, real)
    # a gap is crossed in a straight line to the reading that ends it
    line = position + (reading - position) / rows_left(mask)
    reached = ca.if_else(bridged, line, ca.if_else(read, expected + real * jump, expected))
    moved = reached - position
    # (3) mean motion; what was not seen while the reading was missing belongs to all of that time
    elapsed = ca.if_else(bridged, dt, time)
    passed = ca.if_else(elapsed > 0, elapsed, 1)
    seen = ca.if_else(bridged, moved / ca.if_else(dt > 0, dt, 1), speed + jump / passed)
    believed = ca.if_else(is_there(mask), real, 0)
    share = believed * (1 - ca.exp(-elapsed / MOTION_TIME))
    fade = ca.exp(-dt / (2 * MOTION_TIME))
    # (4) a drive that is lost goes on as it did: its error grows with time, not with the root of
    # time
    astray = ca.fmax(unknown, recent * time * time + noise)
    # whatever it did before, it may have begun to move
    astray = ca.fmax(astray, (wandering * ca.fmax(time - dead, 0)) ** 2)
    doubted = (1 - real) * real * jump**2
    unknown = ca.if_else(
        bridged, moved * moved, ca.if_else(read, ca.if_else(far, doubted, 0), astray)
    )
    # (5), (6) what a straight line between samples misses
    sure = believed > 0.5
    bend = ca.if_else(sure, moved - speed * dt, 0)
    drive = Drive(
        position=reached,
        doubt=ca.if_else(far, doubt + dt, 0),
        speed=speed * (fade + (1 - fade) * believed) + share * (seen - speed),
        square=square + share * (seen * seen - square),
        unknown=unknown,
        lost=ca.if_else(sure, 0, time),
        shift=shift,
        shift_std=shift_std,
        effort=ca.if_else(judges, force_now, effort),
        repeats=ca.if_else(
            ca.logic_or(
                ca.logic_and(judges, force_now == effort),
                ca.logic_and(read, (reading - position) ** 2 < SAME * noise),
            ),
            repeats + 1,
            0,
        ),
        bend=bend,
        variance=noise + unknown + (robustness.bend_share * bend) ** 2,
    )
    parts = ca.vertcat(*vars(drive).values())
    return ca.Function("drive", [memory, readings, dt], [ca.cse(ca.densify(parts))])


JUDGED = Layout(noise=1, dead=1, wandering=1, usual=1)
"""Layout of what a position is judged by where no force judges it: the variance of its noise, the
time without a value after which it may not come back [s], the growth of its std after that, and its
usual mean square speed. Source: definition (layout of a vector).
"""


def judged_by(rig: Rig, sensor: Sensor) -> Floats:
    """Return what a position is judged by where no force judges it, in the order of `JUDGED`."""
    wandering = UNKNOWN_POSITION[rig.drive(sensor.of).kind] / WANDERING
    return np.array([variance(sensor), dead_after(sensor), wandering, usual_square(rig, sensor)])


def begun_alone(rig: Rig, sensor: Sensor, reading: Expression, is_there: Expression) -> Expression:
    """Return what is remembered of a position at its first sample."""
    unknown = UNKNOWN_POSITION[rig.drive(sensor.of).kind] ** 2
    start = {"position": reading, "unknown": ca.if_else(is_there, 0.0, unknown)}
    memory: Expression = ca.vertcat(*(start.get(name, 0) for name in REMEMBERED))
    return memory


def believed_alone(
    memory: VectorNode, dt: ScalarNode, reading: ScalarNode, mask: ScalarNode, judged: VectorNode
) -> tuple[ScalarNode, ScalarNode, VectorNode]:
    """Return a position as it is believed where no force judges it, whether it is, and what is
    remembered; see `track_function`.
    """
    came = {"reading": reading, "mask": mask, **JUDGED.parts(judged)}
    track = track_function(Robustness(), False)
    drive = track(memory, ca.vertcat(*(came.get(name, 0) for name in READING.names)), dt)
    return (
        drive[REMEMBERED.index("position")],
        drive[REMEMBERED.index("lost")] <= 0,
        drive[:MEMORY],
    )
