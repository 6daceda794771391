"""Guards: outliers of positions and forces, jumps, lost positions. Equations (1), (2), (12), (16),
(23); numbers in `tuning`.
"""

from __future__ import annotations

from math import isfinite, log

import casadi as ca

from distal.estimators.adaptive.tuning import Robustness
from distal.expressions import Scalar

STILL_LOST = 3
"""Power with which a lost position comes to move its joint: one missing sample does no harm."""


def is_far(robustness: Robustness, away: Scalar, motion: Scalar, noise: Scalar) -> Scalar:
    """Return 1 where a displacement is farther from where it should be than the recent motion can
    have led: (1).

    It is `away` [m, rad] from where the mean speed leads; `motion` is the mean square of the recent
    motion and what is unknown of the position [m², rad²], `noise` the variance of the sensor's
    random error.
    """
    if not robustness.guards_displacements:
        return ca.SX(0)
    return away**2 > robustness.wild_displacement**2 * (motion + 2 * noise)


MOST_EVIDENCE = 50.0
"""Logarithm of odds beyond which nothing becomes likelier: e⁵⁰ is certain."""


def jump_evidence(change: Scalar, expected: Scalar, variance: Scalar, least: float = 0.5) -> Scalar:
    """Return the logarithm of the likelihood ratio of a real jump to a wild reading, from the
    change of its force: (2).

    A light slider rings after a jump: it may be seen anywhere from half to twice as far as its
    force says. A joint that follows within one interval leaves no force behind: then from none of
    it to twice as far.

    Args:
        change: of the force since the last position that was believed [N, N m].
        expected: change that the jump would make, ∂F/∂s times it.
        variance: of the difference of both.
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
    """Return the chance that a reading that is far away is a real jump, after it has been there for
    `doubt` s: (2).

    The `evidence` is of the force, see `jump_evidence`; `judged` is 1 where there is any.
    """
    time = ca.if_else(judged, robustness.persistence, robustness.persistence_alone)
    odds = ca.fmin(
        log(robustness.real_jump / (1 - robustness.real_jump)) + log(100.0) * doubt / time,
        MOST_EVIDENCE,
    )
    return 1 / (1 + ca.exp(-(odds + ca.if_else(judged, evidence, 0))))


def followed_share(robustness: Robustness, lost: Scalar) -> Scalar:
    """Return how far a joint has followed a drive whose position is lost for a time [s], from 0 to
    1: (12).
    """
    return (lost / (lost + robustness.follow_time)) ** STILL_LOST


def extra_variance(robustness: Robustness, lost: Scalar, unknown: Scalar) -> Scalar:
    """Return the variance to add to a position that is long lost, so that its force does not speak
    of the joint: (16).

    The joint went where the drive went: its error and the position's are one, and cancel in the
    tension. The filter, to which they are independent, would otherwise share the residual between
    them. The position is `lost` for so long [s], with the variance `unknown` [m², rad²].
    """
    return robustness.followed_variance * followed_share(robustness, lost) * unknown


def robust_variance(robustness: Robustness, variance: Scalar, innovation: Scalar) -> Scalar:
    """Return the `variance` S' = S max(1, ν²/(c S)), c = `wild_force`: a wild `innovation` ν counts
    less, (23).
    """
    if not isfinite(robustness.wild_force):
        return variance
    return variance * ca.fmax(1, innovation**2 / (robustness.wild_force * variance))
