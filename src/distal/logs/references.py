"""Readings of joints' angles that come late: a camera's frame is old when it is stamped, and a slow
sensor's sample stays in the log until its next one.
"""

from __future__ import annotations

import numpy as np

from distal.arrays import Bools, Floats

BRIDGED = 2.5
"""Gap of a reference that is interpolated, in its usual intervals [1]. Source: judgement."""

SAME = 1e-9
"""Values that differ by less than this share of their range are one value [1]. Source: rounding."""

ONE_STEP = 1.5
"""Steps of a resolution, above which a change is more than one of them [1]. Source: definition
(the middle between one and two).
"""


@np.errstate(over="ignore", invalid="ignore")
def held_samples(values: Floats) -> Bools:
    """Return which values of a reference, (k,), only repeat a sample that was held until the next
    one; none where the sensor rounds.

    A value that is rounded also repeats, but then goes on by one step of its resolution; or by
    noise, about half as often as it changes by one step. What follows a sample that was held is
    farther away, and changes of one step are rare.
    """
    present = np.flatnonzero(np.isfinite(values))
    repeats = np.zeros(len(values), dtype=bool)
    if len(present) < 3 or np.ptp(values[present]) == 0.0:
        return repeats
    steps = np.abs(np.diff(values[present])) / np.ptp(values[present])
    steps[steps < SAME] = 0.0
    after_repeat = steps[1:][(steps[:-1] == 0.0) & (steps[1:] > 0.0)]
    more = ONE_STEP * np.min(steps[steps > 0.0])
    by_one = np.count_nonzero((steps > 0.0) & (steps < more))
    is_held = len(after_repeat) > 0 and np.median(after_repeat) > more
    if is_held and np.count_nonzero(steps == 0.0) > by_one:
        repeats[present[1:][steps == 0.0]] = True
    return repeats


def earlier(time: Floats, values: Floats, lag: float) -> Floats:
    """Return the values that a reference which is late by a `lag` [s] had at some times, NaN in
    gaps, beyond their ends, and wherever it has no sample of its own.

    Args:
        time: stamps [s], (k,).
        values: as they were read, (k,).
        lag: negative where the reference is early.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < 2 or lag == 0.0:
        return values
    stamps = time[finite]
    at = time + lag
    moved = np.interp(at, stamps, values[finite])
    after = np.clip(np.searchsorted(stamps, at), 1, len(finite) - 1)
    gap = stamps[after] - stamps[after - 1] > BRIDGED * np.median(np.diff(stamps))
    outside = (at < stamps[0]) | (at > stamps[-1])
    # only as often as the reference has values: between them nothing new is known
    seen = np.zeros(len(time), dtype=bool)
    seen[finite] = True
    return np.where(gap | outside | ~seen, np.nan, moved)


JUMPS = 4.0
"""Ratio of a jump to the steps beside it, and to the step above which 2 % of all are [1]. Source:
judgement.
"""

LONGEST_AWAY = 0.02
"""Share of a log's samples for which a reference is away at the most [1]. Source: judgement."""


@np.errstate(over="ignore", invalid="ignore")
def jumps_away(values: Floats) -> Bools:
    """Return which values of a reference, (k,), are between a jump and the jump back, as of a
    marker that is seen the wrong way round for some frames.
    """
    away = np.zeros(len(values), dtype=bool)
    present = np.flatnonzero(np.isfinite(values))
    if len(present) < 3:
        return away
    steps = np.diff(values[present])
    moving = np.abs(steps[steps != 0.0])
    if not len(moving):
        return away
    jump = np.flatnonzero(np.abs(steps) > JUMPS * np.quantile(moving, 0.98))
    longest = max(2.0, LONGEST_AWAY * len(present))
    at = 0
    while at < len(jump) - 1:
        begin, end = jump[at], jump[at + 1]
        least = min(abs(steps[begin]), abs(steps[end]))
        # a joint that is so fast is fast before and after too
        beside = max(
            np.abs(steps[max(begin - 1, 0) : begin]).max(initial=0.0),
            np.abs(steps[end + 1 : end + 2]).max(initial=0.0),
        )
        is_back = abs(steps[begin] + steps[end]) < least / 2.0 and JUMPS * beside < least
        if end - begin <= longest and is_back:
            away[present[begin + 1 : end + 1]] = True
            at += 1
        at += 1
    return away


@np.errstate(over="ignore", invalid="ignore")
def said_of_jumps(values: Floats, away: Bools) -> str:
    """Return in words how often a reference jumps away, and whether to its mirror image.

    Args:
        values: as they were read, (k,).
        away: which of them are away, see `jumps_away`, (k,).
    """
    first = np.flatnonzero(away & ~np.concatenate([[False], away[:-1]]))
    before = values[np.maximum(first - 1, 0)]
    mirrored = np.abs(values[first] + before) < 0.2 * np.abs(values[first] - before)
    how = ", to its mirror image" if np.mean(mirrored) > 0.5 else ""
    return (
        f"jumps away and back {len(first)} times{how} ({int(away.sum())} samples): taken as missing"
    )
