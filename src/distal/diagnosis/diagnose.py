"""The whole diagnosis of an estimate: by the estimate itself, by its log and rig, and by score
tests of what may be wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED
from distal.diagnosis.cause_search import (
    UNFELT,
    Change,
    Derivatives,
    Gains,
    Outcome,
    PerturbedRuns,
    Search,
    candidates,
    unfelt,
    wrong_readings,
)
from distal.diagnosis.causes import (
    COMPLIANCE,
    SCALE,
    ZERO,
    Cause,
    Finding,
    Kind,
    causes_of,
    named_cause,
    sensor_of,
    sizes,
    tendon_of,
)
from distal.diagnosis.innovation_tests import (
    SPAN,
    ChannelStatistics,
    Diagnosis,
    channels_of,
    diagnose_estimate,
    quantile,
    statistics_of,
)
from distal.errors import EstimationError
from distal.estimators.estimator_protocol import dead_after
from distal.logs import Log
from distal.results import Estimate
from distal.rig import Rig, position_range
from distal.run.exchanged_or_late import Redundancy, unlike_free_motion
from distal.run.offline import estimator_for
from distal.units import rounded

OUTSIDE = 0.05
"""Share of a log's samples outside a drive's range, or outside the range of a fit, from which on a
finding says so [1]. Source: judgement.
"""

ACTIVE = 0.5
"""Spread of a force, as a share of that elsewhere, from which on it goes on [1]. Source: judgement.
"""


def diagnose(
    result: Estimate,
    log: Log | None = None,
    rig: Rig | None = None,
    homing: float | None = None,
    *,
    compiled: bool = True,
    what_if: bool = True,
) -> Diagnosis:
    """Return what was tested, what disagrees, and what no sensor in the log can test.

    The result alone gives its innovations, and states that left their priors. With log and rig
    there are also: a reference angle outside the band; displacements beyond the range of their
    drive, or stuck. Of a rig whose logs taught what forces are normal, `wrong_readings` says which
    reading is wrong. Else one pass of `adaptive` over copies in which one thing each is perturbed
    tells which causes the log would show; where something disagrees, two more passes without the
    likeliest causes tell which explains it.

    Args:
        result: the estimate.
        log: of the estimate.
        rig: of the estimate.
        homing: time for which the reference angle was used [s], or None.
        what_if: whether the filter is run with changes.

    Raises:
        EstimationError: only one of log and rig is given.
    """
    if (log is None) != (rig is None):
        raise EstimationError(
            "diagnose needs both the log and the rig, or neither; one of them came"
        )
    if log is None or rig is None:
        return diagnose_estimate(result)
    truth = against_truth(result)
    stuck = stuck_positions(log, rig)
    unlike = not_free(log, rig)
    # the logs from which the rig's map was learned, a little wider
    maps = () if rig.map is None else rig.map.readings
    outside = out_of_range(log, {name: e for m in maps for name, e in m.reach.items()})
    further = truth + elsewhere(log, rig) + stuck + outside + unlike
    wrong: Gains = []
    if what_if and result.is_taught and (unlike or outside) and not stuck:
        wrong = wrong_readings(log, rig)
    named = _named(wrong, "looks like", rig)
    if result.estimator != "adaptive" or not what_if or (named and not truth):
        return diagnose_estimate(result, further + named)
    runs = PerturbedRuns(log, estimator_for(log, rig, "adaptive", compiled, homing), homing)
    # known angles tell the size
    causes = _causes(runs)
    causes = [cause for cause in causes if any(cause in change for change, _ in wrong)] or causes
    channels = channels_of(result)
    ends = result.with_all_states
    if channels.disagreeing() and ends.state_names == runs.estimator.state_names:
        # what the filter learns within the rig's own stds contradicts nothing
        again = _channels(runs, runs.begun_with(ends.means[-1]))
        channels = channels if again.disagreeing() else again
    disagrees = bool(channels.disagreeing())
    wide = not (result.truths is None or truth or result.is_taught)
    is_searched = not stuck and bool(truth or disagrees or wide)
    asked = [cause for cause in causes if is_searched or cause.kind in UNFELT]
    derivatives = Derivatives(runs, asked)
    if not derivatives.base.bounded:
        return diagnose_estimate(result, further + named)
    test = derivatives.test(of_truth=False)
    if is_searched:
        sized = sizes(runs.estimator, runs.log, runs.truths, asked)
        tests = [test]
        if runs.truths is not None:
            tests.append(derivatives.test(of_truth=True))
        changes = candidates(asked, sized, tests)
        # what disagrees is explained, else an error that the band allows
        ways = [True] * bool(truth) + [False] * disagrees + [True] * wide
        trials = _explained(runs, derivatives.base, changes, ways)
        kind: Kind = "looks like" if truth or disagrees else "would explain"
        further += _named(trials, kind, rig) or named
    if not (disagrees or any(finding.contradicts for finding in further)):
        further += _cannot_be_felt(unfelt(derivatives, test), rig)
    return diagnose_estimate(result, further, channels)


def why_diverged(log: Log, rig: Rig, homing: float | None = None) -> list[Finding]:
    """Return what would explain that `adaptive` left all bounds on a log: by its reference angle,
    or else by runs with changes.

    Args:
        log: on which the filter diverged.
        rig: of the log.
        homing: time for which the reference angle is used [s], or None.
    """
    # an estimated external torque would hide what is wrong with the rig
    untouched = rig.with_values({"joints.*.touch": "never"})
    runs = PerturbedRuns(log, estimator_for(log, untouched, "adaptive", homing=homing), homing)
    causes = _causes(runs)
    (base,) = runs([{}])
    sized = sizes(runs.estimator, runs.log, runs.truths, causes)
    # without known angles only what is wrong with readings: friction may hold any filter
    is_known = runs.truths is not None
    changes = candidates([c for c in causes if is_known or c.channels], sized, ())
    trials = _explained(runs, base, changes, [True] * is_known + [False])
    return _named(trials, "looks like", rig)


def _explained(
    runs: PerturbedRuns, base: Outcome, changes: Sequence[Change], ways: Sequence[bool]
) -> Gains:
    """Return the changes that explain something by the first way that finds
    any: by known angles, or by innovations, of which none may disagree then.
    """
    for of_truth in ways:
        trials = Search(runs, base, of_truth=of_truth)(changes)
        if not of_truth:
            trials = [trial for trial in trials if not _channels(runs, trial.outcome).disagreeing()]
        if trials:
            return [(trial.change, trial.gain) for trial in trials]
    return []


def _causes(runs: PerturbedRuns) -> list[Cause]:
    return causes_of(runs.estimator, float(np.median(np.diff(runs.log.time))))


def _channels(runs: PerturbedRuns, outcome: Outcome) -> ChannelStatistics:
    estimator = runs.estimator
    is_taught = bool(Redundancy.of(estimator.rig, estimator.channels).maps)
    return statistics_of(estimator.measured, outcome.normalized, runs.log.time, is_taught=is_taught)


def _named(changes: Gains, kind: Kind, rig: Rig) -> list[Finding]:
    """Return the likeliest causes in words: one, two that are wrong together, or two that cannot be
    told apart.

    Args:
        changes: that explain something.
        kind: of the findings.
        rig: of the log.
    """
    if not changes:
        return []
    (likeliest, best), *alternatives = changes
    named = [named_cause(kind, rig, *pair) for pair in likeliest.items()]
    for change, gain in alternatives:
        other = named_cause(kind, rig, *next(iter(change.items())))
        if best - gain < quantile(1) ** 2 and other.subject != named[0].subject:
            return [*named, replace(other, text=f"or {other.text} (these cannot be told apart)")]
    return named


def _cannot_be_felt(causes: Iterable[Cause], rig: Rig) -> Iterator[Finding]:
    """Yield the groups of causes that no sensor tests, each with its drives."""
    drives = dict[str, dict[str, None]]()
    for cause in causes:
        group = {"scale": SCALE, "arm": SCALE, "zero": ZERO}.get(cause.kind, COMPLIANCE)
        if cause.paths:
            drive = tendon_of(rig, cause).drive
        else:
            sensor = sensor_of(rig, cause)
            drive = sensor.of
            group = group if sensor.measures == "position" else COMPLIANCE
        drives.setdefault(group, {})[drive] = None
    for group, named in drives.items():
        of_all = "all drives" if len(named) == len(rig.drives) > 1 else ", ".join(named)
        subject = f"{group} of {of_all}"
        text = f"{subject}: an error there changes the angle but no innovation"
        yield Finding("cannot test", subject, text)


def against_truth(result: Estimate) -> list[Finding]:
    """Return a finding where the band of a joint contains the reference angles less often than
    chance allows.

    The share inside is a mean over spans of time that count as independent: below c − z √(c (1 −
    c)/n) the band is wrong, with c = 95 %, n spans, and z of `LEVEL` over all joints.
    """
    if result.truths is None:
        return []
    errors = np.abs(result.angles - result.truths)
    counts = np.isfinite(errors).sum(axis=0)
    shares = (errors <= BAND * result.angle_stds).sum(axis=0) / np.maximum(counts, 1)
    spans = max(np.ptp(result.time) / SPAN, 1.0)
    least = COVERED - quantile(len(shares)) * np.sqrt(COVERED * (1.0 - COVERED) / spans)
    shares[counts == 0] = 1.0
    worst = int(np.argmin(shares))
    if shares[worst] >= least:
        return []
    rms = rounded(np.rad2deg(np.sqrt(np.nanmean(errors[:, worst] ** 2))))
    joint = result.joint_names[worst]
    inside = f"{100 * shares[worst]:.0f} % inside the band"
    text = f"the truth contradicts: {joint} errs by {rms}° RMS, {inside}"
    return [Finding("against the truth", joint, text)]


def elsewhere(log: Log, rig: Rig) -> list[Finding]:
    """Return the displacements that are beyond the range of their drives."""
    ranges = {sensor.name: position_range(rig, sensor) for sensor in rig.sensors_of("position")}
    problem = "is where its drive cannot be: wrong unit, zero or side?"
    return [Finding("cannot be there", name, f"{name} {problem}") for name in _outside(log, ranges)]


def stuck_positions(log: Log, rig: Rig) -> list[Finding]:
    """Return the positions that stay at one value for longer than a sensor is silent before it
    counts as dead, while the force of their drive goes on.
    """
    findings = []
    forces = {sensor.of: log.channels.get(sensor.name) for sensor in rig.sensors_of("force")[::-1]}
    for sensor in rig.sensors_of("position"):
        force = forces.get(sensor.of)
        if sensor.name in log.channels and force is not None:
            # each run of readings that are the same
            turns = np.flatnonzero(
                np.diff(log.channels[sensor.name], prepend=np.nan, append=np.nan)
            )
            spans = log.time[turns[1:] - 1] - log.time[turns[:-1]]
            for k in np.flatnonzero(spans > max(SPAN, dead_after(sensor))):
                rows = slice(turns[k], turns[k + 1])
                if _spread(force[rows]) > ACTIVE * _spread(np.delete(force, rows)):
                    begin = log.time[turns[k]]
                    text = f"{sensor.name} has one value from {begin:.1f} to {begin + spans[k]:.1f}"
                    text += " s while its force goes on: is it stuck?"
                    findings.append(Finding("stuck", sensor.name, text))
    return findings


def _spread(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.std(finite)) if len(finite) else 0.0


def out_of_range(log: Log, ranges: Mapping[str, tuple[float, float]]) -> list[Finding]:
    """Return the channels that left the range of a fit.

    Args:
        log: to be checked.
        ranges: channel → lowest and highest value that the fit has seen, SI.
    """
    findings = []
    for name, share in _outside(log, ranges).items():
        low, high = ranges[name]
        text = f"{name} is outside the range of the fit for {100 * share:.0f} % of the log"
        findings.append(Finding("out of range", name, f"{text} ({low:.3g} to {high:.3g})"))
    return findings


def _outside(log: Log, ranges: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Return channel → share of its values that are outside its range, where it is too large."""
    shares = dict[str, float]()
    for name in log.channels.keys() & ranges:
        readings = log.channels[name][np.isfinite(log.channels[name])]
        low, high = ranges[name]
        if len(readings):
            shares[name] = float(np.mean((readings < low) | (readings > high)))
    return {name: shares[name] for name in ranges if shares.get(name, 0.0) > OUTSIDE}


def not_free(log: Log, rig: Rig) -> list[Finding]:
    """Return the forces that are not those of free motion at their positions."""
    return [
        Finding(
            "not free",
            name,
            f"{name}: not as in free motion for {100 * share:.0f} % of the log; something touches "
            "a joint, or a sensor is wrong",
        )
        for name, share in unlike_free_motion(log, rig).items()
    ]
