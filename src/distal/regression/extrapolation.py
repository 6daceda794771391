"""How a map extrapolates: learned from the inner part of what logs cover, judged on the outer part
of logs left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from distal.arrays import Bools
from distal.errors import FitError
from distal.regression.band import Errors
from distal.regression.cross_validation import splits
from distal.regression.features import Samples
from distal.regression.learn_map import Kind, errors_of
from distal.rig import LearnedMap

Learner: TypeAlias = Callable[[Sequence[int], Sequence[Bools]], LearnedMap]
"""(Indices of logs, which of their samples) → the map that these teach."""

INNER = 0.7
"""Share of all samples that lie in the inner part."""

COVERED = (0.5, 99.5)
"""Percentiles between which logs cover what is read: a single spike is no range."""


def inner_parts(logs: Sequence[Samples]) -> list[Bools]:
    """Return which samples of each log lie in the inner part, where max_i |x_i − m_i| / h_i is
    small.

    The maximum is over all readings and angles; m_i is the middle of the range of one, h_i half of
    its length.
    """
    low, high = np.percentile(np.vstack([log.every for log in logs]), COVERED, axis=0)
    moving = high > low
    middle = (low + high)[moving] / 2
    half = (high - low)[moving] / 2
    far = [
        np.max(np.abs(log.every[:, moving] - middle) / half, axis=1, initial=0.0) for log in logs
    ]
    limit = np.quantile(np.concatenate(far), INNER)
    return [np.asarray(distance <= limit) for distance in far]


def errors_beyond(
    logs: Sequence[Samples], kind: Kind, folds: Sequence[int], homing: float | None, learn: Learner
) -> list[list[Errors]]:
    """Return the errors in the outer part of each log with what the inner parts of other folds'
    logs teach.

    They count after a window of `homing` [s], if any.
    """
    parts = inner_parts(logs)
    errors = []
    for out, left in splits(folds) if len(set(folds)) > 1 else ():
        try:
            learned = learn(left, [parts[i] for i in left])
        except FitError:
            continue  # without these logs nothing is known of a joint
        errors += [errors_of(learned, logs[i], kind, homing, ~parts[i]) for i in out]
    return errors
