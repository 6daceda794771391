"""Findings by the states of an estimate: friction that the rig does not declare, and states that
left their priors.
"""

from __future__ import annotations

import numpy as np

from distal.diagnosis import finding_texts as texts
from distal.diagnosis.finding import Finding
from distal.estimators import StateKind
from distal.results.estimate import Estimate
from distal.results.thresholds import LARGE_PRIOR

WALKS = 8.0
"""Change of a state over the second half of a log, in standard deviations that the filter allows,
above which the state does not settle [1].

On right rigs the 95th percentile is 3 to 6, since friction is not normal and a start is not linear;
on wrong rigs it is 10 to 30. Source: judgement.
"""

LARGEST_TRAVEL = float(np.deg2rad(270.0))
"""Range of an angle above which it is of no joint that tendons pull [rad]; fingers and wrists turn
by 180° at most. Source: judgement.
"""

BEGUN = 1.0
"""Least change of a state that does not settle, as a share of its prior std [1]. Source: judgement.
"""


def left_their_priors(estimate: Estimate) -> list[Finding]:
    """Return the states that end far outside their priors, or that do not settle; none where the
    estimate has no priors.
    """
    means = estimate.prior_means
    stds = estimate.prior_stds
    if means is None or stds is None or len(estimate) < 4:
        return []
    worst: dict[str, tuple[float, Finding]] = {}
    middle = len(estimate) // 2
    states = zip(estimate.state_names, estimate.state_kinds, estimate.state_parts)
    for i, (name, kind, part) in enumerate(states):
        if not stds[i] > 0.0:  # NaN: a state that is meant to move
            continue
        prior = means[i]
        end = estimate.means[-1, i]
        std = float(np.sqrt(estimate.variances[-1, i]))
        away = (end - prior) / stds[i]
        # what has been learned since the middle is how far it may have moved since
        learned = max(float(estimate.variances[middle, i]) - std * std, (0.01 * stds[i]) ** 2)
        change = end - estimate.means[middle, i]
        # the weights of a sensor's linearity are one thing
        subject = f"linearity_{part}" if kind is StateKind.LINEARITY else name
        if abs(end - prior) - std > LARGE_PRIOR * stds[i]:
            finding = texts.left_its_prior(subject, end, std, prior, float(stds[i]))
        elif abs(change) > WALKS * np.sqrt(learned) and abs(change) > BEGUN * stds[i]:
            finding = texts.does_not_settle(subject, change)
        else:
            continue
        if subject not in worst or abs(away) > worst[subject][0]:
            worst[subject] = (abs(away), finding)
    return [
        finding
        for _, finding in sorted(worst.values(), key=lambda size_and_finding: -size_and_finding[0])
    ]


def turning_too_far(estimate: Estimate) -> list[Finding]:
    """Return the joints whose angle covers more than `LARGEST_TRAVEL`."""
    covered = [
        (joint, float(np.ptp(angles)))
        for joint, angles in zip(estimate.joint_names, estimate.angles.T)
    ]
    return [texts.turns_too_far(joint, most) for joint, most in covered if most > LARGEST_TRAVEL]


def undeclared_friction(estimate: Estimate) -> list[Finding]:
    """Return the drives at which the filter found friction that the rig does not declare."""
    findings = []
    for i, (kind, drive) in enumerate(zip(estimate.state_kinds, estimate.state_parts)):
        friction = estimate.means[-1, i]
        std = np.sqrt(estimate.variances[-1, i])
        prior = np.sqrt(estimate.variances[0, i])
        if kind is StateKind.FRICTION and friction > 0.25 * prior and friction > 3.0 * std:
            findings.append(texts.friction_undeclared(drive, float(friction)))
    return findings
