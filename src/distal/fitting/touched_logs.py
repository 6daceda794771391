"""Logs in which something touches the joints: what they say of the rig in free motion is wrong.

They are found by the angle itself: the straight line that the other logs teach errs far more on
them than on each other, since the same positions go with other angles.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.errors import EstimationError
from distal.estimators import affine_samples
from distal.logs import Log, true_angles
from distal.regression import yardstick_error
from distal.rig import Rig

FAR = 2.5
"""A log on which the line of the others errs by so many times the median is not like them [1]:
docs/results/touch.md.
"""

SPOILT = 1.5
"""The line of the others errs by so many times as much with logs that are touched [1]: as above."""

FEWEST = 3
"""So many logs in free motion are needed to say that others are not [1]."""

YARDSTICK = "least squares with lags"


def touched_logs(logs: Sequence[Log], rig: Rig) -> list[int]:
    """Return the indices of the logs in which something seems to touch the joints.

    The logs with the largest errors on the line of the others are set aside, never more than half.
    They count as touched where the line of the rest errs `FAR` more on them than on itself, and
    where they spoil it: with them it errs `SPOILT` times as much on the rest. A log of fast motions
    is far, but spoils nothing.
    """
    joints = rig.joint_names
    with_angles = [i for i, log in enumerate(logs) if true_angles(log, joints) is not None]
    try:
        samples = {i: affine_samples(logs[i], rig) for i in with_angles}
    except EstimationError:
        return []

    def errors(of: Sequence[int], training: Sequence[int]) -> dict[int, float]:
        return {
            i: yardstick_error(YARDSTICK, [samples[j] for j in training if j != i], samples[i])
            for i in of
        }

    if len(with_angles) <= FEWEST:
        return []
    kept = list(with_angles)
    aside = list[int]()
    while len(kept) > max(FEWEST, len(with_angles) // 2):
        by_others = errors(kept, kept)
        worst = max(kept, key=lambda i: by_others[i])
        aside.append(worst)
        kept.remove(worst)
    by_kept = errors(with_angles, kept)
    usual = float(np.median([by_kept[i] for i in kept]))
    far = [i for i in aside if by_kept[i] > FAR * usual]
    spoilt = errors(kept, [*kept, *far])
    return sorted(far) if np.median(list(spoilt.values())) > SPOILT * usual else []
