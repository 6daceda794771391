"""The whole diagnosis of an estimate: by the estimate itself, and by its log and its rig, for which
the filter is run again with changes.
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
"""Share of a log's samples outside a drive's range, or outside the range of a fit, from which on a
finding says so [1]. Source: judgement.
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
    """Return what was tested, what disagrees, and what no sensor in the log can test.

    The result alone gives its innovations, and states that left their priors. With log and rig
    there are also: a reference angle outside the band with its likeliest cause; displacements
    beyond the range of their drive; a kinematic estimate that excludes this one; a band that
    depends on the start of the filter. By running `adaptive` again with one thing changed, it is
    found what would explain a disagreement, or, where there is none, what cannot be tested.

    Args:
        result: the estimate.
        log: of the estimate.
        rig: of the estimate.
        homing: time for which the reference angle was used [s], or None.
        ranges: channel → lowest and highest value that a fit has seen, SI; by default those of the
            rig's `[map]`, if any.
        what_if: whether the filter is run again with changes; that costs 20 to 150 runs of the
            log's first 2000 samples.

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
    # the band of a wrong rig says nothing, so it is not tested
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
    """Return what would explain that `adaptive` left all bounds on a log: by its reference angle,
    or else by runs with changes.

    Args:
        log: on which the filter diverged.
        rig: of the log.
        homing: time for which the reference angle is used [s], or None.
    """
    found = causes(log, rig, LOST)
    if not found:
        # an estimated external torque would hide what is wrong with the rig
        untouched = rig.with_values({"joints.*.touch": "never"})
        estimator = estimator_for(log, untouched, "adaptive", compiled, homing)
        assert isinstance(estimator, AdaptiveFilter)
        found = [*explanations(Rerun(log, estimator, homing)), *out_of_reach(log, rig)]
    return found


def _learned_range(rig: Rig) -> dict[str, tuple[float, float]]:
    """Return channel → range of the logs from which the rig's map was learned, wider by a
    tenth at each end.
    """
    maps = () if rig.map is None else rig.map.readings
    ends = (end for each in maps for end in zip(each.channels, each.low, each.high))
    return {name: (low - 0.1 * (high - low), high + 0.1 * (high - low)) for name, low, high in ends}


def elsewhere(log: Log, rig: Rig) -> list[Finding]:
    """Return the displacements that are beyond the range of their drives."""
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
    """Return the channels that left the range of a fit.

    Args:
        log: to be checked.
        ranges: channel → lowest and highest value that the fit has seen, SI.
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
