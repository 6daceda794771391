"""The zero of a position sensor that jumps: a tendon slips on its spool, an encoder loses counts.
Equation (2b).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.tuning import Robustness
from distal.expressions import Scalar

SHOWS = 0.25
"""A drive that jumps changes its force by at least this share of what it would if its joint stood
still [1].
"""

LONGEST_SLIP = 3.0
"""A drive that sticks and slips jumps by less than so many stds of its force, friction included,
over its stiffness [1].
"""

SOONEST_STOP = 0.01
"""No drive starts, moves far and stops within so short an interval [s]."""

SETTLED_TIME = 1.2
"""Time constant with which it is settled that a zero jumped [s]: had the drive moved, its force
would stay unexplained.
"""

GOES_ON = 0.25
"""A drive that goes on after a step does so by at least this share of it from one sample to the
next [1].
"""


@dataclass(frozen=True)
class ForceEvidence:
    """What the force of a drive says of a jump of its position, all scalars.

    Args:
        missing: what is read less what is expected where the mean speed leads, U − F [N, N m].
        mask: of the force, see `distal.kernels.mask`.
        stiffness: change of the drive's pull with its position, ∂F/∂s.
        variance: of how far both may differ where there was no jump: noise, friction, and what is
            not known of the pull.
        effort: what is read, U.
        least: smallest share of the change of the pull that a real jump may show.
    """

    missing: Scalar
    mask: Scalar
    stiffness: Scalar
    variance: Scalar
    effort: Scalar
    least: float = 0.5


def zero_jumped(force: ForceEvidence, jump: Scalar, effort: Scalar, time: Scalar) -> Scalar:
    """Return 1 where a `jump` of a reading is one of its sensor's zero, since the drive's force
    does not show it: (2b).

    The force read `effort` before, and `time` is since the last good reading [s]. A joint that
    follows within an interval leaves no force behind: then only an interval in which no drive
    starts and stops can tell.
    """
    pull = force.stiffness * jump
    silent = ca.logic_and(
        (force.effort - effort) * pull < SHOWS * pull**2, pull**2 > LONGEST_SLIP**2 * force.variance
    )
    return silent if force.least > 0.0 else ca.logic_and(silent, time <= SOONEST_STOP)


def kept_shift(
    robustness: Robustness, shift: Scalar, raw: Scalar, doubted: Scalar, read: Scalar
) -> Scalar:
    """Return by which a sensor's zero is still displaced at a reading that is `raw` from where its
    drive should be: (2b).

    It came back where the reading without the shift is nearer. It was a motion and no jump where a
    second reading, after one that is `doubted`, goes on in the same direction. Nothing changes
    where nothing is `read`.
    """
    if not robustness.zeros_jump:
        return shift
    shifted = raw - shift
    back = ca.fabs(raw) < ca.fabs(shifted) / 2
    moves_on = ca.logic_and(doubted, shifted * shift > GOES_ON * shift**2)
    return ca.if_else(ca.logic_and(read, ca.logic_or(back, moves_on)), 0, shift)
