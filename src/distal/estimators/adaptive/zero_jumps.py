"""A position sensor whose zero jumps, because a tendon slips on its spool or an encoder loses
counts. Equation (2b).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.tuning import Robustness
from distal.expressions import Scalar

SHOWS = 0.25
"""Smallest change of its force by which a drive shows its jump, as a share of that with its joint
at rest [1]. Source: judgement.
"""

LONGEST_SLIP = 3.0
"""Longest jump of a drive that sticks and slips, in stds of its force, friction included, over its
stiffness [1]. Source: judgement.
"""

SOONEST_STOP = 0.01
"""Longest interval in which no drive starts, moves far and stops [s]. Source: judgement."""

SETTLED_TIME = 1.2
"""Time constant with which the doubt whether zero or drive jumped fades [s]: had the drive moved,
its force would stay unexplained. Source: judgement.
"""

GOES_ON = 0.25
"""Smallest step from one sample to the next of a drive that goes on after a jump, as a share of the
jump [1]. Source: judgement.
"""


@dataclass(frozen=True)
class ForceEvidence:
    """What the force of a drive says of a jump of its position, all scalars.

    Args:
        missing: measured minus expected at the position that the mean speed leads to, U − F [N, N
            m].
        mask: of the force, see `distal.kernels.mask`.
        stiffness: change of the drive's pull with its position, ∂F/∂s.
        variance: of U − F where there was no jump: noise, friction, and the uncertainty of the
            pull.
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
    does not show it, else 0: (2b).

    A joint that follows within an interval leaves no change of force (`force.least` is 0). Then the
    time must also be at most `SOONEST_STOP`, in which no drive moves far and stops.

    Args:
        force: evidence of the drive's force.
        jump: of the reading [m, rad].
        effort: last reading of the force before [N, N m].
        time: since the last good reading of the position [s].
    """
    pull = force.stiffness * jump
    silent = ca.logic_and(
        (force.effort - effort) * pull < SHOWS * pull**2, pull**2 > LONGEST_SLIP**2 * force.variance
    )
    return silent if force.least > 0.0 else ca.logic_and(silent, time <= SOONEST_STOP)


def kept_shift(
    robustness: Robustness, shift: Scalar, raw: Scalar, doubted: Scalar, read: Scalar
) -> Scalar:
    """Return the shift of a sensor's zero that remains at a new reading: (2b).

    The zero came back, and the shift is 0, where |`raw`| is below half of |`raw` − `shift`|. The
    jump was a motion of the drive, and the shift is 0, where the second reading goes on in the same
    direction. Without a reading the shift stays.

    Args:
        shift: so far [m, rad].
        raw: reading as it comes, less the expected position [m, rad].
        doubted: 1 where the reading before was far from its expected position.
        read: 1 where there is a reading.
    """
    if not robustness.zeros_jump:
        return shift
    shifted = raw - shift
    back = ca.fabs(raw) < ca.fabs(shifted) / 2
    moves_on = ca.logic_and(doubted, shifted * shift > GOES_ON * shift**2)
    return ca.if_else(ca.logic_and(read, ca.logic_or(back, moves_on)), 0, shift)
