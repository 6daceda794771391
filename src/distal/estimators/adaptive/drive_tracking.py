"""Track the drives: the position and motion of each, from readings that may be missing or wild.
Equations (1) to (6). `Drive` says what is remembered of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from typing import NamedTuple

import casadi as ca

from distal.estimators.adaptive.filter_inputs import JUDGED, mechanics_function
from distal.estimators.adaptive.guard_settings import (
    GOES_ON,
    SETTLED,
    SHIFTED,
    SHIFTED_FELT,
    Robustness,
    chance_of_jump,
    jump_evidence,
)
from distal.estimators.adaptive.states import StateVector
from distal.expressions import Expression, Scalar, ScalarNode, VectorNode, dense_function, symbols
from distal.kernels.layout import Layout, is_bridge, is_read, is_there, rows_left
from distal.regression import MOST_EVIDENCE, JudgedJumps, added, evidence_of_jumps

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

NEAR = 4.0
"""Square of a position's distance from its mean in the logs, in stds, within which it is as likely
as any [1]. Source: definition (95 % of normal values).
"""

SMALLEST_SCALE = 1e-300
"""Least std of a position in the logs [m, rad]. Source: rounding (division by zero)."""

SAME = 1e-12
"""Square of a difference, in variances of the noise, below which readings are the same [1]. Source:
rounding.
"""


class Drive(NamedTuple):
    """What is known of a drive after a reading, all scalars.

    Args:
        position: that its sensor reads or should read, at the end of the interval [m, rad].
        doubt: time since the last jump that is not known to be real [s].
        speed: mean speed, over `MOTION_TIME`.
        square: mean square speed.
        unknown: variance of the position beyond the sensor's noise; it grows while readings are
            missing.
        lost: time since the last good reading [s].
        shift: by which the reading is off if its last jump was none of the drive [m, rad].
        real: chance that the drive moved nevertheless, 1 where there is no shift [1].
        evidence: logarithm of the likelihood ratio of that, by forces and by where logs were [1].
        effort: last reading of the drive's force sensor [N, N m].
        repeats: number of samples in a row in which its sensors read exactly the same [1].
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
    real: Scalar
    evidence: Scalar
    effort: Scalar
    repeats: Scalar
    bend: Scalar
    variance: Scalar


TRACKED = Drive._fields
"""Names of the values that are known of each drive after a reading."""

REMEMBERED = TRACKED[: TRACKED.index("bend")]
"""Names of those that are remembered."""

MEMORY = len(REMEMBERED)
"""Number of values that are remembered of each drive."""


def drive_of(tracks: Expression, drive: int) -> Drive:
    """Return what is known of one drive, from the `TRACKED` values of all, a column for each."""
    return Drive(*ca.vertsplit(tracks[:, drive]))


def positions_of(tracks: Expression) -> list[Expression]:
    """Return the position of each drive, from the `TRACKED` values of all, a column for each."""
    return list(ca.horzsplit(tracks[TRACKED.index("position"), :]))


def remembered(memory: Expression, drive: int, name: str) -> Expression:
    """Return a drive's value, named as in `REMEMBERED`, from those of all, a column for each."""
    return memory[REMEMBERED.index(name), drive]


def tracking(states: StateVector) -> ca.Function:
    """Return the function (mean, memory, x, p) → `TRACKED` values of all drives, a column for each.
    A drive that nothing measures has zeros.
    """
    context = states.context
    n = context.n_drives
    parameters = len(context.mechanism.parameters)
    inputs = symbols(ca.MX, mean=len(states), memory=(MEMORY, n), x=context.width, p=parameters)
    _, memory, x, _ = inputs
    readings = _readings(states)(*inputs)
    drives = [ca.MX.zeros(len(TRACKED))] * n
    for i in range(n):
        if context.position_sensor(i) is not None:
            track = track_function(context.robustness, context.force_sensor(i) is not None)
            drives[i] = track(memory[:, i], readings[:, i], x[0], faded(x[0]))
    return ca.Function("track", inputs, [ca.horzcat(*drives)])


