"""The maps of the angle that `learn` learns: `affine`, and what the filter's angle lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from distal.estimators import affine_of, affine_samples
from distal.fitting.groups import folds_of
from distal.fitting.map_samples import discrepancy_of
from distal.fitting.maps import MapFit, map_of
from distal.fitting.options import Options
from distal.fitting.reference_error import with_reference_error
from distal.logs import Log
from distal.regression import Kind, Samples, as_discrepancy, left_out_errors, rms_beyond_noise
from distal.rig import Rig
from distal.sensors import place_offsets

CLEARLY = 1.1
"""`affine` does clearly better where the error of `adaptive` on logs left out is this many times larger."""


def angle_maps(
    known: Sequence[Log],
    data: Mapping[int, Samples],
    partly: Mapping[int, Samples],
    groups: Sequence[str],
    prior: Rig,
    learned: Rig,
    options: Options,
) -> list[MapFit]:
    """Return the map of `affine`, and that of what the filter's angles lack.

    Args:
        known: logs with a truth.
        data: what the filter makes of them with numbers that have not seen them, by the index of the log.
        partly: the same of some of these logs, after a homing move that covers half of their range.
        groups: of each log, which are left out together.
        prior: the description as it came.
        learned: with the fitted numbers.
        options: of the fit.
    """
    # whether a reading moves is judged by the noise that its user states: a fitted one may hold what the model lacks
    line = affine_of(prior)
    straight = [affine_samples(log, learned) for log in known]
    straight = [one.part(np.asarray(np.isfinite(one.targets).any(axis=1))) for one in straight]
    affine = map_of(straight, line, learned, options.homing, groups, scored=False)
    maps = [affine]
    if data:
        samples, own = list(data.values()), [groups[i] for i in data]
        kind = discrepancy_of(learned, samples)
        half = {k: partly[i] for k, i in enumerate(data) if i in partly}
        found = map_of(samples, kind, learned, options.homing, own, scored=False, partly=half)
        if options.homing is None:
            among = [_at_times_of(data[i], affine_samples(known[i], learned)) for i in data]
            found = as_good_as_a_line(found, affine, [(kind, samples), (line, among)], own, learned)
        maps.append(found)
    if options.homing is None:
        return [one.with_map(with_reference_error(one.learned, prior, known)) for one in maps]
    return maps


def as_good_as_a_line(
    found: MapFit,
    affine: MapFit,
    data: Sequence[tuple[Kind, Sequence[Samples]]],
    groups: Sequence[str],
    rig: Rig,
) -> MapFit:
    """Return the correction of the filter's angle, or `affine` in its place where that errs clearly less on logs left out.

    Args:
        found: the correction.
        affine: the map of readings.
        data: kind and samples of both, the same samples of the same logs.
        groups: of the logs.
        rig: with the fitted numbers.
    """
    folds = folds_of(list(groups))
    if len(set(folds)) < 2:
        return found
    # the reference's noise is in both, and would make them alike
    noise = max(one.reference_std for _, samples in data for one in samples)
    ours, line = (
        rms_beyond_noise(left_out_errors(samples, kind, fit.terms, folds, None), noise)
        for fit, (kind, samples) in zip((found, affine), data)
    )
    if not ours > CLEARLY * line:
        return found
    errors = f"{np.rad2deg(line):.3f}°" if line > 0.0 else "no more than the reference's own noise"
    note = (
        f"discrepancy: within the range of the logs the angle is that of affine: its error on logs left out is {errors}, "
        f"that of the filter {np.rad2deg(ours):.3f}°"
    )
    other = as_discrepancy(affine.learned, found.learned, place_offsets(rig, affine.learned.channels))
    return replace(found.with_map(other), notes=(note, *found.notes[1:]), terms=affine.terms)


def _at_times_of(one: Samples, straight: Samples) -> Samples:
    """Return samples of readings, their target known at those times only at which that of others is."""
    there = np.isin(straight.time, one.time[np.isfinite(one.targets).any(axis=1)])
    return replace(straight, targets=np.where(there[:, None], straight.targets, np.nan))
