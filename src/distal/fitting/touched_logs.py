"""Logs in which something touches the joints, so that they say nothing true of the rig in free
motion.

They are found by the angle itself: least squares from the other logs err far more on them than on
each other, since the same positions of the drives go with other angles.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.errors import EstimationError
from distal.estimators import samples_of_angles
from distal.logs import Log, true_angles
from distal.regression import yardstick_error
from distal.rig import Rig

FAR = 2.5
"""Ratio of a log's error to the median error of the other logs, above which the log is unlike them
[1]. Source: benchmark (docs/results/touch.md).
"""

SPOILT = 1.5
"""Ratio of the errors on the other logs with and without such logs in the training, above which
these count as touched [1]. Source: benchmark (docs/results/touch.md).
"""

FEWEST = 3
"""Least number of logs in free motion that are needed to say that others are not [1]. Source:
judgement.
"""

YARDSTICK = "least squares with lags"
"""Name of the yardstick, see `YARDSTICKS`, whose errors are compared."""


def touched_logs(logs: Sequence[Log], rig: Rig) -> list[int]:
    """Return the indices of the logs in which something seems to touch the joints.

    The log on which least squares from the others err most is set aside, again and again, until
    half of the logs are left, or `FEWEST`. Logs that were set aside count as touched where two
    things hold. Least squares from the rest err `FAR` times as much on them as on the rest. Least
    squares from the rest and them together err `SPOILT` times as much on the rest. A log of fast
    motions is far off too, but spoils nothing.
    """
    joints = rig.joint_names
    with_angles = [i for i, log in enumerate(logs) if true_angles(log, joints) is not None]
    try:
        samples = {i: samples_of_angles(logs[i], rig) for i in with_angles}
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