READING = Layout(
    reading=1,
    mask=1,
    **dict.fromkeys(JUDGED.names, 1),
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
the growth of the std of the position after that time [m/s, rad/s], and its `usual_motion` in the
logs that taught the rig. Of its force: measured minus
expected at the position that the mean speed leads to, U − F, its mask, the stiffness ∂F/∂s with the
joints held, the share of it that a jump shows (`FilterContext.jumps`), the pull F of a drive with
one tendon, which can go slack, else 0; the variance of U − F where there was no jump (noise,
friction, uncertainty of the pull), and U. Source:
definition (layout of a vector).
"""


def _readings(states: StateVector) -> ca.Function:
    """Return the function (mean, memory, x, p) → the readings of each drive and of its force, one
    column per drive; see `READING`.
    """
    context = states.context
    n = context.n_drives
    nj = context.n_joints
    inputs = symbols(ca.SX, mean=len(states), memory=(MEMORY, n), x=context.width)
    mean, memory, x = inputs
    led = [
        remembered(memory, i, "position") + remembered(memory, i, "speed") * x[0] for i in range(n)
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
            position = remembered(memory, i, "position")
            lag = context.number(f"{context.path(sensor)}.lag")
            reading = position + (reading - position) * (1 - ca.exp(-x[0] / lag))
        judged = (context.number(f"{context.path(sensor)}.{name}") for name in JUDGED.names[1:])
        of_position = [reading, context.mask(x, sensor), context.noise(sensor), *judged]
        table[: len(of_position), i] = ca.vertcat(*of_position)
        if force is not None:
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
            alone = len(context.mechanism.pulled_by(nj + i)) == 1
            table[len(of_position) :, i] = ca.vertcat(
                effort - pull,
                context.mask(x, force),
                stiffness,
                shown,
                pull if alone else 0,
                spread,
                effort,
            )
    arguments = [*inputs, context.mechanism.parameters.symbols]
    return dense_function("readings", arguments, [table])


def _unlikely(position: Scalar, centre: Scalar, scale: Scalar) -> Scalar:
    """Return by how much a position is less likely than those where logs were, (z² − 4)⁺/2; 0 where
    there are none.
    """
    square = ((position - centre) / ca.fmax(scale, SMALLEST_SCALE)) ** 2
    return ca.if_else(scale > 0, ca.fmax(square - NEAR, 0) / 2, 0)


def faded(dt: Expression) -> Expression:
    """Return the share of a drive's mean speed that is left after an interval dt, e^{−dt/(2 T_m)};
    once for all drives, since exponential functions are slow on a microcontroller.
    """
    share: Expression = ca.exp(-dt / (2 * MOTION_TIME))
    return share


def _evidence_of_force(
    judged: bool,
    jump: Scalar,
    repeats: Scalar,
    missing: Scalar,
    mask: Scalar,
    stiffness: Scalar,
    shown: Scalar,
    taut: Scalar,
    variance: Scalar,
    _: Scalar,
) -> tuple[Scalar, Scalar]:
    """Return whether a drive's force can judge a jump of its position, and the logarithm of the
    likelihood ratio of a real one by that force.

    Args:
        judged: see `track_function`.
        jump: of the position [m, rad].
        repeats: as in `Drive`; the other arguments are those of the force in `READING`.
    """
    if not judged:
        return ca.SX(0), ca.SX(0)
    judges = is_read(mask)
    # a tendon alone does not push
    pull = ca.if_else(taut > 0, ca.fmax(stiffness * jump, -taut), stiffness * jump)
    pull = ca.if_else(taut < 0, ca.fmin(pull, -taut), pull)
    ratio = ca.if_else(judges, jump_evidence(missing, pull, variance, shown), 0)
    # after old readings all drives may have gone anywhere together
    is_after_old = judges * (repeats >= OLD)
    return judges, ca.if_else(is_after_old, log(SHIFTED_FELT / SHIFTED), ratio)


def track_function(robustness: Robustness, judged: bool) -> ca.Function:
    """Return the function (memory, `READING`, dt, `faded`) → what is known of a drive after a
    reading, `TRACKED`; a missing reading is bridged by the mean speed, which fades.

    A reading that is far from the position expected by the mean speed is right with a chance p, or
    off by a shift s: a wild reading, which comes back, or a zero that jumped, which does not. From
    then on the drive is in one of two positions, which differ by s; the position is their mean, and
    its variance p (1 − p) s². Forces say which, here or where they are compared with those of free
    motion.

    Args:
        robustness: the guards.
        judged: whether the drive's force can tell a real jump from a wild reading.
    """
    inputs = symbols(ca.SX, memory=MEMORY, readings=READING.size, dt=1, fade=1)
    memory, readings, dt, fade = inputs
    position, doubt, speed, square, unknown, lost, shift, was_real, evidence, effort, repeats = (
        ca.vertsplit(memory)
    )
    reading, mask, noise, dead, wandering, usual, centre, scale, felt, *force = ca.vertsplit(
        readings
    )
    recent = ca.fmax(square, usual)
    # where the drive is if its last jump was none
    off = position - was_real * shift
    expected = off + speed * dt
    time = lost + dt
    bridged = is_bridge(mask)
    read = is_read(mask)
    # (2b) the reading came back, since its last jump was wild, or it goes on, a motion that began
    raw = reading - expected
    comes_back = ca.fabs(raw) < ca.fabs(raw - shift)
    goes_on = (doubt < dt) * ((raw - shift) * shift > GOES_ON * shift**2)
    shift = ca.if_else(read * ca.logic_or(comes_back, goes_on), 0, shift)
    jump = raw - shift
    # (1) far: more than the recent motion can have led to
    explained = recent * time * time + ca.if_else(shift != 0, 0, unknown)
    farthest = robustness.wild_displacement**2 * (explained + 2 * noise)
    far = read * ca.logic_not(goes_on) * (jump**2 > farthest)
    # (2) the chance that the jump is real: by where the logs were, and by the drive's force
    judges, ratio = _evidence_of_force(judged, jump, repeats, *force)
    # the evidence on a reading that stood still since its jump is none on the next one
    stood = ca.fmax(doubt, robustness.persistence_alone)
    is_next = read * (lost >= stood) * ((jump + speed * dt) ** 2 >= SAME * noise)
    evidence = ca.if_else(far, ratio, ca.if_else(is_next, 0, evidence))
    # between slow samples it may have been there since the mean speed faded
    doubt = ca.if_else(far, ca.fmax(dt - MOTION_TIME, 0), ca.if_else(shift == 0, 0, doubt + dt))
    # or the zero of its sensor has jumped, and the drive goes on as it did
    shift = ca.if_else(far, shift + jump, shift)
    logged = ca.fmin(_unlikely(reading - shift, centre, scale), MOST_EVIDENCE)
    logged -= _unlikely(reading, centre, scale)
    real = chance_of_jump(robustness, doubt, added(evidence, logged), judges, felt)
    is_settled = ca.logic_or(shift == 0, real > SETTLED)
    shift = ca.if_else(is_settled, 0, shift)
    real = ca.if_else(is_settled, 1, real)
    # a gap is crossed in a straight line to the reading that ends it
    line = off + (reading - off) / rows_left(mask)
    reached = ca.if_else(bridged, line, ca.if_else(read, reading - shift, expected))
    moved = reached - off
    # (3) mean motion; what was not seen while the reading was missing belongs to all of that time
    elapsed = ca.if_else(bridged, dt, time)
    seen = speed + (reached - expected) / ca.if_else(elapsed > 0, elapsed, 1)
    seen = ca.if_else(bridged, moved / ca.if_else(dt > 0, dt, 1), seen)
    believed = ca.if_else(is_there(mask), ca.if_else(far, real, 1), 0)
    share = believed * (1 - ca.exp(-elapsed / MOTION_TIME))
    # (4) a drive that is lost: by the motion that it had, whose error grows with time, not with the
    # root of time; or, once the sensor is dead, because it may have begun to move whatever it did
    led = ca.fmax(unknown, recent * time * time + noise)
    astray = ca.fmax(led, (wandering * ca.fmax(time - dead, 0)) ** 2)
    either = either_variance(real, shift)
    same = ca.logic_and(read, moved**2 < SAME * noise)
    is_old = ca.logic_and(same, ca.logic_or(1 - judges, force[-1] == effort))
    # a reading that is off and does not change tells nothing of the drive
    tells = ca.logic_and(is_there(mask), ca.logic_not(ca.logic_and(shift != 0, same)))
    unknown = ca.if_else(bridged, moved * moved, ca.if_else(tells, either, ca.fmax(astray, either)))
    # it is somewhere where the logs were
    unknown = ca.if_else(read * (scale > 0), ca.fmin(unknown, 2 * scale**2), unknown)
    # (5), (6) what a straight line between samples misses
    sure = believed > 0.5
    bend = ca.if_else(sure, moved - speed * dt, 0)
    drive = Drive(
        position=reached + real * shift,
        doubt=doubt,
        speed=speed * (fade + (1 - fade) * believed) + share * (seen - speed),
        square=square + share * (seen * seen - square),
        unknown=unknown,
        lost=ca.if_else(tells, 0, time),
        shift=shift,
        real=real,
        evidence=evidence,
        effort=ca.if_else(judges, force[-1], effort),
        repeats=ca.if_else(is_old, repeats + 1, 0),
        bend=bend,
        variance=noise + unknown + (robustness.bend_share * bend) ** 2,
    )
    return dense_function("drive", inputs, [ca.vertcat(*drive)])


def begun_alone(reading: Expression, is_there: Expression, unknown: float = 0.0) -> Expression:
    """Return what is remembered of a position at its first sample; it is `unknown` with that
    variance where it is not read.
    """
    start = {"position": reading, "real": 1.0, "unknown": ca.if_else(is_there, 0.0, unknown)}
    memory: Expression = ca.vertcat(*(start.get(name, 0) for name in REMEMBERED))
    return memory


@dataclass(frozen=True)
class BothReadings:
    """The readings of a sample, if the last jumps of positions were none of the drives, and if they
    were real.

    Args:
        off: if they were none, (n,).
        real: if they were real, (n,).
        doubts: variances beside that, (n,).
        masks: of the readings that count, (n,).
        chance: that the jumps were real.
        drives: what is remembered of all positions.
        judges: what is remembered of what forces say of jumps.
        lasting: whether the jump of each reading lasts, (n,).
    """

    off: VectorNode
    real: VectorNode
    doubts: VectorNode
    masks: VectorNode
    chance: ScalarNode
    drives: VectorNode
    judges: VectorNode
    lasting: VectorNode


def judged_alone(
    memory: VectorNode,
    dt: ScalarNode,
    readings: VectorNode,
    masks: VectorNode,
    positions: Sequence[tuple[int, VectorNode, Sequence[int]]],
    judges: Sequence[JudgedJumps],
    of_judges: VectorNode,
    parameters: VectorNode,
) -> BothReadings:
    """Return a sample's readings where no force judges a position but by maps; see
    `track_function`.

    Args:
        memory: what is remembered of the positions.
        dt: since the sample before [s].
        readings: of the channels, (n,).
        masks: of them, (n,).
        positions: of each its index, what it is judged by, `JUDGED`, and the indices of what its
            motor reads with it.
        judges: what forces say of jumps.
        of_judges: what these remember.
        parameters: of these.
    """
    off = ca.MX(readings)
    real = ca.MX(readings)
    masks = ca.MX(masks)
    doubts = ca.MX.zeros(readings.numel())
    lasting = ca.MX.zeros(readings.numel())
    chance = ca.MX(0)
    drives = []
    track = track_function(Robustness(), False)
    for remembered_of, (k, judged, message) in zip(ca.vertsplit(memory, MEMORY), positions):
        came = {"reading": readings[k], "mask": masks[k], **JUDGED.parts(judged)}
        given = ca.vertcat(*(came.get(name, 0) for name in READING.names))
        drive = track(remembered_of, given, dt, faded(dt))[:MEMORY]
        branch = branches(drive)
        off[k] = branch["off"]
        real[k] = branch["real"]
        doubts[k] = branch["variance"]
        lasting[k] = branch["lasts"]
        chance = ca.fmax(chance, branch["chance"])
        masks[list(message)] *= branch["believed"]
        drives.append(drive)
    ratios, judged = evidence_of_jumps(judges, of_judges, dt, off, real, masks, parameters)
    evidence, shift = (REMEMBERED.index(name) for name in ("evidence", "shift"))
    for drive, (k, *_) in zip(drives, positions):
        drive[evidence] = added(drive[evidence], ratios[k] * (drive[shift] != 0))
    together = ca.vertcat(ca.MX(0, 1), *drives)
    return BothReadings(off, real, doubts, masks, chance, together, judged, lasting)


def either_variance(real: Expression, shift: Expression) -> Expression:
    """Return the variance of a position that is off by a shift or not: p (1 − p) s²."""
    return (1 - real) * real * shift**2


def branches(memory: Expression) -> dict[str, Expression]:
    """Return a drive's position if its last jump was none and if it was real, the chance of that,
    the variance beside it, whether its reading counts, and whether the jump lasts, so that it is no
    wild reading; by its `REMEMBERED` values.
    """
    drive = dict(zip(REMEMBERED, (memory[k] for k in range(MEMORY))))
    shift = drive["shift"]
    real = drive["real"]
    return {
        "off": drive["position"] - real * shift,
        "real": drive["position"] + (1 - real) * shift,
        "chance": ca.if_else(shift == 0, 0, real),
        # of a position that is missing maps know by its age
        "variance": ca.if_else(
            shift != 0, ca.fmax(drive["unknown"] - either_variance(real, shift), 0), 0
        ),
        "believed": ca.logic_or(drive["lost"] <= 0, shift != 0),
        "lasts": ca.logic_and(shift != 0, drive["doubt"] >= Robustness().persistence_alone),
    }
