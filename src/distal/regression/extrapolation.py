"""How a map extrapolates: it is learned from the inner part of what some logs cover, and judged on
the outer part of held-out logs.
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
"""A function that learns a map from logs, by their indices, and from those of each log's samples
that its mask, (k,), holds.
"""

INNER = 0.7
"""Share of all samples that lie in the inner part. Source: judgement."""

COVERED = (0.5, 99.5)
"""Percentiles of a reading between which its range lies, so that a single spike does not widen it
[%]. Source: judgement.
"""


def inner_parts(logs: Sequence[Samples]) -> list[Bools]:
    """Return, for each log, which samples lie in the inner part of what all logs cover, (k,): where
    max_i |x_i − m_i| / h_i is small.

    The maximum is over all readings and angles x_i; m_i is the middle of the range of x_i, and h_i
    is half of the range's length. The inner part holds the share `INNER` of all samples.
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
    """Return, for each held-out log, the errors in its outer part of the map that the inner parts
    of the other folds' logs teach.

    With a `homing` window [s] the map is updated by it first, and only the samples after it count.
    A fold is passed over where `learn` raises `FitError`.
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
