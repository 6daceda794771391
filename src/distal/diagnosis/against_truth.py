"""Findings by a reference angle: whether the band of an estimate contains it, and the likeliest
causes if not. The reference angle of a log counts as the truth here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from distal.confidence import BAND
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.causes import MOST, Cause, DriveResidual
from distal.diagnosis.drive_residuals import residual_of, swaps
from distal.diagnosis.finding import Finding
from distal.diagnosis.rerun import Rerun
from distal.diagnosis.trials import tried
from distal.logs import Log, true_angles
from distal.results import Estimate
from distal.rig import Rig

LEAST_INSIDE = 0.85
"""Share of the samples of all joints inside the band, below which the truth contradicts the
estimate [1]. Source: judgement.
"""

LEAST_OF_JOINT = 0.7
"""Share of the samples of one joint inside the band, below which the truth contradicts the estimate
[1]. Errors of a joint last: one of three rigs that were drawn from their stds had a joint at 0.73
to 0.84. Source: judgement.
"""

SHARE = 0.25
"""Motion of the angle by a cause, as a share of the error, from which on the cause explains
something [1]. Source: judgement.
"""

NOISE = 0.3
"""RMS error, as a share of the band's half-width, from which on a cause is looked for [1]; a
correct band has 0.51.

Rigs with right parameters had up to 0.29. Rigs with parameters wrong by a factor of 0.5 to 2, whose
errors were inside the band, had 0.28 to 0.75. Source: judgement.
"""

MUCH = 0.5
"""RMS error without a cause, as a share of that with it, below which the cause is named inside the
band [1]. Source: judgement.
"""

MOST_COMPARED = 100_000
"""Largest number of samples whose positions are compared with reference angles, the first ones [1]:
a thousand seconds at 100 Hz. Source: judgement.
"""

LOST = float(np.deg2rad(10.0))
"""Error from which on a filter is lost [rad]: what led it there may be smaller than its error.
Source: judgement.
"""


def against_truth(
    result: Estimate, log: Log, rig: Rig, rerun: Callable[[], Rerun] | None = None
) -> list[Finding]:
    """Return what the reference angles say against an estimate: that its band does not contain
    them, or that its error inside the band has a cause.

    The likeliest causes come before the first, and after the second. Inside the band a cause is
    named only if the filter, run again without it, has less than `MUCH` of the error.

    Args:
        result: the estimate, with reference angles; without them nothing is found.
        log: of the estimate.
        rig: of the estimate.
        rerun: gives the filter over the log again; None where causes are not tried.
    """
    if result.truths is None:
        return []
    errors = np.abs(result.angles - result.truths)
    held = errors <= BAND * result.angle_stds
    has_truth = np.isfinite(errors)
    shares = held.sum(axis=0) / np.maximum(has_truth.sum(axis=0), 1)
    shares[~has_truth.any(axis=0)] = 1.0
    worst = int(np.argmin(shares))
    rms = np.sqrt(np.nansum(errors**2, axis=0) / np.maximum(has_truth.sum(axis=0), 1))
    most = int(np.nanargmax(rms))
    if held.sum() < LEAST_INSIDE * has_truth.sum() or shares[worst] < LEAST_OF_JOINT:
        outside = texts.outside_the_truth(
            result.joint_names[worst], float(rms[worst]), float(shares[worst])
        )
        if rerun is None:
            return [*causes(log, rig, float(rms[most])), outside]
        trials = tried(rerun(), _of_drives(log, rig, DriveResidual.alone))
        return [*_named([trial.cause for trial in trials]), outside]
    beyond = causes(log, rig, float(rms[most]), beyond=True)
    widths = BAND * np.median(result.angle_stds, axis=0)
    most = int(np.argmax(rms / widths))
    if beyond or rms[most] <= NOISE * widths[most]:
        return beyond
    inside = texts.errs_inside(result.joint_names[most], float(rms[most]), float(shares[most]))
    if rerun is None:
        return [inside]
    trials = tried(rerun(), _of_drives(log, rig, DriveResidual.alone))
    sure = [trial.cause for trial in trials if trial.errors[most] < MUCH * trial.before[most]]
    return [inside, *(replace(cause, kind="would explain") for cause in _named(sure))]


def causes(log: Log, rig: Rig, error: float, *, beyond: bool = False) -> list[Finding]:
    """Return what would explain an error of the angle, the likeliest first; nothing where no
    reference angle is known.

    Args:
        log: with reference angles.
        rig: of the log.
        error: of the angle [rad].
        beyond: only causes that go beyond what the rig's own stds allow.
    """
    return _named([cause for cause in _likeliest(log, rig, error) if cause.beyond or not beyond])


def _named(found: Sequence[Cause]) -> list[Finding]:
    """Return the first causes in words; drives with the same cause, such as a wrong gear, share one
    finding.
    """
    named: dict[str, list[str]] = {}
    for cause in found:
        named.setdefault(cause.words, []).append(cause.subject)
    return [
        texts.looks(" and ".join(subjects), words) for words, subjects in [*named.items()][:MOST]
    ]


def _likeliest(log: Log, rig: Rig, error: float) -> list[Cause]:
    """Return what would explain an `error` of the angle [rad], the likeliest first."""
    found = _of_drives(log, rig, DriveResidual.causes)
    found.sort(key=lambda cause: -round(cause.gain))
    return [cause for cause in found if cause.size > SHARE * min(error, LOST)]


def _of_drives(log: Log, rig: Rig, of_drive: Callable[[DriveResidual], list[Cause]]) -> list[Cause]:
    """Return the causes of what remains of the position of each drive beside the reference angles,
    and columns that may be exchanged; nothing where no reference angle is known.
    """
    log = log.select(slice(MOST_COMPARED))
    angles = true_angles(log, rig.joint_names)
    if angles is None:
        return []
    found = (residual_of(log, rig, angles, sensor) for sensor in rig.sensors_of("position"))
    drives = [drive for drive in found if drive is not None]
    each = [cause for drive in drives for cause in of_drive(drive)]
    return [*each, *swaps(log, rig, angles, drives)]
