"""Guards against outliers of positions and forces, jumps, lost positions, and zeros that jump
because a tendon slips on its spool or an encoder loses counts. Equations (1), (2), (2b), (12),
(16), (23); values in `tuning`.
"""

from __future__ import annotations

from math import isfinite, log

import casadi as ca

from distal.estimators.adaptive.tuning import Robustness
from distal.expressions import Scalar

STILL_LOST = 3
"""Power in (12) with which a lost position moves its joint [1], so that one missing sample does no
harm. Source: judgement.
"""


def is_far(robustness: Robustness, away: Scalar, motion: Scalar, noise: Scalar) -> Scalar:
    """Return 1 where a displacement is farther from the expected one than the recent motion can
    explain: (1).

    Args:
        away: distance from the displacement expected by the mean speed [m, rad].
        motion: mean square of the recent motion, and what is unknown of the position [m², rad²].
        noise: variance of the sensor's random error.
    """
    if not robustness.guards_displacements:
        return ca.SX(0)
    return away**2 > robustness.wild_displacement**2 * (motion + 2 * noise)


MOST_EVIDENCE = 50.0
"""Largest logarithm of odds [1]: e⁵⁰ is certain. Source: rounding (overflow of the exponential
function).
"""


def jump_evidence(change: Scalar, expected: Scalar, variance: Scalar, least: float = 0.5) -> Scalar:
    """Return the logarithm of the likelihood ratio of a real jump to a wild reading, from the
    change of the drive's force: (2).

    A light slider rings after a jump: it may be seen anywhere from half to twice as far as its
    force says. A joint that follows within one interval leaves no change of force; then `least` is
    0, and it may be seen from nowhere to twice as far.

    Args:
        change: of the force since the last position that was believed [N, N m].
        expected: change that the jump would make, ∂F/∂s times the jump.
        variance: of the difference of `change` and `expected`.
        least: smallest share of the expected change that a real jump may show.
    """
    ratio = change * expected / ca.fmax(expected * expected, 1e-300)
    explained = ca.fmin(ca.fmax(ratio, least), 2) * expected
    return ca.fmin(
        ca.fmax((change - explained / 2) * explained / variance, -MOST_EVIDENCE), MOST_EVIDENCE
    )


def chance_of_jump(
    robustness: Robustness, doubt: Scalar, evidence: Scalar, judged: Scalar
) -> Scalar:
    """Return the chance that a far reading is a real jump, after readings have been far for `doubt`
    s: (2).

    The `evidence` is that of the force, see `jump_evidence`; `judged` is 1 where there is a force,
    else 0.
    """
    time = ca.if_else(judged, robustness.persistence, robustness.persistence_alone)
    odds = ca.fmin(
        log(robustness.real_jump / (1 - robustness.real_jump)) + log(100.0) * doubt / time,
        MOST_EVIDENCE,
    )
    return 1 / (1 + ca.exp(-(odds + ca.if_else(judged, evidence, 0))))


def followed_share(robustness: Robustness, lost: Scalar) -> Scalar:
    """Return the share, 0 to 1, of a drive's motion that its joint has followed, after the position
    was `lost` for a time [s]: (12).
    """
    return (lost / (lost + robustness.follow_time)) ** STILL_LOST


def extra_variance(robustness: Robustness, lost: Scalar, unknown: Scalar) -> Scalar:
    """Return the variance to add to a position that has been lost for long, so that its force does
    not correct the joint: (16).

    The joint went where the drive went: both positions have the same error, which cancels in the
    tension. The filter takes these errors as independent and would otherwise divide the residual
    between them. The position has been `lost` for so long [s], and has the variance `unknown` [m²,
    rad²].
    """
    return robustness.followed_variance * followed_share(robustness, lost) * unknown


def robust_variance(robustness: Robustness, variance: Scalar, innovation: Scalar) -> Scalar:
    """Return the `variance` S' = S max(1, ν²/(c S)), c = `wild_force`, by which a wild `innovation`
    ν counts less, (23).
    """
    if not isfinite(robustness.wild_force):
        return variance
    return variance * ca.fmax(1, innovation**2 / (robustness.wild_force * variance))


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


def zero_jumped(change: Scalar, pull: Scalar, variance: Scalar) -> Scalar:
    """Return 1 where a jump of a reading is one of its sensor's zero, since the drive's force does
    not show it, else 0: (2b).

    Args:
        change: of the force since its last reading [N, N m].
        pull: by which a jump of the drive would change it.
        variance: of the force where there was no jump.
    """
    return ca.logic_and(change * pull < SHOWS * pull**2, pull**2 > LONGEST_SLIP**2 * variance)


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
