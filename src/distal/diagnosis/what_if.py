"""The filter with another start: whether the band depends on the start, and what still contradicts
if the filter begins with what it learned.
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
"""First part of a log, which does not count since a start is forgotten there [s]. Source:
judgement.
"""

HANGS = 1.1
"""Spread of the angle over starts that are drawn from the prior, in its standard deviations, above
which the band is too narrow [1].

A right filter has at most 1: the posterior covariance is what remains of the prior plus what noise
adds. Random rigs with more than 90 % inside have mostly 0.3 to 1.1, those with less than half
inside 1.2 to 6. Source: judgement.
"""


WITHIN = 3.0
"""Largest distance of a learned parameter from the rig's, in standard deviations, that contradicts
nothing [1]. Source: judgement.
"""


def overconfidence(rerun: Rerun) -> list[Finding]:
    """Return a finding if the angle depends on the start of the filter by more than its band
    allows, and on which state.

    Each state with a prior begins one standard deviation above, then below its prior. To first
    order, the root of the sum of squares of the motions of the angle is the spread of estimates
    over starts drawn from the prior, which is a part of the posterior's standard deviation. A start
    that the log itself rejects is weighted by its likelihood, min(1, p/p_0).
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
    """Return state → mean square by which another start of it moves the joints' angles, relative to
    the mean variance of these angles, (n_joints,).
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
    """Return a result with the innovations of the filter that begins with the parameters that it
    had learned at the end.

    A parameter that is wrong by no more than its std allows makes the first innovations large and
    alike, until it is learned. If it is within `WITHIN` standard deviations of the rig's, that
    contradicts nothing.
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
    """Return kind and subject of all contradictions in a run."""
    findings = diagnose_estimate(as_estimate(rerun, outcome)).findings
    return {(finding.kind, finding.subject) for finding in findings if finding.contradicts}


def as_estimate(rerun: Rerun, outcome: Outcome) -> Estimate:
    """Return the outcome of a run as an estimate without reference angles."""
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
