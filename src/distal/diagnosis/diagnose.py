"""The whole diagnosis of an estimate: what it says itself, and what its log and its rig say when
they are asked again.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from distal.arrays import Floats
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.against_truth import LOST, against_truth, causes
from distal.diagnosis.channel_statistics import channel_statistics_of
from distal.diagnosis.comparison import disagreement, disagreement_with_map
from distal.diagnosis.explanations import explanations
from distal.diagnosis.finding import Finding
from distal.diagnosis.gears import out_of_reach
from distal.diagnosis.of_estimate import Diagnosis, diagnose_estimate
from distal.diagnosis.rerun import Rerun
from distal.diagnosis.untested import untestable
from distal.diagnosis.what_if import overconfidence, with_learned_parameters
from distal.errors import EstimationError
from distal.estimators import AdaptiveFilter
from distal.logs import Log
from distal.results import Estimate
from distal.rig import Rig
from distal.run.drive_range import position_range
from distal.run.offline import estimator_for

OUTSIDE_SHARE = 0.05
"""Share of a log outside of where it can be, or of what a fit has seen, from which on that is said.
"""


def diagnose(
    result: Estimate,
    log: Log | None = None,
    rig: Rig | None = None,
    homing: float | None = None,
    *,
    compiled: bool = True,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    what_if: bool = True,
) -> Diagnosis:
    """Return what was tested, what disagrees, and what no sensor there can test.

    From the result alone: its innovations, and states that left their priors. With log and rig
    also: a truth outside of the band with its likeliest cause, displacements where no drive can be,
    a kinematic estimate that excludes this one, a band that hangs on the start, and, by running
    `adaptive` again with one thing changed, what would explain a disagreement, or else what cannot
    be tested.

    Args:
        homing: for how long the truth was used [s], or None.
        ranges: channel → lowest and highest value that a fit has seen, SI; default those of the
            rig's `[affine]`, if any.
        what_if: run the filter again with one thing changed; it costs 20 to 150 runs of the log's
            first 2000 samples.

    Raises:
        EstimationError: only one of log and rig is given.
    """
    if (log is None) != (rig is None):
        raise EstimationError(
            "diagnose needs both the log and the rig, or neither; one of them came"
        )
    if log is None or rig is None:
        return diagnose_estimate(result)

    @cache
    def rerun() -> Rerun:
        estimator = estimator_for(log, rig, "adaptive", compiled, homing)
        assert isinstance(estimator, AdaptiveFilter)
        return Rerun(log, estimator, homing)

    truth = against_truth(
        result, log, rig, rerun if what_if and result.estimator == "adaptive" else None
    )
    further = [
        *truth,
        *elsewhere(log, rig),
        *out_of_range(log, _learned_range(rig) if ranges is None else ranges),
    ]
    if result.estimator != "adaptive":
        return diagnose_estimate(result, further)
    further += disagreement(result, log, rig, homing) + disagreement_with_map(
        result, log, rig, homing
    )
    channels = channel_statistics_of(result)
    if what_if and any(finding.contradicts for finding in channels.findings()):
        channels = channel_statistics_of(with_learned_parameters(result, rerun()))
    first = diagnose_estimate(result, further, channels)
    if not what_if:
        return first
    # of a rig that is wrong the band says nothing anyway
    if not any(finding.contradicts for finding in first.findings):
        further += overconfidence(rerun())
        first = diagnose_estimate(result, further, channels)
    against = [finding for finding in first.findings if finding.contradicts]
    if any(finding.kind != "overconfident" for finding in against):
        named = any(finding.contradicts for finding in truth)
        explained = [] if named else [*explanations(rerun()), *out_of_reach(log, rig)]
        return diagnose_estimate(result, [*explained, *further], channels)
    if against:
        return first
    return diagnose_estimate(result, [*further, *untestable(rerun())], channels)


def why_diverged(
    log: Log, rig: Rig, homing: float | None = None, *, compiled: bool = True
) -> list[Finding]:
    """Return what would explain that `adaptive` left all bounds on a log: by its truth, else by
    running it with changes.

    The truth is used for `homing` [s], or not at all.
    """
    found = causes(log, rig, LOST)
    if not found:
        # a torque from outside would take what is wrong with the rig upon itself
        untouched = rig.with_values({"joints.*.touch": "never"})
        estimator = estimator_for(log, untouched, "adaptive", compiled, homing)
        assert isinstance(estimator, AdaptiveFilter)
        found = [*explanations(Rerun(log, estimator, homing)), *out_of_reach(log, rig)]
    return found


def _learned_range(rig: Rig) -> dict[str, tuple[float, float]]:
    """Return what the logs that taught a rig's map have seen, each channel by a tenth of its range
    more.
    """
    learned = rig.affine
    if learned is None:
        return {}
    ends = zip(learned.channels, learned.low, learned.high)
    return {name: (low - 0.1 * (high - low), high + 0.1 * (high - low)) for name, low, high in ends}


def elsewhere(log: Log, rig: Rig) -> list[Finding]:
    """Return the displacements that are where their drives cannot be."""
    findings = []
    for sensor in rig.sensors_of("position"):
        readings = log.channels.get(sensor.name)
        if (
            readings is not None
            and _share_outside(readings, *position_range(rig, sensor)) > OUTSIDE_SHARE
        ):
            findings.append(texts.drive_elsewhere(sensor.name))
    return findings


def out_of_range(log: Log, ranges: Mapping[str, tuple[float, float]]) -> list[Finding]:
    """Return the channels that left `ranges`: the lowest and highest value of each that a fit has
    seen, SI.
    """
    findings = []
    for name, (low, high) in ranges.items():
        share = _share_outside(log.channels.get(name, np.zeros(0)), low, high)
        if share > OUTSIDE_SHARE:
            findings.append(texts.outside_the_fit(name, share, low, high))
    return findings


def _share_outside(readings: Floats, low: float, high: float) -> float:
    finite = readings[np.isfinite(readings)]
    return float(np.mean((finite < low) | (finite > high))) if len(finite) else 0.0
