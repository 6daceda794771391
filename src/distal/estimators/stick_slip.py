"""How a force is taken by how its drive moves: friction against its motion, or any up to its limit while it sticks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from distal.estimators.augmented import AugmentedState
from distal.estimators.channels import sensor_for
from distal.estimators.motion import MEMORY, MOTION_TIME

STICK_WEIGHT = 50.0
"""Samples over which friction of a drive that sticks is the same: how little one of them tells."""

TURN_WEIGHT = 10.0
"""The same while a drive turns back."""

MEAN_TIME = 0.1
"""Time constant of the mean residual of a force whose drive sticks [s]."""

STICK_STD = 0.42
"""Standard deviation of a tension within its friction's limits, as a share of the limit."""


@dataclass(frozen=True)
class TakenRow:
    """How a force is taken. With slopes h of the residual, l of the limit and e of the lean, the slope of what is expected
    is −h + β l + γ e.

    Args:
        innovation: measured minus expected.
        variance: of the innovation without the state's.
        memory: what is remembered of the drive: its mean residual where the rig declares friction, else its last clear
            direction times the samples since then.
        by_limit: β.
        by_lean: γ.
        counts: 1 where its innovation belongs to a likelihood: a guess at the friction of a drive that hardly moves does
            not, since its variance is part of the guess.
    """

    innovation: Any
    variance: Any
    memory: Any
    by_limit: Any = 0
    by_lean: Any = 0
    counts: Any = 1


def friction_row(
    augmented: AugmentedState,
    drive: int | None,
    motions: Any,
    residual: Any,
    limit: Any,
    lean: Any,
    own: Any,
    unsure: Any,
    known: Any,
    kept: Any,
    mask: Any,
    dt: Any,
    ideal: bool = False,
) -> TakenRow:
    """Return how a force is taken, by how its drive moves; all are numbers.

    Args:
        augmented: the layout of the state.
        drive: its index, None for a tension.
        motions: of all drives.
        residual: measured minus expected, without friction.
        limit: friction limit, the mean of both directions.
        lean: by how much it is larger against motion to +.
        own: variance of the sensor.
        unsure: variance of the limit by the state's, l P lᵀ.
        known: variance of the residual by the state's, h P hᵀ.
        kept: what is remembered of the drive's force.
        mask: 1 where the force counts.
        dt: length of the interval [s].
        ideal: leave out all that guards against a wrong model.
    """
    if drive is None or drive in augmented.places_at:
        return TakenRow(residual, own + limit**2, kept)
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
        since = kept + ca.sign(kept)
        held = ca.if_else(mask > 0, ca.if_else(clear, ca.sign(direction), since), kept)
        direction = ca.if_else(stuck < 0.15, direction, ca.sign(held))
    weight = 3 * TURN_WEIGHT if declared else TURN_WEIGHT
    # while it sticks its friction stays the same: a long stick tells little more than a short one
    sticking = STICK_WEIGHT if declared else ca.fmax(STICK_WEIGHT, held * held / STICK_WEIGHT)
    clear = ca.logic_and(stuck < 0.15, ca.fabs(direction) > 0.9)
    doubt = 0 if ideal else stuck * sticking + (1 - stuck) * (1 - direction**2) * weight
    counts: Any = 1
    if declared and not augmented.suspicious:
        # a fit goes by the drives that clearly move: there friction is what it is
        doubt, counts = ca.if_else(clear, 0, doubt), clear
    sliding = residual - direction * limit - ca.fabs(direction) * lean
    spread = own + doubt * (limit**2 + unsure)
    fade = ca.exp(-dt / MEAN_TIME)
    average = ca.if_else(mask > 0, fade * kept + (1 - fade) * residual, kept)
    if not declared:
        return TakenRow(sliding, spread, held, direction, ca.fabs(direction))
    sign = ca.sign(average)
    allowed = limit + sign * lean
    beyond = ca.fabs(average) > allowed
    # inside the limits nothing moves the mean, but the tension is no less certain than the limits themselves
    bound = (STICK_STD * limit) ** 2 + own + unsure
    within = 1 / ca.fmax(1 / bound - 1 / ca.fmax(known, 1e-12), 1e-9)
    sticks = stuck > 0.5
    return TakenRow(
        ca.if_else(sticks, ca.if_else(beyond, average - sign * allowed, 0), sliding),
        ca.if_else(sticks, ca.if_else(beyond, own, within), spread),
        average,
        ca.if_else(sticks, ca.if_else(beyond, sign, 0), direction),
        ca.if_else(sticks, ca.if_else(beyond, 1, 0), ca.fabs(direction)),
        counts,
    )
