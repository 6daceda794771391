"""What a known truth says of an estimate, and the likeliest causes where its band does not hold the
truth.
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
"""Share of the samples of all joints with a truth that a band has to hold; below it the truth
contradicts.
"""

LEAST_OF_JOINT = 0.7
"""The same of one joint: its errors last, so one of three rigs drawn from their stds had a joint at
0.73 to 0.84.
"""

SHARE = 0.25
"""A cause explains something if it moves the angle by this share of the error."""

NOISE = 0.3
"""An RMS error above this share of the band's half-width, which is 0.51 if all of the band is used,
has a cause.

Right numbers in the rig file gave up to 0.29, numbers wrong by a factor of 0.5 to 2 inside of the
band 0.28 to 0.75.
"""

MUCH = 0.5
"""A cause inside of the band is sure where the filter errs by less than this share without it."""

LOST = float(np.deg2rad(10.0))
"""A filter that errs by more [rad] is lost: what led it there may be smaller than its error."""


def against_truth(
    result: Estimate, log: Log, rig: Rig, rerun: Callable[[], Rerun] | None = None
) -> list[Finding]:
    """Return what speaks against an estimate's band, or for an error inside of it, after or before
    its likeliest causes.

    Inside of the band a cause is named where the filter, run again without it by `rerun`, errs by
    half as much.
    """
    if result.truths is None:
        return []
    errors = np.abs(result.angles - result.truths)
    held = errors <= BAND * result.angle_stds
    known = np.isfinite(errors)
    shares = held.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    shares[~known.any(axis=0)] = 1.0
    worst = int(np.argmin(shares))
    rms = np.sqrt(np.nansum(errors**2, axis=0) / np.maximum(known.sum(axis=0), 1))
    most = int(np.nanargmax(rms))
    if held.sum() < LEAST_INSIDE * known.sum() or shares[worst] < LEAST_OF_JOINT:
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
    """Return what would explain an `error` of the angle [rad], the likeliest first; nothing where
    no truth is known.

    Of all causes, or only of those `beyond` what the rig's own stds allow.
    """
    return _named([cause for cause in _likeliest(log, rig, error) if cause.beyond or not beyond])


def _named(found: Sequence[Cause]) -> list[Finding]:
    """Return the first causes in words; several drives with one cause, such as a gear written for
    all, are one line.
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
    """Return the causes of what the position of each drive leaves beside the truth, and columns
    that may be exchanged; nothing where no truth is known.
    """
    angles = true_angles(log, rig.joint_names)
    if angles is None:
        return []
    found = (residual_of(log, rig, angles, sensor) for sensor in rig.sensors_of("position"))
    drives = [drive for drive in found if drive is not None]
    each = [cause for drive in drives for cause in of_drive(drive)]
    return [*each, *swaps(log, rig, angles, drives)]
