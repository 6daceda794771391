"""`learn`: everything that is learned from logs. A fold of `leave_out` is the same call with fewer logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from distal.fitting.angle_maps import angle_maps
from distal.fitting.checks import unknown_joints
from distal.fitting.cross_fit import cross_fit
from distal.fitting.curves import curves
from distal.fitting.fitted import assignments
from distal.fitting.groups import folds_of, groups_of
from distal.fitting.map_samples import filtered, mean_rms, partly_homed
from distal.fitting.maps import MapFit, learn_contact
from distal.fitting.numbers import Numbers, numbers_of
from distal.fitting.options import Options
from distal.fitting.progress import Progress
from distal.logs import Log, true_angles, true_torques
from distal.regression import Samples
from distal.rig import Rig, part_at

Floats = NDArray[np.float64]

SURER = 0.85
"""Narrower stds are used if they bring the angle's error below this share."""

TOLD_OR_HELD: tuple[float | None, ...] = (None, 0.0)
"""Stds that are tried after a fit: those from the logs, or none, so that filters keep the numbers constant."""

SIMPLER = 0.8
"""The original numbers are kept if their angle error on logs left out is below this share of the fitted rig's error."""

IN_DOUBT: tuple[float | None, ...] = (1.0, 0.3, 0.1, 0.0)
"""Shares of the priors' stds that are tried, widest first, where a fit is in doubt; 0 holds the numbers."""


@dataclass(frozen=True)
class Learned:
    """All that is learned from logs.

    Args:
        rig: the description with all results.
        numbers: the rig's numbers.
        prior_share: share of the priors' stds that the file keeps; None where the stds come from the logs.
        curves: path → value of the position sensors' systematic errors.
        maps: what was learned beside the numbers, by the name of its table: ``affine``, ``discrepancy``, ``contact``.
        doubts: sentences with the reasons not to trust the fit.
    """

    rig: Rig
    numbers: Numbers
    prior_share: float | None
    curves: Mapping[str, object]
    maps: Mapping[str, MapFit]
    doubts: tuple[str, ...]


def learn(logs: Sequence[Log], rig: Rig, options: Options, progress: Progress | None = None) -> Learned:
    """Return all that is learned from logs: the numbers, their stds, and the error that the model leaves.

    All choices that depend on logs are made here, starting from the original rig.

    Args:
        logs: as read and checked.
        rig: the description, whose values and stds are the priors.
        options: options of the fit.
        progress: called with what is done.

    Raises:
        FitError: the logs cannot be fitted.
    """
    known = [log for log in logs if true_angles(log, _names(rig)) is not None]
    numbers = numbers_of(logs, rig, options, bool(known), progress)

    def curves_of(own: Numbers) -> dict[str, object]:
        return dict(curves(own.problem, own.found.z)) if options.curves else {}

    def written(own: Numbers, prior_share: float | None) -> Rig:
        return described(rig, assignments(own.fitted, own.problem.filter.rig, prior_share) | curves_of(own))

    doubts = list(numbers.doubts)
    unknown = unknown_joints(known, rig) if known else []
    if unknown:
        doubts.append(
            f"the angle of {', '.join(unknown)} is known in no log: numbers of the rig are fitted, but no straight line "
            "(affine) and no correction (discrepancy), which are of all joints"
        )
    unsure = numbers.found.interrupted or bool(doubts)
    share, maps = (IN_DOUBT if unsure else TOLD_OR_HELD)[0], list[MapFit]()
    if known and not unknown:
        groups = _groups([log.source for log in known], options)
        folds = folds_of(groups)
        unseen = cross_fit(numbers, known, folds)
        if any(own.found.interrupted for own in unseen):
            numbers = replace(numbers, found=replace(numbers.found, interrupted=True))
            unseen = [numbers] * len(unseen)

        def cross_filtered(each: Sequence[Numbers], prior_share: float | None) -> tuple[dict[int, Samples], list[str]]:
            rigs = [written(own, prior_share) for own in each]
            return filtered(known, [rigs[fold] for fold in folds], options.homing, options.compiled)

        data, refused = cross_filtered(unseen, share)
        doubts += refused
        for other in (IN_DOUBT if unsure else TOLD_OR_HELD)[1:] if data and not numbers.found.interrupted else ():
            as_sure, _ = cross_filtered(unseen, other)
            if len(as_sure) == len(data) and mean_rms(as_sure) < SURER * mean_rms(data):
                data, share = as_sure, other
        rigs = [written(own, share) for own in unseen]
        plain = [as_it_came(own) for own in unseen]
        before = cross_filtered(plain, None)[0] if data and not numbers.found.interrupted else {}
        if before and len(before) == len(data) and mean_rms(before) < SIMPLER * mean_rms(data):
            doubts.append(
                f"the rig as it came errs less on logs left out ({np.rad2deg(mean_rms(before)):.2f}°) than the fitted one "
                f"({np.rad2deg(mean_rms(data)):.2f}°): its numbers are kept"
            )
            numbers, data, rigs = as_it_came(numbers), before, [written(own, share) for own in plain]
        ran = list(data)
        own = [rigs[folds[i]] for i in ran]
        half = partly_homed([known[i] for i in ran], own, options.homing, options.compiled)
        partly = {ran[k]: one for k, one in half.items()}
        maps += angle_maps(known, data, partly, groups, rig, written(numbers, share), options)
    learned = written(numbers, share)
    maps += _contact_map(logs, learned, options)
    whole = learned.with_values({one.table: one.learned.model_dump() for one in maps}) if maps else learned
    return Learned(whole, numbers, share, curves_of(numbers), {one.table: one for one in maps}, tuple(doubts))


def _contact_map(logs: Sequence[Log], learned: Rig, options: Options) -> list[MapFit]:
    """Return the map of the external torque, if the logs have it and the rig says that it can occur."""
    felt = [log for log in logs if true_torques(log, _names(learned)) is not None]
    if not felt or any(joint.external_torque.std == 0.0 for joint in learned.joints):
        return []
    groups = _groups([log.source for log in felt], options)
    return [learn_contact(felt, learned, options.homing, groups, scored=False)]


def _groups(sources: Sequence[str], options: Options) -> list[str]:
    """Return which logs are left out together: those of one unit, else each alone."""
    return [str(i) for i in range(len(sources))] if options.units is None else groups_of(sources, options.units, 1)


def as_it_came(numbers: Numbers) -> Numbers:
    """Return the numbers, all marked as not determined, so that a description keeps its own.

    Args:
        numbers: that logs tell.
    """
    return replace(numbers, fitted=tuple(part.as_it_came for part in numbers.fitted))


def described(rig: Rig, values: Mapping[str, object]) -> Rig:
    """Return a rig with its fitted numbers; a reference sensor that only the fit used is left out.

    Args:
        rig: the description as it came.
        values: path → value.
    """
    own = {path: value for path, value in values.items() if part_at(rig, ".".join(path.split(".")[:2])) is not None}
    return rig.with_values(own) if own else rig


def _names(rig: Rig) -> list[str]:
    return [joint.name for joint in rig.joints]
