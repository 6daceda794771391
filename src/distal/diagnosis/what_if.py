"""The filter begun elsewhere: a band that hangs on where it began, and what still contradicts if it
begins with what it learned.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from distal.arrays import Floats
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.changes_in_subsystems import each_apart
from distal.diagnosis.finding import Finding, Kind
from distal.diagnosis.of_estimate import diagnose_estimate
from distal.diagnosis.rerun import ModelChange, Outcome, Rerun
from distal.estimators import StateKind, state_units
from distal.results import Estimate

START_FORGOTTEN = 0.5
"""The first moments of a log, in which a start is forgotten, do not count [s]."""

HANGS = 1.1
"""Spread of the angle over starts drawn from the prior, in its standard deviations, that is too
much.

Of a filter that is right it is at most 1: the posterior covariance is what the prior leaves plus
what noise adds. On random rigs with more than 90 % inside it is mostly 0.3 to 1.1, on those with
less than half inside 1.2 to 6.
"""


WITHIN = 3.0
"""A number that a log teaches may be so many standard deviations from what the rig says."""


def overconfidence(rerun: Rerun) -> list[Finding]:
    """Return whether the angle hangs on where the filter began by more than its band says, and on
    which numbers.

    Each state that has a prior begins one of its standard deviations above, then below. By
    linearity the root of the sum of squares of what that moves the angle by is the spread of
    estimates over starts drawn from the prior, which is part of the posterior's standard deviation.
    A start that the log itself rejects counts by its likelihood, min(1, p/p_0).
    """
    moved = moved_by_starts(rerun)
    if not moved:
        return []
    total = np.sum(list(moved.values()), axis=0)
    worst = int(np.argmax(total))
    spread = float(np.sqrt(total[worst]))
    if spread <= HANGS:
        return []
    most = max(moved, key=lambda name: float(moved[name][worst]))
    return [texts.hangs_on_the_start(most, spread, is_angle=most in _angles(rerun))]


def moved_by_starts(rerun: Rerun) -> dict[str, Floats]:
    """Return state → by how much another start of it moves the joints' angles, the mean square over
    that of the band, (n_joints,).
    """
    estimator = rerun.estimator
    base = rerun.base
    states = estimator.states
    joints = len(estimator.rig.joints)
    time = rerun.log.time
    settled = time >= time[0] + min(START_FORGOTTEN, 0.1 * float(np.ptp(time)))
    width = np.mean(base.variances[settled, :joints], axis=0)
    moved = dict[str, Floats]()
    shifts = list[tuple[str, float]]()
    angles = _angles(rerun)
    for i, name in enumerate(estimator.state_names):
        if states.stds[i] > 0.0 and (states.lasting[i] or name in angles):
            moved[name] = np.zeros(joints)
            shifts += [(name, sign * float(states.stds[i])) for sign in (1.0, -1.0)]
    changes = [ModelChange(shifts={name: shift}) for name, shift in shifts]
    for i, away in each_apart(rerun, changes):
        if away.bounded:
            change = (away.means - base.means)[settled, :joints]
            likelier = away.log_likelihood - base.log_likelihood
            weight = float(np.exp(min(0.0, likelier)))
            moved[shifts[i][0]] += 0.5 * weight * np.mean(change**2, axis=0) / width
    return moved


def _angles(rerun: Rerun) -> set[str]:
    kinds = zip(rerun.estimator.state_names, rerun.estimator.state_kinds)
    return {name for name, kind in kinds if kind is StateKind.ANGLE}


def with_learned_parameters(result: Estimate, rerun: Rerun) -> Estimate:
    """Return a result with the innovations of the filter that begins with the numbers that it had
    learned at the end.

    A number that is wrong by no more than its std allows makes the first innovations large and
    alike, until it is learned. So far as it is within `WITHIN` standard deviations of what the rig
    says, that contradicts nothing.
    """
    states = rerun.estimator.states
    names = rerun.estimator.state_names
    shifts = np.clip(
        rerun.base.means[-1] - states.means, -WITHIN * states.stds, WITHIN * states.stds
    )
    outcome = rerun(
        ModelChange(shifts={names[i]: float(shifts[i]) for i in np.flatnonzero(states.lasting)})
    )
    measured = rerun.estimator.measured
    if not outcome.bounded or not set(result.measured) <= set(measured):
        return result
    # a reference that is read while homing is not among what a result compares
    count = len(rerun.log)
    columns = [measured.index(name) for name in result.measured]
    innovations = result.innovations.copy()
    variances = result.innovation_variances.copy()
    innovations[:count], variances[:count] = (
        part[:, columns] for part in (outcome.innovations, outcome.innovation_variances)
    )
    return replace(result, innovations=innovations, innovation_variances=variances)


def contradictions(rerun: Rerun, outcome: Outcome) -> set[tuple[Kind, str]]:
    """Return kind and subject of what contradicts in a run."""
    findings = diagnose_estimate(as_estimate(rerun, outcome)).findings
    return {(finding.kind, finding.subject) for finding in findings if finding.contradicts}


def as_estimate(rerun: Rerun, outcome: Outcome) -> Estimate:
    """Return what a run gave as an estimate without a truth."""
    estimator = rerun.estimator
    lasting = estimator.states.lasting
    return Estimate(
        estimator.name,
        estimator.rig.name,
        rerun.log.time,
        estimator.state_names,
        outcome.means,
        outcome.variances,
        estimator.measured,
        outcome.innovations,
        outcome.innovation_variances,
        joint_names=tuple(estimator.rig.joint_names),
        prior_means=np.where(lasting, estimator.states.means, np.nan),
        prior_stds=np.where(lasting, estimator.states.stds, np.nan),
        state_kinds=estimator.state_kinds,
        state_parts=estimator.state_parts,
        state_units=state_units(estimator),
    )
