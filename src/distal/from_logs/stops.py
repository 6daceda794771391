"""End stops of joints: a joint turns back again and again at one angle, sharply, wherever its
drives are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians

import numpy as np
from scipy.signal import find_peaks
from scipy.stats import poisson

from distal.arrays import Floats
from distal.from_logs.found_parts import FoundDrive, pulls_of
from distal.from_logs.motion_data import MotionData

PARTED = 3.0
"""By the drives' positions, a stopped joint would have turned so many times farther apart than it
did [1]. Source: judgement (a motion that is repeated turns where its drives turn).
"""

SOFT = radians(2.0)
"""Largest difference of angles in one stop [rad]. Source: judgement (pads of rubber)."""

PROMINENCE = radians(1.0)
"""A joint turns back where it goes at least so far on both sides; a way back that is shorter ends
in the same stop [rad]. Source: judgement (above the noise of cameras).
"""

CHANCE = 1e-4
"""Probability below which turning points at one angle are not by chance [1]. Source: definition
(level of the test).
"""

BRISK = 0.6
"""Share of the speed lost around a turning point that a stop takes at once [1]. Source: benchmark
(docs/results/from-logs.md: means of 0.7 to 0.9 at stops, below 0.5 at goals that are reached
again).
"""

CLOSE = radians(0.25)
"""A joint arrives where it comes so close to its turning point [rad]. Source: judgement."""

ARRIVAL = 0.015
"""Time before and after its arrival in which a stop takes the speed of a joint away [s]. Source:
judgement.
"""

BRAKING = 0.1
"""The same for friction and goals that are reached [s]. Source: judgement."""

REST_TIMES = (0.1, 0.3)
"""Time after a turning point in which a joint that stays there rests [s]. Source: judgement."""

FEWEST_OF_TIME = 3
"""Least ratio of these times in samples, below which they tell nothing [1]. Source: judgement."""


@dataclass(frozen=True)
class _Turn:
    """A turning point of a joint.

    Args:
        angle: there [rad].
        by_drives: angle that a straight line of the drives' positions tells there [rad].
        settled: angle at which it then rested [rad], NaN where it went on.
        briskness: speed lost within `ARRIVAL` over that lost within `BRAKING` [1].
        side: 1 where it turned back from a larger angle, else −1.
    """

    angle: float
    by_drives: float
    settled: float
    briskness: float
    side: float


def joint_stops(
    joint: int, drives: Sequence[FoundDrive], logs: Sequence[MotionData]
) -> tuple[float | None, float | None]:
    """Return the lower and the upper stop of a joint [rad], None where the logs show none.

    Of n turning points on a range R, k are within w of the outermost by chance Σ e^(−λ) λ^j/j! over
    j ≥ k − 1, with λ = n w/R (Poisson). Where m of them rest within w′, that has the chance
    (w′/w)^(m−1). The share of other turning points that are as brisk is the chance of each one's
    briskness.

    Args:
        joint: index of the joint.
        drives: all of them.
        logs: all of them.
    """
    turns = _turns(joint, [drive.index for drive, _ in pulls_of(joint, drives)], logs)
    return _level(-1.0, turns), _level(1.0, turns)


def _level(side: float, turns: Sequence[_Turn]) -> float | None:
    """Return where a stop begins on one side, ±1, None where there is none."""
    outward = side * np.array([turn.angle for turn in turns])
    by_drives = np.array([turn.by_drives for turn in turns])
    briskness = np.array([turn.briskness for turn in turns])
    on_side = np.flatnonzero([turn.side == side for turn in turns])
    order = on_side[np.argsort(-outward[on_side])]
    reach = float(np.ptp(outward)) if turns else 0.0
    level = None
    least = CHANCE
    for count in range(2, len(order) // 2 + 1):
        members = order[:count]
        width = float(np.ptp(outward[members]))
        parted = float(np.ptp(by_drives[members])) > max(PARTED * width, PROMINENCE)
        if width > SOFT or not parted:
            continue
        gathered = float(poisson.sf(count - 2, len(order) * width / reach))
        rests = np.array([turns[i].settled for i in members])
        settled = rests[np.isfinite(rests)]
        together = len(settled) > 1 and np.ptp(settled) < min(width, CLOSE)
        if together:
            gathered *= (float(np.ptp(settled)) / width) ** (len(settled) - 1)
        elsewhere = briskness[np.setdiff1d(np.arange(len(outward)), members)]
        as_brisk = np.sum(elsewhere >= briskness[members, None], axis=1)
        brisk = float(np.prod((1 + as_brisk) / (1 + len(elsewhere))))
        sharp = float(np.mean(briskness[members])) > BRISK
        if sharp and gathered * brisk < least:
            least = gathered * brisk
            innermost = side * np.min(outward[members])
            level = float(np.median(settled) if together else innermost)
    return level


def _turns(joint: int, drives: Sequence[int], logs: Sequence[MotionData]) -> list[_Turn]:
    """Return the turning points of a joint."""
    angles = np.concatenate([log.angles[:, joint] for log in logs])
    positions = np.vstack([log.positions[:, list(drives)] for log in logs])
    finite = np.isfinite(angles)
    if finite.sum() < 10:
        return []
    columns = np.column_stack([np.ones(len(angles)), positions])
    line = np.linalg.lstsq(columns[finite], angles[finite])[0]
    return [turn for log in logs for turn in _turns_of(log, joint, drives, line)]


def _turns_of(log: MotionData, joint: int, drives: Sequence[int], line: Floats) -> list[_Turn]:
    """Return the turning points of a log, by the `line` of the drives' positions."""
    angle = log.angles[:, joint]
    rows = np.flatnonzero(np.isfinite(angle))
    if len(rows) < 3:
        return []
    angle = angle[rows]
    time = log.time[rows]
    step = float(np.median(np.diff(time)))
    near, far = (max(1, round(time_around / step)) for time_around in (ARRIVAL, BRAKING))
    if far < FEWEST_OF_TIME * near:
        return []
    begin, end = (round(time_after / step) for time_after in REST_TIMES)
    speed = np.gradient(angle, time)
    usual = float(np.sqrt(np.mean(speed**2)))
    by_drives = line[0] + log.positions[rows][:, list(drives)] @ line[1:]
    turns = []
    for side in (1.0, -1.0):
        outward = side * angle
        for turn in find_peaks(outward, prominence=PROMINENCE)[0]:
            below = np.flatnonzero(outward[:turn] < outward[turn] - CLOSE)
            arrival = int(below[-1]) + 1 if len(below) else 0
            lost, all_lost = (
                float(np.ptp(speed[max(arrival - width, 0) : arrival + width + 1]))
                for width in (near, far)
            )
            after = angle[turn + begin : turn + end]
            stays = len(after) > 0 and np.ptp(after) < CLOSE
            settled = float(np.median(after)) if stays else np.nan
            if abs(settled - angle[turn]) > PROMINENCE:
                settled = np.nan
            brisk = lost / max(all_lost, usual)
            turns.append(_Turn(angle[turn], by_drives[turn], settled, brisk, side))
    return turns
